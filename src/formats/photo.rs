//! Photos: JPEG, PNG and TIFF to 8-bit images of one or three channels.
//!
//! The pixels are taken as stored: an EXIF orientation is not applied, because the interior orientation
//! belongs to the stored pixels. A file that ends early, holds broken data or is larger than allowed is
//! refused; a decoder's guess never reaches a product. Channels of 16 bits are scaled linearly
//! (65535 → 255). A photo with an alpha channel is accepted when it is opaque throughout.

mod store;

pub use store::PhotoStore;

use super::InputError;
use crate::calibration::Grey;
use crate::raster::Image8;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::fs;
use std::io::{BufRead, Cursor, Seek};
use std::path::Path;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Decoded photos may take this many bytes: 357 megapixels of colour.
const MOST_BYTES: u64 = 1 << 30;

/// What a file's header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PhotoHeader {
    /// Columns as stored.
    pub width: u32,
    /// Rows as stored.
    pub height: u32,
    /// 1 (grey) or 3 (colour).
    pub channels: usize,
    /// True when the samples have 16 bits and will be scaled to 8.
    pub sixteen_bits: bool,
}

/// Reads a photo's header; its pixels are neither decoded nor allocated.
///
/// # Errors
/// [`InputError`]: unreadable, empty, of no known format, or of a kind that [`decode`] refuses.
pub fn read_header(path: &Path) -> Result<PhotoHeader, InputError> {
    let failed = |cause: String| InputError::new(path, cause);
    let size = fs::metadata(path).map_err(|e| failed(format!("cannot be read ({e})")))?.len();
    if size == 0 {
        return Err(failed("the file is empty".to_owned()));
    }
    let reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(|e| failed(format!("cannot be read ({e})")))?;
    if known_format(reader.format()).map_err(failed)? == ImageFormat::Jpeg {
        return jpeg_header(reader.into_inner()).map_err(failed);
    }
    let decoder = reader.into_decoder().map_err(|e| failed(broken(&e)))?;
    header(&decoder).map_err(failed)
}

/// Reads as far as the size of the image stands; the decoder of the `image` crate would read the whole file.
fn jpeg_header(mut file: impl BufRead + Seek) -> Result<PhotoHeader, String> {
    file.rewind().map_err(|e| format!("cannot be read ({e})"))?;
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(file, options);
    decoder.decode_headers().map_err(|e| format!("cannot be decoded ({e:?})"))?;
    let info = decoder.info().ok_or("cannot be decoded (no header)")?;
    let channels = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => 1,
        _ => 3,
    };
    Ok(PhotoHeader {
        width: u32::from(info.width),
        height: u32::from(info.height),
        channels,
        sixteen_bits: false,
    })
}

/// Reads and decodes a photo.
///
/// # Errors
/// [`InputError`]: as [`read_header`], or the file ends early, holds broken data, has transparent pixels,
/// or would take more than 1 GiB decoded.
pub fn decode(path: &Path) -> Result<Image8, InputError> {
    let bytes = fs::read(path).map_err(|e| InputError::new(path, format!("cannot be read ({e})")))?;
    decode_bytes(&bytes).map_err(|cause| InputError::new(path, cause))
}

/// Brightest value of what [`decode_grey`] returns.
pub const WHITE: f32 = 255.0;

/// Reads and decodes a photo to brightness from 0 to [`WHITE`], colours weighted as the eye does (ITU-R BT.601, as
/// JPEG and OpenCV do). Samples of 16 bits keep their precision.
///
/// # Errors
/// As [`decode`].
pub fn decode_grey(path: &Path) -> Result<Grey, InputError> {
    let bytes = fs::read(path).map_err(|e| InputError::new(path, format!("cannot be read ({e})")))?;
    grey(&bytes).map_err(|cause| InputError::new(path, cause))
}

