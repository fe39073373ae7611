//! The synthetic survey as a whole: picture, pixels and poses agree.

use super::*;

/// Noise-free, in a small frame without the paper's fold.
fn quiet() -> Scenario {
    Scenario { photo: Photo { noise_std: 0.0, ..Photo::default() }, ..Scenario::demo() }
}

#[test]
fn renders_the_same_bytes_on_one_and_two_threads() {
    let survey = Survey::new(&Scenario::demo()).unwrap();
    let [one, two] = [1, 2].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let survey = Survey::new(&Scenario::demo()).unwrap();
            (survey.render_frame(3), survey.render_target_photo(1))
        })
    });
    assert!(one == two);
    assert!(survey.render_frame(2) != one.0);
    let other = Survey::new(&Scenario { seed: 15, ..Scenario::demo() }).unwrap();
    assert!(other.render_frame(3) != one.0);
}

/// The white disc found in the picture lies where the forward model says: centroid of the light above the plate.
#[test]
fn discs_are_rendered_where_they_are_observed() {
    for shape in [ReliefShape::Flat, ReliefShape::Hills] {
        let mut scenario = quiet();
        scenario.relief = Relief { shape, amplitude_m: 12.0, wavelength_m: 350.0 };
        let survey = Survey::new(&scenario).unwrap();
        let (mut checked, mut worst) = (0, 0.0_f64);
        for (index, frame) in survey.frames().iter().enumerate().take(4) {
            // Further out the lens squeezes the plate so much that the window would leave it.
            let near_axis = |o: &Observation| (o.column - 566.4).hypot(o.row - 345.5) < 400.0;
            let observations =
                survey.observations().into_iter().filter(|o| o.frame == frame.name && near_axis(o));
            let picture = survey.render_frame(index);
            for observation in observations {
                let [column, row] = white_centroid(&picture, observation.column, observation.row);
                let miss = (column - observation.column).hypot(row - observation.row);
                worst = worst.max(miss);
                assert!(miss < 0.03, "{} in {}: {miss} px", observation.point, frame.name);
                checked += 1;
            }
        }
        assert!(checked >= 8, "{checked} targets, worst {worst} px");
    }
}

/// Centroid of the light above the plate's, within a window that stays on the plate.
fn white_centroid(picture: &RgbImage, column: f64, row: f64) -> [f64; 2] {
    let (mut sum, mut across, mut down) = (0.0, 0.0, 0.0);
    for y in (row - 6.0).round() as u32..=(row + 6.0).round() as u32 {
        for x in (column - 6.0).round() as u32..=(column + 6.0).round() as u32 {
            if (f64::from(x) - column).hypot(f64::from(y) - row) > 6.0 {
                continue;
            }
            let light = (f64::from(picture.get_pixel(x, y)[1]) - 44.0).max(0.0);
            sum += light;
            across += light * f64::from(x);
            down += light * f64::from(y);
        }
    }
    [across / sum, down / sum]
}

#[test]
fn pixel_and_ground_are_inverse() {
    let mut scenario = quiet();
    scenario.relief = Relief { shape: ReliefShape::Hills, amplitude_m: 20.0, wavelength_m: 300.0 };
    scenario.site = Site { latitude_deg: 60.0, longitude_deg: 17.9, ground_height_ellipsoid_m: 50.0 };
    let survey = Survey::new(&scenario).unwrap();
    for frame in survey.frames() {
        for (column, row) in [(100.0, 300.0), (575.5, 323.5), (900.25, 600.0)] {
            let ground = survey.ground_from_pixel(frame, column, row).unwrap();
            assert!(
                (survey.ground_height(ground.latitude_deg, ground.longitude_deg) - ground.height_m).abs()
                    < 1e-5
            );
            let [back_column, back_row] = survey.pixel_from_ground(frame, &ground).unwrap();
            assert!((back_column - column).hypot(back_row - row) < 1e-5);
        }
    }
}

