//! Pose of a flat skin in the coordinate frame of a robot.

use crate::calibration::Label;
use crate::checks::correlation::cosine;
use dermis::geom::vector::{bounding_box, sub};
use dermis::geom::{Point2, Point3};
use dermis::skin::Skin;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Labels that are compared with the model, at most.
const MAX_LABELS: usize = 300;
/// Steps of rotation of the search, from coarse to fine, rad.
const STEPS: [f64; 3] = [TAU / 72.0, TAU / 360.0, TAU / 1440.0];
/// Range of the coarse search for the position, in parts of the skin's half diagonal.
const RANGE: f64 = 0.4;
/// Steps of position of the coarse search on each side.
const COARSE: i32 = 4;

/// A rigid transformation of a flat skin: `p = centre + R(rotation) M s`, where M mirrors y if the skin is seen
/// mirrored.
///
/// ```
/// use dermis_calibrate::Pose;
///
/// let pose = Pose { centre_m: [0.1, 0.2, 0.05], rotation_rad: 1.0, mirrored: true };
/// let back = pose.to_skin(pose.to_robot([0.01, 0.02, 0.0]));
/// assert!((back[0] - 0.01).abs() < 1e-12 && (back[1] - 0.02).abs() < 1e-12);
/// assert_eq!(pose.direction_to_robot([0.0, 0.0, 1.0]), [0.0, 0.0, 1.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// The skin's origin in the robot's frame, m.
    pub centre_m: Point3,
    /// Angle from the robot's x to the skin's x.
    pub rotation_rad: f64,
    /// Whether the skin's y is mirrored.
    pub mirrored: bool,
}

impl Pose {
    /// A position on the skin in the robot's frame.
    pub fn to_robot(&self, position_m: Point3) -> Point3 {
        let [x, y] = [position_m[0], if self.mirrored { -position_m[1] } else { position_m[1] }];
        let (sin, cos) = self.rotation_rad.sin_cos();
        [self.centre_m[0] + cos * x - sin * y, self.centre_m[1] + sin * x + cos * y, self.centre_m[2] + position_m[2]]
    }

    /// A direction on the skin, such as a normal, in the robot's frame. On a mirrored skin only y is reversed: the
    /// normal of a flat skin points to the robot's +z, from where it is pressed.
    pub fn direction_to_robot(&self, direction: Point3) -> Point3 {
        sub(self.to_robot(direction), self.centre_m)
    }

    /// A position in the robot's frame on the skin.
    pub fn to_skin(&self, position_m: Point3) -> Point3 {
        let [x, y, z] = sub(position_m, self.centre_m);
        let (sin, cos) = self.rotation_rad.sin_cos();
        let [x, y] = [cos * x + sin * y, -sin * x + cos * y];
        [x, if self.mirrored { -y } else { y }, z]
    }

    /// The pose in which the changes of the labelled frames correlate most with those that the model of the skin
    /// predicts for a touch at the same position, with the correlation. `values` are the frames of the labels in units
    /// of the channels, `origin_m` is a first estimate of the position of the centre of the skin.
    ///
    /// # Errors
    /// A model that cannot be linearised.
    pub(crate) fn estimate(
        skin: &Skin,
        values: &[&[f64]],
        labels: &[Label],
        origin_m: Point3,
    ) -> dermis::Result<(Self, f64)> {
        let chosen: Vec<usize> = {
            let count = labels.len().min(MAX_LABELS);
            (0..count).map(|k| k * labels.len() / count).collect()
        };
        let frames: Vec<Vec<f64>> = standardised(chosen.iter().map(|&index| values[index].to_vec()).collect());
        let templates = templates(skin)?;
        let correlations: Vec<Vec<f32>> = frames
            .par_iter()
            .map(|frame| {
                templates
                    .iter()
                    .map(|template| cosine(frame.iter().copied(), template.iter().copied()) as f32)
                    .collect()
            })
            .collect();
        let positions: Vec<Point3> = chosen.iter().map(|&index| labels[index].position_m).collect();
        let [x, y, _] = skin.pixels().box_m();
        let half_diagonal_m = 0.5 * (x[1] - x[0]).hypot(y[1] - y[0]);
        let search = Search { grid: Grid::new(skin), positions, correlations, middle: middle(skin), half_diagonal_m };
        Ok(search.run(origin_m))
    }
}

/// The middle of the skin in its own frame.
fn middle(skin: &Skin) -> Point2 {
    let [low_m, high_m] = bounding_box(skin.pixels().centres_m.iter().copied());
    [0, 1].map(|axis| 0.5 * (low_m[axis] + high_m[axis]))
}

/// The predicted change of all channels by a touch at each pixel.
fn templates(skin: &Skin) -> dermis::Result<Vec<Vec<f64>>> {
    let jacobian = &skin.linearised()?.jacobian;
    let sign = skin.design().sheet.touch.sign();
    let column = |pixel: usize| (0..jacobian.rows).map(|channel| sign * jacobian.at(channel, pixel)).collect();
    Ok(standardised((0..jacobian.columns).map(column).collect()))
}

