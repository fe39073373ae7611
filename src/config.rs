//! The pipeline file: text to validated, typed settings.
//!
//! A file is read in two steps. `*Spec` types hold the tables as written (they are also the JSON Schema's source and
//! what `resolved.toml` repeats with defaults filled in); `resolve` functions turn them into the types stages work
//! with: SI units, paths from the pipeline file's folder, one enum instead of several optional keys. Combinations that
//! would leave a key unused are refused. Values that a stage may still find wrong (a missing folder, an unknown CRS)
//! keep their place ([`Located`]), so that the stage's error can show the line: see [`Config::at`].
//!
//! Nothing here looks at any file but the pipeline file.

pub mod accuracy;
pub mod calibrate;
mod error;
pub mod georeference;
pub mod height;
pub mod log;
pub mod mosaic;
pub mod quantity;
mod read;
pub mod run;
mod schema;
mod source;
pub mod target;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use accuracy::Accuracy;
pub use calibrate::{Calibrate, CameraSource};
pub use error::ConfigError;
pub use georeference::Georeference;
pub use mosaic::Mosaic;
pub use read::VERSION;
pub use run::Run;
pub use schema::schema_json;
pub use source::{Diagnostic, Located, Place, Source};

use accuracy::AccuracySpec;
use calibrate::CalibrateSpec;
use error::Resolver;
use georeference::GeoreferenceSpec;
use mosaic::MosaicSpec;
use run::RunSpec;

/// The pipeline file as written: one table per stage.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spec {
    /// Version of this file's format: 1.
    #[schemars(range(min = 1, max = 1))]
    pub version: i64,
    /// Where the products go, the seed, and limits of the whole run.
    #[serde(default)]
    pub run: RunSpec,
    /// Where the camera comes from.
    pub calibrate: Located<CalibrateSpec>,
    /// Frames and log to poses and footprints.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub georeference: Option<Located<GeoreferenceSpec>>,
    /// Frames to one map. An empty table takes all defaults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mosaic: Option<Located<MosaicSpec>>,
    /// What the products are worth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accuracy: Option<Located<AccuracySpec>>,
}

/// A validated pipeline.
#[derive(Debug, Clone)]
pub struct Config {
    /// The text it was read from.
    pub source: Arc<Source>,
    /// Folder of the pipeline file, from which its paths count.
    pub base: PathBuf,
    /// The whole run.
    pub run: Run,
    /// Where the camera comes from.
    pub calibrate: Calibrate,
    /// Frames and log to poses; absent when the pipeline stops after calibration.
    pub georeference: Option<Georeference>,
    /// Frames to one map.
    pub mosaic: Option<Mosaic>,
    /// What the products are worth.
    pub accuracy: Option<Accuracy>,
    spec: Spec,
}

impl Config {
    /// Reads a pipeline file.
    ///
    /// - `file`: the pipeline file; paths inside it count from its folder.
    /// - `overrides`: `key.path=value`, put in place before anything is checked.
    ///
    /// # Errors
    /// [`ConfigError`] when the file cannot be read, is not TOML, or its contents are refused.
    pub fn load(file: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let text = read_text(file)?;
        Self::from_text(file, &text, overrides)
    }

