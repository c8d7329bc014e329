//! Links and joints from a URDF file. Meshes, masses and limits of positions are not read.

use crate::kinematics::{Joint, JointKind, Kinematics};
use crate::pose::Pose;
use dermis::design::{DesignError, closest_name};
use dermis::files::read_text_at_most;
use dermis::geom::Point3;
use dermis::geom::vector::{norm, scale};
use roxmltree::{Document, Node};
use std::path::Path;

/// Largest URDF file, bytes.
const MAX_BYTES: u64 = 64 << 20;
/// The longest distance between two joints, m: a larger one is in millimetres.
const MAX_ORIGIN_M: f64 = 20.0;

impl Kinematics {
    /// From a URDF file: revolute, continuous, prismatic, fixed and mimic joints. The child of a planar or floating joint is
    /// the root of another tree.
    ///
    /// # Errors
    /// A file that is not URDF, with the line; a link with two parents; a cycle.
    pub fn load(path: &Path) -> Result<Self, DesignError> {
        let text = read_text_at_most(path, MAX_BYTES).map_err(|error| {
            DesignError::new(format!("cannot read the robot description {}: {error}", path.display()), None)
        })?;
        Self::parse(&text, &path.display().to_string())
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
        let is_macro = |node: Node<'_, '_>| node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
        if robot.descendants().any(is_macro) {
            let fix = "expand it first: xacro FILE.urdf.xacro > FILE.urdf";
            return Err(file.error(robot, "the file has macros of xacro".into(), Some(fix)));
        }
        let children = |tag: &'static str| robot.children().filter(move |node| node.has_tag_name(tag));
        let links: Vec<String> = children("link").map(|node| file.name_of(node)).collect::<Result<_, _>>()?;
        if links.is_empty() {
            return Err(file.error(robot, "the robot has no links".into(), None));
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

    fn joint(self, node: Node<'_, '_>, links: &[String], names: &[String]) -> Result<Joint, DesignError> {
        let name = self.name_of(node)?;
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
        if norm(axis) == 0.0 {
            return Err(self.error(node, format!("the axis of the joint `{name}` has no direction"), None));
        }
        let mimic = child("mimic").map(|mimic| {
            let source = mimic.attribute("joint").unwrap_or_default();
            let source = self.place(mimic, source, names, &format!("what the joint `{name}` mimics"))?;
            Ok((source, self.number(mimic, "multiplier", 1.0)?, self.number(mimic, "offset", 0.0)?))
        });
        let limit = child("limit").map_or(Ok(0.0), |limit| self.number(limit, "velocity", 0.0))?;
        Ok(Joint {
            kind,
            parent,
            child: child_link,
            origin,
            axis: scale(axis, 1.0 / norm(axis)),
            mimic: mimic.transpose()?,
            speed_limit: Some(limit).filter(|limit| *limit > 0.0),
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
        Ok(Pose::from_xyz_rpy(xyz, self.vector(Some(node), "rpy", [0.0; 3])?))
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
