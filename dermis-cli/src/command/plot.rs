//! `dermis plot`: pictures of a skin.

use crate::failure::{Failure, Outcome};
use crate::frames::{CurrentArguments, FrameArguments, PAIRED_HELP, of_each};
use crate::method::MethodArguments;
use crate::picture::{is_png, save};
use crate::range::count;
use clap::ValueEnum;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::{DetectOptions, Detector};
use dermis::frame::{Truth, read_array, read_truth};
use dermis::image::{Image, PixelSpace};
use dermis::mesh::Mesh;
use dermis::reconstruct::Quantity;
use dermis::skin::Skin;
use dermis_plot::{Drawing, Scene, View};
use dermis_study::plots::localisation_scene;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The arguments of `dermis plot`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// What to draw.
    #[arg(long, value_enum, default_value = "electrodes")]
    what: What,
    /// View [default: unrolled where the body has a flat layout, else 3d]
    #[arg(long, value_enum)]
    view: Option<ViewName>,
    /// Images, as `dermis reconstruct` writes them.
    #[arg(long, value_name = "FILE", conflicts_with = "frames")]
    images: Option<PathBuf>,
    /// Frames to reconstruct, one per row (CSV, NPY or NPZ; ohm, or see --unit).
    #[arg(long, value_name = "FILE")]
    frames: Option<PathBuf>,
    /// Untouched frames, one per row; their mean is subtracted.
    #[arg(long, value_name = "FILE", requires = "frames", conflicts_with = "difference")]
    baseline: Option<PathBuf>,
    /// The frames are differences from the untouched skin.
    #[arg(long, requires = "frames")]
    difference: bool,
    #[arg(long, requires = "baseline", help = PAIRED_HELP)]
    paired: bool,
    /// Go on with frames that are not those of the design, or not of the baseline.
    #[arg(long, requires = "frames")]
    force: bool,
    #[command(flatten)]
    currents: CurrentArguments,
    #[command(flatten)]
    method: MethodArguments,
    /// Number of the image or frame, from 0 (for `--what image`).
    #[arg(long, default_value_t = 0, value_parser = count(0..=10_000_000usize))]
    frame: usize,
    /// True positions of the touches (for `--what image` and `--what localisation`), as for `dermis evaluate`.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Picture to write: .svg or .png.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// Content of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// The cells and the electrodes.
    Mesh,
    /// The electrodes with their numbers.
    Electrodes,
    /// Sensitivity of a frame to a small touch at each position.
    Sensitivity,
    /// An image with its detected contacts, and with the true positions of --truth.
    Image,
    /// True positions, estimates and the errors between them.
    Localisation,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ViewName {
    /// Laid out flat.
    Unrolled,
    /// In space, from enough sides to show every electrode and contact.
    #[value(name = "3d")]
    Solid,
}

impl Arguments {
    /// Draws the picture and writes it.
    pub fn run(self) -> Outcome {
        if self.currents.are_given() && self.frames.is_none() {
            let fix = "leave --currents out, or name the frames with --frames";
            return Err(Failure::given("--currents belong to frames, and there are none", Some(fix)));
        }
        let is_of_design = matches!(self.what, What::Mesh | What::Electrodes | What::Sensitivity);
        if is_of_design && (self.frames.is_some() || self.images.is_some()) {
            let message = format!("--what {} is a picture of the design, and takes no frames", self.what_name());
            return Err(Failure::given(message, Some("give --what image, or leave the frames out")));
        }
        is_png(&self.output)?;
        let design = SkinDesign::load(&self.design)?;
        let mesh = Mesh::generate(&design)?;
        let mut scene = self.scene(&design, &mesh)?;
        if scene.title.is_empty() {
            scene.title = format!("{}: {}", design.name, self.what_name());
        }
        let view = self.view(&scene, &design);
        let picture = view.draw(&scene, &design)?;
        save(&picture, &self.output)?;
        crate::console::print(&format!("wrote {}\n", self.output.display()))
    }

