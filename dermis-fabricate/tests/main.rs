//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod workshop;
