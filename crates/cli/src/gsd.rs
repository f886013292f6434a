//! What a user's GSD file of this device changes: the ident number and the configurations.
//!
//! A parameter layout other than the manual's is told, never taken over.

use std::path::Path;

use gsd_parser::{GenericStationDescription, Module, UserPrmData, UserPrmDataType};
use profibus_dp::wire::chk_cfg::Lengths;
use sch108bex::configuration::Configurations;
use sch108bex::functionality::Functionality;
use sch108bex::specification::{PLACEHOLDER_IDENT, Variant};

use crate::Failure;

/// Octets of Set_Prm before the user parameters.
const STANDARD_OCTETS: usize = 7;

/// What an encoder offers to masters.
#[derive(Debug)]
pub(crate) struct Offer {
    pub(crate) ident_number: u16,
    pub(crate) configurations: Configurations,
    /// What the user should know of it.
    pub(crate) notes: Vec<String>,
}

impl Offer {
    /// From the command line: an ident number, a GSD file, or neither.
    pub(crate) fn new(ident: Option<u16>, gsd: Option<&Path>, variant: Variant) -> Result<Self, Failure> {
        if let Some(path) = gsd {
            return Self::from_gsd(&read(path)?, variant)
                .map_err(|why| Failure::Failed(format!("--gsd {}: {why}", path.display())));
        }
        let configurations = Configurations::default();
        let notes = if ident.is_some() {
            Vec::new()
        } else {
            vec![format!(
                "ident number {PLACEHOLDER_IDENT:04X} is a placeholder, the maker's is not public; \
                 --ident or --gsd takes the one of your project"
            )]
        };
        Ok(Self { ident_number: ident.unwrap_or(PLACEHOLDER_IDENT), configurations, notes })
    }

    fn from_gsd(gsd: &GenericStationDescription, variant: Variant) -> Result<Self, String> {
        if gsd.ident_number == 0 {
            return Err("it has no Ident_Number; a master needs it to know the device".to_owned());
        }
        let mut offer = Self {
            ident_number: gsd.ident_number,
            configurations: Configurations::default(),
            notes: Vec::new(),
        };
        let mut found = [false; 3];
        for module in &gsd.available_modules {
            let Some(functionality) = functionality_of(module) else {
                offer.notes.push(format!(
                    "module \"{}\" ({:02X?}) is none of this device's: its octets are not those of class 1 \
                     (4 in), class 2 (4 in, 4 out) or Scancon 2.0 (12 in, 4 out)",
                    module.name, module.config
                ));
                continue;
            };
            let first = !std::mem::replace(&mut found[functionality as usize], true);
            let taken = if first {
                offer.configurations.replace(functionality, &module.config)
            } else {
                offer.configurations.offer(functionality, &module.config)
            };
            match taken {
                Ok(()) => offer.notes.extend(layout_notes(gsd, module, functionality, variant)),
                Err(why) => offer.notes.push(format!("module \"{}\" is not taken over: {why}", module.name)),
            }
        }
        if found.contains(&true) {
            Ok(offer)
        } else {
            Err("it describes no module that this device could be; is it the file of another device?"
                .to_owned())
        }
    }
}

/// Reads a GSD file. The parser gives up by a panic on some broken files; that is an error here.
fn read(path: &Path) -> Result<GenericStationDescription, Failure> {
    let fault = |why: String| Failure::Failed(format!("--gsd {}: {why}", path.display()));
    let octets = std::fs::read(path).map_err(|error| fault(format!("cannot be read: {error}")))?;
    let source = String::from_utf8_lossy(&octets).into_owned();
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let parsed = std::panic::catch_unwind(|| gsd_parser::parser::parse(path, &source));
    std::panic::set_hook(hook);
    match parsed {
        Ok(Ok(gsd)) => Ok(gsd),
        Ok(Err(error)) => Err(fault(format!("is no GSD file that can be read:\n{error}"))),
        Err(_) => Err(fault(
            "is broken: it refers to something that is not in it, or a value is of the wrong kind".into(),
        )),
    }
}

/// What a module's identifier octets amount to.
fn functionality_of(module: &Module) -> Option<Functionality> {
    let lengths = Lengths::of(&module.config)?;
    Functionality::ALL.into_iter().find(|functionality| functionality.lengths() == lengths)
}

