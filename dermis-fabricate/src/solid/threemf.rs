//! 3MF (core specification 1.3): a ZIP archive with a model in XML, which states its unit.

use crate::error::FabricateError;
use crate::solid::Solid;
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const CONTENT_TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;
const RELATIONSHIPS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;

pub(crate) fn bytes(solid: &Solid, name: &str) -> Result<Vec<u8>, FabricateError> {
    archive(&model(solid, name)).map_err(|error| FabricateError::Internal(format!("3MF: {error}")))
}

fn archive(model: &str) -> zip::result::ZipResult<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    // A fixed date, so that equal results give equal files.
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
    let parts = [("[Content_Types].xml", CONTENT_TYPES), ("_rels/.rels", RELATIONSHIPS), ("3D/3dmodel.model", model)];
    for (path, text) in parts {
        archive.start_file(path, options)?;
        archive.write_all(text.as_bytes())?;
    }
    Ok(archive.finish()?.into_inner())
}

fn model(solid: &Solid, name: &str) -> String {
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    text += "<model unit=\"millimeter\" xml:lang=\"en\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n";
    let _ = writeln!(text, "<metadata name=\"Title\">{}</metadata>", dermis::text::escaped(name));
    text += "<resources><object id=\"1\" type=\"model\"><mesh><vertices>\n";
    for [x, y, z] in &solid.corners_mm {
        let _ = writeln!(text, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>");
    }
    text += "</vertices><triangles>\n";
    for [a, b, c] in &solid.triangles {
        let _ = writeln!(text, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>");
    }
    text += "</triangles></mesh></object></resources>\n<build><item objectid=\"1\"/></build>\n</model>\n";
    text
}
