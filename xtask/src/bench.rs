//! `cargo xtask bench`: the figures that the project promises, and their limits.

use std::fmt::Write as _;
use std::fs;

use crate::measure::{ABSENT, Limit, Source, measure};
use crate::project::Project;
use crate::setup::Tools;
use crate::steps::Run;
use crate::tally::Tally;

/// One promised figure.
#[derive(Debug)]
struct Figure {
    name: &'static str,
    unit: &'static str,
    limit: Limit,
    source: Source,
}

const fn figure(name: &'static str, unit: &'static str, limit: Limit, source: Source) -> Figure {
    Figure { name, unit, limit, source }
}

use Limit::{AtLeast, AtMost, Unlimited};

const FIGURES: [Figure; 28] = [
    figure("data_exchange_4_in_instructions", "instructions", AtMost(320.0), Source::Callgrind("exchange-4")),
    figure(
        "data_exchange_12_in_instructions",
        "instructions",
        AtMost(340.0),
        Source::Callgrind("exchange-12"),
    ),
    figure("sample_instructions", "instructions", Unlimited, Source::Callgrind("sample")),
    figure("data_exchange_4_in_over_limit", "ratio", AtMost(3.0), Source::Timed("over-limit")),
    figure("foreign_telegram_6_instructions", "instructions", AtMost(90.0), Source::Callgrind("foreign-6")),
    figure(
        "foreign_telegram_255_instructions",
        "instructions",
        AtMost(400.0),
        Source::Callgrind("foreign-255"),
    ),
    figure("m4_octet_instructions", "instructions", AtMost(60.0), Source::M4),
    figure("m4_reply_instructions", "instructions", AtMost(230.0), Source::M4),
    figure("m4_sample_instructions", "instructions", AtMost(300.0), Source::M4),
    figure("pty_round_trip_ratio", "ratio", AtMost(1.25), Source::Program("round-trip")),
    figure("demo_cycle_us", "us", Unlimited, Source::Timed("demo-cycle")),
    figure("demo_cycle_over_profirust", "ratio", AtMost(1.5), Source::Timed("demo-cycle-ratio")),
    figure("start_to_ready_ms", "ms", AtMost(20.0), Source::Program("start")),
    figure("help_ms", "ms", AtMost(10.0), Source::Program("help")),
    figure("fw_foreign_octet_instructions", "instructions", AtMost(40.0), Source::Firmware),
    figure("fw_own_octet_instructions", "instructions", AtMost(80.0), Source::Firmware),
    figure("fw_reply_instructions", "instructions", AtMost(230.0), Source::Firmware),
    figure("fw_sample_instructions", "instructions", AtMost(500.0), Source::Firmware),
    // To be 6144, and the stack 1024: docs/figures.md tells what is in the way. Until then they do not grow.
    figure("fw_stack_text_octets", "octets", AtMost(8000.0), Source::Image),
    figure("fw_flash_kib", "KiB", AtMost(24.0), Source::Image),
    figure("fw_static_ram_kib", "KiB", AtMost(4.0), Source::Image),
    figure("fw_worst_stack_octets", "octets", AtMost(2600.0), Source::Image),
    figure("bus_125_times_real_time", "times", AtLeast(100.0), Source::Timed("bus-125")),
    figure("exchange_cost_10000_over_1", "ratio", AtMost(1.3), Source::Timed("cost-ratio")),
    figure("memory_per_encoder_kib", "KiB", AtMost(4.0), Source::Host("encoder-memory")),
    figure("late_answers_per_100000", "answers", AtMost(10.0), Source::Program("late")),
    figure("record_capture_cost_ratio", "ratio", AtMost(1.3), Source::Timed("record-capture")),
    figure("device_ram_octets", "octets", AtMost(1536.0), Source::Host("ram")),
];

/// What the command line asks for.
#[derive(Debug, Default)]
pub(crate) struct Options {
    only: Option<String>,
    gate: bool,
}

impl Options {
    /// `--only NAME`, `--gate`; `None` for anything else.
    pub(crate) fn parse(words: &[&str]) -> Option<Self> {
        let mut options = Self::default();
        let mut words = words.iter();
        while let Some(word) = words.next() {
            match *word {
                "--gate" => options.gate = true,
                "--only" => options.only = Some((*words.next()?).into()),
                _ => return None,
            }
        }
        Some(options)
    }
}

/// A figure as measured; without a value where a tool is missing.
struct Measured {
    figure: &'static Figure,
    value: Result<f64, String>,
}

impl Measured {
    fn over(&self) -> bool {
        self.value.as_ref().is_ok_and(|value| !self.figure.limit.holds(*value))
    }

    fn verdict(&self) -> &str {
        match (&self.value, self.figure.limit) {
            (Err(reason), _) => reason.lines().next().unwrap_or("not measured"),
            (_, Unlimited) => "-",
            (_, AtMost(_)) if self.over() => "OVER",
            (_, AtLeast(_)) if self.over() => "UNDER",
            _ => "within",
        }
    }
}

