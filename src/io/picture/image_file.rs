//! Reads and writes image files; the extension chooses the format.
//!
//! | extension | numbers | colour |
//! |---|---|---|
//! | `.png` | 8-bit RGBA (RGB if all pixels are opaque) | sRGB, straight alpha |
//! | `.exr` | f32 R, G, B, A; depth: Z | linear, premultiplied |
//! | `.pfm` | f32 RGB, little-endian, rows from the bottom; depth: one channel | linear, over black |
//! | `.npy` | f32 (height, width, 4); depth: (height, width) | linear, premultiplied |
//!
//! A PFM file begins with the lines `PF` (colour) or `Pf` (grey), `width height`, and a scale. The sign of the scale
//! gives the byte order (negative: little-endian). The numbers follow.

use std::io::Cursor;
use std::path::Path;

use ::exr::block;
use ::exr::meta::header::Header;
use ::exr::prelude as exr;
use exr::{
    Encoding as ExrEncoding, ReadChannels, ReadLayers, ReadSpecificChannel, SpecificChannels,
    WritableImage,
};

use super::provenance::{KEYWORD, exr_attribute};
use super::samples::{Encoded, Refusal, png_file};
use crate::error::{Error, Result};
use crate::image::{DepthImage, Image, NormalImage, linear_from_srgb};
use crate::io::bytes::atomic::write_bytes_atomically;
use crate::io::bytes::file::extension;
use crate::io::bytes::file::read_all;
use crate::io::bytes::scalars::{Encoding, ScalarType, Stride, values};
use crate::io::particles::npy;
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::vtk::xml::clip;

/// Extensions that [`write_image`] writes.
pub(in crate::io) const IMAGE_EXTENSIONS: &str = "png, exr, pfm or npy";
/// Extensions that [`write_depth`] and [`write_normals`] write.
const DEPTH_EXTENSIONS: &str = "exr, pfm or npy";

/// Checks, before an image is computed, that [`write_image`] could write to `path`.
///
/// # Errors
/// The extension is unknown or the folder is missing.
pub fn check_image_path(path: &Path) -> Result<()> {
    check_path(path, IMAGE_EXTENSIONS)
}

/// Checks, before an image is computed, that [`write_depth`] and [`write_normals`] could write to `path`.
///
/// # Errors
/// The extension is unknown or the folder is missing.
pub fn check_depth_path(path: &Path) -> Result<()> {
    check_path(path, DEPTH_EXTENSIONS)
}

pub(in crate::io) fn check_path(path: &Path, known: &str) -> Result<()> {
    let extension = extension(path);
    if !known
        .split([',', ' '])
        .any(|k| k == extension && k != "or" && !k.is_empty())
    {
        return Err(unknown_extension(path, known));
    }
    check_folder(path)
}

/// Checks that the folder of a file exists, before the file's contents are computed.
///
/// # Errors
/// The folder is missing.
pub fn check_folder(path: &Path) -> Result<()> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => Err(Error::format(
            path,
            "writing",
            "an existing folder",
            format!("no folder `{}`", folder.display()),
            "create it first",
        )),
        _ => Ok(()),
    }
}

/// Writes an image in the format that the extension names: `png`, `exr`, `pfm` or `npy`.
///
/// Alpha is stored except in `pfm`, which shows the image over black. A `png` has an alpha channel unless the image is
/// opaque.
///
/// # Errors
/// The extension is unknown, or the image has no pixels; the errors of
/// [`write_bytes_atomically`](crate::io::write_bytes_atomically).
pub fn write_image(path: &Path, image: &Image) -> Result<()> {
    write_image_with(path, image, None)
}

/// Writes an image as [`write_image`] does, with a record of how it was made if the format has a place for it.
///
/// - `record`: JSON in ASCII.
pub(crate) fn write_image_with(path: &Path, image: &Image, record: Option<&str>) -> Result<()> {
    check_size(path, image.width, image.height, image.pixels.len())?;
    let bytes = match extension(path).as_str() {
        "png" => png_bytes_with(path, image, record)?,
        "exr" => exr_bytes(path, image, record)?,
        "pfm" => {
            let rows = image.pixels.chunks(image.width).rev();
            pfm_bytes(
                "PF",
                image.width,
                image.height,
                rows.flatten().flat_map(|p| &p[..3]),
            )
        }
        "npy" => npy_bytes(
            &[image.height, image.width, 4],
            image.pixels.iter().flatten().copied(),
        ),
        _ => return Err(unknown_extension(path, IMAGE_EXTENSIONS)),
    };
    write_bytes_atomically(path, &bytes)
}

