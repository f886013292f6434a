//! The commands of a script, and their words.

use crate::commission::parameters::pair;

/// What a line asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Command {
    List,
    Station(u8),
    Status,
    Diag,
    Cfg,
    /// From a GSD file: module, and parameters by name.
    Gsd {
        file: String,
        module: Option<String>,
        set: Vec<(String, String)>,
    },
    /// The manual's defaults for a class, perhaps with units and range.
    Class {
        class: String,
        scaling: Option<(u32, u32)>,
        counter_clockwise: bool,
    },
    /// Set_Prm from octet 8 on, and Chk_Cfg.
    Hex {
        prm: Vec<u8>,
        cfg: Vec<u8>,
    },
    Watchdog(u32),
    Groups(u8),
    Modes {
        sync: bool,
        freeze: bool,
    },
    Start,
    Exchange(u32),
    Outputs(Vec<u8>),
    Preset(u32),
    /// Global_Control: its name, its command octet, and the groups that it is for, 0 for all.
    Control {
        name: &'static str,
        octet: u8,
        groups: u8,
    },
    Inputs,
    ReadOutputs,
    Wait(u64),
    Stop,
    Unlock,
    SetAddress(u8),
    Expect(String),
    Help,
    Quit,
}

/// What `help` prints.
pub(super) const HELP: &str = "\
list                          who is on the bus
station N                     the station that is meant from now on
status, diag, cfg             is it there; its diagnosis in words; its configuration
gsd FILE [MODULE] [NAME=VALUE ...]
                              parameters from a GSD file, set by the file's own names
class 1|2|scancon [units=N range=N] [ccw]
                              the manual's defaults for an SCH108BEX, perhaps scaled
hex PRM CFG                   Set_Prm from octet 8 on, and Chk_Cfg; each in quotes
watchdog MS                   0: off; 1000 if nothing is said
groups [N ...]                the station's groups, 1 to 8
modes [sync] [freeze]         which of them Set_Prm asks for
start                         parameterize: Set_Prm, Chk_Cfg, diagnosis
exchange [N]                  N exchanges, and the inputs then
outputs HEX                   the outputs from now on
preset VALUE                  bit 31 up, and down again
sync, unsync, freeze, unfreeze, clear, operate [GROUP ...]
                              Global_Control, to all or to groups
inputs, read-outputs          RD_Inp, RD_Outp: also of another master's station
wait SECONDS                  data exchange goes on
stop                          no data exchange any more, and the station is free
unlock                        frees a station that this master has not started
set-address N                 gives the station another address
expect TEXT                   fails if the answer before does not hold it
quit                          the end; so is the end of the file
Words with blanks stand in \"quotes\"; # begins a remark.";

impl Command {
    /// What a line asks for; `None`: nothing, it is blank or a remark.
    pub(super) fn parse(line: &str) -> Result<Option<Self>, String> {
        let words = words(line)?;
        let Some((name, rest)) = words.split_first() else { return Ok(None) };
        let rest: Vec<&str> = rest.iter().map(String::as_str).collect();
        let command = match (name.as_str(), rest.as_slice()) {
            ("list", []) => Self::List,
            ("station", [address]) => Self::Station(number(address, 126)?),
            ("status", []) => Self::Status,
            ("diag", []) => Self::Diag,
            ("cfg", []) => Self::Cfg,
            ("gsd", [file, rest @ ..]) => gsd(file, rest)?,
            ("class", [class, rest @ ..]) => self::class(class, rest)?,
            ("hex", [prm, cfg]) => Self::Hex { prm: octets(prm)?, cfg: octets(cfg)? },
            ("watchdog", [millis]) => Self::Watchdog(number(millis, 650_000)?),
            ("groups", numbers) => Self::Groups(groups(numbers)?),
            ("modes", modes) => modes_of(modes)?,
            ("start", []) => Self::Start,
            ("exchange", []) => Self::Exchange(1),
            ("exchange", [count]) => Self::Exchange(number(count, 1_000_000)?),
            ("outputs", [first, rest @ ..]) => Self::Outputs(octets(&[&[*first], rest].concat().join(" "))?),
            ("preset", [value]) => Self::Preset(number(value, 0x7FFF_FFFF)?),
            ("inputs", []) => Self::Inputs,
            ("read-outputs", []) => Self::ReadOutputs,
            ("wait", [seconds]) => Self::Wait(millis(seconds)?),
            ("stop", []) => Self::Stop,
            ("unlock", []) => Self::Unlock,
            ("set-address", [address]) => Self::SetAddress(number(address, 126)?),
            ("expect", [_, ..]) => Self::Expect(rest.join(" ")),
            ("help", []) => Self::Help,
            ("quit" | "exit", []) => Self::Quit,
            (name, rest) => return control(name, rest),
        };
        Ok(Some(command))
    }
}

