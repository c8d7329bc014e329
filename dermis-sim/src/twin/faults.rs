//! Faults of a skin.

use super::TwinError;
use super::electronics::{out_of_range, positive};
use crate::elementary::unrolled;
use dermis::design::{Body, SkinDesign};
use dermis::files::exactly;
use dermis::forward::ElectrodeNetwork;
use dermis::geom::{Point2, Point3, Surface};
use dermis::mesh::{Cells, Mesh};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Faults of a skin; none by default.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FaultOptions {
    /// Electrodes that are detached from the coating, by number.
    pub dead_electrodes: Vec<usize>,
    /// Electrodes with loose contact, by number.
    pub loose_electrodes: Vec<usize>,
    /// Contact impedance of a loose electrode over that of a good one.
    pub loose_factor: f64,
    /// Electrodes with a broken wire, by number. They are still on the coating.
    pub torn_wires: Vec<usize>,
    /// Cuts through the coating.
    pub cuts: Vec<CutOptions>,
    /// Pairs of wires that touch.
    pub shorts: Vec<ShortOptions>,
    /// Pairs of wires, by electrode, that are exchanged at the instrument.
    pub exchanged_wires: Vec<[usize; 2]>,
    /// Reference resistors of another value than the instrument expects.
    pub references: Vec<ReferenceOptions>,
}

/// Two wires that touch.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShortOptions {
    /// Their electrodes, by number.
    #[serde(deserialize_with = "exactly")]
    pub electrodes: [usize; 2],
    /// Resistance between them, ohm.
    pub ohm: f64,
}

/// A reference resistor of another value than the instrument expects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceOptions {
    /// The drive that uses it, by its place in the protocol; that of all drives if this is missing.
    pub drive: Option<usize>,
    /// Its resistance over the expected one. The values of the drive are divided by it.
    pub factor: f64,
}

/// A straight cut through the coating, as thin as the cells of the mesh allow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CutOptions {
    /// Start point, m: (z, s = radius * theta) on a cylinder, (x, y) on a flat skin.
    #[serde(deserialize_with = "exactly")]
    pub from_m: [f64; 2],
    /// End point, m.
    #[serde(deserialize_with = "exactly")]
    pub to_m: [f64; 2],
}

/// Contact impedance of a detached electrode over that of one on the coating: about 40 Mohm for a disc of 4 mm, the
/// insulation of dry air and board between them.
const DEAD_FACTOR: f64 = 1e8;

/// Insulation resistance of a broken wire, ohm.
const TORN_OHM: f64 = 1e8;

/// Remaining fraction of the coating's conductance in the cells of a cut.
const CUT_SHARE: f64 = 1e-6;

impl FaultOptions {
    /// Whether there is no fault.
    pub fn none(&self) -> bool {
        let lists = [&self.dead_electrodes, &self.loose_electrodes, &self.torn_wires];
        let wires = self.shorts.is_empty() && self.exchanged_wires.is_empty() && self.references.is_empty();
        lists.iter().all(|list| list.is_empty()) && self.cuts.is_empty() && wires
    }

    pub(super) fn check(&self, design: &SkinDesign) -> Result<(), TwinError> {
        self.check_ranges()?;
        let electrode_count = design.electrodes.len();
        let shorted: Vec<usize> = self.shorts.iter().flat_map(|short| short.electrodes).collect();
        let exchanged: Vec<usize> = self.exchanged_wires.iter().flatten().copied().collect();
        for (field, list) in [
            ("faults.dead_electrodes", &self.dead_electrodes),
            ("faults.loose_electrodes", &self.loose_electrodes),
            ("faults.torn_wires", &self.torn_wires),
            ("faults.shorts", &shorted),
            ("faults.exchanged_wires", &exchanged),
        ] {
            if let Some(&electrode) = list.iter().find(|&&electrode| electrode >= electrode_count) {
                return Err(TwinError::NoSuchElectrode { field, electrode, electrode_count });
            }
        }
        if !self.cuts.is_empty() && matches!(design.body, Body::Mesh { .. }) {
            return Err(TwinError::CutOnMesh);
        }
        let drives = design.protocol.drives().0.len();
        if let Some(drive) = self.references.iter().filter_map(|one| one.drive).find(|&drive| drive >= drives) {
            let must = format!("a drive from 0 to {}", drives - 1);
            return Err(out_of_range("faults.references", drive as f64, must, "leave `drive` out for all drives"));
        }
        Ok(())
    }

