//! What is known of a robot before it is read: its skins in the base's frame, neighbours, the load.

use crate::LiveError;
use crate::clock;
use crate::device::Address;
use crate::robot::Prepared;
use dermis::geom::Point3;
use dermis::geom::vector::{centroid, distance};
use dermis::method::{MethodSet, Methods};
use dermis::pipeline::{Command, FrameInput, Pipeline, Settings, Timestamp};
use dermis::skin::Skin;
use dermis_robot::{Kinematics, Pose, Robot, Rule, SEAM_M, When, WornSkin};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Frames that are timed.
const TIMED: u32 = 100;
/// Touched frames, of which contacts are confirmed by the second.
const PRESSED: u32 = 5;
/// Noise of the timed frames, of their values: that of a good instrument, so that each frame is another one.
const NOISE: f64 = 1e-4;

/// What `dermis robot check` finds.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct RobotReport {
    /// The name of the robot.
    pub robot: String,
    /// The link whose frame is the base.
    pub base: Option<String>,
    /// The joints that the poses of the skins depend on.
    pub joints: Vec<String>,
    /// The skins.
    pub skins: Vec<SkinReport>,
    /// Pairs of skins of one link that meet or overlap.
    pub neighbours: Vec<Neighbours>,
    /// Cores that all pipelines together need at this rate.
    pub cores: f64,
    /// The rate, frames per second.
    pub rate_hz: f64,
    /// Rules that cannot do what they say, with the reason.
    pub warnings: Vec<String>,
}

/// A skin of a [`RobotReport`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SkinReport {
    /// Its name.
    pub skin: String,
    /// The link that wears it.
    pub link: String,
    /// Its design.
    pub design: String,
    /// Its method.
    pub method: String,
    /// Where its frames come from.
    pub source: String,
    /// Numbers of electrodes, channels and cells.
    pub electrodes: usize,
    /// Values of a frame.
    pub channels: usize,
    /// Cells of the mesh.
    pub cells: usize,
    /// Time of its pipeline for a frame, median, s.
    pub frame_s: f64,
    /// The largest force that its method states, N; `None` if it has no limit or is not known.
    pub most_force_n: Option<f64>,
    /// Whether its contacts have forces, which take a calibration or a method that knows them; `None` if the method did not find
    /// the touch that was tried.
    pub forces: Option<bool>,
}

/// Two skins of one link.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Neighbours {
    /// The skins.
    pub skins: [String; 2],
    /// Distance of their nearest points, m.
    pub distance_m: f64,
    /// The part of the first that lies on the second.
    pub overlap: f64,
}

/// Checks a robot: prepares each skin with its method, times its pipeline, looks for skins that meet or overlap.
///
/// # Errors
/// A method that does not exist or cannot be prepared.
pub fn check(robot: &Robot, methods: &Methods, rate_hz: f64) -> Result<RobotReport, LiveError> {
    for worn in robot.skins().iter().filter(|worn| worn.source != "emulate" && worn.part().is_none()) {
        Address::parse(&worn.source).map_err(|error| LiveError::Given(format!("the skin `{}`: {error}", worn.name)))?;
    }
    let mut prepared = Prepared::new(methods);
    let sets: Vec<Arc<MethodSet>> = robot.skins().iter().map(|worn| prepared.of(worn)).collect::<Result<_, _>>()?;
    let mut skins: Vec<SkinReport> = Vec::new();
    for ((worn, set), (frame_s, forces)) in robot.skins().iter().zip(&sets).zip(try_frames(&sets)?) {
        let skin = set.skin();
        skins.push(SkinReport {
            skin: worn.name.clone(),
            link: worn.link.clone(),
            design: worn.design.clone(),
            method: worn.method.clone().unwrap_or_else(|| "best".into()),
            source: worn.source.clone(),
            electrodes: skin.design().electrodes.len(),
            channels: skin.design().protocol.channel_count(),
            cells: skin.mesh().cell_count(),
            frame_s,
            most_force_n: most_force_n(worn, set)?,
            forces,
        });
    }
    let mut neighbours = Vec::new();
    for (a, b, pose) in robot.fixed_pairs() {
        let [first, second] = [a, b].map(|skin| sets[skin].skin());
        let (distance_m, overlap) = (distance_m(first, second, &pose), overlap(first, second, &pose));
        if distance_m < SEAM_M {
            let skins = [a, b].map(|skin| robot.skins()[skin].name.clone());
            neighbours.push(Neighbours { skins, distance_m, overlap });
        }
    }
    let joints = robot.kinematics().map(|kinematics| {
        let names: Vec<&str> = kinematics.joint_names().collect();
        robot.needed_joints().iter().map(|&joint| names[joint].to_string()).collect()
    });
    let read_here = skins.iter().zip(robot.skins()).filter(|(_, worn)| worn.part().is_none());
    Ok(RobotReport {
        robot: robot.name().into(),
        base: robot.base().map(String::from),
        joints: joints.unwrap_or_default(),
        warnings: unconnected(robot)
            .into_iter()
            .chain(robot.kinematics().into_iter().flat_map(Kinematics::doubtful_limits))
            .chain(robot.rules().iter().filter_map(|rule| without_forces(rule, &skins)))
            .chain(robot.rules().iter().filter_map(|rule| beyond_forces(rule, &skins)))
            .collect(),
        cores: rate_hz * read_here.map(|(skin, _)| skin.frame_s).sum::<f64>(),
        skins,
        neighbours,
        rate_hz,
    })
}

