//! Points, orientations, velocities, forces.

use crate::Covariance;
use crate::std_msgs::Header;

messages! { "geometry_msgs";
    /// A free vector.
    #[derive(Copy)]
    Vector3 {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }
    /// A point, m.
    #[derive(Copy)]
    Point {
        /// Along x, m.
        x: f64,
        /// Along y, m.
        y: f64,
        /// Along z, m.
        z: f64,
    }
    /// A unit quaternion. The default is all zeros, which is no orientation: use [`Quaternion::IDENTITY`].
    #[derive(Copy)]
    Quaternion {
        /// First component of the vector part.
        x: f64,
        /// Second component of the vector part.
        y: f64,
        /// Third component of the vector part.
        z: f64,
        /// The scalar part.
        w: f64,
    }
    /// Where and how oriented.
    #[derive(Copy)]
    Pose {
        /// m.
        position: Point,
        /// A unit quaternion.
        orientation: Quaternion,
    }
    /// A pose with its frame and time.
    PoseStamped {
        /// Time and frame.
        header: Header,
        /// The pose.
        pose: Pose,
    }
    /// Velocity.
    #[derive(Copy)]
    Twist {
        /// m/s.
        linear: Vector3,
        /// rad/s.
        angular: Vector3,
    }
    /// A velocity with its frame and time.
    TwistStamped {
        /// Time and frame.
        header: Header,
        /// The velocity.
        twist: Twist,
    }
    /// Force and moment.
    #[derive(Copy)]
    Wrench {
        /// N.
        force: Vector3,
        /// Nm.
        torque: Vector3,
    }
    /// A wrench with its frame and time.
    WrenchStamped {
        /// Time and frame.
        header: Header,
        /// The wrench.
        wrench: Wrench,
    }
    /// A pose and how sure it is.
    #[derive(Copy)]
    PoseWithCovariance {
        /// The pose.
        pose: Pose,
        /// x, y, z, then rotation about x, y, z; m and rad.
        covariance: Covariance,
    }
    /// A velocity and how sure it is.
    #[derive(Copy)]
    TwistWithCovariance {
        /// The velocity.
        twist: Twist,
        /// x, y, z, then rotation about x, y, z; m/s and rad/s.
        covariance: Covariance,
    }
    /// From one frame to another.
    #[derive(Copy)]
    Transform {
        /// m.
        translation: Vector3,
        /// A unit quaternion.
        rotation: Quaternion,
    }
    /// The pose of `child_frame_id` in the header's frame.
    TransformStamped {
        /// Time and parent frame.
        header: Header,
        /// The child frame.
        child_frame_id: String,
        /// The child's pose in the parent.
        transform: Transform,
    }
}

impl Quaternion {
    /// No rotation.
    pub const IDENTITY: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
}
