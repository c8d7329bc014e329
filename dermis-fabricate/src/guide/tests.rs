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
        for outside in ["<script", "<img", "<link", "url(", "@import"] {
            assert!(!page.contains(outside), "{name}: {outside}");
        }
        // The contents refer to the sections.
        let targets = page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap());
        let targets: Vec<&str> =
            targets.map(|target| target.strip_prefix('#').expect("a place of this page")).collect();
        assert!(targets.len() == page.matches("<h2>").count() && targets.len() > 8, "{targets:?}");
        assert!(targets.iter().all(|target| page.contains(&format!("id=\"{target}\""))), "{targets:?}");
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
        "wall, 4 mm",
        "bores with a drill of 2 mm",
    ] {
        assert!(page.contains(part), "{part}");
    }
}

/// A shipped design is named in commands as it is; a changed one is a file.
#[test]
fn the_commands_of_the_page_name_the_design() {
    let mut design = SkinDesign::shipped("skin16").unwrap();
    for command in ["live", "check-build"] {
        assert!(page_of(&design).contains(&format!("dermis {command} skin16 --source")), "{command}");
    }
    design.sheet.conductance *= 2.0;
    assert!(page_of(&design).contains("dermis live skin16.toml --source"));
}

/// The firmware is on the controller before the first command that needs it.
#[test]
fn every_step_comes_before_what_needs_it() {
    let page = page_of(&SkinDesign::shipped("cylinder30").unwrap());
    let at = |part: &str| page.find(part).unwrap_or_else(|| panic!("{part}"));
    let order = [
        "2.9 mm in diameter: 0.1 mm less than the bore",
        "at most 0.8 mm with its insulation",
        "tables/neighbours.csv",
        "stick an elastic tape",
        "end B of the reference resistor",
        "dermis scan-table cylinder30 --firmware",
        "elf2uf2-rs target",
        "dermis check-device cylinder30",
    ];
    assert!(order.map(at).is_sorted());
    // Between the rim electrodes 0 and 1.
    assert!(page.contains("<td>E00 - E01</td><td class=\"number\">698</td><td class=\"number\">1726</td>"));
}

/// Every part of the reader has its supply, and the drawing joins the ends of the reference resistor nowhere.
#[test]
fn the_reader_has_its_supplies_and_its_reference_is_not_shorted() {
    let page = page_of(&SkinDesign::shipped("cylinder30").unwrap());
    for part in
        ["+12 V; -12 V", "<td>AVDD</td><td>1.8 V</td>", "<td>DVIO</td><td>3.3 V", "/CS, /WR", "MCP6D11", "100 nF"]
    {
        assert!(page.contains(part), "{part}");
    }
    // Lines at the height of input 31 reach one multiplexer each, from a label.
    let y = format!("{:.2}", 12.0 + 4.1 * 31.5);
    let lines: Vec<&str> =
        page.split("<path d=\"M").filter(|rest| rest.split('"').next().unwrap().contains(&format!(" {y} H"))).collect();
    let length = |line: &&str| {
        let (from, rest) = line.split_once(' ').unwrap();
        let to = rest.split_once('H').unwrap().1.split('"').next().unwrap();
        to.parse::<f64>().unwrap() - from.parse::<f64>().unwrap()
    };
    assert!(lines.len() == 2 && lines.iter().map(length).all(|length| (0.0..9.0).contains(&length)), "{lines:?}");
}

/// A region has its resistance in the drawing, and a row with its place.
#[test]
fn regions_are_named_with_their_resistance() {
    let region = "[[sheet.regions]]\nname = \"stripe\"\nsheet_resistance_ohm = 2500.0\nlow_m = [-0.01, -0.01]\nhigh_m = [0.01, 0.01]\n\n[electrodes]\n";
    let text = SkinDesign::shipped_text("skin16").unwrap().replacen("[electrodes]\n", region, 1);
    let page = page_of(&SkinDesign::parse(&text, "test.toml").unwrap());
    assert!(page.contains(">stripe</text>") && page.contains(">2500 ohm/sq</text>"));
    assert!(page.contains("<td>stripe</td><td class=\"number\">2500</td><td>x -10 to 10, y -10 to 10</td>"));
}

