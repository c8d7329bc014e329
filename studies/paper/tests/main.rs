//! All integration tests as one program: one link.

mod reproduce;
