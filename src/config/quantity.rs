//! Quantities written with their unit (`"15.7 mm"`), so that no number in a pipeline file can be misread.
//!
//! Each type holds one SI value; the unit exists only in the text. Bare numbers, unknown units and non-finite values
//! are refused with the spelling that would have been accepted.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

/// Separates what is wrong from what to do inside the one string a serde error can carry.
pub(super) const HELP_MARK: &str = "\nhelp: ";

/// Why a quantity's text was refused.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum QuantityError {
    /// The text does not begin with a number.
    #[error("\"{text}\" is not a {kind}\nhelp: write a number and a unit, for example \"{example}\"")]
    NoNumber {
        /// The text as written.
        text: String,
        /// What was wanted ("length", ...).
        kind: &'static str,
        /// An accepted spelling.
        example: &'static str,
    },
    /// A number stands alone.
    #[error("{kind} {number} has no unit\nhelp: write \"{number} {unit}\" (units of a {kind}: {units})")]
    NoUnit {
        /// The number as written.
        number: String,
        /// What was wanted.
        kind: &'static str,
        /// A unit that could follow.
        unit: &'static str,
        /// Every accepted unit.
        units: String,
    },
    /// The unit is not one of this kind's.
    #[error("unknown unit \"{unit}\" in {kind} \"{text}\"\nhelp: units of a {kind}: {units}")]
    UnknownUnit {
        /// The text as written.
        text: String,
        /// The refused unit.
        unit: String,
        /// What was wanted.
        kind: &'static str,
        /// Every accepted unit.
        units: String,
    },
    /// NaN, infinity, or a value too large to hold.
    #[error("{kind} \"{text}\" is not a finite number")]
    NotFinite {
        /// The text as written.
        text: String,
        /// What was wanted.
        kind: &'static str,
    },
}

/// A unit's spelling and its size in the SI unit as a fraction: "35 cm" is 35 / 100, the number nearest to 0.35, where 35 × 0.01 is not.
type Unit = (&'static str, f64, f64);

/// What a kind of quantity is called and which units it accepts; the first unit is the one suggested.
struct Kind {
    name: &'static str,
    example: &'static str,
    units: &'static [Unit],
}

impl Kind {
    fn units_listed(&self) -> String {
        self.units.iter().map(|(spelling, ..)| *spelling).collect::<Vec<_>>().join(", ")
    }

    fn parse(&self, text: &str) -> Result<f64, QuantityError> {
        let trimmed = text.trim();
        let split = end_of_number(trimmed);
        let (number, unit) = (trimmed[..split].trim_end(), trimmed[split..].trim());
        let not_finite = || QuantityError::NotFinite { text: text.to_owned(), kind: self.name };
        if number.is_empty() {
            let word = trimmed.trim_start_matches(['+', '-']).to_ascii_lowercase();
            return Err(if word.starts_with("nan") || word.starts_with("inf") {
                not_finite()
            } else {
                QuantityError::NoNumber { text: text.to_owned(), kind: self.name, example: self.example }
            });
        }
        let value: f64 = number.parse().map_err(|_| QuantityError::NoNumber {
            text: text.to_owned(),
            kind: self.name,
            example: self.example,
        })?;
        if unit.is_empty() {
            return Err(self.no_unit(number));
        }
        let Some((_, numerator, denominator)) = self.units.iter().find(|(spelling, ..)| *spelling == unit)
        else {
            return Err(QuantityError::UnknownUnit {
                text: text.to_owned(),
                unit: unit.to_owned(),
                kind: self.name,
                units: self.units_listed(),
            });
        };
        let si = value * numerator / denominator;
        if si.is_finite() { Ok(si) } else { Err(not_finite()) }
    }

    fn no_unit(&self, number: &str) -> QuantityError {
        QuantityError::NoUnit {
            number: number.to_owned(),
            kind: self.name,
            unit: self.units[0].0,
            units: self.units_listed(),
        }
    }

    /// Writes `si` in the first unit, rounded to 15 digits so that "-2.5 deg" survives its way through radians.
    fn write(&self, si: f64) -> String {
        let (spelling, numerator, denominator) = self.units[0];
        let value = si * denominator / numerator;
        let rounded = format!("{value:.14e}").parse::<f64>().unwrap_or(value);
        format!("{rounded} {spelling}")
    }

    fn pattern(&self) -> String {
        let units: Vec<_> = self.units.iter().map(|(spelling, ..)| spelling.replace('/', "\\/")).collect();
        format!("^\\s*[+-]?([0-9]+\\.?[0-9]*|\\.[0-9]+)([eE][+-]?[0-9]+)?\\s*({})\\s*$", units.join("|"))
    }
}

/// Where the number at the start of `text` ends. An `e` belongs to it only when digits follow.
fn end_of_number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits_from = |mut at: usize| {
        while at < bytes.len() && (bytes[at].is_ascii_digit() || bytes[at] == b'.') {
            at += 1;
        }
        at
    };
    let sign = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let mantissa = digits_from(sign);
    if mantissa == sign {
        return 0;
    }
    if matches!(bytes.get(mantissa), Some(b'e' | b'E')) {
        let exponent_sign = usize::from(matches!(bytes.get(mantissa + 1), Some(b'+' | b'-')));
        let exponent = digits_from(mantissa + 1 + exponent_sign);
        if exponent > mantissa + 1 + exponent_sign {
            return exponent;
        }
    }
    mantissa
}

