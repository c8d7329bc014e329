//! The skin in space: parallel projection, the painter's algorithm, light from the upper left.

use crate::colour::{BLACK, Colour, INK, mix};
use crate::frame;
use crate::scene::{Key, LABEL_SIZE, Scene, Tile};
use crate::svg::{Anchor, Picture, Place, Style, Text};
use dermis::geom::Point3;
use dermis::geom::vector::{add, centroid, cross, dot, normalize, scale};

/// Largest extent of the body in the picture, pixels.
const PLOT_SIZE: f64 = 540.0;
const MARGIN: f64 = 24.0;
/// Room below the body for the axes and the scale bar.
const BELOW: f64 = 74.0;
/// Width that a picture has at least, so that its title can be read, pixels.
const LEAST_WIDTH: f64 = 400.0;
/// Least cosine between view and normal at which a label on the skin can be read.
const READABLE: f64 = 0.3;
/// Least cosine for marks: nearer to the body's limb they would crowd.
const MARKED: f64 = 0.15;
/// Room for a caption below each of several views, pixels.
const CAPTION: f64 = 22.0;

/// From where the skin is looked at. Angles in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Round the z axis, from +x towards +y.
    pub azimuth_rad: f64,
    /// Above the plane z = 0.
    pub elevation_rad: f64,
}

impl Camera {
    /// Right, up, and towards the viewer.
    fn frame(&self) -> [Point3; 3] {
        let ((sa, ca), (se, ce)) = (self.azimuth_rad.sin_cos(), self.elevation_rad.sin_cos());
        let towards = [ce * ca, ce * sa, se];
        let right = [-sa, ca, 0.0];
        [right, cross(towards, right), towards]
    }
}

/// How a tile is drawn: with its outline, or with a seam of its own colour that hides the gaps between neighbours.
pub fn tile_style(fill: Colour, edge: Option<Colour>) -> Style {
    let (colour, width) = edge.map_or((fill, 1.0), |edge| (edge, 0.5));
    Style::fill(fill).outlined(colour, width)
}

/// A tile as the camera sees it.
struct Seen {
    places: Vec<Place>,
    depth: f64,
    fill: Colour,
    edge: Option<Colour>,
    /// Bounding box, pixels.
    low: Place,
    high: Place,
    /// Depth as a plane over the picture: `depth = plane[0] + plane[1] x + plane[2] y`; none seen edge-on.
    plane: Option<[f64; 3]>,
}

struct View {
    axes: [Point3; 3],
    low: Place,
    high: Place,
    pixels_per_m: f64,
}

