use super::super::calibration::{
    BoardNumbers, CandidateNumbers, ChoiceNumbers, MeasuredNumbers, RejectedNumbers, StepNumbers,
    SupportNumbers, TargetNumbers, UncertaintyNumbers, ViewNumbers,
};
use super::super::figures::{Panel, contour_panels, residual_plot};
use super::super::numbers::*;
use super::*;

fn ellipse() -> EllipseNumbers {
    EllipseNumbers { semi_major_m: 2.881, semi_minor_m: 2.860, azimuth_deg: 136.5 }
}

fn place(name: &str, ce90_m: f64) -> PlaceNumbers {
    PlaceNumbers {
        place: name.to_owned(),
        column: 575.5,
        row: 323.5,
        latitude_deg: -23.1,
        longitude_deg: -46.0,
        cep50_m: 0.55 * ce90_m,
        ce90_m,
        ellipse: ellipse(),
    }
}

fn figures_of(count: usize, scale: f64) -> CheckFigures {
    CheckFigures {
        count,
        mean_north_m: 0.21 * scale,
        mean_east_m: -0.004 * scale,
        rmse_north_m: 2.4 * scale,
        rmse_east_m: 2.2 * scale,
        rmse_radial_m: 3.26 * scale,
        cep50_sample_m: 2.9 * scale,
        ce90_sample_m: 5.12 * scale,
        worst_m: 8.4 * scale,
        worst_point: "T07".to_owned(),
        worst_frame: "IMG_0009.jpg".to_owned(),
        mean_normalised_squared: Some(1.93),
        few: count < 30,
    }
}

pub(in crate::report) fn numbers() -> AccuracyNumbers {
    AccuracyNumbers {
        format: FORMAT.to_owned(),
        version: VERSION,
        sigmas: vec![
            Sigma {
                what: "antenna position, each horizontal axis".into(),
                value: 2.547_97,
                unit: "m".into(),
            },
            Sigma { what: "yaw".into(), value: 0.6, unit: "°".into() },
        ],
        assumptions: vec!["errors of different sources are independent".into()],
        map: Some(MapNumbers {
            ce90_median_m: 6.234,
            ce90_p95_m: 8.91,
            ce90_worst_m: 11.23,
            colour_range_m: [5.9, 10.4],
            area_m2: 212_345.0,
            cell: 2.0,
            crs: "EPSG:32723".into(),
        }),
        frames: vec![FrameNumbers {
            frame: "IMG_0001.jpg".into(),
            centre: place("image centre", 6.16),
            worst_corner: Some(place("upper right", 11.8)),
            corner_fraction: 0.9,
        }],
        frames_without: Vec::new(),
        budget: BudgetNumbers {
            frame: "IMG_0001.jpg".into(),
            position_cep50_m: 3.0,
            corner_fraction: 0.9,
            points: vec![BudgetPointNumbers {
                place: "image centre".into(),
                column: 575.5,
                row: 323.5,
                epsilon_attitude_m: 1.5067,
                epsilon_m: 1.558,
                linear_m: 4.558,
                quadrature_m: 3.3804,
                cep50_m: 3.3804,
                full_cep50_m: 3.3804,
                full_ce90_m: 6.161,
            }],
            missing: Vec::new(),
        },
        shares: vec![
            Share { source: "position".into(), centre_percent: 78.7, corner_percent: Some(21.8) },
            Share { source: "lever arm".into(), centre_percent: 0.1, corner_percent: None },
        ],
        monte_carlo: None,
        lengths: vec![LengthNumbers {
            name: "runway length".into(),
            frames: ["IMG_0001.jpg".into(), "IMG_0001.jpg".into()],
            length_m: 224.1234,
            std_m: 3.2187,
            interval_m: [217.8, 230.4],
            confidence: 0.95,
            truth_m: Some(225.0),
            z_score: Some(-0.2723),
        }],
        check_points: Some(CheckNumbers {
            points: 24,
            judged_by: 0,
            variants: vec![
                CheckVariant {
                    ground: "each point's own height".into(),
                    all: figures_of(96, 1.0),
                    claimed_ce90_median_m: Some(6.4),
                    inside_claimed_ce90_percent: Some(92.7),
                    frames: Vec::new(),
                },
                CheckVariant {
                    ground: "the frame's ground".into(),
                    all: figures_of(96, 1.1),
                    claimed_ce90_median_m: Some(6.5),
                    inside_claimed_ce90_percent: None,
                    frames: Vec::new(),
                },
            ],
            without: Vec::new(),
        }),
        requirement: Some(RequirementNumbers {
            ce90_m: 10.0,
            worst_ce90_m: 11.23,
            area_percent: 99.96,
            met: false,
        }),
        figures: Vec::new(),
    }
}

