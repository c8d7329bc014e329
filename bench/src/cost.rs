//! Dependence of the solve time on the mesh size.

use crate::problem::Problem;
use crate::serve::time_forward;
use dermis::linalg::{LANES, SimdLevel};
use dermis::stats::upper_median;
use std::error::Error;
use std::time::{Duration, Instant};

/// Edge lengths and their growth, relative to its own, that give `cylinder30` about 1,000, 2,000, 5,000, 20,000 and
/// 50,000 nodes. The coarsest needs a faster growth, because its electrodes have the same number of corners.
const SCALES: [[f64; 2]; 5] = [[4.5, 2.0], [1.9, 1.0], [1.0, 1.0], [0.475, 1.0], [0.292, 1.0]];
/// Time per line, and the minimum number of batches.
const PATIENCE: Duration = Duration::from_millis(1500);
const MIN: usize = 9;

/// One line per mesh and instruction set: `batched_ms` and `single_ms` are medians per sample.
pub fn print() -> Result<(), Box<dyn Error>> {
    println!("nodes,cells,factor_entries,multiply_adds,level,batched_ms,single_ms");
    for [edges, growth] in SCALES {
        let problem = Problem::cylinder(edges, growth)?;
        let (mesh, symbolic) = (problem.model.mesh(), problem.model.symbolic());
        let single = upper_median(&time_forward(&problem, 21)?).unwrap_or(f64::NAN);
        for level in SimdLevel::available() {
            let batched = upper_median(&time_at(&problem, level)?).unwrap_or(f64::NAN);
            println!(
                "{},{},{},{},{},{:.4},{:.4}",
                mesh.node_count(),
                mesh.cell_count(),
                symbolic.value_count(),
                symbolic.multiply_add_count(),
                format!("{level:?}").to_lowercase(),
                1e3 * batched,
                1e3 * single
            );
        }
    }
    Ok(())
}

/// Seconds per sample of batches at an instruction set.
fn time_at(problem: &Problem, level: SimdLevel) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut solver = problem.model.batch_solver_at(level);
    let batch = problem.batch();
    let mut frames = vec![[0.0; LANES]; problem.model.protocol().channel_count()];
    solver.solve_into(&batch, &mut frames)?;
    let mut times = Vec::new();
    let begin = Instant::now();
    while times.len() < MIN || begin.elapsed() < PATIENCE {
        let start = Instant::now();
        solver.solve_into(&batch, &mut frames)?;
        times.push(start.elapsed().as_secs_f64() / LANES as f64);
    }
    Ok(times)
}
