//! Voltages and Jacobians compared with independent programs.

use crate::reference::{Reference, matrix_of, relative_difference, table};

/// Voltages agree to rounding: the same mesh, the same elements, another program.
const VOLTAGES: f64 = 1e-9;
/// Jacobians lose a few more digits, because they are products of differences of fields.
const JACOBIAN: f64 = 1e-8;

fn assert_close(what: &str, ours: &[f64], theirs: &[f64], tolerance: f64) {
    let difference = relative_difference(ours, theirs);
    println!("{what}: relative difference {difference:.2e} (at most {tolerance:.0e})");
    assert!(difference <= tolerance, "{what}: {difference:.2e} > {tolerance:.0e}");
}

#[test]
fn disk16_voltages() {
    let disk = Reference::disk16();
    let model = disk.model();
    for case in ["homog", "incl", "random", "two"] {
        let ours = disk.voltages(&model, &format!("sigma_{case}.csv"));
        assert_close(&format!("disk16 {case}"), &ours, &disk.column(&format!("v_{case}.csv")), VOLTAGES);
    }
}

#[test]
fn disk16_voltages_at_other_contact_impedances() {
    let disk = Reference::disk16();
    let varied = disk.column("zc_var.csv");
    let cases = [("zc0.0001", vec![1e-4; 16]), ("zc0.1", vec![0.1; 16]), ("zc1", vec![1.0; 16]), ("zcvar", varied)];
    for (case, impedances) in cases {
        let ours = disk.voltages(&disk.model_with(&impedances), &format!("sigma_homog_{case}.csv"));
        assert_close(&format!("disk16 {case}"), &ours, &disk.column(&format!("v_homog_{case}.csv")), VOLTAGES);
    }
}

#[test]
fn disk16_potentials_of_nodes() {
    let disk = Reference::disk16();
    for case in ["homog", "incl", "random", "two"] {
        let potentials = disk.model().potentials(&disk.column(&format!("sigma_{case}.csv"))).unwrap();
        let [source, sink] = disk.protocol.channels()[0].drive;
        let ours: Vec<f64> = (0..potentials.rows).map(|n| potentials.at(n, source) - potentials.at(n, sink)).collect();
        let theirs = disk.column(&format!("vnode_stim0_{case}.csv"));
        // The reference grounds a node; potentials are determined up to a constant.
        let ground = 844;
        let ours: Vec<f64> = ours.iter().map(|value| value - ours[ground]).collect();
        let theirs: Vec<f64> = theirs.iter().map(|value| value - theirs[ground]).collect();
        assert_close(&format!("disk16 {case} nodes"), &ours, &theirs, VOLTAGES);
    }
}

#[test]
fn disk16_jacobian() {
    let disk = Reference::disk16();
    let ours = disk.model().jacobian(&disk.column("sigma_homog.csv")).unwrap();
    let theirs = matrix_of(table(&disk.folder.join("jacobian_homog.csv.gz")));
    assert_close("disk16 Jacobian", &ours.values, &theirs.values, JACOBIAN);
}

#[test]
fn sheet25_voltages() {
    let sheet = Reference::sheet25();
    let model = sheet.model();
    for case in ["homog", "touch"] {
        let ours = sheet.voltages(&model, &format!("sigma_{case}.csv"));
        assert_close(&format!("sheet25 {case}"), &ours, &sheet.column(&format!("v_{case}.csv")), VOLTAGES);
    }
}

#[test]
fn sheet25_jacobian_rows() {
    let sheet = Reference::sheet25();
    let ours = sheet.model().jacobian(&sheet.column("sigma_homog.csv")).unwrap();
    let theirs = matrix_of(table(&sheet.folder.join("jacobian_homog_rows.csv.gz")));
    let rows: Vec<f64> = sheet
        .column("jacobian_homog_rowidx.csv")
        .iter()
        .flat_map(|&row| ours.row(row as usize).iter().map(|value| value * sheet.current_a))
        .collect();
    assert_close("sheet25 Jacobian", &rows, &theirs.values, JACOBIAN);
}

#[test]
fn disk30_voltages() {
    let disk = Reference::disk30();
    let model = disk.model();
    for case in ["hom", "inh"] {
        let ours = disk.voltages(&model, &format!("sigma_{case}.csv"));
        assert_close(&format!("disk30 {case}"), &ours, &disk.column(&format!("V_{case}.csv")), VOLTAGES);
    }
}
