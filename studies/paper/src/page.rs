//! The page of a reproduction.

use crate::bias::Structure;
use crate::results::{Results, StructureStudy};
use crate::scale::{CHOOSING_SEED, Scale};
use crate::stage::{Done, time};
use crate::stated::{facts, results, table};
use clap::ValueEnum;
use dermis::text::counted;
use dermis_learn::{Card, Epoch};
use dermis_plot::Picture;
use dermis_plot::chart::Curves;
use dermis_plot::report::{Report, Table};
use dermis_study::Result;
use dermis_study::plots::{LOCALISATION_CAPTION, Plots};

/// The page.
pub(crate) fn page(found: &Results<'_>, stages: &[Done]) -> Result<Report> {
    let design = found.bench.skin.design();
    let plots = Plots::new(design, found.bench.skin.mesh());
    let lead = format!(
        "\u{201c}An ERT-based Robotic Skin with Sparsely Distributed Electrodes: Structure, Fabrication, and DNN-based Signal \
         Processing\u{201d}, its sections II to IV, on the twin \u{201c}{}\u{201d} of {}: {}. All of it is simulated.",
        found.bench.twin.name,
        design.name,
        found.twins()
    );
    let mut report = Report::new("The paper, reproduced", &lead);
    if found.scale == Scale::Glance {
        report
            .paragraph("This page was made at the scale \u{201c}glance\u{201d}, from a few dozen presses: its figures mean nothing.");
    }
    the_table(&mut report, found);
    the_sensor(&mut report, found, &plots)?;
    a_sample(&mut report, found, &plots)?;
    losses(&mut report, found);
    localisation(&mut report, found, &plots)?;
    sensitivity(&mut report, found, &plots)?;
    several_touches(&mut report, found, &plots)?;
    if let Some(study) = &found.structure {
        structure(&mut report, found, study)?;
    }
    how_it_was_made(&mut report, found, stages);
    Ok(report)
}

fn the_table(report: &mut Report, found: &Results<'_>) {
    report.heading("The paper's figures and ours");
    report.paragraph(
        "The paper's figures were measured: a real skin, a real indenter, real electronics. Ours come from twins, simulated skins \
         with errors that no method has information of. The last column lists the differences; the table shows that the chain works, \
         not that one skin is better than another. Ours is the mean of the twins, in brackets the worst one.",
    );
    let ours: Vec<&str> = found.assessed.iter().map(|one| one.name.as_str()).collect();
    report.table(&table(&["paper: linear", "paper: network"], &ours, &results(found)));
    report.paragraph("The sensor, its instrument and the experiment:");
    report.table(&table(&["paper"], &["twin"], &facts(found)));
}

fn the_sensor(report: &mut Report, found: &Results<'_>, plots: &Plots<'_>) -> Result<()> {
    report.heading("The sensor and its mesh (Fig. 3)");
    let sensitivity = plots.frame_sensitivity(
        found.bench.skin.pixels(),
        &found.bench.skin.linearised()?.sensitivity(found.bench.skin.pixels()),
    );
    report.pictures(&[
        (
            plots.solid(&plots.electrodes())?,
            "The electrodes and their numbers; those on the rims are half discs.".into(),
        ),
        (
            plots.flat(&plots.mesh_scene("Reconstruction mesh"))?,
            "Fine at the electrodes' edges, where the current is singular, coarser between.".into(),
        ),
        (plots.flat(&sensitivity)?, "How strongly a small touch at each place changes the frame.".into()),
    ]);
    Ok(())
}

fn a_sample(report: &mut Report, found: &Results<'_>, plots: &Plots<'_>) -> Result<()> {
    report.heading("A sample of voltages and image (Fig. 2)");
    let sample = &found.gallery.sample;
    report.paragraph(
        "What networks are trained on: Gaussian rises of conductance at several places, and the frame that they make, less the \
         untouched one.",
    );
    let places = sample.difference.iter().enumerate().map(|(channel, &value)| [channel as f64, value]).collect();
    let voltages = Curves {
        title: "A frame",
        subtitle: "simulated, without noise",
        below: "channel",
        left: "change (ohm)",
        logarithmic: false,
        shown: vec![0.0],
        curves: vec![("change".into(), places)],
    };
    let image = plots.truth_image("The image that belongs to it", &sample.touches, &sample.image);
    report.pictures(&[
        (voltages.draw(), format!("Change of {} values, volts per ampere driven.", sample.difference.len())),
        (plots.flat(&image)?, "Relative change of conductance per pixel; dots are the touches.".into()),
    ]);
    Ok(())
}

