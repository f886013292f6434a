//! A telegram as fields: what every telegram has, whatever it is about.

use profibus_dp::wire::function_code::FunctionCode;
use profibus_dp::wire::sap::Sap;
use profibus_dp::wire::telegram::{BROADCAST, DataTelegram, SD1, SD2, SD3, SD4};
use serde::Serialize;

use crate::field::{Field, Value};
use crate::hex;
use crate::names::{self, Direction, Format, Service};

/// A telegram in words.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dissected {
    /// All octets, in hexadecimal.
    pub octets: String,
    /// Its format.
    pub format: Format,
    /// Who speaks to whom.
    pub direction: Direction,
    /// SA; not in a short acknowledgement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<u8>,
    /// DA, 127 for all; not in a short acknowledgement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub destination: Option<u8>,
    /// What it is about, as far as it can be known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub service: Option<Service>,
    /// The number of the entry with the request that it answers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub answers: Option<u64>,
    /// Whether it is the same request once more, by its frame count bit.
    pub retry: bool,
    /// One line.
    pub summary: String,
    /// Every value, in the order of the octets; an encoder's alarms and warnings come first of its own.
    pub fields: Vec<Field>,
    /// What is wrong or unusual, with the octet.
    pub remarks: Vec<Remark>,
}

/// What is wrong or unusual in a telegram that has no fault in its format.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Remark {
    /// The octet of the telegram, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub octet: Option<usize>,
    /// A sentence.
    pub words: String,
}

/// Where things stand in an SD1, SD2 or SD3 telegram, from 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Places {
    pub(crate) da: usize,
    pub(crate) fc: usize,
    /// Octets before the data of the service.
    pub(crate) before_data: usize,
}

impl Places {
    pub(crate) fn of(octets: &[u8], telegram: &DataTelegram<'_>) -> Self {
        let da = if octets.first() == Some(&SD2) { 5 } else { 2 };
        let saps = usize::from(!telegram.dsap.is_nil()) + usize::from(!telegram.ssap.is_nil());
        Self { da, fc: da + 2, before_data: da + 2 + saps }
    }
}

impl Dissected {
    /// One without fields so far.
    pub(crate) fn new(octets: &[u8], direction: Direction) -> Self {
        let format = match octets.first() {
            Some(&SD1) => Format::SD1,
            Some(&SD2) => Format::SD2,
            Some(&SD3) => Format::SD3,
            Some(&SD4) => Format::SD4,
            _ => Format::SC,
        };
        Self {
            octets: hex::text(octets),
            format,
            direction,
            source: None,
            destination: None,
            service: None,
            answers: None,
            retry: false,
            summary: String::new(),
            fields: Vec::new(),
            remarks: Vec::new(),
        }
    }

    /// A token.
    pub(crate) fn token(octets: &[u8], da: u8, sa: u8) -> Self {
        let mut dissected = Self::new(octets, Direction::Token);
        dissected.addresses(2, [da, sa]);
        dissected.summary = format!("{sa} -> {da}  token");
        if da == BROADCAST || sa == BROADCAST {
            dissected
                .remark(Some(if da == BROADCAST { 2 } else { 3 }), "address 127 holds no token".to_owned());
        }
        dissected
    }

    /// Addresses, FC, SAPs and lengths.
    pub(crate) fn head(octets: &[u8], telegram: &DataTelegram<'_>) -> Self {
        let request = telegram.fc.is_request();
        let mut dissected = Self::new(octets, if request { Direction::Request } else { Direction::Response });
        let places = Places::of(octets, telegram);
        if dissected.format == Format::SD2 {
            let le = Value::Number(i64::from(octets[1]));
            dissected.field([2, 3], None, "LE", le, "octets from DA to the end of the data");
        }
        dissected.addresses(places.da, [telegram.da, telegram.sa]);
        dissected.function_code(places.fc, telegram.fc);
        let mut place = places.fc;
        for (name, sap) in [("DSAP", telegram.dsap), ("SSAP", telegram.ssap)] {
            if !sap.is_nil() {
                place += 1;
                dissected.field(
                    [place, place],
                    None,
                    name,
                    Value::Number(i64::from(sap.0)),
                    names::sap(sap.0),
                );
            }
        }
        dissected.unusual(places, telegram);
        dissected
    }

    fn addresses(&mut self, place: usize, [da, sa]: [u8; 2]) {
        (self.destination, self.source) = (Some(da), Some(sa));
        let all = if da == BROADCAST { "all stations" } else { "" };
        self.field([place, place], Some([6, 0]), "DA", Value::Number(i64::from(da)), all);
        self.field([place + 1, place + 1], Some([6, 0]), "SA", Value::Number(i64::from(sa)), "");
    }

    fn function_code(&mut self, place: usize, fc: FunctionCode) {
        let number = |value: u8| Value::Number(i64::from(value));
        let octets = [place, place];
        if fc.is_request() {
            self.field(octets, Some([5, 5]), "FCB", Value::Bit(fc.frame_count_bit()), "");
            let words = if fc.frame_count_valid() { "" } else { "FCB does not count" };
            self.field(octets, Some([4, 4]), "FCV", Value::Bit(fc.frame_count_valid()), words);
            self.field(octets, Some([3, 0]), "Function", number(fc.0 & 0x0F), names::function(fc));
        } else {
            self.field(octets, Some([5, 4]), "Station_Type", number(fc.0 >> 4 & 3), names::station_type(fc));
            self.field(octets, Some([3, 0]), "Response_Code", number(fc.0 & 0x0F), names::response(fc));
        }
    }

    /// What slaves do not answer, or not expect.
    fn unusual(&mut self, places: Places, telegram: &DataTelegram<'_>) {
        let DataTelegram { da, sa, fc, dsap, ssap, .. } = *telegram;
        if sa == BROADCAST {
            self.remark(Some(places.da + 1), "127 is no source address".to_owned());
        }
        let answered = !matches!(fc.0 & 0x0F, 0x4 | 0x6);
        if da == BROADCAST && (!fc.is_request() || answered) {
            self.remark(Some(places.da), "only a request without answer may go to all stations".to_owned());
        }
        let words = if fc.is_request() { names::function(fc) } else { names::response(fc) };
        if words == "reserved" || (!fc.is_request() && fc.0 & 0x80 != 0) {
            self.remark(Some(places.fc), format!("FC {:02X}h is reserved; nobody answers it", fc.0));
        }
        let mut place = places.fc;
        for sap in [dsap, ssap] {
            place += usize::from(!sap.is_nil());
            if !sap.is_plain() {
                self.remark(
                    Some(place),
                    "no SAP but a segment or a chain of extensions; slaves ignore it".to_owned(),
                );
            }
        }
        let dp = fc.is_srd_request() && !dsap.is_nil() && Service::of_sap(dsap) != Service::Other;
        if dp && ssap != Sap::CHK_CFG {
            self.remark(None, "masters ask for this service from SSAP 62".to_owned());
        }
    }

    /// A field of the telegram outside the service's data.
    fn field(
        &mut self,
        octets: [usize; 2],
        bits: Option<[u8; 2]>,
        name: &'static str,
        value: Value,
        words: &'static str,
    ) {
        self.fields.push(Field { octets, data_octets: None, bits, name, value, words: words.into() });
    }

    pub(crate) fn remark(&mut self, octet: Option<usize>, words: String) {
        self.remarks.push(Remark { octet, words });
    }
}