fn grey(bytes: &[u8]) -> Result<Grey, String> {
    const WEIGHTS: [f32; 3] = [0.299, 0.587, 0.114];
    let deep = |values: Vec<u16>, width: u32, height: u32, channels: usize| {
        const SCALE: f32 = WHITE / u16::MAX as f32;
        let values = match channels {
            1 => values.into_iter().map(|v| SCALE * f32::from(v)).collect(),
            _ => values
                .chunks_exact(channels)
                .map(|c| SCALE * WEIGHTS.iter().zip(c).map(|(w, v)| w * f32::from(*v)).sum::<f32>())
                .collect(),
        };
        Grey::new(width as usize, height as usize, values).map_err(|e| e.to_string())
    };
    let image = match pixels(bytes)? {
        Pixels::Deep(image @ (DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_))) => {
            let (width, height) = (image.width(), image.height());
            return deep(image.into_luma16().into_raw(), width, height, 1);
        }
        Pixels::Deep(image) => {
            let (width, height) = (image.width(), image.height());
            return deep(image.into_rgb16().into_raw(), width, height, 3);
        }
        Pixels::Eight(image) => image,
    };
    let values = match image.channels() {
        1 => image.samples().iter().map(|v| f32::from(*v)).collect(),
        _ => image
            .samples()
            .chunks_exact(3)
            .map(|c| WEIGHTS.iter().zip(c).map(|(w, v)| w * f32::from(*v)).sum())
            .collect(),
    };
    Grey::new(image.width(), image.height(), values).map_err(|e| e.to_string())
}

fn decode_bytes(bytes: &[u8]) -> Result<Image8, String> {
    match pixels(bytes)? {
        Pixels::Eight(image) => Ok(image),
        Pixels::Deep(image) => {
            let (width, height) = (image.width() as usize, image.height() as usize);
            let (channels, samples) = match image {
                DynamicImage::ImageLuma16(_) | DynamicImage::ImageLumaA16(_) => {
                    (1, image.into_luma8().into_raw())
                }
                _ => (3, image.into_rgb8().into_raw()),
            };
            Image8::new(width, height, channels, samples).ok_or_else(unfilled)
        }
    }
}

fn unfilled() -> String {
    "the decoded pixels do not fill the image".to_owned()
}

/// A decoded photo: opaque, of one or three colours.
enum Pixels {
    /// 8 bits a sample.
    Eight(Image8),
    /// 16 bits a sample.
    Deep(DynamicImage),
}

fn pixels(bytes: &[u8]) -> Result<Pixels, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    let reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| format!("cannot be read ({e})"))?;
    if known_format(reader.format())? == ImageFormat::Jpeg {
        return decode_jpeg(bytes).map(Pixels::Eight);
    }
    let mut decoder = reader.into_decoder().map_err(|e| broken(&e))?;
    let PhotoHeader { width, height, .. } = header(&decoder)?;
    affordable(width, height, 4)?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(width);
    limits.max_image_height = Some(height);
    // 16 bits and four channels at most, and the decoder's own buffers.
    limits.max_alloc = Some(4 * MOST_BYTES);
    decoder.set_limits(limits).map_err(|e| broken(&e))?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|e| broken(&e))?;
    if !is_opaque(&decoded) {
        return Err("has transparent pixels; frames must be opaque".to_owned());
    }
    let (channels, samples) = match decoded {
        DynamicImage::ImageLuma8(image) => (1, image.into_raw()),
        DynamicImage::ImageRgb8(image) => (3, image.into_raw()),
        DynamicImage::ImageLumaA8(_) => (1, decoded.into_luma8().into_raw()),
        DynamicImage::ImageRgba8(_) => (3, decoded.into_rgb8().into_raw()),
        deep => return Ok(Pixels::Deep(deep)),
    };
    Image8::new(width as usize, height as usize, channels, samples).map(Pixels::Eight).ok_or_else(unfilled)
}

/// Strictly, for the decoder's default is to fill what it cannot decode with grey and call it a photo.
fn decode_jpeg(bytes: &[u8]) -> Result<Image8, String> {
    if !has_jpeg_end(bytes) {
        return Err(format!("the JPEG is cut short: it ends after {} bytes without its end", bytes.len()));
    }
    let broken = |e: zune_jpeg::errors::DecodeErrors| format!("cannot be decoded ({e:?})");
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX));
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(broken)?;
    let info = decoder.info().ok_or("cannot be decoded (no header)")?;
    let (channels, space) = match decoder.input_colorspace() {
        Some(ColorSpace::Luma) => (1, ColorSpace::Luma),
        _ => (3, ColorSpace::RGB),
    };
    affordable(u32::from(info.width), u32::from(info.height), channels as u64)?;
    decoder.set_options(options.jpeg_set_out_colorspace(space));
    let samples = decoder.decode().map_err(broken)?;
    Image8::new(usize::from(info.width), usize::from(info.height), channels, samples).ok_or_else(unfilled)
}

