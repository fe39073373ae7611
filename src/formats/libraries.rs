//! The C libraries under this program: their versions, for manifests (the same input may give other bytes with another
//! GDAL), and their messages.

use gdal::errors::CplErrType;

/// GDAL's version, "3.6.2".
pub fn gdal_version() -> String {
    gdal::version::version_info("RELEASE_NAME")
}

/// PROJ's version, "9.1.1".
pub fn proj_version() -> String {
    let (mut major, mut minor, mut patch) = (0, 0, 0);
    // SAFETY: the three pointers are valid for the call, which only writes one integer to each.
    unsafe { gdal_sys::OSRGetPROJVersion(&raw mut major, &raw mut minor, &raw mut patch) };
    format!("{major}.{minor}.{patch}")
}

/// Brings GDAL's messages into the log; it would print them to stderr by itself.
///
/// Failures come back to the caller as errors, which say them again: here they are details.
pub fn route_messages() {
    gdal::config::set_error_handler(|class, number, message| match class {
        CplErrType::Warning => tracing::warn!(gdal = number, "{message}"),
        CplErrType::Failure | CplErrType::Fatal => tracing::debug!(gdal = number, "{message}"),
        CplErrType::None | CplErrType::Debug => tracing::trace!(gdal = number, "{message}"),
    });
}

#[cfg(test)]
mod tests {
    #[test]
    fn versions_are_three_numbers() {
        for version in [super::gdal_version(), super::proj_version()] {
            let numbers: Vec<u32> = version.split('.').map(|part| part.parse().unwrap()).collect();
            assert_eq!(numbers.len(), 3, "{version}");
            assert!(numbers[0] >= 3, "{version}");
        }
    }
}
