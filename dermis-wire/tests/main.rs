//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod messages;
mod no_std;
mod specification;
mod stream;
