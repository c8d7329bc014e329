//! Symmetries of a skin, by which the touches of samples are moved.

use dermis::design::{Body, SkinDesign};
use dermis::geom::Point3;
use dermis::protocol::{Pair, Protocol};
use dermis_sim::elementary::{atan2, hypot, sin_cos};
use std::collections::HashMap;

/// Electrodes closer than this are the same, m.
const SAME_M: f64 = 1e-6;

/// The symmetries of a skin: at least the identity.
#[derive(Debug, Clone)]
pub struct Symmetries {
    elements: Vec<Symmetry>,
    drives: Vec<[usize; 4]>,
    electrodes: usize,
    /// For each pair of neighbours in the ring of electrodes (drive, measure) its channel.
    channel_of: Vec<Option<usize>>,
}

/// One symmetry.
#[derive(Debug, Clone)]
struct Symmetry {
    motion: Motion,
    /// For each electrode the index of the electrode that is mapped to it.
    from: Vec<usize>,
}

#[derive(Debug, Clone, Copy)]
enum Motion {
    /// On a cylinder: theta becomes `turn_rad + sign theta`, z optionally the length minus z.
    Cylinder { turn_rad: f64, sign: f64, flips_m: Option<f64> },
    /// In the plane: a rotation about the origin, after y is multiplied by `sign`.
    Disk { turn_rad: f64, sign: f64 },
    /// In the plane: mirrored about the middle of either axis.
    Rectangle { flips_m: [Option<f64>; 2] },
}

impl Motion {
    fn apply(&self, [x, y, z]: Point3) -> Point3 {
        match *self {
            Motion::Cylinder { turn_rad, sign, flips_m } => {
                let radius_m = hypot(x, y);
                let (sine, cosine) = sin_cos(turn_rad + sign * atan2(y, x));
                [radius_m * cosine, radius_m * sine, flips_m.map_or(z, |length_m| length_m - z)]
            }
            Motion::Disk { turn_rad, sign } => {
                let (sine, cosine) = sin_cos(turn_rad);
                [cosine * x - sine * sign * y, sine * x + cosine * sign * y, z]
            }
            Motion::Rectangle { flips_m: [across, along] } => {
                [across.map_or(x, |size_m| size_m - x), along.map_or(y, |size_m| size_m - y), z]
            }
        }
    }
}

impl Symmetries {
    /// The symmetries of a design with adjacent drives and all other adjacent measures, so that the voltage between any
    /// two electrodes for a current through any two follows from a frame. Any other protocol has only the identity.
    pub fn of(design: &SkinDesign, protocol: &Protocol) -> Self {
        let electrodes = protocol.electrode_count();
        let channel_of = neighbours(protocol).unwrap_or_default();
        let places: Vec<Point3> = design.electrodes.iter().map(|electrode| electrode.centre_m).collect();
        let candidates = if channel_of.is_empty() { vec![] } else { motions(&design.body, &places) };
        let mut elements: Vec<Symmetry> = Vec::new();
        for motion in candidates {
            if let Some(from) = permutation(&motion, &places)
                && !elements.iter().any(|other| other.from == from)
            {
                elements.push(Symmetry { motion, from });
            }
        }
        let drive = |channel: &dermis::protocol::Channel| {
            [channel.drive[0], channel.drive[1], channel.measure[0], channel.measure[1]]
        };
        Symmetries { elements, drives: protocol.channels().iter().map(drive).collect(), electrodes, channel_of }
    }

    /// Number of symmetries.
    pub fn len(&self) -> usize {
        self.elements.len().max(1)
    }

    /// Always false: the identity is always included.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The image of a point under a symmetry.
    pub fn point(&self, element: usize, point: Point3) -> Point3 {
        self.elements.get(element).map_or(point, |symmetry| symmetry.motion.apply(point))
    }

    /// The frame of a skin transformed by a symmetry, from the frame of the skin: transfer resistances follow their
    /// electrodes. Frames must be free of noise: each result is a sum of several values.
    pub fn frame(&self, element: usize, frame: &[f32], moved: &mut [f32]) {
        let Some(symmetry) = self.elements.get(element) else { return moved.copy_from_slice(frame) };
        let count = self.electrodes;
        // [d][k]: the potential of electrode 0 minus that of electrode k for a current into 0 and out of d.
        let mut potential = vec![0.0f64; count * count];
        let mut steps = vec![0.0f64; count];
        for drive in 0..count - 1 {
            for (measure, step) in steps.iter_mut().enumerate() {
                let channel = self.channel_of[drive * count + measure];
                *step = channel.map_or(0.0, |channel| f64::from(frame[channel]));
            }
            // The voltages around the ring sum to zero, which gives the one that is not measured.
            steps[drive] = -steps.iter().sum::<f64>();
            let mut sum = 0.0;
            for measure in 0..count {
                potential[(drive + 1) * count + measure] = potential[drive * count + measure] + sum;
                sum += steps[measure];
            }
        }
        let voltage = |[a, b, c, d]: [usize; 4]| {
            let at = |drive: usize, measure: usize| potential[drive * count + measure];
            at(b, d) - at(b, c) - at(a, d) + at(a, c)
        };
        for (value, channel) in moved.iter_mut().zip(&self.drives) {
            *value = voltage(channel.map(|electrode| symmetry.from[electrode])) as f32;
        }
    }
}

