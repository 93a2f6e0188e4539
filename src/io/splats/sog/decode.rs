//! Decodes splats from the pixels of images.

use std::f32::consts::SQRT_2;
use std::path::Path;

use glam::DVec3;

use super::files::Files;
use super::meta::{Harmonics, Meta};
use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, sigmoid};
use crate::error::{Error, Result};
use crate::io::picture::samples::Encoded;
use crate::io::vtk::xml::clip;
use crate::math::harmonics_count;
use crate::scene::SplatRule;

const FORMAT: &str = "SOG splats";

/// Number of the palette's entries in a row of its image.
pub(super) const PALETTE_ROW: usize = 64;
/// Greatest number of rows in the palette's image: its entries have indices of 16 bits.
pub(super) const PALETTE_ROWS: usize = (1 << 16) / PALETTE_ROW;

/// Greatest number of splats per byte of the positions' images, and a number of splats that is always allowed.
const SPLATS_PER_BYTE: usize = 64;
const FEW_SPLATS: usize = 1 << 14;

/// The alpha of a quaternion whose first component is left out.
pub(super) const FIRST_LARGEST: u8 = 252;

struct Image {
    width: usize,
    pixels: Vec<[u8; 4]>,
}

/// The images of a scene.
struct Scene<'a> {
    path: &'a Path,
    files: &'a Files<'a>,
    count: usize,
}

pub(super) fn splats(path: &Path, meta: &Meta, files: &Files<'_>) -> Result<Dataset> {
    let count = meta.count;
    let scene = Scene { path, files, count };
    let positions = scene.positions(meta)?;
    let (scales, colours) = (&meta.scales, &meta.colours);
    let scale = |p: [u8; 4]| [0, 1, 2].map(|i| scales[i][usize::from(p[i])].exp());
    let scales = scene.image(&meta.scales_file)?.pixels;
    let scales = scales.into_iter().take(count).map(scale).collect();

    let quats = scene.image(&meta.quats_file)?.pixels;
    let mut notes = Vec::new();
    let unknown = quats[..count].iter().filter(|p| p[3] < FIRST_LARGEST);
    let unknown = unknown.count();
    if unknown > 0 {
        notes.push(format!(
            "{unknown} rotations do not say which component is the largest and are taken as none"
        ));
    }
    let rotations = quats.into_iter().take(count).map(rotation).collect();

    let codes = scene.image(&meta.colours_file)?.pixels;
    let opacity = |p: &[u8; 4]| match &meta.logits {
        Some(logits) => sigmoid(logits[usize::from(p[3])]),
        None => f32::from(p[3]) / 255.0,
    };
    let opacities = codes[..count].iter().map(opacity).collect();
    let palette = match &meta.harmonics {
        Some(stated) => Some(scene.palette(stated)?),
        None => None,
    };
    let degree = palette.as_ref().map_or(0, |palette| palette.degree);
    let mut harmonics = Vec::with_capacity(count * 3 * harmonics_count(degree));
    let mut nameless = 0;
    for (i, p) in codes[..count].iter().enumerate() {
        harmonics.extend([0, 1, 2].map(|c| colours[c][usize::from(p[c])]));
        if let (Some(palette), Some(stated)) = (&palette, &meta.harmonics) {
            match palette.entry(i) {
                Some(entry) => harmonics.extend(
                    entry
                        .iter()
                        .flat_map(|p| &p[..3])
                        .map(|byte| stated.levels[usize::from(*byte)]),
                ),
                None => {
                    nameless += 1;
                    let others = 3 * (harmonics_count(degree) - 1);
                    harmonics.extend(std::iter::repeat_n(0.0, others));
                }
            }
        }
    }
    if nameless > 0 {
        notes.push(format!(
            "{nameless} splats name harmonics that the palette does not have: they have none"
        ));
    }
    let cloud = SplatCloud {
        positions,
        scales,
        rotations,
        opacities,
        harmonics_degree: degree,
        harmonics,
        rule: SplatRule::of_mark(meta.is_anti_aliased),
        is_linear: false,
        ..SplatCloud::default()
    };
    let mut data = cloud.dataset(path, FORMAT, Vec::new())?;
    data.notes = notes;
    Ok(data)
}

