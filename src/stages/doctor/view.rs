//! The numbers of a flight that findings are made from, free of rotations and datums.

use super::overlap::Overlap;
use super::turns::Turns;
use super::{Georeferenced, PhotosByName};
use crate::config::Config;
use crate::config::georeference::Ground;
use crate::config::log::LogSource;
use crate::formats::flight::LoggedPosition;
use crate::formats::geoid::Geoid;
use crate::formats::metadata::PhotoMetadata;
use crate::geodesy::{Geodetic, GeoidModel, LocalTangent, WGS84};
use crate::geometry::{Camera, Displacement, Ecef, Ned, Point};
use crate::georeference::GeoreferencedFrame;
use crate::navigation::GimbalReference;
use crate::units::{Metres, Seconds};
use std::collections::BTreeMap;

/// One used frame, seen from above. Places are east and north in metres.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct View {
    pub name: String,
    /// On whatever clock all frames share.
    pub time_s: Option<f64>,
    /// Of the antenna.
    pub place: [f64; 2],
    /// Of the antenna, above the ellipsoid.
    pub height_m: f64,
    /// Of the ground under the antenna, above the ellipsoid.
    pub ground_m: Option<f64>,
    /// Height above ground as stated.
    pub above_ground_m: Option<f64>,
    /// Height above the take-off point as stated.
    pub above_takeoff_m: Option<f64>,
    /// Where the photo itself says it was.
    pub photo_place: Option<[f64; 2]>,
    /// Yaw of the body, or of the camera where the log states that, clockwise from true north.
    pub nose_deg: Option<f64>,
    /// Where the top of the sensor points, clockwise from true north.
    pub top_deg: Option<f64>,
    /// Pan of a gimbal that counts from north.
    pub pan_deg: Option<f64>,
    /// All angles of the record are exactly zero and no gimbal is logged.
    pub without_angles: bool,
    /// How the stored pixels are declared to be turned.
    pub turned_deg: u32,
    pub outline: Vec<[f64; 2]>,
    /// What the middle of the image sees.
    pub centre: [f64; 2],
    pub clipped: bool,
    pub gsd_m: f64,
    pub off_nadir_deg: f64,
    pub height_above_ground_m: f64,
    /// Speed over ground as stated, and by whom.
    pub stated_speed: Option<(f64, &'static str)>,
    pub exposure_time_s: Option<f64>,
}

/// What the pipeline file says that findings depend on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declared {
    /// One sigma of the angle between course and nose, degrees, where yaw is declared to be the course.
    pub crab_std_deg: Option<f64>,
    /// One sigma of the antenna's height, and whether the pipeline file states it.
    pub height_std_m: (f64, bool),
    /// One sigma of the ground's height, and whether the pipeline file states it.
    pub ground_std_m: (f64, bool),
    /// The ground has heights of its own, so that others can be compared with it.
    pub ground_has_heights: bool,
    /// The poses are what the photos say.
    pub log_is_photos: bool,
    /// More frames are rejected than the run allows.
    pub too_many_rejected: bool,
}

/// Where one frame stands in the alignment of photos and exposures.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Match {
    pub residual_s: Option<f64>,
    pub probability: Option<f64>,
}

/// A flight, ready to be examined.
#[derive(Debug, Clone)]
pub(super) struct Flight<'a> {
    pub declared: Declared,
    pub views: Vec<View>,
    /// Indices of `views` in the order they were taken.
    pub order: Vec<usize>,
    pub rejected: Vec<(String, String)>,
    pub photos: &'a PhotosByName,
    pub matches: BTreeMap<String, Match>,
    /// One sigma of the offset between the clocks of photos and log, where times were aligned.
    pub clock_std_s: Option<f64>,
    /// Whether only the number of photos and exposures decided how they were matched.
    pub rests_on_count: bool,
    /// Height of the geoid above the ellipsoid at the survey.
    pub undulation_m: Option<f64>,
    pub overlap: Option<Overlap>,
    pub turns: Option<Turns>,
    pub sharpness: BTreeMap<String, f64>,
    plane: Option<LocalTangent>,
}

