use super::*;
use crate::design::Body;
use crate::geom::vector::norm;
use crate::mesh::Mesh;

/// The skin of the paper on a coarse mesh, for speed.
fn skin() -> (SkinDesign, ForwardModel) {
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    design.mesh = design.mesh.scaled(2.0);
    let model = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
    (design, model)
}

/// A coating and displacements are found again in the noiseless frame of the same mesh, to a part of their
/// size that the prior explains; the frame itself is explained to its stated error.
#[test]
fn a_known_skin_is_found_again() {
    let (design, model) = skin();
    let identifier = Identifier::new(&design, &model, IdentifyOptions::default()).unwrap().on_equal_mesh();
    let surface = design.body.surface();
    let wave = |at: Point3| (at[2] / 0.05).sin() + (surface.theta_rad(at).unwrap() * 2.0).cos();
    let mesh = model.mesh();
    let truth = Unknowns {
        log_conductivity: (0..mesh.cell_count()).map(|cell| 0.05 * wave(mesh.cell_centre(cell))).collect(),
        log_contacts: (0..30).map(|electrode| 0.3 * f64::from(electrode % 3 - 1)).collect(),
        displaced: (0..identifier.displacements.len()).map(|k| 4e-4 * ((k * 7 % 5) as f64 - 2.0) / 2.0).collect(),
    };
    let made = identifier.model_at(&truth).unwrap();
    let untouched = made.solve(made.rest_conductivity()).unwrap();
    let found = identifier.identify(&untouched, &vec![1e-3; untouched.len()]).unwrap();
    let errors = found.conductivity().iter().zip(made.rest_conductivity()).map(|(found, truth)| (found / truth).ln());
    let of_coating = rms(errors);
    let found_contacts = found.model().contact_impedances().iter().zip(made.contact_impedances());
    let of_contacts = rms(found_contacts.map(|(found, truth)| (found / truth).ln()));
    let mut displaced_m = vec![[0.0; 2]; 30];
    for (displacement, by_m) in identifier.displacements.iter().zip(&truth.displaced) {
        let (electrode, direction) = displacement.electrode.expect("no sizes");
        (0..2).for_each(|axis| displaced_m[electrode][axis] += by_m * direction[axis]);
    }
    let off = found.displacements_m.iter().zip(&displaced_m).flat_map(|(a, b)| [a[0] - b[0], a[1] - b[1]]);
    let of_displacements = rms(off);
    println!("errors: coating {of_coating}, contacts {of_contacts}, displacements {of_displacements} m");
    // Of 0.05 and 0.28 mm; the prior draws each a little towards zero. The contacts, of 0.24, change a frame by less than
    // the stated error of its values at driven electrodes.
    assert!(of_coating < 0.006 && of_displacements < 8e-5 && of_contacts < 0.25);
    let left = found.model().solve(found.conductivity()).unwrap();
    let channels = design.protocol.channels();
    let free = (0..left.len()).filter(|&channel| !channels[channel].touches_driven());
    let (of_frame, size) = (rms(free.clone().map(|c| left[c] - untouched[c])), rms(free.map(|c| untouched[c])));
    assert!(of_frame < 1e-3 * size, "{of_frame} of {size}");
    assert!(found.misfit < 1.5, "{}", found.misfit);
}

/// Derivatives agree with central differences of the model.
#[test]
fn derivatives_are_those_of_differences() {
    let (design, model) = skin();
    let options = IdentifyOptions { radius_sd: 0.08, length_sd: 0.007, ..IdentifyOptions::default() };
    let identifier = Identifier::new(&design, &model, options).unwrap();
    let count = identifier.unknown_count();
    let x: Vec<f64> = (0..count).map(|k| 0.2 * ((k * 13 % 7) as f64 - 3.0) / 3.0).collect();
    let state = identifier.unknowns(&x);
    let at = identifier.model_at(&state).unwrap();
    let rest = at.solve(at.rest_conductivity()).unwrap();
    let data = identifier.data(&rest, &vec![0.1; rest.len()]).unwrap();
    let jacobian = identifier.jacobian(&at, &data).unwrap();
    let coating = identifier.basis.columns;
    for unknown in [0, 1 + coating / 2, 1 + coating, 2 + coating + 4, count - 9, count - 2, count - 1] {
        let frame = |by: f64| {
            let mut x = x.clone();
            x[unknown] += by;
            let model = identifier.model_at(&identifier.unknowns(&x)).unwrap();
            data.residuals(&model.solve(model.rest_conductivity()).unwrap())
        };
        let (below, above) = (frame(-1e-3), frame(1e-3));
        let expected: Vec<f64> = below.iter().zip(&above).map(|(below, above)| (below - above) / 2e-3).collect();
        let off = rms(expected.iter().enumerate().map(|(row, expected)| jacobian.at(row, unknown) - expected));
        let size = rms(expected);
        println!("unknown {unknown}: {off} of {size}");
        // Displacements by one-sided differences of 0.1 mm; of contacts the series resistances are held constant.
        assert!(off < 0.03 * size, "unknown {unknown}: {off} of {size}");
    }
}