/// Where the parameters of a module are not where the manual has them.
fn layout_notes(
    gsd: &GenericStationDescription,
    module: &Module,
    functionality: Functionality,
    variant: Variant,
) -> Vec<String> {
    let UserPrmData { length: of_station, data_ref: refs_of_station, .. } = &gsd.user_prm_data;
    let UserPrmData { length: of_module, data_ref: refs_of_module, .. } = &module.module_prm_data;
    let octets = STANDARD_OCTETS + usize::from(*of_station) + usize::from(*of_module);
    let due = usize::from(functionality.parameter_octets());
    let mut notes = Vec::new();
    if octets != due {
        notes.push(format!(
            "module \"{}\" makes a Set_Prm of {octets} octets; {functionality} of the manual has {due}. \
             The manual's layout stays in force (manual 4.1)",
            module.name
        ));
    }
    let in_module = refs_of_module.iter().map(|(offset, data)| (offset + usize::from(*of_station), data));
    for (offset, data) in refs_of_station.iter().map(|(offset, data)| (*offset, data)).chain(in_module) {
        let octet = STANDARD_OCTETS + 1 + offset;
        if !is_the_manuals(octet, data.data_type) {
            notes.push(format!(
                "parameter \"{}\" of module \"{}\" is at octet {octet} as {:?}; the manual has none there (manual 4.1)",
                data.name, module.name, data.data_type
            ));
        }
        let most = match octet {
            10 => i64::from(variant.steps_per_revolution()),
            14 => i64::from(variant.total()),
            _ => continue,
        };
        if data.default_value > most {
            notes.push(format!(
                "parameter \"{}\" of module \"{}\" is {} by default, more than the {most} that {variant} bits \
                 allow: with scaling on it will be refused; --bits takes another variant",
                data.name, module.name, data.default_value
            ));
        }
    }
    notes
}

/// Whether the manual has such a parameter at this octet of Set_Prm (manual 4.1).
fn is_the_manuals(octet: usize, kind: UserPrmDataType) -> bool {
    match octet {
        9 => matches!(kind, UserPrmDataType::Bit(0..=3) | UserPrmDataType::BitArea(0..=3, 0..=3)),
        10 | 14 => matches!(kind, UserPrmDataType::Unsigned32 | UserPrmDataType::Unsigned16),
        12 | 16 => kind == UserPrmDataType::Unsigned16,
        26 => matches!(kind, UserPrmDataType::Unsigned8 | UserPrmDataType::BitArea(0, _)),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A GSD with one module of these identifiers and user parameters.
    fn gsd(module: &str) -> String {
        format!(
            "#Profibus_DP\nGSD_Revision = 2\nVendor_Name = \"V\"\nModel_Name = \"M\"\nIdent_Number = 0x4711\n\
             Modular_Station = 1\nMax_Module = 1\n\
             ExtUserPrmData = 1 \"Units\"\nUnsigned32 65536 1-65536\nEndExtUserPrmData\n{module}"
        )
    }

    fn offer(text: &str) -> Result<Offer, String> {
        let parsed = gsd_parser::parser::parse(Path::new("test.gsd"), text).expect("the test's own GSD");
        Offer::from_gsd(&parsed, Variant::FULL)
    }

    #[test]
    fn ident_and_configuration_are_taken_over() {
        let module = "Module = \"Scancon 2.0\" 0xE1,0xD5\nExt_Module_Prm_Data_Len = 19\n\
                      Ext_User_Prm_Data_Ref(2) = 1\nEndModule\n";
        let offer = offer(&gsd(module)).expect("fits");
        assert_eq!(offer.ident_number, 0x4711);
        let chosen = offer.configurations.find(&[0xE1, 0xD5]).map(|(functionality, _)| functionality);
        assert_eq!(chosen, Some(Functionality::Scancon2));
        assert!(offer.configurations.find(&[0xF1, 0xD3]).is_none(), "the file's octets, not ours");
        assert!(offer.configurations.find(&[0xF1]).is_some(), "the file says nothing of class 2");
        assert!(offer.notes.is_empty(), "{:?}", offer.notes);
    }

    #[test]
    fn another_layout_is_told_and_not_adopted() {
        let module = "Module = \"Class 2\" 0xF1\nExt_Module_Prm_Data_Len = 10\n\
                      Ext_User_Prm_Data_Ref(3) = 1\nEndModule\n";
        let offer = offer(&gsd(module)).expect("fits");
        assert_eq!(offer.notes.len(), 2, "{:?}", offer.notes);
        assert!(
            offer.notes[0].contains("17 octets") && offer.notes[0].contains("has 25"),
            "{}",
            offer.notes[0]
        );
        assert!(offer.notes[1].contains("octet 11"), "{}", offer.notes[1]);
    }

    #[test]
    fn a_file_without_an_ident_number_is_an_error() {
        let text = gsd("Module = \"Class 2\" 0xF1\nEndModule\n").replace("Ident_Number = 0x4711\n", "");
        assert!(offer(&text).expect_err("no ident number").contains("Ident_Number"));
    }

    #[test]
    fn a_file_of_another_device_is_an_error() {
        let error = offer(&gsd("Module = \"DI\" 0x10\nEndModule\n")).expect_err("no encoder");
        assert!(error.contains("another device"), "{error}");
    }

    #[test]
    fn what_is_no_gsd_is_an_error_and_no_panic() {
        let directory = tempfile::tempdir().expect("a directory");
        let path = directory.path().join("broken.gsd");
        for (text, words) in [
            ("hello", "no GSD file"),
            ("", "no GSD file"),
            (&gsd("Module = \"A\" 0xF1\nExt_User_Prm_Data_Ref(0) = 9\nEndModule\n"), "is broken"),
        ] {
            std::fs::write(&path, text).expect("writes");
            let error = read(&path).expect_err(text).to_string();
            assert!(error.contains(words) && error.contains("broken.gsd"), "{error}");
        }
        let missing = read(&directory.path().join("none.gsd")).expect_err("missing").to_string();
        assert!(missing.contains("cannot be read"), "{missing}");
    }
}
