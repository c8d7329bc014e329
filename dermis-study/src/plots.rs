//! Pictures of an experiment for reports.

use crate::Result;
use crate::comparison::Shown;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::image::{Image, PixelSpace};
use dermis::mesh::Mesh;
use dermis::reconstruct::Quantity;
use dermis_plot::chart::Histogram;
use dermis_plot::{Drawing, Key, Picture, Scale, Scene, View};
use dermis_sim::evaluate::match_contacts;

/// A skin for pictures of experiments.
pub struct Plots<'a> {
    /// The skin.
    pub design: &'a SkinDesign,
    /// Its mesh.
    pub mesh: &'a Mesh,
    drawing: Drawing<'a>,
}

/// Caption of all pictures of localisation.
pub const LOCALISATION_CAPTION: &str = "Black dots are the true positions, red circles the estimates, yellow the \
    electrodes. Left and right edge are the same line on the skin.";

impl<'a> Plots<'a> {
    /// Pictures of a skin.
    pub fn new(design: &'a SkinDesign, mesh: &'a Mesh) -> Self {
        Plots { design, mesh, drawing: Drawing::new(design, mesh) }
    }

    /// The unrolled picture; in 3D for a body without a flat layout.
    pub fn flat(&self, scene: &Scene) -> Result<Picture> {
        match self.design.body {
            dermis::design::Body::Mesh { .. } => self.solid(scene),
            _ => self.draw(scene, &View::Unrolled),
        }
    }

    /// The picture in 3D.
    pub fn solid(&self, scene: &Scene) -> Result<Picture> {
        self.draw(scene, &View::Solid)
    }

    fn draw(&self, scene: &Scene, view: &View) -> Result<Picture> {
        Ok(view.draw(scene, self.design)?)
    }

    /// The electrodes with their numbers.
    pub fn electrodes(&self) -> Scene {
        self.drawing.electrodes().titled("Electrodes", "")
    }

    /// The mesh.
    pub fn mesh_scene(&self, title: &str) -> Scene {
        let subtitle = format!("{} nodes, {} triangles", self.mesh.node_count(), self.mesh.cell_count());
        self.drawing.mesh().titled(title, subtitle)
    }

    /// The sensitivity of a frame to each pixel.
    pub fn frame_sensitivity(&self, space: &PixelSpace, sensitivity: &[f64]) -> Scene {
        let scene = self.drawing.sensitivity(space, sensitivity);
        let subtitle = scene.subtitle.clone();
        scene.titled("Sensitivity of the frame", subtitle)
    }

    /// True and estimated positions of presses (the paper's Fig. 7).
    pub fn localisation(&self, title: &str, subtitle: &str, truth: &[Vec<Contact>], shown: &Shown) -> Scene {
        localisation_scene(&self.drawing, self.design, truth, &shown.contacts).titled(title, subtitle)
    }

    /// A histogram of the localisation errors.
    pub fn errors(&self, title: &str, truth: &[Vec<Contact>], shown: &Shown) -> Picture {
        let surface = self.design.body.surface();
        let mut errors_mm = Vec::new();
        for (touches, contacts) in truth.iter().zip(&shown.contacts) {
            let matched = match_contacts(touches, contacts, &surface);
            errors_mm.extend(matched.pairs.iter().map(|(_, _, distance_m)| distance_m * 1e3));
        }
        let summary = &shown.score.localisation_m;
        let mark = |name: &str, value_m: f64| (value_m * 1e3, format!("{name} {:.1} mm", value_m * 1e3));
        let marks = [("median", summary.median), ("mean", summary.mean), ("95th percentile", summary.p95)];
        let marks =
            marks.into_iter().filter(|mark| mark.1.is_finite()).map(|(name, value)| mark(name, value)).collect();
        Histogram {
            title,
            label: "distance along the surface (mm)",
            values: &errors_mm,
            counted: "presses",
            step: 0.25,
            marks,
        }
        .draw()
    }

