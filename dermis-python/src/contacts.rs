//! Contacts as `dermis.Contacts`.

use crate::arrays::{self, Column, Rows};
use crate::failure::{Failure, Outcome};
use dermis::contact::{ConductanceChange, Contact};
use dermis::pipeline::PipelineFrame;
use dermis::skin::Skin;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The contacts of some frames.
pub fn table<'py>(py: Python<'py>, frames: &[Vec<Contact>]) -> Outcome<Bound<'py, PyAny>> {
    let numbered = || frames.iter().enumerate().flat_map(|(frame, contacts)| contacts.iter().map(move |c| (frame, c)));
    let columns = PyDict::new(py);
    columns.set_item("frame", PyArray1::from_iter(py, numbered().map(|(frame, _)| frame as i64)))?;
    columns.set_item("id", PyArray1::from_iter(py, numbered().map(|(_, contact)| contact.id)))?;
    columns.set_item("sign", PyArray1::from_iter(py, numbered().map(|(_, contact)| sign(contact.conductance))))?;
    // The first column is the identifier.
    for (index, name) in Contact::COLUMNS.iter().enumerate().skip(1) {
        let values = numbered().map(|(_, contact)| contact.values()[index - 1]);
        columns.set_item(name, PyArray1::from_iter(py, values))?;
    }
    Ok(py.import("dermis._contacts")?.call_method1("table", (columns,))?)
}

/// The tracked contacts of a frame.
pub fn tracked<'py>(py: Python<'py>, frame: &PipelineFrame) -> Outcome<Bound<'py, PyAny>> {
    let contacts = &frame.contacts;
    let number = |of: &dyn Fn(usize) -> f64| PyArray1::from_iter(py, (0..contacts.len()).map(of));
    let columns = PyDict::new(py);
    columns.set_item("frame", PyArray1::from_iter(py, contacts.iter().map(|_| frame.sequence as i64)))?;
    columns.set_item("id", PyArray1::from_iter(py, contacts.iter().map(|contact| contact.id)))?;
    columns.set_item("seen", PyArray1::from_iter(py, contacts.iter().map(|contact| contact.seen)))?;
    columns.set_item("since_s", number(&|index| contacts[index].since.seconds()))?;
    columns.set_item("sign", number(&|index| sign(contacts[index].conductance)))?;
    columns.set_item("force_n", number(&|index| contacts[index].force_n.unwrap_or(f64::NAN)))?;
    columns.set_item("force_sd_n", number(&|index| contacts[index].force_sd_n.unwrap_or(f64::NAN)))?;
    columns.set_item("strength", number(&|index| contacts[index].strength))?;
    columns.set_item("area_m2", number(&|index| contacts[index].area_m2))?;
    columns.set_item("sd_m", number(&|index| contacts[index].sd_m))?;
    columns.set_item("confidence", number(&|index| contacts[index].confidence))?;
    let vector =
        |of: &dyn Fn(usize) -> [f64; 3]| arrays::rows(py, (0..contacts.len()).flat_map(of).collect(), &[3], false);
    columns.set_item("position_m", vector(&|index| contacts[index].position_m)?)?;
    columns.set_item("normal", vector(&|index| contacts[index].normal)?)?;
    columns.set_item("centroid_m", vector(&|index| contacts[index].centroid_m)?)?;
    columns.set_item("centre_of_pressure_m", vector(&|index| contacts[index].centre_of_pressure_m)?)?;
    columns.set_item("velocity_m_s", vector(&|index| contacts[index].velocity_m_s)?)?;
    Ok(py.import("dermis._contacts")?.call_method1("tracked", (columns,))?)
}

/// True touches, by frame: `Contacts`, or positions of one touch in each frame.
pub fn truth(given: &Bound<'_, PyAny>, skin: &Skin, frame_count: usize) -> Outcome<Vec<Vec<Contact>>> {
    let named = |name: &str| given.getattr_opt(name);
    let positions = named("position_m")?.unwrap_or_else(|| given.clone());
    let rows = Rows::of(&positions, "truth", 3)?;
    let (positions, _) = rows.values()?.as_chunks::<3>();
    let frames = match named("frame")? {
        Some(frames) => arrays::indices(&frames, "truth.frame", positions.len())?,
        None if positions.len() == frame_count => (0..frame_count).collect(),
        None => {
            let message = format!("`truth` has {} positions for {frame_count} frames", positions.len());
            return Err(Failure::with_hint(message, "give one for each frame, or Contacts with `frame`"));
        }
    };
    if let Some(bad) = positions.iter().find(|position| position.iter().any(|value| !value.is_finite())) {
        return Err(Failure::given(format!("`truth` has {bad:?}: positions are finite")));
    }
    let force_n = Column::of(named("force_n")?.as_ref(), "truth.force_n", positions.len(), f64::NAN)?;
    let surface = skin.design().body.surface();
    let mut touches = vec![Vec::new(); frame_count];
    for (index, (&position_m, frame)) in positions.iter().zip(frames).enumerate() {
        let normal = surface.normal(position_m).unwrap_or([f64::NAN; 3]);
        let of_frame = touches.get_mut(frame).ok_or_else(|| {
            Failure::given(format!("`truth` has a touch in frame {frame}: there are {frame_count} frames"))
        })?;
        of_frame.push(Contact::truth(position_m, normal, force_n.at(index)));
    }
    Ok(touches)
}

fn sign(conductance: Option<ConductanceChange>) -> f64 {
    conductance.map_or(f64::NAN, ConductanceChange::sign)
}
