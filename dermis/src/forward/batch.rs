//! Eight conductivities solved simultaneously.

use super::assembly::Assembly;
use super::network::series;
use super::{ForwardError, ForwardModel};
use crate::linalg::{AlignedVec, BatchFactor, BatchPlan, BatchWorkspace, Entries, LANES, Matrix, SimdLevel};
use pulp::{Simd, WithSimd};
use std::borrow::Cow;
use std::sync::Arc;

/// Cells that are transposed at once: their lanes stay in the cache.
const BLOCK: usize = 64;

/// Work memory for repeated solves of eight conductivities simultaneously, one in each SIMD lane.
///
/// It gives the results of [`Solver`](super::Solver) except for rounding, several times faster. The bits of a lane do
/// not depend on the other lanes.
#[derive(Debug, Clone)]
pub struct BatchSolver {
    pub(super) model: ForwardModel,
    pub(super) plan: Arc<BatchPlan>,
    pub(super) terms: Terms,
    conductivity: AlignedVec,
    pub(super) workspace: BatchWorkspace,
    pub(super) impedances: Vec<[f64; LANES]>,
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

impl ForwardModel {
    /// The frames of the mesh's transfer impedances, a lane for each skin, to which the model's corrections are applied.
    pub(super) fn read_frames(&self, impedances: &mut Vec<[f64; LANES]>, frames: &mut [[f64; LANES]]) {
        assert_eq!(frames.len(), self.protocol().channel_count(), "a value per channel");
        if let Some(transform) = self.transform() {
            *impedances = transformed(&transform.matrix, impedances);
            add_to_each(impedances, &transform.constant);
        }
        if self.series_resistances().iter().any(|&resistance| resistance != 0.0) {
            add_to_each(impedances, &series(self.series_resistances()));
        }
        let count = self.mesh().electrodes.len();
        for (value, channel) in frames.iter_mut().zip(self.protocol().channels()) {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            let [a, b, c, d] = [[source, plus], [source, minus], [sink, plus], [sink, minus]]
                .map(|[row, column]| &impedances[row * count + column]);
            for lane in 0..LANES {
                value[lane] = (a[lane] - b[lane]) - (c[lane] - d[lane]);
            }
        }
    }
}

/// Adds a matrix to that of each lane.
fn add_to_each(impedances: &mut [[f64; LANES]], matrix: &Matrix) {
    for (lanes, other) in impedances.iter_mut().zip(&matrix.values) {
        lanes.iter_mut().for_each(|value| *value += other);
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
        self.load(conductivity)?;
        self.factor(None)?;
        self.read_frames(frames);
        Ok(())
    }

    /// Takes the conductivities of all lanes.
    pub(super) fn load(&mut self, conductivity: &[[f64; LANES]]) -> Result<(), ForwardError> {
        super::model::check_count("conductivities", conductivity.len(), self.model.mesh().cell_count())?;
        self.conductivity.values_mut().copy_from_slice(conductivity.as_flattened());
        self.check_conductivity()
    }

    /// The same from a list for each lane; lanes without one repeat the last.
    pub(super) fn load_maps(&mut self, maps: &[Cow<'_, [f64]>]) -> Result<(), ForwardError> {
        let cell_count = self.model.mesh().cell_count();
        for map in maps {
            super::model::check_count("conductivities", map.len(), cell_count)?;
        }
        for (block, target) in self.conductivity.values_mut().as_chunks_mut::<LANES>().0.chunks_mut(BLOCK).enumerate() {
            let cells = block * BLOCK..block * BLOCK + target.len();
            for lane in 0..LANES {
                let values = &maps[lane.min(maps.len() - 1)][cells.clone()];
                target.iter_mut().zip(values).for_each(|(lanes, value)| lanes[lane] = *value);
            }
        }
        self.check_conductivity()
    }

    fn check_conductivity(&self) -> Result<(), ForwardError> {
        let values = self.conductivity.values();
        let is_good = |value: &f64| (*value > 0.0) & (*value < f64::INFINITY);
        // Without an early exit, so that the loop is vectorised.
        if values.iter().fold(true, |good, value| good & is_good(value)) {
            return Ok(());
        }
        let index = values.iter().position(|value| !is_good(value)).unwrap_or(0);
        Err(ForwardError::Conductivity { cell: index / LANES, value: values[index] })
    }

    /// The conductivities of all lanes.
    pub(super) fn conductivity(&self) -> &[[f64; LANES]] {
        self.conductivity.values().as_chunks::<LANES>().0
    }

    /// Computes the transfer impedances; with a factor also what derivatives need.
    pub(super) fn factor(&mut self, factor: Option<&mut BatchFactor>) -> Result<(), ForwardError> {
        let entries = Assembled { terms: &self.terms, conductivity: self.conductivity.values() };
        let (plan, workspace, impedances) = (&self.plan, &mut self.workspace, &mut self.impedances);
        let solved = match factor {
            None => plan.transfer_impedances(&entries, workspace, impedances),
            Some(factor) => plan.transfer_impedances_kept(&entries, workspace, factor, impedances),
        };
        solved.map_err(|bad| self.name_singular(bad.0))
    }

    /// The frames of the transfer impedances, to which the model's corrections are applied.
    pub(super) fn read_frames(&mut self, frames: &mut [[f64; LANES]]) {
        self.model.read_frames(&mut self.impedances, frames);
    }

    /// The error of the plain solver for the first lane that failed.
    fn name_singular(&self, bad: [bool; LANES]) -> ForwardError {
        let lane = bad.iter().position(|&bad| bad).unwrap_or(0);
        let one: Vec<f64> = self.conductivity().iter().map(|lanes| lanes[lane]).collect();
        match self.model.solve(&one) {
            Err(error) => error,
            Ok(_) => ForwardError::Singular { place: "the electrodes".into() },
        }
    }
}

/// `M X M'`, a lane for each `X`.
pub(super) fn transformed(transform: &Matrix, values: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
    let count = transform.columns;
    let mut whole = vec![[0.0; LANES]; count * count];
    pulp::Arch::new().dispatch(Transform { transform, values, whole: &mut whole });
    whole
}

struct Transform<'a> {
    transform: &'a Matrix,
    values: &'a [[f64; LANES]],
    whole: &'a mut [[f64; LANES]],
}

impl WithSimd for Transform<'_> {
    type Output = ();

