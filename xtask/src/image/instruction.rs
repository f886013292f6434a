//! What an instruction of a listing means for the stack and for where the program goes next.

/// An instruction as `objdump -d --no-show-raw-insn` lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Instruction {
    pub(crate) address: u32,
    /// The mnemonic, without the width that some have.
    name: String,
    operands: String,
    /// The constant that it loads stands there.
    pub(crate) literal: Option<u32>,
}

/// What an instruction does to the stack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stack {
    /// Nothing.
    Same,
    /// The stack grows by so many octets.
    Grows(u32),
    /// The stack shrinks by so many octets.
    Shrinks(u32),
    /// The same, but only if a condition holds.
    MayShrink,
}

/// Where the program goes after an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flow {
    /// To the next one.
    On,
    /// There.
    To(u32),
    /// There or to the next one.
    ToOrOn(u32),
    /// There, and back to the next one.
    Call(u32),
    /// By a table within the function.
    Table,
    /// Out of the function.
    Out,
    /// Nowhere that is known: through a register.
    Unknown,
}

const CONDITIONS: [&str; 16] =
    ["eq", "ne", "cs", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le", "hs", "lo"];

impl Instruction {
    /// Reads a line of a listing; `None` for anything but an instruction, data among code too.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let (address, rest) = line.split_once(':')?;
        let address = u32::from_str_radix(address.trim_start(), 16).ok()?;
        let rest = rest.strip_prefix('\t')?;
        let (name, operands) = rest.split_once('\t').unwrap_or((rest, ""));
        let name = name.trim().trim_end_matches(".n").trim_end_matches(".w");
        let (operands, comment) = operands.split_once(['@', ';']).unwrap_or((operands, ""));
        let operands = operands.trim();
        let of_pool = name.starts_with("ldr") && operands.contains("[pc, #");
        let literal = comment.split_whitespace().next().filter(|_| of_pool);
        let literal = literal.and_then(|word| u32::from_str_radix(word.trim_start_matches('('), 16).ok());
        let is_code = !name.is_empty() && !name.starts_with('.');
        is_code.then(|| Self { address, name: name.into(), operands: operands.into(), literal })
    }

    /// Whether it is what the linker fills gaps with, D4D4h, which reads as a jump.
    pub(crate) fn is_filler(&self) -> bool {
        self.name == "bmi" && self.flow() == Flow::ToOrOn(self.address.wrapping_sub(84))
    }

    /// Whether it is one of the floating point unit.
    pub(crate) fn is_float(&self) -> bool {
        self.name.starts_with('v')
    }

    /// Whether it comes back to the next one through a register.
    pub(crate) fn is_call(&self) -> bool {
        self.is("blx").is_some()
    }

    /// Whether it is done only if a condition holds.
    pub(crate) fn is_conditional(&self) -> bool {
        CONDITIONS.iter().any(|condition| self.name.ends_with(condition))
    }

    /// The register that it jumps or calls through.
    pub(crate) fn through(&self) -> Option<&str> {
        let is = self.is("blx").is_some() || self.is("bx").is_some();
        is.then_some(self.operands.as_str())
    }

    /// Whether the register may have another value after it.
    pub(crate) fn writes(&self, register: &str) -> bool {
        /// They only read.
        const READERS: [&str; 12] =
            ["str", "stm", "cmp", "cmn", "tst", "teq", "push", "cb", "tb", "vpush", "vst", "msr"];
        /// A call may leave anything in these.
        const LOST_BY_CALLS: [&str; 6] = ["r0", "r1", "r2", "r3", "ip", "lr"];
        let is_call = self.is("bl").is_some() || self.is_call();
        if is_call {
            return LOST_BY_CALLS.contains(&register);
        }
        if self.operands.contains(&format!("{register}!"))
            || self.operands.contains(&format!("[{register}],"))
            || (self.operands.contains(&format!("[{register}, ")) && self.operands.ends_with("]!"))
        {
            return true;
        }
        if matches!(self.flow(), Flow::To(_) | Flow::ToOrOn(_))
            || READERS.iter().any(|name| self.name.starts_with(name))
        {
            return false;
        }
        let Some((_, list)) = self.operands.split_once('{') else {
            let written = if self.name.starts_with("ldrd")
                || self.name.contains("mull")
                || self.name.contains("mlal")
            {
                2
            } else {
                1
            };
            return self.operands.split(", ").take(written).any(|operand| operand == register);
        };
        list.contains(register) || list.contains('-')
    }

    /// As in the listing, for people.
    pub(crate) fn text(&self) -> String {
        format!("{:x}: {} {}", self.address, self.name, self.operands)
    }

    /// Whether it is `name`, and under which condition.
    fn is(&self, name: &str) -> Option<&str> {
        let condition = self.name.strip_prefix(name)?;
        (condition.is_empty() || CONDITIONS.contains(&condition)).then_some(condition)
    }

    /// What it does to the stack.
    ///
    /// # Errors
    ///
    /// It changes the stack pointer in a way that is not known here.
    pub(crate) fn stack(&self) -> Result<Stack, String> {
        let unknown = || format!("{} changes the stack pointer in a way that is not followed", self.text());
        let conditional = self.is_conditional();
        let shrinks = |octets| if conditional { Stack::MayShrink } else { Stack::Shrinks(octets) };
        let list = || registers(&self.operands).ok_or_else(unknown);
        let of_stack = self.operands.starts_with("sp!,");
        if self.is("push").is_some() || self.is("vpush").is_some() {
            return Ok(Stack::Grows(list()?));
        }
        if self.is("pop").is_some() || self.is("vpop").is_some() {
            return Ok(shrinks(list()?));
        }
        if of_stack && (self.is("stmdb").is_some() || self.is("vstmdb").is_some()) {
            return Ok(Stack::Grows(list()?));
        }
        if of_stack && (self.is("ldmia").is_some() || self.is("vldmia").is_some()) {
            return Ok(shrinks(list()?));
        }
        if self.operands.contains("[sp, #-") && self.operands.ends_with("]!") {
            return Ok(Stack::Grows(number(&self.operands).ok_or_else(unknown)?));
        }
        if self.operands.contains("[sp], #") {
            return Ok(shrinks(number(&self.operands).ok_or_else(unknown)?));
        }
        let Some(rest) = self.operands.strip_prefix("sp, ") else {
            return if self.operands.contains("sp!") || self.writes_stack_pointer() {
                Err(unknown())
            } else {
                Ok(Stack::Same)
            };
        };
        if rest.starts_with('{') {
            // Registers stored where the stack pointer points, which stays as it is.
            return Ok(Stack::Same);
        }
        let octets = Some(rest.strip_prefix("sp, ").unwrap_or(rest)).filter(|rest| rest.starts_with('#'));
        let octets = octets.and_then(number);
        match (self.name.get(..3), octets) {
            (Some("add"), Some(octets)) => Ok(shrinks(octets)),
            (Some("sub"), Some(octets)) => Ok(Stack::Grows(octets)),
            (Some("cmp" | "cmn" | "tst"), _) => Ok(Stack::Same),
            _ => Err(unknown()),
        }
    }

    /// Anything that has the stack pointer in the first place, or writes it as a special register.
    fn writes_stack_pointer(&self) -> bool {
        self.operands == "sp" || (self.name.starts_with("msr") && self.operands.starts_with("MSP"))
    }

    /// Where the program goes after it.
    pub(crate) fn flow(&self) -> Flow {
        let target = || self.operands.rsplit_once(", ").map_or(self.operands.as_str(), |(_, last)| last);
        let target = || u32::from_str_radix(target().split(' ').next()?, 16).ok();
        let out = |condition: &str| if condition.is_empty() { Flow::Out } else { Flow::On };
        if self.name == "cbz" || self.name == "cbnz" {
            return target().map_or(Flow::Unknown, Flow::ToOrOn);
        }
        if let Some(condition) = self.is("b") {
            let to = if condition.is_empty() { Flow::To } else { Flow::ToOrOn };
            return target().map_or(Flow::Unknown, to);
        }
        if self.is("bl").is_some() {
            return target().map_or(Flow::Unknown, Flow::Call);
        }
        if let Some(condition) = self.is("bx") {
            return if self.operands == "lr" { out(condition) } else { Flow::Unknown };
        }
        if self.name == "tbb" || self.name == "tbh" {
            return Flow::Table;
        }
        if self.is("blx").is_some() || self.operands.starts_with("pc, ") {
            let returns = self.operands.starts_with("pc, [sp], #");
            return if returns { out(self.is("ldr").unwrap_or_default()) } else { self.jump_by_memory() };
        }
        let loads = ["pop", "ldmia"].into_iter().find_map(|name| self.is(name));
        match loads {
            Some(condition) if self.operands.contains("pc}") => out(condition),
            _ if self.name == "udf" => Flow::Out,
            _ => Flow::On,
        }
    }

    /// A jump through a table of addresses, which the compiler puts behind the function's code.
    fn jump_by_memory(&self) -> Flow {
        let by_table = self.is("ldr").is_some() && self.operands.ends_with(", lsl #2]");
        if by_table { Flow::Table } else { Flow::Unknown }
    }
}

