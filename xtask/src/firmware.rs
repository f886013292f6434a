//! `cargo xtask firmware`: the images of all boards, and what is proved of each.

mod proofs;

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use crate::image::{Image, OBJDUMP};
use crate::measure::ABSENT;
use crate::process::{Show, run};
use crate::project::Project;
use crate::setup::{self, Tools};
use crate::steps::Run;
use crate::tally::Tally;
use crate::thumb::{TARGET, Thumb};

/// Where the firmware's workspace is.
pub(crate) const MANIFEST: &str = "firmware/Cargo.toml";
const BUILD: Duration = Duration::from_mins(15);
const KIB: f64 = 1024.0;
/// The source of the slave stack, FDL and DP, which knows no encoder.
const STACK: &str = "crates/profibus-dp/";

/// A board that there is an image for.
#[derive(Debug)]
pub(crate) struct Board {
    /// Its program and its feature in the firmware's workspace.
    pub(crate) name: &'static str,
    part: &'static str,
    /// What its image may take.
    flash: u32,
    ram: u32,
}

/// The image that the figures are of, and that the emulator runs.
pub(crate) const SHIPPED: &Board =
    &Board { name: "olimex_h405", part: "STM32F405", flash: 24 * 1024, ram: 4 * 1024 };

const BOARDS: [&Board; 2] =
    [SHIPPED, &Board { name: "nucleo_g474re", part: "STM32G474", flash: 32 * 1024, ram: 4 * 1024 }];

impl Board {
    /// `cargo build` of its image, with these features beside its own.
    pub(crate) fn build(&self, project: &Project, thumb: &Thumb, features: &str) -> Command {
        let mut cargo = thumb.cargo_at(project, "build", MANIFEST, &folder(features));
        cargo.args(["--quiet", "--bin", self.name, "--features", &format!("{} {features}", self.name)]);
        cargo
    }

    /// Where its image is.
    pub(crate) fn image(&self, project: &Project, features: &str) -> PathBuf {
        project.target.join(folder(features)).join(TARGET).join("release").join(self.name)
    }

    /// Builds and reads its image.
    fn read(&self, project: &Project, thumb: &Thumb, features: &str) -> Result<Image, String> {
        run(&mut self.build(project, thumb, features), BUILD, Show::Nothing)?
            .expect_success(&format!("Building the image for {}", self.name))?;
        Image::read(project, &self.image(project, features))
    }
}

/// Builds with other features do not take turns in one folder.
fn folder(features: &str) -> String {
    if features.is_empty() { "firmware".into() } else { format!("firmware-{features}") }
}

/// `cargo xtask firmware`: sets up what it needs where it may, builds, prints sizes, and proves.
///
/// # Errors
///
/// A tool is missing, an image cannot be built, or a proof fails.
pub(crate) fn make(project: &Project) -> Result<(), String> {
    if Tools::find(project).lacks_for_firmware().is_some() {
        // Whatever else is missing is told there, and does not matter here.
        let told = setup::setup(project, setup::may_install(project)).err();
        println!("{}", told.unwrap_or_default());
    }
    let tools = Tools::find(project);
    if let Some(missing) = tools.lacks_for_firmware() {
        return Err(format!("{missing} is missing. To install it: cargo xtask setup --yes"));
    }
    let tally = images(project, &tools)?;
    println!("{tally}");
    if tally.failed.is_empty() { Ok(()) } else { Err("The images are not as they have to be.".into()) }
}

/// `cargo xtask firmware run`: the image in an emulator, with a shaft and a world, until Ctrl-C.
///
/// # Errors
///
/// A tool is missing, or the board does not run.
pub(crate) fn emulate(project: &Project, options: &[String]) -> Result<(), String> {
    let tools = Tools::find(project);
    let missing = tools.lacks_for_firmware().or((!tools.qemu).then_some("qemu-system-arm"));
    if let Some(missing) = missing {
        return Err(format!("{missing} is missing. To install it: cargo xtask setup --yes"));
    }
    let image = shipped_image(project, &tools)?;
    let mut board = project.cargo(["run", "--quiet", "--release", "--package", "emulated-board", "--"]);
    board.arg("--image").arg(image).args(options);
    match board.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err("The emulated board has ended before it was told to.".into()),
        Err(error) => Err(format!("cargo cannot be started: {error}")),
    }
}

/// The images as a step of `cargo xtask test`.
pub(crate) fn step(run: &Run<'_>) -> Result<Tally, String> {
    if let Some(missing) = run.tools.lacks_for_firmware() {
        let mut tally = Tally::default();
        tally.skip("firmware", &format!("{ABSENT}{missing}"));
        return Ok(tally);
    }
    images(run.project, &run.tools)
}

