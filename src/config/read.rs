//! Text to tables as written: TOML, overrides put in place, serde's words turned into ours.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::error::ConfigError;
use super::quantity::HELP_MARK;
use super::source::Source;

/// The version this program reads.
pub const VERSION: i64 = 1;

/// Parses the text, puts the overrides in place, checks what must be checked first, and reads the typed tables.
pub(super) fn read<T: DeserializeOwned + JsonSchema>(
    source: &Arc<Source>,
    check_first: impl Fn(&Arc<Source>, &DeTable<'_>) -> Result<(), ConfigError>,
) -> Result<T, ConfigError> {
    let mut document = DeTable::parse(&source.text).map_err(|error| refusal(source, &error))?;
    // The values of overrides are parsed behind as many blanks as their place in the source, so that spans come out right.
    let overrides = source
        .overrides()
        .map(|(start, written)| Override::split(source, start, written))
        .collect::<Result<Vec<_>, _>>()?;
    for given in &overrides {
        given.put_into(source, document.get_mut())?;
    }
    check_first(source, document.get_ref())?;
    refuse_lists_for_tables(source, document.get_ref(), &schemars::schema_for!(T).to_value())?;
    T::deserialize(toml::Deserializer::from(document)).map_err(|error| refusal(source, &error))
}

/// One `--set`, split at its first `=`.
struct Override {
    keys: Vec<(String, Range<usize>)>,
    /// `v=<value>` behind the blanks that bring the value to its place.
    padded: String,
    value: Range<usize>,
}

impl Override {
    fn split(source: &Arc<Source>, start: usize, written: &str) -> Result<Self, ConfigError> {
        let whole = start..start + written.len();
        let shape = |message: &str| {
            ConfigError::at(source, whole.clone(), message)
                .help("write --set stage.key=value, for example --set mosaic.gsd=\"20 cm\"")
        };
        let Some((path, value)) = written.split_once('=') else {
            return Err(shape("the override has no `=`"));
        };
        let mut keys = Vec::new();
        let mut at = start;
        for key in path.split('.') {
            let bare = key.trim();
            if bare.is_empty()
                || !bare.chars().all(|letter| letter.is_ascii_alphanumeric() || "_-".contains(letter))
            {
                return Err(shape(&format!("`{path}` is not a key path")));
            }
            keys.push((bare.to_owned(), at..at + key.len()));
            at += key.len() + 1;
        }
        let value_start = start + path.len() + 1;
        Ok(Self {
            keys,
            padded: format!("{:pad$}v={value}", "", pad = value_start - 2),
            value: value_start..value_start + value.len(),
        })
    }

    /// The value read as TOML; what is not TOML is taken as the text it is (`--set mosaic.gsd=20 cm`).
    fn parsed(&self) -> Spanned<DeValue<'_>> {
        let text = self.padded[self.value.clone()].trim();
        let as_toml =
            DeTable::parse(&self.padded).ok().map(Spanned::into_inner).filter(|table| table.len() == 1);
        match as_toml.and_then(|table| table.into_iter().next()) {
            Some((_, value)) => value,
            None => Spanned::new(self.value.clone(), DeValue::String(Cow::Borrowed(text))),
        }
    }

    fn put_into<'i>(&'i self, source: &Arc<Source>, root: &mut DeTable<'i>) -> Result<(), ConfigError> {
        let (last, parents) = self.keys.split_last().expect("split gives at least one key");
        let mut table = root;
        for (key, span) in parents {
            let slot = table
                .entry(Spanned::new(span.clone(), Cow::Borrowed(key.as_str())))
                .or_insert_with(|| Spanned::new(span.clone(), DeValue::Table(DeTable::new())));
            table = match slot.get_mut() {
                DeValue::Table(inner) => inner,
                _ => {
                    return Err(ConfigError::at(source, span.clone(), format!("`{key}` is not a table"))
                        .help(
                            "an override reaches keys of tables; give a list as a whole: --set key='[...]'",
                        ));
                }
            };
        }
        let (key, span) = last;
        table.insert(Spanned::new(span.clone(), Cow::Borrowed(key.as_str())), self.parsed());
        Ok(())
    }
}

/// The version comes first: a file of another version would otherwise be refused for some unknown key.
pub(super) fn check_version(source: &Arc<Source>, root: &DeTable<'_>) -> Result<(), ConfigError> {
    let Some(version) = root.get("version") else {
        return Err(ConfigError::at(source, 0..0, "missing key `version`")
            .help(format!("begin the file with `version = {VERSION}`")));
    };
    let number = version.get_ref().as_integer().and_then(|integer| integer.as_str().parse::<i64>().ok());
    if number == Some(VERSION) {
        return Ok(());
    }
    Err(ConfigError::at(source, version.span(), "this version of the pipeline file is not known")
        .help(format!("this program reads `version = {VERSION}`")))
}

