//! Encodes values of any type as the bytes that ranks send to one another, and decodes them.

use crate::error::Result;
use crate::message::{put, take, unknown};
use crate::scene::Values;

/// Appends values. Floating-point values carry their precision, which differs from rank to rank.
pub(super) fn put_values(bytes: &mut Vec<u8>, values: &Values) {
    match values {
        Values::U8(values) => put(bytes, values),
        Values::I16(values) => put(bytes, values),
        Values::U16(values) => put(bytes, values),
        Values::F32(values) => {
            put(bytes, &[4_u8]);
            put(bytes, values);
        }
        Values::F64(values) => {
            put(bytes, &[8_u8]);
            put(bytes, values);
        }
    }
}

/// Takes values of the same type as `alike`; floating-point values may have either precision.
///
/// # Errors
/// The errors of [`take`].
pub(super) fn take_values(bytes: &mut &[u8], alike: &Values) -> Result<Values> {
    Ok(match alike {
        Values::U8(_) => Values::U8(take(bytes)?),
        Values::I16(_) => Values::I16(take(bytes)?),
        Values::U16(_) => Values::U16(take(bytes)?),
        Values::F32(_) | Values::F64(_) => match take::<u8>(bytes)?[..] {
            [4] => Values::F32(take(bytes)?),
            [8] => Values::F64(take(bytes)?),
            _ => return Err(unknown("values of no precision")),
        },
    })
}