/// On a body known only by its mesh, electrodes move in its tangent planes, those on its edge along it; derivatives are those of
/// differences, and displacements are found again.
#[test]
fn electrodes_of_a_mesh_are_displaced_in_its_tangent_planes() {
    let (mut design, model) = skin();
    design.body = Body::Mesh { file: "cylinder.stl".into(), unit_m: 1.0 };
    let model = ForwardModel::new(&design, model.mesh()).unwrap();
    let identifier = Identifier::new(&design, &model, IdentifyOptions::default()).unwrap().on_equal_mesh();
    // The rings at both ends have one direction each, the others two.
    let on_edge = design.electrodes.iter().filter(|one| [0.0, 0.3].contains(&one.centre_m[2])).count();
    assert_eq!(identifier.displacements.len(), 2 * 30 - on_edge);
    let nodes_m = &model.mesh().nodes;
    for displacement in &identifier.displacements {
        let (electrode, _) = displacement.electrode.unwrap();
        let velocities = displacement.velocities(&Surface::Free, nodes_m);
        let fastest = velocities.iter().map(|(_, by)| norm(*by)).fold(0.0, f64::max);
        assert!((0.9..=1.0 + 1e-9).contains(&fastest), "electrode {electrode}: {fastest}");
        for (node, [x, y, z]) in velocities {
            let [at_x, at_y, at_z] = nodes_m[node];
            // Normals of nodes are those of the cylinder but for the size of its cells.
            assert!((x * at_x + y * at_y).abs() < 0.25 * at_x.hypot(at_y), "electrode {electrode}: across the wall");
            let is_on_rim = !(1e-9..=0.3 - 1e-9).contains(&at_z);
            assert!(!is_on_rim || z.abs() < 1e-9, "electrode {electrode}: over the edge");
        }
    }
    let count = identifier.unknown_count();
    let truth: Vec<f64> =
        (0..count).map(|k| if k + 40 > count { ((k * 7 % 5) as f64 - 2.0) / 2.0 } else { 0.0 }).collect();
    let made = identifier.model_at(&identifier.unknowns(&truth)).unwrap();
    let untouched = made.solve(made.rest_conductivity()).unwrap();
    let found = identifier.identify(&untouched, &vec![1e-3; untouched.len()]).unwrap();
    let off = found
        .displacements_m
        .iter()
        .zip(identifier.displacements_m(&truth))
        .flat_map(|(a, b)| [a[0] - b[0], a[1] - b[1]]);
    let of_displacements = rms(off);
    println!("displacements {of_displacements} m, misfit {}", found.misfit);
    assert!(of_displacements < 8e-5 && found.misfit < 1.0);
    let data = identifier.data(&untouched, &vec![0.1; untouched.len()]).unwrap();
    let jacobian = identifier.jacobian(&made, &data).unwrap();
    for unknown in [count - 1, count - 17, count - 30] {
        let frame = |by: f64| {
            let mut x = truth.clone();
            x[unknown] += by;
            let model = identifier.model_at(&identifier.unknowns(&x)).unwrap();
            data.residuals(&model.solve(model.rest_conductivity()).unwrap())
        };
        let (below, above) = (frame(-1e-2), frame(1e-2));
        let expected: Vec<f64> = below.iter().zip(&above).map(|(below, above)| (below - above) / 2e-2).collect();
        let off = rms(expected.iter().enumerate().map(|(row, expected)| jacobian.at(row, unknown) - expected));
        assert!(off < 0.03 * rms(expected.iter().copied()), "unknown {unknown}: {off}");
    }
}

/// Of reciprocal channels one is saturated: the skin is found as without both.
#[test]
fn a_saturated_channel_does_not_spoil_the_skin() {
    let (design, model) = skin();
    let identifier = Identifier::new(&design, &model, IdentifyOptions::default()).unwrap().on_equal_mesh();
    let even: Vec<f64> = model.rest_conductivity().iter().map(|s| 1.1 * s).collect();
    let mut untouched = model.solve(&even).unwrap();
    let largest = (0..untouched.len()).max_by(|a, b| untouched[*a].total_cmp(&untouched[*b])).unwrap();
    untouched.0[largest] *= 0.8;
    let found = identifier.identify(&untouched, &vec![1e-3; untouched.len()]).unwrap();
    let off = rms(found.conductivity().iter().zip(&even).map(|(found, truth)| (found / truth).ln()));
    println!("misfit {}, conductance off by {off}", found.misfit);
    assert!(found.misfit < 1.0 && off < 0.01, "{} {off}", found.misfit);
}

