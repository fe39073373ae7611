//! Any bytes as a text log or an exterior orientation: records or a refusal, in bounded time and memory, without a panic.
#![no_main]

use boresight::formats::flight::{
    AngleSystem, AngleUnit, Column, Declared, North, geo_txt, geoinfo, mrk, opensfm, orientation, rtklib,
};
use boresight::geodesy::HeightKind;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let [kind, text @ ..] = bytes else { return };
    let columns =
        [Column::Frame, Column::X, Column::Y, Column::Height, Column::Omega, Column::Phi, Column::Kappa];
    let declared = Declared {
        crs: (kind & 8 != 0).then_some("EPSG:32633"),
        heights: (kind & 16 != 0).then_some(HeightKind::Ellipsoid),
        angles: (kind & 32 != 0).then_some(AngleSystem::CameraYawPitchRoll(North::True)),
        angle_unit: if kind & 64 != 0 { AngleUnit::Gon } else { AngleUnit::Degrees },
        columns: (kind & 128 != 0).then_some(&columns[..]),
    };
    let grid = opensfm::Axes::Grid { crs: "EPSG:32633", offset: [5e5, 5e6] };
    let read = match kind % 8 {
        0 => mrk::read(text),
        1 => rtklib::read(text, kind & 32 != 0, declared.heights),
        2 => geoinfo::read(text, &declared),
        3 => geo_txt::read(text, &declared),
        4 => orientation::read(text, &declared, None),
        5 => orientation::read(text, &declared, Some(b"332000 3488000 4000")),
        6 => opensfm::read(text, opensfm::Axes::Topocentric, None, declared.heights),
        _ => opensfm::read(text, grid, None, declared.heights),
    };
    if let Ok(log) = read {
        assert!(log.exposures.len() + log.positions.len() + log.bad.len() <= text.len());
        for exposure in &log.exposures {
            assert!(exposure.position.is_some());
        }
    }
});
