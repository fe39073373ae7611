//! XMP: an RDF/XML packet to properties, namespaces resolved by their URI.
//!
//! Values may stand in attributes or elements, in one `rdf:Description` or several, in `rdf:Seq`, `rdf:Bag`, `rdf:Alt`,
//! or one level down in a structure. A document type is refused, so no entity exists beyond XML's five and the
//! character references; depth and number of events are bounded.

use quick_xml::NsReader;
use quick_xml::events::{BytesRef, BytesStart, Event};
use quick_xml::name::ResolveResult;

/// Elements may be nested this deep; real packets need about 10.
const DEEPEST: usize = 64;
/// Events of one packet.
const MOST_EVENTS: usize = 100_000;
/// Properties kept of one packet.
const MOST_PROPERTIES: usize = 10_000;

/// The namespaces that hold something for us.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Namespace {
    /// `http://www.dji.com/drone-dji/1.0/`; Autel's newer firmware writes it too, under another prefix.
    Dji,
    /// `http://ns.sensefly.com/sensefly/1.0/`: the autopilot's record.
    SenseflyFlight,
    /// `http://ns.sensefly.com/Camera/1.0/`: as Pix4D's.
    SenseflyCamera,
    /// `http://pix4d.com/camera/1.0/`, with or without the last slash.
    Pix4d,
    /// `http://micasense.com/MicaSense/1.0/`.
    MicaSense,
    /// `http://micasense.com/DLS/1.0/`: the irradiance sensor.
    Dls,
    /// `http://www.parrot.com/drone-parrot/1.0/`.
    Parrot,
    /// `https://www.skydio.com/drone-skydio/1.0/`.
    Skydio,
    /// `http://ns.adobe.com/tiff/1.0/`.
    Tiff,
    /// `http://ns.adobe.com/xap/1.0/`.
    Xmp,
    /// `http://ns.adobe.com/exif/1.0/aux/`.
    Aux,
}

impl Namespace {
    const ALL: [(Self, &str, &str); 11] = [
        (Self::Dji, "www.dji.com/drone-dji/1.0", "drone-dji"),
        (Self::SenseflyFlight, "ns.sensefly.com/sensefly/1.0", "sensefly"),
        (Self::SenseflyCamera, "ns.sensefly.com/camera/1.0", "Camera"),
        (Self::Pix4d, "pix4d.com/camera/1.0", "Camera"),
        (Self::MicaSense, "micasense.com/micasense/1.0", "MicaSense"),
        (Self::Dls, "micasense.com/dls/1.0", "DLS"),
        (Self::Parrot, "www.parrot.com/drone-parrot/1.0", "drone-parrot"),
        (Self::Skydio, "www.skydio.com/drone-skydio/1.0", "drone-skydio"),
        (Self::Tiff, "ns.adobe.com/tiff/1.0", "tiff"),
        (Self::Xmp, "ns.adobe.com/xap/1.0", "xmp"),
        (Self::Aux, "ns.adobe.com/exif/1.0/aux", "aux"),
    ];

    /// The namespace of a URI; `http` or `https`, letters of any case, and a missing last slash are the same to us,
    /// because makers vary them.
    fn of(uri: &str) -> Option<Self> {
        let rest = uri.strip_prefix("http://").or_else(|| uri.strip_prefix("https://"))?;
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        Self::ALL
            .iter()
            .find(|(_, name, _)| name.eq_ignore_ascii_case(rest))
            .map(|(namespace, ..)| *namespace)
    }

    /// The prefix that is usually bound to it.
    pub(super) fn prefix(self) -> &'static str {
        Self::ALL.iter().find(|(namespace, ..)| *namespace == self).map_or("", |(_, _, prefix)| prefix)
    }
}

const RDF: &str = "http://www.w3.org/1999/02/22-rdf-syntax-ns#";
const META: &str = "adobe:ns:meta/";

/// What an element or attribute name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Known(Namespace),
    Item,
    /// `rdf:Description`, `rdf:Seq`, `x:xmpmeta` and the like: their content counts as their parent's.
    Wrapper,
    Other,
}

