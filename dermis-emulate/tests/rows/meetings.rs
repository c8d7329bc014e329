//! Two contacts so close to each other that the image shows one.

use crate::rows::bench::{Bench, along, lab, place, stroke, surface_distance};
use dermis::pipeline::Settings;
use dermis_emulate::emulator::{Place, Stroke};
use dermis_sim::random::sample_rng;
use rand::RngExt;

#[test]
fn most_slides_that_cross_keep_their_ids() {
    let swapped = meetings(10, 81, Encounter::Cross);
    println!("ids swapped or lost in {swapped} of 10 crossings");
    assert!(swapped <= 1, "{swapped} of 10 swapped or lost");
}

#[test]
fn most_slides_that_turn_back_from_each_other_keep_their_ids() {
    let swapped = meetings(5, 83, Encounter::TurnBack);
    println!("ids swapped or lost in {swapped} of 5 that turned back");
    assert!(swapped <= 1, "{swapped} of 5 swapped or lost");
}

#[test]
#[ignore = "slow: 200 crossings"]
fn of_two_hundred_slides_that_cross_few_swap_ids() {
    let swapped = meetings(200, 82, Encounter::Cross);
    println!("ids swapped or lost in {swapped} of 200 crossings");
    assert!(swapped <= 10);
}

#[test]
#[ignore = "slow: 100 meetings"]
fn of_a_hundred_slides_that_turn_back_few_swap_ids() {
    let swapped = meetings(100, 84, Encounter::TurnBack);
    println!("ids swapped or lost in {swapped} of 100 that turned back");
    assert!(swapped <= 5);
}

/// Motion of two slides at their common point.
#[derive(Clone, Copy, PartialEq)]
enum Encounter {
    /// They continue over the same point at the same time.
    Cross,
    /// They stop 15 mm from each other, for 0.1 to 0.5 s, and return.
    TurnBack,
}

/// Two slides of 0.1 m/s to a random point at a random angle; returns in how many runs the ids are exchanged or lost.
fn meetings(count: u64, seed: u64, encounter: Encounter) -> usize {
    let mut rng = sample_rng(seed, 0);
    (0..count)
        .filter(|index| {
            let middle = [0.1 + 0.1 * rng.random::<f64>(), 360.0 * rng.random::<f64>()];
            let first = std::f64::consts::TAU * rng.random::<f64>();
            let between = (0.3 + 0.4 * rng.random::<f64>()) * std::f64::consts::PI;
            let forces_n = [0, 1].map(|_| 1.5 + rng.random::<f64>());
            let hold_s = if encounter == Encounter::TurnBack { 0.1 + 0.4 * rng.random::<f64>() } else { 0.0 };
            let near_m = 0.0075 / (0.5 * between).sin();
            let fingers = [(first, forces_n[0]), (first + between, forces_n[1])].map(|(direction, force_n)| {
                let at = |along_m: f64| {
                    let [z_m, round_m] = [along_m * direction.sin(), along_m * direction.cos()];
                    place(middle[0] + z_m, middle[1] + (round_m / 0.047_75).to_degrees())
                };
                match encounter {
                    Encounter::Cross => vec![stroke(1.0, 1.6, at(-0.08), Some(at(0.08)), force_n)],
                    Encounter::TurnBack => turning_back(at(-0.08), at(-near_m), (0.08 - near_m) / 0.1, hold_s, force_n),
                }
            });
            exchanged(&fingers, seed + index)
        })
        .count()
}

/// A finger that moves to a position, stays and returns, without a lift.
fn turning_back(from: Place, to: Place, way_s: f64, hold_s: f64, force_n: f64) -> Vec<Stroke> {
    let part = |at_s, for_s, from, to| Stroke { ramp_s: 0.0, ..stroke(at_s, for_s, from, Some(to), force_n) };
    let turn_s = 1.0 + way_s + hold_s;
    vec![part(1.0, way_s, from, to), part(1.0 + way_s, hold_s, to, to), part(turn_s, way_s, to, from)]
}

/// Whether two fingers have other ids at the end than at the beginning.
fn exchanged(fingers: &[Vec<Stroke>; 2], seed: u64) -> bool {
    let end_s = fingers[0].last().map_or(0.0, |stroke| stroke.at_s + stroke.for_s);
    let mut bench = Bench::new(lab(), seed, fingers.concat(), Settings::default());
    let (mut start, mut end) = (Vec::new(), Vec::new());
    while bench.time_s() < end_s {
        let time_s = bench.time_s();
        let frame = bench.frame();
        let owner = |finger: &Vec<Stroke>| {
            let now = finger.iter().find(|stroke| (stroke.at_s..stroke.at_s + stroke.for_s).contains(&time_s))?;
            let near = |contact: &&dermis::pipeline::TrackedContact| {
                surface_distance(contact.contact.position_m, along(now, time_s)) < 0.015
            };
            frame.contacts.iter().find(near).map(|contact| contact.contact.id)
        };
        if (1.1..1.2).contains(&time_s) {
            start = fingers.iter().map(owner).collect();
        }
        if (end_s - 0.2..end_s - 0.1).contains(&time_s) {
            end = fingers.iter().map(owner).collect();
        }
    }
    start != end || start.contains(&None)
}
