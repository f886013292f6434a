//! Pictures as SVG: text stays text.

use std::fmt::Write;

use super::canvas::{Anchor, Canvas, Colour, Theme};

/// A picture that grows.
pub(crate) struct Svg {
    parts: String,
    ground: Colour,
}

impl Svg {
    pub(crate) fn new(theme: &Theme) -> Self {
        Self { parts: String::new(), ground: theme.ground }
    }

    pub(crate) fn finish(self, width: f64, height: f64, title: &str) -> String {
        let (ground, title) = (hex(self.ground), escaped(title));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"'Noto Sans', 'DejaVu Sans', Arial, sans-serif\" role=\"img\">\n<title>{title}</title>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"{ground}\"/>\n{}</svg>\n",
            self.parts
        )
    }

    fn put(&mut self, part: std::fmt::Arguments<'_>) {
        // A string takes everything.
        let _ = self.parts.write_fmt(part);
        self.parts.push('\n');
    }
}

impl Canvas for Svg {
    fn area(&mut self, [left, top, width, height]: [f64; 4], colour: Colour, opacity: f64) {
        let fill = hex(colour);
        self.put(format_args!(
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{fill}\" \
             fill-opacity=\"{opacity}\"/>"
        ));
    }

    fn line(&mut self, points: &[(f64, f64)], colour: Colour, width: f64, dashed: bool) {
        let mut path = String::new();
        for (at, (x, y)) in points.iter().enumerate() {
            let _ = write!(path, "{}{x:.1} {y:.1}", if at == 0 { "M" } else { "L" });
        }
        let gaps = if dashed { " stroke-dasharray=\"3 3\"" } else { "" };
        self.put(format_args!(
            "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"{gaps}/>",
            hex(colour)
        ));
    }

    fn text(&mut self, (x, y): (f64, f64), size: f64, anchor: Anchor, colour: Colour, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.put(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{}\">{}</text>",
            hex(colour),
            escaped(text)
        ));
    }

    fn turned_text(&mut self, (x, y): (f64, f64), size: f64, colour: Colour, text: &str) {
        self.put(format_args!(
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" font-size=\"{size}\" text-anchor=\"middle\" \
             fill=\"{}\">{}</text>",
            hex(colour),
            escaped(text)
        ));
    }
}

fn hex(Colour(red, green, blue): Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// A text as XML takes it.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            control if control.is_control() => out.push(' '),
            '\u{FFFE}' | '\u{FFFF}' => out.push('\u{FFFD}'),
            other => out.push(other),
        }
    }
    out
}
