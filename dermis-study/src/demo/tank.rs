//! Measured frames of a saline tank: the objects in it, and their positions.

use super::write_page;
use crate::to_json;
use crate::{Result, StudyOutput};
use dermis::design::SkinDesign;
use dermis::frame::Frame;
use dermis::image::Image;
use dermis::mesh::Mesh;
use dermis::method::{Method, MethodOptions, Methods};
use dermis::reconstruct::Quantity;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_plot::report::{Report, Table};
use dermis_plot::{Drawing, Picture, View};
use dermis_sim::evaluate::{FoundObject, Material, TankObject, find_objects};
use std::path::Path;

/// A recording: the frame of the empty tank and that of the tank with its objects, one row of numbers each.
struct Recording {
    name: &'static str,
    empty: &'static str,
    objects: &'static str,
}

/// The two frames of a recording, by its name in `dermis-study/tank`.
macro_rules! recording {
    ($name:literal) => {
        Recording {
            name: $name,
            empty: include_str!(concat!("../../tank/", $name, "_empty.csv")),
            objects: include_str!(concat!("../../tank/", $name, "_objects.csv")),
        }
    };
}

const RECORDINGS: [Recording; 6] = [
    recording!("metal1_55uA"),
    recording!("metal1_plastic5_55uA"),
    recording!("metal1_plastic5_plastic9_55uA"),
    recording!("metal1_plastic5_plastic9_metal13_20uA"),
    recording!("metal1_plastic5_plastic9_metal13_55uA"),
    recording!("metal1_plastic5_plastic9_metal13_60uA"),
];

/// The object at each electrode in each recording.
const OBJECTS: &str = include_str!("../../tank/objects.csv");

/// Where the frames come from.
const SOURCE: &str =
    "Real frames of a 16-electrode saline tank, from CBZ199671/PyEIDORS (MIT licence; see dermis-study/tank).";

/// A recording, its image and its objects.
struct Found {
    name: &'static str,
    image: Image,
    objects: Vec<FoundObject>,
}

/// Localises the objects in every recording, prints their positions, and writes the page.
pub(super) fn run(output: &Path) -> Result<StudyOutput> {
    let skin = Skin::load("tank16")?;
    let design = skin.design();
    let method = Methods::linear().method(&skin, "noser", &MethodOptions::default())?;
    let found: Vec<Found> =
        RECORDINGS.iter().map(|recording| find(recording, design, &method)).collect::<Result<_>>()?;
    let how = method.description();
    write_page(output, &page(design, skin.mesh(), &found, &how)?)?;
    let there = found.iter().flat_map(|found| &found.objects);
    let (all, near) =
        there.fold((0, 0), |(all, near), object| (all + 1, near + usize::from(object.is_at_its_electrode())));
    let text = format!(
        "{SOURCE}\nDifference images by {how}.\n\n{}\n{near} of {all} objects within half an electrode's spacing of \
         their electrode.\n\nThe report with all pictures: {}\n",
        table(&found).to_text(),
        output.display()
    );
    Ok(StudyOutput { text, json: to_json(&summary(&found, output))? })
}

fn find(recording: &Recording, design: &SkinDesign, method: &Method) -> Result<Found> {
    let difference = &frame(recording.objects, design) - &frame(recording.empty, design);
    let image = method.reconstruct().reconstruct(&difference)?;
    let named: Vec<TankObject> = objects_of(recording.name);
    Ok(Found { name: recording.name, objects: find_objects(&image, &named, design.electrodes.len()), image })
}

/// Parses a shipped frame.
fn frame(text: &str, design: &SkinDesign) -> Frame {
    let number = |cell: &str| cell.trim().parse().expect("the shipped frames hold numbers");
    let values: Vec<f64> = text.trim().split(',').map(number).collect();
    assert_eq!(values.len(), design.protocol.channel_count(), "the shipped frames fit the shipped design");
    Frame(values)
}

