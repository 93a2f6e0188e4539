//! Reads numbered images as one volume. The pattern `slice_%03d.png` names all files in its folder with a number in
//! that place.
//!
//! `%d` represents numbers without leading zeros, and `%03d` numbers with at least three digits. Layers are one pixel
//! step apart, in the order of their numbers. No number may be missing between the first and the last. Images are PNG,
//! JPEG, WebP and TIFF; rows run along y. Colours are not decoded; they become a field `rgb` of stored numbers.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::{tiff, voxels};
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::picture::samples::Encoded;
use crate::io::vtk::array::Array;
use crate::scene::{LatticeSpacing, Values};

/// Greatest number of digits.
const MOST_DIGITS: usize = 18;

/// Name with one place for a number.
struct Pattern<'a> {
    before: &'a str,
    /// Least number of digits; if `None`, numbers have no leading zeros.
    width: Option<usize>,
    after: &'a str,
}

impl<'a> Pattern<'a> {
    /// Parses a name; returns `None` if it is no pattern.
    fn of(name: &'a str) -> Option<Self> {
        let (before, rest) = name.split_once('%')?;
        let (digits, after) = rest.split_once('d')?;
        let is_one = !before.contains('%') && !after.contains('%');
        let width = match digits.strip_prefix('0') {
            None => digits.is_empty().then_some(None),
            Some(width) => {
                let width = width.parse().ok();
                width.filter(|n| (1..=MOST_DIGITS).contains(n)).map(Some)
            }
        };
        let width = width.filter(|_| is_one)?;
        Some(Self {
            before,
            width,
            after,
        })
    }

    /// Returns the number in a name that matches this pattern.
    fn number(&self, name: &str) -> Option<u64> {
        let digits = name.strip_prefix(self.before)?.strip_suffix(self.after)?;
        let is_number = !digits.is_empty()
            && digits.len() <= MOST_DIGITS
            && digits.bytes().all(|b| b.is_ascii_digit());
        let has_zeros = digits.len() > 1 && digits.starts_with('0');
        let is_written_so = match self.width {
            Some(width) => digits.len() >= width && (digits.len() == width || !has_zeros),
            None => !has_zeros,
        };
        let number = digits.parse().ok();
        number.filter(|_| is_number && is_written_so)
    }
}

fn name_of(path: &Path) -> &str {
    let name = path.file_name().unwrap_or_default();
    name.to_str().unwrap_or_default()
}

/// Returns true if a path is a pattern and no existing file.
pub(in crate::io) fn is_pattern(path: &Path) -> bool {
    Pattern::of(name_of(path)).is_some() && !path.exists()
}

/// Reads the images of a pattern, which is the input's path.
///
/// # Errors
/// There is no image, a number is missing, or an image cannot be read or differs from the first in size or kind.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let files = files(path)?;
    let mut all: Option<Layer> = None;
    for file in &files {
        let layer = layer(file)?;
        match &mut all {
            None => all = Some(layer),
            Some(all) => all.append(file, layer)?,
        }
    }
    let Some(Layer {
        size: [width, height],
        steps: [x, y],
        fields,
    }) = all
    else {
        return Err(none(path));
    };
    // No file states the distance of layers, so it is a step of the pixels.
    let z = x.cross(y).normalize_or_zero() * x.length().min(y.length());
    let dims = [width, height, files.len()];
    let steps = [x, y, z];
    let lattice = voxels::lattice(path, "steps of the images", dims, DVec3::ZERO, &steps)?;
    let fields = fields
        .into_iter()
        .map(|(name, components)| voxels::field(&name, components, None))
        .collect();
    let mut data = Dataset::new(path, "series of images", Geometry::Lattice(lattice), fields);
    data.notes.push(format!(
        "{} layers, taken to lie a step of the pixels apart.",
        files.len()
    ));
    Ok(data)
}

fn none(path: &Path) -> Error {
    let expected = "at least one file of this pattern";
    let advice = "name files that are there: `%03d` stands for numbers such as 001";
    Error::format(path, "files", expected, "none", advice)
}

/// Returns the files of a pattern in the order of their numbers.
fn files(path: &Path) -> Result<Vec<PathBuf>> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let Some(pattern) = Pattern::of(name_of(path)) else {
        return Err(none(path));
    };
    let fault = |e| Error::io(folder, "listing the folder", e, "check its permissions");
    let mut found: Vec<(u64, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let entry = entry.map_err(fault)?;
        let name = entry.file_name();
        if let Some(number) = name.to_str().and_then(|name| pattern.number(name)) {
            found.push((number, entry.path()));
        }
    }
    found.sort();
    if let Some(gap) = found.windows(2).find(|pair| pair[1].0 != pair[0].0 + 1) {
        return Err(Error::format(
            path,
            "files",
            "numbers without a gap",
            format!("none between {} and {}", gap[0].0, gap[1].0),
            "add what is missing, or move what does not belong to it",
        ));
    }
    if found.is_empty() {
        return Err(none(path));
    }
    Ok(found.into_iter().map(|(_, file)| file).collect())
}