impl View {
    fn new(camera: &Camera, tiles: &[Tile]) -> Self {
        let axes = camera.frame();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in tiles.iter().flat_map(|tile| &tile.corners) {
            for axis in 0..2 {
                let value = dot(axes[axis], *corner);
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        View { axes, low, high, pixels_per_m: if extent > 0.0 { PLOT_SIZE / extent } else { 1.0 } }
    }

    fn width(&self) -> f64 {
        (self.high[0] - self.low[0]) * self.pixels_per_m + 2.0 * MARGIN
    }

    fn height(&self) -> f64 {
        (self.high[1] - self.low[1]) * self.pixels_per_m + 2.0 * MARGIN
    }

    fn place(&self, point: Point3) -> Place {
        let right = dot(self.axes[0], point) - self.low[0];
        let up = self.high[1] - dot(self.axes[1], point);
        [MARGIN + right * self.pixels_per_m, MARGIN + up * self.pixels_per_m]
    }

    fn depth(&self, point: Point3) -> f64 {
        dot(self.axes[2], point)
    }

    fn facing(&self, normal: Point3) -> f64 {
        dot(self.axes[2], normal)
    }

    fn shaded(&self, fill: Colour, normal: Point3) -> Colour {
        let light = normalize(add(add(self.axes[2], scale(self.axes[1], 0.6)), scale(self.axes[0], -0.5)));
        let facing = self.facing(normal);
        let normal = if facing < 0.0 { scale(normal, -1.0) } else { normal };
        // Light enough to leave the colours of the key recognisable; the inside of an open body is darker.
        let dark = 0.28 * (1.0 - dot(light, normal).max(0.0)) + if facing < 0.0 { 0.3 } else { 0.0 };
        mix(fill, BLACK, dark)
    }

    fn see(&self, tile: &Tile) -> Seen {
        let places: Vec<Place> = tile.corners.iter().map(|&corner| self.place(corner)).collect();
        let normal = tile.normal();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for place in &places {
            for axis in 0..2 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        Seen {
            depth: self.depth(centroid(&tile.corners)),
            fill: self.shaded(tile.fill, normal),
            edge: tile.edge.map(|edge| self.shaded(edge, normal)),
            plane: self.depth_plane(tile, normal, places[0]),
            places,
            low,
            high,
        }
    }

    fn depth_plane(&self, tile: &Tile, normal: Point3, first: Place) -> Option<[f64; 3]> {
        let facing = self.facing(normal);
        if facing.abs() < 1e-6 {
            return None;
        }
        // On the plane n . (x - x0) = 0 a step right by dx changes depth by -(n . right) dx / (n . towards).
        let dx = -dot(normal, self.axes[0]) / facing / self.pixels_per_m;
        let dy = dot(normal, self.axes[1]) / facing / self.pixels_per_m;
        Some([self.depth(tile.corners[0]) - dx * first[0] - dy * first[1], dx, dy])
    }

    /// Whether nothing of the skin lies between a point on it and the viewer.
    fn visible(&self, point: Point3, normal: Point3, least_facing: f64, skin: &[Seen]) -> bool {
        if self.facing(normal) <= least_facing {
            return false;
        }
        let place = self.place(point);
        // A point on a curved body lies a little off its flat tiles; half a percent of the picture forgives that.
        let limit = self.depth(point) + 0.005 * PLOT_SIZE / self.pixels_per_m;
        !skin.iter().any(|tile| {
            let inside_box = (0..2).all(|axis| tile.low[axis] <= place[axis] && place[axis] <= tile.high[axis]);
            let nearer = tile.plane.is_some_and(|[d, dx, dy]| d + dx * place[0] + dy * place[1] > limit);
            inside_box && nearer && inside(&tile.places, place)
        })
    }
}

fn inside(polygon: &[Place], [x, y]: Place) -> bool {
    let mut odd = false;
    let mut previous = polygon[polygon.len() - 1];
    for &corner in polygon {
        if (corner[1] > y) != (previous[1] > y) {
            let crossing = corner[0] + (y - corner[1]) / (previous[1] - corner[1]) * (previous[0] - corner[0]);
            odd ^= x < crossing;
        }
        previous = corner;
    }
    odd
}

/// The scene as seen by some cameras, side by side.
pub fn draw(scene: &Scene, cameras: &[Camera]) -> Picture {
    let views: Vec<View> = cameras.iter().map(|camera| View::new(camera, &scene.tiles)).collect();
    let width = views.iter().map(View::width).sum::<f64>();
    let height = views.iter().map(View::height).fold(0.0, f64::max);
    let right = if scene.key.is_some() { frame::KEY_WIDTH } else { 0.0 };
    let top = frame::title_height(&scene.title, &scene.subtitle);
    let base = top + height + if views.len() > 1 { CAPTION } else { 0.0 };
    // Narrow bodies leave the title some room.
    let total_width = (width + right).max(LEAST_WIDTH);
    let legend_width = total_width - 2.0 * MARGIN;
    let legend_height = frame::legend_height(&scene.legend, legend_width);
    let mut picture = Picture::new(total_width, base + BELOW + legend_height);
    frame::title(&mut picture, &scene.title, &scene.subtitle);
    let mut x = ((total_width - right - width) / 2.0).max(0.0);
    for (view, camera) in views.iter().zip(cameras) {
        picture.place([x, top], &draw_body(scene, view));
        axes(&mut picture, view, [x + view.width() / 2.0 - 30.0, base + 26.0]);
        if views.len() > 1 {
            let azimuth = camera.azimuth_rad.to_degrees().rem_euclid(360.0);
            let caption = format!("seen from \u{3b8} = {azimuth:.0}\u{b0}");
            let place = [x + view.width() / 2.0, top + height];
            picture.text(place, &caption, Text::new(12.0, Anchor::Middle));
        }
        x += view.width();
    }
    // All views have one scale, since the cameras differ only in direction round the body; the bar stands by the first.
    let bar = [(total_width - right - width).max(0.0) / 2.0 + views[0].width() / 2.0 + 30.0, base + 24.0];
    scale_bar(&mut picture, &views[0], bar);
    if let Some(key) = &scene.key {
        colour_bar(&mut picture, total_width - right, top, height, key);
    }
    frame::legend(&mut picture, [MARGIN, base + BELOW - 8.0], legend_width, &scene.legend);
    picture
}

fn colour_bar(picture: &mut Picture, x: f64, top: f64, height: f64, key: &Key) {
    let bar_height = (height - 2.0 * MARGIN).max(160.0).min(height);
    frame::colour_bar(picture, [x, top + (height - bar_height) / 2.0], bar_height, key);
}

fn draw_body(scene: &Scene, view: &View) -> Picture {
    let mut picture = Picture::new(view.width(), view.height());
    let mut skin: Vec<Seen> = scene.tiles.iter().map(|tile| view.see(tile)).collect();
    skin.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    for tile in &skin {
        picture.polygon(&tile.places, tile_style(tile.fill, tile.edge));
    }
    let visible = |at, normal, least| view.visible(at, normal, least, &skin);
    for patch in scene.patches.iter().filter(|patch| visible(centroid(&patch.corners), patch.normal(), 0.0)) {
        let seen = view.see(patch);
        picture.polygon(&seen.places, tile_style(seen.fill, seen.edge));
    }
    for stroke in scene.strokes.iter().filter(|stroke| visible(centroid(&stroke.ends), stroke.normal, 0.0)) {
        picture.line(&stroke.ends.map(|end| view.place(end)), Style::line(stroke.colour, stroke.width));
    }
    for dot in scene.dots.iter().filter(|dot| visible(dot.at, dot.normal, MARKED)) {
        frame::draw_mark(&mut picture, view.place(dot.at), dot.radius, dot.mark);
    }
    for label in scene.labels.iter().filter(|label| visible(label.at, label.normal, READABLE)) {
        let at = label.baseline(view.place(label.at), [view.width(), view.height()], view.pixels_per_m);
        picture.text(at, &label.text, Text::new(LABEL_SIZE, Anchor::Middle).rimmed());
    }
    picture
}

/// The directions of the axes.
fn axes(picture: &mut Picture, view: &View, origin: Place) {
    const LENGTH: f64 = 30.0;
    for (name, axis) in [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])] {
        let [dx, dy] = [dot(view.axes[0], axis) * LENGTH, -dot(view.axes[1], axis) * LENGTH];
        picture.line(&[origin, [origin[0] + dx, origin[1] + dy]], Style::line(INK, 1.4));
        let length = dx.hypot(dy);
        if length > 6.0 {
            let beyond = (length + 9.0) / length;
            let at = [origin[0] + dx * beyond, origin[1] + dy * beyond + 4.0];
            picture.text(at, name, Text::new(12.0, Anchor::Middle));
        }
    }
}

/// A bar of known length.
fn scale_bar(picture: &mut Picture, view: &View, [x, y]: Place) {
    let length_mm = round_down(0.2 * PLOT_SIZE / view.pixels_per_m * 1e3);
    let pixels = length_mm / 1e3 * view.pixels_per_m;
    let bar = [[x, y - 4.0], [x, y + 4.0], [x, y], [x + pixels, y], [x + pixels, y - 4.0], [x + pixels, y + 4.0]];
    picture.line(&bar, Style::line(INK, 1.4));
    let text = format!("{} mm", trim(length_mm));
    picture.text([x + pixels / 2.0, y + 20.0], &text, Text::new(frame::TEXT_SIZE, Anchor::Middle));
}

/// The largest of 1, 2, 5 times a power of ten that is not above a number.
fn round_down(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|factor| factor * power).find(|&round| round <= value).unwrap_or(power)
}

