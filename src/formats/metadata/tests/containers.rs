//! The same tags in JPEG, TIFF and PNG.

use super::build::{Exif, attributes, finds, jpeg, parse};
use crate::formats::metadata::{Severity, read};
use std::io::{Cursor, Read, Seek, SeekFrom};

fn tagged() -> Exif {
    Exif::default()
        .text(0x10F, "Maker of cameras")
        .text(0x110, "M")
        .with_gps()
        .text(0x9003, "2013:06:04 13:37:35")
}

fn pitch() -> String {
    attributes("http://pix4d.com/camera/1.0/", &[("Yaw", "1"), ("Pitch", "2"), ("Roll", "3")])
}

fn chunk(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let length = u32::try_from(content.len()).unwrap();
    [&length.to_be_bytes()[..], kind, content, &[0; 4]].concat()
}

fn png(exif: &Exif, xmp: &str) -> Vec<u8> {
    let header = [&640u32.to_be_bytes()[..], &480u32.to_be_bytes(), &[8, 2, 0, 0, 0]].concat();
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(b"IHDR", &header),
        chunk(b"IDAT", &[0; 5000]),
        chunk(b"eXIf", &exif.bytes()),
        chunk(b"iTXt", &[b"XML:com.adobe.xmp\0\0\0\0\0", xmp.as_bytes()].concat()),
        chunk(b"IEND", &[]),
    ]
    .concat()
}

/// A TIFF with a pixel strip and a maker note that nobody may read.
fn tiff(exif: Exif, xmp: &str) -> Vec<u8> {
    exif.long(256, 640)
        .long(257, 480)
        .raw(700, 1, xmp.as_bytes().to_vec())
        .raw(0x927C, 7, vec![7; 3000])
        .bytes()
}

#[test]
fn every_container_gives_the_same() {
    let jpeg = parse(&jpeg(Some(&tagged()), Some(&pitch()), (640, 480)));
    assert!(jpeg.exposure.position.is_some() && jpeg.exposure.attitude.is_some());
    for little in [false, true] {
        let exif = || {
            let base = if little { Exif::little() } else { Exif::default() };
            base.text(0x10F, "Maker of cameras")
                .text(0x110, "M")
                .with_gps()
                .text(0x9003, "2013:06:04 13:37:35")
        };
        assert_eq!(parse(&tiff(exif(), &pitch())), jpeg);
        assert_eq!(parse(&png(&exif(), &pitch())), jpeg);
    }
}

/// Counts the bytes that are read.
struct Counted<'a>(Cursor<&'a [u8]>, usize);

impl Read for Counted<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.0.read(buffer)?;
        self.1 += n;
        Ok(n)
    }
}

impl Seek for Counted<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

#[test]
fn pixels_are_not_read() {
    let header = jpeg(Some(&tagged()), Some(&pitch()), (640, 480));
    let bytes = [header, vec![0x55; 5_000_000]].concat();
    let mut counted = Counted(Cursor::new(&bytes), 0);
    read(&mut counted).unwrap();
    assert!(counted.1 <= 1 << 15, "{} bytes read", counted.1);
}

#[test]
fn second_blocks_and_extended_xmp_are_noted() {
    let one = jpeg(Some(&tagged()), Some(&pitch()), (640, 480));
    let extension = b"http://ns.adobe.com/xmp/extension/\0GUID";
    let length = u16::try_from(extension.len() + 2).unwrap().to_be_bytes();
    let extended = [&one[..2], &[0xFF, 0xE1], &length, extension, &one[2..]].concat();
    assert!(finds(&parse(&extended), Severity::Note, "extended XMP"));
    let end = one.len() - 14 - 13;
    let twice = [&one[..end], &one[2..]].concat();
    if let Ok(photo) = read(&mut Cursor::new(&twice)) {
        assert!(finds(&photo, Severity::Note, "second EXIF"), "{:?}", photo.findings);
    }
}

#[test]
fn other_files_are_refused_with_their_reason() {
    let cause = |bytes: &[u8]| read(&mut Cursor::new(bytes)).unwrap_err().cause;
    assert!(cause(b"").contains("first 8 bytes"));
    assert!(cause(b"GIF89a..........").contains("neither JPEG nor PNG nor TIFF"));
    assert!(cause(b"II\x2b\0\x08\0\0\0\0\0\0\0").contains("BigTIFF"));
    assert!(cause(b"\xFF\xD8\xFF\xE0\x00\x01....").contains("less than its own length"));
    assert!(cause(b"\xFF\xD8\xFF\xE0\x40\x00....").contains("ends inside its header"));
    assert!(cause(b"II\x2a\0\xFF\xFF\xFF\x7F\0\0\0\0").contains("ends inside a directory"));
}
