//! Any image, any target: an answer or a refusal, in bounded time and memory, without a panic.
#![no_main]

use boresight::calibration::{
    AprilGridTarget, CharucoTarget, ChessboardTarget, CircleLayout, CirclesTarget, Dictionary, Grey, Marker, SquaresTarget,
    TagPrint, Target, count, detect, photo_quality,
};
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
    let share = 0.2 + f64::from(kind / 6) / 64.0;
    let circles = |layout| CirclesTarget::new(rows, columns, 1.0, share, layout).map(Target::Circles);
    let target = match kind % 6 {
        0 => SquaresTarget::new(rows, columns, 1.0, share, Marker::None).map(Target::Squares),
        1 => SquaresTarget::new(rows, columns, 1.0, share, Marker::UpperLeft).map(Target::Squares),
        2 => ChessboardTarget::new(rows, columns, 1.0).map(Target::Chessboard),
        3 => circles(if kind / 6 % 2 == 0 { CircleLayout::Symmetric } else { CircleLayout::Asymmetric }),
        4 => AprilGridTarget::new(rows, columns, 1.0, share, TagPrint::kalibr()).map(Target::AprilGrid),
        _ => {
            let Some(dictionary) = Dictionary::named("DICT_4X4_50") else { return };
            CharucoTarget::new(rows, columns, 1.0, 0.7, dictionary, 0, kind / 6 % 2 == 1).map(Target::Charuco)
        }
    };
    let Ok(target) = target else { return };
    let _ = count(&image, &target);
    if let Ok(detection) = detect(&image, &target) {
        assert!(detection.corners.len() <= target.points().len());
        let quality = photo_quality(&image, 255.0, &detection);
        assert!((0.0..=1.0).contains(&quality.clipped_share));
    }
});
