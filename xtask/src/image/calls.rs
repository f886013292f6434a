//! Who calls whom, and the deepest that the stack gets.

use std::collections::{BTreeMap, BTreeSet};

use super::frames::{Frame, frame};
use super::instruction::{Flow, Instruction};
use super::registers::Words;
use super::{Function, Image};

/// What the processor puts on the stack for an exception: eight registers, and a word where the stack was
/// not at a multiple of eight octets (Armv7-M, B1.5.7).
const EXCEPTION: u32 = 32 + 4;
/// The same with the registers of the floating point unit, where the program has used it.
const EXCEPTION_WITH_FLOAT: u32 = 104 + 4;

/// Calls of the compiler's own for floating point without the unit.
const SOFT_FLOAT: [&str; 8] = [
    "__aeabi_f",
    "__aeabi_d",
    "__aeabi_ui2",
    "__aeabi_i2",
    "__aeabi_ul2",
    "__aeabi_l2",
    "__adddf3",
    "__addsf3",
];

/// The functions of an image with what each needs of the stack.
#[derive(Debug)]
pub(crate) struct Calls<'a> {
    image: &'a Image,
    /// Of every function, or why it cannot be followed.
    frames: BTreeMap<u32, Result<Frame, String>>,
}

/// What the compiler has taken out of several functions because it is the same in them.
const OUTLINED: &str = "OUTLINED_FUNCTION_";

/// The code of a function, with what it has of that kind: there it goes on with its own stack and registers. And the
/// constants among all that.
fn with_outlined(image: &Image, function: &Function) -> (Vec<Instruction>, Words) {
    let (mut code, mut words) = (function.code.clone(), function.words.clone());
    let mut taken = BTreeSet::new();
    let mut at = 0;
    while let Some(instruction) = code.get(at) {
        if let Flow::To(to) | Flow::ToOrOn(to) | Flow::Call(to) = instruction.flow()
            && let Some(outlined) = image.functions.get(&to)
            && outlined.name.starts_with(OUTLINED)
            && taken.insert(to)
        {
            code.extend(outlined.code.iter().cloned());
            words.extend(&outlined.words);
        }
        at += 1;
    }
    (code, words)
}

/// The deepest path from somewhere.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Deepest {
    pub(crate) octets: u32,
    /// The functions on it, with the octets that each has on the stack there.
    pub(crate) path: Vec<(String, u32)>,
}

impl<'a> Calls<'a> {
    /// Reads every function.
    pub(crate) fn of(image: &'a Image) -> Self {
        let read = |(begin, function): (&u32, &Function)| {
            let (code, words) = with_outlined(image, function);
            let frame = frame(&code, function.end, &words);
            (*begin, frame.map_err(|error| format!("{}: {error}", function.name)))
        };
        Self { image, frames: image.functions.iter().map(read).collect() }
    }

    /// The deepest path from a function.
    ///
    /// # Errors
    ///
    /// A path that calls itself, a jump to where no function begins, or a call through a register.
    pub(crate) fn deepest(&self, from: u32) -> Result<Deepest, String> {
        self.deeper(from, &mut Vec::new(), &mut BTreeMap::new())
    }

    fn deeper(
        &self,
        from: u32,
        above: &mut Vec<u32>,
        known: &mut BTreeMap<u32, Deepest>,
    ) -> Result<Deepest, String> {
        if let Some(deepest) = known.get(&from) {
            return Ok(deepest.clone());
        }
        let name = self.image.name(from);
        let path = |of: &[u32]| of.iter().map(|one| self.image.name(*one)).collect::<Vec<_>>().join(" -> ");
        if above.contains(&from) {
            return Err(format!("{} -> {name}: it calls itself, so its stack has no bound", path(above)));
        }
        let frame = self
            .frames
            .get(&from)
            .ok_or_else(|| format!("{} jumps to {from:x}, where no function begins", path(above)))?
            .as_ref()
            .map_err(Clone::clone)?;
        if let Some(unknown) = frame.unknown.first() {
            let whom = "whom it calls is not known";
            return Err(format!("{name}: {unknown}: {whom} (on the way {})", path(above)));
        }
        above.push(from);
        let mut deepest = Deepest { octets: frame.own, path: vec![(name.clone(), frame.own)] };
        for (to, depth) in &frame.calls {
            let below = self.deeper(*to, above, known)?;
            if depth + below.octets > deepest.octets {
                let here = std::iter::once((name.clone(), *depth));
                deepest = Deepest { octets: depth + below.octets, path: here.chain(below.path).collect() };
            }
        }
        above.pop();
        known.insert(from, deepest.clone());
        Ok(deepest)
    }

