//! First-order propagation: the ground point's derivative by every parameter, in closed form.

use super::circular::{CircularError, ErrorEllipse};
use super::model::{ErrorModel, ModelError, PARAMETERS, ParameterCovariance, Source};
use crate::camera::{ImagePoint, MAX_INTERIOR};
use crate::geodesy::{Geodetic, LocalTangent, WGS84};
use crate::geometry::Ned;
use crate::georeference::{GeoreferencedFrame, GroundPoint, LocateError};
use crate::navigation::GimbalReference;
use crate::terrain::{Ray, Terrain};
use crate::units::Radians;
use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

/// d(north, east) of a ground point by the parameters, columns as [`Source::parameters`] deals them out;
/// metres per metre, radian, second, pixel or unit of the interior parameter.
pub type GroundJacobian = SMatrix<f64, 2, PARAMETERS>;

/// Why there is no covariance for a pixel.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PropagationError {
    /// The pixel has no ground point.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// The model itself is refused.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A timing error without a speed.
    #[error(
        "the model has a timing error of {time_std_s} s, but the log gives neither velocity nor ground speed"
    )]
    NoSpeed {
        /// The timing error.
        time_std_s: f64,
    },
    /// The camera's covariance is asked for but unknown.
    #[error("the model asks for the camera's covariance, but the calibration has none")]
    NoInteriorCovariance,
    /// The elevation model has no slope at the ground point.
    #[error("the elevation model has no slope at {latitude_deg:.6}°, {longitude_deg:.6}°")]
    NoSlope {
        /// Where.
        latitude_deg: f64,
        /// Where.
        longitude_deg: f64,
    },
    /// The lens is about to fold back.
    #[error(
        "the lens is about to fold back there: an error of one pixel turns the ray {times:.0} times as far as at the centre"
    )]
    NearFold {
        /// Against an undistorted lens.
        times: f64,
    },
    /// The ray runs along the ground.
    #[error(
        "the ray meets the ground at a grazing angle ({angle_deg:.2}°), where a small error moves the ground point without bound"
    )]
    Grazing {
        /// Angle between ray and ground.
        angle_deg: f64,
    },
    /// The covariance has no ellipse.
    #[error(transparent)]
    Circular(#[from] CircularError),
}

/// A pixel's ground point with its covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelAccuracy {
    /// The ground point.
    pub ground: GroundPoint,
    /// Its derivative by every parameter.
    pub jacobian: GroundJacobian,
    /// Covariance in (north, east) of the local tangent at the ground point, m².
    pub covariance: Matrix2<f64>,
    /// Variance (north plus east, m²) by source, in the order of [`Source::ALL`].
    pub variance_by_source: [f64; Source::ALL.len()],
    /// The 1σ ellipse.
    pub ellipse: ErrorEllipse,
}

impl PixelAccuracy {
    /// Radius that holds half of the errors, metres.
    ///
    /// # Errors
    /// [`CircularError::NoSpread`] when no source moves this pixel.
    pub fn cep50_m(&self) -> Result<f64, CircularError> {
        self.ellipse.radius_of(0.5)
    }
    /// Radius that holds ninety percent of the errors, metres.
    ///
    /// # Errors
    /// As [`Self::cep50_m`].
    pub fn ce90_m(&self) -> Result<f64, CircularError> {
        self.ellipse.radius_of(0.9)
    }
}

/// Propagates one error model through one frame.
///
/// Everything happens in the north-east-down frame at the antenna; results are turned into the tangent at
/// each ground point.
pub struct FramePropagation<'a> {
    frame: &'a GeoreferencedFrame,
    parameters: ParameterCovariance,
    ned_from_ecef: Matrix3<f64>,
    antenna_in_ecef: Vector3<f64>,
    camera_in_ned: Vector3<f64>,
    ned_from_camera: Matrix3<f64>,
    ned_from_body: Matrix3<f64>,
    /// What a small increase of each angle does: UAV, gimbal and boresight, each yaw, pitch, roll.
    turns: [Turn; 9],
    /// Turn of the north-east-down axes when the antenna moves north and east, radians per metre.
    transport: [Vector3<f64>; 2],
    /// Velocity that a timing error is multiplied with: along, and across where only a speed is known.
    velocity: [Vector3<f64>; 2],
}

