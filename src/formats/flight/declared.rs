//! What a pipeline file declares about a table of poses, and what a CRS's text says about its coordinates and heights.

use super::angles::{AngleSystem, AngleUnit};
use super::columns::Column;
use super::{LoggedPosition, ReadError, geodetic, plausible_height};
use crate::geodesy::{GeoidModel, HeightKind, MapPoint};
use crate::geometry::Point;
use crate::units::Radians;

/// What the user states about a table that does not state it itself. Where a file is silent and nothing is declared, the
/// reader refuses and says which key is missing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Declared<'a> {
    /// CRS of the positions and of grid angles: `EPSG:n`, WKT or a PROJ string.
    pub crs: Option<&'a str>,
    /// What heights are measured from.
    pub heights: Option<HeightKind>,
    /// What the angle columns mean.
    pub angles: Option<AngleSystem>,
    /// Their unit.
    pub angle_unit: AngleUnit,
    /// The columns in their order, for a table without a header.
    pub columns: Option<&'a [Column]>,
}

/// What kind of coordinates a CRS has, as far as its text tells; whatever it does not tell is left to PROJ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Coordinates {
    /// WGS 84 degrees.
    Wgs84,
    /// Degrees of another datum.
    Degrees,
    /// WGS 84, Earth-centred.
    Ecef,
    /// Anything else: a map grid.
    Grid,
}

/// A CRS as a file or a pipeline file writes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Crs {
    /// For PROJ: without a vertical part.
    pub(super) definition: String,
    /// Kind of its coordinates.
    pub(super) coordinates: Coordinates,
    /// What its heights are measured from, when it says.
    pub(super) heights: Option<HeightKind>,
}

impl Crs {
    /// Understands `EPSG:n`, `EPSG:n+v`, `WGS84 UTM 17N`, PROJ strings and WKT.
    ///
    /// # Errors
    /// [`ReadError`] for a local system without a place on the Earth, or text that is no CRS.
    pub(super) fn of(text: &str) -> Result<Self, ReadError> {
        let text = text.trim().trim_matches(|c| c == '\'' || c == '"');
        let upper = text.to_uppercase();
        if let Some(zone) = upper.strip_prefix("WGS84 UTM ").or_else(|| upper.strip_prefix("WGS 84 UTM ")) {
            return utm(zone.trim(), text);
        }
        let heights = heights(&upper);
        if let Some(code) = upper.strip_prefix("EPSG:") {
            return epsg(code.trim(), text, heights);
        }
        if upper.contains("+PROJ=") || upper.contains("+INIT=") {
            return Ok(Self { definition: text.to_owned(), coordinates: proj(&upper), heights });
        }
        let coordinates = wkt(&upper).ok_or_else(|| {
            ReadError::new(format!("\"{}\" is no coordinate reference system", super::text::short(text)))
                .help("write EPSG:n, a PROJ string, WKT or \"WGS84 UTM 17N\"")
        })?;
        if upper.starts_with("LOCAL_CS") || upper.starts_with("ENGCRS") || upper.starts_with("ENGINEERINGCRS")
        {
            return Err(ReadError::new(
                "its positions are in local coordinates without a place on the Earth",
            )
            .help("export the poses in a georeferenced coordinate system"));
        }
        Ok(Self { definition: text.to_owned(), coordinates, heights })
    }

    /// A position in this CRS: `x` is the easting or longitude, `y` the northing or latitude in degrees.
    ///
    /// # Errors
    /// Words for coordinates that no aircraft has.
    pub(super) fn position(
        &self,
        [x, y, z]: [f64; 3],
        heights: HeightKind,
    ) -> Result<LoggedPosition, String> {
        match self.coordinates {
            Coordinates::Wgs84 => geodetic(Radians::from_degrees(y), Radians::from_degrees(x), z, heights),
            Coordinates::Degrees => {
                geodetic(Radians::from_degrees(y), Radians::from_degrees(x), z, heights)?;
                Ok(on_map(x, y, z, heights))
            }
            Coordinates::Ecef => ecef(x, y, z),
            Coordinates::Grid => {
                if ecef(x, y, z).is_ok() && plausible_height(z).is_err() {
                    return Err(format!(
                        "x {x:.1}, y {y:.1}, z {z:.1} are Earth-centred coordinates (EPSG:4978), not {}",
                        super::text::short(&self.definition)
                    ));
                }
                if x == 0.0 && y == 0.0 {
                    return Err("x and y are both 0".to_owned());
                }
                Ok(on_map(x, y, plausible_height(z)?, heights))
            }
        }
    }

