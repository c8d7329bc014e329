//! Presses on patches: the fast method compared with the direct one, and effects of patches that Gaussian touches do
//! not have.

use dermis::design::SkinDesign;
use dermis::forward::{ElectrodeNetwork, ForwardModel};
use dermis::frame::Frame;
use dermis::mesh::Mesh;
use dermis::protocol::Protocol;
use dermis::stats::upper_median;
use dermis_sim::twin::{
    ContactHistory, ContactLaw, Foam, Indentation, MOMENT_DEGREE, PatchLattice, PatchOptions, PatchShape, PatchedSkin,
    Press,
};
use std::sync::OnceLock;
use std::time::Instant;

/// The paper's skin on a mesh of about 11,000 nodes.
fn skin() -> &'static (SkinDesign, ForwardModel) {
    static SKIN: OnceLock<(SkinDesign, ForwardModel)> = OnceLock::new();
    SKIN.get_or_init(|| {
        let mut design = SkinDesign::load("cylinder30").unwrap();
        design.mesh = design.mesh.scaled(0.65);
        let mesh = Mesh::generate(&design).unwrap();
        let model = ForwardModel::new(&design, &mesh).unwrap();
        println!("mesh of {} nodes", mesh.node_count());
        (design, model)
    })
}

/// The patches, foam and contact of the twin `lab`.
fn lab() -> PatchOptions {
    PatchOptions {
        rows: 30,
        columns: 31,
        gap_m: 0.001,
        shape: PatchShape::Square,
        lattice: PatchLattice::Rectangular,
        offset_m: [0.0; 2],
        pitch_m: None,
        foam: Foam { thickness_m: 0.002, modulus_pa: 2.5e5, indentation: Indentation::Foundation },
        contact: ContactLaw {
            conductance_s_per_m2: 1500.0,
            reference_pressure_pa: 1e4,
            exponent: 0.7,
            saturation_s_per_m2: 3000.0,
            preload_pa: 0.0,
            hysteresis: 0.0,
        },
    }
}

fn patched(options: &PatchOptions, degree: usize) -> PatchedSkin {
    let (design, model) = skin();
    PatchedSkin::with_degree(options, &design.body, model, model.rest_conductivity(), degree).unwrap()
}

fn press(z_m: f64, theta_rad: f64, force_n: f64) -> Press {
    let (sin, cos) = theta_rad.sin_cos();
    Press { centre_m: [0.05 * cos, 0.05 * sin, z_m], force_n, tip_radius_m: 0.005 }
}

/// Some positions, including the rim and the seam.
fn places() -> Vec<Press> {
    vec![
        press(0.155, 1.1, 2.0),
        press(0.031, 3.07, 5.0),
        press(0.2995, 0.4, 1.0),
        press(0.12, 0.002, 3.0),
        press(0.09, 4.4, 2.0),
    ]
}

/// The values without a driven electrode.
fn undriven(frame: &Frame, protocol: &Protocol) -> Vec<f64> {
    let channels = frame.iter().zip(protocol.channels());
    channels.filter(|(_, channel)| !channel.touches_driven()).map(|(value, _)| *value).collect()
}

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// The change of the values without a driven electrode, and their size at rest.
fn change(skin: &PatchedSkin, network: &ElectrodeNetwork) -> (Vec<f64>, f64) {
    let protocol = skin.conductors().model().protocol();
    let rest = undriven(&skin.conductors().resting_network().unwrap().frame(protocol), protocol);
    let touched = undriven(&network.frame(protocol), protocol);
    (touched.iter().zip(&rest).map(|(touched, rest)| touched - rest).collect(), norm(&rest))
}

fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
    norm(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>()) / norm(b)
}

fn median(values: Vec<f64>) -> f64 {
    upper_median(&values).expect("values")
}

