//! Words and values.

use profibus_dp::time::{Baudrate, Duration};

use crate::case::{Pattern, Span};
use crate::telegram::Atom;

/// What is wrong, in words.
pub(crate) type Parsed<T> = Result<T, String>;

/// The first word and the rest.
pub(crate) fn split_word(text: &str) -> (&str, &str) {
    let text = text.trim();
    text.split_once(char::is_whitespace).map_or((text, ""), |(word, rest)| (word, rest.trim()))
}

pub(crate) fn number<T: std::str::FromStr>(text: &str) -> Parsed<T> {
    text.trim().parse().map_err(|_| format!("`{text}` is no number that fits here"))
}

pub(crate) fn octet(text: &str) -> Parsed<u8> {
    if text.len() == 2 {
        u8::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no octet: two hex digits"))
    } else {
        Err(format!("`{text}` is no octet: two hex digits"))
    }
}

pub(crate) fn rate(text: &str) -> Parsed<Baudrate> {
    Baudrate::from_bits_per_second(number(text)?).ok_or_else(|| format!("`{text}` is none of the ten rates"))
}

pub(crate) fn span(text: &str) -> Parsed<Span> {
    const UNITS: [(&str, u64); 5] = [
        (" us", 1_000),
        (" ms", 1_000_000),
        (" s", 1_000_000_000),
        (" min", 60_000_000_000),
        (" h", 3_600_000_000_000),
    ];
    if let Some(bits) = text.strip_suffix(" bits") {
        return Ok(Span::Bits(number(bits)?));
    }
    UNITS
        .iter()
        .find_map(|(unit, nanos)| {
            let value = text.strip_suffix(unit)?;
            Some(number::<u64>(value).map(|value| Span::Time(Duration::from_nanos(value * nanos))))
        })
        .unwrap_or_else(|| Err(format!("`{text}` is no time: a whole number and bits, us, ms, s, min or h")))
}

/// A decimal number in tenths: at most one digit behind the point.
pub(crate) fn tenths(text: &str) -> Parsed<i32> {
    let (whole, tenth) = text.split_once('.').unwrap_or((text, "0"));
    if tenth.len() != 1 {
        return Err(format!("`{text}`: one digit behind the point at most"));
    }
    let magnitude = number::<i32>(whole.trim_start_matches('-'))? * 10 + number::<i32>(tenth)?;
    Ok(if whole.starts_with('-') { -magnitude } else { magnitude })
}

