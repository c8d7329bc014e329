//! `dermis reproduce`: the paper's sections II to IV on twins, as one page and as numbers.

mod bench;
mod benchmarked;
mod bias;
mod choose;
mod controls;
mod gallery;
mod page;
mod results;
mod scale;
mod stage;
mod stated;
mod training;

use crate::comparison::{LINEAR, Named, shipped_networks};
use crate::console::print;
use crate::failure::{Failure, Outcome};
use bench::Bench;
use benchmarked::Benchmarked;
use choose::Choice;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis_sim::twin::TwinOptions;
use gallery::Gallery;
use results::{Results, StructureStudy};
use scale::Scale;
use stage::{Budget, Work, time};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::PathBuf;

/// The arguments of `dermis reproduce`.
#[derive(Debug, Args)]
#[command(
    after_help = "What is done is kept in the folder `work` beside the page: run again, a run that was stopped goes \
    on where it was."
)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    #[arg(default_value = "cylinder30")]
    design: String,
    /// The twin: the path of its file, or a shipped name (ideal, lab, harsh).
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// The folder of a network of `dermis train` to set beside the linear methods; may be given more than once. Scale `paper`
    /// trains its own from nothing without it; the others take those that are shipped.
    #[arg(long, value_name = "DIR")]
    model: Vec<PathBuf>,
    /// How large.
    #[arg(long, value_enum, default_value_t = Scale::Quick)]
    scale: Scale,
    /// The folder for index.html and report.json.
    #[arg(short, long, value_name = "DIR", default_value = "report")]
    output: PathBuf,
    /// Print the numbers as JSON in place of tables.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Makes the page and the numbers.
    pub fn run(self) -> Outcome {
        let design = SkinDesign::load(&self.design)?;
        let twin = TwinOptions::load(&self.twin)?;
        let work = Work::new(&self.output.join("work"), key(&design, &twin, self.scale))?;
        let controls = controls::controls(&design);
        let bench = Bench::new(design, &twin)?;
        // A folder that holds no model for this skin is told of before anything is pressed.
        let mut networks: Vec<Named> = self.model.iter().map(|folder| bench.network(folder)).collect::<Outcome<_>>()?;
        if self.model.is_empty() && self.scale != Scale::Paper {
            networks = shipped_networks(&bench.skin.forward, &bench.pixels)?;
        }
        let twice =
            |(number, network): &(usize, &Named)| networks[..*number].iter().any(|other| other.key == network.key);
        if let Some((_, network)) = networks.iter().enumerate().find(twice) {
            let message = format!("two of the networks are called `{}`", network.key);
            return Err(Failure::given(
                message,
                Some("name another in one's card.json, or reproduce with one at a time"),
            ));
        }
        let steps = if self.scale == Scale::Paper && networks.is_empty() {
            training::steps(&self.design, &self.twin, work.folder())?
        } else {
            Vec::new()
        };
        let method_count = LINEAR.len() + networks.len() + steps.iter().filter(|step| step.model.is_some()).count();
        let mut stages: Vec<(String, f64)> = steps.iter().map(|step| (step.summary(), step.estimate_s)).collect();
        stages.extend(plan(self.scale, bench.pixels.len(), method_count, controls.is_some()));
        let mut budget = Budget::new(stages);
        eprintln!("{}", budget.summary());
        for step in &steps {
            budget.stage(|| step.carry_out())?;
            networks.extend(step.model.iter().map(|folder| bench.network(folder)).collect::<Outcome<Vec<_>>>()?);
        }

        let choice: Choice = budget.stage(|| work.kept("alpha", "", || Choice::make(&bench, self.scale)))?;
        let mut methods: Vec<Named> = choice.methods(&bench)?;
        methods.append(&mut networks);
        let assessed = budget.stage(|| {
            methods.iter().map(|method| Benchmarked::make(&bench, method, self.scale, &work)).collect::<Outcome<_>>()
        })?;
        let gallery = budget.stage(|| Gallery::make(&bench, &methods, self.scale))?;
        let structure = match controls {
            None => None,
            Some(controls) => Some(budget.stage(|| study(controls, &bench, &methods, self.scale, &work))?),
        };
        let scale = self.scale;
        let found = Results { scale, bench: &bench, methods: &methods, choice: &choice, assessed, gallery, structure };
        self.write(&found, &budget)
    }

    fn write(&self, found: &Results<'_>, budget: &Budget) -> Outcome {
        let page = page::page(found, budget.done())?.to_html();
        let told = serde_json::to_string_pretty(&found.summary(budget.done()));
        let told = told.map_err(|error| Failure::Ours(error.to_string()))?;
        let index = self.output.join("index.html");
        write_whole(&index, |out| out.write_all(page.as_bytes()))?;
        write_whole(&self.output.join("report.json"), |out| writeln!(out, "{told}"))?;
        if self.json {
            return print(&format!("{told}\n"));
        }
        let ours: Vec<&str> = found.assessed.iter().map(|one| one.name.as_str()).collect();
        let table = stated::table(&["paper: linear", "paper: network"], &ours, &stated::results(found));
        print(&format!(
            "{} of {} (`{}`), SIMULATED; the paper's figures were measured\n\n{}\nThe page, with what differs: {} ({})\n",
            found.twins(),
            found.bench.skin.design.name,
            found.bench.twin.name,
            table.to_text(),
            index.display(),
            time(budget.elapsed_s())
        ))
    }
}

