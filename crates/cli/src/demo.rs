//! `sch108bex demo`: the main job in one go, in virtual time.

use bus::VirtualSegment;
use plant::{EncoderSetup, EncoderStation, Rate, Report, Reporter, Shaft, Store, What, World};
use profibus_dp::time::{Baudrate, Duration, Instant};
use profibus_dp::wire::{Sap, StandardDiagnosis};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::diagnostics::{Diagnostics, Warnings};
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::event::Event;
use sch108bex::health::Measurement;
use sch108bex::parameterization::{ParameterLength, Parameters, TimeBase};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use std::sync::mpsc::{self, Receiver};

use crate::Failure;
use crate::master::{MASTER, Master, Reply};
use crate::output::line;

const RATE: Baudrate = Baudrate::B1500000;
const ADDRESS: u8 = 5;
/// 4096 steps a turn, over all 32768 turns.
const STEPS: u32 = 4096;
/// Output bit 31 (manual 4.3.2).
const PRESET: u32 = 0x8000_0000;
const RPM: f64 = 300.0;

/// Shows it, and fails where something is not as claimed.
pub(crate) fn demo() -> Result<(), Failure> {
    let (encoder, reports) = encoder()?;
    let mut segment = VirtualSegment::new(Instant::ZERO, RATE);
    segment.add(encoder);
    let mut demo = Demo { master: Master::new(segment, 126), reports };
    line("A virtual SCH108BEX as delivered (switches 7E, nothing stored) on a virtual bus at 1.5 Mbit/s,");
    line("and a scripted master with address 2. `sch108bex run` gives your own master such an encoder.");
    demo.give_address()?;
    demo.refused_parameters()?;
    demo.start_up()?;
    demo.turn()?;
    demo.preset()?;
    demo.warning()?;
    line("");
    line("All as it should be.");
    Ok(())
}

struct Demo {
    master: Master,
    reports: Receiver<Report>,
}

fn encoder() -> Result<(EncoderStation, Receiver<Report>), Failure> {
    let (to, reports) = mpsc::channel();
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: "1234567"
                .parse::<SerialNumber>()
                .map_err(|error| Failure::Failed(error.to_string()))?,
            switches: RotarySwitches(126),
        },
        configurations: Configurations::default(),
        rate: Rate::Fixed(RATE),
        termination: TerminationSwitches { first: true, second: true },
        shaft: Shaft::still(0),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", Some(to)),
    };
    let station =
        EncoderStation::new(Instant::ZERO, setup).map_err(|error| Failure::Failed(error.to_string()))?;
    Ok((station, reports))
}

/// A Set_Prm for Scancon 2.0: watchdog 200 ms, scaling on, steps per 100 ms.
fn parameters(units_per_revolution: u32) -> Vec<u8> {
    let parameters = Parameters {
        length: ParameterLength::TwentySix,
        scaling: true,
        measuring_units_per_revolution: units_per_revolution,
        total_measuring_range: STEPS * Variant::FULL.revolutions(),
        time_base: TimeBase::Per100Ms,
        ..Parameters::default_for(Variant::FULL)
    };
    let mut octets = [0; 26];
    let length = parameters.emit(&mut octets);
    let [ident_high, ident_low] = PLACEHOLDER_IDENT.to_be_bytes();
    octets[..8].copy_from_slice(&[0x88, 1, 20, 11, ident_high, ident_low, 0, 0]);
    octets[..length].to_vec()
}

impl Demo {
    fn give_address(&mut self) -> Result<(), Failure> {
        heading("The master looks for stations and finds one at 126; it gives it address 5.");
        expect(self.master.find(), "a station at 126")?;
        let [ident_high, ident_low] = PLACEHOLDER_IDENT.to_be_bytes();
        let reply = self.master.service(Sap::SET_SLAVE_ADD, &[ADDRESS, ident_high, ident_low, 0])?;
        expect(reply == Reply::Acknowledged, "an E5 to Set_Slave_Add")?;
        expect(!self.master.find(), "silence at 126")?;
        self.master.follow(ADDRESS);
        expect(self.master.find(), "a station at 5")?;
        self.tell_events();
        Ok(())
    }

    fn refused_parameters(&mut self) -> Result<(), Failure> {
        heading("It asks for 70000 units per revolution, more than the disc has. The encoder says why not:");
        self.master.service(Sap::SET_PRM, &parameters(70_000))?;
        let (standard, _) = self.diagnosis()?;
        expect(standard.prm_fault, "Prm_Fault")?;
        let refused = self.tell_events();
        expect(refused.iter().any(|event| matches!(event, Event::PrmRefused(_))), "a refusal with its reason")
    }

    fn start_up(&mut self) -> Result<(), Failure> {
        heading("Set_Prm with 4096 units per revolution, then Chk_Cfg F1 D1 D1: Scancon 2.0.");
        self.master.service(Sap::SET_PRM, &parameters(STEPS))?;
        self.master.service(Sap::CHK_CFG, &[0xF1, 0xD1, 0xD1])?;
        let (standard, extended) = self.diagnosis()?;
        expect(!standard.station_not_ready && standard.master_add == Some(MASTER), "data exchange")?;
        let part = extended.class_2_part.ok_or_else(|| missing("the long diagnosis"))?;
        self.tell_events();
        line(&format!(
            "  diagnosis: {} steps x {} turns on the disc, {} of {} units in force, serial number {}",
            extended.singleturn_resolution,
            extended.revolutions,
            part.measuring_units_per_revolution,
            part.total_measuring_range,
            String::from_utf8_lossy(&part.serial_number).trim_end()
        ));
        Ok(())
    }