/// Patches would let a membrane conduct more where it is pressed.
#[test]
fn a_coat_whose_conductance_falls_gets_no_fabric() {
    let page = page_of(&SkinDesign::shipped("skin16").unwrap());
    assert!(page.contains("Lay no conductive fabric on it") && !page.contains("Iron a stretchable film"));
    assert!(page_of(&SkinDesign::shipped("cylinder30").unwrap()).contains("Iron a stretchable film"));
}

/// A coat that works by stretching lies on a membrane over foam, and the pins reach it; one with patches lies on the base.
#[test]
fn a_coat_whose_conductance_falls_lies_on_a_membrane() {
    let membrane =
        ["3. Membrane and coat", "<td>membrane</td>", "elastic; sprayed on the membrane", "until 2.5 mm stand out"];
    let page = page_of(&SkinDesign::shipped("skin16").unwrap());
    for part in membrane {
        assert!(page.contains(part), "{part}");
    }
    // The pin: a wall of 4 mm less the channel's 2 mm, foam of 2 mm, membrane of 0.5 mm.
    assert!(page.contains("1.9 mm in diameter; 4.5 mm long") && !page.contains("<td>conductive fabric</td>"));
    let at = |part: &str| page.find(part).unwrap_or_else(|| panic!("{part}"));
    assert!(["until 2.5 mm stand out", "Cut a membrane", "Spray thin layers", "Lay no conductive"].map(at).is_sorted());
    let covered = page_of(&SkinDesign::shipped("cylinder30").unwrap());
    assert!(covered.contains("sprayed on the base") && membrane.iter().all(|part| !covered.contains(part)));
    // What is not to be cut is not listed so.
    let files = crate::sheet::files(&Fabrication::new(&SkinDesign::shipped("skin16").unwrap()).unwrap()).unwrap();
    let of = |path: &str| files.iter().find(|file| file.path == path).unwrap().purpose.as_str();
    assert!(of("patterns/patches.svg").starts_with("not used") && of("patterns/patches.csv").starts_with("not used"));
    assert!(of("patterns/foam.svg").contains("below the membrane"));
}

#[test]
fn a_membrane_without_foam_is_refused() {
    let text = SkinDesign::shipped_text("skin16").unwrap().replace("bore_m", "foam_thickness_m = 0.0\nbore_m");
    let error = Fabrication::new(&SkinDesign::parse(&text, "test.toml").unwrap()).unwrap_err();
    assert!(error.to_string().contains("nothing stretches") && error.fix().unwrap().contains("0.002"), "{error}");
}

/// Channels that exceed the range are named in the notes and on the page, with what to do; a skin of which many would gets
/// a larger reference resistor, for which the firmware's command has a file of its own.
#[test]
fn channels_beyond_the_range_of_the_reader_are_named() {
    let cylinder = Fabrication::new(&SkinDesign::shipped("cylinder30").unwrap()).unwrap();
    let note = |made: &Fabrication, part: &str| crate::notes(made).into_iter().find(|note| note.contains(part));
    let said = note(&cylinder, "exceed the range").unwrap();
    for part in ["3 of the 870 channels", "0.5 V", "289 (E", "3.3 kohm", "`gain = 1.0`"] {
        assert!(said.contains(part), "{said}");
    }
    let own_page = page(&cylinder).unwrap();
    assert!(
        own_page.contains("3 of the 870 channels") && own_page.contains("--twin dermis-firmware/boards/reader.toml")
    );
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis-cli/src/command/new/rectangle.toml");
    let rectangle = Fabrication::new(&SkinDesign::load(path).unwrap()).unwrap();
    let said = note(&rectangle, "this skin gets 10 kohm").unwrap();
    assert!(said.contains("92 of the 380 channels"), "{said}");
    let page = page(&rectangle).unwrap();
    assert!(page.contains("reference_ohm = 10000.0") && page.contains("_reader.toml -o dermis-firmware"));
    assert!(page.contains("<td>10 kohm; 0.1 %; 10 ppm/K</td>"));
    assert_eq!(note(&Fabrication::new(&SkinDesign::shipped("skin16").unwrap()).unwrap(), "exceed"), None);
}
