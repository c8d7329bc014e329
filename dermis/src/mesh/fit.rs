//! Checks that a mesh fits a design.

use crate::design::{Region, RegionPlace, SheetKind, SkinDesign};
use crate::geom::{Chart, Point2, polygon};
use crate::mesh::{Cells, Mesh, MeshError};

/// Largest relative error of the area of a region's cells: cells belong to it whole or not at all, so that its outline is jagged
/// by half a cell. Generated meshes have [`CELLS_ACROSS`](crate::mesh::generate::CELLS_ACROSS) of them across.
const MAX_AREA_ERROR: f64 = 0.2;

/// A box of a region in the coordinates of a chart: on a cylinder those that are a turn apart, too.
pub(super) fn boxes(chart: &Chart, low_m: Point2, high_m: Point2) -> Vec<[Point2; 2]> {
    let Some(period_m) = chart.period_m() else { return vec![[low_m, high_m]] };
    // One that goes round more than once covers no cell twice.
    let high_m = [high_m[0], high_m[1].min(low_m[1] + period_m)];
    let turned = |[along, around]: Point2, turn: i32| [around + f64::from(turn) * period_m, along];
    let [first, last] = [(-high_m[1] / period_m).floor() as i32, (1.0 - low_m[1] / period_m).ceil() as i32];
    (first..=last).map(|turn| [turned(low_m, turn), turned(high_m, turn)]).collect()
}

impl Mesh {
    /// Checks that the mesh has the electrodes and regions of a design, and is a surface for a sheet resistance or a
    /// volume for a conductivity.
    ///
    /// # Errors
    /// The missing part.
    pub fn check_fits(&self, design: &SkinDesign) -> Result<(), MeshError> {
        let (kind, has) = match self.cells {
            Cells::Triangles(_) => (SheetKind::Surface, "a surface: state its sheet_resistance_ohm"),
            Cells::Tetrahedra(_) => (SheetKind::Volume, "a volume: state its conductivity_s_per_m"),
        };
        if design.sheet.kind != kind {
            return Err(MeshError::Invalid(format!("the mesh of the design `{}` is {has}", design.name)));
        }
        let (named, found) = (design.electrodes.len(), self.electrodes.len());
        if named != found {
            let message = format!("the design `{}` has {named} electrodes, but its mesh has {found}", design.name);
            return Err(MeshError::Invalid(message));
        }
        for region in &design.sheet.regions {
            if region.place == RegionPlace::Group && !self.regions.iter().any(|(name, _)| *name == region.name) {
                let known: Vec<&str> = self.regions.iter().map(|(name, _)| name.as_str()).collect();
                let known = if known.is_empty() { "none".to_string() } else { known.join(", ") };
                let message = format!("the mesh has no region `{}`; it has {known}", region.name);
                return Err(MeshError::Invalid(message));
            }
            if self.cells_of(design, region).is_empty() {
                let message = format!(
                    "the region `{}` of the design `{}` covers no cell: lengths are in metres, and a region smaller than the cells \
                     needs a finer mesh",
                    region.name, design.name
                );
                return Err(MeshError::Invalid(message));
            }
            if let Some(part) = self.covered_part(design, region).filter(|part| (part - 1.0).abs() > MAX_AREA_ERROR) {
                let message = format!(
                    "the cells of the region `{}` of the design `{}` have {:.0} % of its area: give the mesh a shorter \
                     max_edge_m",
                    region.name,
                    design.name,
                    100.0 * part
                );
                return Err(MeshError::Invalid(message));
            }
        }
        Ok(())
    }

    /// The cells whose centres lie in a region of a design.
    pub(crate) fn cells_of(&self, design: &SkinDesign, region: &Region) -> Vec<usize> {
        match region.place {
            RegionPlace::Group => {
                let groups = self.regions.iter().filter(|(name, _)| *name == region.name);
                groups.flat_map(|(_, cells)| cells).copied().collect()
            }
            RegionPlace::Box { low_m, high_m } => {
                let chart = Chart::of(&design.body.surface());
                let boxes = boxes(&chart, low_m, high_m);
                let is_inside = |&cell: &usize| {
                    let place = chart.unroll(self.cell_centre(cell));
                    let contains =
                        |[low, high]: &[Point2; 2]| (0..2).all(|axis| (low[axis]..=high[axis]).contains(&place[axis]));
                    boxes.iter().any(contains)
                };
                (0..self.cell_count()).filter(is_inside).collect()
            }
        }
    }

