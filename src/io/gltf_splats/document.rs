//! The container, the JSON and the accessors: as much of glTF 2.0 as splats take.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::rc::Rc;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;

use super::{EXTENSION, PACKED};
use crate::error::{Error, Result};
use crate::io::file::Input;
use crate::io::gltf::percent_decoded;

const MAGIC: &[u8; 4] = b"glTF";
/// Bytes before the JSON of a binary file: magic, version, length; the chunk's length and type.
const HEADER: usize = 20;

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Root {
    pub(super) scene: Option<usize>,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
    buffers: Vec<Buffer>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) extensions: Extensions,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Extensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub(super) splats: Option<SplatExtension>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SplatExtension {
    pub(super) kernel: Option<String>,
    pub(super) color_space: Option<String>,
    extensions: BTreeMap<String, PackedExtension>,
}

/// What packs the numbers of a primitive.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct PackedExtension {
    buffer_view: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Accessor {
    buffer_view: Option<usize>,
    byte_offset: u64,
    component_type: u32,
    normalized: bool,
    count: u64,
    #[serde(rename = "type")]
    kind: String,
    sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    byte_offset: u64,
    byte_length: u64,
    byte_stride: Option<u64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Buffer {
    uri: Option<String>,
}

/// An opened file.
pub(super) struct Document<'a> {
    input: Input<'a>,
    pub(super) path: &'a Path,
    /// Bytes of the file.
    pub(super) len: u64,
    pub(super) root: Root,
    /// The binary chunk.
    binary: Option<Rc<Vec<u8>>>,
    /// Buffers that were needed, by their URI.
    loaded: BTreeMap<String, Rc<Vec<u8>>>,
}

/// Whether a file is glTF with splats in it: `head` has its first bytes, the JSON is looked through.
pub(in crate::io) fn looks_like(input: Input<'_>, head: &[u8]) -> bool {
    let is_binary = head.starts_with(MAGIC);
    if !is_binary && crate::io::extension(input.path) != "gltf" {
        return false;
    }
    let Ok((file, _)) = input.open() else {
        return false;
    };
    let json_len = match (is_binary, head.get(12..16)) {
        (true, Some(len)) => (HEADER + word(len) as usize) as u64,
        _ => u64::MAX,
    };
    let mut json = Vec::new();
    let is_read = file.take(json_len).read_to_end(&mut json).is_ok();
    let name = format!("\"{EXTENSION}\"");
    is_read && json.windows(name.len()).any(|w| w == name.as_bytes())
}

fn word(bytes: &[u8]) -> u32 {
    let mut word = [0; 4];
    word.copy_from_slice(&bytes[..4]);
    u32::from_le_bytes(word)
}

impl<'a> Document<'a> {
    /// Reads a file and its JSON, no buffers beside it yet.
    pub(super) fn open(input: Input<'a>) -> Result<Self> {
        let path = input.path;
        let bytes = input.read_all()?;
        let len = bytes.len() as u64;
        let (json, binary) = if bytes.starts_with(MAGIC) {
            chunks(path, &bytes)?
        } else {
            (&bytes[..], None)
        };
        let root: Root = serde_json::from_slice(json).map_err(|e| {
            Error::format(
                path,
                "JSON",
                "a glTF 2.0 document",
                e.to_string(),
                "the file is damaged: get it again",
            )
        })?;
        Ok(Self {
            input,
            path,
            len,
            root,
            binary: binary.map(|b| Rc::new(b.to_vec())),
            loaded: BTreeMap::new(),
        })
    }