/// Distances of places of a skin from the surface of another one, m.
fn distances_m(places_m: &[Point3], other: &Skin, to_other: Pose) -> impl Iterator<Item = f64> {
    let limits = other.place_limits();
    places_m.iter().map(move |&place_m| limits.distance_m(to_other.point(place_m)))
}

/// The distance of the nearest points of two skins, m: of the nodes of each from the other; with the pose of the second's frame in
/// that of the first.
fn distance_m(a: &Skin, b: &Skin, pose: &Pose) -> f64 {
    let from =
        |one: &Skin, other, to_other| distances_m(&one.mesh().nodes, other, to_other).fold(f64::INFINITY, f64::min);
    from(a, b, pose.inverse()).min(from(b, a, *pose))
}

/// The part of a skin that lies on another one: of its pixels. Those at a common edge are half a pixel from it.
fn overlap(a: &Skin, b: &Skin, pose: &Pose) -> f64 {
    const ON_IT: f64 = 0.25;
    let pixels = a.pixels();
    let on_m = ON_IT * pixels.half_pixel_m();
    let on = distances_m(&pixels.centres_m, b, pose.inverse()).filter(|distance_m| *distance_m < on_m).count();
    on as f64 / pixels.len() as f64
}

/// The largest force that the method of a skin states, N.
fn most_force_n(worn: &WornSkin, set: &MethodSet) -> Result<Option<f64>, LiveError> {
    let method = set.method(worn.method.as_deref().unwrap_or(Methods::BEST))?;
    Ok(method.reconstruct().detection().forces.and_then(|forces| forces.most_n))
}

/// Skins whose links no chain of joints connects to the base.
fn unconnected(robot: &Robot) -> Vec<String> {
    let Some(kinematics) = robot.kinematics() else { return Vec::new() };
    let poses = robot.poses(&vec![0.0; kinematics.joint_names().len()]);
    let is_apart = |worn: &&WornSkin| kinematics.link(&worn.link).is_none_or(|link| poses[link].is_none());
    let told = |worn: &WornSkin| {
        let (base, WornSkin { name, link, .. }) = (robot.base().unwrap_or_default(), worn);
        format!(
            "no chain of joints leads from the base `{base}` to the link `{link}` of the skin `{name}`: where its contacts are in the \
             frame of the base stays unknown"
        )
    };
    robot.skins().iter().filter(is_apart).map(told).collect()
}

/// Why a rule of forces is about skins without.
fn without_forces(rule: &Rule, skins: &[SkinReport]) -> Option<String> {
    let without: Vec<&str> = rule
        .skins
        .iter()
        .map(|&skin| &skins[skin])
        .filter(|skin| skin.forces != Some(true))
        .map(|skin| skin.skin.as_str())
        .collect();
    (matches!(rule.when, When::ForceN(_)) && !without.is_empty()).then(|| {
        format!(
            "the rule `{}` needs forces, and no touch of {} that was tried has one: every touch of it is of an unknown force; calibrate it \
             with labels that have a force",
            rule.name,
            without.join(", ")
        )
    })
}

