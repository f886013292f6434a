//! An image for a Cortex-M, read as it is: sections, symbols, and the code as a disassembler lists it.
//!
//! The disassembler is GNU's objdump for ARM. It names every instruction, so that anything which changes
//! the stack pointer or jumps in a way that is not known here stands out; no decoder of our own could do that
//! in less than all of Thumb-2, and no small crate was found that knows its floating point part.

mod calls;
mod frames;
mod instruction;
mod registers;
mod sources;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use crate::process::{Show, run};
use crate::project::Project;

pub(crate) use calls::{Calls, Deepest};
use instruction::Instruction;
use registers::Words;

/// The disassembler, and Debian's package that has it.
pub(crate) const OBJDUMP: &str = "arm-none-eabi-objdump";
pub(crate) const OBJDUMP_PACKAGE: &str = "binutils-arm-none-eabi";

/// The table of priorities in an image: two octets for each exception, its number and its priority.
const PRIORITIES: &str = "INTERRUPT_PRIORITIES";

const LIMIT: Duration = Duration::from_mins(2);
/// Exceptions of the processor and interrupts of the part (Armv7-M, B1.5.2).
const FIRST_EXCEPTION: usize = 2;

/// What a linker has made.
#[derive(Debug)]
pub(crate) struct Image {
    pub(crate) sections: Vec<Section>,
    /// All symbols by their names as people write them.
    pub(crate) symbols: Vec<(String, u32)>,
    /// Pairs of exception number and priority, as the image has them; empty: it tells nothing.
    priorities: Vec<(usize, u8)>,
    /// Functions by their address.
    pub(crate) functions: BTreeMap<u32, Function>,
    /// The first words of the image: initial stack pointer, then where reset and exceptions go.
    vectors: Vec<u32>,
}

/// A part of memory.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Section {
    name: String,
    size: u32,
    /// It takes memory when the program runs.
    in_memory: bool,
    /// It is part of what is programmed.
    is_loaded: bool,
    is_code: bool,
    address: u32,
    loaded_at: u32,
}

/// A function as it is listed.
#[derive(Debug)]
pub(crate) struct Function {
    pub(crate) name: String,
    code: Vec<Instruction>,
    /// Constants among it.
    words: Words,
    end: u32,
}

/// How much memory an image takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Octets of non-volatile memory.
    pub(crate) flash: u32,
    /// Octets of RAM that are taken for good.
    pub(crate) ram: u32,
}

impl Image {
    /// Reads the image at `path`.
    ///
    /// # Errors
    ///
    /// The disassembler is missing, or what it lists is no image.
    pub(crate) fn read(project: &Project, path: &Path) -> Result<Self, String> {
        let dump = |options: &[&str]| {
            let mut command = project.command(OBJDUMP, options);
            run(command.arg(path), LIMIT, Show::Nothing)?.expect_success(OBJDUMP)
        };
        let table = dump(&["-t", "-C"])?;
        let priorities = match extent(&table, PRIORITIES) {
            None => Vec::new(),
            Some((from, to)) => {
                let bounds = [format!("--start-address={from}"), format!("--stop-address={to}")];
                pairs(&words(&dump(&["-s", &bounds[0], &bounds[1]])?), to - from)
            }
        };
        let image = Self {
            sections: sections(&dump(&["-h"])?),
            symbols: symbols(&table),
            priorities,
            functions: functions(&dump(&["-d", "-C", "--no-show-raw-insn"])?),
            vectors: words(&dump(&["-s", "-j", ".vector_table"])?),
        };
        if image.functions.len() < 2 || image.vectors.len() <= FIRST_EXCEPTION {
            return Err(format!("{} is no image of a Cortex-M that was not stripped.", path.display()));
        }
        Ok(image)
    }

