//! Tiny photo files for the tests, byte by byte.

use crate::formats::metadata::{PhotoMetadata, Severity, read};
use std::io::Cursor;

/// A TIFF structure of three directories, big-endian ("MM") or little-endian ("II").
#[derive(Clone, Default)]
pub struct Exif {
    pub little: bool,
    main: Vec<(u16, u16, u32, Vec<u8>)>,
    exif: Vec<(u16, u16, u32, Vec<u8>)>,
    gps: Vec<(u16, u16, u32, Vec<u8>)>,
}

impl Exif {
    pub fn little() -> Self {
        Self { little: true, ..Self::default() }
    }

    fn b16(&self, v: u16) -> Vec<u8> {
        if self.little { v.to_le_bytes().to_vec() } else { v.to_be_bytes().to_vec() }
    }

    fn b32(&self, v: u32) -> Vec<u8> {
        if self.little { v.to_le_bytes().to_vec() } else { v.to_be_bytes().to_vec() }
    }

    /// Adds a tag to the directory it belongs to: GPS tags are below 32, EXIF tags above 33000 but for the texts.
    fn put(mut self, tag: u16, kind: u16, count: usize, value: Vec<u8>) -> Self {
        let entry = (tag, kind, u32::try_from(count).unwrap(), value);
        match tag {
            0..=0x1F => self.gps.push(entry),
            0x829A..=0xA435 => self.exif.push(entry),
            _ => self.main.push(entry),
        }
        self
    }

    pub fn text(self, tag: u16, text: &str) -> Self {
        let bytes = [text.as_bytes(), &[0]].concat();
        self.put(tag, 2, bytes.len(), bytes)
    }

    pub fn byte(self, tag: u16, value: u8) -> Self {
        self.put(tag, 1, 1, vec![value])
    }

    pub fn short(self, tag: u16, value: u16) -> Self {
        let bytes = self.b16(value);
        self.put(tag, 3, 1, bytes)
    }

    pub fn long(self, tag: u16, value: u32) -> Self {
        let bytes = self.b32(value);
        self.put(tag, 4, 1, bytes)
    }

    pub fn raw(self, tag: u16, kind: u16, value: Vec<u8>) -> Self {
        self.put(tag, kind, value.len(), value)
    }

    pub fn rationals(self, tag: u16, values: &[(u32, u32)]) -> Self {
        let bytes = values.iter().flat_map(|(n, d)| [self.b32(*n), self.b32(*d)].concat()).collect();
        self.put(tag, 5, values.len(), bytes)
    }

    /// 41°01'05.25"N 83°18'30.5"W, 300.25 m, reference 0.
    pub fn with_gps(self) -> Self {
        self.text(1, "N")
            .rationals(2, &[(41, 1), (1, 1), (525, 100)])
            .text(3, "W")
            .rationals(4, &[(83, 1), (18, 1), (305, 10)])
            .byte(5, 0)
            .rationals(6, &[(30_025, 100)])
    }

    pub fn bytes(&self) -> Vec<u8> {
        let length = |d: &[(u16, u16, u32, Vec<u8>)]| {
            6 + 12 * d.len() + d.iter().map(|e| e.3.len()).filter(|n| *n > 4).sum::<usize>()
        };
        let pointers = 24;
        let exif_at = 8 + length(&self.main) + pointers;
        let gps_at = exif_at + length(&self.exif);
        let u = |n: usize| u32::try_from(n).unwrap();
        let mut main = self.main.clone();
        main.push((0x8769, 4, 1, self.b32(u(exif_at))));
        main.push((0x8825, 4, 1, self.b32(u(gps_at))));
        let mut out = if self.little { b"II".to_vec() } else { b"MM".to_vec() };
        out.extend(self.b16(42));
        out.extend(self.b32(8));
        for directory in [&main, &self.exif, &self.gps] {
            let mut values: Vec<u8> = Vec::new();
            let values_at = out.len() + 6 + 12 * directory.len();
            out.extend(self.b16(u16::try_from(directory.len()).unwrap()));
            for (tag, kind, count, value) in directory {
                out.extend([self.b16(*tag), self.b16(*kind), self.b32(*count)].concat());
                if value.len() > 4 {
                    out.extend(self.b32(u(values_at + values.len())));
                    values.extend(value);
                } else {
                    let mut inline = value.clone();
                    inline.resize(4, 0);
                    out.extend(inline);
                }
            }
            out.extend([0; 4]);
            out.extend(values);
        }
        out
    }
}

/// An XMP packet with one description.
pub fn packet(description: &str) -> String {
    format!(
        "<?xpacket begin=\"\u{feff}\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?>\n<x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\
         <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">{description}</rdf:RDF></x:xmpmeta>\n\
         <?xpacket end=\"w\"?>"
    )
}

/// Properties as attributes of one description.
pub fn attributes(uri: &str, properties: &[(&str, &str)]) -> String {
    let list: String = properties.iter().map(|(name, value)| format!(" q:{name}=\"{value}\"")).collect();
    packet(&format!("<rdf:Description rdf:about=\"\" xmlns:q=\"{uri}\"{list}/>"))
}

/// Properties as elements of one description.
pub fn elements(uri: &str, properties: &[(&str, &str)]) -> String {
    let list: String =
        properties.iter().map(|(name, value)| format!("<z:{name}>{value}</z:{name}>\n")).collect();
    packet(&format!("<rdf:Description rdf:about='' xmlns:z='{uri}'>{list}</rdf:Description>"))
}

fn segment(marker: u8, content: &[u8]) -> Vec<u8> {
    let length = u16::try_from(content.len() + 2).unwrap();
    [&[0xFF, marker], &length.to_be_bytes()[..], content].concat()
}

/// A JPEG's header of that size, up to its first scan.
pub fn jpeg(exif: Option<&Exif>, xmp: Option<&str>, (width, height): (u16, u16)) -> Vec<u8> {
    let mut out = vec![0xFF, 0xD8];
    if let Some(exif) = exif {
        out.extend(segment(0xE1, &[b"Exif\0\0", &exif.bytes()[..]].concat()));
    }
    if let Some(xmp) = xmp {
        out.extend(segment(0xE1, &[b"http://ns.adobe.com/xap/1.0/\0", xmp.as_bytes()].concat()));
    }
    let frame = [&[8][..], &height.to_be_bytes(), &width.to_be_bytes(), &[1, 1, 0x11, 0]].concat();
    out.extend(segment(0xC0, &frame));
    out.extend(segment(0xDA, &[1, 1, 0, 0, 63, 0]));
    out.extend([0x12, 0x34, 0xFF, 0xD9]);
    out
}

/// The metadata of a file's bytes.
pub fn parse(bytes: &[u8]) -> PhotoMetadata {
    read(&mut Cursor::new(bytes)).unwrap_or_else(|e| panic!("{}", e.cause))
}

/// True when a finding of at least that severity holds the text.
pub fn finds(photo: &PhotoMetadata, severity: Severity, text: &str) -> bool {
    photo.findings.iter().any(|f| f.severity >= severity && f.text.contains(text))
}

/// What `explain` says the quantity came from, and what it means.
pub fn origin(photo: &PhotoMetadata, quantity: &str) -> (String, String) {
    let found = photo.exposure.origins.iter().find(|o| o.quantity == quantity);
    let found = found.unwrap_or_else(|| panic!("no origin of {quantity} in {:?}", photo.exposure.origins));
    (found.from.clone(), found.meaning.clone())
}