    /// The deepest that the stack gets: the program, and on top of it one handler of each priority, each
    /// with what the processor puts there. `priority` tells the priority of an exception by its number; the
    /// smaller it is, the more urgent.
    ///
    /// # Errors
    ///
    /// As for [`deepest`](Self::deepest).
    pub(crate) fn worst(&self, priority: impl Fn(usize) -> i32) -> Result<Vec<(String, Deepest)>, String> {
        let frame = if self.image.has_float() { EXCEPTION_WITH_FLOAT } else { EXCEPTION };
        let mut levels: BTreeMap<i32, (String, Deepest)> = BTreeMap::new();
        for (number, handler) in self.image.handlers() {
            let mut deepest = self.deepest(handler)?;
            deepest.octets += frame;
            let level = levels.entry(priority(number)).or_default();
            if deepest.octets > level.1.octets {
                *level = (self.image.name(handler), deepest);
            }
        }
        let program = ("the program".to_owned(), self.deepest(self.image.reset())?);
        Ok(std::iter::once(program).chain(levels.into_values().rev()).collect())
    }

    /// Floating point that can be reached from an exception, with the way there; `None`: none.
    pub(crate) fn float_in_handlers(&self) -> Option<String> {
        self.image.handlers().into_iter().find_map(|(_, handler)| {
            let mut seen = BTreeSet::new();
            self.float_below(handler, &mut seen)
        })
    }

