//! The container: messages with a length and a type, formats that nest, subscriptions; found again after damage.
//!
//! Why no crate: `px4-ulog` 0.6 stops at the first damaged message, where most of a flight may follow, and indexes into
//! messages that are shorter than their own header.
//!
//! # Source
//! PX4 "ULog File Format" (docs.px4.io, version 1).

use super::super::ReadError;
use super::super::autopilot::{Quarantine, array_at};
use std::collections::BTreeMap;

pub(super) const MAGIC: [u8; 7] = [b'U', b'L', b'o', b'g', 0x01, 0x12, 0x35];
const FILE_HEADER: usize = 16;
const HEADER: usize = 3;
/// Messages that must follow one another before a place after damage is trusted.
const CHAIN: usize = 4;
/// Fields of one message, nested ones included; PX4's largest has some hundred.
const FIELDS: usize = 4_096;
const DEPTH: usize = 8;

/// C type of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "int8_t" => Self::I8,
            "uint8_t" | "bool" | "char" => Self::U8,
            "int16_t" => Self::I16,
            "uint16_t" => Self::U16,
            "int32_t" => Self::I32,
            "uint32_t" => Self::U32,
            "int64_t" => Self::I64,
            "uint64_t" => Self::U64,
            "float" => Self::F32,
            "double" => Self::F64,
            _ => return None,
        })
    }
    const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }
}

/// A number of a message; for an array its first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) kind: Kind,
    offset: usize,
}

impl Field {
    /// The number; `None` beyond the end (writers leave out padding at the end).
    pub(super) fn number(self, body: &[u8]) -> Option<f64> {
        let at = self.offset;
        Some(match self.kind {
            Kind::I8 => f64::from(i8::from_le_bytes(array_at(body, at)?)),
            Kind::U8 => f64::from(u8::from_le_bytes(array_at(body, at)?)),
            Kind::I16 => f64::from(i16::from_le_bytes(array_at(body, at)?)),
            Kind::U16 => f64::from(u16::from_le_bytes(array_at(body, at)?)),
            Kind::I32 => f64::from(i32::from_le_bytes(array_at(body, at)?)),
            Kind::U32 => f64::from(u32::from_le_bytes(array_at(body, at)?)),
            Kind::I64 => i64::from_le_bytes(array_at(body, at)?) as f64,
            Kind::U64 => u64::from_le_bytes(array_at(body, at)?) as f64,
            Kind::F32 => f64::from(f32::from_le_bytes(array_at(body, at)?)),
            Kind::F64 => f64::from_le_bytes(array_at(body, at)?),
        })
    }
    /// The same field some elements further on.
    pub(super) const fn element(self, i: usize) -> Self {
        Self { kind: self.kind, offset: self.offset + i * self.kind.size() }
    }
}

/// The fields of a topic by name; those of nested types as `outer.inner`, elements of their arrays as `outer[1].inner`.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    fields: Vec<(String, Field, usize)>,
    size: usize,
    /// Fields and nested types gone through.
    steps: usize,
}

impl Layout {
    /// A number, or the first of an array.
    pub(super) fn field(&self, name: &str) -> Option<Field> {
        self.fields.iter().find(|(n, ..)| n == name).map(|(_, f, _)| *f)
    }
    /// An array of at least `N` numbers.
    pub(super) fn array<const N: usize>(&self, name: &str) -> Option<[Field; N]> {
        let (_, first, count) = self.fields.iter().find(|(n, ..)| n == name)?;
        (*count >= N).then(|| std::array::from_fn(|i| first.element(i)))
    }
}

/// One field as a format states it.
#[derive(Debug, Clone)]
struct Declared {
    kind: String,
    count: usize,
    name: String,
}

/// Reads `type name` or `type[n] name`.
fn declared(text: &str) -> Option<Declared> {
    let (kind, name) = text.trim().split_once(' ')?;
    let (kind, count) = match kind.split_once('[') {
        Some((kind, count)) => (kind, count.strip_suffix(']')?.parse().ok()?),
        None => (kind, 1),
    };
    Some(Declared { kind: kind.to_owned(), count, name: name.trim().to_owned() })
}

/// The formats met so far.
#[derive(Debug, Default)]
struct Formats(BTreeMap<String, Vec<Declared>>);

impl Formats {
    /// Reads `name:type field;type field;…`.
    fn add(&mut self, text: &str) -> Option<()> {
        let (name, fields) = text.split_once(':')?;
        let fields: Option<Vec<Declared>> =
            fields.split(';').filter(|f| !f.trim().is_empty()).map(declared).collect();
        self.0.insert(name.to_owned(), fields?);
        Some(())
    }

