//! `[mosaic]`: grid, blending, compression and memory of the mosaic.

use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::error::{ConfigError, Resolver};
use super::quantity::{ByteSize, Length};
use super::source::Located;

/// `[mosaic]` as written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MosaicSpec {
    /// Size of a pixel on the ground: "20 cm", or "auto" for that of the frames. Default "auto".
    pub gsd: Located<Gsd>,
    /// How overlapping frames are joined. Default "feather".
    pub blend: Blend,
    /// Compression of the GeoTIFF. Default "deflate".
    pub compression: Located<Compression>,
    /// Quality of "jpeg" and "webp", 1 to 100. Default 90.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quality: Option<Located<u32>>,
    /// How frames are resampled. Default "bilinear".
    pub resampling: Resampling,
    /// Ceiling for decoded frames and tiles held at a time. Default "768 MiB".
    pub memory: Located<ByteSize>,
    /// Width of the PNG preview, pixels. Default 1600.
    pub preview_width_px: Located<u32>,
    /// Extent of the mosaic in the CRS of the products. Default: all the ground the frames show.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Located<BoundsSpec>>,
}

impl Default for MosaicSpec {
    fn default() -> Self {
        Self {
            gsd: Located::unplaced(Gsd::Auto),
            blend: Blend::Feather,
            compression: Located::unplaced(Compression::Deflate),
            quality: None,
            resampling: Resampling::Bilinear,
            memory: Located::unplaced(ByteSize::new(768.0 * 1_048_576.0)),
            preview_width_px: Located::unplaced(1600),
            bounds: None,
        }
    }
}

/// Size of a pixel on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gsd {
    /// That of the frames.
    Auto,
    /// As stated; metres inside.
    Given(Length),
}

impl Serialize for Gsd {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Given(length) => length.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Gsd {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct GsdVisitor;
        impl Visitor<'_> for GsdVisitor {
            type Value = Gsd;
            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a length with its unit, such as \"20 cm\", or \"auto\"")
            }
            fn visit_str<E: de::Error>(self, text: &str) -> Result<Gsd, E> {
                if text == "auto" { Ok(Gsd::Auto) } else { text.parse().map(Gsd::Given).map_err(E::custom) }
            }
            fn visit_i64<E: de::Error>(self, number: i64) -> Result<Gsd, E> {
                self.visit_str(&number.to_string())
            }
            fn visit_f64<E: de::Error>(self, number: f64) -> Result<Gsd, E> {
                self.visit_str(&number.to_string())
            }
        }
        deserializer.deserialize_any(GsdVisitor)
    }
}

impl JsonSchema for Gsd {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Gsd".into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let length = generator.subschema_for::<Length>();
        json_schema!({ "anyOf": [{ "const": "auto" }, length] })
    }
}

/// How overlapping frames are joined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blend {
    /// Weights that fall towards each frame's edge.
    Feather,
    /// The frame that looks at the place most directly.
    None,
}

/// Compression of a GeoTIFF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Compression {
    /// Lossless, read everywhere.
    Deflate,
    /// Lossless, faster than deflate; needs a GDAL built with it.
    Zstd,
    /// Lossless, read everywhere.
    Lzw,
    /// Lossy, small.
    Jpeg,
    /// Lossy, smallest; needs a GDAL built with it.
    Webp,
}

/// How frames are resampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Resampling {
    /// The nearest pixel.
    Nearest,
    /// Linear between four pixels.
    Bilinear,
    /// Cubic between sixteen pixels.
    Cubic,
}

/// Extent in a map CRS.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoundsSpec {
    /// Smallest easting.
    pub west: f64,
    /// Smallest northing.
    pub south: f64,
    /// Largest easting.
    pub east: f64,
    /// Largest northing.
    pub north: f64,
}

/// `[mosaic]`, resolved.
#[derive(Debug, Clone)]
pub struct Mosaic {
    /// The table's place.
    pub table: Located<()>,
    /// Size of a pixel on the ground, metres; `None`: that of the frames.
    pub gsd_m: Option<Located<f64>>,
    /// How overlapping frames are joined.
    pub blend: Blend,
    /// Compression of the GeoTIFF.
    pub compression: Located<Compression>,
    /// Quality of lossy compressions, 1 to 100.
    pub quality: u32,
    /// How frames are resampled.
    pub resampling: Resampling,
    /// Ceiling for decoded frames and tiles, bytes.
    pub memory_bytes: Located<u64>,
    /// Width of the preview, pixels.
    pub preview_width_px: u32,
    /// Extent in the CRS of the products.
    pub bounds: Option<Located<BoundsSpec>>,
}

/// Below this not even one frame and the tiles under it fit.
const SMALLEST_MEMORY: u64 = 64 << 20;

pub(super) fn resolve(spec: &mut Located<MosaicSpec>, resolver: &Resolver) -> Result<Mosaic, ConfigError> {
    let table = Located { value: (), span: spec.span.clone() };
    let spec = &mut spec.value;
    let gsd_m = match spec.gsd.value {
        Gsd::Auto => None,
        Gsd::Given(length) if length.metres() > 0.0 => Some(spec.gsd.as_ref().map(|_| length.metres())),
        Gsd::Given(length) => {
            return Err(resolver.error(&spec.gsd, format!("`gsd` is {length}; it must be above 0")));
        }
    };
    let lossy = matches!(spec.compression.value, Compression::Jpeg | Compression::Webp);
    if !lossy {
        resolver.unused(&spec.quality, "quality", "the compression is lossless")?;
    }
    let quality = match &spec.quality {
        Some(quality) if !(1..=100).contains(&quality.value) => {
            return Err(
                resolver.error(quality, format!("`quality` is {}; it lies between 1 and 100", quality.value))
            );
        }
        quality => quality.as_ref().map_or(90, |quality| quality.value),
    };
    if lossy {
        spec.quality.get_or_insert_with(|| Located::unplaced(quality));
    }
    let memory_bytes = spec.memory.as_ref().map(|memory| memory.bytes());
    if memory_bytes.value < SMALLEST_MEMORY {
        return Err(resolver
            .error(&spec.memory, format!("`memory` is {}; it must be 64 MiB or more", spec.memory.value)));
    }
    if !(16..=20_000).contains(&spec.preview_width_px.value) {
        let width = spec.preview_width_px.value;
        return Err(resolver.error(
            &spec.preview_width_px,
            format!("`preview_width_px` is {width}; it lies between 16 and 20000"),
        ));
    }
    if let Some(bounds) = &spec.bounds {
        let finite =
            [bounds.west, bounds.south, bounds.east, bounds.north].iter().all(|edge| edge.is_finite());
        if !(finite && bounds.west < bounds.east && bounds.south < bounds.north) {
            return Err(resolver
                .error(bounds, "the bounds hold no area")
                .help("west < east and south < north, in the CRS of the products"));
        }
    }
    Ok(Mosaic {
        table,
        gsd_m,
        blend: spec.blend,
        compression: spec.compression.clone(),
        quality,
        resampling: spec.resampling,
        memory_bytes,
        preview_width_px: spec.preview_width_px.value,
        bounds: spec.bounds.clone(),
    })
}
