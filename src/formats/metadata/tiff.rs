//! A TIFF photo's own tags, repacked as a small TIFF of the tags that matter.
//!
//! In a TIFF photo the directories may lie anywhere among the pixels. They are followed here with bounded reads; what
//! they hold is written anew in the same byte order for the EXIF reader, without pixels, maker notes, thumbnails and
//! profiles.

use super::container::{Blocks, LARGEST_BLOCK, broken, payload};
use crate::formats::flight::ReadError;
use std::io::{self, Read, Seek, SeekFrom};

/// Tags of one directory.
const MOST_TAGS: u16 = 2048;
/// No tag that is read here needs more bytes than this, XMP aside.
const LARGEST_VALUE: u64 = 4096;
/// Values of one directory together, XMP aside: entries may share bytes, so the file's size bounds nothing.
const LARGEST_DIRECTORY: u64 = 1 << 20;

const EXIF_DIRECTORY: u16 = 0x8769;
const GPS_DIRECTORY: u16 = 0x8825;
const XMP: u16 = 700;
const MAKER_NOTE: u16 = 0x927C;
const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;

#[derive(Clone, Copy)]
enum Order {
    Little,
    Big,
}

impl Order {
    fn u16(self, b: [u8; 2]) -> u16 {
        match self {
            Self::Little => u16::from_le_bytes(b),
            Self::Big => u16::from_be_bytes(b),
        }
    }
    fn u32(self, b: [u8; 4]) -> u32 {
        match self {
            Self::Little => u32::from_le_bytes(b),
            Self::Big => u32::from_be_bytes(b),
        }
    }
    fn bytes16(self, v: u16) -> [u8; 2] {
        match self {
            Self::Little => v.to_le_bytes(),
            Self::Big => v.to_be_bytes(),
        }
    }
    fn bytes32(self, v: u32) -> [u8; 4] {
        match self {
            Self::Little => v.to_le_bytes(),
            Self::Big => v.to_be_bytes(),
        }
    }
}

/// A tag with its value's bytes, in the file's byte order.
struct Entry {
    tag: u16,
    kind: u16,
    count: u32,
    value: Vec<u8>,
}

/// The metadata of a TIFF whose first eight bytes were read already.
pub(super) fn blocks<S: Read + Seek>(source: &mut S, magic: [u8; 8]) -> Result<Blocks, ReadError> {
    let order = if magic[0] == b'I' { Order::Little } else { Order::Big };
    let [.., o3, o2, o1, o0] = magic;
    let mut found = Blocks::default();
    let main = directory(source, order, order.u32([o3, o2, o1, o0]), &mut found)?;
    let mut below = |tag| match main.iter().find(|e| e.tag == tag).and_then(|e| number(order, e)) {
        // A broken directory below takes only itself along.
        Some(offset) => directory(source, order, offset, &mut found).unwrap_or_else(|e| {
            found.notes.push(format!("the directory of tag {tag} is broken: {}", e.cause));
            Vec::new()
        }),
        None => Vec::new(),
    };
    let (exif, gps) = (below(EXIF_DIRECTORY), below(GPS_DIRECTORY));
    let size = |tag| main.iter().find(|e| e.tag == tag).and_then(|e| number(order, e));
    found.size = size(WIDTH).zip(size(HEIGHT));
    found.exif = Some(packed(order, main, exif, gps));
    Ok(found)
}

/// The first value of an entry of shorts or longs.
fn number(order: Order, entry: &Entry) -> Option<u32> {
    match (entry.kind, &entry.value[..]) {
        (3, [a, b, ..]) => Some(u32::from(order.u16([*a, *b]))),
        (4, [a, b, c, d, ..]) => Some(order.u32([*a, *b, *c, *d])),
        _ => None,
    }
}

/// Bytes of one value of a TIFF type.
const fn unit(kind: u16) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 => 8,
        _ => 0,
    }
}

