//! The demo's report.

use super::presses::{AMPLITUDE, CAVEAT, Demo, WIDTH_M};
use crate::command::plot::{image_scene, localisation_scene, sensitivity_scene};
use crate::failure::{Failure, Outcome};
use crate::picture::chart::Histogram;
use crate::picture::colour::Scale;
use crate::picture::{Drawing, Key, Picture, Scene, View};
use crate::report::Report;
use dermis::contact::Contact;
use dermis::design::{SkinDesign, TouchEffect};
use dermis::image::Image;

/// The page of a demo.
pub fn report(demo: &Demo) -> Outcome<Report> {
    let drawing = Drawing::new(&demo.design, &demo.mesh);
    let lead = "The skin of the paper, pressed 900 times in simulation: from a design to contacts, and how far they \
        are from the truth.";
    let mut report = Report::new("Dermis demo: 900 presses on cylinder30", lead);
    results(&mut report, demo, &drawing)?;
    examples(&mut report, demo, &drawing)?;
    the_skin(&mut report, demo, &drawing)?;
    report.heading("Do it yourself");
    report.paragraph("The same from the command line, on a design of your own (see `dermis --help`):");
    report.code(
        "dermis new cylinder -o my_skin.toml\ndermis mesh my_skin.toml -o my_skin.vtu\n\
         dermis plot my_skin.toml --what sensitivity -o sensitivity.png\n\
         dermis reconstruct my_skin.toml --frames frames.csv --baseline untouched.csv -o images.npy",
    );
    Ok(report)
}

fn results(report: &mut Report, demo: &Demo, drawing: &Drawing<'_>) -> Outcome {
    report.heading("Where the presses were found");
    report.paragraph(&demo.heading());
    report.table(&demo.table());
    report.paragraph(CAVEAT);
    let mut scene = localisation_scene(drawing, &demo.design, &demo.truth, &demo.contacts);
    scene.title = format!("Localisation of {} presses", demo.score.presses);
    scene.subtitle = "simulated".into();
    let flat = draw(&scene, &demo.design, View::Unrolled)?;
    let solid = draw(&scene, &demo.design, View::solid(&demo.design, &demo.mesh))?;
    let caption = "As the paper's Fig. 7: black dots are the true places, red circles the estimates, yellow the \
        electrodes. Left and right edge are the same line on the skin.";
    report.pictures(&[(flat, caption.into()), (solid, "The same, from both sides.".into())]);
    let peaks: Vec<f64> = demo.images.iter().map(|image| image.peak().map_or(f64::NAN, |(_, peak)| peak)).collect();
    let mean = peaks.iter().sum::<f64>() / peaks.len().max(1) as f64;
    let relative: Vec<f64> = peaks.iter().map(|peak| peak / mean).collect();
    report.pictures(&[
        (error_histogram(demo), "How often a press was misplaced by how much.".into()),
        (
            peak_map(demo, drawing, &relative)?,
            "As the paper's Fig. 8: the peak of the image of a press at each place, over its mean. An even skin would \
             show one colour."
                .into(),
        ),
    ]);
    Ok(())
}

fn error_histogram(demo: &Demo) -> Picture {
    let surface = demo.design.body.surface();
    let mut errors_mm = Vec::new();
    for (touches, contacts) in demo.truth.iter().zip(&demo.contacts) {
        let matched = dermis::evaluate::match_contacts(touches, contacts, &surface);
        errors_mm.extend(matched.pairs.iter().map(|(_, _, distance_m)| distance_m * 1e3));
    }
    let summary = &demo.score.localisation_m;
    let mark = |name: &str, value_m: f64| (value_m * 1e3, format!("{name} {:.1} mm", value_m * 1e3));
    Histogram {
        title: "Localisation error, simulated",
        label: "distance along the surface (mm)",
        values: &errors_mm,
        step: 0.25,
        marks: vec![mark("median", summary.median), mark("mean", summary.mean), mark("95th percentile", summary.p95)],
    }
    .draw()
}

fn peak_map(demo: &Demo, drawing: &Drawing<'_>, relative: &[f64]) -> Outcome<Picture> {
    let key =
        Key { scale: Scale::sequential(relative.iter().copied()), label: "peak of the image over its mean".into() };
    let mut scene = drawing.field(&demo.images[0].space, relative, key);
    scene.title = "Sensitivity by place of the press".into();
    scene.subtitle = format!("spread (sd over mean) {:.2}", demo.score.sensitivity_spread);
    draw(&scene, &demo.design, View::Unrolled)
}

