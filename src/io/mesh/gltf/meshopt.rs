//! Unpacks buffer views that use `EXT_meshopt_compression` or `KHR_meshopt_compression`. The second adds version 1 of
//! the attribute codec and the filter `COLOR`; otherwise they are the same.
//!
//! | key of the extension | contents |
//! |---|---|
//! | `buffer`, `byteOffset`, `byteLength` | position of the packed bytes |
//! | `mode` | `ATTRIBUTES`: vertices; `TRIANGLES`: indices of a list of triangles; `INDICES`: any indices |
//! | `count`, `byteStride` | number of elements, and bytes of each |
//! | `filter` | conversion of the unpacked elements: `NONE`, `OCTAHEDRAL` (unit vectors), `QUATERNION`, `EXPONENTIAL` (floats of few bits), `COLOR` |
//!
//! The view itself names a fallback buffer, which usually has no bytes. The reader ignores it.
//!
//! Source: the texts of both extensions in Khronos' registry. The crate `meshoptimizer-rs` decodes.

use std::path::Path;

use meshoptimizer_rs::{Error as CodecError, Limits, Workspace, codec};

use super::document::Object;
use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// Names of the extensions, whose members are the same.
const NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// Returns the compression data of a view, if it is packed.
pub(super) fn packed(view: Object<'_>) -> Option<Object<'_>> {
    NAMES.into_iter().find_map(|name| view.extension(name))
}

/// Function that returns a range (offset, length) of the buffer with this index; the last argument is the place for
/// errors.
type PartOf<'a> = dyn Fn(usize, [u64; 2], &str) -> Result<&'a [u8]> + 'a;

/// Access to packed bytes.
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) part: &'a PartOf<'a>,
    /// Number of bytes that may still be unpacked.
    pub(super) room: usize,
}

/// Function that undoes a filter. Its arguments are the bytes of all elements, their number and their size.
type Filter = fn(&mut [u8], usize, usize, &mut Workspace) -> Result<(), CodecError>;

/// Unpacks the bytes of a view that is packed as `stated`.
///
/// # Errors
/// A key is missing or names something that does not exist, there are too many elements for the file's bytes, or the
/// packed bytes are damaged.
pub(super) fn unpack(source: &Source<'_>, stated: Object<'_>, place: &str) -> Result<Vec<u8>> {
    let place = format!("{place}, meshopt");
    let refuse = |expected: String, found: String| {
        let advice = "the file is damaged or breaks the format's rules: export it again";
        Error::format(source.path, place.clone(), expected, found, advice)
    };
    let size = |key: &str| -> Result<usize> {
        Ok(usize::try_from(stated.size(key)?).unwrap_or(usize::MAX))
    };
    let buffer = size("buffer")?;
    let offset = stated.integer("byteOffset")?.unwrap_or(0);
    let range = [offset, stated.size("byteLength")?];
    let packed = (source.part)(buffer, range, &place)?;
    let (count, stride) = (size("count")?, size("byteStride")?);
    let room = source.room;
    if count.checked_mul(stride).is_none_or(|bytes| bytes > room) {
        let expected = format!("{room} bytes at most, unpacked from those that there are");
        let found = format!("{count} elements of {stride} bytes");
        return Err(refuse(expected, found));
    }
    let decode = match stated.word("mode")? {
        Some("ATTRIBUTES") => codec::decode_vertex_buffer,
        Some("TRIANGLES") => codec::decode_index_buffer,
        Some("INDICES") => codec::decode_index_sequence,
        other => {
            let found = other.map_or("none".into(), |other| format!("`{}`", clip(other)));
            let expected = "a mode `ATTRIBUTES`, `TRIANGLES` or `INDICES`";
            return Err(refuse(expected.into(), found));
        }
    };
    let filter: Option<Filter> = match stated.word("filter")?.unwrap_or("NONE") {
        "NONE" => None,
        "OCTAHEDRAL" => Some(codec::decode_filter_oct),
        "QUATERNION" => Some(codec::decode_filter_quat),
        "EXPONENTIAL" => Some(codec::decode_filter_exp),
        "COLOR" => Some(codec::decode_filter_color),
        other => {
            let expected = "a filter `NONE`, `OCTAHEDRAL`, `QUATERNION`, `EXPONENTIAL` or `COLOR`";
            return Err(refuse(expected.into(), format!("`{}`", clip(other))));
        }
    };
    let mut workspace = Workspace::new(Limits {
        max_bytes: room,
        ..Limits::default()
    });
    let unpacked = decode(count, stride, packed, &mut workspace).and_then(|mut bytes| {
        if let Some(filter) = filter {
            filter(&mut bytes, count, stride, &mut workspace)?;
        }
        Ok(bytes)
    });
    unpacked.map_err(|error| {
        let expected = format!("{count} elements of {stride} bytes, packed");
        refuse(expected, error.to_string())
    })
}
