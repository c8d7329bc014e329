//! `dermis schema`: the JSON schema of design files.

use crate::console::print_json;
use crate::failure::Outcome;
use dermis::design::SkinDesign;

/// Prints the schema.
pub fn run() -> Outcome {
    print_json(&SkinDesign::json_schema())
}