/// The entries of a directory that are small enough to matter; XMP goes to `found`.
fn directory<S: Read + Seek>(
    source: &mut S,
    order: Order,
    offset: u32,
    found: &mut Blocks,
) -> Result<Vec<Entry>, ReadError> {
    let cut = |e: io::Error| broken(&e, "the TIFF file ends inside a directory");
    source.seek(SeekFrom::Start(u64::from(offset))).map_err(cut)?;
    let mut count = [0; 2];
    source.read_exact(&mut count).map_err(cut)?;
    let count = order.u16(count);
    if count > MOST_TAGS {
        return Err(ReadError::new(format!("a TIFF directory claims {count} tags")));
    }
    let table = payload(source, 12 * u64::from(count)).map_err(cut)?;
    let mut entries = Vec::new();
    let mut spent = 0;
    for raw in table.chunks_exact(12) {
        let [t1, t0, k1, k0, c3, c2, c1, c0, v3, v2, v1, v0] = *raw else { continue };
        let inline = [v3, v2, v1, v0];
        let (tag, kind) = (order.u16([t1, t0]), order.u16([k1, k0]));
        let count = order.u32([c3, c2, c1, c0]);
        let length = unit(kind) * u64::from(count);
        let limit = if tag == XMP { LARGEST_BLOCK } else { LARGEST_VALUE };
        if length == 0 || length > limit || tag == MAKER_NOTE || (tag == XMP && found.xmp.is_some()) {
            continue;
        }
        if tag != XMP {
            spent += length;
        }
        if spent > LARGEST_DIRECTORY {
            return Err(ReadError::new(format!(
                "a TIFF directory holds more than {LARGEST_DIRECTORY} bytes of values"
            )));
        }
        let value = if length <= 4 {
            inline.into_iter().take(usize::try_from(length).unwrap_or(4)).collect()
        } else {
            let at = SeekFrom::Start(u64::from(order.u32(inline)));
            match source.seek(at).and_then(|_| payload(source, length)) {
                Ok(value) => value,
                Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
                    found.notes.push(format!("the value of tag {tag} lies beyond the end of the file"));
                    continue;
                }
                Err(e) => return Err(broken(&e, "")),
            }
        };
        if tag == XMP {
            found.xmp = Some(value);
        } else {
            entries.push(Entry { tag, kind, count, value });
        }
    }
    Ok(entries)
}

/// A TIFF of three directories.
fn packed(order: Order, mut main: Vec<Entry>, exif: Vec<Entry>, gps: Vec<Entry>) -> Vec<u8> {
    main.retain(|e| e.tag != EXIF_DIRECTORY && e.tag != GPS_DIRECTORY);
    let pointer = |tag| Entry { tag, kind: 4, count: 1, value: vec![0; 4] };
    let size = |entries: &[Entry]| {
        let values: usize = entries.iter().map(|e| e.value.len()).filter(|n| *n > 4).sum();
        6 + 12 * entries.len() + values
    };
    main.extend([pointer(EXIF_DIRECTORY), pointer(GPS_DIRECTORY)]);
    let exif_at = 8 + size(&main);
    let gps_at = exif_at + size(&exif);
    let as_u32 = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    for (tag, at) in [(EXIF_DIRECTORY, exif_at), (GPS_DIRECTORY, gps_at)] {
        for entry in main.iter_mut().filter(|e| e.tag == tag) {
            entry.value = order.bytes32(as_u32(at)).to_vec();
        }
    }
    let mut out = match order {
        Order::Little => b"II".to_vec(),
        Order::Big => b"MM".to_vec(),
    };
    out.extend(order.bytes16(42));
    out.extend(order.bytes32(8));
    for entries in [main, exif, gps] {
        let mut values = Vec::new();
        let values_at = out.len() + 6 + 12 * entries.len();
        out.extend(order.bytes16(u16::try_from(entries.len()).unwrap_or(u16::MAX)));
        for entry in entries {
            out.extend(order.bytes16(entry.tag));
            out.extend(order.bytes16(entry.kind));
            out.extend(order.bytes32(entry.count));
            if entry.value.len() > 4 {
                out.extend(order.bytes32(as_u32(values_at + values.len())));
                values.extend(entry.value);
            } else {
                let mut inline = entry.value;
                inline.resize(4, 0);
                out.extend(inline);
            }
        }
        out.extend([0; 4]);
        out.extend(values);
    }
    out
}
