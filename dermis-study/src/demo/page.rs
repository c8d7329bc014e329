//! The demo's report.

use super::presses::{CAVEAT, Demo, FORCE_N, TWIN};
use crate::Result;
use crate::comparison::Shown;
use crate::plots::{LOCALISATION_CAPTION, Plots};
use dermis::text::counted;
use dermis_plot::Scale;
use dermis_plot::report::Report;

/// The page of a demo.
pub(super) fn report(demo: &Demo) -> Result<Report> {
    let plots = Plots::new(demo.skin.design(), demo.skin.mesh());
    let lead = "The skin of the paper, pressed 900 times in simulation: from a design to contacts, and how far they \
        are from the truth.";
    let mut report = Report::new("Dermis demo: 900 presses on cylinder30", lead);
    results(&mut report, demo, &plots)?;
    examples(&mut report, demo, &plots)?;
    the_skin(&mut report, demo, &plots)?;
    report.heading("Do it yourself");
    report.paragraph("On a design of your own (see `dermis --help`):");
    report.code(
        "dermis new cylinder -o my-skin.toml\ndermis plot my-skin.toml --what sensitivity -o sensitivity.png\n\
         dermis forward my-skin.toml -o untouched.csv\n\
         dermis contacts my-skin.toml --frames frames.csv --baseline untouched.csv -o contacts.csv\n\
         dermis live my-skin.toml",
    );
    Ok(report)
}

fn results(report: &mut Report, demo: &Demo, plots: &Plots<'_>) -> Result<()> {
    report.heading("Where the presses were found");
    report.paragraph(&demo.heading());
    report.table(&demo.table());
    let mut pictures = Vec::new();
    for shown in &demo.shown {
        let title = format!("Localisation of {}", counted(demo.truth.len(), "press"));
        let scene = plots.localisation(&title, &format!("simulated; {}", shown.name), &demo.truth, shown);
        pictures.push((plots.flat(&scene)?, format!("As the paper's Fig. 7. {LOCALISATION_CAPTION}")));
        pictures.push((plots.solid(&scene)?, "The same in space.".into()));
    }
    report.pictures(&pictures);
    report.paragraph(CAVEAT);
    report.table(&demo.whole_images());
    let mut pictures = Vec::new();
    for shown in &demo.shown {
        let title = format!("Localisation error, simulated; {}", shown.name);
        let errors = plots.errors(&title, &demo.truth, shown);
        pictures.push((errors, "Histogram of the localisation error.".into()));
        let caption = "As the paper's Fig. 8: the peak of the image of a press at each place, over its mean. A uniform skin would \
            show one colour.";
        let map = plots.sensitivity_map(&demo.truth, shown);
        let scale = Scale::sequential(map.iter().copied());
        pictures.push((plots.flat(&plots.sensitivity(shown, &map, scale))?, caption.into()));
    }
    report.pictures(&pictures);
    Ok(())
}

fn examples(report: &mut Report, demo: &Demo, plots: &Plots<'_>) -> Result<()> {
    report.heading("Images");
    report.paragraph(
        "The image of one frame of 870 voltages: red where the image is positive, as at a touch; blue where it is \
         negative, an artefact of the reconstruction. A dot is the true position, a cross the detected contact.",
    );
    let of = |shown: &Shown| format!("simulated, one frame; {}", shown.name);
    let mut pictures = Vec::new();
    for (name, z_m, degrees) in
        [("in the middle", 0.155, 150.0), ("on the seam", 0.105, 6.0), ("near the rim", 0.015, 222.0)]
    {
        let index = nearest_press(demo, z_m, degrees);
        let title = format!("One press {name}");
        for shown in &demo.shown {
            let scene = plots.example(&title, &of(shown), &demo.truth[index], shown, index);
            pictures.push((plots.flat(&scene)?, format!("Press {index}, {name}.")));
        }
    }
    let mut last = None;
    for shown in &demo.four {
        let scene = plots.example("Four touches at once", &of(shown), &demo.four_truth, shown, 0);
        let found = counted(shown.contacts[0].len(), "contact");
        let caption = format!("Four touches in one frame, as in the paper's Fig. 9: {found} found.");
        pictures.push((plots.flat(&scene)?, caption));
        last = Some(scene);
    }
    report.pictures(&pictures);
    if let Some(scene) = last {
        report.pictures(&[(plots.solid(&scene)?, "The four touches in space.".into())]);
    }
    Ok(())
}

fn nearest_press(demo: &Demo, z_m: f64, degrees: f64) -> usize {
    let surface = demo.skin.design().body.surface();
    let place = surface.at(z_m, f64::to_radians(degrees)).expect("the paper's skin is a cylinder");
    let distance = |index: &usize| surface.distance_m(demo.truth[*index][0].position_m, place);
    (0..demo.truth.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

fn the_skin(report: &mut Report, demo: &Demo, plots: &Plots<'_>) -> Result<()> {
    report.heading("The skin and its model");
    report.paragraph(&format!(
        "A cylinder 300 mm long and 100 mm across with {} electrodes of 4 mm radius. The twin `{TWIN}` is pressed with \
         {FORCE_N} N at every pixel of the image. The frames come from a mesh of {} nodes, the images from one of {} nodes; a \
         baseline is the mean of {} untouched frames, and each press is one frame with its own noise.",
        demo.skin.design().electrodes.len(),
        demo.simulation_nodes,
        demo.skin.mesh().node_count(),
        dermis_sim::experiment::UNTOUCHED_FRAMES
    ));
    let space = &demo.first().images[0].space;
    report.pictures(&[
        (plots.solid(&plots.electrodes())?, "The electrodes and their numbers.".into()),
        (
            plots.flat(&plots.mesh_scene("Reconstruction mesh"))?,
            "Fine at the electrodes' edges, coarser between.".into(),
        ),
        (
            plots.flat(&plots.frame_sensitivity(space, &demo.sensitivity))?,
            "Change of the frame by a small touch at each position.".into(),
        ),
    ]);
    Ok(())
}
