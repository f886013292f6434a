//! The whole slave: octets in, replies out.

use super::application::Application;
use super::slave::Slave;
use crate::fdl::baud_search::BaudSetting;
use crate::fdl::receiver::{Collected, Gathered, Listener, Receiver, ReceiverMode};
use crate::fdl::station::{Station, Window};
use crate::time::{Baudrate, Duration, Instant};
use crate::wire::Telegram;

/// How a slave is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Configuration {
    /// Station address, 0 to 126; `None`: it stays off the bus.
    pub address: Option<u8>,
    /// Baud rate, or the search for it.
    pub baud: BaudSetting,
    /// What the receiver sees of the line.
    pub receiver: ReceiverMode,
}

/// A DP-V0 slave around an [`Application`].
///
/// Octets go through the receiver, the passive station and the MS0 state machine to the
/// application; the reply comes back from the station's transmit buffer. See [`Station`] for the
/// order of calls. `IN` and `OUT` are the most input and output octets of any configuration.
#[derive(Debug)]
pub struct DpSlave<A, const IN: usize, const OUT: usize> {
    receiver: Receiver,
    slave: Slave<A, IN, OUT>,
}

impl<A: Application, const IN: usize, const OUT: usize> DpSlave<A, IN, OUT> {
    /// A slave at power-on.
    pub fn new(now: Instant, configuration: Configuration, application: A) -> Self {
        let mut slave = Self::blank(application);
        slave.restart(now, configuration);
        slave
    }

    /// A slave without power: off the bus until [`restart`](Self::restart). For places where a
    /// slave is to lie from the beginning, such as a static.
    pub const fn blank(application: A) -> Self {
        Self { receiver: Receiver::blank(), slave: Slave::blank(application) }
    }

    /// As at power-on, but for the application, which has to be made new by itself.
    pub fn restart(&mut self, now: Instant, configuration: Configuration) {
        let Configuration { address, baud, receiver } = configuration;
        self.slave.restart(now, address, baud);
        self.receiver.restart(receiver, self.slave.baudrate());
    }

    /// States, times and application.
    pub const fn slave(&self) -> &Slave<A, IN, OUT> {
        &self.slave
    }

    /// The application.
    pub const fn application(&self) -> &A {
        self.slave.application()
    }

    /// The application, to feed it.
    pub const fn application_mut(&mut self) -> &mut A {
        self.slave.application_mut()
    }

    /// States, times and application, to feed them.
    pub const fn slave_mut(&mut self) -> &mut Slave<A, IN, OUT> {
        &mut self.slave
    }

    /// See [`Slave::diagnosis_changed`].
    pub fn diagnosis_changed(&mut self) {
        self.slave.diagnosis_changed();
    }

    /// The host tells the baud rate: it counts as found.
    pub fn set_baudrate(&mut self, now: Instant, rate: Baudrate) {
        self.slave.set_baudrate(now, rate);
        self.retune();
    }

    /// The device cannot exchange data any longer: back to Wait_Prm.
    pub fn leave_master(&mut self, now: Instant) {
        self.slave.leave_master(now);
    }

    /// The far side has gone: an unfinished telegram is forgotten.
    pub fn forget_unfinished(&mut self) {
        self.receiver.forget();
    }

    /// One octet that ended at `now`, on a line whose idle times are seen: the path of a UART
    /// interrupt.
    #[inline]
    pub fn receive_octet(&mut self, now: Instant, octet: u8) -> Option<Window> {
        if self.collect(now, octet) { self.take_collected(now) } else { None }
    }

    /// The first half of [`receive_octet`](Self::receive_octet): whether this octet completes a
    /// telegram to be taken. If so, [`take_collected`](Self::take_collected) must follow, with the same `now`.
    ///
    /// For devices that do something after telegrams and nothing after all other octets.
    #[inline(always)]
    pub fn collect(&mut self, now: Instant, octet: u8) -> bool {
        match self.receiver.completes(now, octet, &mut Plain(&mut self.slave)) {
            Collected::Nothing => false,
            Collected::Telegram => true,
            Collected::Foreign => {
                self.hear_foreign(now);
                false
            }
        }
    }

    /// [`collect`](Self::collect) for a driver that watches the line itself, in two parts. This
    /// one is all that most octets need. Where the line was idle before this octet, for
    /// [`idle_gap`](Self::idle_gap) or longer, [`forget_unfinished`](Self::forget_unfinished)
    /// comes first.
    #[inline(always)]
    pub fn gather(&mut self, octet: u8) -> Gathered {
        self.receiver.gather(octet)
    }

    /// The second part, where [`gather`](Self::gather) asks for it, with the same octet. What must
    /// follow is [`take_collected`](Self::take_collected).
    #[inline(always)]
    pub fn look(&mut self, octet: u8) -> bool {
        self.receiver.look(octet, &mut Anticipating(&mut self.slave)) == Collected::Telegram
    }

    /// From the end of one octet to the end of the next: as long as this, and the line was idle.
    /// It changes with the rate.
    pub const fn idle_gap(&self) -> Duration {
        self.receiver.idle_gap()
    }

    /// Whether the telegram that [`look`](Self::look) has just completed is a
    /// Data_Exchange whose reply is sure to begin with SD2: a driver may send that octet before
    /// it asks for the rest, by [`take_collected`](Self::take_collected) and
    /// [`transmit`](Station::transmit).
    #[inline(always)]
    pub fn answers_data(&self, now: Instant) -> bool {
        self.slave.answers_data(now)
    }