/// Global_Control by name, or nothing that is known.
fn control(name: &str, rest: &[&str]) -> Result<Option<Command>, String> {
    let (name, octet) = match name {
        "sync" => ("Sync", 0x20),
        "unsync" => ("Unsync", 0x10),
        "freeze" => ("Freeze", 0x08),
        "unfreeze" => ("Unfreeze", 0x04),
        "clear" => ("Clear_Data", 0x02),
        "operate" => ("Operate", 0x00),
        _ => {
            let known = HELP.lines().any(|line| {
                line.split("  ").next().is_some_and(|names| names.split([' ', ',']).next() == Some(name))
            });
            return Err(if known {
                format!("{name} is not written like this; `help` says how")
            } else {
                format!("there is no command {name:?}; `help` lists those that there are")
            });
        }
    };
    Ok(Some(Command::Control { name, octet, groups: groups(rest)? }))
}

fn gsd(file: &str, rest: &[&str]) -> Result<Command, String> {
    let mut module = None;
    let mut set = Vec::new();
    for word in rest {
        match (word.contains('='), &module, set.is_empty()) {
            (true, ..) => set.push(pair(word)?),
            (false, None, true) => module = Some((*word).to_owned()),
            _ => {
                return Err(format!(
                    "{word:?}: behind the module only NAME=VALUE can stand, in quotes if it has blanks"
                ));
            }
        }
    }
    Ok(Command::Gsd { file: file.to_owned(), module, set })
}

fn class(class: &str, rest: &[&str]) -> Result<Command, String> {
    if !["1", "2", "scancon"].contains(&class) {
        return Err(format!("{class:?} is no class; write 1, 2 or scancon"));
    }
    let (mut units, mut range, mut counter_clockwise) = (None, None, false);
    for word in rest {
        match word.split_once('=') {
            Some(("units", value)) => units = Some(number(value, u32::MAX)?),
            Some(("range", value)) => range = Some(number(value, u32::MAX)?),
            None if *word == "ccw" => counter_clockwise = true,
            _ => return Err(format!("{word:?}: write units=N, range=N or ccw")),
        }
    }
    if units.is_some() != range.is_some() {
        return Err("units and range go together; write both".to_owned());
    }
    Ok(Command::Class { class: class.to_owned(), scaling: units.zip(range), counter_clockwise })
}

fn modes_of(words: &[&str]) -> Result<Command, String> {
    if let Some(other) = words.iter().find(|word| !["sync", "freeze"].contains(word)) {
        return Err(format!("{other:?} is no mode; write sync, freeze, both or nothing"));
    }
    Ok(Command::Modes { sync: words.contains(&"sync"), freeze: words.contains(&"freeze") })
}

fn groups(numbers: &[&str]) -> Result<u8, String> {
    numbers.iter().try_fold(0, |groups, text| {
        let group: u8 = number(text, 8)?;
        if group == 0 { Err("groups go from 1 to 8".to_owned()) } else { Ok(groups | 1 << (group - 1)) }
    })
}