/// Walks the markers up to the end-of-image marker; whatever cameras append after it does not matter.
fn has_jpeg_end(bytes: &[u8]) -> bool {
    const END_OF_IMAGE: u8 = 0xD9;
    // Markers that stand alone: TEM, RST0–7, SOI.
    let stands_alone = |marker: u8| matches!(marker, 0x01 | 0xD0..=0xD8);
    let mut at = 0;
    loop {
        // To the next marker; between segments that is at once, within a scan past the entropy-coded data,
        // in which a byte 0xFF is followed by 0x00 or a restart marker.
        let marker = loop {
            let Some(found) = bytes.get(at..).and_then(|rest| rest.iter().position(|b| *b == 0xFF)) else {
                return false;
            };
            at += found + 1;
            match bytes.get(at) {
                None => return false,
                Some(0x00 | 0xFF) => {}
                Some(marker) => break *marker,
            }
        };
        at += 1;
        if marker == END_OF_IMAGE {
            return true;
        }
        if stands_alone(marker) {
            continue;
        }
        let Some(length) = bytes.get(at..at + 2) else { return false };
        at += usize::from(u16::from_be_bytes([length[0], length[1]]));
    }
}

fn known_format(format: Option<ImageFormat>) -> Result<ImageFormat, String> {
    format
        .filter(|f| matches!(f, ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Tiff))
        .ok_or_else(|| "is no JPEG, PNG or TIFF image".to_owned())
}

fn header(decoder: &impl ImageDecoder) -> Result<PhotoHeader, String> {
    let (width, height) = decoder.dimensions();
    let (channels, sixteen_bits) = match decoder.color_type() {
        ColorType::L8 | ColorType::La8 => (1, false),
        ColorType::Rgb8 | ColorType::Rgba8 => (3, false),
        ColorType::L16 | ColorType::La16 => (1, true),
        ColorType::Rgb16 | ColorType::Rgba16 => (3, true),
        other => return Err(format!("has samples of the kind {other:?}; 8 or 16 bits are needed")),
    };
    Ok(PhotoHeader { width, height, channels, sixteen_bits })
}

fn affordable(width: u32, height: u32, bytes_per_pixel: u64) -> Result<(), String> {
    let bytes = u64::from(width) * u64::from(height) * bytes_per_pixel;
    if bytes > MOST_BYTES {
        return Err(format!(
            "its header announces {width} × {height} pixels, {} MiB decoded; the limit is {} MiB",
            bytes >> 20,
            MOST_BYTES >> 20
        ));
    }
    Ok(())
}

fn is_opaque(image: &DynamicImage) -> bool {
    match image {
        DynamicImage::ImageLumaA8(i) => i.pixels().all(|p| p.0[1] == u8::MAX),
        DynamicImage::ImageRgba8(i) => i.pixels().all(|p| p.0[3] == u8::MAX),
        DynamicImage::ImageLumaA16(i) => i.pixels().all(|p| p.0[1] == u16::MAX),
        DynamicImage::ImageRgba16(i) => i.pixels().all(|p| p.0[3] == u16::MAX),
        _ => true,
    }
}

