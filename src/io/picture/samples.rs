//! Decodes PNG, JPEG, WebP and KTX 2 files to samples, for images and textures; and, with the crate `image`,
//! TGA, BMP, GIF and TIFF files of textures.
//!
//! Decoding has two steps, so that the stated size can be checked before memory is allocated: [`Encoded::open`]
//! reads the header, [`Encoded::decode`] the pixels. Colour profiles are not applied: numbers are taken as
//! sRGB.

use std::io::Cursor;

use image::{ImageDecoder, ImageFormat, ImageReader};
use image_webp::WebPDecoder;
use png::Transformations;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

#[cfg(feature = "ktx2")]
use crate::io::mesh::ktx2::Ktx2;
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::volume::tiff;
use crate::scene::Values;

/// The first bytes of every PNG file.
pub(in crate::io) const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";
/// The first bytes of every JPEG file.
pub(in crate::io) const JPEG_MAGIC: &[u8] = b"\xff\xd8\xff";
/// The first bytes of every KTX 2 file.
const KTX2_START: &[u8] = b"\xabKTX 20\xbb";

/// Greatest number of a PNG's pixels per byte: eight, deflated.
const PNG_PIXELS_PER_BYTE: u64 = 8 * DEFLATE_RATIO;

/// Greatest number of a JPEG's pixels per byte: a block of 64 takes at least a bit.
const JPEG_PIXELS_PER_BYTE: u64 = 8 * 64;

/// Greatest number of a lossy WebP's pixels per byte: each 256 pixels take more than three bits for the modes
/// of prediction, whose probabilities are fixed.
const WEBP_PIXELS_PER_BYTE: u64 = 1024;

/// Number of pixels that any lossless WebP may have: an image of one colour takes no bits for its pixels.
const WEBP_PIXELS_OF_NOTHING: u64 = 1 << 22;

/// The formats of textures.
pub(in crate::io) const TEXTURES: &str = "PNG, JPEG, WebP, KTX 2, TGA, BMP, GIF or TIFF";

/// A file whose header has been read and whose size its bytes could hold.
pub(in crate::io) struct Encoded<'a> {
    form: Form<'a>,
    /// Width and height, pixels; neither is 0.
    size: [usize; 2],
}

enum Form<'a> {
    Png(Box<png::Reader<Cursor<&'a [u8]>>>),
    Jpeg(Box<JpegDecoder<ZCursor<&'a [u8]>>>),
    WebP(Box<WebPDecoder<Cursor<&'a [u8]>>>),
    #[cfg(feature = "ktx2")]
    Ktx2(Ktx2),
    /// A decoder of the crate `image`.
    Other(Box<dyn ImageDecoder + 'a>),
}

/// The reason why there are no pixels, as the end of a sentence about the image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::io) enum Refusal {
    /// The first bytes are of an unknown format.
    Unknown,
    /// The first bytes of a texture are of an unknown format.
    UnknownTexture,
    /// A format, and the crate's feature that reads it.
    #[cfg(not(feature = "ktx2"))]
    NotBuilt(&'static str, &'static str),
    /// The decoder's error.
    Damaged(String),
    /// More pixels than the bytes can hold, or none: width, height and bytes.
    Claim(usize, usize, usize),
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Unknown => write!(f, "is neither PNG, JPEG, WebP nor KTX 2"),
            Self::UnknownTexture => write!(f, "is no image that is read ({TEXTURES})"),
            #[cfg(not(feature = "ktx2"))]
            Self::NotBuilt(name, feature) => write!(
                f,
                "is {name}, which is read where the feature `{feature}` is built in: save it as PNG or JPEG"
            ),
            Self::Damaged(reason) => write!(f, "is damaged ({reason})"),
            Self::Claim(width, height, bytes) => {
                write!(f, "claims {width} x {height} pixels in {bytes} bytes")
            }
        }
    }
}

/// Whether a file begins as WebP files do.
pub(in crate::io) fn is_webp(head: &[u8]) -> bool {
    head.starts_with(b"RIFF") && head.get(8..12) == Some(b"WEBP")
}

/// The first line of a decoder's error.
fn damaged(error: impl std::fmt::Display) -> Refusal {
    let text = error.to_string();
    Refusal::Damaged(text.lines().next().unwrap_or("").to_owned())
}

