//! A skin ready to be read live: all that is computed once.

use crate::LiveError;
use crate::scan::ScanTable;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::reconstruct::{Linearised, OneStep, OneStepOptions, Prior, Reconstruct, WithoutChannels};
use dermis_learn::Model;
use std::path::Path;
use std::sync::Arc;

/// A skin ready to be read live: its design, its model, the methods that make its images.
pub struct LiveSkin {
    /// The design.
    pub design: SkinDesign,
    /// The text of the design's file, which recordings carry.
    pub design_text: String,
    /// Its forward model.
    pub forward: ForwardModel,
    /// The pixels of its images.
    pub pixels: Arc<PixelSpace>,
    /// What a device reads.
    pub scan: ScanTable,
    /// Its forward model made linear about the untouched skin.
    pub linear: Linearised,
    methods: Vec<NamedMethod>,
    /// The name of the network that does not come with the library.
    own: Option<String>,
}

/// A method under the name that it is chosen by.
#[derive(Clone)]
pub struct NamedMethod {
    /// Its name: `best`, `paper`, `noser`, `laplace`, or the folder of a model, whatever its card calls it.
    pub name: String,
    /// It.
    pub method: Arc<dyn Reconstruct>,
    /// What makes it anew without some channels; `None` of a network, for which they are filled in.
    pub prior: Option<Prior>,
    /// The card of a network, JSON.
    pub card: Option<String>,
}

impl std::fmt::Debug for LiveSkin {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<&str> = self.method_names().collect();
        formatter.debug_struct("LiveSkin").field("design", &self.design.name).field("methods", &names).finish()
    }
}

/// The linear methods that stand ready for every skin.
const LINEAR: [(&str, Prior); 2] = [("noser", Prior::Noser { exponent: 0.5 }), ("laplace", Prior::Laplace)];

/// The order in which networks are preferred where none is asked for.
const PREFERRED: [&str; 4] = ["best", "paper", "shapes", "noser"];