fn broken(error: &image::ImageError) -> String {
    format!("cannot be decoded ({error})")
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ExtendedColorType, ImageEncoder};

    fn gradient(width: u32, height: u32) -> Vec<u8> {
        (0..height).flat_map(|r| (0..width).flat_map(move |c| [(c * 3) as u8, (r * 2) as u8, 90])).collect()
    }
    fn jpeg(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 92)
            .write_image(&gradient(width, height), width, height, ExtendedColorType::Rgb8)
            .unwrap();
        bytes
    }
    fn png(samples: &[u8], width: u32, height: u32, kind: ExtendedColorType) -> Vec<u8> {
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes).write_image(samples, width, height, kind).unwrap();
        bytes
    }
    fn cause(bytes: &[u8]) -> String {
        decode_bytes(bytes).unwrap_err()
    }

    #[test]
    fn jpeg_and_png_come_out_as_stored() {
        let image = decode_bytes(&jpeg(80, 60)).unwrap();
        assert_eq!((image.width(), image.height(), image.channels()), (80, 60, 3));
        for (is, was) in image.samples().iter().zip(gradient(80, 60)) {
            assert!(is.abs_diff(was) < 8, "{is} {was}");
        }
        let exact = decode_bytes(&png(&gradient(80, 60), 80, 60, ExtendedColorType::Rgb8)).unwrap();
        assert_eq!(exact.samples(), gradient(80, 60));
        let grey = decode_bytes(&png(&[1, 2, 3, 4], 2, 2, ExtendedColorType::L8)).unwrap();
        assert_eq!((grey.channels(), grey.samples()), (1, [1, 2, 3, 4].as_slice()));
    }

    #[test]
    fn sixteen_bits_are_scaled_linearly() {
        let samples: Vec<u8> = [0_u16, 257, 32896, 65535].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let image = decode_bytes(&png(&samples, 2, 2, ExtendedColorType::L16)).unwrap();
        assert_eq!(image.samples(), [0, 1, 128, 255]);
        // As brightness they keep what 8 bits would lose.
        let samples: Vec<u8> = [1_u16, 258, 32897, 65535].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let deep = grey(&png(&samples, 2, 2, ExtendedColorType::L16)).unwrap();
        for (value, stored) in deep.values().iter().zip([1.0_f32, 258.0, 32897.0, 65535.0]) {
            assert!((value - stored / 257.0).abs() < 1e-4, "{value} for {stored}");
        }
        let rgb: Vec<u8> = [65535_u16, 0, 0].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let red = grey(&png(&rgb, 1, 1, ExtendedColorType::Rgb16)).unwrap();
        assert!((red.values()[0] - 76.245).abs() < 1e-3, "{:?}", red.values());
    }

    #[test]
    fn a_file_that_ends_early_is_refused_wherever_it_ends() {
        let whole = jpeg(200, 150);
        for keep in [whole.len() - 2, whole.len() * 9 / 10, whole.len() / 2, 200, 20] {
            let cause = cause(&whole[..keep]);
            assert!(cause.contains("cut short") || cause.contains("decoded"), "{keep}: {cause}");
        }
        let whole = png(&gradient(80, 60), 80, 60, ExtendedColorType::Rgb8);
        for keep in [whole.len() - 20, whole.len() / 2, 40] {
            assert!(cause(&whole[..keep]).contains("cannot be decoded"));
        }
    }

    #[test]
    fn what_a_camera_appends_after_the_end_does_not_matter() {
        let mut bytes = jpeg(40, 30);
        bytes.extend_from_slice(b"preview \xFF\xD8 and so on");
        assert!(decode_bytes(&bytes).is_ok());
    }

    #[test]
    fn broken_data_is_not_painted_grey() {
        let mut bytes = jpeg(200, 150);
        let at = bytes.len() * 2 / 3;
        // Codes of sixteen ones, which no Huffman table holds (0xFF is stored as 0xFF00).
        for pair in bytes[at..at + 16].chunks_mut(2) {
            pair.copy_from_slice(&[0xFF, 0x00]);
        }
        assert!(cause(&bytes).contains("cannot be decoded"), "{}", cause(&bytes));
        // A marker that has no business inside a scan: the end is not found behind it.
        bytes[at..at + 2].copy_from_slice(&[0xFF, 0xC0]);
        assert!(decode_bytes(&bytes).is_err());
    }

    #[test]
    fn strangers_are_named() {
        assert_eq!(cause(b""), "the file is empty");
        assert!(cause(b"this is a text").contains("no JPEG, PNG or TIFF"));
        let clear = png(&[9, 9, 9, 0], 1, 1, ExtendedColorType::Rgba8);
        assert!(cause(&clear).contains("transparent"));
        let opaque = png(&[9, 8, 7, 255], 1, 1, ExtendedColorType::Rgba8);
        assert_eq!(decode_bytes(&opaque).unwrap().samples(), [9, 8, 7]);
    }

    #[test]
    fn a_header_that_announces_too_much_is_refused_before_decoding() {
        // A JPEG whose frame header is rewritten to 65500 × 65500.
        let mut bytes = jpeg(40, 30);
        let frame = bytes.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
        bytes[frame + 5..frame + 9].copy_from_slice(&[0xFF, 0xDC, 0xFF, 0xDC]);
        assert!(cause(&bytes).contains("announces 65500 × 65500"), "{}", cause(&bytes));
        // A PNG of 65535 × 65535 in a few bytes: rewritten size, checksum made right again.
        let mut bytes = png(&gradient(8, 8), 8, 8, ExtendedColorType::Rgb8);
        bytes[16..24].copy_from_slice(&[0, 0, 0xFF, 0xFF, 0, 0, 0xFF, 0xFF]);
        let checksum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
        assert!(cause(&bytes).contains("announces 65535 × 65535"), "{}", cause(&bytes));
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8)
                .fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { 0xEDB8_8320 ^ (c >> 1) } else { c >> 1 })
        })
    }

    #[test]
    fn headers_are_read_without_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        crate::formats::atomic::write_atomic(&path, &jpeg(80, 60)).unwrap();
        let header = read_header(&path).unwrap();
        assert_eq!((header.width, header.height, header.channels), (80, 60, 3));
        let missing = read_header(&folder.path().join("b.jpg")).unwrap_err();
        assert!(missing.to_string().contains("b.jpg"), "{missing}");
    }
}
