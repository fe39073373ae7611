//! The text a configuration was read from, and places in it, so that every later error can show the very line.
//!
//! Overrides (`--set key=value`) are kept behind the file's own text in one address space: a span beyond the end
//! of the file belongs to an override, and an error about it shows the command line argument instead of the file.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use annotate_snippets::renderer::DecorStyle;
use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A value and where it stands in the pipeline file (byte range, or a range inside an override).
#[derive(Debug, Clone)]
pub struct Located<T> {
    /// The value itself.
    pub value: T,
    /// Bytes of [`Source`] it was read from; empty when the value is a default.
    pub span: Range<usize>,
}

impl<T> Located<T> {
    /// A value that stands nowhere in the file.
    pub fn unplaced(value: T) -> Self {
        Self { value, span: 0..0 }
    }

    /// The same place with another value.
    pub fn map<U>(self, change: impl FnOnce(T) -> U) -> Located<U> {
        Located { value: change(self.value), span: self.span }
    }

    /// The same place with a reference.
    pub fn as_ref(&self) -> Located<&T> {
        Located { value: &self.value, span: self.span.clone() }
    }
}

impl<T> std::ops::Deref for Located<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T: PartialEq> PartialEq for Located<T> {
    /// Two located values are equal when their values are: where they stand does not matter.
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Located<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = toml::Spanned::<T>::deserialize(deserializer)?;
        Ok(Self { span: spanned.span(), value: spanned.into_inner() })
    }
}

impl<T: Serialize> Serialize for Located<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.value.serialize(serializer)
    }
}

impl<T: JsonSchema> JsonSchema for Located<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        T::schema_name()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        T::json_schema(generator)
    }
    fn inline_schema() -> bool {
        T::inline_schema()
    }
}

/// The text of a pipeline file followed by its overrides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The file's name as the user gave it.
    pub name: PathBuf,
    /// The file's text.
    pub text: String,
    /// Overrides with the offset at which their text begins in the shared address space.
    overrides: Vec<(usize, String)>,
}

impl Source {
    /// A file's text with its overrides, each written `key.path=value`.
    pub fn new(name: &Path, text: &str, overrides: &[String]) -> Self {
        // One unused byte between the parts, so that an empty span at a part's end belongs to that part.
        let mut offset = text.len() + 1;
        let placed = overrides
            .iter()
            .map(|written| {
                let start = offset;
                offset += written.len() + 1;
                (start, written.clone())
            })
            .collect();
        Self { name: name.to_owned(), text: text.to_owned(), overrides: placed }
    }

    /// The overrides with the offset at which each begins.
    pub fn overrides(&self) -> impl Iterator<Item = (usize, &str)> {
        self.overrides.iter().map(|(start, written)| (*start, written.as_str()))
    }

    /// What `span` points into: name to show, text, and the span inside that text.
    fn part(&self, span: &Range<usize>) -> (String, &str, Range<usize>) {
        let holder = self.overrides.iter().rev().find(|(start, _)| span.start >= *start);
        let (name, text, start) = match holder {
            Some((start, written)) => ("--set".to_owned(), written.as_str(), *start),
            None => (self.name.display().to_string(), self.text.as_str(), 0),
        };
        let clamp =
            |position: usize| floor_char_boundary(text, position.saturating_sub(start).min(text.len()));
        (name, text, clamp(span.start)..clamp(span.end.max(span.start)))
    }

    /// Line and column (both from 1, columns in characters) of the start of `span`.
    pub fn line_and_column(&self, span: &Range<usize>) -> (usize, usize) {
        let (_, text, span) = self.part(span);
        let before = &text[..span.start];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// `file:line:column`, or `--set <override>` for an override.
    pub fn place(&self, span: &Range<usize>) -> String {
        let (name, text, _) = self.part(span);
        if name == "--set" {
            return format!("--set {text}");
        }
        let (line, column) = self.line_and_column(span);
        format!("{name}:{line}:{column}")
    }
}

fn floor_char_boundary(text: &str, position: usize) -> usize {
    (0..=position).rev().find(|&candidate| text.is_char_boundary(candidate)).unwrap_or(0)
}

/// A place in the pipeline file: what an error keeps to be able to show the line later.
#[derive(Debug, Clone)]
pub struct Place {
    /// The text pointed into.
    pub source: Arc<Source>,
    /// The bytes pointed at.
    pub span: Range<usize>,
}

impl std::fmt::Display for Place {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.source.place(&self.span))
    }
}

