//! Positions brought to the ellipsoid.

use super::Conventions;
use crate::config::height::{Height, HeightDatum, VerticalDatum};
use crate::formats::InputError;
use crate::formats::flight::LoggedPosition;
use crate::formats::geoid::{Geoid, GeoidError};
use crate::formats::log::height_kind;
use crate::geodesy::{Geodetic, HeightKind, MapProjection, WGS84};
use crate::units::Metres;

/// Ellipsoidal height of a stated height at a place.
///
/// # Errors
/// Words for a geoid that cannot be had there.
pub(in super::super) fn ellipsoidal(height: Height, at: &Geodetic, geoid: &Geoid) -> Result<f64, String> {
    let above = geoid.above_ellipsoid(height.datum, &[*at]).map_err(|e| e.to_string())?[0];
    Ok(height.metres + above)
}

impl Conventions<'_> {
    /// Positions of the antenna above the ellipsoid, in order.
    ///
    /// # Errors
    /// [`InputError`] for a geoid grid that is not installed: it concerns the whole log.
    pub(in super::super) fn positions(
        &self,
        stated: &[(LoggedPosition, Option<f64>)],
    ) -> Result<Vec<Result<Geodetic, String>>, InputError> {
        let mut placed: Vec<Result<(Geodetic, HeightKind), String>> =
            stated.iter().map(|(position, takeoff)| self.place(position, *takeoff)).collect();
        let geoid_failed = |e: GeoidError| self.of_log(e.to_string());
        for datum in [VerticalDatum::Egm96, VerticalDatum::Egm2008] {
            let above_geoid = |place: &Result<(Geodetic, HeightKind), String>| {
                place.as_ref().ok().filter(|(_, kind)| *kind == kind_of(datum)).map(|(at, _)| *at)
            };
            let at: Vec<Geodetic> = placed.iter().filter_map(above_geoid).collect();
            if at.is_empty() {
                continue;
            }
            let mut undulations = self.geoid.above_ellipsoid(datum, &at).map_err(geoid_failed)?.into_iter();
            for place in placed.iter_mut().filter(|place| above_geoid(place).is_some()) {
                if let (Ok((at, kind)), Some(n)) = (place, undulations.next()) {
                    (*at, *kind) = (at.at_height(at.height.get() + n), HeightKind::Ellipsoid);
                }
            }
        }
        placed.into_iter().map(|place| Ok(place.and_then(|(at, kind)| self.absolute(at, kind)))).collect()
    }

    /// Latitude and longitude, with the height as stated and what it counts from.
    pub(super) fn place(
        &self,
        position: &LoggedPosition,
        above_takeoff: Option<f64>,
    ) -> Result<(Geodetic, HeightKind), String> {
        let instead = self.declared.log.height_datum;
        let height = |height_m: f64, kind: HeightKind| match (instead, above_takeoff) {
            // A record that states both heights has the one above take-off in a place of its own.
            (Some(HeightDatum::AboveTakeoff), Some(above)) => Ok((above, HeightKind::AboveTakeoff)),
            (Some(HeightDatum::AboveTakeoff), None) if kind != HeightKind::AboveTakeoff => {
                Err("`height_datum` is above_takeoff, and it states no height above take-off".to_owned())
            }
            (Some(datum), _) => Ok((height_m, height_kind(datum))),
            (None, _) => Ok((height_m, kind)),
        };
        match (*position, &self.grid) {
            (LoggedPosition::Geodetic { latitude, longitude, height_m, kind }, _) => {
                let (height_m, kind) = height(height_m, kind)?;
                Ok((Geodetic { latitude, longitude, height: Metres::new(height_m) }, kind))
            }
            (LoggedPosition::Projected { map, height_m, kind }, Some(projection)) => {
                let (height_m, kind) = height(height_m, kind)?;
                let at = projection.geodetic_from_map(&[map]).map_err(|e| e.to_string())?[0];
                Ok((at.at_height(height_m), kind))
            }
            (LoggedPosition::Projected { .. }, None) => Err("the position has no CRS".to_owned()),
            (LoggedPosition::Ecef(point), _) => Ok((WGS84.geodetic_from_ecef(&point), HeightKind::Ellipsoid)),
        }
    }

    /// Heights that count from a place, brought to the ellipsoid.
    fn absolute(&self, at: Geodetic, kind: HeightKind) -> Result<Geodetic, String> {
        let base = match kind {
            // Sea level has been dealt with for all positions at once.
            HeightKind::Ellipsoid | HeightKind::SeaLevel(_) => 0.0,
            HeightKind::AboveTakeoff | HeightKind::Barometric => {
                let zero = self.declared.log.takeoff.ok_or(
                    "its height counts from the take-off point, whose own height is not stated (takeoff_height)",
                )?;
                ellipsoidal(zero, &at, self.geoid)?
            }
            HeightKind::AboveGround => (self.ground)(&[at])
                .swap_remove(0)
                .map_err(|e| format!("its height is above ground, and there is no ground under it: {e}"))?,
        };
        Ok(at.at_height(at.height.get() + base))
    }
}

fn kind_of(datum: VerticalDatum) -> HeightKind {
    height_kind(match datum {
        VerticalDatum::Ellipsoid => HeightDatum::Ellipsoid,
        VerticalDatum::Egm96 => HeightDatum::Egm96,
        VerticalDatum::Egm2008 => HeightDatum::Egm2008,
    })
}