fn survey() -> Survey {
    let frames = (0..12)
        .map(|i| {
            let (strip, k) = (i / 4, i % 4);
            let (e, n) =
                (f64::from(strip) * 180.0, f64::from(if strip % 2 == 0 { k } else { 3 - k }) * 120.0);
            MapFrame {
                name: format!("IMG_{i:04}.jpg"),
                outline: vec![
                    [e - 155.0, n - 280.0],
                    [e - 150.0, n + 275.0],
                    [e + 160.0, n + 280.0],
                    [e + 152.0, n - 270.0],
                ],
                camera: [e, n],
            }
        })
        .collect();
    Survey {
        frames_used: 12,
        frames_rejected: 1,
        crs: "EPSG:32723 (WGS 84 / UTM zone 23S)".into(),
        gsd_median_m: 0.4806,
        gsd_range_m: [0.4711, 0.4913],
        height_above_ground_m: [349.2, 361.8],
        frames,
        unit_m: Some(1.0),
        matching: None,
    }
}

pub(in crate::report) fn full() -> Page {
    let values: Vec<f64> = (0..32 * 18)
        .map(|i| 6.0 + f64::hypot((i % 32) as f64 / 32.0 - 0.4, (i / 32) as f64 / 18.0 - 0.55) * 8.0)
        .collect();
    let panel = |title: &str| Panel {
        title: title.to_owned(),
        image_px: (1152, 648),
        columns: 32,
        rows: 18,
        values: values.clone(),
        spread: false,
    };
    let figure = contour_panels(&[panel("north 1σ (m)"), panel("east 1σ (m)"), panel("CE90 (m)")]).unwrap();
    let residuals: Vec<(f64, f64)> =
        (0..96).map(|i| (3.0 * f64::from(i * 37 % 97).sin(), 2.7 * f64::from(i * 53 % 89).cos())).collect();
    let ce90: Vec<f32> = (0..200 * 120)
        .map(|i| {
            let (c, r) = ((i % 200) as f32 / 200.0 - 0.5, (i / 200) as f32 / 120.0 - 0.5);
            let d = (c * c + r * r).sqrt();
            if d > 0.55 { f32::NAN } else { 6.0 + 8.0 * d * d }
        })
        .collect();
    Page {
        title: "Crop field <north>".into(),
        provenance: Provenance {
            program_version: "0.1.0".into(),
            pipeline_file: "demo.toml".into(),
            pipeline_blake3: "5f2d8c".repeat(10),
            inputs_blake3: None,
            seed: 1,
            libraries: BTreeMap::from([("GDAL".to_owned(), "3.6.2".to_owned())]),
        },
        survey: Some(survey()),
        mosaic: Some(MosaicSection {
            preview_png: figures::ce90_picture(&ce90, 200).unwrap().unwrap().0,
            file: "mosaic/mosaic.tif".into(),
            width_px: 2410,
            height_px: 1800,
            gsd_m: 0.48,
            crs: "EPSG:32723".into(),
            area_m2: Some(318_000.0),
        }),
        accuracy: Some(AccuracySection {
            numbers: numbers(),
            figures: vec![CaptionedFigure {
                title: "Attitude error".into(),
                caption: "Errors on the ground from attitude alone, drawn 100 000 times.".into(),
                svg: figure.svg,
            }],
            ce90: figures::ce90_picture(&ce90, 200).unwrap(),
            residuals_svg: Some(residual_plot(&residuals, 4.1, Some(6.4)).unwrap().svg),
        }),
        calibration: Some(CalibrationSection {
            source: "Calibrated from photos of the squares target.".into(),
            parameters: calibration().parameters,
            adjustment: Some(calibration()),
            figures: Vec::new(),
            steps_png: None,
            overlay: None,
        }),
        rejected: vec![Rejected { name: "IMG_0013.jpg".into(), reason: "no row of log.csv names it".into() }],
        warnings: vec!["3 rows of log.csv name no image of the folder".into()],
    }
}