    /// The CRS that the log keeps: none when its positions are WGS 84 already.
    pub(super) fn kept(&self) -> Option<String> {
        matches!(self.coordinates, Coordinates::Degrees | Coordinates::Grid).then(|| self.definition.clone())
    }
}

const fn on_map(x: f64, y: f64, height_m: f64, kind: HeightKind) -> LoggedPosition {
    LoggedPosition::Projected { map: MapPoint { easting: x, northing: y }, height_m, kind }
}

/// An Earth-centred position near the Earth's surface.
///
/// # Errors
/// Words for one that is not.
pub(super) fn ecef(x: f64, y: f64, z: f64) -> Result<LoggedPosition, String> {
    let point = Point::new(x, y, z);
    let radius = point.vector().norm();
    if (6.3e6..6.5e6).contains(&radius) {
        Ok(LoggedPosition::Ecef(point))
    } else {
        Err(format!("x, y, z lie {:.0} km from the Earth's centre", radius / 1e3))
    }
}

fn utm(zone: &str, text: &str) -> Result<Crs, ReadError> {
    let (number, base) = match (zone.strip_suffix('N'), zone.strip_suffix('S')) {
        (Some(number), _) => (number, 32_600),
        (_, Some(number)) => (number, 32_700),
        _ => ("", 0),
    };
    match number.trim().parse::<u32>() {
        Ok(number @ 1..=60) => Ok(Crs {
            definition: format!("EPSG:{}", base + number),
            coordinates: Coordinates::Grid,
            heights: None,
        }),
        _ => Err(ReadError::new(format!("\"{}\" names no UTM zone", super::text::short(text)))
            .help("write it as \"WGS84 UTM 17N\"")),
    }
}

fn epsg(code: &str, text: &str, heights: Option<HeightKind>) -> Result<Crs, ReadError> {
    let horizontal = code.split('+').next().unwrap_or("").trim();
    let number: u32 = horizontal.parse().map_err(|_| {
        ReadError::new(format!("\"{}\" is no EPSG code", super::text::short(text)))
            .help("write it as EPSG:32617")
    })?;
    let coordinates = match number {
        // WGS 84 in two and three dimensions, and with EGM96 and EGM2008 heights.
        4326 | 4979 | 9707 | 9518 => Coordinates::Wgs84,
        4978 => Coordinates::Ecef,
        // NAD 27, NAD 83 and its later realisations, ETRS 89, ED 50, GDA, JGD, SIRGAS, CGCS, NZGD, Hartebeesthoek.
        4267 | 4269 | 4258 | 4230 | 4283 | 7844 | 6318 | 6319 | 4617 | 4674 | 4612 | 6668 | 4490 | 4167
        | 4148 | 4937 | 4939 => Coordinates::Degrees,
        _ => Coordinates::Grid,
    };
    Ok(Crs { definition: format!("EPSG:{number}"), coordinates, heights })
}

/// What heights are measured from, when the CRS's text (in capitals) says so.
fn heights(upper: &str) -> Option<HeightKind> {
    let says = |words: &[&str]| words.iter().any(|w| upper.contains(w));
    if says(&["+5773", "EPSG:9707", "EGM96"]) {
        Some(HeightKind::SeaLevel(GeoidModel::Egm96))
    } else if says(&["+3855", "EPSG:9518", "EGM2008", "EGM08"]) {
        Some(HeightKind::SeaLevel(GeoidModel::Egm2008))
    } else if says(&["EPSG:4979", "EPSG:4978", "ELLIPSOIDAL HEIGHT", "+PROJ=GEOCENT", "GEOCCS["]) {
        Some(HeightKind::Ellipsoid)
    } else {
        None
    }
}

fn proj(upper: &str) -> Coordinates {
    let wgs84 = upper.contains("+DATUM=WGS84");
    if upper.contains("+PROJ=LONGLAT") || upper.contains("+PROJ=LATLONG") {
        if wgs84 { Coordinates::Wgs84 } else { Coordinates::Degrees }
    } else if upper.contains("+PROJ=GEOCENT") && wgs84 {
        Coordinates::Ecef
    } else {
        Coordinates::Grid
    }
}

