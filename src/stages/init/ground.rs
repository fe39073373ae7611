//! The ground: an elevation model with its datum settled by the survey's own heights, or what the log knows of it.

use super::Survey;
use super::poses::{Source, kind, median, place};
use super::scan::{FileKind, RasterKind, shown};
use super::write::{Line, quoted_path, rounded, text};
use crate::config::height::VerticalDatum;
use crate::formats::crs::Projection;
use crate::formats::elevation::read_elevation;
use crate::formats::geoid::Geoid;
use crate::geodesy::{Geodetic, GeoidModel, HeightKind};
use crate::terrain::{Dem, Terrain};
use std::path::Path;
use std::sync::Arc;

/// An elevation model has to hold heights below this share of the photos.
const ENOUGH: f64 = 0.2;
/// Undulations smaller than this leave the two datums apart by less than their heights are good for.
const TELLING_UNDULATION_M: f64 = 5.0;

/// The words of the pipeline file.
const fn word(datum: VerticalDatum) -> &'static str {
    match datum {
        VerticalDatum::Ellipsoid => "ellipsoid",
        VerticalDatum::Egm96 => "egm96",
        VerticalDatum::Egm2008 => "egm2008",
    }
}

/// One photo's heights.
#[derive(Debug, Clone, Copy)]
struct Camera {
    at: Geodetic,
    /// As stated, metres.
    height: f64,
    kind: HeightKind,
    above_takeoff: Option<f64>,
}

impl Camera {
    /// Above the ellipsoid; `None` for a height that is above take-off or ground.
    fn ellipsoidal(&self, undulation: f64) -> Option<f64> {
        match self.kind {
            HeightKind::Ellipsoid => Some(self.height),
            HeightKind::SeaLevel(_) => Some(self.height + undulation),
            _ => None,
        }
    }
}

/// The model chosen among those found.
struct Model<'a> {
    path: &'a Path,
    words: &'a str,
    /// Its own heights below the photos.
    below: Vec<Option<f64>>,
    spacing_m: f64,
}

/// Lines of `[georeference.log]` for heights that count from the take-off point, and `[georeference.ground]`; and why.
pub fn ground(survey: &Survey<'_>, source: &Source, left_out: &mut Vec<String>) -> (Vec<Line>, Vec<Line>) {
    let cameras: Vec<Camera> = source
        .exposures
        .iter()
        .filter_map(|exposure| {
            let at = place(exposure)?;
            let above_takeoff = exposure.height_above_takeoff_m;
            Some(Camera { at, height: at.height.get(), kind: kind(exposure)?, above_takeoff })
        })
        .collect();
    let at: Vec<Geodetic> = cameras.iter().map(|camera| camera.at).collect();
    // Without a grid the datums cannot be told apart; the run would name the grid.
    let undulation = at
        .first()
        .and_then(|first| Geoid::Grids.undulations(GeoidModel::Egm96, &[*first]).ok()?.first().copied());
    let mut lines = vec![Line::Table("georeference.ground")];
    match model(survey, &at, left_out) {
        Some(model) => {
            let below = model.below.iter().flatten().next().copied().unwrap_or(0.0);
            with_model(survey, source, &model, &cameras, undulation, &mut lines);
            (takeoff(&cameras, Some(below)), lines)
        }
        None => {
            without_model(survey, source, &cameras, 0.0, &mut lines);
            (takeoff(&cameras, None), lines)
        }
    }
}

/// The take-off point's height, where the log's heights count from it.
fn takeoff(cameras: &[Camera], below_first_m: Option<f64>) -> Vec<Line> {
    let Some(HeightKind::AboveTakeoff | HeightKind::Barometric) = cameras.first().map(|camera| camera.kind)
    else {
        return Vec::new();
    };
    let why = match below_first_m {
        Some(_) => {
            "how high above the sea is the take-off point, from which the heights count? Meanwhile it is the elevation \
             model's height below the first photo; frames come out as many metres too high or too low as that is off"
        }
        None => {
            "how high above the sea is the take-off point, from which the heights count? Meanwhile 0 m, and the ground lies \
             at it: places do not suffer, heights of the products do"
        }
    };
    let value =
        format!("{{ value = \"{} m\", datum = \"egm96\" }}", rounded(below_first_m.unwrap_or(0.0), 1));
    vec![Line::Question(why.to_owned()), Line::Key("takeoff_height".to_owned(), value)]
}

