//! The topics, and their messages for a frame.

use crate::LiveFrame;
use crate::sinks::ros2::{DiagnosticArray, MarkerArray, Text, UInt8MultiArray};
use crate::sinks::ros2::{Header, Image, Message, PointCloud2, PointField, Time, Wrench, WrenchStamped};
use dermis::contact::{Contact, Field, FieldKind};
use dermis::image::PixelSpace;
use dermis::pipeline::{Timestamp, TrackedContact};
use dermis::skin::Skin;
use std::sync::{Arc, LazyLock};

/// A topic; its value is its index in [`Topic::all`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Topic {
    /// The values of a frame, ohm.
    Frame,
    /// The image.
    Image,
    /// The contacts.
    Contacts,
    /// The total force and torque on the skin.
    Wrench,
    /// The contacts as markers.
    Markers,
    /// The state of the skin and its instrument.
    Diagnostics,
    /// Whether contacts can be relied on, as JSON; in recordings when it changes.
    Validity,
    /// The message of the device; in recordings only.
    Wire,
    /// Commands, notices and hellos as JSON; in recordings only.
    Events,
}

/// Each topic with its name within a namespace and the type of its messages.
const TOPICS: [(Topic, &str, &str); 9] = [
    (Topic::Frame, "dermis/frame", Image::TYPE),
    (Topic::Image, "dermis/image", Image::TYPE),
    (Topic::Contacts, "dermis/contacts", PointCloud2::TYPE),
    (Topic::Wrench, "dermis/wrench", WrenchStamped::TYPE),
    (Topic::Markers, "dermis/markers", MarkerArray::TYPE),
    (Topic::Diagnostics, "diagnostics", DiagnosticArray::TYPE),
    (Topic::Validity, "dermis/validity", Text::TYPE),
    (Topic::Wire, "dermis/wire", UInt8MultiArray::TYPE),
    (Topic::Events, "dermis/events", Text::TYPE),
];

impl Topic {
    /// The number of topics.
    pub const COUNT: usize = TOPICS.len();

    /// All topics.
    pub fn all() -> impl Iterator<Item = Topic> {
        TOPICS.iter().map(|(topic, ..)| *topic)
    }

    /// Its name within a namespace.
    pub(crate) fn name(self) -> &'static str {
        TOPICS[self as usize].1
    }

    /// Its absolute name; diagnostics are one topic for a whole robot, whatever the namespace (`""` or `/left_arm`).
    pub(crate) fn absolute(self, namespace: &str) -> String {
        let namespace = if self == Topic::Diagnostics { "" } else { namespace.trim_end_matches('/') };
        format!("{namespace}/{}", self.name())
    }

    /// Its absolute name for one of the skins of a robot: `/dermis/forearm/contacts`.
    #[cfg(feature = "ros2")]
    pub(crate) fn of_skin(self, namespace: &str, skin: &str) -> String {
        match self.name().strip_prefix("dermis/") {
            Some(name) => format!("{}/dermis/{skin}/{name}", namespace.trim_end_matches('/')),
            None => self.absolute(namespace),
        }
    }

    /// The type of its messages.
    pub(crate) fn type_name(self) -> &'static str {
        TOPICS[self as usize].2
    }
}

/// The frame of reference of the positions, and its pixels.
#[derive(Debug, Clone)]
pub struct Reference {
    /// Name of the frame of reference: that of the body in the design.
    pub frame_id: String,
    /// Name in diagnostics: `dermis`, or `dermis SKIN` of a skin of a robot.
    pub name: String,
    /// The pixels of the image.
    pub space: Arc<PixelSpace>,
}

impl Reference {
    /// That of a skin.
    pub fn of(skin: &Skin, frame_id: String) -> Self {
        Reference { frame_id, name: "dermis".into(), space: Arc::clone(skin.pixels()) }
    }

    /// The header of a measurement at `moment`.
    pub(crate) fn header(&self, moment: Timestamp) -> Header {
        Header { stamp: Time::from(moment), frame_id: self.frame_id.clone() }
    }