/// Words, with what stands in brackets kept together.
pub(crate) fn tokens(text: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let (mut start, mut depth) = (None, 0_u32);
    for (at, character) in text.char_indices() {
        match character {
            '[' => depth += 1,
            ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if character.is_whitespace() && depth == 0 {
            tokens.extend(start.take().map(|start| &text[start..at]));
        } else {
            start.get_or_insert(at);
        }
    }
    tokens.extend(start.map(|start| &text[start..]));
    tokens
}

pub(crate) fn atoms(text: &str) -> Parsed<Vec<Atom>> {
    tokens(text).into_iter().map(atom).collect()
}

pub(crate) fn patterns(text: &str) -> Parsed<Vec<Pattern>> {
    let mut patterns = Vec::new();
    for token in tokens(text) {
        if let Some(count) = token.strip_prefix("..x") {
            patterns.extend(std::iter::repeat_n(Pattern::Any, number(count)?));
        } else if token == "..." {
            patterns.push(Pattern::Rest);
        } else if token == ".." {
            patterns.push(Pattern::Any);
        } else if let Some((value, mask)) = token.split_once('/') {
            patterns.push(Pattern::Masked(octet(value)?, octet(mask)?));
        } else {
            patterns.push(Pattern::Atom(atom(token)?));
        }
    }
    Ok(patterns)
}

/// `8B`, `00x8`, `P2w[9=0A]`, `C1`, `O:01`, `units+1`, ...
fn atom(token: &str) -> Parsed<Atom> {
    if let Ok(value) = octet(token) {
        return Ok(Atom::Octet(value, 1));
    }
    if let Some((value, times)) = token.split_once('x')
        && let (Ok(value), Ok(times)) = (octet(value), number(times))
    {
        return Ok(Atom::Octet(value, times));
    }
    if let Some(prm) = token.strip_prefix('P') {
        return parameters(prm);
    }
    if let Some(value) = token.strip_prefix("O:") {
        return Ok(Atom::Outputs(octet(value)?));
    }
    if let Some(value) = token.strip_prefix('#') {
        return Ok(Atom::Number(number::<i64>(value).and_then(|value| {
            u32::try_from(value)
                .or_else(|_| i32::try_from(value).map(i32::cast_unsigned))
                .map_err(|_| format!("`{value}` does not fit into four octets"))
        })?));
    }
    let (name, more) = offset(token)?;
    let more_octet = || u8::try_from(more).map_err(|_| format!("`{token}`: too much"));
    Ok(match name {
        "S" => Atom::Own(0),
        "Sx" => Atom::Own(0x80),
        "M1" => Atom::Master(1, 0),
        "M1x" => Atom::Master(1, 0x80),
        "M2" => Atom::Master(2, 0),
        "M2x" => Atom::Master(2, 0x80),
        "N" => Atom::Other(0),
        "Nx" => Atom::Other(0x80),
        "C" => Atom::Cfg(None),
        "class1" => Atom::Cfg(Some(mode('1'))),
        "class2" => Atom::Cfg(Some(mode('2'))),
        "scancon" => Atom::Cfg(Some(mode('3'))),
        "O" => Atom::Outputs(0),
        "ident" => Atom::Ident(u16::try_from(more).map_err(|_| format!("`{token}`: too much"))?),
        "units" => Atom::Units(more),
        "range" => Atom::Range(more),
        "turns" => Atom::Turns,
        "serial" => Atom::Serial,
        "sum" => Atom::Sum(more_octet()?),
        "fc" => Atom::NextFc,
        "STAT" => Atom::Stat,
        _ => return Err(format!("`{token}` stands for no octets")),
    })
}

/// `units+1`, `range-1`
fn offset(token: &str) -> Parsed<(&str, i64)> {
    if let Some((name, more)) = token.split_once('+') {
        Ok((name, number(more)?))
    } else if let Some((name, less)) = token.split_once('-') {
        Ok((name, -number::<i64>(less)?))
    } else {
        Ok((token, 0))
    }
}

/// What cases call by a digit.
fn mode(digit: char) -> String {
    match digit {
        '1' => "class 1",
        '3' => "scancon",
        _ => "class 2",
    }
    .to_owned()
}

/// What follows the `P`: the mode, `w` for no watchdog, `[N=OCTETS]` and `[..COUNT]`.
fn parameters(text: &str) -> Parsed<Atom> {
    let mut rest = text;
    let (mut which, mut watchdog, mut changed, mut first) = (None, true, Vec::new(), None);
    if let Some(digit @ '1'..='3') = rest.chars().next() {
        which = Some(mode(digit));
        rest = &rest[1..];
    }
    if let Some(after) = rest.strip_prefix('w') {
        (watchdog, rest) = (false, after);
    }
    while let Some(inside) = rest.strip_prefix('[') {
        let (inside, after) =
            inside.split_once(']').ok_or_else(|| format!("`P{text}`: a bracket is missing"))?;
        rest = after;
        if let Some(count) = inside.strip_prefix("..") {
            first = Some(number(count)?);
        } else {
            let (at, octets) =
                inside.split_once('=').ok_or_else(|| format!("`[{inside}]`: `=` is missing"))?;
            let at = number(at)?;
            if at == 0 {
                return Err(format!("`[{inside}]`: octets count from 1"));
            }
            changed.push((at, atoms(octets)?));
        }
    }
    if rest.is_empty() {
        Ok(Atom::Prm { mode: which, watchdog, changed, first })
    } else {
        Err(format!("`P{text}`: {rest} means nothing"))
    }
}
