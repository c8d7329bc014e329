//! The skin of a command, and conductivity maps for it.

use crate::console::{Progress, warn};
use crate::failure::{Failure, Outcome};
use clap::ValueEnum;
use dermis::contact::Contact;
use dermis::frame::{Truth, read_conductivities};
use dermis::skin::Skin;
use dermis::text::{number_of, ranges};
use std::path::Path;

/// Elements of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Per {
    /// Each pixel of the design's image.
    Pixel,
    /// Each cell of the mesh.
    Cell,
}

/// Prepares the skin of a design, by name or by path.
pub fn load(design: &str) -> Outcome<Skin> {
    let _waiting = Progress::waiting("preparing the skin");
    Ok(Skin::load(design)?)
}

/// Warns of a protocol that cannot tell places apart.
pub fn warn_if_ambiguous(skin: &Skin) -> Outcome {
    if let Some(found) = skin.ambiguity()? {
        warn(&format!("{}: {}; {}", skin.design().name, found.evidence, found.fix));
    }
    Ok(())
}

/// Touches farther off the body than this are warned of, m: measured places and the width of a tip differ by less.
const OFF_BODY_M: f64 = 0.005;

/// Reads the truth of some frames. Warns of touches off the body.
pub fn read_truth(skin: &Skin, path: &Path, frames: usize) -> Outcome<Truth> {
    let limits = skin.place_limits();
    let truth = dermis::frame::read_truth(path, &limits, frames)?;
    if let Truth::OnSkin(touches) = &truth {
        let off_m = |touches: &Vec<Contact>| {
            touches.iter().map(|touch| limits.distance_m(touch.position_m)).fold(0.0, f64::max)
        };
        let off_m: Vec<f64> = touches.iter().map(off_m).collect();
        let rows: Vec<usize> = (0..off_m.len()).filter(|&frame| off_m[frame] > OFF_BODY_M).collect();
        if !rows.is_empty() {
            let most_mm = 1e3 * off_m.iter().fold(0.0, |most: f64, &off_m| most.max(off_m));
            warn(&format!(
                "{}: touches of the {} lie off the body, by up to {most_mm:.0} mm: check the origin and the axes",
                path.display(),
                number_of(rows.len(), "frame") + " " + &ranges(&rows)
            ));
        }
    }
    Ok(truth)
}

/// Conductivity maps from a file, or the untouched skin without one.
pub fn conductivities(skin: &Skin, path: Option<&Path>) -> Outcome<Vec<Vec<f64>>> {
    match path {
        Some(path) => Ok(read_conductivities(path, skin.mesh().cell_count())?),
        None => Ok(vec![skin.forward().rest_conductivity().to_vec()]),
    }
}

/// The only conductivity map of a file, or the untouched skin without one.
pub fn conductivity(skin: &Skin, path: Option<&Path>) -> Outcome<Vec<f64>> {
    let mut maps = conductivities(skin, path)?;
    if maps.len() > 1 {
        let message = format!("{} maps of conductivity, but a Jacobian belongs to one", maps.len());
        return Err(Failure::given(message, Some("give a file with one row")));
    }
    Ok(maps.remove(0))
}
