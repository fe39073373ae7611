//! The camera written out in the pipeline file.

use crate::camera::{Brown, Camera, CameraError, Interior, InteriorCovariance};
use crate::config::calibrate::ParametersSpec;
use crate::config::{Config, Located};

use super::context::StageError;

/// The camera of `[calibrate.parameters]`, its pixels counted from the centre of the top-left one.
///
/// Standard deviations become a diagonal covariance; without them the camera has none.
///
/// # Errors
/// A parameter is no camera's, at its place in the pipeline file.
pub fn camera_from_parameters(config: &Config, spec: &Located<ParametersSpec>) -> Result<Camera, StageError> {
    from_parameters(spec).map_err(|error| {
        StageError::pipeline("[calibrate.parameters] is no camera").because(error).at(config.at(spec))
    })
}

fn from_parameters(spec: &ParametersSpec) -> Result<Camera, CameraError> {
    let shift = spec.pixel_origin.offset_to_centre_px();
    let brown = Brown::new([
        spec.fx_px.value,
        spec.fy_px.value,
        spec.skew_px,
        spec.cx_px.value + shift,
        spec.cy_px.value + shift,
        spec.k1,
        spec.k2,
        spec.p1,
        spec.p2,
        spec.k3,
    ])?;
    let covariance = spec.std.as_ref().map(|std| {
        let std =
            [std.fx_px, std.fy_px, std.skew_px, std.cx_px, std.cy_px, std.k1, std.k2, std.p1, std.p2, std.k3];
        let variances: Interior = std::array::from_fn(|k| std.get(k).map_or(0.0, |std| std * std));
        InteriorCovariance::from_diagonal(&variances.into())
    });
    Camera::new(brown, spec.image_width_px.value, spec.image_height_px.value, covariance)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::CameraSource;

    fn camera(origin: &str) -> Camera {
        let text = format!(
            "version = 1\n[calibrate.parameters]\nimage_width_px = 1800\nimage_height_px = 1350\n\
             pixel_origin = \"{origin}\"\nfx_px = 1278.5\nfy_px = 1278.25\ncx_px = 900\ncy_px = 675\nk3 = 0.5\n\
             std = {{ fx_px = 2.0, k3 = 0.1 }}\n"
        );
        let config = Config::from_text(Path::new("p.toml"), &text, &[]).unwrap();
        let CameraSource::Parameters(spec) = &config.calibrate.camera else { panic!("parameters") };
        camera_from_parameters(&config, spec).unwrap()
    }

    #[test]
    fn the_principal_point_moves_by_half_a_pixel_with_the_origin() {
        let [corner, centre] = ["corner", "centre"].map(|origin| camera(origin).lens.interior());
        assert_eq!(corner[3..5], [899.5, 674.5]);
        assert_eq!(centre[3..5], [900.0, 675.0]);
        assert_eq!(corner[9], 0.5);
    }

    #[test]
    fn standard_deviations_become_variances_in_their_places() {
        let covariance = camera("centre").covariance.unwrap();
        assert_eq!(covariance[(0, 0)], 4.0);
        assert!((covariance[(9, 9)] - 0.01).abs() < 1e-15);
        assert_eq!(covariance.sum(), covariance[(0, 0)] + covariance[(9, 9)]);
    }
}
