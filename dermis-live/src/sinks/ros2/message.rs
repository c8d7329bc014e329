//! The standard messages, as in ROS 2 since Humble. Units as in REP 103: m, N, N m, s, rad.

use crate::sinks::ros2::Message;
use dermis::pipeline::Timestamp;
use serde::{Deserialize, Serialize, Serializer};

/// Writes an array of bytes as such, not number by number.
fn as_bytes<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

macro_rules! messages {
    ($($(#[$about:meta])* $name:ident = $type_name:literal { $($(#[$field_about:meta])* $field:ident: $kind:ty,)* })*) => {$(
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        pub struct $name {
            $($(#[$field_about])* pub $field: $kind,)*
        }

        impl Message for $name {
            const TYPE: &'static str = $type_name;
        }
    )*};
}

messages! {
    /// A time since 1970.
    #[derive(Copy)]
    Time = "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        sec: i32,
        /// Additional nanoseconds.
        nanosec: u32,
    }
    /// A duration.
    #[derive(Copy)]
    Duration = "builtin_interfaces/msg/Duration" {
        /// Whole seconds.
        sec: i32,
        /// Additional nanoseconds.
        nanosec: u32,
    }
    /// Time and frame of reference.
    Header = "std_msgs/msg/Header" {
        /// Time of measurement.
        stamp: Time,
        /// Frame of reference.
        frame_id: String,
    }
    /// A text.
    Text = "std_msgs/msg/String" {
        /// The text.
        data: String,
    }
    /// A dimension of an array.
    MultiArrayDimension = "std_msgs/msg/MultiArrayDimension" {
        /// Its meaning.
        label: String,
        /// Its size.
        size: u32,
        /// Number of values from here to the end of the innermost dimension.
        stride: u32,
    }
    /// The dimensions of an array.
    MultiArrayLayout = "std_msgs/msg/MultiArrayLayout" {
        /// Outermost first.
        dim: Vec<MultiArrayDimension>,
        /// Number of values before the first one.
        data_offset: u32,
    }
    /// An array of bytes.
    UInt8MultiArray = "std_msgs/msg/UInt8MultiArray" {
        /// Its dimensions.
        layout: MultiArrayLayout,
        /// The bytes.
        #[serde(serialize_with = "as_bytes")]
        data: Vec<u8>,
    }
    /// A colour; each component from 0 to 1.
    #[derive(Copy)]
    ColorRGBA = "std_msgs/msg/ColorRGBA" {
        /// Red.
        r: f32,
        /// Green.
        g: f32,
        /// Blue.
        b: f32,
        /// Opacity.
        a: f32,
    }
    /// An image, row by row.
    Image = "sensor_msgs/msg/Image" {
        /// Time and frame of reference.
        header: Header,
        /// Rows.
        height: u32,
        /// Columns.
        width: u32,
        /// Encoding of a pixel, such as `32FC1`.
        encoding: String,
        /// Whether numbers are big-endian.
        is_bigendian: u8,
        /// Bytes per row.
        step: u32,
        /// The rows.
        #[serde(serialize_with = "as_bytes")]
        data: Vec<u8>,
    }
    /// A compressed image; only textures of markers use it, and these are empty here.
    CompressedImage = "sensor_msgs/msg/CompressedImage" {
        /// Time and frame of reference.
        header: Header,
        /// The compression format.
        format: String,
        /// The file.
        #[serde(serialize_with = "as_bytes")]
        data: Vec<u8>,
    }
    /// A field of each point of a cloud.
    PointField = "sensor_msgs/msg/PointField" {
        /// Its name.
        name: String,
        /// Offset in bytes from the start of the point.
        offset: u32,
        /// 1 to 8: int8, uint8, int16, uint16, int32, uint32, float32, float64.
        datatype: u8,
        /// Number of elements.
        count: u32,
    }
    /// A point cloud, with any fields per point.
    PointCloud2 = "sensor_msgs/msg/PointCloud2" {
        /// Time and frame of reference.
        header: Header,
        /// Rows: 1 for unordered points.
        height: u32,
        /// Points per row.
        width: u32,
        /// Fields of a point.
        fields: Vec<PointField>,
        /// Whether numbers are big-endian.
        is_bigendian: bool,
        /// Bytes per point.
        point_step: u32,
        /// Bytes per row.
        row_step: u32,
        /// The points.
        #[serde(serialize_with = "as_bytes")]
        data: Vec<u8>,
        /// Whether all points are valid.
        is_dense: bool,
    }
    /// A point.
    #[derive(Copy)]
    Point = "geometry_msgs/msg/Point" {
        /// m.
        x: f64,
        /// m.
        y: f64,
        /// m.
        z: f64,
    }
    /// A vector.
    #[derive(Copy)]
    Vector3 = "geometry_msgs/msg/Vector3" {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }
    /// A rotation; `w` = 1 is the identity.
    #[derive(Copy)]
    Quaternion = "geometry_msgs/msg/Quaternion" {
        /// First imaginary part.
        x: f64,
        /// Second imaginary part.
        y: f64,
        /// Third imaginary part.
        z: f64,
        /// Real part.
        w: f64,
    }
    /// A position and an orientation.
    #[derive(Copy)]
    Pose = "geometry_msgs/msg/Pose" {
        /// Position.
        position: Point,
        /// Orientation.
        orientation: Quaternion,
    }
    /// The pose of a frame in another one.
    #[derive(Copy)]
    Transform = "geometry_msgs/msg/Transform" {
        /// m.
        translation: Vector3,
        /// The rotation.
        rotation: Quaternion,
    }
    /// The pose of the frame `child_frame_id` in that of the header.
    TransformStamped = "geometry_msgs/msg/TransformStamped" {
        /// Time and outer frame.
        header: Header,
        /// The inner frame.
        child_frame_id: String,
        /// Its pose.
        transform: Transform,
    }
    /// Poses of frames.
    TransformArray = "tf2_msgs/msg/TFMessage" {
        /// A frame each.
        transforms: Vec<TransformStamped>,
    }
    /// Positions of joints.
    JointState = "sensor_msgs/msg/JointState" {
        /// Time of measurement.
        header: Header,
        /// Names of the joints.
        name: Vec<String>,
        /// rad or m.
        position: Vec<f64>,
        /// rad/s or m/s; may be empty.
        velocity: Vec<f64>,
        /// N m or N; may be empty.
        effort: Vec<f64>,
    }
    /// A force and a torque.
    #[derive(Copy)]
    Wrench = "geometry_msgs/msg/Wrench" {
        /// N.
        force: Vector3,
        /// N m.
        torque: Vector3,
    }
    /// A force and a torque, with time and frame of reference.
    WrenchStamped = "geometry_msgs/msg/WrenchStamped" {
        /// Time and frame of reference.
        header: Header,
        /// The force and the torque.
        wrench: Wrench,
    }
    /// A point of a texture.
    #[derive(Copy)]
    UVCoordinate = "visualization_msgs/msg/UVCoordinate" {
        /// Across.
        u: f32,
        /// Up.
        v: f32,
    }
    /// A mesh file.
    MeshFile = "visualization_msgs/msg/MeshFile" {
        /// Its name.
        filename: String,
        /// Its contents.
        #[serde(serialize_with = "as_bytes")]
        data: Vec<u8>,
    }
    /// An object to draw.
    Marker = "visualization_msgs/msg/Marker" {
        /// Time and frame of reference.
        header: Header,
        /// Namespace; with the id, it identifies the marker.
        ns: String,
        /// Number within `ns`.
        id: i32,
        /// What to draw.
        r#type: i32,
        /// 0 to draw it, 2 to delete it, 3 to delete all.
        action: i32,
        /// Position and orientation.
        pose: Pose,
        /// Size, m; for an arrow between points: the diameters of the shaft and of the head, and the length of the
        /// head.
        scale: Vector3,
        /// Its colour.
        color: ColorRGBA,
        /// Lifetime; 0 is unlimited.
        lifetime: Duration,
        /// Whether it moves with its frame of reference.
        frame_locked: bool,
        /// Points, for the types that use them.
        points: Vec<Point>,
        /// A colour for each point.
        colors: Vec<ColorRGBA>,
        /// Not used here.
        texture_resource: String,
        /// Not used here.
        texture: CompressedImage,
        /// Not used here.
        uv_coordinates: Vec<UVCoordinate>,
        /// The text of a text marker.
        text: String,
        /// Not used here.
        mesh_resource: String,
        /// Not used here.
        mesh_file: MeshFile,
        /// Not used here.
        mesh_use_embedded_materials: bool,
    }
    /// Objects to draw.
    MarkerArray = "visualization_msgs/msg/MarkerArray" {
        /// The objects.
        markers: Vec<Marker>,
    }
    /// A named value.
    KeyValue = "diagnostic_msgs/msg/KeyValue" {
        /// Its name.
        key: String,
        /// The value.
        value: String,
    }
    /// The status of a component.
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus" {
        /// 0 OK, 1 warning, 2 error, 3 stale.
        level: u8,
        /// Which component.
        name: String,
        /// A summary.
        message: String,
        /// Which device.
        hardware_id: String,
        /// Its values.
        values: Vec<KeyValue>,
    }
    /// The status of the components.
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
        /// Time.
        header: Header,
        /// The components.
        status: Vec<DiagnosticStatus>,
    }
}

impl Pose {
    /// A position without rotation.
    pub(crate) fn at([x, y, z]: [f64; 3]) -> Self {
        Pose { position: Point { x, y, z }, orientation: Quaternion { w: 1.0, ..Quaternion::default() } }
    }
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Vector3 { x, y, z }
    }
}

const NS_PER_S: u64 = 1_000_000_000;

impl From<Timestamp> for Time {
    /// Seconds after the year 2038 do not fit and saturate.
    fn from(moment: Timestamp) -> Self {
        let sec = i32::try_from(moment.unix_ns / NS_PER_S).unwrap_or(i32::MAX);
        Time { sec, nanosec: (moment.unix_ns % NS_PER_S) as u32 }
    }
}

impl From<std::time::Duration> for Duration {
    fn from(time: std::time::Duration) -> Self {
        Duration { sec: i32::try_from(time.as_secs()).unwrap_or(i32::MAX), nanosec: time.subsec_nanos() }
    }
}
