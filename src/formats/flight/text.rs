//! Lines, cells and numbers of text logs.

use super::{BadRecord, FlightLog, ReadError};

/// No record of a text log comes near; beyond, the cells of a line could take more memory than the file.
const LONGEST_LINE: usize = 1 << 16;

/// Bad records that are listed whatever the good ones are.
const MOST_BAD: usize = 10_000;

/// The lines of a text with their numbers from 1; a line that is not UTF-8 says so. LF and CRLF end a line, a byte order
/// mark is passed over.
///
/// # Errors
/// [`ReadError`] for UTF-16, which some exports call "Unicode".
pub(super) fn lines(bytes: &[u8]) -> Result<impl Iterator<Item = (u64, Result<&str, String>)>, ReadError> {
    if bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
        return Err(ReadError::new("is UTF-16 text").help("save it as UTF-8 text"));
    }
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    Ok((1..).zip(text.split(|b| *b == b'\n')).map(|(number, line)| {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        if line.len() > LONGEST_LINE {
            return (number, Err(format!("is {} bytes long, the limit is {LONGEST_LINE}", line.len())));
        }
        (number, std::str::from_utf8(line).map_err(|_| "is not UTF-8 text".to_owned()))
    }))
}

/// What parts the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delimiter {
    /// This character; cells may stand in double quotes, a quote inside them is doubled.
    Character(char),
    /// Any run of blanks and tabs; a cell may stand in double quotes.
    Blanks,
}

impl Delimiter {
    /// The one that a line uses: a tab before a semicolon before a comma before blanks.
    pub(super) fn of(line: &str) -> Self {
        ['\t', ';', ',']
            .into_iter()
            .find(|c| outside_quotes(line).any(|(_, found)| found == *c))
            .map_or(Self::Blanks, Self::Character)
    }

    /// The cells of a line, trimmed and without their quotes, each with the byte at which it begins.
    pub(super) fn cells(self, line: &str) -> Vec<(usize, String)> {
        let mut cells = Vec::new();
        let mut from = 0;
        for (at, c) in outside_quotes(line) {
            let ends = match self {
                Self::Character(delimiter) => c == delimiter,
                Self::Blanks => c == ' ' || c == '\t',
            };
            if ends {
                self.push(&mut cells, line, from, at);
                from = at + c.len_utf8();
            }
        }
        self.push(&mut cells, line, from, line.len());
        cells
    }

    fn push(self, cells: &mut Vec<(usize, String)>, line: &str, from: usize, to: usize) {
        let cell = line.get(from..to).unwrap_or("").trim();
        if self != Self::Blanks || !cell.is_empty() {
            cells.push((from, unquoted(cell)));
        }
    }
}

/// Characters of a line that no quotes enclose. A quote opens only at the start of a cell, so that `5'10"` stays a cell.
fn outside_quotes(line: &str) -> impl Iterator<Item = (usize, char)> {
    let (mut quoted, mut starts) = (false, true);
    line.char_indices().filter(move |(_, c)| {
        let visible = !quoted && *c != '"';
        if *c == '"' && (quoted || starts) {
            quoted = !quoted;
        }
        starts = !quoted && matches!(c, ',' | ';' | '\t' | ' ');
        visible
    })
}

fn unquoted(cell: &str) -> String {
    match cell.strip_prefix('"').and_then(|c| c.strip_suffix('"')) {
        Some(inside) => inside.replace("\"\"", "\""),
        None => cell.to_owned(),
    }
}

/// A finite number.
///
/// # Errors
/// Words for text that is none.
pub(super) fn number(name: &str, text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(value) => Err(format!("{name} is {value}")),
        Err(_) if text.is_empty() => Err(format!("{name} is missing")),
        Err(_) => Err(format!("{name} is \"{}\", not a number", short(text))),
    }
}

/// A number that may be missing: nothing, or NaN.
///
/// # Errors
/// As [`number`].
pub(super) fn optional(name: &str, text: &str) -> Result<Option<f64>, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_nan() => Ok(None),
        _ if text.is_empty() => Ok(None),
        _ => number(name, text).map(Some),
    }
}

/// A standard deviation that may be missing; 0 and less is how files write "unknown".
///
/// # Errors
/// As [`number`].
pub(super) fn std(name: &str, text: &str) -> Result<Option<f64>, String> {
    Ok(optional(name, text)?.filter(|value| *value > 0.0))
}

