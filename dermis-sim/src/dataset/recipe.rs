//! The distributions from which the samples of a dataset are drawn.

use crate::dataset::DatasetError;
use crate::twin::{CoatOptions, ElectrodeOptions, FORCES_N, PatchOptions, TIP_RADII_M, TouchOptions, TwinOptions};
use dermis::design::{SkinDesign, TouchEffect};
use dermis::files::exactly;
use dermis::files::{MAX_SETTINGS_BYTES, read_text_at_most};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Maximum number of touches of a sample: more than the ten fingers of two hands are a typing error.
pub const MAX_TOUCHES: usize = 16;

/// All parameters of the samples, besides the design and its mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The seed: sample `i` depends only on `(seed, i)`.
    pub seed: u64,
    /// Number of samples.
    pub samples: u64,
    /// The effect and the distributions of touches.
    pub touch: Touch,
    /// Whether the samples are of one skin or of many.
    pub skins: Skins,
}

/// Whether the samples are of one skin or of many.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Skins {
    /// The exact design.
    Even,
    /// Another skin for every 16 samples, drawn from the seed.
    Random(SkinSpread),
}

/// The random differences of the skins of one design.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkinSpread {
    /// The coating.
    pub coat: CoatOptions,
    /// The electrodes.
    pub electrodes: ElectrodeOptions,
    /// The patches of a skin, for touches that are presses: minimum and maximum number of rows, uniformly distributed
    /// (the pitch follows from it); the grid's offset is uniform over a pitch.
    #[serde(deserialize_with = "exactly")]
    pub patch_rows: [usize; 2],
    /// Columns, in the same way.
    #[serde(deserialize_with = "exactly")]
    pub patch_columns: [usize; 2],
}

impl SkinSpread {
    /// The values of the twin `lab`: coating 10 % rms at 40 mm, electrodes 0.5 mm rms, contact
    /// impedance 30 %; patches in 28 to 32 rows and 29 to 33 columns.
    pub fn usual() -> Self {
        SkinSpread {
            coat: CoatOptions { rms: 0.1, correlation_m: 0.04 },
            electrodes: ElectrodeOptions { displacement_rms_m: 5e-4, contact_impedance_rms: 0.3 },
            patch_rows: [28, 32],
            patch_columns: [29, 33],
        }
    }

    /// The [usual](Self::usual) values for a design: electrodes on a body from a mesh file are not moved.
    pub fn for_design(design: &SkinDesign) -> Self {
        let mut spread = Self::usual();
        if design.body.chart().is_none() {
            spread.electrodes.displacement_rms_m = 0.0;
        }
        spread
    }

    fn check(&self) -> Result<(), DatasetError> {
        for (what, [fewest, most]) in
            [("the rows of patches", self.patch_rows), ("the columns of patches", self.patch_columns)]
        {
            check_range(what, [fewest as f64, most as f64], [1.0, 1000.0])?;
        }
        Ok(())
    }
}

/// The effect and the distributions of touches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Touch {
    /// Gaussian changes of conductance, as in the paper's training.
    Gaussian(GaussianTouches),
    /// Presses on fabric patches under foam: [`PatchedSkin`](crate::twin::PatchedSkin).
    Patch(PatchTouches),
}

/// Ranges of the numbers of touches: outside, a number is in another unit, or a sample takes minutes.
const DISTANCES_M: [f64; 2] = [1e-6, 100.0];
const WIDTHS_M: [f64; 2] = [1e-4, 100.0];
const AMPLITUDES: [f64; 2] = [1e-9, 1e6];

/// Presses next to the one before.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Together {
    /// The fraction of the presses after the first that are next to the one before.
    pub share: f64,
    /// Minimum and maximum distance from it, m; uniform between. A press that would be off the body is placed at
    /// random.
    #[serde(deserialize_with = "exactly")]
    pub distance_m: [f64; 2],
}

