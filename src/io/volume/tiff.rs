//! Reads stacks of images in TIFF (`.tif`, `.tiff`), with the crate `tiff`.
//!
//! Pages of one size are the layers of a volume, the first at z = 0; columns are along x, rows along y. ImageJ
//! writes more in the description of the first page, as lines of `key=value`. There are `channels` pages for
//! each of `slices` layers, `frames` times; `spacing` is the distance of layers in the unit (`unit`) whose
//! pixels per unit are the resolution. Other resolutions are for prints, and are left out.
//!
//! <https://www.itu.int/itudoc/itu-t/com16/tiff-fx/docs/tiff6.pdf>

use std::io::Cursor;
use std::path::Path;

use glam::DVec3;
use tiff::ColorType;
use tiff::decoder::{Decoder, Limits, ifd::Value};
use tiff::tags::Tag;

use super::voxels;
use crate::data::dataset::{Dataset, Field, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::io::cloud::DAMAGED;
use crate::scene::Values;

/// Greatest number of bytes that LZW makes from one byte; deflate makes fewer.
const RATIO: u64 = 2048;

/// Buffer for a strip or tile being unpacked, in bytes.
const INTERMEDIATE: usize = 1 << 25;

type Pages<'a> = Decoder<Cursor<&'a [u8]>>;

/// Whether a file begins as TIFF or BigTIFF, in either byte order.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    [&b"II*\0"[..], b"MM\0*", b"II+\0", b"MM\0+"]
        .iter()
        .any(|magic| head.starts_with(magic))
}

/// Reads a stack, or one image as a layer.
///
/// # Errors
/// Faults that the crate finds; pages whose bytes are missing; pixels that are indices or the like, not
/// numbers.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let fault = |e: tiff::TiffError| damaged(path, &e);
    let mut limits = Limits::default();
    // The crate uses this limit for lists of tags, which take eight bytes in memory for each byte of the file;
    // pixels have their own buffer here.
    limits.decoding_buffer_size = bytes.len().saturating_mul(8);
    limits.ifd_value_size = bytes.len();
    limits.intermediate_buffer_size = bytes.len().max(INTERMEDIATE);
    // The decoder applies limits only after it has read the first directory, and prints to standard error if
    // they are exceeded.
    if has_long_lists(&bytes) {
        let expected = "lists of tags that are no longer than the file";
        let found = "a longer one";
        return Err(Error::format(path, "pages", expected, found, DAMAGED));
    }
    let pages = Decoder::new(Cursor::new(&*bytes)).map_err(fault)?;
    let mut pages = pages.with_limits(limits);
    let description = pages.get_tag(Tag::ImageDescription).ok();
    let image_j = description
        .and_then(|value| value.into_string().ok())
        .filter(|text| text.starts_with("ImageJ="))
        .map(|text| ImageJ::of(&text))
        .unwrap_or_default();
    let [x, y] = [Tag::XResolution, Tag::YResolution].map(|tag| step(&mut pages, tag, &image_j));

    let mut left = bytes.len() as u64;
    let first = Page::of(path, &mut pages)?;
    let mut channels: Vec<Vec<Option<Values>>> = Vec::new();
    let (mut layers, mut others, mut later) = (0, 0, 0);
    for number in 0.. {
        if number > 0 {
            if !pages.more_images() {
                break;
            }
            pages.next_image().map_err(fault)?;
        }
        if Page::of(path, &mut pages)? != first {
            others += 1;
            continue;
        }
        let (channel, layer) = (layers % image_j.channels, layers / image_j.channels);
        layers += 1;
        if image_j.slices.is_some_and(|slices| layer >= slices) {
            later += 1;
            continue;
        }
        if channels.len() <= channel {
            channels.push(vec![None; first.samples]);
        }
        let numbers = first.numbers(path, &mut pages, &mut left)?;
        for (all, more) in channels[channel].iter_mut().zip(numbers) {
            voxels::append(all, more);
        }
    }
    let of_channel = |channel: Vec<Option<Values>>| channel.into_iter().flatten().collect();
    let channels: Vec<Vec<Values>> = channels.into_iter().map(of_channel).collect();
    let [width, height] = first.size;
    let area = width * height;
    let depth = channels[0][0].len() / area;
    if channels.iter().flatten().any(|c| c.len() != area * depth) {
        let expected = format!("{} pages for each layer", image_j.channels);
        let found = format!("{layers} pages");
        return Err(Error::format(path, "pages", expected, found, DAMAGED));
    }
    if let Some(slices) = image_j.slices.filter(|slices| *slices > depth) {
        let expected = format!("{slices} layers, as ImageJ's description says");
        let found = format!("{depth} in pages of their own");
        let advice = "save it as a series of images, or as NRRD";
        return Err(Error::format(path, "pages", expected, found, advice));
    }
    let mut notes = Vec::new();
    if others > 0 {
        notes.push(format!(
            "{others} pages of another size or type than the first are left out."
        ));
    }
    if later > 0 {
        notes.push(format!(
            "The first time: {later} pages of later ones are left out."
        ));
    }
    let z = DVec3::Z * image_j.spacing.unwrap_or(x);
    let steps = [DVec3::X * x, DVec3::Y * y, z];
    let given = if depth > 1 { &steps[..] } else { &steps[..2] };
    let dims = [width, height, depth];
    let lattice = voxels::lattice(path, "resolution", dims, DVec3::ZERO, given)?;
    Ok(Dataset {
        notes,
        ..Dataset::new(
            path,
            "TIFF stack",
            Geometry::Lattice(lattice),
            fields(channels),
        )
    })
}

