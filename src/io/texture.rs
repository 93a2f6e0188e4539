//! Images of textures: PNG and JPEG, decoded to eight bits, within limits.

use super::TextureImage;
use super::samples::Encoded;

/// The most pixels that the textures of one file may have together: 2 GiB of them.
const MOST_PIXELS: u64 = 1 << 29;

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
        let encoded = Encoded::open(bytes).map_err(|refusal| refusal.to_string())?;
        let [width, height] = encoded.size();
        // Neither exceeds 32 bits.
        self.pixels = self
            .pixels
            .checked_sub(width as u64 * height as u64)
            .ok_or_else(|| {
                format!("has {width} x {height} pixels: with the others too many ({MOST_PIXELS})")
            })?;
        let samples = encoded.decode().map_err(|refusal| refusal.to_string())?;
        Ok(TextureImage {
            width,
            height,
            pixels: samples.rgba8(),
        })
    }
}
