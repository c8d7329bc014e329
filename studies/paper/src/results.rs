//! All results of a reproduction, for the page and for report.json.

use crate::bench::Bench;
use crate::benchmarked::Benchmarked;
use crate::bias::Structure;
use crate::choose::Choice;
use crate::controls::Control;
use crate::gallery::Gallery;
use crate::scale::{CHOOSING_SEED, REPORTED_SEED, Scale};
use crate::stage::Done;
use crate::stated::{Row, facts, results};
use dermis_study::comparison::Named;
use serde::Serialize;

/// All results of a reproduction.
pub(crate) struct Results<'a> {
    /// Its scale.
    pub scale: Scale,
    /// The skin and its twins.
    pub bench: &'a Bench<'a>,
    /// The methods, in the order of all tables.
    pub methods: &'a [Named],
    /// The choice of alpha for the linear methods.
    pub choice: &'a Choice,
    /// Benchmark of every method on the reported twins.
    pub assessed: Vec<Benchmarked>,
    /// The data of the pictures.
    pub gallery: Gallery,
    /// The controls; `None` for a design without controls.
    pub structure: Option<StructureStudy>,
}

/// The design under study and its controls.
pub(crate) struct StructureStudy {
    /// The designs; the first is the design under study.
    pub designs: Vec<Control>,
    /// The angle of the cut, rad.
    pub cut_rad: f64,
    /// Results of each method on each design.
    pub structures: Vec<Structure>,
}

impl StructureStudy {
    /// Results of a method on a design.
    pub(crate) fn of(&self, design: &str, method: &str) -> Option<&Structure> {
        self.structures.iter().find(|structure| structure.design == design && structure.method == method)
    }
}

impl Results<'_> {
    /// The linear methods.
    pub(crate) fn linear(&self) -> impl Iterator<Item = &Benchmarked> {
        self.assessed.iter().filter(|assessed| assessed.alpha.is_some())
    }

    /// The reported twins as text: "2 twins, seeds 1001 to 1002".
    pub(crate) fn twins(&self) -> String {
        match self.scale.twins() {
            1 => format!("1 twin, seed {REPORTED_SEED}"),
            count => format!("{count} twins, seeds {REPORTED_SEED} to {}", REPORTED_SEED + count - 1),
        }
    }

    /// The numbers for report.json.
    pub(crate) fn summary(&self, stages: &[Done]) -> Summary<'_> {
        let size = self.scale.result();
        Summary {
            dermis: env!("CARGO_PKG_VERSION"),
            simulated: true,
            scale: self.scale,
            design: &self.bench.skin.design().name,
            mesh_hash: self.bench.skin.mesh().hash(),
            twin: &self.bench.twin.name,
            first_reported_seed: REPORTED_SEED,
            reported_twins: self.scale.twins(),
            first_choosing_seed: CHOOSING_SEED,
            choosing_twins: self.scale.choosing_twins(),
            presses_a_twin: [self.bench.skin.pixels().len().div_ceil(size.sizes.grid_step), size.sizes.random],
            alphas_tried: self.choice,
            methods: &self.assessed,
            seconds_a_frame: &self.gallery.seconds_a_frame,
            cut_degrees: self.structure.as_ref().map(|study| study.cut_rad.to_degrees()),
            structures: self.structure.as_ref().map_or(&[], |study| &study.structures),
            facts: facts(self),
            results: results(self),
            stages: stages.to_vec(),
        }
    }
}

/// The contents of report.json.
#[derive(Serialize)]
pub(crate) struct Summary<'a> {
    dermis: &'static str,
    simulated: bool,
    scale: Scale,
    design: &'a str,
    mesh_hash: String,
    twin: &'a str,
    first_reported_seed: u64,
    reported_twins: u64,
    first_choosing_seed: u64,
    choosing_twins: u64,
    /// Numbers of presses on the grid and at random positions.
    presses_a_twin: [usize; 2],
    alphas_tried: &'a Choice,
    methods: &'a [Benchmarked],
    /// Median time from a difference to contacts, one thread, in the order of the methods.
    seconds_a_frame: &'a [f64],
    cut_degrees: Option<f64>,
    structures: &'a [Structure],
    facts: Vec<Row>,
    results: Vec<Row>,
    stages: Vec<Done>,
}
