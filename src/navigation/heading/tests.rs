//! Against the test values that the models' makers publish with each release.

use super::*;

/// Year, height km, latitude, longitude, declination °, horizontal intensity nT: `WMM2010testvalues.pdf`,
/// `WMM2015v2testvalues.pdf`, `WMM2020testvalues.pdf` (whole tables), `WMM2025_TestValues.txt` (two of each half year).
const OFFICIAL: [[f64; 6]; 56] = [
    [2010.0, 0.0, 80.0, 0.0, -6.13, 6687.8],
    [2010.0, 0.0, 0.0, 120.0, 0.97, 39434.5],
    [2010.0, 0.0, -80.0, 240.0, 70.21, 16714.0],
    [2010.0, 100.0, 80.0, 0.0, -6.57, 6374.0],
    [2010.0, 100.0, 0.0, 120.0, 0.94, 37457.0],
    [2010.0, 100.0, -80.0, 240.0, 69.62, 15748.6],
    [2012.5, 0.0, 80.0, 0.0, -5.21, 6685.5],
    [2012.5, 0.0, 0.0, 120.0, 0.88, 39428.6],
    [2012.5, 0.0, -80.0, 240.0, 70.04, 16737.2],
    [2012.5, 100.0, 80.0, 0.0, -5.63, 6371.6],
    [2012.5, 100.0, 0.0, 120.0, 0.86, 37452.2],
    [2012.5, 100.0, -80.0, 240.0, 69.45, 15768.9],
    [2015.0, 0.0, 80.0, 0.0, -3.90, 6651.9],
    [2015.0, 0.0, 0.0, 120.0, 0.55, 39522.9],
    [2015.0, 0.0, -80.0, 240.0, 69.81, 16791.2],
    [2015.0, 100.0, 80.0, 0.0, -4.32, 6341.4],
    [2015.0, 100.0, 0.0, 120.0, 0.54, 37539.7],
    [2015.0, 100.0, -80.0, 240.0, 69.22, 15818.3],
    [2017.5, 0.0, 80.0, 0.0, -2.59, 6612.0],
    [2017.5, 0.0, 0.0, 120.0, 0.37, 39570.2],
    [2017.5, 0.0, -80.0, 240.0, 69.59, 16819.7],
    [2017.5, 100.0, 80.0, 0.0, -3.01, 6303.0],
    [2017.5, 100.0, 0.0, 120.0, 0.36, 37585.1],
    [2017.5, 100.0, -80.0, 240.0, 69.01, 15844.2],
    [2020.0, 0.0, 80.0, 0.0, -1.28, 6572.0],
    [2020.0, 0.0, 0.0, 120.0, 0.16, 39624.4],
    [2020.0, 0.0, -80.0, 240.0, 69.36, 16853.8],
    [2020.0, 100.0, 80.0, 0.0, -1.70, 6264.5],
    [2020.0, 100.0, 0.0, 120.0, 0.16, 37636.9],
    [2020.0, 100.0, -80.0, 240.0, 68.78, 15875.4],
    [2022.5, 0.0, 80.0, 0.0, 0.01, 6529.9],
    [2022.5, 0.0, 0.0, 120.0, -0.06, 39684.7],
    [2022.5, 0.0, -80.0, 240.0, 69.13, 16885.0],
    [2022.5, 100.0, 80.0, 0.0, -0.41, 6224.2],
    [2022.5, 100.0, 0.0, 120.0, -0.05, 37694.1],
    [2022.5, 100.0, -80.0, 240.0, 68.55, 15904.1],
    [2025.0, 48.0, 80.0, -96.0, -29.91, 2164.0],
    [2025.0, 54.0, 82.0, 87.0, 54.89, 2302.0],
    [2025.5, 6.0, -36.0, -137.0, 20.28, 25353.0],
    [2025.5, 63.0, 26.0, 81.0, 0.51, 34804.0],
    [2026.0, 74.0, -57.0, 3.0, -22.51, 14362.0],
    [2026.0, 83.0, 86.0, -46.0, -30.61, 3000.0],
    [2026.5, 14.0, 0.0, 80.0, -3.10, 39489.0],
    [2026.5, 12.0, -79.0, 115.0, -137.58, 13023.0],
    [2027.0, 37.0, -66.0, -5.0, -17.22, 17160.0],
    [2027.0, 67.0, 72.0, -115.0, 13.73, 5027.0],
    [2027.5, 8.0, 62.0, 53.0, 19.39, 12998.0],
    [2027.5, 73.0, -72.0, 95.0, -102.64, 13307.0],
    [2028.0, 49.0, 20.0, 167.0, 5.10, 30251.0],
    [2028.0, 75.0, 79.0, 125.0, -18.59, 2582.0],
    [2028.5, 28.0, 54.0, -120.0, 15.43, 15286.0],
    [2028.5, 55.0, 86.0, 70.0, 67.64, 2370.0],
    [2029.0, 95.0, -60.0, -59.0, 8.58, 18096.0],
    [2029.0, 19.0, 46.0, -22.0, -5.65, 22632.0],
    [2029.5, 31.0, 13.0, -132.0, 9.04, 28145.0],
    [2029.5, 64.0, 22.0, -132.0, 10.23, 26015.0],
];