/// Every combination of the table, of the forward substitution, and of a direct factorisation with a patch unknown,
/// with and without contact at rest.
#[test]
fn the_low_rank_update_equals_the_direct_solve() {
    let mut preloaded = lab();
    preloaded.contact.preload_pa = 300.0;
    for (name, options) in [("loose patches", lab()), ("preloaded patches", preloaded)] {
        let skin = patched(&options, MOMENT_DEGREE);
        let conductors = skin.conductors();
        let model = conductors.model();
        for presses in [&places()[..1], &places()[1..3], &places()] {
            let contacts = skin.contacts(presses).unwrap();
            let mut all = contacts.clone();
            if options.contact.preload_pa > 0.0 {
                let touched: Vec<usize> = contacts.iter().map(|contact| contact.conductor).collect();
                let resting = skin.contacts_at_rest().iter();
                all.extend(resting.filter(|contact| !touched.contains(&contact.conductor)).cloned());
            }
            let direct = model.network_with_conductors(model.rest_conductivity(), conductors.moments(), &all).unwrap();
            let fast = skin.network(presses).unwrap();
            let once = skin.network_once(presses).unwrap();
            let frames = [&direct, &fast, &once].map(|network| network.frame(model.protocol()));
            let errors = [1, 2].map(|k| relative_difference(&frames[k], &frames[0]));
            let changes = [&direct, &fast].map(|network| change(&skin, network).0);
            let of_change = relative_difference(&changes[1], &changes[0]);
            println!(
                "{name}, {} presses, {} patches: table {:.1e}, half solve {:.1e} of the frame; {of_change:.1e} of the change",
                presses.len(),
                contacts.len(),
                errors[0],
                errors[1]
            );
            assert!(errors[0] < 1e-10 && errors[1] < 1e-10 && of_change < 1e-8);
        }
    }
}

/// Most time of a frame with the table over that of one without it.
const MAX_OF_TIME: f64 = 0.6;

/// The limit is a ratio of the shortest times of two that are measured in turns, on a thread that takes no work of other
/// tests: other times depend on what else runs on the machine.
#[test]
fn a_frame_costs_little() {
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    alone.install(the_table_saves_time);
}

fn the_table_saves_time() {
    let start = Instant::now();
    let skin = patched(&lab(), MOMENT_DEGREE);
    println!("skin: {:.2} s", start.elapsed().as_secs_f64());
    let start = Instant::now();
    skin.network(&places()[..1]).unwrap();
    println!("first touch: {:.1} ms", start.elapsed().as_secs_f64() * 1e3);
    let time = |action: &dyn Fn()| {
        let start = Instant::now();
        action();
        start.elapsed().as_secs_f64() * 1e3
    };
    let protocol = skin.conductors().model().protocol();
    for presses in [&places()[..1], &places()[1..3], &places()] {
        let patches = skin.contacts(presses).unwrap().len();
        let measure = || {
            [
                time(&|| drop(skin.contacts(presses).unwrap())),
                time(&|| drop(skin.network(presses).unwrap().frame(protocol))),
                time(&|| drop(skin.network_once(presses).unwrap().frame(protocol))),
            ]
        };
        measure();
        let runs: Vec<[f64; 3]> = (0..21).map(|_| measure()).collect();
        let [contacts, table, without] =
            [0, 1, 2].map(|which: usize| runs.iter().map(|run| run[which]).fold(f64::INFINITY, f64::min));
        println!(
            "{} presses, {patches} patches: frame {table:.2} ms (contacts {contacts:.2} ms), without a table {without:.2} ms",
            presses.len()
        );
        assert!(cfg!(debug_assertions) || table < MAX_OF_TIME * without, "{table} ms of {without} ms");
    }
    let start = Instant::now();
    skin.conductors().prepare();
    let [now, whole] = skin.conductors().table_bytes();
    println!("whole table: {:.1} s, {:.0} MB", start.elapsed().as_secs_f64(), now as f64 / 1e6);
    assert_eq!(now, whole);
}

/// Presses all over the skin: the memory stays below the limit, and the frames are those of the whole table.
#[test]
fn the_memory_of_many_presses_has_a_limit() {
    const MAX_BYTES: usize = 8 << 20;
    let (whole, mut limited) = (patched(&lab(), MOMENT_DEGREE), patched(&lab(), MOMENT_DEGREE));
    limited.limit_table(MAX_BYTES);
    let protocol = whole.conductors().model().protocol();
    // Twice round the skin, so that places whose Green's functions were dropped are pressed again.
    for index in 0..80 {
        let presses = [press(0.01 + 0.007 * f64::from(index % 40), 2.4 * f64::from(index % 40), 2.0)];
        let frame = |skin: &PatchedSkin| skin.network(&presses).unwrap().frame(protocol);
        assert_eq!(frame(&limited), frame(&whole), "press {index}");
        assert!(limited.conductors().table_bytes()[0] <= MAX_BYTES, "press {index}");
    }
    assert!(whole.conductors().table_bytes()[0] > 2 * MAX_BYTES, "the test needs more places");
}

