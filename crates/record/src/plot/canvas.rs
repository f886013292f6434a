//! What can be drawn on, and in which colours.

/// Red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

/// Where a text has its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// Something to draw on, in pixels from the top left.
pub(crate) trait Canvas {
    /// A rectangle: left, top, width, height.
    fn area(&mut self, place: [f64; 4], colour: Colour, opacity: f64);
    /// A line through points.
    fn line(&mut self, points: &[(f64, f64)], colour: Colour, width: f64, dashed: bool);
    /// Words on a base line.
    fn text(&mut self, at: (f64, f64), size: f64, anchor: Anchor, colour: Colour, text: &str);
    /// Words that go upwards, with their middle here.
    fn turned_text(&mut self, at: (f64, f64), size: f64, colour: Colour, text: &str);
}

/// Colours that go together.
#[derive(Debug)]
pub struct Theme {
    pub(crate) ground: Colour,
    pub(crate) panel: Colour,
    pub(crate) grid: Colour,
    pub(crate) ink: Colour,
    pub(crate) faint: Colour,
    pub(crate) alarm: Colour,
    pub(crate) warning: Colour,
    pub(crate) off: Colour,
    pub(crate) curves: [Colour; 6],
}

impl Theme {
    /// For paper.
    pub const LIGHT: Self = Self {
        ground: Colour(255, 255, 255),
        panel: Colour(248, 249, 251),
        grid: Colour(222, 226, 232),
        ink: Colour(33, 39, 48),
        faint: Colour(105, 115, 130),
        alarm: Colour(200, 40, 45),
        warning: Colour(226, 140, 0),
        off: Colour(120, 128, 140),
        curves: [
            Colour(0, 98, 178),
            Colour(205, 88, 8),
            Colour(0, 130, 105),
            Colour(160, 60, 140),
            Colour(120, 100, 20),
            Colour(70, 80, 200),
        ],
    };
    /// For screens.
    pub const DARK: Self = Self {
        ground: Colour(22, 26, 32),
        panel: Colour(29, 34, 42),
        grid: Colour(52, 60, 72),
        ink: Colour(230, 234, 240),
        faint: Colour(150, 160, 175),
        alarm: Colour(245, 95, 95),
        warning: Colour(245, 175, 60),
        off: Colour(140, 150, 165),
        curves: [
            Colour(90, 175, 255),
            Colour(255, 160, 90),
            Colour(75, 215, 175),
            Colour(235, 140, 215),
            Colour(225, 205, 100),
            Colour(160, 165, 255),
        ],
    };
}
