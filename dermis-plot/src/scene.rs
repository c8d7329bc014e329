//! A scene in 3D; the views unroll or project it.

use crate::colour::{Colour, Scale};
use crate::svg::text_width;
use dermis::geom::Point3;
use dermis::geom::vector::{bounding_box, cross, normalize, sub};

/// A flat polygon of the skin. Corners are counter-clockwise as seen from outside.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    /// Corners, m.
    pub corners: Vec<Point3>,
    /// Its colour.
    pub fill: Colour,
    /// Colour of its outline, if any.
    pub edge: Option<Colour>,
}

impl Tile {
    /// The outward unit normal of the tile.
    pub(crate) fn normal(&self) -> Point3 {
        normal_of(&self.corners)
    }
}

/// A straight line on the skin.
#[derive(Debug, Clone)]
pub(crate) struct Stroke {
    /// Its ends, m.
    pub ends: [Point3; 2],
    /// Outward normal at its position.
    pub normal: Point3,
    /// Its colour.
    pub colour: Colour,
    /// Its width, pixels.
    pub width: f64,
}

/// A round mark on the skin.
#[derive(Debug, Clone)]
pub(crate) struct Dot {
    /// Position, m.
    pub at: Point3,
    /// Outward normal at its position.
    pub normal: Point3,
    /// Its radius, pixels.
    pub radius: f64,
    /// Its shape and colour.
    pub mark: Mark,
}

/// A shape of round mark, for dots and for the legend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mark {
    /// A disc with or without a dark rim.
    Disc(Colour, bool),
    /// A disc with a white rim that separates it from any background.
    OutlinedDisc(Colour),
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
pub(crate) struct Label {
    /// Position, m.
    pub at: Point3,
    /// Outward normal at its position.
    pub normal: Point3,
    /// Its text.
    pub text: String,
    /// Extent of the labelled object from there, m.
    pub reach_m: f64,
    /// Its position.
    pub position: LabelPosition,
    /// Text size, pixels.
    pub size: f64,
}

/// The position of a label relative to its object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum LabelPosition {
    /// Above it, with an offset.
    Above {
        /// Offset to the baseline, pixels.
        pixels: f64,
    },
    /// On it if it is large enough, else above it (below it if there is no room).
    OnOrAbove,
    /// Towards the centre of the body, for objects at its edge.
    Inwards {
        /// Offset to the text, pixels.
        pixels: f64,
    },
}

/// The colour bar of the tiles.
#[derive(Debug, Clone)]
pub struct Key {
    /// The colour map.
    pub scale: Scale,
    /// The quantity, with its unit.
    pub label: String,
}

/// All elements of a view: tiles from back to front, then the elements on them.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// The title.
    pub title: String,
    /// A second, smaller line, for example on the method.
    pub subtitle: String,
    /// The colour bar.
    pub key: Option<Key>,
    /// The skin itself.
    pub(crate) tiles: Vec<Tile>,
    /// Tiles on top of the skin.
    pub(crate) patches: Vec<Tile>,
    /// Lines on the skin.
    pub(crate) strokes: Vec<Stroke>,
    /// Marks on the skin.
    pub(crate) dots: Vec<Dot>,
    /// Texts on the skin.
    pub(crate) labels: Vec<Label>,
    /// The legend of the marks.
    pub(crate) legend: Vec<(Mark, String)>,
}

/// Depth of a flat scene across an axis, relative to its size: files of meshes have six or seven digits.
const FLAT: f64 = 1e-6;

impl Scene {
    /// Whether its tiles lie in a plane across one of the axes.
    pub(crate) fn is_flat(&self) -> bool {
        let [low_m, high_m] = bounding_box(self.tiles.iter().flat_map(|tile| &tile.corners).copied());
        let sizes_m = sub(high_m, low_m);
        let [least_m, most_m] =
            [f64::min, f64::max].map(|of: fn(f64, f64) -> f64| sizes_m.into_iter().fold(sizes_m[0], of));
        least_m <= FLAT * most_m
    }

    /// The same scene with a title and a second, smaller line; either may be empty.
    #[must_use]
    pub fn titled(self, title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Scene { title: title.into(), subtitle: subtitle.into(), ..self }
    }
}

/// The unit normal of a flat polygon (from its first corners that span a plane).
pub(crate) fn normal_of(corners: &[Point3]) -> Point3 {
    let spokes: Vec<Point3> = corners[1..].iter().map(|&corner| sub(corner, corners[0])).collect();
    let sum = spokes.windows(2).fold([0.0; 3], |sum, pair| dermis::geom::vector::add(sum, cross(pair[0], pair[1])));
    normalize(sum)
}

/// Size of the electrodes' numbers, pixels.
pub(crate) const LABEL_SIZE: f64 = 10.0;

impl Label {
    /// The centre of the baseline of the label in a plot of a given size, from its anchor in pixels and the pixels per
    /// m; the label is always completely inside the plot.
    pub(crate) fn baseline(&self, [x, y]: [f64; 2], [width, height]: [f64; 2], pixels_per_m: f64) -> [f64; 2] {
        let reach = self.reach_m * pixels_per_m;
        let half = text_width(&self.text, self.size) / 2.0;
        let centred = 0.36 * self.size;
        let (x, y) = match self.position {
            LabelPosition::Above { pixels } => (x, y - pixels - 2.0),
            LabelPosition::OnOrAbove if reach > self.size => (x, y + centred),
            LabelPosition::OnOrAbove if y - reach - 3.0 > self.size => (x, y - reach - 3.0),
            LabelPosition::OnOrAbove => (x, y + reach + 2.0 + self.size),
            LabelPosition::Inwards { pixels } => {
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
