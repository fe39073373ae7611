//! The error model: 1σ of every source, and which errors two pixels share.

use crate::camera::{InteriorCovariance, MAX_INTERIOR};
use crate::navigation::GimbalReference;
use std::ops::Range;

/// Number of parameters in a ground point's Jacobian.
pub const PARAMETERS: usize = INTERIOR_START + MAX_INTERIOR + 2;

/// First column of the interior parameters.
const INTERIOR_START: usize = 18;

/// A source of error: one or more columns of the Jacobian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Source {
    /// Antenna position, north and east.
    Position,
    /// Antenna height.
    Height,
    /// Yaw of the UAV.
    Yaw,
    /// Pitch of the UAV.
    Pitch,
    /// Roll of the UAV.
    Roll,
    /// Gimbal readout, or the stabilised head's own attitude.
    Gimbal,
    /// Boresight angles.
    Boresight,
    /// Lever arm from the antenna to the projection centre.
    LeverArm,
    /// Instant of exposure against the log's clock.
    Time,
    /// Height of the ground.
    GroundHeight,
    /// Interior orientation and lens.
    Interior,
    /// Picking of the pixel.
    Picking,
}

/// Which pixels share one realisation of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Persistence {
    /// Every pixel has its own.
    Pixel,
    /// All pixels of a frame share it; other frames have their own.
    Frame,
    /// The whole survey shares it.
    Survey,
}

impl Source {
    /// All sources, in the order of the Jacobian's columns.
    pub const ALL: [Self; 12] = [
        Self::Position,
        Self::Height,
        Self::Yaw,
        Self::Pitch,
        Self::Roll,
        Self::Gimbal,
        Self::Boresight,
        Self::LeverArm,
        Self::Time,
        Self::GroundHeight,
        Self::Interior,
        Self::Picking,
    ];

    /// Its columns: position north, east | up | yaw | pitch | roll | gimbal yaw, pitch, roll | boresight
    /// yaw, pitch, roll | lever arm forward, right, down | time along and across the flight | ground
    /// height | the interior parameters of any lens | column, row.
    #[must_use]
    pub const fn parameters(self) -> Range<usize> {
        match self {
            Self::Position => 0..2,
            Self::Height => 2..3,
            Self::Yaw => 3..4,
            Self::Pitch => 4..5,
            Self::Roll => 5..6,
            Self::Gimbal => 6..9,
            Self::Boresight => 9..12,
            Self::LeverArm => 12..15,
            Self::Time => 15..17,
            Self::GroundHeight => 17..18,
            Self::Interior => INTERIOR_START..INTERIOR_START + MAX_INTERIOR,
            Self::Picking => PARAMETERS - 2..PARAMETERS,
        }
    }

    /// Which pixels share its error.
    ///
    /// What is measured anew for every exposure differs from frame to frame; what was measured once, or
    /// belongs to the ground, is one error for the survey. Timing counts as new for every frame, which is
    /// the cautious choice for lengths across strips flown in opposite directions.
    #[must_use]
    pub const fn persistence(self) -> Persistence {
        match self {
            Self::Position
            | Self::Height
            | Self::Yaw
            | Self::Pitch
            | Self::Roll
            | Self::Gimbal
            | Self::Time => Persistence::Frame,
            Self::Boresight | Self::LeverArm | Self::GroundHeight | Self::Interior => Persistence::Survey,
            Self::Picking => Persistence::Pixel,
        }
    }

    /// Name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Height => "height",
            Self::Yaw => "yaw",
            Self::Pitch => "pitch",
            Self::Roll => "roll",
            Self::Gimbal => "gimbal",
            Self::Boresight => "boresight",
            Self::LeverArm => "lever_arm",
            Self::Time => "time",
            Self::GroundHeight => "ground_height",
            Self::Interior => "camera",
            Self::Picking => "picking",
        }
    }
}

/// 1σ of three angles, radians.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AngleStd {
    /// About the vertical axis.
    pub yaw: f64,
    /// About the lateral axis.
    pub pitch: f64,
    /// About the longitudinal axis.
    pub roll: f64,
}

impl AngleStd {
    /// The same for all three.
    #[must_use]
    pub const fn equal(std: f64) -> Self {
        Self { yaw: std, pitch: std, roll: std }
    }
}

/// 1σ of every source of error, in SI units. The default knows no error at all.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ErrorModel {
    /// Antenna position along north and along east, each, metres.
    pub position_std_m: f64,
    /// Antenna height, metres.
    pub height_std_m: f64,
    /// Attitude of the UAV, radians.
    pub attitude_std: AngleStd,
    /// Gimbal angles, radians. Counted from the body: pan, elevation and roll readout. Counted from north
    /// and the horizon: attitude of the stabilised head about the vertical, its level lateral and its
    /// level longitudinal axis; `None` then means that [`Self::attitude_std`] states the head's attitude.
    /// `None` with angles counted from the body means exact angles.
    pub gimbal_std: Option<AngleStd>,
    /// Boresight angles, radians.
    pub boresight_std: AngleStd,
    /// Lever arm from the antenna to the projection centre, along each axis of the UAV, metres.
    pub lever_arm_std_m: f64,
    /// Instant of exposure, seconds.
    pub time_std_s: f64,
    /// Ground height, metres.
    pub ground_height_std_m: f64,
    /// Picking of a pixel, along columns and along rows, each, pixels.
    pub picking_std_px: f64,
    /// Whether the camera's own covariance of its interior parameters takes part.
    pub interior: bool,
}

