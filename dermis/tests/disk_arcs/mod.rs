//! The complete electrode model of a uniform disk with equal, evenly spaced arcs on its rim, by a boundary integral.

use std::f64::consts::{PI, TAU};

/// Nodes of a panel.
const ORDER: usize = 10;
/// Gauss points of a part of a panel on which the kernel is integrated.
const POINTS: usize = 20;
/// Halvings of a panel towards a point next to it.
const HALVINGS: usize = 40;

/// A disk of radius 1 and conductance 1 with `count` arcs of the angle `2 half_angle`; arc 0 is at the angle 0.
///
/// With `J` the current per angle that enters, the potential of the rim is `-1/pi integral of ln|2 sin((s - t) / 2)|
/// J(t) dt`, up to a constant (the Neumann function of the disk), and on an arc it is `U - z J`. By the symmetry of
/// rotation the potentials `U_e = exp(2 pi i m e / L)` of the arcs belong to currents with the same factor; so the
/// transfer impedance has the eigenvalues `1 / (current of arc 0 for U = exp(...))`, one integral equation for each
/// `m`. It is solved by collocation with polynomials on panels that halve towards the ends of the arc, where `J` grows
/// like `d^(-1/2)` for `z = 0` (Kress, Linear Integral Equations, 3rd ed. 2014, sections 7.6 and 13.4).
#[derive(Debug, Clone, Copy)]
pub struct DiskArcs {
    pub count: usize,
    pub half_angle: f64,
    /// Contact impedance times conductance over radius.
    pub contact_impedance: f64,
    /// Panels on each half of an arc.
    pub panels: usize,
}

impl DiskArcs {
    /// The transfer impedance between arc 0 and each arc, for currents without a sum: the mean of the row is zero.
    pub fn transfer_impedances(&self) -> Vec<f64> {
        let (blocks, weights) = (self.blocks(), self.weights());
        let share = |mode: usize| 1.0 / self.current(mode, &blocks, &weights);
        let shares: Vec<f64> = (1..=self.count / 2).map(share).collect();
        let of_arc = |arc: usize| -> f64 {
            let of_mode = |mode: usize| {
                let wave = (TAU * (mode * arc) as f64 / self.count as f64).cos();
                shares[mode.min(self.count - mode) - 1] * wave
            };
            (1..self.count).map(of_mode).sum::<f64>() / self.count as f64
        };
        (0..self.count).map(of_arc).collect()
    }

    /// The ends of the panels on the half from the centre to the end of the arc.
    fn panel_ends(&self) -> Vec<f64> {
        let left = |k: usize| if k == self.panels { 0.0 } else { 0.5f64.powi(k as i32) };
        (0..=self.panels).map(|k| self.half_angle * (1.0 - left(k))).collect()
    }

    fn panel(&self, panel: usize) -> [f64; 2] {
        let ends = self.panel_ends();
        [ends[panel], ends[panel + 1]]
    }

    /// Collocation points on that half.
    fn nodes(&self) -> Vec<f64> {
        let (x, _) = gauss(ORDER);
        let of_panel = |panel| x.iter().map(move |x| self.at(self.panel(panel), *x)).collect::<Vec<_>>();
        (0..self.panels).flat_map(of_panel).collect()
    }

    fn at(&self, [from, to]: [f64; 2], x: f64) -> f64 {
        0.5 * (from + to) + 0.5 * (to - from) * x
    }

    fn weights(&self) -> Vec<f64> {
        let (_, w) = gauss(ORDER);
        let of_panel = |panel| {
            let [from, to] = self.panel(panel);
            w.iter().map(move |w| 0.5 * (to - from) * w).collect::<Vec<_>>()
        };
        (0..self.panels).flat_map(of_panel).collect()
    }

    /// For each other arc, the potential at the nodes of arc 0 by the basis functions on its halves: `[lag][side]`,
    /// nodes x nodes.
    fn blocks(&self) -> Vec<[Vec<f64>; 2]> {
        let (nodes, rule, points) = (self.nodes(), gauss(ORDER), gauss(POINTS));
        let block = |lag: usize, side: f64| {
            let mut values = vec![0.0; nodes.len() * nodes.len()];
            for (i, s) in nodes.iter().enumerate() {
                // The distance from s to the point t on a half with the sign `side` of the arc `lag`.
                let shift = wrapped(s - TAU * lag as f64 / self.count as f64);
                for panel in 0..self.panels {
                    let row = &mut values[i * nodes.len() + panel * ORDER..][..ORDER];
                    integrate(self.panel(panel), side * shift, &rule, &points, row);
                }
            }
            values
        };
        (0..self.count).map(|lag| [block(lag, 1.0), block(lag, -1.0)]).collect()
    }

