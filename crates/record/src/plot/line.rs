//! Samples as lines: no more points than can be seen, and gaps where there is nothing.

/// The lines through samples: as pixels, broken at gaps and where the value jumps further than `jump`.
///
/// Of the samples in one column of pixels the first, the least, the greatest and the last count.
pub(crate) fn lines(
    times: &[u64],
    values: &[f64],
    jump: f64,
    x: impl Fn(u64) -> f64,
    y: impl Fn(f64) -> f64,
) -> Vec<Vec<(f64, f64)>> {
    let mut all = Vec::new();
    let mut line = Vec::new();
    let mut column: Option<Column> = None;
    let mut before = f64::NAN;
    for (time, value) in times.iter().zip(values) {
        let breaks = value.is_nan() || (value - before).abs() > jump;
        before = *value;
        if breaks {
            column.take().into_iter().for_each(|column| column.put(&mut line, &y));
            if !line.is_empty() {
                all.push(std::mem::take(&mut line));
            }
            if value.is_nan() {
                continue;
            }
        }
        let at = x(*time);
        match &mut column {
            Some(open) if (open.pixel - at.floor()).abs() < 0.5 => open.add(at, *value),
            _ => {
                column.take().into_iter().for_each(|column| column.put(&mut line, &y));
                column = Some(Column::new(at, *value));
            }
        }
    }
    if let Some(column) = column {
        column.put(&mut line, &y);
    }
    if !line.is_empty() {
        all.push(line);
    }
    all
}

/// The samples in one column of pixels.
struct Column {
    pixel: f64,
    first: (f64, f64),
    last: (f64, f64),
    least: (f64, f64),
    most: (f64, f64),
}

impl Column {
    fn new(at: f64, value: f64) -> Self {
        let point = (at, value);
        Self { pixel: at.floor(), first: point, last: point, least: point, most: point }
    }

    fn add(&mut self, at: f64, value: f64) {
        self.last = (at, value);
        if value < self.least.1 {
            self.least = self.last;
        }
        if value > self.most.1 {
            self.most = self.last;
        }
    }

    fn put(self, line: &mut Vec<(f64, f64)>, y: &impl Fn(f64) -> f64) {
        let mut points = [self.first, self.least, self.most, self.last];
        points.sort_by(|one, other| one.0.total_cmp(&other.0));
        let mut last = None;
        for point in points {
            if last.replace(point) != Some(point) {
                line.push((point.0, y(point.1)));
            }
        }
    }
}

#[cfg(test)]
#[expect(clippy::cast_precision_loss, reason = "small numbers")]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_samples_in_a_pixel_are_its_first_least_greatest_and_last() {
        let times: Vec<u64> = (0..1_000).collect();
        let mut values = vec![0.0; 1_000];
        (values[200], values[700]) = (9.0, -9.0);
        let drawn = lines(&times, &values, f64::INFINITY, |time| time as f64 / 1024.0, |value| value);
        assert_eq!(
            drawn,
            [vec![(0.0, 0.0), (200.0 / 1024.0, 9.0), (700.0 / 1024.0, -9.0), (999.0 / 1024.0, 0.0)]]
        );
    }

    #[test]
    fn a_line_is_broken_at_gaps_and_jumps() {
        let values = [1.0, 2.0, f64::NAN, 3.0, 90.0, 91.0];
        let drawn = lines(&[0, 1, 2, 3, 4, 5], &values, 50.0, |time| 10.0 * time as f64, |value| value);
        let due = [vec![(0.0, 1.0), (10.0, 2.0)], vec![(30.0, 3.0)], vec![(40.0, 90.0), (50.0, 91.0)]];
        assert_eq!(drawn, due);
    }
}