/// The model with heights below most photos; of equals the finest.
fn model<'a>(survey: &Survey<'a>, at: &[Geodetic], left_out: &mut Vec<String>) -> Option<Model<'a>> {
    let mut models = Vec::new();
    for found in &survey.scan.files {
        let FileKind::Raster(RasterKind::Heights { words }) = &found.kind else { continue };
        let name = shown(survey.root, &found.path);
        let read = read_elevation(&found.path).map_err(|e| e.cause).and_then(|raster| {
            let projection = Projection::new(&raster.wkt).map_err(|e| e.to_string())?;
            let spacing =
                raster.grid.per_column.0.hypot(raster.grid.per_column.1) * projection.metres_per_unit();
            Dem::new(raster.heights, raster.grid, Arc::new(projection), spacing)
                .ok_or_else(|| "holds no data anywhere".to_owned())
                .map(|dem| (dem, spacing))
        });
        match read {
            Err(cause) => left_out.push(format!("{name}: {cause}")),
            Ok((dem, spacing_m)) => {
                let below: Vec<Option<f64>> = dem.heights(at).into_iter().map(Result::ok).collect();
                models.push(Model { path: &found.path, words, below, spacing_m });
            }
        }
    }
    let covered = |model: &Model<'_>| model.below.iter().flatten().count();
    models.sort_by(|a, b| covered(b).cmp(&covered(a)).then(a.spacing_m.total_cmp(&b.spacing_m)));
    let mut models = models.into_iter();
    let best = models.next()?;
    for other in models {
        left_out.push(format!("{}: another elevation model is used", shown(survey.root, other.path)));
    }
    if covered(&best) as f64 >= ENOUGH * at.len().max(1) as f64 {
        return Some(best);
    }
    left_out.push(format!(
        "{}: holds heights below {} of {} photos only",
        shown(survey.root, best.path),
        covered(&best),
        at.len()
    ));
    None
}

fn with_model(
    survey: &Survey<'_>,
    source: &Source,
    model: &Model<'_>,
    cameras: &[Camera],
    undulation: Option<f64>,
    lines: &mut Vec<Line>,
) {
    let covered = model.below.iter().flatten().count();
    lines.push(Line::Note(format!(
        "{} holds heights below {covered} of {} photos.",
        shown(survey.root, model.path),
        cameras.len()
    )));
    lines.push(text("kind", "dem"));
    lines.push(Line::Key("file".to_owned(), quoted_path(survey.base, model.path)));
    let (datum, why) = datum(model, cameras, undulation, source.heights_are_stated);
    lines.push(why);
    lines.push(text("datum", word(datum)));
    if let Some(height) = median(model.below.iter().flatten().copied().collect()) {
        lines.push(Line::Note("Where it is empty: its median below the photos.".to_owned()));
        lines.push(text("fallback_height", &format!("{height:.1} m")));
    }
}