/// Writes a depth image in the format that the extension names: `exr` (channel Z), `pfm` or `npy`.
///
/// # Errors
/// The errors of [`write_image`].
pub fn write_depth(path: &Path, depth: &DepthImage) -> Result<()> {
    let (width, height) = (depth.width, depth.height);
    check_size(path, width, height, depth.depths.len())?;
    let names = ["Z", "depth"];
    let bytes = grey_bytes(path, [width, height], &depth.depths, names, None)
        .ok_or_else(|| unknown_extension(path, DEPTH_EXTENSIONS))??;
    write_bytes_atomically(path, &bytes)
}

/// Writes normals in the format that the extension names: `exr` (channels X, Y and Z of the layer
/// `normals`), `pfm` (as colours) or `npy` (height, width, 3).
///
/// # Errors
/// The errors of [`write_image`].
pub fn write_normals(path: &Path, normals: &NormalImage) -> Result<()> {
    let (width, height) = (normals.width, normals.height);
    check_size(path, width, height, normals.normals.len())?;
    let bytes = match extension(path).as_str() {
        "exr" => {
            let at = |at: exr::Vec2<usize>| normals.normals[at.y() * width + at.x()];
            let channels = SpecificChannels::build()
                .with_channel("X")
                .with_channel("Y")
                .with_channel("Z")
                .with_pixel_fn(|pixel| {
                    let [x, y, z] = at(pixel);
                    (x, y, z)
                });
            let layer = exr::Layer::new(
                (width, height),
                exr::LayerAttributes::named("normals"),
                ExrEncoding::FAST_LOSSLESS,
                channels,
            );
            let mut bytes = Vec::new();
            exr::Image::from_layer(layer)
                .write()
                .non_parallel()
                .to_buffered(Cursor::new(&mut bytes))
                .map_err(|e| encoding_failed(path, &e))?;
            bytes
        }
        "pfm" => {
            let rows = normals.normals.chunks(width).rev();
            pfm_bytes("PF", width, height, rows.flatten().flatten())
        }
        "npy" => {
            let values = normals.normals.iter().flatten().copied();
            npy_bytes(&[height, width, 3], values)
        }
        _ => return Err(unknown_extension(path, DEPTH_EXTENSIONS)),
    };
    write_bytes_atomically(path, &bytes)
}

/// Returns the bytes of a file with one f32 per pixel. The extension of `path` chooses `exr`, `pfm` or `npy`; `None`
/// for others.
///
/// - `names`: those of the channel and the layer.
/// - `record`: record of how the picture was made, for `exr`.
pub(in crate::io) fn grey_bytes(
    path: &Path,
    [width, height]: [usize; 2],
    values: &[f32],
    [channel, layer]: [&str; 2],
    record: Option<&str>,
) -> Option<Result<Vec<u8>>> {
    match extension(path).as_str() {
        "exr" => {
            let channels = SpecificChannels::build()
                .with_channel(channel)
                .with_pixel_fn(|at: exr::Vec2<usize>| (values[at.y() * width + at.x()],));
            let layer = exr::Layer::new(
                (width, height),
                exr::LayerAttributes::named(layer),
                ExrEncoding::FAST_LOSSLESS,
                channels,
            );
            let mut bytes = Vec::new();
            let written = with_record(exr::Image::from_layer(layer), record)
                .write()
                .non_parallel()
                .to_buffered(Cursor::new(&mut bytes));
            Some(match written {
                Ok(()) => Ok(bytes),
                Err(e) => Err(encoding_failed(path, &e)),
            })
        }
        "pfm" => {
            let rows = values.chunks(width).rev().flatten();
            Some(Ok(pfm_bytes("Pf", width, height, rows)))
        }
        "npy" => Some(Ok(npy_bytes(&[height, width], values.iter().copied()))),
        _ => None,
    }
}

