//! Corners found elsewhere, in the text format of Zhang's data: numbers in pairs, x y x y …, any number a line.

use super::InputError;
use std::path::Path;

/// Reads all pairs of a file, in their order.
///
/// # Errors
/// [`InputError`]: unreadable, something that is not a finite number, an odd count, or no pair at all.
pub fn read_pairs(file: &Path) -> Result<Vec<(f64, f64)>, InputError> {
    let text = std::fs::read_to_string(file)
        .map_err(|error| InputError::new(file, format!("cannot be read as text ({error})")))?;
    pairs(file, &text)
}

fn pairs(file: &Path, text: &str) -> Result<Vec<(f64, f64)>, InputError> {
    let mut values = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        for word in line.split_whitespace() {
            match word.parse::<f64>() {
                Ok(value) if value.is_finite() => values.push(value),
                _ => {
                    return Err(InputError::new(file, format!("\"{word}\" is not a finite number"))
                        .line(number)
                        .help("the file holds x y pairs separated by blanks and nothing else"));
                }
            }
        }
    }
    if values.is_empty() || values.len() % 2 == 1 {
        let count = values.len();
        return Err(InputError::new(file, format!("holds {count} numbers, which make no pairs x y")));
    }
    Ok(values.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_run_over_lines_and_bad_words_are_placed() {
        let read = |text| pairs(Path::new("data1.txt"), text);
        assert_eq!(read("1 2  3 4e-1\n\n-5 6\n").unwrap(), [(1.0, 2.0), (3.0, 0.4), (-5.0, 6.0)]);
        assert_eq!(read("1 2\n3 x\n").unwrap_err().line, Some(2));
        assert!(read("1 2 3").unwrap_err().cause.contains("3 numbers"));
        assert!(read("").unwrap_err().cause.contains("0 numbers"));
        assert!(read("nan 1").is_err());
    }
}
