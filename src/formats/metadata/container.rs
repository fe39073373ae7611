//! The blocks of a photo file that hold metadata: EXIF, XMP and the size, out of JPEG, PNG or TIFF.
//!
//! Pixels are not read: a JPEG ends for us at its first scan, PNG data chunks and TIFF strips are skipped. What is read
//! is bounded: a JPEG segment by its own 64 KiB, a PNG chunk and an XMP tag of a TIFF by [`LARGEST_BLOCK`], the number
//! of segments, chunks and tags by fixed counts.

use super::tiff;
use crate::formats::flight::ReadError;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};

/// The largest XMP packet or PNG metadata chunk that is read, bytes.
pub(super) const LARGEST_BLOCK: u64 = 1 << 20;
/// Segments of a JPEG before its first scan, thermal images included.
const MOST_SEGMENTS: usize = 4096;
/// Chunks of a PNG.
const MOST_CHUNKS: usize = 1 << 16;

/// What a file holds.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Blocks {
    /// A TIFF structure with the EXIF tags.
    pub exif: Option<Vec<u8>>,
    /// The XMP packet.
    pub xmp: Option<Vec<u8>>,
    /// Columns and rows as stored.
    pub size: Option<(u32, u32)>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// Reads the metadata blocks of a photo.
pub(super) fn blocks<S: Read + Seek>(source: &mut S) -> Result<Blocks, ReadError> {
    let mut source = BufReader::with_capacity(1 << 14, source);
    let mut magic = [0; 8];
    let cut = |e: io::Error| broken(&e, "the file ends before its first 8 bytes");
    source.seek(SeekFrom::Start(0)).and_then(|_| source.read_exact(&mut magic)).map_err(cut)?;
    match magic {
        [0xFF, 0xD8, ..] => {
            source.seek_relative(-6).map_err(|e| broken(&e, ""))?;
            jpeg(&mut source)
        }
        [0x89, b'P', b'N', b'G', 0x0D, 0x0A, 0x1A, 0x0A] => png(&mut source),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => tiff::blocks(&mut source, magic),
        [b'I', b'I', 43, 0, ..] | [b'M', b'M', 0, 43, ..] => {
            Err(ReadError::new("the photo is a BigTIFF, whose metadata is not read"))
        }
        _ => Err(ReadError::new("the file is neither JPEG nor PNG nor TIFF")
            .help("raw formats must be developed to one of these first")),
    }
}

/// The error of a read: that the file ends is the file's fault, anything else is said in the system's words.
pub(super) fn broken(error: &io::Error, end: &str) -> ReadError {
    if error.kind() == ErrorKind::UnexpectedEof && !end.is_empty() {
        ReadError::new(end)
    } else {
        ReadError::new(format!("the file cannot be read ({error})"))
    }
}

const EXIF: &[u8] = b"Exif\0\0";
const XMP: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
const XMP_EXTENSION: &[u8] = b"http://ns.adobe.com/xmp/extension/\0";

/// From the first segment on.
fn jpeg<S: Read + Seek>(source: &mut BufReader<S>) -> Result<Blocks, ReadError> {
    let cut = |e: io::Error| broken(&e, "the JPEG file ends inside its header");
    let mut found = Blocks::default();
    for _ in 0..MOST_SEGMENTS {
        let marker = marker(source)?;
        match marker {
            // The first scan, or the end: no header follows.
            0xDA | 0xD9 => return Ok(found),
            0x01 | 0xD0..=0xD8 => continue,
            _ => {}
        }
        let mut length = [0; 2];
        source.read_exact(&mut length).map_err(cut)?;
        let Some(length) = u16::from_be_bytes(length).checked_sub(2) else {
            return Err(ReadError::new(format!(
                "the JPEG segment {marker:#04X} claims less than its own length"
            )));
        };
        match marker {
            0xE1 => app1(&mut found, payload(source, u64::from(length)).map_err(cut)?),
            // Frame headers, all but the tables that share their range.
            0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => {
                let header = payload(source, u64::from(length)).map_err(cut)?;
                if let [_, h1, h0, w1, w0, ..] = header[..] {
                    let (w, h) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
                    found.size = Some((u32::from(w), u32::from(h)));
                }
            }
            _ => source.seek_relative(i64::from(length)).map_err(cut)?,
        }
    }
    Err(ReadError::new(format!("the JPEG file has more than {MOST_SEGMENTS} segments before its first scan")))
}