/// Kind of a WKT by its outer key word; `None` when it is no WKT.
fn wkt(upper: &str) -> Option<Coordinates> {
    let keyword = upper.split('[').next().filter(|k| k.len() < upper.len())?.trim();
    let datum_is_wgs84 = ["WGS 84\"", "WGS84\"", "GCS_WGS_1984\""]
        .iter()
        .any(|name| upper.split('"').nth(1).is_some_and(|first| format!("{first}\"").starts_with(name)));
    Some(match keyword {
        "GEOGCS" | "GEOGCRS" | "GEOGRAPHICCRS" | "GEODCRS" | "GEODETICCRS" => {
            if upper.contains("CARTESIAN") {
                Coordinates::Ecef
            } else if datum_is_wgs84 {
                Coordinates::Wgs84
            } else {
                Coordinates::Degrees
            }
        }
        "GEOCCS" => Coordinates::Ecef,
        "PROJCS" | "PROJCRS" | "PROJECTEDCRS" | "LOCAL_CS" | "ENGCRS" | "ENGINEERINGCRS" | "BOUNDCRS" => {
            Coordinates::Grid
        }
        "COMPD_CS" | "COMPOUNDCRS" => match upper.split_once("\",").map(|(_, inner)| inner.trim_start()) {
            Some(inner) if !inner.starts_with("COMPD") && !inner.starts_with("COMPOUND") => wkt(inner)?,
            _ => return None,
        },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_crs_by_its_text() {
        let sea = |model| Some(HeightKind::SeaLevel(model));
        let cases = [
            ("EPSG:4326", Coordinates::Wgs84, None),
            ("epsg:4979", Coordinates::Wgs84, Some(HeightKind::Ellipsoid)),
            ("EPSG:9707", Coordinates::Wgs84, sea(GeoidModel::Egm96)),
            ("EPSG:4326+3855", Coordinates::Wgs84, sea(GeoidModel::Egm2008)),
            ("EPSG:4978", Coordinates::Ecef, Some(HeightKind::Ellipsoid)),
            ("EPSG:4269", Coordinates::Degrees, None),
            ("EPSG:32617", Coordinates::Grid, None),
            ("WGS84 UTM 17N", Coordinates::Grid, None),
            ("+proj=longlat +datum=WGS84 +no_defs", Coordinates::Wgs84, None),
            ("+proj=longlat +ellps=GRS80", Coordinates::Degrees, None),
            ("+proj=utm +zone=17 +geoidgrids=egm96_15.gtx", Coordinates::Grid, sea(GeoidModel::Egm96)),
            ("GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\"]]", Coordinates::Wgs84, None),
            ("GEOGCRS[\"WGS 84 (G1762)\"]", Coordinates::Degrees, None),
            ("GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\"]]", Coordinates::Wgs84, None),
            ("PROJCS[\"WGS 84 / UTM zone 33N\",GEOGCS[\"WGS 84\"]]", Coordinates::Grid, None),
            (
                "COMPD_CS[\"a, b\",GEOGCS[\"WGS 84\"],VERT_CS[\"EGM2008 height\"]]",
                Coordinates::Wgs84,
                sea(GeoidModel::Egm2008),
            ),
            ("COMPOUNDCRS[\"a\",PROJCRS[\"b\"]]", Coordinates::Grid, None),
        ];
        for (text, coordinates, heights) in cases {
            let crs = Crs::of(text).unwrap();
            assert_eq!((crs.coordinates, crs.heights), (coordinates, heights), "{text}");
        }
        for bad in ["", "hello", "EPSG:", "EPSG:-1", "VERT_CS[\"x\"]", "LOCAL_CS[\"x\"]", "WGS84 UTM 0N"] {
            assert!(Crs::of(bad).is_err(), "{bad}");
        }
        assert!(Crs::of(&"COMPD_CS[\"a\",".repeat(100_000)).is_err());
    }

    proptest! {
        #[test]
        fn any_text_is_a_crs_or_not(text in ".{0,100}", x in any::<f64>(), y in any::<f64>(), z in any::<f64>()) {
            for text in [text.clone(), format!("EPSG:{text}"), format!("WGS84 UTM {text}"), format!("GEOGCS[\"{text}")] {
                if let Ok(crs) = Crs::of(&text) {
                    let _ = crs.position([x, y, z], HeightKind::Ellipsoid);
                }
            }
        }
    }
}
