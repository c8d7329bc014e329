//! The skin unrolled: a cylinder cut open at theta = 0, a flat skin unchanged, from above. A body of another shape is
//! projected.

use crate::colour::{FAINT, INK};
use crate::frame::{self, Axis};
use crate::scene::{Scene, Tile};
use crate::svg::{Anchor, Picture, Place, Style, Text};
use crate::{PlotError, solid};
use dermis::design::{Body, SkinDesign};
use dermis::geom::vector::bounding_box;
use dermis::geom::{Chart, Point2, Point3, Shape};

/// Largest extent of the plot, pixels.
const PLOT_SIZE: f64 = 540.0;
/// Margin around the body inside the plot, relative to the larger extent of the body; marks at the edge need it.
const MARGIN: f64 = 0.03;
const LEFT: f64 = 66.0;
const BELOW: f64 = 48.0;
/// Height of the angles above a cylinder.
const ABOVE: f64 = 44.0;

/// The flat layout of a body: lengths in m, the second axis upwards.
#[derive(Debug, Clone, Copy)]
struct Layout {
    chart: Chart,
    bounds_m: [Point2; 2],
    /// Axes in space of a flat layout, to the right and upwards.
    axes: [usize; 2],
}

impl Layout {
    /// The layout of a body, or of a scene that is flat itself.
    fn of(body: &Body, scene: &Scene) -> Option<Self> {
        let of_chart = body.chart().map(|chart| Layout { chart, bounds_m: chart.bounds_m(), axes: [0, 1] });
        of_chart.or_else(|| scene.is_flat().then(|| Layout::projected(&scene.tiles)))
    }

    /// The projection on the two axes along which some tiles extend most.
    fn projected(tiles: &[Tile]) -> Self {
        let [low_m, high_m] = bounding_box(tiles.iter().flat_map(|tile| &tile.corners).copied());
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| (high_m[b] - low_m[b]).total_cmp(&(high_m[a] - low_m[a])));
        let axes = [axes[0].min(axes[1]), axes[0].max(axes[1])];
        let bounds_m = [low_m, high_m].map(|corner| axes.map(|axis| corner[axis]));
        Layout { chart: Chart::new(Shape::Plane), bounds_m, axes }
    }

    fn is_closed(&self) -> bool {
        self.chart.period_m().is_some()
    }

    fn labels(&self) -> [&'static str; 2] {
        match self.is_closed() {
            true => ["arc length s = r \u{3b8} (mm)", "z (mm)"],
            false => self.axes.map(|axis| ["x (mm)", "y (mm)", "z (mm)"][axis]),
        }
    }

    /// A point of the skin, m.
    fn point(&self, at: Point3) -> Point2 {
        self.chart.unroll([at[self.axes[0]], at[self.axes[1]], at[2]])
    }

    /// The points of one element (a tile, a line), repeated where it crosses the seam.
    fn together(&self, points: &[Point3]) -> Vec<Vec<Point2>> {
        let first = self.point(points[0]);
        let beside = |&at: &Point3| {
            let [x, y] = self.chart.difference(first, self.point(at));
            [first[0] + x, first[1] + y]
        };
        let mut copies = vec![points.iter().map(beside).collect::<Vec<_>>()];
        if let Some(period_m) = self.chart.period_m() {
            // A small tolerance, so that an element that only touches the seam is not drawn twice.
            let tolerance_m = 1e-9 * period_m;
            let moved = |by_m: f64| copies[0].iter().map(|[x, y]| [x + by_m, *y]).collect();
            let below = copies[0].iter().any(|[x, _]| *x < -tolerance_m).then(|| moved(period_m));
            let above = copies[0].iter().any(|[x, _]| *x > period_m + tolerance_m).then(|| moved(-period_m));
            copies.extend([below, above].into_iter().flatten());
        }
        copies
    }
}

/// Position and scale of the plot.
struct Plot {
    layout: Layout,
    low_m: Point2,
    pixels_per_m: f64,
    width: f64,
    height: f64,
}

impl Plot {
    fn new(layout: Layout) -> Self {
        let [low_m, high_m] = layout.bounds_m;
        let extent = [high_m[0] - low_m[0], high_m[1] - low_m[1]];
        let room = MARGIN * extent[0].max(extent[1]);
        // A cylinder fills the plot from seam to seam.
        let room = [if layout.is_closed() { 0.0 } else { room }, room];
        let full = [extent[0] + 2.0 * room[0], extent[1] + 2.0 * room[1]];
        let pixels_per_m = PLOT_SIZE / full[0].max(full[1]);
        Plot {
            layout,
            low_m: [low_m[0] - room[0], low_m[1] - room[1]],
            pixels_per_m,
            width: full[0] * pixels_per_m,
            height: full[1] * pixels_per_m,
        }
    }

    fn place(&self, [x, y]: [f64; 2]) -> Place {
        [(x - self.low_m[0]) * self.pixels_per_m, self.height - (y - self.low_m[1]) * self.pixels_per_m]
    }

    fn range_mm(&self, axis: usize) -> [f64; 2] {
        let extent = [self.width, self.height][axis] / self.pixels_per_m;
        [self.low_m[axis] * 1e3, (self.low_m[axis] + extent) * 1e3]
    }