    pub(super) fn check_ranges(&self) -> Result<(), TwinError> {
        let possible = self.loose_factor >= 1.0 && self.loose_factor.is_finite();
        if !(self.loose_electrodes.is_empty() || possible) {
            return Err(TwinError::OutOfRange {
                field: "faults.loose_factor",
                value: self.loose_factor,
                must: "1 or more, and finite".into(),
                fix: "how many times the contact impedance of a sound electrode".into(),
            });
        }
        for short in &self.shorts {
            positive("faults.shorts", short.ohm)?;
        }
        for reference in &self.references {
            positive("faults.references", reference.factor)?;
        }
        let pairs = self.shorts.iter().map(|short| ("faults.shorts", short.electrodes));
        let pairs = pairs.chain(self.exchanged_wires.iter().map(|&pair| ("faults.exchanged_wires", pair)));
        if let Some((field, [electrode, _])) = pairs.into_iter().find(|(_, [a, b])| a == b) {
            let fix = "name the two electrodes";
            return Err(out_of_range(field, electrode as f64, "a pair of two different electrodes".into(), fix));
        }
        let coordinates = self.cuts.iter().flat_map(|cut| cut.from_m.into_iter().chain(cut.to_m));
        match coordinates.into_iter().find(|coordinate| !coordinate.is_finite()) {
            Some(value) => Err(TwinError::OutOfRange {
                field: "faults.cuts",
                value,
                must: "finite".into(),
                fix: "m along the surface".into(),
            }),
            None => Ok(()),
        }
    }

    /// The contact impedance of each electrode with its faults.
    pub(super) fn contact_factor(&self, electrode: usize) -> f64 {
        if self.dead_electrodes.contains(&electrode) {
            DEAD_FACTOR
        } else if self.loose_electrodes.contains(&electrode) {
            self.loose_factor
        } else {
            1.0
        }
    }

    /// The series resistance of an electrode, ohm.
    pub(super) fn series_ohm(&self, electrode: usize) -> f64 {
        if self.torn_wires.contains(&electrode) { TORN_OHM } else { 0.0 }
    }

    /// The network of the skin at the instrument's terminals: with its wires.
    pub(super) fn wired(&self, mut network: ElectrodeNetwork) -> ElectrodeNetwork {
        for short in &self.shorts {
            network = network.with_resistance_between(short.electrodes, short.ohm);
        }
        self.exchanged_wires.iter().fold(network, |network, &pair| network.exchanged(pair))
    }

    /// The reference resistor of a drive over the expected one.
    pub(super) fn reference_factor(&self, drive: usize) -> f64 {
        let used = self.references.iter().filter(|one| one.drive.is_none_or(|own| own == drive));
        used.map(|one| one.factor).product()
    }

    /// Cuts the coating: reduces the conductance of each cell on the cut.
    pub(super) fn cut(&self, surface: Surface, mesh: &Mesh, conductivity: &mut [f64]) {
        let Cells::Triangles(triangles) = &mesh.cells else { return };
        for cut in &self.cuts {
            for (value, corners) in conductivity.iter_mut().zip(triangles) {
                if cut.crosses(surface, corners.map(|node| mesh.nodes[node])) {
                    *value *= CUT_SHARE;
                }
            }
        }
    }
}

impl CutOptions {
    /// Whether the cut crosses a triangle, in the chart of the surface.
    fn crosses(&self, surface: Surface, corners: [Point3; 3]) -> bool {
        let chart = unrolled(&surface);
        let first = chart.unroll(corners[0]);
        let corners = corners.map(|corner| chart.unroll_beside(first, corner));
        let Some(round_m) = chart.period_m() else { return segment_intersects([self.from_m, self.to_m], corners) };
        let corners = corners.map(|[round, along]| [along, round]);
        let low = ((self.from_m[1].min(self.to_m[1]) - round_m) / round_m).floor() as i64;
        let high = ((self.from_m[1].max(self.to_m[1]) + round_m) / round_m).ceil() as i64;
        (low..=high).any(|turn| {
            let shifted = [self.from_m, self.to_m].map(|[z, s]| [z, s - turn as f64 * round_m]);
            segment_intersects(shifted, corners)
        })
    }
}

/// Whether a segment has a point in common with a triangle.
fn segment_intersects(segment: [Point2; 2], triangle: [Point2; 3]) -> bool {
    let inside = |p: Point2| {
        let sides = [0, 1, 2].map(|i| turn(triangle[i], triangle[(i + 1) % 3], p));
        sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
    };
    let crosses = |i: usize| {
        let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
        turn(a, b, segment[0]) * turn(a, b, segment[1]) <= 0.0
            && turn(segment[0], segment[1], a) * turn(segment[0], segment[1], b) <= 0.0
    };
    segment.into_iter().any(inside) || (segment[0] != segment[1] && (0..3).any(crosses))
}

/// Twice the signed area of a triangle.
fn turn(a: Point2, b: Point2, c: Point2) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