    fn float_below(&self, from: u32, seen: &mut BTreeSet<u32>) -> Option<String> {
        if !seen.insert(from) {
            return None;
        }
        let function = self.image.functions.get(&from)?;
        let soft = SOFT_FLOAT.iter().any(|begin| function.name.starts_with(begin));
        if let Some(found) =
            function.float().or_else(|| soft.then(|| "floating point without the unit".into()))
        {
            return Some(format!("{}: {found}", function.name));
        }
        let frame = match self.frames.get(&from)? {
            Ok(frame) if frame.unknown.is_empty() => frame,
            Ok(frame) => {
                return Some(format!("{}: {}: whom it calls is not known", function.name, frame.unknown[0]));
            }
            Err(error) => return Some(error.clone()),
        };
        frame.calls.keys().find_map(|to| {
            let found = self.float_below(*to, seen)?;
            Some(format!("{} -> {found}", function.name))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::functions;
    use super::*;

    /// An image of two exceptions: 15 goes to `tick`, 16 to `octet`.
    fn image(listing: &str) -> Image {
        let functions = functions(listing);
        let at = |name: &str| functions.iter().find(|(_, one)| one.name == name).map_or(0, |(at, _)| at | 1);
        let mut vectors = vec![0; 17];
        vectors[0] = 0x2002_0000;
        (vectors[1], vectors[15], vectors[16]) = (at("Reset"), at("tick"), at("octet"));
        Image { sections: Vec::new(), symbols: Vec::new(), priorities: Vec::new(), functions, vectors }
    }

    const TWO: &str = "
08000400 <Reset>:
 8000400:\tpush\t{r4, lr}
 8000402:\tbl\t8000410 <deep>
 8000406:\tpop\t{r4, pc}

08000410 <deep>:
 8000410:\tpush\t{r4, r5, r6, r7, lr}
 8000412:\tsub\tsp, #44
 8000414:\tadd\tsp, #44
 8000416:\tpop\t{r4, r5, r6, r7, pc}

08000420 <tick>:
 8000420:\tpush\t{r7, lr}
 8000422:\tbl\t8000410 <deep>
 8000426:\tpop\t{r7, pc}

08000430 <octet>:
 8000430:\tpush\t{r4, lr}
 8000432:\tpop\t{r4, pc}
";

    // By hand: deep 20 + 44 = 64; Reset 8 + 64; tick 8 + 64 + 36; octet 8 + 36.
    #[test]
    fn one_handler_of_each_priority_is_on_top_of_the_program() {
        let image = image(TWO);
        let calls = Calls::of(&image);
        let sum = |priority: fn(usize) -> i32| {
            calls.worst(priority).unwrap().iter().map(|(_, one)| one.octets).sum::<u32>()
        };
        assert_eq!(sum(|number| i32::try_from(number).unwrap()), 72 + 108 + 44);
        assert_eq!(sum(|_| 0), 72 + 108);
        let path = calls.deepest(0x0800_0420).unwrap().path;
        assert_eq!(path, [("tick".to_owned(), 8), ("deep".to_owned(), 64)]);
    }

    // By hand: Reset 8, then 24 more, given back by what was taken out of several functions.
    #[test]
    fn what_was_taken_out_of_several_functions_goes_on_with_their_stack() {
        let listing = "
08000400 <Reset>:
 8000400:\tpush\t{r4, lr}
 8000402:\tsub\tsp, #24
 8000404:\tbl\t8000420 <deep>
 8000408:\tb.n\t8000410 <OUTLINED_FUNCTION_0>

08000410 <OUTLINED_FUNCTION_0>:
 8000410:\tadd\tsp, #24
 8000412:\tpop\t{r4, pc}

08000420 <deep>:
 8000420:\tpush\t{r4, lr}
 8000422:\tpop\t{r4, pc}
";
        let image = image(listing);
        assert_eq!(Calls::of(&image).deepest(0x0800_0400).unwrap().octets, 8 + 24 + 8);
        // By itself it takes what nobody has put there.
        assert!(Calls::of(&image).deepest(0x0800_0410).is_err());
    }

    #[test]
    fn with_floating_point_exceptions_need_more() {
        let image = image(&TWO.replace("sub\tsp, #44", "vmov\ts0, r0").replace("add\tsp, #44", "nop"));
        let calls = Calls::of(&image);
        let worst = calls.worst(|_| 0).unwrap();
        assert_eq!(worst.iter().map(|(_, one)| one.octets).sum::<u32>(), 28 + 28 + 108);
        assert_eq!(calls.float_in_handlers().unwrap(), "tick -> deep: 8000412: vmov s0, r0");
    }

    #[test]
    fn floating_point_in_the_program_alone_is_fine() {
        let image = image(&TWO.replace("push\t{r4, lr}\n 8000402", "vpush\t{d8}\n 8000402"));
        assert_eq!(Calls::of(&image).float_in_handlers(), None);
    }

    #[test]
    fn a_stack_without_a_bound_is_told() {
        let told = |from: &str, to: &str| {
            let image = image(&TWO.replacen(from, to, 1).replace("add\tsp, #44", "nop"));
            Calls::of(&image).worst(|_| 0).unwrap_err()
        };
        let recursion = told("sub\tsp, #44", "bl\t8000410 <deep>");
        assert!(recursion.contains("it calls itself"), "{recursion}");
        let register = told("sub\tsp, #44", "blx\tr3");
        assert!(register.contains("8000412: blx r3: whom it calls is not known"), "{register}");
        let nowhere = told("bl\t8000410 <deep>", "bl\t8000418 <deep+8>");
        assert!(nowhere.contains("8000418, where no function begins"), "{nowhere}");
    }
}
