//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod batched_forward;
mod bound;
mod changed_parameters;
mod gauss_newton;
mod other_physics;
mod patched_skin;
mod real_presses;
mod tank;
mod training_mesh;
