//! The prior of the image: the matrix R of the penalty x'Rx.

use crate::design::{Body, SkinDesign};
use crate::image::PixelSpace;
use crate::reconstruct::ReconstructError;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, MatRef, Side};

/// The prior of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// Every pixel is small: `R = I`.
    Tikhonov,
    /// Every pixel is small relative to its sensitivity: `R = diag(J'J)^exponent` (Cheney, Isaacson, Newell et al.
    /// 1990, DOI 10.1002/ima.1850020203).
    Noser {
        /// 0 is the Tikhonov prior, 1 the original NOSER; 0.5 is usual.
        exponent: f64,
    },
    /// Neighbours are similar (a spatial high-pass): `R = 2 x` the graph Laplacian of pixels that share an edge.
    Laplace,
}

impl Default for Prior {
    /// NOSER with the exponent 0.5.
    fn default() -> Self {
        Prior::Noser { exponent: 0.5 }
    }
}

/// The default prior of a skin.
///
/// Laplace on bodies from a mesh file, whose images have a value per cell: on these NOSER often gives false contacts at
/// the electrodes. NOSER on all others. `cargo run --release -p dermis-sim --example choose_prior -- bodies` compares
/// them.
///
/// ```
/// use dermis::design::SkinDesign;
/// use dermis::reconstruct::{Prior, default_prior};
///
/// let design = SkinDesign::shipped("cylinder30").unwrap();
/// assert_eq!(default_prior(&design), Prior::Noser { exponent: 0.5 });
/// ```
pub fn default_prior(design: &SkinDesign) -> Prior {
    match design.body {
        Body::Mesh { .. } => Prior::Laplace,
        Body::Cylinder { .. } | Body::Disk { .. } | Body::Rectangle { .. } => Prior::default(),
    }
}

impl Prior {
    /// Its name in tables.
    pub fn name(&self) -> String {
        match self {
            Prior::Tikhonov => "Tikhonov".into(),
            Prior::Noser { exponent: 0.5 } => "NOSER".into(),
            Prior::Noser { exponent } => format!("NOSER^{exponent}"),
            Prior::Laplace => "Laplace".into(),
        }
    }

    /// The matrix R over some pixels, for a Jacobian with channels as rows.
    pub(crate) fn matrix(self, jacobian: MatRef<'_, f64>, pixels: &PixelSpace) -> Result<Penalty, ReconstructError> {
        let count = jacobian.ncols();
        match self {
            Prior::Tikhonov => Ok(Penalty::Diagonal(vec![1.0; count])),
            Prior::Noser { exponent } => {
                if !(exponent.is_finite() && exponent >= 0.0) {
                    let message = format!("the NOSER exponent is {exponent}: it must be a number from 0 upwards");
                    return Err(ReconstructError::Parameter(message));
                }
                let power = |column: usize| jacobian.col(column).squared_norm_l2().powf(exponent);
                Ok(Penalty::Diagonal((0..count).map(power).collect()))
            }
            Prior::Laplace => Ok(Penalty::Graph(Graph::new(&pixels.neighbours, |_, _| 2.0)?)),
        }
    }
}

/// The matrix R of a penalty x'Rx.
#[derive(Debug, Clone)]
pub(crate) enum Penalty {
    /// A diagonal. A pixel of weight zero has no sensitivity in any channel.
    Diagonal(Vec<f64>),
    /// A graph's Laplacian.
    Graph(Graph),
}

impl Penalty {
    pub(crate) fn trace(&self) -> f64 {
        match self {
            Penalty::Diagonal(weights) => weights.iter().sum(),
            Penalty::Graph(graph) => graph.edges.iter().flatten().map(|edge| edge.1).sum(),
        }
    }

