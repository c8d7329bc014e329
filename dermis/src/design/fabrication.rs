//! What a workshop makes of a design: sizes of base, patches and foam, and the bores below the electrodes.

use crate::design::{Body, SkinDesign};
use crate::geom::vector::{Point3, distance, normalize, scale, sub};
use crate::protocol::MultiplexerInput;
#[cfg(feature = "schema")]
use schemars::JsonSchema;
use serde::Deserialize;

/// Sizes of the parts that a workshop makes. Lengths in m.
///
/// The paper prints the base, embeds the electrodes in it and leads the wires away underneath; it cuts fabric with a
/// laser and glues neoprene foam on it. It states no sizes of these parts: the defaults are common ones.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct FabricationOptions {
    /// Thickness of the base below the coat, m; default: 0.005.
    pub wall_m: f64,
    /// Diameter of the bore below each electrode, m; default: 0.003.
    pub bore_m: f64,
    /// Width of the wire channels in the inner face of the base, m; default: 0.003.
    pub channel_width_m: f64,
    /// Depth of the wire channels, m; 0: none; default: 0.002.
    pub channel_depth_m: f64,
    /// Length by which the base continues beyond the edges of the coat, m; 0: none; default: 0.
    pub flange_m: f64,
    /// Pitch of the fabric patches, m; on a body it is rounded so that a whole number of patches fits; default: 0.010.
    pub patch_pitch_m: f64,
    /// Width of the gaps between patches, m; default: 0.001.
    pub patch_gap_m: f64,
    /// Thickness of the foam, m; default: 0.002.
    pub foam_thickness_m: f64,
    /// Width of the cut of the laser or knife, m; default: 0.0002.
    pub kerf_m: f64,
    /// Angle at which the patterns of a cylinder are cut open, rad; default: 0.
    pub seam_theta_rad: f64,
    /// Width by which the foam and the drill template pass beyond the seam of a cylinder, m; default: 0.
    pub overlap_m: f64,
    /// Relative standard deviation of the sheet resistance that a coat reaches; default: 0.2.
    pub sheet_spread: f64,
    /// Relative standard deviation of the contact impedances, one from the other; default: 0.3.
    pub contact_spread: f64,
    /// Multiplexers of 32 inputs on each of the four lines; default: as many as needed.
    pub multiplexers: Option<usize>,
    /// Place of each electrode on the multiplexers: 32 times the multiplexer, and its input; default: the electrode's
    /// number, and one more from 31 on, where the reference resistor is.
    pub inputs: Option<Vec<usize>>,
}

impl Default for FabricationOptions {
    fn default() -> Self {
        FabricationOptions {
            // A tube of this wall prints on any machine, and a bore is longer than wide, so that it holds a pin upright.
            wall_m: 0.005,
            // The shank of an M3 screw.
            bore_m: 0.003,
            // Three wires of 1 mm beside each other.
            channel_width_m: 0.003,
            channel_depth_m: 0.002,
            flange_m: 0.0,
            // 30 rows on the paper's skin, which has 30 rows of pixels.
            patch_pitch_m: 0.010,
            patch_gap_m: 0.001,
            // As the shipped twins.
            foam_thickness_m: 0.002,
            // Lasers cut 0.1 to 0.3 mm wide.
            kerf_m: 0.0002,
            seam_theta_rad: 0.0,
            overlap_m: 0.0,
            // Sprayed coats differ by a few ten per cent from one to the next.
            sheet_spread: 0.2,
            // As the shipped twin `lab`.
            contact_spread: 0.3,
            multiplexers: None,
            inputs: None,
        }
    }
}

impl FabricationOptions {
    /// Least distance of a bore from an edge of the base and from its neighbours, m: two lines of the common nozzle of
    /// 0.4 mm, rounded up.
    pub const MIN_LAND_M: f64 = 0.001;

    /// Distance from the edge of the base that the centre of a bore needs, m.
    pub fn edge_m(&self) -> f64 {
        0.5 * self.bore_m + Self::MIN_LAND_M
    }

    /// Rows or columns of patches along a length, and their pitch, m.
    pub fn patches_along(&self, length_m: f64) -> (usize, f64) {
        let count = (length_m / self.patch_pitch_m).round().max(1.0);
        (count as usize, length_m / count)
    }

    /// The place of the bore of an electrode on the surface: its centre, or the nearest place that is far enough from the
    /// base's edge. A flange longer than that distance keeps the centre. On a body known only by its mesh the centre.
    pub(crate) fn bore_centre_m(&self, body: &Body, centre_m: Point3) -> Point3 {
        let edge_m = (self.edge_m() - self.flange_m).max(0.0);
        let [x, y, z] = centre_m;
        let inside = |value: f64, size_m: f64| value.max(edge_m).min(size_m - edge_m);
        match *body {
            Body::Cylinder { length_m, .. } => [x, y, inside(z, length_m)],
            Body::Disk { diameter_m } => {
                let (radius_m, most_m) = (x.hypot(y), 0.5 * diameter_m - edge_m);
                if radius_m <= most_m { centre_m } else { [x * most_m / radius_m, y * most_m / radius_m, z] }
            }
            Body::Rectangle { width_m, height_m } => [inside(x, width_m), inside(y, height_m), z],
            Body::Mesh { .. } => centre_m,
        }
    }
}

/// The pair of bores with the least land between them at the inner face of the base, and this land, m. Places and outward
/// normals are those of the bores; `None` for fewer than two.
pub fn closest_bores(bores: &[(Point3, Point3)], options: &FabricationOptions) -> Option<(usize, usize, f64)> {
    let inner: Vec<Point3> =
        bores.iter().map(|&(centre_m, normal)| sub(centre_m, scale(normalize(normal), options.wall_m))).collect();
    let pairs = (0..bores.len()).flat_map(|j| (0..j).map(move |i| (i, j)));
    let land = |(i, j): (usize, usize)| {
        let apart_m = distance(inner[i], inner[j]).min(distance(bores[i].0, bores[j].0));
        (i, j, apart_m - options.bore_m)
    };
    pairs.map(land).min_by(|a, b| a.2.total_cmp(&b.2))
}

impl SkinDesign {
    /// What a workshop makes: the design's, or the default.
    pub fn fabrication_options(&self) -> FabricationOptions {
        self.fabrication.clone().unwrap_or_default()
    }

    /// The place of each electrode on the multiplexers.
    pub fn multiplexer_inputs(&self) -> Vec<MultiplexerInput> {
        match self.fabrication.as_ref().and_then(|options| options.inputs.as_ref()) {
            Some(inputs) => inputs.iter().map(|&number| MultiplexerInput::numbered(number)).collect(),
            None => (0..self.electrodes.len()).map(MultiplexerInput::usual).collect(),
        }
    }

    /// Name of the frame that positions are in, for robots: the design's name with `_` for what is neither a letter or
    /// digit of ASCII nor `_`.
    pub fn frame_id(&self) -> String {
        self.name.replace(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_', "_")
    }

    /// The bores of a body whose surface is known: the centre on the surface and the outward normal of each. `None` for
    /// a body known only by its mesh.
    pub fn bores(&self) -> Option<Vec<(Point3, Point3)>> {
        let (options, surface) = (self.fabrication_options(), self.body.surface());
        let bore = |centre_m: Point3| {
            let centre_m = options.bore_centre_m(&self.body, centre_m);
            Some((centre_m, surface.normal(centre_m)?))
        };
        self.electrodes.iter().map(|electrode| bore(electrode.centre_m)).collect()
    }
}
