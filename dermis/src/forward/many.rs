//! Frames of many conductivities, and gradients of functions of them.

use super::{BatchSolver, ForwardError, ForwardModel, Gradient, KeptSolution};
use crate::frame::Frame;
use crate::geom::Point3;
use crate::linalg::LANES;
use rayon::prelude::*;
use std::borrow::Cow;

impl ForwardModel {
    /// The frames of `count` conductivities, as the instrument reports them: amplitudes if it loses the signs. They are
    /// solved in parallel, eight at once. A frame does not depend on the others.
    ///
    /// `conductivity` gives the conductivity with a number, per cell; `done` receives the number of frames that have just
    /// been solved.
    ///
    /// ```
    /// use dermis::forward::ForwardError;
    /// use dermis::skin::Skin;
    ///
    /// let skin = Skin::load("tank16")?;
    /// let forward = skin.forward();
    /// let maps: Vec<Vec<f64>> = [1.0, 2.0].map(|factor| forward.rest_conductivity().iter().map(|s| s * factor).collect()).into();
    /// let frames = forward.solve_many(maps.len(), |map| Ok::<_, ForwardError>(maps[map].as_slice().into()), |_| {})?;
    /// assert_eq!(frames.len(), 2);
    /// # Ok::<(), dermis::Error>(())
    /// ```
    ///
    /// # Errors
    /// The error of `conductivity`; a conductivity of the wrong length, or one that is not positive and finite.
    pub fn solve_many<'a, E: From<ForwardError> + Send>(
        &self,
        count: usize,
        conductivity: impl Fn(usize) -> Result<Cow<'a, [f64]>, E> + Sync,
        done: impl Fn(usize) + Sync,
    ) -> Result<Vec<Frame>, E> {
        let solve = |work: &mut Work, maps: &[Cow<'_, [f64]>]| work.solve(maps);
        Ok(self.for_each_group(count, conductivity, done, solve)?.into_iter().flatten().collect())
    }

    /// As [`solve_many`](Self::solve_many), with the same bits, frame after frame into one slice. Its memory is not
    /// touched before: what was allocated with zeros is cleared by the threads that write it.
    ///
    /// # Errors
    /// The same.
    ///
    /// # Panics
    /// If the length of `frames` is no multiple of the number of channels.
    pub fn solve_many_into<'a, E: From<ForwardError> + Send>(
        &self,
        conductivity: impl Fn(usize) -> Result<Cow<'a, [f64]>, E> + Sync,
        done: impl Fn(usize) + Sync,
        frames: &mut [f64],
    ) -> Result<(), E> {
        let channels = self.protocol().channel_count();
        assert!(frames.len().is_multiple_of(channels), "a value per channel");
        let of_group = |work: &mut Work, (group, rows): (usize, &mut [f64])| {
            let count = rows.len() / channels;
            let maps = (group * LANES..group * LANES + count).map(&conductivity).collect::<Result<Vec<_>, E>>()?;
            work.factor(&maps)?;
            rows.chunks_exact_mut(channels).enumerate().for_each(|(lane, row)| work.read_into(lane, row));
            done(count);
            Ok(())
        };
        let solver = self.batch_solver();
        frames.par_chunks_mut(LANES * channels).enumerate().try_for_each_init(|| Work::new(&solver), of_group)
    }

    /// As [`solve_many`](Self::solve_many), with the same bits, and keeps the conductivities for gradients.
    ///
    /// # Errors
    /// The same.
    pub fn solve_many_kept<'a, E: From<ForwardError> + Send>(
        &self,
        count: usize,
        conductivity: impl Fn(usize) -> Result<Cow<'a, [f64]>, E> + Sync,
        done: impl Fn(usize) + Sync,
    ) -> Result<(Vec<Frame>, Solutions), E> {
        let solve =
            |work: &mut Work, maps: &[Cow<'_, [f64]>]| Ok((work.solve(maps)?, work.solver.conductivity().to_vec()));
        let (frames, groups): (Vec<Vec<Frame>>, Vec<_>) =
            self.for_each_group(count, conductivity, done, solve)?.into_iter().unzip();
        let frames = frames.into_iter().flatten().collect();
        Ok((frames, Solutions { model: self.clone(), groups, count }))
    }

    /// The results for every eight conductivities, in parallel.
    fn for_each_group<'a, T: Send, E: From<ForwardError> + Send>(
        &self,
        count: usize,
        conductivity: impl Fn(usize) -> Result<Cow<'a, [f64]>, E> + Sync,
        done: impl Fn(usize) + Sync,
        solve: impl Fn(&mut Work, &[Cow<'_, [f64]>]) -> Result<T, ForwardError> + Sync,
    ) -> Result<Vec<T>, E> {
        let of_group = |work: &mut Work, group: usize| {
            let numbers = group * LANES..count.min((group + 1) * LANES);
            let maps = numbers.clone().map(&conductivity).collect::<Result<Vec<_>, E>>()?;
            let solved = solve(work, &maps)?;
            done(numbers.len());
            Ok(solved)
        };
        let solver = self.batch_solver();
        (0..count.div_ceil(LANES)).into_par_iter().map_init(|| Work::new(&solver), of_group).collect()
    }
}

/// Solutions of many conductivities, for gradients of functions of their frames.
///
/// They hold the conductivities alone. The factors of the systems are computed again for a gradient: to keep them takes
/// 1 to 2 MB of fresh memory for each solution, and more time than to compute them in memory that is used again.
#[derive(Debug, Clone)]
pub struct Solutions {
    model: ForwardModel,
    /// Every eight conductivities.
    groups: Vec<Vec<[f64; LANES]>>,
    count: usize,
}

/// The gradient of a function of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SolutionGradient {
    /// With respect to the conductivity of each cell.
    pub conductivity: Vec<f64>,
    /// With respect to the contact impedance of each electrode.
    pub contact_impedances: Vec<f64>,
    /// With respect to the position of each node.
    pub nodes: Vec<Point3>,
}

