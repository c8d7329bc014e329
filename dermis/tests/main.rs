//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod cylinder30_mesh;
mod dependencies;
mod disk_analytic;
mod disk_arcs;
mod fit_reference;
mod forward_gradient;
mod forward_many;
mod forward_physics;
mod forward_reference;
mod fuzz_readers;
mod layers;
mod mesh_bodies;
mod mesh_broken;
mod mesh_files;
mod mesh_generation;
mod mesh_surfaces;
mod one_step_reference;
mod patch_exact;
mod reference;
mod reference_methods;
mod rim_arcs;
mod shapes;
mod sparse_cholesky;