    /// The peak of the image per newton of the press in each pixel, divided by its mean (the paper's Fig. 8). Each
    /// frame has one press, each in another pixel; pixels without a press are `NaN`.
    pub fn sensitivity_map(&self, truth: &[Vec<Contact>], shown: &Shown) -> Vec<f64> {
        let Some(space) = shown.images.first().map(|image| &image.space) else { return Vec::new() };
        let surface = self.design.body.surface();
        let mut values = vec![f64::NAN; space.len()];
        for (touches, image) in truth.iter().zip(&shown.images) {
            let [touch] = touches[..] else { continue };
            let from = |pixel: usize| surface.distance_m(space.centres_m[pixel], touch.position_m);
            let pixel = (0..space.len()).min_by(|&a, &b| from(a).total_cmp(&from(b)));
            if let (Some(pixel), Some((_, peak))) = (pixel, image.peak()) {
                values[pixel] = peak / touch.force_n;
            }
        }
        let pressed: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
        let mean = pressed.iter().sum::<f64>() / pressed.len().max(1) as f64;
        values.iter().map(|value| value / mean).collect()
    }

    /// This map as a picture; pixels without a press are grey.
    pub fn sensitivity(&self, shown: &Shown, map: &[f64], scale: Scale) -> Scene {
        let space = &shown.images[0].space;
        let mut scene = self.drawing.field(space, map, Key { scale, label: "peak per newton over its mean".into() });
        scene.title = format!("Sensitivity, {}", shown.name);
        scene.subtitle = format!("spread (sd over mean) {:.2}", shown.score.sensitivity_spread);
        scene
    }

    /// One image of a method with the true positions and the detected contacts.
    pub fn example(&self, title: &str, subtitle: &str, touches: &[Contact], shown: &Shown, frame: usize) -> Scene {
        let mut scene = self.drawing.image(&shown.images[frame], shown.quantity);
        self.drawing.add_contacts(&mut scene, &shown.contacts[frame]);
        self.drawing.add_touches(&mut scene, touches);
        scene.titled(title, subtitle)
    }

    /// A true change of conductance, with marks at the touches.
    pub fn truth_image(&self, title: &str, touches: &[Contact], image: &Image) -> Scene {
        let mut scene = self.drawing.image(image, Quantity::Change);
        self.drawing.add_touches(&mut scene, touches);
        scene.titled(title, "")
    }
}

/// True and estimated positions of touches.
pub fn localisation_scene(
    drawing: &Drawing<'_>,
    design: &SkinDesign,
    truth: &[Vec<Contact>],
    contacts: &[Vec<Contact>],
) -> Scene {
    let (mut pairs, mut false_positives) = (Vec::new(), Vec::new());
    for (touches, found) in truth.iter().zip(contacts) {
        let matched = match_contacts(touches, found, &design.body.surface());
        pairs.extend(matched.pairs.iter().map(|&(touch, contact, _)| (touches[touch], Some(found[contact]))));
        pairs.extend(matched.missed.iter().map(|&touch| (touches[touch], None)));
        false_positives.extend(matched.false_positives.iter().map(|&false_positive| found[false_positive]));
    }
    drawing.localisation(&pairs, &false_positives)
}

/// Four simultaneous touches, one of them on the seam, at fractions of the length of a cylinder and at angles; on the
/// paper's skin, the nearest two are 95 mm apart. `None` on a body that is not a cylinder.
pub fn four_touches(design: &SkinDesign, force_n: f64) -> Option<Vec<Contact>> {
    let dermis::geom::Surface::Cylinder { length_m, .. } = design.body.surface() else { return None };
    let surface = design.body.surface();
    let place = |part: f64, degrees: f64| {
        let at = surface.at(part * length_m, degrees.to_radians())?;
        Some(Contact::truth(at, surface.normal(at)?, force_n))
    };
    [(0.25, 2.0), (0.215 / 0.3, 64.0), (0.35, 148.0), (0.75, 260.0)]
        .map(|(part, at)| place(part, at))
        .into_iter()
        .collect()
}