/// Bytes that a PNG decoder may allocate: the greatest ratio of deflate, with some more for small images.
pub(super) fn png_limits(bytes: &[u8]) -> png::Limits {
    let limit = bytes.len() as u64 * DEFLATE_RATIO + (1 << 20);
    png::Limits {
        bytes: usize::try_from(limit).unwrap_or(usize::MAX),
    }
}

impl<'a> Encoded<'a> {
    /// Reads the header of a file; the format follows from its first bytes.
    pub(in crate::io) fn open(bytes: &'a [u8]) -> Result<Self, Refusal> {
        if bytes.starts_with(PNG_MAGIC) {
            Self::png(bytes)
        } else if bytes.starts_with(JPEG_MAGIC) {
            Self::jpeg(bytes)
        } else if is_webp(bytes) {
            Self::webp(bytes)
        } else if bytes.starts_with(KTX2_START) {
            Self::ktx2(bytes)
        } else {
            Err(Refusal::Unknown)
        }
    }

    /// Reads the header of a texture; the format follows from its first bytes.
    pub(in crate::io) fn texture(bytes: &'a [u8]) -> Result<Self, Refusal> {
        match Self::open(bytes) {
            Err(Refusal::Unknown) => {
                let format = other_format(bytes).ok_or(Refusal::UnknownTexture)?;
                Self::other(bytes, format)
            }
            known => known,
        }
    }

    /// Reads the header of a TGA, BMP, GIF or TIFF file.
    fn other(bytes: &'a [u8], format: ImageFormat) -> Result<Self, Refusal> {
        // The decoder of TIFF prints to standard error if its limits are exceeded.
        if format == ImageFormat::Tiff && tiff::has_long_lists(bytes) {
            return Err(damaged("lists of tags that are longer than the file"));
        }
        let limit = bytes.len() as u64 * DEFLATE_RATIO + (1 << 20);
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(limit.saturating_mul(8));
        let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(damaged)?;
        let (width, height) = decoder.dimensions();
        let size = [width, height].map(|n| n as usize);
        check_claim(size, bytes, PNG_PIXELS_PER_BYTE)?;
        Ok(Self {
            form: Form::Other(Box::new(decoder)),
            size,
        })
    }

