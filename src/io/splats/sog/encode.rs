//! Encodes scenes of version 2, as archives or as folders.

use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

use image_webp::{ColorType, EncoderParams, EncodingError, WebPEncoder};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::codebook::{codebook, nearest};
use super::decode::{FIRST_LARGEST, PALETTE_ROW};
use super::meta::Levels;
use super::palette::{Palette, palette};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::bytes::zip_write::stored;
use crate::io::splats::encoded_splats::{Encoded, byte, note_faint, opacity_byte};
use crate::io::splats::morton::morton_order;
use crate::io::splats::sog::files::META;
use crate::math::harmonics_count;

/// Greatest side of an image in pixels: the limit of WebP.
const MOST_SIDE: usize = 1 << 14;

/// Sides of images are multiples of this many pixels, as in PlayCanvas's own writer.
const SIDE_STEP: usize = 4;

/// Greatest number of entries that indices of 16 bits can address.
const MOST_ENTRIES: usize = 1 << 16;

/// Scenes with at most this many splats have an entry for each different splat.
const FEW_SPLATS: usize = 2048;

/// An image: its name, its width and its pixels.
type Image = (&'static str, usize, Vec<[u8; 4]>);

/// The splats of a scene, in the order of the file.
struct Scene<'a> {
    cloud: &'a SplatCloud,
    order: Vec<usize>,
    width: usize,
    /// Number of pixels of each image.
    pixels: usize,
}

/// Encodes splats, sorted along a Morton curve: neighbours in images are then alike, and are
/// compressed better.
///
/// - `is_archive`: true for one archive of all files; false for `meta.json` with the images beside it.
///
/// # Errors
/// More splats than images have pixels, or than an archive can hold.
pub(in crate::io) fn encode(path: &Path, cloud: &SplatCloud, is_archive: bool) -> Result<Encoded> {
    let count = cloud.positions.len();
    let too_many = |expected: String| {
        let found = count.to_string();
        Error::format(path, "splats", expected, found, "split the scene")
    };
    let width = (count as f64).sqrt().ceil();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the root of a count"
    )]
    let width = (width as usize).next_multiple_of(SIDE_STEP);
    if width > MOST_SIDE {
        return Err(too_many(format!("at most {}", MOST_SIDE * MOST_SIDE)));
    }
    let height = count.div_ceil(width).next_multiple_of(SIDE_STEP);
    let scene = Scene {
        cloud,
        order: morton_order(&cloud.positions),
        width,
        pixels: width * height,
    };
    let mut notes = Vec::new();
    let (means, bounds, position_quantum) = scene.means();
    let (scales, scale_levels) = scene.scales(&mut notes);
    let (colours, colour_levels) = scene.colours(&mut notes);
    let mut meta = json!({
        "version": 2,
        "asset": { "generator": concat!("ewa-splat ", env!("CARGO_PKG_VERSION")) },
        "count": count,
        "antialias": cloud.rule.is_anti_aliased(),
        "means": { "mins": bounds[0], "maxs": bounds[1], "files": [means[0].0, means[1].0] },
        "scales": { "codebook": scale_levels.to_vec(), "files": [scales.0] },
        "sh0": { "codebook": colour_levels.to_vec(), "files": [colours.0] },
    });
    let [low, high] = means;
    let quats = scene.quats();
    meta["quats"] = json!({ "files": [quats.0] });
    let mut images = vec![low, high, scales, quats, colours];
    if cloud.harmonics_degree > 0 {
        let (of_palette, stated) = scene.harmonics(&mut notes);
        meta["shN"] = stated;
        images.extend(of_palette);
    }
    let packed: std::result::Result<Vec<_>, _> = images
        .par_iter()
        .map(|(name, width, pixels)| Ok((*name, webp(*width, pixels)?)))
        .collect();
    let packed = packed.map_err(|e: EncodingError| {
        let found = e.to_string();
        Error::format(path, "images", "WebP", found, "write another format")
    })?;
    let meta = meta.to_string();
    let (bytes, beside) = if is_archive {
        let files: Vec<(&str, &[u8])> = std::iter::once((META, meta.as_bytes()))
            .chain(packed.iter().map(|(name, bytes)| (*name, &bytes[..])))
            .collect();
        let bytes = stored(&files);
        let expected = || too_many("fewer: an archive has 4 GiB".into());
        (bytes.ok_or_else(expected)?, Vec::new())
    } else {
        (meta.into_bytes(), packed)
    };
    Ok(Encoded {
        bytes,
        beside,
        position_quantum,
        order: scene.order,
        notes,
    })
}

