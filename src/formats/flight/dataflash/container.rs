//! The container: records that describe themselves (FMT, FMTU, UNIT, MULT), found again after damage.
//!
//! Why no crate: `ardupilot-binlog` 0.2 panics on a format shorter than its own header, gives up after 256 unknown
//! records, does not look for records inside the body of a broken one, ignores FMTU and allocates for every message.
//!
//! # Source
//! ArduPilot `AP_Logger/LogStructure.h` and `AP_Logger/README.md`.

use super::super::autopilot::{Quarantine, array_at};

const MAGIC: [u8; 2] = [0xA3, 0x95];
const FMT_TYPE: u8 = 0x80;
const FMT_LENGTH: usize = 89;
const HEADER: usize = 3;

/// A number of a message: where it lies, its C type by the format's letter, and its scale to the stated unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Field {
    offset: usize,
    letter: u8,
    scale: f64,
    radians: bool,
}

impl Field {
    /// The scaled number; `None` for text and beyond the end.
    pub(super) fn number(&self, body: &[u8]) -> Option<f64> {
        Some(self.raw(body)? * self.scale)
    }
    /// An angle in degrees, also when FMTU states radians.
    pub(super) fn degrees(&self, body: &[u8]) -> Option<f64> {
        let angle = self.number(body)?;
        Some(if self.radians { crate::units::Radians::new(angle).degrees() } else { angle })
    }
    /// What the raw number is multiplied by.
    pub(super) const fn scale(&self) -> f64 {
        self.scale
    }
    fn raw(&self, body: &[u8]) -> Option<f64> {
        let at = self.offset;
        Some(match self.letter {
            b'b' => f64::from(i8::from_le_bytes(array_at(body, at)?)),
            b'B' | b'M' => f64::from(u8::from_le_bytes(array_at(body, at)?)),
            b'h' | b'c' => f64::from(i16::from_le_bytes(array_at(body, at)?)),
            b'H' | b'C' => f64::from(u16::from_le_bytes(array_at(body, at)?)),
            b'i' | b'e' | b'L' => f64::from(i32::from_le_bytes(array_at(body, at)?)),
            b'I' | b'E' => f64::from(u32::from_le_bytes(array_at(body, at)?)),
            b'q' => i64::from_le_bytes(array_at(body, at)?) as f64,
            b'Q' => u64::from_le_bytes(array_at(body, at)?) as f64,
            b'f' => f64::from(f32::from_le_bytes(array_at(body, at)?)),
            b'd' => f64::from_le_bytes(array_at(body, at)?),
            b'g' => half(u16::from_le_bytes(array_at(body, at)?)),
            _ => return None,
        })
    }
}

/// A number of half precision.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1F), f64::from(bits & 0x3FF));
    sign * match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}

const fn size_of(letter: u8) -> Option<usize> {
    Some(match letter {
        b'b' | b'B' | b'M' => 1,
        b'h' | b'H' | b'c' | b'C' | b'g' => 2,
        b'i' | b'I' | b'e' | b'E' | b'f' | b'L' | b'n' => 4,
        b'q' | b'Q' | b'd' => 8,
        b'N' => 16,
        b'a' | b'Z' => 64,
        _ => return None,
    })
}

/// What a format's letter itself scales by.
const fn scale_of(letter: u8) -> f64 {
    match letter {
        b'c' | b'C' | b'e' | b'E' => 0.01,
        b'L' => 1e-7,
        _ => 1.0,
    }
}

/// One kind of message, as its FMT (and FMTU) record describes it.
#[derive(Debug, Clone)]
pub(super) struct Format {
    pub(super) name: String,
    /// Of the body, without the header.
    length: usize,
    fields: Vec<(String, Field)>,
}

