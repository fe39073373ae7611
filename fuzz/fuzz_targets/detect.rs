//! Any image, any target: an answer or a refusal, in bounded time and memory, without a panic.
#![no_main]

use boresight::calibration::{ChessboardTarget, Grey, Marker, SquaresTarget, Target, count, detect, photo_quality};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let [width, kind, rows, columns, zoom, pixels @ ..] = bytes else { return };
    let (width, zoom) = (usize::from(*width) + 1, usize::from(*zoom % 8) + 1);
    let height = pixels.len() / width;
    if height == 0 {
        return;
    }
    // Few bytes make a large picture: blocks of equal pixels are what targets consist of.
    let (wide, high) = ((width * zoom).min(1024), (height * zoom).min(1024));
    let values = (0..wide * high)
        .map(|i| f32::from(pixels[(i / wide / zoom) * width + (i % wide) / zoom]))
        .collect();
    let Ok(image) = Grey::new(wide, high, values) else { return };
    let (rows, columns) = (usize::from(*rows % 12), usize::from(*columns % 12));
    let marker = if kind & 1 == 0 { Marker::None } else { Marker::UpperLeft };
    let target = match kind / 2 % 2 {
        0 => SquaresTarget::new(rows, columns, 1.0, 0.5 + f64::from(kind / 4) / 64.0, marker).map(Target::Squares),
        _ => ChessboardTarget::new(rows, columns, 1.0).map(Target::Chessboard),
    };
    let Ok(target) = target else { return };
    let _ = count(&image, &target);
    if let Ok(detection) = detect(&image, &target) {
        assert!(detection.corners.len() <= target.points().len());
        let quality = photo_quality(&image, 255.0, &detection);
        assert!((0.0..=1.0).contains(&quality.clipped_share));
    }
});