impl Scene<'_> {
    /// An image with a pixel for each splat, and unused pixels to the end of the last row.
    fn image(&self, name: &'static str, pixel: impl FnMut(usize) -> [u8; 4]) -> Image {
        let mut pixels: Vec<[u8; 4]> = self.order.iter().copied().map(pixel).collect();
        pixels.resize(self.pixels, [0, 0, 0, 255]);
        (name, self.width, pixels)
    }

    /// Images of the low and high bytes of positions, the least and the greatest logarithms, and the greatest
    /// step.
    fn means(&self) -> ([Image; 2], [[f64; 3]; 2], f64) {
        let positions = &self.cloud.positions;
        let logarithm = |x: f64| x.abs().ln_1p().copysign(x);
        let logarithms = |axis: usize| positions.iter().map(move |p| logarithm(p[axis]));
        let least = [0, 1, 2].map(|axis| logarithms(axis).fold(f64::INFINITY, f64::min));
        let most = [0, 1, 2].map(|axis| logarithms(axis).fold(f64::NEG_INFINITY, f64::max));
        let place = |i: usize, axis: usize| {
            let extent = most[axis] - least[axis];
            let above = logarithm(positions[i][axis]) - least[axis];
            let share = if extent > 0.0 { above / extent } else { 0.0 };
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "at most 65,535, by the clamp"
            )]
            let place = (65_535.0 * share).round().clamp(0.0, 65_535.0) as u16;
            place.to_le_bytes()
        };
        let quantum = (0..3).fold(0.0_f64, |quantum, axis| {
            let farthest = least[axis].abs().max(most[axis].abs()).exp();
            quantum.max((most[axis] - least[axis]) / 65_535.0 * farthest)
        });
        let [low, high] = [("means_l.webp", 0), ("means_u.webp", 1)].map(|(name, half)| {
            self.image(name, |i| {
                let [x, y, z] = [0, 1, 2].map(|axis| place(i, axis)[half]);
                [x, y, z, 255]
            })
        });
        ([low, high], [least, most], quantum)
    }

    fn quats(&self) -> Image {
        self.image("quats.webp", |i| {
            let q = self.cloud.unit_rotation(i);
            let largest = (1..4).fold(0, |m, i| if q[i].abs() > q[m].abs() { i } else { m });
            // q and -q are one rotation: the component left out is made positive.
            let sign = q[largest].signum();
            let mut pixel = [0; 4];
            for (slot, i) in pixel.iter_mut().zip((0..4).filter(|&i| i != largest)) {
                *slot = byte(255.0 * (0.5 + FRAC_1_SQRT_2 * sign * q[i]), &mut 0);
            }
            pixel[3] = FIRST_LARGEST.saturating_add(u8::try_from(largest).unwrap_or(0));
            pixel
        })
    }

    fn scales(&self, notes: &mut Vec<String>) -> (Image, Levels) {
        let logarithms = |i: usize| self.cloud.thick_scales(i).map(f32::ln);
        let all: Vec<f32> = (0..self.order.len()).flat_map(logarithms).collect();
        let levels = codebook(all.clone());
        note_errors(notes, "logarithms of scales", &all, &levels);
        let image = self.image("scales.webp", |i| {
            let [x, y, z] = logarithms(i).map(|logarithm| nearest(&levels, logarithm));
            [x, y, z, 255]
        });
        (image, levels)
    }

    fn colours(&self, notes: &mut Vec<String>) -> (Image, Levels) {
        let constants = |i: usize| &self.cloud.coefficients(i)[..3];
        let all: Vec<f32> = (0..self.order.len()).flat_map(constants).copied().collect();
        let levels = codebook(all.clone());
        note_errors(notes, "constant colour coefficients", &all, &levels);
        let mut faint = 0;
        let image = self.image("sh0.webp", |i| {
            let alpha = opacity_byte(self.cloud, i, &mut faint);
            let [r, g, b] = [0, 1, 2].map(|c| nearest(&levels, constants(i)[c]));
            [r, g, b, alpha]
        });
        note_faint(notes, faint);
        (image, levels)
    }

    /// The palette of the other harmonics, the splats' indices in it, and the metadata of both.
    fn harmonics(&self, notes: &mut Vec<String>) -> ([Image; 2], Value) {
        let coefficients = harmonics_count(self.cloud.harmonics_degree) - 1;
        let components = 3 * coefficients;
        let others = |i: &usize| &self.cloud.coefficients(*i)[3..];
        let sets: Vec<f32> = self.order.iter().flat_map(others).copied().collect();
        let Palette { entries, labels } = palette(&sets, components, entry_count(self.order.len()));
        let levels = codebook(entries.clone());
        let codes: Vec<u8> = entries.iter().map(|&x| nearest(&levels, x)).collect();
        let count = entries.len() / components;
        let written = |label: u16| &codes[usize::from(label) * components..][..components];
        let squares: f64 = sets
            .chunks_exact(components)
            .zip(&labels)
            .flat_map(|(set, &label)| set.iter().zip(written(label)))
            .map(|(x, code)| f64::from(x - levels[usize::from(*code)]).powi(2))
            .sum();
        if squares > 0.0 {
            notes.push(format!(
                "harmonics of {} splats are those of {count}: off by {:.2e} (root mean square)",
                labels.len(),
                (squares / sets.len() as f64).sqrt()
            ));
        }

        let width = PALETTE_ROW * coefficients;
        let mut pixels: Vec<[u8; 4]> = codes
            .chunks_exact(3)
            .map(|rgb| [rgb[0], rgb[1], rgb[2], 255])
            .collect();
        pixels.resize(pixels.len().next_multiple_of(width), [0, 0, 0, 255]);
        let mut labels = labels.iter().map(|label| {
            let [low, high] = label.to_le_bytes();
            [low, high, 0, 255]
        });
        // The sets are already in the order of the images.
        let labels = self.image("shN_labels.webp", |_| labels.next().unwrap_or_default());
        let palette = ("shN_centroids.webp", width, pixels);
        let stated = json!({
            "count": count,
            "bands": self.cloud.harmonics_degree,
            "codebook": levels.to_vec(),
            "files": [palette.0, labels.0],
        });
        ([palette, labels], stated)
    }
}