    /// An attribute of `N` numbers per point.
    pub(super) fn floats<const N: usize>(
        &mut self,
        primitive: &Primitive,
        name: &str,
    ) -> Result<Vec<[f32; N]>> {
        let path = self.path;
        let fault = |expected: String, found: String, advice: &str| {
            Error::format(path, format!("attribute `{name}`"), expected, found, advice)
        };
        let damaged = "the file is damaged: get it again";
        let Some(&index) = primitive.attributes.get(name) else {
            let splats = primitive.extensions.splats.as_ref();
            let packing = splats.and_then(|e| e.extensions.keys().next());
            return Err(match packing {
                Some(packing) => fault(
                    "numbers that are not packed".into(),
                    format!("the extension `{packing}`"),
                    "save the splats without it",
                ),
                None => fault(
                    "one".into(),
                    "none".into(),
                    "write all that the extension asks for",
                ),
            });
        };
        let missing = |what: &str, i: usize| fault(what.into(), format!("number {i}"), damaged);
        let accessor = (self.root.accessors.get(index))
            .ok_or_else(|| missing("an accessor that is there", index))?;
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        // What the extension and `KHR_mesh_quantization` let be bytes or shorts; harmonics are floats.
        let is_short = ["SCALE", "ROTATION", "OPACITY", "POSITION", "COLOR_0"]
            .iter()
            .any(|n| name.ends_with(n));
        let size: u64 = match accessor.component_type {
            5120 | 5121 if is_short => 1,
            5122 | 5123 if is_short => 2,
            5126 => 4,
            other => {
                let expected = if is_short {
                    "bytes, shorts or floats (5120 to 5123, 5126)"
                } else {
                    "floats (5126)"
                };
                return Err(fault(expected.into(), other.to_string(), damaged));
            }
        };
        if accessor.kind != kind {
            return Err(fault(kind.into(), format!("`{}`", accessor.kind), damaged));
        }
        let (Some(view), None) = (accessor.buffer_view, &accessor.sparse) else {
            let advice = "write all numbers into a buffer";
            return Err(fault(
                "a dense accessor".into(),
                "a sparse one".into(),
                advice,
            ));
        };
        let view = (self.root.buffer_views.get(view))
            .ok_or_else(|| missing("a buffer view that is there", view))?;
        let element = size * N as u64;
        let stride = view.byte_stride.filter(|s| *s > 0).unwrap_or(element);
        let (count, within) = (accessor.count, accessor.byte_offset);
        let (start, view_len, buffer) = (view.byte_offset, view.byte_length, view.buffer);
        let (code, is_normalised) = (accessor.component_type, accessor.normalized);
        let bytes = self.buffer(buffer)?;
        let needed = count
            .saturating_sub(1)
            .saturating_mul(stride)
            .saturating_add(element.min(element.saturating_mul(count)))
            .saturating_add(within);
        let end = start.saturating_add(view_len.max(needed));
        if stride < element || needed > view_len || end > bytes.len() as u64 {
            return Err(fault(
                format!("{count} elements in a view of {view_len} bytes"),
                format!("{needed} bytes needed, {} in the buffer", bytes.len()),
                damaged,
            ));
        }
        // All within `bytes`, whose length is an usize.
        let place = |x: u64| usize::try_from(x).unwrap_or(usize::MAX);
        let [start, stride, size] = [start + within, stride, size].map(place);
        let component = |at: usize| number(&bytes[at..at + size], code, is_normalised);
        Ok((0..place(count))
            .map(|i| std::array::from_fn(|c| component(start + i * stride + c * size)))
            .collect())
    }

    /// The SPZ stream that a primitive's numbers are packed in, or `None` where they are not.
    pub(super) fn packed(&mut self, extension: &SplatExtension) -> Result<Option<Vec<u8>>> {
        let Some(packed) = extension.extensions.get(PACKED) else {
            return Ok(None);
        };
        let path = self.path;
        let fault = |expected: &str, found: String| {
            let advice = "the file is damaged: get it again";
            Error::format(path, PACKED, expected, found, advice)
        };
        let view = (packed.buffer_view).and_then(|index| self.root.buffer_views.get(index));
        let Some(view) = view else {
            let found = packed
                .buffer_view
                .map_or("none".into(), |i| format!("number {i}"));
            return Err(fault("a buffer view that is there", found));
        };
        let (start, len, buffer) = (view.byte_offset, view.byte_length, view.buffer);
        let bytes = self.buffer(buffer)?;
        let bounds = [Some(start), start.checked_add(len)].map(|n| usize::try_from(n?).ok());
        let part = match bounds {
            [Some(start), Some(end)] => bytes.get(start..end),
            _ => None,
        };
        let part = part.ok_or_else(|| {
            let expected = format!("{len} bytes from byte {start} on");
            fault(&expected, format!("{} in the buffer", bytes.len()))
        })?;
        Ok(Some(part.to_vec()))
    }

