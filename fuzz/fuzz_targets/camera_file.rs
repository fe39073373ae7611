//! Any text as a camera file of any format: a camera that projects, or a refusal, without a panic.
#![no_main]

use boresight::camera::ImagePoint;
use boresight::formats::camera::{CameraChoice, CameraFormat, camera_from_text, export};
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    for choice in [
        CameraChoice::default(),
        CameraChoice { name: Some("cam0"), image_size: Some((640, 480)) },
    ] {
        let Ok(camera) = camera_from_text(Path::new("camera"), &text, &choice) else { continue };
        assert!(camera.width > 0 && camera.height > 0);
        assert!(camera.lens.interior().iter().all(|value| value.is_finite()));
        let _ = camera.lens.direction_from_pixel(ImagePoint::new(0.0, 0.0));
        for format in CameraFormat::ALL {
            let _ = export(&camera, format, "fuzz");
        }
    }
});
