//! Judges what the station sends by what a `<` line demands.

use profibus_dp::fdl::Window;
use profibus_dp::time::{Baudrate, BitTimes};

use super::driver::{Driver, Played};
use super::script::Due;

impl Driver {
    pub(super) fn judge(&mut self, due: &Due, window: Option<Window>) -> Played {
        match *due {
            Due::Silence => match window {
                None => self.silence(),
                Some(_) => Err(self.unwanted(window)),
            },
            Due::Late => {
                let window = window.ok_or("no reply is due at all")?;
                self.advance(window.not_after + self.bits(1));
                match self.bench.transmit(self.now) {
                    None => Ok(()),
                    Some(octets) => Err(format!("sent after its window: {}", hex(&octets))),
                }
            }
            Due::Unfetched => window.map(|_| ()).ok_or("no reply is due at all".into()),
            Due::Reply { perhaps: true, .. } if window.is_none() => self.silence(),
            Due::Reply { min_tsdr, ref octets, .. } => {
                let window =
                    window.ok_or_else(|| format!("\n  due      {}\n  got      silence", pattern(octets)))?;
                self.judge_window(min_tsdr, window)?;
                self.judge_reply(octets, window)
            }
        }
    }

    fn unwanted(&mut self, window: Option<Window>) -> String {
        let got = window.and_then(|window| self.bench.transmit(window.not_before));
        format!("\n  due      silence\n  got      {}", hex(&got.unwrap_or_default()))
    }

    /// Nothing is sent for three slot times.
    fn silence(&mut self) -> Played {
        let slot = match self.rate {
            Baudrate::B500000 => 200,
            Baudrate::B1500000 => 300,
            Baudrate::B3000000 => 400,
            Baudrate::B6000000 => 600,
            Baudrate::B12000000 => 1000,
            _ => 100,
        };
        for _ in 0..30 {
            self.advance(self.now + self.bits(slot / 10));
            if let Some(octets) = self.bench.transmit(self.now) {
                return Err(format!("\n  due      silence\n  got      {}", hex(&octets)));
            }
        }
        Ok(())
    }

    fn judge_window(&mut self, min_tsdr: Option<u32>, window: Window) -> Played {
        let bit = self.bits(1).as_nanos();
        let nanos = window.not_before.since(self.end_of_request).as_nanos();
        let begins = u32::try_from((nanos + bit / 2) / bit).map_err(|error| error.to_string())?;
        if begins < BitTimes::MIN_TSDR.0 {
            return Err(format!("the reply starts {begins} bit times after the request"));
        }
        if let Some(due) = min_tsdr
            && begins != due
        {
            return Err(format!(
                "the reply starts {begins} bit times after the request at the earliest, due is {due}"
            ));
        }
        let latest = begins.max(self.rate.max_tsdr().0) + BitTimes::CHARACTER.0;
        let nanos = window.not_after.since(self.end_of_request).as_nanos();
        if nanos.abs_diff(self.bits(latest).as_nanos()) > bit / 2 {
            return Err(format!(
                "the window ends {} bit times after the request, due is {latest}",
                nanos / bit
            ));
        }
        Ok(())
    }

    fn judge_reply(&mut self, due: &[Option<u8>], window: Window) -> Played {
        self.advance(window.not_before - self.bits(1));
        if self.bench.transmit(self.now).is_some() {
            return Err("the reply can be had before its window".into());
        }
        self.advance(window.not_before);
        let got = self.bench.transmit(self.now).unwrap_or_default();
        // A host keeps what must be kept before it puts the reply on the line.
        self.keep();
        let length = u32::try_from(got.len()).map_err(|error| error.to_string())?;
        let fits = got.len() == due.len()
            && due.iter().zip(&got).all(|(due, got)| due.is_none_or(|due| due == *got));
        if !fits {
            let same =
                due.iter().zip(&got).take_while(|(due, got)| due.is_none_or(|due| due == **got)).count();
            return Err(format!(
                "\n  due      {}\n  got      {}\n           {}^^",
                pattern(due),
                hex(&got),
                " ".repeat(3 * same)
            ));
        }
        self.advance(self.now + self.bits(length * BitTimes::CHARACTER.0));
        if self.bench.transmit(self.now).is_some() {
            return Err("the reply can be had twice".into());
        }
        Ok(())
    }
}

fn hex(octets: &[u8]) -> String {
    if octets.is_empty() {
        return "silence".into();
    }
    let octets: Vec<_> = octets.iter().map(|octet| format!("{octet:02X}")).collect();
    octets.join(" ")
}

fn pattern(octets: &[Option<u8>]) -> String {
    let octets: Vec<_> = octets
        .iter()
        .map(|octet| octet.map_or_else(|| "..".into(), |octet| format!("{octet:02X}")))
        .collect();
    octets.join(" ")
}