    /// The address that a symbol of the linker stands for.
    pub(crate) fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.iter().find(|(known, _)| known == name).map(|(_, address)| *address)
    }

    /// The name of the function at an address.
    pub(crate) fn name(&self, address: u32) -> String {
        let function = self.functions.get(&address);
        function.map_or_else(|| format!("{address:x}"), |function| function.name.clone())
    }

    /// Where the program begins.
    pub(crate) fn reset(&self) -> u32 {
        self.vectors.get(1).map_or(0, |word| word & !1)
    }

    /// Where exceptions go that have something to do, by their numbers; those that share the handler of all
    /// others are left out.
    pub(crate) fn handlers(&self) -> Vec<(usize, u32)> {
        let default = self.symbol("DefaultHandler_").or_else(|| self.symbol("DefaultHandler"));
        let numbered = self.vectors.iter().enumerate().skip(FIRST_EXCEPTION);
        let used = numbered.map(|(number, word)| (number, word & !1));
        used.filter(|(_, handler)| *handler != 0 && Some(*handler) != default).collect()
    }

    /// The priority of an exception, the urgent ones first; one that is not told is more urgent than all
    /// others, and by itself.
    pub(crate) fn priority(&self, exception: usize) -> i32 {
        let told = self.priorities.iter().find(|(number, _)| *number == exception);
        let unknown = || -1 - i32::try_from(exception).unwrap_or_default();
        told.map_or_else(unknown, |(_, priority)| i32::from(*priority))
    }

    /// How much memory it takes.
    pub(crate) fn sizes(&self) -> Sizes {
        /// From here on there is RAM (Armv7-M, B3.1).
        const RAM: u32 = 0x2000_0000;
        let sum = |of: &dyn Fn(&Section) -> bool| {
            self.sections.iter().filter(|one| of(one)).map(|one| one.size).sum()
        };
        Sizes {
            flash: sum(&|one| one.is_loaded && one.loaded_at < RAM),
            ram: sum(&|one| one.in_memory && one.address >= RAM),
        }
    }

    /// Whether any instruction is one of the floating point unit.
    pub(crate) fn has_float(&self) -> bool {
        self.functions.values().any(|function| function.code.iter().any(Instruction::is_float))
    }
}

impl Function {
    /// The first floating point instruction.
    fn float(&self) -> Option<String> {
        self.code.iter().find(|one| one.is_float()).map(Instruction::text)
    }
}

/// The sections in the table of `objdump -h`: two lines each, the second with their flags.
fn sections(table: &str) -> Vec<Section> {
    let lines: Vec<&str> = table.lines().collect();
    let section = |pair: &[&str]| {
        let words: Vec<&str> = pair[0].split_whitespace().collect();
        let [number, name, size, address, loaded_at, ..] = words[..] else { return None };
        number.parse::<u32>().ok()?;
        let hex = |text| u32::from_str_radix(text, 16).ok();
        let has = |flag: &str| pair[1].split(',').any(|word| word.trim() == flag);
        Some(Section {
            name: name.into(),
            size: hex(size)?,
            in_memory: has("ALLOC"),
            is_loaded: has("LOAD"),
            is_code: has("CODE"),
            address: hex(address)?,
            loaded_at: hex(loaded_at)?,
        })
    };
    lines.windows(2).filter_map(section).collect()
}

/// The symbols in the table of `objdump -t`: address, flags, section, a tab, size, name.
fn symbols(table: &str) -> Vec<(String, u32)> {
    let symbol = |line: &str| {
        let (front, back) = line.split_once('\t')?;
        let address = u32::from_str_radix(front.split(' ').next()?, 16).ok()?;
        let name = back.split_once(' ')?.1.trim_start().trim_start_matches(".hidden ");
        Some((name.to_owned(), address & !1))
    };
    table.lines().filter_map(symbol).collect()
}

/// Where an object begins and ends, by the same table.
fn extent(table: &str, name: &str) -> Option<(u32, u32)> {
    let line = table.lines().find(|line| line.ends_with(&format!(" {name}")))?;
    let (front, back) = line.split_once('\t')?;
    let from = u32::from_str_radix(front.split(' ').next()?, 16).ok()?;
    let size = u32::from_str_radix(back.split(' ').next()?, 16).ok()?;
    Some((from, from + size))
}

/// So many octets of words, two and two.
fn pairs(words: &[u32], octets: u32) -> Vec<(usize, u8)> {
    let all = words.iter().flat_map(|word| word.to_le_bytes()).take(octets as usize);
    let all: Vec<u8> = all.collect();
    all.chunks_exact(2).map(|pair| (pair[0].into(), pair[1])).collect()
}

/// The functions of a listing: each begins with `ADDRESS <NAME>:`.
fn functions(listing: &str) -> BTreeMap<u32, Function> {
    let mut functions: BTreeMap<u32, Function> = BTreeMap::new();
    let mut open: Option<(u32, Function)> = None;
    for line in listing.lines() {
        let address = |text: &str| u32::from_str_radix(text, 16).ok();
        if let Some((begin, name)) = line.strip_suffix(">:").and_then(|line| line.split_once(" <"))
            && let Some(begin) = address(begin)
        {
            functions.extend(open.take());
            open = Some((
                begin,
                Function { name: name.into(), code: Vec::new(), words: Words::new(), end: begin },
            ));
        } else if let Some((_, function)) = &mut open {
            function.code.extend(Instruction::parse(line));
            function.words.extend(constant(line));
            if let Some(at) = line.split_once(':').and_then(|(at, _)| address(at.trim_start())) {
                // The listing has the address of each line but not its length: the next one tells.
                function.end = function.end.max(at + 2);
            }
        }
    }
    functions.extend(open.take());
    for function in functions.values_mut() {
        function.code.pop_if(|last| last.is_filler());
    }
    let begins: Vec<u32> = functions.keys().copied().collect();
    for pair in begins.windows(2) {
        if let Some(function) = functions.get_mut(&pair[0]) {
            function.end = pair[1];
        }
    }
    functions
}

