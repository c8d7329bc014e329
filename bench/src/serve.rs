//! Outputs times, in turns with other programs.

use crate::export::write_problem;
use crate::problem::Problem;
use dermis::forward::ForwardError;
use dermis::linalg::LANES;
use std::error::Error;
use std::io::{BufRead, Write};
use std::path::Path;
use std::sync::Barrier;
use std::time::Instant;

pub fn serve(case: &str, folder: &Path) -> Result<(), Box<dyn Error>> {
    let problem = Problem::named(case)?;
    std::fs::create_dir_all(folder)?;
    write_problem(&problem, folder)?;
    answer(|words| match *words {
        ["forward", count] => time_forward(&problem, count.parse()?),
        ["batched", count] => time_batched(&problem, count.parse()?),
        ["many", maps, count] => time_many(&problem, maps.parse()?, count.parse()?),
        ["jacobian", count] => time_jacobian(&problem, count.parse()?),
        ["forward-on", threads, count] => Ok(vec![on_threads(threads.parse()?, count.parse()?, || {
            let mut solver = problem.model.solver();
            let mut values = vec![0.0; problem.model.protocol().channel_count()];
            let mut turn = problem.conductivities.iter().cycle();
            move || {
                let conductivity = turn.next().expect("a cycle has no end");
                solver.solve_into(conductivity, &mut values).expect("positive conductivities");
                assert_finite(&values);
                1
            }
        })]),
        ["batched-on", threads, count] => Ok(vec![on_threads(threads.parse()?, count.parse()?, || {
            let mut solver = problem.model.batch_solver();
            let batch = problem.batch();
            let mut frames = vec![[0.0; LANES]; problem.model.protocol().channel_count()];
            move || {
                solver.solve_into(&batch, &mut frames).expect("positive conductivities");
                assert_finite(frames.as_flattened());
                LANES
            }
        })]),
        _ => Err(format!("unknown command `{}`", words.join(" ")).into()),
    })
}

/// Prints that it is ready, then answers each line of the standard input with a line of times, until the input ends.
pub fn answer(mut times: impl FnMut(&[&str]) -> Result<Vec<f64>, Box<dyn Error>>) -> Result<(), Box<dyn Error>> {
    println!("ready");
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let times = times(&line.split_whitespace().collect::<Vec<&str>>())?;
        let words: Vec<String> = times.iter().map(f64::to_string).collect();
        println!("{}", words.join(" "));
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// Seconds from one new conductivity to a frame; the symbolic factorisation and memory are reused.
pub fn time_forward(problem: &Problem, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut solver = problem.model.solver();
    let mut values = vec![0.0; problem.model.protocol().channel_count()];
    let mut times = Vec::with_capacity(count);
    for conductivity in problem.conductivities.iter().cycle().take(count) {
        let start = Instant::now();
        solver.solve_into(conductivity, &mut values)?;
        times.push(start.elapsed().as_secs_f64());
        assert_finite(&values);
    }
    Ok(times)
}

/// Seconds per sample from eight new conductivities to their frames.
fn time_batched(problem: &Problem, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut solver = problem.model.batch_solver();
    let mut batch = problem.batch();
    let mut frames = vec![[0.0; LANES]; problem.model.protocol().channel_count()];
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        solver.solve_into(&batch, &mut frames)?;
        times.push(start.elapsed().as_secs_f64() / LANES as f64);
        assert_finite(frames.as_flattened());
        batch.iter_mut().for_each(|lanes| lanes.rotate_left(1));
    }
    Ok(times)
}

/// Seconds from many conductivities in memory to all their frames.
fn time_many(problem: &Problem, maps: usize, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let all: Vec<Vec<f64>> = problem.conductivities.iter().cycle().take(maps).cloned().collect();
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        let map = |map: usize| Ok::<_, ForwardError>(all[map].as_slice().into());
        let mut frames = vec![0.0; maps * problem.model.protocol().channel_count()];
        problem.model.solve_many_into(map, |_| {}, &mut frames)?;
        times.push(start.elapsed().as_secs_f64());
        assert_finite(&frames);
    }
    Ok(times)
}

/// Seconds for the Jacobian per pixel at a new conductivity, the factorisation included.
fn time_jacobian(problem: &Problem, count: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut times = Vec::with_capacity(count);
    for conductivity in problem.conductivities.iter().cycle().take(count) {
        let start = Instant::now();
        let jacobian = problem.model.pixel_jacobian(conductivity, &problem.pixels)?;
        times.push(start.elapsed().as_secs_f64());
        assert_finite(&jacobian.values[..1]);
    }
    Ok(times)
}

/// Seconds per sample if each thread creates its own solver and calls it `count` times, all starting together; a call
/// returns the number of samples that it solved.
fn on_threads<Solve: FnMut() -> usize>(threads: usize, count: usize, make: impl Fn() -> Solve + Sync) -> f64 {
    let start_line = Barrier::new(threads + 1);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                scope.spawn(|| {
                    let mut solve = make();
                    solve();
                    start_line.wait();
                    (0..count).map(|_| solve()).sum::<usize>()
                })
            })
            .collect();
        start_line.wait();
        let start = Instant::now();
        let solved: usize = workers.into_iter().map(|worker| worker.join().expect("a worker that ends")).sum();
        start.elapsed().as_secs_f64() / solved as f64
    })
}

fn assert_finite(values: &[f64]) {
    assert!(std::hint::black_box(values).iter().all(|value| value.is_finite()), "numbers");
}