    /// The bytes of a buffer: the binary chunk, a data URI or a file beside this one.
    fn buffer(&mut self, index: usize) -> Result<Rc<Vec<u8>>> {
        let path = self.path;
        let fault = |expected: &str, found: String, advice: &str| {
            Error::format(path, format!("buffer {index}"), expected, found, advice)
        };
        let Some(buffer) = self.root.buffers.get(index) else {
            let advice = "the file is damaged: get it again";
            return Err(fault("a buffer that is there", "none".into(), advice));
        };
        let Some(uri) = &buffer.uri else {
            let binary = self.binary.clone().filter(|_| index == 0);
            let advice = "the file is cut off or damaged: get it again";
            return binary
                .ok_or_else(|| fault("a binary chunk or a URI", "neither".into(), advice));
        };
        if let Some(bytes) = self.loaded.get(uri) {
            return Ok(bytes.clone());
        }
        let bytes = if let Some(data) = uri.strip_prefix("data:") {
            let text = data.split_once(";base64,").map(|(_, text)| text);
            let bytes = text.and_then(|text| STANDARD.decode(text).ok());
            let advice = "the file is damaged: get it again";
            bytes.ok_or_else(|| fault("data in base64", "another".into(), advice))?
        } else {
            let name = percent_decoded(uri);
            let beside = Path::new(&name);
            if beside.is_absolute() || name.contains("://") {
                let advice = "keep the buffer beside the file";
                return Err(fault("a relative path", format!("`{name}`"), advice));
            }
            self.input
                .read_beside(&path.with_file_name("").join(beside))?
        };
        let bytes = Rc::new(bytes);
        self.loaded.insert(uri.clone(), bytes.clone());
        Ok(bytes)
    }
}

/// JSON and binary chunk of a .glb file.
fn chunks<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>)> {
    let fault = |expected: &str, found: String| {
        let advice = "the file is cut off or damaged: get it again";
        Error::format(path, "header", expected, found, advice)
    };
    let Some((header, rest)) = bytes.split_at_checked(HEADER) else {
        return Err(fault("20 bytes", format!("{} bytes", bytes.len())));
    };
    if word(&header[4..]) != 2 {
        return Err(fault(
            "version 2",
            format!("version {}", word(&header[4..])),
        ));
    }
    if word(&header[16..]).to_le_bytes() != *b"JSON" {
        return Err(fault("a chunk of JSON first", "another".into()));
    }
    let json_len = word(&header[12..]) as usize;
    let Some((json, rest)) = rest.split_at_checked(json_len) else {
        return Err(fault(
            &format!("{json_len} bytes of JSON"),
            format!("{} bytes", rest.len()),
        ));
    };
    let binary = match rest.split_at_checked(8) {
        Some((header, rest)) if &header[4..] == b"BIN\0" => {
            let len = word(header) as usize;
            let Some((binary, _)) = rest.split_at_checked(len) else {
                return Err(fault(
                    &format!("{len} bytes of data"),
                    format!("{} bytes", rest.len()),
                ));
            };
            Some(binary)
        }
        _ => None,
    };
    Ok((json, binary))
}

/// A component as a float, by section 3.11 of the glTF specification where normalised.
fn number(bytes: &[u8], code: u32, is_normalised: bool) -> f32 {
    let (value, most) = match (code, bytes) {
        (5120, &[b]) => (f32::from(i8::from_le_bytes([b])), 127.0),
        (5121, &[b]) => (f32::from(b), 255.0),
        (5122, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32_767.0),
        (5123, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65_535.0),
        (_, bytes) => return f32::from_bits(word(bytes)),
    };
    if is_normalised {
        (value / most).max(-1.0)
    } else {
        value
    }
}