    /// Reads the header of a PNG file.
    pub(in crate::io) fn png(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png_limits(bytes));
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        // Palettes and fewer than eight bits become eight; sixteen stay.
        decoder.set_transformations(Transformations::EXPAND);
        let info = decoder.read_header_info().map_err(damaged)?;
        let size = [info.width, info.height].map(|n| n as usize);
        check_claim(size, bytes, PNG_PIXELS_PER_BYTE)?;
        let reader = decoder.read_info().map_err(damaged)?;
        Ok(Self {
            form: Form::Png(Box::new(reader)),
            size,
        })
    }

    fn jpeg(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let options = DecoderOptions::default()
            .set_strict_mode(false)
            .set_max_width(usize::MAX)
            .set_max_height(usize::MAX);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(damaged)?;
        let (width, height) = decoder.dimensions().unwrap_or((0, 0));
        check_claim([width, height], bytes, JPEG_PIXELS_PER_BYTE)?;
        // Grey stays grey; all else is converted to RGB.
        let colours = match decoder.input_colorspace() {
            Some(ColorSpace::Luma) => ColorSpace::Luma,
            _ => ColorSpace::RGB,
        };
        decoder.set_options(options.jpeg_set_out_colorspace(colours));
        Ok(Self {
            form: Form::Jpeg(Box::new(decoder)),
            size: [width, height],
        })
    }

    /// Reads the header of a WebP file.
    pub(in crate::io) fn webp(bytes: &'a [u8]) -> Result<Self, Refusal> {
        let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(damaged)?;
        if decoder.is_animated() {
            return Err(damaged("an animation, not an image"));
        }
        let (width, height) = decoder.dimensions();
        let size = [width as usize, height as usize];
        let is_of_nothing = !decoder.is_lossy()
            && u64::from(width) * u64::from(height) <= WEBP_PIXELS_OF_NOTHING
            && width > 0
            && height > 0;
        if !is_of_nothing {
            let pixels_per_byte = match decoder.is_lossy() {
                true => WEBP_PIXELS_PER_BYTE,
                false => PNG_PIXELS_PER_BYTE,
            };
            check_claim(size, bytes, pixels_per_byte)?;
        }
        Ok(Self {
            form: Form::WebP(Box::new(decoder)),
            size,
        })
    }

    /// Reads the header of a KTX 2 file.
    #[cfg(feature = "ktx2")]
    fn ktx2(bytes: &[u8]) -> Result<Self, Refusal> {
        let image = Ktx2::of(bytes).map_err(damaged)?;
        Ok(Self {
            size: image.size,
            form: Form::Ktx2(image),
        })
    }

    #[cfg(not(feature = "ktx2"))]
    fn ktx2(_: &[u8]) -> Result<Self, Refusal> {
        Err(Refusal::NotBuilt("KTX 2", "ktx2"))
    }

    /// Width and height, pixels.
    pub(in crate::io) fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Decodes the pixels (of an animation, the first frame).
    pub(in crate::io) fn decode(self) -> Result<Samples, Refusal> {
        let (channels, numbers) = match self.form {
            Form::Png(mut reader) => {
                let (colour, depth) = reader.output_color_type();
                let length = reader
                    .output_buffer_size()
                    .ok_or_else(|| damaged("too large"))?;
                let mut bytes = vec![0; length];
                reader.next_frame(&mut bytes).map_err(damaged)?;
                let numbers = match depth {
                    png::BitDepth::Sixteen => {
                        let pairs = bytes.as_chunks().0.iter();
                        Numbers::Sixteen(pairs.map(|b| u16::from_be_bytes(*b)).collect())
                    }
                    _ => Numbers::Eight(bytes),
                };
                (colour.samples(), numbers)
            }
            Form::Jpeg(mut decoder) => {
                let bytes = decoder.decode().map_err(damaged)?;
                let colours = decoder.output_colorspace();
                (
                    colours.map_or(0, |c| c.num_components()),
                    Numbers::Eight(bytes),
                )
            }
            Form::Other(decoder) => {
                let image = image::DynamicImage::from_decoder(decoder).map_err(damaged)?;
                (4, Numbers::Eight(image.into_rgba8().into_raw()))
            }
            #[cfg(feature = "ktx2")]
            Form::Ktx2(image) => (4, Numbers::Eight(image.decode().map_err(damaged)?)),
            Form::WebP(mut decoder) => {
                let length = decoder
                    .output_buffer_size()
                    .ok_or_else(|| damaged("too large"))?;
                let mut bytes = vec![0; length];
                decoder.read_image(&mut bytes).map_err(damaged)?;
                (
                    if decoder.has_alpha() { 4 } else { 3 },
                    Numbers::Eight(bytes),
                )
            }
        };
        let samples = Samples {
            size: self.size,
            channels,
            numbers,
        };
        if samples.is_whole() {
            Ok(samples)
        } else {
            Err(damaged("another number of samples than of pixels"))
        }
    }
}

/// The format of a texture that is none of the others. TGA has no signature: its header must be plausible.
fn other_format(bytes: &[u8]) -> Option<ImageFormat> {
    if bytes.starts_with(b"GIF87a") || bytes.starts_with(b"GIF89a") {
        return Some(ImageFormat::Gif);
    }
    if bytes.starts_with(b"BM") {
        return Some(ImageFormat::Bmp);
    }
    if tiff::looks_like(bytes) {
        return Some(ImageFormat::Tiff);
    }
    // Length of a name, whether there is a palette, kind; then origin, width, height and bits per pixel.
    let (start, rest) = (bytes.first_chunk::<3>()?, bytes.get(12..18)?);
    let is_tga = match start {
        [_, 1, 1 | 9] => rest[4] == 8 || rest[4] == 16,
        [_, 0, 2 | 10] => matches!(rest[4], 15 | 16 | 24 | 32),
        [_, 0, 3 | 11] => matches!(rest[4], 8 | 16),
        _ => false,
    };
    let has_size = rest[..2] != [0, 0] && rest[2..4] != [0, 0];
    (is_tga && has_size).then_some(ImageFormat::Tga)
}

