//! Decodes KTX 2 images in Basis Universal's codecs ETC1S and UASTC, which `KHR_texture_basisu` uses; little-endian.
//!
//! | bytes | contents |
//! |---|---|
//! | 0..12 | `«KTX 20»\r\n\x1a\n` |
//! | 12..48 | format (0), size of a type (1), width, height, depth (0), layers, faces, levels, compression of levels: 0 none, 1 ETC1S, 2 zstd |
//! | 48..80 | offsets and lengths of the description, the keys and the global data |
//! | 80.. | for each level from the largest on: its offset, its length, its unpacked length |
//! | description | 44 bytes, or 60 with a second sample; byte 12 is the codec: 163 ETC1S, 166 UASTC |
//! | global data, of ETC1S | 20 bytes with the lengths of three tables, 20 for each image, the tables |
//!
//! Only the largest level is decoded. The decoder does not check sizes. So this module writes the level into a new file
//! with its own offsets and lengths, and passes that to the decoder.
//!
//! Source: the KTX File Format Specification 2.0 and the crate `basisu`.

use std::io::Read;

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use ruzstd::decoding::StreamingDecoder;

/// First bytes of a file.
const MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
const HEADER: usize = 80;
const LEVEL: usize = 24;
const ETC1S: u8 = 163;
const UASTC: u8 = 166;
/// Length of the start of ETC1S's global data, and of each image's entry in them.
const TABLES: usize = 20;
const IMAGE: usize = 20;

/// Greatest number of blocks of 16 pixels in ETC1S, for any file and for each byte. Runs of equal blocks need no bits.
const BLOCKS_OF_NOTHING: u64 = 1 << 16;
const BLOCKS_PER_BYTE: u64 = 64;

/// Image whose header is consistent.
pub(in crate::io) struct Ktx2 {
    /// Width and height, pixels.
    pub(in crate::io) size: [usize; 2],
    /// File with only the largest level.
    file: Vec<u8>,
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Returns the bytes that a 64-bit offset and length state.
fn stretch(bytes: &[u8], at: usize) -> Option<&[u8]> {
    let long = |at: usize| {
        let number = u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?);
        usize::try_from(number).ok()
    };
    let (start, length) = (long(at)?, long(at + 8)?);
    bytes.get(start..start.checked_add(length)?)
}

impl Ktx2 {
    /// # Errors
    /// The fault of the file, as a phrase.
    pub(in crate::io) fn of(bytes: &[u8]) -> Result<Self, &'static str> {
        let cut = "it is cut off";
        let number = |at: usize| word(bytes, at).ok_or(cut);
        let [width, height] = [number(20)?, number(24)?];
        let plain = [number(12)?, number(16)?, number(28)?] == [0, 1, 0];
        if !plain || width == 0 || height == 0 {
            return Err("no picture of two dimensions in Basis Universal's codes");
        }
        let images = number(32)?
            .max(1)
            .checked_mul(number(36)?.max(1))
            .and_then(|n| n.checked_mul(number(40).ok()?.max(1)))
            .and_then(|n| usize::try_from(n).ok());
        let scheme = number(44)?;
        let start = number(48)? as usize;
        let description = bytes.get(start..start.saturating_add(number(52)? as usize));
        let description = description.filter(|d| matches!(d.len(), 44 | 60));
        let description = description.ok_or("no description of its pixels")?;
        let level = stretch(bytes, HEADER).ok_or(cut)?;

