//! Movements from a file.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use super::ShaftError;
use super::pieces::rounded_up;

/// More octets than this are refused.
const MOST_OCTETS: u64 = 64 << 20;

/// Reads points of time in nanoseconds and position from a file of two columns with a comma between:
/// seconds, and units. Further columns, empty lines and lines that begin with `#` mean nothing, nor does
/// a first line of names. Times count from the first.
///
/// # Errors
///
/// The file and the line, and what is wrong there.
pub(super) fn read(path: &Path) -> Result<Vec<(u64, f64)>, ShaftError> {
    let wrong = |what: String| ShaftError::File { file: path.display().to_string(), what };
    let file = File::open(path).map_err(|error| wrong(error.to_string()))?;
    if !file.metadata().is_ok_and(|metadata| metadata.is_file() && metadata.len() <= MOST_OCTETS) {
        return Err(wrong("it is no regular file of at most 64 MiB".to_owned()));
    }
    parse(BufReader::new(file.take(MOST_OCTETS))).map_err(wrong)
}

fn parse(lines: impl BufRead) -> Result<Vec<(u64, f64)>, String> {
    let mut points: Vec<(u64, f64)> = Vec::new();
    let mut first = None;
    let mut names_allowed = true;
    for (number, line) in lines.lines().enumerate() {
        let number = number + 1;
        let line = line.map_err(|error| format!("line {number}: {error}"))?;
        let line = line.trim_start_matches('\u{FEFF}').trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let is_first = std::mem::take(&mut names_allowed);
        let Some((seconds, position)) = columns(line) else {
            if is_first {
                continue;
            }
            return Err(format!(
                "line {number}: write seconds and position with a comma between, like 0.5,3.2"
            ));
        };
        let seconds = seconds - *first.get_or_insert(seconds);
        if !(0.0..=1e9).contains(&seconds) || position.abs() > 1e9 {
            return Err(format!("line {number}: times and positions are at most 1e9, and times go up"));
        }
        let nanos = rounded_up(seconds);
        if points.last().is_some_and(|(before, _)| *before >= nanos) {
            return Err(format!("line {number}: each time is later than the one before"));
        }
        points.push((nanos, position));
    }
    if points.is_empty() { Err("it has no points".to_owned()) } else { Ok(points) }
}

fn columns(line: &str) -> Option<(f64, f64)> {
    let mut columns = line.split(',').map(|column| column.trim().trim_matches('"').parse::<f64>());
    match (columns.next(), columns.next()) {
        (Some(Ok(seconds)), Some(Ok(position))) if seconds.is_finite() && position.is_finite() => {
            Some((seconds, position))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_comments_and_further_columns_mean_nothing() {
        let text = "time,position,speed\n# measured\n10,1.5,0\n\n10.5,2.5,0\r\n";
        assert_eq!(parse(text.as_bytes()), Ok(vec![(0, 1.5), (500_000_000, 2.5)]));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        for (text, line) in
            [("0,1\nx,2\n", "line 2"), ("0,1\n1,2\n1,3\n", "line 3"), ("0,nan\n1\n", "line 2")]
        {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.starts_with(line), "{error}");
        }
        assert!(parse("time,position\n".as_bytes()).is_err());
    }
}
