//! The integration tests in one program: it is linked once, and one test computes while another waits.

mod benchmark;
mod bound;
mod calibrate;
mod check_build;
mod check_frames;
mod commands;
mod docs;
mod export;
mod fabricate;
mod field_cases;
mod fit;
mod formats;
mod inputs;
mod optimise;
mod pages;
mod plot_and_demo;
mod readme;
mod robot;
mod shell;
mod simulate;
mod train;
mod workplace;
