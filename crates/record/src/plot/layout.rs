//! Where everything is in a picture.

use super::Look;
use super::axis::{Axis, time_unit};
use super::canvas::{Anchor, Canvas, Colour, Theme};
use super::font::Font;
use super::line::lines;
use crate::row::Column;
use crate::table::{Grade, Mark, Table};

const LEFT: f64 = 92.0;
const RIGHT: f64 = 24.0;
const PANEL: f64 = 190.0;
const GAP: f64 = 14.0;
const STRIP: f64 = 18.0;
const ROW: f64 = 15.0;
/// Rows of words below; what finds no place there has a line only.
const MOST_ROWS: usize = 8;
const SMALL: f64 = 11.0;
const NORMAL: f64 = 12.5;
const LARGE: f64 = 17.0;
const LONGEST_WORDS: usize = 52;

/// What all parts of a picture share.
struct Drawing<'a> {
    table: &'a Table,
    look: &'a Look<'a>,
    theme: &'a Theme,
    font: Font,
    /// In nanoseconds.
    time: Axis,
}

/// Draws a recording; how wide and high it is.
pub(super) fn draw(canvas: &mut dyn Canvas, table: &Table, look: &Look<'_>, theme: &Theme) -> (f64, f64) {
    let (first, last) = span(table);
    let width = f64::from(look.width);
    let parts = ((width - LEFT - RIGHT) / 90.0).max(2.0);
    let drawing = Drawing { table, look, theme, font: Font::new(), time: Axis::exact(first, last, parts) };
    canvas.text((LEFT, 28.0), LARGE, Anchor::Start, theme.ink, look.title);
    let mut top = drawing.legend(canvas, 48.0);
    let first_panel = top;
    for (number, column) in look.columns.iter().enumerate() {
        drawing.panel(canvas, top, number, column);
        top += PANEL + GAP;
    }
    top = drawing.strips(canvas, first_panel, top);
    top = drawing.time_axis(canvas, top);
    top = drawing.marks(canvas, first_panel, top);
    (width, top + 12.0)
}

/// The first and the last moment, in nanoseconds.
#[expect(clippy::cast_precision_loss, reason = "to be drawn only")]
fn span(table: &Table) -> (f64, f64) {
    let times =
        table.curves.iter().flat_map(|curve| curve.times.first().into_iter().chain(curve.times.last()));
    let (first, last) = times.fold((u64::MAX, 0), |(first, last), at| (first.min(*at), last.max(*at)));
    if first > last { (0.0, 1e9) } else { (first as f64, last as f64) }
}