/// Reads an image that [`write_image`] or another program wrote: `png`, `exr`, `pfm` or `npy` (shape (height, width, 3
/// or 4)).
///
/// # Errors
/// The extension is unknown or the file is damaged.
pub fn read_image(path: &Path) -> Result<Image> {
    let extension = extension(path);
    if !matches!(extension.as_str(), "png" | "exr" | "pfm" | "npy") {
        return Err(unknown_extension(path, IMAGE_EXTENSIONS));
    }
    let bytes = read_all(path)?;
    match extension.as_str() {
        "png" => read_png(path, &bytes),
        "exr" => read_exr(path, &bytes),
        "pfm" => read_pfm(path, &bytes),
        _ => read_npy(path, &bytes),
    }
}

/// Reads depths that [`write_depth`] or another program wrote: one number a pixel. `exr` (channel `Z`, alone or of a
/// layer, or the only channel there is), `pfm` or `npy` (shape (height, width)).
///
/// # Errors
/// The extension is unknown, the file is damaged, or has no channel of depths.
pub fn read_depth(path: &Path) -> Result<DepthImage> {
    let extension = extension(path);
    if !matches!(extension.as_str(), "exr" | "pfm" | "npy") {
        return Err(unknown_extension(path, DEPTH_EXTENSIONS));
    }
    let bytes = read_all(path)?;
    match extension.as_str() {
        "exr" => read_exr_depth(path, &bytes),
        "pfm" => {
            if bytes.starts_with(b"PF") {
                return Err(damaged(path, "one number a pixel (`Pf`)", "colours (`PF`)"));
            }
            let image = read_pfm(path, &bytes)?;
            Ok(DepthImage {
                width: image.width,
                height: image.height,
                depths: image.pixels.iter().map(|pixel| pixel[0]).collect(),
            })
        }
        _ => {
            let (size, channels) = read_npy_channels(path, &bytes, [1, 1])?;
            let [width, height] = size;
            Ok(DepthImage {
                width,
                height,
                depths: channels.into_iter().flatten().collect(),
            })
        }
    }
}

/// The display window of an EXR file, as a layer's pixels lie in it.
#[derive(Debug, Clone, Copy)]
struct Window {
    offset: exr::Vec2<i32>,
    width: usize,
    height: usize,
}

impl Window {
    /// Returns the window of a layer.
    ///
    /// # Errors
    /// More pixels than the file's bytes can hold.
    fn of(path: &Path, bytes: &[u8], header: &Header) -> Result<Self> {
        let window = header.shared_attributes.display_window;
        let (width, height) = (window.size.width(), window.size.height());
        check_claim(path, bytes.len(), [width, height])?;
        Ok(Self {
            offset: header.own_attributes.layer_position - window.position,
            width,
            height,
        })
    }

    /// Returns the index of a layer's pixel in the window; `None` outside.
    fn index(&self, at: exr::Vec2<usize>) -> Option<usize> {
        let at = at.to_i32() + self.offset;
        let inside = |n: i32, count: usize| usize::try_from(n).ok().filter(|&n| n < count);
        Some(inside(at.y(), self.height)? * self.width + inside(at.x(), self.width)?)
    }
}

