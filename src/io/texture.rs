//! Images of textures: PNG, JPEG, WebP and KTX 2, decoded to eight bits, within limits.

use std::path::{Path, PathBuf};

use super::TextureImage;
use super::file::Input;
use super::samples::Encoded;
use super::vtk_xml::clip;
use crate::error::{Error, Hint, Result};

/// The file that a statement names: relative to the folder, or by its last name in it, as for
/// paths of another machine.
pub(crate) fn find(input: Input<'_>, name: &str) -> Option<PathBuf> {
    let folder = input.path.parent().unwrap_or(Path::new(""));
    let name = name.replace('\\', "/");
    let last = name.rsplit('/').next().unwrap_or("");
    [name.as_str(), last]
        .into_iter()
        .filter(|n| !n.is_empty())
        .map(|n| folder.join(n))
        .find(|file| input.has_beside(file))
}

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
    /// Decodes a PNG, JPEG, WebP or KTX 2 image, known by its first bytes.
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
    /// The image that a file of a mesh names.
    ///
    /// # Errors
    /// A note: why there is none.
    pub(crate) fn named(&mut self, input: Input<'_>, name: &str) -> Result<TextureImage, String> {
        let decoded = match find(input, name) {
            None => Err(format!("no file `{}`", clip(name))),
            Some(file) => {
                let bytes = input.read_beside(&file).map_err(|e| e.to_string());
                bytes.and_then(|bytes| {
                    self.decode(&bytes)
                        .map_err(|reason| format!("image `{}` {reason}", clip(name)))
                })
            }
        };
        decoded.map_err(|reason| format!("{reason}: its texture is not used"))
    }

    /// The image that the user names as a texture.
    ///
    /// # Errors
    /// It cannot be read or decoded.
    pub(crate) fn named_by_user(&mut self, input: Input<'_>, path: &Path) -> Result<TextureImage> {
        let bytes = input.read_beside(path)?;
        self.decode(&bytes).map_err(|reason| {
            Error::format(
                path,
                "texture",
                "a PNG, JPEG, WebP or KTX 2 image",
                format!("a file that {reason}"),
                Hint::NameOtherTexture,
            )
        })
    }
}