/// One pixel's view of the ground, in the north-east-down frame at the antenna.
pub(super) struct View {
    /// (x, y) of the viewing ray (x, y, 1) in the camera.
    pub ray: Vector2<f64>,
    /// Its derivative by the stored pixel.
    pub ray_by_stored: Matrix2<f64>,
    /// Its derivative by the interior parameters.
    pub ray_by_interior: SMatrix<f64, 2, MAX_INTERIOR>,
    /// The ground point.
    pub end: Vector3<f64>,
    /// North at the ground point.
    pub north: Vector3<f64>,
    /// East at the ground point.
    pub east: Vector3<f64>,
    /// Normal of the ground: gradient of (height − ground height).
    pub normal: Vector3<f64>,
}

/// How a small increase of one angle moves the far end of a ray.
#[derive(Debug, Clone, Copy)]
enum Turn {
    /// About an axis through a pivot.
    About { axis: Vector3<f64>, pivot: Vector3<f64> },
    /// The whole ray moves along.
    Shift(Vector3<f64>),
}

impl<'a> FramePropagation<'a> {
    /// Prepares the frame.
    ///
    /// # Errors
    /// [`PropagationError::Model`], [`PropagationError::NoSpeed`],
    /// [`PropagationError::NoInteriorCovariance`].
    pub fn new(frame: &'a GeoreferencedFrame, model: &ErrorModel) -> Result<Self, PropagationError> {
        model.validate()?;
        let (record, mount) = (&frame.record, &frame.mount);
        let chain = &frame.chain;
        let velocity = match (record.velocity, record.ground_speed_m_s) {
            (Some(v), _) => [v.vector(), Vector3::zeros()],
            // A speed without direction is spread evenly over all directions, its square kept.
            (None, Some(speed)) => {
                let each = speed / 2.0_f64.sqrt();
                [Vector3::x() * each, Vector3::y() * each]
            }
            (None, None) if model.time_std_s > 0.0 => {
                return Err(PropagationError::NoSpeed { time_std_s: model.time_std_s });
            }
            (None, None) => [Vector3::zeros(); 2],
        };
        if model.interior && frame.camera.covariance.is_none() {
            return Err(PropagationError::NoInteriorCovariance);
        }

        let pose = chain.ned_from_camera();
        let ned_from_body = chain.ned_from_body.matrix();
        let antenna_to_gimbal =
            ned_from_body * (chain.gimbal_in_body + chain.antenna_in_body * -1.0).vector();
        let angles = record.gimbal.unwrap_or(mount.gimbal);
        let boresight_axes = mount.boresight.increment_axes();
        let about_antenna = |axis| Turn::About { axis, pivot: Vector3::zeros() };
        let about_gimbal = |axis| Turn::About { axis, pivot: antenna_to_gimbal };
        let attitude = record.attitude.increment_axes();
        let turns = match mount.gimbal_reference {
            GimbalReference::Body => {
                let ned_from_mount = ned_from_body * mount.boresight.rotation::<Ned, Ned>().matrix();
                let gimbal_axes = angles.as_yaw_pitch_roll().increment_axes();
                [
                    about_antenna(attitude[0]),
                    about_antenna(attitude[1]),
                    about_antenna(attitude[2]),
                    about_gimbal(ned_from_mount * gimbal_axes[0]),
                    about_gimbal(ned_from_mount * gimbal_axes[1]),
                    about_gimbal(ned_from_mount * gimbal_axes[2]),
                    about_gimbal(ned_from_body * boresight_axes[0]),
                    about_gimbal(ned_from_body * boresight_axes[1]),
                    about_gimbal(ned_from_body * boresight_axes[2]),
                ]
            }
            GimbalReference::Nav => {
                let ned_from_head = angles.rotation::<Ned>().matrix();
                let (s, c) = angles.pan.get().sin_cos();
                let carried = |axis: Vector3<f64>| Turn::Shift(axis.cross(&antenna_to_gimbal));
                [
                    carried(attitude[0]),
                    carried(attitude[1]),
                    carried(attitude[2]),
                    about_gimbal(Vector3::z()),
                    about_gimbal(Vector3::new(-s, c, 0.0)),
                    about_gimbal(Vector3::new(c, s, 0.0)),
                    about_gimbal(ned_from_head * boresight_axes[0]),
                    about_gimbal(ned_from_head * boresight_axes[1]),
                    about_gimbal(ned_from_head * boresight_axes[2]),
                ]
            }
        };
        let ecef_from_ned = chain.tangent.ecef_from_ned();
        Ok(Self {
            frame,
            parameters: ParameterCovariance::new(model, mount.gimbal_reference, frame.camera.covariance),
            ned_from_ecef: ecef_from_ned.rotation.matrix().transpose(),
            antenna_in_ecef: ecef_from_ned.origin.vector(),
            camera_in_ned: pose.origin.vector(),
            ned_from_camera: pose.rotation.matrix(),
            ned_from_body,
            turns,
            transport: transport(chain.tangent.origin()),
            velocity,
        })
    }