/// One sigma of a satellite receiver's height where nothing is declared, metres.
const GNSS_STD_M: f64 = 5.0;
/// One sigma of an elevation model where nothing is declared, metres.
const GROUND_STD_M: f64 = 5.0;

impl<'a> Flight<'a> {
    pub(super) fn new(config: &Config, survey: &Georeferenced, photos: &'a PhotosByName) -> Self {
        let plane = (!survey.frames.is_empty()).then(|| {
            let sum = survey.frames.iter().fold(nalgebra::Vector3::zeros(), |sum, frame| {
                sum + WGS84.ecef_from_geodetic(&frame.record.antenna).vector()
            });
            let middle = WGS84.geodetic_from_ecef(&Point::from_vector(sum / survey.frames.len() as f64));
            LocalTangent::at(middle.at_height(0.0))
        });
        let mut views: Vec<View> = match &plane {
            None => Vec::new(),
            Some(plane) => survey.frames.iter().map(|frame| view(frame, survey, photos, plane)).collect(),
        };
        times(&mut views, survey, photos);
        let undulation_m = plane.as_ref().and_then(|plane| {
            let constant = config.georeference.as_ref().and_then(|g| g.geoid_undulation_m);
            let geoid = constant.map_or(Geoid::Grids, Geoid::Constant);
            geoid.undulations(GeoidModel::Egm96, &[*plane.origin()]).ok()?.first().copied()
        });
        let matching = survey.matching.as_ref();
        let matches = matching
            .iter()
            .flat_map(|report| &report.rows)
            .filter(|row| !row.frame.is_empty())
            .map(|row| {
                (row.frame.clone(), Match { residual_s: row.residual_s, probability: row.probability })
            })
            .collect();
        Self {
            declared: declared(config, survey),
            order: order(&views),
            views,
            rejected: survey.rejected.iter().map(|r| (r.frame.clone(), r.reason.clone())).collect(),
            photos,
            matches,
            rests_on_count: matching.is_some_and(|report| report.rests_on_count),
            clock_std_s: matching.and_then(|report| Some(report.clock?.offset_std.get())),
            undulation_m,
            overlap: None,
            turns: None,
            sharpness: BTreeMap::new(),
            plane,
        }
    }

    /// What a frame's photo says, if it could be read.
    pub(super) fn photo(&self, name: &str) -> Option<&PhotoMetadata> {
        self.photos.get(name)?.as_ref().ok()
    }

    /// Pairs of views that follow each other, in order.
    pub(super) fn steps(&self) -> impl Iterator<Item = (&View, &View)> {
        self.order.windows(2).map(|pair| (&self.views[pair[0]], &self.views[pair[1]]))
    }

    /// Where rejected frames say they were taken.
    pub(super) fn rejected_places(&self) -> Vec<[f64; 2]> {
        let Some(plane) = &self.plane else { return Vec::new() };
        self.rejected.iter().filter_map(|(name, _)| place_of_photo(self.photo(name)?, plane)).collect()
    }

    /// Worth of the last digit of the frames' times, seconds: 1 when all are whole.
    pub(super) fn time_resolution_s(&self) -> f64 {
        match self.views.iter().filter_map(|view| view.time_s).all(|time| time.fract() == 0.0) {
            true => 1.0,
            false => 0.0,
        }
    }

    #[cfg(test)]
    pub(super) fn made(views: Vec<View>, photos: &'a PhotosByName) -> Self {
        Self {
            declared: Declared {
                crab_std_deg: None,
                height_std_m: (GNSS_STD_M, false),
                ground_std_m: (GROUND_STD_M, false),
                ground_has_heights: true,
                log_is_photos: false,
                too_many_rejected: false,
            },
            order: order(&views),
            views,
            rejected: Vec::new(),
            photos,
            matches: BTreeMap::new(),
            rests_on_count: false,
            clock_std_s: None,
            undulation_m: None,
            overlap: None,
            turns: None,
            sharpness: BTreeMap::new(),
            plane: None,
        }
    }
}

