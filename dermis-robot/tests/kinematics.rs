//! Kinematics against exact solutions, finite differences and an independent program.
