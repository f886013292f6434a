//! The encoder as the application of a DP slave: the half of the device that the bus drives.
//!
//! It meets the half that the shaft drives ([`crate::sensor_half`]) in two places: an input image
//! and the state of health come in, [`Demand`]s go out. Neither waits for the other.

use profibus_dp::dp::{
    Application, Event as BusEvent, ExtendedDiagnosis, PrmVerdict, Refusal, Refused, Service,
};
use profibus_dp::time::Instant;
use profibus_dp::wire::SetPrm;
use profibus_dp::wire::chk_cfg::Lengths;

use crate::configuration::{Configurations, Identifiers};
use crate::diagnostics::{self, Alarms, Diagnostics, Warnings};
use crate::end_cap::RotarySwitches;
use crate::event::{Event, Observer};
use crate::functionality::Functionality;
use crate::health::{Health, OperatingTime};
use crate::parameterization::{ParameterLength, Parameters};
use crate::refusal::{AddressRefusal, CfgRefusal, PrmRefusal};
use crate::scaling::Scaling;
use crate::sensor_half::{Demand, InputImage};
use crate::specification::{SerialNumber, Variant};

/// Who the device is: what is printed on it and set at its end cap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Identity {
    /// Singleturn and multiturn bits.
    pub variant: Variant,
    /// Ident_Number of the PNO.
    #[doc(alias = "Ident_Number")]
    pub ident_number: u16,
    /// Octets 48-57 of the diagnosis (manual 4.2.18).
    pub serial_number: SerialNumber,
    /// The rotary switches at power-on (manual 3.4).
    pub switches: RotarySwitches,
}

/// What Chk_Cfg has settled.
#[derive(Debug, Clone, Copy)]
struct Agreed {
    functionality: Functionality,
    configuration: Identifiers,
    scaling: Scaling,
}

/// The application of the slave: parameters, configuration, outputs, and images of the rest.
#[derive(Debug)]
pub struct Encoder<O> {
    pub(crate) image: InputImage,
    outputs: [u8; 4],
    /// Bit 31 of the last outputs that carried data.
    preset_bit: bool,
    /// Data exchange has begun, and its first outputs have not been looked at yet.
    first_outputs: bool,
    demanding: bool,
    session_demand: Option<Demand>,
    preset_demand: Option<u32>,
    pub(crate) health: Health,
    pub(crate) observer: O,
    identity: Identity,
    pub(crate) configurations: Configurations,
    /// Of the last good Set_Prm since power-on.
    parameters: Option<Parameters>,
    agreed: Option<Agreed>,
    /// The station address set over the bus.
    stored_address: Option<u8>,
    address_changed: bool,
}

impl<O: Observer> Encoder<O> {
    /// Without power.
    pub(crate) const fn blank(observer: O) -> Self {
        Self {
            image: InputImage { octets: [0; 12], sum_4: 0, sum_12: 0 },
            outputs: [0; 4],
            preset_bit: false,
            first_outputs: false,
            demanding: false,
            session_demand: None,
            preset_demand: None,
            health: Health {
                alarms: Alarms::empty(),
                warnings: Warnings::empty(),
                operating_time: OperatingTime(0),
                offset: 0,
            },
            observer,
            identity: Identity {
                variant: Variant::FULL,
                ident_number: 0,
                serial_number: SerialNumber::DEFAULT,
                switches: RotarySwitches(0),
            },
            configurations: Configurations::DELIVERED,
            parameters: None,
            agreed: None,
            stored_address: None,
            address_changed: false,
        }
    }

    /// At power-on.
    pub(crate) fn restart(&mut self, identity: Identity, stored_address: Option<u8>, health: Health) {
        (self.image, self.outputs) = (InputImage::default(), [0; 4]);
        (self.preset_bit, self.first_outputs, self.demanding) = (false, false, false);
        (self.session_demand, self.preset_demand) = (None, None);
        (self.identity, self.health) = (identity, health);
        self.configurations = Configurations::DELIVERED;
        (self.parameters, self.agreed) = (None, None);
        (self.stored_address, self.address_changed) = (stored_address, false);
    }

    /// Who the device is.
    pub const fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The functionality agreed on; `None` outside data exchange.
    pub fn functionality(&self) -> Option<Functionality> {
        self.agreed.map(|agreed| agreed.functionality)
    }

    /// The parameters of the last good Set_Prm since power-on.
    pub const fn parameters(&self) -> Option<&Parameters> {
        self.parameters.as_ref()
    }

