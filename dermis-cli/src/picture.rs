//! Files of pictures and pages.

use crate::failure::{Failure, Outcome};
use dermis::frame::write_whole;
use dermis_plot::Picture;
use std::path::Path;

/// Format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    /// Scalable vector graphics.
    Svg,
    /// Pixels.
    Png,
}

/// Refuses another ending than that of a page.
pub fn check_page_ending(path: &Path) -> Outcome {
    if path.extension().is_some_and(|extension| extension == "html") {
        return Ok(());
    }
    let message = format!("{}: the page is written as .html", path.display());
    Err(Failure::given(message, Some("choose this ending")))
}

/// Dots per pixel of a PNG, for high-resolution screens and print.
const PNG_SCALE: f64 = 2.0;

impl PictureFormat {
    /// The format by the ending of a path.
    pub fn of(path: &Path) -> Outcome<Self> {
        match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("svg") => Ok(PictureFormat::Svg),
            Some("png") => Ok(PictureFormat::Png),
            _ => {
                let message = format!("{}: no kind of picture known", path.display());
                Err(Failure::given(message, Some("name the picture .svg or .png")))
            }
        }
    }

    /// Writes a picture.
    pub fn save(self, picture: &Picture, path: &Path) -> Outcome {
        let bytes = match self {
            PictureFormat::Svg => picture.to_svg().into_bytes(),
            PictureFormat::Png => picture.to_png(PNG_SCALE)?,
        };
        Ok(write_whole(path, |writer| writer.write_all(&bytes))?)
    }
}