#[test]
fn the_polynomials_under_a_patch_are_fine_enough() {
    let fine = patched(&lab(), 6);
    let mut medians = Vec::new();
    for degree in 1..=4 {
        let skin = patched(&lab(), degree);
        let errors = errors_of_changes(&skin, &fine);
        let worst = errors.iter().copied().fold(0.0, f64::max);
        medians.push(median(errors));
        println!("degree {degree}: median {:.2} %, worst {:.2} %", medians[degree - 1] * 100.0, worst * 100.0);
    }
    assert!(medians.is_sorted_by(|a, b| a > b) && medians[MOMENT_DEGREE - 1] < 0.03);
}

/// Relative differences of the changes by some presses on two instances of a skin.
fn errors_of_changes(skin: &PatchedSkin, reference: &PatchedSkin) -> Vec<f64> {
    let presses = (0..24).map(|k| press(0.02 + 0.0113 * k as f64, 0.37 * k as f64, 1.0 + 0.17 * k as f64));
    let of = |skin: &PatchedSkin, press| change(skin, &skin.network_once(&[press]).unwrap()).0;
    presses.map(|press| relative_difference(&of(skin, press), &of(reference, press))).collect()
}

/// Skins that are touched only a few times, as in a set of training samples: on the mesh of the design itself.
#[test]
fn a_skin_of_a_few_touches_costs_little() {
    let design = SkinDesign::load("cylinder30").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    let rest = model.rest_conductivity();
    let presses: Vec<Press> = (0..16).map(|k| press(0.01 + 0.018 * k as f64, 0.7 * k as f64, 2.0)).collect();
    let whole = PatchedSkin::new(&lab(), &design.body, &model, rest).unwrap();
    let (mut building, mut touching) = (Vec::new(), Vec::new());
    for _ in 0..5 {
        let start = Instant::now();
        let skin = PatchedSkin::for_presses(&lab(), &design.body, &model, rest, &presses).unwrap();
        building.push(start.elapsed().as_secs_f64() * 1e3);
        for press in &presses {
            let start = Instant::now();
            let network = skin.network_once(&[*press]).unwrap();
            touching.push(start.elapsed().as_secs_f64() * 1e3);
            let expected = whole.network_once(&[*press]).unwrap();
            assert_eq!(network.transfer_impedance, expected.transfer_impedance);
        }
    }
    println!(
        "{} nodes: a skin for 16 presses {:.1} ms, a press {:.2} ms",
        mesh.node_count(),
        median(building),
        median(touching)
    );
}

/// The pitch of the columns, m.
const PITCH_M: f64 = 0.1 * std::f64::consts::PI / 31.0;

/// A press of 2 N at a position around the skin, in pitches from a gap, in the middle of a row.
fn along_the_columns(pitches: f64) -> Press {
    press(0.155, pitches * PITCH_M / 0.05, 2.0)
}

/// The calibration of the twin `lab`: the contact's conductance is chosen so that a press of 2 N changes the values
/// without a driven electrode by 0.5 to 2 %.
#[test]
fn a_press_of_two_newtons_changes_the_frame_by_about_one_per_cent() {
    let skin = patched(&lab(), MOMENT_DEGREE);
    let share = |force_n: f64| {
        let of = |k: usize| {
            // Positions that cover the skin uniformly: the two-dimensional golden ratio sequence (Roberts, 2018).
            let (u, v) = ((k as f64 * 0.754_877_67).fract(), (k as f64 * 0.569_840_29).fract());
            let press = press(0.3 * u, std::f64::consts::TAU * v, force_n);
            let (change, rest) = change(&skin, &skin.network(&[press]).unwrap());
            norm(&change) / rest
        };
        median((0..200).map(of).collect())
    };
    let [one, two, five] = [1.0, 2.0, 5.0].map(share);
    println!("median change at 1, 2, 5 N: {:.3} %, {:.3} %, {:.3} %", one * 100.0, two * 100.0, five * 100.0);
    assert!((0.005..0.02).contains(&two), "{two}");
    assert!(one < two && two < five);
}

