//! `run --record`, `scenario run --record` and `plot`, as their users see them.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::tempdir;

use crate::driver::{Ended, Program, end_of, program, run};
use crate::master::{CLASS_2, status, status_answer};

const PATIENCE: Duration = Duration::from_secs(20);

fn plot(file: &Path, options: &[&str]) -> Ended {
    end_of(program().arg("plot").arg(file).args(options))
}

/// Lines of a CSV file that hold all of these parts, once there are some.
#[track_caller]
fn lines_with(path: &Path, parts: &[&str]) -> Vec<String> {
    let until = Instant::now() + PATIENCE;
    loop {
        let text = fs::read_to_string(path).unwrap_or_default();
        let fits = |line: &&str| parts.iter().all(|part| line.contains(part));
        let found: Vec<_> = text.lines().filter(fits).map(str::to_owned).collect();
        if !found.is_empty() {
            return found;
        }
        assert!(Instant::now() < until, "no line has {parts:?}:\n{text}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_run_is_recorded_with_its_events_and_drawn() {
    let folder = tempdir().expect("a folder");
    let path = folder.path().join("run.csv");
    let mut program = run([
        "--switches",
        "05",
        "--shaft",
        "still@1234",
        "--record",
        path.to_str().unwrap(),
        "--record-every",
        "1",
    ]);
    let mut master = program.master(5);
    master.start_up(CLASS_2, &[0xF1]);
    // Scaling is off in these parameters: steps are counts.
    lines_with(&path, &["encoder,,,1234,0,0,1234,1234,0,,,data_exchange,class_2,,,24,20"]);
    lines_with(&path, &["encoder,data_exchange_entered,data exchange with master 2 begins,"]);
    lines_with(&path, &["bus,master_came,"]);
    let drawn = plot(&path, &[]);
    assert_eq!(drawn.status, Some(0), "{drawn:?}");
    let picture = fs::read_to_string(folder.path().join("run.svg")).expect("beside the recording");
    for words in [
        "<title>run.csv</title>",
        ">encoder</text>",
        "data exchange with master 2 begins",
        "position (steps)",
    ] {
        assert!(picture.contains(words), "{words}");
    }
    drop(master);
    program.end();
    let png = folder.path().join("it.png");
    let drawn =
        plot(&path, &["--output", png.to_str().unwrap(), "--columns", "rpm", "--dark", "--width", "500"]);
    assert_eq!(drawn.status, Some(0), "{drawn:?}");
    assert!(drawn.output.ends_with(" samples of 1 encoder"), "{}", drawn.output);
    let octets = fs::read(&png).expect("a picture");
    // The signature, and in IHDR twice the width.
    assert_eq!(&octets[..8], b"\x89PNG\r\n\x1a\n");
    assert_eq!(octets[16..20], 1_000_u32.to_be_bytes());
}

#[test]
fn a_killed_run_leaves_a_recording_that_can_be_drawn() {
    for ending in ["csv", "parquet"] {
        let folder = tempdir().expect("a folder");
        let path = folder.path().join(format!("run.{ending}"));
        let mut program =
            run(["--switches", "05", "--record", path.to_str().unwrap(), "--record-every", "1"]);
        let until = Instant::now() + PATIENCE;
        while plot(&path, &[]).status != Some(0) {
            assert!(Instant::now() < until, "{ending}: {:?}", plot(&path, &[]));
        }
        program.kill();
        let drawn = plot(&path, &[]);
        assert_eq!(drawn.status, Some(0), "{ending}: {drawn:?}");
    }
}

#[test]
fn a_full_disk_is_told_and_ends_the_recording_but_not_the_bus() {
    let folder = tempdir().expect("a folder");
    let path = folder.path().join("run.csv");
    let mut shell = Command::new("sh");
    // 16 blocks of 512 octets; what is beyond is refused in place of ending the program.
    shell.args(["-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_sch108bex")]);
    shell.args(["run", "--switches", "05", "--record-every", "1", "--record"]).arg(&path);
    let mut program =
        Program::start(shell.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()));
    program.wait_for(&["ready"]);
    let until = Instant::now() + PATIENCE;
    while fs::metadata(&path).map_or(0, |metadata| metadata.len()) < 8_192 {
        assert!(Instant::now() < until, "it has {:?}", fs::metadata(&path));
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(200));
    let terminal = program.terminal();
    assert_eq!(terminal.ask(&status(5)), status_answer(5));
    drop(terminal);
    assert_eq!(program.end_with(Signal::INT).code(), Some(1));
    let errors = program.take_errors();
    assert!(errors.contains("warning: the recording ") && errors.contains(" ends here: "), "{errors}");
    assert!(errors.contains("error: the recording ") && errors.contains("is not whole"), "{errors}");
}