    /// The second half of [`receive_octet`](Self::receive_octet), for the octet that has just
    /// completed a telegram, and only for it.
    #[inline]
    pub fn take_collected(&mut self, now: Instant) -> Option<Window> {
        let Some(frame) = self.receiver.sd2_frame() else {
            return self.take_other(now);
        };
        if !self.slave.is_heard(now) {
            self.retune();
            return None;
        }
        self.slave.frame(now, frame)
    }

    /// A telegram for another station has come, which keeps the rate alive; it ended at `now`.
    #[inline]
    pub fn hear_foreign(&mut self, now: Instant) {
        if !self.slave.is_heard(now) {
            self.retune();
        }
    }

    /// What was collected is not an SD2. By itself, so that each kind lies where it is known to.
    #[inline(never)]
    fn take_other(&mut self, now: Instant) -> Option<Window> {
        let Some(frame) = self.receiver.other_frame() else {
            self.receiver.spoil();
            return None;
        };
        if !self.slave.is_heard(now) {
            self.retune();
            return None;
        }
        self.slave.rarer_frame(now, frame)
    }

    /// [`Station::receive`], and `then` after each telegram that the slave has
    /// dealt with, also where one slice holds several: for devices with a part of their own that
    /// has to follow in step. Telegrams for other stations may be left out.
    #[inline(always)]
    pub fn receive_then(
        &mut self,
        now: Instant,
        octets: &[u8],
        mut then: impl FnMut(&mut Slave<A, IN, OUT>, Instant),
    ) -> Option<Window> {
        let Some(frame) = self.receiver.whole(now, octets) else {
            return self.receive_pieces(now, octets, then);
        };
        self.slave.drop_reply();
        if !self.slave.is_heard(now) {
            self.retune();
            return None;
        }
        // A host hears whole telegrams, most of them for others: those end here. One octet by
        // octet is more urgent if it is for us, and is first asked for that.
        if !self.slave.is_meant(frame.da) {
            return None;
        }
        let window = self.slave.frame(now, frame);
        then(&mut self.slave, now);
        window
    }

    /// Octets that are not one whole telegram.
    #[cold]
    #[inline(never)]
    fn receive_pieces(
        &mut self,
        now: Instant,
        octets: &[u8],
        mut then: impl FnMut(&mut Slave<A, IN, OUT>, Instant),
    ) -> Option<Window> {
        if let &[octet] = octets
            && self.receiver.mode() == ReceiverMode::Idle
        {
            let window = self.receive_octet(now, octet);
            then(&mut self.slave, now);
            return window;
        }
        self.slave.drop_reply();
        let (slave, mut window) = (&mut self.slave, None);
        let ended = self.receiver.pieces(now, octets, |end, telegram| {
            window = slave.indicate_out_of_line(end, telegram);
            then(slave, end);
        });
        self.retune();
        if !ended {
            // More has come: the master does not wait for this answer any longer.
            self.slave.drop_reply();
            return None;
        }
        window
    }

    #[inline]
    fn retune(&mut self) {
        if let Some(rate) = self.slave.take_retuned() {
            self.receiver.set_baudrate(rate);
        }
    }
}

/// Hears whole telegrams.
struct Plain<'a, A, const IN: usize, const OUT: usize>(&'a mut Slave<A, IN, OUT>);

impl<A: Application, const IN: usize, const OUT: usize> Listener for Plain<'_, A, IN, OUT> {
    #[inline(always)]
    fn begins(&mut self) {
        // A reply that is not fetched yet can only be met by the first octet after it.
        self.0.drop_reply();
    }

    #[inline(always)]
    fn is_foreign(&self, da: u8) -> bool {
        !self.0.is_meant(da)
    }

    #[inline(always)]
    fn ahead(&mut self, _: u8, _: u8, _: [u8; 3]) {}
}

/// Looks ahead, too: what it can decide before the last octet it need not decide after it.
struct Anticipating<'a, A, const IN: usize, const OUT: usize>(&'a mut Slave<A, IN, OUT>);

impl<A: Application, const IN: usize, const OUT: usize> Listener for Anticipating<'_, A, IN, OUT> {
    #[inline(always)]
    fn begins(&mut self) {
        self.0.begin();
    }

    #[inline(always)]
    fn is_foreign(&self, da: u8) -> bool {
        !self.0.is_meant(da)
    }

    #[inline(always)]
    fn ahead(&mut self, start: u8, le: u8, head: [u8; 3]) {
        self.0.anticipate(start, le, head);
    }
}

impl<A: Application, const IN: usize, const OUT: usize> Station for DpSlave<A, IN, OUT> {
    #[inline]
    fn receive(&mut self, now: Instant, octets: &[u8]) -> Option<Window> {
        self.receive_then(now, octets, |_, _| {})
    }

    #[inline]
    fn indicate(&mut self, now: Instant, telegram: &Telegram<'_>) -> Option<Window> {
        let window = self.slave.indicate(now, telegram);
        self.retune();
        window
    }

    fn line_error(&mut self, now: Instant) {
        self.receiver.line_error(now);
        self.slave.line_error(now);
        self.retune();
    }

    #[inline]
    fn transmit(&mut self, now: Instant) -> Option<&[u8]> {
        self.slave.transmit(now)
    }

    fn poll(&mut self, now: Instant) {
        self.slave.poll(now);
        self.retune();
    }

    fn next_deadline(&self) -> Option<Instant> {
        self.slave.next_deadline()
    }

    fn listening_rate(&self) -> Baudrate {
        self.slave.baudrate()
    }

    fn address(&self) -> Option<u8> {
        self.slave.station().address()
    }
}