        let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
        let (data, level) = match (description[12], scheme) {
            (ETC1S, 1) => {
                let most = BLOCKS_PER_BYTE.saturating_mul(bytes.len() as u64);
                if blocks > BLOCKS_OF_NOTHING.saturating_add(most) {
                    return Err("more pixels than its bytes can hold");
                }
                let data = stretch(bytes, 64).ok_or(cut)?;
                let images = images.ok_or("too many images")?;
                (
                    etc1s(data, level, images, description.len() == 60)?,
                    level.to_vec(),
                )
            }
            (UASTC, 0 | 2) => {
                let expected = blocks.checked_mul(16).ok_or("too many pixels")?;
                // Images compress to no less than a thousandth.
                if expected > 1024 * (level.len() as u64) {
                    return Err("more pixels than its bytes can hold");
                }
                (Vec::new(), uastc(level, scheme, expected)?)
            }
            _ => return Err("in another code than ETC1S and UASTC"),
        };
        let file = file_of([width, height], description, &data, &level);
        Ok(Self {
            size: [width as usize, height as usize],
            file: file.ok_or("it is too large")?,
        })
    }

    /// Returns the pixels.
    ///
    /// # Errors
    /// The decoder refuses a block.
    pub(in crate::io) fn decode(&self) -> Result<Vec<u8>, &'static str> {
        let damaged = |_| "the decoder refuses its blocks";
        let decoder = Transcoder::new(&self.file).map_err(damaged)?;
        let pixels = decoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
        pixels.map_err(damaged)
    }
}

/// Returns the global data with the entry of the first image only. The image must lie within its level.
fn etc1s(
    data: &[u8],
    level: &[u8],
    images: usize,
    has_alpha: bool,
) -> Result<Vec<u8>, &'static str> {
    let wrong = "its tables are not where it says";
    let number = |at: usize| word(data, at).map(|n| n as usize);
    let (tables, image) = (data.get(..TABLES), data.get(TABLES..TABLES + IMAGE));
    let (tables, image) = tables.zip(image).ok_or(wrong)?;
    let rest = images
        .checked_mul(IMAGE)
        .and_then(|length| data.get(TABLES.checked_add(length)?..));
    let rest = rest.ok_or(wrong)?;
    let lengths = [4, 8, 12].map(|at| number(at).unwrap_or(usize::MAX));
    let all = lengths.into_iter().try_fold(0_usize, usize::checked_add);
    let rest = all.and_then(|all| rest.get(..all)).ok_or(wrong)?;
    // In films, frames depend on the frame before.
    if number(TABLES).is_some_and(|flags| flags & 2 != 0) {
        return Err("it is a film");
    }
    for part in [4, 12].into_iter().take(if has_alpha { 2 } else { 1 }) {
        let start = number(TABLES + part);
        let length = number(TABLES + part + 4);
        let end = start.zip(length).and_then(|(a, b)| a.checked_add(b));
        if end.is_none_or(|end| end > level.len()) {
            return Err(wrong);
        }
    }
    Ok([tables, image, rest].concat())
}

/// Returns exactly `expected` bytes of unpacked blocks.
fn uastc(level: &[u8], scheme: u32, expected: u64) -> Result<Vec<u8>, &'static str> {
    let mut blocks = Vec::new();
    if scheme == 0 {
        blocks.extend(level);
    } else {
        let damaged = "its zstd stream is damaged";
        let stream = StreamingDecoder::new(level).map_err(|_| damaged)?;
        let mut stream = stream.take(expected);
        stream.read_to_end(&mut blocks).map_err(|_| damaged)?;
    }
    match blocks.len() as u64 == expected {
        true => Ok(blocks),
        false => Err("it holds another number of blocks than of pixels"),
    }
}

/// Returns a file with one image.
fn file_of(size: [u32; 2], description: &[u8], data: &[u8], level: &[u8]) -> Option<Vec<u8>> {
    let described = HEADER + LEVEL;
    let data_at = described + description.len();
    let level_at = data_at + data.len();
    let words = [
        0,
        1,
        size[0],
        size[1],
        0,
        0,
        1,
        1,
        u32::from(!data.is_empty()),
    ];
    let short = |n: usize| u32::try_from(n).ok();
    let index = [short(described)?, short(description.len())?, 0, 0];
    let data_at = if data.is_empty() { 0 } else { data_at };
    // ETC1S files state no unpacked length.
    let unpacked = if data.is_empty() { level.len() } else { 0 };
    let long = [data_at, data.len(), level_at, level.len(), unpacked];
    let mut file = MAGIC.to_vec();
    file.extend(words.iter().chain(&index).flat_map(|n| n.to_le_bytes()));
    file.extend(long.iter().flat_map(|n| (*n as u64).to_le_bytes()));
    file.extend([description, data, level].concat());
    Some(file)
}
