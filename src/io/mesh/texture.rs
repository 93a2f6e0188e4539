//! Decodes the images of textures to eight bits, within limits.

use std::path::{Path, PathBuf};

use crate::data::mesh::TextureImage;
use crate::error::{Error, Hint, Result};
use crate::io::bytes::file::Input;
use crate::io::picture::samples::{Encoded, TEXTURES};
use crate::io::vtk::xml::clip;

/// A file that a statement names.
#[derive(Debug)]
pub(crate) struct NamedFile {
    pub(crate) path: PathBuf,
    /// A note if the file's name is spelled differently.
    pub(crate) note: Option<String>,
}

/// Finds the file that a statement names: relative to the folder, or in the folder by its last component, for
/// paths of another machine. Otherwise a file whose name differs in upper and lower case alone.
pub(crate) fn find(input: Input<'_>, name: &str) -> Option<NamedFile> {
    let folder = input.path.parent().unwrap_or(Path::new(""));
    let name = name.replace('\\', "/");
    let last = name.rsplit('/').next().unwrap_or("");
    let paths = || {
        let names = [name.as_str(), last].into_iter();
        names.filter(|n| !n.is_empty()).map(|n| folder.join(n))
    };
    if let Some(path) = paths().find(|file| input.has_beside(file)) {
        return Some(NamedFile { path, note: None });
    }
    let path = paths().find_map(|file| input.in_another_case(&file))?;
    Some(NamedFile {
        note: Some(spelled_otherwise(&name, &path)),
        path,
    })
}

/// The note on a file whose name differs from the stated one in upper and lower case.
pub(crate) fn spelled_otherwise(name: &str, path: &Path) -> String {
    let found = path.file_name().unwrap_or_default().to_string_lossy();
    let (name, found) = (clip(name), clip(&found));
    format!("no file `{name}`: `{found}` is taken for it")
}

/// Greatest number of pixels in all textures of one file: 2 GiB of them.
const MOST_PIXELS: u64 = 1 << 29;

/// Decodes the images of one file, within a common limit.
#[derive(Debug)]
pub(crate) struct ImageBudget {
    pixels: u64,
    /// Notes on files that were found under other names.
    pub(crate) notes: Vec<String>,
}

impl Default for ImageBudget {
    fn default() -> Self {
        Self {
            pixels: MOST_PIXELS,
            notes: Vec::new(),
        }
    }
}

impl ImageBudget {
    /// Decodes an image of any format that [`Encoded::texture`] supports.
    ///
    /// # Errors
    /// The reason, as the end of a sentence: readers of meshes continue without the image and note it.
    pub(crate) fn decode(&mut self, bytes: &[u8]) -> Result<TextureImage, String> {
        let encoded = Encoded::texture(bytes).map_err(|refusal| refusal.to_string())?;
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
    /// The image in a file that a mesh names.
    ///
    /// # Errors
    /// A note with the reason why there is none.
    pub(crate) fn named(&mut self, input: Input<'_>, name: &str) -> Result<TextureImage, String> {
        let decoded = match find(input, name) {
            None => Err(format!("no file `{}`", clip(name))),
            Some(file) => {
                self.notes.extend(file.note);
                let bytes = input.read_beside(&file.path).map_err(|e| e.to_string());
                bytes.and_then(|bytes| {
                    self.decode(&bytes)
                        .map_err(|reason| format!("image `{}` {reason}", clip(name)))
                })
            }
        };
        decoded.map_err(|reason| format!("{reason}: its texture is not used"))
    }

    /// The image that the user gave as a texture.
    ///
    /// # Errors
    /// A file that cannot be read or decoded.
    pub(crate) fn named_by_user(&mut self, input: Input<'_>, path: &Path) -> Result<TextureImage> {
        let bytes = input.read_beside(path)?;
        self.decode(&bytes).map_err(|reason| {
            Error::format(
                path,
                "texture",
                format!("an image ({TEXTURES})"),
                format!("a file that {reason}"),
                Hint::NameOtherTexture,
            )
        })
    }
}