/// Why an error model cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A sigma is negative, NaN or infinite.
    #[error("the standard deviation of {what} is {value}, it must be finite and not negative")]
    Sigma {
        /// Which.
        what: &'static str,
        /// What was given.
        value: f64,
    },
    /// Every sigma is zero.
    #[error("every standard deviation is zero: state at least one, or there is no accuracy to speak of")]
    NoErrors,
}

impl ErrorModel {
    /// Refuses sigmas that are no sigmas, and a model without any error.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn validate(&self) -> Result<(), ModelError> {
        let gimbal = self.gimbal_std.unwrap_or_default();
        let all = [
            ("position", self.position_std_m),
            ("height", self.height_std_m),
            ("yaw", self.attitude_std.yaw),
            ("pitch", self.attitude_std.pitch),
            ("roll", self.attitude_std.roll),
            ("gimbal pan", gimbal.yaw),
            ("gimbal elevation", gimbal.pitch),
            ("gimbal roll", gimbal.roll),
            ("boresight yaw", self.boresight_std.yaw),
            ("boresight pitch", self.boresight_std.pitch),
            ("boresight roll", self.boresight_std.roll),
            ("lever arm", self.lever_arm_std_m),
            ("time", self.time_std_s),
            ("ground height", self.ground_height_std_m),
            ("picking", self.picking_std_px),
        ];
        for (what, value) in all {
            if !value.is_finite() || value < 0.0 {
                return Err(ModelError::Sigma { what, value });
            }
        }
        if all.iter().all(|(_, value)| *value == 0.0) && !self.interior {
            return Err(ModelError::NoErrors);
        }
        Ok(())
    }

    /// The same model with these sources only.
    #[must_use]
    pub fn only(&self, sources: &[Source]) -> Self {
        let keep = |source, value: f64| {
            if sources.contains(&source) { value } else { 0.0 }
        };
        Self {
            position_std_m: keep(Source::Position, self.position_std_m),
            height_std_m: keep(Source::Height, self.height_std_m),
            attitude_std: AngleStd {
                yaw: keep(Source::Yaw, self.attitude_std.yaw),
                pitch: keep(Source::Pitch, self.attitude_std.pitch),
                roll: keep(Source::Roll, self.attitude_std.roll),
            },
            // `None` follows the attitude, `Some` is a source of its own.
            gimbal_std: match self.gimbal_std {
                Some(_) if !sources.contains(&Source::Gimbal) => Some(AngleStd::default()),
                as_given => as_given,
            },
            boresight_std: if sources.contains(&Source::Boresight) {
                self.boresight_std
            } else {
                AngleStd::default()
            },
            lever_arm_std_m: keep(Source::LeverArm, self.lever_arm_std_m),
            time_std_s: keep(Source::Time, self.time_std_s),
            ground_height_std_m: keep(Source::GroundHeight, self.ground_height_std_m),
            picking_std_px: keep(Source::Picking, self.picking_std_px),
            interior: self.interior && sources.contains(&Source::Interior),
        }
    }

    /// 1σ of the gimbal's angles: see [`Self::gimbal_std`].
    #[must_use]
    pub fn gimbal_std_for(&self, reference: GimbalReference) -> AngleStd {
        match (self.gimbal_std, reference) {
            (Some(std), _) => std,
            (None, GimbalReference::Nav) => self.attitude_std,
            (None, GimbalReference::Body) => AngleStd::default(),
        }
    }
}

/// Covariance of all parameters: independent but for the interior orientation, whose parameters are
/// strongly correlated by calibration.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ParameterCovariance {
    /// 1σ of every parameter; zero for the interior ones.
    pub std: [f64; PARAMETERS],
    /// Covariance of the interior ones.
    pub interior: Option<InteriorCovariance>,
}

impl ParameterCovariance {
    /// For one gimbal reference and camera. The time columns are scaled by the velocity in the Jacobian.
    pub fn new(model: &ErrorModel, reference: GimbalReference, interior: Option<InteriorCovariance>) -> Self {
        let mut std = [0.0; PARAMETERS];
        let mut set = |source: Source, values: &[f64]| {
            std[source.parameters()].copy_from_slice(values);
        };
        let angles = |a: AngleStd| [a.yaw, a.pitch, a.roll];
        set(Source::Position, &[model.position_std_m; 2]);
        set(Source::Height, &[model.height_std_m]);
        set(Source::Yaw, &[model.attitude_std.yaw]);
        set(Source::Pitch, &[model.attitude_std.pitch]);
        set(Source::Roll, &[model.attitude_std.roll]);
        set(Source::Gimbal, &angles(model.gimbal_std_for(reference)));
        set(Source::Boresight, &angles(model.boresight_std));
        set(Source::LeverArm, &[model.lever_arm_std_m; 3]);
        set(Source::Time, &[model.time_std_s; 2]);
        set(Source::GroundHeight, &[model.ground_height_std_m]);
        set(Source::Picking, &[model.picking_std_px; 2]);
        Self { std, interior: if model.interior { interior } else { None } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_dealt_out_without_gap_or_overlap() {
        let mut next = 0;
        for source in Source::ALL {
            assert_eq!(source.parameters().start, next, "{source:?}");
            next = source.parameters().end;
        }
        assert_eq!(next, PARAMETERS);
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let model = ErrorModel { time_std_s: -0.1, ..ErrorModel::default() };
        assert!(model.validate().unwrap_err().to_string().contains("time is -0.1"));
        assert_eq!(ErrorModel::default().validate(), Err(ModelError::NoErrors));
        let model = ErrorModel { gimbal_std: Some(AngleStd::equal(f64::NAN)), ..ErrorModel::default() };
        assert!(model.validate().is_err());
    }
}