/// What a model's heights are measured from, and how that is known.
fn datum(
    model: &Model<'_>,
    cameras: &[Camera],
    undulation: Option<f64>,
    stated: bool,
) -> (VerticalDatum, Line) {
    let says = |words: &[&str]| words.iter().any(|word| model.words.contains(word));
    let own = if says(&["egm2008", "egm08"]) {
        Some(VerticalDatum::Egm2008)
    } else if says(&["egm96", "sea level", "orthometric"]) {
        Some(VerticalDatum::Egm96)
    } else {
        says(&["ellipsoid"]).then_some(VerticalDatum::Ellipsoid)
    };
    if let Some(own) = own {
        return (own, Line::Note(format!("Its own words: \"{}\".", model.words.trim())));
    }
    let Some(n) = undulation else {
        return (
            VerticalDatum::Egm96,
            Line::Assumed(
                "its heights are above sea level (EGM96): no geoid grid is installed to compare them"
                    .to_owned(),
            ),
        );
    };
    let (by_takeoff, above) = heights_below(model, cameras, n);
    if let (Some((ground, sea, ellipsoid)), true) = (by_takeoff, n.abs() >= TELLING_UNDULATION_M) {
        let is_sea = sea.abs() < ellipsoid.abs();
        let words = format!(
            "the heights of the photos less those above take-off put the take-off point at {ground:.1} m above the \
             ellipsoid; the model below the photos lies {sea:+.1} m from that if its heights are above sea level (EGM96, \
             undulation {n:.1} m here), {ellipsoid:+.1} m if above the ellipsoid"
        );
        let chosen = if is_sea { VerticalDatum::Egm96 } else { VerticalDatum::Ellipsoid };
        let beyond = sea.abs().min(ellipsoid.abs());
        if beyond < 0.5 * n.abs() {
            let open = if stated {
                ""
            } else {
                ". What the photos' heights count from is assumed above: only both together \
                can be wrong, which moves heights, not places"
            };
            return (chosen, Line::Note(format!("Settled by the survey itself: {words}{open}.")));
        }
        return (
            chosen,
            Line::Question(format!(
                "are the model's heights above sea level or above the ellipsoid? Neither fits well: {words}. Meanwhile the \
                 nearer of the two; whoever made the model knows"
            )),
        );
    }
    let Some((sea, ellipsoid)) = above else {
        return (VerticalDatum::Egm96, Line::Assumed("its heights are above sea level (EGM96)".to_owned()));
    };
    let same = match cameras.first().map(|camera| camera.kind) {
        Some(HeightKind::Ellipsoid) => VerticalDatum::Ellipsoid,
        _ => VerticalDatum::Egm96,
    };
    let plausible = |height: f64| (5.0..5000.0).contains(&height);
    let numbers = format!(
        "the photos are then {sea:.0} m above the ground if the model counts from sea level (EGM96), {ellipsoid:.0} m if \
         from the ellipsoid"
    );
    match (plausible(sea), plausible(ellipsoid)) {
        (true, false) => {
            (VerticalDatum::Egm96, Line::Note(format!("Settled by the survey itself: {numbers}.")))
        }
        (false, true) => {
            (VerticalDatum::Ellipsoid, Line::Note(format!("Settled by the survey itself: {numbers}.")))
        }
        _ if n.abs() < TELLING_UNDULATION_M => (
            same,
            Line::Assumed(format!("the model's heights count from the same as the photos'; {numbers}")),
        ),
        _ => (
            same,
            Line::Question(format!(
                "are the model's heights above sea level or above the ellipsoid? Nothing says it, and {numbers}: which of the \
                 two did the UAV fly at? Meanwhile they count from the same as the photos'"
            )),
        ),
    }
}

/// Against a take-off point's height: (ground, model − ground if above sea level, if above the ellipsoid); and the
/// photos' heights above the model under both, all ellipsoidal medians.
type Heights = (Option<(f64, f64, f64)>, Option<(f64, f64)>);

fn heights_below(model: &Model<'_>, cameras: &[Camera], n: f64) -> Heights {
    let both = || {
        cameras
            .iter()
            .zip(&model.below)
            .filter_map(|(camera, below)| Some((camera, camera.ellipsoidal(n)?, (*below)?)))
    };
    let takeoff = median(both().filter_map(|(c, height, _)| Some(height - c.above_takeoff?)).collect());
    let apart =
        median(both().filter_map(|(c, height, below)| Some(below - (height - c.above_takeoff?))).collect());
    let above = median(both().map(|(_, height, below)| height - below).collect());
    (
        takeoff.zip(apart).map(|(ground, apart)| (ground, apart + n, apart)),
        above.map(|above| (above - n, above)),
    )
}

