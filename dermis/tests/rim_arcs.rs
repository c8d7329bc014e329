//! Arcs on the rim of a disk against the boundary integral of the complete electrode model.

use crate::disk_arcs::DiskArcs;
use crate::reference::{path, relative_difference, table};
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use dermis::mesh::quality::MeshReport;
use dermis::protocol::Channel;
use std::f64::consts::{PI, TAU};

/// `K` by the arithmetic-geometric mean, from the complementary modulus (DLMF 19.8.5).
fn elliptic_k(complementary_modulus: f64) -> f64 {
    let (mut a, mut b) = (1.0, complementary_modulus);
    for _ in 0..40 {
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
    }
    PI / (2.0 * a)
}

/// Two perfect arcs. The disk is mapped to the half plane with the electrodes from `-1/k` to `-1` and from `1` to
/// `1/k`, and that to a rectangle: the resistance is `2 K(k) / K'(k)`. `k` follows from the cross ratio of the ends,
/// `|x2 - x1| |x4 - x3| / (|x3 - x1| |x4 - x2|) = ((1 - k) / (1 + k))^2`.
#[test]
fn two_perfect_arcs_have_the_resistance_of_a_rectangle() {
    for half_angle in [0.02, 0.3, PI / 4.0, 1.2] {
        let arcs = DiskArcs { count: 2, half_angle, contact_impedance: 0.0, panels: 24 };
        let resistance = DiskArcs::voltage(&arcs.transfer_impedances(), [0, 1], [0, 1]);
        // Of opposite arcs both pairs of chords are equal; two opposite ends are a diameter apart.
        let ratio = half_angle.sin();
        let k = (1.0 - ratio) / (1.0 + ratio);
        let exact = 2.0 * elliptic_k((1.0 - k * k).sqrt()) / elliptic_k(k);
        println!("half angle {half_angle}: {:.1e}", resistance / exact - 1.0);
        assert!((resistance / exact - 1.0).abs() < 1e-8);
    }
}

/// With a large contact impedance the current density is even: with `w = 2 half_angle` the transfer impedance is `z / w`
/// at the electrode itself and `1/pi sum over n of (sin(n w / 2) / (n w / 2))^2 cos(n angle) / n`, less its mean.
#[test]
fn a_large_contact_impedance_makes_the_current_even() {
    let (count, half_angle, contact_impedance) = (8, 0.2, 1e4);
    let ours = DiskArcs { count, half_angle, contact_impedance, panels: 6 }.transfer_impedances();
    let share = |n: f64| (n * half_angle).sin() / (n * half_angle);
    let of = |arc: usize| -> f64 {
        let term = |n: f64| share(n).powi(2) * (n * TAU * arc as f64 / count as f64).cos() / n;
        (1..200_000).map(|n| term(f64::from(n))).sum::<f64>() / PI
    };
    let exact = DiskArcs::voltage(&(0..count).map(of).collect::<Vec<_>>(), [0, 1], [3, 4]);
    let voltage = DiskArcs::voltage(&ours, [0, 1], [3, 4]);
    assert!((voltage / exact - 1.0).abs() < 1e-4, "{voltage} and {exact}");
    let own = DiskArcs::voltage(&ours, [0, 1], [0, 1]);
    assert!((own / (2.0 * contact_impedance / (2.0 * half_angle)) - 1.0).abs() < 1e-4, "{own}");
}