fn number<T: TryFrom<u64> + Into<u64> + Copy>(text: &str, most: T) -> Result<T, String> {
    crate::arguments::whole::<T>(0..=most.into())(text).map_err(|why| format!("{text:?}: {why}"))
}

fn octets(text: &str) -> Result<Vec<u8>, String> {
    dissector::hex::octets(text).map_err(|error| format!("{text:?}: {error}"))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 86400 s")]
fn millis(text: &str) -> Result<u64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=86_400.0).contains(seconds));
    let seconds: f64 = seconds.ok_or_else(|| format!("{text:?}: write seconds from 0 to 86400, like 0.5"))?;
    Ok((seconds * 1e3) as u64)
}

/// The words of a line, up to a remark.
fn words(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '"' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            '#' if !quoted && word.is_none() => break,
            c if c.is_whitespace() && !quoted => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    if quoted {
        return Err("a quote is not closed".to_owned());
    }
    words.extend(word);
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Command {
        Command::parse(line).expect(line).expect("a command")
    }

    #[test]
    fn lines_are_commands() {
        assert_eq!(Command::parse("  # remark"), Ok(None));
        assert_eq!(Command::parse(""), Ok(None));
        assert_eq!(parsed("station 5 # the left one"), Command::Station(5));
        let gsd = Command::Gsd {
            file: "a b.gsd".to_owned(),
            module: Some("Class 2 Multiturn".to_owned()),
            set: vec![("Code sequence".to_owned(), "1".to_owned())],
        };
        assert_eq!(parsed("gsd \"a b.gsd\" \"Class 2 Multiturn\" \"Code sequence=1\""), gsd);
        let class =
            Command::Class { class: "2".to_owned(), scaling: Some((360, 720)), counter_clockwise: true };
        assert_eq!(parsed("class 2 units=360 range=720 ccw"), class);
        assert_eq!(parsed("outputs 80 00 03 E8"), Command::Outputs(vec![0x80, 0, 3, 0xE8]));
        assert_eq!(parsed("hex \"00 02\" D1"), Command::Hex { prm: vec![0, 2], cfg: vec![0xD1] });
        assert_eq!(parsed("groups 1 8"), Command::Groups(0x81));
        assert_eq!(parsed("wait 0.25"), Command::Wait(250));
        assert_eq!(parsed("expect 12 34"), Command::Expect("12 34".to_owned()));
    }

    // DP slave reference, Global_Control: bit 5 Sync, 4 Unsync, 3 Freeze, 2 Unfreeze, 1 Clear_Data.
    #[test]
    fn global_control_has_the_standards_bits() {
        for (line, octet, groups) in [
            ("sync", 0x20, 0),
            ("unsync 1", 0x10, 1),
            ("freeze 2 3", 0x08, 6),
            ("unfreeze", 0x04, 0),
            ("clear", 0x02, 0),
            ("operate", 0, 0),
        ] {
            let Command::Control { octet: sent, groups: to, .. } = parsed(line) else { panic!("{line}") };
            assert_eq!((sent, to), (octet, groups), "{line}");
        }
    }

    #[test]
    fn what_is_wrong_is_told() {
        for (line, words) in [
            ("fly", "no command \"fly\""),
            ("station", "not written like this"),
            ("station 127", "0 to 126"),
            ("class 3", "1, 2 or scancon"),
            ("class 2 units=5", "go together"),
            ("gsd a b c", "NAME=VALUE"),
            ("hex 0", "not written like this"),
            ("outputs 0", "two digits"),
            ("groups 0", "1 to 8"),
            ("modes both", "sync, freeze"),
            ("wait -1", "0 to 86400"),
            ("expect \"open", "not closed"),
        ] {
            let why = Command::parse(line).expect_err(line);
            assert!(why.contains(words), "{line}: {why}");
        }
    }

    #[test]
    fn help_has_every_command() {
        for name in ["list", "gsd", "hex", "freeze", "read-outputs", "expect", "quit", "modes", "preset"] {
            assert!(HELP.contains(name), "{name}");
        }
    }
}