/// Sizes that nodes are displaced for change the frame as those of a design that is meshed with them do.
#[test]
fn sizes_are_those_of_designs() {
    const BY: f64 = 0.05;
    let design = SkinDesign::shipped("cylinder30").unwrap();
    let frame = |design: &SkinDesign| {
        let model = ForwardModel::new(design, &Mesh::generate(design).unwrap()).unwrap();
        let off = discretisation_ohm(design, &model).unwrap();
        let frame = model.solve(model.rest_conductivity()).unwrap();
        (frame.iter().zip(off).map(|(value, off)| value + off).collect::<Vec<f64>>(), model)
    };
    let (rest, model) = frame(&design);
    let mut wider = design.clone();
    let mut longer = design.clone();
    let Body::Cylinder { length_m, .. } = &mut longer.body else { panic!("a cylinder") };
    *length_m *= 1.0 + BY;
    for (wider, longer) in wider.electrodes.iter_mut().zip(&mut longer.electrodes) {
        let crate::design::ElectrodeShape::Disc { radius_m } = &mut wider.shape else { panic!("discs") };
        *radius_m *= 1.0 + BY;
        longer.centre_m[2] *= 1.0 + BY;
    }
    for (sizes, changed) in [([BY, 0.0], wider), ([0.0, BY], longer)] {
        let [radius_sd, length_sd] = sizes;
        let options = IdentifyOptions { radius_sd, length_sd, ..IdentifyOptions::default() };
        let identifier = Identifier::new(&design, &model, options).unwrap();
        let mut x = vec![0.0; identifier.unknown_count()];
        *x.last_mut().unwrap() = 1.0;
        let own = identifier.model_of(&x).unwrap();
        let own = own.solve(own.rest_conductivity()).unwrap();
        let own =
            own.iter().zip(identifier.discretisation_ohm()).zip(&rest).map(|((value, off), rest)| value + off - rest);
        let expected: Vec<f64> = frame(&changed).0.iter().zip(&rest).map(|(value, rest)| value - rest).collect();
        let off = rms(own.zip(&expected).map(|(own, expected)| own - expected)) / rms(expected.iter().copied());
        println!("{sizes:?}: {off}");
        assert!(off < 0.1, "{sizes:?}: {off}");
    }
}

#[test]
fn the_field_has_its_variance_and_correlation() {
    let (_, model) = skin();
    let basis = coating::basis(model.mesh(), 0.04).unwrap();
    let mesh = model.mesh();
    for (a, b) in [(10, 10), (0, mesh.cell_count() / 3), (5, 6), (100, 700)] {
        let covariance: f64 = basis.row(a).iter().zip(basis.row(b)).map(|(a, b)| a * b).sum();
        let apart_m = crate::geom::vector::distance(mesh.cell_centre(a), mesh.cell_centre(b));
        let exact = (-0.5 * (apart_m / 0.04).powi(2)).exp();
        assert!((covariance - exact).abs() < 0.03, "{a} {b}: {covariance}, not {exact}");
    }
}

#[test]
fn bad_input_is_refused_with_its_name() {
    let (design, model) = skin();
    assert_ne!(design.body.surface(), Surface::Free);
    let identifier = Identifier::new(&design, &model, IdentifyOptions::default()).unwrap();
    let frame = Frame(vec![1.0; 870]);
    let message = |frame: &Frame, sd: &[f64]| identifier.identify(frame, sd).unwrap_err().to_string();
    assert_eq!(
        message(&Frame(vec![1.0; 3]), &[1.0; 870]),
        "the untouched frame has 3 values, but the protocol has 870"
    );
    assert_eq!(message(&frame, &[1.0; 2]), "the list of deviations has 2 values, but the protocol has 870");
    assert!(message(&frame, &[0.0; 870]).contains("no channel has a finite value"));
    let mut amplitudes = design.clone();
    amplitudes.protocol = amplitudes.protocol.with_amplitude_only(true);
    let error = Identifier::new(&amplitudes, &model, IdentifyOptions::default()).unwrap_err();
    assert!(error.to_string().contains("amplitude_only"));
}
