//! Images of textures: PNG and JPEG, decoded to eight bits, within limits.

use std::io::Cursor;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::TextureImage;

/// The most pixels that the textures of one file may have together: 2 GiB of them.
const MOST_PIXELS: u64 = 1 << 29;

/// Deflate packs 1032 bytes into one at best, and a PNG holds eight pixels in a byte at most.
const PNG_PIXELS_PER_BYTE: u64 = 8 * 1032;

/// A JPEG spends a bit on each block of 64 pixels at least.
const JPEG_PIXELS_PER_BYTE: u64 = 8 * 64;

/// Decodes the images of one file, and holds them to a common limit.
#[derive(Debug)]
pub(crate) struct ImageBudget {
    pixels: u64,
}

impl Default for ImageBudget {
    fn default() -> Self {
        Self {
            pixels: MOST_PIXELS,
        }
    }
}

impl ImageBudget {
    /// Decodes a PNG or JPEG image, known by its first bytes.
    ///
    /// # Errors
    /// Why it cannot be decoded, as the end of a sentence: readers of meshes go on without the
    /// image and tell of it.
    pub(crate) fn decode(&mut self, bytes: &[u8]) -> Result<TextureImage, String> {
        let damaged = |e: image::ImageError| {
            let text = e.to_string();
            let first = text.lines().next().unwrap_or("").to_owned();
            format!("is damaged ({first})")
        };
        let ratio = match image::guess_format(bytes) {
            Ok(ImageFormat::Png) => PNG_PIXELS_PER_BYTE,
            Ok(ImageFormat::Jpeg) => JPEG_PIXELS_PER_BYTE,
            _ => return Err("is neither PNG nor JPEG".into()),
        };
        let mut decoder = ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| format!("is damaged ({e})"))?
            .into_decoder()
            .map_err(damaged)?;
        let (width, height) = decoder.dimensions();
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || pixels > ratio.saturating_mul(bytes.len() as u64) {
            return Err(format!(
                "claims {width} x {height} pixels in {} bytes",
                bytes.len()
            ));
        }
        self.pixels = self.pixels.checked_sub(pixels).ok_or_else(|| {
            format!("has {width} x {height} pixels: with the others too many ({MOST_PIXELS})")
        })?;
        let mut limits = image::Limits::no_limits();
        // Sixteen bits of four channels, and as much again for the decoder.
        limits.max_alloc = Some(16 * pixels + (1 << 20));
        decoder.set_limits(limits).map_err(damaged)?;
        let decoded = DynamicImage::from_decoder(decoder).map_err(damaged)?;
        let rgba = decoded.into_rgba8();
        let (width, height) = (rgba.width() as usize, rgba.height() as usize);
        let pixels = rgba.as_raw().as_chunks::<4>().0.to_vec();
        Ok(TextureImage {
            width,
            height,
            pixels,
        })
    }
}