fn declared(config: &Config, survey: &Georeferenced) -> Declared {
    let georeference = config.georeference.as_ref();
    let sigmas = config.accuracy.as_ref().map(|accuracy| &accuracy.sigmas);
    let stated = |value: Option<f64>, otherwise: f64| {
        value.filter(|v| *v > 0.0).map_or((otherwise, false), |v| (v, true))
    };
    Declared {
        crab_std_deg: georeference
            .and_then(|g| g.log.crab_std_rad)
            .map(|crab| crate::units::Radians::new(crab).degrees()),
        height_std_m: stated(sigmas.map(|s| s.height_m), GNSS_STD_M),
        ground_std_m: stated(sigmas.map(|s| s.ground_height_m), GROUND_STD_M),
        ground_has_heights: georeference.is_some_and(|g| !matches!(g.ground, Ground::BelowCamera(_))),
        log_is_photos: georeference.is_some_and(|g| matches!(g.log.source, LogSource::Photos)),
        too_many_rejected: config.run.max_rejected_frames.is_exceeded_by(survey.rejected.len()),
    }
}

fn east_north(plane: &LocalTangent, at: &Point<Ecef>) -> [f64; 2] {
    let there: Point<Ned> = plane.ecef_from_ned().inverse() * *at;
    [there.y(), there.x()]
}

fn place_of_photo(photo: &PhotoMetadata, plane: &LocalTangent) -> Option<[f64; 2]> {
    match photo.exposure.position? {
        LoggedPosition::Geodetic { latitude, longitude, height_m, .. } => {
            let at = Geodetic { latitude, longitude, height: Metres::new(height_m) };
            Some(east_north(plane, &WGS84.ecef_from_geodetic(&at)))
        }
        LoggedPosition::Ecef(point) => Some(east_north(plane, &point)),
        LoggedPosition::Projected { .. } => None,
    }
}

fn view(
    frame: &GeoreferencedFrame,
    survey: &Georeferenced,
    photos: &PhotosByName,
    plane: &LocalTangent,
) -> View {
    let photo = photos.get(&frame.name).and_then(|photo| photo.as_ref().ok());
    let record = &frame.record;
    let flat = |at: &Geodetic| east_north(plane, &WGS84.ecef_from_geodetic(at));
    let source = survey.sources.get(&frame.name);
    let angles = [record.attitude.yaw, record.attitude.pitch, record.attitude.roll];
    let no_angles = angles.iter().all(|angle| angle.get() == 0.0);
    let pan = record.gimbal.filter(|_| frame.mount.gimbal_reference == GimbalReference::Nav);
    let logs_speed = source.is_some_and(|source| {
        source.origins.iter().any(|o| o.quantity.contains("speed") || o.quantity.contains("velocity"))
    });
    let speed_of = |ground: Option<f64>, velocity: Option<Displacement<Ned>>| {
        ground.or_else(|| velocity.map(|v| v.x().hypot(v.y())))
    };
    let by_log = speed_of(record.ground_speed_m_s, record.velocity).filter(|_| logs_speed);
    let by_photo = photo.and_then(|p| speed_of(p.exposure.ground_speed_m_s, p.exposure.velocity));
    let antenna_ground = frame.ground.heights(&[record.antenna]);
    View {
        name: frame.name.clone(),
        time_s: record.time.map(Seconds::get),
        place: flat(&record.antenna),
        height_m: record.antenna.height.get(),
        ground_m: antenna_ground.into_iter().next().and_then(Result::ok),
        above_ground_m: record.height_above_ground_m,
        above_takeoff_m: source
            .and_then(|source| source.height_above_takeoff_m)
            .or_else(|| photo.and_then(|p| p.exposure.height_above_takeoff_m)),
        photo_place: photo.and_then(|photo| place_of_photo(photo, plane)),
        nose_deg: (!(no_angles && pan.is_some())).then(|| record.attitude.yaw.degrees()),
        top_deg: top_of_sensor(frame),
        pan_deg: pan.map(|gimbal| gimbal.pan.degrees()),
        without_angles: no_angles && record.gimbal.is_none(),
        turned_deg: frame.pixel_rotation.degrees(),
        outline: frame.footprint.outline.iter().map(|vertex| flat(&vertex.position)).collect(),
        centre: frame.footprint.anchor.map_or_else(|| flat(&record.antenna), |a| flat(&a.position)),
        clipped: frame.footprint.clipped,
        gsd_m: frame.footprint.gsd_m,
        off_nadir_deg: crate::units::Radians::new(frame.footprint.off_nadir).degrees(),
        height_above_ground_m: frame.footprint.height_above_ground_m,
        stated_speed: by_log.map(|s| (s, "log")).or(by_photo.map(|s| (s, "photo"))),
        exposure_time_s: photo.and_then(|photo| photo.exposure_time_s),
    }
}

