//! DXF of AutoCAD 2000 (AC1015): closed LWPOLYLINE entities in layers, unit mm.
//!
//! A file is a list of pairs: a group code and a value, a line each (AutoCAD 2000 DXF Reference). Every object has a
//! handle, and names that of its owner.

use crate::outline::Outline;
use crate::sheet::{Label, Sheet, mm};
use std::fmt::Display;

/// Handles of objects that others refer to; 0x12 to 0x18 are those of `objects.dxf`.
mod handle {
    pub(super) const TABLES: [(&str, u32); 9] = [
        ("VPORT", 0x1),
        ("LTYPE", 0x2),
        ("LAYER", 0x3),
        ("STYLE", 0x4),
        ("VIEW", 0x5),
        ("UCS", 0x6),
        ("APPID", 0x7),
        ("DIMSTYLE", 0x8),
        ("BLOCK_RECORD", 0x9),
    ];
    pub(super) const MODEL: u32 = 0x10;
    pub(super) const PAPER: u32 = 0x11;
    pub(super) const MODEL_LAYOUT: u32 = 0x12;
    pub(super) const PAPER_LAYOUT: u32 = 0x13;
    pub(super) const PLOT_STYLE: u32 = 0x18;
    /// The first handle of all other objects.
    pub(super) const FIRST: u32 = 0x100;
}

/// A file under construction.
struct Writer {
    text: String,
    next: u32,
}

impl Writer {
    fn pair(&mut self, code: i32, value: impl Display) -> &mut Self {
        self.text += &format!("{code}\n{value}\n");
        self
    }

    fn handle(&mut self) -> u32 {
        self.next += 1;
        self.next - 1
    }

    /// The beginning of an object: kind, handle, owner and classes.
    fn object(&mut self, kind: &str, own: u32, owner: u32, classes: &[&str]) -> &mut Self {
        let code = if kind == "DIMSTYLE" { 105 } else { 5 };
        self.pair(0, kind).pair(code, format_args!("{own:X}")).pair(330, format_args!("{owner:X}"));
        for class in classes {
            self.pair(100, class);
        }
        self
    }

    fn section(&mut self, name: &str, fill: impl FnOnce(&mut Self)) {
        self.pair(0, "SECTION").pair(2, name);
        fill(self);
        self.pair(0, "ENDSEC");
    }

    /// A table with its records.
    fn table(&mut self, name: &str, count: usize, fill: impl FnOnce(&mut Self, u32)) {
        let (_, own) = *handle::TABLES.iter().find(|(table, _)| *table == name).expect("a table of DXF");
        self.pair(0, "TABLE").pair(2, name).pair(5, format_args!("{own:X}")).pair(330, 0);
        self.pair(100, "AcDbSymbolTable").pair(70, count);
        if name == "DIMSTYLE" {
            self.pair(100, "AcDbDimStyleTable").pair(71, 0);
        }
        fill(self, own);
        self.pair(0, "ENDTAB");
    }

    /// A record of a table with a new handle.
    fn record(&mut self, kind: &str, owner: u32, class: &str, name: &str) -> &mut Self {
        let own = self.handle();
        self.object(kind, own, owner, &["AcDbSymbolTableRecord", class]).pair(2, name).pair(70, 0)
    }
}

pub(super) fn text(sheet: &Sheet) -> String {
    let mut file = Writer { text: String::new(), next: handle::FIRST };
    file.section("CLASSES", |_| {});
    file.section("TABLES", |file| tables(file, sheet));
    file.section("BLOCKS", |file| {
        block(file, "*Model_Space", handle::MODEL, false);
        block(file, "*Paper_Space", handle::PAPER, true);
    });
    file.section("ENTITIES", |file| entities(file, sheet));
    // The last section: dictionaries, layouts, and the plot style of all layers.
    file.text += include_str!("objects.dxf");
    // The header comes first, but names the first handle that is free.
    let mut whole = Writer { text: String::new(), next: 0 };
    whole.section("HEADER", |whole| header(whole, sheet, file.next));
    whole.text + &file.text
}

fn header(file: &mut Writer, sheet: &Sheet, free: u32) {
    file.pair(9, "$ACADVER").pair(1, "AC1015");
    file.pair(9, "$DWGCODEPAGE").pair(3, "ANSI_1252");
    // 4: millimetres.
    file.pair(9, "$INSUNITS").pair(70, 4);
    file.pair(9, "$MEASUREMENT").pair(70, 1);
    file.pair(9, "$EXTMIN").pair(10, "0.0").pair(20, "0.0").pair(30, "0.0");
    file.pair(9, "$EXTMAX").pair(10, mm(sheet.size_m[0])).pair(20, mm(sheet.size_m[1])).pair(30, "0.0");
    file.pair(9, "$HANDSEED").pair(5, format_args!("{free:X}"));
}

