//! Points, polygons and surfaces.

pub mod polygon;
pub mod surface;
pub mod triangle_tree;
pub mod vector;

pub use surface::Surface;
pub use triangle_tree::TriangleTree;
pub use vector::{Point2, Point3};
