//! Export of a problem as NPY files, for the other programs.

use crate::problem::Problem;
use dermis::frame::write_array;
use dermis::linalg::LANES;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::error::Error;
use std::path::Path;

/// Writes the mesh, its electrodes and channels, the conductivities and our voltages for each: one by one, and batched.
pub fn write_problem(problem: &Problem, folder: &Path) -> Result<(), Box<dyn Error>> {
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
    let channel_count = model.protocol().channel_count();
    save("voltages", &[problem.conductivities.len(), channel_count], &frames)?;
    let mut batched = vec![[0.0; LANES]; channel_count];
    model.batch_solver().solve_into(&problem.batch(), &mut batched)?;
    save("voltages_batched", &[channel_count, LANES], batched.as_flattened())?;
    Ok(())
}

/// One row per simplex of a patch: the electrode, then its corners.
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