fn examples(report: &mut Report, demo: &Demo, drawing: &Drawing<'_>) -> Outcome {
    report.heading("Images");
    report.paragraph(
        "What one frame of 870 voltages shows: red where the sheet conducts better than untouched, blue where the \
         image swings to the other side. A dot is the true place, a cross the contact found.",
    );
    let mut pictures = Vec::new();
    for (name, z_m, degrees) in
        [("in the middle", 0.155, 150.0), ("on the seam", 0.105, 6.0), ("near the rim", 0.015, 222.0)]
    {
        let index = nearest_press(demo, z_m, degrees);
        let title = format!("One press {name}");
        let scene = example(drawing, &title, &demo.truth[index], &demo.images[index], &demo.contacts[index]);
        pictures.push((draw(&scene, &demo.design, View::Unrolled)?, format!("Press {index}, {name}.")));
    }
    let (touches, image, contacts) = &demo.four;
    let scene = example(drawing, "Four touches at once", touches, image, contacts);
    let caption = format!("Four touches in one frame, as in the paper's Fig. 9: {} contacts found.", contacts.len());
    pictures.push((draw(&scene, &demo.design, View::Unrolled)?, caption));
    report.pictures(&pictures);
    let solid = draw(&scene, &demo.design, View::solid(&demo.design, &demo.mesh))?;
    report.pictures(&[(solid, "The four touches in space.".into())]);
    Ok(())
}

fn nearest_press(demo: &Demo, z_m: f64, degrees: f64) -> usize {
    let surface = demo.design.body.surface();
    let place = surface.at(z_m, f64::to_radians(degrees)).expect("the paper's skin is a cylinder");
    let distance = |index: &usize| surface.distance_m(demo.truth[*index][0].position_m, place);
    (0..demo.truth.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

fn example(drawing: &Drawing<'_>, title: &str, touches: &[Contact], image: &Image, contacts: &[Contact]) -> Scene {
    let mut scene = image_scene(drawing, image, TouchEffect::ConductanceRises);
    drawing.add_contacts(&mut scene, contacts);
    drawing.add_touches(&mut scene, touches);
    scene.title = title.to_string();
    scene.subtitle = "simulated, one frame".into();
    scene
}

fn the_skin(report: &mut Report, demo: &Demo, drawing: &Drawing<'_>) -> Outcome {
    report.heading("The skin and its model");
    report.paragraph(&format!(
        "A cylinder 300 mm long and 100 mm across with {} electrodes of 4 mm radius. A press raises the sheet's \
         conductance by a Gaussian: {} times more in the middle, with a standard deviation of {} mm. The frames come \
         from a mesh of {} nodes, the images from one of {} nodes; a baseline is the mean of {} untouched frames, and \
         each press is one frame with its own noise.",
        demo.design.electrodes.len(),
        1.0 + AMPLITUDE,
        WIDTH_M * 1e3,
        demo.simulation_nodes,
        demo.mesh.node_count(),
        dermis::experiment::UNTOUCHED_FRAMES
    ));
    let titled = |scene: Scene, title: &str| Scene { title: title.to_string(), ..scene };
    let mesh_line = format!("{} nodes, {} triangles", demo.mesh.node_count(), demo.mesh.cell_count());
    let mesh = Scene { subtitle: mesh_line, ..titled(drawing.mesh(), "The mesh that reconstructs") };
    let electrodes = titled(drawing.electrodes(), "Electrodes");
    let space = &demo.images[0].space;
    let sensitivity = titled(sensitivity_scene(drawing, space, &demo.sensitivity), "Sensitivity of the frame");
    let solid = View::solid(&demo.design, &demo.mesh);
    report.pictures(&[
        (draw(&electrodes, &demo.design, solid)?, "The electrodes and their numbers.".into()),
        (draw(&mesh, &demo.design, View::Unrolled)?, "Fine at the electrodes' edges, coarser between.".into()),
        (
            draw(&sensitivity, &demo.design, View::Unrolled)?,
            "How strongly a small touch at each place changes the frame.".into(),
        ),
    ]);
    Ok(())
}

fn draw(scene: &Scene, design: &SkinDesign, view: View) -> Outcome<Picture> {
    view.draw(scene, design).map_err(|error| Failure::Ours(error.to_string()))
}