impl Format {
    /// Reads the body of an FMT record: the type, and its description unless the declared length is impossible.
    fn of(body: &[u8]) -> Option<(u8, Self)> {
        let (&kind, &total) = (body.first()?, body.get(1)?);
        let length = usize::from(total).checked_sub(HEADER)?;
        let letters = text(body.get(6..22)?);
        let labels = text(body.get(22..86)?);
        let (mut offset, mut fields) = (0, Vec::new());
        for (letter, label) in letters.bytes().zip(labels.split(',')) {
            let Some(size) = size_of(letter) else { break };
            if offset + size > length {
                break;
            }
            let field = Field { offset, letter, scale: scale_of(letter), radians: false };
            fields.push((label.trim().to_owned(), field));
            offset += size;
        }
        Some((kind, Self { name: text(body.get(2..6)?), length, fields }))
    }

    /// A field by name.
    pub(super) fn field(&self, name: &str) -> Option<Field> {
        self.fields.iter().find(|(n, _)| n == name).map(|(_, f)| *f)
    }
    /// The first of several names that the message has.
    pub(super) fn any(&self, names: &[&str]) -> Option<Field> {
        names.iter().find_map(|n| self.field(n))
    }
    /// Where a text of 16 characters lies.
    pub(super) fn text_offset(&self, name: &str) -> Option<usize> {
        self.field(name).filter(|f| f.letter == b'N').map(|f| f.offset)
    }
    /// The text of a field.
    pub(super) fn text(&self, name: &str, body: &[u8]) -> Option<String> {
        let field = self.field(name)?;
        let size = size_of(field.letter)?;
        body.get(field.offset..field.offset + size).map(text)
    }
}

/// Bytes up to the first zero, as text.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}

/// Units and multipliers by letter; ArduPilot's own until the log states its own.
struct Units {
    multipliers: [f64; 256],
    radians: [bool; 256],
}

impl Default for Units {
    fn default() -> Self {
        let mut multipliers = [0.0; 256];
        let known = [
            (b'2', 1e2),
            (b'1', 1e1),
            (b'0', 1.0),
            (b'A', 1e-1),
            (b'B', 1e-2),
            (b'C', 1e-3),
            (b'D', 1e-4),
            (b'E', 1e-5),
            (b'F', 1e-6),
            (b'G', 1e-7),
            (b'I', 1e-9),
        ];
        for (letter, value) in known {
            multipliers[usize::from(letter)] = value;
        }
        let mut radians = [false; 256];
        radians[usize::from(b'r')] = true;
        Self { multipliers, radians }
    }
}

/// The formats met so far, by type.
struct Formats {
    by_type: Vec<Option<Format>>,
    units: Units,
}

impl Formats {
    fn new() -> Self {
        Self { by_type: vec![None; 256], units: Units::default() }
    }

    /// The whole length of a record of this type; `None` for a type not described (yet).
    fn length(&self, kind: u8) -> Option<usize> {
        if kind == FMT_TYPE {
            return Some(FMT_LENGTH);
        }
        self.by_type[usize::from(kind)].as_ref().map(|f| HEADER + f.length)
    }

    /// The whole length of the record whose header lies here.
    fn record_at(&self, bytes: &[u8], at: usize) -> Option<usize> {
        let [a, b, kind] = array_at(bytes, at)?;
        if [a, b] == MAGIC { self.length(kind) } else { None }
    }

    /// Whether a record starts at `at` and another (or the end of the file) follows it.
    fn chain_at(&self, bytes: &[u8], at: usize) -> bool {
        self.record_at(bytes, at).is_some_and(|length| {
            let end = at + length;
            end == bytes.len() || self.record_at(bytes, end).is_some()
        })
    }

