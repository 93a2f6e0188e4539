//! Writes compressed PLY in the layout of `packed.rs`.

use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

use super::packed::{BOXES, CHUNK};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::splats::encoded_splats::{
    Encoded, byte, note_cut, note_faint, note_mark_lost, single_precision_quantum,
};
use crate::io::splats::morton::morton_order;
use crate::math::{HARMONIC_0, harmonics_count};

/// Greatest magnitude of scales' logarithms, to which they are clamped as in PlayCanvas's writers.
const GREATEST_LOGARITHM: f32 = 20.0;

/// Encodes splats, sorted along a Morton curve, so that the 256 of a chunk lie close together.
///
/// # Errors
/// More splats than a header can count.
pub(in crate::io) fn encode(path: &Path, cloud: &SplatCloud) -> Result<Encoded> {
    let count = cloud.positions.len();
    if u32::try_from(count).is_err() {
        let found = count.to_string();
        let advice = "split the scene";
        return Err(Error::format(
            path,
            "splats",
            "fewer than 2^32",
            found,
            advice,
        ));
    }
    let order = morton_order(&cloud.positions);
    let per_channel = harmonics_count(cloud.harmonics_degree) - 1;
    let mut bytes = header(count, 3 * per_channel);
    let mut vertices = Vec::with_capacity(16 * count);
    let mut position_quantum = single_precision_quantum(cloud.positions.iter().copied());
    let [mut cut_scales, mut cut_harmonics, mut faint] = [0; 3];
    for members in order.chunks(CHUNK) {
        let positions: Vec<[f32; 3]> = members
            .iter()
            .map(|&i| cloud.positions[i].as_vec3().to_array())
            .collect();
        let logarithms: Vec<[f32; 3]> = members
            .iter()
            .map(|&i| {
                let logarithms = cloud.thick_scales(i).map(f32::ln);
                let is_cut = |l: &&f32| l.abs() > GREATEST_LOGARITHM;
                cut_scales += logarithms.iter().filter(is_cut).count();
                logarithms.map(|l| l.clamp(-GREATEST_LOGARITHM, GREATEST_LOGARITHM))
            })
            .collect();
        let colours: Vec<[f32; 3]> = members
            .iter()
            .map(|&i| {
                let constant = &cloud.coefficients(i)[..3];
                [0, 1, 2].map(|c| 0.5 + HARMONIC_0 * constant[c])
            })
            .collect();
        let [places, sizes, colour_box] =
            [&positions, &logarithms, &colours].map(|v| Bounds::of(v));
        position_quantum = position_quantum.max(places.step());
        for bounds in [&places, &sizes, &colour_box] {
            for value in bounds.least.into_iter().chain(bounds.most) {
                bytes.extend(value.to_le_bytes());
            }
        }
        for (k, &i) in members.iter().enumerate() {
            let three =
                |[a, b, c]: [f64; 3]| packed(a, 11) << 21 | packed(b, 10) << 11 | packed(c, 11);
            let opacity = f64::from(cloud.opacities[i]);
            let alpha = packed(opacity, 8);
            faint += usize::from(alpha == 0 && opacity > 0.0);
            let [r, g, b] = colour_box.shares(colours[k]).map(|share| packed(share, 8));
            for word in [
                three(places.shares(positions[k])),
                rotation(cloud.unit_rotation(i)),
                three(sizes.shares(logarithms[k])),
                r << 24 | g << 16 | b << 8 | alpha,
            ] {
                vertices.extend(word.to_le_bytes());
            }
        }
    }
    bytes.extend(vertices);
    if per_channel > 0 {
        bytes.reserve_exact(3 * per_channel * count);
        for &i in &order {
            let rest = &cloud.coefficients(i)[3..];
            for channel in 0..3 {
                let others = rest.iter().skip(channel).step_by(3);
                bytes.extend(others.map(|c| harmonic(*c, &mut cut_harmonics)));
            }
        }
    }
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    note_cut(
        &mut notes,
        cut_scales,
        "scales outside 2.1e-9 to 4.9e8 are cut",
    );
    note_cut(
        &mut notes,
        cut_harmonics,
        "colour coefficients outside -4 to 4 are cut",
    );
    note_faint(&mut notes, faint);
    Ok(Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum,
        order,
        notes,
    })
}

/// - `rest`: number of harmonics beyond the constant ones, in all channels.
fn header(count: usize, rest: usize) -> Vec<u8> {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk {}\n",
        count.div_ceil(CHUNK)
    );
    for name in BOXES.as_flattened() {
        header += &format!("property float {name}\n");
    }
    header += &format!("element vertex {count}\n");
    for name in ["position", "rotation", "scale", "color"] {
        header += &format!("property uint packed_{name}\n");
    }
    if rest > 0 {
        header += &format!("element sh {count}\n");
        for i in 0..rest {
            header += &format!("property uchar f_rest_{i}\n");
        }
    }
    header += "end_header\n";
    header.into_bytes()
}

/// The least and the greatest of each component, rounded as in the file.
struct Bounds {
    least: [f32; 3],
    most: [f32; 3],
}

impl Bounds {
    fn of(all: &[[f32; 3]]) -> Self {
        let none = Self {
            least: [f32::INFINITY; 3],
            most: [f32::NEG_INFINITY; 3],
        };
        all.iter().fold(none, |bounds, v| Self {
            least: [0, 1, 2].map(|c| bounds.least[c].min(v[c])),
            most: [0, 1, 2].map(|c| bounds.most[c].max(v[c])),
        })
    }

    fn extent(&self, axis: usize) -> f64 {
        f64::from(self.most[axis]) - f64::from(self.least[axis])
    }

    /// The positions of values between the bounds, from 0 to 1.
    fn shares(&self, values: [f32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| {
            let extent = self.extent(axis);
            let above = f64::from(values[axis]) - f64::from(self.least[axis]);
            if extent > 0.0 { above / extent } else { 0.0 }
        })
    }

    /// The greatest step between neighbouring positions.
    fn step(&self) -> f64 {
        let steps = [2047.0, 1023.0, 2047.0];
        (0..3).fold(0.0, |m: f64, axis| m.max(self.extent(axis) / steps[axis]))
    }
}

/// A share as an integer of `bits` bits.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "at most eleven bits, by the clamp"
)]
fn packed(share: f64, bits: u32) -> u32 {
    let greatest = f64::from((1_u32 << bits) - 1);
    (greatest * share.clamp(0.0, 1.0)).round() as u32
}

/// A unit quaternion w, x, y, z: the index of its largest component, then the others.
fn rotation(q: [f64; 4]) -> u32 {
    let largest = (1..4).fold(0, |m, i| if q[i].abs() > q[m].abs() { i } else { m });
    // q and -q are one rotation: the component left out is made positive.
    let sign = q[largest].signum();
    let others = (0..4).filter(|i| *i != largest);
    let number = u32::try_from(largest).unwrap_or(0);
    others.fold(number, |word, i| {
        word << 10 | packed(0.5 + FRAC_1_SQRT_2 * sign * q[i], 10)
    })
}

/// A harmonic's coefficient: the index of its step among 256 from -4 to 4.
fn harmonic(coefficient: f32, cut: &mut usize) -> u8 {
    let step = 256.0 * (f64::from(coefficient) / 8.0 + 0.5);
    byte(step - 0.5, cut)
}