/// Reads the first channel of depths over the display window; nothing stands outside its layer.
fn read_exr_depth(path: &Path, bytes: &[u8]) -> Result<DepthImage> {
    let broken = |e: exr::Error| damaged(path, "an EXR image", e.to_string());
    let reader = block::read(Cursor::new(bytes), false).map_err(broken)?;
    let flat = reader.headers().iter().filter(|header| !header.deep);
    let of_header = |header| channel_of_depth(header).map(|name| (header, name));
    let Some((header, name)) = flat.clone().find_map(of_header) else {
        let channels = flat.flat_map(|header| &header.channels.list);
        let all: Vec<String> = channels.map(|channel| channel.name.to_string()).collect();
        let found = match all.is_empty() {
            true => "none that is flat".to_owned(),
            false => clip(&all.join(", ")),
        };
        return Err(damaged(path, "an EXR image with one channel Z", found));
    };
    let window = Window::of(path, bytes, header)?;
    let Window { width, height, .. } = window;
    let read = exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(name)
        .collect_pixels(
            move |_, _| vec![f32::INFINITY; width * height],
            move |depths, at, (depth,): (f32,)| {
                if let Some(i) = window.index(at) {
                    depths[i] = depth;
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_chunks(reader)
        .map_err(broken)?;
    Ok(DepthImage {
        width,
        height,
        depths: read.layer_data.channel_data.pixels,
    })
}

/// Returns the channel of depths: Z by itself; one of a layer called depth; Z of a layer; or the only channel. Vectors, which
/// have X and Y as well, are none, and of several candidates none is taken.
fn channel_of_depth(header: &Header) -> Option<exr::Text> {
    let names: Vec<String> = header
        .channels
        .list
        .iter()
        .map(|c| c.name.to_string())
        .collect();
    let has = |name: &str| names.iter().any(|own| own == name);
    let is_component = |name: &str| {
        let layer = name.strip_suffix('Z').unwrap_or(name);
        has(&format!("{layer}X")) && has(&format!("{layer}Y"))
    };
    let is_of_depth = |name: &&String| {
        let mut parts = name.split('.');
        parts.any(|part| part.eq_ignore_ascii_case("depth"))
    };
    let is_z = |name: &&String| name.ends_with(".Z") && !is_component(name);
    fn only<'a>(mut found: impl Iterator<Item = &'a String>) -> Option<&'a String> {
        found.next().filter(|_| found.next().is_none())
    }
    let plain = names
        .iter()
        .find(|name| *name == "Z" && !is_component(name));
    let found = plain
        .or_else(|| only(names.iter().filter(is_of_depth)))
        .or_else(|| only(names.iter().filter(is_z)))
        .or_else(|| only(names.iter()))?;
    Some(exr::Text::from(found.as_str()))
}

pub(in crate::io) fn check_size(
    path: &Path,
    width: usize,
    height: usize,
    count: usize,
) -> Result<()> {
    let fits = [width, height]
        .iter()
        .all(|&n| n > 0 && i32::try_from(n).is_ok());
    if fits && width.checked_mul(height) == Some(count) {
        return Ok(());
    }
    Err(Error::format(
        path,
        "image size",
        "width x height pixels, at least one",
        format!("{width} x {height} with {count} pixels"),
        "give a size of at least 1x1",
    ))
}

pub(in crate::io) fn unknown_extension(path: &Path, known: &str) -> Error {
    let found = extension(path);
    let found = if found.is_empty() {
        "none".to_owned()
    } else {
        format!("`{found}`")
    };
    Error::format(
        path,
        "file extension",
        known,
        found,
        "name the file with one of these",
    )
}

fn encoding_failed(path: &Path, error: &dyn std::fmt::Display) -> Error {
    Error::format(
        path,
        "encoding",
        "an image that the format can hold",
        error.to_string(),
        "choose another format",
    )
}

pub(super) fn damaged(path: &Path, expected: &str, found: impl Into<String>) -> Error {
    Error::format(
        path,
        "image",
        expected,
        found,
        "the file is damaged or of another format: write it again",
    )
}

/// Returns the bytes of the PNG file that [`write_image`] would write; `path` is for messages.
///
/// # Errors
/// The image has no pixels, or more than the format allows.
pub fn png_bytes(path: &Path, image: &Image) -> Result<Vec<u8>> {
    png_bytes_with(path, image, None)
}

/// As [`png_bytes`], with a record of how the picture was made.
fn png_bytes_with(path: &Path, image: &Image, record: Option<&str>) -> Result<Vec<u8>> {
    let size = [image.width, image.height].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
    let (mut channels, mut numbers) = (4, image.to_srgb8());
    if image.pixels.iter().all(|p| p[3] >= 1.0) {
        (channels, numbers) = (
            3,
            numbers
                .chunks_exact(4)
                .flat_map(|p| [p[0], p[1], p[2]])
                .collect(),
        );
    }
    let note = record.map(|record| (KEYWORD, record));
    png_file(size, channels, &numbers, note).map_err(|e| encoding_failed(path, &e))
}

/// Returns an image of one layer in EXR's memory, with a record of how it was made.
fn with_record<L>(mut image: exr::Image<L>, record: Option<&str>) -> exr::Image<L> {
    image.attributes.other.extend(exr_attribute(record));
    image
}

fn exr_bytes(path: &Path, image: &Image, record: Option<&str>) -> Result<Vec<u8>> {
    let channels = SpecificChannels::rgba(|at: exr::Vec2<usize>| {
        let [r, g, b, a] = image.pixel(at.x(), at.y());
        (r, g, b, a)
    });
    let mut bytes = Vec::new();
    let whole = exr::Image::from_channels((image.width, image.height), channels);
    with_record(whole, record)
        .write()
        .non_parallel()
        .to_buffered(Cursor::new(&mut bytes))
        .map_err(|e| encoding_failed(path, &e))?;
    Ok(bytes)
}

fn pfm_bytes<'a>(
    magic: &str,
    width: usize,
    height: usize,
    numbers: impl Iterator<Item = &'a f32>,
) -> Vec<u8> {
    let mut bytes = format!("{magic}\n{width} {height}\n-1.0\n").into_bytes();
    bytes.extend(numbers.flat_map(|x| x.to_le_bytes()));
    bytes
}

