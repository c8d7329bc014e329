//! The study: its stages in order, and what they write.

use crate::Arguments;
use crate::bench::Bench;
use crate::benchmarked::Benchmarked;
use crate::choose::Choice;
use crate::gallery::Gallery;
use crate::results::{Results, StructureStudy};
use crate::scale::Scale;
use crate::stage::{Parts, Schedule, Work, time};
use crate::{bias, controls, page, stated};
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis::skin::Skin;
use dermis_sim::twin::TwinOptions;
use dermis_study::comparison::{Named, shipped_networks};
use dermis_study::{Error, Progress, Result, StudyOutput, to_json};
use std::hash::{DefaultHasher, Hash, Hasher};

impl Arguments {
    /// Computes the numbers and writes the page.
    ///
    /// # Errors
    /// A design, a twin or a network that cannot be used; two networks with the same name; a folder that cannot be
    /// written.
    pub(crate) fn run(&self, progress: &dyn Progress) -> Result<StudyOutput> {
        let design = SkinDesign::load(&self.design)?;
        let twin = TwinOptions::load(&self.twin)?;
        let work = Work::new(&self.output.join("work"), self.key(&design, &twin))?;
        let controls = controls::controls(&design);
        let bench = Bench { skin: Skin::new(design)?, twin: &twin, progress };
        let mut networks = self.networks(&bench)?;
        let mut stages = ["choosing alpha", "assessing the methods", "pictures"].map(String::from).to_vec();
        stages.extend(controls.is_some().then(|| "structure and its controls".to_string()));
        let mut schedule = Schedule::new(stages, progress);
        progress.note(&schedule.summary());

        let choice: Choice = schedule.stage(|_| work.kept("alpha", "", || Choice::make(&bench, self.scale)))?;
        let mut methods: Vec<Named> = choice.methods(&bench)?;
        methods.append(&mut networks);
        let assessed = schedule.stage(|parts| {
            let total = methods.len() * self.scale.twins() as usize;
            let make = |method| Benchmarked::make(&bench, method, self.scale, &work, parts, total);
            methods.iter().map(make).collect::<Result<_>>()
        })?;
        let gallery = schedule.stage(|_| Gallery::make(&bench, &methods, self.scale))?;
        let structure = match controls {
            None => None,
            Some(controls) => {
                Some(schedule.stage(|parts| study(controls, &bench, &methods, self.scale, &work, parts))?)
            }
        };
        let scale = self.scale;
        let found = Results { scale, bench: &bench, methods: &methods, choice: &choice, assessed, gallery, structure };
        self.write(&found, &schedule)
    }

    /// The networks; a folder without a network for this skin is rejected before the first press.
    fn networks(&self, bench: &Bench<'_>) -> Result<Vec<Named>> {
        if self.models.is_empty() {
            return shipped_networks(&bench.skin);
        }
        let networks: Vec<Named> = self.models.iter().map(|folder| bench.network(folder)).collect::<Result<_>>()?;
        let same = |(number, network): &(usize, &Named)| networks[..*number].iter().any(|one| one.key == network.key);
        match networks.iter().enumerate().find(same) {
            Some((_, network)) => Err(Error::SameName(network.key.clone())),
            None => Ok(networks),
        }
    }

    fn write(&self, found: &Results<'_>, schedule: &Schedule<'_>) -> Result<StudyOutput> {
        let page = page::page(found, schedule.done())?;
        let json = to_json(&found.summary(schedule.done()))?;
        let index = self.output.join("index.html");
        page.write(&index)?;
        write_whole(&self.output.join("report.json"), |out| out.write_all(json.as_bytes()))?;
        let ours: Vec<&str> = found.assessed.iter().map(|one| one.name.as_str()).collect();
        let table = stated::table(&["paper: linear", "paper: network"], &ours, &stated::results(found));
        let text = format!(
            "{} of {} (`{}`), SIMULATED; the paper's figures were measured\n\n{}\nThe page, with what differs: {} ({})\n",
            found.twins(),
            found.bench.skin.design().name,
            found.bench.twin.name,
            table.to_text(),
            index.display(),
            time(schedule.elapsed_s())
        );
        Ok(StudyOutput { text, json })
    }

    /// All inputs of the saved results except the methods: this program, the design, the twin and the scale.
    fn key(&self, design: &SkinDesign, twin: &TwinOptions) -> String {
        let program = std::env::current_exe().and_then(std::fs::metadata);
        let program = program.map(|file| (file.len(), file.modified().ok())).ok();
        let mut hasher = DefaultHasher::new();
        format!("{design:?}{twin:?}{program:?}").hash(&mut hasher);
        let version = env!("CARGO_PKG_VERSION");
        let (design, twin, scale, hash) = (&design.name, &twin.name, self.scale, hasher.finish());
        format!("dermis {version}, {design}, {twin}, {scale:?}, {hash:016x}")
    }
}

/// The design under study and its controls, each with the linear methods; the design under study also with the other
/// methods.
fn study(
    controls: controls::Controls,
    bench: &Bench<'_>,
    methods: &[Named],
    scale: Scale,
    work: &Work,
    parts: &Parts<'_>,
) -> Result<StructureStudy> {
    let mut structures = Vec::new();
    let cut_rad = controls.cut_rad;
    let total = controls.designs.len();
    for (number, control) in controls.designs.iter().enumerate() {
        structures.extend(parts.part(total, work, || {
            if number == 0 {
                return bias::structures(control, cut_rad, bench, methods, scale, work);
            }
            let own = Bench { skin: Skin::new(control.design.clone())?, ..*bench };
            let linear = bias::linear(control, &own, scale, work)?;
            bias::structures(control, cut_rad, &own, &linear, scale, work)
        })?);
    }
    Ok(StructureStudy { designs: controls.designs, cut_rad, structures })
}
