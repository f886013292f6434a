//! The letters of pictures: a part of Noto Sans (SIL Open Font License 1.1, see font/OFL.txt), so that a PNG
//! needs no font of the system.

use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// U+0020 to U+007E, and a few signs.
static FILE: &[u8] = include_bytes!("../../font/NotoSans-subset.ttf");

/// Letters that can be measured and drawn.
pub(crate) struct Font {
    /// Always there: a test sees to it.
    face: Option<Face<'static>>,
}

impl Font {
    pub(crate) fn new() -> Self {
        Self { face: Face::parse(FILE, 0).ok() }
    }

    /// How wide a text is at this size.
    pub(crate) fn width(&self, text: &str, size: f64) -> f64 {
        self.glyphs(text, size).map(|(_, width)| width).sum()
    }

    /// Gives the outline of each letter to a builder, from its place on the line on.
    pub(crate) fn outline<B: OutlineBuilder>(
        &self,
        text: &str,
        size: f64,
        mut builder: impl FnMut(f64, f64) -> B,
    ) -> Vec<B> {
        let mut at = 0.0;
        let mut built = Vec::new();
        for (glyph, width) in self.glyphs(text, size) {
            let mut letter = builder(at, size / self.units());
            if let Some(face) = &self.face
                && face.outline_glyph(glyph, &mut letter).is_some()
            {
                built.push(letter);
            }
            at += width;
        }
        built
    }

    fn units(&self) -> f64 {
        self.face.as_ref().map_or(1_000.0, |face| f64::from(face.units_per_em()))
    }

    /// Letters that are not in the file are shown as its sign for that.
    fn glyphs(&self, text: &str, size: f64) -> impl Iterator<Item = (GlyphId, f64)> {
        let scale = size / self.units();
        text.chars().map(move |letter| {
            let glyph = self.face.as_ref().and_then(|face| face.glyph_index(letter)).unwrap_or(GlyphId(0));
            let advance = self.face.as_ref().and_then(|face| face.glyph_hor_advance(glyph)).unwrap_or(600);
            (glyph, f64::from(advance) * scale)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_that_we_write_is_there_and_has_a_width() {
        let font = Font::new();
        let face = font.face.as_ref().expect("a font");
        for letter in (' '..='~').chain("°µ·±–−…".chars()) {
            assert!(face.glyph_index(letter).is_some(), "{letter:?}");
        }
        // As the file has it: 572 of 1000 for each digit.
        assert!((font.width("00", 100.0) - 114.4).abs() < 1e-9, "{}", font.width("00", 100.0));
    }
}