/// The design under study and its controls, each with the linear methods; the design also by the methods that only it has.
fn study(
    controls: controls::Controls,
    bench: &Bench<'_>,
    methods: &[Named],
    scale: Scale,
    work: &Work,
) -> Outcome<StructureStudy> {
    let mut structures = Vec::new();
    let cut_rad = controls.cut_rad;
    for (number, control) in controls.designs.iter().enumerate() {
        if number == 0 {
            structures.extend(bias::structures(control, cut_rad, bench, methods, scale, work)?);
        } else {
            let own = Bench::new(control.design.clone(), bench.twin)?;
            let linear = bias::linear(control, &own, scale, work)?;
            structures.extend(bias::structures(control, cut_rad, &own, &linear, scale, work)?);
        }
    }
    Ok(StructureStudy { designs: controls.designs, cut_rad, structures })
}

/// Everything that kept results depend on but the methods: the program, the design, the twin and the scale.
fn key(design: &SkinDesign, twin: &TwinOptions, scale: Scale) -> String {
    let program = std::env::current_exe().and_then(std::fs::metadata);
    let program = program.map(|file| (file.len(), file.modified().ok())).ok();
    let mut hasher = DefaultHasher::new();
    format!("{design:?}{twin:?}{program:?}").hash(&mut hasher);
    format!("dermis {}, {}, {}, {scale:?}, {:016x}", env!("CARGO_PKG_VERSION"), design.name, twin.name, hasher.finish())
}

/// Time to draw a twin and to learn its patches, on two cores, s.
const TWIN_S: f64 = 3.0;
/// Time to read and to see a frame, on two cores, s.
const FRAME_S: f64 = 4e-4;

/// The stages and the seconds that they are expected to take on two cores.
fn plan(scale: Scale, pixels: usize, methods: usize, controls: bool) -> Vec<(String, f64)> {
    let size = scale.result();
    let linear = LINEAR.len() as f64;
    let twin = |twins: u64, frames: usize| twins as f64 * (TWIN_S + frames as f64 * FRAME_S);
    // Every frame is seen once with every alpha.
    let choose = twin(scale.choosing_twins(), 11 * scale.choosing_presses()) + 11.0 * linear * 0.2;
    let grid = pixels.div_ceil(scale.grid_step());
    // The presses at random places are on a twin of their own; a smallest force takes some ten frames.
    let frames = crate::command::benchmark::steps(&size, pixels) + 12 * pixels.div_ceil(size.force_step);
    let mut plan = vec![
        ("choosing alpha", choose),
        ("assessing the methods", methods as f64 * (twin(scale.twins(), frames) + TWIN_S * scale.twins() as f64)),
        ("pictures", twin(1, grid) + 2.0),
    ];
    if controls {
        let presses = 2 * scale.structure_presses();
        plan.push(("structure and its controls", 4.0 * twin(scale.twins(), presses) + 3.0 * choose));
    }
    plan.into_iter().map(|(stage, seconds)| (stage.to_string(), seconds)).collect()
}