/// Refuses a size that the file's bytes cannot hold, even at the greatest ratio.
fn check_claim(size: [usize; 2], bytes: &[u8], pixels_per_byte: u64) -> Result<(), Refusal> {
    let [width, height] = size;
    let claimed = (width as u64).saturating_mul(height as u64);
    if claimed == 0 || claimed > pixels_per_byte.saturating_mul(bytes.len() as u64) {
        return Err(Refusal::Claim(width, height, bytes.len()));
    }
    Ok(())
}

/// Samples in the file's channels: grey, grey and alpha, RGB or RGBA, rows from the top.
pub(in crate::io) struct Samples {
    size: [usize; 2],
    /// Numbers per pixel, 1 to 4.
    channels: usize,
    numbers: Numbers,
}

enum Numbers {
    Eight(Vec<u8>),
    Sixteen(Vec<u16>),
}

impl Samples {
    fn is_whole(&self) -> bool {
        let count = match &self.numbers {
            Numbers::Eight(n) => n.len(),
            Numbers::Sixteen(n) => n.len(),
        };
        let [width, height] = self.size;
        let expected = width
            .checked_mul(height)
            .and_then(|n| n.checked_mul(self.channels));
        (1..=4).contains(&self.channels) && expected == Some(count)
    }

    /// Width and height, and the numbers of each channel.
    pub(in crate::io) fn channels(self) -> ([usize; 2], Vec<Values>) {
        let count = self.channels;
        let channel = |c: usize| match &self.numbers {
            Numbers::Eight(n) => Values::U8(n.iter().skip(c).step_by(count).copied().collect()),
            Numbers::Sixteen(n) => Values::U16(n.iter().skip(c).step_by(count).copied().collect()),
        };
        (self.size, (0..count).map(channel).collect())
    }

    /// Pixels of eight bits; sixteen are rounded.
    pub(in crate::io) fn rgba8(self) -> Vec<[u8; 4]> {
        let narrow = |x: &u16| u8::try_from((u32::from(*x) + 128) / 257).unwrap_or(u8::MAX);
        match &self.numbers {
            Numbers::Eight(n) => pixels(n, self.channels, u8::MAX, |x| *x),
            Numbers::Sixteen(n) => pixels(n, self.channels, u8::MAX, narrow),
        }
    }

    /// Pixels of sixteen bits; 255 of eight bits is 65535.
    pub(in crate::io) fn rgba16(self) -> Vec<[u16; 4]> {
        match &self.numbers {
            Numbers::Eight(n) => pixels(n, self.channels, u16::MAX, |x| u16::from(*x) * 257),
            Numbers::Sixteen(n) => pixels(n, self.channels, u16::MAX, |x| *x),
        }
    }
}

/// Numbers as pixels of four channels: grey is repeated; without alpha it is `opaque`.
fn pixels<T, U: Copy>(
    numbers: &[T],
    channels: usize,
    opaque: U,
    convert: impl Fn(&T) -> U,
) -> Vec<[U; 4]> {
    let convert = &convert;
    let pixel = |n: &[T]| match n {
        [grey] => [convert(grey), convert(grey), convert(grey), opaque],
        [grey, a] => [convert(grey), convert(grey), convert(grey), convert(a)],
        [r, g, b] => [convert(r), convert(g), convert(b), opaque],
        [r, g, b, a, ..] => [convert(r), convert(g), convert(b), convert(a)],
        [] => [opaque; 4],
    };
    numbers.chunks_exact(channels).map(pixel).collect()
}

