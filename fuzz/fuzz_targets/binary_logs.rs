//! Any bytes as an autopilot's log or a trajectory: records or a refusal, in bounded time and memory, without a panic.
#![no_main]

use boresight::formats::flight::{dataflash, sbet, tlog, ulog};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let [kind, log @ ..] = bytes else { return };
    let read = match kind % 4 {
        0 => dataflash::read(log),
        1 => ulog::read(log),
        2 => tlog::read(log),
        _ => {
            let _ = sbet::read_accuracy(log);
            sbet::read(log)
        }
    };
    if let Ok(read) = read {
        // Every record takes bytes of the file.
        let records = read.positions.len() + read.attitudes.len() + read.exposures.len();
        assert!(records <= log.len());
        assert!(read.positions.iter().all(|sample| sample.time.is_finite()));
    }
});