impl LiveSkin {
    /// Prepares a skin from the text of its design; `name` is its path, which errors name. `model`: the folder of a network
    /// beside the shipped ones, which becomes a method of that name.
    ///
    /// # Errors
    /// A design that is refused, a model of another skin, a folder that is called like another method.
    pub fn new(design_text: &str, name: &str, model: Option<&str>) -> Result<Self, LiveError> {
        let design = SkinDesign::parse(design_text, name).map_err(dermis::Error::from)?;
        let mesh = Mesh::generate(&design).map_err(dermis::Error::from)?;
        let forward = ForwardModel::new(&design, &mesh)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh()).map_err(dermis::Error::from)?);
        let linear = Linearised::new(&forward, &pixels)?;
        let scan = ScanTable::new(&design.protocol)?;
        let mut skin = LiveSkin {
            design_text: design_text.into(),
            design,
            forward,
            pixels,
            scan,
            linear,
            methods: Vec::new(),
            own: None,
        };
        for model in Model::shipped(&skin.forward, &skin.pixels)? {
            skin.methods.push(network(model.card().name.clone(), model));
        }
        for (name, prior) in LINEAR {
            skin.methods.push(skin.linear_method(name, prior, &[])?);
        }
        model.map_or(Ok(()), |folder| skin.add(folder))?;
        Ok(skin)
    }

    /// Adds the network of a folder.
    fn add(&mut self, folder: &str) -> Result<(), LiveError> {
        if self.method(folder).is_ok() {
            let message = format!("`{folder}` is the name of another method: write ./{folder} for the folder");
            return Err(LiveError::Given(message));
        }
        let model = Model::load(Path::new(folder), &self.forward, Arc::clone(&self.pixels))?;
        self.methods.push(network(folder.into(), model));
        self.own = Some(folder.into());
        Ok(())
    }

    /// A linear method without some channels.
    ///
    /// # Errors
    /// Too few channels left.
    fn linear_method(&self, name: &str, prior: Prior, masked: &[usize]) -> Result<NamedMethod, LiveError> {
        let options = OneStepOptions {
            prior,
            excluded: masked.to_vec(),
            touch: self.design.sheet.touch,
            ..OneStepOptions::default()
        };
        let method = OneStep::from_linearised(&self.linear, Arc::clone(&self.pixels), &options)?;
        Ok(NamedMethod { name: name.into(), method: Arc::new(method), prior: Some(prior), card: None })
    }

    /// A method where some channels are broken: a linear one made anew without them, a network told what the other channels
    /// say of them.
    ///
    /// # Errors
    /// No such method; too few channels left.
    pub fn without(&self, name: &str, broken: &[usize]) -> Result<NamedMethod, LiveError> {
        let whole = self.method(name)?;
        match whole.prior {
            _ if broken.is_empty() => Ok(whole.clone()),
            Some(prior) => self.linear_method(name, prior, broken),
            None => {
                let filled = WithoutChannels::new(Arc::clone(&whole.method), &self.linear, broken.to_vec())?;
                Ok(NamedMethod { method: Arc::new(filled), ..whole.clone() })
            }
        }
    }

    /// The names of its methods.
    pub fn method_names(&self) -> impl Iterator<Item = &str> {
        self.methods.iter().map(|method| method.name.as_str())
    }

    /// The network that was added to those that come with the library.
    pub fn own(&self) -> Option<&NamedMethod> {
        self.method(self.own.as_deref()?).ok()
    }

    /// A method by its name.
    ///
    /// # Errors
    /// No such method; the error names those that there are.
    pub fn method(&self, name: &str) -> Result<&NamedMethod, LiveError> {
        self.methods.iter().find(|method| method.name == name).ok_or_else(|| LiveError::NoSuchMethod {
            name: name.into(),
            known: self.method_names().map(str::to_string).collect(),
        })
    }

    /// A method by its name, the preferred one for no name.
    ///
    /// # Errors
    /// No such method.
    pub fn by_name(&self, name: &str) -> Result<&NamedMethod, LiveError> {
        if name.is_empty() { Ok(self.preferred()) } else { self.method(name) }
    }

    /// The method that is used where none is asked for: the best network for the skin, or else NOSER.
    pub fn preferred(&self) -> &NamedMethod {
        let of_name = |name: &&str| self.methods.iter().find(|method| method.name == **name);
        PREFERRED.iter().find_map(of_name).unwrap_or(&self.methods[0])
    }

    /// Channels that an electrode is part of.
    pub fn channels_of(&self, electrode: usize) -> impl Iterator<Item = usize> {
        let channels = self.design.protocol.channels().iter().enumerate();
        channels
            .filter(move |(_, channel)| channel.drive.contains(&electrode) || channel.measure.contains(&electrode))
            .map(|(index, _)| index)
    }

    /// What each channel gains for each ohm that an electrode's contact gains: 1 or -1 where it is driven and read at once, else 0.
    pub fn contact_gains(&self, electrode: usize) -> impl Iterator<Item = f64> {
        let sign = move |pair: [usize; 2]| f64::from(pair[0] == electrode) - f64::from(pair[1] == electrode);
        self.design.protocol.channels().iter().map(move |channel| sign(channel.drive) * sign(channel.measure))
    }

    /// The contact resistance of an electrode as the design has it, ohm; 0 of a point.
    pub fn contact_ohm(&self, electrode: usize) -> f64 {
        self.forward.contact_resistance_ohm(electrode)
    }
}

fn network(name: String, model: Model) -> NamedMethod {
    let card = serde_json::to_string_pretty(model.card()).ok();
    NamedMethod { name, card, method: Arc::new(model), prior: None }
}

impl std::fmt::Debug for NamedMethod {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("NamedMethod").field("name", &self.name).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn a_network_of_ones_own_is_used_whatever_its_card_calls_it() {
        let folder = tempfile::tempdir().unwrap();
        let own = synthetic::retrained(folder.path());
        let skin = LiveSkin::new(SkinDesign::shipped_text("skin16").unwrap(), "skin16", Some(&own)).unwrap();
        let card = |name: &str| skin.method(name).unwrap().card.clone().unwrap();
        assert!(card(&own).contains(synthetic::RETRAINED) && !card("shapes").contains(synthetic::RETRAINED));
        assert_eq!(skin.own().unwrap().name, own);
        assert_eq!(skin.preferred().name, "shapes", "where none is asked for");
        let error = LiveSkin::new(SkinDesign::shipped_text("skin16").unwrap(), "skin16", Some("shapes"));
        assert!(error.unwrap_err().to_string().contains("write ./shapes for the folder"));
    }
}