/// Lists a bad record.
///
/// # Errors
/// [`ReadError`] once there are more than ten thousand and more than usable ones: the file is of another kind, and a list
/// of its lines helps nobody.
pub(super) fn bad(
    log: &mut FlightLog,
    place: u64,
    frame: Option<String>,
    cause: String,
) -> Result<(), ReadError> {
    log.bad.push(BadRecord { place, frame, cause });
    let usable = log.exposures.len() + log.positions.len();
    match log.bad.first() {
        Some(first) if log.bad.len() > MOST_BAD.max(usable) => Err(ReadError::new(format!(
            "{} of its first {} records are unusable; the first: {}",
            log.bad.len(),
            log.bad.len() + usable,
            first.cause
        ))
        .line(first.place)),
        _ => Ok(()),
    }
}

/// Text for a message: its first forty characters.
pub(super) fn short(text: &str) -> String {
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// A log in which at least one record is usable.
///
/// # Errors
/// [`ReadError`] for a log without one, with the first bad record's cause.
pub(super) fn not_empty(log: FlightLog, kind: &str) -> Result<FlightLog, ReadError> {
    if !log.exposures.is_empty() || !log.positions.is_empty() {
        return Ok(log);
    }
    Err(match log.bad.first() {
        Some(bad) => ReadError::new(format!(
            "holds no usable record of {kind}; of {} bad ones the first: {}",
            log.bad.len(),
            bad.cause
        ))
        .line(bad.place),
        None => ReadError::new(format!("holds no record of {kind}")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(delimiter: Delimiter, line: &str) -> Vec<String> {
        delimiter.cells(line).into_iter().map(|(_, cell)| cell).collect()
    }

    #[test]
    fn lines_of_windows_and_bytes_that_are_no_text() {
        let found: Vec<_> = lines(b"\xEF\xBB\xBFa\r\nb\n\xFF\n").unwrap().collect();
        assert_eq!(found[..2], [(1, Ok("a")), (2, Ok("b"))]);
        assert_eq!(found[2], (3, Err("is not UTF-8 text".to_owned())));
        assert!(lines(b"\xFF\xFEa\0").err().unwrap().cause.contains("UTF-16"));
    }

    #[test]
    fn cells_by_the_delimiter_of_the_line() {
        let comma = Delimiter::of("\"a, b.jpg\",1");
        assert_eq!(comma, Delimiter::Character(','));
        assert_eq!(cells(comma, " \"a, \"\"b\"\".jpg\" , 1,,x\"y"), ["a, \"b\".jpg", "1", "", "x\"y"]);
        assert_eq!(Delimiter::of("a b\t1,5"), Delimiter::Character('\t'));
        assert_eq!(Delimiter::of("\"a;b\" 1"), Delimiter::Blanks);
        assert_eq!(cells(Delimiter::Blanks, "  ../é.jpg \t 1  2 "), ["../é.jpg", "1", "2"]);
        assert_eq!(Delimiter::Blanks.cells("ab  cd")[1], (4, "cd".to_owned()));
    }

    #[test]
    fn a_file_of_another_kind_is_not_listed_line_by_line() {
        let mut log = FlightLog::new(super::super::Clock::Own);
        let kept = (1..20_000).find(|i| bad(&mut log, *i, None, "is odd".to_owned()).is_err());
        assert_eq!((kept, log.bad.len()), (Some(10_001), 10_001));
        let long = "x".repeat(70_000);
        let (_, line) = lines(long.as_bytes()).unwrap().next().unwrap();
        assert_eq!(line, Err("is 70000 bytes long, the limit is 65536".to_owned()));
    }

    #[test]
    fn numbers_say_what_they_are_not() {
        assert_eq!(number("x", "-1.5e2"), Ok(-150.0));
        assert_eq!(number("x", "inf"), Err("x is inf".to_owned()));
        assert_eq!(number("x", ""), Err("x is missing".to_owned()));
        assert_eq!(number("x", "abc"), Err("x is \"abc\", not a number".to_owned()));
        assert_eq!(optional("x", "NaN"), Ok(None));
        assert_eq!(std("x", "0"), Ok(None));
        assert_eq!(short(&"é".repeat(50)).chars().count(), 41);
    }
}
