//! Gradients of functions of frames with respect to conductivity, contact impedances and node positions, in reverse mode.
//!
//! A function of a frame, with the derivative `f_c` by channel `c`, changes with the transfer impedances `S` by
//! `trace(H dS)`, `H` the sum of `f_c` times the symmetric product of the drive's and the measure pair's currents. With
//! `S` the pseudo-inverse of the admittance `Y`, `dS = -S dY S`; with `Y` the Schur complement of the nodes, the
//! derivative with respect to each entry of the system follows from the factorisation in reverse order. No field and no
//! Jacobian is computed, and the gradient costs little more than the frame. The derivative of the entries is that of the
//! element matrices: with `g_i` the gradients of the basis functions, a corner `a` that moves by `v` changes
//! `K_ij = |e| g_i . g_j` by `|e| ((g_i . g_j)(g_a . v) - (g_i . g_a)(g_j . v) - (g_j . g_a)(g_i . v))`.
//!
//! The [series resistances](super::ForwardModel::series_resistances) and the correction at the ends of arcs are held
//! constant.

use super::batch::{add, transformed};
use super::{BatchSolver, ForwardError, ForwardModel};
use crate::fem::Gradients;
use crate::geom::Point3;
use crate::geom::vector::{cross, dot, norm, scale, sub};
use crate::linalg::{BatchFactor, LANES};

/// What gradients need of eight solutions.
#[derive(Debug, Clone)]
pub struct KeptSolution {
    factor: BatchFactor,
    /// Transfer impedances without series resistances.
    impedances: Vec<[f64; LANES]>,
    conductivity: Vec<[f64; LANES]>,
}

/// Gradients of eight functions, a lane for each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gradient {
    /// With respect to the conductivity of each cell, per S (per S/m in volumes).
    pub conductivity: Vec<[f64; LANES]>,
    /// With respect to the contact impedance of each electrode, per ohm m2 (on cells and faces) or per ohm m (on edges);
    /// zero for point electrodes.
    pub contact_impedances: Vec<[f64; LANES]>,
    /// With respect to the position of each node, x, y and z, per m.
    pub nodes: Vec<[[f64; LANES]; 3]>,
}

impl BatchSolver {
    /// Memory for [`solve_kept_into`](Self::solve_kept_into).
    pub fn kept_solution(&self) -> KeptSolution {
        KeptSolution { factor: self.plan.factor(&self.workspace), impedances: Vec::new(), conductivity: Vec::new() }
    }

    /// As [`solve_into`](Self::solve_into), with the same bits, and keeps what [`gradient`](Self::gradient) needs.
    ///
    /// # Errors
    /// The same.
    ///
    /// # Panics
    /// If the length of `frames` differs from the protocol, or the memory is of another mesh.
    pub fn solve_kept_into(
        &mut self,
        conductivity: &[[f64; LANES]],
        frames: &mut [[f64; LANES]],
        kept: &mut KeptSolution,
    ) -> Result<(), ForwardError> {
        self.load(conductivity)?;
        self.factor(Some(&mut kept.factor))?;
        kept.impedances.clone_from(&self.impedances);
        kept.conductivity.clear();
        kept.conductivity.extend_from_slice(conductivity);
        self.read_frames(frames);
        Ok(())
    }

