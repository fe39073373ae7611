//! JSON as other programs write it.

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::Value;
use std::borrow::Cow;

/// Members of an object in the file's order.
#[derive(Debug, Default)]
pub(super) struct Members(pub(super) Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Members {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Members;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Members, A::Error> {
                let mut members = Vec::new();
                while let Some(member) = map.next_entry()? {
                    members.push(member);
                }
                Ok(Members(members))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

/// The text with Python's `NaN`, `Infinity` and `-Infinity`, which are no JSON, written as `null`, so that they spoil only
/// the record they stand in.
pub(super) fn without_nan(bytes: &[u8]) -> Cow<'_, [u8]> {
    const NOT_JSON: [&[u8]; 3] = [b"NaN", b"-Infinity", b"Infinity"];
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let mut out: Option<Vec<u8>> = None;
    let (mut at, mut kept, mut quoted) = (0, 0, false);
    while let Some(byte) = bytes.get(at) {
        match byte {
            b'\\' if quoted => at += 1,
            b'"' => quoted = !quoted,
            b'N' | b'I' | b'-' if !quoted => {
                if let Some(word) = NOT_JSON.into_iter().find(|w| bytes[at..].starts_with(w)) {
                    let out = out.get_or_insert_with(|| Vec::with_capacity(bytes.len()));
                    out.extend_from_slice(&bytes[kept..at]);
                    out.extend_from_slice(b"null");
                    at += word.len();
                    kept = at;
                    continue;
                }
            }
            _ => {}
        }
        at += 1;
    }
    match out {
        Some(mut out) => {
            out.extend_from_slice(&bytes[kept..]);
            Cow::Owned(out)
        }
        None => Cow::Borrowed(bytes),
    }
}

/// Three finite numbers.
///
/// # Errors
/// Words for anything else.
pub(super) fn three(name: &str, value: Option<&Value>) -> Result<[f64; 3], String> {
    let list = value.and_then(Value::as_array).ok_or_else(|| format!("{name} is missing or no list"))?;
    let numbers: Vec<f64> = list.iter().filter_map(Value::as_f64).filter(|v| v.is_finite()).collect();
    match (<[f64; 3]>::try_from(numbers), list.len()) {
        (Ok(three), 3) => Ok(three),
        _ => Err(format!("{name} is not a list of three numbers")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_keep_their_order_and_nan_spoils_only_itself() {
        let text = br#"{"b": NaN, "a\"NaN": [-Infinity, "NaN", Infinity, 1]}"#;
        let members: Members = serde_json::from_slice(&without_nan(text)).unwrap();
        assert_eq!(members.0[0], ("b".to_owned(), Value::Null));
        assert_eq!(members.0[1].0, "a\"NaN");
        assert_eq!(members.0[1].1, serde_json::json!([null, "NaN", null, 1]));
        assert!(matches!(without_nan(b"[1]"), Cow::Borrowed(b"[1]")));
    }

    #[test]
    fn three_numbers_or_words() {
        assert_eq!(three("x", Some(&serde_json::json!([1, 2.5, -3]))), Ok([1.0, 2.5, -3.0]));
        for bad in [
            serde_json::json!([1, 2]),
            serde_json::json!([1, 2, null]),
            serde_json::json!("1"),
            serde_json::json!([1, 2, 3, null]),
        ] {
            assert!(three("x", Some(&bad)).is_err(), "{bad}");
        }
        assert!(three("x", None).is_err());
    }
}