#[test]
fn the_boundary_integral_converges_and_agrees_with_an_independent_program() {
    for contact_impedance in [0.0, 1e-6, 1e-4, 1e-2, 1.0] {
        let [coarse, fine] = [16, 22].map(|panels| {
            DiskArcs { count: 16, half_angle: 0.025 / 0.23, contact_impedance, panels }.transfer_impedances()
        });
        let change = relative_difference(&coarse, &fine);
        println!("z = {contact_impedance:e}: {change:.1e}");
        assert!(change < 1e-6);
    }
    // Its authors state an error of 5e-5.
    let ours = DiskArcs { count: 30, half_angle: PI / 60.0, contact_impedance: 0.01, panels: 12 }.transfer_impedances();
    let pairs =
        |name: &str| table(&path("disk30_5k").join(name)).into_iter().map(|row| [row[0] as usize, row[1] as usize]);
    let values: Vec<f64> = pairs("inj.csv")
        .flat_map(|drive| pairs("meas.csv").map(move |measure| (drive, measure)))
        .map(|(drive, measure)| DiskArcs::voltage(&ours, drive, measure))
        .collect();
    let theirs: Vec<f64> = table(&path("disk30_5k").join("analytic_V.csv")).into_iter().flatten().collect();
    println!("disk30_5k: {:.1e}", relative_difference(&values, &theirs));
    assert!(relative_difference(&values, &theirs) < 5e-5);
}

/// A tank with 32 arcs of 25 mm, 20 mm apart, and the conductance 1 S.
fn tank(contact_impedance_ohm_m: f64, mesh: &str) -> SkinDesign {
    let text = format!(
        "name = \"tank\"\n[body.disk]\ndiameter_m = 0.46\n[sheet]\nsheet_resistance_ohm = 1.0\n\
         touch = \"conductance_rises\"\n[electrodes]\nshape.arc.length_m = 0.025\n\
         contact_impedance_ohm_m = {contact_impedance_ohm_m:e}\nlayout.rim.count = 32\n\
         [protocol]\npattern = \"adjacent\"\n[image.grid]\nrows = 32\ncolumns = 32\n[mesh]\n{mesh}"
    );
    SkinDesign::parse(&text, "tank.toml").unwrap()
}

/// Relative L2 errors of the values that touch a driven electrode and of the rest, of a sheet that conducts so many times as well as
/// that of the model.
fn errors_at(model: &ForwardModel, factor: f64) -> [f64; 2] {
    let radius_m = 0.23;
    let arcs = DiskArcs {
        count: 32,
        half_angle: 0.0125 / radius_m,
        contact_impedance: factor * model.contact_impedances()[0] / radius_m,
        panels: 16,
    };
    let exact = arcs.transfer_impedances();
    let conductivity: Vec<f64> = model.rest_conductivity().iter().map(|rest| factor * rest).collect();
    let frame = model.solve(&conductivity).unwrap();
    [true, false].map(|is_driven| {
        let shares = |channel: &Channel| channel.measure.iter().any(|one| channel.drive.contains(one));
        let channels = model.protocol().channels().iter().zip(frame.iter());
        let (ours, theirs): (Vec<f64>, Vec<f64>) = channels
            .filter(|(channel, _)| shares(channel) == is_driven)
            .map(|(channel, value)| (factor * value, DiskArcs::voltage(&exact, channel.drive, channel.measure)))
            .unzip();
        relative_difference(&ours, &theirs)
    })
}

/// The same of the skin itself, and the estimate for the former.
fn errors(contact_impedance_ohm_m: f64, mesh: &str) -> ([f64; 2], f64) {
    let design = tank(contact_impedance_ohm_m, mesh);
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    let (_, ends) = MeshReport::new(&design, &mesh).least_accurate_arc().unwrap();
    let result = (errors_at(&model, 1.0), ends.voltage_error);
    println!(
        "z = {contact_impedance_ohm_m:e} ohm m, {} nodes, edges of {:.2} mm: driven {:.3} %, estimated {:.3} %, rest {:.3} %",
        mesh.node_count(),
        ends.edge_m * 1e3,
        result.0[0] * 1e2,
        result.1 * 1e2,
        result.0[1] * 1e2
    );
    result
}

/// Bounds: 0.5 % of values at driven electrodes and 0.2 % of the others.
#[test]
fn the_default_mesh_has_the_voltages_of_arcs_from_no_contact_impedance_on() {
    for contact_impedance_ohm_m in [1e-8, 1e-5, 1e-4, 1e-3, 1e-2] {
        let ([driven, rest], _) = errors(contact_impedance_ohm_m, "");
        assert!(driven < 0.005 && rest < 0.002);
    }
    let ([driven, rest], _) = errors(1e-8, "correct_arc_ends = false");
    assert!(driven > 0.05 && rest > 0.01, "without the correction");
}