    /// Rows and columns of the image; one row if the pixels have no grid.
    pub fn picture(&self) -> [usize; 2] {
        self.space.grid.unwrap_or([1, self.space.len()])
    }
}

/// Decides which messages are due that are not sent with every frame.
///
/// Diagnostics are sent about once per second, and when the state of an electrode or the validity changes; markers while there are
/// contacts, and once more to delete them.
#[derive(Debug, Clone, Default)]
pub struct Due {
    told_at: Option<Timestamp>,
    diagnosed: Vec<dermis::pipeline::ElectrodeState>,
    drawn: Option<bool>,
    validity: Option<&'static str>,
    diagnosed_validity: Option<&'static str>,
}

impl Due {
    /// Whether markers are due with this frame.
    pub(crate) fn markers(&mut self, frame: &LiveFrame) -> bool {
        let drawn = self.drawn.replace(!frame.result.contacts.is_empty());
        !frame.result.contacts.is_empty() || drawn != Some(false)
    }

    /// Whether the validity is due with this frame, where it is sent on changes only.
    pub(crate) fn validity(&mut self, frame: &LiveFrame) -> bool {
        let name = frame.result.validity.name();
        self.validity.replace(name) != Some(name)
    }

    /// Whether diagnostics are due with this frame.
    pub(crate) fn diagnostics(&mut self, frame: &LiveFrame) -> bool {
        let states = || frame.result.health.electrodes.iter().map(|electrode| electrode.state);
        let long_ago = self.told_at.is_none_or(|at| !(0.0..1.0).contains(&frame.result.measured_at.seconds_since(at)));
        let name = frame.result.validity.name();
        let has_changed = self.diagnosed_validity.replace(name) != Some(name);
        let due = long_ago || has_changed || !states().eq(self.diagnosed.iter().copied());
        if due {
            self.told_at = Some(frame.result.measured_at);
            self.diagnosed.clear();
            self.diagnosed.extend(states());
        }
        due
    }
}

/// The values of a frame, ohm, as one row.
pub fn frame(reference: &Reference, live: &LiveFrame) -> Image {
    let values = live.result.values_ohm.iter().map(|&value| value as f32);
    picture(reference.header(live.result.measured_at), [1, live.result.values_ohm.len()], values)
}

/// The image, `NaN` outside the body. Rows and columns as in all images: row 0 at z = 0 of a cylinder, at the lowest y
/// of a flat skin.
pub fn image(reference: &Reference, live: &LiveFrame) -> Image {
    let [rows, columns] = reference.picture();
    let mut values = vec![f32::NAN; rows * columns];
    for (&position, &value) in reference.space.position_in_grid.iter().zip(&live.result.image) {
        if let Some(place) = values.get_mut(position) {
            *place = value;
        }
    }
    picture(reference.header(live.result.measured_at), [rows, columns], values.into_iter())
}

fn picture(header: Header, [rows, columns]: [usize; 2], values: impl Iterator<Item = f32>) -> Image {
    let mut data = Vec::with_capacity(rows * columns * size_of::<f32>());
    for value in values {
        data.extend_from_slice(&value.to_le_bytes());
    }
    Image {
        header,
        height: rows as u32,
        width: columns as u32,
        encoding: "32FC1".into(),
        is_bigendian: 0,
        step: (columns * size_of::<f32>()) as u32,
        data,
    }
}

/// A number of a contact in point clouds and in the tables of recordings.
pub(crate) struct ContactColumn {
    /// Its field in a point cloud.
    pub ros: &'static str,
    /// Its column in tables.
    pub column: &'static str,
    /// Whether it is a uint32, the lowest bits of a count, and not a float32.
    pub is_count: bool,
    number: Box<dyn Fn(&TrackedContact) -> f64 + Send + Sync>,
}

/// The numbers of a contact in point clouds: the coordinates first, where programs expect them, and counts last.
pub(crate) static CONTACT_COLUMNS: LazyLock<Vec<ContactColumn>> = LazyLock::new(|| {
    let of_frame = columns(&Contact::FIELDS, |tracked| &tracked.contact);
    let mut columns: Vec<ContactColumn> = of_frame.chain(columns(&TrackedContact::FIELDS, |tracked| tracked)).collect();
    columns.sort_by_key(|column| column.is_count);
    columns
});

