//! The data of requests and answers, with what is known of the station.

use profibus_dp::wire::chk_cfg::Lengths;
use profibus_dp::wire::set_prm::{SetPrm, StationStatus};
use profibus_dp::wire::slave_diag::StandardDiagnosis;

use super::{Conversation, Profile};
use crate::dissected::Dissected;
use crate::encoder;
use crate::field::Data;
use crate::names::Service;
use crate::services;

impl Conversation {
    /// The data of a request.
    pub(super) fn tell_request(
        &mut self,
        service: Service,
        da: u8,
        data: &mut Data<'_>,
        into: &mut Dissected,
    ) -> String {
        let (words, wrong) = match service {
            Service::GlobalControl => services::global_control(data),
            Service::SetSlaveAdd => services::set_slave_add(data),
            Service::SetPrm => return self.tell_set_prm(da, data, into),
            Service::ChkCfg => {
                let told = services::identifiers(data);
                let octets = data.octets.to_vec();
                if let Some(station) = self.stations.get_mut(usize::from(da)) {
                    station.remember();
                    station.configuration = Some(octets);
                }
                self.with_functionality(da, data.octets, told)
            }
            Service::DataExchange => return self.tell_outputs(da, data, into),
            Service::SlaveDiag | Service::GetCfg | Service::RdInp | Service::RdOutp => {
                data.raw([1, usize::MAX], "Data", "a request for this service has none");
                let wrong = (!data.octets.is_empty())
                    .then(|| (data.place(1), "a request for this service has no data".to_owned()));
                (String::new(), wrong)
            }
            _ => {
                data.raw([1, usize::MAX], "Data", "");
                (String::new(), None)
            }
        };
        into.remarks(wrong);
        words
    }

    fn with_functionality(
        &self,
        da: u8,
        octets: &[u8],
        (words, wrong): (String, Option<(usize, String)>),
    ) -> (String, Option<(usize, String)>) {
        let found = self.configurations.find(octets).filter(|_| self.is_encoder(da));
        (found.map_or(words.clone(), |(functionality, _)| format!("{words}, {functionality}")), wrong)
    }

    fn tell_set_prm(&mut self, da: u8, data: &mut Data<'_>, into: &mut Dissected) -> String {
        let (mut words, wrong) = services::standard_parameters(data);
        into.remarks(wrong);
        let parsed = SetPrm::parse(data.octets).map(|parsed| parsed.status);
        let locks = parsed.is_some_and(|status| status.lock_req() && !status.unlock_req());
        if let Some(station) = self.stations.get_mut(usize::from(da)) {
            station.remember();
            station.encoder |= locks && encoder::parameters_fit(data.octets);
            if locks {
                station.set_prm = Some(data.octets.to_vec());
            } else if parsed.is_some_and(StationStatus::unlock_req) {
                (station.set_prm, station.configuration) = (None, None);
            }
        }
        if locks && self.is_encoder(da) && data.octets.len() >= 9 {
            let variant = self.station(da).and_then(|station| station.variant).unwrap_or_default();
            let (more, refusal) = encoder::parameters(data, variant);
            into.remarks(refusal);
            words = format!("{words}; {more}");
        } else {
            data.raw([9, usize::MAX], "User_Prm_Data", "the device's own");
        }
        words
    }

    fn tell_outputs(&mut self, da: u8, data: &mut Data<'_>, into: &mut Dissected) -> String {
        let octets = data.octets.len();
        self.check_length(da, data, true, into);
        let encoders = self.is_encoder(da) && self.functionality(da).is_none_or(|known| known.outputs() == 4);
        let words = if octets == 4 && encoders { encoder::outputs(data) } else { String::new() };
        data.raw([1, usize::MAX], "Outputs", "");
        match (octets, words.as_str()) {
            (0, _) => "no outputs".to_owned(),
            (_, "") => format!("{octets} octets of outputs"),
            _ => words,
        }
    }

    /// Whether inputs or outputs have the length that the last Chk_Cfg has.
    fn check_length(&self, address: u8, data: &Data<'_>, outputs: bool, into: &mut Dissected) {
        let configuration = self.station(address).and_then(|station| station.configuration.as_deref());
        let Some(lengths) = configuration.and_then(Lengths::of) else { return };
        let due = if outputs { lengths.outputs } else { lengths.inputs };
        let octets = data.octets.len();
        // Empty outputs are what a master in Clear sends to slaves with Fail_Safe.
        if octets != usize::from(due) && !(outputs && octets == 0) {
            let words = format!(
                "{octets} octets, but the last Chk_Cfg has {}",
                services::lengths_in_words(configuration.unwrap_or(&[]))
            );
            into.remark(Some(data.place(octets)), words);
        }
    }

    /// The data of a positive answer.
    pub(super) fn tell_response(
        &mut self,
        service: Service,
        sa: u8,
        data: &mut Data<'_>,
        into: &mut Dissected,
    ) -> String {
        match service {
            Service::SlaveDiag => self.tell_diagnosis(sa, data, into),
            Service::GetCfg => {
                let told = services::identifiers(data);
                let (words, wrong) = self.with_functionality(sa, data.octets, told);
                into.remarks(wrong);
                words
            }
            Service::DataExchange | Service::RdInp => {
                self.check_length(sa, data, false, into);
                self.tell_inputs(sa, data)
            }
            Service::RdOutp => {
                self.check_length(sa, data, true, into);
                let words = if data.octets.len() == 4 && self.is_encoder(sa) {
                    encoder::outputs(data)
                } else {
                    String::new()
                };
                data.raw([1, usize::MAX], "Outputs", "");
                if words.is_empty() { format!("{} octets of outputs", data.octets.len()) } else { words }
            }
            _ => {
                data.raw([1, usize::MAX], "Data", "");
                format!("{} octets of data", data.octets.len())
            }
        }
    }

    fn tell_inputs(&self, sa: u8, data: &mut Data<'_>) -> String {
        let octets = data.octets.len();
        let fits = match self.functionality(sa) {
            Some(known) => octets == usize::from(known.inputs()),
            None => octets == 4 || octets == 12,
        };
        let words = if fits && self.is_encoder(sa) {
            let base =
                self.station(sa).and_then(|station| encoder::time_base_of(station.set_prm.as_deref()?));
            encoder::inputs(data, base)
        } else {
            String::new()
        };
        data.raw([1, usize::MAX], "Inputs", "");
        match (octets, words.as_str()) {
            (0, _) => "no inputs".to_owned(),
            (_, "") => format!("{octets} octets of inputs"),
            _ => words,
        }
    }

    fn tell_diagnosis(&mut self, sa: u8, data: &mut Data<'_>, into: &mut Dissected) -> String {
        let (words, wrong, blocks) = services::standard_diagnosis(data);
        into.remarks(wrong);
        let fits = encoder::diagnosis_fits(data, &blocks) && self.profile != Profile::Dp;
        let told = if fits { encoder::diagnosis(data) } else { None };
        if let (Some(station), Some(standard)) =
            (self.stations.get_mut(usize::from(sa)), StandardDiagnosis::parse(data.octets))
        {
            if let Some((_, variant)) = told {
                (station.encoder, station.variant) = (true, variant.or(station.variant));
            }
            if standard.prm_req {
                station.set_prm = None;
            }
            if standard.prm_req || standard.cfg_fault {
                station.configuration = None;
            }
        }
        told.map_or(words.clone(), |(encoders, _)| format!("{encoders}; {words}"))
    }
}
