//! Links and joints from a URDF file. Masses are not read.

use crate::kinematics::{Joint, JointKind, Kinematics};
use crate::pose::Pose;
use dermis::design::{DesignError, closest_name};
use dermis::files::{folder_of, read_text_at_most};
use dermis::geom::vector::{norm, scale};
use dermis::geom::{Point3, beyond_a_turn};
use roxmltree::{Document, Node};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use std::path::{Path, PathBuf};

/// Largest URDF file, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// Most links: the largest robots have some hundreds.
const MAX_LINKS: usize = 10_000;
/// The longest distance between two joints, m: a larger one is in millimetres.
const MAX_ORIGIN_M: f64 = 20.0;

impl Kinematics {
    /// From a URDF file: revolute, continuous, prismatic, fixed and mimic joints. The child of a planar or floating joint is
    /// the root of another tree.
    ///
    /// # Errors
    /// A file that is not URDF, with the line; a link with two parents; a cycle.
    pub fn load(path: &Path) -> Result<Self, DesignError> {
        Self::parse(&read(path)?, &path.display().to_string())
    }

    /// From the text of a URDF file.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(text: &str, name: &str) -> Result<Self, DesignError> {
        let file = File { name, text };
        let document = Document::parse(text).map_err(|error| {
            let error_at = error.pos();
            DesignError::new(format!("{name}:{}: {error}", error_at.row), Some("give a URDF file".into()))
        })?;
        let robot = document.root_element();
        if robot.tag_name().name() != "robot" {
            let fix = "write `<robot name=\"...\">` around links and joints; MJCF and SDF are other formats";
            return Err(file.error(robot, format!("<{}> is no robot of URDF", robot.tag_name().name()), Some(fix)));
        }
        let is_macro = |node: Node<'_, '_>| {
            let space = node.tag_name().namespace();
            space.is_some_and(|space| space.contains("xacro") || node.lookup_prefix(space) == Some("xacro"))
        };
        if robot.descendants().any(is_macro) {
            let fix = "expand it first: xacro FILE.urdf.xacro > FILE.urdf";
            return Err(file.error(robot, "the file has macros of xacro".into(), Some(fix)));
        }
        let children = |tag: &'static str| robot.children().filter(move |node| node.has_tag_name(tag));
        let links: Vec<String> = children("link").map(|node| file.name_of(node)).collect::<Result<_, _>>()?;
        if links.is_empty() {
            return Err(file.error(robot, "the robot has no links".into(), None));
        }
        if links.len() > MAX_LINKS {
            return Err(file.error(
                robot,
                format!("the robot has {} links: at most {MAX_LINKS} are read", links.len()),
                None,
            ));
        }
        let nodes: Vec<Node<'_, '_>> = children("joint").filter(|node| !is_free(*node)).collect();
        let names: Vec<String> = nodes.iter().map(|node| file.name_of(*node)).collect::<Result<_, _>>()?;
        for (kind, names) in [("link", &links), ("joint", &names)] {
            if let Some(name) = names.iter().enumerate().find(|(index, name)| names[..*index].contains(name)) {
                return Err(file.error(robot, format!("two {kind}s are called `{}`", name.1), None));
            }
        }
        let joints = nodes.iter().map(|node| file.joint(*node, &links, &names)).collect::<Result<_, _>>()?;
        let title = robot.attribute("name").unwrap_or_default().to_string();
        Kinematics::new(title, links, joints).map_err(|message| file.error(robot, message, None))
    }
}

/// What a link looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// For collisions: coarse, and closed.
    Collision,
    /// For pictures.
    Visual,
}

