//! `cargo xtask drawings`: how the parts of a board are wired, as a picture for the pages.

use std::fmt::Write as _;
use std::fs;

use crate::project::Project;

/// Where the picture goes.
const WIRING: &str = "docs/firmware-wiring.svg";

/// In pixels: a row, the columns, what is between boxes.
const ROW: u32 = 22;
const GAP: u32 = 34;
const WIDTH: u32 = 1180;
const LEFT: Column = Column { x: 20, width: 230 };
const MIDDLE: Column = Column { x: 420, width: 180 };
const RIGHT: Column = Column { x: 740, width: 170 };
const FAR: Column = Column { x: 1000, width: 160 };
const TOP: u32 = 70;

/// Where boxes stand below each other.
#[derive(Debug, Clone, Copy)]
struct Column {
    x: u32,
    width: u32,
}

/// A part, and its wires to the controller: the controller's pin, the part's pin.
struct Part {
    name: &'static str,
    wires: &'static [(&'static str, &'static str)],
}

const SENSORS: [Part; 4] = [
    Part {
        name: "AS5047P, magnet on the shaft",
        wires: &[
            ("PA4", "CSn"),
            ("PA5", "CLK"),
            ("PA6", "MISO"),
            ("PA7", "MOSI"),
            ("3V3", "VDD, VDD3V3"),
            ("GND", "GND, TEST"),
        ],
    },
    Part {
        name: "FRAM or EEPROM at 50h",
        wires: &[
            ("PB8", "SCL, 4.7 k\u{3a9} to 3V3"),
            ("PB9", "SDA, 4.7 k\u{3a9} to 3V3"),
            ("3V3", "VCC"),
            ("GND", "GND, A0-A2, WP"),
        ],
    },
    Part {
        name: "Supply, 9 to 30 V",
        wires: &[
            ("PC0", "by 100 k\u{3a9}; 10 k\u{3a9} to GND"),
            ("5V", "by a DC/DC converter"),
            ("GND", "0 V"),
        ],
    },
    Part { name: "Battery, 3 V lithium", wires: &[("VBAT", "+"), ("GND", "-")] },
];

const OUTSIDE: [Part; 4] = [
    Part {
        name: "RS-485 transceiver",
        wires: &[("PB6", "D"), ("PB7", "R"), ("PB5", "DE"), ("GND", "/RE"), ("3V3", "VCC1"), ("GND", "GND1")],
    },
    Part {
        name: "Rotary switches",
        wires: &[("PC2-PC5", "X1: 1 2 4 8, to GND"), ("PC6-PC9", "X16: 1 2 4 8, to GND")],
    },
    Part { name: "Termination, sensed", wires: &[("PB12", "1, to GND"), ("PB13", "2, to GND")] },
    Part { name: "Lamp", wires: &[("PC12", "LED, 680 \u{3a9} to 3V3")] },
];

/// From the transceiver to the plug, on rows of the transceiver.
const PLUG: [(&str, &str); 4] =
    [("B", "3 RxD/TxD-P"), ("A", "8 RxD/TxD-N"), ("VCC2", "6 VP, 5 V"), ("GND2", "5 DGND")];

/// Makes all drawings.
///
/// # Errors
///
/// A file cannot be written.
pub(crate) fn draw(project: &Project) -> Result<(), String> {
    let path = project.root.join(WIRING);
    fs::write(&path, wiring()).map_err(|error| format!("{} cannot be written: {error}.", path.display()))?;
    println!("{WIRING}");
    Ok(())
}

