//! Text tables whose first line names the columns.

use super::InputError;
use crate::config::Located;
use std::path::{Path, PathBuf};

/// Tables larger than this are refused before they are read: no survey's log comes near it.
const MAX_BYTES: u64 = 2 << 30;

/// A table in memory.
#[derive(Debug, Clone)]
pub struct Table {
    file: PathBuf,
    header: Vec<String>,
    /// Each with its line in the file.
    rows: Vec<(u64, csv::StringRecord)>,
}

/// The place of a column in a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column(usize);

/// One row.
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    line: u64,
    header: &'a [String],
    record: &'a csv::StringRecord,
}

impl Table {
    /// Reads a table; a byte order mark is passed over, cells are trimmed.
    ///
    /// # Errors
    /// [`InputError`] when the file cannot be read, is empty or is not UTF-8.
    pub fn read(file: &Located<PathBuf>, delimiter: u8) -> Result<Self, InputError> {
        Self::read_path(file, delimiter).map_err(|e| e.caused_by(file))
    }

    /// As [`Table::read`], for a file that no pipeline file names.
    ///
    /// # Errors
    /// As [`Table::read`].
    pub fn read_path(path: &Path, delimiter: u8) -> Result<Self, InputError> {
        let unreadable = |e: std::io::Error| InputError::new(path, format!("cannot be read ({e})"));
        let size = std::fs::metadata(path).map_err(unreadable)?.len();
        if size > MAX_BYTES {
            return Err(InputError::new(path, format!("is {size} bytes long, the limit is {MAX_BYTES}")));
        }
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes);
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(delimiter)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            // A torn row is that row's matter: its cells say so when they are asked for.
            .flexible(true)
            .from_reader(text);
        let malformed = |e: csv::Error| {
            let line = e.position().map(csv::Position::line);
            let cause = match e.kind() {
                csv::ErrorKind::Utf8 { .. } => "is not UTF-8 text".to_owned(),
                _ => e.to_string(),
            };
            let error = InputError::new(path, cause);
            line.map_or(error.clone(), |l| error.line(l))
        };
        let header: Vec<String> = reader.headers().map_err(malformed)?.iter().map(str::to_owned).collect();
        if header.iter().all(String::is_empty) {
            return Err(InputError::new(path, "is empty: a first line with the columns' names is needed"));
        }
        if let Some((i, name)) = header.iter().enumerate().find(|(i, name)| header[..*i].contains(name)) {
            return Err(
                InputError::new(path, format!("column {} repeats the name \"{name}\"", i + 1)).line(1)
            );
        }
        let rows = reader
            .records()
            .map(|record| record.map(|r| (line_of(&r, text), r)))
            .collect::<Result<Vec<_>, _>>()
            .map_err(malformed)?;
        Ok(Self { file: path.to_owned(), header, rows })
    }

    /// The file it was read from.
    #[must_use]
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The place of a declared column.
    ///
    /// # Errors
    /// [`InputError`] that lists the columns there are, points at the declaration and guesses the one meant.
    pub fn column(&self, name: &Located<String>) -> Result<Column, InputError> {
        self.column_named(name).map_err(|e| e.caused_by(name))
    }

    /// The place of a column.
    ///
    /// # Errors
    /// As [`Table::column`].
    pub fn column_named(&self, name: &str) -> Result<Column, InputError> {
        if let Some(i) = self.header.iter().position(|h| h == name) {
            return Ok(Column(i));
        }
        let error = InputError::new(&self.file, format!("has no column \"{name}\""));
        let nearest = self
            .header
            .iter()
            .map(|h| (strsim::jaro_winkler(&h.to_lowercase(), &name.to_lowercase()), h))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|(likeness, _)| *likeness > 0.8);
        let all = self.header.join(", ");
        Err(match nearest {
            Some((_, h)) => error.help(format!("did you mean \"{h}\"? its columns are: {all}")),
            None => error.help(format!("its columns are: {all}")),
        })
    }

    /// True when the table has such a column.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.header.iter().any(|h| h == name)
    }

    /// The rows below the header, in order.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.rows.iter().map(|(line, record)| Row { line: *line, header: &self.header, record })
    }
}

/// Line of a record; the reader counts from where it began to look, before any blank or comment lines.
fn line_of(record: &csv::StringRecord, text: &[u8]) -> u64 {
    let Some(position) = record.position() else { return 0 };
    let (mut at, mut line) = (usize::try_from(position.byte()).unwrap_or(text.len()), position.line());
    while let Some(b'\n' | b'\r' | b'#') = text.get(at) {
        match text[at..].iter().position(|b| *b == b'\n') {
            None => break,
            Some(end) => {
                at += end + 1;
                line += 1;
            }
        }
    }
    line
}

impl Row<'_> {
    /// Line in the file, 1-based.
    #[must_use]
    pub const fn line(&self) -> u64 {
        self.line
    }
    /// The text of a cell.
    #[must_use]
    pub fn text(&self, column: Column) -> &str {
        self.record.get(column.0).unwrap_or("")
    }
    /// A finite number.
    ///
    /// # Errors
    /// Words for a cell that is empty, not a number, NaN or infinite, or a row of another length than the
    /// header.
    pub fn number(&self, column: Column) -> Result<f64, String> {
        if self.record.len() != self.header.len() {
            return Err(format!("has {} cells, the header has {}", self.record.len(), self.header.len()));
        }
        let (name, text) = (&self.header[column.0], self.text(column));
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(value) => Err(format!("{name} is {value}")),
            Err(_) if text.is_empty() => Err(format!("{name} is empty")),
            Err(_) => Err(format!("{name} is \"{text}\", not a number")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn table(text: &[u8]) -> Result<Table, InputError> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text).unwrap();
        Table::read_path(file.path(), b',')
    }

    #[test]
    fn cells_by_name_and_lines_by_number() {
        let t = table(b"\xEF\xBB\xBFfile, lat\na.jpg, 41.5\n\nb.jpg,nan\nc.jpg,\nd.jpg,x\n").unwrap();
        let lat = t.column_named("lat").unwrap();
        let cells: Vec<_> = t.rows().map(|r| (r.line(), r.number(lat))).collect();
        assert_eq!(cells[0], (2, Ok(41.5)));
        assert_eq!(cells[1], (4, Err("lat is NaN".to_owned())));
        assert_eq!(cells[2].1, Err("lat is empty".to_owned()));
        assert_eq!(cells[3].1, Err("lat is \"x\", not a number".to_owned()));
    }

    #[test]
    fn refusals_name_the_place() {
        let missing = table(b"file,latitude\n").unwrap().column_named("latitud").unwrap_err();
        assert!(missing.help.unwrap().starts_with("did you mean \"latitude\"?"));
        assert!(table(b"").unwrap_err().cause.contains("is empty"));
        let torn = table(b"a,b\n1,2\n1,2,3\n4").unwrap();
        let a = torn.column_named("a").unwrap();
        let cells: Vec<_> = torn.rows().map(|r| r.number(a)).collect();
        assert_eq!(cells[0], Ok(1.0));
        assert_eq!(cells[1], Err("has 3 cells, the header has 2".to_owned()));
        assert_eq!(cells[2], Err("has 1 cells, the header has 2".to_owned()));
        assert!(table(b"a,a\n").unwrap_err().cause.contains("repeats"));
        assert!(table(b"a,b\n\xff,2\n").unwrap_err().cause.contains("UTF-8"));
    }
}