/// The triangles of a link, in its frame, m, and its mesh files: STL, OBJ or PLY. Boxes, cylinders and spheres are triangles too.
///
/// # Errors
/// A file that is not URDF; a link that is not there or has no such shape; a mesh that is not found or cannot be read.
pub fn link_triangles(urdf: &Path, link: &str, shape: Shape) -> Result<(Vec<[Point3; 3]>, Vec<PathBuf>), DesignError> {
    let name = urdf.display().to_string();
    let text = read(urdf)?;
    let file = File { name: &name, text: &text };
    // The links are checked, with all else.
    let kinematics = Kinematics::parse(&text, &name)?;
    let document = Document::parse(&text).map_err(|error| DesignError::new(error.to_string(), None))?;
    let robot = document.root_element();
    let index = kinematics.named_link(link).map_err(|error| file.error(robot, error.message, error.fix.as_deref()))?;
    let node = robot.children().filter(|node| node.has_tag_name("link")).nth(index).unwrap_or(robot);
    let (tag, other) = match shape {
        Shape::Collision => ("collision", "visual"),
        Shape::Visual => ("visual", "collision"),
    };
    let (mut triangles, mut files) = (Vec::new(), Vec::new());
    for part in node.children().filter(|part| part.has_tag_name(tag)) {
        let origin = part.children().find(|node| node.has_tag_name("origin"));
        let pose = origin.map_or(Ok(Pose::IDENTITY), |node| file.origin(node))?;
        let Some(mesh) = part.descendants().find(|node| node.has_tag_name("mesh")) else {
            let solid = file.solid(part)?.into_iter();
            triangles.extend(solid.map(|triangle| triangle.map(|corner| pose.point(corner))));
            continue;
        };
        let scales = file.vector(Some(mesh), "scale", [1.0; 3])?;
        let path = mesh_path(urdf, mesh.attribute("filename").unwrap_or_default()).ok_or_else(|| {
            let fix = "put the URDF where its package is, or write the path of the mesh from the folder of the URDF";
            let named = mesh.attribute("filename").unwrap_or_default();
            file.error(mesh, format!("the mesh `{named}` is not found"), Some(fix))
        })?;
        let loaded = dermis::mesh::import::load_triangles(&path, 1.0)
            .map_err(|error| file.error(mesh, error.to_string(), Some("give an STL file with --mesh")))?;
        files.push(path);
        let place = |corner: Point3| pose.point([0, 1, 2].map(|axis| corner[axis] * scales[axis]));
        triangles.extend(loaded.into_iter().map(|triangle| triangle.map(place)));
    }
    if triangles.is_empty() {
        let fix = format!("try the shape for {other}, or give an STL file with --mesh");
        let message = format!("the link `{link}` has no mesh, box, cylinder or sphere for {tag}");
        return Err(file.error(node, message, Some(&fix)));
    }
    Ok((triangles, files))
}

fn read(urdf: &Path) -> Result<String, DesignError> {
    read_text_at_most(urdf, MAX_BYTES).map_err(|error| {
        DesignError::new(format!("cannot read the robot description {}: {error}", urdf.display()), None)
    })
}

/// The file of a mesh: `package://NAME/...` is looked for in the folders above the URDF.
fn mesh_path(urdf: &Path, name: &str) -> Option<PathBuf> {
    let folder = std::path::absolute(folder_of(urdf)).ok()?;
    let Some(rest) = name.strip_prefix("package://") else {
        let path = folder.join(name.strip_prefix("file://").unwrap_or(name));
        return path.is_file().then_some(path);
    };
    let rest = rest.trim_start_matches('/');
    let (package, inside) = rest.split_once('/')?;
    folder.ancestors().find_map(|above| {
        let is_package = above.file_name().is_some_and(|name| name == package);
        [Some(above.join(rest)), is_package.then(|| above.join(inside))]
            .into_iter()
            .flatten()
            .find(|path| path.is_file())
    })
}

/// The closed surface that half a profile (radius, height) makes about z, from the top to the middle; the lower half mirrors it.
fn revolved(half: &[[f64; 2]], sides: usize) -> impl Iterator<Item = [Point3; 3]> {
    let lower = half.iter().rev().map(|[radius, height]| [*radius, -height]);
    let profile: Vec<[f64; 2]> = half.iter().copied().chain(lower).collect();
    let corner = move |[radius, height]: [f64; 2], side: usize| {
        let (sin, cos) = (TAU * (side as f64 + 0.5) / sides as f64).sin_cos();
        [radius * cos, radius * sin, height]
    };
    let bands = profile.windows(2).map(|pair| [pair[0], pair[1]]).filter(|[upper, lower]| upper != lower);
    let bands: Vec<[[f64; 2]; 2]> = bands.collect();
    bands.into_iter().flat_map(move |[upper, lower]| {
        (0..sides).flat_map(move |side| {
            let [a, b] = [side, side + 1].map(|side| corner(upper, side));
            let [c, d] = [side, side + 1].map(|side| corner(lower, side));
            let halves = [(upper[0] > 0.0).then_some([a, c, b]), (lower[0] > 0.0).then_some([b, c, d])];
            halves.into_iter().flatten()
        })
    })
}

fn is_free(joint: Node<'_, '_>) -> bool {
    matches!(joint.attribute("type"), Some("floating" | "planar"))
}

/// The file that is read, for its errors.
#[derive(Clone, Copy)]
struct File<'a> {
    name: &'a str,
    text: &'a str,
}

