//! Errors of localisation on the skin, as colours.

use crate::colour::{BLACK, Scale};
use crate::drawing::{CROWDED, Drawing, ElectrodeLook};
use crate::scene::{Dot, Key, Mark, Scene, Stroke};
use dermis::contact::Contact;
use dermis::geom::Point3;
use dermis::stats::Summary;

/// A true position with its estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressError {
    /// The press.
    pub truth: Contact,
    /// Its estimated position, m, and the error of the estimate, m; `None` if the press was missed.
    pub estimate: Option<(Point3, f64)>,
}

impl Drawing<'_> {
    /// True positions, coloured by the error of their estimates, with a line to each estimate. Colours end at the 95th
    /// percentile of the errors.
    ///
    /// ```
    /// use dermis::contact::Contact;
    /// use dermis::design::SkinDesign;
    /// use dermis::mesh::Mesh;
    /// use dermis_plot::{Drawing, PressError, View};
    ///
    /// let design = SkinDesign::shipped("skin16").expect("a shipped design");
    /// let mesh = Mesh::generate(&design)?;
    /// let truth = Contact::truth([0.01, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0);
    /// let press = PressError { truth, estimate: Some(([0.012, 0.0, 0.0], 0.002)) };
    /// let scene = Drawing::new(&design, &mesh).errors(&[press]);
    /// assert!(View::Unrolled.draw(&scene, &design)?.to_svg().contains(">error (mm)</text>"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn errors(&self, presses: &[PressError]) -> Scene {
        let mut scene = Scene { tiles: self.body_tiles(), ..Scene::default() };
        // Numbers would cover presses.
        self.add_electrodes(&mut scene, ElectrodeLook::Outlined { numbered: false });
        let errors_mm = || presses.iter().filter_map(|press| press.estimate).map(|(_, error_m)| 1e3 * error_m);
        let scale = Scale::sequential([0.0, Summary::of(&errors_mm().collect::<Vec<_>>()).p95]);
        let radius = if presses.len() > CROWDED { 2.2 } else { 3.6 };
        scene.strokes.extend(presses.iter().flat_map(|press| self.error_line(press, &scale)));
        // Large errors are drawn last, on top of the others.
        let mut order: Vec<&PressError> = presses.iter().collect();
        order.sort_by(|a, b| error_m(a).total_cmp(&error_m(b)));
        scene.dots.extend(order.into_iter().map(|press| self.error_dot(press, &scale, radius)));
        scene
            .legend
            .push((Mark::Disc(scale.colour(0.6 * scale.high), true), "true position, coloured by the error".into()));
        scene.legend.push((Mark::Line(scale.colour(0.6 * scale.high)), "line to the estimate".into()));
        if errors_mm().any(|error_mm| error_mm > scale.high) {
            let text = format!("{:.2} mm and more", scale.high);
            scene.legend.push((Mark::Disc(scale.colour(scale.high), true), text));
        }
        if presses.iter().any(|press| press.estimate.is_none()) {
            scene.legend.push((MISSED, "missed".into()));
        }
        scene.key = Some(Key { scale, label: "error (mm)".into() });
        scene
    }

    fn error_line(&self, press: &PressError, scale: &Scale) -> Vec<Stroke> {
        let Some((estimate_m, error_m)) = press.estimate else { return Vec::new() };
        self.line([press.truth.position_m, estimate_m], press.truth.normal, scale.colour(1e3 * error_m), 1.4)
    }

    fn error_dot(&self, press: &PressError, scale: &Scale, radius: f64) -> Dot {
        match press.estimate {
            Some((_, error_m)) => self.dot(&press.truth, radius, Mark::Disc(scale.colour(1e3 * error_m), true)),
            None => self.dot(&press.truth, radius + 1.5, MISSED),
        }
    }
}

/// The mark of a press without an estimate.
const MISSED: Mark = Mark::Cross(BLACK);

fn error_m(press: &PressError) -> f64 {
    press.estimate.map_or(f64::INFINITY, |(_, error_m)| error_m)
}