#[test]
fn declination_and_intensity_equal_the_makers_test_values() {
    for [year, height_km, latitude, longitude, angle, horizontal] in OFFICIAL {
        let at = Geodetic::from_degrees(latitude, longitude, height_km * 1000.0);
        let d = declination_in(&at, year).unwrap();
        // The tables give two decimals of a degree; one decimal of a nT, or none in 2025.
        let step = if year < 2025.0 { 0.1 } else { 1.0 };
        assert!(
            (d.angle.degrees() - angle).abs() < 0.005_01,
            "{year} {latitude}: {} {angle}",
            d.angle.degrees()
        );
        assert!(
            (d.horizontal_nt - horizontal).abs() < step * 0.501,
            "{year}: {} {horizontal}",
            d.horizontal_nt
        );
    }
}

#[test]
fn every_year_takes_its_own_model() {
    let at = Geodetic::from_degrees(46.0, 7.0, 1500.0);
    // 2013-06-04T17:38:09Z, 2016-05-04, 2024-12-31T23:59:59Z, 2025-01-01T00:00:00Z.
    for (unix, model) in [
        (1_370_367_489.0, "WMM2010"),
        (1_462_320_000.0, "WMM2015v2"),
        (1_735_689_599.0, "WMM2020"),
        (1_735_689_600.0, "WMM2025"),
    ] {
        assert_eq!(declination(&at, Seconds::new(unix)).unwrap().model, model);
    }
    // One second apart two models differ by far less than either's sigma.
    let [before, after] =
        [1_735_689_599.0, 1_735_689_600.0].map(|t| declination(&at, Seconds::new(t)).unwrap());
    assert!((before.angle - after.angle).get().abs() < 0.5 * after.std.get());
    // WMM2025 at H = 22,500 nT or so: sqrt(0.26² + (5417/H)²).
    let expected = 0.26_f64.hypot(5417.0 / after.horizontal_nt);
    assert!((after.std.degrees() - expected).abs() < 1e-12);
}

#[test]
fn other_years_places_and_the_poles_are_refused() {
    let alps = Geodetic::from_degrees(46.0, 7.0, 1500.0);
    for unix in [1_262_303_999.0, 1_893_456_000.0, f64::NAN, f64::INFINITY, -1e300] {
        assert!(
            matches!(declination(&alps, Seconds::new(unix)), Err(HeadingError::OutsideYears { .. })),
            "{unix}"
        );
    }
    let now = Seconds::new(1_750_000_000.0);
    for (lat, lon, h) in [(91.0, 0.0, 0.0), (f64::NAN, 0.0, 0.0), (0.0, f64::INFINITY, 0.0), (0.0, 0.0, 1e9)]
    {
        let got = declination(&Geodetic::from_degrees(lat, lon, h), now);
        assert!(matches!(got, Err(HeadingError::NoPlace { .. })), "{lat} {lon} {h}");
    }
    // The official table has H = 907 nT at 87° N 154° W, 50 km, in 2029.0.
    let Err(HeadingError::NearPole { horizontal_nt }) =
        declination_in(&Geodetic::from_degrees(87.0, -154.0, 50_000.0), 2029.0)
    else {
        panic!("a compass works beside the pole?")
    };
    assert!((horizontal_nt - 907.0).abs() < 0.5);
    for pole in [90.0, -90.0] {
        assert!(declination(&Geodetic::from_degrees(pole, 0.0, 0.0), now).is_err());
    }
}

#[test]
fn the_decimal_year_follows_the_calendar() {
    // 2016 is a leap year: noon of 1 July is day 182.5 of 366.
    assert!((decimal_year(Seconds::new(1_467_374_400.0)) - (2016.0 + 182.5 / 366.0)).abs() < 1e-12);
    assert_eq!(decimal_year(Seconds::new(0.0)), 1970.0);
    assert_eq!(decimal_year(Seconds::new(951_782_400.0 - 59.0 * 86_400.0)), 2000.0);
    assert!((decimal_year(Seconds::new(-1.0)) - 1970.0).abs() < 1e-7);
}
