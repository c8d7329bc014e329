//! Eight conductivities solved simultaneously.

use super::assembly::Assembly;
use super::{ForwardError, ForwardModel};
use crate::linalg::{AlignedVec, BatchPlan, BatchWorkspace, Entries, LANES, SimdLevel};
use pulp::Simd;
use std::sync::Arc;

/// Work memory for repeated solves of eight conductivities simultaneously, one in each SIMD lane.
///
/// It gives the results of [`Solver`](super::Solver) except for rounding, several times faster. The bits of a lane do
/// not depend on the other lanes.
#[derive(Debug, Clone)]
pub struct BatchSolver {
    model: ForwardModel,
    plan: Arc<BatchPlan>,
    terms: Terms,
    conductivity: AlignedVec,
    workspace: BatchWorkspace,
    impedances: Vec<[f64; LANES]>,
}

impl ForwardModel {
    /// Work memory with the best instruction set of this machine.
    pub fn batch_solver(&self) -> BatchSolver {
        self.batch_solver_at(SimdLevel::best())
    }

    /// The same with a chosen instruction set.
    pub fn batch_solver_at(&self, level: SimdLevel) -> BatchSolver {
        let plan = Arc::new(self.symbolic().batch_plan());
        BatchSolver {
            terms: Terms::new(self.assembly(), &plan),
            conductivity: AlignedVec::new(self.mesh().cell_count() * LANES),
            workspace: plan.workspace_at(level),
            impedances: vec![[0.0; LANES]; plan.kept_count() * plan.kept_count()],
            plan,
            model: self.clone(),
        }
    }
}

impl BatchSolver {
    /// The model in use.
    pub fn model(&self) -> &ForwardModel {
        &self.model
    }

    /// Continues with another instance of the same skin, from [`ForwardModel::with_parameters`].
    ///
    /// # Panics
    /// If the model is of another mesh.
    pub fn set_model(&mut self, model: &ForwardModel) {
        assert!(self.model.has_pattern_of(model), "a model of another mesh");
        self.terms = Terms::new(model.assembly(), &self.plan);
        self.model = model.clone();
    }

    /// The frames of skins with the given conductivities (per cell, a lane per skin), per channel, ohm.
    ///
    /// # Errors
    /// A conductivity of the wrong length, or one that is not positive and finite.
    ///
    /// # Panics
    /// If the length of `frames` differs from the protocol.
    pub fn solve_into(
        &mut self,
        conductivity: &[[f64; LANES]],
        frames: &mut [[f64; LANES]],
    ) -> Result<(), ForwardError> {
        let protocol = self.model.protocol();
        assert_eq!(frames.len(), protocol.channel_count(), "a value per channel");
        super::model::check_count("conductivities", conductivity.len(), self.model.mesh().cell_count())?;
        let flat = conductivity.as_flattened();
        if let Some(index) = flat.iter().position(|value| !(*value > 0.0 && *value < f64::INFINITY)) {
            return Err(ForwardError::Conductivity { cell: index / LANES, value: flat[index] });
        }
        self.conductivity.values_mut().copy_from_slice(flat);
        let entries = Assembled { terms: &self.terms, conductivity: self.conductivity.values() };
        let solved = self.plan.transfer_impedances(&entries, &mut self.workspace, &mut self.impedances);
        if let Err(bad) = solved {
            return Err(self.name_singular(conductivity, bad.0));
        }
        self.add_series();
        let count = self.plan.kept_count();
        for (value, channel) in frames.iter_mut().zip(self.model.protocol().channels()) {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            let [a, b, c, d] = [[source, plus], [source, minus], [sink, plus], [sink, minus]]
                .map(|[row, column]| &self.impedances[row * count + column]);
            for lane in 0..LANES {
                value[lane] = (a[lane] - b[lane]) - (c[lane] - d[lane]);
            }
        }
        Ok(())
    }

    /// As [`ElectrodeNetwork::with_series`](super::ElectrodeNetwork) does it.
    fn add_series(&mut self) {
        let resistances = self.model.series_resistances();
        let count = resistances.len();
        if resistances.iter().all(|&resistance| resistance == 0.0) {
            return;
        }
        let mean = resistances.iter().sum::<f64>() / count as f64;
        for (i, row) in self.impedances.chunks_exact_mut(count).enumerate() {
            for (j, lanes) in row.iter_mut().enumerate() {
                let own = if i == j { resistances[i] } else { 0.0 };
                let series = own - (resistances[i] + resistances[j] - mean) / count as f64;
                lanes.iter_mut().for_each(|value| *value += series);
            }
        }
    }

    /// The error of the plain solver for the first lane that failed.
    fn name_singular(&self, conductivity: &[[f64; LANES]], bad: [bool; LANES]) -> ForwardError {
        let lane = bad.iter().position(|&bad| bad).unwrap_or(0);
        let one: Vec<f64> = conductivity.iter().map(|lanes| lanes[lane]).collect();
        match self.model.solve(&one) {
            Err(error) => error,
            Ok(_) => ForwardError::Singular { place: "the electrodes".into() },
        }
    }
}

/// The entries of the system in the order of the factorisation: each `fixed + sum of coefficient * conductivity[cell]`.
#[derive(Debug, Clone)]
struct Terms {
    fixed: Vec<f64>,
    starts: Vec<u32>,
    terms: Vec<(u32, f64)>,
}

impl Terms {
    fn new(assembly: &Assembly, plan: &BatchPlan) -> Self {
        let mut sorted = Terms { fixed: Vec::new(), starts: vec![0], terms: Vec::new() };
        let index = |value: usize| u32::try_from(value).expect("more terms than memory holds");
        for &entry in plan.entry_order() {
            let (fixed, terms) = assembly.entry(entry);
            sorted.fixed.push(fixed);
            sorted.terms.extend(terms.map(|(cell, coefficient)| (index(cell), coefficient)));
            sorted.starts.push(index(sorted.terms.len()));
        }
        sorted
    }
}

/// The entries at eight conductivities.
struct Assembled<'a> {
    terms: &'a Terms,
    /// Per cell, per lane.
    conductivity: &'a [f64],
}

impl Entries for Assembled<'_> {
    #[inline(always)]
    fn entry<S: Simd>(&self, simd: S, position: usize, pass: usize) -> S::f64s {
        let conductivity = S::as_simd_f64s(self.conductivity).0;
        let passes = LANES / S::F64_LANES;
        let terms = &self.terms.terms[self.terms.starts[position] as usize..self.terms.starts[position + 1] as usize];
        let mut sum = simd.splat_f64s(self.terms.fixed[position]);
        for &(cell, coefficient) in terms {
            sum = simd.mul_add_e_f64s(simd.splat_f64s(coefficient), conductivity[cell as usize * passes + pass], sum);
        }
        sum
    }
}