impl Drawing<'_> {
    #[expect(clippy::cast_precision_loss, reason = "to be drawn only")]
    fn x(&self, nanos: u64) -> f64 {
        let share = self.time.share(nanos as f64).clamp(0.0, 1.0);
        LEFT + share * self.inner()
    }

    /// How wide the panels are.
    fn inner(&self) -> f64 {
        f64::from(self.look.width) - LEFT - RIGHT
    }

    fn colour(&self, curve: usize) -> Colour {
        self.theme.curves[curve % self.theme.curves.len()]
    }

    /// Those with samples, and their numbers.
    fn curves(&self) -> impl Iterator<Item = (usize, &crate::Curve)> {
        self.table.curves.iter().filter(|curve| !curve.times.is_empty()).enumerate()
    }

    /// Who has which colour.
    fn legend(&self, canvas: &mut dyn Canvas, top: f64) -> f64 {
        let (mut left, mut top) = (LEFT, top);
        for (number, curve) in self.curves() {
            let width = self.font.width(&curve.encoder, NORMAL) + 46.0;
            if left + width > LEFT + self.inner() && left > LEFT {
                (left, top) = (LEFT, top + 18.0);
            }
            canvas.line(&[(left, top - 4.0), (left + 20.0, top - 4.0)], self.colour(number), 2.5, false);
            canvas.text((left + 26.0, top), NORMAL, Anchor::Start, self.theme.ink, &curve.encoder);
            left += width;
        }
        top + 14.0
    }

    /// One column of all encoders.
    fn panel(&self, canvas: &mut dyn Canvas, top: f64, number: usize, column: &Column) {
        let Self { theme, .. } = self;
        let width = self.inner();
        canvas.area([LEFT, top, width, PANEL], theme.panel, 1.0);
        self.shade(canvas, top);
        let values = || self.curves().flat_map(|(_, curve)| curve.values[number].iter().copied());
        let values = || values().filter(|value| value.is_finite());
        let (least, most) =
            values().fold((f64::MAX, f64::MIN), |(least, most), value| (least.min(value), most.max(value)));
        for tick in self.time.ticks() {
            let x = LEFT + self.time.share(tick) * width;
            canvas.line(&[(x, top), (x, top + PANEL)], theme.grid, 1.0, false);
        }
        if least > most {
            let middle = (LEFT + width / 2.0, top + PANEL / 2.0);
            canvas.text(middle, NORMAL, Anchor::Middle, theme.faint, "nothing was recorded here");
            self.name(canvas, top, column);
            return;
        }
        let axis = Axis::whole(least, most, 5.0);
        let y = |value: f64| top + PANEL - 6.0 - axis.share(value) * (PANEL - 12.0);
        for tick in axis.ticks() {
            canvas.line(&[(LEFT, y(tick)), (LEFT + width, y(tick))], theme.grid, 1.0, false);
            let at = (LEFT - 8.0, y(tick) + 4.0);
            canvas.text(at, SMALL, Anchor::End, theme.faint, &axis.label(tick));
        }
        // A position that begins anew at the end of its range is no movement.
        let jump = if column.name == "position" { (most - least) / 2.0 } else { f64::INFINITY };
        for (at, curve) in self.curves() {
            for line in lines(&curve.times, &curve.values[number], jump, |time| self.x(time), y) {
                // A single sample is a point.
                let line = if let [(x, y)] = *line { vec![(x - 1.0, y), (x + 1.0, y)] } else { line };
                canvas.line(&line, self.colour(at), 1.6, false);
            }
        }
        self.name(canvas, top, column);
    }

    /// What a panel shows, beside its axis.
    fn name(&self, canvas: &mut dyn Canvas, top: f64, column: &Column) {
        let machine = self.curves().find_map(|(_, curve)| curve.unit.as_deref());
        let unit = if column.name == "machine_position" { machine.unwrap_or_default() } else { column.unit };
        let mut name = column.name.trim_end_matches("_c").trim_end_matches("_v").replace('_', " ");
        if column.name == "rpm" {
            "speed of the shaft".clone_into(&mut name);
        }
        let words = if unit.is_empty() { name } else { format!("{name} ({unit})") };
        // Long names are smaller, not cut off.
        let size = (NORMAL * (PANEL - 8.0) / self.font.width(&words, NORMAL)).min(NORMAL);
        canvas.turned_text((20.0, top + PANEL / 2.0), size, self.theme.ink, &words);
    }

    /// What was wrong, behind a panel; of several encoders the strips tell who it was.
    fn shade(&self, canvas: &mut dyn Canvas, top: f64) {
        for band in self.curves().flat_map(|(_, curve)| &curve.bands) {
            let (left, right) = (self.x(band.from), self.x(band.to));
            let width = (right - left).max(1.0);
            canvas.area([left, top, width, PANEL], self.grade(band.grade), 0.13);
        }
    }

    fn grade(&self, grade: Grade) -> Colour {
        match grade {
            Grade::Alarm => self.theme.alarm,
            Grade::Warning => self.theme.warning,
            Grade::Off => self.theme.off,
        }
    }

    /// What was wrong in words, one strip for each kind and encoder that has any; where the next thing begins.
    fn strips(&self, canvas: &mut dyn Canvas, _: f64, top: f64) -> f64 {
        let mut top = top - GAP + 6.0;
        let several = self.curves().nth(1).is_some();
        for (number, curve) in self.curves() {
            for (grade, name) in
                [(Grade::Alarm, "alarms"), (Grade::Warning, "warnings"), (Grade::Off, "power")]
            {
                let bands: Vec<_> = curve.bands.iter().filter(|band| band.grade == grade).collect();
                if bands.is_empty() {
                    continue;
                }
                canvas.area([LEFT, top, self.inner(), STRIP], self.theme.panel, 1.0);
                if several {
                    canvas.area([LEFT - 5.0, top, 3.0, STRIP], self.colour(number), 1.0);
                }
                canvas.text((LEFT - 10.0, top + 13.0), SMALL, Anchor::End, self.theme.faint, name);
                for band in bands {
                    let (left, right) = (self.x(band.from), self.x(band.to));
                    let width = (right - left).max(1.0);
                    canvas.area([left, top, width, STRIP], self.grade(grade), 0.35);
                    let words = band.words.replace('_', " ");
                    if self.font.width(&words, SMALL) + 8.0 <= width {
                        canvas.text((left + 4.0, top + 13.0), SMALL, Anchor::Start, self.theme.ink, &words);
                    }
                }
                top += STRIP + 3.0;
            }
        }
        top
    }

    /// The common axis; where the next thing begins.
    fn time_axis(&self, canvas: &mut dyn Canvas, top: f64) -> f64 {
        let (unit, seconds) = time_unit((self.time.most - self.time.least) / 1e9);
        let scale = seconds * 1e9;
        let parts = (self.inner() / 90.0).max(2.0);
        let axis = Axis::exact(self.time.least / scale, self.time.most / scale, parts);
        for tick in axis.ticks() {
            let x = LEFT + axis.share(tick) * self.inner();
            canvas.line(&[(x, top), (x, top + 5.0)], self.theme.faint, 1.0, false);
            canvas.text((x, top + 18.0), SMALL, Anchor::Middle, self.theme.faint, &axis.label(tick));
        }
        let words = format!("time ({unit})");
        canvas.text((LEFT - 10.0, top + 18.0), SMALL, Anchor::End, self.theme.faint, &words);
        top + 26.0
    }

    /// What happened: lines through the panels, and the words below where there is room; where the next thing
    /// begins.
    fn marks(&self, canvas: &mut dyn Canvas, panels: f64, top: f64) -> f64 {
        let several = self.curves().nth(1).is_some();
        let mut all: Vec<(&Mark, String)> = Vec::new();
        for curve in &self.table.curves {
            let who = if several { format!("{}: ", curve.encoder) } else { String::new() };
            all.extend(curve.marks.iter().map(|mark| (mark, format!("{who}{}", words(mark)))));
        }
        all.sort_by_key(|(mark, _)| mark.at);
        let mut rows = [f64::MIN; MOST_ROWS];
        let (mut used, mut unsaid) = (0, 0);
        for (mark, words) in &all {
            let (x, width) = (self.x(mark.at), self.font.width(words, SMALL));
            canvas.line(&[(x, panels), (x, top - 26.0)], self.theme.faint, 0.8, true);
            // To the left of its line where there is no room to the right.
            let left =
                if x + width + 4.0 > LEFT + self.inner() { (x - width - 4.0).max(0.0) } else { x + 4.0 };
            let Some(row) = rows.iter().position(|end| *end + 6.0 < left.min(x)) else {
                unsaid += 1;
                continue;
            };
            rows[row] = (left + width).max(x);
            used = used.max(row + 1);
            let below = top + ROW * as_f64(row);
            canvas.line(&[(x, top - 2.0), (x, below + 11.0)], self.theme.faint, 0.8, false);
            canvas.text((left, below + 10.0), SMALL, Anchor::Start, self.theme.ink, words);
        }
        let mut end = top + ROW * as_f64(used);
        if unsaid > 0 {
            let words = format!("{unsaid} more events have a line only: choose a shorter time");
            canvas.text((LEFT, end + 10.0), SMALL, Anchor::Start, self.theme.faint, &words);
            end += ROW;
        }
        end
    }
}

/// The sentence of an event, or its one word where that is too long.
fn words(mark: &Mark) -> String {
    let text = &mark.text;
    if text.is_empty() || text.chars().count() > LONGEST_WORDS {
        mark.kind.replace('_', " ")
    } else {
        text.clone()
    }
}

fn as_f64(count: usize) -> f64 {
    u32::try_from(count).map_or(f64::MAX, f64::from)
}