fn tables(file: &mut Writer, sheet: &Sheet) {
    file.table("VPORT", 1, |file, own| viewport(file, own, sheet));
    file.table("LTYPE", 3, |file, own| {
        for (name, text) in [("ByBlock", ""), ("ByLayer", ""), ("Continuous", "Solid line")] {
            file.record("LTYPE", own, "AcDbLinetypeTableRecord", name);
            file.pair(3, text).pair(72, 65).pair(73, 0).pair(40, "0.0");
        }
    });
    file.table("LAYER", sheet.layers.len() + 2, |file, own| {
        let layers = sheet.layers.iter().map(|layer| (layer.name, layer.colour.1));
        for (name, colour) in [("0", 7), ("LABELS", 7)].into_iter().chain(layers) {
            file.record("LAYER", own, "AcDbLayerTableRecord", name);
            file.pair(62, colour)
                .pair(6, "Continuous")
                .pair(370, -3)
                .pair(390, format_args!("{:X}", handle::PLOT_STYLE));
        }
    });
    file.table("STYLE", 1, |file, own| {
        file.record("STYLE", own, "AcDbTextStyleTableRecord", "Standard");
        file.pair(40, "0.0").pair(41, "1.0").pair(50, "0.0").pair(71, 0).pair(42, "2.5").pair(3, "txt").pair(4, "");
    });
    file.table("VIEW", 0, |_, _| {});
    file.table("UCS", 0, |_, _| {});
    file.table("APPID", 1, |file, own| {
        file.record("APPID", own, "AcDbRegAppTableRecord", "ACAD");
    });
    file.table("DIMSTYLE", 1, |file, own| {
        file.record("DIMSTYLE", own, "AcDbDimStyleTableRecord", "Standard");
    });
    file.table("BLOCK_RECORD", 2, |file, own| {
        let blocks = [
            ("*Model_Space", handle::MODEL, handle::MODEL_LAYOUT),
            ("*Paper_Space", handle::PAPER, handle::PAPER_LAYOUT),
        ];
        for (name, block, layout) in blocks {
            file.object("BLOCK_RECORD", block, own, &["AcDbSymbolTableRecord", "AcDbBlockTableRecord"]);
            file.pair(2, name).pair(340, format_args!("{layout:X}"));
        }
    });
}

/// The view in which a program opens the drawing: all of it.
fn viewport(file: &mut Writer, own: u32, sheet: &Sheet) {
    let [width, height] = sheet.size_m;
    file.record("VPORT", own, "AcDbViewportTableRecord", "*Active");
    file.pair(10, "0.0").pair(20, "0.0").pair(11, "1.0").pair(21, "1.0");
    file.pair(12, mm(0.5 * width)).pair(22, mm(0.5 * height));
    file.pair(16, "0.0").pair(26, "0.0").pair(36, "1.0").pair(17, "0.0").pair(27, "0.0").pair(37, "0.0");
    file.pair(40, mm(height)).pair(41, format_args!("{:.6}", width / height)).pair(42, "50.0");
}

fn block(file: &mut Writer, name: &str, record: u32, paper: bool) {
    let (begin, end) = (file.handle(), file.handle());
    file.object("BLOCK", begin, record, &["AcDbEntity"]);
    if paper {
        file.pair(67, 1);
    }
    file.pair(8, "0").pair(100, "AcDbBlockBegin").pair(2, name).pair(70, 0);
    file.pair(10, "0.0").pair(20, "0.0").pair(30, "0.0").pair(3, name).pair(1, "");
    file.object("ENDBLK", end, record, &["AcDbEntity"]);
    if paper {
        file.pair(67, 1);
    }
    file.pair(8, "0").pair(100, "AcDbBlockEnd");
}

fn entities(file: &mut Writer, sheet: &Sheet) {
    for layer in &sheet.layers {
        layer.outlines.iter().for_each(|outline| polyline(file, layer.name, outline));
    }
    sheet.labels.iter().for_each(|label| label_text(file, label));
}

/// A closed polyline; a circle has two corners, joined by half circles (bulge 1: the tangent of a quarter of the arc's
/// angle).
fn polyline(file: &mut Writer, layer: &str, outline: &Outline) {
    let (corners, bulge) = match outline {
        Outline::Polygon(corners) => (corners.clone(), None),
        &Outline::Circle { centre_m: [x, y], radius_m } => (vec![[x - radius_m, y], [x + radius_m, y]], Some("1.0")),
    };
    let own = file.handle();
    file.object("LWPOLYLINE", own, handle::MODEL, &["AcDbEntity"]);
    file.pair(8, layer).pair(100, "AcDbPolyline").pair(90, corners.len()).pair(70, 1);
    for [x, y] in corners {
        file.pair(10, mm(x)).pair(20, mm(y));
        if let Some(bulge) = bulge {
            file.pair(42, bulge);
        }
    }
}

fn label_text(file: &mut Writer, label: &Label) {
    let own = file.handle();
    file.object("TEXT", own, handle::MODEL, &["AcDbEntity"]);
    file.pair(8, "LABELS").pair(100, "AcDbText");
    file.pair(10, mm(label.at_m[0])).pair(20, mm(label.at_m[1])).pair(30, "0.0");
    file.pair(40, mm(label.height_m)).pair(1, &label.text).pair(7, "Standard");
    if label.ends {
        // 2: the second place is the right end.
        file.pair(72, 2).pair(11, mm(label.at_m[0])).pair(21, mm(label.at_m[1])).pair(31, "0.0");
    }
    file.pair(100, "AcDbText");
}
