//! A picture as a list of SVG elements, and its rendering to PNG.

#[cfg(feature = "png")]
use crate::PlotError;
use crate::colour::{Colour, INK, WHITE};
use dermis::frame::{TableError, write_whole};
use dermis::text::{decimal, escaped};
#[cfg(feature = "png")]
use resvg::{tiny_skia, usvg};
use std::fmt::Write as _;
use std::path::Path;
#[cfg(feature = "png")]
use std::sync::{Arc, LazyLock};

/// A position in a picture: pixels from the left and from the top.
pub(crate) type Place = [f64; 2];

/// The font of all text. DejaVu Sans is wide, so that text also fits in the font that a browser substitutes.
const FONT_FAMILY: &str = "'DejaVu Sans', Verdana, sans-serif";
#[cfg(feature = "png")]
const FONT: &[u8] = include_bytes!("../fonts/DejaVuSans-subset.ttf");

/// Mean width of a character relative to the font size, measured on the labels of the pictures; accurate enough to
/// separate labels.
const MEAN_CHARACTER_WIDTH: f64 = 0.6;

#[cfg(feature = "png")]
static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(FONT.to_vec());
    Arc::new(fonts)
});

/// The style of a shape.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Style {
    /// Colour inside.
    pub fill: Option<Colour>,
    /// Colour and width of the outline, pixels.
    pub stroke: Option<(Colour, f64)>,
    /// Length of dashes, pixels.
    pub dash: Option<f64>,
}

impl Style {
    /// Filled, without an outline.
    pub(crate) fn fill(colour: Colour) -> Self {
        Style { fill: Some(colour), ..Style::default() }
    }

    /// Outlined only.
    pub(crate) fn line(colour: Colour, width: f64) -> Self {
        Style { stroke: Some((colour, width)), ..Style::default() }
    }

    /// With an outline.
    pub(crate) fn outlined(self, colour: Colour, width: f64) -> Self {
        Style { stroke: Some((colour, width)), ..self }
    }

    /// With a dashed outline.
    pub(crate) fn dashed(self, length: f64) -> Self {
        Style { dash: Some(length), ..self }
    }

    fn attributes(&self) -> String {
        let mut text = match self.fill {
            Some(colour) => format!(" fill=\"{}\"", hex(colour)),
            None => " fill=\"none\"".to_string(),
        };
        if let Some((colour, width)) = self.stroke {
            let _ = write!(text, " stroke=\"{}\" stroke-width=\"{}\"", hex(colour), number(width));
        }
        if let Some(length) = self.dash {
            let _ = write!(text, " stroke-dasharray=\"{}\"", number(length));
        }
        text
    }
}

/// Anchor of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// Style of a text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Text {
    /// Font size, pixels.
    pub size: f64,
    /// Colour.
    pub colour: Colour,
    /// The anchor.
    pub anchor: Anchor,
    /// Rotated by 90 degrees, to be read upwards.
    pub upwards: bool,
    /// A white outline, for text on images.
    pub rim: bool,
}

impl Text {
    /// Dark text of a given size.
    pub(crate) fn new(size: f64, anchor: Anchor) -> Self {
        Text { size, colour: INK, anchor, upwards: false, rim: false }
    }

    /// Rotated, to be read upwards.
    pub(crate) fn upwards(self) -> Self {
        Text { upwards: true, ..self }
    }

    /// With a white outline.
    pub(crate) fn rimmed(self) -> Self {
        Text { rim: true, ..self }
    }

    /// In another colour.
    pub(crate) fn coloured(self, colour: Colour) -> Self {
        Text { colour, ..self }
    }
}

/// Approximate width of a text, pixels.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    text.chars().count() as f64 * MEAN_CHARACTER_WIDTH * size
}

/// A picture under construction, pixels from the upper left corner.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Width, pixels.
    pub width: f64,
    /// Height, pixels.
    pub height: f64,
    body: String,
    /// The end of the last element, if it is a polygon.
    polygon_tail: String,
}

impl Picture {
    /// An empty picture.
    pub(crate) fn new(width: f64, height: f64) -> Self {
        Picture { width, height, body: String::new(), polygon_tail: String::new() }
    }

    /// This picture with another one at its right.
    #[must_use]
    pub fn beside(&self, other: &Picture) -> Picture {
        let mut both = Picture::new(self.width + other.width, self.height.max(other.height));
        both.place([0.0, 0.0], self);
        both.place([self.width, 0.0], other);
        both
    }

    /// Adds a closed polygon. Consecutive polygons of the same style are merged into one element: the file of a mesh
    /// would be three times as large otherwise. Overlapping polygons must have the same orientation.
    pub(crate) fn polygon(&mut self, corners: &[Place], style: Style) {
        let tail = format!("\"{}/>\n", style.attributes());
        if tail == self.polygon_tail && self.body.ends_with(&tail) {
            self.body.truncate(self.body.len() - tail.len());
            let _ = write!(self.body, "{}Z{tail}", path(corners));
        } else {
            let _ = write!(self.body, "<path d=\"{}Z{tail}", path(corners));
            self.polygon_tail = tail;
        }
    }

    /// Adds an open line through some points.
    pub(crate) fn line(&mut self, places: &[Place], style: Style) {
        let _ = writeln!(self.body, "<path d=\"{}\"{} stroke-linecap=\"round\"/>", path(places), style.attributes());
    }