    /// The gradients of functions with the derivatives `by_frame` with respect to each channel, a lane per solution.
    ///
    /// ```
    /// use dermis::linalg::LANES;
    /// use dermis::skin::Skin;
    ///
    /// let skin = Skin::load("tank16")?;
    /// let model = skin.forward();
    /// let mut solver = model.batch_solver();
    /// let mut kept = solver.kept_solution();
    /// let conductivity: Vec<_> = model.rest_conductivity().iter().map(|&s| [s; LANES]).collect();
    /// let mut frames = vec![[0.0; LANES]; model.protocol().channel_count()];
    /// solver.solve_kept_into(&conductivity, &mut frames, &mut kept)?;
    /// // Half the sum of squares: all voltages and contact terms scale with one factor, by Euler's theorem.
    /// let gradient = solver.gradient(&kept, &frames);
    /// let by_conductivity: f64 = gradient.conductivity.iter().zip(&conductivity).map(|(g, s)| g[0] * s[0]).sum();
    /// assert!(by_conductivity < 0.0);
    /// # Ok::<(), dermis::Error>(())
    /// ```
    ///
    /// # Panics
    /// If the length of `by_frame` differs from the protocol, or the solution is of another mesh.
    pub fn gradient(&mut self, kept: &KeptSolution, by_frame: &[[f64; LANES]]) -> Gradient {
        let by_impedance = self.by_impedance(by_frame);
        let on_mesh = self.on_mesh(&by_impedance);
        let by_entry = self.by_entry(kept, on_mesh.as_deref().unwrap_or(&by_impedance));
        let model = &self.model;
        let mut gradient = Gradient {
            conductivity: self.by_conductivity(&by_entry),
            contact_impedances: vec![[0.0; LANES]; model.contact_impedances().len()],
            nodes: vec![[[0.0; LANES]; 3]; model.mesh().node_count()],
        };
        let mut of_entry = vec![[0.0; LANES]; by_entry.len()];
        for (&entry, value) in self.plan.entry_order().iter().zip(by_entry) {
            of_entry[entry] = value;
        }
        add_contacts(model, &of_entry, &mut gradient);
        if let Some(on_mesh) = on_mesh {
            self.add_constant(&by_impedance, &on_mesh, &mut gradient);
        }
        add_cells(model, &of_entry, &kept.conductivity, &mut gradient.nodes);
        gradient
    }

    /// The gradient with respect to the conductivity alone, in less time.
    ///
    /// # Panics
    /// As [`gradient`](Self::gradient).
    pub fn conductivity_gradient(&mut self, kept: &KeptSolution, by_frame: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
        let by_impedance = self.by_impedance(by_frame);
        let by_entry = self.by_entry(kept, &self.on_mesh(&by_impedance).unwrap_or(by_impedance));
        self.by_conductivity(&by_entry)
    }

    /// The derivatives with respect to the transfer impedances of the electrodes.
    fn by_impedance(&self, by_frame: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
        let channels = self.model.protocol().channels();
        assert_eq!(by_frame.len(), channels.len(), "a value per channel");
        let count = self.plan.kept_count();
        let mut by_impedance = vec![[0.0; LANES]; count * count];
        for (channel, values) in channels.iter().zip(by_frame) {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            for (i, j, sign) in [(source, plus, 0.5), (source, minus, -0.5), (sink, plus, -0.5), (sink, minus, 0.5)] {
                for at in [i * count + j, j * count + i] {
                    (0..LANES).for_each(|lane| by_impedance[at][lane] += sign * values[lane]);
                }
            }
        }
        by_impedance
    }

    /// The same with respect to those of the mesh, if the ends of arcs are corrected.
    fn on_mesh(&self, by_impedance: &[[f64; LANES]]) -> Option<Vec<[f64; LANES]>> {
        self.model.transform().map(|transform| transformed(&transform.matrix.transposed(), by_impedance))
    }

    /// The contact impedances in what the correction at the ends of arcs adds to the transfer impedances.
    fn add_constant(&self, by_impedance: &[[f64; LANES]], on_mesh: &[[f64; LANES]], gradient: &mut Gradient) {
        let Some(transform) = self.model.transform() else { return };
        let count = self.plan.kept_count();
        for (electrode, size) in transform.sizes.iter().enumerate().filter(|(_, size)| **size > 0.0) {
            let at = electrode * count + electrode;
            for lane in 0..LANES {
                gradient.contact_impedances[electrode][lane] += (by_impedance[at][lane] - on_mesh[at][lane]) / size;
            }
        }
    }

    /// The derivatives with respect to the values of the system's entries, in the order of the factorisation, from those with
    /// respect to the transfer impedances of the mesh.
    fn by_entry(&mut self, kept: &KeptSolution, on_mesh: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
        let count = self.plan.kept_count();
        let half = product(&kept.impedances, on_mesh, count);
        let mut by_admittance = product(&half, &kept.impedances, count);
        by_admittance.iter_mut().flatten().for_each(|value| *value = -*value);
        let mut by_entry = vec![[0.0; LANES]; self.plan.entry_order().len()];
        self.plan.entry_derivatives(&kept.factor, &by_admittance, &mut self.workspace, &mut by_entry);
        let pattern = &self.model.assembly().pattern.entries;
        for (&entry, values) in self.plan.entry_order().iter().zip(&mut by_entry) {
            let [row, column] = pattern[entry];
            if row != column {
                values.iter_mut().for_each(|value| *value *= 2.0);
            }
        }
        by_entry
    }