fn images(project: &Project, tools: &Tools) -> Result<Tally, String> {
    let thumb = tools.thumb.as_ref().ok_or("no core library")?;
    let mut tally = Tally::default();
    for board in BOARDS {
        let image = board.read(project, thumb, "")?;
        let sizes = image.sizes();
        println!(
            "{} ({}): {:.1} KiB of flash, {:.1} KiB of RAM for good",
            board.name,
            board.part,
            f64::from(sizes.flash) / KIB,
            f64::from(sizes.ram) / KIB
        );
        proofs::prove(board, &image, &mut tally);
    }
    proofs::prove_that_panics_show(&SHIPPED.read(project, thumb, proofs::PANIC)?, &mut tally);
    Ok(tally)
}

/// Builds the image that the emulator runs; where it is.
pub(crate) fn shipped_image(project: &Project, tools: &Tools) -> Result<PathBuf, String> {
    let thumb = tools.thumb.as_ref().ok_or("no core library")?;
    run(&mut SHIPPED.build(project, thumb, ""), BUILD, Show::Nothing)?
        .expect_success(&format!("Building the image for {}", SHIPPED.name))?;
    Ok(SHIPPED.image(project, ""))
}

/// `cargo clippy` of the firmware's workspace: what a board runs for each board, and what measures it for the host.
pub(crate) fn clippy(project: &Project, thumb: &Thumb) -> Vec<Command> {
    let board = |board: &Board| {
        let mut cargo = thumb.cargo_at(project, "clippy", MANIFEST, "firmware");
        cargo.args(["--package", "firmware", "--package", "logic", "--features", board.name]);
        cargo
    };
    let mut measure = project.cargo(["clippy", "--package", "measure", "--manifest-path", MANIFEST]);
    measure.arg("--target-dir").arg(project.target.join("firmware-logic"));
    BOARDS.map(board).into_iter().chain([measure]).collect()
}

/// The tests of the firmware's logic, on the host.
pub(crate) fn logic_tests(run: &Run<'_>) -> Result<Tally, String> {
    let project = run.project;
    let mut cargo = project.cargo(["test", "--quiet", "--package", "logic", "--manifest-path", MANIFEST]);
    cargo.arg("--target-dir").arg(project.target.join("firmware-logic"));
    crate::steps::counted("firmware logic", project, cargo)
}

/// What the firmware's own counting program says of the shipped image: one `NAME NUMBER` a line.
pub(crate) fn counted(project: &Project, tools: &Tools) -> Result<String, String> {
    const COUNTING: Duration = Duration::from_mins(10);
    if let Some(missing) = tools.lacks_for_firmware().or((!tools.qemu).then_some("qemu-system-arm")) {
        return Err(format!("{ABSENT}{missing}"));
    }
    let image = shipped_image(project, tools)?;
    let mut cargo = project.cargo(["run", "--quiet", "--release", "--package", "measure"]);
    cargo.args(["--manifest-path", MANIFEST, "--target-dir"]).arg(project.target.join("firmware-measure"));
    cargo.arg("--").arg(image);
    run(&mut cargo, COUNTING, Show::Nothing)?.expect_success("Counting the instructions of the firmware")
}

/// A figure of the shipped image that stands in the image itself.
pub(crate) fn figure(project: &Project, tools: &Tools, name: &str) -> Result<f64, String> {
    if let Some(missing) = tools.lacks_for_firmware() {
        return Err(format!("{ABSENT}{missing}"));
    }
    let path = shipped_image(project, tools)?;
    let image = Image::read(project, &path)?;
    match name {
        "fw_flash_kib" => Ok(f64::from(image.sizes().flash) / KIB),
        "fw_static_ram_kib" => Ok(f64::from(image.sizes().ram) / KIB),
        "fw_worst_stack_octets" => proofs::worst_stack(&image).map(|(octets, _)| octets.into()),
        "fw_stack_text_octets" => {
            let code = image.code_from(project, &path, STACK, &[STACK, "crates/sch108bex/", "firmware/"])?;
            Ok(code.into())
        }
        _ => Err(format!("there is no figure {name}")),
    }
}

impl Tools {
    /// What images cannot be built or read without, if it is missing.
    pub(crate) fn lacks_for_firmware(&self) -> Option<&'static str> {
        match (&self.thumb, self.objdump) {
            (None, _) => Some("core library for thumbv7em-none-eabihf"),
            (_, false) => Some(OBJDUMP),
            _ => None,
        }
    }
}
