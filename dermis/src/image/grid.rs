//! Pixels in a grid of rows and columns, and their exact overlaps with the triangles of a mesh.

use crate::design::Body;
use crate::geom::vector::bounding_box;
use crate::geom::{Chart, Point2, Point3, Shape, Surface, polygon};
use crate::image::PixelSpace;
use crate::mesh::{Cells, Mesh, MeshError};

/// Overlaps below this fraction of a cell are rounding errors at a shared edge.
const SMALLEST_FRACTION: f64 = 1e-12;

/// A pixel grid on a body: the unrolled wall of a cylinder, or the bounding box of a flat skin.
struct Grid {
    surface: Surface,
    chart: Chart,
    rows: usize,
    columns: usize,
    /// Corner of pixel (0, 0) in the chart.
    low: Point2,
    /// Extent of a pixel in the chart.
    step: Point2,
    /// Whether the last column is adjacent to the first, around a cylinder.
    wraps: bool,
}

/// The overlap of a triangle with one pixel: area and first moments in the chart.
struct Piece {
    position: usize,
    area: f64,
    moment: Point2,
}

pub(super) fn pixels(body: &Body, [rows, columns]: [usize; 2], mesh: &Mesh) -> Result<PixelSpace, MeshError> {
    let (Some(chart), Cells::Triangles(triangles)) = (body.chart(), &mesh.cells) else {
        let message = "a picture of rows and columns needs a cylinder, disk or rectangle; use an image per cell";
        return Err(MeshError::Invalid(message.into()));
    };
    if rows == 0 || columns == 0 {
        return Err(MeshError::Invalid(format!("a picture of {rows} rows and {columns} columns holds no pixel")));
    }
    let ([low, _], [width, height]) = (chart.bounds_m(), chart.size_m());
    let step = [width / columns as f64, height / rows as f64];
    let grid = Grid { surface: body.surface(), chart, rows, columns, low, step, wraps: chart.period_m().is_some() };
    Ok(grid.collect(mesh, triangles))
}

impl Grid {
    fn collect(&self, mesh: &Mesh, triangles: &[[usize; 3]]) -> PixelSpace {
        let count = self.rows * self.columns;
        let mut overlaps = vec![Vec::new(); count];
        let mut areas = vec![0.0; count];
        let mut chart_areas = vec![0.0; count];
        let mut moments = vec![[0.0; 2]; count];
        for (cell, triangle) in triangles.iter().enumerate() {
            let first = self.chart.unroll(mesh.nodes[triangle[0]]);
            let corners = triangle.map(|node| self.chart.unroll_beside(first, mesh.nodes[node]));
            let pieces = self.cut(&corners);
            let total: f64 = pieces.iter().map(|piece| piece.area).sum();
            for Piece { position, area, moment } in pieces {
                overlaps[position].push((cell, area / total));
                areas[position] += area / total * mesh.cell_measure(cell);
                chart_areas[position] += area;
                moments[position] = [moments[position][0] + moment[0], moments[position][1] + moment[1]];
            }
        }
        let position_in_grid: Vec<usize> = (0..count).filter(|&position| !overlaps[position].is_empty()).collect();
        let centres_m: Vec<Point3> = (position_in_grid.iter())
            .map(|&position| self.centre(position, moments[position], chart_areas[position]))
            .collect();
        let normals = (centres_m.iter())
            .map(|&centre| self.surface.normal(centre).expect("cylinders and planes know their normals"))
            .collect();
        PixelSpace {
            surface: self.surface,
            grid: Some([self.rows, self.columns]),
            neighbours: self.neighbours(&position_in_grid),
            areas: position_in_grid.iter().map(|&position| areas[position]).collect(),
            edge_m: Vec::new(),
            overlaps: position_in_grid.iter().map(|&position| std::mem::take(&mut overlaps[position])).collect(),
            centres_m,
            normals,
            position_in_grid,
        }
    }

