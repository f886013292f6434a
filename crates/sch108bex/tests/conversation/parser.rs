//! From text to steps, with a clear word about every line that is not one.

use profibus_dp::time::{Baudrate, Duration};

use super::script::{Action, Battery, Conversation, Due, Piece, Question, Setup, Step};
use super::values::{Parsed, bits, counts, duration, ident, number, octet, one_of, rate, span, tenths};

/// A line that cannot be read, and why.
#[derive(Debug)]
pub(crate) struct BadLine {
    pub(crate) line: usize,
    pub(crate) message: String,
}

/// A line without its comment, joined with the lines that continue it.
struct Line {
    number: usize,
    text: String,
}

/// Reads a whole file.
pub(crate) fn parse(text: &str) -> Result<Conversation, BadLine> {
    let lines = join(text)?;
    let mut header = Header::default();
    let mut rest = lines.iter().peekable();
    while let Some(line) = rest.peek() {
        let Some((key, value)) = header_entry(&line.text) else {
            break;
        };
        header.enter(key, value).map_err(|message| BadLine { line: line.number, message })?;
        rest.next();
    }
    if !text.trim_start().starts_with("# ") {
        return Err(BadLine { line: 1, message: "a conversation begins with `# ` and what it shows".into() });
    }
    let setup = header
        .setup()
        .map_err(|message| BadLine { line: rest.peek().map_or(1, |line| line.number), message })?;
    let steps = steps(&mut rest, None)?;
    if !steps.iter().any(|step| {
        matches!(step.action, Action::Exchange { .. } | Action::Foreign(_) | Action::Repeat { .. })
    }) {
        return Err(BadLine { line: 1, message: "nothing is said in this conversation".into() });
    }
    Ok(Conversation { setup, steps })
}

/// Drops comments, headings and empty lines; joins a telegram that goes on in further lines.
fn join(text: &str) -> Result<Vec<Line>, BadLine> {
    let mut lines: Vec<Line> = Vec::new();
    for (number, whole) in (1..).zip(text.lines()) {
        let text = whole.split(';').next().unwrap_or_default().trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        if continues(text) {
            let Some(before) = lines.last_mut().filter(|line| is_telegram(&line.text)) else {
                return Err(BadLine { line: number, message: format!("`{text}` goes on with no telegram") });
            };
            before.text.push(' ');
            before.text.push_str(text);
        } else {
            lines.push(Line { number, text: text.to_owned() });
        }
    }
    Ok(lines)
}

fn continues(text: &str) -> bool {
    let first = text.split_whitespace().next().unwrap_or_default();
    first == ".." || first == "--" || first.starts_with('|') || octet(first).is_ok()
}

fn is_telegram(text: &str) -> bool {
    text.starts_with(['>', '<', '+'])
}

const KEYS: [&str; 12] = [
    "source",
    "bits",
    "switches",
    "ident",
    "serial",
    "baud",
    "master baud",
    "stored address",
    "operating time",
    "receiver",
    "shaft",
    "memory",
];

fn header_entry(text: &str) -> Option<(&str, &str)> {
    let (key, value) = text.split_once(':')?;
    KEYS.contains(&key).then(|| (key, value.trim()))
}

/// `baud:` of the header.
#[derive(Clone, Copy)]
enum Rate {
    Auto,
    Fixed(Baudrate),
}

#[derive(Default)]
struct Header {
    source: Option<String>,
    bits: Option<(u8, u8)>,
    switches: Option<u8>,
    ident: Option<u16>,
    serial: Option<String>,
    baud: Option<Rate>,
    master_baud: Option<Baudrate>,
    stored_address: Option<u8>,
    operating_time: u64,
    stream: bool,
    shaft: i64,
    memory: Duration,
}

impl Header {
    fn enter(&mut self, key: &str, value: &str) -> Parsed<()> {
        match key {
            "source" => self.source = Some(value.to_owned()).filter(|text| !text.is_empty()),
            "bits" => self.bits = Some(bits(value)?),
            "switches" => self.switches = Some(octet(value)?),
            "ident" => self.ident = Some(ident(value)?),
            "serial" => self.serial = Some(value.to_owned()),
            "baud" if value == "auto" => self.baud = Some(Rate::Auto),
            "baud" => self.baud = Some(Rate::Fixed(rate(value)?)),
            "master baud" => self.master_baud = Some(rate(value)?),
            "stored address" => self.stored_address = Some(number(value)?),
            "operating time" => {
                let hours = value.strip_suffix(" h").ok_or("an operating time is in hours: `6.1 h`")?;
                self.operating_time =
                    u64::try_from(tenths(hours)?).map_err(|_| "an operating time is not negative")?;
            }
            "receiver" => self.stream = one_of(value, &[("idle", false), ("stream", true)])?,
            "shaft" => self.shaft = counts(value)?,
            "memory" => self.memory = duration(value)?,
            _ => return Err(format!("`{key}` is no header")),
        }
        Ok(())
    }

