//! The file of a robot: its skins, where they are, and rules.

use crate::kinematics::Kinematics;
use crate::pose::Pose;
use dermis::design::{DesignError, SkinDesign, closest_name, explain_toml_error};
use dermis::files::{MAX_SETTINGS_BYTES, folder_of, read_text_at_most};
use dermis::geom::{Point3, beyond_a_turn};
use serde::{Deserialize, Deserializer};
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A robot with its skins, as in its file; see `docs/robot.md`.
#[derive(Debug, Clone)]
pub struct Robot {
    name: String,
    joints: JointSource,
    age_s: f64,
    friction: f64,
    skins: Vec<WornSkin>,
    rules: Vec<Rule>,
    kinematics: Option<Kinematics>,
    description: Option<PathBuf>,
    /// The text of its file, and where the paths are in it: that of the description, those of each skin's design and method.
    text: String,
    description_at: Option<Range<usize>>,
    skin_paths_at: Vec<[Option<Range<usize>>; 2]>,
    base: usize,
    needed_joints: Vec<usize>,
}

/// A skin on a link.
#[derive(Debug, Clone)]
pub struct WornSkin {
    /// Its name, unique on the robot.
    pub name: String,
    /// The path of its design, or a shipped name.
    pub design: String,
    /// The [checksum](SkinDesign::sha256) of the design.
    pub design_sha256: [u8; 32],
    /// The name of the link that wears it.
    pub link: String,
    /// The pose of the design's frame in the link's.
    pub origin: Pose,
    /// Where its frames come from: the address of a device, or `robot:HOST:PORT`, another program that reads it.
    pub source: String,
    /// The serial number that the device must have.
    pub serial: Option<u32>,
    /// Its method: a name, or the folder of a model or calibration.
    pub method: Option<String>,
    /// Whether the robot may be touched unnoticed while this skin is unknown.
    pub required: bool,
    /// The index of the link in the description.
    pub(crate) link_index: usize,
}

impl WornSkin {
    /// The address of the program that reads it, if it is not read by this one.
    pub fn part(&self) -> Option<&str> {
        self.source.strip_prefix(PART)
    }
}

/// The longest way from the frame of a link to its skin, m: a longer one is in millimetres.
const FARTHEST_M: f64 = 2.0;
/// The start of the source of a skin that another program reads.
const PART: &str = "robot:";

/// Where joint states come from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum JointSource {
    /// From nowhere, or from the program that feeds the robot.
    #[default]
    None,
    /// Datagrams of JSON that are sent to this address.
    Udp(String),
    /// A topic of ROS 2 with messages of the type `sensor_msgs/msg/JointState`.
    Ros2(String),
}

/// A condition on skins, whose begin and end are events.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Its name.
    pub name: String,
    /// The skins that it is about, by index.
    pub skins: Vec<usize>,
    /// When it holds.
    pub when: When,
    /// What it does while a skin is unknown.
    pub unknown: OnUnknown,
    /// How long it must not hold before it ends, s.
    pub clear_s: f64,
    /// Whether contacts with other skins of the robot do not count.
    pub ignores_self: bool,
}

/// When a rule holds.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum When {
    /// At the first frame that is touched.
    Touched,
    /// While there is a contact.
    Contact,
    /// While the force of a contact is at least this, N.
    ForceN(f64),
}

/// What a rule does while one of its skins is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnUnknown {
    /// It holds.
    #[default]
    Stop,
    /// It stays as it was.
    Keep,
    /// It does not hold by this skin.
    Ignore,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    name: String,
    description: Option<Spanned<PathBuf>>,
    base: Option<Spanned<String>>,
    #[serde(default = "no_joints")]
    joints: Spanned<String>,
    #[serde(default = "default_age_s")]
    age_s: Spanned<f64>,
    #[serde(default = "default_friction")]
    friction: Spanned<f64>,
    skin: Vec<Spanned<SkinTable>>,
    #[serde(default)]
    rule: Vec<Spanned<RuleTable>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SkinTable {
    name: Spanned<String>,
    design: Spanned<String>,
    link: Option<Spanned<String>>,
    origin: Option<Spanned<OriginTable>>,
    source: Spanned<String>,
    serial: Option<u32>,
    method: Option<Spanned<String>>,
    #[serde(default = "yes")]
    required: bool,
}