/// Whether a directory's entry has more numbers than the file has bytes, or all directories together have more
/// entries.
///
/// | | TIFF | BigTIFF |
/// |---|---|---|
/// | offset of the first directory | u32 at byte 4 | u64 at byte 8 |
/// | number of its entries | u16 | u64 |
/// | an entry: tag u16, type u16, count, value | count u32, 12 bytes in all | count u64, 20 bytes in all |
/// | after them, offset of the next directory, 0 for none | u32 | u64 |
pub(in crate::io) fn has_long_lists(bytes: &[u8]) -> bool {
    let is_big_endian = bytes.starts_with(b"MM");
    let number = |at: usize, len: usize| {
        let part = bytes.get(at..at.checked_add(len)?)?;
        let digit = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(match is_big_endian {
            true => part.iter().fold(0, digit),
            false => part.iter().rev().fold(0, digit),
        })
    };
    let is_big = number(2, 2) == Some(43);
    let (place, width, counted, entry) = if is_big { (8, 8, 8, 20) } else { (4, 4, 2, 12) };
    let directory = |at: usize| {
        let next = number(at, width).and_then(|next| usize::try_from(next).ok());
        next.filter(|next| *next > 0)
    };
    let mut left = bytes.len();
    let mut next = directory(place);
    while let Some((start, count)) = next.and_then(|at| Some((at, number(at, counted)?))) {
        let mut at = start.saturating_add(counted);
        for _ in 0..count {
            let Some(numbers) = number(at.saturating_add(4), width) else {
                return false;
            };
            if numbers > bytes.len() as u64 || left == 0 {
                return true;
            }
            left -= 1;
            at = at.saturating_add(entry);
        }
        // A directory without entries may lead back to itself.
        left = left.saturating_sub(1);
        next = directory(at).filter(|_| left > 0);
    }
    false
}

fn fields(channels: Vec<Vec<Values>>) -> Vec<Field> {
    let count = channels.len();
    let name = |i: usize| match count {
        1 => "value".to_owned(),
        _ => format!("channel {}", i + 1),
    };
    let numbered = channels.into_iter().enumerate();
    numbered
        .map(|(i, components)| voxels::field(&name(i), components, None))
        .collect()
}

fn damaged(path: &Path, error: &tiff::TiffError) -> Error {
    let expected = "what TIFF allows and is read";
    Error::format(path, "pages", expected, error.to_string(), DAMAGED)
}