fn trim(value: f64) -> String {
    if value >= 1.0 { format!("{value:.0}") } else { format!("{value}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::SKIN;

    fn square(z: f64) -> Tile {
        let corners = vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]];
        Tile { corners, fill: SKIN, edge: None }
    }

    #[test]
    fn the_camera_sees_a_right_handed_world() {
        let [right, up, towards] = Camera { azimuth_rad: 0.7, elevation_rad: 0.4 }.frame();
        let off = dermis::geom::vector::distance(cross(right, up), towards);
        assert!(off < 1e-12, "{off}");
        assert!(up[2] > 0.0);
    }

    #[test]
    fn what_lies_behind_the_skin_or_faces_away_is_hidden() {
        let tiles = [square(0.0), square(1.0)];
        let camera = Camera { azimuth_rad: 0.3, elevation_rad: 1.5 };
        let view = View::new(&camera, &tiles);
        let skin: Vec<Seen> = tiles.iter().map(|tile| view.see(tile)).collect();
        let up = [0.0, 0.0, 1.0];
        assert!(view.visible([0.5, 0.5, 1.0], up, 0.0, &skin));
        assert!(!view.visible([0.5, 0.5, 0.0], up, 0.0, &skin), "the upper square covers it");
        assert!(!view.visible([0.5, 0.5, 1.0], [0.0, 0.0, -1.0], 0.0, &skin));
    }

    #[test]
    fn bars_have_round_lengths() {
        assert_eq!(round_down(84.0), 50.0);
        assert_eq!(round_down(0.3), 0.2);
    }
}