    /// Adds a circle.
    pub(crate) fn circle(&mut self, centre: Place, radius: f64, style: Style) {
        let [x, y] = centre.map(number);
        let _ = writeln!(self.body, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\"{}/>", number(radius), style.attributes());
    }

    /// Adds a line of text; its position is on the baseline.
    pub(crate) fn text(&mut self, place: Place, text: &str, how: Text) {
        let [x, y] = place.map(number);
        let anchor = match how.anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let turn = if how.upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
        let rim = if how.rim {
            format!(" stroke=\"{}\" stroke-width=\"3\" stroke-linejoin=\"round\" paint-order=\"stroke\"", hex(WHITE))
        } else {
            String::new()
        };
        let _ = writeln!(
            self.body,
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" fill=\"{}\" text-anchor=\"{anchor}\"{rim}{turn}>{}</text>",
            number(how.size),
            hex(how.colour),
            escaped(text)
        );
    }

    /// Embeds another picture with its upper left corner at a position; parts outside its frame are clipped.
    pub(crate) fn place(&mut self, [x, y]: Place, inner: &Picture) {
        let (w, h) = (number(inner.width), number(inner.height));
        let _ = writeln!(
            self.body,
            "<svg x=\"{}\" y=\"{}\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\">\n{}</svg>",
            number(x),
            number(y),
            inner.body
        );
    }

    /// The picture as an SVG document; it can also be embedded in a page.
    pub fn to_svg(&self) -> String {
        let (w, h) = (number(self.width), number(self.height));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"{FONT_FAMILY}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{}</svg>\n",
            self.body
        )
    }

    /// Writes the picture as an SVG file, completely or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_svg(&self, path: &Path) -> Result<(), TableError> {
        write_whole(path, |out| out.write_all(self.to_svg().as_bytes()))
    }

    /// The picture as a PNG file with `scale` dots per pixel.
    ///
    /// # Errors
    /// A picture that is too large for the memory.
    #[cfg(feature = "png")]
    pub fn to_png(&self, scale: f64) -> Result<Vec<u8>, PlotError> {
        let options = usvg::Options { fontdb: Arc::clone(&FONTS), ..usvg::Options::default() };
        let tree =
            usvg::Tree::from_str(&self.to_svg(), &options).map_err(|error| PlotError::Render(error.to_string()))?;
        let [width, height] = [self.width, self.height].map(|length| (length * scale).ceil() as u32);
        let mut pixels = tiny_skia::Pixmap::new(width, height)
            .ok_or_else(|| PlotError::Render(format!("{width} x {height} dots cannot be held in memory")))?;
        let transform = tiny_skia::Transform::from_scale(scale as f32, scale as f32);
        resvg::render(&tree, transform, &mut pixels.as_mut());
        pixels.encode_png().map_err(|error| PlotError::Render(error.to_string()))
    }
}

fn path(places: &[Place]) -> String {
    let mut text = String::with_capacity(places.len() * 12);
    for (index, &[x, y]) in places.iter().enumerate() {
        let _ = write!(text, "{}{} {}", if index == 0 { 'M' } else { 'L' }, number(x), number(y));
    }
    text
}

/// A number rounded to a tenth of a pixel, without trailing zeros.
fn number(value: f64) -> String {
    decimal(value, 1)
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::BLACK;

    #[cfg(feature = "png")]
    #[test]
    fn a_png_has_the_right_size_and_shows_shapes_and_text() {
        let mut blank = Picture::new(60.0, 30.0);
        let empty = blank.to_png(2.0).unwrap();
        assert_eq!(&empty[1..4], b"PNG");
        assert_eq!(u32::from_be_bytes(empty[16..20].try_into().unwrap()), 120);
        assert_eq!(u32::from_be_bytes(empty[20..24].try_into().unwrap()), 60);
        let mut written = blank.clone();
        written.text([5.0, 20.0], "\u{3b8} 90\u{b0}", Text::new(13.0, Anchor::Start));
        blank.circle([30.0, 15.0], 10.0, Style::fill(BLACK));
        // Without a font for the text, the page would be empty.
        assert_ne!(written.to_png(2.0).unwrap(), empty);
        assert_ne!(blank.to_png(2.0).unwrap(), empty);
    }

    #[test]
    fn polygons_of_one_style_share_an_element_in_their_order() {
        let mut picture = Picture::new(10.0, 10.0);
        let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.25]];
        picture.polygon(&triangle, Style::fill(BLACK));
        picture.polygon(&triangle, Style::fill(BLACK));
        picture.polygon(&triangle, Style::fill(INK));
        picture.line(&triangle[..2], Style::line(INK, 1.0));
        picture.polygon(&triangle, Style::fill(INK));
        assert_eq!(picture.to_svg().matches("<path").count(), 4);
        assert_eq!(picture.to_svg().matches("M0 0L1 0L0 1.2Z").count(), 4);
    }

    #[test]
    fn names_cannot_break_out_of_the_picture() {
        let mut picture = Picture::new(10.0, 10.0);
        picture.text([0.0, 0.0], "</text><script>\"&", Text::new(10.0, Anchor::Start));
        assert!(!picture.to_svg().contains("<script>"));
    }
}
