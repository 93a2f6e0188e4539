//! Converts the colours and columns of point clouds; the readers of point clouds share it.
//!
//! Scanners store display (sRGB-encoded) colours as bytes, 16-bit words or fractions of a range that the file states.

#[cfg(feature = "e57")]
pub(super) mod e57;
pub(super) mod las;
pub(super) mod pcd;
pub(super) mod xyz;

use super::particles::table::scalar_field;
use crate::data::dataset::Field;
use crate::image::linear_from_srgb;
use crate::scene::Values;

/// Advice for a file that breaks its format's rules.
pub(super) const DAMAGED: &str =
    "the file is damaged or cut off: copy it again or save it with the program that wrote it";

/// Returns the fields of sRGB-encoded red, green and blue from 0 to 1. They are bytes `red`, `green`, `blue` if all are
/// whole 255ths, and linear numbers `r`, `g`, `b` otherwise.
pub(super) fn colour_fields(encoded: [Vec<f32>; 3]) -> Vec<Field> {
    /// Tolerance in steps of a byte: the rounding of a quotient in single precision.
    const ROUNDING: f32 = 1e-3;
    let is_byte = |x: &f32| {
        let byte = x * 255.0;
        (0.0..=255.0).contains(&byte) && (byte - byte.round()).abs() < ROUNDING
    };
    let are_bytes = encoded.iter().flatten().all(is_byte);
    let names = match are_bytes {
        true => ["red", "green", "blue"],
        false => ["r", "g", "b"],
    };
    let column = |channel: Vec<f32>| match are_bytes {
        true => Values::U8(channel.iter().map(|x| byte(x * 255.0)).collect()),
        false => Values::F32(channel.into_iter().map(linear_from_srgb).collect()),
    };
    let columns = names.into_iter().zip(encoded);
    columns
        .map(|(name, channel)| scalar_field(name, column(channel)))
        .collect()
}

fn byte(x: f32) -> u8 {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the caller found it between 0 and 255"
    )]
    {
        x.round() as u8
    }
}

/// Returns a column. It has 16-bit integers if all numbers are whole and lie from 0 to 65,535.
pub(super) fn column(name: &str, numbers: &[f64]) -> Field {
    let is_word = |x: &f64| (0.0..=65535.0).contains(x) && x.fract() == 0.0;
    let values = match numbers.iter().all(is_word) {
        true =>
        {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "found whole and in the range"
            )]
            Values::U16(numbers.iter().map(|x| *x as u16).collect())
        }
        false => numbers.to_vec().into(),
    };
    scalar_field(name, values)
}
