//! Axes: where their ticks are, and what stands there.

/// An axis from a least to a greatest value, over so many pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axis {
    pub(crate) least: f64,
    pub(crate) most: f64,
    /// From tick to tick.
    step: f64,
}

impl Axis {
    /// An axis that ends at ticks, with at most so many parts.
    pub(crate) fn whole(least: f64, most: f64, parts: f64) -> Self {
        let (least, most) = if most > least {
            (least, most)
        } else {
            // A straight line is in the middle.
            let around = (least.abs() * 0.001).max(1.0);
            (least - around, least + around)
        };
        let step = nice((most - least) / parts);
        Self { least: (least / step).floor() * step, most: (most / step).ceil() * step, step }
    }

    /// An axis that ends where the values do.
    pub(crate) fn exact(least: f64, most: f64, parts: f64) -> Self {
        let most = if most > least { most } else { least + 1.0 };
        Self { least, most, step: nice((most - least) / parts) }
    }

    /// Where a value is, from 0 to 1.
    pub(crate) fn share(&self, value: f64) -> f64 {
        (value - self.least) / (self.most - self.least)
    }

    /// The values with a tick.
    pub(crate) fn ticks(&self) -> impl Iterator<Item = f64> {
        let (first, step) = ((self.least / self.step - 1e-9).ceil(), self.step);
        let last = self.most + step * 1e-6;
        (0..200u8).map(move |number| (first + f64::from(number)) * step).take_while(move |tick| *tick <= last)
    }

    /// A value of this axis in words: no more places than its ticks need, thousands apart.
    pub(crate) fn label(&self, value: f64) -> String {
        let places = if self.step >= 1.0 { 0 } else { places(self.step) };
        let text = format!("{:.places$}", value.abs());
        let (whole, part) = text.split_once('.').unwrap_or((&text, ""));
        let mut apart = String::new();
        for (at, digit) in whole.chars().enumerate() {
            if at > 0 && (whole.len() - at).is_multiple_of(3) && whole.len() > 4 {
                apart.push(' ');
            }
            apart.push(digit);
        }
        if !part.is_empty() {
            apart.push('.');
            apart.push_str(part);
        }
        let is_zero = text.bytes().all(|octet| matches!(octet, b'0' | b'.'));
        if value < 0.0 && !is_zero { format!("\u{2212}{apart}") } else { apart }
    }
}

/// The next of 1, 2, 5, 10 and so on that is not smaller.
fn nice(step: f64) -> f64 {
    let power = 10_f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= step * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and positive")]
fn places(step: f64) -> usize {
    (-step.log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize
}

/// The unit of a time axis for a span in seconds: what it is called, and its seconds.
pub(crate) fn time_unit(span: f64) -> (&'static str, f64) {
    match span {
        span if span <= 0.5 => ("ms", 1e-3),
        span if span <= 300.0 => ("s", 1.0),
        span if span <= 4.0 * 3600.0 => ("min", 60.0),
        _ => ("h", 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<String> {
        axis.ticks().map(|tick| axis.label(tick)).collect()
    }

    #[test]
    fn ticks_are_round_and_labels_have_the_places_that_they_need() {
        assert_eq!(labels(&Axis::whole(-3.0, 17.0, 5.0)), ["\u{2212}5", "0", "5", "10", "15", "20"]);
        assert_eq!(labels(&Axis::exact(0.1, 0.34, 5.0)), ["0.10", "0.15", "0.20", "0.25", "0.30"]);
        assert_eq!(labels(&Axis::whole(0.0, 40_000.0, 2.0)), ["0", "20 000", "40 000"]);
        assert_eq!(labels(&Axis::whole(0.0, 4_000.0, 2.0)), ["0", "2000", "4000"]);
        assert_eq!(labels(&Axis::whole(7.0, 7.0, 2.0)), ["6", "7", "8"]);
    }

    #[test]
    fn a_time_axis_has_a_unit_that_suits_its_span() {
        let units = [0.2, 16.0, 3_000.0, 90_000.0].map(|span| time_unit(span).0);
        assert_eq!(units, ["ms", "s", "min", "h"]);
    }
}