fn kind_of(namespace: &ResolveResult, local: &str) -> Kind {
    match namespace {
        ResolveResult::Bound(uri) if uri.0 == RDF && local == "li" => Kind::Item,
        ResolveResult::Bound(uri) if uri.0 == RDF || uri.0 == META => Kind::Wrapper,
        ResolveResult::Bound(uri) => Namespace::of(uri.0).map_or(Kind::Other, Kind::Known),
        ResolveResult::Unbound | ResolveResult::Unknown(_) => Kind::Other,
    }
}

/// One property.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Property {
    namespace: Namespace,
    name: String,
    /// The structure it is a member of.
    parent: Option<usize>,
    text: String,
    items: Vec<String>,
}

/// A packet's properties of the namespaces known here, in the packet's order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Xmp {
    properties: Vec<Property>,
}

impl Xmp {
    /// True when the packet holds a property of the namespace.
    pub(super) fn has(&self, namespace: Namespace) -> bool {
        self.properties.iter().any(|p| p.namespace == namespace)
    }

    /// The text of a property; the first item of a list; `None` when absent or empty.
    pub(super) fn text(&self, namespace: Namespace, name: &str) -> Option<&str> {
        self.items(namespace, name).first().map(String::as_str)
    }

    /// The items of a list, or the one value of a plain property.
    pub(super) fn items(&self, namespace: Namespace, name: &str) -> &[String] {
        self.find(namespace, name, None).map_or(&[], |(_, property)| property.values())
    }

    /// A member of a structure.
    pub(super) fn member(&self, namespace: Namespace, structure: &str, name: &str) -> Option<&str> {
        let (parent, _) = self
            .properties
            .iter()
            .enumerate()
            .find(|(_, p)| p.namespace == namespace && p.name == structure && p.parent.is_none())?;
        let (_, property) = self.find(namespace, name, Some(parent))?;
        property.values().first().map(String::as_str)
    }

    fn find(&self, namespace: Namespace, name: &str, parent: Option<usize>) -> Option<(usize, &Property)> {
        self.properties.iter().enumerate().find(|(_, p)| {
            p.namespace == namespace && p.name == name && p.parent == parent && !p.values().is_empty()
        })
    }
}

impl Property {
    fn values(&self) -> &[String] {
        if !self.items.is_empty() {
            &self.items
        } else if self.text.is_empty() {
            &[]
        } else {
            std::slice::from_ref(&self.text)
        }
    }
}

/// Where text and members go while the packet is read.
#[derive(Debug, Clone, Copy)]
enum Frame {
    Wrapper,
    Property(usize),
    Item(usize),
    Skipped,
}

#[derive(Default)]
struct Builder {
    xmp: Xmp,
    stack: Vec<Frame>,
}

impl Builder {
    /// The property that the current element lies in.
    fn parent(&self) -> Option<usize> {
        self.stack.iter().rev().find_map(|frame| match frame {
            Frame::Property(index) | Frame::Item(index) => Some(*index),
            Frame::Wrapper | Frame::Skipped => None,
        })
    }

    fn add(
        &mut self,
        namespace: Namespace,
        name: &str,
        parent: Option<usize>,
        text: String,
    ) -> Result<usize, String> {
        if self.xmp.properties.len() == MOST_PROPERTIES {
            return Err(format!("it holds more than {MOST_PROPERTIES} properties"));
        }
        self.xmp.properties.push(Property {
            namespace,
            name: name.to_owned(),
            parent,
            text,
            items: Vec::new(),
        });
        Ok(self.xmp.properties.len() - 1)
    }