fn columns<T: 'static>(
    fields: &'static [Field<T>],
    part: fn(&TrackedContact) -> &T,
) -> impl Iterator<Item = ContactColumn> {
    let column = move |field: &'static Field<T>, index: usize| ContactColumn {
        ros: field.ros[index],
        column: field.columns[index],
        is_count: field.kind == FieldKind::Count,
        number: Box::new(move |tracked: &TrackedContact| field.numbers(part(tracked)).nth(index).unwrap_or(f64::NAN)),
    };
    fields.iter().flat_map(move |field| (0..field.ros.len()).map(move |index| column(field, index)))
}

/// The validity of a frame as JSON, as in lines of JSON: `{"state": "ok"}`.
pub fn validity(live: &LiveFrame) -> Text {
    Text { data: serde_json::to_string(&live.result.validity).expect("a validity is JSON") }
}

/// The contacts as points, the oldest first.
pub fn contacts(reference: &Reference, live: &LiveFrame) -> PointCloud2 {
    cloud(reference.header(live.result.measured_at), live.result.contacts.iter().map(|tracked| (tracked, [])), [])
}

/// Contacts as points, with further whole numbers.
pub(super) fn cloud<'a, const N: usize>(
    header: Header,
    contacts: impl Iterator<Item = (&'a TrackedContact, [u32; N])>,
    further: [&str; N],
) -> PointCloud2 {
    const FIELD_BYTES: usize = 4;
    const FLOAT32: u8 = 7;
    const UINT32: u8 = 6;
    let columns = CONTACT_COLUMNS.iter().map(|column| (column.ros, column.is_count));
    let field = |(index, (name, is_count)): (usize, (&str, bool))| PointField {
        name: name.into(),
        offset: (index * FIELD_BYTES) as u32,
        datatype: if is_count { UINT32 } else { FLOAT32 },
        count: 1,
    };
    let fields: Vec<PointField> = columns.chain(further.map(|name| (name, true))).enumerate().map(field).collect();
    let (mut data, mut width) = (Vec::new(), 0);
    for (tracked, numbers) in contacts {
        width += 1;
        data.extend(CONTACT_COLUMNS.iter().flat_map(|column| match (column.number)(tracked) {
            count if column.is_count => (count as u64 as u32).to_le_bytes(),
            number => (number as f32).to_le_bytes(),
        }));
        data.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }
    PointCloud2 {
        header,
        height: 1,
        width,
        is_bigendian: false,
        point_step: (fields.len() * FIELD_BYTES) as u32,
        fields,
        row_step: data.len() as u32,
        data,
        is_dense: true,
    }
}

/// The force on the skin and its torque about the frame's origin: F = sum of -n f, M = sum of r x (-n f) over the
/// contacts whose force f is known. All zero without a contact; all `NaN` where there are contacts and no force is
/// known, and where the frame is invalid or stale.
pub fn wrench(reference: &Reference, live: &LiveFrame) -> WrenchStamped {
    let known =
        live.result.contacts.iter().map(|tracked| &tracked.contact).filter(|contact| contact.force_n.is_finite());
    let without_forces = !live.result.contacts.is_empty() && known.clone().next().is_none();
    let unknown = without_forces || !live.result.validity.is_usable();
    let (mut force_n, mut torque_nm) =
        ([if unknown { f64::NAN } else { 0.0 }; 3], [if unknown { f64::NAN } else { 0.0 }; 3]);
    for contact in known {
        let push = contact.normal.map(|part| -part * contact.force_n);
        let turn = cross(contact.position_m, push);
        for axis in 0..3 {
            force_n[axis] += push[axis];
            torque_nm[axis] += turn[axis];
        }
    }
    let wrench = Wrench { force: force_n.into(), torque: torque_nm.into() };
    WrenchStamped { header: reference.header(live.result.measured_at), wrench }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
