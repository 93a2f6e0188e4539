//! glTF 2.0: meshes with their materials, textures and places, as JSON with binary buffers
//! (`.gltf`), or all in one file (`.glb`).
//!
//! Shown is the default scene (else the first, else all nodes) in its rest pose: nodes'
//! transforms in f64, skins by their joints, morph targets by their default weights. Base
//! colours, emission and opacity are read; what only light would show is not.
//!
//! | extension | what is made of it |
//! |---|---|
//! | `KHR_texture_transform`, `KHR_mesh_quantization`, `KHR_materials_emissive_strength`, `EXT_mesh_gpu_instancing`, `EXT_texture_webp`, `KHR_texture_basisu` | as it says |
//! | `EXT_meshopt_compression`, `KHR_meshopt_compression` | views are unpacked: see [`meshopt`] |
//! | `KHR_draco_mesh_compression` | primitives are unpacked, with the feature `draco` |
//! | `KHR_materials_pbrSpecularGlossiness` | its diffuse colour, where the material has no other |
//! | `KHR_materials_unlit`, and those in [`OF_LIGHT`] | nothing: they change no colour or shape |
//! | others | nothing and a note; refused by name where the file requires them |
//!
//! The crate `gltf-json` supplies the types of the JSON; all that indexes or counts is checked here
//! before it is used.

mod accessor;
mod container;
#[cfg(feature = "draco")]
mod draco;
mod materials;
mod meshopt;
mod nodes;
mod primitives;

use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use gltf_json::Root;
use serde_json::Value;

pub(crate) use container::looks_like;
pub(super) use container::percent_decoded;

use super::dataset::{Dataset, Geometry};
use super::file::Input;
use super::mesh_part::{LeftOut, check_not_empty, finish};
use super::vtk_xml::clip;
use super::{Mesh, MeshPart};
use crate::error::{Error, Result};
use container::Buffers;
use materials::Materials;
use nodes::Nodes;
use primitives::{PrimitiveReader, Shape};

/// The most corners that all triangles, lines and points of a scene may have together. Nodes and instances share
/// meshes, so a small file can state a scene of any size.
const MOST_CORNERS: usize = 1 << 27;

/// Extensions that are read.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    #[cfg(feature = "draco")]
    DRACO,
    "EXT_texture_webp",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Extensions that change neither shape nor base colour.
const OF_LIGHT: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_variants",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];

/// What packs the meshes of whole primitives.
const DRACO: &str = "KHR_draco_mesh_compression";

/// Reads a scene.
///
/// # Errors
/// JSON or buffers that break the format's rules or are not there, required extensions that are
/// not read, and scenes without triangles, lines or points.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let (json, bin) = container::split(path, &bytes)?;
    let document: Value = serde_json::from_slice(json).map_err(|e| broken_json(path, &e))?;
    check_version(path, &document)?;
    if holds_splats(&document) {
        return Err(Error::format(
            path,
            "primitives",
            "triangles",
            "Gaussian splats (KHR_gaussian_splatting), which are not read yet",
            "save them as PLY or SPZ",
        ));
    }
    let mut notes = Vec::new();
    check_extensions(path, &document, &mut notes)?;
    drop(document);
    let root = Root::from_slice(json).map_err(|e| broken_json(path, &e))?;
    let buffers = Buffers::new(input, &root, bin, bytes.len());
    let mesh = scene(&buffers, &mut notes)?;
    check_not_empty(path, &mesh)?;
    let mut data = Dataset::new(path, "glTF mesh", Geometry::Mesh(mesh), Vec::new());
    data.format_up = Some((DVec3::Y, "glTF has y up"));
    data.notes = notes;
    Ok(data)
}

fn broken_json(path: &Path, error: &serde_json::Error) -> Error {
    let found = error.to_string();
    let found = match found.len() {
        0..=200 => found,
        _ => format!("{} ...", clip(&found)),
    };
    let advice = "the file is damaged or no glTF 2.0 file: export it again";
    Error::format(path, "JSON", "a glTF 2.0 asset", found, advice)
}

fn check_version(path: &Path, document: &Value) -> Result<()> {
    let version = document["asset"]["version"].as_str().unwrap_or("none");
    if version.starts_with("2.") {
        return Ok(());
    }
    Err(Error::format(
        path,
        "asset, version",
        "2.0",
        format!("`{}`", clip(version)),
        "export it as glTF 2.0",
    ))
}

/// Whether a primitive holds Gaussian splats (`KHR_gaussian_splatting`).
fn holds_splats(document: &Value) -> bool {
    let items = |value: &'_ Value, key: &str| value[key].as_array().cloned().unwrap_or_default();
    items(document, "meshes")
        .iter()
        .flat_map(|mesh| items(mesh, "primitives"))
        .any(|primitive| {
            primitive["extensions"]
                .get("KHR_gaussian_splatting")
                .is_some()
        })
}