    fn by_conductivity(&self, by_entry: &[[f64; LANES]]) -> Vec<[f64; LANES]> {
        let mut gradient = vec![[0.0; LANES]; self.model.mesh().cell_count()];
        for (position, derivative) in by_entry.iter().enumerate() {
            for &(cell, coefficient) in self.terms.of_entry(position) {
                add(&mut gradient[cell as usize], coefficient, derivative);
            }
        }
        gradient
    }
}

/// The products of square matrices, a lane for each.
fn product(a: &[[f64; LANES]], b: &[[f64; LANES]], count: usize) -> Vec<[f64; LANES]> {
    let mut product = vec![[0.0; LANES]; count * count];
    for (row, target) in a.chunks_exact(count).zip(product.chunks_exact_mut(count)) {
        for (factor, other) in row.iter().zip(b.chunks_exact(count)) {
            for (target, value) in target.iter_mut().zip(other) {
                (0..LANES).for_each(|lane| target[lane] += factor[lane] * value[lane]);
            }
        }
    }
    product
}

/// The contacts: their values are inverse to the contact impedance and proportional to the measure of the simplex.
fn add_contacts(model: &ForwardModel, of_entry: &[[f64; LANES]], gradient: &mut Gradient) {
    let (mesh, impedances) = (model.mesh(), model.contact_impedances());
    model.assembly().for_each_contact_part(mesh, impedances, |electrode, corners, entry, value| {
        let derivative = &of_entry[entry];
        add(&mut gradient.contact_impedances[electrode], -value / impedances[electrode], derivative);
        for (&corner, slope) in corners.iter().zip(logarithmic_slopes(corners, &mesh.nodes)) {
            for (axis, slope) in slope.into_iter().enumerate() {
                add(&mut gradient.nodes[corner][axis], value * slope, derivative);
            }
        }
    });
}

/// The derivative of the logarithm of the measure of a segment or triangle with respect to each corner.
pub(super) fn logarithmic_slopes(corners: &[usize], nodes: &[Point3]) -> [Point3; 3] {
    match *corners {
        [a, b] => {
            let along = sub(nodes[b], nodes[a]);
            let slope = scale(along, 1.0 / dot(along, along));
            [scale(slope, -1.0), slope, [0.0; 3]]
        }
        [a, b, c] => {
            let [a, b, c] = [a, b, c].map(|corner| nodes[corner]);
            let twice_normal = cross(sub(b, a), sub(c, a));
            let inverse = norm(twice_normal).powi(-2);
            [sub(c, b), sub(a, c), sub(b, a)].map(|edge| scale(cross(twice_normal, edge), inverse))
        }
        _ => [[0.0; 3]; 3],
    }
}

/// The element matrices.
fn add_cells(
    model: &ForwardModel,
    of_entry: &[[f64; LANES]],
    conductivity: &[[f64; LANES]],
    nodes: &mut [[[f64; LANES]; 3]],
) {
    let mesh = model.mesh();
    let mut last = None;
    model.assembly().for_each_stiffness(mesh, |cell, [i, j], entry| {
        let gradients = match last {
            Some((known, gradients)) if known == cell => gradients,
            _ => Gradients::new(mesh, cell),
        };
        last = Some((cell, gradients));
        let Gradients { of_corner, measure, .. } = gradients;
        let weighted: [f64; LANES] = std::array::from_fn(|lane| of_entry[entry][lane] * conductivity[cell][lane]);
        let (gi, gj) = (of_corner[i], of_corner[j]);
        for (&corner, ga) in mesh.cells.corners(cell).iter().zip(of_corner) {
            let (ij, ia, ja) = (dot(gi, gj), dot(gi, ga), dot(gj, ga));
            for axis in 0..3 {
                let slope = measure * (ij * ga[axis] - ia * gj[axis] - ja * gi[axis]);
                add(&mut nodes[corner][axis], slope, &weighted);
            }
        }
    });
}
