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
    // Two skins in one place.
    let text = std::fs::read_to_string(at.path("arm.toml")).unwrap();
    let text = text.replace("hand_link", "forearm_link").replace("skin16", "cylinder30");
    at.write("arm.toml", text.replace("[0.02, 0, 0.05], rpy_rad = [0, 1.5707963, 0]", "[0, 0, 0.2]"));
    let said = at.refused("robot check arm.toml");
    assert!(said.contains("`forearm` and `palm` overlap") && said.contains("origin"), "{said}");
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
    let mesh = at.good("mesh sleeve.toml");
    assert!(mesh.starts_with("sleeve: "), "{mesh}");
    for (arguments, expected) in [
        ("new link arm.urdf", "needs a robot description and the link"),
        ("new link arm.urdf lower_amr", "did you mean `lower_arm`?"),
        ("new link arm.urdf bare", "the mesh `none.stl` is not found"),
        ("new link arm.urdf empty", "has no mesh with triangles for collision"),
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
