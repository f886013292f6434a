//! The way to the beginning of a case, from whatever the case before has left.

use profibus_dp::time::Duration;

use crate::case::{Before, Start};
use crate::reply::{Reply, hex};
use crate::rig::{Action, Expect, Fresh, Hand, Heard, Order};
use crate::runner::{Played, Runner, Stop};
use crate::telegram::{Atom, Body, Fc, Piece, Service};

/// What Slave_Diag is asked for so many times at most while a slave gets ready.
const PATIENCE: usize = 50;
/// Longer than an encoder takes to see its shaft again.
const LATCH: Duration = Duration::from_millis(2);
/// How often a slave that does not answer is asked again before the first case.
const ATTEMPTS: usize = 3;
/// The address of slaves as delivered.
const DELIVERED: u8 = 126;

impl Runner<'_> {
    /// Goes to where a case begins.
    pub(crate) fn reach(&mut self, before: &Before) -> Played {
        let order = Order {
            rate: before.rate.unwrap_or(self.options.rate),
            search: before.search,
            power_on: matches!(before.state, Start::PowerOn | Start::At126),
            address: (before.state != Start::At126).then_some(self.device.address),
        };
        self.address = order.address.unwrap_or(DELIVERED);
        let name = before.mode.as_deref();
        self.mode = self.device.mode(name).or(self.device.modes.first()).unwrap_or(self.mode);
        let fresh = self.rig.fresh(&order)?;
        if fresh == Fresh::Same && order.power_on {
            return Err(Stop::Skip("it needs control of the device's power".to_owned()));
        }
        let quiet = self.records.len();
        if !order.search {
            self.learn_ident()?;
            if fresh != Fresh::Delivered && before.state != Start::At126 {
                self.reset(fresh == Fresh::PowerCycled && before.state == Start::PowerOn)?;
            }
        }
        self.fcb = [None; 2];
        if matches!(before.state, Start::WaitCfg | Start::DataExchange) {
            self.start_up(before)?;
        }
        // The way is not what the case is about; it is told in one line.
        self.records.truncate(quiet);
        self.note("", &place(before), &[]);
        Ok(())
    }

    /// Asks who the slave is, if nobody has said.
    fn learn_ident(&mut self) -> Played {
        if self.ident == 0 {
            let diag = self.diagnosis()?;
            self.ident = u16::from_be_bytes([diag[4], diag[5]]);
        }
        Ok(())
    }

    /// The diagnosis of the slave, whatever it is: six octets at least, 5 and 6 being its ident number.
    ///
    /// # Errors
    ///
    /// It does not answer, or the rig broke; as a sentence.
    pub fn identify(&mut self) -> Result<Vec<u8>, String> {
        // A slave that still searches its rate does not answer at once.
        let mut learned = self.diagnosis();
        for _ in 0..ATTEMPTS {
            if !matches!(learned, Err(Stop::Fault(_))) {
                break;
            }
            learned = self.diagnosis();
        }
        self.fcb = [None; 2];
        self.records.clear();
        match learned {
            Ok(diagnosis) => Ok(diagnosis),
            Err(Stop::Fault(why) | Stop::Skip(why)) => Err(why),
            Err(Stop::Rig(error)) => Err(error.to_string()),
        }
    }

    /// Leaves nothing of the case before: no owner, no faults, no group, min T_SDR 11, outputs 0.
    fn reset(&mut self, keep_parameters: bool) -> Played {
        self.fcb = [None; 2];
        let owner = self.diagnosis()?[3];
        if let Some(at) = self.options.masters.iter().position(|master| *master == owner) {
            self.unlock(at + 1)?;
        } else if owner != 0xFF {
            return Err(Stop::on_the_way(&format!(
                "master {owner} owns the slave; end that master, the tester needs the slave for itself"
            )));
        }
        if keep_parameters {
            return Ok(());
        }
        let mode = self.mode;
        self.mode = self.device.modes.first().unwrap_or(mode);
        self.start_up(&Before { state: Start::DataExchange, ..Before::default() })?;
        let zeros = vec![Atom::Outputs(0)];
        self.ask(None, zeros.clone())?;
        if self.device.encoder.is_some() && self.rig.has(Hand::Shaft) && self.mode.outputs == 4 {
            // The shaft stands at 0 then, so this takes an offset away.
            self.rig.act(&Action::Shaft(0))?;
            self.rig.wait(LATCH)?;
            self.ask(None, vec![Atom::Octet(0x80, 1), Atom::Octet(0, 3)])?;
            self.rig.wait(LATCH)?;
            self.ask(None, zeros)?;
        }
        self.unlock(1)?;
        self.mode = mode;
        Ok(())
    }

    fn unlock(&mut self, master: usize) -> Played {
        let prm = [0x40, 0, 0, 0].map(|octet| Atom::Octet(octet, 1));
        let data = prm.into_iter().chain([Atom::Ident(0), Atom::Octet(0, 1)]).collect();
        self.ask_as(master, Some(61), data).map(drop)
    }

    /// DIAG, PRM, and for data exchange CFG, DIAG: as masters do.
    fn start_up(&mut self, before: &Before) -> Played {
        self.diagnosis()?;
        let name = Some(self.mode.name.clone());
        let prm =
            Atom::Prm { mode: name.clone(), watchdog: before.watchdog, changed: Vec::new(), first: None };
        self.acknowledged(61, vec![prm], "Set_Prm")?;
        if before.state != Start::DataExchange {
            return Ok(());
        }
        self.acknowledged(62, vec![Atom::Cfg(name)], "Chk_Cfg")?;
        for _ in 0..PATIENCE {
            let diag = self.diagnosis()?;
            if diag[0] & 0x44 != 0 || diag[1] & 0x01 != 0 {
                let why = "the slave refuses the parameters or the configuration it was given";
                return Err(Stop::on_the_way(&format!("{why}: its diagnosis is {}", hex(&diag))));
            }
            if diag[0] & 0x02 == 0 && diag[1] & 0x02 == 0 {
                return Ok(());
            }
        }
        Err(Stop::on_the_way("the slave does not get ready for data exchange"))
    }

    fn acknowledged(&mut self, sap: u8, data: Vec<Atom>, what: &str) -> Played {
        let heard = self.ask(Some(sap), data)?;
        if heard.octets == [0xE5] {
            Ok(())
        } else {
            Err(Stop::on_the_way(&format!("{what} was not acknowledged: {}", shown(&heard))))
        }
    }

    /// The first six octets of Slave_Diag at least.
    pub(crate) fn diagnosis(&mut self) -> Played<Vec<u8>> {
        let heard = self.ask(Some(60), Vec::new())?;
        match Reply::parse(&heard.octets) {
            Ok(Reply::Data { data, fc: 0x08, .. }) if data.len() >= 6 => Ok(data),
            _ => Err(Stop::on_the_way(&format!(
                "no diagnosis from station {}: {}; check address, port and rate",
                self.address,
                shown(&heard)
            ))),
        }
    }

    fn ask(&mut self, sap: Option<u8>, data: Vec<Atom>) -> Played<Heard> {
        self.ask_as(1, sap, data)
    }

    fn ask_as(&mut self, master: usize, sap: Option<u8>, data: Vec<Atom>) -> Played<Heard> {
        let at = master - 1;
        let bit = self.fcb[at];
        let function = if self.options.srd_low { 0x0C } else { 0x0D };
        let fc = bit.map_or(0x60, |bit| 0x50 | u8::from(bit) << 5) | function;
        self.fcb[at] = Some(!bit.unwrap_or(true));
        let dsap = sap.map(|sap| vec![Atom::Octet(sap, 1)]);
        let service = Service { fc: Fc::Next, dsap, data, to: None, from: None };
        let piece = Piece {
            master,
            body: Body::Service(service),
            twists: Vec::new(),
            then: crate::telegram::Joint::None,
        };
        let (signals, _) = self.context(fc).signals(&piece);
        self.rig.send(&signals)?;
        let heard = self.rig.listen(Expect::Reply)?;
        let what = sap.map_or("Data_Exchange, on the way", way);
        self.note("", what, &signals);
        if let Some(record) = self.records.last_mut() {
            record.came = hex(&heard.octets);
            "an answer".clone_into(&mut record.due);
        }
        Ok(heard)
    }

    /// The slave has to be there at the end of a case.
    pub(crate) fn alive(&mut self) -> Played {
        let service = Service { fc: Fc::Is(0x49), dsap: None, data: Vec::new(), to: None, from: None };
        let (octets, _) = self.context(0x49).service(&service, 1, &[]);
        let signals: Vec<_> = octets.into_iter().map(crate::rig::Signal::Octet).collect();
        self.rig.send(&signals)?;
        let heard = self.rig.listen(Expect::Reply)?;
        let fine = matches!(Reply::parse(&heard.octets), Ok(Reply::Data { fc: 0x00, .. }));
        if fine {
            return Ok(());
        }
        self.note("", "is the slave still there?", &signals);
        Err(Stop::Fault(format!("after the case, FDL status was not answered: {}", shown(&heard))))
    }
}

/// What is asked on the way to the beginning.
const fn way(sap: u8) -> &'static str {
    match sap {
        60 => "Slave_Diag, on the way",
        61 => "Set_Prm, on the way",
        _ => "Chk_Cfg, on the way",
    }
}

fn shown(heard: &Heard) -> String {
    if heard.octets.is_empty() { "silence".to_owned() } else { format!("{} came", hex(&heard.octets)) }
}

/// Where a case begins, in words.
pub(crate) fn place(before: &Before) -> String {
    let state = match before.state {
        Start::PowerOn => "the power has just come on",
        Start::At126 => "as delivered, at address 126",
        Start::WaitPrm => "the slave waits for Set_Prm",
        Start::WaitCfg => "the slave is parameterized and waits for Chk_Cfg",
        Start::DataExchange => "the slave exchanges data",
    };
    let mode = before.mode.as_ref().map(|mode| format!(" ({mode})"));
    let watchdog = before.watchdog.then(|| ", watchdog 200 ms".to_owned());
    let rate = before.rate.map(|rate| format!(", at {rate}"));
    let search = before.search.then(|| ", and searches its rate".to_owned());
    [Some(state.to_owned()), mode, watchdog, rate, search].into_iter().flatten().collect()
}