    /// The outputs in force (manual 4.3.2).
    pub const fn outputs(&self) -> [u8; 4] {
        self.outputs
    }

    /// The station address set over the bus, if ever.
    pub const fn stored_address(&self) -> Option<u8> {
        self.stored_address
    }

    /// Whether [`take_demand`](Self::take_demand) has something.
    #[inline]
    pub const fn is_demanding(&self) -> bool {
        self.demanding
    }

    /// What the sensor half has to do next.
    pub fn take_demand(&mut self) -> Option<Demand> {
        let demand = self.session_demand.take().or_else(|| self.preset_demand.take().map(Demand::Preset));
        self.demanding = self.preset_demand.is_some();
        demand
    }

    /// Whether the stored address has changed since the last call.
    pub(crate) fn take_address_change(&mut self) -> bool {
        core::mem::take(&mut self.address_changed)
    }

    /// Whether the diagnosis has the long form, the one with warnings.
    pub(crate) fn sends_warnings(&self) -> bool {
        self.agreed.is_some_and(|agreed| agreed.functionality != Functionality::Class1)
    }

    fn demand(&mut self, demand: Demand) {
        self.session_demand = Some(demand);
        self.demanding = true;
    }

    fn tell(&mut self, now: Instant, event: Event) {
        self.observer.observe(now, &event);
    }

    /// Bit 31 of new outputs is set.
    ///
    /// Reading "Preset": the edge counts, against the last outputs that carried data. Nothing
    /// else resets the remembered bit, so a bit held over a bus fault presets nothing.
    #[cold]
    #[inline(never)]
    fn preset_bit_set(&mut self, now: Instant) {
        let first = core::mem::take(&mut self.first_outputs);
        if !self.preset_bit {
            self.preset_bit = true;
            self.preset_demand = Some(u32::from_be_bytes(self.outputs));
            self.demanding = true;
        } else if first {
            self.tell(now, Event::PresetBitHeld);
        }
    }

    /// The bus half's refusals that have a reason of the device's own.
    fn refusal(&self, refusal: Refusal) -> Option<AddressRefusal> {
        let switches = self.identity.switches;
        Some(match refusal {
            Refusal::AddressFixed => AddressRefusal::SwitchesDecide { switches: switches.0 },
            Refusal::NotInThisState(Service::SetSlaveAdd)
            | Refusal::OtherMaster { service: Service::SetSlaveAdd, .. } => {
                if switches.address_changeable() {
                    AddressRefusal::NotInWaitPrm
                } else {
                    AddressRefusal::SwitchesDecide { switches: switches.0 }
                }
            }
            Refusal::AddressTooShort(octets) => AddressRefusal::TooShort { octets },
            Refusal::AddressIdent { received, own } => AddressRefusal::Ident { received, own },
            Refusal::AddressRange(address) => AddressRefusal::OutOfRange { address },
            _ => return None,
        })
    }
}

impl<O: Observer> Application for Encoder<O> {
    fn ident_number(&self) -> u16 {
        self.identity.ident_number
    }

    fn set_prm(&mut self, now: Instant, prm: &SetPrm<'_>, _: bool) -> PrmVerdict {
        let parameters = match Parameters::parse(prm.octets, &self.identity.variant) {
            Ok(parameters) => parameters,
            Err(refusal) => {
                self.tell(now, Event::PrmRefused(refusal));
                return PrmVerdict::Refused;
            }
        };
        if let Some(Agreed { functionality, .. }) = self.agreed {
            // Reading "Which functionality": the slave leaves its master, without fault bits.
            if !functionality.satisfied_by(parameters.length) {
                let octets = parameters.length.octets();
                self.tell(now, Event::PrmRefused(PrmRefusal::ShorterThanAgreed { octets, functionality }));
                return PrmVerdict::Outgrown;
            }
            self.put_in_force(functionality, parameters);
        }
        self.parameters = Some(parameters);
        PrmVerdict::Accepted
    }

    fn chk_cfg(&mut self, now: Instant, octets: &[u8]) -> Result<Lengths, Refused> {
        let (functionality, configuration) = self.configurations.find(octets).ok_or_else(|| {
            self.tell(now, Event::CfgRefused(CfgRefusal::not_offered(octets)));
            Refused
        })?;
        let parameters = self.parameters.ok_or(Refused)?;
        if !functionality.satisfied_by(parameters.length) {
            let have = parameters.length.octets();
            self.tell(now, Event::CfgRefused(CfgRefusal::ParametersTooShort { functionality, have }));
            return Err(Refused);
        }
        self.agreed = Some(Agreed {
            functionality,
            configuration,
            scaling: Scaling::in_force(self.identity.variant, functionality, &parameters),
        });
        self.first_outputs = true;
        self.put_in_force(functionality, parameters);
        self.tell(now, Event::FunctionalityChosen(functionality));
        Ok(functionality.lengths())
    }