/// Refuses `[[mosaic]]` where `[mosaic]` is meant: serde would fill a table's keys from a list by their order.
fn refuse_lists_for_tables(
    source: &Arc<Source>,
    document: &DeTable<'_>,
    schema: &Value,
) -> Result<(), ConfigError> {
    let mut open: Vec<(&DeTable<'_>, &Value)> = vec![(document, schema)];
    while let Some((table, described)) = open.pop() {
        for (key, value) in table {
            let expected = table_schema(schema, &described["properties"][key.get_ref().as_ref()]);
            // A list of tables is described by its items.
            let items = expected
                .is_none()
                .then(|| table_schema(schema, &described["properties"][key.get_ref().as_ref()]["items"]));
            match (value.get_ref(), expected, items.flatten()) {
                (DeValue::Table(inner), Some(expected), _) => open.push((inner, expected)),
                (DeValue::Array(_), Some(_), _) => {
                    return Err(ConfigError::at(source, value.span(), format!("`{}` is a list; expected a table", key.get_ref()))
                        .help("a table's header has single brackets: [name]; written in one line it has braces: name = { key = value }"));
                }
                (DeValue::Array(list), None, Some(item)) => {
                    for element in list.iter() {
                        match element.get_ref() {
                            DeValue::Table(inner) => open.push((inner, item)),
                            DeValue::Array(_) => {
                                return Err(ConfigError::at(
                                    source,
                                    element.span(),
                                    format!("an element of `{}` is a list; expected a table", key.get_ref()),
                                ));
                            }
                            _ => {}
                        }
                    }
                }
                _ => {}
            }
        }
    }
    Ok(())
}

/// The schema of a table behind references and options; `None` when `described` is not a table.
fn table_schema<'s>(root: &'s Value, described: &'s Value) -> Option<&'s Value> {
    if let Some(reference) = described["$ref"].as_str() {
        return table_schema(root, root.pointer(reference.trim_start_matches('#'))?);
    }
    if let Some(options) = described["anyOf"].as_array() {
        return options.iter().find_map(|option| table_schema(root, option));
    }
    described["properties"].is_object().then_some(described)
}

/// Turns a TOML or serde error into one about keys and values.
fn refusal(source: &Arc<Source>, error: &toml::de::Error) -> ConfigError {
    let span = error.span().unwrap_or(0..0);
    let (message, help) = match error.message().split_once(HELP_MARK) {
        Some((message, help)) => (message, Some(help.to_owned())),
        None => (error.message(), None),
    };
    let quoted =
        |text: &str| -> Vec<String> { text.split('`').skip(1).step_by(2).map(str::to_owned).collect() };
    if let Some(rest) = message.strip_prefix("unknown field ") {
        let names = quoted(rest);
        return with_suggestion(
            ConfigError::at(source, span, format!("unknown key `{}`", names[0])),
            &names,
            "keys",
        );
    }
    if let Some(rest) = message.strip_prefix("unknown variant ") {
        let names = quoted(rest);
        return with_suggestion(
            ConfigError::at(source, span, format!("unknown value \"{}\"", names[0])),
            &names,
            "values",
        );
    }
    if let Some(rest) = message.strip_prefix("missing field ") {
        return ConfigError::at(source, span, format!("missing key {rest}"))
            .help(format!("add {rest} to this table"));
    }
    let mut refused = ConfigError::at(source, span, plain_types(message));
    if let Some(help) = help {
        refused = refused.help(help);
    }
    refused
}

/// `names`: the refused one, then the accepted ones.
fn with_suggestion(error: ConfigError, names: &[String], what: &str) -> ConfigError {
    let (refused, accepted) = (names[0].to_lowercase(), &names[1..]);
    let nearest = accepted
        .iter()
        .map(|name| (strsim::damerau_levenshtein(&refused, name), name))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, name)| *distance <= 1 + name.len() / 3);
    let error = match nearest {
        Some((_, name)) => error.help(format!("did you mean `{name}`?")),
        None => error,
    };
    if accepted.is_empty() {
        return error.help(format!("no {what} are accepted here"));
    }
    let listed: Vec<_> = accepted.iter().map(|name| format!("`{name}`")).collect();
    error.help(format!("{what} accepted here: {}", listed.join(", ")))
}

/// Rust's type names mean nothing to the writer of a pipeline file.
fn plain_types(message: &str) -> String {
    const WORDS: [(&str, &str); 9] = [
        ("expected f64", "expected a number"),
        ("expected u64", "expected a whole number"),
        ("expected u32", "expected a whole number"),
        ("expected usize", "expected a whole number"),
        ("expected path string", "expected a path"),
        ("expected a sequence", "expected a list"),
        ("invalid type: sequence", "invalid type: list"),
        ("invalid type: map", "invalid type: table"),
        ("expected a borrowed string", "expected a string"),
    ];
    let mut text = WORDS.iter().fold(message.to_owned(), |text, (rust, plain)| text.replace(rust, plain));
    if let Some(at) = text.find("expected struct ") {
        text.truncate(at);
        text.push_str("expected a table");
    }
    text
}