/// The losses of the networks among the methods.
fn losses(report: &mut Report, found: &Results<'_>) {
    let networks: Vec<(&str, &Card)> =
        found.methods.iter().filter_map(|method| Some((method.name.as_str(), method.card.as_ref()?))).collect();
    if networks.is_empty() {
        return;
    }
    report.heading("Losses (II.C)");
    report.paragraph(
        "Mean square error per pixel on inputs with noise. The paper's are 6.17e-4 on its training samples and 6.42e-4 on its test \
         samples; it does not state the scale of its target, so that losses compare only as parts of the target's variance.",
    );
    let mut table = Table::new(&[
        "network",
        "samples",
        "epochs",
        "time",
        "training loss",
        "test loss",
        "target variance",
        "unexplained",
    ]);
    for (name, card) in &networks {
        let record = &card.training;
        let last = record.epochs.last();
        let loss = |of: fn(&Epoch) -> f64| last.map_or("none".into(), |epoch| format!("{:.3e}", of(epoch)));
        let unexplained = last.map_or(f64::NAN, |epoch| epoch.test_loss / record.target_variance);
        table.push(vec![
            name.to_string(),
            record.samples.to_string(),
            record.epochs.len().to_string(),
            time(record.epochs.iter().map(|epoch| epoch.seconds).sum()),
            loss(|epoch| epoch.training_loss),
            loss(|epoch| epoch.test_loss),
            format!("{:.3e}", record.target_variance),
            format!("{:.1} %", 100.0 * unexplained),
        ]);
    }
    report.table(&table);
    let curve = |name: &str, card: &Card, of: fn(&Epoch) -> f64| {
        // Divided by the variance, so that networks with different targets fit in one chart.
        let part =
            |(number, epoch): (usize, &Epoch)| [number as f64 + 1.0, 100.0 * of(epoch) / card.training.target_variance];
        (name.to_string(), card.training.epochs.iter().enumerate().map(part).collect::<Vec<_>>())
    };
    let curves = networks.iter().flat_map(|(name, card)| {
        [
            curve(&format!("{name}, training"), card, |epoch| epoch.training_loss),
            curve(&format!("{name}, test"), card, |epoch| epoch.test_loss),
        ]
    });
    let picture = Curves {
        title: "Loss",
        subtitle: "over the variance of the target",
        below: "epoch",
        left: "unexplained (%)",
        logarithmic: false,
        shown: vec![0.0],
        curves: curves.collect(),
    };
    report.pictures(&[(picture.draw(), "Loss by epoch; training losses are means while weights changed.".into())]);
}

fn localisation(report: &mut Report, found: &Results<'_>, plots: &Plots<'_>) -> Result<()> {
    report.heading("Localisation (Fig. 7)");
    let gallery = &found.gallery;
    report.paragraph(&format!("The first twin, pressed {} times. {LOCALISATION_CAPTION}", gallery.pressed.truth.len()));
    let mut pictures = Vec::new();
    for shown in &gallery.shown {
        let error = &shown.score.localisation_m;
        let how = format!("{:.1} \u{b1} {:.1} mm, {} missed", error.mean * 1e3, error.sd * 1e3, shown.score.misses);
        let scene = plots.localisation(&format!("Localisation, {}", shown.name), &how, &gallery.pressed.truth, shown);
        pictures.push((plots.flat(&scene)?, shown.how.clone()));
    }
    for shown in &gallery.shown {
        let title = format!("Localisation error, {}", shown.name);
        let picture = plots.errors(&title, &gallery.pressed.truth, shown);
        pictures.push((picture, "Histogram of the localisation error.".into()));
    }
    report.pictures(&pictures);
    Ok(())
}

fn sensitivity(report: &mut Report, found: &Results<'_>, plots: &Plots<'_>) -> Result<()> {
    report.heading("Sensitivity (Fig. 8)");
    report.paragraph(
        "The peak of the image of each press over its force, at the place of the press, in units of its mean. A uniform \
         skin would show one colour; a twin does not, as its patches have gaps and its contacts saturate. All maps share one scale, \
         from the 2nd to the 98th percentile of all values; values beyond have the colours of its ends.",
    );
    let gallery = &found.gallery;
    let maps: Vec<Vec<f64>> =
        gallery.shown.iter().map(|shown| plots.sensitivity_map(&gallery.pressed.truth, shown)).collect();
    // One common scale for comparison; a few presses near electrodes would extend it to several times the mean.
    let scale = dermis_plot::Scale::between_quantiles(maps.iter().flatten().copied(), [0.02, 0.98]);
    let mut pictures = Vec::new();
    for (shown, map) in gallery.shown.iter().zip(&maps) {
        pictures.push((plots.flat(&plots.sensitivity(shown, map, scale))?, shown.how.clone()));
    }
    report.pictures(&pictures);
    Ok(())
}