/// The next marker; fill bytes before it are skipped.
fn marker<S: Read + Seek>(source: &mut BufReader<S>) -> Result<u8, ReadError> {
    let cut = |e: io::Error| broken(&e, "the JPEG file ends inside its header");
    let mut byte = [0];
    source.read_exact(&mut byte).map_err(cut)?;
    if byte != [0xFF] {
        return Err(ReadError::new(format!("byte {:#04X} stands where a JPEG marker should", byte[0])));
    }
    for _ in 0..1 << 16 {
        source.read_exact(&mut byte).map_err(cut)?;
        if byte != [0xFF] {
            return Ok(byte[0]);
        }
    }
    Err(ReadError::new("the JPEG file has more than 65536 fill bytes between two segments"))
}

/// So many bytes; what the file does not hold is not allocated.
pub(super) fn payload<S: Read>(source: &mut S, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(ErrorKind::UnexpectedEof.into()) }
}

fn app1(found: &mut Blocks, mut bytes: Vec<u8>) {
    if bytes.starts_with(EXIF) {
        if found.exif.is_none() {
            bytes.drain(..EXIF.len());
            found.exif = Some(bytes);
        } else {
            note(found, "the file holds a second EXIF block, which is not read");
        }
    } else if bytes.starts_with(XMP) {
        if found.xmp.is_none() {
            bytes.drain(..XMP.len());
            found.xmp = Some(bytes);
        } else {
            note(found, "the file holds a second XMP packet, which is not read");
        }
    } else if bytes.starts_with(XMP_EXTENSION) {
        note(found, "the file holds extended XMP, which is not read: cameras write none");
    }
}

fn note(found: &mut Blocks, text: &str) {
    if !found.notes.iter().any(|n| n == text) {
        found.notes.push(text.to_owned());
    }
}

/// From the first chunk on.
fn png<S: Read + Seek>(source: &mut BufReader<S>) -> Result<Blocks, ReadError> {
    const XMP_KEYWORD: &[u8] = b"XML:com.adobe.xmp\0";
    let cut = |e: io::Error| broken(&e, "the PNG file ends inside a chunk");
    let mut found = Blocks::default();
    for _ in 0..MOST_CHUNKS {
        let mut head = [0; 8];
        source.read_exact(&mut head).map_err(cut)?;
        let [l3, l2, l1, l0, kind @ ..] = head;
        let length = u64::from(u32::from_be_bytes([l3, l2, l1, l0]));
        let wanted = matches!(&kind, b"IHDR" | b"eXIf" | b"iTXt") && length <= LARGEST_BLOCK;
        if &kind == b"IEND" {
            return Ok(found);
        }
        if !wanted {
            // The chunk and its checksum.
            source.seek_relative(i64::from(u32::from_be_bytes([l3, l2, l1, l0])) + 4).map_err(cut)?;
            continue;
        }
        let bytes = payload(source, length).map_err(cut)?;
        source.seek_relative(4).map_err(cut)?;
        match &kind {
            b"IHDR" => {
                if let [w3, w2, w1, w0, h3, h2, h1, h0, ..] = bytes[..] {
                    let size = [[w3, w2, w1, w0], [h3, h2, h1, h0]].map(u32::from_be_bytes);
                    found.size = Some((size[0], size[1]));
                }
            }
            b"eXIf" => {
                // Some writers keep the JPEG's prefix.
                let bare = bytes.strip_prefix(EXIF).map(<[u8]>::to_vec);
                found.exif = found.exif.or(Some(bare.unwrap_or(bytes)));
            }
            _ => {
                // Keyword, compression flag and method, language, translated keyword, text.
                if let Some([flag, _, rest @ ..]) = bytes.strip_prefix(XMP_KEYWORD) {
                    if *flag != 0 {
                        note(
                            &mut found,
                            "the file's XMP is compressed, which the standard forbids: it is not read",
                        );
                    } else if let Some(text) = rest.splitn(3, |b| *b == 0).nth(2) {
                        found.xmp = Some(text.to_owned());
                    }
                }
            }
        }
    }
    Err(ReadError::new(format!("the PNG file has more than {MOST_CHUNKS} chunks")))
}
