//! How deep the stack of a function gets, and how deep it is at each of its calls.

use std::collections::{BTreeMap, BTreeSet};

use super::instruction::{Flow, Instruction, Stack};
use super::registers::{Words, aims};

/// A function without those that it calls.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Frame {
    /// The most octets that it has on the stack itself.
    pub(crate) own: u32,
    /// Where it goes, calls and jumps alike, and the octets that it has on the stack then.
    pub(crate) calls: BTreeMap<u32, u32>,
    /// Jumps and calls through a register, as the listing has them.
    pub(crate) unknown: Vec<String>,
}

/// Follows every path through a function. `end` is the address behind it, which it may run into; `words` are the
/// constants among the code.
///
/// # Errors
///
/// The stack pointer is changed in a way that cannot be followed.
pub(crate) fn frame(code: &[Instruction], end: u32, words: &Words) -> Result<Frame, String> {
    let at: BTreeMap<u32, usize> = code.iter().enumerate().map(|(at, one)| (one.address, at)).collect();
    let aims = aims(code, words);
    let mut walk = Walk { code, at, end, aims, depths: vec![None; code.len()], frame: Frame::default() };
    let mut tables = Vec::new();
    walk.follow(0, 0, &mut tables)?;
    // Where a table leads is not read: it leads to all that nothing else does.
    while let Some(depth) = tables.iter().copied().max() {
        tables.clear();
        let unreached: Vec<usize> = (0..code.len()).filter(|at| walk.depths[*at].is_none()).collect();
        for at in unreached {
            if walk.depths[at].is_none() {
                walk.follow(at, depth, &mut tables)?;
            }
        }
    }
    Ok(walk.frame)
}

struct Walk<'a> {
    code: &'a [Instruction],
    at: BTreeMap<u32, usize>,
    end: u32,
    /// Where calls and jumps through registers go.
    aims: BTreeMap<usize, BTreeSet<u32>>,
    /// The deepest that the stack was before each instruction.
    depths: Vec<Option<u32>>,
    frame: Frame,
}

impl Walk<'_> {
    /// From one instruction to wherever it leads; `tables` takes the depths at jumps by a table.
    fn follow(&mut self, from: usize, depth: u32, tables: &mut Vec<u32>) -> Result<(), String> {
        let mut open = vec![(from, depth)];
        while let Some((at, before)) = open.pop() {
            if self.depths[at].is_some_and(|known| known >= before) {
                continue;
            }
            self.depths[at] = Some(before);
            let instruction = &self.code[at];
            let depth = match instruction.stack()? {
                Stack::Same | Stack::MayShrink => before,
                Stack::Grows(octets) => before + octets,
                Stack::Shrinks(octets) => before.checked_sub(octets).ok_or_else(|| {
                    format!("{} takes more from the stack than was put there", instruction.text())
                })?,
            };
            if depth > 0x1_0000 {
                return Err(format!("{} is in a loop that grows the stack", instruction.text()));
            }
            self.frame.own = self.frame.own.max(depth);
            let flow = instruction.flow();
            match flow {
                Flow::Call(to) if to == self.code[0].address => self.call(to, depth),
                // What was taken out of several functions is followed as if it stood here.
                Flow::To(to) | Flow::ToOrOn(to) | Flow::Call(to) => open.extend(self.go(to, depth)),
                Flow::Table => tables.push(depth),
                Flow::Unknown => match self.aims.get(&at).cloned() {
                    Some(aims) => aims.into_iter().for_each(|aim| self.call(aim, depth)),
                    None => self.frame.unknown.push(instruction.text()),
                },
                Flow::On | Flow::Out => {}
            }
            let comes_back = instruction.is_call();
            if matches!(flow, Flow::On | Flow::ToOrOn(_) | Flow::Call(_)) || comes_back {
                let next = self.code.get(at + 1).map_or(self.end, |next| next.address);
                open.extend(self.go(next, depth));
            }
        }
        Ok(())
    }

    /// A jump, within the function or into another.
    fn go(&mut self, to: u32, depth: u32) -> Option<(usize, u32)> {
        if let Some(at) = self.at.get(&to) {
            return Some((*at, depth));
        }
        self.call(to, depth);
        None
    }

    fn call(&mut self, to: u32, depth: u32) {
        let deepest = self.frame.calls.entry(to).or_default();
        *deepest = depth.max(*deepest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function at 8000400 whose instructions are all 2 octets long.
    fn of(text: &str) -> Result<Frame, String> {
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        let code: Vec<_> = lines
            .enumerate()
            .map(|(at, line)| {
                Instruction::parse(&format!(" {:x}:\t{}", 0x0800_0400 + 2 * at, line.replacen(' ', "\t", 1)))
                    .unwrap()
            })
            .collect();
        let end = 0x0800_0400 + 2 * u32::try_from(code.len()).unwrap();
        frame(&code, end, &Words::new())
    }

    #[test]
    fn calls_know_how_deep_the_stack_is() {
        let frame = of("push {r4, lr}
             bl 8001000 <g>
             sub sp, #16
             bl 8002000 <h>
             bl 8001000 <g>
             add sp, #16
             ldmia sp!, {r4, lr}
             b.w 8003000 <tail>")
        .unwrap();
        assert_eq!(frame.own, 24);
        let due = [(0x0800_1000, 24), (0x0800_2000, 24), (0x0800_3000, 0)];
        assert_eq!(frame.calls, BTreeMap::from(due));
    }

    #[test]
    fn the_deeper_of_two_paths_counts() {
        let frame = of("cbz r0, 8000406 <f+6>
             push {r4, r5, r6, lr}
             pop {r4, r5, r6, pc}
             push {r7, lr}
             bl 8001000 <g>
             pop {r7, pc}")
        .unwrap();
        assert_eq!((frame.own, frame.calls[&0x0800_1000]), (16, 8));
    }

    #[test]
    fn a_table_leads_to_what_nothing_else_does() {
        let frame = of("push {r4, lr}
             tbb [pc, r0]
             bl 8001000 <g>
             pop {r4, pc}
             sub sp, #32
             bl 8002000 <h>
             udf #0")
        .unwrap();
        assert_eq!(frame.own, 40);
        assert_eq!(frame.calls, BTreeMap::from([(0x0800_1000, 8), (0x0800_2000, 40)]));
    }

    #[test]
    fn what_cannot_be_followed_is_told() {
        assert_eq!(of("push {lr}\nblx r3\nbl 8001000 <g>\npop {pc}").unwrap().unknown, ["8000402: blx r3"]);
        assert_eq!(
            of("blx r3\nbl 8001000 <g>\npop {pc}").err().unwrap(),
            "8000404: pop {pc} takes more from the stack than was put there"
        );
        assert!(of("mov sp, r4\nbx lr").is_err());
        assert!(of("push {r0}\nb.n 8000400 <f>").unwrap_err().contains("loop that grows"));
    }

    #[test]
    fn running_into_the_next_function_is_a_jump() {
        assert_eq!(of("push {lr}\nnop").unwrap().calls, BTreeMap::from([(0x0800_0404, 4)]));
    }
}