    /// The frame this propagates through.
    #[must_use]
    pub const fn frame(&self) -> &GeoreferencedFrame {
        self.frame
    }

    /// Velocity that a timing error is multiplied with, along and across the flight.
    pub(super) const fn velocity(&self) -> &[Vector3<f64>; 2] {
        &self.velocity
    }

    /// Covariance of the parameters.
    pub(super) const fn parameters(&self) -> &ParameterCovariance {
        &self.parameters
    }

    /// A stored pixel on the frame's own ground, with its covariance.
    ///
    /// # Errors
    /// [`PropagationError`]: no ground point, no slope, grazing.
    pub fn at(&self, stored: ImagePoint) -> Result<PixelAccuracy, PropagationError> {
        let ground = self.frame.ground_from_pixel(stored)?;
        self.accuracy(stored, ground, self.slope(&ground.position)?)
    }

    /// As [`Self::at`], on ground of a given ellipsoidal height.
    ///
    /// # Errors
    /// As [`Self::at`].
    pub fn at_height(&self, stored: ImagePoint, height_m: f64) -> Result<PixelAccuracy, PropagationError> {
        let ground = self.frame.ground_from_pixel_at_height(stored, height_m)?;
        self.accuracy(stored, ground, [0.0, 0.0])
    }

    /// As [`Self::at`], for a stored pixel that is known to see a place of the frame's ground.
    ///
    /// # Errors
    /// As [`Self::at`].
    pub fn at_place(
        &self,
        stored: ImagePoint,
        position: Geodetic,
    ) -> Result<PixelAccuracy, PropagationError> {
        let end = WGS84.ecef_from_geodetic(&position);
        let origin = self.frame.ecef_from_camera().origin;
        let ground =
            GroundPoint { position, ray: Ray::new(origin, end - origin), range_m: origin.distance_to(&end) };
        self.accuracy(stored, ground, self.slope(&position)?)
    }

    fn accuracy(
        &self,
        stored: ImagePoint,
        ground: GroundPoint,
        slope: [f64; 2],
    ) -> Result<PixelAccuracy, PropagationError> {
        let jacobian = self.jacobian(&self.view(stored, &ground, slope)?);
        let mut covariance = Matrix2::zeros();
        let mut variance_by_source = [0.0; Source::ALL.len()];
        for (source, variance) in Source::ALL.into_iter().zip(&mut variance_by_source) {
            let of_source = self.covariance_from(source, &jacobian);
            *variance = of_source.trace();
            covariance += of_source;
        }
        Ok(PixelAccuracy {
            ground,
            jacobian,
            covariance,
            variance_by_source,
            ellipse: ErrorEllipse::of(&covariance)?,
        })
    }

    /// Part of a ground point's covariance (or of any 2-row product of Jacobians) that one source causes.
    #[must_use]
    pub fn covariance_from(&self, source: Source, jacobian: &GroundJacobian) -> Matrix2<f64> {
        let mut sum = Matrix2::zeros();
        for k in source.parameters() {
            let column = jacobian.column(k) * self.parameters.std[k];
            sum += column * column.transpose();
        }
        if let (Source::Interior, Some(interior)) = (source, &self.parameters.interior) {
            let columns = jacobian.fixed_columns::<MAX_INTERIOR>(Source::Interior.parameters().start);
            sum += columns * interior * columns.transpose();
        }
        sum
    }