/// Measures, prints a table, writes `target/bench.json`.
///
/// # Errors
///
/// When a figure cannot be measured, or with `--gate` is over its limit.
pub(crate) fn run(project: &Project, options: &Options) -> Result<(), String> {
    let wanted = |figure: &&'static Figure| options.only.as_ref().is_none_or(|only| only == figure.name);
    let figures: Vec<&'static Figure> = FIGURES.iter().filter(wanted).collect();
    if figures.is_empty() {
        let names: Vec<&str> = FIGURES.iter().map(|figure| figure.name).collect();
        return Err(format!("There is no such figure. There are: {}.", names.join(", ")));
    }
    let measured = take(project, &Tools::find(project), &figures)?;
    let unmeasured = measured.iter().filter(|figure| figure.value.is_err()).count();
    let over = measured.iter().filter(|figure| figure.over()).count();
    let absent =
        measured.iter().any(|one| one.value.as_ref().is_err_and(|reason| reason.starts_with(ABSENT)));
    match (over, unmeasured) {
        (1.., _) if options.gate => Err(format!("{over} beyond the limit.")),
        (_, 0) => Ok(()),
        _ if absent => Err("To install what is missing: cargo xtask setup --yes".into()),
        _ => Err(format!("{unmeasured} not measured.")),
    }
}

/// The figures as a step of `cargo xtask test`: counts are judged always, times only in
/// continuous integration, where they have seven attempts.
pub(crate) fn gate(run: &Run<'_>) -> Result<Tally, String> {
    let figures: Vec<&'static Figure> = FIGURES.iter().collect();
    let measured = take(run.project, &run.tools, &figures)?;
    let mut tally = Tally::default();
    for one in &measured {
        match (&one.value, one.figure.source) {
            (Err(reason), _) if reason.starts_with(ABSENT) => tally.skip(one.figure.name, reason),
            (Err(reason), _) => {
                println!("{}: {reason}", one.figure.name);
                tally.check(one.figure.name, false);
            }
            (Ok(_), Source::Timed(_) | Source::Program(_)) if !run.project.ci => {}
            (Ok(_), _) if one.figure.limit == Unlimited => {}
            (Ok(value), _) => {
                tally.check(format!("{} is {value:.2}", one.figure.name), !one.over());
            }
        }
    }
    Ok(tally)
}

/// Measures, and leaves the table on the screen and in `target/bench.json`.
fn take(project: &Project, tools: &Tools, figures: &[&'static Figure]) -> Result<Vec<Measured>, String> {
    let wanted: Vec<_> = figures.iter().map(|figure| (figure.name, figure.source, figure.limit)).collect();
    let values = measure(project, tools, &wanted)?;
    let measured: Vec<_> =
        figures.iter().zip(values).map(|(figure, value)| Measured { figure, value }).collect();
    print!("{}", table(&measured));
    let path = project.target.join("bench.json");
    fs::write(&path, json(&measured))
        .map_err(|error| format!("{} cannot be written: {error}.", path.display()))?;
    Ok(measured)
}

fn table(measured: &[Measured]) -> String {
    let mut text = format!("{:<34} {:>10} {:<12} {:>8}  {}\n", "name", "value", "unit", "limit", "verdict");
    for one in measured {
        let value = one.value.as_ref().map_or_else(|_| "-".into(), |value| digits(*value));
        let limit = match one.figure.limit {
            Unlimited => "-".into(),
            AtMost(limit) => digits(limit),
            AtLeast(limit) => format!(">= {}", digits(limit)),
        };
        let (name, unit, verdict) = (one.figure.name, one.figure.unit, one.verdict());
        let _ = writeln!(text, "{name:<34} {value:>10} {unit:<12} {limit:>8}  {verdict}");
    }
    text
}

fn json(measured: &[Measured]) -> String {
    let rows = measured.iter().filter_map(|one| {
        let value = digits(*one.value.as_ref().ok()?);
        Some(format!(
            "  {{\"name\": \"{}\", \"value\": {value}, \"unit\": \"{}\"}}",
            one.figure.name, one.figure.unit
        ))
    });
    format!("[\n{}\n]\n", rows.collect::<Vec<_>>().join(",\n"))
}

/// Whole where it is whole, else two places.
fn digits(value: f64) -> String {
    if value.fract().abs() < 0.005 { format!("{value:.0}") } else { format!("{value:.2}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_options_are_read() {
        let options = Options::parse(&["--gate", "--only", "device_ram_octets"]).unwrap();
        assert!(options.gate);
        assert_eq!(options.only.as_deref(), Some("device_ram_octets"));
        assert!(Options::parse(&["--only"]).is_none());
        assert!(Options::parse(&["--fast"]).is_none());
    }

    #[test]
    fn what_was_measured_is_judged_and_written() {
        let ratio = figure("ratio", "ratio", AtMost(1.25), Source::M4);
        let ratio: &'static Figure = Box::leak(Box::new(ratio));
        let of = |value| Measured { figure: ratio, value };
        let all = [of(Ok(1.2)), of(Ok(1.26)), of(Err("no valgrind".into()))];
        assert_eq!(all.each_ref().map(Measured::verdict), ["within", "OVER", "no valgrind"]);
        assert_eq!(
            json(&all[..2]),
            "[\n  {\"name\": \"ratio\", \"value\": 1.20, \"unit\": \"ratio\"},\n  \
             {\"name\": \"ratio\", \"value\": 1.26, \"unit\": \"ratio\"}\n]\n"
        );
        assert!(table(&all).contains("OVER"));
        let times: &'static Figure =
            Box::leak(Box::new(figure("times", "times", AtLeast(100.0), Source::M4)));
        let times = [100.0, 99.9].map(|value| Measured { figure: times, value: Ok(value) });
        assert_eq!(times.each_ref().map(Measured::verdict), ["within", "UNDER"]);
        assert!(times[1].over() && table(&times).contains(">= 100"));
    }
}
