//! Reads and writes SOG (PlayCanvas); reads versions 1 and 2. Splats are stored in the pixels of lossless WebP
//! images, which a `meta.json` names; beside it, or all in one archive (`.sog`, ZIP).
//!
//! Splat i is pixel i of each image but the palette, rows from the top; R, G and B are x, y and z unless stated
//! otherwise.
//!
//! | in `meta.json` | images | content |
//! |---|---|---|
//! | `means` | low bytes, high bytes | positions in 16 bits between `mins` and `maxs`, which hold sign(x) ln(1 + abs x) |
//! | `scales` | one | logarithms of standard deviations |
//! | `quats` | one | the quaternion w, x, y, z without its largest component, whose index 0 to 3 is alpha 252 to 255; the others from -√½ to √½ |
//! | `sh0` | one | coefficients of the constant harmonic; alpha: the peak opacity, in version 1 its logit |
//! | `shN`, if there are more | palette, indices | coefficients of degree `bands` as an entry of the palette: 64 entries a row, a pixel for each coefficient; indices in R and G, the low byte first |
//!
//! Bytes of version 2 are indices in a `codebook` of 256 numbers, its peak opacities shares of 255. Those of
//! version 1, which has no `version`, lie between `mins` and `maxs`. `count` (version 1: `means.shape`) is the
//! number of splats; `antialias` marks splats made for an anti-aliasing filter. Axes are those of PLY files.
//!
//! Source: the description of the format in PlayCanvas' manual, and its program splat-transform for version 1.

mod codebook;
mod decode;
mod encode;
pub(in crate::io) mod files;
mod meta;
mod palette;

use crate::io::splats::sog::files::META;
use std::path::Path;

use crate::data::dataset::Dataset;
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::bytes::zip;
pub(in crate::io) use encode::encode;
use files::Files;

/// Keys of `meta.json`, some of which are near its beginning.
const KEYS: [&str; 4] = ["\"means\"", "\"scales\"", "\"quats\"", "\"sh0\""];

/// Whether a file that begins with `head` is a `meta.json`.
pub(in crate::io) fn looks_like(path: &Path, head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let found = KEYS.iter().filter(|key| text.contains(**key)).count();
    let is_named = path.file_name().is_some_and(|name| name == META);
    text.trim_start_matches('\u{feff}')
        .trim_start()
        .starts_with('{')
        && found >= if is_named { 1 } else { 2 }
}

/// Whether an archive holds a scene.
pub(in crate::io) fn is_archive(entries: &[zip::Entry<'_>]) -> bool {
    entries.iter().any(|entry| files::is_meta(&entry.name))
}

/// Reads splats.
///
/// # Errors
/// Images that are missing, damaged or too small for the splats; a `meta.json` of another version or without a
/// required part.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let bytes = input.read_all()?;
    let files = Files::of(input, &bytes)?;
    let meta = meta::Meta::of(input.path, &files.meta()?)?;
    decode::splats(input.path, &meta, &files)
}
