//! The wrong slaves that the build script has made of the model and `mutants.txt`.

use profibus_dp::Station;
use profibus_dp::time::{Baudrate, Instant};
use reference_model::Device;

/// How a wrong slave is connected.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Setting {
    pub(crate) address: u8,
    pub(crate) rate: Baudrate,
    pub(crate) stream: bool,
}

/// Any version of the model.
pub(crate) trait AnySlave: Station {
    fn device(&mut self) -> &mut Device;
    fn diagnosis_changed(&mut self);
}

/// Makes a version of the model whose power comes on.
pub(crate) type PowerOn = fn(Instant, Setting, Device) -> Box<dyn AnySlave>;

macro_rules! version {
    ($($module:ident)::+, $power_on:ident) => {
        impl AnySlave for $($module)::+::Slave {
            fn device(&mut self) -> &mut Device {
                &mut self.device
            }
            fn diagnosis_changed(&mut self) {
                self.diagnosis_changed();
            }
        }

        pub(crate) fn $power_on(now: Instant, setting: Setting, device: Device) -> Box<dyn AnySlave> {
            use $($module)::+ as version;
            let Setting { address, rate, stream } = setting;
            Box::new(version::Slave::new(now, version::Setting { address, rate, stream }, device))
        }
    };
}

version!(reference_model, model);

#[allow(warnings, clippy::all, clippy::pedantic, reason = "each is wrong somewhere")]
pub(crate) mod made {
    use super::{AnySlave, PowerOn, Setting};
    use profibus_dp::time::Instant;
    use reference_model::Device;

    include!(concat!(env!("OUT_DIR"), "/mutants.rs"));
}
