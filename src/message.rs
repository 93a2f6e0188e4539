//! Encodes records as the bytes that ranks send to one another, and decodes them.

use bytemuck::Pod;

use crate::error::{Error, Result};

/// Appends the number of the records, then the records.
pub(crate) fn put<T: Pod>(bytes: &mut Vec<u8>, records: &[T]) {
    bytes.extend_from_slice(&(records.len() as u64).to_le_bytes());
    bytes.extend_from_slice(bytemuck::cast_slice(records));
}

/// Takes records off the beginning of bytes, as [`put`] appended them.
///
/// # Errors
/// Fewer bytes than announced: no rank of this program sends that.
pub(crate) fn take<T: Pod>(bytes: &mut &[u8]) -> Result<Vec<T>> {
    let short = || unknown("fewer bytes");
    let (count, rest) = bytes.split_first_chunk::<8>().ok_or_else(short)?;
    let size = usize::try_from(u64::from_le_bytes(*count)).ok();
    let size = size.and_then(|count| count.checked_mul(size_of::<T>()));
    let size = size.filter(|size| *size <= rest.len()).ok_or_else(short)?;
    let (records, rest) = rest.split_at(size);
    *bytes = rest;
    Ok(bytemuck::pod_collect_to_vec(records))
}

/// Returns the error that another rank sent a message that no rank of this program sends.
pub(crate) fn unknown(found: &str) -> Error {
    let advice = "start the same program on every rank";
    let expected = "records as this program sends them";
    Error::invalid("ranks", "message", expected, found, advice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_and_short_messages_are_refused() {
        let mut bytes = vec![7];
        put(&mut bytes, &[1.5_f64, -2.0]);
        put::<u16>(&mut bytes, &[]);
        put(&mut bytes, &[3_u16, 4, 5]);
        let whole = bytes.clone();
        let mut rest = &whole[1..];
        assert_eq!(take::<f64>(&mut rest).unwrap(), [1.5, -2.0]);
        assert!(take::<u16>(&mut rest).unwrap().is_empty());
        assert_eq!(take::<u16>(&mut rest).unwrap(), [3, 4, 5]);
        assert!(rest.is_empty() && take::<u16>(&mut rest).is_err());
        let mut short = &whole[1..20];
        assert!(take::<f64>(&mut short).is_err());
        let mut endless: &[u8] = &[0xff; 16];
        assert!(take::<f64>(&mut endless).is_err());
    }
}