macro_rules! quantity {
    ($(#[$doc:meta])* $type:ident, $kind:literal, $example:literal, $getter:ident, $getter_doc:literal, [$(($unit:literal, $numerator:expr, $denominator:expr)),+ $(,)?]) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
        pub struct $type(f64);

        impl $type {
            const KIND: Kind = Kind { name: $kind, example: $example, units: &[$(($unit, $numerator, $denominator)),+] };

            #[doc = concat!("From a value in ", $getter_doc, ".")]
            pub const fn new(si: f64) -> Self {
                Self(si)
            }

            #[doc = concat!("The value in ", $getter_doc, ".")]
            pub const fn $getter(self) -> f64 {
                self.0
            }
        }

        impl std::str::FromStr for $type {
            type Err = QuantityError;
            fn from_str(text: &str) -> Result<Self, QuantityError> {
                Self::KIND.parse(text).map(Self)
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str(&Self::KIND.write(self.0))
            }
        }

        impl Serialize for $type {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }

        impl<'de> Deserialize<'de> for $type {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(QuantityVisitor(Self::KIND)).map(Self)
            }
        }

        impl JsonSchema for $type {
            fn schema_name() -> Cow<'static, str> {
                stringify!($type).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({
                    "type": "string",
                    "description": concat!("A ", $kind, " with its unit, for example \"", $example, "\"."),
                    "pattern": Self::KIND.pattern(),
                    "examples": [$example],
                })
            }
        }
    };
}