    /// The area of a region's cells over that of the part of the surface inside its box; `None` for a group.
    fn covered_part(&self, design: &SkinDesign, region: &Region) -> Option<f64> {
        let (RegionPlace::Box { low_m, high_m }, Cells::Triangles(triangles)) = (&region.place, &self.cells) else {
            return None;
        };
        let chart = Chart::of(&design.body.surface());
        let boxes = boxes(&chart, *low_m, *high_m);
        let mut memory = [Vec::new(), Vec::new()];
        let mut inside_m2 = 0.0;
        for (cell, corners) in triangles.iter().enumerate() {
            let centre = chart.unroll(self.cell_centre(cell));
            let corners = corners.map(|node| chart.unroll_beside(centre, self.nodes[node]));
            for [low, high] in &boxes {
                polygon::clip_box_in(&corners, *low, *high, &mut memory);
                inside_m2 += polygon::signed_area(&memory[0]).abs();
            }
        }
        let covered_m2: f64 = self.cells_of(design, region).into_iter().map(|cell| self.cell_measure(cell)).sum();
        Some(covered_m2 / inside_m2)
    }
}

#[cfg(test)]
mod tests {
    use crate::design::{Region, RegionPlace, SkinDesign};
    use crate::mesh::{Mesh, import};
    use std::f64::consts::PI;

    const SHEET: &str = r#"
[body.mesh]
path = "data/bodies/sheet_4.1_ascii.msh"
unit_m = 0.001
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[[sheet.regions]]
name = "left"
sheet_resistance_ohm = 500
[electrodes]
shape = "group"
layout.groups.count = 4
contact_impedance_ohm_m2 = 1e-5
[protocol]
pattern = "adjacent"
"#;

    #[test]
    fn what_a_design_names_must_be_in_its_mesh() {
        // The design file is in the root of the workspace.
        let name = concat!(env!("CARGO_MANIFEST_DIR"), "/../skin.toml");
        let mesh =
            import::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/bodies/sheet_4.1_ascii.msh").as_ref(), 1e-3);
        let mesh = mesh.unwrap();
        let said = |text: &str, mesh: &crate::mesh::Mesh| {
            mesh.check_fits(&SkinDesign::parse(text, name).unwrap()).map_err(|error| error.to_string())
        };
        said(SHEET, &mesh).unwrap();
        let error = said(&SHEET.replace("count = 4", "count = 5"), &mesh).unwrap_err();
        assert!(error.contains("has 5 electrodes, but its mesh has 4"), "{error}");
        let error = said(&SHEET.replace("\"left\"", "\"right\""), &mesh).unwrap_err();
        assert!(error.contains("no region `right`; it has") && error.contains("left"), "{error}");
        let error = said(&SHEET.replace("sheet_resistance_ohm", "conductivity_s_per_m"), &mesh).unwrap_err();
        assert!(error.contains("is a surface: state its sheet_resistance_ohm"), "{error}");
    }

    #[test]
    fn a_region_off_the_body_or_smaller_than_a_cell_is_named() {
        let found = |low: &str, high: &str| {
            let text = format!(
                "[body.rectangle]\nwidth_m = 0.2\nheight_m = 0.1\n[sheet]\nsheet_resistance_ohm = 500\ntouch = \"conductance_falls\"\n\
                 [[sheet.regions]]\nname = \"stripe\"\nsheet_resistance_ohm = 20\nlow_m = {low}\nhigh_m = {high}\n[electrodes]\n\
                 shape = \"point\"\ncontact_impedance_ohm_m2 = 1e-5\nlayout.grid = {{ rows = 2, columns = 2 }}\n[protocol]\n\
                 pattern = \"adjacent\"\n"
            );
            let design = SkinDesign::parse(&text, "flat.toml").unwrap();
            Mesh::generate(&design).and_then(|mesh| mesh.check_fits(&design)).err().map(|error| error.to_string())
        };
        assert_eq!(found("[0.05, 0]", "[0.1, 0.1]"), None);
        for (low, high) in [("[50, 0]", "[100, 100]"), ("[0.05, 0.05]", "[0.050001, 0.050001]")] {
            let error = found(low, high).unwrap();
            assert!(error.contains("the region `stripe` of the design `flat` covers no cell"), "{error}");
        }
    }

    /// The area of the cells of a box on the paper's cylinder over that of the box.
    fn covered(low_m: [f64; 2], high_m: [f64; 2]) -> f64 {
        let mut design = SkinDesign::shipped("cylinder30").unwrap();
        let region = Region { name: "r".into(), conductance: 1e-4, place: RegionPlace::Box { low_m, high_m } };
        design.sheet.regions = vec![region.clone()];
        let mesh = Mesh::generate(&design).unwrap();
        mesh.check_fits(&design).unwrap();
        let cells = mesh.cells_of(&design, &region);
        let round_m = (high_m[1] - low_m[1]).min(PI * 0.1);
        cells.into_iter().map(|cell| mesh.cell_measure(cell)).sum::<f64>() / (round_m * (high_m[0] - low_m[0]))
    }

    #[test]
    fn regions_cover_their_boxes_across_the_seam_and_if_they_are_narrow() {
        for (low, high) in [(-0.01, 0.01), (PI * 0.1 - 0.01, PI * 0.1 + 0.01), (0.05, 0.07), (-1.0, 1.0), (0.05, 0.052)]
        {
            let part = covered([0.1, low], [0.2, high]);
            assert!((part - 1.0).abs() < 0.1, "{low} to {high}: {part}");
        }
    }
}
