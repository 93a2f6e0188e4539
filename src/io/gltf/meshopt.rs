//! Buffer views that are packed by `EXT_meshopt_compression` or `KHR_meshopt_compression`, which are the same but for
//! version 1 of the codec of attributes and the filter `COLOR`, which the second has.
//!
//! | key of the extension | what it says |
//! |---|---|
//! | `buffer`, `byteOffset`, `byteLength` | where the packed bytes are |
//! | `mode` | `ATTRIBUTES`: vertices; `TRIANGLES`: indices of a list of triangles; `INDICES`: any indices |
//! | `count`, `byteStride` | how many elements there are, of so many bytes |
//! | `filter` | what is done to the elements after that: `NONE`, `OCTAHEDRAL` (unit vectors), `QUATERNION`, `EXPONENTIAL` (floats of few bits), `COLOR` |
//!
//! The view itself names a fallback buffer, which mostly has no bytes: it is not read.
//!
//! Source: the texts of both extensions in Khronos' registry. The crate `meshoptimizer-rs` decodes.

use std::path::Path;

use gltf_json::buffer::View;
use meshoptimizer_rs::{Error as CodecError, Limits, Workspace, codec};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::io::vtk_xml::clip;

/// The extensions, which are stated alike.
const NAMES: [&str; 2] = ["KHR_meshopt_compression", "EXT_meshopt_compression"];

/// What a view says of how it is packed.
pub(super) fn packed(view: &View) -> Option<&Value> {
    let others = &view.extensions.as_ref()?.others;
    NAMES.iter().find_map(|name| others.get(*name))
}

/// Gives `length` bytes from `offset` on of a buffer by its number; the place is for errors.
type PartOf<'a> = dyn Fn(usize, [u64; 2], &str) -> Result<&'a [u8]> + 'a;

/// Where packed bytes come from.
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    pub(super) part: &'a PartOf<'a>,
    /// How many bytes may still be unpacked.
    pub(super) room: usize,
}

/// Undoes a filter: of all elements, how many there are, and their size.
type Filter = fn(&mut [u8], usize, usize, &mut Workspace) -> Result<(), CodecError>;

/// The bytes of a view that is packed as `stated`.
///
/// # Errors
/// Keys that are missing or name what is not there, more elements than the file's bytes may stand for, and packed bytes
/// that are damaged.
pub(super) fn unpack(source: &Source<'_>, stated: &Value, place: &str) -> Result<Vec<u8>> {
    let place = format!("{place}, meshopt");
    let refuse = |expected: String, found: String| {
        let advice = "the file is damaged or breaks the format's rules: export it again";
        Error::format(source.path, place.clone(), expected, found, advice)
    };
    let number = |key: &str, otherwise: Option<u64>| {
        let number = match &stated[key] {
            Value::Null => otherwise,
            value => value.as_u64(),
        };
        number.ok_or_else(|| {
            let found = clip(&stated[key].to_string());
            refuse(format!("a number `{key}`"), found)
        })
    };
    let size = |key: &str| {
        let number = number(key, None)?;
        Ok(usize::try_from(number).unwrap_or(usize::MAX))
    };
    let buffer = size("buffer")?;
    let range = [number("byteOffset", Some(0))?, number("byteLength", None)?];
    let packed = (source.part)(buffer, range, &place)?;
    let (count, stride) = (size("count")?, size("byteStride")?);
    let room = source.room;
    if count.checked_mul(stride).is_none_or(|bytes| bytes > room) {
        let expected = format!("{room} bytes at most, unpacked from those that there are");
        let found = format!("{count} elements of {stride} bytes");
        return Err(refuse(expected, found));
    }
    let decode = match stated["mode"].as_str() {
        Some("ATTRIBUTES") => codec::decode_vertex_buffer,
        Some("TRIANGLES") => codec::decode_index_buffer,
        Some("INDICES") => codec::decode_index_sequence,
        _ => {
            let found = clip(&stated["mode"].to_string());
            let expected = "a mode `ATTRIBUTES`, `TRIANGLES` or `INDICES`";
            return Err(refuse(expected.into(), found));
        }
    };
    let filter: Option<Filter> = match stated["filter"].as_str().unwrap_or("NONE") {
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
