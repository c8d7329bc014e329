use super::*;
use dermis::design::SkinDesign;
use std::f64::consts::PI;

fn fabrication(text: &str, change: &str) -> Fabrication {
    let text = format!("{text}\n[fabrication]\n{change}\n");
    Fabrication::new(&SkinDesign::parse(&text, "test.toml").unwrap()).unwrap()
}

fn shipped(name: &str) -> String {
    let text = SkinDesign::shipped_text(name).unwrap();
    text.split("\n[fabrication]").next().unwrap().to_string()
}

/// Volume of a tube, of a wall's part in a bore, and of a channel, by their formulas.
#[test]
fn the_base_of_the_papers_skin_has_its_holes_and_its_volume() {
    let made = fabrication(&shipped("cylinder30"), "channel_depth_m = 0.0");
    let solid = base(&made).unwrap();
    assert!(solid.is_closed());
    assert_eq!((solid.genus(), designed_genus(&made)), (31, 31));
    let tube = PI * (50.0f64.powi(2) - 45.0f64.powi(2)) * 300.0;
    // A bore of radius a through a tube: its wall along the axis is sqrt(R^2 - y^2) - sqrt(r^2 - y^2) thick at the
    // distance y; integrated over the bore.
    let bore = {
        let steps = 2000;
        let step = 3.0 / steps as f64;
        let slice = |k: usize| {
            let y = -1.5 + (k as f64 + 0.5) * step;
            2.0 * (2.25 - y * y).sqrt() * ((2500.0 - y * y).sqrt() - (2025.0 - y * y).sqrt()) * step
        };
        (0..steps).map(slice).sum::<f64>()
    };
    // Facets leave out two thirds of their distance from the arc; inside and outside nearly cancel.
    let expected = tube - 30.0 * bore;
    assert!((solid.volume_mm3() / expected - 1.0).abs() < 1e-4, "{} {expected}", solid.volume_mm3());
}

#[test]
fn flat_bases_and_flanges_have_their_volume() {
    let made = fabrication(&shipped("skin16"), "flange_m = 0.004\nchannel_depth_m = 0.0");
    let solid = base(&made).unwrap();
    assert_eq!((solid.genus(), solid.is_closed()), (16, true));
    let expected = 5.0 * PI * (44.0f64.powi(2) - 16.0 * 1.5f64.powi(2));
    assert!((solid.volume_mm3() / expected - 1.0).abs() < 1e-4, "{} {expected}", solid.volume_mm3());
    assert!(made.electrodes.iter().all(|electrode| electrode.bore.moved_m == 0.0));
}

/// A plate of a polygon has no edge that its wall could follow: it ends across the surface.
#[test]
fn the_base_of_a_polygon_has_its_volume() {
    let text = "[body.polygon]\ncorners_m = [[0, 0], [0.2, 0], [0.2, 0.05], [0.1, 0.05], [0.1, 0.15], [0, 0.15]]\n\
        [sheet]\nsheet_resistance_ohm = 1000.0\ntouch = \"conductance_rises\"\n\
        [electrodes]\nshape.disc.radius_m = 0.004\ncontact_impedance_ohm_m2 = 2e-5\n\
        layout.positions = [{ x_m = 0.03, y_m = 0.02 }, { x_m = 0.17, y_m = 0.02 }, { x_m = 0.03, y_m = 0.12 },\n\
        { x_m = 0.07, y_m = 0.08 }]\n[protocol]\npattern = \"adjacent\"\n";
    let made = fabrication(text, "channel_depth_m = 0.0");
    let solid = base(&made).unwrap();
    assert_eq!((solid.genus(), solid.is_closed()), (4, true));
    let expected = 5.0 * (200.0 * 50.0 + 100.0 * 100.0 - 4.0 * PI * 1.5f64.powi(2));
    assert!((solid.volume_mm3() / expected - 1.0).abs() < 1e-4, "{} {expected}", solid.volume_mm3());
}

#[test]
fn channels_leave_the_genus_and_take_their_volume() {
    for name in ["cylinder30", "skin16"] {
        let [with, without] = ["", "channel_depth_m = 0.0"].map(|change| {
            let made = fabrication(&shipped(name), change);
            let solid = base(&made).unwrap();
            assert_eq!(solid.genus(), designed_genus(&made), "{name}");
            solid.volume_mm3()
        });
        assert!(with < without, "{name}");
        if name == "cylinder30" {
            // Ten lines of 3 mm x 2 mm: five from the rings 0, 2 and 4, and five up to ring 5, less the parts in bores.
            let most = 5.0 * 6.0 * 240.0 + 5.0 * 6.0 * 297.5;
            let taken = without - with;
            assert!(taken < 1.02 * most && taken > 0.9 * most, "{taken} {most}");
        }
    }
}
