//! Finds the records of Fortran's unformatted files: a mark of four bytes with the number of bytes that follow, these bytes,
//! and the mark again.

use std::ops::Range;

/// Bytes of a mark.
pub(in crate::io) const MARK: usize = 4;

/// Returns the number in the four bytes at a place; `None` beyond the end.
pub(in crate::io) fn word(bytes: &[u8], at: usize, big_endian: bool) -> Option<u32> {
    let bytes = *bytes.get(at..)?.first_chunk()?;
    Some(match big_endian {
        true => u32::from_be_bytes(bytes),
        false => u32::from_le_bytes(bytes),
    })
}

/// Returns the place of the bytes of the record that begins with a mark at `at`.
///
/// # Errors
/// The mark, if it is not repeated behind as many bytes; `None` if there is no mark.
pub(in crate::io) fn record(
    bytes: &[u8],
    at: usize,
    big_endian: bool,
) -> Result<Range<usize>, Option<u32>> {
    let mark = word(bytes, at, big_endian).ok_or(None)?;
    let start = at + MARK;
    let end = usize::try_from(mark)
        .ok()
        .and_then(|len| start.checked_add(len));
    end.filter(|end| word(bytes, *end, big_endian) == Some(mark))
        .map(|end| start..end)
        .ok_or(Some(mark))
}
