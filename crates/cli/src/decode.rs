//! `sch108bex decode`: telegrams in words.

mod captured;
mod filter;

use std::fmt::Write;
use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dissector::hex::{self, Token};
use dissector::{Conversation, Dissected, Entry, Item, Profile};
use sch108bex::specification::Variant;
use serde::Serialize;

use crate::gsd::Offer;
use crate::{Failure, output};
use filter::{Filter, Followed};

/// As much of the input as is looked at to tell text from octets.
const CHUNK: usize = 64 * 1024;

/// The options of `decode`.
#[derive(Debug, Args)]
#[command(
    after_help = "Text is two hexadecimal digits an octet; comments run from #, ; or // to the end of the line, \
                        and a blank line is a pause on the bus. Captures (pcapng) are known by their first octets.\n\
                        Status: 0 if every octet belongs to a telegram without a fault, else 1."
)]
pub(crate) struct Decode {
    /// Octets in hexadecimal; or one file; or - for standard input
    #[arg(value_name = "HEX... | FILE | -", required = true)]
    input: Vec<String>,
    /// Whose parameters, data and diagnoses are read beyond the standard's part
    #[arg(long, value_enum, default_value_t = ProfileName::Auto)]
    profile: ProfileName,
    /// A GSD of the encoder, for identifier octets of the functionalities other than ours
    #[arg(long, value_name = "FILE")]
    gsd: Option<PathBuf>,
    /// What a file or standard input holds; auto looks at its beginning
    #[arg(long, value_enum, default_value_t = Form::Auto, value_name = "FORM")]
    input_form: Form,
    /// Every field of every telegram
    #[arg(long, short)]
    verbose: bool,
    /// One document for each telegram, each in a line, with every field
    #[arg(long, conflicts_with = "verbose")]
    json: bool,
    #[command(flatten)]
    filter: Filter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ProfileName {
    /// The encoder's, where a telegram can be nothing else
    Auto,
    /// Every slave is an encoder
    Encoder,
    /// The standard only
    Dp,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Form {
    /// Text or octets
    Auto,
    /// Hexadecimal text
    Hex,
    /// The octets themselves
    Binary,
    /// A capture
    Pcapng,
}

/// What is printed, and whether all was well.
struct Printer<'a> {
    filter: &'a Filter,
    followed: Followed,
    /// Of a capture: the time of its first packet, and that of the newest; nanoseconds.
    times: Option<[u64; 2]>,
    /// Of a capture: what is said about the newest packet and not yet printed.
    comments: Vec<String>,
    json: bool,
    verbose: bool,
    faults: u64,
    entries: u64,
    /// Nobody reads any more.
    closed: bool,
}

/// An entry, with what a capture knows about it.
#[derive(Debug, Serialize)]
struct Captured<'a> {
    #[serde(flatten)]
    stamp: Option<Stamp>,
    #[serde(flatten)]
    entry: &'a Entry,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    comments: Vec<String>,
}

/// Something that happened between telegrams.
#[derive(Debug, Serialize)]
struct Note {
    #[serde(flatten)]
    stamp: Option<Stamp>,
    kind: &'static str,
    comments: Vec<String>,
}

/// When.
#[derive(Debug, Clone, Copy, Serialize)]
struct Stamp {
    /// Since the first packet.
    seconds: f64,
    /// Since 1970-01-01, or since the start where time was virtual.
    nanos: u64,
}