fn parameter(name: &str, value: f64, std: f64, insignificant: bool) -> ParameterNumbers {
    let reference = Some(value + std);
    ParameterNumbers { name: name.into(), value, std: Some(std), estimated: true, insignificant, reference }
}

fn calibration() -> CalibrationNumbers {
    let steps = StepNumbers { blunt_rms_px: 1.31, refined_rms_px: 0.62, sharp_rms_px: 0.027 };
    CalibrationNumbers {
        format: crate::report::calibration::FORMAT.into(),
        version: crate::report::calibration::VERSION,
        image_width_px: 1152,
        image_height_px: 648,
        target: Some(TargetNumbers { unit: "squares".into(), rows: 7, columns: 7, counted: true }),
        model: "brown (k1 k2 p1 p2 k3, skew)".into(),
        choice: Some(ChoiceNumbers {
            explanation: "Brown predicts photos left out as well as the best.".into(),
            candidates: vec![CandidateNumbers {
                model: "fisheye (k1 k2 k3 k4)".into(),
                parameters: 8,
                rms_px: None,
                held_out_rms_px: None,
                chosen: false,
                failed: Some("did not converge".into()),
            }],
        }),
        parameters: vec![
            parameter("fx_px", 743.793_71, 1.083, false),
            parameter("k3", -0.301_8, 0.352, true),
        ],
        correlation: vec![vec![1.0, 0.0], vec![0.0, 1.0]],
        points: 576,
        j_px2: 54.3,
        j_per_point_px2: 0.0943,
        rms_px: 0.307,
        sigma0_px: 0.2198,
        robust_sigma_px: 0.21,
        iterations: 7,
        closed_form: "with_skew".into(),
        steps: Some(steps),
        board: BoardNumbers {
            side_excess_m: Some(MeasuredNumbers { value: 0.000_14, std: 0.000_02, significant: true }),
            pitch_excess: None,
            bend_m: Some(0.000_3),
            flat_probability: Some(0.21),
            bend_estimated: false,
        },
        support: SupportNumbers {
            max_ideal_radius: Some(0.7),
            fold_radius: Some(0.9578),
            supported_share_of_frame: 0.87,
            folded_share_of_frame: 0.0076,
            share_of_48_cells_with_corners: 0.7,
            invertible: "0.76 % of the frame have no viewing ray.".into(),
        },
        uncertainty: UncertaintyNumbers {
            columns: 2,
            rows: 1,
            std_px: vec![Some(0.04), None],
            centre_px: Some(0.04),
            median_px: 0.04,
            worst_px: 0.52,
            height_m: 100.0,
            median_m: 0.005,
            worst_m: 0.07,
        },
        views: vec![ViewNumbers {
            file: "target_01.png".into(),
            points: 192,
            rms_px: 0.307,
            steps: Some(steps),
            quality: None,
            hidden: vec![[3, 4]],
            marker: Some("hollow".into()),
            suspect: None,
            camera_from_board_rotation: Vec::new(),
            board_origin_in_camera_m: [0.0, 0.0, 0.4],
            overlay: None,
        }],
        outliers: Vec::new(),
        rejected_photos: vec![RejectedNumbers {
            file: "target_09.png".into(),
            reason: "the photo has no contrast".into(),
            overlay: None,
        }],
        advice: vec!["Photograph the target in the upper right.".into()],
        overlay_of: None,
        figures: Vec::new(),
        notes: vec!["k3 differs from 0 by less than two standard deviations".into()],
    }
}

