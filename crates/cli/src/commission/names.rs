//! What a device is called: by its ident number, in GSD files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sch108bex::specification::PLACEHOLDER_IDENT;

use crate::{Failure, output};

/// Names by ident number.
#[derive(Debug, Default)]
pub(crate) struct Names(BTreeMap<u16, String>);

impl Names {
    /// Those in files, and in the folders that are among them. A file that cannot be read is an error where it was named, a
    /// remark where it was only found in a folder.
    pub(crate) fn read(paths: &[PathBuf]) -> Result<Self, Failure> {
        let mut names = BTreeMap::new();
        for path in paths {
            let Ok(entries) = path.read_dir() else {
                let (ident, name) =
                    one(path).map_err(|why| Failure::Failed(format!("--gsd {}: {why}", path.display())))?;
                names.insert(ident, name);
                continue;
            };
            let mut files: Vec<_> = entries
                .filter_map(Result::ok)
                .map(|entry| entry.path())
                .filter(|path| is_gsd(path))
                .collect();
            files.sort();
            for file in files {
                match one(&file) {
                    Ok((ident, name)) => {
                        names.insert(ident, name);
                    }
                    Err(why) => output::aside(&format!("{} is left out: it {why}", file.display())),
                }
            }
        }
        names
            .entry(PLACEHOLDER_IDENT)
            .or_insert_with(|| "SCH108BEX as software (placeholder ident number)".to_owned());
        Ok(Self(names))
    }

    /// The name of a device.
    pub(crate) fn get(&self, ident: u16) -> Option<&str> {
        self.0.get(&ident).map(String::as_str)
    }
}

/// `.gsd`, and those of a language: `.gse`, `.gsg` and so on.
fn is_gsd(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    extension.len() == 3 && extension.to_ascii_lowercase().starts_with("gs")
}

fn one(path: &Path) -> Result<(u16, String), String> {
    let text = gsd_reader::read_text(path).map_err(|error| error.to_string())?;
    let gsd = gsd_reader::read(path, &text).map_err(|error| error.to_string())?;
    let name = format!("{} {}", gsd.vendor.trim(), gsd.model.trim());
    Ok((gsd.ident_number, name.trim().to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_from_files_and_folders_and_ours_is_known() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = "#Profibus_DP\nGSD_Revision = 2\nVendor_Name = \"Maker\"\nModel_Name = \"Encoder 5\"\n\
                    Ident_Number = 0x4711\n";
        std::fs::write(folder.path().join("a.GSE"), text).expect("writes");
        std::fs::write(folder.path().join("broken.gsd"), "nothing").expect("writes");
        std::fs::write(folder.path().join("other.txt"), text.replace("4711", "4712")).expect("writes");
        let names = Names::read(&[folder.path().to_owned()]).expect("a folder");
        assert_eq!(names.get(0x4711), Some("Maker Encoder 5"));
        assert_eq!(names.get(0x4712), None);
        assert!(names.get(0x108B).is_some_and(|name| name.contains("placeholder")));
        let result = Names::read(&[folder.path().join("broken.gsd")]);
        assert!(result.is_err(), "what was named has to be one");
    }
}
