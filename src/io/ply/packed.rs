//! Reads compressed PLY (PlayCanvas, SuperSplat): splats in sixteen bytes each, in chunks of 256.
//!
//! | element | properties | content |
//! |---|---|---|
//! | `chunk` | `min_x` ... `max_z` | box of the positions of 256 splats |
//! | | `min_scale_x` ... `max_scale_z` | box of the logarithms of their standard deviations |
//! | | `min_r` ... `max_b` | box of their colours; without these from 0 to 1 |
//! | `vertex` | `packed_position` | x, y, z in 11, 10 and 11 bits, from the highest down, each a share of the chunk's box |
//! | | `packed_scale` | the same |
//! | | `packed_rotation` | index of the largest component of the quaternion w, x, y, z, which is left out, in 2 bits; the others in 10 bits each, -√½ to √½ |
//! | | `packed_color` | R, G, B as shares of the chunk's box, the peak opacity; 8 bits each |
//! | `sh` | `f_rest_0..` | the other harmonics, in PLY's order: bytes, -4 to 4 |
//!
//! `packed_write.rs` writes it. A colour is 1/2 + .28209479 c of the constant harmonic's coefficient c, as in .splat files.

use std::f64::consts::SQRT_2;
use std::path::Path;

use glam::DVec3;

use super::body::rows;
use super::header::Header;
use super::table::{Rows, Table};
use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, constant_of_colour};
use crate::error::{Error, Result};
use crate::io::bytes::scalars::ScalarType;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count, narrowed};
use crate::scene::SplatRule;

const FORMAT: &str = "compressed PLY splats";

/// Number of splats in a chunk; the last chunk may have fewer.
pub(in crate::io) const CHUNK: usize = 256;

/// The least and the greatest of three numbers, by the middle of their names.
pub(in crate::io) const BOXES: [[&str; 6]; 3] = [
    ["min_x", "min_y", "min_z", "max_x", "max_y", "max_z"],
    [
        "min_scale_x",
        "min_scale_y",
        "min_scale_z",
        "max_scale_x",
        "max_scale_y",
        "max_scale_z",
    ],
    ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"],
];

/// Whether a header is one of packed splats.
pub(in crate::io) fn is_packed(header: &Header) -> bool {
    let mut vertices = header.elements.iter().filter(|e| e.name == "vertex");
    vertices.any(|e| e.properties.iter().any(|p| p.name == "packed_position"))
}

