//! Checksums of small datasets and of presses on the shipped twins: they have the same bits on every system, for the same
//! mesh.
//!
//! The mesh, the electrode positions and the instruction set are fixed here, so that the result depends only on the
//! functions under test. A checksum of a dataset changes with the recipe of samples; then the version of the format changes
//! too.

use super::record::sha256;
use super::{GaussianTouches, Generator, Recipe, SkinSpread, Skins, Touch};
use crate::elementary::{sin_cos, unrolled};
use crate::touch::{GaussianTouch, touched_conductivity};
use crate::twin::{PatchedSkin, Press, TouchOptions, TwinOptions};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::linalg::SimdLevel;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::f64::consts::TAU;

/// A cylinder with four arcs on each rim.
const CYLINDER: &str = r#"
[body.cylinder]
length_m = 0.3
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.03
contact_impedance_ohm_m = 0.01
[electrodes.layout.rings]
rings = 2
per_ring = 4
spacing_m = 0.3
stagger = 0.5
[protocol]
pattern = "adjacent"
[image.grid]
rows = 6
columns = 8
[mesh]
max_edge_m = 0.03
electrode_edge_m = 0.01
correct_arc_ends = false
"#;

const ROWS: usize = 12;
const COLUMNS: usize = 16;

fn skin() -> (SkinDesign, ForwardModel) {
    let mut design = SkinDesign::parse(CYLINDER, "cylinder.toml").unwrap();
    let place = |row: usize, column: usize| {
        let (sine, cosine) = sin_cos(TAU * column as f64 / COLUMNS as f64);
        [0.05 * cosine, 0.05 * sine, 0.3 * row as f64 / ROWS as f64]
    };
    let node = |row: usize, column: usize| row * COLUMNS + column % COLUMNS;
    let nodes = (0..=ROWS).flat_map(|row| (0..COLUMNS).map(move |column| place(row, column))).collect();
    let mut cells = Vec::new();
    for (row, column) in (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (row, column))) {
        let [a, b, c, d] = [node(row, column), node(row, column + 1), node(row + 1, column), node(row + 1, column + 1)];
        cells.extend([[a, b, d], [a, d, c]]);
    }
    let middles: Vec<(usize, usize)> =
        [(0, 0), (ROWS, 2)].into_iter().flat_map(|(row, first)| (0..4).map(move |k| (row, first + 4 * k))).collect();
    let arc = |&(row, column): &(usize, usize)| {
        ElectrodePatch::Edges(vec![
            [node(row, column + COLUMNS - 1), node(row, column)],
            [node(row, column), node(row, column + 1)],
        ])
    };
    for (electrode, &(row, column)) in design.electrodes.iter_mut().zip(&middles) {
        electrode.centre_m = place(row, column);
    }
    let electrodes = middles.iter().map(arc).collect();
    let mesh = Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: vec![] };
    let forward = ForwardModel::new(&design, &mesh).unwrap();
    (design, forward)
}

/// SHA-256 of all values of 32 samples.
fn checksum(skins: Skins) -> String {
    let (design, forward) = skin();
    let touches = GaussianTouches { most: 2, width_m: [0.012, 0.02], amplitude: [0.2, 1.0] };
    let recipe = Recipe { seed: 11, samples: 32, touch: Touch::Gaussian(touches), skins };
    let generator = Generator::at_level(&design, &forward, &recipe, SimdLevel::Plain).unwrap();
    let mut bytes = Vec::new();
    for sample in generator.stream(0).take(32) {
        let sample = sample.unwrap();
        let touches = sample.touches.iter().flat_map(|touch| touch.row());
        let values = sample.frame.iter().chain(&sample.rest).chain(&sample.image).copied().chain(touches);
        values.for_each(|value| bytes.extend(value.to_le_bytes()));
    }
    sha256(&bytes)
}

#[test]
fn a_dataset_of_one_skin_has_its_checksum() {
    assert_eq!(checksum(Skins::Even), "f7b55b51a2d8e892f115c63ad97d6535bb950881a391dd66f0b44163eee58ba9");
}

#[test]
fn a_dataset_of_random_skins_has_its_checksum() {
    assert_eq!(
        checksum(Skins::Random(SkinSpread::usual())),
        "fcd265469d68194e7fd9d73958ded053a116cdc859b5d9107e1017d71c26b004"
    );
}

/// SHA-256 of the effect of some presses on a shipped twin, before anything is solved: the contacts of patches and their
/// true strength, or the touched conductance of the coating.
fn checksum_of_presses(twin: &str) -> String {
    let (design, forward) = skin();
    let (mesh, rest) = (forward.mesh(), forward.rest_conductivity());
    let chart = unrolled(&design.body.surface());
    let presses: Vec<Press> = [([0.01, 0.003], 2.0), ([-0.155, 0.2985], 1.0), ([0.06, 0.14], 5.0), ([0.07, 0.15], 0.3)]
        .map(|(step_m, force_n)| Press { centre_m: chart.walk([0.05, 0.0, 0.0], step_m), force_n, tip_radius_m: 0.005 })
        .to_vec();
    let values: Vec<f64> = match TwinOptions::shipped(twin).unwrap().touch {
        TouchOptions::Patches(options) => {
            let skin = PatchedSkin::new(&options, &design.body, &forward, rest).unwrap();
            let contacts = skin.contacts(&presses).unwrap().into_iter();
            let strength_m2 = skin.strength_m2(&presses).unwrap();
            contacts.flat_map(|contact| contact.conductance.values).chain([strength_m2]).collect()
        }
        TouchOptions::Gaussian(options) => {
            let touch = |press: &Press| GaussianTouch {
                centre_m: press.centre_m,
                amplitude: options.amplitude_per_n * press.force_n,
                width_m: options.width_m,
            };
            let touches: Vec<GaussianTouch> = presses.iter().map(touch).collect();
            touched_conductivity(mesh, &design.body.surface(), design.sheet.touch, rest, &touches).unwrap()
        }
        other => panic!("no checksum for {other:?}"),
    };
    sha256(&values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

#[test]
fn presses_on_the_shipped_twins_have_their_checksums() {
    let patches = "b76e795f400fa3eaa7f9dec37afab161b0eace6d4424e34ae9f918f386197302";
    for (twin, of_text, of_presses) in [
        (
            "ideal",
            "51cdaa2b70ec8e3805d45a3c05261f5c79c6d9801cc257533f10d66547c23708",
            "4584fc9e01388e695c884a1d2c5acea0dca9a37d85ef7873900e0e1d47601870",
        ),
        ("lab", "bd4fc8901969d62887727447cbbff1ec492c9248d9584acba0cdb89c18f5ecec", patches),
        ("harsh", "e8c8850e7d7e31a34fe29d47f93dc9365348f4b9fe58f9c9cca8c6e95ad62f9c", patches),
    ] {
        assert_eq!(sha256(TwinOptions::shipped_text(twin).unwrap().as_bytes()), of_text, "the file of `{twin}`");
        assert_eq!(checksum_of_presses(twin), of_presses, "presses on `{twin}`");
    }
}

#[test]
fn the_mesh_of_the_checksums_lies_on_its_body() {
    let (design, forward) = skin();
    let chart = unrolled(&design.body.surface());
    for node in &forward.mesh().nodes {
        assert!(chart.distance_m(chart.unroll(*node), chart.unroll(chart.walk(*node, [0.0; 2]))) < 1e-15);
    }
    assert!((forward.mesh().electrode_size(0) - 4.0 * 0.05 * (TAU / 32.0).sin()).abs() < 1e-12);
}