    /// `R x`.
    pub(crate) fn apply(&self, image: &[f64]) -> Vec<f64> {
        match self {
            Penalty::Diagonal(weights) => weights.iter().zip(image).map(|(w, x)| w * x).collect(),
            Penalty::Graph(graph) => {
                let pull = |(pixel, edges): (usize, &Vec<(usize, f64)>)| {
                    edges.iter().map(|&(other, weight)| weight * (image[pixel] - image[other])).sum()
                };
                graph.edges.iter().enumerate().map(pull).collect()
            }
        }
    }

    /// `matrix + factor R`, in place; a pixel without any weight gets a one on the diagonal, which keeps it at zero.
    pub(crate) fn add_to(&self, matrix: &mut Mat<f64>, factor: f64) {
        match self {
            Penalty::Diagonal(weights) => {
                for (pixel, &weight) in weights.iter().enumerate() {
                    matrix[(pixel, pixel)] += if weight > 0.0 { factor * weight } else { 1.0 };
                }
            }
            Penalty::Graph(graph) => {
                for (pixel, edges) in graph.edges.iter().enumerate() {
                    for &(other, weight) in edges {
                        matrix[(pixel, pixel)] += factor * weight;
                        matrix[(pixel, other)] -= factor * weight;
                    }
                }
            }
        }
    }

    /// `R^-1 J'`, pixels x channels. For a graph, R is made regular by fixing one pixel of each component at zero (see
    /// [`Graph`]).
    pub(crate) fn solve(&self, jacobian: MatRef<'_, f64>) -> Result<Mat<f64>, ReconstructError> {
        match self {
            Penalty::Diagonal(weights) => Ok(Mat::from_fn(jacobian.ncols(), jacobian.nrows(), |pixel, channel| {
                if weights[pixel] > 0.0 { jacobian[(channel, pixel)] / weights[pixel] } else { 0.0 }
            })),
            Penalty::Graph(graph) => graph.solve(jacobian),
        }
    }

    /// For each pixel its component in the null space of R: `None` if R is regular.
    pub(crate) fn components(&self) -> Option<(&[usize], usize)> {
        match self {
            Penalty::Diagonal(_) => None,
            Penalty::Graph(graph) => Some((&graph.component, graph.component_count)),
        }
    }
}

/// The graph of pixels that share an edge, with a weight for each edge.
///
/// Its Laplacian, `x'Rx = sum over edges of weight (x_i - x_j)^2`, is singular: a constant on a connected component has
/// no penalty. With the first pixel of each component fixed at zero the rest is positive definite; the constants are
/// then fitted to the data (see [`super::system`]).
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    /// For each pixel its neighbours and the weight of the edge between them.
    edges: Vec<Vec<(usize, f64)>>,
    /// Component of each pixel.
    component: Vec<usize>,
    component_count: usize,
    /// Position of each pixel among those not fixed; `None` for the fixed ones.
    free: Vec<Option<usize>>,
}

