//! One sample, and its touches as named numbers.

/// One sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Its index.
    pub index: u64,
    /// The frame during the touches, ohm.
    pub frame: Vec<f32>,
    /// The untouched frame of the same skin, ohm.
    pub rest: Vec<f32>,
    /// The relative change of conductance, a mean per pixel, positive for any touch.
    pub image: Vec<f32>,
    /// The touches.
    pub touches: Vec<SampleTouch>,
}

/// A touch of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleTouch {
    /// Its centre on the surface, in the body's frame, m.
    pub centre_m: [f32; 3],
    /// The kind of touch.
    pub kind: TouchKind,
    /// The integral over the surface of the relative change of conductance by this touch alone, m2.
    pub strength_m2: f32,
}

/// The kind of a touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TouchKind {
    /// A Gaussian change of conductance.
    Gaussian {
        /// Standard deviation along the surface, m.
        width_m: f32,
        /// Relative change in the centre.
        amplitude: f32,
    },
    /// A press of a spherical tip.
    Press {
        /// Radius of the tip, m.
        tip_radius_m: f32,
        /// Force, N.
        force_n: f32,
    },
}

/// Number of values of a touch in a file.
pub const TOUCH_COLUMNS: usize = 6;

/// A touch as a row of a file: x, y, z (m), then width (m) and amplitude of a Gaussian, or radius of the tip (m) and
/// force (N) of a press, and the strength (m2). A row of `NaN` means no touch.
pub type TouchRow = [f32; TOUCH_COLUMNS];

impl SampleTouch {
    /// Its size: the force of a press (N), the strength of a Gaussian touch (cm2).
    pub fn size(&self) -> f32 {
        self.force_n().unwrap_or(self.strength_m2 * 1e4)
    }

    /// The force of a press, N; `None` for a Gaussian touch.
    pub(crate) fn force_n(&self) -> Option<f32> {
        match self.kind {
            TouchKind::Press { force_n, .. } => Some(force_n),
            TouchKind::Gaussian { .. } => None,
        }
    }

    /// The touch as a row of a file.
    pub fn row(&self) -> TouchRow {
        let [x, y, z] = self.centre_m;
        let [size, height] = match self.kind {
            TouchKind::Gaussian { width_m, amplitude } => [width_m, amplitude],
            TouchKind::Press { tip_radius_m, force_n } => [tip_radius_m, force_n],
        };
        [x, y, z, size, height, self.strength_m2]
    }

    /// The touches of a sample's rows; the rows after the last touch are `NaN`.
    pub(super) fn from_rows(values: &[f32], is_press: bool) -> Vec<Self> {
        let (rows, _) = values.as_chunks::<TOUCH_COLUMNS>();
        let touch = |&[x, y, z, size, height, strength_m2]: &TouchRow| SampleTouch {
            centre_m: [x, y, z],
            kind: match is_press {
                true => TouchKind::Press { tip_radius_m: size, force_n: height },
                false => TouchKind::Gaussian { width_m: size, amplitude: height },
            },
            strength_m2,
        };
        rows.iter().map(touch).filter(|touch| !touch.centre_m[0].is_nan()).collect()
    }
}

/// A point in single precision.
pub(super) fn single(point: [f64; 3]) -> [f32; 3] {
    point.map(|value| value as f32)
}