/// One image, or several stacked ones.
struct Layer {
    /// Width and height, pixels.
    size: [usize; 2],
    /// Step from one pixel to the next along each axis.
    steps: [DVec3; 2],
    fields: Vec<(String, Vec<Values>)>,
}

impl Layer {
    fn append(&mut self, file: &Path, other: Self) -> Result<()> {
        let kind = |layer: &Self| {
            let of = |(name, components): &(String, Vec<Values>)| {
                let kinds = components.iter().map(std::mem::discriminant);
                (name.clone(), kinds.collect::<Vec<_>>())
            };
            layer.fields.iter().map(of).collect::<Vec<_>>()
        };
        if self.size != other.size || kind(self) != kind(&other) {
            let [width, height] = self.size;
            let [own_width, own_height] = other.size;
            return Err(Error::format(
                file,
                "image",
                format!("{width} x {height} pixels of one kind, as the first image has"),
                format!("{own_width} x {own_height}, or another number or type of channels"),
                "save all images alike",
            ));
        }
        for ((_, all), (_, more)) in self.fields.iter_mut().zip(other.fields) {
            for (all, more) in all.iter_mut().zip(more) {
                let mut whole = Some(std::mem::replace(all, Values::U8(Vec::new())));
                voxels::append(&mut whole, more);
                if let Some(whole) = whole {
                    *all = whole;
                }
            }
        }
        Ok(())
    }
}

fn layer(file: &Path) -> Result<Layer> {
    let input = Input::of_file(file);
    let bytes = input.read_all()?;
    if tiff::looks_like(&bytes) {
        return of_stack(file, tiff::read(input)?);
    }
    let refuse = |reason: String| {
        let advice = "save it as PNG or TIFF";
        Error::format(file, "image", "PNG, JPEG, WebP or TIFF", reason, advice)
    };
    let samples = Encoded::open(&bytes).and_then(Encoded::decode);
    let samples = samples.map_err(|refusal| refuse(format!("one that {refusal}")))?;
    let (size, mut channels) = samples.channels();
    let fields = match channels.len() {
        3 => vec![("rgb".into(), channels)],
        4 => vec![("rgba".into(), channels)],
        // Grey; its alpha is not data and is dropped.
        _ => {
            channels.truncate(1);
            vec![("value".into(), channels)]
        }
    };
    Ok(Layer {
        size,
        steps: [DVec3::X, DVec3::Y],
        fields,
    })
}

/// Reads a TIFF file with one page.
fn of_stack(file: &Path, data: Dataset) -> Result<Layer> {
    let depth = |found: String| {
        let advice = "give the stack itself";
        Error::format(file, "pages", "one", found, advice)
    };
    let Geometry::Lattice(lattice) = data.geometry else {
        return Err(depth("none".into()));
    };
    let [width, height, layers] = lattice.dims;
    let LatticeSpacing::Uniform { step, .. } = lattice.spacing else {
        return Err(depth("none".into()));
    };
    if layers != 1 {
        return Err(depth(layers.to_string()));
    }
    let arrays = data.fields.into_iter().filter_map(Array::of_field);
    Ok(Layer {
        size: [width, height],
        steps: [step.x_axis, step.y_axis],
        fields: arrays.map(|array| (array.name, array.components)).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_have_one_place_for_a_number() {
        let number = |pattern: &str, name: &str| Pattern::of(pattern)?.number(name);
        assert_eq!(number("a_%03d.png", "a_007.png"), Some(7));
        assert_eq!(number("a_%03d.png", "a_1007.png"), Some(1007));
        assert_eq!(number("a_%03d.png", "a_0007.png"), None);
        assert_eq!(number("a_%03d.png", "a_7.png"), None);
        assert_eq!(number("a_%03d.png", "a_x07.png"), None);
        assert_eq!(number("%d.tif", "0.tif"), Some(0));
        assert_eq!(number("%d.tif", "12.tif"), Some(12));
        assert_eq!(number("%d.tif", "012.tif"), None);
        for pattern in [
            "a.png",
            "%s.png",
            "%d_%d.png",
            "%3d.png",
            "%00d.png",
            "%099d.png",
        ] {
            assert!(Pattern::of(pattern).is_none(), "{pattern}");
        }
    }
}
