//! Which source file an instruction comes from, whatever was inlined where.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use super::{Image, LIMIT};
use crate::process::{Show, run};
use crate::project::Project;

/// Names the source lines of addresses; comes with the disassembler.
const ADDR2LINE: &str = "arm-none-eabi-addr2line";

impl Image {
    /// Octets of code from source below `folder`: of every instruction the innermost file counts that is
    /// below one of `folders`. Code of Rust's own library belongs to whom it was inlined into.
    ///
    /// # Errors
    ///
    /// The image tells nothing of its source.
    pub(crate) fn code_from(
        &self,
        project: &Project,
        path: &Path,
        folder: &str,
        folders: &[&str],
    ) -> Result<u32, String> {
        let lengths = self.lengths();
        let list = path.with_extension("addresses");
        let mut addresses = String::new();
        for (address, _) in &lengths {
            let _ = writeln!(addresses, "{address:x}");
        }
        let trouble = |error| format!("{} cannot be written: {error}.", list.display());
        fs::write(&list, addresses).map_err(trouble)?;
        let mut command = project.command(ADDR2LINE, ["-a", "-i", "-e"]);
        command.arg(path).arg(format!("@{}", list.display()));
        let lines = run(&mut command, LIMIT, Show::Nothing)?.expect_success(ADDR2LINE)?;
        let _ = fs::remove_file(&list);
        let owners = owners(&lines, folders);
        if owners.len() != lengths.len() || !owners.iter().any(|owner| owner.as_deref() == Some(folder)) {
            return Err(format!("{} tells nothing of its source: it needs line tables", path.display()));
        }
        let own = owners.iter().zip(&lengths).filter(|(owner, _)| owner.as_deref() == Some(folder));
        Ok(own.map(|(_, (_, length))| length).sum())
    }

    /// All instructions: where they are, and how many octets they have.
    fn lengths(&self) -> Vec<(u32, u32)> {
        let of = |function: &super::Function| {
            let ends = function.code.iter().skip(1).map(|next| next.address).chain([function.end]);
            // Data may follow: no instruction has more than four octets.
            let length = |(one, end): (&super::Instruction, u32)| (one.address, (end - one.address).min(4));
            function.code.iter().zip(ends).map(length).collect::<Vec<_>>()
        };
        self.functions.values().flat_map(of).collect()
    }
}

/// For each address the folder that it belongs to. `lines` has `0xADDRESS`, then its files from the
/// innermost outwards.
fn owners(lines: &str, folders: &[&str]) -> Vec<Option<String>> {
    let mut owners: Vec<Option<String>> = Vec::new();
    for line in lines.lines() {
        if line.starts_with("0x") {
            owners.push(None);
        } else if let Some(owner @ None) = owners.last_mut() {
            *owner = folders.iter().find(|folder| line.contains(*folder)).map(|folder| (*folder).into());
        }
    }
    owners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instruction_belongs_to_the_innermost_of_the_folders() {
        let lines = "0x08000400
/rustc/1/library/core/src/num.rs:1
/x/crates/profibus-dp/src/fdl/receiver.rs:7
/x/crates/sch108bex/src/device.rs:9
0x08000402
/x/crates/sch108bex/src/encoder.rs:1
/x/crates/profibus-dp/src/dp/slave.rs:7
0x08000404
??:?
";
        let due = [Some("crates/profibus-dp/"), Some("crates/sch108bex/"), None];
        let owners = owners(lines, &["crates/profibus-dp/", "crates/sch108bex/"]);
        assert_eq!(owners.iter().map(Option::as_deref).collect::<Vec<_>>(), due);
    }
}