/// Reads the splats.
///
/// # Errors
/// A body that is shorter than the header states; properties that are missing or of other types; fewer chunks
/// or harmonics than the splats need.
pub(in crate::io) fn read(path: &Path, bytes: &[u8], header: &Header) -> Result<Dataset> {
    let mut notes = Vec::new();
    let mut element = |name: &str| -> Result<Option<Rows<'_>>> {
        let Some(at) = header.elements.iter().position(|e| e.name == name) else {
            return Ok(None);
        };
        notes.clear();
        rows(header, path, bytes, at, None, &mut notes).map(Some)
    };
    let fault = |expected: String, found: String| {
        let advice = "export the splats again, or as uncompressed PLY, .splat or .spz";
        Error::format(path, "compressed PLY", expected, found, advice)
    };
    let missing = |name: &str| fault(format!("an element `{name}`"), "none".into());
    let chunks = element("chunk")?.ok_or_else(|| missing("chunk"))?;
    let vertices = element("vertex")?.ok_or_else(|| missing("vertex"))?;
    let harmonics = element("sh")?;
    let count = vertices.count;
    if chunks.count < count.div_ceil(CHUNK) {
        return Err(fault(
            format!("{} chunks for {count} splats", count.div_ceil(CHUNK)),
            chunks.count.to_string(),
        ));
    }
    if let Some(rows) = harmonics.as_ref().filter(|rows| rows.count != count) {
        return Err(fault(
            format!("harmonics of {count} splats"),
            format!("of {}", rows.count),
        ));
    }

    let chunks = Table {
        path,
        rows: &chunks,
    };
    let bounds = |names: [&str; 6]| -> Result<Bounds> {
        let mut columns = Vec::with_capacity(6);
        for name in names {
            let column = chunks.index(name);
            let column = column
                .ok_or_else(|| fault(format!("chunks with `{name}`"), "chunks without".into()))?;
            columns.push(chunks.numbers(column)?);
        }
        Ok(Bounds(columns))
    };
    let places = bounds(BOXES[0])?;
    let logarithms = bounds(BOXES[1])?;
    let colours = match chunks.index(BOXES[2][0]) {
        Some(_) => Some(bounds(BOXES[2])?),
        None => None,
    };

    let vertices = Table {
        path,
        rows: &vertices,
    };
    let words = |name: &str| -> Result<Vec<u32>> {
        let column = vertices.index(name);
        let column = column
            .ok_or_else(|| fault(format!("splats with `{name}`"), "splats without".into()))?;
        let numbers = vertices.numbers(column)?.into_iter();
        numbers
            .enumerate()
            .map(|(i, n)| {
                word(n).ok_or_else(|| {
                    let expected = format!("`{name}` of splat {i}: 32 bits");
                    fault(expected, n.to_string())
                })
            })
            .collect()
    };
    let packed_positions = words("packed_position")?;
    let packed_scales = words("packed_scale")?;
    let packed_rotations = words("packed_rotation")?;
    let packed_colours = words("packed_color")?;

    let rest = harmonics.as_ref().map(|rows| Table { path, rows });
    let mut rest_columns = Vec::new();
    if let Some(table) = &rest {
        while let Some(column) = table.index(&format!("f_rest_{}", rest_columns.len())) {
            if table.rows.members[column].scalar != ScalarType::U8 {
                let found = format!("`f_rest_{}` of another type", rest_columns.len());
                return Err(fault("harmonics of bytes (uchar)".into(), found));
            }
            rest_columns.push(column);
        }
    }
    let degree = (0..=MAX_HARMONICS_DEGREE)
        .find(|&d| 3 * (harmonics_count(d) - 1) == rest_columns.len())
        .ok_or_else(|| {
            let expected = "0, 9, 24 or 45 properties f_rest_0, f_rest_1, ...";
            fault(expected.into(), rest_columns.len().to_string())
        })?;

    let stride = 3 * harmonics_count(degree);
    let mut coefficients = vec![0.0; count * stride];
    for (i, (set, packed)) in coefficients
        .chunks_exact_mut(stride)
        .zip(&packed_colours)
        .enumerate()
    {
        let shares = [24, 16, 8].map(|low| share(*packed, low, 8));
        let colour = match &colours {
            Some(bounds) => bounds.at(i, shares),
            None => shares,
        };
        for (slot, code) in set.iter_mut().zip(colour) {
            *slot = constant_of_colour(narrowed(code));
        }
    }
    if let Some(table) = &rest {
        let per_channel = rest_columns.len() / 3;
        for (k, &column) in rest_columns.iter().enumerate() {
            let slot = 3 * (k % per_channel + 1) + k / per_channel;
            let bytes = table.floats(column)?;
            for (set, byte) in coefficients.chunks_exact_mut(stride).zip(bytes) {
                set[slot] = coefficient(byte);
            }
        }
    }
    let numbered = |packed: &[u32], bounds: &Bounds| -> Vec<[f64; 3]> {
        let three = |p: u32| [share(p, 21, 11), share(p, 11, 10), share(p, 0, 11)];
        let all = packed.iter().enumerate();
        all.map(|(i, &p)| bounds.at(i, three(p))).collect()
    };
    let cloud = SplatCloud {
        positions: numbered(&packed_positions, &places)
            .into_iter()
            .map(DVec3::from)
            .collect(),
        scales: numbered(&packed_scales, &logarithms)
            .into_iter()
            .map(|s| s.map(|s| narrowed(s.exp())))
            .collect(),
        rotations: packed_rotations.into_iter().map(rotation).collect(),
        opacities: packed_colours
            .iter()
            .map(|&p| narrowed(share(p, 0, 8)))
            .collect(),
        harmonics_degree: degree,
        harmonics: coefficients,
        rule: SplatRule::Inria,
        is_linear: false,
        ..SplatCloud::default()
    };
    let mut data = cloud.dataset(path, FORMAT, Vec::new())?;
    data.notes = notes;
    Ok(data)
}

/// The least and the greatest of three numbers in each chunk: columns in the order of [`BOXES`].
struct Bounds(Vec<Vec<f64>>);

impl Bounds {
    /// Values of shares of a box, in the chunk of splat `i`.
    fn at(&self, i: usize, shares: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let (least, most) = (self.0[axis][i / CHUNK], self.0[axis + 3][i / CHUNK]);
            least + shares[axis] * (most - least)
        })
    }
}

/// `count` bits from bit `low` on, as a share of their greatest number.
fn share(packed: u32, low: u32, count: u32) -> f64 {
    let greatest = (1 << count) - 1;
    f64::from(packed >> low & greatest) / f64::from(greatest)
}

/// The quaternion w, x, y, z.
fn rotation(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let others = [20, 10, 0].map(|low| SQRT_2 * (share(packed, low, 10) - 0.5));
    let squares: f64 = others.iter().map(|c| c * c).sum();
    let mut quaternion = [0.0; 4];
    for (i, other) in (0..4).filter(|&i| i != largest).zip(others) {
        quaternion[i] = narrowed(other);
    }
    quaternion[largest] = narrowed((1.0 - squares).max(0.0).sqrt());
    quaternion
}

/// A harmonic's coefficient. Writers divide the range from -4 to 4 into 256 steps: a byte is a step's middle,
/// but the first and the last byte are the ends of the range.
fn coefficient(byte: f32) -> f32 {
    let share = match byte {
        b if b <= 0.0 => 0.0,
        b if b >= 255.0 => 1.0,
        b => (b + 0.5) / 256.0,
    };
    8.0 * (share - 0.5)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a whole number within the range"
)]
fn word(number: f64) -> Option<u32> {
    let is_word = number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number);
    is_word.then_some(number as u32)
}