/// What is wrong, where in the pipeline file (if it stands there), and what to do next.
#[derive(Debug, Clone)]
pub struct Diagnostic {
    /// What is wrong: a lowercase fragment with the values in it.
    pub message: String,
    /// Where it stands.
    pub place: Option<Place>,
    /// The next step for the user.
    pub help: Vec<String>,
}

impl Diagnostic {
    /// Renders the diagnostic for people: `error[class]: …`, the source line with a caret, the causes, the help.
    ///
    /// - `causes`: the chain of underlying errors, outermost first.
    /// - `colour`: whether to use terminal colours.
    pub fn render(&self, class: &str, causes: &[String], colour: bool) -> String {
        let renderer =
            if colour { Renderer::styled() } else { Renderer::plain() }.decor_style(DecorStyle::Ascii);
        let title = Level::ERROR.with_name(format!("error[{class}]")).primary_title(self.message.as_str());
        let mut group = Group::with_title(title);
        let located = self.place.as_ref().map(|place| place.source.part(&place.span));
        if let Some((name, text, span)) = &located {
            // An empty span would draw nothing: point at the character there, if any.
            let next = text[span.start..].chars().next().map_or(0, char::len_utf8);
            let span =
                if span.is_empty() { span.start..span.start + next } else { first_line(text, span.clone()) };
            group = group.element(
                Snippet::source(*text)
                    .path(name.as_str())
                    .fold(true)
                    .annotation(AnnotationKind::Primary.span(span)),
            );
        }
        for cause in causes {
            group = group.element(Level::NOTE.with_name("cause").message(cause.as_str()));
        }
        for help in &self.help {
            group = group.element(Level::HELP.message(help.as_str()));
        }
        renderer.render(&[group])
    }
}

/// A span over several lines (a whole table) is shown by its first line.
fn first_line(text: &str, span: Range<usize>) -> Range<usize> {
    let end = text[span.clone()].find('\n').map_or(span.end, |newline| span.start + newline);
    span.start..end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_columns_count_characters_from_one() {
        let source = Source::new(Path::new("p.toml"), "é = 1\nab = \"µ\" x\n", &[]);
        let span = source.text.find('x').unwrap()..source.text.len();
        assert_eq!(source.line_and_column(&span), (2, 10));
        assert_eq!(source.place(&(0..1)), "p.toml:1:1");
        assert_eq!(source.line_and_column(&(1000..1001)), (3, 1));
    }

    #[test]
    fn spans_beyond_the_file_belong_to_the_override_they_fall_into() {
        let source = Source::new(Path::new("p.toml"), "a = 1\n", &["b=2".to_owned(), "c.d=3".to_owned()]);
        let starts: Vec<_> = source.overrides().map(|(start, _)| start).collect();
        assert_eq!(starts, [7, 11]);
        assert_eq!(source.place(&(9..10)), "--set b=2");
        assert_eq!(source.place(&(15..16)), "--set c.d=3");
        assert_eq!(source.line_and_column(&(15..16)), (1, 5));
    }

    #[test]
    fn rendering_shows_the_line_the_caret_the_cause_and_the_help() {
        let source = Arc::new(Source::new(Path::new("p.toml"), "version = 1\nfoo = 12\n", &[]));
        let diagnostic = Diagnostic {
            message: "folder is missing".into(),
            place: Some(Place { source, span: 18..20 }),
            help: vec!["make it".into()],
        };
        let text = diagnostic.render("input", &["not found".into()], false);
        for part in [
            "error[input]: folder is missing",
            "p.toml:2:7",
            "foo = 12",
            "^^",
            "cause: not found",
            "help: make it",
        ] {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
    }
}
