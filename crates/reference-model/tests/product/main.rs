//! The model against the product: random dialogues, and each cell of state x service reached.

mod services;
mod splits;
mod twin;

use std::cell::RefCell;
use std::collections::BTreeMap;

use profibus_dp::time::{Baudrate, Duration};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestCaseError, TestRunner};
use reference_model::{Device, Setting, State};

use services::{ALL, Place, Service};
use twin::{Fate, Same, Twin};

/// The frame count bit of a request.
#[derive(Debug, Clone, Copy)]
enum Count {
    /// The other one than before, as masters do.
    Next,
    /// The same as before.
    Retry,
    First,
    None,
}

#[derive(Debug, Clone)]
struct Ask {
    service: Service,
    master: u8,
    count: Count,
    low: bool,
    sd3: bool,
    any: u8,
    fate: Fate,
    /// Where the read ends in the middle of it.
    cut: Option<u8>,
}

#[derive(Debug, Clone)]
enum Step {
    Ask(Ask),
    /// The master's way to data exchange.
    StartUp(u8),
    /// The request before, once more, octet for octet; or another one under its count.
    Again(Fate, Option<Service>),
    Wait(u16),
    Inputs(u8),
    Diagnosis {
        ext: bool,
        stat: bool,
    },
    LineError,
    /// One octet of a request is changed.
    Bad(Ask, u8, u8),
    Garbage(Vec<u8>, bool),
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        12 => Just(Fate::After(0)),
        1 => (0u32..400).prop_map(Fate::After),
        1 => Just(Fate::Lost),
    ]
}

fn ask() -> impl Strategy<Value = Ask> {
    let count = prop_oneof![9 => Just(Count::Next), 1 => Just(Count::Retry), 1 => Just(Count::First), 1 => Just(Count::None)];
    let master = prop_oneof![6 => Just(2u8), 3 => Just(3u8)];
    let service = prop_oneof![4 => proptest::sample::select(&ALL[..]), 1 => Just(Service::Exchange)];
    let cut = proptest::option::weighted(0.1, any::<u8>());
    (service, master, count, any::<bool>(), any::<bool>(), any::<u8>(), fate(), cut).prop_map(
        |(service, master, count, low, sd3, any, fate, cut)| Ask {
            service,
            master,
            count,
            low,
            sd3,
            any,
            fate,
            cut,
        },
    )
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        30 => ask().prop_map(Step::Ask),
        6 => prop_oneof![4 => Just(2u8), 1 => Just(3u8)].prop_map(Step::StartUp),
        4 => (fate(), proptest::option::of(proptest::sample::select(&ALL[..]))).prop_map(|(fate, other)| Step::Again(fate, other)),
        3 => (0u16..60).prop_map(Step::Wait),
        2 => any::<u8>().prop_map(Step::Inputs),
        2 => (any::<bool>(), any::<bool>()).prop_map(|(ext, stat)| Step::Diagnosis { ext, stat }),
        1 => Just(Step::LineError),
        1 => (ask(), any::<u8>(), 1u8..=255).prop_map(|(ask, at, flip)| Step::Bad(ask, at, flip)),
        1 => (proptest::collection::vec(prop_oneof![Just(0x68u8), Just(0x10), Just(0xA2), Just(0xDC), Just(0xE5), any::<u8>()], 1..20), any::<bool>())
            .prop_map(|(octets, pause)| Step::Garbage(octets, pause)),
    ]
}

fn device() -> impl Strategy<Value = Device> {
    let lengths = proptest::sample::select(vec![
        (vec![0xF1], 4, 4),
        (vec![0xD1], 4, 0),
        (vec![0x21], 0, 2),
        (vec![0x17, 0x27], 8, 8),
    ]);
    (lengths, any::<[bool; 4]>()).prop_map(
        |((cfg, inputs, outputs), [fail_safe, sync, freeze, changeable])| Device {
            fail_safe,
            sync,
            freeze,
            address_changeable: changeable,
            ..Device::new().with_lengths(&cfg, inputs, outputs)
        },
    )
}

fn setting() -> impl Strategy<Value = Setting> {
    let rates = proptest::sample::select(&Baudrate::ALL[..]);
    (rates, any::<bool>(), prop_oneof![5 => Just(11u8), 1 => Just(126u8)])
        .prop_map(|(rate, stream, address)| Setting { address, rate, stream })
}

/// How often a new request met a slave in this place, and retries.
type Cells = BTreeMap<(Place, Service), u32>;

struct Dialogue<'a> {
    twin: Twin,
    /// Of masters 2 and 3: the frame count bit of the request before.
    fcb: [bool; 2],
    before: Option<(Ask, u8)>,
    cells: &'a RefCell<Cells>,
}

