//! Shapes for RViz and Foxglove.

use crate::builtin_interfaces::Duration;
use crate::geometry_msgs::{Point, Pose, Vector3};
use crate::sensor_msgs::CompressedImage;
use crate::std_msgs::{ColorRGBA, Header};

messages! { "visualization_msgs";
    /// A place in a texture.
    UVCoordinate {
        /// 0 to 1.
        u: f32,
        /// 0 to 1.
        v: f32,
    }
    /// A mesh that travels with the marker.
    MeshFile {
        /// Its name.
        filename: String,
        /// The file.
        data: Vec<u8>,
    }
    /// One shape.
    Marker {
        /// frame_id: the frame of the pose and the points.
        header: Header,
        /// With `id`, what a later marker replaces.
        ns: String,
        /// See above.
        id: i32,
        /// 0 arrow, 1 cube, 2 sphere, 3 cylinder, 4 line strip, 5 line list, …
        r#type: i32,
        /// 0 add or change, 2 delete, 3 delete all.
        action: i32,
        /// Where.
        pose: Pose,
        /// Size, m.
        scale: Vector3,
        /// Colour.
        color: ColorRGBA,
        /// How long it is shown; 0: until it is replaced.
        lifetime: Duration,
        /// Moves with its frame.
        frame_locked: bool,
        /// Of arrows (start, end) and lines.
        points: Vec<Point>,
        /// One for each point, or none.
        colors: Vec<ColorRGBA>,
        /// Of textured shapes.
        texture_resource: String,
        /// Of textured shapes.
        texture: CompressedImage,
        /// Of textured shapes.
        uv_coordinates: Vec<UVCoordinate>,
        /// Of text.
        text: String,
        /// Of meshes.
        mesh_resource: String,
        /// Of meshes.
        mesh_file: MeshFile,
        /// Of meshes.
        mesh_use_embedded_materials: bool,
    }
    /// Shapes that belong together.
    MarkerArray {
        /// Them.
        markers: Vec<Marker>,
    }
}