    fn turn(&mut self) -> Result<(), Failure> {
        heading("The shaft turns clockwise at 300 RPM: 20480 units a second, 2048 in 100 ms.");
        let now = self.master.segment().now();
        self.master.segment().stations_mut()[0].set_shaft(now, Shaft::constant(RPM, 0, now));
        let mut last = None;
        for step in 0..6 {
            // Data is exchanged every millisecond; every 100th answer is shown.
            let (position, velocity, acceleration) = self.run_for(100)?;
            line(&format!("  position {position:6}   velocity {velocity:5}   acceleration {acceleration:5}"));
            let moved = last.map(|last: u32| position.wrapping_sub(last));
            // A latch every 500 us, 10.24 units apart, and a request every millisecond and some.
            expect(
                step == 0 || moved.is_some_and(|moved| (2040..=2160).contains(&moved)),
                "2048 units in 100 ms",
            )?;
            last = Some(position);
            if step == 5 {
                expect(
                    (2047..=2049).contains(&velocity) && acceleration.abs() <= 1,
                    "a steady velocity of 2048",
                )?;
            }
        }
        Ok(())
    }

    fn preset(&mut self) -> Result<(), Failure> {
        heading("Bit 31 of the outputs rises with the value 1000000: a preset while it turns.");
        self.master.exchange(&(PRESET + 1_000_000).to_be_bytes())?;
        self.tell_events();
        let (position, velocity, _) = self.run_for(1)?;
        line(&format!("  position {position} a millisecond later, velocity {velocity} as before"));
        expect((1_000_000..1_000_100).contains(&position), "a position behind 1000000")?;
        expect((2047..=2049).contains(&velocity), "a velocity without a jump")
    }

    fn warning(&mut self) -> Result<(), Failure> {
        heading(
            "It gets 70 degrees warm. The next answer has high priority, and the master fetches the diagnosis.",
        );
        let now = self.master.segment().now();
        let world = World(Measurement { temperature_tenths: 700, ..World::default().0 });
        let warmed = self.master.segment().stations_mut()[0].set_world(now, world);
        warmed.map_err(|error| Failure::Failed(error.to_string()))?;
        self.tell_events();
        let (_, high) = self.master.exchange(&[0; 4])?;
        expect(high, "an answer of high priority")?;
        let (standard, extended) = self.diagnosis()?;
        let warnings = extended.class_2_part.map(|part| part.warnings).unwrap_or_default();
        line(&format!(
            "  diagnosis: alarms {}, warnings {warnings}; Ext_Diag {}, Stat_Diag {}",
            extended.alarms,
            u8::from(standard.ext_diag),
            u8::from(standard.stat_diag)
        ));
        expect(warnings == Warnings::TEMPERATURE_EXCEEDED && standard.ext_diag, "the temperature warning")?;
        let (_, high) = self.master.exchange(&[0; 4])?;
        expect(!high, "low priority after the diagnosis was fetched")
    }

    /// Exchanges data every millisecond for so many milliseconds; the last inputs.
    fn run_for(&mut self, millis: u64) -> Result<(u32, i32, i32), Failure> {
        let mut cycle = self.master.segment().now();
        let mut inputs = Vec::new();
        for _ in 0..millis {
            cycle += Duration::from_millis(1);
            let pause = cycle.since(self.master.segment().now());
            self.master.segment().wait(pause);
            (inputs, _) = self.master.exchange(&[0; 4])?;
        }
        let word = |at: usize| inputs.get(at..at + 4).and_then(|octets| octets.first_chunk().copied());
        match (word(0), word(4), word(8)) {
            (Some(position), Some(velocity), Some(acceleration)) => Ok((
                u32::from_be_bytes(position),
                i32::from_be_bytes(velocity),
                i32::from_be_bytes(acceleration),
            )),
            _ => Err(missing("12 input octets")),
        }
    }

    fn diagnosis(&mut self) -> Result<(StandardDiagnosis, Diagnostics), Failure> {
        let Reply::Data(_, octets) = self.master.service(Sap::SLAVE_DIAG, &[])? else {
            return Err(missing("a diagnosis"));
        };
        let extended = octets.get(6..).and_then(Diagnostics::parse);
        StandardDiagnosis::parse(&octets).zip(extended).ok_or_else(|| missing("a diagnosis that can be read"))
    }

    /// Prints what the encoder has told since the last time.
    fn tell_events(&self) -> Vec<Event> {
        let mut events = Vec::new();
        for Report { what, .. } in self.reports.try_iter() {
            line(&format!("  encoder: {what}"));
            if let What::Device(event) = what {
                events.push(event);
            }
        }
        events
    }
}

fn heading(text: &str) {
    line("");
    line(text);
}

fn expect(holds: bool, what: &str) -> Result<(), Failure> {
    if holds { Ok(()) } else { Err(missing(what)) }
}

fn missing(what: &str) -> Failure {
    Failure::Failed(format!("the demonstration went wrong: {what} was due, but did not come"))
}
