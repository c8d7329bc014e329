//! Robots from their files.
