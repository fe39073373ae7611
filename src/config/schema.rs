//! The JSON Schema of the pipeline file, from the very types that read it.

use schemars::generate::SchemaSettings;

use super::Spec;

/// The schema (draft 2020-12) as formatted JSON, ending in a newline.
///
/// It describes the keys, their types and what they mean; rules over several keys are checked when the file is read.
pub fn schema_json() -> String {
    let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<Spec>();
    schema.insert("$id".to_owned(), "boresight.schema.json".into());
    schema.insert("title".to_owned(), "boresight pipeline".into());
    let mut text = format!("{:#}", schema.as_value());
    text.push('\n');
    text
}
