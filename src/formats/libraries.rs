//! Versions of the C libraries under this program, for manifests: the same input may give other bytes with another GDAL.

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