    /// The fields of a topic with their places; `None` for one without a format, or one nested beyond reason.
    fn layout(&self, topic: &str) -> Option<Layout> {
        let mut layout = Layout::default();
        self.extend(&mut layout, topic, "", 0)?;
        Some(layout)
    }

    fn extend(&self, layout: &mut Layout, of: &str, prefix: &str, depth: usize) -> Option<()> {
        if depth > DEPTH {
            return None;
        }
        for Declared { kind, count, name } in self.0.get(of)? {
            if let Some(kind) = Kind::of(kind) {
                let field = Field { kind, offset: layout.size };
                layout.size = layout.size.checked_add(kind.size().checked_mul(*count)?)?;
                layout.fields.push((format!("{prefix}{name}"), field, *count));
            } else {
                for i in 0..*count {
                    layout.steps += 1;
                    if layout.steps > FIELDS {
                        return None;
                    }
                    let inner = if *count == 1 {
                        format!("{prefix}{name}.")
                    } else {
                        format!("{prefix}{name}[{i}].")
                    };
                    self.extend(layout, kind, &inner, depth + 1)?;
                }
            }
            layout.steps += 1;
            if layout.steps > FIELDS || layout.size > usize::from(u16::MAX) {
                return None;
            }
        }
        Some(())
    }
}

