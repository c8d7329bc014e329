//! Frames of many conductivities against the plain solver.

use dermis::forward::{ForwardError, ForwardModel};
use dermis::skin::Skin;
use std::borrow::Cow;

/// The untouched conductivity with a factor that differs from cell to cell.
fn maps(model: &ForwardModel, count: usize) -> Vec<Vec<f64>> {
    let factor = |map: usize, cell: usize| 1.0 + 0.1 * ((map * 7 + cell * 13) % 11) as f64;
    let map = |map| model.rest_conductivity().iter().enumerate().map(|(cell, s)| s * factor(map, cell)).collect();
    (0..count).map(map).collect()
}

#[test]
fn frames_of_many_are_those_of_the_plain_solver_and_do_not_depend_on_each_other() {
    for name in ["tank16", "skin16"] {
        let skin = Skin::load(name).unwrap();
        let model = skin.forward();
        let maps = maps(model, 19);
        let solve = |maps: &[Vec<f64>]| {
            let map = |map: usize| Ok::<_, ForwardError>(Cow::Borrowed(maps[map].as_slice()));
            model.solve_many(maps.len(), map, |_| {}).unwrap()
        };
        let frames = solve(&maps);
        assert_eq!(frames.len(), 19);
        for (frame, map) in frames.iter().zip(&maps) {
            let mut plain = model.solve(map).unwrap();
            model.protocol().drop_signs(&mut plain);
            let largest = plain.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
            assert!(frame.iter().zip(plain.iter()).all(|(a, b)| (a - b).abs() <= 1e-11 * largest));
        }
        for one in [0, 7, 8, 18] {
            assert_eq!(solve(&maps[one..=one])[0], frames[one], "map {one} alone");
        }
        assert!(solve(&[]).is_empty());
        let mut flat = vec![0.0; maps.len() * model.protocol().channel_count()];
        let map = |map: usize| Ok::<_, ForwardError>(Cow::Borrowed(maps[map].as_slice()));
        model.solve_many_into(map, |_| {}, &mut flat).unwrap();
        assert_eq!(flat, frames.iter().flat_map(|frame| frame.iter().copied()).collect::<Vec<f64>>());
    }
}

#[test]
fn bad_conductivities_are_refused() {
    let skin = Skin::load("tank16").unwrap();
    let model = skin.forward();
    let refused = |map: Vec<f64>| {
        model.solve_many(1, |_| Ok::<_, ForwardError>(Cow::Borrowed(map.as_slice())), |_| {}).unwrap_err()
    };
    assert!(refused(vec![1.0; 3]).to_string().contains("3"));
    let mut map = model.rest_conductivity().to_vec();
    map[5] = -1.0;
    assert!(matches!(refused(map), ForwardError::Conductivity { cell: 5, .. }));
}