    /// Reading "Get_Cfg": in data exchange the octets agreed on; else those of the last good
    /// Set_Prm's length since power-on, also after faults; before any, those of class 1.
    fn configuration(&self, exchanging: bool) -> &[u8] {
        match &self.agreed {
            Some(agreed) if exchanging => agreed.configuration.as_slice(),
            _ => {
                let length = self.parameters.map_or(ParameterLength::Nine, |parameters| parameters.length);
                self.configurations.first(Functionality::of_parameter_length(length))
            }
        }
    }

    #[inline]
    fn read_inputs(&self, to: &mut [u8]) -> u8 {
        if to.len() == 4 {
            if let (Some(to), Some(from)) = (to.first_chunk_mut::<4>(), self.image.octets.first_chunk::<4>())
            {
                *to = *from;
            }
            self.image.sum_4
        } else {
            if let Some(to) = to.first_chunk_mut::<12>() {
                *to = self.image.octets;
            }
            self.image.sum_12
        }
    }

    #[inline]
    fn write_outputs(&mut self, now: Instant, octets: &[u8]) {
        let Some(&outputs) = octets.first_chunk::<4>() else {
            return;
        };
        self.outputs = outputs;
        // Bit 31 is the highest of the first octet.
        if u32::from_ne_bytes(outputs) & const { u32::from_ne_bytes([0x80, 0, 0, 0]) } == 0 {
            self.preset_bit = false;
        } else {
            self.preset_bit_set(now);
        }
    }

    fn clear_outputs(&mut self, _: Instant) {
        self.outputs = [0; 4];
    }

    fn read_outputs(&self, to: &mut [u8]) {
        for (to, from) in to.iter_mut().zip(self.outputs) {
            *to = from;
        }
    }

    /// Reading "Diagnosis form": 16 octets with octet 9 = 0 whenever not in data exchange; in it,
    /// 16 or 57 octets by functionality.
    fn diagnosis(&self, exchanging: bool, to: &mut [u8]) -> ExtendedDiagnosis {
        let Identity { variant, serial_number, .. } = &self.identity;
        let diagnostics = match &self.agreed {
            Some(agreed) if exchanging => Diagnostics::in_data_exchange(
                agreed.functionality,
                &agreed.scaling,
                &self.health,
                serial_number,
            ),
            _ => Diagnostics::outside_data_exchange(*variant, &self.health),
        };
        let length = if diagnostics.class_2_part.is_some() {
            to.first_chunk_mut().map_or(0, |block| {
                diagnostics.emit_long(block);
                block.len()
            })
        } else {
            to.first_chunk_mut().map_or(0, |block| {
                diagnostics.emit_short(block);
                block.len()
            })
        };
        ExtendedDiagnosis { length, overflow: false }
    }

    fn external_diagnosis(&self, exchanging: bool) -> bool {
        diagnostics::ext_diag(self.health.alarms, self.health.warnings, exchanging && self.sends_warnings())
    }

    #[inline]
    fn static_diagnosis(&self) -> bool {
        diagnostics::stat_diag(self.health.alarms)
    }

    fn address_changeable(&self) -> bool {
        self.identity.switches.address_changeable()
    }

    fn address_taken(&mut self, _: Instant, address: u8) {
        self.stored_address = Some(address);
        self.address_changed = true;
    }

    fn master_left(&mut self, _: Instant) {
        if self.agreed.take().is_some() {
            self.demand(Demand::Leave);
        }
    }

    fn observe(&mut self, now: Instant, event: &BusEvent) {
        let own = match event {
            BusEvent::Refused(refusal) => self.refusal(*refusal).map(Event::AddressRefused),
            _ => None,
        };
        self.tell(now, own.unwrap_or(Event::Bus(*event)));
    }
}

impl<O: Observer> Encoder<O> {
    fn put_in_force(&mut self, functionality: Functionality, parameters: Parameters) {
        if let Some(agreed) = &mut self.agreed {
            agreed.scaling = Scaling::in_force(self.identity.variant, functionality, &parameters);
        }
        self.demand(Demand::Parameterize { functionality, parameters });
    }
}
