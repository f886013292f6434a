//! Counts the instructions of the firmware's passages, in the image as it ships.
//!
//! `measure IMAGE` runs it under QEMU, which logs every instruction, every exception and every
//! access to a USART (`-d exec,int -trace`, one instruction a block). The log is read afterwards:
//! nothing is added to the image, and the counts are those of its own code. Prints one
//! `name number` a line; `measure IMAGE --profile` also where the instructions of the dearest
//! passage of each kind are.
#![forbid(unsafe_code)]

mod drive;
mod log;

use std::process::ExitCode;
use std::{env, fs};

use drive::Kind;
use log::{Passage, passages};

/// The exceptions of the image: USART1 is interrupt 37.
const BUS: u32 = 16 + 37;
const LATCH: u32 = 15;

fn main() -> ExitCode {
    let mut words = env::args().skip(1);
    let Some(image) = words.next() else {
        eprintln!("Name the image: measure target/thumbv7em-none-eabihf/release/olimex_h405.");
        return ExitCode::from(2);
    };
    let profile = words.next().is_some_and(|word| word == "--profile");
    match measure(&image, profile) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(image: &str, profile: bool) -> Result<(), String> {
    let folder = env::temp_dir().join(format!("sch108bex-measure-{}", std::process::id()));
    fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}.", folder.display()))?;
    let result = drive::run(image, &folder).and_then(|sent| {
        let log = folder.join("log");
        let passages = passages(&log)?;
        Ok((sent, passages))
    });
    let _ = fs::remove_dir_all(&folder);
    let (sent, passages) = result?;
    let mut kinds = Vec::new();
    // Octets of the bus, in the order of the bus interrupts that read the data register.
    let bus: Vec<&Passage> =
        passages.iter().filter(|passage| passage.exception == BUS && passage.reads > 0).collect();
    if bus.len() != sent.len() {
        return Err(format!("{} octets were sent, but the image read {}.", sent.len(), bus.len()));
    }
    for (kind, passage) in sent.iter().zip(&bus) {
        kinds.push((*kind, *passage));
    }
    let worst = |kind: Kind| {
        let of = kinds.iter().filter(|(its, _)| *its == kind).map(|(_, passage)| *passage);
        of.max_by_key(
            |passage| if kind == Kind::Exchange { passage.to_first_write } else { passage.instructions },
        )
    };
    let latch = passages
        .iter()
        .filter(|passage| passage.exception == LATCH)
        .max_by_key(|passage| passage.instructions);
    let rows = [
        ("fw_foreign_octet_instructions", worst(Kind::Foreign), false),
        ("fw_foreign_last_octet_instructions", worst(Kind::ForeignLast), false),
        ("fw_own_octet_instructions", worst(Kind::Own), false),
        ("fw_reply_instructions", worst(Kind::Exchange), true),
        ("fw_reply_second_octet_instructions", worst(Kind::Exchange), false),
        ("fw_sample_instructions", latch, false),
    ];
    for (name, passage, to_write) in rows {
        let passage = passage.ok_or_else(|| format!("Nothing was seen of {name}."))?;
        let number = match name {
            "fw_reply_second_octet_instructions" => {
                passage.to_second_write.saturating_sub(passage.to_first_write)
            }
            _ if to_write => passage.to_first_write,
            _ => passage.instructions,
        };
        println!("{name} {number}");
        if profile {
            for (function, count) in &passage.functions {
                eprintln!("    {count:5} {function}");
            }
        }
    }
    Ok(())
}