impl Decode {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let profile = match self.profile {
            ProfileName::Auto => Profile::Auto,
            ProfileName::Encoder => Profile::Encoder,
            ProfileName::Dp => Profile::Dp,
        };
        let mut conversation = Conversation::new(profile);
        if let Some(gsd) = &self.gsd {
            // What else does not fit is no matter of telegrams; `run` tells it.
            let offer = Offer::new(None, Some(gsd), Variant::FULL)?;
            conversation.set_configurations(offer.configurations);
        }
        let mut printer = Printer {
            filter: &self.filter,
            followed: Followed::default(),
            times: None,
            comments: Vec::new(),
            json: self.json,
            verbose: self.verbose,
            faults: 0,
            entries: 0,
            closed: false,
        };
        match self.input.as_slice() {
            [dash] if dash == "-" => {
                self.stream(&mut io::stdin().lock(), "standard input", &mut conversation, &mut printer)?;
            }
            [path] if !looks_like_octets(path) => {
                let mut file = open(path)?;
                self.stream(&mut file, path, &mut conversation, &mut printer)?;
            }
            octets => {
                let octets = hex::octets(&octets.join(" ")).map_err(|error| {
                    Failure::Usage(format!("{error}; or write one file name, or - for standard input"))
                })?;
                self.no_times()?;
                conversation.push(&octets, &mut |entry| printer.print(&entry));
            }
        }
        conversation.finish(&mut |entry| printer.print(&entry));
        printer.end()
    }

    fn no_times(&self) -> Result<(), Failure> {
        if self.filter.needs_times() {
            return Err(Failure::Usage(
                "--from and --to need a capture (pcapng): octets alone have no times".to_owned(),
            ));
        }
        Ok(())
    }

    /// Reads to the end, however far that is, in constant memory.
    fn stream(
        &self,
        input: &mut dyn Read,
        name: &str,
        conversation: &mut Conversation,
        printer: &mut Printer<'_>,
    ) -> Result<(), Failure> {
        let mut first = Vec::new();
        let magic = capture::reader::MAGIC;
        (&mut *input)
            .take(magic.len() as u64)
            .read_to_end(&mut first)
            .map_err(|error| Failure::Failed(format!("{name}: cannot be read: {error}")))?;
        let is_capture = self.input_form == Form::Auto && first == magic;
        let mut input = first.as_slice().chain(input);
        if is_capture || self.input_form == Form::Pcapng {
            return captured::stream(&mut input, name, conversation, printer);
        }
        self.no_times()?;
        let mut buffer = vec![0; CHUNK];
        let mut form = self.input_form;
        let mut text = hex::Reader::default();
        let wrong = |error: hex::HexError| Failure::Failed(format!("{name}: {error}"));
        while !printer.closed {
            let octets = match input.read(&mut buffer) {
                Ok(0) => break,
                Ok(count) => &buffer[..count],
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(Failure::Failed(format!("{name}: cannot be read: {error}"))),
            };
            if form == Form::Auto {
                form = if is_text(octets) { Form::Hex } else { Form::Binary };
            }
            if form == Form::Binary {
                conversation.push(octets, &mut |entry| printer.print(&entry));
                continue;
            }
            text.read(octets, |token| match token {
                Token::Octet(octet) => conversation.push(&[octet], &mut |entry| printer.print(&entry)),
                Token::Gap => conversation.finish(&mut |entry| printer.print(&entry)),
            })
            .map_err(wrong)?;
        }
        text.finish().map_err(wrong)
    }
}

impl Printer<'_> {
    /// The next entries are of a packet of this time.
    fn begin_packet(&mut self, nanos: u64, comments: Vec<String>) {
        let first = self.times.map_or(nanos, |[first, _]| first);
        (self.times, self.comments) = (Some([first, nanos]), comments);
    }

    /// A packet that has no octets is something that happened.
    fn end_packet(&mut self) {
        let comments = std::mem::take(&mut self.comments);
        let stamp = self.stamp();
        if self.closed || comments.is_empty() || !stamp.is_some_and(|at| self.filter.shows_note(at.seconds)) {
            return;
        }
        self.entries += 1;
        let printed = if self.json {
            output::json_line(&Note { stamp, kind: "note", comments })
        } else {
            output::try_line(&format!("{}       -- {}", time(stamp), comments.join("; ")))
        };
        self.closed = !printed;
    }

    fn stamp(&self) -> Option<Stamp> {
        let [first, nanos] = self.times?;
        #[expect(clippy::cast_precision_loss, reason = "exact for captures of a hundred days")]
        let seconds = nanos.saturating_sub(first) as f64 / 1e9;
        Some(Stamp { seconds, nanos })
    }

    fn print(&mut self, entry: &Entry) {
        if self.closed {
            return;
        }
        let (stamp, comments) = (self.stamp(), std::mem::take(&mut self.comments));
        let seconds = stamp.map(|stamp| stamp.seconds);
        if !self.filter.shows(entry, seconds, !comments.is_empty(), &mut self.followed) {
            return;
        }
        self.entries += 1;
        self.faults += u64::from(!matches!(entry.item, Item::Telegram(_)));
        let printed = if self.json {
            output::json_line(&Captured { stamp, entry, comments })
        } else {
            let mut text = format!("{}{}", time(stamp), lines(entry, self.verbose));
            for comment in comments {
                let _ = write!(text, "\n         note: {comment}");
            }
            output::try_line(&text)
        };
        self.closed = !printed;
    }

    fn end(&self) -> Result<(), Failure> {
        let nothing = "there is not one octet to decode; write octets like 10 0B 02 49 56 16";
        match (self.entries, self.faults) {
            // Nothing of what was asked for is no fault.
            (0, _) if self.filter.is_set() => Ok(()),
            (0, _) if self.times.is_some() => Ok(()),
            (0, _) => Err(Failure::Failed(nothing.to_owned())),
            (_, 0) => Ok(()),
            (entries, faults) => {
                Err(Failure::Failed(format!("{faults} of {entries} entries are no telegram without a fault")))
            }
        }
    }
}

