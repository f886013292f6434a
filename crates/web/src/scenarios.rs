//! The scenarios that come with the program, and the demonstration as a place to stay in.

use plant::scenario::Scenario;
use rust_embed::RustEmbed;
use serde::Serialize;

use crate::live::seconds;

#[derive(RustEmbed)]
#[folder = "../../examples/scenarios"]
struct Examples;

/// One that can be played.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Listed {
    name: String,
    title: String,
    story: String,
    seconds: f64,
}

/// A scenario with its text.
pub(crate) struct Loaded {
    pub(crate) plan: Scenario,
    pub(crate) source: String,
}

/// All of them, by name.
pub(crate) fn list() -> Vec<Listed> {
    let mut names: Vec<_> =
        Examples::iter().filter_map(|file| Some(file.strip_suffix(".toml")?.to_owned())).collect();
    names.sort();
    let listed = names.into_iter().filter_map(|name| {
        let Loaded { plan, .. } = load(&name)?;
        Some(Listed {
            name,
            title: plan.title,
            story: plan.description.trim().to_owned(),
            seconds: seconds(plan.duration.as_nanos()),
        })
    });
    listed.collect()
}

/// The one with this name.
pub(crate) fn load(name: &str) -> Option<Loaded> {
    let file = Examples::get(&format!("{name}.toml"))?;
    let source = String::from_utf8_lossy(&file.data).into_owned();
    let plan = Scenario::parse(&source).ok()?;
    Some(Loaded { plan, source })
}

/// An encoder with a turning shaft, and a master that exchanges data with it.
pub(crate) fn demonstration() -> Loaded {
    let source = include_str!("demonstration.toml").to_owned();
    match Scenario::parse(&source) {
        Ok(plan) => Loaded { plan, source },
        Err(faults) => unreachable!("a test reads it: {faults:?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_example_can_be_played() {
        let files = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/scenarios"));
        let files = files.expect("the examples").count();
        let all = list();
        assert_eq!(all.len(), files);
        for one in &all {
            assert!(!one.title.is_empty() && !one.story.is_empty() && one.seconds > 0.0, "{one:?}");
        }
        assert!(load("../Cargo").is_none() && load("nothing").is_none());
    }

    #[test]
    fn the_demonstration_goes_on_and_on() {
        let Loaded { plan, .. } = demonstration();
        assert!(plan.duration.as_nanos() > 90 * 86_400 * 1_000_000_000);
    }
}