/// A PNG file of eight bits and `channels` (3 or 4) per pixel, deflated fast.
///
/// - `note`: keyword and text of an iTXt chunk.
///
/// # Errors
/// The encoder's error: sizes that disagree.
pub(in crate::io) fn png_file(
    [width, height]: [u32; 2],
    channels: usize,
    numbers: &[u8],
    note: Option<(&str, &str)>,
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(match channels {
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    if let Some((keyword, text)) = note {
        encoder.add_itxt_chunk(keyword.into(), text.into())?;
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(numbers)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A PNG file of one row; `numbers` are the stored bytes.
    fn png_row(
        width: u32,
        colour: png::ColorType,
        depth: png::BitDepth,
        palette: &[u8],
        numbers: &[u8],
    ) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette.to_vec());
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(numbers).unwrap();
        writer.finish().unwrap();
        bytes
    }

    fn decoded(bytes: &[u8]) -> Samples {
        Encoded::open(bytes).unwrap().decode().unwrap()
    }

    #[test]
    fn every_kind_of_png_becomes_four_channels() {
        use png::{BitDepth as D, ColorType as C};
        let max = u16::MAX;
        for (bytes, expected) in [
            // Black, white, black, white, in bits.
            (
                png_row(4, C::Grayscale, D::One, &[], &[0b0101_0000]),
                vec![[0, 0, 0, 255], [255; 4], [0, 0, 0, 255], [255; 4]],
            ),
            (
                png_row(2, C::Indexed, D::Two, &[1, 2, 3, 4, 5, 6], &[0b0001_0000]),
                vec![[1, 2, 3, 255], [4, 5, 6, 255]],
            ),
            (
                png_row(2, C::GrayscaleAlpha, D::Eight, &[], &[9, 0, 7, 200]),
                vec![[9, 9, 9, 0], [7, 7, 7, 200]],
            ),
            (
                png_row(1, C::Rgb, D::Sixteen, &[], &[0, 127, 0, 129, 255, 255]),
                vec![[0, 1, 255, 255]],
            ),
        ] {
            assert_eq!(decoded(&bytes).rgba8(), expected);
        }
        let sixteen = png_row(1, C::Grayscale, D::Sixteen, &[], &[1, 2]);
        assert_eq!(decoded(&sixteen).rgba16(), [[258, 258, 258, max]]);
        let eight = png_row(1, C::Rgb, D::Eight, &[], &[0, 1, 255]);
        assert_eq!(decoded(&eight).rgba16(), [[0, 257, max, max]]);
    }

    #[test]
    fn jpegs_are_grey_or_coloured() {
        use jpeg_encoder::{ColorType, Encoder};
        // Uniform blocks, of the best quality: only the rounding of the colours is left.
        for (colours, numbers, expected) in [
            (ColorType::Luma, &[77][..], [77, 77, 77]),
            (ColorType::Rgb, &[200, 100, 50], [200, 100, 50]),
            // Inks: none of the first three and half of black.
            (ColorType::Cmyk, &[0, 0, 0, 128], [127, 127, 127]),
        ] {
            let mut bytes = Vec::new();
            Encoder::new(&mut bytes, 100)
                .encode(&numbers.repeat(9 * 5), 9, 5, colours)
                .unwrap();
            let encoded = Encoded::open(&bytes).unwrap();
            assert_eq!(encoded.size(), [9, 5]);
            let pixels = encoded.decode().unwrap().rgba8();
            assert_eq!(pixels.len(), 45);
            for [r, g, b, a] in pixels {
                let near = |x: u8, y: u8| x.abs_diff(y) <= 2;
                let [er, eg, eb] = expected;
                assert!(
                    near(r, er) && near(g, eg) && near(b, eb) && a == 255,
                    "{:?} for {expected:?}",
                    [r, g, b]
                );
            }
        }
    }

    #[test]
    fn claims_are_checked_before_memory_is_taken() {
        let mut bytes = png_row(
            1,
            png::ColorType::Rgb,
            png::BitDepth::Eight,
            &[],
            &[1, 2, 3],
        );
        // Width and height, and the checksum of the header.
        bytes[16..24].copy_from_slice(&[0, 0, 255, 255, 0, 0, 255, 255]);
        let mut crc = flate2::Crc::new();
        crc.update(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.sum().to_be_bytes());
        let expected = Refusal::Claim(65535, 65535, bytes.len());
        assert_eq!(Encoded::open(&bytes).err(), Some(expected));
        assert_eq!(Encoded::open(b"GIF89a").err(), Some(Refusal::Unknown));
        for magic in [PNG_MAGIC, JPEG_MAGIC] {
            let refusal = Encoded::open(magic).err();
            assert!(matches!(refusal, Some(Refusal::Damaged(_))), "{refusal:?}");
        }
    }
}