    fn open(&mut self, reader: &NsReader<&[u8]>, element: &BytesStart) -> Result<Frame, String> {
        if self.stack.len() >= DEEPEST {
            return Err(format!("its elements are nested deeper than {DEEPEST}"));
        }
        // Members of structures that we do not know must not pass for the photo's own properties.
        if matches!(self.stack.last(), Some(Frame::Skipped)) {
            return Ok(Frame::Skipped);
        }
        let (namespace, local) = reader.resolver().resolve_element(element.name());
        let parent = self.parent();
        let frame = match kind_of(&namespace, local.into_inner()) {
            Kind::Known(namespace) => {
                Frame::Property(self.add(namespace, local.into_inner(), parent, String::new())?)
            }
            Kind::Item => match parent {
                Some(index) => {
                    self.xmp.properties[index].items.push(String::new());
                    Frame::Item(index)
                }
                None => Frame::Wrapper,
            },
            Kind::Wrapper => Frame::Wrapper,
            Kind::Other => Frame::Skipped,
        };
        let owner = match frame {
            Frame::Property(index) => Some(index),
            Frame::Wrapper | Frame::Item(_) => parent,
            Frame::Skipped => return Ok(frame),
        };
        for attribute in element.attributes().with_checks(false) {
            let attribute = attribute.map_err(|e| format!("an attribute is broken ({e})"))?;
            let (namespace, local) = reader.resolver().resolve_attribute(attribute.key);
            if let Kind::Known(namespace) = kind_of(&namespace, local.into_inner()) {
                let value = attribute
                    .normalized_value(quick_xml::XmlVersion::Implicit1_0)
                    .map_err(|e| format!("the value of {} is broken ({e})", local.into_inner()))?;
                self.add(namespace, local.into_inner(), owner, value.into_owned())?;
            }
        }
        Ok(frame)
    }

    fn text(&mut self, text: &str) {
        match self.stack.last() {
            Some(Frame::Property(index)) => self.xmp.properties[*index].text.push_str(text),
            Some(Frame::Item(index)) => {
                if let Some(item) = self.xmp.properties[*index].items.last_mut() {
                    item.push_str(text);
                }
            }
            Some(Frame::Wrapper | Frame::Skipped) | None => {}
        }
    }

    fn finish(mut self) -> Xmp {
        for property in &mut self.xmp.properties {
            trim(&mut property.text);
            property.items.iter_mut().for_each(trim);
        }
        self.xmp
    }
}

fn trim(text: &mut String) {
    let trimmed = text.trim();
    if trimmed.len() != text.len() {
        *text = trimmed.to_owned();
    }
}

/// Reads a packet. Bytes that are no UTF-8 are replaced, never guessed.
///
/// # Errors
/// Words for broken XML, a document type, an unknown entity, or a packet nested too deeply or too large.
pub(super) fn parse(packet: &[u8]) -> Result<Xmp, String> {
    let text = String::from_utf8_lossy(packet);
    let mut reader = NsReader::from_str(text.trim_end_matches('\0'));
    let mut builder = Builder::default();
    for _ in 0..MOST_EVENTS {
        let event = reader
            .read_event()
            .map_err(|e| format!("it is no well-formed XML at byte {} ({e})", reader.error_position()))?;
        match event {
            Event::Start(element) => {
                let frame = builder.open(&reader, &element)?;
                builder.stack.push(frame);
            }
            Event::Empty(element) => {
                builder.open(&reader, &element)?;
            }
            Event::End(_) => {
                builder.stack.pop();
            }
            Event::Text(text) => builder.text(&text.xml10_content()),
            Event::CData(text) => builder.text(&text.xml10_content()),
            Event::GeneralRef(reference) => {
                let mut buffer = [0; 4];
                builder.text(character(&reference)?.encode_utf8(&mut buffer));
            }
            Event::DocType(_) => return Err("it declares a document type, which no camera writes".to_owned()),
            Event::Eof if builder.stack.is_empty() => return Ok(builder.finish()),
            Event::Eof => return Err("it ends inside an element".to_owned()),
            Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
        }
    }
    Err(format!("it holds more than {MOST_EVENTS} XML events"))
}

