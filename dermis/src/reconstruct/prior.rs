//! What an image is expected to look like before it is measured: the matrix R of the penalty x'Rx.

use crate::image::PixelSpace;
use crate::reconstruct::ReconstructError;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, MatRef, Side};

/// What an image is expected to look like before it is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// Every pixel is small: `R = I`.
    Tikhonov,
    /// Every pixel is small by the measure of its own sensitivity: `R = diag(J'J)^exponent` (Cheney, Isaacson, Newell
    /// et al. 1990, DOI 10.1002/ima.1850020203).
    Noser {
        /// 0 is Tikhonov's prior, 1 the original NOSER; 0.5 is usual.
        exponent: f64,
    },
    /// Neighbours are alike (a spatial high-pass): `R = 2 x` the graph Laplacian of pixels that share an edge.
    Laplace,
}

impl Default for Prior {
    /// NOSER with the exponent 0.5.
    fn default() -> Self {
        Prior::Noser { exponent: 0.5 }
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
            Prior::Laplace => Ok(Penalty::Graph(Graph::new(&pixels.neighbours)?)),
        }
    }
}

/// The matrix R of a penalty x'Rx.
#[derive(Debug, Clone)]
pub(crate) enum Penalty {
    /// A diagonal. A pixel of weight zero is one that no channel sees.
    Diagonal(Vec<f64>),
    /// Twice a graph's Laplacian.
    Graph(Graph),
}

impl Penalty {
    pub(crate) fn trace(&self) -> f64 {
        match self {
            Penalty::Diagonal(weights) => weights.iter().sum(),
            Penalty::Graph(graph) => graph.neighbours.iter().map(|list| 2.0 * list.len() as f64).sum(),
        }
    }

    /// `R x`.
    #[cfg(test)]
    pub(crate) fn apply(&self, image: &[f64]) -> Vec<f64> {
        match self {
            Penalty::Diagonal(weights) => weights.iter().zip(image).map(|(w, x)| w * x).collect(),
            Penalty::Graph(graph) => {
                let difference = |(pixel, list): (usize, &Vec<usize>)| {
                    list.iter().map(|&other| 2.0 * (image[pixel] - image[other])).sum()
                };
                graph.neighbours.iter().enumerate().map(difference).collect()
            }
        }
    }

    /// `matrix + factor R`, in place; a pixel without any weight gets one on the diagonal, which keeps it at zero.
    pub(crate) fn add_to(&self, matrix: &mut Mat<f64>, factor: f64) {
        match self {
            Penalty::Diagonal(weights) => {
                for (pixel, &weight) in weights.iter().enumerate() {
                    matrix[(pixel, pixel)] += if weight > 0.0 { factor * weight } else { 1.0 };
                }
            }
            Penalty::Graph(graph) => {
                for (pixel, list) in graph.neighbours.iter().enumerate() {
                    matrix[(pixel, pixel)] += factor * 2.0 * list.len() as f64;
                    for &other in list {
                        matrix[(pixel, other)] -= factor * 2.0;
                    }
                }
            }
        }
    }

    /// `R^-1 J'`, pixels x channels. For a graph R is made regular by holding one pixel of each component at zero (see
    /// [`Graph`]).
    pub(crate) fn solve(&self, jacobian: MatRef<'_, f64>) -> Result<Mat<f64>, ReconstructError> {
        match self {
            Penalty::Diagonal(weights) => Ok(Mat::from_fn(jacobian.ncols(), jacobian.nrows(), |pixel, channel| {
                if weights[pixel] > 0.0 { jacobian[(channel, pixel)] / weights[pixel] } else { 0.0 }
            })),
            Penalty::Graph(graph) => graph.solve(jacobian),
        }
    }

    /// For each pixel the component of the images that R does not see: `None` where R is regular.
    pub(crate) fn components(&self) -> Option<(&[usize], usize)> {
        match self {
            Penalty::Diagonal(_) => None,
            Penalty::Graph(graph) => Some((&graph.component, graph.component_count)),
        }
    }
}

/// The graph of pixels that share an edge.
///
/// Its Laplacian is singular: a constant on a connected component costs nothing. With the first pixel of each component
/// held at zero the rest is positive definite; the constants are then fitted to the data (see
/// [`super::system`]).
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    neighbours: Vec<Vec<usize>>,
    /// Component of each pixel.
    component: Vec<usize>,
    component_count: usize,
    /// Position of each pixel among those not held; `None` for the held ones.
    free: Vec<Option<usize>>,
}

impl Graph {
    fn new(neighbours: &[Vec<usize>]) -> Result<Self, ReconstructError> {
        for (pixel, list) in neighbours.iter().enumerate() {
            if let Some(&other) = list.iter().find(|&&o| o >= neighbours.len() || !neighbours[o].contains(&pixel)) {
                let message =
                    format!("pixel {pixel} names pixel {other} as its neighbour, but not the other way round");
                return Err(ReconstructError::Parameter(message));
            }
        }
        let mut graph = Graph {
            neighbours: neighbours.to_vec(),
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
        let mut count = 0..;
        graph.free.extend(held.into_iter().map(|is_held| if is_held { None } else { count.next() }));
        Ok(graph)
    }

    /// Marks all that hangs together with a pixel as one component.
    fn flood(&mut self, start: usize) {
        let mut waiting = vec![start];
        self.component[start] = self.component_count;
        while let Some(pixel) = waiting.pop() {
            for &other in &self.neighbours[pixel] {
                if self.component[other] == usize::MAX {
                    self.component[other] = self.component_count;
                    waiting.push(other);
                }
            }
        }
        self.component_count += 1;
    }

    /// The Laplacian, doubled, without the rows and columns of the held pixels.
    fn factor(&self, free_count: usize) -> Result<Llt<usize, f64>, ReconstructError> {
        let mut entries = Vec::new();
        for (pixel, list) in self.neighbours.iter().enumerate() {
            let Some(row) = self.free[pixel] else { continue };
            entries.push(Triplet::new(row, row, 2.0 * list.len() as f64));
            entries.extend(list.iter().filter_map(|&other| self.free[other]).map(|col| Triplet::new(row, col, -2.0)));
        }
        SparseColMat::<usize, f64>::try_new_from_triplets(free_count, free_count, &entries)
            .map_err(|error| ReconstructError::Singular(format!("the Laplace prior has no matrix: {error:?}")))?
            .sp_cholesky(Side::Lower)
            .map_err(|error| ReconstructError::Singular(format!("the Laplace prior cannot be factored: {error:?}")))
    }

    fn solve(&self, jacobian: MatRef<'_, f64>) -> Result<Mat<f64>, ReconstructError> {
        let free: Vec<usize> = (0..self.free.len()).filter(|&pixel| self.free[pixel].is_some()).collect();
        let mut full = Mat::zeros(jacobian.ncols(), jacobian.nrows());
        if free.is_empty() {
            return Ok(full);
        }
        let mut reduced = Mat::from_fn(free.len(), jacobian.nrows(), |row, channel| jacobian[(channel, free[row])]);
        self.factor(free.len())?.solve_in_place(reduced.as_mut());
        for channel in 0..jacobian.nrows() {
            for (row, &pixel) in free.iter().enumerate() {
                full[(pixel, channel)] = reduced[(row, channel)];
            }
        }
        Ok(full)
    }
}
