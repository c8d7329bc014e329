//! The standard messages, as ROS 2 has had them since Humble. Units are those of REP 103: m, N, N m, s, rad.

use crate::sinks::ros2::Message;
use dermis::pipeline::Timestamp;
use serde::{Deserialize, Serialize};

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
    /// A moment since 1970.
    #[derive(Copy)]
    Time = "builtin_interfaces/msg/Time" {
        /// Whole seconds.
        sec: i32,
        /// Nanoseconds on top of them.
        nanosec: u32,
    }
    /// A span of time.
    #[derive(Copy)]
    Duration = "builtin_interfaces/msg/Duration" {
        /// Whole seconds.
        sec: i32,
        /// Nanoseconds on top of them.
        nanosec: u32,
    }
    /// When and in which frame of reference.
    Header = "std_msgs/msg/Header" {
        /// When it was measured.
        stamp: Time,
        /// Frame of reference.
        frame_id: String,
    }
    /// A text.
    Text = "std_msgs/msg/String" {
        /// The text.
        data: String,
    }
    /// A side of an array.
    MultiArrayDimension = "std_msgs/msg/MultiArrayDimension" {
        /// What it is.
        label: String,
        /// How many.
        size: u32,
        /// Values from here to the end of the innermost side.
        stride: u32,
    }
    /// The sides of an array.
    MultiArrayLayout = "std_msgs/msg/MultiArrayLayout" {
        /// Outermost first.
        dim: Vec<MultiArrayDimension>,
        /// Values before the first.
        data_offset: u32,
    }
    /// An array of bytes.
    UInt8MultiArray = "std_msgs/msg/UInt8MultiArray" {
        /// Its sides.
        layout: MultiArrayLayout,
        /// The bytes.
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// A colour, each part from 0 to 1.
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
    /// A picture, row after row.
    Image = "sensor_msgs/msg/Image" {
        /// When and where.
        header: Header,
        /// Rows.
        height: u32,
        /// Columns.
        width: u32,
        /// What a pixel is, such as `32FC1`.
        encoding: String,
        /// Whether numbers have their highest byte first.
        is_bigendian: u8,
        /// Bytes of a row.
        step: u32,
        /// The rows.
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// A compressed picture; only markers' textures have it, and these are empty here.
    CompressedImage = "sensor_msgs/msg/CompressedImage" {
        /// When and where.
        header: Header,
        /// How it is compressed.
        format: String,
        /// The file.
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// A number of each point of a cloud.
    PointField = "sensor_msgs/msg/PointField" {
        /// Its name.
        name: String,
        /// Bytes from the point's first.
        offset: u32,
        /// 1 to 8: int8, uint8, int16, uint16, int32, uint32, float32, float64.
        datatype: u8,
        /// How many.
        count: u32,
    }
    /// Points, and whatever numbers each has.
    PointCloud2 = "sensor_msgs/msg/PointCloud2" {
        /// When and where.
        header: Header,
        /// Rows: 1 where the points have no order.
        height: u32,
        /// Points of a row.
        width: u32,
        /// What a point is.
        fields: Vec<PointField>,
        /// Whether numbers have their highest byte first.
        is_bigendian: bool,
        /// Bytes of a point.
        point_step: u32,
        /// Bytes of a row.
        row_step: u32,
        /// The points.
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
        /// Whether every point is known.
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
    /// A rotation; no rotation is `w` = 1.
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
    /// Where something is, and how it is turned.
    #[derive(Copy)]
    Pose = "geometry_msgs/msg/Pose" {
        /// Where.
        position: Point,
        /// How it is turned.
        orientation: Quaternion,
    }
    /// A force and a torque.
    #[derive(Copy)]
    Wrench = "geometry_msgs/msg/Wrench" {
        /// N.
        force: Vector3,
        /// N m.
        torque: Vector3,
    }
    /// A force and a torque, when and where.
    WrenchStamped = "geometry_msgs/msg/WrenchStamped" {
        /// When and where.
        header: Header,
        /// What acts.
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
        /// What it holds.
        #[serde(with = "serde_bytes")]
        data: Vec<u8>,
    }
    /// Something to draw.
    Marker = "visualization_msgs/msg/Marker" {
        /// When and where.
        header: Header,
        /// With the id it says which marker this is.
        ns: String,
        /// Number within `ns`.
        id: i32,
        /// What to draw.
        r#type: i32,
        /// 0 to draw it, 2 to take it away, 3 to take all away.
        action: i32,
        /// Where.
        pose: Pose,
        /// How large, m; of an arrow between points the shaft's and the head's diameters and the head's length.
        scale: Vector3,
        /// Its colour.
        color: ColorRGBA,
        /// How long it stays; 0 is for ever.
        lifetime: Duration,
        /// Whether it moves with its frame of reference.
        frame_locked: bool,
        /// Points, of what has some.
        points: Vec<Point>,
        /// A colour for each point.
        colors: Vec<ColorRGBA>,
        /// Not used here.
        texture_resource: String,
        /// Not used here.
        texture: CompressedImage,
        /// Not used here.
        uv_coordinates: Vec<UVCoordinate>,
        /// The text, of a text.
        text: String,
        /// Not used here.
        mesh_resource: String,
        /// Not used here.
        mesh_file: MeshFile,
        /// Not used here.
        mesh_use_embedded_materials: bool,
    }
    /// Things to draw.
    MarkerArray = "visualization_msgs/msg/MarkerArray" {
        /// The things.
        markers: Vec<Marker>,
    }
    /// A value with its name.
    KeyValue = "diagnostic_msgs/msg/KeyValue" {
        /// Its name.
        key: String,
        /// The value.
        value: String,
    }
    /// How a part is.
    DiagnosticStatus = "diagnostic_msgs/msg/DiagnosticStatus" {
        /// 0 well, 1 a warning, 2 an error, 3 nothing heard of it.
        level: u8,
        /// Which part.
        name: String,
        /// How it is.
        message: String,
        /// Which device.
        hardware_id: String,
        /// Its values.
        values: Vec<KeyValue>,
    }
    /// How the parts are.
    DiagnosticArray = "diagnostic_msgs/msg/DiagnosticArray" {
        /// When.
        header: Header,
        /// The parts.
        status: Vec<DiagnosticStatus>,
    }
}

impl Pose {
    /// A place, without rotation.
    pub fn at([x, y, z]: [f64; 3]) -> Self {
        Pose { position: Point { x, y, z }, orientation: Quaternion { w: 1.0, ..Quaternion::default() } }
    }
}

const NS_PER_S: u64 = 1_000_000_000;

impl From<Timestamp> for Time {
    /// Seconds beyond the year 2038 do not fit, and are cut to the last that does.
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
