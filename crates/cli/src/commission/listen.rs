//! Another master's traffic: what an encoder tells its owner, without a word of our own.

use std::time::Duration as Time;

use bus::{End, Event, PortAddress, open_for_slaves};
use dissector::{Conversation, Dissected, Item, Profile, Value};
use profibus_dp::fdl::BaudSetting;
use profibus_dp::time::Baudrate;
use sch108bex::parameterization::TimeBase;

use super::place::core_span;
use super::readings::{Sample, Scale};
use crate::{Failure, output};

/// An encoder that is listened to.
pub(super) struct Listener {
    end: Box<dyn End>,
    conversation: Conversation,
    /// Which station; the first one that sends a position where none was named.
    address: Option<u8>,
    pub(super) scale: Scale,
    pub(super) retries: u64,
    heard: Vec<Dissected>,
}

impl Listener {
    pub(super) fn open(port: &PortAddress, rate: Baudrate, address: Option<u8>) -> Result<Self, Failure> {
        let end = open_for_slaves(port, BaudSetting::Fixed(rate))
            .map_err(|error| Failure::Failed(error.to_string()))?;
        output::aside(&format!("listening at {}", end.name()));
        // Who listens says that it is an encoder; nobody may start it up while he does.
        let conversation = Conversation::new(Profile::Encoder);
        Ok(Self { end, conversation, address, scale: Scale::default(), retries: 0, heard: Vec::new() })
    }

    /// The station that is listened to.
    pub(super) fn address(&self) -> Option<u8> {
        self.address
    }

    /// What comes within `span`, all positions of it.
    pub(super) fn listen(&mut self, span: Time) -> Result<Vec<Sample>, Failure> {
        let mut buffer = [0; 4096];
        match self.end.wait(Some(core_span(span)), &mut buffer) {
            Ok(Event::Octets(count)) => {
                let heard = &mut self.heard;
                self.conversation.push(&buffer[..count], &mut |entry| {
                    if let Item::Telegram(telegram) = entry.item {
                        heard.push(telegram);
                    }
                });
            }
            Ok(Event::Noted(note)) => output::aside(&format!("note: {note}")),
            Ok(_) => {}
            Err(error) => return Err(Failure::Failed(error.to_string())),
        }
        let heard = std::mem::take(&mut self.heard);
        Ok(heard.iter().filter_map(|telegram| self.take(telegram)).collect())
    }

    fn take(&mut self, telegram: &Dissected) -> Option<Sample> {
        let number = |name: &str| {
            telegram.fields.iter().find(|field| field.name == name).and_then(|field| match field.value {
                Value::Number(number) => Some(number),
                _ => None,
            })
        };
        let small = |name: &str| number(name).and_then(|number| u32::try_from(number).ok());
        let signed = |name: &str| number(name).and_then(|number| i32::try_from(number).ok());
        let position = small("encoder.position");
        if position.is_some() && self.address.is_none() {
            self.address = telegram.source;
        }
        self.retries += u64::from(telegram.retry && telegram.destination == self.address);
        if let Some(base) = number("encoder.time_base").filter(|_| telegram.destination == self.address) {
            self.scale.base = u8::try_from(base).ok().and_then(TimeBase::from_octet);
        }
        if telegram.source != self.address {
            return None;
        }
        // A diagnosis in data exchange tells what is in force.
        if let (Some(steps), Some(range)) =
            (small("encoder.measuring_units_per_revolution"), small("encoder.total_measuring_range"))
        {
            (self.scale.steps, self.scale.range) = (Some(steps), Some(range));
        } else if let (Some(steps), Some(turns)) =
            (small("encoder.singleturn_resolution"), small("encoder.revolutions"))
        {
            (self.scale.steps, self.scale.range) = (Some(steps), steps.checked_mul(turns));
        }
        let sample = Sample {
            position: position?,
            velocity: signed("encoder.velocity"),
            acceleration: signed("encoder.acceleration"),
        };
        Some(sample)
    }
}
