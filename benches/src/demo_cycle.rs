//! One exchange of the demonstration's master with the encoder in virtual time, beside one of profirust
//! with a slave whose answers are fixed.
//!
//! Both masters build a request and take an answer of 12 octets. On our side there is the virtual bus and a
//! whole encoder in between; on the other side nothing. An exchange of profirust has in it what it does in every
//! cycle besides: it passes the token to itself, and asks an address whether somebody there wants it.

use std::time::Instant as Moment;

use bus::VirtualSegment;
use master::{LightMaster, Settings};
use plant::{EncoderSetup, EncoderStation, Rate, Reporter, Shaft, Store, World};
use profibus_dp::time::{Baudrate, Instant};
use profibus_dp::wire::telegram;
use profirust::dp::{DpMaster, Peripheral, PeripheralHandle, PeripheralOptions};
use profirust::fdl::{FdlActiveStation, ParametersBuilder};
use profirust::phy::ProfibusPhy;
use sch108bex::configuration::Configurations;
use sch108bex::encoder::Identity;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};

use crate::median;
use crate::telegrams::ADDRESS;

const RATE: Baudrate = Baudrate::B1500000;
/// Octets 8 on of Set_Prm for Scancon 2.0 with 16 and 15 bits (manual 4.1).
const USER: [u8; 19] = [0, 0x02, 0, 1, 0, 0, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
const CONFIGURATION: [u8; 3] = [0xF1, 0xD1, 0xD1];
/// How many exchanges are timed at once, and how often.
const EXCHANGES: u32 = 20_000;
const ROUNDS: usize = 15;

/// Microseconds for one exchange of ours, and of profirust's.
pub(crate) struct Cycle {
    pub(crate) ours: f64,
    pub(crate) theirs: f64,
}

/// Times both, by turns.
pub(crate) fn measure() -> Result<Cycle, String> {
    let mut ours = ours()?;
    let mut theirs = Theirs::new()?;
    let (mut of_ours, mut of_theirs) = (Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let begun = Moment::now();
        for count in 0..EXCHANGES {
            let inputs = ours.exchange(ADDRESS, &count.to_be_bytes()).map_err(|error| error.to_string())?;
            if inputs.octets.len() != 12 {
                return Err("The encoder does not send 12 octets.".into());
            }
        }
        of_ours.push(begun.elapsed().as_secs_f64() * 1e6 / f64::from(EXCHANGES));
        let begun = Moment::now();
        for count in 0..EXCHANGES {
            theirs.exchange(&count.to_be_bytes())?;
        }
        of_theirs.push(begun.elapsed().as_secs_f64() * 1e6 / f64::from(EXCHANGES));
    }
    Ok(Cycle { ours: median(of_ours), theirs: median(of_theirs) })
}

/// The demonstration's master, with an encoder in data exchange whose shaft turns.
fn ours() -> Result<LightMaster<VirtualSegment<EncoderStation>>, String> {
    let setup = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(ADDRESS),
        },
        configurations: Configurations::default(),
        rate: Rate::Fixed(RATE),
        termination: TerminationSwitches { first: true, second: true },
        shaft: Shaft::constant(300.0, 0, Instant::ZERO),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", None),
    };
    let mut segment = VirtualSegment::new(Instant::ZERO, RATE);
    segment.add(EncoderStation::new(Instant::ZERO, setup).map_err(|error| error.to_string())?);
    let mut master = LightMaster::new(segment, Settings::default());
    let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
    let prm = [&[0x88, 1, 20, 11, high, low, 0], &USER[..]].concat();
    master.set_prm(ADDRESS, &prm).map_err(|error| error.to_string())?;
    master.chk_cfg(ADDRESS, &CONFIGURATION).map_err(|error| error.to_string())?;
    Ok(master)
}

/// profirust, a slave whose answers are fixed, and a clock that stands where something happens next.
struct Theirs {
    fdl: FdlActiveStation,
    dp: DpMaster<'static>,
    peripheral: PeripheralHandle,
    canned: Canned,
    now: i64,
}

/// What profirust hears: the answer to what it has just sent.
struct Canned {
    outgoing: [u8; 256],
    answer: [u8; 64],
    length: usize,
    /// How many telegrams were sent, and whether the newest wants an answer.
    sent: u64,
}