/// Patch-size steps: if a press moves within a patch the frame hardly changes, across a gap it jumps. The effect
/// increases with the contact pressure and with the size of the patch relative to the footprint.
#[test]
fn the_frame_moves_in_steps_of_a_patch() {
    let mut hard = lab();
    hard.foam = Foam { thickness_m: 0.001, modulus_pa: 4e5, ..hard.foam };
    hard.contact = ContactLaw { conductance_s_per_m2: 1e5, saturation_s_per_m2: 1e6, ..hard.contact };
    for (name, options, least_ratio) in [("lab", lab(), 1.5), ("hard contact, thin foam", hard, 5.0)] {
        let skin = patched(&options, MOMENT_DEGREE);
        let at = |pitches: f64| change(&skin, &skin.network(&[along_the_columns(pitches)]).unwrap()).0;
        let size = norm(&at(15.5));
        let steps: Vec<f64> = (0..20)
            .map(|k| {
                let (here, next) = (at(15.0 + k as f64 / 20.0), at(15.0 + (k + 1) as f64 / 20.0));
                norm(&next.iter().zip(&here).map(|(a, b)| a - b).collect::<Vec<f64>>()) / size
            })
            .collect();
        let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
        let most = steps.iter().copied().fold(0.0, f64::max);
        println!(
            "{name}: a step of a twentieth of the pitch changes the frame by {least:.4} to {most:.4} of the press"
        );
        assert!(most > least_ratio * least, "{name}");
    }
}

/// Saturation: the response to a light press has nearly the exponent of the contact law, that of a strong one half of
/// it, although it reaches more patches.
#[test]
fn the_change_saturates_with_the_force() {
    let skin = patched(&lab(), MOMENT_DEGREE);
    let size = |force_n: f64| {
        let press = Press { force_n, ..along_the_columns(15.5) };
        norm(&change(&skin, &skin.network(&[press]).unwrap()).0)
    };
    let exponents = [0.01, 0.1, 1.0, 5.0].map(|force: f64| (size(force * 1.02) / size(force)).ln() / 1.02f64.ln());
    println!("exponent of the change with the force at 0.01, 0.1, 1 and 5 N: {exponents:.3?}");
    assert!((0.6..0.7).contains(&exponents[0]), "{exponents:?}");
    assert!(exponents[2] < 0.6 * exponents[0] && exponents[3] < 0.7 * exponents[0], "{exponents:?}");
}

/// Two presses on one patch: their change is less than the sum; far apart they add up.
#[test]
fn touches_on_one_patch_do_not_add_up() {
    let skin = patched(&lab(), MOMENT_DEGREE);
    let of = |presses: &[Press]| change(&skin, &skin.network(presses).unwrap()).0;
    let together = |apart: f64| {
        let [a, b] = [-0.5, 0.5].map(|side| along_the_columns(15.5 + side * apart));
        let sum: Vec<f64> = of(&[a]).iter().zip(of(&[b])).map(|(a, b)| a + b).collect();
        (relative_difference(&of(&[a, b]), &sum), norm(&of(&[a, b])) / norm(&sum))
    };
    for (apart, range) in [(0.4, 0.2..1.0), (1.0, 0.05..1.0), (10.0, 0.0..0.02)] {
        let (difference, ratio) = together(apart);
        println!("{apart} pitches apart: off the sum by {:.1} %, {ratio:.2} times its size", difference * 100.0);
        assert!(range.contains(&difference), "{difference}");
    }
    assert!(together(0.4).1 < 0.9);
}

/// Kirchhoff: the net current of a patch is zero, to 1e-12 of the drive current.
#[test]
fn no_patch_keeps_a_current() {
    let (design, model) = skin();
    let bare = model.clone().with_series_resistances(&[0.0; 30]).unwrap();
    let skin = PatchedSkin::new(&lab(), &design.body, &bare, bare.rest_conductivity()).unwrap();
    let (mut worst, mut largest) = (0.0f64, 0.0f64);
    for presses in [&places()[..1], &places()] {
        let network = skin.network(presses).unwrap();
        let contacts = skin.contacts(presses).unwrap();
        for drive in 0..30 {
            let impedance = &network.transfer_impedance;
            let potentials: Vec<f64> =
                (0..30).map(|k| impedance.at(k, drive) - impedance.at(k, (drive + 1) % 30)).collect();
            for [current, of_one] in skin.conductors().currents(&contacts, &potentials).unwrap() {
                let net: f64 = current.iter().zip(&of_one).map(|(current, one)| current * one).sum();
                worst = worst.max(net.abs());
                largest = largest.max(norm(&current));
            }
        }
    }
    println!(
        "net current of a patch: at most {worst:.1e} A of 1 A driven; moments of its current up to {largest:.1e} A"
    );
    assert!(worst < 1e-12 && largest > 1e-3);
}