/// A first argument that can only be a file does not.
fn looks_like_octets(text: &str) -> bool {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")).unwrap_or(text);
    !text.is_empty() && digits.chars().all(|c| c.is_ascii_hexdigit() || " ,:|<>xX\t\r\n".contains(c))
}

fn open(path: &str) -> Result<File, Failure> {
    let failed = |why: String| {
        Failure::Failed(format!(
            "{path}: {why}; write octets like 10 0B 02 49 56 16, a file, or - for standard input"
        ))
    };
    let file = File::open(path).map_err(|error| failed(format!("cannot be read: {error}")))?;
    match file.metadata() {
        Ok(data) if data.is_dir() => Err(failed("is a directory".to_owned())),
        _ => Ok(file),
    }
}

/// Text has no control characters but those that end lines; every telegram but a lone E5 has.
fn is_text(octets: &[u8]) -> bool {
    let cut_at_the_end = |error: std::str::Utf8Error| error.error_len().is_none() && error.valid_up_to() > 0;
    let control = |octet: &u8| octet.is_ascii_control() && !b"\t\n\r\x0C".contains(octet);
    std::str::from_utf8(octets).map_or_else(cut_at_the_end, |_| true) && !octets.iter().any(control)
}

/// When, for people: seconds since the first packet.
fn time(stamp: Option<Stamp>) -> String {
    stamp.map_or_else(String::new, |stamp| format!("{:15.9} ", stamp.seconds))
}

/// An entry for people.
fn lines(entry: &Entry, verbose: bool) -> String {
    let mut text = format!("{:>5}  ", entry.number);
    match &entry.item {
        Item::Telegram(telegram) => {
            text.push_str(&telegram.summary);
            text.push_str(&details(telegram, verbose));
        }
        Item::Bad { octets, words, .. } => {
            let _ = write!(text, "bad telegram: {words}\n         {octets}");
        }
        Item::Garbage { count, octets, words } => {
            let more = if *count > octets.len().div_ceil(3) as u64 { " ..." } else { "" };
            let _ = write!(text, "{count} octets skipped: {words}\n         {octets}{more}");
        }
    }
    text
}

fn details(telegram: &Dissected, verbose: bool) -> String {
    let mut text = String::new();
    for remark in &telegram.remarks {
        let place = remark.octet.map_or_else(String::new, |octet| format!("octet {octet}: "));
        let _ = write!(text, "\n         note: {place}{}", remark.words);
    }
    if !verbose {
        return text;
    }
    let _ = write!(text, "\n         {}", telegram.octets);
    for field in &telegram.fields {
        let place = |[first, last]: [usize; 2]| {
            if first == last { first.to_string() } else { format!("{first}-{last}") }
        };
        let mut octets = place(field.octets);
        if let Some([high, low]) = field.bits {
            let bits = if high == low { high.to_string() } else { format!("{high}-{low}") };
            let _ = write!(octets, " bit {bits}");
        }
        let data = field.data_octets.map_or_else(String::new, |octets| format!("data {}", place(octets)));
        let line = format!("{octets:14} {data:12} {} = {}  {}", field.name, field.value, field.words);
        let _ = write!(text, "\n         {}", line.trim_end());
    }
    text
}
