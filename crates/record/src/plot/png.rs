//! Pictures as PNG.

use tiny_skia::{FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform};
use ttf_parser::OutlineBuilder;

use super::canvas::{Anchor, Canvas, Colour, Theme};
use super::font::Font;

/// Pixels of the picture for one of the layout.
const FINE: f32 = 2.0;

/// A picture.
pub(crate) struct Png {
    pixels: Pixmap,
    font: Font,
}

#[expect(clippy::cast_possible_truncation, reason = "pixels")]
fn narrow(value: f64) -> f32 {
    value as f32
}

impl Png {
    pub(crate) fn new(width: f64, height: f64, theme: &Theme) -> Result<Self, String> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, saturates")]
        let fine = |length: f64| (length * f64::from(FINE)).ceil() as u32;
        let mut pixels = Pixmap::new(fine(width), fine(height))
            .ok_or("the picture is too large; leave out some columns or encoders")?;
        let Colour(red, green, blue) = theme.ground;
        pixels.fill(tiny_skia::Color::from_rgba8(red, green, blue, 255));
        Ok(Self { pixels, font: Font::new() })
    }

    pub(crate) fn finish(self) -> Result<Vec<u8>, String> {
        self.pixels.encode_png().map_err(|error| error.to_string())
    }

    fn letters(&mut self, text: &str, size: f64, colour: Colour, place: Transform) {
        let letters = self.font.outline(text, size, |at, scale| Letter {
            path: PathBuilder::new(),
            at: narrow(at),
            scale: narrow(scale),
        });
        let paint = paint(colour, 1.0);
        for path in letters.into_iter().filter_map(|letter| letter.path.finish()) {
            self.pixels.fill_path(&path, &paint, FillRule::Winding, place.post_scale(FINE, FINE), None);
        }
    }
}

impl Canvas for Png {
    fn area(&mut self, [left, top, width, height]: [f64; 4], colour: Colour, opacity: f64) {
        if let Some(area) = Rect::from_xywh(narrow(left), narrow(top), narrow(width), narrow(height)) {
            let fine = Transform::from_scale(FINE, FINE);
            self.pixels.fill_rect(area, &paint(colour, opacity), fine, None);
        }
    }

    fn line(&mut self, points: &[(f64, f64)], colour: Colour, width: f64, dashed: bool) {
        let Some(path) = polyline(points) else { return };
        let stroke = Stroke {
            width: narrow(width),
            line_join: LineJoin::Round,
            dash: if dashed { StrokeDash::new(vec![3.0, 3.0], 0.0) } else { None },
            ..Stroke::default()
        };
        let fine = Transform::from_scale(FINE, FINE);
        self.pixels.stroke_path(&path, &paint(colour, 1.0), &stroke, fine, None);
    }

    fn text(&mut self, (x, y): (f64, f64), size: f64, anchor: Anchor, colour: Colour, text: &str) {
        let width = self.font.width(text, size);
        let left = match anchor {
            Anchor::Start => x,
            Anchor::Middle => x - width / 2.0,
            Anchor::End => x - width,
        };
        self.letters(text, size, colour, Transform::from_translate(narrow(left), narrow(y)));
    }

    fn turned_text(&mut self, (x, y): (f64, f64), size: f64, colour: Colour, text: &str) {
        let half = narrow(self.font.width(text, size) / 2.0);
        let turned = Transform::from_row(0.0, -1.0, 1.0, 0.0, narrow(x), narrow(y));
        self.letters(text, size, colour, turned.pre_translate(-half, 0.0));
    }
}

fn paint(Colour(red, green, blue): Colour, opacity: f64) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1")]
    paint.set_color_rgba8(red, green, blue, (opacity * 255.0).round() as u8);
    paint
}

fn polyline(points: &[(f64, f64)]) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (at, (x, y)) in points.iter().enumerate() {
        if at == 0 {
            path.move_to(narrow(*x), narrow(*y));
        } else {
            path.line_to(narrow(*x), narrow(*y));
        }
    }
    path.finish()
}

/// The outline of a letter, upside down: letters go up from their line.
struct Letter {
    path: PathBuilder,
    at: f32,
    scale: f32,
}

impl Letter {
    fn x(&self, x: f32) -> f32 {
        self.at + x * self.scale
    }

    fn y(&self, y: f32) -> f32 {
        -y * self.scale
    }
}

impl OutlineBuilder for Letter {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.x(x), self.y(y));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.x(x), self.y(y));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.quad_to(self.x(x1), self.y(y1), self.x(x), self.y(y));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let (x1, y1, x2, y2) = (self.x(x1), self.y(y1), self.x(x2), self.y(y2));
        self.path.cubic_to(x1, y1, x2, y2, self.x(x), self.y(y));
    }

    fn close(&mut self) {
        self.path.close();
    }
}
