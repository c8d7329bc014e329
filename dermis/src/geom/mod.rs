//! Points, polygons and surfaces.

pub mod polygon;
pub mod surface;
pub mod vector;

pub use surface::Surface;
pub use vector::{Point2, Point3};
