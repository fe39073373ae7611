//! The survey from above, coloured by how many frames see the ground.

use super::Diagnosis;
use crate::report::coverage::{CoverageMap, coverage_map};
use crate::report::{Figure, FigureError};

/// Draws how often the ground is seen, with the flight line; `None` when no frame is used.
///
/// # Errors
/// [`FigureError`]: the drawing library refuses it.
pub fn picture(diagnosis: &Diagnosis, title: &str) -> Result<Option<Figure>, FigureError> {
    let (Some(coverage), Some(overlap)) = (&diagnosis.coverage, &diagnosis.overlap) else { return Ok(None) };
    let flown = diagnosis.order.iter().filter_map(|index| diagnosis.views.get(*index));
    let map = CoverageMap {
        title: title.to_owned(),
        cell_m: coverage.cell_m,
        corner: coverage.corner,
        columns: coverage.columns,
        counts: coverage.counts.clone(),
        holes: coverage.hole.clone(),
        outlines: diagnosis.views.iter().map(|view| view.outline.clone()).collect(),
        flown: flown.map(|view| view.place).collect(),
        rejected: diagnosis.rejected_places.clone(),
        words: vec![
            format!("{} frames, {}", diagnosis.views.len(), area(overlap.area_m2)),
            format!("{:.0} % seen by one frame", 100.0 * overlap.seen_by.one),
            format!("{:.0} % by two", 100.0 * overlap.seen_by.two),
            format!("{:.0} % by three or more", 100.0 * overlap.seen_by.more),
            match overlap.holes {
                0 => "no holes".to_owned(),
                1 => format!("1 hole, {}", area(overlap.holes_m2)),
                holes => format!("{holes} holes, {}", area(overlap.holes_m2)),
            },
        ],
    };
    coverage_map(&map).map(Some)
}

/// An area for people.
fn area(square_metres: f64) -> String {
    match square_metres {
        a if a < 10_000.0 => format!("{a:.0} m²"),
        a if a < 1e6 => format!("{:.1} ha", a / 1e4),
        a => format!("{:.2} km²", a / 1e6),
    }
}
