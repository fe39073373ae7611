//! Every matrix and vector of one frame's chain, with units: what `explain` prints.

use super::georeference::Georeferenced;
use crate::formats::crs::Projection;
use crate::formats::flight::{LoggedStd, Origin};
use crate::geodesy::{MapProjection, WGS84};
use crate::geometry::{Displacement, Frame};
use crate::georeference::GeoreferencedFrame;
use crate::navigation::GimbalReference;
use crate::units::{Radians, Seconds};
use nalgebra::{Matrix3, Vector3};
use std::fmt;

/// The chain ECEF ← NAV ← UAV ← gimbal ← camera ← image of one frame.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Explanation {
    /// Name and version of this record.
    pub format: &'static str,
    /// The image's file name.
    pub frame: String,
    /// Line of the log it came from (the nearer one, when interpolated).
    pub log_line: u64,
    /// Exposure on the log's clock, seconds.
    pub time_s: Option<f64>,
    /// How the frame found its pose.
    pub found: String,
    /// Which tag or column every number came from, and by which convention it was read.
    pub read: Vec<Origin>,
    /// What was done to the numbers before the chain: north references, offsets.
    pub applied: Vec<String>,
    /// What the log says its own values are worth, one sigma; empty when it does not say.
    pub stated_std: Vec<Quantity>,
    /// What the log and the mount said, in our senses.
    pub given: Vec<Quantity>,
    /// Rotation matrices, row by row.
    pub rotations: Vec<RotationEntry>,
    /// Vectors, metres.
    pub vectors: Vec<VectorEntry>,
    /// `K` of eq. (4), row by row, pixels.
    pub interior_matrix_px: [[f64; 3]; 3],
    /// Interior parameters by name.
    pub interior: Vec<Quantity>,
    /// The image centre, followed through the chain.
    pub centre: Vec<Quantity>,
}

/// A number with its name and unit.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Quantity {
    /// What it is.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
}

/// A rotation matrix.
#[derive(Debug, Clone, serde::Serialize)]
pub struct RotationEntry {
    /// `to_from_from`.
    pub name: &'static str,
    /// The symbol of the paper, where it has one.
    pub symbol: &'static str,
    /// Rows.
    pub rows: [[f64; 3]; 3],
}

/// A vector.
#[derive(Debug, Clone, serde::Serialize)]
pub struct VectorEntry {
    /// `what_in_frame`.
    pub name: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Components along the frame's x, y, z, metres.
    pub metres: [f64; 3],
}

fn rows(m: Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}

fn triple(v: Vector3<f64>) -> [f64; 3] {
    [v.x, v.y, v.z]
}

fn arm<F: Frame>(name: &'static str, meaning: &'static str, d: Displacement<F>) -> VectorEntry {
    VectorEntry { name, meaning, metres: triple(d.vector()) }
}

