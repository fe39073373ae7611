//! `[run]`: where the products go, the seed, and what makes the run stop or be skipped.

use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::error::{ConfigError, Resolver};
use super::source::Located;

/// `[run]` as written.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunSpec {
    /// The run folder, from the pipeline file's folder. Default: `out/<name of the pipeline file>`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub output: Option<Located<PathBuf>>,
    /// Seed of everything random in the run; the same seed gives the same products. Default 0.
    #[serde(default)]
    pub seed: u64,
    /// More rejected frames than this and the run, its products finished, exits with code 5. "any" never does. Default 0.
    #[serde(default)]
    pub max_rejected_frames: RejectionLimit,
    /// Data that may be absent: when a path is missing the run is skipped with its hint and exit code 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub requires: Vec<RequiredDataSpec>,
}

/// One `[[run.requires]]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RequiredDataSpec {
    /// File or folder that must exist, from the pipeline file's folder.
    pub path: Located<PathBuf>,
    /// What it is and where to get it: printed when it is absent.
    pub hint: String,
}

/// How many frames may be rejected before the run counts as failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RejectionLimit {
    /// At most this many.
    AtMost(u64),
    /// Any number.
    Any,
}

impl RejectionLimit {
    /// Whether `rejected` frames are too many.
    pub fn is_exceeded_by(self, rejected: usize) -> bool {
        matches!(self, Self::AtMost(limit) if rejected as u64 > limit)
    }
}

impl Default for RejectionLimit {
    fn default() -> Self {
        Self::AtMost(0)
    }
}

impl Serialize for RejectionLimit {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::AtMost(limit) => serializer.serialize_u64(*limit),
            Self::Any => serializer.serialize_str("any"),
        }
    }
}

impl<'de> Deserialize<'de> for RejectionLimit {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct LimitVisitor;
        impl Visitor<'_> for LimitVisitor {
            type Value = RejectionLimit;
            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a whole number of frames or \"any\"")
            }
            fn visit_i64<E: de::Error>(self, number: i64) -> Result<RejectionLimit, E> {
                u64::try_from(number)
                    .map(RejectionLimit::AtMost)
                    .map_err(|_| E::invalid_value(de::Unexpected::Signed(number), &self))
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<RejectionLimit, E> {
                if text == "any" {
                    Ok(RejectionLimit::Any)
                } else {
                    Err(E::invalid_value(de::Unexpected::Str(text), &self))
                }
            }
        }
        deserializer.deserialize_any(LimitVisitor)
    }
}

impl JsonSchema for RejectionLimit {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "RejectionLimit".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "oneOf": [{ "type": "integer", "minimum": 0 }, { "const": "any" }] })
    }
}

/// `[run]`, resolved.
#[derive(Debug, Clone)]
pub struct Run {
    /// The run folder.
    pub output: Located<PathBuf>,
    /// Seed of everything random.
    pub seed: u64,
    /// How many rejected frames are too many.
    pub max_rejected_frames: RejectionLimit,
    /// Data that may be absent.
    pub requires: Vec<Requirement>,
}

/// Data without which the run is skipped.
#[derive(Debug, Clone)]
pub struct Requirement {
    /// File or folder that must exist.
    pub path: Located<PathBuf>,
    /// What it is and where to get it.
    pub hint: String,
}

pub(super) fn resolve(spec: &mut RunSpec, resolver: &Resolver) -> Result<Run, ConfigError> {
    let stem = resolver.source.name.file_stem().map_or_else(|| "run".into(), PathBuf::from);
    let output = spec.output.get_or_insert_with(|| Located::unplaced(PathBuf::from("out").join(stem)));
    let requires = spec
        .requires
        .iter()
        .map(|requirement| {
            Ok(Requirement { path: resolver.path(&requirement.path)?, hint: requirement.hint.clone() })
        })
        .collect::<Result<_, ConfigError>>()?;
    Ok(Run {
        output: resolver.path(output)?,
        seed: spec.seed,
        max_rejected_frames: spec.max_rejected_frames,
        requires,
    })
}