    /// d(ground height)/d(north, east) of the frame's ground.
    ///
    /// Over an elevation model: across one posting, which is the slope an error of that size meets; on the
    /// model's edge one side suffices.
    pub(super) fn slope(&self, at: &Geodetic) -> Result<[f64; 2], PropagationError> {
        let ground = self.frame.ground.as_ref();
        match ground.spacing() {
            None => Ok([0.0, 0.0]),
            Some(spacing) => slope_of(ground, at, 0.5 * spacing).ok_or(PropagationError::NoSlope {
                latitude_deg: at.latitude.degrees(),
                longitude_deg: at.longitude.degrees(),
            }),
        }
    }

    /// What one pixel sees, ready for errors to be applied to it. `slope` is d height by d north and d east.
    pub(super) fn view(
        &self,
        stored: ImagePoint,
        ground: &GroundPoint,
        slope: [f64; 2],
    ) -> Result<View, PropagationError> {
        let no_ray = LocateError::NoRay { column: stored.column, row: stored.row };
        let sensor = self.frame.sensor_from_stored(stored);
        let ray = self.frame.camera.ray_from_pixel(sensor).ok_or(no_ray)?;
        let (ray_by_sensor, ray_by_interior) = self.frame.camera.ray_derivatives(sensor).ok_or(no_ray)?;
        // Towards the fold the derivative grows without bound, over a pixel or two; past this factor the
        // distance to the fold itself is of the order of the errors.
        const MAX_STRETCH: f64 = 10.0;
        let [fx, fy, ..] = self.frame.camera.lens.interior();
        let times = ray_by_sensor.norm() / (1.0 / fx).hypot(1.0 / fy);
        if times > MAX_STRETCH {
            return Err(PropagationError::NearFold { times });
        }
        let turned = |column: f64, row: f64| {
            let p = self.frame.sensor_from_stored(ImagePoint::new(column, row));
            Vector2::new(p.column, p.row)
        };
        let sensor_by_stored = Matrix2::from_columns(&[
            turned(1.0, 0.0) - turned(0.0, 0.0),
            turned(0.0, 1.0) - turned(0.0, 0.0),
        ]);
        let end =
            self.ned_from_ecef * (WGS84.ecef_from_geodetic(&ground.position).vector() - self.antenna_in_ecef);
        // Columns: north, east and down at the ground point.
        let ned_from_ground =
            self.ned_from_ecef * LocalTangent::at(ground.position).ecef_from_ned().rotation.matrix();
        let (north, east) = (ned_from_ground.column(0), ned_from_ground.column(1));
        let up = -ned_from_ground.column(2);
        let normal = up - north * slope[0] - east * slope[1];
        let sine = -normal.dot(&(end - self.camera_in_ned).normalize()) / normal.norm();
        // Below a tenth of a degree no first-order statement about the ground point means anything.
        const MIN_SINE: f64 = 1.7e-3;
        if sine < MIN_SINE {
            return Err(PropagationError::Grazing {
                angle_deg: Radians::new(sine.clamp(-1.0, 1.0).asin()).degrees(),
            });
        }
        Ok(View {
            ray: Vector2::new(ray.x(), ray.y()),
            ray_by_stored: ray_by_sensor * sensor_by_stored,
            ray_by_interior,
            end,
            north: north.into(),
            east: east.into(),
            normal,
        })
    }