fn without_model(
    survey: &Survey<'_>,
    source: &Source,
    cameras: &[Camera],
    takeoff_m: f64,
    lines: &mut Vec<Line>,
) {
    let all = source.exposures.len();
    let above_ground =
        source.exposures.iter().filter_map(|e| e.height_above_ground_m).filter(|h| *h > 0.0).count();
    if all > 0 && above_ground == all && (source.is_photos || source.by_name) {
        lines.push(Line::Note("Every photo states its height above the ground below it.".to_owned()));
        lines.push(text("kind", "below_camera"));
        return;
    }
    if let Some(scenario) = survey.scenario.as_ref().filter(|_| !source.is_photos) {
        lines.push(Line::Note("As the simulated survey's own scenario.toml has it ([site]).".to_owned()));
        lines.push(text("kind", "plane"));
        lines.push(text("height", &format!("{} m", scenario.site.ground_height_ellipsoid_m)));
        lines.push(text("datum", "ellipsoid"));
        return;
    }
    if let Some(HeightKind::AboveTakeoff | HeightKind::Barometric) = cameras.first().map(|camera| camera.kind)
    {
        lines.push(Line::Assumed(
            "the ground is level at the height of the take-off point. No elevation model was found"
                .to_owned(),
        ));
        lines.push(text("kind", "plane"));
        lines.push(text("height", &format!("{} m", rounded(takeoff_m, 1))));
        lines.push(text("datum", "egm96"));
        return;
    }
    let ground = |camera: &Camera| Some(camera.height - camera.above_takeoff?);
    if let Some(height) = median(cameras.iter().filter_map(ground).collect())
        && let Some(datum) = cameras.first().and_then(|camera| absolute(camera.kind))
    {
        let agl = median(cameras.iter().filter_map(|camera| camera.above_takeoff).collect())
            .unwrap_or(100.0)
            .max(1.0);
        lines.push(Line::Assumed(format!(
            "the ground is level, at the height of the take-off point ({height:.1} m: the median of each photo's height less \
             its height above take-off). No elevation model was found. Each metre that the ground is higher makes a frame \
             {:.1} % too large and moves its edges apart from its neighbours'",
            100.0 / agl
        )));
        lines.push(text("kind", "plane"));
        lines.push(text("height", &format!("{height:.1} m")));
        lines.push(text("datum", word(datum)));
        return;
    }
    if let Some(points) = points_below(survey, cameras) {
        lines.extend(points);
        return;
    }
    lines.push(Line::Question(
        "how high is the ground? No elevation model was found, and no photo says how high above take-off or ground it was \
         taken. Meanwhile it lies 100 m below each photo; frames come out as many per cent too large or too small as that is \
         off. Give the flying height here, kind = \"plane\" with height and datum, or an elevation model"
            .to_owned(),
    ));
    lines.push(text("kind", "below_camera"));
    lines.push(text("height_above_ground", "100 m"));
}

