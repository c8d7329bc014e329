//! Contacts as `dermis.Contacts`.

use crate::arrays::{self, Column, Rows};
use crate::failure::{Failure, Outcome};
use dermis::contact::{Contact, Field, FieldKind};
use dermis::geom::Point3;
use dermis::pipeline::{PipelineFrame, TrackedContact};
use dermis::skin::Skin;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::HashMap;

/// The contacts of some frames.
pub fn table<'py>(py: Python<'py>, frames: &[Vec<Contact>]) -> Outcome<Bound<'py, PyAny>> {
    let numbers = frames.iter().enumerate().flat_map(|(frame, contacts)| contacts.iter().map(move |_| frame as i64));
    let contacts: Vec<&Contact> = frames.iter().flatten().collect();
    let columns = PyDict::new(py);
    columns.set_item("frame", PyArray1::from_iter(py, numbers))?;
    add_fields(&columns, &Contact::FIELDS, &contacts)?;
    made(&columns)
}

/// The tracked contacts of a frame.
pub fn tracked<'py>(py: Python<'py>, frame: &PipelineFrame) -> Outcome<Bound<'py, PyAny>> {
    let tracked: Vec<&TrackedContact> = frame.contacts.iter().collect();
    let contacts: Vec<&Contact> = frame.contacts.iter().map(|tracked| &tracked.contact).collect();
    let columns = PyDict::new(py);
    columns.set_item("frame", PyArray1::from_vec(py, vec![frame.sequence as i64; tracked.len()]))?;
    add_fields(&columns, &Contact::FIELDS, &contacts)?;
    add_fields(&columns, &TrackedContact::FIELDS, &tracked)?;
    made(&columns)
}

/// Adds an array for each field of contacts.
fn add_fields<T>(columns: &Bound<'_, PyDict>, fields: &[Field<T>], contacts: &[&T]) -> Outcome<()> {
    let py = columns.py();
    for field in fields {
        let numbers = contacts.iter().flat_map(|contact| field.numbers(contact));
        let array = match field.kind {
            _ if field.columns.len() > 1 => arrays::rows(py, numbers.collect(), &[field.columns.len()], false)?,
            FieldKind::Count => PyArray1::from_iter(py, numbers.map(|number| number as u64)).into_any(),
            FieldKind::Flag => PyArray1::from_iter(py, numbers.map(|number| number > 0.0)).into_any(),
            FieldKind::Number | FieldKind::Change => PyArray1::from_iter(py, numbers).into_any(),
        };
        columns.set_item(field.array_name(), array)?;
    }
    Ok(())
}

fn made<'py>(columns: &Bound<'py, PyDict>) -> Outcome<Bound<'py, PyAny>> {
    Ok(columns.py().import("dermis._contacts")?.call_method1("table", (columns,))?)
}

/// The columns of the vectors of contacts in tables, by their names.
#[pyfunction]
pub fn contact_columns() -> HashMap<&'static str, Vec<&'static str>> {
    fn vectors<T>(fields: &[Field<T>]) -> impl Iterator<Item = (&'static str, Vec<&'static str>)> {
        fields.iter().filter(|field| field.columns.len() > 1).map(|field| (field.key, field.columns.to_vec()))
    }
    vectors(&Contact::FIELDS).chain(vectors(&TrackedContact::FIELDS)).collect()
}

/// Refuses places off a skin.
pub fn check_places(name: &str, places_m: &[Point3], skin: &Skin) -> Outcome<()> {
    let limits = skin.place_limits();
    places_m.iter().try_for_each(|&place_m| {
        if place_m.iter().any(|value| !value.is_finite()) {
            return Err(Failure::given(format!("`{name}` has {place_m:?}: positions are finite")));
        }
        let refused = |why| Failure::with_hint(format!("`{name}`: {why}"), "positions are in metres, on the skin");
        limits.check(place_m).map(drop).map_err(refused)
    })
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
    check_places("truth", positions, skin)?;
    let surface = skin.design().body.surface();
    let force_n = Column::of(named("force_n")?.as_ref(), "truth.force_n", positions.len(), f64::NAN)?;
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