fn exactly_if_given<'de, D: Deserializer<'de>, const N: usize>(given: D) -> Result<Option<[f64; N]>, D::Error> {
    dermis::files::exactly(given).map(Some)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct OriginTable {
    #[serde(default, deserialize_with = "dermis::files::exactly")]
    xyz_m: Point3,
    #[serde(default, deserialize_with = "exactly_if_given")]
    rpy_rad: Option<Point3>,
    #[serde(default, deserialize_with = "exactly_if_given")]
    quaternion: Option<[f64; 4]>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleTable {
    name: Spanned<String>,
    on: Vec<Spanned<String>>,
    when: Spanned<When>,
    #[serde(default)]
    unknown: OnUnknown,
    #[serde(default = "default_clear_s")]
    clear_s: Spanned<f64>,
    #[serde(default, rename = "self")]
    self_touch: SelfTouch,
}

/// What a contact with another skin of the robot is to a rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SelfTouch {
    #[default]
    Count,
    Ignore,
}

fn yes() -> bool {
    true
}

fn no_joints() -> Spanned<String> {
    Spanned::new(0..0, "none".into())
}

/// Six frames at 120 Hz.
fn default_age_s() -> Spanned<f64> {
    Spanned::new(0..0, 0.05)
}

fn default_clear_s() -> Spanned<f64> {
    Spanned::new(0..0, 0.2)
}

/// Skin, wood and plastics on rubber or fabric have 0.3 to 0.8.
fn default_friction() -> Spanned<f64> {
    Spanned::new(0..0, 0.5)
}

impl Robot {
    /// From a file. Paths in it are relative to its folder.
    ///
    /// # Errors
    /// A file that cannot be read; a wrong value, with its line and the fix; a design or a robot description that is wrong.
    pub fn load(path: &Path) -> Result<Self, DesignError> {
        let text = read_text_at_most(path, MAX_SETTINGS_BYTES)
            .map_err(|error| DesignError::new(format!("cannot read the robot {}: {error}", path.display()), None))?;
        let name = path.display().to_string();
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        Reader { name: &name, text, folder: folder_of(path) }.robot()
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its skins, in the order of the file.
    pub fn skins(&self) -> &[WornSkin] {
        &self.skins
    }

    /// Its rules, in the order of the file.
    pub fn rules(&self) -> &[Rule] {
        &self.rules
    }

    /// Its links and joints, if it has a description.
    pub fn kinematics(&self) -> Option<&Kinematics> {
        self.kinematics.as_ref()
    }

    /// The text of its file with other paths: of the description, and of the design and the method of each skin; a method that is
    /// not given stays.
    pub fn text_with_paths(
        &self,
        description: &str,
        of_skin: impl Fn(&WornSkin) -> (String, Option<String>),
    ) -> String {
        let mut paths: Vec<(&Range<usize>, String)> =
            self.description_at.iter().map(|at| (at, description.to_string())).collect();
        for (worn, [design_at, method_at]) in self.skins.iter().zip(&self.skin_paths_at) {
            let (design, method) = of_skin(worn);
            paths.extend(design_at.as_ref().map(|at| (at, design)));
            paths.extend(method_at.as_ref().zip(method));
        }
        paths.sort_by_key(|(at, _)| at.start);
        let mut text = self.text.clone();
        for (at, path) in paths.into_iter().rev() {
            let quoted = if path.contains('\'') { format!("{path:?}") } else { format!("'{path}'") };
            text.replace_range(at.clone(), &quoted);
        }
        text
    }

    /// The path of its description.
    pub fn description(&self) -> Option<&Path> {
        self.description.as_deref()
    }

    /// The pose of each link in the frame of the base, at positions in the order of [`Kinematics::joint_names`]; `None` of a
    /// link that no joints connect with the base, or that hangs on a joint whose position is `NaN`. Empty without a description.
    ///
    /// # Panics
    /// If there are not as many positions as joints.
    pub fn poses(&self, positions: &[f64]) -> Vec<Option<Pose>> {
        let Some(kinematics) = &self.kinematics else { return Vec::new() };
        let posture = kinematics.posture(positions);
        (0..kinematics.links().len()).map(|link| posture.pose(self.base, link)).collect()
    }

    /// The name of the link whose frame is the base.
    pub fn base(&self) -> Option<&str> {
        self.kinematics.as_ref().map(|kinematics| kinematics.links()[self.base].as_str())
    }

    /// Pairs of skins that do not move against each other: on one link, or on links that are fixed to each other; with the pose of
    /// the frame of the second in that of the first.
    pub fn fixed_pairs(&self) -> Vec<(usize, usize, Pose)> {
        let posture = self.kinematics().map(|known| known.posture(&vec![f64::NAN; known.movable().len()]));
        let pose = |worn: &WornSkin, other: &WornSkin| {
            let links = match &posture {
                _ if worn.link == other.link => Some(Pose::IDENTITY),
                Some(posture) => posture.pose(worn.link_index, other.link_index),
                None => None,
            };
            links.map(|links| worn.origin.inverse().after(&links).after(&other.origin))
        };
        let skins = self.skins();
        let pairs = (0..skins.len()).flat_map(|a| (a + 1..skins.len()).map(move |b| (a, b)));
        pairs.filter_map(|(a, b)| Some((a, b, pose(&skins[a], &skins[b])?))).collect()
    }

    pub(crate) fn base_index(&self) -> usize {
        self.base
    }

    /// Where joint states come from.
    pub fn joint_source(&self) -> &JointSource {
        &self.joints
    }

    /// Contacts and joint states that are older are unknown, s.
    pub fn age_s(&self) -> f64 {
        self.age_s
    }

    /// The largest coefficient of friction of what touches the robot.
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// The index of a skin.
    pub fn skin(&self, name: &str) -> Option<usize> {
        self.skins.iter().position(|skin| skin.name == name)
    }

    /// The joints that the pose of some skin depends on, by their place in [`Kinematics::joint_names`].
    pub fn needed_joints(&self) -> &[usize] {
        &self.needed_joints
    }
}

/// What reads the file, for its errors.
struct Reader<'a> {
    name: &'a str,
    text: &'a str,
    folder: &'a Path,
}

impl Reader<'_> {
    fn error(&self, span: Range<usize>, message: String, fix: Option<&str>) -> DesignError {
        DesignError {
            source_text: Some((self.name.into(), self.text.into())),
            // Defaults have no place in the file.
            span: Some(span).filter(|span| !span.is_empty()),
            ..DesignError::new(message, fix.map(String::from))
        }
    }

    fn robot(&self) -> Result<Robot, DesignError> {
        let fix = "give the file of a robot: `dermis new robot -o arm.toml` writes one";
        if self.text.trim_start().starts_with('<') {
            let message = format!("{} is a robot description (URDF): it is the `description` of a robot", self.name);
            return Err(DesignError::new(message, Some(fix.into())));
        }
        let has_key = |key: &str| self.text.parse::<toml::Table>().is_ok_and(|table| table.contains_key(key));
        if has_key("body") && !has_key("skin") {
            let message = format!("{} is the design of a skin: it is the `design` of a [[skin]] of a robot", self.name);
            return Err(DesignError::new(message, Some(fix.into())));
        }
        let file: RobotFile = toml::from_str(self.text).map_err(|error| {
            let (message, fix) = explain_toml_error(error.message());
            // A key that the file lacks has no place in it: its beginning.
            let at = error.span().filter(|span| !span.is_empty()).unwrap_or(0..self.text.len().min(1));
            self.error(at, message, fix.as_deref())
        })?;
        let description = file.description.as_ref().map(|path| self.folder.join(path.get_ref()));
        let kinematics = description.as_deref().map(Kinematics::load).transpose()?;
        let base = match (&file.base, &kinematics) {
            (Some(base), Some(kinematics)) => self.link(kinematics, base)?,
            (None, Some(kinematics)) => kinematics.root(),
            (Some(base), None) => {
                return Err(self.error(
                    base.span(),
                    "a base without a robot description".into(),
                    Some("write description = \"robot.urdf\""),
                ));
            }
            (None, None) => 0,
        };
        let skins: Vec<WornSkin> =
            file.skin.iter().map(|skin| self.skin(skin, kinematics.as_ref())).collect::<Result<_, _>>()?;
        self.check_skins(&file.skin)?;
        for (index, rule) in file.rule.iter().enumerate() {
            let name = &rule.get_ref().name;
            self.check_name(name, "a rule")?;
            if file.rule[..index].iter().any(|other| other.get_ref().name.get_ref() == name.get_ref()) {
                return Err(self.error(name.span(), format!("two rules are called `{}`", name.get_ref()), None));
            }
        }
        let rules = file.rule.iter().map(|rule| self.rule(rule, &skins)).collect::<Result<_, _>>()?;
        let mut needed_joints: Vec<usize> = kinematics
            .iter()
            .flat_map(|kinematics| skins.iter().flat_map(|skin| kinematics.needed(base, skin.link_index)))
            .collect();
        needed_joints.sort_unstable();
        needed_joints.dedup();
        Ok(Robot {
            name: file.name,
            description,
            text: self.text.into(),
            description_at: file.description.as_ref().map(Spanned::span),
            skin_paths_at: file
                .skin
                .iter()
                .map(Spanned::get_ref)
                .map(|skin| [Some(skin.design.span()), skin.method.as_ref().map(Spanned::span)])
                .collect(),
            joints: self.joint_source(&file.joints)?,
            age_s: self.within(&file.age_s, "age_s", 0.001..=10.0)?,
            friction: self.within(&file.friction, "friction", 0.0..=10.0)?,
            skins,
            rules,
            kinematics,
            base,
            needed_joints,
        })
    }

    fn within(
        &self,
        value: &Spanned<f64>,
        key: &str,
        range: std::ops::RangeInclusive<f64>,
    ) -> Result<f64, DesignError> {
        let number = *value.get_ref();
        if range.contains(&number) {
            return Ok(number);
        }
        let fix = format!("from {} to {}", range.start(), range.end());
        Err(self.error(value.span(), format!("`{key}` is {number:?}"), Some(&fix)))
    }

    fn joint_source(&self, joints: &Spanned<String>) -> Result<JointSource, DesignError> {
        match joints.get_ref().split_once(':') {
            None if joints.get_ref() == "none" => Ok(JointSource::None),
            Some(("udp", address)) if has_port(address) => Ok(JointSource::Udp(address.into())),
            Some(("ros2", topic)) if topic.len() > 1 && topic.starts_with('/') => Ok(JointSource::Ros2(topic.into())),
            _ => {
                let fix = "write \"ros2:/joint_states\", \"udp:127.0.0.1:7450\" or \"none\"";
                Err(self.error(
                    joints.span(),
                    format!("`{}` is no source of joint states", joints.get_ref()),
                    Some(fix),
                ))
            }
        }
    }

    fn link(&self, kinematics: &Kinematics, name: &Spanned<String>) -> Result<usize, DesignError> {
        let named = kinematics.named_link(name.get_ref());
        named.map_err(|error| self.error(name.span(), error.message, error.fix.as_deref()))
    }

    fn skin(&self, table: &Spanned<SkinTable>, kinematics: Option<&Kinematics>) -> Result<WornSkin, DesignError> {
        let SkinTable { name, design, link, origin, source, serial, method, required } = table.get_ref();
        self.check_name(name, "a skin")?;
        let link_index = match (link, kinematics) {
            (Some(link), Some(kinematics)) => self.link(kinematics, link)?,
            (None, Some(_)) => {
                let fix = "write link = \"...\": `dermis robot links FILE` lists them";
                return Err(self.error(name.span(), format!("the skin `{}` is on no link", name.get_ref()), Some(fix)));
            }
            (_, None) => 0,
        };
        let named = design.get_ref();
        let is_shipped = SkinDesign::SHIPPED.contains(&named.as_str()) && !self.folder.join(named).exists();
        let design_path = if is_shipped { named.clone() } else { self.beside(named) };
        let loaded = SkinDesign::load(&design_path).map_err(|error| match &error.source_text {
            Some(_) => error,
            None => self.error(design.span(), error.message.clone(), error.fix.as_deref()),
        })?;
        if let Some(address) = source.get_ref().strip_prefix(PART)
            && !address
                .rsplit_once(':')
                .is_some_and(|(host, port)| !host.is_empty() && port.parse().is_ok_and(|port: u16| port > 0))
        {
            let fix = "write source = \"robot:HOST:PORT\", where `dermis robot run --share HOST:PORT` reads the skin";
            return Err(self.error(source.span(), format!("`{address}` is no address"), Some(fix)));
        }
        let is_folder = |method: &String| method.contains(['/', '\\']);
        Ok(WornSkin {
            name: name.get_ref().clone(),
            design: design_path,
            design_sha256: loaded.sha256(),
            link: link.as_ref().map_or_else(|| name.get_ref().clone(), |link| link.get_ref().clone()),
            origin: origin.as_ref().map_or(Ok(Pose::IDENTITY), |origin| self.origin(origin))?,
            source: source.get_ref().clone(),
            serial: *serial,
            method: method.as_ref().map(|method| match method.get_ref() {
                folder if is_folder(folder) => self.beside(folder),
                name => name.clone(),
            }),
            required: *required,
            link_index,
        })
    }

    /// A file of the robot's folder.
    fn beside(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
    }

    fn origin(&self, table: &Spanned<OriginTable>) -> Result<Pose, DesignError> {
        let OriginTable { xyz_m, rpy_rad, quaternion } = *table.get_ref();
        if xyz_m.iter().any(|value| !(-FARTHEST_M..=FARTHEST_M).contains(value)) {
            let fix = format!("xyz_m is in metres, each at most {FARTHEST_M}");
            return Err(self.error(table.span(), "the origin is not on the link".into(), Some(&fix)));
        }
        if let Some(wrong) =
            rpy_rad.iter().flatten().find_map(|angle_rad| beyond_a_turn("an angle of rpy_rad", *angle_rad))
        {
            return Err(self.error(table.span(), wrong, None));
        }
        match (rpy_rad, quaternion) {
            (Some(_), Some(_)) => {
                let fix = "give one of rpy_rad and quaternion";
                Err(self.error(table.span(), "the origin has two rotations".into(), Some(fix)))
            }
            (_, Some(quaternion)) => Pose::from_xyz_quaternion(xyz_m, quaternion).ok_or_else(|| {
                let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
                let fix = "its length must be 1, in the order x, y, z, w";
                self.error(table.span(), format!("the quaternion has the length {length:.3}"), Some(fix))
            }),
            (rpy, None) => Ok(Pose::from_xyz_rpy(xyz_m, rpy.unwrap_or_default())),
        }
    }

    fn check_name(&self, name: &Spanned<String>, of: &str) -> Result<(), DesignError> {
        let is_plain = |character: char| character.is_alphanumeric() || "_-.".contains(character);
        if (1..=100).contains(&name.get_ref().len()) && name.get_ref().chars().all(is_plain) {
            return Ok(());
        }
        let fix = "write 1 to 100 letters, digits, `_`, `-` and `.`";
        Err(self.error(name.span(), format!("{:?} is no name of {of}", name.get_ref()), Some(fix)))
    }

    /// Refuses skins that share a name or a device.
    fn check_skins(&self, skins: &[Spanned<SkinTable>]) -> Result<(), DesignError> {
        if skins.is_empty() {
            return Err(self.error(0..0, "the robot has no skin".into(), Some("write a [[skin]]")));
        }
        for (index, skin) in skins.iter().enumerate() {
            let SkinTable { name, source, serial, .. } = skin.get_ref();
            for other in skins[..index].iter().map(Spanned::get_ref) {
                if other.name.get_ref() == name.get_ref() {
                    let message = format!("two skins are called `{}`", name.get_ref());
                    return Err(self.error(name.span(), message, None));
                }
                let is_device = source.get_ref() != "emulate" && !source.get_ref().starts_with(PART);
                if is_device && other.source.get_ref() == source.get_ref() {
                    let message = format!("`{}` and `{}` read one device", other.name.get_ref(), name.get_ref());
                    return Err(self.error(source.span(), message, Some("each skin has a device of its own")));
                }
                if serial.is_some() && other.serial == *serial {
                    let message = format!("`{}` and `{}` have one serial number", other.name.get_ref(), name.get_ref());
                    return Err(self.error(skin.span(), message, Some("each device has a serial number of its own")));
                }
            }
        }
        Ok(())
    }

    fn rule(&self, table: &Spanned<RuleTable>, skins: &[WornSkin]) -> Result<Rule, DesignError> {
        let RuleTable { name, on, when, unknown, clear_s, self_touch } = table.get_ref();
        let mut chosen: Vec<usize> = Vec::new();
        for pattern in on {
            let found = skins.iter().enumerate().filter(|(_, skin)| matches(pattern.get_ref(), &skin.name));
            let before = chosen.len();
            chosen.extend(found.map(|(index, _)| index));
            if chosen.len() == before {
                let near = closest_name(pattern.get_ref(), skins.iter().map(|skin| skin.name.as_str()));
                let fix = near.map(|near| format!("did you mean `{near}`?"));
                return Err(self.error(
                    pattern.span(),
                    format!("no skin is called `{}`", pattern.get_ref()),
                    fix.as_deref(),
                ));
            }
        }
        chosen.sort_unstable();
        chosen.dedup();
        if chosen.is_empty() {
            return Err(self.error(
                name.span(),
                format!("the rule `{}` is about no skin", name.get_ref()),
                Some("write on = [\"*\"] for all"),
            ));
        }
        if let When::ForceN(force_n) = when.get_ref()
            && !(*force_n > 0.0 && force_n.is_finite())
        {
            return Err(self.error(when.span(), format!("a force of {force_n} N"), Some("above 0")));
        }
        Ok(Rule {
            name: name.get_ref().clone(),
            skins: chosen,
            when: *when.get_ref(),
            unknown: *unknown,
            clear_s: self.within(clear_s, "clear_s", 0.0..=60.0)?,
            ignores_self: *self_touch == SelfTouch::Ignore,
        })
    }
}

/// Whether an address ends with a port.
fn has_port(address: &str) -> bool {
    address.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok_and(|port| port > 0))
}

/// Whether a name matches a pattern, in which `*` is any text.
fn matches(pattern: &str, name: &str) -> bool {
    let Some((before, parts)) = pattern.split_once('*') else { return pattern == name };
    let Some(mut rest) = name.strip_prefix(before) else { return false };
    let mut parts: Vec<&str> = parts.split('*').collect();
    let last = parts.pop().unwrap_or_default();
    // The first place of each part leaves most for those after it.
    let is_found = parts.into_iter().all(|part| {
        let found = rest.find(part);
        rest = found.map_or(rest, |at| &rest[at + part.len()..]);
        found.is_some()
    });
    is_found && rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn stars_are_any_text() {
        for (pattern, name, expected) in [
            ("arm", "arm", true),
            ("arm", "arms", false),
            ("*", "", true),
            ("a*m*", "arm_1", true),
            ("*a*a", "a", false),
            ("a*a", "a", false),
            ("*rm*1", "arm_1", true),
            ("*_b", "arm_a", false),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }
}
