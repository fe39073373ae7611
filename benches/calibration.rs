//! Times and shows what `compare-opencv` compares: corners in photos, and the adjustment of given points.
//!
//! ```text
//! calibration corners KIND ROWS COLUMNS PHOTO...   chessboard: inner corners; squares: with a hollow first one
//! calibration solve VIEWS.json                     { width, height, views: [[[x_m, y_m, column, row], …], …] }
//! ```
//!
//! JSON lines on standard output; milliseconds are the least of several rounds on one thread, so that other
//! work on the machine matters little.

use boresight::calibration::{
    BoardPoint, ChessboardTarget, LensModel, Marker, Observation, SquaresTarget, Target, ViewPoints,
    calibrate, detect,
};
use boresight::camera::ImagePoint;
use boresight::formats::photo::decode_grey;
use serde_json::json;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` adds arguments of its own.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["corners", kind, rows, columns, photos @ ..] => {
            corners(&target(kind, rows.parse()?, columns.parse()?)?, photos)
        }
        ["solve", file] => solve(Path::new(file)),
        _ => {
            println!("see benches/compare-opencv, which runs this");
            Ok(())
        }
    }
}

fn target(kind: &str, rows: usize, columns: usize) -> Result<Target, Box<dyn Error>> {
    // The side does not matter for finding corners, its ratio to the gap does.
    Ok(match kind {
        "chessboard" => Target::Chessboard(ChessboardTarget::new(rows, columns, 1.0)?),
        "squares" => Target::Squares(SquaresTarget::new(rows, columns, 1.0, 1.0, Marker::UpperLeft)?),
        other => return Err(format!("{other} is not compared").into()),
    })
}

/// The result of a task and the least milliseconds of several rounds.
fn timed<T>(rounds: usize, mut task: impl FnMut() -> T) -> (T, f64) {
    let mut once = || {
        let start = Instant::now();
        let made = task();
        (made, 1e3 * start.elapsed().as_secs_f64())
    };
    let first = once();
    (1..rounds).fold(first, |(_, least), _| {
        let (made, ms) = once();
        (made, least.min(ms))
    })
}

fn corners(target: &Target, photos: &[&str]) -> Result<(), Box<dyn Error>> {
    for photo in photos {
        let image = decode_grey(Path::new(photo))?;
        let (found, ms) = timed(7, || detect(&image, target));
        let line = match found {
            Ok(detection) => {
                let corners: Vec<_> = detection
                    .corners
                    .iter()
                    .map(|c| json!([c.row, c.column, c.corner, c.sharp.column, c.sharp.row]))
                    .collect();
                json!({ "photo": photo, "ms": ms, "corners": corners })
            }
            Err(error) => json!({ "photo": photo, "ms": ms, "error": error.to_string() }),
        };
        println!("{line}");
    }
    Ok(())
}

fn solve(file: &Path) -> Result<(), Box<dyn Error>> {
    #[derive(serde::Deserialize)]
    struct Views {
        width: u32,
        height: u32,
        views: Vec<Vec<[f64; 4]>>,
    }
    let read: Views = serde_json::from_slice(&std::fs::read(file)?)?;
    let still = BoardPoint { x_m: 0.0, y_m: 0.0 };
    let views: Vec<ViewPoints> = read
        .views
        .iter()
        .enumerate()
        .map(|(i, points)| ViewPoints {
            name: format!("view {i}"),
            observations: points
                .iter()
                .map(|&[x_m, y_m, column, row]| Observation {
                    board: BoardPoint { x_m, y_m },
                    growth: still,
                    pixel: ImagePoint::new(column, row),
                })
                .collect(),
        })
        .collect();
    let (made, ms) = timed(15, || calibrate(&views, read.width, read.height, LensModel::PAPER));
    let made = made?;
    println!("{}", json!({ "ms": ms, "rms_px": made.rms_px, "std": made.std }));
    Ok(())
}