    fn setup(self) -> Parsed<Setup> {
        let missing = |what: &str| {
            format!("`{what}:` is missing in the header, or a line before this one is no header")
        };
        self.source.ok_or_else(|| missing("source"))?;
        let baud = match self.baud.ok_or_else(|| missing("baud"))? {
            Rate::Auto => None,
            Rate::Fixed(rate) => Some(rate),
        };
        Ok(Setup {
            bits: self.bits.ok_or_else(|| missing("bits"))?,
            switches: self.switches.ok_or_else(|| missing("switches"))?,
            ident: self.ident.ok_or_else(|| missing("ident"))?,
            serial: self.serial.ok_or_else(|| missing("serial"))?,
            baud,
            master_baud: self.master_baud.or(baud).ok_or_else(|| missing("master baud"))?,
            stream: self.stream,
            stored_address: self.stored_address,
            operating_time: self.operating_time,
            shaft: self.shaft,
            memory: self.memory,
        })
    }
}

type Lines<'a> = std::iter::Peekable<std::slice::Iter<'a, Line>>;

/// The steps up to the end of the file, or to the `end` of the `repeat` that began at `opened`.
fn steps(lines: &mut Lines<'_>, opened: Option<usize>) -> Result<Vec<Step>, BadLine> {
    let mut steps = Vec::new();
    while let Some(line) = lines.next() {
        if line.text == "end" {
            return match opened {
                Some(_) => Ok(steps),
                None => Err(BadLine { line: line.number, message: "`end` without `repeat`".into() }),
            };
        }
        let action = action(line, lines).map_err(|bad| match bad {
            Bad::Here(message) => BadLine { line: line.number, message },
            Bad::There(bad) => bad,
        })?;
        steps.push(Step { line: line.number, action });
    }
    match opened {
        Some(line) => Err(BadLine { line, message: "this `repeat` has no `end`".into() }),
        None => Ok(steps),
    }
}

enum Bad {
    Here(String),
    There(BadLine),
}

impl From<String> for Bad {
    fn from(message: String) -> Self {
        Self::Here(message)
    }
}

impl From<&str> for Bad {
    fn from(message: &str) -> Self {
        Self::Here(message.into())
    }
}

fn action(line: &Line, lines: &mut Lines<'_>) -> Result<Action, Bad> {
    let text = line.text.as_str();
    if let Some(rest) = text.strip_prefix(">>") {
        return exchange(octet_by_octet(pieces(rest)?), lines);
    }
    if let Some(rest) = text.strip_prefix('>') {
        return exchange(pieces(rest)?, lines);
    }
    if let Some(rest) = text.strip_prefix('+') {
        return Ok(Action::Foreign(pieces(rest)?));
    }
    if text.starts_with('<') {
        return Err("a `<` line without a `>` line right before it".into());
    }
    if text == "!! none" {
        return Ok(Action::NothingReported);
    }
    if let Some(words) = text.strip_prefix('!') {
        let words: Vec<_> = words.split_whitespace().map(str::to_lowercase).collect();
        if words.is_empty() || text.starts_with("!!") {
            return Err("`! words` or `!! none`".into());
        }
        return Ok(Action::Reported(words));
    }
    if let Some(question) = text.strip_prefix('?') {
        return Ok(Action::Ask(self::question(question.trim())?));
    }
    if let Some(times) = text.strip_prefix("repeat ").and_then(|rest| rest.strip_suffix(':')) {
        let body = steps(lines, Some(line.number)).map_err(Bad::There)?;
        return Ok(Action::Repeat { times: number(times)?, body });
    }
    Ok(world(text)?)
}

fn exchange(request: Vec<Piece>, lines: &mut Lines<'_>) -> Result<Action, Bad> {
    let due_line = lines
        .peek()
        .filter(|line| line.text.starts_with('<'))
        .ok_or("the `<` line that says what is due is missing: `< silence` if nothing is")?;
    let number = due_line.number;
    let due =
        due(due_line.text[1..].trim()).map_err(|message| Bad::There(BadLine { line: number, message }))?;
    lines.next();
    Ok(Action::Exchange { request, due_line: number, due })
}