/// Presses of a spherical tip on a skin with patches. Their positions are uniform by area over the whole surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatchTouches {
    /// A sample has 1 to this many presses, uniformly distributed.
    pub most: usize,
    /// Lowest and highest force, N; uniform in its logarithm between.
    #[serde(deserialize_with = "exactly")]
    pub force_n: [f64; 2],
    /// Lowest and highest radius of the tip, m; uniform between.
    #[serde(deserialize_with = "exactly")]
    pub tip_radius_m: [f64; 2],
    /// The patches; on random skins their rows, columns and offset differ.
    pub patches: PatchOptions,
    /// Presses next to each other; by default all positions are independent, and presses are rarely near each other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub together: Option<Together>,
}

impl Touch {
    /// The usual touches of a design: presses on patches where they have rows and columns and raise the conductance, or else
    /// Gaussian ones.
    pub fn for_design(design: &SkinDesign) -> Self {
        let effect = design.sheet.touch;
        match design.body.chart() {
            Some(_) if effect == TouchEffect::ConductanceRises => Touch::Patch(PatchTouches::usual()),
            _ => Touch::Gaussian(GaussianTouches::for_effect(effect)),
        }
    }
}

impl PatchTouches {
    /// The patches of the twin `lab`; 1 to 4 presses of 1 to 5 N with tips of 4 to 8 mm.
    pub fn usual() -> Self {
        let lab = TwinOptions::shipped("lab").map(|twin| twin.touch);
        let Some(TouchOptions::Patches(patches)) = lab else { panic!("the twin `lab` is shipped and has patches") };
        PatchTouches { most: 4, force_n: [1.0, 5.0], tip_radius_m: [0.004, 0.008], patches, together: None }
    }

    fn check(&self, effect: TouchEffect) -> Result<(), DatasetError> {
        check_count(self.most)?;
        check_range("the force of presses in N", self.force_n, FORCES_N)?;
        check_range("the radius of the tip in m", self.tip_radius_m, TIP_RADII_M)?;
        if let Some(together) = &self.together {
            check_range("the distance of presses side by side in m", together.distance_m, DISTANCES_M)?;
            if !(0.0..=1.0).contains(&together.share) {
                let what = "the share of presses side by side";
                return Err(DatasetError::OutOfRange { what, value: together.share, must: "0 to 1".into() });
            }
        }
        if let Some(field) = self.patches.kept_for_evaluation() {
            return Err(DatasetError::KeptForEvaluation { field });
        }
        match effect {
            TouchEffect::ConductanceRises => Ok(()),
            TouchEffect::ConductanceFalls => Err(DatasetError::OutOfRange {
                what: "the sign of touches",
                value: -1.0,
                must: "1 with patches, which raise the conductance: use Gaussian touches".into(),
            }),
        }
    }
}

/// Gaussian touches: `1 + sum of A exp(-d^2 / (2 w^2))` times the untouched conductance, with a minus sign if touches
/// lower it. Their positions are uniform by area over the whole surface, rim and seam included.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaussianTouches {
    /// A sample has 1 to this many touches, uniformly distributed.
    pub most: usize,
    /// Lowest and highest width `w` (standard deviation along the surface), m; uniform between.
    #[serde(deserialize_with = "exactly")]
    pub width_m: [f64; 2],
    /// Lowest and highest amplitude `A`, the relative change in the centre; uniform in its logarithm between.
    #[serde(deserialize_with = "exactly")]
    pub amplitude: [f64; 2],
}

impl GaussianTouches {
    /// 1 to 4 touches, 5 to 15 mm wide: from half of the paper's patch to the heel of a hand. Amplitudes from 0.1 to 2
    /// if touches raise the conductance; from 0.05 to 0.2 if they lower it, so that four at one position leave a
    /// positive conductance.
    pub fn for_effect(effect: TouchEffect) -> Self {
        let amplitude = match effect {
            TouchEffect::ConductanceRises => [0.1, 2.0],
            TouchEffect::ConductanceFalls => [0.05, 0.2],
        };
        GaussianTouches { most: 4, width_m: [0.005, 0.015], amplitude }
    }