/// Rows with each column at mean 0 and standard deviation 1.
fn standardised(mut rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for column in 0..rows[0].len() {
        let values: Vec<f64> = rows.iter().map(|row| row[column]).collect();
        let (mean, sd) = dermis::stats::mean_and_sd(&values);
        rows.iter_mut().for_each(|row| row[column] = if sd > 0.0 { (row[column] - mean) / sd } else { 0.0 });
    }
    rows
}

/// The pixel at each position.
struct Grid {
    low_m: Point2,
    edge_m: f64,
    columns: usize,
    pixel: Vec<Option<usize>>,
}

impl Grid {
    /// A square grid over the pixels with the nearest pixel in each square.
    fn new(skin: &Skin) -> Self {
        const SIDE: usize = 64;
        let centres = &skin.pixels().centres_m;
        let [low_m, high_m] = bounding_box(centres.iter().map(|&[x, y, _]| [x, y]));
        let edge_m = (high_m[0] - low_m[0]).max(high_m[1] - low_m[1]) / (SIDE - 1) as f64;
        let nearest = |square: usize| {
            let at = [low_m[0] + (square % SIDE) as f64 * edge_m, low_m[1] + (square / SIDE) as f64 * edge_m];
            let apart = |centre: &Point3| (centre[0] - at[0]).hypot(centre[1] - at[1]);
            let (pixel, distance_m) =
                centres.iter().map(apart).enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).expect("a skin has pixels");
            (distance_m < 3.0 * edge_m).then_some(pixel)
        };
        let pixel = (0..SIDE * SIDE).into_par_iter().map(nearest).collect();
        Grid { low_m, edge_m, columns: SIDE, pixel }
    }

    fn at(&self, position_m: Point3) -> Option<usize> {
        let index = |axis: usize| ((position_m[axis] - self.low_m[axis]) / self.edge_m).round();
        let (column, row) = (index(0), index(1));
        let inside = |value: f64| value >= 0.0 && value < self.columns as f64;
        if inside(column) && inside(row) { self.pixel[row as usize * self.columns + column as usize] } else { None }
    }
}

/// The search for the best pose.
struct Search {
    grid: Grid,
    positions: Vec<Point3>,
    /// Correlation of each label's frame with the template of each pixel.
    correlations: Vec<Vec<f32>>,
    /// The middle of the skin in its own frame.
    middle: Point2,
    half_diagonal_m: f64,
}

impl Search {
    fn run(&self, origin_m: Point3) -> (Pose, f64) {
        let mut best: Option<(Pose, f64)> = None;
        for (level, &rotation_step) in STEPS.iter().enumerate() {
            // Each level searches the steps of the one before at a third of their size.
            let position_step_m = RANGE * self.half_diagonal_m / f64::from(COARSE) / 3.0_f64.powi(level as i32);
            let poses = match best {
                None => {
                    let rotations = (0..(TAU / rotation_step).round() as i32).map(|k| f64::from(k) * rotation_step);
                    let both = rotations.flat_map(|rotation| [(rotation, false), (rotation, true)]);
                    both.flat_map(|(rotation, mirrored)| {
                        around([origin_m[0], origin_m[1]], COARSE, position_step_m)
                            .map(move |middle| (middle, rotation, mirrored))
                    })
                    .collect::<Vec<_>>()
                }
                Some((pose, _)) => {
                    let middle = pose.to_robot([self.middle[0], self.middle[1], 0.0]);
                    let rotations = (-5..=5).map(move |k| pose.rotation_rad + f64::from(k) * rotation_step);
                    rotations
                        .flat_map(|rotation| {
                            around([middle[0], middle[1]], 3, position_step_m)
                                .map(move |middle| (middle, rotation, pose.mirrored))
                        })
                        .collect()
                }
            };
            best = poses
                .into_par_iter()
                .map(|(middle, rotation, mirrored)| {
                    let pose = self.pose(middle, rotation, mirrored, origin_m[2]);
                    (pose, self.score(&pose))
                })
                .max_by(|a, b| a.1.total_cmp(&b.1));
        }
        best.expect("there are poses")
    }

    /// The pose with the middle of the skin at a position.
    fn pose(&self, middle_m: Point2, rotation_rad: f64, mirrored: bool, height_m: f64) -> Pose {
        let turned = Pose { centre_m: [0.0; 3], rotation_rad, mirrored };
        let [x, y, _] = turned.to_robot([self.middle[0], self.middle[1], 0.0]);
        Pose { centre_m: [middle_m[0] - x, middle_m[1] - y, height_m], ..turned }
    }

    /// The mean correlation; 0 for labels that lie off the skin.
    fn score(&self, pose: &Pose) -> f64 {
        let one = |(position, correlations): (&Point3, &Vec<f32>)| {
            self.grid.at(pose.to_skin(*position)).map_or(0.0, |pixel| f64::from(correlations[pixel]))
        };
        self.positions.iter().zip(&self.correlations).map(one).sum::<f64>() / self.positions.len() as f64
    }
}

/// A square of points.
fn around(middle_m: Point2, steps: i32, step_m: f64) -> impl Iterator<Item = Point2> {
    (-steps..=steps).flat_map(move |i| {
        (-steps..=steps).map(move |j| [middle_m[0] + f64::from(i) * step_m, middle_m[1] + f64::from(j) * step_m])
    })
}