/// A character reference or one of XML's five entities.
fn character(reference: &BytesRef) -> Result<char, String> {
    let broken = |e| format!("a character reference is broken ({e})");
    if let Some(character) = reference.resolve_char_ref().map_err(broken)? {
        return Ok(character);
    }
    let name = reference.xml10_content();
    match &*name {
        "amp" => Ok('&'),
        "lt" => Ok('<'),
        "gt" => Ok('>'),
        "apos" => Ok('\''),
        "quot" => Ok('"'),
        _ => Err(format!("the entity &{name}; is none of XML's five")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    fn packet(body: &str) -> String {
        format!(
            "<?xpacket begin=\"\u{feff}\" id=\"W5M0\"?><x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\
             <rdf:RDF xmlns:rdf=\"{RDF}\">{body}</rdf:RDF></x:xmpmeta><?xpacket end=\"w\"?>"
        )
    }

    #[test]
    fn attributes_elements_prefixes_lists_and_structures_are_the_same() {
        let text = packet(
            "<rdf:Description rdf:about='' xmlns:q='http://www.dji.com/drone-dji/1.0/' q:GimbalRollDegree='+1.5'>\
             <q:GimbalYawDegree> -12.5 </q:GimbalYawDegree></rdf:Description>\
             <rdf:Description xmlns='http://pix4d.com/camera/1.0'><BandName><rdf:Seq><rdf:li>Red</rdf:li>\
             <rdf:li>N&amp;&#x49;R</rdf:li></rdf:Seq></BandName></rdf:Description>\
             <rdf:Description xmlns:s='https://www.skydio.com/drone-skydio/1.0/'>\
             <s:CameraOrientationNED rdf:parseType='Resource'><s:Yaw>3</s:Yaw></s:CameraOrientationNED>\
             <s:Other s:Yaw='4'/><s:Nested><rdf:Description s:Yaw='5'/></s:Nested></rdf:Description>",
        );
        let xmp = parse(text.as_bytes()).unwrap();
        assert_eq!(xmp.text(Namespace::Dji, "GimbalRollDegree"), Some("+1.5"));
        assert_eq!(xmp.text(Namespace::Dji, "GimbalYawDegree"), Some("-12.5"));
        assert_eq!(xmp.items(Namespace::Pix4d, "BandName"), ["Red".to_owned(), "N&IR".to_owned()]);
        let yaw = |structure| xmp.member(Namespace::Skydio, structure, "Yaw");
        assert_eq!(
            [yaw("CameraOrientationNED"), yaw("Other"), yaw("Nested")],
            [Some("3"), Some("4"), Some("5")]
        );
        // A member is no property of the photo.
        assert_eq!(xmp.text(Namespace::Skydio, "Yaw"), None);
    }

    #[test]
    fn members_of_unknown_structures_are_not_the_photo_s() {
        let text = packet(
            "<rdf:Description xmlns:h='urn:history' xmlns:xmp='http://ns.adobe.com/xap/1.0/'>\
             <h:History><rdf:Seq><rdf:li xmp:CreatorTool='x'><xmp:CreatorTool>y</xmp:CreatorTool></rdf:li></rdf:Seq>\
             </h:History></rdf:Description>",
        );
        assert_eq!(parse(text.as_bytes()).unwrap().text(Namespace::Xmp, "CreatorTool"), None);
    }

    #[test]
    fn hostile_packets_are_refused_quickly() {
        let start = Instant::now();
        let deep = packet(&"<rdf:Seq>".repeat(100_000));
        assert!(parse(deep.as_bytes()).unwrap_err().contains("nested deeper than 64"));
        let bomb = format!("<!DOCTYPE l [<!ENTITY a \"{}\">]>{}", "&b;".repeat(1000), packet("&a;"));
        assert!(parse(bomb.as_bytes()).unwrap_err().contains("document type"));
        assert!(parse(packet("<rdf:li>&a;</rdf:li>").as_bytes()).unwrap_err().contains("&a;"));
        assert!(parse(packet(&"<rdf:li/>".repeat(200_000)).as_bytes()).unwrap_err().contains("events"));
        let wide = packet(&format!("<rdf:Description {}/>", "a=\"\" ".repeat(100_000)));
        assert!(parse(wide.as_bytes()).is_ok());
        let bindings: String = (0..50_000).map(|i| format!("xmlns:p{i}='u' ")).collect();
        let _ = parse(packet(&format!("<rdf:Description {bindings}/>")).as_bytes());
        assert!(start.elapsed().as_secs_f64() < 2.0, "{:?}", start.elapsed());
        assert!(parse(packet("<rdf:Description a=b/>").as_bytes()).is_err());
        for text in ["<a", "<a><b></a>", "<a>", "</a>", "&#x110000;"] {
            assert!(parse(text.as_bytes()).is_err(), "{text}");
        }
    }
}