/// How many octets the registers of a list have: `{r4, r7, lr}`, `{d8-d11}`, `{s16}`.
fn registers(operands: &str) -> Option<u32> {
    let inside = operands.split_once('{')?.1.split_once('}')?.0;
    inside.split(',').try_fold(0, |octets, part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let ((kind, first), (_, last)) = (register(first)?, register(last)?);
        let size = if kind == "d" { 8 } else { 4 };
        Some(octets + size * (last.checked_sub(first)? + 1))
    })
}

/// The kind and number of a register.
fn register(name: &str) -> Option<(&str, u32)> {
    Some(match name.trim() {
        "sl" => ("r", 10),
        "fp" => ("r", 11),
        "ip" => ("r", 12),
        "sp" => ("r", 13),
        "lr" => ("r", 14),
        "pc" => ("r", 15),
        named => (named.get(..1)?, named.get(1..)?.parse().ok()?),
    })
}

/// The number after `#`, without its sign.
fn number(operands: &str) -> Option<u32> {
    let text = operands.split_once('#')?.1.trim_start_matches('-').trim_end_matches(['!', ']']);
    text.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Instruction {
        Instruction::parse(&format!(" 8000400:\t{text}")).unwrap()
    }

    // Sizes by hand: a core register has 4 octets, a double register 8.
    #[test]
    fn what_the_stack_grows_and_shrinks_by() {
        for (text, due) in [
            ("push\t{r4, r6, r7, lr}", Stack::Grows(16)),
            ("stmdb\tsp!, {r8, r9, sl, fp}", Stack::Grows(16)),
            ("vpush\t{d8-d11}", Stack::Grows(32)),
            ("vpush\t{s16}", Stack::Grows(4)),
            ("str.w\tfp, [sp, #-4]!", Stack::Grows(4)),
            ("strd\tr4, r5, [sp, #-8]!", Stack::Grows(8)),
            ("sub\tsp, #24", Stack::Grows(24)),
            ("sub.w\tsp, sp, #512\t@ 0x200", Stack::Grows(512)),
            ("subw\tsp, sp, #1028\t@ 0x404", Stack::Grows(1028)),
            ("add\tsp, #24", Stack::Shrinks(24)),
            ("add.w\tsp, sp, #512\t@ 0x200", Stack::Shrinks(512)),
            ("ldmia.w\tsp!, {r7, lr}", Stack::Shrinks(8)),
            ("ldr.w\tfp, [sp], #4", Stack::Shrinks(4)),
            ("pop\t{r4, r5, pc}", Stack::Shrinks(12)),
            ("addne\tsp, #16", Stack::MayShrink),
            ("popne\t{r4, pc}", Stack::MayShrink),
            ("add\tr7, sp, #8", Stack::Same),
            ("str\tr2, [sp, #0]", Stack::Same),
            ("mov\tr7, sp", Stack::Same),
            ("cmp\tsp, r0", Stack::Same),
            ("msr\tPSP, r0", Stack::Same),
            ("stmia.w\tsp, {r0, r1, r3}", Stack::Same),
        ] {
            assert_eq!(read(text).stack(), Ok(due), "{text}");
        }
        for text in
            ["mov\tsp, r4", "sub.w\tsp, sp, r3", "ldr.w\tsp, [r0]", "msr\tMSP, r0", "stmia.w\tsp!, {r0}"]
        {
            assert!(read(text).stack().is_err(), "{text}");
        }
    }

    #[test]
    fn where_the_program_goes() {
        for (text, due) in [
            ("movs\tr0, #1", Flow::On),
            ("b.n\t8000414 <f+0x14>", Flow::To(0x0800_0414)),
            ("b.w\t80051e0 <g>", Flow::To(0x0800_51e0)),
            ("bne.w\t80051e0 <g>", Flow::ToOrOn(0x0800_51e0)),
            ("bls.n\t8000412 <f+0x12>", Flow::ToOrOn(0x0800_0412)),
            ("cbz\tr0, 8000412 <f+0x12>", Flow::ToOrOn(0x0800_0412)),
            ("bl\t80056a4 <g>", Flow::Call(0x0800_56a4)),
            ("blx\tr3", Flow::Unknown),
            ("bx\tr2", Flow::Unknown),
            ("bx\tlr", Flow::Out),
            ("bxeq\tlr", Flow::On),
            ("pop\t{r4, pc}", Flow::Out),
            ("popne\t{r4, pc}", Flow::On),
            ("ldmia.w\tsp!, {r4, r7, pc}", Flow::Out),
            ("ldr.w\tpc, [sp], #4", Flow::Out),
            ("ldr.w\tpc, [r1, r0, lsl #2]", Flow::Table),
            ("ldr.w\tpc, [r1, #4]", Flow::Unknown),
            ("mov\tpc, r0", Flow::Unknown),
            ("tbh\t[pc, ip, lsl #1]", Flow::Table),
            ("udf\t#0", Flow::Out),
            ("bfi\tr2, r3, #6, #26", Flow::On),
            ("bic.w\tr2, r3, #6", Flow::On),
        ] {
            assert_eq!(read(text).flow(), due, "{text}");
        }
    }

    // D4D4h at 800506a: 800506e and 2 x -44.
    #[test]
    fn what_fills_a_gap_is_known() {
        let line = |at: &str, to: &str| Instruction::parse(&format!(" {at}:\tbmi.n\t{to} <f+0x1e>")).unwrap();
        assert!(line("800506a", "8005016").is_filler());
        assert!(!line("800506a", "8005018").is_filler());
    }

    #[test]
    fn only_code_is_an_instruction() {
        for line in ["08000400 <Reset>:", " 8000440:\t.word\t0x20000000", "", "Disassembly of section .text:"]
        {
            assert_eq!(Instruction::parse(line), None, "{line}");
        }
        assert!(read("vldr\td16, [r0]").is_float());
        assert!(!read("yield").is_float());
    }
}
