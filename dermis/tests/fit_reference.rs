//! Contact impedances and conductance of independent programs' frames and of a real tank.

use crate::reference::Reference;
use dermis::design::{
    Body, Electrode, ElectrodeShape, ImageLayout, MeshOptions, Sheet, SheetKind, SkinDesign, TouchEffect,
};
use dermis::fit::{Contacts, Determination, FitOptions, fit};
use dermis::frame::{Frame, read_frames};
use dermis::mesh::Mesh;
use std::path::Path;

/// The disk of the reference, with a wrong conductance and wrong contact impedances.
fn guess(disk: &Reference) -> SkinDesign {
    let electrode = Electrode { centre_m: [f64::NAN; 3], shape: ElectrodeShape::Group, contact_impedance: 0.02 };
    SkinDesign {
        name: "disk16".into(),
        body: Body::Disk { diameter_m: 2.0 },
        sheet: Sheet {
            kind: SheetKind::Surface,
            conductance: 0.3,
            regions: Vec::new(),
            touch: TouchEffect::ConductanceRises,
        },
        electrodes: vec![electrode; 16],
        protocol: disk.protocol.clone(),
        image: ImageLayout::Grid { rows: 32, columns: 32 },
        mesh: MeshOptions { max_edge_m: 0.1, electrode_edge_m: 0.1, growth: 0.0, correct_arc_ends: false },
        fabrication: None,
    }
}

/// EIDORS's voltages at other contact impedances. None is read at a driven electrode: the impedances show in what the
/// other electrodes shunt, and are found all the same, since nothing is noisy.
#[test]
fn eidors_contact_impedances_are_recovered() {
    let disk = Reference::disk16();
    let design = guess(&disk);
    for (case, contacts) in [("0.1", Contacts::Common), ("1", Contacts::Common), ("var", Contacts::Each)] {
        let frame = Frame(disk.column(&format!("v_homog_zc{case}.csv")));
        let expected = match case {
            "var" => disk.column("zc_var.csv"),
            value => vec![value.parse().unwrap(); 16],
        };
        let fit = fit(&design, &disk.mesh, &[frame], &FitOptions { contacts, left_out: Vec::new() }).unwrap();
        let off = |(found, expected): (&Electrode, &f64)| (found.contact_impedance / expected - 1.0).abs();
        let worst = fit.design.electrodes.iter().zip(&expected).map(off).fold(0.0, f64::max);
        let misfit = fit.others.unwrap();
        println!(
            "zc {case}: conductance {:.9}, contact impedances within {worst:.1e}, misfit {:.1e} of {:.1e}",
            fit.design.sheet.conductance, misfit.misfit_ohm, misfit.rms_ohm
        );
        assert!((fit.design.sheet.conductance - 1.0).abs() < 1e-6, "{case}");
        assert!(worst < 1e-4, "{case}: {worst}");
    }
}

/// The empty tank: no value is read at a driven electrode, so that the contact impedance is kept. The resistance is the
/// same in every recording within its deviation.
#[test]
fn the_empty_tank_has_one_resistance() {
    let design = SkinDesign::shipped("tank16").unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-study/tank");
    let mut values = Vec::new();
    for name in ["metal1_55uA", "metal1_plastic5_55uA", "metal1_plastic5_plastic9_55uA"] {
        let frames = read_frames(&folder.join(format!("{name}_empty.csv")), &design.protocol).unwrap();
        let fit = fit(&design, &mesh, &frames, &FitOptions::default()).unwrap();
        let [sheet, contact] = [fit.quantities[0], fit.quantities[1]];
        let misfit = fit.others.unwrap();
        println!(
            "{name}: {:.0} ohm (sd {:.0}), contact {:?} {:.2e} (sd {:.1}), misfit {:.1} of {:.0} ohm",
            sheet.value,
            sheet.value * sheet.relative_sd,
            contact.determination,
            contact.value,
            contact.relative_sd,
            misfit.misfit_ohm,
            misfit.rms_ohm
        );
        assert!(misfit.misfit_ohm < 0.25 * misfit.rms_ohm, "{misfit:?}");
        assert_eq!((contact.determination, contact.value), (Determination::Kept, contact.initial));
        values.push(sheet);
    }
    for other in &values[1..] {
        let off = (other.value / values[0].value).ln().abs();
        assert!(off < 3.0 * other.relative_sd.hypot(values[0].relative_sd), "{values:?}");
    }
}