impl Graph {
    /// The graph of the neighbours; `weight` returns the weight of the edge between two pixels and must be symmetric.
    pub(crate) fn new(
        neighbours: &[Vec<usize>],
        weight: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, ReconstructError> {
        for (pixel, list) in neighbours.iter().enumerate() {
            if let Some(&other) = list.iter().find(|&&o| o >= neighbours.len() || !neighbours[o].contains(&pixel)) {
                let message =
                    format!("pixel {pixel} names pixel {other} as its neighbour, but not the other way round");
                return Err(ReconstructError::Parameter(message));
            }
        }
        let mut graph = Graph {
            edges: neighbours.iter().map(|list| list.iter().map(|&other| (other, 0.0)).collect()).collect(),
            component: vec![usize::MAX; neighbours.len()],
            component_count: 0,
            free: Vec::with_capacity(neighbours.len()),
        };
        let mut held = vec![false; neighbours.len()];
        for (start, is_held) in held.iter_mut().enumerate() {
            if graph.component[start] == usize::MAX {
                *is_held = true;
                graph.flood(start);
            }
        }
        graph.reweigh(weight);
        let mut count = 0..;
        graph.free.extend(held.into_iter().map(|is_held| if is_held { None } else { count.next() }));
        Ok(graph)
    }

    /// Gives every edge its weight.
    fn reweigh(&mut self, weight: impl Fn(usize, usize) -> f64) {
        for (pixel, edges) in self.edges.iter_mut().enumerate() {
            edges.iter_mut().for_each(|(other, value)| *value = weight(pixel, *other));
        }
    }

    /// Marks all pixels connected with a pixel as one component.
    fn flood(&mut self, start: usize) {
        let mut waiting = vec![start];
        self.component[start] = self.component_count;
        while let Some(pixel) = waiting.pop() {
            for &(other, _) in &self.edges[pixel] {
                if self.component[other] == usize::MAX {
                    self.component[other] = self.component_count;
                    waiting.push(other);
                }
            }
        }
        self.component_count += 1;
    }

    /// The factor of the Laplacian.
    pub(crate) fn factored(&self) -> Result<FactoredGraph, ReconstructError> {
        let free: Vec<usize> = (0..self.free.len()).filter(|&pixel| self.free[pixel].is_some()).collect();
        let factor = if free.is_empty() { None } else { Some(self.factor(free.len())?) };
        Ok(FactoredGraph { free, factor })
    }

    /// The Laplacian without the rows and columns of the fixed pixels.
    fn factor(&self, free_count: usize) -> Result<Llt<usize, f64>, ReconstructError> {
        let mut entries = Vec::new();
        for (pixel, edges) in self.edges.iter().enumerate() {
            let Some(row) = self.free[pixel] else { continue };
            entries.push(Triplet::new(row, row, edges.iter().map(|edge| edge.1).sum()));
            let free = |&(other, weight): &(usize, f64)| Some(Triplet::new(row, self.free[other]?, -weight));
            entries.extend(edges.iter().filter_map(free));
        }
        SparseColMat::<usize, f64>::try_new_from_triplets(free_count, free_count, &entries)
            .map_err(|error| ReconstructError::Singular(format!("the Laplace prior has no matrix: {error:?}")))?
            .sp_cholesky(Side::Lower)
            .map_err(|error| ReconstructError::Singular(format!("the Laplace prior cannot be factored: {error:?}")))
    }

    fn solve(&self, jacobian: MatRef<'_, f64>) -> Result<Mat<f64>, ReconstructError> {
        let mut full = jacobian.transpose().to_owned();
        self.factored()?.solve_matrix_in_place(&mut full);
        Ok(full)
    }
}

/// The factor of a graph's Laplacian with the first pixel of each component fixed at zero.
#[derive(Debug, Clone)]
pub(crate) struct FactoredGraph {
    /// The pixels that are not fixed.
    free: Vec<usize>,
    /// `None` if all are.
    factor: Option<Llt<usize, f64>>,
}

impl FactoredGraph {
    /// `R^-1 x` for each column of a matrix.
    fn solve_matrix_in_place(&self, values: &mut Mat<f64>) {
        let columns = values.ncols();
        let mut reduced = Mat::from_fn(self.free.len(), columns, |row, column| values[(self.free[row], column)]);
        if let Some(factor) = &self.factor {
            factor.solve_in_place(reduced.as_mut());
        }
        values.fill(0.0);
        for column in 0..columns {
            for (row, &pixel) in self.free.iter().enumerate() {
                values[(pixel, column)] = reduced[(row, column)];
            }
        }
    }

    /// `R^-1 x` for an image that sums to zero over each component.
    pub(crate) fn solve_in_place(&self, image: &mut [f64]) {
        let mut column = Mat::from_fn(image.len(), 1, |pixel, _| image[pixel]);
        self.solve_matrix_in_place(&mut column);
        image.iter_mut().zip(column.col(0).iter()).for_each(|(value, solved)| *value = *solved);
    }
}