/// Why a rule waits for a force that the methods of its skins do not state.
fn beyond_forces(rule: &Rule, skins: &[SkinReport]) -> Option<String> {
    let When::ForceN(force_n) = rule.when else { return None };
    let is_below = |skin: &&SkinReport| skin.most_force_n.is_some_and(|most_n| most_n < force_n);
    let skin = rule.skins.iter().map(|&skin| &skins[skin]).find(is_below)?;
    let most_n = skin.most_force_n?;
    Some(format!(
        "the rule `{}` waits for {force_n} N, but forces of `{}` end at {most_n} N: a stronger touch has an unknown force, and with \
         `unknown = \"keep\"` or \"ignore\" the rule never begins; choose at most {most_n} N, or calibrate with stronger presses",
        rule.name, skin.skin
    ))
}

/// A frame of the model, touched near the middle of the skin: half the conductance more, or a third less, around a place.
fn touched(skin: &Skin) -> Result<Vec<f64>, LiveError> {
    const WIDTH_M: f64 = 0.008;
    let (mesh, model) = (skin.mesh(), skin.forward());
    let middle_m = centroid(&mesh.nodes);
    let apart_m = |place: &&Point3| distance(**place, middle_m);
    let centres = &skin.pixels().centres_m;
    let place_m = centres.iter().min_by(|a, b| apart_m(a).total_cmp(&apart_m(b))).copied().unwrap_or(middle_m);
    let sign = skin.design().sheet.touch.sign();
    let change = |cell: usize| {
        let away = distance(mesh.cell_centre(cell), place_m) / WIDTH_M;
        (0.4 * sign * (-0.5 * away * away).exp()).exp()
    };
    let conductivity: Vec<f64> =
        model.rest_conductivity().iter().enumerate().map(|(cell, rest)| rest * change(cell)).collect();
    Ok(model.solve(&conductivity).map_err(dermis::Error::from)?.0)
}

/// The median time of each pipeline for a frame, s, of untouched frames of the model with noise, all pipelines in turn, as they
/// share the processor's caches; and whether the contacts of a touch have forces.
fn try_frames(sets: &[Arc<MethodSet>]) -> Result<Vec<(f64, Option<bool>)>, LiveError> {
    let settings = Settings { force_tare: true, ..Settings::default() };
    let tare = settings.tare_frames as u32;
    let pipeline = |set: &Arc<MethodSet>| Pipeline::new(Arc::clone(set), settings.clone());
    let mut pipelines = sets.iter().map(pipeline).collect::<Result<Vec<_>, _>>()?;
    let mut times_s = vec![Vec::new(); sets.len()];
    let (begun, mut random) = (clock::now(), ChaCha8Rng::seed_from_u64(1));
    for index in 0..tare + TIMED {
        if index == tare {
            // Methods that depend on the tare are one for each skin then.
            std::thread::scope(|scope| {
                pipelines.iter_mut().for_each(|pipeline| drop(scope.spawn(|| pipeline.command(&Command::Rebuild))));
            });
        }
        let measured_at: Timestamp = begun.after(Duration::from_millis(8 * u64::from(index)));
        for (pipeline, times_s) in pipelines.iter_mut().zip(&mut times_s) {
            let noisy = |value: &f64| value * (1.0 + NOISE * (random.random::<f64>() - 0.5));
            let values: Vec<f64> = pipeline.skin().untouched()?.iter().map(noisy).collect();
            let start = Instant::now();
            pipeline.process(FrameInput::new(u64::from(index), measured_at, values))?;
            if index >= tare {
                times_s.push(start.elapsed().as_secs_f64());
            }
        }
    }
    let median = |mut times_s: Vec<f64>| {
        times_s.sort_by(f64::total_cmp);
        times_s[times_s.len() / 2]
    };
    let at = begun.after(Duration::from_millis(8 * u64::from(tare + TIMED)));
    let mut forces = Vec::new();
    for pipeline in &mut pipelines {
        let values = touched(pipeline.skin())?;
        let mut has_forces = None;
        for index in 0..PRESSED {
            let noisy = values.iter().map(|value| value * (1.0 + NOISE * (random.random::<f64>() - 0.5))).collect();
            let input = FrameInput::new(
                u64::from(tare + TIMED + index),
                at.after(Duration::from_millis(8 * u64::from(index))),
                noisy,
            );
            let frame = pipeline.process(input)?;
            let known = frame.contacts.iter().map(|tracked| tracked.contact.force_n.is_finite());
            has_forces = known.max().max(has_forces);
        }
        forces.push(has_forces);
    }
    Ok(times_s.into_iter().map(median).zip(forces).collect())
}
