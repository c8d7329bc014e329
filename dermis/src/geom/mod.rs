//! Points, polygons, surfaces and their charts.

mod chart;
mod edge;
mod place_limits;
pub mod polygon;
pub mod surface;
mod triangle_tree;
pub mod vector;

pub use chart::{Chart, Elementary, Shape, System};
pub(crate) use edge::Edge;
pub use place_limits::{PlaceLimits, beyond_a_turn};
pub use surface::Surface;
pub use triangle_tree::{Nearest, TriangleTree};
pub use vector::{Point2, Point3};
