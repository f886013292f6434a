//! `sch108bex run FILE`: a scenario on its ports in real time, for your own master.

use std::path::Path;
use std::sync::mpsc::{self, Sender};
use std::time::{Duration as Time, Instant as Moment};

use bus::{Link, PortAddress, Settings, open_for_slaves};
use plant::control::{ControlAddress, Subscriptions};
use plant::scenario::{Act, EncoderPlan, Event, Scenario, SegmentPlan};
use plant::{EncoderSetup, Handle, Plant, Rate, Report, SegmentSetup};
use profibus_dp::fdl::BaudSetting;
use web::Shown;

use super::{Loaded, load};
use crate::Failure;
use crate::http::Browser;
use crate::output;
use crate::recording::Capture;
use crate::run::{
    end_of, end_on_signals, failed, forward_reports, note_on_address, note_on_state, serve_control,
    shared_addresses, tell_address, tell_until_end,
};
use crate::samples;

/// Runs until it is told to end.
pub(crate) fn run(
    file: &Path,
    control: Option<&ControlAddress>,
    capture: &Capture,
    record: &samples::Options,
    http: &Browser,
) -> Result<(), Failure> {
    let Loaded { plan, .. } = load(file)?;
    let (to_main, wakes) = mpsc::channel();
    let subscriptions = Subscriptions::new();
    let reports = forward_reports(&to_main, subscriptions.clone());
    let mut plant = Plant::new();
    let mut links = Vec::new();
    end_on_signals(&to_main)?;
    for segment in &plan.segments {
        links.extend(add(&mut plant, segment, &reports)?);
    }
    drop(reports);
    for note in what_is_not_done(&plan) {
        output::aside(&format!("note: {note}"));
    }
    for note in shared_addresses(&plant.snapshots().map_err(failed)?) {
        output::line(&note);
    }
    let handle = plant.handle();
    let buses: Vec<_> =
        plan.segments.iter().map(|segment| segment.name.as_str()).zip(plant.ports()).collect();
    let captures = capture.start(&handle, &buses, false)?;
    for start in plan.starts() {
        handle.apply(&start).map_err(failed)?;
    }
    let recording = record.start_with(&plant, &subscriptions)?;
    plant.start_shafts().map_err(failed)?;
    let control = serve_control(control, handle.clone(), subscriptions.clone(), end_of(&to_main))?;
    tell_address(control.as_ref());
    let (title, handle_of_page) = (plan.title.clone(), handle.clone());
    let shown = Shown::Plant { kind: web::Kind::Scenario, title, handle: handle_of_page, subscriptions };
    let http = http.serve(shown, end_of(&to_main))?;
    output::line("ready");
    drop(to_main);
    std::thread::spawn(move || play(&plan.events, &handle));
    tell_until_end(&wakes);
    drop(http);
    drop(control);
    drop(links);
    samples::stop(plant, recording).and(captures.end())
}

/// Opens a segment's port and puts its encoders there.
fn add(plant: &mut Plant, plan: &SegmentPlan, reports: &Sender<Report>) -> Result<Option<Link>, Failure> {
    let baud = plan.rate.map_or(BaudSetting::Search(bus::segment::DEFAULT_RATE), |rate| {
        if plan.search { BaudSetting::Search(rate) } else { BaudSetting::Fixed(rate) }
    });
    let rate = match (plan.rate, plan.search, &plan.port) {
        (Some(rate), true, PortAddress::Device(_)) => Rate::Search(rate),
        (Some(rate), false, _) => Rate::Fixed(rate),
        (None, _, PortAddress::Device(_)) => Rate::Search(bus::segment::DEFAULT_RATE),
        _ => Rate::OfTheEnd,
    };
    let setups: Result<Vec<_>, Failure> =
        plan.encoders.iter().map(|plan| setup(plan, rate, reports)).collect();
    let setups = setups?;
    let end = open_for_slaves(&plan.port, baud).map_err(failed)?;
    let bus = end.name().to_owned();
    let link = plan.link.as_deref().map(|link| Link::create(link, Path::new(&bus))).transpose();
    let link = link.map_err(failed)?;
    let notes: Vec<_> = setups.iter().flat_map(|(_, notes)| notes.clone()).collect();
    let setup = SegmentSetup {
        name: plan.name.clone(),
        end,
        settings: Settings { pace: plan.pace, ..Settings::default() },
        encoders: setups.into_iter().map(|(setup, _)| setup).collect(),
    };
    plant.add_with_master_at(plan.tap, setup, reports.clone()).map_err(failed)?;
    output::line(&format!("{}: {bus}", plan.name));
    for note in &notes {
        output::line(note);
    }
    Ok(link)
}

fn setup(
    plan: &EncoderPlan,
    rate: Rate,
    reports: &Sender<Report>,
) -> Result<(EncoderSetup, Vec<String>), Failure> {
    let mut setup = plan.setup(rate, reports).map_err(failed)?;
    let stored = setup.store.load().map_err(failed)?;
    let notes = [
        note_on_state(&plan.name, &stored),
        note_on_address(&plan.name, &plan.identity, &stored, plan.world),
    ];
    Ok((setup, notes.into_iter().flatten().collect()))
}

/// What stands in the file and is for virtual time only.
fn what_is_not_done(plan: &Scenario) -> Vec<String> {
    let masters = plan.segments.iter().any(|segment| segment.master.is_some());
    let acts = plan.events.iter().any(|event| matches!(event.act, Act::Master(_)));
    let mut notes = Vec::new();
    if masters || acts {
        notes.push(
            "your master is awaited: the built-in one, and events for it, are for `scenario run`".to_owned(),
        );
    }
    if !plan.expectations.is_empty() {
        notes.push("expectations are judged by `scenario run` only".to_owned());
    }
    notes
}

/// Does what happens, when it does.
fn play(events: &[Event], handle: &Handle) {
    let begun = Moment::now();
    for event in events {
        let Act::Request(request) = &event.act else {
            continue;
        };
        let due = Time::from_nanos(event.at.as_nanos());
        std::thread::sleep(due.saturating_sub(begun.elapsed()));
        if let Err(error) = handle.apply(request) {
            output::line(&format!("warning: the event {} was not done: {error}", request.name()));
        }
    }
}
