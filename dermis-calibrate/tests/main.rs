//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod amplitudes;
mod built;
mod built_skins;
mod checks;
mod correction;
mod corrupted_recordings;
mod real_presses;
mod recordings;
mod several_touches;
mod synthetic;
mod useless_labels;