    /// UNIT, MULT and FMTU; the type whose fields they change.
    fn describe(&mut self, kind: u8, body: &[u8]) -> Option<u8> {
        let format = self.by_type[usize::from(kind)].as_ref()?;
        match format.name.as_str() {
            "UNIT" => {
                let id = format.field("Id")?.number(body)? as u8;
                self.units.radians[usize::from(id)] = format.text("Label", body)? == "rad";
                None
            }
            "MULT" => {
                let id = format.field("Id")?.number(body)? as u8;
                let value = format.field("Mult")?.number(body)?;
                self.units.multipliers[usize::from(id)] = if value.is_normal() { value } else { 0.0 };
                None
            }
            "FMTU" => {
                let of = format.field("FmtType")?.number(body)? as u8;
                let (units, multipliers) = (format.text("UnitIds", body)?, format.text("MultIds", body)?);
                let described = self.by_type[usize::from(of)].as_mut()?;
                for (i, (_, field)) in described.fields.iter_mut().enumerate() {
                    let letter = multipliers.as_bytes().get(i).copied().unwrap_or(b'-');
                    let multiplier = self.units.multipliers[usize::from(letter)];
                    // `-` (none) and `?` (not worked out) leave the letter's own scale.
                    if !matches!(letter, b'-' | b'?') && multiplier != 0.0 {
                        field.scale = multiplier;
                    }
                    field.radians =
                        units.as_bytes().get(i).is_some_and(|u| self.units.radians[usize::from(*u)]);
                }
                Some(of)
            }
            _ => None,
        }
    }
}

/// What [`walk`] meets.
pub(super) enum Event<'a> {
    /// A kind of message was described, or described again.
    Format(u8, &'a Format),
    /// A message: its number in the file from 1, its type and its body.
    Message(u64, u8, &'a [u8]),
}

/// Visits every record in the file's order in one pass; damage is set aside and skipped.
pub(super) fn walk(bytes: &[u8], quarantine: &mut Quarantine, mut visit: impl FnMut(Event<'_>)) -> u64 {
    let mut formats = Formats::new();
    let (mut at, mut place) = (0, 0);
    while at < bytes.len() {
        let Some(length) = formats.record_at(bytes, at).filter(|length| at + length <= bytes.len()) else {
            let next = next_record(&formats, bytes, at + 1);
            quarantine.add(place + 1, format!("{} bytes at byte {at} are no record", next - at));
            at = next;
            continue;
        };
        place += 1;
        let end = at + length;
        // A record that nothing follows may have lost bytes: then the next one starts inside it.
        let alone = end < bytes.len() && formats.record_at(bytes, end).is_none();
        if let Some(inner) = alone.then(|| (at + HEADER..end).find(|i| formats.chain_at(bytes, *i))).flatten()
        {
            quarantine.add(place, format!("record at byte {at} lost {} bytes", end - inner));
            at = inner;
            continue;
        }
        let (kind, body) = (bytes[at + 2], &bytes[at + HEADER..end]);
        if kind == FMT_TYPE {
            match Format::of(body) {
                Some((of, format)) if of != FMT_TYPE => {
                    visit(Event::Format(of, formats.by_type[usize::from(of)].insert(format)));
                }
                Some(_) => {}
                None => {
                    quarantine.add(place, format!("FMT at byte {at} describes records shorter than 3 bytes"))
                }
            }
        } else {
            if let Some(of) = formats.describe(kind, body)
                && let Some(format) = &formats.by_type[usize::from(of)]
            {
                visit(Event::Format(of, format));
            }
            visit(Event::Message(place, kind, body));
        }
        at = end;
    }
    place
}

/// Where the next record starts, from `from` on; the end of the file when there is none.
fn next_record(formats: &Formats, bytes: &[u8], from: usize) -> usize {
    (from..bytes.len())
        .find(|at| {
            bytes[*at] == MAGIC[0]
                && formats.record_at(bytes, *at).is_some_and(|length| at + length <= bytes.len())
        })
        .unwrap_or(bytes.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_reads_as_ieee_754_has_it() {
        for (bits, value) in
            [(0x3C00, 1.0), (0xC000, -2.0), (0x7BFF, 65504.0), (0x0001, 5.960_464_477_539_063e-8)]
        {
            assert_eq!(half(bits), value);
        }
        assert!(half(0x7C00).is_infinite() && half(0x7E00).is_nan());
    }
}
