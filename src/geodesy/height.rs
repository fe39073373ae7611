//! What a height is measured from, before it is brought to the ellipsoid.

/// A model of the geoid: mean sea level above the ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum GeoidModel {
    /// EGM96, 15-minute grid: what most receivers and autopilots carry.
    Egm96,
    /// EGM2008, 2.5-minute grid.
    Egm2008,
}

impl GeoidModel {
    /// The model's own name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Egm96 => "EGM96",
            Self::Egm2008 => "EGM2008",
        }
    }
}

/// What a height is measured from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum HeightKind {
    /// The WGS 84 ellipsoid.
    Ellipsoid,
    /// Mean sea level, as this geoid model has it.
    SeaLevel(GeoidModel),
    /// A surface of constant air pressure, whose own height somebody must state.
    Barometric,
    /// The take-off point, whose own height somebody must state.
    AboveTakeoff,
    /// The ground below.
    AboveGround,
}