    /// Compiled once per instruction set, with the same bits: no operation is fused.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Transform { transform, values, whole } = self;
        let count = transform.columns;
        let mut half = vec![[0.0; LANES]; count];
        for (i, whole) in whole.chunks_exact_mut(count).enumerate() {
            half.fill([0.0; LANES]);
            for (factor, row) in transform.row(i).iter().zip(values.chunks_exact(count)) {
                for (sum, value) in half.iter_mut().zip(row) {
                    add(sum, *factor, value);
                }
            }
            for (j, sum) in whole.iter_mut().enumerate() {
                for (value, factor) in half.iter().zip(transform.row(j)) {
                    add(sum, *factor, value);
                }
            }
        }
    }
}

#[inline(always)]
pub(super) fn add(target: &mut [f64; LANES], factor: f64, values: &[f64; LANES]) {
    for lane in 0..LANES {
        target[lane] += factor * values[lane];
    }
}

/// The entries of the system in the order of the factorisation: each `fixed + sum of coefficient * conductivity[cell]`.
#[derive(Debug, Clone)]
pub(super) struct Terms {
    fixed: Vec<f64>,
    starts: Vec<u32>,
    terms: Vec<(u32, f64)>,
}

impl Terms {
    /// The cells of an entry with their coefficients.
    pub(super) fn of_entry(&self, position: usize) -> &[(u32, f64)] {
        &self.terms[self.starts[position] as usize..self.starts[position + 1] as usize]
    }

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