/// A line of a listing that is a constant: `ADDRESS:`, a tab, `.word`, a tab, `0x...`.
fn constant(line: &str) -> Option<(u32, u32)> {
    let (address, rest) = line.split_once(":\t.word\t0x")?;
    let word = rest.split_whitespace().next()?;
    Some((u32::from_str_radix(address.trim_start(), 16).ok()?, u32::from_str_radix(word, 16).ok()?))
}

/// The words of a section as `objdump -s` prints it: address, four groups of hex, the same as text.
fn words(dump: &str) -> Vec<u32> {
    let lines = dump.lines().filter_map(|line| line.strip_prefix(' '));
    let groups = lines.filter_map(|line| Some(line.split_once("  ")?.0.split_once(' ')?.1.to_owned()));
    let words: Vec<String> =
        groups.flat_map(|groups| groups.split(' ').map(str::to_owned).collect::<Vec<_>>()).collect();
    // The last may have fewer octets.
    let word = |word: &String| u32::from_str_radix(&format!("{word:0<8}"), 16).ok();
    words.iter().filter_map(word).map(u32::swap_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flash_and_ram_are_summed_over_the_sections() {
        let table = "Idx Name          Size      VMA       LMA       File off  Algn
  0 .vector_table 00000400  08000000  08000000  00010000  2**2
                  CONTENTS, ALLOC, LOAD, READONLY, DATA
  1 .text         00001000  08000400  08000400  00010400  2**2
                  CONTENTS, ALLOC, LOAD, READONLY, CODE
  3 .data         00000020  20000000  08001400  00020000  2**2
                  CONTENTS, ALLOC, LOAD, DATA
  5 .bss          00000108  20000020  20000020  00020000  2**2
                  ALLOC
  7 .debug_abbrev 00000844  00000000  00000000  00020000  2**0
                  CONTENTS, READONLY, DEBUGGING, OCTETS
";
        let image = Image {
            sections: sections(table),
            symbols: Vec::new(),
            priorities: Vec::new(),
            functions: BTreeMap::new(),
            vectors: Vec::new(),
        };
        assert_eq!(image.sections.len(), 5);
        assert_eq!(image.sizes(), Sizes { flash: 0x1420, ram: 0x128 });
    }

    #[test]
    fn symbols_have_their_names_as_people_write_them() {
        let table = "20000008 g       .uninit\t00000000 __euninit
0800056d l     F .text\t000000b6 <a::B as c::D>::e
20020000 g       *ABS*\t00000000 _stack_start
08000622 g     F .text\t00000008 .hidden main
";
        let due = [
            ("__euninit", 0x2000_0008),
            ("<a::B as c::D>::e", 0x0800_056c),
            ("_stack_start", 0x2002_0000),
            ("main", 0x0800_0622),
        ];
        assert_eq!(symbols(table), due.map(|(name, address)| (name.to_owned(), address)));
    }

    #[test]
    fn the_priorities_are_those_in_the_image() {
        let table = "08000300 g     O .rodata\t00000006 INTERRUPT_PRIORITIES\n";
        assert_eq!(extent(table, PRIORITIES), Some((0x0800_0300, 0x0800_0306)));
        // Exception 15 with priority 40h, 14 with 40h, 53 with 00h; what follows is no part of it.
        let found = pairs(&[0x400e_400f, 0xffff_0035], 6);
        assert_eq!(found, [(15, 0x40), (14, 0x40), (53, 0)]);
    }

    #[test]
    fn a_function_ends_where_the_next_begins() {
        let listing = "
08000400 <Reset>:
 8000400:\tbl\t8000408 <<a as b>::c>
 8000404:\tudf\t#0
 8000406:\t.short\t0x1234

08000408 <<a as b>::c>:
 8000408:\tvmov\ts0, r0
 800040c:\tbx\tlr
";
        let functions = functions(listing);
        let of = |begin: u32| {
            let function = &functions[&begin];
            (function.name.as_str(), function.code.len(), function.end)
        };
        assert_eq!(of(0x0800_0400), ("Reset", 2, 0x0800_0408));
        assert_eq!(of(0x0800_0408), ("<a as b>::c", 2, 0x0800_040e));
        assert_eq!(functions[&0x0800_0408].float().as_deref(), Some("8000408: vmov s0, r0"));
    }

    #[test]
    fn words_are_read_as_the_processor_does() {
        let dump = "
Contents of section .vector_table:
 8000000 00000220 01040008 a1560008 a9560008  ... .....V...V..
 8000010 00000000 c1560008                    .....V..
";
        assert_eq!(words(dump), [0x2002_0000, 0x0800_0401, 0x0800_56a1, 0x0800_56a9, 0, 0x0800_56c1]);
    }
}