impl Scene<'_> {
    fn fault(&self, name: &str, expected: String, found: String) -> Error {
        let place = format!("image `{}`", clip(name));
        let advice = "export the splats again, or as PLY or SPZ";
        Error::format(self.path, place, expected, found, advice)
    }

    fn positions(&self, meta: &Meta) -> Result<Vec<DVec3>> {
        let [low, high] = &meta.means_files;
        let (low_bytes, high_bytes) = (self.files.bytes(low)?, self.files.bytes(high)?);
        let bytes = low_bytes.len().saturating_add(high_bytes.len());
        let most = FEW_SPLATS.saturating_add(bytes.saturating_mul(SPLATS_PER_BYTE));
        if self.count > most {
            let expected = format!("positions of {} splats", self.count);
            let found = format!("{bytes} bytes with those of the high bytes");
            return Err(self.fault(low, expected, found));
        }
        let low = self.decode(low, &low_bytes)?;
        let high = self.decode(high, &high_bytes)?;
        let [least, most] = meta.bounds;
        let position = |(low, high): (&[u8; 4], &[u8; 4])| {
            DVec3::from([0, 1, 2].map(|axis| {
                let share = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65_535.0;
                let logarithm = least[axis] + (most[axis] - least[axis]) * share;
                logarithm.abs().exp_m1().copysign(logarithm)
            }))
        };
        let pairs = low.pixels.iter().zip(&high.pixels).take(self.count);
        Ok(pairs.map(position).collect())
    }

    /// The image of this name, with at least one pixel per splat.
    fn image(&self, name: &str) -> Result<Image> {
        self.decode(name, &self.files.bytes(name)?)
    }

    fn decode(&self, name: &str, bytes: &[u8]) -> Result<Image> {
        // Rows are filled up, and some writers make squares.
        let most = self.count.saturating_mul(4).saturating_add(FEW_SPLATS);
        let is_right = |[width, height]: [usize; 2]| {
            let pixels = width.saturating_mul(height);
            (self.count..=most).contains(&pixels)
        };
        self.decode_if(
            name,
            bytes,
            is_right,
            format!("a pixel for each of {} splats", self.count),
        )
    }

    /// Decodes an image if `is_right` accepts its size, which is tested before pixels are decoded.
    fn decode_if(
        &self,
        name: &str,
        bytes: &[u8],
        is_right: impl Fn([usize; 2]) -> bool,
        expected: String,
    ) -> Result<Image> {
        let damaged = |refusal: crate::io::picture::samples::Refusal| {
            let found = format!("a file that {refusal}");
            self.fault(name, "a WebP image".into(), found)
        };
        let encoded = Encoded::open(bytes).map_err(damaged)?;
        let [width, height] = encoded.size();
        if !is_right([width, height]) {
            return Err(self.fault(name, expected, format!("{width} x {height} pixels")));
        }
        let pixels = encoded.decode().map_err(damaged)?.rgba8();
        Ok(Image { width, pixels })
    }

    fn palette(&self, stated: &Harmonics) -> Result<Palette> {
        let [colours, numbers] = &stated.files;
        let width = |degree: u8| PALETTE_ROW * (harmonics_count(degree) - 1);
        let is_right = |[found, height]: [usize; 2]| {
            let is_known = match stated.degree {
                Some(degree) => found == width(degree),
                None => (1..=3).any(|degree| found == width(degree)),
            };
            is_known && height <= PALETTE_ROWS
        };
        let expected = match stated.degree {
            Some(degree) => format!("{} pixels a row", width(degree)),
            None => "192, 512 or 960 pixels a row".into(),
        };
        let bytes = self.files.bytes(colours)?;
        let image = self.decode_if(colours, &bytes, is_right, expected)?;
        let degree = (1..=3).find(|degree| image.width == width(*degree));
        let degree = degree.unwrap_or(0);
        let coefficients = harmonics_count(degree) - 1;
        let entries = image.pixels.len() / coefficients.max(1);
        Ok(Palette {
            degree,
            count: stated.count.unwrap_or(entries).min(entries),
            pixels: image.pixels,
            numbers: self.image(numbers)?.pixels,
        })
    }
}

/// Harmonics of degrees above 0 that splats share.
struct Palette {
    degree: u8,
    /// Number of entries.
    count: usize,
    /// A pixel for each coefficient of each entry.
    pixels: Vec<[u8; 4]>,
    /// The entry index of each splat.
    numbers: Vec<[u8; 4]>,
}

impl Palette {
    /// The coefficients of a splat; `None` if its entry does not exist.
    fn entry(&self, splat: usize) -> Option<&[[u8; 4]]> {
        let [low, high, ..] = *self.numbers.get(splat)?;
        let entry = usize::from(u16::from_le_bytes([low, high]));
        let coefficients = harmonics_count(self.degree) - 1;
        let first = entry * coefficients;
        let entry = Some(entry).filter(|entry| *entry < self.count);
        entry.and_then(|_| self.pixels.get(first..first + coefficients))
    }
}

/// A quaternion w, x, y, z; no rotation if the component left out is not stated.
fn rotation([a, b, c, largest]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = largest.checked_sub(FIRST_LARGEST).map(usize::from) else {
        return [1.0, 0.0, 0.0, 0.0];
    };
    let others = [a, b, c].map(|byte| (f32::from(byte) / 127.5 - 1.0) / SQRT_2);
    let mut quaternion = [0.0; 4];
    for (i, other) in (0..4).filter(|&i| i != largest).zip(others) {
        quaternion[i] = other;
    }
    let squares: f32 = others.iter().map(|c| c * c).sum();
    quaternion[largest] = (1.0 - squares).max(0.0).sqrt();
    quaternion
}