/// What [`walk`] meets.
pub(super) enum Event<'a> {
    /// A topic is logged from here on: message id, topic, instance, fields.
    Subscribed(u16, &'a str, u8, &'a Layout),
    /// Values: number of the message in the file from 1, message id, body.
    Data(u64, u16, &'a [u8]),
    /// A parameter's value.
    Parameter(&'a str, f64),
    /// Milliseconds that the logger could not write.
    Dropout(u16),
}

/// Where messages end: the file, or one of the places where data was appended later.
struct Sections {
    appended: Vec<usize>,
    len: usize,
}

impl Sections {
    fn end_after(&self, at: usize) -> usize {
        self.appended.iter().copied().filter(|o| *o > at).min().unwrap_or(self.len)
    }
}

/// The message at a place, if one can be there: its type and where it ends.
fn message_at(bytes: &[u8], at: usize, end: usize, known: &[bool]) -> Option<(u8, usize)> {
    let [a, b, kind] = array_at(bytes, at)?;
    let size = usize::from(u16::from_le_bytes([a, b]));
    let after = at + HEADER + size;
    if after > end {
        return None;
    }
    let possible = match kind {
        b'D' => {
            let id = array_at(bytes, at + HEADER).map(u16::from_le_bytes)?;
            size > 2 && known.get(usize::from(id)).copied().unwrap_or(false)
        }
        b'B' => size >= 40,
        b'F' | b'I' | b'M' | b'P' | b'Q' | b'A' | b'L' | b'C' => size >= 4,
        b'S' => size == 8,
        b'R' | b'O' => size == 2,
        _ => false,
    };
    possible.then_some((kind, after))
}

fn chain_at(bytes: &[u8], at: usize, end: usize, known: &[bool]) -> bool {
    let mut at = at;
    for _ in 0..CHAIN {
        match message_at(bytes, at, end, known) {
            Some((_, after)) => at = after,
            None => return false,
        }
        if at == end {
            return true;
        }
    }
    true
}

/// Visits every message in the file's order in one pass; damage is set aside and skipped.
///
/// # Errors
/// Bytes that are no ULog, or one that a reader of this version must refuse.
pub(super) fn walk(
    bytes: &[u8],
    quarantine: &mut Quarantine,
    mut visit: impl FnMut(Event<'_>),
) -> Result<u64, ReadError> {
    if bytes.len() < FILE_HEADER || bytes[..7] != MAGIC {
        return Err(ReadError::new(format!("no PX4 ULog: {} bytes without its first seven", bytes.len())));
    }
    let mut sections = Sections { appended: Vec::new(), len: bytes.len() };
    let mut formats = Formats::default();
    let mut known = vec![false; 1 << 16];
    let (mut at, mut place) = (FILE_HEADER, 0);
    while at < bytes.len() {
        let end = sections.end_after(at);
        let Some((kind, after)) = message_at(bytes, at, end, &known) else {
            at = skip_damage(bytes, at, end, &known, place + 1, quarantine);
            continue;
        };
        place += 1;
        // A message that nothing follows may have lost bytes: then the next one starts inside it.
        let alone = after < end && message_at(bytes, after, end, &known).is_none();
        let inner = || (at + HEADER..after).find(|i| chain_at(bytes, *i, end, &known));
        if let Some(inner) = alone.then(inner).flatten() {
            quarantine.add(place, format!("message at byte {at} lost {} bytes", after - inner));
            at = inner;
            continue;
        }
        let body = &bytes[at + HEADER..after];
        if kind == b'F' && formats.add(&String::from_utf8_lossy(body)).is_none() {
            quarantine.add(place, format!("format at byte {at} cannot be read"));
        }
        match kind {
            b'D' => visit(Event::Data(place, u16::from_le_bytes([body[0], body[1]]), &body[2..])),
            b'B' => sections.appended = flags(body, bytes.len())?,
            b'A' => subscribe(body, &formats, &mut known, &mut visit),
            b'P' => {
                if let Some((name, value)) = parameter(body) {
                    visit(Event::Parameter(name, value));
                }
            }
            b'O' => visit(Event::Dropout(u16::from_le_bytes([body[0], body[1]]))),
            _ => {}
        }
        at = after;
    }
    Ok(place)
}

/// The next place that can be trusted, or the section's end.
fn skip_damage(
    bytes: &[u8],
    at: usize,
    end: usize,
    known: &[bool],
    place: u64,
    quarantine: &mut Quarantine,
) -> usize {
    let next = (at + 1..end).find(|i| chain_at(bytes, *i, end, known)).unwrap_or(end);
    quarantine.add(place, format!("{} bytes at byte {at} are no message", next - at));
    next
}

/// Offsets of appended data from the flag bits.
fn flags(body: &[u8], len: usize) -> Result<Vec<usize>, ReadError> {
    let incompatible = &body[8..16];
    if incompatible[0] & !1 != 0 || incompatible[1..].iter().any(|b| *b != 0) {
        return Err(ReadError::new(format!(
            "this ULog uses additions that version 1 does not know (incompatible flags {incompatible:02x?})"
        )));
    }
    let offset = |i: usize| array_at(body, 16 + 8 * i).map(u64::from_le_bytes);
    Ok((0..3)
        .filter_map(offset)
        .filter_map(|o| usize::try_from(o).ok())
        .filter(|o| (FILE_HEADER + 1..len).contains(o))
        .collect())
}

fn subscribe(body: &[u8], formats: &Formats, known: &mut [bool], visit: &mut impl FnMut(Event<'_>)) {
    let (multi, id) = (body[0], u16::from_le_bytes([body[1], body[2]]));
    known[usize::from(id)] = true;
    if let Ok(topic) = std::str::from_utf8(&body[3..])
        && super::messages::is_wanted(topic)
        && let Some(layout) = formats.layout(topic)
    {
        visit(Event::Subscribed(id, topic, multi, &layout));
    }
}

/// `key_length, "type name", value`.
fn parameter(body: &[u8]) -> Option<(&str, f64)> {
    let length = usize::from(*body.first()?);
    let (kind, name) = std::str::from_utf8(body.get(1..1 + length)?).ok()?.split_once(' ')?;
    let field = Field { kind: Kind::of(kind)?, offset: 1 + length };
    Some((name, field.number(body)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_types_and_arrays_have_their_places() {
        let mut formats = Formats::default();
        formats.add("inner:float x;uint8_t[3] pad;").unwrap();
        formats.add("outer:uint64_t timestamp;inner[2] part;inner one;float[4] q;").unwrap();
        let layout = formats.layout("outer").unwrap();
        let places = ["timestamp", "part[0].x", "part[1].x", "part[1].pad", "one.x", "q"]
            .map(|n| layout.field(n).unwrap().offset);
        assert_eq!(places, [0, 8, 15, 19, 22, 29]);
        assert_eq!(layout.array::<4>("q").unwrap()[3].offset, 41);
        assert!(layout.array::<5>("q").is_none() && layout.field("nothing").is_none());
        assert!(formats.add("no colon").is_none() && formats.add("a:float[x] y").is_none());
    }

    #[test]
    fn formats_that_grow_without_end_are_refused() {
        let mut formats = Formats::default();
        formats.add("loop:loop inner").unwrap();
        formats.add("big:float[99999999999] x").unwrap();
        formats.add("nothing:").unwrap();
        formats.add("wide0:nothing[99999999999] x").unwrap();
        for i in 1..8 {
            formats.add(&format!("wide{i}:wide{}[1000] x", i - 1)).unwrap();
        }
        for topic in ["loop", "big", "wide0", "wide7"] {
            assert!(formats.layout(topic).is_none(), "{topic}");
        }
    }
}
