//! A fault campaign: random faults of an emulated device, and how the pipeline copes with them.
//!
//! Random presses, one at a time, and random faults, one every six seconds, are simulated without a connection and as
//! fast as the machine allows. Each frame is compared with the true presses.
//!
//! ```no_run
//! use dermis::method::{MethodSet, Methods};
//! use dermis::skin::Skin;
//! use dermis_emulate::campaign::{CampaignOptions, run, scores};
//! use dermis_sim::twin::TwinOptions;
//! use std::sync::Arc;
//!
//! let methods = Arc::new(MethodSet::new(&Methods::linear(), Skin::load("skin16")?, None)?);
//! let twin = TwinOptions::load("lab")?;
//! let options = CampaignOptions { twin, method: "noser".into(), faults: 100, seed: 1 };
//! let runs = run(&methods, &options, |_| {})?;
//! let false_frames: u64 = scores(&runs).iter().map(|score| score.during.false_contacts).sum();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod draw;
mod score;
mod session;

pub use draw::FaultKind;
pub use score::{FaultRun, FrameCounts, Score};

use crate::EmulateError;
use crate::campaign::draw::faults;
use dermis::method::MethodSet;
use dermis_sim::twin::TwinOptions;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Options of a campaign.
#[derive(Debug, Clone)]
pub struct CampaignOptions {
    /// The digital twin.
    pub twin: TwinOptions,
    /// Name of the method; empty for the default method of the skin.
    pub method: String,
    /// Number of faults.
    pub faults: usize,
    /// Seed of the faults, of the presses and of the twins.
    pub seed: u64,
}

/// Faults of one device, after each other.
const FAULTS_PER_DEVICE: usize = 20;

/// Runs a campaign; returns the faults by device and time. `progress` receives the number of finished faults.
///
/// # Errors
/// An unknown method; a twin that does not fit the design or cannot be solved.
pub fn run(
    methods: &Arc<MethodSet>,
    options: &CampaignOptions,
    progress: impl Fn(usize) + Sync,
) -> Result<Vec<FaultRun>, EmulateError> {
    let done = AtomicUsize::new(0);
    let devices = options.faults.div_ceil(FAULTS_PER_DEVICE);
    let runs: Vec<Vec<FaultRun>> = (0..devices)
        .into_par_iter()
        .map(|device| {
            let first = device * FAULTS_PER_DEVICE;
            let count = FAULTS_PER_DEVICE.min(options.faults - first);
            let faults = faults(methods.skin().design(), options.seed, device as u64, count);
            let runs = session::run(methods, options, &faults, device as u64)?;
            progress(done.fetch_add(count, Ordering::Relaxed) + count);
            Ok(runs)
        })
        .collect::<Result<_, EmulateError>>()?;
    Ok(runs.into_iter().flatten().collect())
}

/// The scores of faults, by kind.
pub fn scores(runs: &[FaultRun]) -> Vec<Score> {
    let mut by_kind: BTreeMap<FaultKind, Score> = BTreeMap::new();
    for FaultRun { score, .. } in runs {
        by_kind.entry(score.kind).and_modify(|total| *total += score).or_insert_with(|| score.clone());
    }
    by_kind.into_values().collect()
}