/// Hysteresis of a contact: its conductance is higher during release, and a released skin has no history.
#[test]
fn unloading_follows_another_way() {
    let mut options = lab();
    options.contact.hysteresis = 0.3;
    let skin = patched(&options, MOMENT_DEGREE);
    let mut history = ContactHistory::default();
    let at = |force_n: f64, history: &mut ContactHistory| {
        let press = Press { force_n, ..along_the_columns(15.4) };
        norm(&change(&skin, &skin.network_after(&[press], history).unwrap()).0)
    };
    let up = at(1.0, &mut history);
    at(4.0, &mut history);
    let down = at(1.0, &mut history);
    println!("a press of 1 N after 4 N changes the frame {:.2} times as much as before", down / up);
    assert!(down > 1.05 * up);
    skin.network_after(&[], &mut history).unwrap();
    assert_eq!(history, ContactHistory::default());
    assert_eq!(at(1.0, &mut history), up);
    let never = skin.network_after(&[], &mut ContactHistory::default()).unwrap();
    let rest = skin.conductors().model().solve(skin.conductors().model().rest_conductivity()).unwrap();
    assert_eq!(never.frame(skin.conductors().model().protocol()), rest, "untouched to the last bit");
}

/// Dependence of the frame change by a press on the mesh.
#[test]
fn a_press_hardly_feels_the_mesh() {
    let (design, _) = skin();
    let coarse = patched(&lab(), MOMENT_DEGREE);
    let mut finer = design.clone();
    finer.mesh = design.mesh.scaled(0.5);
    let mesh = Mesh::generate(&finer).unwrap();
    let model = ForwardModel::new(&finer, &mesh).unwrap();
    let fine = PatchedSkin::with_degree(&lab(), &design.body, &model, model.rest_conductivity(), 4).unwrap();
    let errors = errors_of_changes(&coarse, &fine);
    let worst = errors.iter().copied().fold(0.0, f64::max);
    println!(
        "change of the frame against {} nodes: median {:.2} %, worst {:.2} %",
        mesh.node_count(),
        median(errors.clone()) * 100.0,
        worst * 100.0
    );
    assert!(median(errors) < 0.08);
}

/// The true strength of presses compared with their effect on the frame: light and strong presses at one position, with
/// the patches shifted under them, so that only the amount of contact and its distribution over the patches change.
#[test]
fn the_true_strength_is_what_the_frame_feels() {
    let (design, model) = skin();
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt() / mean
    };
    let thin = PatchOptions { foam: Foam { thickness_m: 0.001, modulus_pa: 6e5, ..lab().foam }, ..lab() };
    for (name, options) in [("lab", lab()), ("thin foam", thin)] {
        for place in [press(0.155, 1.1, 1.0), press(0.23, 3.4, 1.0), press(0.07, 5.2, 1.0)] {
            let one = |k: usize| {
                let press = Press { force_n: [0.1, 0.3, 1.0, 2.0, 4.0][k % 5], ..place };
                let offset_m = [0.01 * (k / 5 % 4) as f64 / 4.0, PITCH_M * (k / 20) as f64 / 4.0];
                let (options, rest) = (PatchOptions { offset_m, ..options.clone() }, model.rest_conductivity());
                let skin = PatchedSkin::for_presses(&options, &design.body, model, rest, &[press]).unwrap();
                (norm(&change(&skin, &skin.network_once(&[press]).unwrap()).0), skin.strength_m2(&[press]).unwrap())
            };
            let (felt, told): (Vec<f64>, Vec<f64>) = (0..80).map(one).unzip();
            let ratio: Vec<f64> = felt.iter().zip(&told).map(|(felt, told)| felt / told).collect();
            let [felt, told, ratio] = [felt, told, ratio].map(|values| spread(&values));
            println!(
                "{name}: the change varies by {felt:.3}, the true strength by {told:.3}, their ratio by {ratio:.3}"
            );
            assert!(ratio < 0.25 * felt, "{ratio} of {felt}");
        }
    }
}
