//! What there is to see, in space; the views unroll it or look at it from outside.

use crate::colour::{Colour, Scale};
use crate::svg::text_width;
use dermis::geom::Point3;
use dermis::geom::vector::{cross, normalize, sub};

/// A flat piece of the skin. Corners run counter-clockwise as seen from outside.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Corners, m.
    pub corners: Vec<Point3>,
    /// Its colour.
    pub fill: Colour,
    /// Colour of its outline, where it has one.
    pub edge: Option<Colour>,
}

impl Tile {
    /// The outward unit normal of the tile.
    pub fn normal(&self) -> Point3 {
        normal_of(&self.corners)
    }
}

/// A straight line on the skin.
#[derive(Debug, Clone)]
pub struct Stroke {
    /// Its ends, m.
    pub ends: [Point3; 2],
    /// Outward normal where it lies.
    pub normal: Point3,
    /// Its colour.
    pub colour: Colour,
    /// Its width, pixels.
    pub width: f64,
}

/// A round mark on the skin.
#[derive(Debug, Clone)]
pub struct Dot {
    /// Where, m.
    pub at: Point3,
    /// Outward normal there.
    pub normal: Point3,
    /// Its radius, pixels.
    pub radius: f64,
    /// How it is drawn.
    pub mark: Mark,
}

/// A kind of round mark, for dots and for the legend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mark {
    /// Filled with a dark rim or without.
    Disc(Colour, bool),
    /// Filled, with a white rim that lifts it off any colour.
    Bead(Colour),
    /// An upright cross with a white rim.
    Cross(Colour),
    /// A filled diamond with a white rim.
    Diamond(Colour),
    /// An empty circle.
    Ring(Colour),
    /// A line, in the legend only.
    Line(Colour),
}

/// A short text on the skin.
#[derive(Debug, Clone)]
pub struct Label {
    /// Where, m.
    pub at: Point3,
    /// Outward normal there.
    pub normal: Point3,
    /// Its text.
    pub text: String,
    /// How far what it names reaches from there, m.
    pub reach_m: f64,
    /// Its position.
    pub stand: Stand,
    /// Height of its letters, pixels.
    pub size: f64,
}

/// The position of a label beside what it names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stand {
    /// Above it, by some pixels.
    Above {
        /// From its place to the foot of the letters.
        pixels: f64,
    },
    /// On it where it is large enough, else above it (below it where there is no room).
    OnOrAbove,
    /// Towards the middle of the body: for what lies on its edge.
    Inwards {
        /// From its place to the letters.
        pixels: f64,
    },
}

/// A key to the colours of the tiles.
#[derive(Debug, Clone)]
pub struct Key {
    /// The colours.
    pub scale: Scale,
    /// What the numbers are, with their unit.
    pub label: String,
}

/// Everything that a view draws: tiles from back to front, then what lies on them.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// What the picture shows.
    pub title: String,
    /// A second, smaller line: how it was made.
    pub subtitle: String,
    /// The key to the colours.
    pub key: Option<Key>,
    /// The skin itself.
    pub(crate) tiles: Vec<Tile>,
    /// Tiles that lie on the skin.
    pub(crate) patches: Vec<Tile>,
    /// Lines on the skin.
    pub(crate) strokes: Vec<Stroke>,
    /// Marks on the skin.
    pub(crate) dots: Vec<Dot>,
    /// Texts on the skin.
    pub(crate) labels: Vec<Label>,
    /// The key to the marks.
    pub(crate) legend: Vec<(Mark, String)>,
}

impl Scene {
    /// The same scene with a title and a second, smaller line; either may be empty.
    #[must_use]
    pub fn titled(self, title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Scene { title: title.into(), subtitle: subtitle.into(), ..self }
    }
}

/// The unit normal of a flat polygon (from its first corners that span a plane).
pub fn normal_of(corners: &[Point3]) -> Point3 {
    let spokes: Vec<Point3> = corners[1..].iter().map(|&corner| sub(corner, corners[0])).collect();
    let sum = spokes.windows(2).fold([0.0; 3], |sum, pair| dermis::geom::vector::add(sum, cross(pair[0], pair[1])));
    normalize(sum)
}

/// Size of the electrodes' numbers, pixels.
pub const LABEL_SIZE: f64 = 10.0;

impl Label {
    /// The middle of the label's baseline in a plot of some size, from the pixels where it is anchored and the pixels
    /// per m; always whole inside the plot.
    pub fn baseline(&self, [x, y]: [f64; 2], [width, height]: [f64; 2], pixels_per_m: f64) -> [f64; 2] {
        let reach = self.reach_m * pixels_per_m;
        let half = text_width(&self.text, self.size) / 2.0;
        let centred = 0.36 * self.size;
        let (x, y) = match self.stand {
            Stand::Above { pixels } => (x, y - pixels - 2.0),
            Stand::OnOrAbove if reach > self.size => (x, y + centred),
            Stand::OnOrAbove if y - reach - 3.0 > self.size => (x, y - reach - 3.0),
            Stand::OnOrAbove => (x, y + reach + 2.0 + self.size),
            Stand::Inwards { pixels } => {
                let (dx, dy) = (width / 2.0 - x, height / 2.0 - y);
                let length = dx.hypot(dy).max(1e-9);
                let step = pixels + half * (dx / length).abs() + 0.5 * self.size * (dy / length).abs();
                let step = step.min(length);
                (x + step * dx / length, y + step * dy / length + centred)
            }
        };
        [x.clamp(half + 2.0, width - half - 2.0), y.clamp(self.size, height - 2.0)]
    }
}