/// Azimuth of the sensor's upper edge; `None` for a camera that looks so flat that it says nothing.
fn top_of_sensor(frame: &GeoreferencedFrame) -> Option<f64> {
    let ned_from_camera =
        frame.chain.tangent.ecef_from_ned().rotation.inverse() * frame.ecef_from_camera().rotation;
    let top: Displacement<Ned> = ned_from_camera * Displacement::<Camera>::new(0.0, -1.0, 0.0);
    let azimuth = crate::units::Radians::new(top.y().atan2(top.x())).degrees();
    (top.x().hypot(top.y()) > 0.3).then_some(azimuth)
}

/// Gives all views a time on one clock: the log's, or the photos' own, or none of them any.
fn times(views: &mut [View], survey: &Georeferenced, photos: &PhotosByName) {
    if survey.frames.iter().all(|frame| frame.record.time.is_some()) {
        return;
    }
    let photo = |view: &View| photos.get(&view.name).and_then(|photo| photo.as_ref().ok());
    let utc = |view: &View| Some(photo(view)?.times.utc(None)?.time.get());
    let civil = |view: &View| Some(photo(view)?.times.civil?.time.get());
    let of_all =
        |time: &dyn Fn(&View) -> Option<f64>| -> Option<Vec<f64>> { views.iter().map(time).collect() };
    let of_views = of_all(&utc).or_else(|| of_all(&civil));
    for (index, view) in views.iter_mut().enumerate() {
        view.time_s = of_views.as_ref().map(|times| times[index]);
    }
}

/// By time, and by name where times do not tell.
fn order(views: &[View]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|a, b| {
        let (a, b) = (&views[*a], &views[*b]);
        let times = a.time_s.zip(b.time_s).map(|(a, b)| a.total_cmp(&b));
        times.unwrap_or(std::cmp::Ordering::Equal).then_with(|| a.name.cmp(&b.name))
    });
    order
}

/// Distance between two places, metres.
pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Direction from one place to another, degrees clockwise from north.
pub(super) fn bearing(from: [f64; 2], to: [f64; 2]) -> f64 {
    crate::units::Radians::new((to[0] - from[0]).atan2(to[1] - from[1])).degrees()
}

/// Signed difference of two directions within ±180°.
pub(super) fn turn(from_deg: f64, to_deg: f64) -> f64 {
    crate::units::Radians::from_degrees(to_deg - from_deg).wrapped().degrees()
}

/// Middle value; `None` of nothing.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
    }
}

/// Value that `share` of the values do not exceed.
pub(super) fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    values.retain(|value| value.is_finite());
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    values.get((share * last as f64).ceil() as usize).copied()
}
