//! PLY files, ASCII and binary; polygons are split into fans of triangles.

use super::cursor::{ByteOrder, Cursor, Problem, quote};
use super::soup::Soup;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Coding {
    Text,
    Binary(ByteOrder),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Debug)]
struct Property {
    name: Vec<u8>,
    /// The type of a list's length.
    length: Option<Number>,
    number: Number,
}

#[derive(Debug)]
struct Element {
    name: Vec<u8>,
    count: u64,
    properties: Vec<Property>,
}

pub(super) fn read(bytes: &[u8]) -> Result<Soup, Problem> {
    let mut cursor = Cursor::new(bytes);
    let (coding, elements) = header(&mut cursor)?;
    let mut soup = Soup::default();
    let mut values = Vec::new();
    for element in &elements {
        let what = Columns::new(&cursor, element)?;
        if element.properties.is_empty() {
            // They take no bytes in the file, so their stated number could be anything.
            continue;
        }
        for _ in 0..element.count {
            let mut position = [f64::NAN; 3];
            for (column, property) in element.properties.iter().enumerate() {
                values.clear();
                read_property(&mut cursor, coding, property, &mut values)?;
                if let Some(axis) = what.axes.iter().position(|&axis| axis == Some(column)) {
                    position[axis] = values.first().copied().unwrap_or(f64::NAN);
                }
                if what.corners == Some(column) {
                    let corners = corners(&cursor, &values)?;
                    soup.add_polygon(&corners);
                }
            }
            if element.name == b"vertex" {
                if position.iter().any(|x| !x.is_finite()) {
                    return Err(Problem(format!("vertex {} is at {position:?}", soup.points.len())));
                }
                soup.points.push(position);
            }
        }
    }
    Ok(soup)
}

/// The properties that contain a vertex's position and a face's corners.
struct Columns {
    axes: [Option<usize>; 3],
    corners: Option<usize>,
}

impl Columns {
    fn new(cursor: &Cursor<'_>, element: &Element) -> Result<Self, Problem> {
        let scalar = |name: &[u8]| element.properties.iter().position(|p| p.name == name && p.length.is_none());
        let list = |name: &[u8]| element.properties.iter().position(|p| p.name == name && p.length.is_some());
        let mut columns = Columns { axes: [None; 3], corners: None };
        match element.name.as_slice() {
            b"vertex" => {
                columns.axes = [b"x", b"y", b"z"].map(|name| scalar(name));
                if columns.axes.contains(&None) {
                    return Err(cursor.problem("the vertices lack one of the properties x, y and z"));
                }
            }
            b"face" => {
                columns.corners = list(b"vertex_indices").or_else(|| list(b"vertex_index"));
                if columns.corners.is_none() {
                    return Err(cursor.problem("the faces lack the list `vertex_indices`"));
                }
            }
            _ => {}
        }
        Ok(columns)
    }
}

fn corners(cursor: &Cursor<'_>, values: &[f64]) -> Result<Vec<usize>, Problem> {
    if values.len() < 3 {
        return Err(cursor.problem(format!("a face with {} corners", values.len())));
    }
    let index = |&value: &f64| match value {
        // Exact: an index of 32 bits fits in a double.
        whole if whole >= 0.0 && whole.fract() == 0.0 && whole <= f64::from(u32::MAX) => Ok(whole as usize),
        other => Err(cursor.problem(format!("{other} is not the index of a vertex"))),
    };
    values.iter().map(index).collect()
}

fn read_property(
    cursor: &mut Cursor<'_>,
    coding: Coding,
    property: &Property,
    values: &mut Vec<f64>,
) -> Result<(), Problem> {
    let count = match property.length {
        None => 1.0,
        Some(number) => read_number(cursor, coding, number, "the length of a list")?,
    };
    if count < 0.0 || count.fract() != 0.0 {
        return Err(cursor.problem(format!("{count} is not the length of a list")));
    }
    for _ in 0..count as u64 {
        values.push(read_number(cursor, coding, property.number, "a number")?);
    }
    Ok(())
}

fn read_number(cursor: &mut Cursor<'_>, coding: Coding, number: Number, what: &str) -> Result<f64, Problem> {
    let order = match coding {
        Coding::Text => return cursor.finite(what),
        Coding::Binary(order) => order,
    };
    let reordered = |bytes: &mut [u8]| {
        if order == ByteOrder::Big {
            bytes.reverse();
        }
    };
    macro_rules! number {
        ($kind:ty) => {{
            let mut bytes = cursor.take(what)?;
            reordered(&mut bytes);
            f64::from(<$kind>::from_le_bytes(bytes))
        }};
    }
    Ok(match number {
        Number::I8 => number!(i8),
        Number::U8 => number!(u8),
        Number::I16 => number!(i16),
        Number::U16 => number!(u16),
        Number::I32 => number!(i32),
        Number::U32 => number!(u32),
        Number::F32 => number!(f32),
        Number::F64 => number!(f64),
    })
}

fn header(cursor: &mut Cursor<'_>) -> Result<(Coding, Vec<Element>), Problem> {
    if cursor.line().map(<[u8]>::trim_ascii) != Some(b"ply") {
        return Err(cursor.problem("a PLY file starts with a line `ply`"));
    }
    let mut coding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let Some(line) = cursor.line() else { return Err(cursor.problem("the file ends within its header")) };
        let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
        match (words.as_slice(), elements.last_mut()) {
            ([b"end_header"], _) => break,
            ([] | [b"comment" | b"obj_info", ..], _) => {}
            ([b"format", name, b"1.0"], _) => {
                coding = Some(match *name {
                    b"ascii" => Coding::Text,
                    b"binary_little_endian" => Coding::Binary(ByteOrder::Little),
                    b"binary_big_endian" => Coding::Binary(ByteOrder::Big),
                    other => return Err(cursor.problem(format!("the format {} does not exist", quote(other)))),
                });
            }
            ([b"element", name, count], _) => {
                let Some(count) = std::str::from_utf8(count).ok().and_then(|text| text.parse().ok()) else {
                    return Err(cursor.problem(format!("{} is not a number of elements", quote(count))));
                };
                elements.push(Element { name: name.to_vec(), count, properties: Vec::new() });
            }
            ([b"property", b"list", length, kind, name], Some(element)) => {
                let length = Some(number_type(cursor, length)?);
                let number = number_type(cursor, kind)?;
                element.properties.push(Property { name: name.to_vec(), length, number });
            }
            ([b"property", kind, name], Some(element)) => {
                let number = number_type(cursor, kind)?;
                element.properties.push(Property { name: name.to_vec(), length: None, number });
            }
            _ => return Err(cursor.problem(format!("{} does not belong in the header of a PLY file", quote(line)))),
        }
    }
    match coding {
        Some(coding) => Ok((coding, elements)),
        None => Err(cursor.problem("the header names no format")),
    }
}

fn number_type(cursor: &Cursor<'_>, word: &[u8]) -> Result<Number, Problem> {
    Ok(match word {
        b"char" | b"int8" => Number::I8,
        b"uchar" | b"uint8" => Number::U8,
        b"short" | b"int16" => Number::I16,
        b"ushort" | b"uint16" => Number::U16,
        b"int" | b"int32" => Number::I32,
        b"uint" | b"uint32" => Number::U32,
        b"float" | b"float32" => Number::F32,
        b"double" | b"float64" => Number::F64,
        other => return Err(cursor.problem(format!("there is no number of type {}", quote(other)))),
    })
}