impl Solutions {
    /// Number of solutions.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The model that was solved.
    pub fn model(&self) -> &ForwardModel {
        &self.model
    }

    /// The results of `gradient` for every eight functions, in parallel.
    fn for_each<'a, T: Send>(
        &self,
        by_frame: impl Fn(usize) -> &'a [f64] + Sync,
        gradient: impl Fn(&mut BatchSolver, &KeptSolution, &[[f64; LANES]]) -> Vec<T> + Sync,
    ) -> Vec<T> {
        let protocol = self.model.protocol();
        let channels = protocol.channel_count();
        let (solver, zeros) = (self.model.batch_solver(), vec![[0.0; LANES]; channels]);
        let begin = || (solver.clone(), solver.kept_solution(), zeros.clone(), zeros.clone());
        let of_group = |(solver, kept, frames, derivatives): &mut (_, _, Vec<_>, Vec<_>), group: usize| {
            let solved = BatchSolver::solve_kept_into(solver, &self.groups[group], frames, kept);
            solved.expect("the same conductivities were solved before");
            let lanes = group * LANES..self.count.min((group + 1) * LANES);
            derivatives.fill([0.0; LANES]);
            for (lane, number) in lanes.clone().enumerate() {
                let values = by_frame(number);
                assert_eq!(values.len(), channels, "a derivative per channel");
                for (channel, &value) in values.iter().enumerate() {
                    let is_reversed = protocol.amplitude_only() && frames[channel][lane] < 0.0;
                    derivatives[channel][lane] = if is_reversed { -value } else { value };
                }
            }
            let mut results = gradient(solver, kept, derivatives);
            results.truncate(lanes.len());
            results
        };
        let groups = (0..self.groups.len()).into_par_iter();
        groups.map_init(begin, of_group).collect::<Vec<_>>().into_iter().flatten().collect()
    }

    /// The gradients of functions of the frames with respect to conductivity, contact impedances and nodes; `by_frame`
    /// gives the derivatives of a function with respect to the channels of its frame. In parallel.
    ///
    /// # Panics
    /// If a list of derivatives differs in length from the protocol.
    pub fn gradients<'a>(&self, by_frame: impl Fn(usize) -> &'a [f64] + Sync) -> Vec<SolutionGradient> {
        self.for_each(by_frame, |solver, kept, derivatives| {
            let Gradient { conductivity, contact_impedances, nodes } = solver.gradient(kept, derivatives);
            let lane = |lane: usize| SolutionGradient {
                conductivity: conductivity.iter().map(|lanes| lanes[lane]).collect(),
                contact_impedances: contact_impedances.iter().map(|lanes| lanes[lane]).collect(),
                nodes: nodes.iter().map(|node| node.map(|lanes| lanes[lane])).collect(),
            };
            (0..LANES).map(lane).collect()
        })
    }

    /// The gradients with respect to conductivity alone, in less time.
    ///
    /// # Panics
    /// If a list of derivatives differs in length from the protocol.
    pub fn conductivity_gradients<'a>(&self, by_frame: impl Fn(usize) -> &'a [f64] + Sync) -> Vec<Vec<f64>> {
        self.for_each(by_frame, |solver, kept, derivatives| {
            let gradient = solver.conductivity_gradient(kept, derivatives);
            (0..LANES).map(|lane| gradient.iter().map(|lanes| lanes[lane]).collect()).collect()
        })
    }
}

/// The work memory of a thread.
struct Work {
    solver: BatchSolver,
    values: Vec<[f64; LANES]>,
}

impl Work {
    fn new(solver: &BatchSolver) -> Self {
        Work { values: vec![[0.0; LANES]; solver.model().protocol().channel_count()], solver: solver.clone() }
    }

    /// The frames of at most as many conductivities as there are lanes, as the instrument reports them.
    fn solve(&mut self, maps: &[Cow<'_, [f64]>]) -> Result<Vec<Frame>, ForwardError> {
        self.factor(maps)?;
        let frame = |lane: usize| {
            let mut frame = Frame(vec![0.0; self.values.len()]);
            self.read_into(lane, &mut frame);
            frame
        };
        Ok((0..maps.len()).map(frame).collect())
    }

    /// Solves at most as many conductivities as there are lanes.
    fn factor(&mut self, maps: &[Cow<'_, [f64]>]) -> Result<(), ForwardError> {
        self.solver.load_maps(maps)?;
        self.solver.factor(None)?;
        self.solver.read_frames(&mut self.values);
        Ok(())
    }

    /// The frame of a lane, as the instrument reports it.
    fn read_into(&self, lane: usize, frame: &mut [f64]) {
        frame.iter_mut().zip(&self.values).for_each(|(value, lanes)| *value = lanes[lane]);
        self.solver.model().protocol().drop_signs(frame);
    }
}