fn npy_bytes(shape: &[usize], numbers: impl Iterator<Item = f32>) -> Vec<u8> {
    let mut bytes = npy::header("<f4", shape);
    bytes.extend(numbers.flat_map(f32::to_le_bytes));
    bytes
}

fn read_png(path: &Path, bytes: &[u8]) -> Result<Image> {
    let broken = |found: Refusal| damaged(path, "a PNG image", format!("a file that {found}"));
    let encoded = Encoded::png(bytes).map_err(broken)?;
    let [width, height] = encoded.size();
    let samples = encoded.decode().map_err(broken)?;
    let pixel = |p: [u16; 4]| {
        let [r, g, b, a] = p.map(|x| f32::from(x) / f32::from(u16::MAX));
        [
            linear_from_srgb(r) * a,
            linear_from_srgb(g) * a,
            linear_from_srgb(b) * a,
            a,
        ]
    };
    Ok(Image {
        width,
        height,
        pixels: samples.rgba16().into_iter().map(pixel).collect(),
    })
}

/// Reads the first layer with channels R, G and B, over the display window. Pixels outside the layer are transparent;
/// pixels outside the window are left out. A layer without A is opaque.
pub(super) fn read_exr(path: &Path, bytes: &[u8]) -> Result<Image> {
    let broken = |e: exr::Error| damaged(path, "an EXR image", e.to_string());
    let reader = block::read(Cursor::new(bytes), false).map_err(broken)?;
    let is_colour = |header: &&Header| {
        let has = |name: &str| {
            let name = exr::Text::from(name);
            header.channels.find_index_of_channel(&name).is_some()
        };
        !header.deep && ["R", "G", "B"].into_iter().all(has)
    };
    let header = reader.headers().iter().find(is_colour);
    let Some(header) = header else {
        return Err(damaged(
            path,
            "an EXR image with channels R, G and B",
            "other channels",
        ));
    };
    let window = Window::of(path, bytes, header)?;
    let Window { width, height, .. } = window;
    let read = exr::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            move |_, _| vec![[0.0_f32; 4]; width * height],
            move |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| {
                if let Some(i) = window.index(at) {
                    pixels[i] = [r, g, b, a];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_chunks(reader)
        .map_err(broken)?;
    Ok(Image {
        width,
        height,
        pixels: read.layer_data.channel_data.pixels,
    })
}

/// Refuses dimensions that the file's bytes cannot contain at the strongest compression (one bit per pixel, deflated).
pub(super) fn check_claim(path: &Path, len: usize, [width, height]: [usize; 2]) -> Result<()> {
    let most = (len as u64).saturating_mul(8 * DEFLATE_RATIO);
    let claimed = (width as u64).saturating_mul(height as u64);
    if claimed > most || claimed == 0 {
        let found = format!("{width} x {height} in {len} bytes");
        return Err(damaged(path, "as many pixels as the file can hold", found));
    }
    Ok(())
}

fn read_pfm(path: &Path, bytes: &[u8]) -> Result<Image> {
    let broken = || {
        damaged(
            path,
            "`PF` or `Pf`, width, height, scale and as many f32",
            format!("{} bytes of something else", bytes.len()),
        )
    };
    let mut rest = bytes;
    let mut word = || -> Option<&str> {
        rest = rest.trim_ascii_start();
        let end = rest.iter().position(u8::is_ascii_whitespace)?;
        let (word, after) = rest.split_at(end);
        // Exactly one white-space character ends a word; the numbers may follow it.
        rest = &after[1..];
        std::str::from_utf8(word).ok()
    };
    let channels = match word() {
        Some("PF") => 3,
        Some("Pf") => 1,
        _ => return Err(broken()),
    };
    let mut count = || word()?.parse().ok().filter(|&n: &usize| n > 0);
    let (Some(width), Some(height)) = (count(), count()) else {
        return Err(broken());
    };
    let scale: f32 = word().and_then(|w| w.parse().ok()).ok_or_else(broken)?;
    let expected = width
        .checked_mul(height)
        .and_then(|n| n.checked_mul(channels))
        .filter(|n| n.checked_mul(4) == Some(rest.len()))
        .ok_or_else(|| {
            let expected = format!("{width} x {height} pixels of {channels} f32");
            damaged(path, &expected, format!("{} bytes of them", rest.len()))
        })?;
    let encoding = Encoding {
        scalar: ScalarType::F32,
        big_endian: scale > 0.0,
    };
    let stride = Stride {
        first: 0,
        step: 4,
        count: expected,
    };
    let numbers = values(rest, encoding, stride).ok_or_else(broken)?;
    let mut image = Image {
        width,
        height,
        pixels: Vec::with_capacity(width * height),
    };
    for y in (0..height).rev() {
        for x in 0..width {
            let at = (y * width + x) * channels;
            let channel = |c: usize| numbers.get(at + c.min(channels - 1));
            image.pixels.push([channel(0), channel(1), channel(2), 1.0]);
        }
    }
    Ok(image)
}

fn read_npy(path: &Path, bytes: &[u8]) -> Result<Image> {
    let ([width, height], channels) = read_npy_channels(path, bytes, [3, 4])?;
    let pixel = |i: usize| {
        let channel = |c: usize| channels.get(c).map_or(1.0, |channel| channel[i]);
        [channel(0), channel(1), channel(2), channel(3)]
    };
    Ok(Image {
        width,
        height,
        pixels: (0..width * height).map(pixel).collect(),
    })
}

/// Reads the channels of an array of pixels, each row by row. Returns them with width and height.
///
/// - `counts`: least and greatest number of channels; an array of one need not have an axis for it.
fn read_npy_channels(
    path: &Path,
    bytes: &[u8],
    [least, most]: [usize; 2],
) -> Result<([usize; 2], Vec<Vec<f32>>)> {
    let array = npy::parse(path, bytes)?;
    let encoding = array.plain_encoding(path)?;
    let dims = match *array.shape.as_slice() {
        [height, width] if least == 1 => Some([height, width, 1]),
        [height, width, channels] if (least..=most).contains(&channels) => {
            Some([height, width, channels])
        }
        _ => None,
    };
    let Some([height, width, channels]) = dims else {
        let expected = match least {
            1 => "an array of shape (height, width)",
            _ => "an array of shape (height, width, 3 or 4)",
        };
        return Err(damaged(path, expected, format!("shape {:?}", array.shape)));
    };
    if height == 0 || width == 0 {
        let found = format!("{width} x {height}");
        return Err(damaged(path, "at least one pixel", found));
    }
    let count = width * height;
    let size = encoding.scalar.size();
    let channel = |c: usize| -> Result<Vec<f32>> {
        let [first, step] = match array.fortran_order {
            true => [c * count, 1],
            false => [c, channels],
        };
        let stride = Stride {
            first: first * size,
            step: step * size,
            count,
        };
        let values = values(array.data, encoding, stride)
            .ok_or_else(|| damaged(path, "whole pixels", "fewer bytes"))?;
        let place = |i: usize| match array.fortran_order {
            true => i % width * height + i / width,
            false => i,
        };
        Ok((0..count).map(|i| values.get(place(i))).collect())
    };
    let channels = (0..channels).map(channel).collect::<Result<_>>()?;
    Ok(([width, height], channels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_rows_run_from_the_bottom() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        let image = Image {
            width: 1,
            height: 2,
            pixels: vec![[1., 2., 3., 1.], [4., 5., 6., 1.]],
        };
        write_image(&path, &image).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let mut expected = b"PF\n1 2\n-1.0\n".to_vec();
        expected.extend(
            [4., 5., 6., 1., 2., 3.]
                .iter()
                .flat_map(|x: &f32| x.to_le_bytes()),
        );
        assert_eq!(bytes, expected);
        assert_eq!(read_image(&path).unwrap(), image);
    }

    #[test]
    fn depths_of_other_programs_are_found_by_their_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let write = |names: &[&str], layer: Option<&str>| {
            let channel = |(i, name): (usize, &&str)| {
                let sample = 10.0 * i as f32;
                let samples = exr::FlatSamples::F32(vec![sample + 1.0, sample + 2.0]);
                exr::AnyChannel::new(*name, samples)
            };
            let channels = names.iter().enumerate().map(channel).collect();
            let attributes = exr::LayerAttributes {
                layer_name: layer.map(exr::Text::from),
                ..Default::default()
            };
            let layer = exr::Layer::new(
                (2, 1),
                attributes,
                ExrEncoding::FAST_LOSSLESS,
                exr::AnyChannels::sort(channels),
            );
            let image = exr::Image::from_layer(layer);
            image.write().to_file(&path).unwrap();
        };
        let read = || read_depth(&path).map(|depth| depth.depths);
        write(&["Z"], None);
        assert_eq!(read().unwrap(), [1.0, 2.0]);
        write(&["A", "B", "G", "R", "Z"], None);
        assert_eq!(read().unwrap(), [41.0, 42.0]);
        // As Blender writes a view layer.
        write(
            &[
                "ViewLayer.Combined.R",
                "ViewLayer.Depth.V",
                "ViewLayer.Normal.Z",
            ],
            None,
        );
        assert_eq!(read().unwrap(), [11.0, 12.0]);
        write(&["ViewLayer.Depth.Z", "ViewLayer.Normal.Z"], None);
        assert_eq!(read().unwrap(), [1.0, 2.0]);
        write(&["Y"], None);
        assert_eq!(read().unwrap(), [1.0, 2.0]);
        // Vectors are no depths, nor is a choice made between two layers.
        write(&["A", "N.X", "N.Y", "N.Z", "Z"], None);
        assert_eq!(read().unwrap(), [41.0, 42.0]);
        for names in [
            &["X", "Y", "Z"][..],
            &["N.X", "N.Y", "N.Z"],
            &["a.Z", "b.Z"],
        ] {
            write(names, None);
            assert!(
                read()
                    .unwrap_err()
                    .to_string()
                    .contains(names[2 % names.len()])
            );
        }
        write(&["R", "G", "B"], None);
        assert!(read().unwrap_err().to_string().contains("B, G, R"));
    }

    #[test]
    fn a_png_holds_straight_srgb() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        // The pixel is half-transparent mid grey, premultiplied. NaN and overflow must not break the file.
        let grey = linear_from_srgb(128.0 / 255.0);
        let image = Image {
            width: 3,
            height: 1,
            pixels: vec![
                [grey * 0.2, 0.0, 0.2, 0.2],
                [f32::NAN, 9.0, -1.0, 1.0],
                [0.0; 4],
            ],
        };
        write_image(&path, &image).unwrap();
        let stored = || {
            let mut reader = png::Decoder::new(Cursor::new(std::fs::read(&path).unwrap()))
                .read_info()
                .unwrap();
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut bytes).unwrap();
            (info.color_type, info.bit_depth, bytes)
        };
        let expected = vec![128, 0, 255, 51, 0, 255, 0, 255, 0, 0, 0, 0];
        let eight = png::BitDepth::Eight;
        assert_eq!(stored(), (png::ColorType::Rgba, eight, expected));
        let opaque = Image {
            width: 1,
            height: 1,
            pixels: vec![[0.0, 1.0, 0.0, 1.0]],
        };
        write_image(&path, &opaque).unwrap();
        assert_eq!(stored(), (png::ColorType::Rgb, eight, vec![0, 255, 0]));
    }

    #[test]
    fn sizes_that_disagree_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        for (width, height, count) in [(0, 0, 0), (2, 2, 3), (usize::MAX, 2, 1)] {
            let image = Image {
                width,
                height,
                pixels: vec![[0.0; 4]; count],
            };
            let depth = DepthImage {
                width,
                height,
                depths: vec![0.0; count],
            };
            for name in ["a.png", "a.exr", "a.pfm", "a.npy"] {
                let path = folder.path().join(name);
                assert!(write_image(&path, &image).is_err());
                assert!(write_depth(&path, &depth).is_err());
            }
        }
        let image = Image::new(1, 1);
        assert!(write_image(&folder.path().join("a.jpg"), &image).is_err());
        assert!(write_image(&folder.path().join("a"), &image).is_err());
        assert!(check_image_path(&folder.path().join("a.png")).is_ok());
        assert!(check_image_path(&folder.path().join("a.or")).is_err());
        assert!(check_image_path(&folder.path().join("none/a.png")).is_err());
        assert!(check_depth_path(&folder.path().join("a.png")).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
