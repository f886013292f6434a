//! The values in a line: octets, numbers, times, choices, each with a word about what is wrong.

use profibus_dp::time::{Baudrate, Duration};

use super::script::Span;

pub(super) type Parsed<T> = Result<T, String>;

pub(super) fn one_of<T: Clone, const N: usize>(text: &str, choices: &[(&str, T); N]) -> Parsed<T> {
    choices.iter().find(|(name, _)| *name == text).map(|(_, value)| value.clone()).ok_or_else(|| {
        let names: Vec<_> = choices.iter().map(|(name, _)| *name).collect();
        format!("`{text}` is none of {}", names.join(", "))
    })
}

pub(super) fn octet(text: &str) -> Parsed<u8> {
    if text.len() == 2 && text.bytes().all(|c| c.is_ascii_hexdigit()) {
        u8::from_str_radix(text, 16).map_err(|error| error.to_string())
    } else {
        Err(format!("`{text}` is no octet: two hex digits"))
    }
}

pub(super) fn ident(text: &str) -> Parsed<u16> {
    if text.len() == 4 {
        u16::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no ident number"))
    } else {
        Err(format!("`{text}` is no ident number: four hex digits"))
    }
}

pub(super) fn number<T: std::str::FromStr>(text: &str) -> Parsed<T> {
    text.parse().map_err(|_| format!("`{text}` is no number that fits here"))
}

pub(super) fn counts(text: &str) -> Parsed<i64> {
    match text.strip_prefix("0x") {
        Some(hex) => i64::from_str_radix(hex, 16).map_err(|_| format!("`{text}` is no number")),
        None => number(text),
    }
}

pub(super) fn bits(text: &str) -> Parsed<(u8, u8)> {
    let (n, m) = text.split_once('x').ok_or("bits are singleturn x multiturn: `13x12`")?;
    Ok((number(n)?, number(m)?))
}

pub(super) fn rate(text: &str) -> Parsed<Baudrate> {
    Baudrate::from_bits_per_second(number(text)?).ok_or_else(|| format!("`{text}` is none of the ten rates"))
}

/// A decimal number in tenths: at most one digit behind the point.
pub(super) fn tenths(text: &str) -> Parsed<i64> {
    let (whole, tenth) = text.split_once('.').unwrap_or((text, "0"));
    if tenth.len() != 1 {
        return Err(format!("`{text}`: one digit behind the point at most"));
    }
    let magnitude: i64 = number(whole.trim_start_matches('-'))?;
    let magnitude = magnitude * 10 + number::<i64>(tenth)?;
    Ok(if whole.starts_with('-') { -magnitude } else { magnitude })
}

pub(super) fn span(text: &str) -> Parsed<Span> {
    match text.strip_suffix(" bits") {
        Some(bits) => Ok(Span::Bits(number(bits)?)),
        None => Ok(Span::Time(duration(text)?)),
    }
}

pub(super) fn duration(text: &str) -> Parsed<Duration> {
    const UNITS: [(&str, u64); 5] = [
        (" us", 1_000),
        (" ms", 1_000_000),
        (" s", 1_000_000_000),
        (" min", 60_000_000_000),
        (" h", 3_600_000_000_000),
    ];
    let (value, unit) = UNITS
        .iter()
        .find_map(|&(suffix, nanos)| Some((text.strip_suffix(suffix)?, nanos)))
        .ok_or_else(|| format!("`{text}` is no time: a number and us, ms, s, min or h"))?;
    let (whole, fraction) = value.split_once('.').unwrap_or((value, ""));
    let mut nanos = number::<u64>(whole)? * unit;
    if !fraction.is_empty() {
        let digits = u32::try_from(fraction.len()).map_err(|error| error.to_string())?;
        nanos += number::<u64>(fraction)? * unit / 10_u64.pow(digits);
    }
    Ok(Duration::from_nanos(nanos))
}
