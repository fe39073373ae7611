//! Data on stdout. A reader that goes away (`| head`) is not an error.

use std::io::{ErrorKind, Write};

use serde::Serialize;

use crate::stages::{ErrorClass, StageError};

/// Writes text to stdout.
///
/// # Errors
/// Stdout cannot be written to (a full disk behind `>`).
pub fn print(text: &str) -> Result<(), StageError> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(StageError::new(ErrorClass::Io, "cannot write to standard output").because(error))
        }
        _ => Ok(()),
    }
}

/// Writes a value to stdout as indented JSON.
///
/// # Errors
/// As [`print`].
pub fn print_json(value: &impl Serialize) -> Result<(), StageError> {
    let text = serde_json::to_string_pretty(value)
        .map_err(|error| StageError::new(ErrorClass::Bug, "a result is not JSON").because(error))?;
    print(&format!("{text}\n"))
}

/// A number of bytes for people: "12.3 MiB".
pub fn human_bytes(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["KiB", "MiB", "GiB", "TiB"];
    if bytes < 1024 {
        return format!("{bytes} B");
    }
    let mut value = bytes as f64 / 1024.0;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    format!("{value:.1} {}", UNITS[unit])
}

#[cfg(test)]
mod tests {
    #[test]
    fn bytes_read_well() {
        let human = super::human_bytes;
        assert_eq!([human(0), human(1023), human(1024)], ["0 B", "1023 B", "1.0 KiB"]);
        assert_eq!(human(5_368_709_120), "5.0 GiB");
    }
}