quantity!(
    /// A length; metres inside.
    Length, "length", "15.7 mm", metres, "metres",
    [
        ("m", 1.0, 1.0), ("mm", 1.0, 1e3), ("cm", 1.0, 1e2), ("km", 1e3, 1.0), ("ft", 3048.0, 1e4), ("inch", 254.0, 1e4)
    ]
);
quantity!(
    /// An angle; radians inside. Its sense is stated where it is used.
    Angle, "angle", "-32.08 deg", radians, "radians",
    [("deg", std::f64::consts::PI, 180.0), ("rad", 1.0, 1.0), ("mrad", 1.0, 1e3)]
);
quantity!(
    /// A span of time; seconds inside.
    Duration, "duration", "20 ms", seconds, "seconds",
    [
        ("s", 1.0, 1.0), ("ns", 1.0, 1e9), ("us", 1.0, 1e6), ("ms", 1.0, 1e3), ("min", 60.0, 1.0), ("h", 3600.0, 1.0)
    ]
);
quantity!(
    /// A speed; metres per second inside.
    Speed, "speed", "12 m/s", metres_per_second, "metres per second",
    [("m/s", 1.0, 1.0), ("km/h", 1.0, 3.6), ("kn", 1852.0, 3600.0)]
);
quantity!(
    /// A distance in an image; pixels inside.
    PixelLength, "pixel length", "0.5 px", pixels, "pixels", [("px", 1.0, 1.0)]
);
quantity!(
    /// An amount of memory or disk; bytes inside.
    ByteSize, "size", "768 MiB", bytes_f64, "bytes",
    [
        ("MiB", 1_048_576.0, 1.0), ("B", 1.0, 1.0), ("KiB", 1024.0, 1.0), ("GiB", 1_073_741_824.0, 1.0),
        ("kB", 1e3, 1.0), ("MB", 1e6, 1.0), ("GB", 1e9, 1.0)
    ]
);

impl ByteSize {
    /// The value in whole bytes.
    pub fn bytes(self) -> u64 {
        self.0 as u64
    }
}

struct QuantityVisitor(Kind);

impl Visitor<'_> for QuantityVisitor {
    type Value = f64;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "a {} with its unit, such as \"{}\"", self.0.name, self.0.example)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<f64, E> {
        self.0.parse(text).map_err(E::custom)
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<f64, E> {
        Err(E::custom(self.0.no_unit(&number.to_string())))
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<f64, E> {
        Err(E::custom(if number.is_finite() {
            self.0.no_unit(&number.to_string())
        } else {
            QuantityError::NotFinite { text: number.to_string(), kind: self.0.name }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn units_convert_to_si() {
        let length = |text: &str| text.parse::<Length>().unwrap().metres();
        for (text, metres) in [
            ("15.7 mm", 0.0157),
            ("1e3m", 1000.0),
            ("-2 ft", -0.6096),
            ("  .5 km ", 500.0),
            ("1 inch", 0.0254),
        ] {
            assert!((length(text) - metres).abs() < 1e-12, "{text}");
        }
        assert_eq!("180 deg".parse::<Angle>().unwrap().radians(), std::f64::consts::PI);
        assert_eq!("20 ms".parse::<Duration>().unwrap().seconds(), 0.02);
        assert_eq!("36 km/h".parse::<Speed>().unwrap().metres_per_second(), 10.0);
        assert_eq!("1 GiB".parse::<ByteSize>().unwrap().bytes(), 1 << 30);
    }

    #[test]
    fn refusals_name_what_would_be_accepted() {
        let refused = |text: &str| text.parse::<Length>().unwrap_err().to_string();
        assert!(refused("400").contains("write \"400 m\""), "{}", refused("400"));
        assert!(refused("3 furlong").contains("unknown unit \"furlong\""));
        assert!(refused("3 furlong").contains("m, mm, cm, km, ft, inch"));
        assert!(refused("tall").contains("not a length"));
        assert!(refused("").contains("not a length"));
        for text in ["nan m", "inf m", "-infinity m", "1e400 m"] {
            assert!(refused(text).contains("not a finite number"), "{}", refused(text));
        }
        assert!(refused("1.2.3 m").contains("not a length"));
    }

    proptest! {
        #[test]
        fn degrees_written_with_up_to_twelve_digits_come_back_unchanged(milli in -360_000_000i64..360_000_000) {
            let degrees = milli as f64 / 1e6;
            let angle: Angle = format!("{degrees} deg").parse().unwrap();
            prop_assert_eq!(angle.to_string(), format!("{degrees} deg"));
        }

        #[test]
        fn no_text_panics(text in "\\PC{0,12}") {
            let _ = text.parse::<Length>();
            let _ = text.parse::<Speed>();
        }
    }
}