#[test]
fn a_full_page_shows_the_numbers_rounded_to_what_is_known() {
    let html = render(&full()).unwrap();
    let spaced = html.replace("&nbsp;", " ").replace('\u{a0}', " ");
    for expected in [
        "Crop field &lt;north&gt;",
        "6.2 m",
        "224.1 ± 3.2 m",
        "−0.9 m",
        "217.8 to 230.4 m (95 %)",
        "99 % of the area",
        "743.8",
        "not significant",
        "744.9",
        "−1.0 σ",
        "0.070 m on the ground from 100 m",
        "Photograph the target in the upper right.",
        "did not converge",
        "0.14 ± 0.020 mm",
        "the photo has no contrast",
        "no row of log.csv names it",
        "31.8 ha",
        "+0.2, 0.0 m",
        "48.0 cm",
        "2.55 m",
    ] {
        assert!(spaced.contains(expected), "{expected} is missing");
    }
    assert!(!spaced.contains("100 % of the area"), "not met, so never rounded up to all");
    // Self-contained: nothing is fetched.
    assert!(!html.contains("http://") && !html.contains("https://") && !html.contains("<script"));
    for nonsense in ["NaN", "undefined", "none", "inf "] {
        let text: String =
            html.split("base64,").map(|part| part.split_once('"').map_or(part, |p| p.1)).collect();
        let body = &text[text.find("<body>").unwrap()..];
        assert!(!body.contains(nonsense), "{nonsense} in the page");
    }
    assert_eq!(html, render(&full()).unwrap());
}

#[test]
fn every_section_may_be_missing() {
    let sections: [fn(&mut Page); 6] = [
        |p| p.mosaic = None,
        |p| p.survey = None,
        |p| p.accuracy = None,
        |p| p.calibration = None,
        |p| p.rejected.clear(),
        |p| {
            let Some(accuracy) = &mut p.accuracy else { return };
            accuracy.ce90 = None;
            accuracy.residuals_svg = None;
            accuracy.figures.clear();
            accuracy.numbers.map = None;
            accuracy.numbers.check_points = None;
            accuracy.numbers.requirement = None;
            accuracy.numbers.lengths[0].truth_m = None;
            accuracy.numbers.lengths[0].z_score = None;
        },
    ];
    for without in sections {
        let mut page = full();
        without(&mut page);
        render(&page).unwrap();
    }
    let mut page = full();
    sections[0](&mut page);
    sections[5](&mut page);
    let html = render(&page).unwrap();
    assert!(!html.contains("<h2>Mosaic") && !html.contains("Check points<"));
    let empty = render(&Page { title: "Nothing".into(), ..Page::default() }).unwrap();
    assert!(empty.contains("<h1>Nothing</h1>") && empty.contains("Provenance"));
}

#[test]
fn numbers_keep_two_digits_of_their_spread() {
    assert_eq!(two_digits(3.3804), "3.4");
    assert_eq!(two_digits(0.0996), "0.10");
    assert_eq!(two_digits(12.34), "12");
    assert_eq!(two_digits(123.4), "120");
    assert_eq!(decimals_of(0.0997), 2);
    assert_eq!(decimals_of(45.0), 0);
    assert_eq!(exact(2.5), "2.5");
    assert_eq!(exact(300.0), "300");
    assert_eq!(exact(0.2), "0.2");
    assert_eq!(signed(-0.0004, 2), "0.00");
    assert_eq!(gsd(0.48), "48.0\u{a0}cm");
}

/// `BORESIGHT_SAMPLE_PAGE=/path/page.html cargo test sample_page` leaves the page to look at.
#[test]
fn sample_page() {
    if let Some(path) = std::env::var_os("BORESIGHT_SAMPLE_PAGE") {
        crate::formats::atomic::write_atomic(path.as_ref(), render(&full()).unwrap().as_bytes()).unwrap();
    }
}
