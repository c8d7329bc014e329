//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod corrected_twins;
mod file_and_live;
mod real_presses;
mod refined;
mod training;
mod wrong_input;