/// Where the sheet conducts far better than in the design, the contacts are most of the values of driven electrodes: the correction
/// of the sheet must not change them.
#[test]
fn other_sheets_than_the_designs_are_corrected_too() {
    for contact_impedance_ohm_m in [1e-4, 1e-2] {
        let design = tank(contact_impedance_ohm_m, "");
        let model = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        for factor in [0.01, 0.1, 10.0, 100.0, 1000.0] {
            let [driven, rest] = errors_at(&model, factor);
            println!(
                "z = {contact_impedance_ohm_m:e}, {factor} times: driven {:.3} %, rest {:.3} %",
                1e2 * driven,
                1e2 * rest
            );
            // Without the correction: 0.072 and 0.015. The error of an end depends on its conductance, and the correction does not.
            assert!(driven < 0.04 && rest < 0.025);
        }
    }
}

/// Meshes from 25 edges per arc to 2.
#[test]
fn the_estimated_error_of_arcs_is_within_a_factor_of_two() {
    for contact_impedance_ohm_m in [1e-8, 1e-3] {
        for correction in ["", "correct_arc_ends = false"] {
            for edge_m in [0.001, 0.002, 0.004, 0.00625, 0.0125] {
                let mesh =
                    format!("electrode_edge_m = {edge_m}\nmax_edge_m = {}\n{correction}", f64::max(edge_m, 0.008));
                let ([driven, _], estimate) = errors(contact_impedance_ohm_m, &mesh);
                assert!((0.5..2.0).contains(&(estimate / driven)), "{estimate} for {driven}");
            }
        }
    }
}

/// The transform between electrodes and mesh is one of all solutions: it keeps their laws and derivatives.
#[test]
fn corrected_models_scale_and_have_their_jacobian() {
    let design = SkinDesign::shipped("tank16").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let model = ForwardModel::new(&design, &mesh).unwrap();
    let rest = model.rest_conductivity();
    let frame = model.solve(rest).unwrap();
    let plain = ForwardModel::from_parts(&mesh, model.contact_impedances(), model.protocol(), rest).unwrap();
    let correction = relative_difference(&frame, &plain.solve(rest).unwrap());
    println!("tank16: the correction is {:.2} % of the undriven values", correction * 1e2);
    assert!(correction > 1e-3);

    let twice: Vec<f64> = rest.iter().map(|s| 2.0 * s).collect();
    let halved: Vec<f64> = model.contact_impedances().iter().map(|z| 0.5 * z).collect();
    let half = model.with_parameters(&mesh.nodes, &halved, &twice).unwrap().solve(&twice).unwrap();
    let doubled: Vec<f64> = half.iter().map(|value| 2.0 * value).collect();
    assert!(relative_difference(&doubled, &frame) < 1e-10);

    let network = model.network(rest).unwrap();
    for electrode in 0..16 {
        let row = network.admittance.row(electrode);
        assert!(row.iter().sum::<f64>().abs() < 1e-10 * row[electrode], "currents sum to zero");
    }
    let jacobian = model.jacobian(rest).unwrap();
    for cell in [0, 100, mesh.cell_count() / 2] {
        let shifted = |step: f64| {
            let mut conductivity = rest.to_vec();
            conductivity[cell] *= 1.0 + step;
            model.solve(&conductivity).unwrap()
        };
        let (below, above, step) = (shifted(-1e-3), shifted(1e-3), 2e-3 * rest[cell]);
        let differences: Vec<f64> = above.iter().zip(below.iter()).map(|(a, b)| (a - b) / step).collect();
        let column: Vec<f64> = (0..jacobian.rows).map(|channel| jacobian.at(channel, cell)).collect();
        assert!(relative_difference(&column, &differences) < 1e-5);
    }
}
