//! Pictures in and out.
//!
//! | extension | content |
//! |---|---|
//! | png | 8-bit sRGB; RGBA with straight alpha, or RGB where the image is opaque |
//! | exr | f32 RGBA, linear premultiplied |
//! | pfm | f32 RGB, linear premultiplied (alpha is dropped: black shows through) |
//! | npy | f32 (H, W, 4), linear premultiplied, rows from the top |
//!
//! Depths go to exr (one channel repeated), pfm (one channel) or npy (H, W).

use std::io::{Cursor, Write};
use std::path::Path;

use super::atomic::{write_atomically, write_bytes_atomically};
use crate::error::{Error, Result};
use crate::image::{DepthImage, Image, linear_from_srgb, srgb_from_linear};

/// Writes an image in the format of its name's extension.
///
/// # Errors
/// An unknown extension, or a file that cannot be written.
pub fn write_image(path: &Path, image: &Image) -> Result<()> {
    let [w, h] = [image.width, image.height];
    match extension(path).as_str() {
        "png" => {
            let opaque = image.pixels.iter().all(|p| p[3] >= 1.0);
            let bytes: Vec<u8> = image
                .pixels
                .iter()
                .flat_map(|&[r, g, b, a]| {
                    let straight = |c: f32| if a > 0.0 { byte(srgb_from_linear(c / a)) } else { 0 };
                    [straight(r), straight(g), straight(b), byte(a)]
                })
                .enumerate()
                .filter(|(i, _)| !opaque || i % 4 != 3)
                .map(|(_, b)| b)
                .collect();
            let colour =
                if opaque { image::ExtendedColorType::Rgb8 } else { image::ExtendedColorType::Rgba8 };
            encode(path, image::ImageFormat::Png, &bytes, [w, h], colour)
        }
        "exr" => {
            let bytes = bytemuck::cast_slice(&image.pixels);
            encode(path, image::ImageFormat::OpenExr, bytes, [w, h], image::ExtendedColorType::Rgba32F)
        }
        "pfm" => write_atomically(path, |out| {
            write!(out, "PF\n{w} {h}\n-1.0\n")?;
            for row in image.pixels.chunks_exact(w.max(1)).rev() {
                for p in row {
                    out.write_all(&[p[0], p[1], p[2]].map(f32::to_le_bytes).concat())?;
                }
            }
            Ok(())
        }),
        "npy" => write_npy(path, &[h, w, 4], bytemuck::cast_slice(&image.pixels)),
        other => Err(unknown_extension(path, other, "png, exr, pfm or npy")),
    }
}

/// Writes a depth image in the format of its name's extension.
///
/// # Errors
/// An unknown extension, or a file that cannot be written.
pub fn write_depth(path: &Path, depth: &DepthImage) -> Result<()> {
    let [w, h] = [depth.width, depth.height];
    match extension(path).as_str() {
        "exr" => {
            let rgb: Vec<f32> = depth.depths.iter().flat_map(|&d| [d; 3]).collect();
            let bytes = bytemuck::cast_slice(&rgb);
            encode(path, image::ImageFormat::OpenExr, bytes, [w, h], image::ExtendedColorType::Rgb32F)
        }
        "pfm" => write_atomically(path, |out| {
            write!(out, "Pf\n{w} {h}\n-1.0\n")?;
            for row in depth.depths.chunks_exact(w.max(1)).rev() {
                for d in row {
                    out.write_all(&d.to_le_bytes())?;
                }
            }
            Ok(())
        }),
        "npy" => write_npy(path, &[h, w], &depth.depths),
        other => Err(unknown_extension(path, other, "exr, pfm or npy")),
    }
}

/// Reads an image as linear premultiplied RGBA; a format without alpha is opaque.
///
/// # Errors
/// A file that cannot be read, is of no such format, or is damaged.
pub fn read_image(path: &Path) -> Result<Image> {
    let bytes = super::file::read_all(path)?;
    if bytes.starts_with(b"\x93NUMPY") {
        return read_npy(path, &bytes);
    }
    if bytes.starts_with(b"PF\n") || bytes.starts_with(b"Pf\n") {
        return read_pfm(path, &bytes);
    }
    let format = image::guess_format(&bytes).map_err(|e| damaged(path, e.to_string()))?;
    let decoded = image::load_from_memory_with_format(&bytes, format)
        .map_err(|e| damaged(path, e.to_string()))?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let pixels = if format == image::ImageFormat::OpenExr {
        decoded.to_rgba32f().pixels().map(|p| p.0).collect()
    } else {
        let premultiply = |p: &image::Rgba<u16>| {
            let [r, g, b, a] = p.0.map(|c| f32::from(c) / 65_535.0);
            [linear_from_srgb(r) * a, linear_from_srgb(g) * a, linear_from_srgb(b) * a, a]
        };
        decoded.to_rgba16().pixels().map(premultiply).collect()
    };
    Ok(Image { width, height, pixels })
}