/// The parts around the STM32F405.
fn wiring() -> String {
    let mut body = String::new();
    let left = parts(&mut body, &SENSORS, LEFT, Side::Left);
    let right = parts(&mut body, &OUTSIDE, RIGHT, Side::Right);
    let bottom = left.max(right);
    plug(&mut body);
    part_box(&mut body, MIDDLE, TOP - 30, bottom - TOP + 30, "STM32F405");
    let height = bottom + 112;
    let notes = [
        "Bus: 390 \u{3a9} from VP to B, 220 \u{3a9} from B to A, 390 \u{3a9} from A to DGND, each by a contact of the termination switches.",
        "GND2, VP and the shield are the bus side's: with an isolating transceiver they have no connection to GND.",
        "Contacts to GND need no resistors: the pins pull up. PB14 stays open: at GND the board waits for the world link instead.",
        "Every part has 100 nF at its supply.",
    ];
    for (at, note) in (0..).zip(notes) {
        text(&mut body, LEFT.x, bottom + 30 + at * 20, "start", note);
    }
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"13\">\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n{body}</svg>\n"
    )
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// Boxes below each other with their wires; where they end.
fn parts(body: &mut String, parts: &[Part], column: Column, side: Side) -> u32 {
    let mut y = TOP;
    for part in parts {
        let rows = u32::try_from(part.wires.len()).unwrap_or_default();
        part_box(body, column, y - 24, rows * ROW + 30, part.name);
        for (at, (pin, end)) in (0..).zip(part.wires) {
            wire(body, column, side, y + at * ROW + 12, pin, end);
        }
        y += rows * ROW + GAP + 18;
    }
    y
}

fn part_box(body: &mut String, column: Column, y: u32, height: u32, name: &str) {
    let Column { x, width } = column;
    let _ = writeln!(
        body,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"4\" fill=\"none\" stroke=\"#1f2d3d\"/>"
    );
    let _ = writeln!(
        body,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\">{name}</text>",
        x + width / 2,
        y + 16
    );
}

/// A wire between the controller and a part, with the names of both ends inside the boxes.
fn wire(body: &mut String, column: Column, side: Side, y: u32, pin: &str, end: &str) {
    let (from, to) = match side {
        Side::Left => (column.x + column.width, MIDDLE.x),
        Side::Right => (MIDDLE.x + MIDDLE.width, column.x),
    };
    line(body, from, to, y);
    let base = y + 4;
    match side {
        Side::Left => {
            text(body, from - 6, base, "end", end);
            text(body, to + 6, base, "start", pin);
        }
        Side::Right => {
            text(body, from - 6, base, "end", pin);
            text(body, to + 6, base, "start", end);
        }
    }
}

/// The bus: from the transceiver, the first box on the right, to the plug.
fn plug(body: &mut String) {
    let rows = u32::try_from(PLUG.len()).unwrap_or_default();
    part_box(body, FAR, TOP - 24, rows * ROW + 30, "Plug, D-sub 9");
    for (at, (pin, end)) in (0..).zip(PLUG) {
        let y = TOP + at * ROW + 12;
        let (from, to) = (RIGHT.x + RIGHT.width, FAR.x);
        line(body, from, to, y);
        text(body, from - 6, y + 4, "end", pin);
        text(body, to + 6, y + 4, "start", end);
    }
}

fn line(body: &mut String, from: u32, to: u32, y: u32) {
    let _ = writeln!(body, "<path d=\"M{from} {y}H{to}\" stroke=\"#0b6e4f\" stroke-width=\"1.5\"/>");
}

fn text(body: &mut String, x: u32, y: u32, anchor: &str, text: &str) {
    let _ = writeln!(body, "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\">{text}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drawing_in_the_pages_is_the_one_that_is_made() {
        let kept = fs::read_to_string(format!("{}/../{WIRING}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        assert!(kept == wiring(), "make it anew: cargo xtask drawings");
    }

    /// The board's own table of pins, at the head of its file, has every pin of the drawing.
    #[test]
    fn the_drawing_has_the_pins_of_the_board() {
        let board = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/src/boards/olimex_h405.rs");
        let table = fs::read_to_string(board).unwrap();
        let table: String = table.lines().take_while(|line| line.starts_with("//!")).collect();
        for part in SENSORS.iter().chain(&OUTSIDE) {
            for (pin, _) in part.wires {
                let supply = ["3V3", "5V", "GND"].contains(pin);
                let ends: Vec<&str> = pin.split('-').collect();
                let known = match ends.as_slice() {
                    ["PC2", "PC5"] | ["PC6", "PC9"] => table.contains("PC2 to PC9"),
                    _ => table.contains(pin),
                };
                assert!(supply || known, "{pin} of {}", part.name);
            }
        }
    }
}