impl Dialogue<'_> {
    fn step(&mut self, step: &Step) -> Same {
        match step {
            Step::Ask(ask) => {
                let fc = self.function_code(ask);
                self.ask(ask, fc)
            }
            Step::StartUp(master) => self.start_up(*master),
            Step::Again(fate, other) => {
                let Some((mut ask, fc)) = self.before.clone() else { return Ok(()) };
                ask.fate = *fate;
                ask.service = other.unwrap_or(ask.service);
                self.ask(&ask, fc | 0x10)
            }
            Step::Wait(millis) => self.twin.pass(Duration::from_millis(u64::from(*millis))),
            Step::Inputs(value) => {
                self.twin.change(|device| device.inputs.fill(*value), false);
                Ok(())
            }
            Step::Diagnosis { ext, stat } => {
                self.twin.change(|device| (device.ext_diag, device.stat_diag) = (*ext, *stat), true);
                Ok(())
            }
            Step::LineError => self.twin.line_error(),
            Step::Bad(ask, at, flip) => {
                let mut octets = self.octets(ask, 0x6D);
                let at = usize::from(*at) % octets.len();
                octets[at] ^= flip;
                self.twin.idle(40);
                self.twin.send(&[&octets], Fate::After(0)).map(drop)
            }
            Step::Garbage(octets, pause) => {
                self.twin.idle(if *pause { 6_000 } else { 0 });
                self.twin.send(&[octets], Fate::After(0)).map(drop)
            }
        }
    }

    fn function_code(&mut self, ask: &Ask) -> u8 {
        let bit = &mut self.fcb[usize::from(ask.master - 2)];
        let function = if ask.low { 0x4C } else { 0x4D };
        match ask.count {
            Count::None => return function,
            Count::Retry => {}
            Count::First => *bit = true,
            Count::Next => *bit = !*bit,
        }
        let valid = if matches!(ask.count, Count::First) { 0 } else { 0x10 };
        function | valid | u8::from(*bit) << 5
    }

    fn octets(&self, ask: &Ask, fc: u8) -> Vec<u8> {
        let device = &self.twin.model.device;
        ask.service.asked(self.twin.address(), ask.master, fc, device, ask.any).octets(ask.sd3)
    }

    fn ask(&mut self, ask: &Ask, fc: u8) -> Same {
        let octets = self.octets(ask, fc);
        let (state, owner) = (self.twin.model.state(), self.twin.model.owner());
        let place = Place::of(state, owner == Some(ask.master), self.twin.address());
        if !matches!(ask.count, Count::Retry) {
            *self.cells.borrow_mut().entry((place, ask.service)).or_default() += 1;
        }
        self.before = Some((ask.clone(), fc));
        // Long enough for both kinds of receivers.
        self.twin.idle(40);
        self.twin.pass(Duration::from_millis(11))?;
        let cut = ask.cut.map_or(0, |cut| usize::from(cut) % octets.len());
        let (head, tail) = octets.split_at(cut);
        let answer = self.twin.send(&[head, tail], ask.fate)?;
        self.twin.idle(11 * u32::try_from(answer.map_or(0, |answer| answer.len())).unwrap_or(0));
        Ok(())
    }

    fn start_up(&mut self, master: u8) -> Same {
        for service in [Service::Diag, Service::PrmGood, Service::CfgGood] {
            let (fate, cut) = (Fate::After(0), None);
            let ask = Ask { service, master, count: Count::Next, low: false, sd3: false, any: 0, fate, cut };
            let fc = self.function_code(&ask);
            self.ask(&ask, fc)?;
        }
        Ok(())
    }
}

fn play(setting: Setting, device: &Device, steps: &[Step], cells: &RefCell<Cells>) -> Same {
    let twin = Twin::new(setting, device);
    let mut dialogue = Dialogue { twin, fcb: [false; 2], before: None, cells };
    steps.iter().try_for_each(|step| dialogue.step(step))
}

#[test]
fn the_product_is_the_model_in_every_cell() {
    let cells = RefCell::new(Cells::new());
    let config = Config { failure_persistence: None, ..Config::with_cases(4_000) };
    let strategy = (setting(), device(), proptest::collection::vec(step(), 1..60));
    let result = TestRunner::new(config).run(&strategy, |(setting, device, steps)| {
        play(setting, &device, &steps, &cells).map_err(TestCaseError::fail)
    });
    if let Err(failure) = result {
        panic!("{failure}");
    }
    let cells = cells.into_inner();
    let missing: Vec<_> = Place::ALL
        .into_iter()
        .flat_map(|place| ALL.map(|service| (place, service)))
        .filter(|cell| !cells.contains_key(cell))
        .collect();
    assert!(missing.is_empty(), "cells that no dialogue reached: {missing:?}");
    let fewest = cells.values().min().expect("cells");
    println!("{} cells, the rarest was reached {fewest} times", cells.len());
}

#[test]
fn the_model_comes_to_data_exchange_by_itself() {
    let cells = RefCell::new(Cells::new());
    let setting = Setting { address: 11, rate: Baudrate::B500000, stream: false };
    let twin = Twin::new(setting, &Device::new());
    let mut dialogue = Dialogue { twin, fcb: [false; 2], before: None, cells: &cells };
    dialogue.start_up(2).expect("they are the same");
    assert_eq!(dialogue.twin.model.state(), State::DataExch);
}