    /// The parts of a triangle in each pixel. The outermost pixels extend beyond the box, so that rounding at the
    /// body's edge loses no area.
    fn cut(&self, corners: &[Point2; 3]) -> Vec<Piece> {
        let whole = polygon::signed_area(corners).abs();
        let mut pieces: Vec<Piece> = Vec::new();
        let (first_row, last_row) = self.lines(corners, 1, self.rows, false);
        for row in first_row..=last_row {
            let strip = self.clip(corners, 1, row, Some(self.rows));
            if strip.len() < 3 {
                continue;
            }
            let (first_column, last_column) = self.lines(&strip, 0, self.columns, self.wraps);
            for column in first_column..=last_column {
                let part = self.clip(&strip, 0, column, (!self.wraps).then_some(self.columns));
                let (area, moment) = area_and_moment(&part);
                if area <= SMALLEST_FRACTION * whole {
                    continue;
                }
                let inside = column.rem_euclid(self.columns as i64) as usize;
                let turns = (column - inside as i64) as f64 * self.step[0];
                let position = row as usize * self.columns + inside;
                let moment = [moment[0] - turns * area, moment[1]];
                match pieces.iter_mut().find(|piece| piece.position == position) {
                    Some(piece) => {
                        piece.area += area;
                        piece.moment = [piece.moment[0] + moment[0], piece.moment[1] + moment[1]];
                    }
                    None => pieces.push(Piece { position, area, moment }),
                }
            }
        }
        pieces
    }

    /// First and last line of pixels that some corners cover along an axis.
    fn lines(&self, corners: &[Point2], axis: usize, count: usize, wraps: bool) -> (i64, i64) {
        let line = |value: f64| {
            let line = ((value - self.low[axis]) / self.step[axis]).floor() as i64;
            if wraps { line } else { line.clamp(0, count as i64 - 1) }
        };
        let [low, high] = bounding_box(corners.iter().copied());
        (line(low[axis]), line(high[axis]))
    }

    /// The part of a polygon in one line of pixels along an axis; with a count the outer lines are unbounded outwards.
    fn clip(&self, corners: &[Point2], axis: usize, line: i64, open_count: Option<usize>) -> Vec<Point2> {
        let mut normal = [0.0; 2];
        let mut kept = corners.to_vec();
        if open_count.is_none_or(|count| line < count as i64 - 1) {
            normal[axis] = 1.0;
            kept = polygon::clip_half_plane(&kept, normal, self.low[axis] + (line + 1) as f64 * self.step[axis]);
        }
        if open_count.is_none() || line > 0 {
            normal[axis] = -1.0;
            kept = polygon::clip_half_plane(&kept, normal, -(self.low[axis] + line as f64 * self.step[axis]));
        }
        kept
    }

    /// The centre of the part of a pixel inside the body.
    fn centre(&self, position: usize, moment: Point2, area: f64) -> Point3 {
        let (row, column) = (position / self.columns, position % self.columns);
        let middle = |axis: usize, line: usize| self.low[axis] + (line as f64 + 0.5) * self.step[axis];
        self.chart.roll(match self.chart.shape() {
            // A pixel of the wall is entirely inside.
            Shape::Wall { .. } => [middle(0, column), middle(1, row)],
            _ => moment.map(|moment| moment / area),
        })
    }

    /// The up to four existing pixels of the grid that share an edge with each pixel.
    fn neighbours(&self, position_in_grid: &[usize]) -> Vec<Vec<usize>> {
        let mut index = vec![None; self.rows * self.columns];
        for (pixel, &position) in position_in_grid.iter().enumerate() {
            index[position] = Some(pixel);
        }
        let around = |&position: &usize| {
            let (row, column) = ((position / self.columns) as i64, (position % self.columns) as i64);
            let mut found: Vec<usize> = [(-1, 0), (0, -1), (0, 1), (1, 0)]
                .into_iter()
                .filter_map(|(up, right)| self.position(row + up, column + right))
                .filter(|&other| other != position)
                .filter_map(|other| index[other])
                .collect();
            found.sort_unstable();
            found.dedup();
            found
        };
        position_in_grid.iter().map(around).collect()
    }

    fn position(&self, row: i64, column: i64) -> Option<usize> {
        let columns = self.columns as i64;
        let column = if self.wraps { column.rem_euclid(columns) } else { column };
        let inside = (0..self.rows as i64).contains(&row) && (0..columns).contains(&column);
        inside.then(|| (row * columns + column) as usize)
    }
}

/// Area and first moments of a polygon, for either order of its corners.
fn area_and_moment(corners: &[Point2]) -> (f64, Point2) {
    let Some(&origin) = corners.first() else { return (0.0, [0.0; 2]) };
    let (mut area, mut moment) = (0.0, [0.0; 2]);
    for pair in corners.windows(2).skip(1) {
        let triangle = [origin, pair[0], pair[1]];
        let part = polygon::signed_area(&triangle);
        area += part;
        for axis in 0..2 {
            moment[axis] += part * (triangle[0][axis] + triangle[1][axis] + triangle[2][axis]) / 3.0;
        }
    }
    let sign = if area < 0.0 { -1.0 } else { 1.0 };
    (sign * area, [sign * moment[0], sign * moment[1]])
}
