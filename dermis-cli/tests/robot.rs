//! Robots: their files, and skins around their links.

use crate::workplace::Workplace;
use serde_json::Value;

#[test]
fn the_template_of_a_robot_is_checked_and_its_load_is_stated() {
    let at = Workplace::empty();
    at.good("new robot -o arm.toml");
    let said = at.refused("new robot -o arm.toml");
    assert!(said.contains("arm.toml exists already"), "{said}");
    let report: Value = serde_json::from_str(&at.good("robot check arm.toml --json")).unwrap();
    assert_eq!(report["joints"], serde_json::json!(["shoulder", "elbow", "wrist"]));
    assert_eq!(report["skins"][1]["electrodes"], 16);
    assert!(report["cores"].as_f64().unwrap() > 0.0 && report["neighbours"].as_array().unwrap().is_empty());
    let tree = at.good("robot links arm.urdf");
    assert!(tree.contains("    forearm_link  (elbow)\n"), "{tree}");
    // A rule that its skins cannot meet, and a joint whose limits are in degrees.
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    at.write("strong.toml", text.replace("when = \"touched\"", "when = { force_n = 20.0 }"));
    let urdf = std::fs::read_to_string(at.path("arm.urdf")).unwrap();
    at.write("degrees.urdf", urdf.replacen("lower=\"-", "lower=\"-9", 1));
    at.write("degrees.toml", text.replace("arm.urdf", "degrees.urdf"));
    let warned =
        |file: &str| String::from_utf8_lossy(&at.run(&format!("robot check {file}")).stderr).replace("\n  │ ", " ");
    assert!(
        warned("strong.toml").contains("waits for 20 N, but forces of `forearm` end at 7.5 N"),
        "{}",
        warned("strong.toml")
    );
    assert!(warned("degrees.toml").contains("seem to be in degrees"), "{}", warned("degrees.toml"));
    // Two skins in one place.
    let text = text.replace("hand_link", "forearm_link").replace("skin16", "cylinder30");
    at.write("arm.toml", text.replace("[0.02, 0, 0.05], rpy_rad = [0, 1.5707963, 0]", "[0, 0, 0.2]"));
    let said = at.refused("robot check arm.toml");
    assert!(said.contains("`forearm` and `palm` overlap") && said.contains("origin"), "{said}");
}

/// Plates above each other and side by side: distances are those of the surfaces.
#[test]
fn distances_of_skins_are_those_of_their_surfaces() {
    let at = Workplace::empty();
    at.good("new rectangle -o plate.toml");
    let width_m = 0.2;
    for (offset, expected_m) in [([0.0, 0.0, 0.005], 0.005), ([width_m + 0.003, 0.0, 0.004], 0.005)] {
        let skin = |name: &str, at: [f64; 3]| {
            format!(
                "[[skin]]\nname = \"{name}\"\ndesign = \"plate.toml\"\nlink = \"arm\"\nsource = \"emulate\"\norigin = {{ xyz_m = {at:?} }}\n"
            )
        };
        at.write("robot.toml", format!("name = \"robot\"\n{}{}", skin("a", [0.0; 3]), skin("b", offset)));
        let report: Value = serde_json::from_str(&at.good("robot check robot.toml --json")).unwrap();
        let neighbours = &report["neighbours"][0];
        let distance_m = neighbours["distance_m"].as_f64().unwrap();
        assert!((distance_m - expected_m).abs() < 1e-5 && neighbours["overlap"] == 0.0, "{offset:?}: {neighbours}");
    }
}

#[test]
fn a_skin_is_made_around_a_link() {
    let at = Workplace::empty();
    at.good("new mesh -o body.toml");
    let link = |name: &str, mesh: &str| {
        format!(
            "<link name=\"{name}\"><collision><geometry><mesh filename=\"{mesh}\" scale=\"0.001 0.001 0.001\"/></geometry></collision></link>"
        )
    };
    let parts = [
        link("lower_arm", "package://arm/forearm.stl"),
        link("bare", "none.stl"),
        "<link name=\"empty\"/>".to_string(),
    ];
    at.write("arm.urdf", format!("<robot name=\"arm\">{}</robot>", parts.concat()));
    std::fs::create_dir(at.path("arm")).unwrap();
    std::fs::rename(at.path("forearm.stl"), at.path("arm/forearm.stl")).unwrap();
    let said = at.good("new link arm.urdf lower_arm --electrodes 20 --around 10..350 -o sleeve.toml");
    assert!(said.contains("20 electrodes") && said.contains("mm from the link"), "{said}");
    // A mesh of the link is never replaced, nor a design by its body.
    std::fs::copy(at.path("arm/forearm.stl"), at.path("own.stl")).unwrap();
    let own = std::fs::read_to_string(at.path("arm.urdf")).unwrap().replace("package://arm/forearm.stl", "own.stl");
    at.write("own.urdf", own);
    let said = at.refused("new link own.urdf lower_arm -o own.toml --force");
    assert!(said.contains("is a mesh of the link itself"), "{said}");
    let said = at.refused("new link arm.urdf lower_arm -o out.stl --force");
    assert!(said.contains("a design ends in .toml"), "{said}");
    // Halves meet and do not overlap.
    let half = |name: &str, around: &str| {
        at.good(&format!("new link arm.urdf lower_arm --electrodes 12 --around {around} -o {name}.toml"));
        format!("[[skin]]\nname = \"{name}\"\ndesign = \"{name}.toml\"\nlink = \"lower_arm\"\nsource = \"emulate\"\n")
    };
    let halves = format!("name = \"arm\"\n{}{}", half("left", "0..180"), half("right", "180..360"));
    at.write("halves.toml", halves);
    let report: Value = serde_json::from_str(&at.good("robot check halves.toml --json")).unwrap();
    assert_eq!(report["neighbours"][0]["overlap"], 0.0, "{report}");
    let mesh = at.good("mesh sleeve.toml");
    assert!(mesh.starts_with("sleeve: "), "{mesh}");
    for (arguments, expected) in [
        ("new link arm.urdf", "needs a robot description and the link"),
        ("new link arm.urdf lower_amr", "did you mean `lower_arm`?"),
        ("new link arm.urdf bare", "the mesh `none.stl` is not found"),
        ("new link arm.urdf empty", "has no mesh, box, cylinder or sphere for collision"),
        ("new link arm.urdf lower_arm --along z:0.5..0.9", "is not on the link"),
        ("new link arm.urdf lower_arm --along q:0.1..0.2", "write AXIS:FROM..TO"),
        ("new link arm.urdf lower_arm --around 0..359.9", "mm wide"),
        ("new link arm.urdf lower_arm --along z:0.1..0.105", "mm long"),
        ("new link arm.urdf lower_arm --around 90", "write FROM..TO"),
        ("new disk arm.urdf", "a robot description is for links"),
        ("new link none.urdf lower_arm", "cannot read the robot description none.urdf"),
    ] {
        let said = at.refused(&format!("{arguments} -o out.toml"));
        assert!(said.replace("\n  │ ", " ").contains(expected), "{arguments}: {said}");
    }
}
