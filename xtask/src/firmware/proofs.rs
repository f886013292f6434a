//! What is proved of an image, by looking at nothing but the image.

use std::fmt::Write as _;

use super::Board;
use crate::image::{Calls, Deepest, Image};
use crate::tally::Tally;

/// The feature with which the image has a panic.
pub(super) const PANIC: &str = "panic-on-purpose";

/// The symbols between which the stack is: where it begins, and what it must not grow into.
const STACK_BEGINS: &str = "_stack_start";
const STATIC_ENDS: &str = "__euninit";

/// All proofs of one image.
pub(super) fn prove(board: &Board, image: &Image, tally: &mut Tally) {
    let mut check = |what: &str, result: Result<String, String>| {
        let (Ok(text) | Err(text)) = &result;
        println!("  {what}: {text}");
        tally.check(format!("{}: {what}", board.name), result.is_ok());
    };
    check("no panic", no_panic(image));
    check("stack", stack(image));
    check("no floating point in interrupts", no_float(image));
    let sizes = image.sizes();
    check("flash", within(sizes.flash, board.flash));
    check("RAM", within(sizes.ram, board.ram));
}

/// The image with a panic put in on purpose does not pass.
pub(super) fn prove_that_panics_show(bad: &Image, tally: &mut Tally) {
    let seen = no_panic(bad).is_err();
    println!("a panic put in on purpose: {}", if seen { "detected" } else { "NOT DETECTED" });
    tally.check("firmware: a panic put in on purpose is detected", seen);
}

fn within(octets: u32, limit: u32) -> Result<String, String> {
    let text = format!("{octets} octets, at most {limit}");
    if octets <= limit { Ok(text) } else { Err(format!("{text}: too many")) }
}

/// Nothing in the image is there for a panic: no function of core's, no message, no handler.
fn no_panic(image: &Image) -> Result<String, String> {
    let tells = |name: &str| name.contains("panic") || name.contains("rust_begin_unwind");
    let left: Vec<&str> =
        image.symbols.iter().map(|(name, _)| name.as_str()).filter(|name| tells(name)).collect();
    match left.as_slice() {
        [] => Ok(format!("none of {} symbols tells of one", image.symbols.len())),
        left => Err(format!("symbols of a panic are linked: {}", left.join(", "))),
    }
}

/// The octets of the deepest stack, and how they come about.
pub(super) fn worst_stack(image: &Image) -> Result<(u32, Vec<(String, Deepest)>), String> {
    let calls = Calls::of(image);
    let worst = calls.worst(|exception| image.priority(exception))?;
    Ok((worst.iter().map(|(_, deepest)| deepest.octets).sum(), worst))
}

fn stack(image: &Image) -> Result<String, String> {
    let (octets, worst) = worst_stack(image)?;
    let symbol = |name: &str| image.symbol(name).ok_or_else(|| format!("there is no symbol {name}"));
    let room = symbol(STACK_BEGINS)?.saturating_sub(symbol(STATIC_ENDS)?);
    let mut text = format!("{octets} octets at worst, there are {room}");
    for (who, deepest) in &worst {
        let path = deepest.path.iter().map(|(name, octets)| format!("{name} {octets}"));
        let _ = write!(text, "\n    {} {who}: {}", deepest.octets, path.collect::<Vec<_>>().join(" -> "));
    }
    if octets <= room { Ok(text) } else { Err(format!("too much: {text}")) }
}

fn no_float(image: &Image) -> Result<String, String> {
    match Calls::of(image).float_in_handlers() {
        None => Ok(format!("none below {} handlers", image.handlers().len())),
        Some(found) => Err(found),
    }
}