impl Theirs {
    fn new() -> Result<Self, String> {
        let mut dp = DpMaster::new(Vec::new());
        let options = PeripheralOptions {
            ident_number: PLACEHOLDER_IDENT,
            max_tsdr: 150,
            user_parameters: Some(&USER),
            config: Some(&CONFIGURATION),
            ..PeripheralOptions::default()
        };
        let peripheral = dp.add(Peripheral::new(ADDRESS, options, vec![0; 12], vec![0; 4]));
        let fdl = ParametersBuilder::new(2, profirust::Baudrate::B1500000).build_verified(&dp);
        let mut fdl = FdlActiveStation::new(fdl);
        fdl.set_online();
        dp.enter_operate();
        let canned = Canned { outgoing: [0; 256], answer: [0; 64], length: 0, sent: 0 };
        let mut theirs = Self { fdl, dp, peripheral, canned, now: 0 };
        theirs.exchange(&[0; 4])?;
        if theirs.dp.get_mut(peripheral).pi_i()[0] != 0x12 {
            return Err("profirust does not take the canned answer.".into());
        }
        Ok(theirs)
    }

    /// Polls until outputs have gone and inputs have come. The clock goes on by steps that are as long as
    /// profirust wants to wait, so that no poll is idle but those that it needs.
    fn exchange(&mut self, outputs: &[u8]) -> Result<(), String> {
        self.dp.get_mut(self.peripheral).pi_q_mut().copy_from_slice(outputs);
        for _ in 0..10_000 {
            let sent = self.canned.sent;
            let now = profirust::time::Instant::from_micros(self.now);
            self.fdl.poll(now, &mut self.canned, &mut self.dp);
            let event = self.dp.take_last_events().peripheral;
            if matches!(event, Some((_, profirust::dp::PeripheralEvent::DataExchanged))) {
                return Ok(());
            }
            // The longest request takes 100 us, an idle time 22 us, a slot 200 us.
            self.now += if self.canned.sent > sent { 250 } else { 23 };
        }
        Err("profirust does not come into data exchange.".into())
    }
}

impl ProfibusPhy for Canned {
    fn poll_transmission(&mut self, _: profirust::time::Instant) -> bool {
        false
    }

    fn transmit_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&mut [u8]) -> (usize, R),
    {
        let (length, result) = f(&mut self.outgoing);
        if length > 0 {
            self.sent += 1;
            self.length = canned(&self.outgoing[..length], &mut self.answer);
        }
        result
    }

    fn receive_data<F, R>(&mut self, _: profirust::time::Instant, f: F) -> R
    where
        F: FnOnce(&[u8]) -> (usize, R),
    {
        let (used, result) = f(&self.answer[..self.length]);
        if used > 0 {
            self.length = 0;
        }
        result
    }
}

/// The answer to a request to the slave, and its length.
fn canned(request: &[u8], answer: &mut [u8; 64]) -> usize {
    /// Inputs with their check sum: SD2 02 05 08, 12 34 56 78 and eight zeros.
    const INPUTS: [u8; 21] = [
        0x68,
        15,
        15,
        0x68,
        2,
        ADDRESS,
        8,
        0x12,
        0x34,
        0x56,
        0x78,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0x12u8.wrapping_add(0x34).wrapping_add(0x56).wrapping_add(0x78).wrapping_add(2 + ADDRESS + 8),
        0x16,
    ];
    let octets: &[u8] = match request {
        [telegram::SD2, _, _, _, da, _, _, sap, ..] if da & 0x80 != 0 && da & 0x7F == ADDRESS => match sap {
            60 => return diagnosis(answer),
            _ => &[telegram::SC],
        },
        [telegram::SD2, _, _, _, ADDRESS, ..] => &INPUTS,
        _ => &[],
    };
    answer[..octets.len()].copy_from_slice(octets);
    octets.len()
}

/// Ready, owned by master 2.
fn diagnosis(answer: &mut [u8; 64]) -> usize {
    let [high, low] = PLACEHOLDER_IDENT.to_be_bytes();
    let body = [0x82, ADDRESS | 0x80, 8, 62, 60, 0, 4, 0, 2, high, low];
    answer[..4].copy_from_slice(&[0x68, 11, 11, 0x68]);
    answer[4..15].copy_from_slice(&body);
    answer[15..17].copy_from_slice(&[telegram::sum(&body), 0x16]);
    17
}