fn several_touches(report: &mut Report, found: &Results<'_>, plots: &Plots<'_>) -> Result<()> {
    if let Some((truth, all)) = &found.gallery.four {
        report.heading("Four touches at once (Fig. 9)");
        report.paragraph(
            "One frame of the first twin, pressed with 2 N at four places that were fixed beforehand, one of them on the seam. A \
             dot is a true position, a cross a detected contact.",
        );
        let mut pictures = Vec::new();
        let mut last = None;
        for shown in all {
            let scene = plots.example(
                &format!("Four touches, {}", shown.name),
                &(counted(shown.contacts[0].len(), "contact") + " found"),
                truth,
                shown,
                0,
            );
            pictures.push((plots.flat(&scene)?, shown.how.clone()));
            last = Some((scene, shown));
        }
        report.pictures(&pictures);
        if let Some((scene, shown)) = last {
            report.heading("The touched skin in three dimensions (Fig. 1c)");
            report.pictures(&[(plots.solid(&scene)?, format!("The same four touches in space; {}.", shown.how))]);
        }
    }
    report.heading("Two touches");
    report.paragraph(
        "The part of pairs of touches, with forces drawn one by one, that were resolved: exactly two contacts, each within 10 mm \
         of its touch and within a third of the distance between them.",
    );
    let percent = |[distance_m, part]: [f64; 2]| [distance_m * 1e3, part * 100.0];
    let curves =
        found.assessed.iter().map(|one| (one.name.clone(), one.two_resolved().into_iter().map(percent).collect()));
    let picture = Curves {
        title: "Two-point resolution",
        subtitle: &found.twins(),
        below: "distance along the surface (mm)",
        left: "pairs resolved (%)",
        logarithmic: false,
        shown: vec![0.0, 100.0],
        curves: curves.collect(),
    };
    report.pictures(&[(picture.draw(), "Mean of the twins.".into())]);
    Ok(())
}

fn structure(report: &mut Report, found: &Results<'_>, study: &StructureStudy) -> Result<()> {
    report.heading("Does the structure matter?");
    report.paragraph(&format!(
        "The paper claims that electrodes on the edge alone leave the middle poor (III.A), and that centroids are not biased towards the \
         middle because the domain is closed (IV.B). The controls differ from the skin in one thing each. Rims only: the same {} \
         electrodes, half of them on each rim, once numbered so that pairs drive along a rim and once so that they drive from rim to \
         rim. Cut open: the coat parted from rim to rim at {:.0} degrees, where no electrode is; \
         since a sheet is described by lengths along itself alone, that is a flat rectangle of the same size, and the cut is an insulating \
         edge. Every control has meshes, twins and methods of its own, with the best alpha chosen anew.",
        found.bench.skin.design().electrodes.len(),
        study.cut_rad.to_degrees()
    ));
    let mut methods: Vec<&str> = study.structures.iter().map(|one| one.method.as_str()).collect();
    methods.dedup();
    for method in found.methods.iter().filter(|method| methods.contains(&method.key.as_str())) {
        report.paragraph(&format!("Method: {}.", method.name));
        report.table(&structure_table(study, &method.key));
    }
    if let Some(method) = found.methods.first() {
        report.pictures(&profiles(study, &method.key, &method.name));
    }
    report.paragraph(
        "Presses are at random places; distances are those of the presses that were found. Bias is the mean of estimate minus truth: towards the middle of the length, and away from the line of the cut. A profile \
         that is above zero on the left and below it on the right draws inwards. On the closed skin the line of the cut is a line \
         like any other.",
    );
    if let Some(worst) = study.structures.iter().map(|one| one.saturated_readings).max().filter(|&count| count > 0) {
        report.paragraph(&format!(
            "The instrument's gains are those of the skin as designed; on a control up to {worst} readings of the untouched \
             frames before the first press lay out of the converter's range."
        ));
    }
    Ok(())
}