    fn tiles(&self, picture: &mut Picture, tiles: &[Tile]) {
        for tile in tiles {
            for copy in self.layout.together(&tile.corners) {
                let mut places: Vec<Place> = copy.into_iter().map(|at| self.place(at)).collect();
                // Of a projected body, the back has the other orientation: together they would be a hole.
                if doubled_area(&places) < 0.0 {
                    places.reverse();
                }
                picture.polygon(&places, solid::tile_style(tile.fill, tile.edge));
            }
        }
    }

    /// The two sides of the seam, or the outline of a flat body.
    fn outline(&self, picture: &mut Picture, body: &Body) {
        let [[x0, y0], [x1, y1]] = self.layout.bounds_m;
        let style = Style::line(FAINT, 1.0);
        match *body {
            Body::Disk { diameter_m } => {
                let centre = self.place([0.0, 0.0]);
                picture.circle(centre, diameter_m / 2.0 * self.pixels_per_m, style);
            }
            Body::Mesh { .. } => {}
            _ => picture.polygon(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|at| self.place(at)), style),
        }
    }

    fn draw(&self, scene: &Scene, body: &Body) -> Picture {
        let mut picture = Picture::new(self.width, self.height);
        self.tiles(&mut picture, &scene.tiles);
        self.outline(&mut picture, body);
        self.tiles(&mut picture, &scene.patches);
        for stroke in &scene.strokes {
            for copy in self.layout.together(&stroke.ends) {
                let places: Vec<Place> = copy.into_iter().map(|at| self.place(at)).collect();
                picture.line(&places, Style::line(stroke.colour, stroke.width));
            }
        }
        for dot in &scene.dots {
            let copies = self.layout.chart.copies_within(self.layout.point(dot.at), dot.radius / self.pixels_per_m);
            for place in copies {
                frame::draw_mark(&mut picture, self.place(place), dot.radius, dot.mark);
            }
        }
        for label in &scene.labels {
            let anchor = self.place(self.layout.point(label.at));
            let at = label.baseline(anchor, [self.width, self.height], self.pixels_per_m);
            picture.text(at, &label.text, Text::new(label.size, Anchor::Middle).rimmed());
        }
        picture
    }
}

/// Twice the area of a polygon, with the sign of its orientation.
fn doubled_area(places: &[Place]) -> f64 {
    let next = places.iter().cycle().skip(1);
    places.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum()
}

/// The scene as an unrolled picture.
///
/// # Errors
/// A body from a mesh file that is not flat has no flat layout.
pub(crate) fn draw(scene: &Scene, design: &SkinDesign) -> Result<Picture, PlotError> {
    let layout = Layout::of(&design.body, scene).ok_or(PlotError::NoFlatLayout)?;
    Ok(draw_layout(scene, design, layout))
}

/// The same; a body without a flat layout is projected on its two longest axes.
pub(crate) fn draw_flat(scene: &Scene, design: &SkinDesign) -> Picture {
    let layout = Layout::of(&design.body, scene).unwrap_or_else(|| Layout::projected(&scene.tiles));
    draw_layout(scene, design, layout)
}

fn draw_layout(scene: &Scene, design: &SkinDesign, layout: Layout) -> Picture {
    let plot = Plot::new(layout);
    let above = if layout.is_closed() { ABOVE } else { 6.0 };
    let right = if scene.key.is_some() { frame::KEY_WIDTH + 24.0 } else { 24.0 };
    let top = frame::title_height(&scene.title, &scene.subtitle) + above;
    let legend_height = frame::legend_height(&scene.legend, plot.width);
    let mut picture = Picture::new(LEFT + plot.width + right, top + plot.height + BELOW + legend_height + 4.0);
    frame::title(&mut picture, &scene.title, &scene.subtitle);
    picture.place([LEFT, top], &plot.draw(scene, &design.body));
    frame::border(&mut picture, [LEFT, top], plot.width, plot.height);
    let corner = [LEFT, top + plot.height];
    let wanted = |pixels: f64| ((pixels / 70.0) as usize).max(2);
    let below =
        Axis { range: plot.range_mm(0), logarithmic: false, label: layout.labels()[0], wanted: wanted(plot.width) };
    frame::axis_below(&mut picture, corner, plot.width, &below);
    let left =
        Axis { range: plot.range_mm(1), logarithmic: false, label: layout.labels()[1], wanted: wanted(plot.height) };
    frame::axis_left(&mut picture, corner, plot.height, &left);
    if layout.is_closed() {
        angles(&mut picture, [LEFT, top], plot.width);
    }
    if let Some(key) = &scene.key {
        frame::colour_bar(&mut picture, [LEFT + plot.width + 20.0, top], plot.height, key);
    }
    frame::legend(&mut picture, [LEFT, corner[1] + BELOW], plot.width, &scene.legend);
    picture
}

/// The angles of a cylinder, above the plot.
fn angles(picture: &mut Picture, [x, y]: Place, width: f64) {
    for degrees in (0..=360).step_by(60) {
        let at = x + width * f64::from(degrees) / 360.0;
        picture.line(&[[at, y - 5.0], [at, y]], Style::line(INK, 1.0));
        picture.text([at, y - 9.0], &degrees.to_string(), Text::new(12.0, Anchor::Middle));
    }
    picture.text([x + width / 2.0, y - 27.0], "\u{3b8} (degrees)", Text::new(frame::TEXT_SIZE, Anchor::Middle));
}
