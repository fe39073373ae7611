//! True heading from a magnetic one: the declination by the World Magnetic Model of the flight's own years.

mod coefficients;

use crate::geodesy::{Geodetic, WGS84};
use crate::units::{Radians, Seconds};
use coefficients::{WMM2010, WMM2015_V2, WMM2020, WMM2025};

/// Highest degree of the models.
const DEGREE: usize = 12;
/// The models' reference radius, metres.
const RADIUS_M: f64 = 6_371_200.0;
/// Below this horizontal intensity (nT) the models' makers call a compass unusable: the "blackout zone".
const BLACKOUT_NT: f64 = 2_000.0;

/// The angle from true north to magnetic north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Declination {
    /// Positive when magnetic north lies east of true north: `true heading = magnetic heading + angle`.
    pub angle: Radians,
    /// One sigma of the declination as the model's makers state it: errors of the model and the crust's field; neither
    /// magnetic storms nor the compass's own errors.
    pub std: Radians,
    /// Horizontal intensity of the field, nT: what a compass has to work with.
    pub horizontal_nt: f64,
    /// The model used.
    pub model: &'static str,
}

/// Why there is no declination.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HeadingError {
    /// A coordinate or the time is not finite, or out of range.
    #[error(
        "latitude {latitude_deg}°, longitude {longitude_deg}°, height {height_m} m is no place for a declination"
    )]
    NoPlace {
        /// Degrees north.
        latitude_deg: f64,
        /// Degrees east.
        longitude_deg: f64,
        /// Metres above the ellipsoid.
        height_m: f64,
    },
    /// No model covers the instant.
    #[error("the magnetic models at hand cover 2010 to the end of 2029, not {year:.2}")]
    OutsideYears {
        /// Decimal year of the instant.
        year: f64,
    },
    /// Near a magnetic pole the direction of the horizontal field means nothing.
    #[error(
        "the field's horizontal part is {horizontal_nt:.0} nT here, below 2000 nT: this close to a magnetic pole no compass heading is usable"
    )]
    NearPole {
        /// Horizontal intensity, nT.
        horizontal_nt: f64,
    },
}

/// A model with the years it is for and its stated error of the declination.
struct Model {
    name: &'static str,
    epoch: f64,
    coefficients: &'static [[f64; 4]; 90],
    /// σ² = constant² + (per_horizontal / H)², degrees, H in nT.
    constant_deg: f64,
    per_horizontal_deg_nt: f64,
}

/// Error models: section 3.4 of the technical reports of WMM2015, 2020 and 2025. The report of WMM2010 has no such
/// formula; the widest of the three stands in.
static MODELS: [Model; 4] = [
    Model {
        name: "WMM2010",
        epoch: 2010.0,
        coefficients: &WMM2010,
        constant_deg: 0.26,
        per_horizontal_deg_nt: 5625.0,
    },
    Model {
        name: "WMM2015v2",
        epoch: 2015.0,
        coefficients: &WMM2015_V2,
        constant_deg: 0.23,
        per_horizontal_deg_nt: 5430.0,
    },
    Model {
        name: "WMM2020",
        epoch: 2020.0,
        coefficients: &WMM2020,
        constant_deg: 0.26,
        per_horizontal_deg_nt: 5625.0,
    },
    Model {
        name: "WMM2025",
        epoch: 2025.0,
        coefficients: &WMM2025,
        constant_deg: 0.26,
        per_horizontal_deg_nt: 5417.0,
    },
];

/// The declination at a place and an instant (UTC, Unix seconds), by the model of that instant's five years.
///
/// # Errors
/// [`HeadingError`] for an instant outside 2010–2029, a place that is none, and near the magnetic poles.
pub fn declination(at: &Geodetic, utc: Seconds) -> Result<Declination, HeadingError> {
    let year = decimal_year(utc);
    declination_in(at, year)
}

fn declination_in(at: &Geodetic, year: f64) -> Result<Declination, HeadingError> {
    let (latitude_deg, longitude_deg, height_m) =
        (at.latitude.degrees(), at.longitude.degrees(), at.height.get());
    // The models are stated for 1 km below to 850 km above the ellipsoid; comparisons fail for NaN.
    if !(latitude_deg.abs() <= 90.0
        && longitude_deg.abs() <= 360.0
        && (-1_000.0..=850_000.0).contains(&height_m))
    {
        return Err(HeadingError::NoPlace { latitude_deg, longitude_deg, height_m });
    }
    let model = MODELS
        .iter()
        .find(|m| (m.epoch..m.epoch + 5.0).contains(&year))
        .ok_or(HeadingError::OutsideYears { year })?;
    let [north, east, _] = field(model, at, year);
    let horizontal_nt = north.hypot(east);
    // At a geographic pole itself "north" has no direction either.
    if !(horizontal_nt >= BLACKOUT_NT && latitude_deg.abs() < 89.999_99) {
        return Err(HeadingError::NearPole { horizontal_nt });
    }
    let std_deg = model.constant_deg.hypot(model.per_horizontal_deg_nt / horizontal_nt);
    Ok(Declination {
        angle: Radians::new(east.atan2(north)),
        std: Radians::from_degrees(std_deg),
        horizontal_nt,
        model: model.name,
    })
}