/// Writes down the chain of one frame; an image centre that sees no ground ends its own list early.
#[must_use]
pub fn explain(frame: &GeoreferencedFrame, survey: &Georeferenced) -> Explanation {
    let projection = &survey.projection;
    let source = survey.sources.get(&frame.name);
    let number = |name: &str, value: f64, unit: &'static str| Quantity { name: name.to_owned(), value, unit };
    let angle = |name: &str, a: Radians| number(name, a.degrees(), "deg");
    let (record, chain, mount) = (&frame.record, &frame.chain, &frame.mount);
    let gimbal = record.gimbal.unwrap_or(mount.gimbal);
    let against = match mount.gimbal_reference {
        GimbalReference::Body => "against the UAV",
        GimbalReference::Nav => "against north and the horizon",
    };
    let given = vec![
        angle("antenna latitude", record.antenna.latitude),
        angle("antenna longitude", record.antenna.longitude),
        number("antenna height above the ellipsoid", record.antenna.height.get(), "m"),
        angle("yaw, clockwise from true north", record.attitude.yaw),
        angle("pitch, nose up", record.attitude.pitch),
        angle("roll, right wing down", record.attitude.roll),
        angle(&format!("gimbal pan, clockwise, {against}"), gimbal.pan),
        angle(&format!("gimbal elevation, up, {against}"), gimbal.elevation),
        angle("gimbal roll, clockwise along the optical axis", gimbal.roll),
        angle("boresight yaw", mount.boresight.yaw),
        angle("boresight pitch", mount.boresight.pitch),
        angle("boresight roll", mount.boresight.roll),
        number("stored pixels turned clockwise", f64::from(frame.pixel_rotation.degrees()), "deg"),
    ];
    let ned_from_camera = chain.ned_from_camera();
    let ecef_from_ned = chain.tangent.ecef_from_ned();
    let ecef_from_camera = frame.ecef_from_camera();
    let rotation = |name, symbol, m| RotationEntry { name, symbol, rows: rows(m) };
    let rotations = vec![
        rotation("ecef_from_nav", "", ecef_from_ned.rotation.matrix()),
        rotation("nav_from_body", "C_nb", chain.ned_from_body.matrix()),
        rotation("body_from_gimbal", "C_bg", chain.body_from_gimbal.matrix()),
        rotation("gimbal_from_camera", "C_gc", chain.gimbal_from_camera.matrix()),
        rotation("nav_from_camera", "C_nb C_bg C_gc", ned_from_camera.rotation.matrix()),
        rotation("ecef_from_camera", "", ecef_from_camera.rotation.matrix()),
    ];
    let vectors = vec![
        arm("antenna_in_body", "from the UAV's reference point to the antenna", chain.antenna_in_body),
        arm("gimbal_in_body", "ArmG: from the UAV's reference point to the gimbal", chain.gimbal_in_body),
        arm("camera_in_gimbal", "ArmC: from the gimbal to the projection centre", chain.camera_in_gimbal),
        VectorEntry {
            name: "camera_in_nav",
            meaning: "projection centre from the antenna",
            metres: triple(ned_from_camera.origin.vector()),
        },
        VectorEntry {
            name: "antenna_in_ecef",
            meaning: "origin of NAV",
            metres: triple(ecef_from_ned.origin.vector()),
        },
        VectorEntry {
            name: "camera_in_ecef",
            meaning: "projection centre",
            metres: triple(ecef_from_camera.origin.vector()),
        },
    ];
    let interior_values = frame.camera.lens.interior();
    let [fx, fy, skew, cx, cy, ..] = interior_values;
    let interior = frame
        .camera
        .lens
        .names()
        .iter()
        .zip(interior_values)
        .map(|(name, value)| {
            let (name, unit) = name.strip_suffix("_px").map_or((*name, ""), |bare| (bare, "px"));
            number(name, value, unit)
        })
        .collect();
    Explanation {
        format: "boresight-explanation/2",
        frame: frame.name.clone(),
        log_line: record.line,
        time_s: record.time.map(Seconds::get),
        found: source.map(|source| source.found.clone()).unwrap_or_default(),
        read: source.map(|source| source.origins.to_vec()).unwrap_or_default(),
        applied: source.map(|source| source.applied.clone()).unwrap_or_default(),
        stated_std: source.map(|source| stated_std(&source.std)).unwrap_or_default(),
        given,
        rotations,
        vectors,
        interior_matrix_px: [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        interior,
        centre: centre(frame, projection),
    }
}

fn stated_std(std: &LoggedStd) -> Vec<Quantity> {
    let angle = |angle: Option<Radians>| angle.map(Radians::degrees);
    [
        ("std of the position towards north", std.north_m, "m"),
        ("std of the position towards east", std.east_m, "m"),
        ("std of the height", std.up_m, "m"),
        ("std of yaw", angle(std.yaw), "deg"),
        ("std of pitch", angle(std.pitch), "deg"),
        ("std of roll", angle(std.roll), "deg"),
    ]
    .into_iter()
    .filter_map(|(name, value, unit)| Some(Quantity { name: name.to_owned(), value: value?, unit }))
    .collect()
}

/// The image centre from pixel to map, step by step, as far as it gets.
fn centre(frame: &GeoreferencedFrame, projection: &Projection) -> Vec<Quantity> {
    let mut steps = Vec::new();
    let mut push = |name: &str, value: f64, unit: &'static str| {
        steps.push(Quantity { name: name.to_owned(), value, unit });
    };
    let stored = frame.image_centre();
    push("column", stored.column, "px");
    push("row", stored.row, "px");
    let sensor = frame.sensor_from_stored(stored);
    let Some(ray) = frame.camera.ray_from_pixel(sensor) else { return steps };
    push("x in camera, undistorted", ray.x(), "");
    push("y in camera, undistorted", ray.y(), "");
    let in_nav = frame.chain.ned_from_camera().rotation * ray;
    let unit = in_nav.vector().normalize();
    push("viewing ray towards north", unit.x, "");
    push("viewing ray towards east", unit.y, "");
    push("viewing ray downwards", unit.z, "");
    let Ok(ground) = frame.ground_from_pixel(stored) else { return steps };
    push("distance to the ground", ground.range_m, "m");
    push("ground latitude", ground.position.latitude.degrees(), "deg");
    push("ground longitude", ground.position.longitude.degrees(), "deg");
    push("ground height above the ellipsoid", ground.position.height.get(), "m");
    if let Ok(map) = projection.map_from_geodetic(&[ground.position]) {
        let unit = if projection.is_geographic() { "deg" } else { "map units" };
        push("easting", map[0].easting, unit);
        push("northing", map[0].northing, unit);
    }
    let camera = WGS84.geodetic_from_ecef(&frame.ecef_from_camera().origin);
    push("height of the camera above that ground", camera.height.get() - ground.position.height.get(), "m");
    steps
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.frame, self.found)?;
        match self.time_s {
            Some(time) => writeln!(f, ", exposed at {time} s")?,
            None => writeln!(f)?,
        }
        writeln!(f, "\nread")?;
        for origin in &self.read {
            writeln!(f, "  {:<28} {}: {}", origin.quantity, origin.from, origin.meaning)?;
        }
        if !self.applied.is_empty() {
            writeln!(f, "\napplied")?;
        }
        for sentence in &self.applied {
            writeln!(f, "  {sentence}")?;
        }
        if !self.stated_std.is_empty() {
            writeln!(f, "\nstated by the log (1 sigma)")?;
            quantities(f, &self.stated_std)?;
        }
        writeln!(f, "\ngiven")?;
        quantities(f, &self.given)?;
        writeln!(f, "\nrotations (components of the right frame in, of the left frame out)")?;
        for r in &self.rotations {
            let symbol = if r.symbol.is_empty() { String::new() } else { format!("   ({})", r.symbol) };
            writeln!(f, "  {}{symbol}", r.name)?;
            for row in r.rows {
                writeln!(f, "    {:>14.9} {:>14.9} {:>14.9}", row[0], row[1], row[2])?;
            }
        }
        writeln!(f, "\nvectors, metres")?;
        for v in &self.vectors {
            let [x, y, z] = v.metres;
            writeln!(f, "  {:<18} {x:>16.4} {y:>16.4} {z:>16.4}   {}", v.name, v.meaning)?;
        }
        writeln!(f, "\ncamera: K of eq. (4), pixels")?;
        for row in self.interior_matrix_px {
            writeln!(f, "    {:>12.4} {:>12.4} {:>12.4}", row[0], row[1], row[2])?;
        }
        quantities(f, &self.interior)?;
        writeln!(f, "\nthe image centre through the chain")?;
        quantities(f, &self.centre)?;
        if !self.centre.iter().any(|q| q.name == "distance to the ground") {
            writeln!(f, "  the image centre sees no ground")?;
        }
        Ok(())
    }
}

fn quantities(f: &mut fmt::Formatter<'_>, all: &[Quantity]) -> fmt::Result {
    for q in all {
        // Angles and coordinates to a tenth of a millimetre on the ground.
        let decimals = match q.unit {
            "deg" => 9,
            "m" | "px" | "map units" => 4,
            _ => 9,
        };
        writeln!(f, "  {:<52} {:>18.decimals$} {}", q.name, q.value, q.unit)?;
    }
    Ok(())
}