impl File<'_> {
    fn error(self, node: Node<'_, '_>, message: String, fix: Option<&str>) -> DesignError {
        let start = node.range().start;
        let end = self.text[start..].find('>').map_or(self.text.len(), |length| start + length + 1);
        DesignError {
            source_text: Some((self.name.into(), self.text.into())),
            span: Some(start..end),
            ..DesignError::new(message, fix.map(String::from))
        }
    }

    fn name_of(self, node: Node<'_, '_>) -> Result<String, DesignError> {
        let name = node.attribute("name").filter(|name| !name.is_empty());
        name.map(String::from)
            .ok_or_else(|| self.error(node, format!("a {} without a name", node.tag_name().name()), None))
    }

    /// The surface of the boxes, cylinders and spheres of an element, m.
    fn solid(self, part: Node<'_, '_>) -> Result<Vec<[Point3; 3]>, DesignError> {
        /// Sides of what is round: its flat sides are within 0.2 % of the radius.
        const SIDES: usize = 48;
        let mut triangles = Vec::new();
        for node in part.descendants().filter(Node::is_element) {
            let number = |key: &str| self.number(node, key, f64::NAN);
            let (size, profile, sides) = match node.tag_name().name() {
                // A square prism whose sides face the axes.
                "box" => (self.vector(Some(node), "size", [f64::NAN; 3])?, vec![[0.0, 0.5], [FRAC_1_SQRT_2, 0.5]], 4),
                "cylinder" => {
                    let (radius_m, length_m) = (number("radius")?, number("length")?);
                    ([radius_m, radius_m, length_m], vec![[0.0, 0.5], [1.0, 0.5]], SIDES)
                }
                "sphere" => {
                    let angle = |step: usize| PI * step as f64 / SIDES as f64;
                    let profile = (0..=SIDES / 2).map(|step| [angle(step).sin(), angle(step).cos()]).collect();
                    ([number("radius")?; 3], profile, SIDES)
                }
                _ => continue,
            };
            if !size.iter().all(|length_m| *length_m > 0.0 && length_m.is_finite()) {
                let message = format!("a <{}> without an extent", node.tag_name().name());
                return Err(self.error(node, message, Some("give positive lengths, m")));
            }
            let unit = revolved(&profile, sides);
            triangles
                .extend(unit.map(|triangle| triangle.map(|corner| [0, 1, 2].map(|axis| corner[axis] * size[axis]))));
        }
        Ok(triangles)
    }

    /// Refuses parts of a joint that are misspelt or written twice: what is left out moves links.
    fn check_parts(self, joint: Node<'_, '_>) -> Result<(), DesignError> {
        const PARTS: [(&str, &[&str]); 3] =
            [("origin", &["xyz", "rpy"]), ("axis", &["xyz"]), ("mimic", &["joint", "multiplier", "offset"])];
        for tag in PARTS.map(|(tag, _)| tag).into_iter().chain(["parent", "child", "limit"]) {
            if let Some(second) = joint.children().filter(|child| child.has_tag_name(tag)).nth(1) {
                return Err(self.error(second, format!("a second <{tag}> of one joint"), Some("write one")));
            }
        }
        for (tag, keys) in PARTS {
            let first = joint.children().find(|child| child.has_tag_name(tag));
            let attributes = first.into_iter().flat_map(|part| part.attributes());
            if let Some(wrong) = attributes.map(|attribute| attribute.name()).find(|key| !keys.contains(key)) {
                let fix = format!("the attributes of <{tag}> are {}", keys.join(", "));
                return Err(self.error(
                    first.unwrap_or(joint),
                    format!("<{tag}> has no attribute `{wrong}`"),
                    Some(&fix),
                ));
            }
        }
        // Other programs write elements of their own: only a misspelt one is refused.
        const OTHERS: [&str; 6] = ["parent", "child", "limit", "dynamics", "calibration", "safety_controller"];
        let names = || PARTS.iter().map(|(tag, _)| *tag);
        for element in joint.children().filter(Node::is_element) {
            let name = element.tag_name().name();
            if OTHERS.contains(&name) || names().any(|tag| tag == name) {
                continue;
            }
            let near = closest_name(&name.to_lowercase(), names()).filter(|near| near.len().abs_diff(name.len()) <= 1);
            if let Some(near) = near {
                let fix = format!("did you mean <{near}>?");
                return Err(self.error(element, format!("a joint has no <{name}>"), Some(&fix)));
            }
        }
        Ok(())
    }

    fn joint(self, node: Node<'_, '_>, links: &[String], names: &[String]) -> Result<Joint, DesignError> {
        let name = self.name_of(node)?;
        self.check_parts(node)?;
        let child = |tag: &str| node.children().find(|child| child.has_tag_name(tag));
        let kind = match node.attribute("type") {
            Some("fixed") => JointKind::Fixed,
            Some("revolute") => JointKind::Revolute { wraps: false },
            Some("continuous") => JointKind::Revolute { wraps: true },
            Some("prismatic") => JointKind::Prismatic,
            other => {
                let message = format!("the joint `{name}` has the type `{}`", other.unwrap_or_default());
                let fix = "one of revolute, continuous, prismatic, fixed, planar, floating";
                return Err(self.error(node, message, Some(fix)));
            }
        };
        let link_of = |tag: &str| {
            let link = child(tag).and_then(|node| node.attribute("link")).unwrap_or_default();
            self.place(node, link, links, &format!("the <{tag}> of the joint `{name}`"))
        };
        let (parent, child_link) = (link_of("parent")?, link_of("child")?);
        let origin = child("origin").map_or(Ok(Pose::IDENTITY), |node| self.origin(node))?;
        // Fixed joints are often written with an axis of zeros.
        let axis_node = child("axis").filter(|_| kind != JointKind::Fixed);
        let axis = self.vector(axis_node, "xyz", [1.0, 0.0, 0.0])?;
        // Beyond, its square is no number.
        if !(1e-9..=1e9).contains(&norm(axis)) {
            return Err(self.error(node, format!("the axis of the joint `{name}` has no direction"), None));
        }
        let mimic = child("mimic").map(|mimic| {
            let source = mimic.attribute("joint").unwrap_or_default();
            let source = self.place(mimic, source, names, &format!("what the joint `{name}` mimics"))?;
            Ok((source, self.number(mimic, "multiplier", 1.0)?, self.number(mimic, "offset", 0.0)?))
        });
        let limit = |key: &str| child("limit").map_or(Ok(0.0), |limit| self.number(limit, key, 0.0));
        let (speed, limits) = (limit("velocity")?, [limit("lower")?, limit("upper")?]);
        // A continuous joint has none, whatever is written.
        let is_limited = matches!(kind, JointKind::Revolute { wraps: false } | JointKind::Prismatic);
        if is_limited && limits[0] > limits[1] {
            let message = format!("the limits of the joint `{name}` are {} to {}", limits[0], limits[1]);
            return Err(self.error(child("limit").unwrap_or(node), message, Some("lower must be below upper")));
        }
        Ok(Joint {
            kind,
            parent,
            child: child_link,
            origin,
            axis: scale(axis, 1.0 / norm(axis)),
            mimic: mimic.transpose()?,
            speed_limit: Some(speed).filter(|speed| *speed > 0.0),
            limits: Some(limits).filter(|[lower, upper]| is_limited && lower < upper),
            name,
        })
    }

    /// The place of a name in a list.
    fn place(self, node: Node<'_, '_>, name: &str, names: &[String], what: &str) -> Result<usize, DesignError> {
        names.iter().position(|known| known == name).ok_or_else(|| {
            let fix =
                closest_name(name, names.iter().map(String::as_str)).map(|near| format!("did you mean `{near}`?"));
            self.error(node, format!("{what}, `{name}`, is not in the file"), fix.as_deref())
        })
    }

    fn origin(self, node: Node<'_, '_>) -> Result<Pose, DesignError> {
        let xyz = self.vector(Some(node), "xyz", [0.0; 3])?;
        if norm(xyz) > MAX_ORIGIN_M {
            let fix = "lengths in URDF are in metres";
            return Err(self.error(node, format!("an origin {:.0} m away", norm(xyz)), Some(fix)));
        }
        let rpy = self.vector(Some(node), "rpy", [0.0; 3])?;
        if let Some(wrong) = rpy.iter().find_map(|angle_rad| beyond_a_turn("an angle of rpy", *angle_rad)) {
            return Err(self.error(node, wrong, None));
        }
        Ok(Pose::from_xyz_rpy(xyz, rpy))
    }

    fn vector(self, node: Option<Node<'_, '_>>, key: &str, default: Point3) -> Result<Point3, DesignError> {
        let Some((node, text)) = node.and_then(|node| Some((node, node.attribute(key)?))) else { return Ok(default) };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(finite).collect();
        let numbers = numbers.and_then(|numbers| <Point3>::try_from(numbers).ok());
        numbers.ok_or_else(|| self.error(node, format!("{key}=\"{text}\" is not three numbers"), None))
    }

    fn number(self, node: Node<'_, '_>, key: &str, default: f64) -> Result<f64, DesignError> {
        let Some(text) = node.attribute(key) else { return Ok(default) };
        finite(text).ok_or_else(|| self.error(node, format!("{key}=\"{text}\" is not a number"), None))
    }
}

fn finite(word: &str) -> Option<f64> {
    word.trim().parse().ok().filter(|value: &f64| value.is_finite())
}