/// Greatest number of entries in a palette for this many splats: the greatest power of two up to their number,
/// as in PlayCanvas's own writer.
fn entry_count(splats: usize) -> usize {
    if splats <= FEW_SPLATS {
        return splats;
    }
    (1 << splats.ilog2()).min(MOST_ENTRIES)
}

/// Adds a note on the errors of numbers quantised to levels, if there are any.
fn note_errors(notes: &mut Vec<String>, what: &str, values: &[f32], levels: &Levels) {
    let error = |v: &f32| f64::from((v - levels[usize::from(nearest(levels, *v))]).abs());
    let squares: f64 = values.iter().map(|v| error(v).powi(2)).sum();
    if squares > 0.0 {
        let most = values.iter().map(error).fold(0.0, f64::max);
        notes.push(format!(
            "{what} are rounded to 256 numbers: off by {:.2e} (root mean square), {most:.2e} at most",
            (squares / values.len() as f64).sqrt()
        ));
    }
}

/// A lossless WebP image, with or without prediction from neighbours, whichever is smaller.
fn webp(width: usize, pixels: &[[u8; 4]]) -> std::result::Result<Vec<u8>, EncodingError> {
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let [width, height] = [width, pixels.len() / width].map(side);
    let encoded = |use_predictor_transform: bool| {
        let mut bytes = Vec::new();
        let mut encoder = WebPEncoder::new(&mut bytes);
        let mut params = EncoderParams::default();
        params.use_predictor_transform = use_predictor_transform;
        encoder.set_params(params);
        encoder.encode(pixels.as_flattened(), width, height, ColorType::Rgba8)?;
        Ok::<_, EncodingError>(bytes)
    };
    let (predicted, plain) = (encoded(true)?, encoded(false)?);
    Ok(if plain.len() < predicted.len() {
        plain
    } else {
        predicted
    })
}