    fn what_name(&self) -> &'static str {
        match self.what {
            What::Mesh => "mesh",
            What::Electrodes => "electrodes",
            What::Sensitivity => "sensitivity",
            What::Image => "image",
            What::Localisation => "localisation",
        }
    }

    fn view(&self, scene: &Scene, design: &SkinDesign) -> View {
        match self.view {
            Some(ViewName::Unrolled) => View::Unrolled,
            Some(ViewName::Solid) => View::Solid,
            None => View::of(scene, design),
        }
    }

    fn scene(&self, design: &SkinDesign, mesh: &Mesh) -> Outcome<Scene> {
        let drawing = Drawing::new(design, mesh);
        Ok(match self.what {
            What::Mesh => {
                let subtitle = format!("{} nodes, {} cells", mesh.node_count(), mesh.cell_count());
                drawing.mesh().titled("", subtitle)
            }
            What::Electrodes => drawing.electrodes(),
            What::Sensitivity => {
                let skin = Skin::with_mesh(design.clone(), mesh)?;
                drawing.sensitivity(skin.pixels(), &skin.linearised()?.sensitivity(skin.pixels()))
            }
            What::Image => {
                let Seen { images, quantity, contacts, how } = self.images(design, mesh)?;
                let image = images.get(self.frame).ok_or_else(|| self.no_such_frame(images.len()))?;
                let mut scene = drawing.image(image, quantity);
                drawing.add_contacts(&mut scene, &contacts[self.frame]);
                if let Some(path) = &self.truth {
                    drawing.add_touches(&mut scene, &read_touches(path, design, mesh, images.len())?[self.frame]);
                }
                scene.titled(format!("{}: image of frame {}", design.name, self.frame), how)
            }
            What::Localisation => {
                let Seen { images, contacts, how, .. } = self.images(design, mesh)?;
                let Some(path) = &self.truth else {
                    let message = "a picture of the localisation needs the true positions";
                    return Err(Failure::given(message, Some("name their file with --truth")));
                };
                let truth = read_touches(path, design, mesh, images.len())?;
                localisation_scene(&drawing, design, &truth, &contacts).titled("", how)
            }
        })
    }

    fn no_such_frame(&self, count: usize) -> Failure {
        let message = format!("there is no image {}: there are {count}, counted from 0", self.frame);
        Failure::given(message, Some("choose another with --frame"))
    }

    /// The images to draw.
    fn images(&self, design: &SkinDesign, mesh: &Mesh) -> Outcome<Seen> {
        if let Some(path) = &self.images {
            let how = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            let images = read_images(path, design, mesh)?;
            // They may be those of a network, which have no artefacts.
            let detector = Detector::new(DetectOptions { strength_fraction: 0.0, ..DetectOptions::default() });
            let contacts = images.iter().map(|image| detector.detect(image)).collect();
            return Ok(Seen { images, quantity: Quantity::Change, contacts, how });
        }
        let Some(frames) = &self.frames else {
            let fix = "name images with --images, or frames with --frames and --baseline";
            return Err(Failure::given("there is nothing to make an image of", Some(fix)));
        };
        if self.baseline.is_none() && !self.difference {
            let fix = "name the untouched frames with --baseline, or say --difference";
            return Err(Failure::given("frames need a baseline", Some(fix)));
        }
        let (frames, baseline, currents) = (frames.clone(), self.baseline.clone(), self.currents.clone());
        let frames = FrameArguments {
            frames,
            baseline,
            difference: self.difference,
            paired: self.paired,
            force: self.force,
            currents,
        };
        let skin = Skin::with_mesh(design.clone(), mesh)?;
        let differences = frames.read(&skin, &self.method)?;
        let method = self.method.prepare(&skin, &differences)?;
        let how = method.description();
        let detector = method.detector_of(&differences, &design.protocol)?;
        let found =
            of_each(&differences.frames, |difference| method.reconstruct().image_and_contacts(difference, &detector))?;
        let (images, contacts) = found.into_iter().unzip();
        Ok(Seen { images, quantity: method.reconstruct().quantity(), contacts, how })
    }
}

/// Images to draw.
struct Seen {
    images: Vec<Image>,
    /// Quantity of the values.
    quantity: Quantity,
    /// The contacts of each image.
    contacts: Vec<Vec<Contact>>,
    /// Description of the method.
    how: String,
}

/// The true positions of the touches of each frame.
fn read_touches(path: &Path, design: &SkinDesign, mesh: &Mesh, frame_count: usize) -> Outcome<Vec<Vec<Contact>>> {
    match read_truth(path, &mesh.place_limits(design.body.surface()), frame_count)? {
        Truth::OnSkin(touches) => Ok(touches),
        Truth::Elsewhere { .. } => {
            let message = format!("{} holds positions in a frame of reference of its own", path.display());
            Err(Failure::given(message, Some("align it first: see `dermis evaluate --align`")))
        }
    }
}

/// Images from a file: frames x rows x columns of the design's image, or frames x cells.
fn read_images(path: &Path, design: &SkinDesign, mesh: &Mesh) -> Outcome<Vec<Image>> {
    let (shape, values) = read_array(path, "images")?;
    let size: usize = shape.iter().skip(1).product();
    let mut space = PixelSpace::for_design(design, mesh)?;
    let grid = space.grid.map(|[rows, columns]| rows * columns);
    if size == mesh.cell_count() {
        space = PixelSpace::cells(mesh, design.body.surface());
    } else if grid != Some(size) || shape.len() < 2 {
        let wanted = space.grid.map(|[rows, columns]| format!("{rows} x {columns} pixels or ")).unwrap_or_default();
        let cells = mesh.cell_count();
        let message = format!(
            "{}: an array of shape {shape:?}, but each of this design's images has {wanted}{cells} cells",
            path.display()
        );
        return Err(Failure::given(message, Some("draw the images with the design that they were made with")));
    }
    let space = Arc::new(space);
    let pick = |picture: &[f64]| space.position_in_grid.iter().map(|&position| picture[position]).collect();
    let image = |picture: &[f64]| Image { space: Arc::clone(&space), values: pick(picture) };
    Ok(values.chunks_exact(size.max(1)).map(image).collect())
}