    /// Reads a pipeline from text, without looking at any file.
    ///
    /// # Errors
    /// [`ConfigError`] with the place of what was refused.
    pub fn from_text(file: &Path, text: &str, overrides: &[String]) -> Result<Self, ConfigError> {
        let source = Arc::new(Source::new(file, text, overrides));
        let mut spec: Spec = read::read(&source, read::check_version)?;
        let base = file.parent().map(Path::to_owned).unwrap_or_default();
        let resolver = Resolver { source: source.clone(), base: base.clone() };
        let run = run::resolve(&mut spec.run, &resolver)?;
        let calibrate = calibrate::resolve(&mut spec.calibrate, &resolver)?;
        let georeference =
            spec.georeference.as_mut().map(|spec| georeference::resolve(spec, &resolver)).transpose()?;
        let mosaic = spec.mosaic.as_mut().map(|spec| mosaic::resolve(spec, &resolver)).transpose()?;
        let accuracy = match (&mut spec.accuracy, &georeference) {
            (Some(spec), Some(georeference)) => Some(accuracy::resolve(spec, &georeference.log, &resolver)?),
            (Some(spec), None) => return Err(needs_georeference(spec, "accuracy", &resolver)),
            (None, _) => None,
        };
        if let (Some(spec), None) = (&spec.mosaic, &georeference) {
            return Err(needs_georeference(spec, "mosaic", &resolver));
        }
        Ok(Self { source, base, run, calibrate, georeference, mosaic, accuracy, spec })
    }

    /// The place of a value in the pipeline file, for an error about it; `None` when the value is a default.
    pub fn at<T>(&self, value: &Located<T>) -> Option<Place> {
        (!value.span.is_empty()).then(|| Place { source: self.source.clone(), span: value.span.clone() })
    }

    /// `path` as seen from the pipeline file's folder: what products may name without saying whose disk they were made on.
    pub fn relative(&self, path: &Path) -> PathBuf {
        path.strip_prefix(&self.base).unwrap_or(path).to_owned()
    }

    /// The BLAKE3 hash (hex) of the pipeline file's text and its overrides: what products name as their origin.
    pub fn fingerprint(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.source.text.as_bytes());
        for (_, written) in self.source.overrides() {
            // A byte no TOML text holds keeps the parts apart.
            hasher.update(b"\0").update(written.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }

    /// The table of one stage ("mosaic") with defaults filled in, as TOML; `None` when the pipeline has no such table.
    pub fn table_toml(&self, stage: &str) -> Option<String> {
        let spec = toml::Value::try_from(&self.spec).expect("tables of strings, numbers and tables are TOML");
        spec.get(stage).map(ToString::to_string)
    }

    /// The pipeline with overrides in place and defaults filled in, as a pipeline file.
    pub fn resolved_toml(&self) -> String {
        let name = self.source.name.file_name().unwrap_or_default().to_string_lossy();
        let tables = toml::to_string(&self.spec).expect("tables of strings, numbers and tables are TOML");
        format!(
            "# {name} with overrides in place and defaults filled in; paths count from that file's folder.\n{tables}"
        )
    }
}

/// Reads any other settings file (a scenario) with the same overrides, errors and hints as a pipeline file.
///
/// # Errors
/// [`ConfigError`] when the file cannot be read, is not TOML, or its contents are refused.
pub fn load_document<T>(file: &Path, overrides: &[String]) -> Result<T, ConfigError>
where
    T: serde::de::DeserializeOwned + JsonSchema,
{
    let source = Arc::new(Source::new(file, &read_text(file)?, overrides));
    read::read(&source, |_, _| Ok(()))
}

fn read_text(file: &Path) -> Result<String, ConfigError> {
    let bytes = std::fs::read(file).map_err(|error| {
        let refused = ConfigError::whole_file(file, format!("cannot be read: {error}"));
        match error.kind() {
            std::io::ErrorKind::NotFound => refused.help("check the path"),
            _ => refused,
        }
    })?;
    String::from_utf8(bytes).map_err(|error| {
        let line = 1 + error.as_bytes()[..error.utf8_error().valid_up_to()]
            .iter()
            .filter(|&&byte| byte == b'\n')
            .count();
        ConfigError::whole_file(file, format!("line {line} is not UTF-8 text")).help("save the file as UTF-8")
    })
}

fn needs_georeference<T>(table: &Located<T>, name: &str, resolver: &Resolver) -> ConfigError {
    resolver
        .error(table, format!("[{name}] needs the stage before it, [georeference]"))
        .help("add a table [georeference], or remove this one")
}

#[cfg(test)]
mod tests;