/// Refuses required extensions that are not read, and notes others that are used.
fn check_extensions(path: &Path, document: &Value, notes: &mut Vec<String>) -> Result<()> {
    let names = |key: &str| -> BTreeSet<&str> {
        let names = document[key].as_array().into_iter().flatten();
        names
            .filter_map(Value::as_str)
            .filter(|name| !READ.contains(name) && !OF_LIGHT.contains(name))
            .collect()
    };
    if let Some(name) = names("extensionsRequired").first() {
        return Err(Error::format(
            path,
            "extensionsRequired",
            format!("extensions that are read ({})", READ.join(", ")),
            format!("`{}`, which is not", clip(name)),
            "export it without this extension",
        ));
    }
    // One that breaks the rules may name any number of them.
    let used: Vec<String> = names("extensionsUsed")
        .into_iter()
        .take(8)
        .map(clip)
        .collect();
    if !used.is_empty() {
        notes.push(format!("extensions not used: {}", used.join(", ")));
    }
    Ok(())
}

/// A primitive that several nodes show.
struct Unpacked {
    corners: usize,
    shape: Shape,
}

/// All primitives of the nodes shown, in their places.
fn scene(buffers: &Buffers<'_>, notes: &mut Vec<String>) -> Result<Mesh> {
    let root = buffers.root;
    let nodes = Nodes::new(buffers)?;
    let mut materials = Materials::new(buffers);
    let mut parts: Vec<MeshPart> = Vec::new();
    let mut left_out = LeftOut::default();
    let mut corners_left = MOST_CORNERS;
    // How many nodes name each mesh, and the primitives of those that several do.
    let mut named: HashMap<usize, usize> = HashMap::new();
    for &n in &nodes.shown {
        let mesh = root.nodes[n].mesh.iter();
        mesh.for_each(|mesh| *named.entry(mesh.value()).or_default() += 1);
    }
    let mut unpacked: HashMap<(usize, usize), Arc<Unpacked>> = HashMap::new();
    for &n in &nodes.shown {
        let node = &root.nodes[n];
        let Some(index) = node.mesh else { continue };
        let mesh = root.get(index).ok_or_else(|| {
            let expected = format!("one of {} meshes", root.meshes.len());
            let found = format!("mesh {}", index.value());
            buffers.refuse(format!("node {n}"), expected, found)
        })?;
        let instances = nodes::instances(buffers, n, node)?;
        let joints = match node.skin {
            Some(skin) => Some(nodes::joints(buffers, &nodes, skin)?),
            None => None,
        };
        let weights = node.weights.as_ref().or(mesh.weights.as_ref());
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("mesh {}, primitive {p}", index.value());
            #[cfg(not(feature = "draco"))]
            check_has_copy(buffers, primitive, &place)?;
            let reader = PrimitiveReader {
                buffers,
                primitive,
                #[cfg(feature = "draco")]
                draco: draco::Primitive::of(buffers, primitive, &place)?,
                place,
            };
            // A mesh that many nodes name is unpacked once.
            let is_plain = node.skin.is_none() && node.weights.is_none();
            let key = is_plain.then_some((index.value(), p));
            let known = key.and_then(|key| unpacked.get(&key).cloned());
            let corners = match &known {
                Some(known) => known.corners,
                None => reader.corner_count()?,
            };
            let corners_of_one = corners;
            let corners = corners.saturating_mul(instances.len());
            corners_left = corners_left.checked_sub(corners).ok_or_else(|| {
                let advice = "export fewer instances, or a part of the scene";
                let expected =
                    format!("{MOST_CORNERS} corners of triangles, lines and points at most");
                let found = "more, all instances together";
                Error::format(buffers.path, reader.place.clone(), expected, found, advice)
            })?;
            let material = materials.get(primitive.material, |set| reader.has_set(set))?;
            let joint_count = joints.as_ref().map(Vec::len);
            let weights = weights.map_or(&[][..], Vec::as_slice);
            let known = match known {
                Some(known) => known,
                None => Arc::new(Unpacked {
                    corners: corners_of_one,
                    shape: reader.read(weights, material.sets, joint_count)?,
                }),
            };
            let shape = &known.shape;
            if let Some(key) = key.filter(|key| named.get(&key.0).is_some_and(|&count| count > 1)) {
                unpacked.insert(key, Arc::clone(&known));
            }
            for instance in &instances {
                let world = nodes.world_from_node[n] * *instance;
                let mut part = shape.placed(world, joints.as_deref(), material.material);
                finish(&mut part, &mut left_out);
                if !part.is_empty() {
                    parts.push(part);
                }
            }
        }
    }
    notes.extend(materials.notes);
    notes.extend(left_out.notes());
    Ok(Mesh {
        parts,
        materials: materials.materials,
        textures: materials.textures,
    })
}

/// Refuses a primitive whose vertices are packed by Draco and have no other copy.
#[cfg(not(feature = "draco"))]
fn check_has_copy(
    buffers: &Buffers<'_>,
    primitive: &gltf_json::mesh::Primitive,
    place: &str,
) -> Result<()> {
    let extensions = primitive.extensions.as_ref();
    let is_packed = extensions.is_some_and(|e| e.others.contains_key(DRACO));
    let mut accessors = primitive.attributes.values().chain(&primitive.indices);
    let has_no_bytes = |index: &gltf_json::Index<gltf_json::Accessor>| {
        let accessor = buffers.root.get(*index);
        accessor.is_some_and(|a| a.buffer_view.is_none())
    };
    if is_packed && accessors.any(has_no_bytes) {
        return Err(Error::format(
            buffers.path,
            place,
            "vertices without compression",
            format!("{DRACO}, which is not read without the feature `draco`"),
            "export it without compression",
        ));
    }
    Ok(())
}