/// ImageJ's description of a stack.
struct ImageJ {
    is_stated: bool,
    channels: usize,
    slices: Option<usize>,
    spacing: Option<f64>,
}

impl Default for ImageJ {
    fn default() -> Self {
        Self {
            is_stated: false,
            channels: 1,
            slices: None,
            spacing: None,
        }
    }
}

impl ImageJ {
    fn of(text: &str) -> Self {
        let get = |key: &str| {
            let mut lines = text.lines().filter_map(|line| line.split_once('='));
            lines.find(|(name, _)| *name == key).map(|(_, value)| value)
        };
        let count = |key: &str| {
            let count = get(key).and_then(|text| text.parse().ok());
            count.filter(|n: &usize| *n > 0)
        };
        let channels = count("channels").unwrap_or(1);
        let frames = count("frames").unwrap_or(1);
        // Without hyperstacks all pages are layers.
        let all = count("images").map(|n| (n / channels / frames).max(1));
        let spacing = get("spacing").and_then(|text| text.parse().ok());
        Self {
            is_stated: true,
            channels,
            slices: count("slices").or(all),
            spacing: spacing.filter(|x: &f64| x.is_finite() && *x > 0.0),
        }
    }
}

/// The distance of pixels; 1 if only a print's is stated.
fn step(pages: &mut Pages<'_>, tag: Tag, image_j: &ImageJ) -> f64 {
    let resolution = match pages.get_tag(tag) {
        Ok(Value::Rational(pixels, units)) if image_j.is_stated => {
            f64::from(units) / f64::from(pixels)
        }
        _ => 1.0,
    };
    if resolution.is_finite() && resolution > 0.0 {
        resolution
    } else {
        1.0
    }
}

/// The properties that pages of one stack share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Page {
    size: [usize; 2],
    samples: usize,
    scalar: ScalarType,
}

impl Page {
    fn of(path: &Path, pages: &mut Pages<'_>) -> Result<Self> {
        let fault = |e: tiff::TiffError| damaged(path, &e);
        let (width, height) = pages.dimensions().map_err(fault)?;
        let colours = pages.colortype().map_err(fault)?;
        let samples = match colours {
            ColorType::Gray(8..) => 1,
            ColorType::GrayA(8..) => 2,
            ColorType::RGB(8..) => 3,
            ColorType::RGBA(8..) => 4,
            ColorType::Multiband {
                num_samples,
                bit_depth: 8..,
            } => num_samples.into(),
            other => {
                let expected = "grey values or red, green and blue of 8 bits and more";
                let found = format!("{other:?}");
                let advice = "save it as grey values";
                return Err(Error::format(path, "pixels", expected, found, advice));
            }
        };
        let is_planar = pages.find_tag_unsigned::<u16>(Tag::PlanarConfiguration);
        if samples > 1 && is_planar.is_ok_and(|planes| planes == Some(2)) {
            let expected = "the colours of a pixel beside each other";
            let found = "planes of each, which are not read";
            let advice = "save it with interleaved pixels";
            return Err(Error::format(path, "pixels", expected, found, advice));
        }
        let format = pages.find_tag_unsigned_vec::<u16>(Tag::SampleFormat);
        let format = format.ok().flatten().and_then(|all| all.first().copied());
        let scalar = match (format.unwrap_or(1), colours.bit_depth()) {
            (1, 8) => ScalarType::U8,
            (1, 16) => ScalarType::U16,
            (1, 32) => ScalarType::U32,
            (1, 64) => ScalarType::U64,
            (2, 8) => ScalarType::I8,
            (2, 16) => ScalarType::I16,
            (2, 32) => ScalarType::I32,
            (2, 64) => ScalarType::I64,
            (3, 32) => ScalarType::F32,
            (3, 64) => ScalarType::F64,
            (format, bits) => {
                let expected = "integers of 8 to 64 bits, floats of 32 or 64";
                let found = format!("{bits} bits of sample format {format}");
                let advice = "save it as 16-bit integers or 32-bit floats";
                return Err(Error::format(path, "pixels", expected, found, advice));
            }
        };
        Ok(Self {
            size: [width as usize, height as usize],
            samples,
            scalar,
        })
    }

