//! Where a call through a register goes: the compiler keeps a function's address there that it has loaded as a
//! constant, where the same one is called again and again.

use std::collections::{BTreeMap, BTreeSet};

use super::instruction::{Flow, Instruction};

/// Constants among the code, by their address.
pub(crate) type Words = BTreeMap<u32, u32>;

/// The aims of every call through a register, by the place of its instruction; what cannot be told is left out.
pub(crate) fn aims(code: &[Instruction], words: &Words) -> BTreeMap<usize, BTreeSet<u32>> {
    let before = before(code);
    let unknown = code.iter().enumerate().filter(|(_, one)| one.flow() == Flow::Unknown);
    let aims = unknown.filter_map(|(at, one)| Some((at, aims_of(code, words, &before, at, one.through()?)?)));
    aims.collect()
}

/// From which instructions each one is reached.
fn before(code: &[Instruction]) -> Vec<Vec<usize>> {
    let at: BTreeMap<u32, usize> = code.iter().enumerate().map(|(at, one)| (one.address, at)).collect();
    let mut before = vec![Vec::new(); code.len()];
    let mut tables = Vec::new();
    for (from, one) in code.iter().enumerate() {
        let flow = one.flow();
        if let Flow::To(to) | Flow::ToOrOn(to) | Flow::Call(to) = flow
            && let Some(to) = at.get(&to)
        {
            before[*to].push(from);
        }
        let goes_on = matches!(flow, Flow::On | Flow::ToOrOn(_) | Flow::Call(_)) || one.is_call();
        if goes_on && from + 1 < code.len() {
            before[from + 1].push(from);
        }
        if flow == Flow::Table {
            tables.push(from);
        }
    }
    for reached in before.iter_mut().skip(1).filter(|reached| reached.is_empty()) {
        reached.clone_from(&tables);
    }
    before
}

/// Every way back from a call to what its register was loaded with.
fn aims_of(
    code: &[Instruction],
    words: &Words,
    before: &[Vec<usize>],
    call: usize,
    register: &str,
) -> Option<BTreeSet<u32>> {
    let mut aims = BTreeSet::new();
    let mut seen = BTreeSet::new();
    let mut open = before.get(call)?.clone();
    if open.is_empty() {
        return None;
    }
    while let Some(at) = open.pop() {
        if !seen.insert(at) {
            continue;
        }
        let one = code.get(at)?;
        if one.writes(register) {
            // Nothing but a constant will do.
            aims.insert(words.get(&one.literal?)? & !1);
            if !one.is_conditional() {
                continue;
            }
        }
        let earlier = before.get(at)?;
        // The register came from outside.
        if earlier.is_empty() {
            return None;
        }
        open.extend(earlier);
    }
    Some(aims)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(text: &str) -> Vec<Instruction> {
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        let line = |(at, line): (usize, &str)| {
            let line = format!(" {:x}:\t{}", 0x0800_0400 + 2 * at, line.replacen(' ', "\t", 1));
            Instruction::parse(&line).unwrap()
        };
        lines.enumerate().map(line).collect()
    }

    fn found(text: &str) -> BTreeMap<usize, BTreeSet<u32>> {
        let words = [(0x0800_0500, 0x0800_1001), (0x0800_0504, 0x0800_2001)];
        aims(&code(text), &Words::from(words))
    }

    #[test]
    fn an_address_that_was_loaded_is_called() {
        let text = "ldr.w r8, [pc, #100]\t@ 8000500 <f+100>
            bl 8003000 <g>
            movs r1, #2
            blx r8
            blx r8";
        let due = BTreeSet::from([0x0800_1000]);
        assert_eq!(found(text), BTreeMap::from([(3, due.clone()), (4, due)]));
    }

    #[test]
    fn on_two_ways_there_may_be_two() {
        let text = "cbz r0, 8000406 <f+6>
            ldr r4, [pc, #100]\t@ 8000500 <f+100>
            b.n 8000408 <f+8>
            ldr r4, [pc, #100]\t@ 8000504 <f+104>
            blx r4";
        assert_eq!(found(text)[&4], BTreeSet::from([0x0800_1000, 0x0800_2000]));
    }

    #[test]
    fn what_is_no_constant_or_may_be_lost_is_not_told() {
        for text in [
            "ldr r4, [r0, #4]\nblx r4",
            "mov r4, r0\nblx r4",
            "movs r0, #1\nblx r4",
            "ldr r2, [pc, #100]\t@ 8000500 <f+100>\nbl 8003000 <g>\nblx r2",
            "ldr r4, [pc, #100]\t@ 8000500 <f+100>\npop {r3, r4}\nblx r4",
            "ldr r4, [pc, #100]\t@ 8000500 <f+100>\nldr r0, [r4], #4\nblx r4",
            "ldr r4, [pc, #100]\t@ 8000500 <f+100>\nldrd r0, r4, [r5]\nblx r4",
        ] {
            assert_eq!(found(text), BTreeMap::new(), "{text}");
        }
    }
}