    /// All checks that need no mesh.
    ///
    /// # Errors
    /// A number that is invalid for a touch; amplitudes that could leave no conductance.
    pub(crate) fn check(&self, effect: TouchEffect) -> Result<(), DatasetError> {
        check_count(self.most)?;
        check_range("the width of touches in m", self.width_m, WIDTHS_M)?;
        check_range("the amplitude of touches", self.amplitude, AMPLITUDES)?;
        let strongest = self.most as f64 * self.amplitude[1];
        if effect == TouchEffect::ConductanceFalls && strongest >= 1.0 {
            return Err(DatasetError::OutOfRange {
                what: "the most touches times their highest amplitude",
                value: strongest,
                must: "below 1 where touches lower the conductance, or nothing of it may be left".into(),
            });
        }
        Ok(())
    }
}

fn check_count(most: usize) -> Result<(), DatasetError> {
    if (1..=MAX_TOUCHES).contains(&most) {
        return Ok(());
    }
    let must = format!("1 to {MAX_TOUCHES}");
    Err(DatasetError::OutOfRange { what: "the most touches of a sample", value: most as f64, must })
}

fn check_range(what: &'static str, [low, high]: [f64; 2], [least, most]: [f64; 2]) -> Result<(), DatasetError> {
    for value in [low, high] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(DatasetError::OutOfRange { what, value, must: "positive and finite".into() });
        }
        if !(least..=most).contains(&value) {
            return Err(DatasetError::OutOfRange { what, value, must: format!("from {least} to {most}") });
        }
    }
    if high < low {
        let must = format!("at least {low} at its upper end, the lower end");
        return Err(DatasetError::OutOfRange { what, value: high, must });
    }
    Ok(())
}

/// A recipe file: the parts that do not depend on the number of samples.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RecipeFile {
    touch: Touch,
    skins: Skins,
}

impl Recipe {
    /// Reads the touches and the skins of a recipe from a TOML file.
    ///
    /// # Errors
    /// A file that cannot be read or is not a recipe, with the line.
    pub fn load(path: &Path, seed: u64, samples: u64) -> Result<Self, DatasetError> {
        let io = |source| DatasetError::Io { path: path.to_path_buf(), source };
        Self::parse(&read_text_at_most(path, MAX_SETTINGS_BYTES).map_err(io)?, path, seed, samples)
    }

    /// The same from the text of such a file; its path is for messages.
    ///
    /// # Errors
    /// A text that is not a recipe, with the line.
    pub fn parse(text: &str, path: &Path, seed: u64, samples: u64) -> Result<Self, DatasetError> {
        let wrong =
            |error: toml::de::Error| DatasetError::File { path: path.to_path_buf(), message: error.to_string() };
        let RecipeFile { touch, skins } = toml::from_str(text).map_err(wrong)?;
        Ok(Recipe { seed, samples, touch, skins })
    }

    /// All checks that need no mesh.
    ///
    /// # Errors
    /// No samples; numbers that are invalid for a touch.
    pub fn check(&self, effect: TouchEffect) -> Result<(), DatasetError> {
        if self.samples == 0 {
            return Err(DatasetError::OutOfRange {
                what: "the number of samples",
                value: 0.0,
                must: "at least 1".into(),
            });
        }
        if let Skins::Random(spread) = &self.skins {
            spread.check()?;
        }
        match &self.touch {
            Touch::Gaussian(touches) => touches.check(effect),
            Touch::Patch(touches) => touches.check(effect),
        }
    }

    /// Whether touches are presses, which have a force.
    pub(crate) fn has_presses(&self) -> bool {
        matches!(self.touch, Touch::Patch(_))
    }

    /// Maximum number of touches of a sample.
    pub fn most_touches(&self) -> usize {
        match &self.touch {
            Touch::Gaussian(touches) => touches.most,
            Touch::Patch(touches) => touches.most,
        }
    }
}
