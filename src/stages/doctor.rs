//! What a careful colleague would say about a flight before it is rendered: a row per frame, how the ground is covered,
//! and a list of findings. Nothing is written and, unless asked for, no pixel decoded.
//!
//! Lengths, courses and areas count in the plane that touches the ellipsoid under the middle of the survey (north up):
//! true metres whatever the CRS of the products.

mod findings;
mod frames;
mod headings;
mod heights;
mod metadata;
mod motion;
mod overlap;
mod picture;
mod pixels;
mod turns;
mod view;

pub use findings::Finding;
pub use frames::FrameRow;
pub use overlap::{Overlap, Share};
pub use picture::picture;
pub use turns::{TurnVerdict, Turns};

use super::georeference::Georeferenced;
use crate::config::Config;
use crate::formats::metadata::{PhotoMetadata, Severity};
use overlap::Coverage;
use std::collections::BTreeMap;
use view::{Flight, View};

/// What photos say about themselves, by file name; words for one that cannot be read.
pub type PhotosByName = BTreeMap<String, Result<PhotoMetadata, String>>;

/// What is looked at beside the metadata. Both decode the photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Measure how sharp each photo is against the others.
    pub sharpness: bool,
    /// Compare neighbouring photos on the ground, to find pixels that were turned.
    pub overlaps: bool,
}

/// Everything found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Diagnosis {
    /// Name and version of this record.
    pub format: &'static str,
    /// What the user should know, the gravest first.
    pub findings: Vec<Finding>,
    /// How the ground is covered; `None` when no frame is used.
    pub overlap: Option<Overlap>,
    /// What the pixels say about turned photos; only on request.
    pub pixel_turns: Option<Turns>,
    /// One row per image, by name.
    pub frames: Vec<FrameRow>,
    #[serde(skip)]
    views: Vec<View>,
    #[serde(skip)]
    order: Vec<usize>,
    #[serde(skip)]
    rejected_places: Vec<[f64; 2]>,
    #[serde(skip)]
    coverage: Option<Coverage>,
}

impl Diagnosis {
    /// How many findings have a severity.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }
}

/// Examines a georeferenced survey.
///
/// - `photos`: the metadata of its images, used or not; what is missing there counts as not stated.
#[must_use]
pub fn examine(
    config: &Config,
    survey: &Georeferenced,
    photos: &PhotosByName,
    options: Options,
) -> Diagnosis {
    let mut flight = Flight::new(config, survey, photos);
    let (overlap, coverage) = overlap::of(&flight.views, &flight.order);
    flight.overlap = overlap;
    if let (true, Some(declared)) = (options.overlaps, &config.georeference) {
        flight.turns = Some(turns::of(&survey.frames, &declared.images));
    }
    if let (true, Some(declared)) = (options.sharpness, &config.georeference) {
        flight.sharpness = pixels::sharpness(&survey.frames, &declared.images);
    }
    let rows = frames::rows(&flight, survey);
    let findings = findings::of(&flight, &rows);
    Diagnosis {
        format: "boresight/check/1",
        findings,
        overlap: flight.overlap.clone(),
        pixel_turns: flight.turns.clone(),
        frames: rows,
        rejected_places: flight.rejected_places(),
        views: flight.views,
        order: flight.order,
        coverage,
    }
}
