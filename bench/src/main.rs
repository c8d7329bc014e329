//! Our half of the comparison with other programs (`bench/peers/run.sh` drives it).
//!
//! `dermis-bench CASE FOLDER` writes a problem (mesh, electrodes, channels, conductivities) and our voltages into the
//! folder as NPY files. Then it waits for commands on the standard input, so that the other programs and this one can take
//! turns in one run: `forward N` and `jacobian N` answer with one line of N times in seconds, the end of input ends it.

use dermis::frame::write_array;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::error::Error;
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

mod problem;

use problem::Problem;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [case, folder] = &arguments[..] else {
        return Err("usage: dermis-bench cylinder30|cylinder30-points|disk30|disk30-points FOLDER".into());
    };
    let problem = Problem::named(case)?;
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    write_problem(&problem, &folder)?;
    println!("ready {} nodes {} cells", problem.model.mesh().node_count(), problem.model.mesh().cell_count());
    serve(&problem)
}

fn serve(problem: &Problem) -> Result<(), Box<dyn Error>> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (command, count) = line.split_once(' ').ok_or("a command and a number")?;
        let count: usize = count.trim().parse()?;
        let times = match command {
            "forward" => time_forward(problem, count)?,
            "jacobian" => time_jacobian(problem, count)?,
            _ => return Err(format!("unknown command `{command}`").into()),
        };
        let words: Vec<String> = times.iter().map(f64::to_string).collect();
        println!("{}", words.join(" "));
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// Seconds for one new conductivity to a frame, symbolic factor and memory kept.
fn time_forward(problem: &Problem, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut solver = problem.model.solver();
    let mut values = vec![0.0; problem.model.protocol().channel_count()];
    let mut times = Vec::with_capacity(count);
    for conductivity in problem.conductivities.iter().cycle().take(count) {
        let start = Instant::now();
        solver.solve_into(conductivity, &mut values)?;
        times.push(start.elapsed().as_secs_f64());
        assert!(std::hint::black_box(&values).iter().all(|value| value.is_finite()), "a frame of numbers");
    }
    Ok(times)
}

/// Seconds for the Jacobian per pixel at a new conductivity, the factorisation included.
fn time_jacobian(problem: &Problem, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut times = Vec::with_capacity(count);
    for conductivity in problem.conductivities.iter().cycle().take(count) {
        let start = Instant::now();
        let jacobian = problem.model.pixel_jacobian(conductivity, &problem.pixels)?;
        times.push(start.elapsed().as_secs_f64());
        assert!(std::hint::black_box(&jacobian).values[0].is_finite(), "a Jacobian of numbers");
    }
    Ok(times)
}

fn write_problem(problem: &Problem, folder: &Path) -> Result<(), Box<dyn Error>> {
    let model = &problem.model;
    let mesh = model.mesh();
    let save = |name: &str, shape: &[usize], values: &[f64]| {
        write_array(&folder.join(format!("{name}.npy")), name, shape, values)
    };
    save("nodes", &[mesh.node_count(), 3], mesh.nodes.as_flattened())?;
    let Cells::Triangles(triangles) = &mesh.cells else { return Err("the comparison is for surfaces".into()) };
    save("cells", &[triangles.len(), 3], &as_numbers(triangles.as_flattened()))?;
    let parts = electrode_parts(mesh);
    let corner_count = parts.first().map_or(1, |part| part.len() - 1);
    save("electrode_parts", &[parts.len(), corner_count + 1], &as_numbers(&parts.concat()))?;
    save("contact_impedances", &[mesh.electrodes.len()], model.contact_impedances())?;
    let channels: Vec<usize> =
        model.protocol().channels().iter().flat_map(|channel| [channel.drive, channel.measure].concat()).collect();
    save("channels", &[channels.len() / 4, 4], &as_numbers(&channels))?;
    save("conductivities", &[problem.conductivities.len(), mesh.cell_count()], &problem.conductivities.concat())?;
    let mut frames = Vec::new();
    for conductivity in &problem.conductivities {
        frames.extend_from_slice(&model.solve(conductivity)?);
    }
    save("voltages", &[problem.conductivities.len(), model.protocol().channel_count()], &frames)?;
    Ok(())
}

/// A row per simplex of a patch: the electrode, then its corners.
fn electrode_parts(mesh: &Mesh) -> Vec<Vec<usize>> {
    let mut rows = Vec::new();
    for (electrode, patch) in mesh.electrodes.iter().enumerate() {
        let simplices: Vec<Vec<usize>> = match patch {
            ElectrodePatch::Cells(cells) => cells.iter().map(|&cell| mesh.cells.corners(cell).to_vec()).collect(),
            ElectrodePatch::Edges(edges) => edges.iter().map(|edge| edge.to_vec()).collect(),
            ElectrodePatch::Faces(faces) => faces.iter().map(|face| face.to_vec()).collect(),
            ElectrodePatch::Node(node) => vec![vec![*node]],
        };
        rows.extend(simplices.into_iter().map(|corners| [vec![electrode], corners].concat()));
    }
    rows
}

fn as_numbers(indices: &[usize]) -> Vec<f64> {
    indices.iter().map(|&index| index as f64).collect()
}
