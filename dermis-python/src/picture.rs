//! Pictures as SVG.

use crate::failure::{Failure, Outcome};
use crate::worker;
use dermis::contact::Contact;
use dermis::image::Image;
use dermis::reconstruct::Quantity;
use dermis::skin::Skin;
use dermis_plot::{Drawing, PlotError, Scene, View};
use pyo3::prelude::*;

/// A picture of a skin.
pub fn of_skin(py: Python<'_>, skin: &Skin, what: &str) -> Outcome<String> {
    let drawing = Drawing::new(skin.design(), skin.mesh());
    let scene = match what {
        "electrodes" => drawing.electrodes(),
        "mesh" => drawing.mesh(),
        "sensitivity" => {
            let linearised = worker::run(py, "computing the Jacobian", 1, |_| Ok(skin.linearised()?))?;
            drawing.sensitivity(skin.pixels(), &linearised.sensitivity(skin.pixels()))
        }
        _ => {
            let hint = "give \"electrodes\", \"mesh\" or \"sensitivity\"";
            return Err(Failure::with_hint(format!("`what` is {what:?}"), hint));
        }
    };
    draw(skin, &scene.titled(skin.design().name.clone(), what))
}

/// An image with its contacts.
pub fn of_image(skin: &Skin, image: &Image, quantity: Quantity, contacts: &[Contact]) -> Outcome<String> {
    let drawing = Drawing::new(skin.design(), skin.mesh());
    let mut scene = drawing.image(image, quantity);
    drawing.add_contacts(&mut scene, contacts);
    draw(skin, &scene)
}

fn draw(skin: &Skin, scene: &Scene) -> Outcome<String> {
    Ok(View::of(scene, skin.design()).draw(scene, skin.design())?.to_svg())
}

impl From<PlotError> for Failure {
    fn from(error: PlotError) -> Self {
        Failure::given(error)
    }
}
