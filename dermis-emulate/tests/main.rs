//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod bodies;
mod campaign;
mod fuzz_page;
mod page;
mod rows;
mod settling;