/// The field in north, east, down at a geodetic place, nT (WMM technical report, equations 4 to 18).
fn field(model: &Model, at: &Geodetic, year: f64) -> [f64; 3] {
    let p = WGS84.ecef_from_geodetic(at).vector();
    let distance = p.norm();
    let (sin, cos) = (p.z / distance, (p.x.hypot(p.y) / distance).max(1e-12));
    let (legendre, slope) = legendre(sin, cos);
    let since = year - model.epoch;
    let longitude = at.longitude.get();
    let (mut x, mut y, mut z) = (0.0, 0.0, 0.0);
    for (k, (n, m)) in degrees_and_orders().enumerate() {
        let [g, h, g_rate, h_rate] = model.coefficients[k];
        let (g, h) = (g + since * g_rate, h + since * h_rate);
        let order = m as f64;
        let (sin_m, cos_m) = (order * longitude).sin_cos();
        let scale = (RADIUS_M / distance).powi(n as i32 + 2);
        let along = g * cos_m + h * sin_m;
        x -= scale * along * slope[n][m];
        y += scale * order * (g * sin_m - h * cos_m) * legendre[n][m] / cos;
        z -= scale * (n as f64 + 1.0) * along * legendre[n][m];
    }
    // From the sphere's vertical to the ellipsoid's.
    let turn = sin.atan2(cos) - at.latitude.get();
    let (s, c) = turn.sin_cos();
    [x * c - z * s, y, x * s + z * c]
}

/// (1, 0), (1, 1), (2, 0), … (12, 12).
fn degrees_and_orders() -> impl Iterator<Item = (usize, usize)> {
    (1..=DEGREE).flat_map(|n| (0..=n).map(move |m| (n, m)))
}

type Table = [[f64; DEGREE + 1]; DEGREE + 1];

/// Schmidt's quasi-normalised P(n, m) of the sine of the latitude, and their derivatives by the latitude.
fn legendre(sin: f64, cos: f64) -> (Table, Table) {
    let mut p = [[0.0; DEGREE + 1]; DEGREE + 1];
    let mut d = [[0.0; DEGREE + 1]; DEGREE + 1];
    p[0][0] = 1.0;
    for n in 1..=DEGREE {
        for m in 0..=n {
            let (nf, mf) = (n as f64, m as f64);
            if m == n {
                // The first sectorial term carries no square root.
                let f = if n == 1 { 1.0 } else { ((2.0 * nf - 1.0) / (2.0 * nf)).sqrt() };
                p[n][n] = f * cos * p[n - 1][n - 1];
                d[n][n] = f * (cos * d[n - 1][n - 1] - sin * p[n - 1][n - 1]);
            } else {
                let below = (nf * nf - mf * mf).sqrt();
                let (mut value, mut slope) = (
                    (2.0 * nf - 1.0) * sin * p[n - 1][m],
                    (2.0 * nf - 1.0) * (sin * d[n - 1][m] + cos * p[n - 1][m]),
                );
                if n >= 2 {
                    let f = ((nf - 1.0) * (nf - 1.0) - mf * mf).max(0.0).sqrt();
                    value -= f * p[n - 2][m];
                    slope -= f * d[n - 2][m];
                }
                p[n][m] = value / below;
                d[n][m] = slope / below;
            }
        }
    }
    (p, d)
}

/// The year and the fraction of it that has passed, proleptic Gregorian; NaN for times that are no dates.
fn decimal_year(utc: Seconds) -> f64 {
    const DAY: f64 = 86_400.0;
    let days = utc.get() / DAY;
    // 10,000 years about 1970; also stops NaN.
    if days.is_nan() || days.abs() >= 3.6e6 {
        return f64::NAN;
    }
    let mut year = (1970.0 + days / 365.2425).floor() as i64;
    while days < first_day(year) {
        year -= 1;
    }
    while days >= first_day(year + 1) {
        year += 1;
    }
    let (start, end) = (first_day(year), first_day(year + 1));
    year as f64 + (days - start) / (end - start)
}

/// Days from 1970-01-01 to the first of January.
fn first_day(year: i64) -> f64 {
    let leaps = |y: i64| y.div_euclid(4) - y.div_euclid(100) + y.div_euclid(400);
    (365 * (year - 1970) + leaps(year - 1) - leaps(1969)) as f64
}

#[cfg(test)]
mod tests;