    /// The numbers of the decoder's current page, by components.
    ///
    /// - `left`: number of the file's bytes that no page has used yet.
    fn numbers(&self, path: &Path, pages: &mut Pages<'_>, left: &mut u64) -> Result<Vec<Values>> {
        let fault = |e: tiff::TiffError| damaged(path, &e);
        let counts = [Tag::StripByteCounts, Tag::TileByteCounts].map(|tag| {
            let counts = pages.find_tag_unsigned_vec::<u64>(tag).ok().flatten();
            let counts = counts.unwrap_or_default();
            counts.into_iter().fold(0, u64::saturating_add)
        });
        let packed = counts[0].saturating_add(counts[1]);
        let is_packed = pages.find_tag_unsigned::<u16>(Tag::Compression);
        let ratio = match is_packed {
            Ok(None | Some(1)) => 1,
            _ => RATIO,
        };
        let depth = self.scalar.size() as u64;
        let [width, height] = self.size.map(|n| n as u64);
        let wanted = [height, self.samples as u64, depth]
            .into_iter()
            .try_fold(width, u64::checked_mul)
            .filter(|n| *n > 0 && *n <= packed.saturating_mul(ratio));
        let rest = left.checked_sub(packed);
        let wanted = wanted.and_then(|n| usize::try_from(n).ok());
        let (Some(wanted), Some(rest)) = (wanted, rest) else {
            let expected = format!("bytes for {width} x {height} pixels");
            let found = format!("{packed} of {left} bytes");
            return Err(Error::format(path, "pages", expected, found, DAMAGED));
        };
        *left = rest;
        let layout = pages.image_buffer_layout().map_err(fault)?;
        if layout.complete_len != wanted {
            let expected = format!("{wanted} bytes of pixels");
            let found = layout.complete_len.to_string();
            return Err(Error::format(path, "pages", expected, found, DAMAGED));
        }
        let mut pixels = vec![0; wanted];
        pages.read_image_bytes(&mut pixels).map_err(fault)?;
        let encoding = Encoding {
            scalar: self.scalar,
            big_endian: cfg!(target_endian = "big"),
        };
        let component = |i: usize| {
            let stride = Stride {
                first: i * self.scalar.size(),
                step: self.samples * self.scalar.size(),
                count: self.size[0] * self.size[1],
            };
            values(&pixels, encoding, stride)
        };
        let components: Option<Vec<Values>> = (0..self.samples).map(component).collect();
        components.ok_or_else(|| Error::format(path, "pages", "pixels", "none", DAMAGED))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_longer_than_the_file_are_seen_before_they_are_read() {
        // One entry: tag 273, of type 4, `count` numbers, at byte 8.
        let file = |count: u32| {
            let mut bytes = b"II\x2a\0\x08\0\0\0\x01\0\x11\x01\x04\0".to_vec();
            bytes.extend(count.to_le_bytes());
            bytes.extend([8, 0, 0, 0, 0, 0, 0, 0]);
            bytes
        };
        assert!(!has_long_lists(&file(2)));
        assert!(has_long_lists(&file(0x8000_0000)));
        // Its next directory is the one after it; and one that leads to itself, without entries, ends.
        let mut second = file(2);
        second[22] = 26;
        second.extend(&file(u32::MAX)[8..]);
        assert!(has_long_lists(&second));
        assert!(!has_long_lists(b"II\x2a\0\x08\0\0\0\0\0\x08\0\0\0"));
        let mut big = b"MM\0\x2b\0\x08\0\0\0\0\0\0\0\0\0\x10".to_vec();
        big.extend([0, 0, 0, 0, 0, 0, 0, 1, 1, 17, 0, 4, 0, 0, 1, 0, 0, 0, 0, 0]);
        assert!(has_long_lists(&big));
        assert!(!has_long_lists(&big[..20]));
        assert!(!has_long_lists(b"II"));
    }
}
