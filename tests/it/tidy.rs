//! The rules of the house that a compiler does not check: import directions, purity of the ground floors, first lines.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The floor table of ARCHITECTURE.md: each module and what it may import. A module may always import itself.
const MAY_IMPORT: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("geometry", &["units"]),
    ("geodesy", &["units", "geometry"]),
    ("raster", &["units", "geometry", "geodesy"]),
    ("camera", &["units", "geometry"]),
    ("navigation", &["units", "geometry", "geodesy", "camera"]),
    ("terrain", &["units", "geometry", "geodesy", "raster"]),
    ("calibration", &["units", "geometry", "raster", "camera"]),
    ("georeference", &["units", "geometry", "geodesy", "raster", "camera", "navigation", "terrain"]),
    (
        "mosaic",
        &["units", "geometry", "geodesy", "raster", "camera", "navigation", "terrain", "georeference"],
    ),
    (
        "accuracy",
        &[
            "units",
            "geometry",
            "geodesy",
            "raster",
            "camera",
            "navigation",
            "terrain",
            "georeference",
            "mosaic",
        ],
    ),
    // Shares no geometry with the code it tests.
    ("synthetic", &[]),
    ("config", &["units"]),
    (
        "formats",
        &[
            "units",
            "geometry",
            "geodesy",
            "raster",
            "camera",
            "navigation",
            "terrain",
            "calibration",
            "georeference",
            "mosaic",
            "accuracy",
            "synthetic",
            "config",
        ],
    ),
    ("report", &["units", "geometry", "raster", "accuracy", "calibration", "mosaic"]),
    (
        "stages",
        &[
            "units",
            "geometry",
            "geodesy",
            "raster",
            "camera",
            "navigation",
            "terrain",
            "calibration",
            "georeference",
            "mosaic",
            "accuracy",
            "synthetic",
            "config",
            "formats",
            "report",
        ],
    ),
    ("pipeline", &["units", "config", "formats", "report", "stages"]),
    ("cli", &["units", "camera", "synthetic", "config", "formats", "report", "stages", "pipeline"]),
];

/// Modules without I/O, clock, printing or global state.
const PURE: &[&str] = &[
    "units",
    "geometry",
    "geodesy",
    "raster",
    "camera",
    "navigation",
    "terrain",
    "calibration",
    "georeference",
    "mosaic",
    "accuracy",
    "synthetic",
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Files of modules that exist only in test builds: `#[cfg(test)] mod name;`.
fn test_modules(files: &[PathBuf]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in files {
        let text = std::fs::read_to_string(path).unwrap();
        for after in text.split("#[cfg(test)]\nmod ").skip(1) {
            let name: String = after.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if after[name.len()..].starts_with(';') {
                found.push(path.with_extension("").join(format!("{name}.rs")));
            }
        }
    }
    found
}

/// Source files of the library with the floor module each belongs to; test modules left out.
fn sources() -> Vec<(String, PathBuf, String)> {
    let mut files = Vec::new();
    rust_files(&root().join("src"), &mut files);
    let tests = test_modules(&files);
    files
        .into_iter()
        .filter(|path| !tests.contains(path))
        .filter_map(|path| {
            let relative = path.strip_prefix(root().join("src")).unwrap().to_owned();
            let first = relative.components().next()?.as_os_str().to_string_lossy().into_owned();
            let module = first.trim_end_matches(".rs").to_owned();
            let text = std::fs::read_to_string(&path).unwrap();
            (module != "lib" && module != "main").then_some((module, relative, text))
        })
        .collect()
}

/// The code of a file: comments and the test module at its end cut off.
fn code(text: &str) -> String {
    let body = text.split("\n#[cfg(test)]\nmod ").next().unwrap_or(text);
    body.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

#[test]
fn imports_run_one_way() {
    let table: BTreeMap<&str, &[&str]> = MAY_IMPORT.iter().copied().collect();
    let mut wrong = Vec::new();
    for (module, path, text) in sources() {
        let allowed =
            table.get(module.as_str()).unwrap_or_else(|| panic!("{module} is not in the floor table"));
        let code = code(&text);
        for (at, _) in code.match_indices("crate::") {
            let rest = &code[at + "crate::".len()..];
            let named: Vec<String> = match rest.strip_prefix('{') {
                // use crate::{a::b, c};
                Some(group) => top_level_names(group),
                None => vec![rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()],
            };
            for name in named {
                if table.contains_key(name.as_str()) && name != module && !allowed.contains(&name.as_str()) {
                    wrong.push(format!("{}: {module} must not import {name}", path.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Names at the first level of a brace group whose opening brace is already passed.
fn top_level_names(group: &str) -> Vec<String> {
    let (mut depth, mut names, mut name) = (0, Vec::new(), String::new());
    for c in group.chars() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => names.push(std::mem::take(&mut name)),
            c if depth == 0 => name.push(c),
            _ => {}
        }
    }
    names.push(name);
    names
        .iter()
        .map(|n| n.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect())
        .filter(|n: &String| !n.is_empty())
        .collect()
}

#[test]
fn the_table_is_the_one_in_the_architecture_page() {
    let page = std::fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    for (module, allowed) in MAY_IMPORT {
        let row = page
            .lines()
            .find(|l| l.starts_with(&format!("| `{module}`")))
            .unwrap_or_else(|| panic!("ARCHITECTURE.md has no row for {module}"));
        let cell = row.split('|').rev().nth(1).unwrap().trim();
        let mut written: Vec<&str> = cell
            .split(',')
            .map(|n| n.trim().trim_matches('`'))
            .filter(|n| !n.is_empty() && *n != "–")
            .collect();
        let mut expected = allowed.to_vec();
        written.sort_unstable();
        expected.sort_unstable();
        assert_eq!(written, expected, "ARCHITECTURE.md's row of {module}");
    }
}

#[test]
fn ground_floors_are_pure() {
    let forbidden = [
        "std::fs",
        "std::env",
        "std::time",
        "std::process",
        "println!",
        "eprintln!",
        "print!(",
        "static mut",
        "gdal::",
    ];
    let mut wrong = Vec::new();
    for (module, path, text) in sources() {
        if PURE.contains(&module.as_str()) {
            let code = code(&text);
            for word in forbidden {
                if code.contains(word) {
                    wrong.push(format!("{}: {word}", path.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_file_says_what_it_is_for() {
    for (_, path, text) in sources() {
        assert!(text.starts_with("//! "), "{} does not begin with //!", path.display());
    }
}

#[test]
fn no_stubs_and_no_ignored_tests() {
    let words = [concat!("todo", "!("), concat!("unimplemented", "!("), concat!("#[", "ignore")];
    let mut files = Vec::new();
    rust_files(&root().join("src"), &mut files);
    rust_files(&root().join("tests"), &mut files);
    for path in files {
        let text = std::fs::read_to_string(&path).unwrap();
        for word in words {
            assert!(!text.contains(word), "{} contains {word}", path.display());
        }
    }
}
