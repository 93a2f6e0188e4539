//! Writes splats as a .glb or .gltf file.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use serde_json::{Value, json};

use super::super::encoded_splats::{Encoded, note_mark_lost, offset, single_precision_quantum};
use super::{BY_DEPTH, BY_DISTANCE, EXTENSION, LINEAR, harmonic_name};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::math::narrowed;

/// Containers of glTF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Container {
    /// `.glb`: the document and its numbers, one after the other.
    Binary,
    /// `.gltf`: the document, which holds its numbers in base64.
    Text,
}

/// Returns a file with one node and one mesh of points, all numbers in f32.
pub(in crate::io) fn encode(
    path: &Path,
    cloud: &SplatCloud,
    as_container: Container,
) -> Result<Encoded> {
    let count = cloud.positions.len();
    let offset = offset(&cloud.positions);
    let positions: Vec<[f32; 3]> = cloud
        .positions
        .iter()
        .map(|p| (*p - offset).as_vec3().to_array())
        .collect();
    let mut attributes = Attributes::default();
    attributes.push("POSITION".into(), "VEC3", positions.iter().copied());
    let bounds = |pick: fn(f32, f32) -> f32| {
        let all = positions.iter().copied();
        all.reduce(|a, b| [0, 1, 2].map(|c| pick(a[c], b[c])))
    };
    attributes.accessors[0]["min"] = json!(bounds(f32::min));
    attributes.accessors[0]["max"] = json!(bounds(f32::max));
    let name = |what: &str| format!("{EXTENSION}:{what}");
    let rotations = (0..count).map(|i| {
        let [w, x, y, z] = cloud.unit_rotation(i);
        [x, y, z, w].map(narrowed)
    });
    attributes.push(name("ROTATION"), "VEC4", rotations);
    attributes.push(
        name("SCALE"),
        "VEC3",
        (0..count).map(|i| cloud.thick_scales(i)),
    );
    attributes.push(
        name("OPACITY"),
        "SCALAR",
        cloud.opacities.iter().map(|a| [*a]),
    );
    let mut k = 0;
    for degree in 0..=cloud.harmonics_degree {
        for n in 0..=2 * usize::from(degree) {
            let of = |i: usize| {
                let set = cloud.coefficients(i);
                [set[3 * k], set[3 * k + 1], set[3 * k + 2]]
            };
            attributes.push(name(&harmonic_name(degree, n)), "VEC3", (0..count).map(of));
            k += 1;
        }
    }
    let Attributes {
        names,
        mut accessors,
        views,
        bytes: binary,
    } = attributes;
    for accessor in &mut accessors {
        accessor["count"] = json!(count);
    }
    let mut node = json!({ "mesh": 0 });
    if offset != DVec3::ZERO {
        node["translation"] = json!(offset.to_array());
    }
    let names: serde_json::Map<String, Value> = names
        .into_iter()
        .enumerate()
        .map(|(i, name)| (name, json!(i)))
        .collect();
    let mut buffer = json!({ "byteLength": binary.len() });
    if as_container == Container::Text {
        let text = STANDARD.encode(&binary);
        buffer["uri"] = json!(format!("data:application/octet-stream;base64,{text}"));
    }
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("ewa-splat ", env!("CARGO_PKG_VERSION")) },
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{
            "mode": 0,
            "attributes": names,
            "extensions": { EXTENSION: {
                "kernel": "ellipse",
                "sortingMethod": if cloud.by_distance { BY_DISTANCE } else { BY_DEPTH },
                "colorSpace": if cloud.is_linear { LINEAR } else { "srgb_rec709_display" },
                "projection": "perspective",
            } },
        }] }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [buffer],
    });
    let document = document.to_string().into_bytes();
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    Ok(Encoded {
        beside: Vec::new(),
        bytes: match as_container {
            Container::Binary => container(path, document, &binary)?,
            Container::Text => document,
        },
        position_quantum: single_precision_quantum(cloud.positions.iter().map(|p| *p - offset)),
        order: Vec::new(),
        notes,
    })
}

/// Attributes, each an accessor with its own view.
#[derive(Default)]
struct Attributes {
    names: Vec<String>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    bytes: Vec<u8>,
}

impl Attributes {
    fn push<const N: usize>(
        &mut self,
        name: String,
        kind: &str,
        values: impl Iterator<Item = [f32; N]>,
    ) {
        let start = self.bytes.len();
        self.bytes
            .extend(values.flatten().flat_map(f32::to_le_bytes));
        self.accessors.push(json!({
            "bufferView": self.views.len(), "componentType": 5126, "type": kind,
        }));
        self.views.push(json!({
            "buffer": 0, "byteOffset": start, "byteLength": self.bytes.len() - start,
            // Code of vertex data (`ARRAY_BUFFER`).
            "target": 34962,
        }));
        self.names.push(name);
    }
}

/// Returns the two chunks with their headers, padded to four bytes. Spaces pad the JSON; the binary chunk consists of
/// whole words.
fn container(path: &Path, mut json: Vec<u8>, binary: &[u8]) -> Result<Vec<u8>> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let len = 12 + 8 + json.len() + 8 + binary.len();
    let Ok(len_u32) = u32::try_from(len) else {
        return Err(Error::format(
            path,
            "size",
            "fewer than 2^32 bytes",
            len.to_string(),
            "split the scene, or write .ply",
        ));
    };
    // Both chunks are shorter than the file.
    let chunk_len = |len: usize| u32::try_from(len).unwrap_or(len_u32).to_le_bytes();
    let mut bytes = Vec::with_capacity(len);
    bytes.extend(b"glTF");
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(len_u32.to_le_bytes());
    bytes.extend(chunk_len(json.len()));
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend(chunk_len(binary.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    Ok(bytes)
}
