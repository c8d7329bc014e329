use super::page;
use crate::model::Fabrication;
use dermis::design::SkinDesign;

/// Every element that is opened is closed, in order.
fn check_nesting(page: &str) {
    const VOID: [&str; 3] = ["meta", "br", "!DOCTYPE"];
    let mut open: Vec<&str> = Vec::new();
    for (at, _) in page.match_indices('<') {
        let tag = &page[at + 1..at + page[at..].find('>').expect("a tag ends")];
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().expect("a name");
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "at {}", &page[at..page.len().min(at + 60)]);
        } else if !tag.ends_with('/') && !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

fn page_of(design: &SkinDesign) -> String {
    page(&Fabrication::new(design).unwrap()).unwrap()
}

#[test]
fn the_page_is_well_formed_and_needs_no_other_file() {
    for name in ["skin16", concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis/designs/forearm.toml")] {
        let page = page_of(&SkinDesign::load(name).unwrap());
        check_nesting(&page);
        for outside in ["<script", "<img", "<link", "url(", "@import", "href="] {
            assert!(!page.contains(outside), "{name}: {outside}");
        }
    }
}

#[test]
fn the_page_has_every_electrode_and_the_sizes_of_the_design() {
    let mut design = SkinDesign::shipped("skin16").unwrap();
    design.name = "a <b> & c".into();
    let page = page_of(&design);
    for electrode in 0..16 {
        // Places, wiring, diagram.
        assert!(page.matches(&format!(">E{electrode:02}<")).count() >= 3, "{electrode}");
    }
    for part in [
        "a &lt;b&gt; &amp; c",
        "disk, 80 mm in diameter",
        "1000 ohm per square",
        "wall 4<",
        "bores with a drill of 2 mm",
    ] {
        assert!(page.contains(part), "{part}");
    }
}

/// A shipped design is named in commands as it is; a changed one is a file.
#[test]
fn the_commands_of_the_page_name_the_design() {
    let mut design = SkinDesign::shipped("skin16").unwrap();
    assert!(page_of(&design).contains("dermis live skin16 --source"));
    design.sheet.conductance *= 2.0;
    assert!(page_of(&design).contains("dermis live skin16.toml --source"));
}