/// For each (drive, measure) of neighbours in the ring the channel; `None` if one other than the drive's own is
/// missing.
fn neighbours(protocol: &Protocol) -> Option<Vec<Option<usize>>> {
    let count = protocol.electrode_count();
    let numbers: HashMap<(Pair, Pair), usize> = protocol
        .channels()
        .iter()
        .enumerate()
        .map(|(number, channel)| ((channel.drive, channel.measure), number))
        .collect();
    let pair = |first: usize| -> Pair { [first, (first + 1) % count] };
    if protocol.amplitude_only() || count < 3 {
        return None;
    }
    (0..count * count)
        .map(|at| match (at / count, at % count) {
            (drive, measure) if drive == measure => Some(None),
            (drive, measure) => numbers.get(&(pair(drive), pair(measure))).map(|&number| Some(number)),
        })
        .collect()
}

fn motions(body: &Body, places: &[Point3]) -> Vec<Motion> {
    let angle = |place: Point3| atan2(place[1], place[0]);
    let mut motions = Vec::new();
    match *body {
        Body::Cylinder { length_m, .. } => {
            for flips_m in [None, Some(length_m)] {
                for sign in [1.0, -1.0] {
                    for &place in places {
                        motions.push(Motion::Cylinder {
                            turn_rad: angle(place) - sign * angle(places[0]),
                            sign,
                            flips_m,
                        });
                    }
                }
            }
        }
        Body::Disk { .. } => {
            for sign in [1.0, -1.0] {
                for &place in places {
                    motions.push(Motion::Disk { turn_rad: angle(place) - sign * angle(places[0]), sign });
                }
            }
        }
        Body::Rectangle { width_m, height_m } => {
            for across in [None, Some(width_m)] {
                for along in [None, Some(height_m)] {
                    motions.push(Motion::Rectangle { flips_m: [across, along] });
                }
            }
        }
        Body::Mesh { .. } => {}
    }
    motions
}

/// For each electrode the index of the one mapped to it by a motion; `None` if there is none.
fn permutation(motion: &Motion, places: &[Point3]) -> Option<Vec<usize>> {
    let mut from = vec![None; places.len()];
    for (electrode, &place) in places.iter().enumerate() {
        let moved = motion.apply(place);
        let near = |other: &Point3| (0..3).all(|axis| (other[axis] - moved[axis]).abs() < SAME_M);
        from[places.iter().position(near)?] = Some(electrode);
    }
    from.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::forward::ForwardModel;
    use dermis::mesh::Mesh;
    use dermis_sim::touch::{GaussianTouch, touched_conductivity};

    #[test]
    fn the_cylinder_has_twenty_symmetries_and_touches_follow_them() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let symmetries = Symmetries::of(&design, forward.protocol());
        assert_eq!(symmetries.len(), 20);
        let surface = design.body.surface();
        let frame = |centre_m: Point3| -> Vec<f32> {
            let touch = GaussianTouch { centre_m, width_m: 0.012, amplitude: 1.0 };
            let rest = forward.rest_conductivity();
            let coat = touched_conductivity(forward.mesh(), &surface, design.sheet.touch, rest, &[touch]).unwrap();
            let difference = &forward.solve(&coat).unwrap() - &forward.solve(rest).unwrap();
            difference.iter().map(|&value| value as f32).collect()
        };
        let place = surface.at(0.11, 0.7).unwrap();
        let (here, mut moved) = (frame(place), vec![0.0; 870]);
        let size = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
        for element in 0..20 {
            symmetries.frame(element, &here, &mut moved);
            let there = frame(symmetries.point(element, place));
            let off: Vec<f32> = moved.iter().zip(&there).map(|(a, b)| a - b).collect();
            // Meshes are not symmetric: the tolerance is their discretisation error.
            assert!(size(&off) < 0.02 * size(&there), "{element}: {}", size(&off) / size(&there));
        }
        symmetries.frame(0, &here, &mut moved);
        assert!(here.iter().zip(&moved).all(|(a, b)| (a - b).abs() < 1e-5 * size(&here)));
    }
}