fn structure_table(study: &StructureStudy, method: &str) -> Table {
    let structures: Vec<(&str, &Structure)> =
        study.designs.iter().filter_map(|control| Some((control.name, study.of(control.key, method)?))).collect();
    let header: Vec<&str> = ["figure"].into_iter().chain(structures.iter().map(|one| one.0)).collect();
    let mut table = Table::new(&header);
    let mut row = |what: &str, of: &dyn Fn(&Structure) -> String| {
        table.push([what.to_string()].into_iter().chain(structures.iter().map(|one| of(one.1))).collect());
    };
    let signed = |value_m: f64| format!("{:+.2}", value_m * 1e3).replace('-', "\u{2212}");
    row("localisation, mm", &|one| one.localisation.mean_and_sd_mm());
    row("in the middle third of the length, mm", &|one| one.localisation_middle.mean_mm());
    row("within 20 mm of the line of the cut, mm", &|one| one.localisation_cut.mean_mm());
    row("misses, % of presses", &|one| format!("{:.1}", 100.0 * one.misses as f64 / one.presses as f64));
    row("missed in the middle third, % of presses there", &|one| format!("{:.1}", 100.0 * one.missed_middle));
    row("false positives, % of presses", &|one| {
        format!("{:.1}", 100.0 * one.false_positives as f64 / one.presses as f64)
    });
    row("sensitivity spread", &|one| format!("{:.2}", one.sensitivity_spread));
    row("sensitivity in the middle over that towards the rims", &|one| format!("{:.2}", one.sensitivity_middle));
    row("bias along, towards the middle, mm", &|one| signed(one.bias_along_m));
    row("the same within 20 mm of a rim, mm", &|one| signed(one.bias_along_near_rims_m));
    row("bias round, away from the cut, mm", &|one| signed(one.bias_round_m));
    row("the same within 20 mm of the cut, mm", &|one| signed(one.bias_round_near_cut_m));
    row("Eq. 11: bias along, towards the middle, mm", &|one| signed(one.eq11_bias_along_m));
    row("Eq. 11: bias round, away from the cut, mm", &|one| signed(one.eq11_bias_round_m));
    row("alpha", &|one| one.alpha.map_or("\u{2013}".into(), |alpha| format!("{alpha:.2}")));
    table
}

fn profiles(study: &StructureStudy, method: &str, name: &str) -> Vec<(Picture, String)> {
    let curves = |of: &dyn Fn(&Structure) -> &Vec<[f64; 2]>| {
        let one = |control: &super::controls::Control| {
            let structure = study.of(control.key, method)?;
            let mm = |place: &[f64; 2]| place.map(|value| value * 1e3);
            Some((control.name.to_string(), of(structure).iter().map(mm).collect()))
        };
        study.designs.iter().filter_map(one).collect::<Vec<_>>()
    };
    let subtitle = format!("estimate minus truth, {name}");
    let picture = |title, below, curves| {
        let left = "mean error (mm)";
        Curves { title, subtitle: &subtitle, below, left, logarithmic: false, shown: vec![-1.0, 1.0], curves }.draw()
    };
    let along = picture("Bias along the cylinder", "z (mm)", curves(&|one| &one.along_profile_m));
    let round = picture("Bias round the cylinder", "arc from the cut (mm)", curves(&|one| &one.round_profile_m));
    vec![
        (along, "Signed error along z by the height of the press.".into()),
        (round, "Signed error along the arc by the place of the press; the cut is at both ends.".into()),
    ]
}

fn how_it_was_made(report: &mut Report, found: &Results<'_>, stages: &[Done]) {
    report.heading("How this page was made");
    let alphas: Vec<String> = found.methods.iter().map(|method| method.how()).collect();
    report.paragraph(&format!(
        "Methods: {}. The linear methods have their best alpha, with the smallest mean error on {} (seeds from {CHOOSING_SEED}) \
         that the report does not use; a miss or a false positive counts as 20 mm. One detector serves all methods; what share of an image's peak it takes for a touch is a part of the method. Every press is one \
         frame, the baseline the mean of {} frames before the first press.",
        alphas.join("; "),
        counted(found.scale.choosing_twins(), "twin"),
        dermis_sim::experiment::UNTOUCHED_FRAMES
    ));
    let scale = found.scale.to_possible_value().expect("no scale is hidden");
    report.code(&format!(
        "cargo run --release -p paper-study -- {} --twin {} --scale {} -o report",
        found.bench.skin.design().name,
        found.bench.twin.name,
        scale.get_name()
    ));
    let mut table = Table::new(&["stage", "time"]);
    for stage in stages {
        table.row([stage.stage.clone(), time(stage.seconds)]);
    }
    report.table(&table);
    report.paragraph("The same figures in SI units are in report.json beside this page.");
}