#[test]
fn what_cannot_be_drawn_is_told_in_one_sentence() {
    let folder = tempdir().expect("a folder");
    let file = |name: &str, octets: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, octets).expect("a file");
        path
    };
    let other = file("other.csv", b"a,b\n1,2\n");
    let names = "time_ns,encoder,event,text,position,velocity,acceleration,physical_position,shaft_position,rpm,\
                 machine_position,machine_unit,state,functionality,alarms,warnings,supply_v,temperature_c\n";
    let empty = file("empty.csv", names.as_bytes());
    let broken = file("broken.csv", format!("{names}0,it,,,much,0,0,0,0,0,,,off,,,,24,20\n").as_bytes());
    let cut = file("cut.parquet", b"PAR1 and no more");
    let missing = folder.path().join("nothing.csv");
    let told = |path: &Path, options: &[&str], status, words: &str| {
        let ended = plot(path, options);
        assert_eq!(ended.status, Some(status), "{ended:?}");
        assert!(ended.errors.contains(words), "{words}: {}", ended.errors);
        assert_eq!(ended.errors.trim_end().lines().count(), 1, "{}", ended.errors);
    };
    told(
        &other,
        &[],
        2,
        "other.csv is no recording: it has no column time_ns; name a file that --record has written",
    );
    told(&broken, &[], 2, "line 2: \"much\" is no position");
    told(&cut, &[], 2, "cut.parquet is no recording: it is no whole Parquet file");
    told(&missing, &[], 2, "nothing.csv cannot be read");
    told(Path::new("/dev/zero"), &[], 2, "it is no regular file of at most 4 GiB");
    told(&empty, &[], 1, "empty.csv has no samples in this time");
    told(&empty, &["--encoder", "hoist"], 2, "has no encoder \"hoist\"; it has none");
    told(&empty, &["--output", "it.jpg"], 2, "--output it.jpg: end the name with .svg or .png");
    let unknown = plot(&empty, &["--columns", "position,speed"]);
    assert_eq!(unknown.status, Some(2));
    assert!(unknown.errors.contains("there are position, velocity, acceleration"), "{}", unknown.errors);
    let refused = end_of(program().args(["run", "--record", "it.txt"]));
    assert_eq!(refused.status, Some(2), "{refused:?}");
    assert!(refused.errors.contains("--record: it.txt does not say what to write"), "{}", refused.errors);
    let quick = end_of(program().args(["run", "--record", "it.csv", "--record-every", "0.4"]));
    assert_eq!(quick.status, Some(2), "{quick:?}");
}

#[test]
fn a_scenario_gives_the_same_recording_at_any_speed() {
    let folder = tempdir().expect("a folder");
    let hoist = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenarios/hoist.toml");
    for ending in ["csv", "parquet"] {
        let files = [["--virtual", ""], ["--speed", "40"]].map(|speed| {
            let path = folder.path().join(format!("{}.{ending}", speed[0]));
            let mut command = program();
            command.args(["scenario", "run", "--json"]).arg(&hoist);
            command.args(speed.iter().filter(|word| !word.is_empty())).arg("--record").arg(&path);
            let ended = end_of(&mut command);
            assert_eq!(ended.status, Some(0), "{ended:?}");
            fs::read(&path).expect("a recording")
        });
        assert!(files[0] == files[1], "{ending}");
    }
}
