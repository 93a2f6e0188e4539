//! Writes deep images as OpenEXR 2 files: one part of deep scan lines, each compressed by zlib.
//!
//! | part of the file | contents |
//! |---|---|
//! | magic, version | 20000630; 2 with the bit of deep data |
//! | attributes | name, type, size and value of each; a zero byte ends them |
//! | table | the place of each scan line's chunk |
//! | chunk | y, three sizes, the running counts of samples, the samples channel by channel |
//!
//! Source: "OpenEXR File Layout", and the classes of its reference implementation for zlib's predictor.

#![allow(
    clippy::cast_possible_truncation,
    reason = "sizes of images are checked, and a pixel has few samples"
)]

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::image_file::{check_path, check_size, unknown_extension};
use crate::error::{Error, Result};
use crate::image::{DeepImage, DeepSample};
use crate::io::bytes::atomic::write_bytes_atomically;
use crate::io::bytes::file::extension;

/// Name of a channel, and its number of a sample.
type Channel = (&'static str, fn(&DeepSample) -> f32);

/// Channels in the file's order.
const CHANNELS: [Channel; 6] = [
    ("A", |sample| sample.rgba[3]),
    ("B", |sample| sample.rgba[2]),
    ("G", |sample| sample.rgba[1]),
    ("R", |sample| sample.rgba[0]),
    ("Z", |sample| sample.front),
    ("ZBack", |sample| sample.back),
];

/// Checks, before an image is computed, that [`write_deep`] could write to `path`.
///
/// # Errors
/// The extension is another, or the folder is missing.
pub fn check_deep_path(path: &Path) -> Result<()> {
    check_path(path, "exr")
}

/// Writes a deep image: `exr`, with the channels A, B, G, R (f32, premultiplied), Z and ZBack (camera-space z).
///
/// # Errors
/// The extension is another, the image has no pixels or more than the format allows, or the file cannot be written.
pub fn write_deep(path: &Path, image: &DeepImage) -> Result<()> {
    if extension(path) != "exr" {
        return Err(unknown_extension(path, "exr"));
    }
    let pixels = image.firsts.len().saturating_sub(1);
    check_size(path, image.width, image.height, pixels)?;
    let chunks = (0..image.height).map(|y| chunk(path, image, y));
    let chunks = chunks.collect::<Result<Vec<_>>>()?;
    let mut bytes = header(image);
    let table = bytes.len() + 8 * chunks.len();
    let mut place = table as u64;
    for chunk in &chunks {
        bytes.extend(place.to_le_bytes());
        place += chunk.len() as u64;
    }
    bytes.extend(chunks.iter().flatten());
    write_bytes_atomically(path, &bytes)
}

fn header(image: &DeepImage) -> Vec<u8> {
    const DEEP: u32 = 0x800;
    const FLOAT: u32 = 2;
    const ZIPS: u8 = 2;
    let mut bytes = 20_000_630_u32.to_le_bytes().to_vec();
    bytes.extend((2 | DEEP).to_le_bytes());
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        for text in [name, kind] {
            bytes.extend(text.as_bytes());
            bytes.push(0);
        }
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    };
    let mut channels = Vec::new();
    for (name, _) in CHANNELS {
        channels.extend(name.as_bytes());
        channels.push(0);
        // Type, linearity with three bytes that are reserved, and one sample for each pixel.
        for word in [FLOAT, 0, 1, 1] {
            channels.extend(word.to_le_bytes());
        }
    }
    channels.push(0);
    let window = [0, 0, image.width as u32 - 1, image.height as u32 - 1];
    let window: Vec<u8> = window.into_iter().flat_map(u32::to_le_bytes).collect();
    let most = image.firsts.windows(2).map(|pair| pair[1] - pair[0]);
    let most = most.max().unwrap_or(0) as u32;
    attribute("channels", "chlist", &channels);
    attribute("chunkCount", "int", &(image.height as u32).to_le_bytes());
    attribute("compression", "compression", &[ZIPS]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("maxSamplesPerPixel", "int", &most.to_le_bytes());
    attribute("pixelAspectRatio", "float", &1.0_f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1.0_f32.to_le_bytes());
    attribute("type", "string", b"deepscanline");
    attribute("version", "int", &1_u32.to_le_bytes());
    bytes.push(0);
    bytes
}

/// Returns the chunk of a row of pixels.
fn chunk(path: &Path, image: &DeepImage, y: usize) -> Result<Vec<u8>> {
    let firsts = &image.firsts[y * image.width..=(y + 1) * image.width];
    let row = &image.samples[firsts[0]..firsts[image.width]];
    let counts = firsts[1..].iter().map(|end| (end - firsts[0]) as u32);
    let counts: Vec<u8> = counts.flat_map(u32::to_le_bytes).collect();
    let channel = |(_, of): Channel| row.iter().map(of);
    let samples = CHANNELS.into_iter().flat_map(channel);
    let samples: Vec<u8> = samples.flat_map(f32::to_le_bytes).collect();
    let unpacked = samples.len() as u64;
    let [counts, samples] = [counts, samples].map(|bytes| packed(path, bytes));
    let (counts, samples) = (counts?, samples?);
    let mut bytes = (y as u32).to_le_bytes().to_vec();
    for size in [counts.len() as u64, samples.len() as u64, unpacked] {
        bytes.extend(size.to_le_bytes());
    }
    bytes.extend(counts);
    bytes.extend(samples);
    Ok(bytes)
}

/// Packs bytes: those at even places before those at odd ones, each as its difference from the one before, by zlib. They
/// are stored as they are if that is no shorter.
fn packed(path: &Path, bytes: Vec<u8>) -> Result<Vec<u8>> {
    let (even, odd) = (bytes.iter().step_by(2), bytes.iter().skip(1).step_by(2));
    let mut before = 0_u8;
    let difference = |(i, byte): (usize, &u8)| {
        let own = match i {
            0 => *byte,
            _ => byte.wrapping_sub(before).wrapping_add(128),
        };
        before = *byte;
        own
    };
    let differences: Vec<u8> = even.chain(odd).enumerate().map(difference).collect();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let written = encoder
        .write_all(&differences)
        .and_then(|()| encoder.finish());
    let packed = written.map_err(|e| Error::io(path, "packing", e, "free some memory"))?;
    Ok(match packed.len() < bytes.len() {
        true => packed,
        false => bytes,
    })
}
