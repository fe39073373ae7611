//! The pipeline file's text: values with the reason for each beside it.

use std::path::{Component, Path, PathBuf};

/// Comments are broken at this width.
const WIDTH: usize = 118;

/// A piece of the file.
#[derive(Debug, Clone, PartialEq)]
pub enum Line {
    /// `[name]`, with an empty line before it.
    Table(&'static str),
    /// `key = value`, the value in TOML.
    Key(String, String),
    /// What was found, and follows from nothing else.
    Note(String),
    /// What was taken for true without being stated anywhere, and why.
    Assumed(String),
    /// What the user has to decide, what stands there meanwhile, and how to find out.
    Question(String),
    /// TOML that is not in force.
    Dormant(String),
}

/// `key = "text"`.
pub fn text(key: &str, value: &str) -> Line {
    Line::Key(key.to_owned(), quoted(value))
}

/// `key = value` of a value that is TOML already.
pub fn key(key: &str, value: impl ToString) -> Line {
    Line::Key(key.to_owned(), value.to_string())
}

/// A TOML string.
pub fn quoted(value: &str) -> String {
    toml::Value::from(value).to_string()
}

/// A number without digits that mean nothing.
pub fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

/// A TOML float: as [`rounded`], with a point.
pub fn float(value: f64, decimals: usize) -> String {
    let text = rounded(value, decimals);
    if text.contains('.') { text } else { format!("{text}.0") }
}

/// A file as the pipeline file names it: from its own folder, with slashes.
pub fn path_from(base: &Path, file: &Path) -> PathBuf {
    let (Ok(base), Ok(full)) = (base.canonicalize(), file.canonicalize()) else { return file.to_owned() };
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) =
        (base.components().collect(), full.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    // Another drive, or nothing in common but the root.
    if shared <= 1 && from.len() > 1 {
        return full;
    }
    let up = from[shared..].iter().map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(to[shared..].iter().copied()).collect();
    if relative.as_os_str().is_empty() { PathBuf::from(".") } else { relative }
}

/// The same as a TOML string.
pub fn quoted_path(base: &Path, file: &Path) -> String {
    let path = path_from(base, file);
    let text = path.to_string_lossy();
    quoted(&if cfg!(windows) { text.replace('\\', "/") } else { text.into_owned() })
}

/// The text, and the questions and assumptions in it.
#[derive(Debug, Default)]
pub struct Rendered {
    /// TOML.
    pub text: String,
    /// As asked.
    pub questions: Vec<String>,
    /// As stated.
    pub assumptions: Vec<String>,
}

/// The file's text out of its pieces.
pub fn render(lines: &[Line]) -> Rendered {
    let mut out = Rendered::default();
    for line in lines {
        match line {
            Line::Table(name) => out.text.push_str(&format!("\n[{name}]\n")),
            Line::Key(key, value) => out.text.push_str(&format!("{key} = {value}\n")),
            Line::Note(words) => comment(&mut out.text, words),
            Line::Assumed(words) => {
                comment(&mut out.text, &format!("assumed: {words}"));
                out.assumptions.push(words.clone());
            }
            Line::Question(words) => {
                out.questions.push(words.clone());
                comment(&mut out.text, &format!("QUESTION {}: {words}", out.questions.len()));
            }
            Line::Dormant(toml) => {
                for line in toml.lines() {
                    out.text.push_str(&format!("#{line}\n"));
                }
            }
        }
    }
    out
}

/// Words as comment lines; later lines of one comment stand in.
pub fn comment(out: &mut String, words: &str) {
    let mut line = String::from("#");
    // A name from a folder or a tag may hold anything; a line break would end the comment.
    let clean: String = words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    for word in clean.split(' ').filter(|word| !word.is_empty()) {
        if line.chars().count() + 1 + word.chars().count() > WIDTH && line.len() > 4 {
            out.push_str(&line);
            out.push('\n');
            line = String::from("#  ");
        }
        line.push(' ');
        line.push_str(word);
    }
    out.push_str(&line);
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_toml_whatever_names_hold() {
        let lines = [
            Line::Table("run"),
            text("output", "a \"b\"\n../ü"),
            Line::Note("a note\nversion = 2".to_owned()),
            Line::Question("which?".to_owned()),
            Line::Assumed("x ".repeat(200)),
            Line::Dormant("a = 1\nb = 2".to_owned()),
        ];
        let rendered = render(&lines);
        let value: toml::Table = rendered.text.parse().unwrap();
        assert_eq!(value["run"]["output"].as_str(), Some("a \"b\"\n../ü"));
        assert_eq!(value["run"].as_table().unwrap().len(), 1);
        assert!(
            rendered.text.contains("# QUESTION 1: which?\n") && rendered.text.contains("#a = 1\n#b = 2\n")
        );
        assert!(rendered.text.lines().all(|line| line.chars().count() <= WIDTH));
        assert_eq!((rendered.questions.len(), rendered.assumptions.len()), (1, 1));
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([rounded(1155.0, 2), rounded(0.1 + 0.2, 3), rounded(-0.0001, 2)], ["1155", "0.3", "0"]);
        assert_eq!([float(20.0, 1), float(0.25, 3), float(100.0, 0)], ["20.0", "0.25", "100.0"]);
    }

    #[test]
    fn paths_count_from_the_file_s_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a/deep"), folder.path().join("b"));
        std::fs::create_dir_all(&a).unwrap();
        std::fs::create_dir_all(&b).unwrap();
        assert_eq!(path_from(&b, &a), Path::new("../a/deep"));
        assert_eq!(path_from(&a, &a), Path::new("."));
        assert_eq!(quoted_path(folder.path(), &a), "\"a/deep\"");
    }
}
