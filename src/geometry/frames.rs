//! Frame markers: one type per kind of frame, each with its origin, axes and handedness.

/// A kind of frame. All frames are right-handed and in metres.
pub trait Frame: Copy + Clone + std::fmt::Debug + Send + Sync + 'static {
    /// The name used in messages and by `explain`.
    const NAME: &'static str;
}

macro_rules! frame {
    ($(#[$doc:meta])* $name:ident, $text:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = $text;
        }
    };
}

frame!(
    /// Earth-centred, Earth-fixed (WGS 84): x to 0°N 0°E, y to 0°N 90°E, z to the north pole.
    Ecef,
    "ECEF"
);
frame!(
    /// Local navigation frame: north, east, down; origin stated by the value that uses it.
    Ned,
    "NAV"
);
frame!(
    /// The UAV: x forward (nose), y right, z down; origin at the UAV's reference point.
    Body,
    "UAV"
);
frame!(
    /// The gimbal's inner frame: x along the optical axis, y to the image's right, z to the image's
    /// bottom, before the fixed axis change to the camera.
    Gimbal,
    "gimbal"
);
frame!(
    /// The camera: x to the image's right, y to the image's bottom, z along the optical axis; origin at
    /// the projection centre.
    Camera,
    "camera"
);
