//! Draws recordings: panels that share a time axis, what was wrong as bands, what happened as marks with words.

mod axis;
mod canvas;
mod font;
mod layout;
mod line;
mod png;
mod svg;

use crate::row::Column;
use crate::table::Table;

pub use canvas::{Colour, Theme};

use canvas::Canvas;
use png::Png;
use svg::Svg;

/// How to draw.
#[derive(Debug, Clone)]
pub struct Look<'a> {
    /// Stands above.
    pub title: &'a str,
    /// One panel each, as they were wanted of the table.
    pub columns: &'a [&'static Column],
    /// On a dark ground.
    pub dark: bool,
    /// In pixels; a PNG has twice as many.
    pub width: u32,
}

/// The narrowest and the widest picture, in pixels.
pub const WIDTHS: std::ops::RangeInclusive<u32> = 400..=4_000;

/// A recording as SVG.
pub fn svg(table: &Table, look: &Look<'_>) -> String {
    let theme = if look.dark { Theme::DARK } else { Theme::LIGHT };
    let mut canvas = Svg::new(&theme);
    let (width, height) = layout::draw(&mut canvas, table, look, &theme);
    canvas.finish(width, height, look.title)
}

/// A recording as PNG, twice as fine as its width says.
///
/// # Errors
///
/// A picture that is too large.
pub fn png(table: &Table, look: &Look<'_>) -> Result<Vec<u8>, String> {
    let theme = if look.dark { Theme::DARK } else { Theme::LIGHT };
    let mut nothing = Nothing;
    let (width, height) = layout::draw(&mut nothing, table, look, &theme);
    let mut canvas = Png::new(width, height, &theme)?;
    layout::draw(&mut canvas, table, look, &theme);
    canvas.finish()
}

/// To learn how large a picture is.
struct Nothing;

impl Canvas for Nothing {
    fn area(&mut self, _: [f64; 4], _: Colour, _: f64) {}
    fn line(&mut self, _: &[(f64, f64)], _: Colour, _: f64, _: bool) {}
    fn text(&mut self, _: (f64, f64), _: f64, _: canvas::Anchor, _: Colour, _: &str) {}
    fn turned_text(&mut self, _: (f64, f64), _: f64, _: Colour, _: &str) {}
}