fn objects_of(recording: &str) -> Vec<TankObject> {
    let cells = OBJECTS.lines().skip(1).map(|line| line.split(',').map(str::trim).collect::<Vec<_>>());
    cells
        .filter(|cells| cells.first() == Some(&recording))
        .map(|cells| TankObject {
            electrode: cells[1].parse().expect("the shipped list names electrodes by number"),
            material: if cells[2] == "metal" { Material::Metal } else { Material::Plastic },
        })
        .collect()
}

fn material_name(material: Material) -> &'static str {
    match material {
        Material::Metal => "metal",
        Material::Plastic => "plastic",
    }
}

fn table(found: &[Found]) -> Table {
    let mut table = Table::new(&["recording", "object", "at electrode", "found at", "off by (spacings)"]);
    for recording in found {
        for object in &recording.objects {
            let electrode = object.object.electrode;
            let count = RIM_ELECTRODES as f64;
            let place = (electrode as f64 + object.off_spacings).rem_euclid(count);
            let (place, off) = match object.position_m {
                // Positions just below the count wrap around to electrode 0.
                Some(_) => (
                    format!("{:.2}", if place >= count - 0.005 { 0.0 } else { place }),
                    format!("{:+.2}", object.off_spacings),
                ),
                None => ("not found".to_string(), "\u{2013}".to_string()),
            };
            let material = material_name(object.object.material).to_string();
            table.row([recording.name.to_string(), material, electrode.to_string(), place, off]);
        }
    }
    table
}

/// Number of electrodes of the tank.
const RIM_ELECTRODES: usize = 16;

fn page(design: &SkinDesign, mesh: &Mesh, found: &[Found], how: &str) -> Result<Report> {
    let mut report = Report::new("Dermis demo: a real tank", SOURCE);
    report.paragraph(
        "Each recording is one frame of the empty tank and one with objects in it. Metal conducts better than the water \
         and shows red, plastic does not conduct and shows blue. Electrodes are counted from 0: number 0 is the \
         recordings' electrode 1. Nothing was fitted to these frames.",
    );
    report.table(&table(found));
    let drawing = Drawing::new(design, mesh);
    let pictures: Result<Vec<(Picture, String)>> =
        found.iter().map(|recording| Ok((picture(&drawing, design, recording, how)?, caption(recording)))).collect();
    report.pictures(&pictures?);
    Ok(report)
}

fn caption(recording: &Found) -> String {
    let worst = recording.objects.iter().map(|object| object.off_spacings.abs()).fold(0.0, f64::max);
    format!(
        "{}: {}, at most {worst:.2} of an electrode's spacing off.",
        recording.name,
        counted(recording.objects.len(), "object")
    )
}

fn picture(drawing: &Drawing<'_>, design: &SkinDesign, recording: &Found, how: &str) -> Result<Picture> {
    let mut scene = drawing.image(&recording.image, Quantity::Change);
    if let Some(key) = &mut scene.key {
        // The recordings do not state the conductance of the water or the size of the tank.
        key.label = "conductance above the water's (arbitrary scale)".into();
    }
    let named = recording.objects.iter().filter_map(|object| {
        let name = format!("{} {}", material_name(object.object.material), object.object.electrode);
        object.position_m.map(|position_m| (position_m, name))
    });
    drawing.add_named_marks(&mut scene, named, "object found, with its electrode");
    let scene = scene.titled(recording.name, how);
    Ok(View::Unrolled.draw(&scene, design)?)
}

fn summary(found: &[Found], report: &Path) -> serde_json::Value {
    let object = |object: &FoundObject| {
        serde_json::json!({
            "material": material_name(object.object.material),
            "electrode": object.object.electrode,
            "position_m": object.position_m,
            "off_spacings": object.off_spacings,
            "at_its_electrode": object.is_at_its_electrode(),
        })
    };
    let recordings: Vec<serde_json::Value> = found
        .iter()
        .map(|found| {
            let objects: Vec<serde_json::Value> = found.objects.iter().map(object).collect();
            serde_json::json!({ "recording": found.name, "objects": objects })
        })
        .collect();
    serde_json::json!({ "simulated": false, "recordings": recordings, "report": report })
}
