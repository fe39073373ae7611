//! Heights of the pipeline file: every one says what it is measured from.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::Length;

/// A height with its datum.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightSpec {
    /// The height.
    pub value: Length,
    /// What it is measured from.
    pub datum: VerticalDatum,
}

impl HeightSpec {
    /// The value in metres with its datum.
    pub fn height(&self) -> Height {
        Height { metres: self.value.metres(), datum: self.datum }
    }
}

/// What an absolute height is measured from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VerticalDatum {
    /// The WGS 84 ellipsoid, as GNSS receivers compute it.
    Ellipsoid,
    /// The EGM96 geoid (mean sea level): what most receivers and autopilots call altitude.
    Egm96,
    /// The EGM2008 geoid (mean sea level).
    Egm2008,
}

/// A height, metres above its datum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height {
    /// Metres.
    pub metres: f64,
    /// What it is measured from.
    pub datum: VerticalDatum,
}

/// What a logged height is measured from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeightDatum {
    /// The WGS 84 ellipsoid.
    Ellipsoid,
    /// The EGM96 geoid (mean sea level).
    Egm96,
    /// The EGM2008 geoid (mean sea level).
    Egm2008,
    /// A surface of constant air pressure; `takeoff_height` states the height of its zero.
    Barometric,
    /// The ground below the camera, as `[georeference.ground]` has it.
    AboveGround,
    /// The take-off point; `takeoff_height` states its height.
    AboveTakeoff,
}

impl HeightDatum {
    /// The datum of an absolute height; `None` for one that counts from a place.
    pub fn absolute(self) -> Option<VerticalDatum> {
        match self {
            Self::Ellipsoid => Some(VerticalDatum::Ellipsoid),
            Self::Egm96 => Some(VerticalDatum::Egm96),
            Self::Egm2008 => Some(VerticalDatum::Egm2008),
            Self::Barometric | Self::AboveGround | Self::AboveTakeoff => None,
        }
    }

    /// Whether somebody has to state the height of its zero.
    pub fn needs_zero(self) -> bool {
        matches!(self, Self::Barometric | Self::AboveTakeoff)
    }

    /// In a sentence: "a height … is used".
    pub fn words(self) -> &'static str {
        match self {
            Self::Ellipsoid => "above the ellipsoid",
            Self::Egm96 => "above sea level (EGM96)",
            Self::Egm2008 => "above sea level (EGM2008)",
            Self::Barometric => "by air pressure",
            Self::AboveGround => "above the ground",
            Self::AboveTakeoff => "above take-off",
        }
    }
}
