//! The skin in 3D: parallel projection, painter's algorithm.

use crate::camera::{Camera, READABLE};
use crate::colour::{Colour, INK, WHITE, mix};
use crate::frame;
use crate::projection::{Light, MARGIN, PLOT_SIZE, Projection};
use crate::scene::{Key, Scene};
use crate::svg::{Anchor, Picture, Place, Style, Text};
use dermis::geom::vector::{centroid, dot};

/// Height below the body for the axes and the scale bar, pixels.
const BELOW: f64 = 74.0;
/// Minimum width of a picture, so that its title is readable, pixels.
const MIN_WIDTH: f64 = 400.0;
/// Smallest cosine between view and normal for marks: near the limb of the body they would be too dense.
const MARKED: f64 = 0.15;
/// Height of a caption below each of several views, pixels.
const CAPTION: f64 = 22.0;

/// Style of a tile: with its outline, or with a line in its own colour that hides the gaps between neighbours.
pub(crate) fn tile_style(fill: Colour, edge: Option<Colour>) -> Style {
    let (colour, width) = edge.map_or((fill, 1.0), |edge| (edge, 0.5));
    Style::fill(fill).outlined(colour, width)
}

/// The scene as seen by some cameras, side by side.
pub(crate) fn draw(scene: &Scene, cameras: &[Camera]) -> Picture {
    let mut views: Vec<Projection> = cameras.iter().map(|camera| Projection::new(camera, &scene.tiles)).collect();
    // One scale for all views; the scale bar is next to the first.
    let pixels_per_m = views.iter().map(|view| view.pixels_per_m).fold(f64::INFINITY, f64::min);
    views.iter_mut().for_each(|view| view.pixels_per_m = pixels_per_m);
    let width = views.iter().map(Projection::width).sum::<f64>();
    let height = views.iter().map(Projection::height).fold(0.0, f64::max);
    let right = if scene.key.is_some() { frame::KEY_WIDTH } else { 0.0 };
    let top = frame::title_height(&scene.title, &scene.subtitle);
    let base = top + height + if views.len() > 1 { CAPTION } else { 0.0 };
    // Leave room for the title next to a narrow body.
    let total_width = (width + right).max(MIN_WIDTH);
    let legend_width = total_width - 2.0 * MARGIN;
    let legend_height = frame::legend_height(&scene.legend, legend_width);
    let mut picture = Picture::new(total_width, base + BELOW + legend_height);
    frame::title(&mut picture, &scene.title, &scene.subtitle);
    let mut x = ((total_width - right - width) / 2.0).max(0.0);
    for (view, camera) in views.iter().zip(cameras) {
        picture.place([x, top], &draw_body(scene, view));
        axes(&mut picture, view, [x + view.width() / 2.0 - 30.0, base + 26.0]);
        if views.len() > 1 {
            let caption = caption(camera, cameras);
            let place = [x + view.width() / 2.0, top + height];
            picture.text(place, &caption, Text::new(12.0, Anchor::Middle));
        }
        x += view.width();
    }
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

fn draw_body(scene: &Scene, view: &Projection) -> Picture {
    let mut picture = Picture::new(view.width(), view.height());
    // Data keep the colours of the colour bar; bare skin is shaded.
    let light = if scene.key.is_some() { Light::Even } else { Light::Shaded };
    let skin = view.see_all(&scene.tiles, light);
    for tile in &skin {
        picture.polygon(&tile.places, tile_style(tile.fill, tile.edge));
    }
    for edge in view.outline(&scene.tiles, &skin) {
        picture.line(&edge, Style::line(mix(INK, WHITE, 0.35), 1.0));
    }
    let visible = |at, normal, least| view.visible(at, normal, least, &skin);
    for patch in scene.patches.iter().filter(|patch| visible(centroid(&patch.corners), patch.normal(), 0.0)) {
        let seen = view.see(patch, Light::Even);
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
        picture.text(at, &label.text, Text::new(label.size, Anchor::Middle).rimmed());
    }
    picture
}

fn caption(camera: &Camera, all: &[Camera]) -> String {
    let azimuth = camera.azimuth_rad.to_degrees().rem_euclid(360.0);
    let elevation = camera.elevation_rad.to_degrees();
    let side = if elevation < 0.0 { "below" } else { "above" };
    match all.iter().all(|other| other.elevation_rad == camera.elevation_rad) {
        true => format!("seen from \u{3b8} = {azimuth:.0}\u{b0}"),
        false => format!("seen from \u{3b8} = {azimuth:.0}\u{b0}, {:.0}\u{b0} {side}", elevation.abs()),
    }
}

/// The coordinate axes.
fn axes(picture: &mut Picture, view: &Projection, origin: Place) {
    const LENGTH: f64 = 30.0;
    for (name, axis) in [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])] {
        let [dx, dy] = [dot(view.axes[0], axis) * LENGTH, -dot(view.axes[1], axis) * LENGTH];
        picture.line(&[origin, [origin[0] + dx, origin[1] + dy]], Style::line(INK, 1.4));
        let length = dx.hypot(dy);
        if length > 6.0 {
            let beyond = (length + 9.0) / length;
            // Next to the z axis, not on it.
            let aside = if name != "z" && dx.abs() < 6.0 { 9.0 } else { 0.0 };
            let at = [origin[0] + dx * beyond + aside, origin[1] + dy * beyond + 4.0];
            picture.text(at, name, Text::new(12.0, Anchor::Middle));
        }
    }
}

/// A scale bar.
fn scale_bar(picture: &mut Picture, view: &Projection, [x, y]: Place) {
    let length_mm = round_down(0.2 * PLOT_SIZE / view.pixels_per_m * 1e3);
    let pixels = length_mm / 1e3 * view.pixels_per_m;
    let bar = [[x, y - 4.0], [x, y + 4.0], [x, y], [x + pixels, y], [x + pixels, y - 4.0], [x + pixels, y + 4.0]];
    picture.line(&bar, Style::line(INK, 1.4));
    let text = format!("{} mm", trim(length_mm));
    picture.text([x + pixels / 2.0, y + 20.0], &text, Text::new(frame::TEXT_SIZE, Anchor::Middle));
}

/// The largest of 1, 2, 5 times a power of ten that does not exceed a number.
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

    #[test]
    fn bars_have_round_lengths() {
        assert_eq!(round_down(84.0), 50.0);
        assert_eq!(round_down(0.3), 0.2);
    }
}
