//! Reads flight logs as often as asked and tells what was in them: what `compare-logs` times.
//!
//! ```text
//! logs ROUNDS LOG...   DataFlash (.bin) and ULog (.ulg)
//! ```
//!
//! One JSON line a log on standard output; milliseconds are the least of the rounds, on one thread, without the file's
//! reading.

use boresight::formats::flight::{dataflash, ulog};
use serde_json::json;
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` adds arguments of its own.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let Some((rounds, logs)) = arguments.split_first() else {
        println!("see benches/compare-logs, which runs this");
        return Ok(());
    };
    let rounds: usize = rounds.parse()?;
    for log in logs {
        let bytes = std::fs::read(log)?;
        let is_ulog = Path::new(log).extension().is_some_and(|e| e == "ulg");
        let read = if is_ulog { ulog::read } else { dataflash::read };
        let mut least_ms = f64::INFINITY;
        let mut counts = [0; 5];
        for _ in 0..rounds.max(1) {
            let start = Instant::now();
            let made = read(&bytes).map_err(|e| e.cause)?;
            least_ms = least_ms.min(1e3 * start.elapsed().as_secs_f64());
            counts = [
                made.attitudes.len(),
                made.positions.len(),
                made.velocities.len(),
                made.exposures.len(),
                made.bad.len(),
            ];
        }
        let [attitudes, positions, velocities, exposures, bad] = counts;
        let line = json!({
            "log": log, "ms": least_ms, "attitudes": attitudes, "positions": positions, "velocities": velocities,
            "exposures": exposures, "bad": bad,
        });
        println!("{line}");
    }
    Ok(())
}
