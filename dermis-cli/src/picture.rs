//! Files of pictures and pages.

use crate::failure::{Failure, Outcome};
use clap::builder::{PathBufValueParser, TypedValueParser};
use dermis::files::ending;
use dermis::frame::write_whole;
use dermis_plot::Picture;
use std::path::{Path, PathBuf};

/// Dots per pixel of a PNG, for high-resolution screens and print.
const PNG_SCALE: f64 = 2.0;

/// Refuses another ending than that of a page.
pub fn check_page_ending(path: &Path) -> Outcome {
    if path.extension().is_some_and(|extension| extension == "html") {
        return Ok(());
    }
    let message = format!("{}: the page is written as .html", path.display());
    Err(Failure::given(message, Some("choose this ending")))
}

/// Reads the name of a picture, SVG or PNG, on the command line.
pub fn picture() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| match ending(&path).as_str() {
        "svg" | "png" => Ok(path),
        _ => Err("name the picture .svg or .png"),
    })
}

/// Whether a picture is written as PNG, and not as SVG: by the ending of its path.
pub fn is_png(path: &Path) -> Outcome<bool> {
    match ending(path).as_str() {
        "svg" => Ok(false),
        "png" => Ok(true),
        _ => {
            let message = format!("{}: no kind of picture known", path.display());
            Err(Failure::given(message, Some("name the picture .svg or .png")))
        }
    }
}

/// Writes a picture in the format of its ending.
pub fn save(picture: &Picture, path: &Path) -> Outcome {
    if !is_png(path)? {
        return Ok(picture.write_svg(path)?);
    }
    let bytes = picture.to_png(PNG_SCALE)?;
    Ok(write_whole(path, |out| out.write_all(&bytes))?)
}