    fn jacobian(&self, view: &View) -> GroundJacobian {
        let end = view.end;
        let sight = end - self.camera_in_ned;
        let direction = sight.normalize();
        let descent = -view.normal.dot(&direction);
        // dP = v − d (n·v − δh)/(n·d), with n·d = −descent.
        let on_ground = |v: Vector3<f64>, height: f64| {
            let moved = v + direction * ((view.normal.dot(&v) - height) / descent);
            [view.north.dot(&moved), view.east.dot(&moved)]
        };

        let mut jacobian = GroundJacobian::zeros();
        let mut put = |column: usize, [n, e]: [f64; 2]| {
            jacobian[(0, column)] = n;
            jacobian[(1, column)] = e;
        };
        let moved_antenna = |by: &Vector3<f64>| {
            let turn = self.transport[0] * by.x + self.transport[1] * by.y;
            by + turn.cross(&end)
        };
        let first = |source: Source| source.parameters().start;
        put(first(Source::Position), on_ground(moved_antenna(&Vector3::x()), 0.0));
        put(first(Source::Position) + 1, on_ground(moved_antenna(&Vector3::y()), 0.0));
        put(first(Source::Height), on_ground(-Vector3::z(), 0.0));
        for (k, turn) in self.turns.iter().enumerate() {
            let v = match turn {
                Turn::About { axis, pivot } => axis.cross(&(end - pivot)),
                Turn::Shift(v) => *v,
            };
            put(first(Source::Yaw) + k, on_ground(v, 0.0));
        }
        for k in 0..3 {
            put(first(Source::LeverArm) + k, on_ground(self.ned_from_body.column(k).into(), 0.0));
        }
        for (k, velocity) in self.velocity.iter().enumerate() {
            put(first(Source::Time) + k, on_ground(moved_antenna(velocity), 0.0));
        }
        put(first(Source::GroundHeight), on_ground(Vector3::zeros(), 1.0));
        // The ray's end moves sideways by the depth along the optical axis times the change of (x, y).
        let depth = self.ned_from_camera.column(2).dot(&sight);
        let axes = self.ned_from_camera.fixed_columns::<2>(0) * depth;
        for k in 0..MAX_INTERIOR {
            put(first(Source::Interior) + k, on_ground(axes * view.ray_by_interior.column(k), 0.0));
        }
        for k in 0..2 {
            put(first(Source::Picking) + k, on_ground(axes * view.ray_by_stored.column(k), 0.0));
        }
        jacobian
    }
}

/// Turn of the north-east-down axes per metre of motion north and east, in radians per metre.
fn transport(at: &Geodetic) -> [Vector3<f64>; 2] {
    let (sin, cos) = at.latitude.get().sin_cos();
    let e2 = WGS84.eccentricity_squared();
    let w2 = 1.0 - e2 * sin * sin;
    let prime_vertical = WGS84.semi_major_m / w2.sqrt();
    let meridian = prime_vertical * (1.0 - e2) / w2;
    let h = at.height.get();
    [Vector3::new(0.0, -1.0 / (meridian + h), 0.0), Vector3::new(1.0, 0.0, -sin / cos) / (prime_vertical + h)]
}

/// Slope of a terrain by differences over ±`reach` metres; one-sided where the other side has no data.
fn slope_of(terrain: &dyn Terrain, at: &Geodetic, reach: f64) -> Option<[f64; 2]> {
    let [per_north, per_east] = {
        let e2 = WGS84.eccentricity_squared();
        let (sin, cos) = at.latitude.get().sin_cos();
        let w2 = 1.0 - e2 * sin * sin;
        let prime_vertical = WGS84.semi_major_m / w2.sqrt();
        let h = at.height.get();
        [1.0 / (prime_vertical * (1.0 - e2) / w2 + h), 1.0 / ((prime_vertical + h) * cos)]
    };
    let shifted = |north: f64, east: f64| Geodetic {
        latitude: Radians::new(at.latitude.get() + north * per_north),
        longitude: Radians::new(at.longitude.get() + east * per_east),
        ..*at
    };
    let heights = terrain.heights(&[
        *at,
        shifted(reach, 0.0),
        shifted(-reach, 0.0),
        shifted(0.0, reach),
        shifted(0.0, -reach),
    ]);
    let [here, north, south, east, west] = [0, 1, 2, 3, 4].map(|i| heights[i].ok());
    let along = |ahead: Option<f64>, behind: Option<f64>| match (ahead, here, behind) {
        (Some(a), _, Some(b)) => Some((a - b) / (2.0 * reach)),
        (Some(a), Some(h), None) => Some((a - h) / reach),
        (None, Some(h), Some(b)) => Some((h - b) / reach),
        _ => None,
    };
    Some([along(north, south)?, along(east, west)?])
}

#[cfg(test)]
mod tests;