    /// The current of arc 0 for the potentials `exp(2 pi i m e / L)`. The real part of `J` is even on the arc, the
    /// imaginary part odd.
    fn current(&self, mode: usize, blocks: &[[Vec<f64>; 2]], weights: &[f64]) -> f64 {
        let count = weights.len();
        let mut system = vec![0.0; 4 * count * count];
        for (lag, [right, left]) in blocks.iter().enumerate() {
            let (sin, cos) = (TAU * (mode * lag) as f64 / self.count as f64).sin_cos();
            for i in 0..count {
                for j in 0..count {
                    let (even, odd) =
                        (right[i * count + j] + left[i * count + j], right[i * count + j] - left[i * count + j]);
                    system[i * 2 * count + j] += cos * even;
                    system[i * 2 * count + count + j] -= sin * odd;
                    system[(count + i) * 2 * count + j] += sin * even;
                    system[(count + i) * 2 * count + count + j] += cos * odd;
                }
            }
        }
        (0..2 * count).for_each(|i| system[i * 2 * count + i] += self.contact_impedance);
        let mut right: Vec<f64> = (0..2 * count).map(|i| if i < count { 1.0 } else { 0.0 }).collect();
        solve(&mut system, &mut right);
        2.0 * right.iter().zip(weights).map(|(j, w)| j * w).sum::<f64>()
    }

    /// The voltage of a measure pair for 1 A through a drive pair.
    pub fn voltage(impedances: &[f64], drive: [usize; 2], measure: [usize; 2]) -> f64 {
        let of = |a: usize, b: usize| impedances[(a + impedances.len() - b) % impedances.len()];
        of(measure[0], drive[0]) - of(measure[1], drive[0]) - of(measure[0], drive[1]) + of(measure[1], drive[1])
    }
}

/// An angle in -pi..pi.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

fn kernel(distance: f64) -> f64 {
    -(2.0 * (0.5 * distance).sin().abs()).ln() / PI
}

/// Points and weights on -1..1.
type Rule = (Vec<f64>, Vec<f64>);

/// Gauss-Legendre points and weights on -1..1, by Newton's method.
fn gauss(count: usize) -> Rule {
    let of = |k: usize| {
        let mut x = -(PI * (k as f64 + 0.75) / (count as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (mut below, mut value) = (1.0, x);
            for n in 2..=count {
                let n = n as f64;
                (below, value) = (value, ((2.0 * n - 1.0) * x * value - (n - 1.0) * below) / n);
            }
            slope = count as f64 * (x * value - below) / (x * x - 1.0);
            x -= value / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(of).unzip()
}

/// Adds the integrals of `kernel(s - t)` times each basis function of a panel.
fn integrate([from, to]: [f64; 2], s: f64, rule: &Rule, points: &Rule, row: &mut [f64]) {
    let length = to - from;
    let away = |[a, b]: [f64; 2]| (a - s).max(s - b).max(0.0);
    if away([from, to]) > 2.0 * length {
        for ((x, w), value) in rule.0.iter().zip(&rule.1).zip(row) {
            *value += 0.5 * length * w * kernel(s - (from + 0.5 * length * (x + 1.0)));
        }
        return;
    }
    let mut parts = if from < s && s < to { vec![[from, s], [s, to]] } else { vec![[from, to]] };
    let mut depth = 0;
    while let Some([a, b]) = parts.pop() {
        depth += 1;
        let touches = away([a, b]) < 1e-13 * length;
        if !touches && away([a, b]) < 0.5 * (b - a) && depth < 4 * HALVINGS {
            parts.extend([[a, 0.5 * (a + b)], [0.5 * (a + b), b]]);
            continue;
        }
        for (x, w) in points.0.iter().zip(&points.1) {
            // Towards a point where the kernel is singular, t - s = +-v^4.
            let v = 0.5 * (x + 1.0);
            let (share, slope) = if touches { (v.powi(4), 4.0 * v.powi(3)) } else { (v, 1.0) };
            let t = if touches && s > a { b - (b - a) * share } else { a + (b - a) * share };
            let distance = if touches { (b - a) * share } else { s - t };
            let value = 0.5 * (b - a) * w * slope * kernel(distance);
            let place = 2.0 * (t - from) / length - 1.0;
            basis(&rule.0, place).zip(row.iter_mut()).for_each(|(basis, entry)| *entry += value * basis);
        }
    }
}

/// The Lagrange polynomials of some nodes at a point.
fn basis(nodes: &[f64], at: f64) -> impl Iterator<Item = f64> + '_ {
    nodes.iter().enumerate().map(move |(k, node)| {
        let others = nodes.iter().enumerate().filter(|&(other, _)| other != k);
        others.map(|(_, other)| (at - other) / (node - other)).product()
    })
}

/// Gaussian elimination with partial pivoting; the solution replaces the right side.
fn solve(matrix: &mut [f64], right: &mut [f64]) {
    let count = right.len();
    for k in 0..count {
        let pivot = (k..count).max_by(|&a, &b| matrix[a * count + k].abs().total_cmp(&matrix[b * count + k].abs()));
        let pivot = pivot.expect("a row is left");
        (0..count).for_each(|j| matrix.swap(k * count + j, pivot * count + j));
        right.swap(k, pivot);
        let (upper, lower) = matrix.split_at_mut((k + 1) * count);
        let row = &upper[k * count..];
        for (i, below) in lower.chunks_exact_mut(count).enumerate() {
            let factor = below[k] / row[k];
            (k..count).for_each(|j| below[j] -= factor * row[j]);
            right[k + 1 + i] -= factor * right[k];
        }
    }
    for k in (0..count).rev() {
        let known: f64 = (k + 1..count).map(|j| matrix[k * count + j] * right[j]).sum();
        right[k] = (right[k] - known) / matrix[k * count + k];
    }
}
