//! Frames that the tests of this folder share: the paper's two experiments, and oblique ones at random.

use crate::camera::{Brown, Camera};
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::geometry::attitude::YawPitchRoll;
use crate::geometry::{Ned, Point};
use crate::georeference::GeoreferencedFrame;
use crate::navigation::{GimbalAngles, Mount, NavigationRecord};
use crate::terrain::{ConstantHeight, Terrain};
use crate::units::Radians;
use std::sync::Arc;

/// Eqs. (6) and (7) of the paper.
pub(super) const PAPER_INTERIOR: [f64; 10] =
    [743.7937, 748.9947, -0.7729, 566.3670, 345.5019, -0.0199, 0.1629, 0.0076, 0.0039, -0.3018];

/// The paper's camera, 1152 × 648.
pub(super) fn paper_camera() -> Camera {
    Camera::new(Brown::new(PAPER_INTERIOR).unwrap(), 1152, 648, None).unwrap()
}

/// A record at a position with an attitude in degrees.
pub(super) fn record(antenna: Geodetic, yaw: f64, pitch: f64, roll: f64) -> NavigationRecord {
    NavigationRecord {
        line: 1,
        time: None,
        antenna,
        attitude: YawPitchRoll::from_degrees(yaw, pitch, roll),
        gimbal: None,
        height_above_ground_m: None,
        ground_speed_m_s: None,
        velocity: None,
        pixel_rotation: None,
    }
}

/// A frame over its ground.
pub(super) fn frame(
    record: NavigationRecord,
    mount: &Mount,
    camera: Camera,
    ground: Arc<dyn Terrain>,
) -> GeoreferencedFrame {
    GeoreferencedFrame::new("IMG_0001.jpg".to_owned(), record, mount, Arc::new(camera), ground, 1e5).unwrap()
}

/// Gimbal angles in degrees, elevation up.
pub(super) fn gimbal(pan: f64, elevation: f64, roll: f64) -> GimbalAngles {
    GimbalAngles {
        pan: Radians::from_degrees(pan),
        elevation: Radians::from_degrees(elevation),
        roll: Radians::from_degrees(roll),
    }
}

/// Where the indoor test's floor frame stands; the paper gives only local coordinates.
pub(super) fn indoor_site() -> LocalTangent {
    LocalTangent::at(Geodetic::from_degrees(-23.2, -45.9, 600.0))
}

/// Sect. 4.1: tripod at (-0.021, -0.037, -1.154) m, pan -14.08°, ELEVATION -32.08°.
pub(super) fn indoor() -> GeoreferencedFrame {
    let mount = Mount { gimbal: gimbal(-14.08, -32.08, 0.0), ..Mount::default() };
    let antenna = WGS84
        .geodetic_from_ecef(&(*indoor_site().ecef_from_ned() * Point::<Ned>::new(-0.021, -0.037, -1.154)));
    let floor = Arc::new(ConstantHeight { height_m: 600.0 });
    frame(record(antenna, 0.0, 0.0, 0.0), &mount, paper_camera(), floor)
}

/// North, east, down of a position in a tangent frame, metres.
pub(super) fn ned_of(site: &LocalTangent, position: &Geodetic) -> Point<Ned> {
    site.ecef_from_ned().inverse() * WGS84.ecef_from_geodetic(position)
}

/// Sect. 4.3: 357.46 m above ground, attitude (0.0356; 0.057; 3.166) rad, gimbal pan -π/2, tilt π/2 down.
pub(super) fn flight() -> GeoreferencedFrame {
    let mount = Mount { gimbal: gimbal(-90.0, -90.0, 0.0), ..Mount::default() };
    let mut record = record(Geodetic::from_degrees(-23.1, -46.0, 700.0 + 357.46), 0.0, 0.0, 0.0);
    record.attitude = YawPitchRoll::new(Radians::new(3.166), Radians::new(0.057), Radians::new(0.0356));
    let ground = Arc::new(ConstantHeight { height_m: 700.0 });
    frame(record, &mount, paper_camera(), ground)
}

/// The same frame taken elsewhere.
pub(super) fn moved_north(of: &GeoreferencedFrame, by_m: f64) -> GeoreferencedFrame {
    let mut record = of.record.clone();
    let site = LocalTangent::at(record.antenna);
    record.antenna = WGS84.geodetic_from_ecef(&(*site.ecef_from_ned() * Point::<Ned>::new(by_m, 0.0, 0.0)));
    GeoreferencedFrame::new(
        "IMG_0002.jpg".to_owned(),
        record,
        &of.mount,
        of.camera.clone(),
        of.ground.clone(),
        of.max_range_m,
    )
    .unwrap()
}