/// The ground by points that somebody measured where the photos were taken.
fn points_below(survey: &Survey<'_>, cameras: &[Camera]) -> Option<Vec<Line>> {
    /// Half a kilometre beyond the photos, in radians of latitude.
    const MARGIN: f64 = 500.0 / 6_371_000.0;
    let bounds = |of: &dyn Fn(&Geodetic) -> f64| {
        let values = cameras.iter().map(|camera| of(&camera.at));
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (south, north) = bounds(&|at| at.latitude.get());
    let (west, east) = bounds(&|at| at.longitude.get());
    let inside = |at: &&Geodetic| {
        let (latitude, longitude) = (at.latitude.get(), at.longitude.get());
        let wide = MARGIN / latitude.cos();
        (south - MARGIN..=north + MARGIN).contains(&latitude)
            && (west - wide..=east + wide).contains(&longitude)
    };
    let of_table = |path: &Path, delimiter| {
        let points = super::tables::points(path, delimiter)?;
        let heights: Vec<f64> = points.places.iter().filter(inside).map(|at| at.height.get()).collect();
        (heights.len() >= 3).then_some((points, heights))
    };
    let tables = survey.scan.files.iter().filter_map(|found| match found.kind {
        FileKind::Table { delimiter } if survey.tables.iter().all(|table| table.path != found.path) => {
            of_table(&found.path, delimiter)
        }
        _ => None,
    });
    let mut tables: Vec<_> = tables.collect();
    tables.sort_by_key(|(_, heights)| std::cmp::Reverse(heights.len()));
    let (points, heights) = tables.into_iter().next()?;
    let (low, high) =
        heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let middle = median(heights.clone())?;
    Some(vec![
        Line::Assumed(format!(
            "the ground is level at the median height of the {} points of {} that lie among the photos ({low:.1} to {high:.1} \
             m). No elevation model was found, and no photo says how high above take-off it was taken",
            heights.len(),
            shown(survey.root, &points.path)
        )),
        text("kind", "plane"),
        text("height", &format!("{middle:.1} m")),
        text("datum", points.datum),
    ])
}

/// The datum of a height that is absolute.
const fn absolute(kind: HeightKind) -> Option<VerticalDatum> {
    match kind {
        HeightKind::Ellipsoid => Some(VerticalDatum::Ellipsoid),
        HeightKind::SeaLevel(GeoidModel::Egm96) => Some(VerticalDatum::Egm96),
        HeightKind::SeaLevel(GeoidModel::Egm2008) => Some(VerticalDatum::Egm2008),
        HeightKind::Barometric | HeightKind::AboveTakeoff | HeightKind::AboveGround => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras(height: f64, kind: HeightKind, above_takeoff: Option<f64>) -> Vec<Camera> {
        let at = Geodetic::from_degrees(41.0, -83.0, height);
        vec![Camera { at, height, kind, above_takeoff }; 3]
    }

    fn decided(below: f64, words: &str, cameras: &[Camera], n: f64) -> (VerticalDatum, Line) {
        let model = Model { path: Path::new("dem.tif"), words, below: vec![Some(below); 3], spacing_m: 1.0 };
        datum(&model, cameras, Some(n), true)
    }

    #[test]
    fn a_model_s_datum_follows_from_the_flying_heights() {
        let sea = HeightKind::SeaLevel(GeoidModel::Egm96);
        // Take-off at 250 m above the sea, 215 m above the ellipsoid; the model at 255 m or 220 m.
        let flown = cameras(320.0, sea, Some(70.0));
        let (by_sea, line) = decided(255.0, "", &flown, -35.0);
        assert_eq!(by_sea, VerticalDatum::Egm96);
        assert!(
            matches!(&line, Line::Note(words) if words.contains("+5.0 m") && words.contains("+40.0 m")),
            "{line:?}"
        );
        assert_eq!(decided(220.0, "", &flown, -35.0).0, VerticalDatum::Ellipsoid);
        // Half way between the two nothing is settled.
        assert!(matches!(decided(235.0, "", &flown, -35.0).1, Line::Question(_)));
        // Its own words go before any numbers.
        assert_eq!(
            decided(255.0, "height above the wgs 84 ellipsoid, metres", &flown, -35.0).0,
            VerticalDatum::Ellipsoid
        );
    }

    #[test]
    fn without_take_off_only_the_possible_remains() {
        let flown = cameras(240.0, HeightKind::Ellipsoid, None);
        // Above the sea the ground would be at 215 m, below the UAV; above the ellipsoid at 250 m, over it.
        assert_eq!(decided(250.0, "", &flown, -35.0).0, VerticalDatum::Egm96);
        let (datum, line) = decided(180.0, "", &flown, -35.0);
        assert_eq!(datum, VerticalDatum::Ellipsoid);
        assert!(
            matches!(&line, Line::Question(words) if words.contains("95 m") && words.contains("60 m")),
            "{line:?}"
        );
        assert!(matches!(decided(180.0, "", &flown, -2.0).1, Line::Assumed(_)));
    }
}
