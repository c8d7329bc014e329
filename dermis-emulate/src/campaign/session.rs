//! The frames of one device, with faults after each other.

use crate::EmulateError;
use crate::campaign::CampaignOptions;
use crate::campaign::draw::{Drawn, end_s};
use crate::campaign::score::{FaultRun, FrameCounts, Scorer};
use crate::emulator::{EmulatorOptions, Script};
use crate::offline::OfflineSession;
use dermis::method::MethodSet;
use dermis::pipeline::{Pipeline, Settings};
use std::sync::Arc;

/// Runs all faults of a device, and the same presses without faults.
pub(super) fn run(
    methods: &Arc<MethodSet>,
    options: &CampaignOptions,
    faults: &[Drawn],
    device: u64,
) -> Result<Vec<FaultRun>, EmulateError> {
    let (mut session, mut control) =
        (session(methods, options, faults, device)?, session(methods, options, &[], device)?);
    let surface = methods.skin().pixels().surface;
    let no_fault = Drawn::control();
    let mut control_scorer = Scorer::new(&no_fault, surface);
    let mut runs = Vec::new();
    for (index, fault) in faults.iter().enumerate() {
        let mut scorer = Scorer::new(fault, surface);
        while session.time_s() < end_s(index) {
            let (time_s, presses) = (session.time_s(), session.presses());
            let mut without = FrameCounts::default();
            if let Some(frame) = control.frame()? {
                without = control_scorer.take(time_s, &frame, &presses, without);
            }
            control.rebuild();
            if let Some(frame) = session.frame()? {
                scorer.take(time_s, &frame, &presses, without);
            }
            session.rebuild();
        }
        runs.push(scorer.finish(device));
    }
    runs.push(control_scorer.finish(device));
    Ok(runs)
}

/// A device with some faults.
fn session(
    methods: &Arc<MethodSet>,
    options: &CampaignOptions,
    faults: &[Drawn],
    device: u64,
) -> Result<OfflineSession, EmulateError> {
    let seed = options.seed.wrapping_mul(1000).wrapping_add(device);
    let twin = options.twin.clone();
    let script = Script::load("random", methods.skin().design(), &twin, seed)?;
    let faults = faults.iter().flat_map(|drawn| drawn.faults.clone()).collect();
    let device = EmulatorOptions { twin, seed, script, faults, speed: 1.0, prerendered: 0, unpaced: true };
    let settings = Settings { method: options.method.clone(), ..Settings::default() };
    OfflineSession::new(device, Pipeline::new(Arc::clone(methods), settings)?)
}