/// A level camera straight above: one pixel spans height over focal length, and the runway its 225 m.
#[test]
fn nadir_distances_are_those_of_the_pinhole() {
    let mut scenario = Scenario::paper_flight();
    scenario.flight.roll_deg = 0.0;
    scenario.flight.pitch_deg = 0.0;
    scenario.camera = Camera { skew_px: 0.0, k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0, ..scenario.camera };
    let survey = Survey::new(&scenario).unwrap();
    let frame = &survey.frames()[0];
    let ends = survey.runway().unwrap().ends;
    let [one, two] = ends.each_ref().map(|end| survey.pixel_from_ground(frame, end).unwrap());
    let length = (one[0] - two[0]) / 743.7937 * 357.46;
    // The runway bends 1 mm away from the camera's level plane at its ends.
    assert!((length.abs() - 225.0).abs() < 2e-3, "{length}");
    assert!(two[0] > one[0], "the image's right looks to the nose");
}

/// The paper's runway spans 465 to 468 pixels of the paper's frame.
#[test]
fn the_papers_runway_has_its_size_in_pixels() {
    let survey = Survey::new(&Scenario::paper_flight()).unwrap();
    let frame = &survey.frames()[0];
    let [one, two] = survey.runway().unwrap().ends.map(|end| survey.pixel_from_ground(frame, &end).unwrap());
    let length = (one[0] - two[0]).hypot(one[1] - two[1]);
    assert!((460.0..475.0).contains(&length), "{length}");
}

#[test]
fn blind_pixels_are_grey_and_counted() {
    let survey = Survey::new(&quiet()).unwrap();
    assert!((survey.blind_pixels() as i64 - 5707).abs() <= 20, "{}", survey.blind_pixels());
    let picture = survey.render_frame(0);
    assert_eq!(picture.get_pixel(0, 0).0, [128; 3]);
    assert_ne!(picture.get_pixel(576, 324).0, [128; 3]);
}

#[test]
fn a_frame_with_the_horizon_in_it_shows_sky() {
    let mut scenario = quiet();
    scenario.mounting.gimbal_pan_deg = 0.0;
    scenario.mounting.gimbal_elevation_deg = -15.0;
    let survey = Survey::new(&scenario).unwrap();
    let picture = survey.render_frame(0);
    assert_eq!(picture.get_pixel(576, 20).0, [184, 204, 230]);
    assert_eq!(survey.ground_from_pixel(&survey.frames()[0], 576.0, 20.0), None);
    assert!(survey.ground_from_pixel(&survey.frames()[0], 576.0, 600.0).is_some());
}

/// A square's edge crosses half brightness where the corners say it is.
#[test]
fn target_photos_match_their_corners() {
    let mut scenario = quiet();
    scenario.calibration.noise_std = 0.0;
    let survey = Survey::new(&scenario).unwrap();
    for index in [0, 3] {
        let photo = survey.render_target_photo(index);
        let view = View::new(survey.scenario(), &survey.lens, index);
        let corners = survey.target_corners(index);
        for square in corners.chunks(4).step_by(5) {
            let side = square[1].x_mm - square[0].x_mm;
            let pixel = |x: f64| {
                let at = Vector2::new(square[0].x_mm + x * side, square[0].y_mm + 0.5 * side);
                survey.lens.pixel_from_ideal(view.ideal(at))
            };
            let light = |x: f64| bilinear(&photo, pixel(x).x, pixel(x).y);
            // Half of the square's inside and half of the gap to its right: the edge lies at 1.
            let (dark, bright) = (light(0.5), light(1.5));
            assert!(dark < 40.0 && bright > 190.0, "{dark} {bright}");
            let level = 0.5 * (dark + bright);
            let crossing =
                (0..1000).map(|step| 0.8 + f64::from(step) / 2500.0).find(|&x| light(x) > level).unwrap();
            let miss = (pixel(crossing) - pixel(1.0)).norm();
            assert!(miss < 0.06, "square {}, {}: {miss} px", square[0].square_row, square[0].square_column);
        }
    }
}

fn bilinear(photo: &GrayImage, column: f64, row: f64) -> f64 {
    let (x, y) = (column.floor(), row.floor());
    let pixel = |dx: u32, dy: u32| f64::from(photo.get_pixel(x as u32 + dx, y as u32 + dy)[0]);
    let (fx, fy) = (column - x, row - y);
    (pixel(0, 0) * (1.0 - fx) + pixel(1, 0) * fx) * (1.0 - fy)
        + (pixel(0, 1) * (1.0 - fx) + pixel(1, 1) * fx) * fy
}
