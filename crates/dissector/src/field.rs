//! A value with the octets that it stands in.

use std::borrow::Cow;

use serde::Serialize;

/// One value of a telegram.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Field {
    /// First and last octet in the telegram, from 1.
    pub octets: [usize; 2],
    /// First and last octet in the service's data, from 1 as the standard and manuals count them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data_octets: Option<[usize; 2]>,
    /// Highest and lowest bit, where it does not fill its octets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<[u8; 2]>,
    /// The standard's name, or the encoder's with `encoder.` before it. Names do not change.
    pub name: &'static str,
    /// What stands there.
    pub value: Value,
    /// What it means.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub words: Cow<'static, str>,
}

/// What stands in the octets of a field.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A bit.
    Bit(bool),
    /// A number, most significant octet first.
    Number(i64),
    /// Octets as hexadecimal text.
    Octets(String),
    /// Characters.
    Text(String),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bit(bit) => write!(f, "{}", u8::from(*bit)),
            Self::Number(number) => write!(f, "{number}"),
            Self::Octets(text) | Self::Text(text) => f.write_str(text),
        }
    }
}

/// The data of a service, and the fields found in it.
pub(crate) struct Data<'a> {
    /// The data, octet 1 first.
    pub(crate) octets: &'a [u8],
    /// Octets of the telegram before the data.
    before: usize,
    pub(crate) fields: Vec<Field>,
}

type Words = Cow<'static, str>;

impl<'a> Data<'a> {
    pub(crate) fn new(octets: &'a [u8], before: usize) -> Self {
        Self { octets, before, fields: Vec::new() }
    }

    /// The octet with this number; the one place that subtracts the 1.
    pub(crate) fn octet(&self, number: usize) -> Option<u8> {
        profibus_dp::wire::octet(self.octets, number)
    }

    /// A number of one to four octets; `None`, and no field, where the data end before.
    pub(crate) fn number(
        &mut self,
        [first, last]: [usize; 2],
        name: &'static str,
        words: impl FnOnce(u32) -> Words,
    ) -> Option<u32> {
        let number = self.unsigned([first, last])?;
        self.add([first, last], None, name, Value::Number(i64::from(number)), words(number));
        Some(number)
    }

    /// The same with a sign, in four octets.
    pub(crate) fn signed(
        &mut self,
        octets: [usize; 2],
        name: &'static str,
        words: impl FnOnce(i32) -> Words,
    ) -> Option<i32> {
        let number = self.unsigned(octets)?.cast_signed();
        self.add(octets, None, name, Value::Number(i64::from(number)), words(number));
        Some(number)
    }

    /// A bit; `None`, and no field, where the data end before.
    pub(crate) fn bit(
        &mut self,
        octet: usize,
        bit: u8,
        name: &'static str,
        words: [&'static str; 2],
    ) -> Option<bool> {
        let set = self.octet(octet)? >> bit & 1 == 1;
        self.add([octet, octet], Some([bit, bit]), name, Value::Bit(set), words[usize::from(set)].into());
        Some(set)
    }

    /// Octets as they are; no field where there are none.
    pub(crate) fn raw(&mut self, [first, last]: [usize; 2], name: &'static str, words: impl Into<Words>) {
        let last = last.min(self.octets.len());
        let Some(octets) = first.checked_sub(1).and_then(|from| self.octets.get(from..last)) else { return };
        if !octets.is_empty() {
            let value = Value::Octets(crate::hex::text(octets));
            self.add([first, last], None, name, value, words.into());
        }
    }

    /// A field with a value that was made elsewhere.
    pub(crate) fn add(
        &mut self,
        data_octets: [usize; 2],
        bits: Option<[u8; 2]>,
        name: &'static str,
        value: Value,
        words: Words,
    ) {
        let octets = data_octets.map(|octet| octet + self.before);
        self.fields.push(Field { octets, data_octets: Some(data_octets), bits, name, value, words });
    }

    /// The place of a data octet in the telegram.
    pub(crate) fn place(&self, data_octet: usize) -> usize {
        data_octet + self.before
    }

    fn unsigned(&self, [first, last]: [usize; 2]) -> Option<u32> {
        let octets = self.octets.get(first.checked_sub(1)?..last)?;
        Some(octets.iter().fold(0, |number, octet| number << 8 | u32::from(*octet)))
    }
}
