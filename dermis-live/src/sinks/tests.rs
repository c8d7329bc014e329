//! The fields of a contact in the documents and in the page follow from its type: with `DERMIS_WRITE=1` in the environment
//! the test writes them.

use crate::synthetic;
use dermis::contact::{Contact, Field};
use dermis::pipeline::TrackedContact;
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::path::Path;

/// The keys of a contact in JSON with their schemas.
fn properties() -> Map<String, Value> {
    let schema = schemars::schema_for!(TrackedContact).to_value();
    schema["properties"].as_object().expect("an object").clone()
}

/// A field in words: its key and its names in tables, arrays and point clouds.
struct Names {
    key: &'static str,
    columns: Vec<&'static str>,
    array: &'static str,
    ros: Vec<&'static str>,
}

fn names<T>(fields: &[Field<T>]) -> Vec<Names> {
    let name = |field: &Field<T>| Names {
        key: field.key,
        columns: field.columns.to_vec(),
        array: field.array_name(),
        ros: field.ros.to_vec(),
    };
    fields.iter().map(name).collect()
}

fn fields() -> Vec<Names> {
    let zone = Names { key: "zone", columns: Vec::new(), array: "", ros: Vec::new() };
    names(&Contact::FIELDS).into_iter().chain(names(&TrackedContact::FIELDS)).chain([zone]).collect()
}

#[test]
fn every_key_of_a_contact_is_a_field() {
    let (_, live) = synthetic::pressed();
    let mut contact = live.result.contacts[0].clone();
    contact.contact.conductance = Some(dermis::contact::ConductanceChange::Rises);
    let json = serde_json::to_value(&contact).unwrap();
    let written: BTreeSet<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    let schema = properties();
    assert_eq!(written, schema.keys().map(String::as_str).collect());
    assert_eq!(written, fields().iter().map(|field| field.key).collect());
    assert_eq!(json["position_m"], serde_json::json!(contact.contact.position_m));
}

/// Compares a text with the part of a file that it is, between a first line and an empty one.
fn check(path: &str, first_line: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    let file = std::fs::read_to_string(&path).unwrap_or_default();
    let start = file.find(first_line).unwrap_or(0);
    let end = file[start..].find("\n\n").map_or(file.len(), |length| start + length + 1);
    if std::env::var_os("DERMIS_WRITE").is_some() {
        std::fs::write(&path, [&file[..start], text, &file[end..]].concat()).unwrap();
    } else {
        let how = "write it: DERMIS_WRITE=1 cargo test --release -p dermis-live --lib contact";
        assert!(&file[start..end] == text, "{}: is not\n{text}\n{how}", path.display());
    }
}

#[test]
fn the_documents_hold_the_fields_of_a_contact() {
    const HEADER: &str = "| key in JSON | columns of tables | field in Python | fields in ROS 2 | meaning |\n";
    let schema = properties();
    let list = |names: &[&str]| names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let row = |Names { key, columns, array, ros }: &Names| {
        let meaning = schema[*key]["description"].as_str().expect("a documented field").replace('\n', " ");
        let arrays = if array.is_empty() { Vec::new() } else { vec![*array] };
        format!("| `{key}` | {} | {} | {} | {meaning} |\n", list(columns), list(&arrays), list(ros))
            .replace("|  |", "| |")
    };
    let rows: String = fields().iter().map(row).collect();
    check("docs/file-formats.md", HEADER, &format!("{HEADER}|---|---|---|---|---|\n{}", rows.replace("|  |", "| |")));
}

#[test]
fn the_page_knows_the_fields_of_a_contact() {
    let schema = properties();
    let kind = |key: &str| {
        let types = match &schema[key]["type"] {
            Value::Array(types) => types.clone(),
            one => vec![one.clone()],
        };
        let name = |kind: &Value| match kind.as_str() {
            Some("integer" | "number") => "number",
            Some("array") => "Vec3",
            Some("boolean") => "boolean",
            Some("string") => "string",
            Some("null") => "null",
            // A type of its own: a sign, or a time in nanoseconds.
            _ if key == "conductance" => "\"rises\" | \"falls\"",
            _ => "number",
        };
        types.iter().map(name).collect::<Vec<_>>().join(" | ")
    };
    let line = |field: &Names| match field.key {
        "conductance" => format!("  conductance?: {};\n", kind("conductance")),
        key => format!("  {key}: {};\n", kind(key)),
    };
    let lines: String = fields().iter().map(line).collect();
    let place = "  /** Its place on the unrolled surface, if there is one. */\n  flat_m: Vec2 | null;\n";
    const FIRST: &str =
        "/** A contact, as in JSON lines (docs/file-formats.md). Written by a test of dermis-live. */\n";
    check("viewer/src/types.ts", FIRST, &format!("{FIRST}export interface Contact {{\n{lines}{place}}}\n"));
}
