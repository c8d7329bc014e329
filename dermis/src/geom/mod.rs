//! Points, polygons and surfaces.

mod place_limits;
pub mod polygon;
pub mod surface;
mod triangle_tree;
pub mod vector;

pub use place_limits::PlaceLimits;
pub use surface::Surface;
pub use triangle_tree::{Nearest, TriangleTree};
pub use vector::{Point2, Point3};