fn read_pfm(path: &Path, bytes: &[u8]) -> Result<Image> {
    let header = || damaged(path, "a header other than `PF`, width, height, scale".into());
    // Four words, one white byte after the last.
    let mut words = Vec::new();
    let mut at = 0;
    while words.len() < 4 {
        let end = bytes[at..].iter().position(u8::is_ascii_whitespace).ok_or_else(header)? + at;
        words.push(std::str::from_utf8(&bytes[at..end]).map_err(|_| header())?);
        at = end + 1;
    }
    let [magic, width, height, scale] = words[..] else { return Err(header()) };
    let (width, height): (usize, usize) =
        (width.parse().map_err(|_| header())?, height.parse().map_err(|_| header())?);
    let scale: f32 = scale.parse().map_err(|_| header())?;
    let channels = if magic == "PF" { 3 } else { 1 };
    let body = &bytes[at..];
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(4 * channels));
    if expected != Some(body.len()) || body.is_empty() {
        return Err(damaged(path, format!("{} bytes for {width} x {height} pixels", body.len())));
    }
    let float = |c: &[u8; 4]| {
        if scale < 0.0 { f32::from_le_bytes(*c) } else { f32::from_be_bytes(*c) }
    };
    let floats: Vec<f32> = body.as_chunks::<4>().0.iter().map(float).collect();
    let mut pixels = Vec::with_capacity(width * height);
    for row in floats.chunks_exact(width * channels).rev() {
        pixels.extend(row.chunks_exact(channels).map(|p| [p[0], p[channels / 2], p[channels - 1], 1.0]));
    }
    Ok(Image { width, height, pixels })
}

fn read_npy(path: &Path, bytes: &[u8]) -> Result<Image> {
    let wrong = |found: String| {
        Error::format(path, "array", "float32 of shape (H, W, 4)", found, "write it so")
    };
    let npy = npyz::NpyFile::new(Cursor::new(bytes)).map_err(|e| damaged(path, e.to_string()))?;
    let shape = npy.shape().to_vec();
    let &[height, width, 4] = &shape[..] else { return Err(wrong(format!("shape {shape:?}"))) };
    let count = height.checked_mul(width).and_then(|n| n.checked_mul(16));
    if count.is_none_or(|n| n > bytes.len() as u64) || npy.order() != npyz::Order::C {
        return Err(wrong(format!("{shape:?} in {} bytes", bytes.len())));
    }
    let floats: Vec<f32> = npy.into_vec().map_err(|e| wrong(e.to_string()))?;
    Ok(Image {
        width: width as usize,
        height: height as usize,
        pixels: floats.as_chunks::<4>().0.to_vec(),
    })
}

/// NumPy format 1.0: magic, version, header length, a Python dictionary padded to 64 bytes, data.
fn write_npy(path: &Path, shape: &[usize], data: &[f32]) -> Result<()> {
    let shape: Vec<String> = shape.iter().map(ToString::to_string).collect();
    let mut header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}",
        shape.join(", ")
    );
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    write_atomically(path, |out| {
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&(header.len() as u16).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        for value in data {
            out.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    })
}

fn encode(
    path: &Path,
    format: image::ImageFormat,
    bytes: &[u8],
    [width, height]: [usize; 2],
    colour: image::ExtendedColorType,
) -> Result<()> {
    let mut out = Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut out, bytes, width as u32, height as u32, colour, format)
        .map_err(|e| {
            Error::io(path, "encoding", std::io::Error::other(e), "try another format")
        })?;
    write_bytes_atomically(path, out.get_ref())
}

/// A channel as a byte; NaN gives 0.
fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// Checks that an image or depth file's extension is one that can be written, before any work.
///
/// # Errors
/// An extension that is none of `allowed`, a comma-separated list such as `png, exr`.
pub fn check_extension(path: &Path, allowed: &str) -> Result<()> {
    let found = extension(path);
    if allowed.split(", ").any(|e| e == found) {
        Ok(())
    } else {
        Err(unknown_extension(path, &found, allowed))
    }
}

fn unknown_extension(path: &Path, found: &str, allowed: &str) -> Error {
    Error::format(path, "extension", allowed, format!("`{found}`"), "name the file so")
}

fn damaged(path: &Path, found: String) -> Error {
    Error::format(path, "image", "a whole png, exr, pfm or npy image", found, "write it again")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Image {
        let mut image = Image::new(3, 2);
        for (i, p) in image.pixels.iter_mut().enumerate() {
            let a = 0.2 + 0.15 * i as f32;
            *p = [0.9 * a, 0.1 * i as f32 * a, 0.03 * a, a];
        }
        image
    }

    #[test]
    fn float_formats_keep_every_bit_they_hold() {
        let folder = tempfile::tempdir().unwrap();
        for extension in ["exr", "npy", "pfm"] {
            let path = folder.path().join(format!("p.{extension}"));
            write_image(&path, &picture()).unwrap();
            let mut expected = picture();
            if extension == "pfm" {
                expected.pixels.iter_mut().for_each(|p| p[3] = 1.0);
            }
            assert_eq!(read_image(&path).unwrap(), expected, "{extension}");
        }
    }

    #[test]
    fn png_keeps_colours_to_half_a_level() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        write_image(&path, &picture()).unwrap();
        for (a, b) in picture().pixels.iter().zip(read_image(&path).unwrap().pixels) {
            // Half a level of 255 each in colour (steepest slope of the sRGB curve: 2.3) and alpha.
            a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() < 1.6 * 2.3 / 255.0));
        }
    }

    #[test]
    fn damaged_images_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p");
        let bad: [&[u8]; 6] = [
            b"",
            b"PF\n3 2\n-1.0\nxx",
            b"PF\n99999999999 99999999999\n-1\n",
            b"\x93NUMPY\x01\x00\xff\xff{",
            b"\x89PNG\r\n\x1a\n0000",
            b"hello",
        ];
        for bytes in bad {
            std::fs::write(&path, bytes).unwrap();
            assert!(read_image(&path).is_err());
        }
    }
}