fn due(text: &str) -> Parsed<Due> {
    match text {
        "silence" => return Ok(Due::Silence),
        "late" => return Ok(Due::Late),
        "unfetched" => return Ok(Due::Unfetched),
        _ => {}
    }
    let (perhaps, text) = text.strip_prefix("perhaps ").map_or((false, text), |rest| (true, rest));
    let (min_tsdr, text) = match text.strip_prefix('@') {
        Some(rest) => {
            let (bits, rest) = rest.split_once(' ').ok_or("`@N` is followed by the octets")?;
            (Some(number(bits)?), rest)
        }
        None => (None, text),
    };
    let octets: Vec<_> = text
        .split_whitespace()
        .map(|token| if token == ".." { Ok(None) } else { octet(token).map(Some) })
        .collect::<Parsed<_>>()?;
    if octets.is_empty() {
        return Err("`<` needs octets, or `silence`".into());
    }
    check_reply(&octets)?;
    Ok(Due::Reply { min_tsdr, octets, perhaps })
}

/// A reply that no slave could send is a slip of the pen.
fn check_reply(octets: &[Option<u8>]) -> Parsed<()> {
    let Some(known) = octets.iter().copied().collect::<Option<Vec<u8>>>() else {
        return Ok(());
    };
    let body = match known[..] {
        [0xE5] => return Ok(()),
        [0x10, ref body @ .., fcs, 0x16] if body.len() == 3 => (body, fcs),
        [0x68, le, ler, 0x68, ref body @ .., fcs, 0x16] if le == ler && body.len() == usize::from(le) => {
            (body, fcs)
        }
        _ => return Err("what is due is no telegram of a slave: look at delimiters and LE".into()),
    };
    let sum = body.0.iter().fold(0_u8, |sum, &o| sum.wrapping_add(o));
    if sum == body.1 {
        Ok(())
    } else {
        Err(format!("what is due has the check sum {:02X}, but its octets add up to {sum:02X}", body.1))
    }
}

fn pieces(text: &str) -> Parsed<Vec<Piece>> {
    let pieces: Vec<_> = text
        .split_whitespace()
        .map(|token| match token {
            "--" => Ok(Piece::Damaged),
            "|" => Ok(Piece::Read),
            _ => match token.strip_prefix('|') {
                Some(bits) => number(bits).map(Piece::Idle),
                None => octet(token).map(Piece::Octet),
            },
        })
        .collect::<Parsed<_>>()?;
    if pieces.is_empty() {
        return Err("no octets to send".into());
    }
    Ok(pieces)
}

fn octet_by_octet(pieces: Vec<Piece>) -> Vec<Piece> {
    pieces.into_iter().flat_map(|piece| [piece, Piece::Read]).collect()
}

fn question(text: &str) -> Parsed<Question> {
    match text {
        "on" => return Ok(Question::Powered(true)),
        "off" => return Ok(Question::Powered(false)),
        "address none" => return Ok(Question::Address(None)),
        _ => {}
    }
    if let Some(address) = text.strip_prefix("address ") {
        return Ok(Question::Address(Some(number(address)?)));
    }
    match text.strip_prefix("rate ") {
        Some(bits) => Ok(Question::Rate(rate(bits)?)),
        None => Err(format!("`? {text}`: the questions are `? address N`, `? rate N`, `? on` and `? off`")),
    }
}

/// The lines that are words.
fn world(text: &str) -> Parsed<Action> {
    let (word, rest) = text.split_once(' ').unwrap_or((text, ""));
    let rest = rest.trim();
    Ok(match (word, rest) {
        ("wait", _) => Action::Wait(span(rest)?),
        ("at", _) => Action::At(duration(rest)?),
        ("shaft", "stops") => Action::ShaftStops,
        ("shaft", _) if rest.starts_with("moves ") => shaft_moves(rest)?,
        ("shaft", _) => Action::Shaft(counts(rest)?),
        ("position", "error") => Action::PositionError,
        ("temperature", _) => Action::Temperature(tenths(rest)?),
        ("supply", _) => Action::Supply(tenths(rest)?),
        ("light", _) => Action::Light { ok: one_of(rest, &[("ok", true), ("low", false)])? },
        ("battery", _) => Action::Battery(one_of(
            rest,
            &[("ok", Battery::Ok), ("low", Battery::Low), ("empty", Battery::Empty)],
        )?),
        ("power", _) => one_of(rest, &[("on", Action::PowerOn), ("off", Action::PowerOff)])?,
        ("switches", _) => Action::Switches(octet(rest)?),
        ("line", "error") => Action::LineError,
        ("baud", _) => Action::Baud(rate(rest)?),
        _ => {
            return Err(match header_entry(text) {
                Some((key, _)) => format!("`{key}:` belongs to the header, before the first step"),
                None => format!("`{word}` begins no line that I know"),
            });
        }
    })
}

fn shaft_moves(text: &str) -> Parsed<Action> {
    let words: Vec<_> = text.splitn(5, ' ').collect();
    match words[..] {
        ["moves", moved, "counts", "per", time] => Ok(Action::ShaftMoves(counts(moved)?, duration(time)?)),
        _ => Err("`shaft moves 800 counts per 1 ms`".into()),
    }
}
