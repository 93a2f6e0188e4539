//! Reads glTF 2.0: meshes with materials, textures and positions in a scene. Files are JSON with binary buffers
//! (`.gltf`) or a single binary file (`.glb`).
//!
//! The reader returns the default scene (or else the first scene, or else all nodes) in its rest pose. Nodes have their
//! transforms in f64, skins the pose of their joints, and morph targets their default weights. Base colours, emission,
//! opacity and normal maps are read. Other properties that only lighting would show are not.
//!
//! | extension | treatment |
//! |---|---|
//! | `KHR_texture_transform`, `KHR_mesh_quantization`, `KHR_materials_emissive_strength`, `EXT_mesh_gpu_instancing`, `EXT_texture_webp`, `KHR_texture_basisu` | supported |
//! | `EXT_meshopt_compression`, `KHR_meshopt_compression` | views are unpacked: see [`meshopt`] |
//! | `KHR_draco_mesh_compression` | primitives are unpacked, with the feature `draco` |
//! | `KHR_materials_pbrSpecularGlossiness` | its diffuse colour is used if the material has no other |
//! | `KHR_materials_unlit` | the material is marked as unlit |
//! | those in [`OF_LIGHT`] | ignored: they change no colour or shape |
//! | others | ignored with a note; refused by name if the file requires them |
//!
//! [`cameras`] reads the cameras and what moves them.
//!
//! Parts that are not drawn may contain anything ([`document`]). All drawn parts are checked before they are used.

mod accessor;
mod cameras;
mod container;
mod document;
#[cfg(feature = "draco")]
mod draco;
mod materials;
mod meshopt;
mod nodes;
mod primitives;

pub(in crate::io) use self::document::{PACKED_SPLATS, SPLATS};
use crate::io::mesh::gltf::document::DRACO;
use crate::io::mesh::gltf::document::READ;
use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

pub(in crate::io) use accessor::{ANY_NUMBERS, Accessor, ComponentType, Type};
pub(crate) use cameras::{is_gltf, read_gltf_cameras};
pub(crate) use container::looks_like;
pub(in crate::io) use container::{Buffers, split};
pub(in crate::io) use document::{Document, Object};
pub(in crate::io) use nodes::{Nodes, instances};

use super::mesh_part::{LeftOut, check_not_empty, finish};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{Mesh, MeshPart};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::vtk::xml::clip;
use materials::Materials;
use primitives::{PrimitiveReader, Shape};

/// Greatest number of corners of all triangles, lines and points of a scene. Nodes and instances share meshes, so a
/// small file can describe a scene of any size.
const MOST_CORNERS: usize = 1 << 27;

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

/// Reads a scene.
///
/// # Errors
/// JSON or buffers break the format's rules or do not exist; a required extension is not supported; the scene has no
/// triangles, lines or points.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let chunks = split(path, &bytes)?;
    let document = Document::parse(path, chunks.json)?;
    let mut notes: Vec<String> = chunks.note.into_iter().map(str::to_owned).collect();
    check_extensions(path, &document, &[], &mut notes)?;
    let buffers = Buffers::new(input, &document, chunks.bin, bytes.len());
    let mesh = scene(&buffers, &mut notes)?;
    check_not_empty(path, &mesh)?;
    let mut data = Dataset::new(path, "glTF mesh", Geometry::Mesh(mesh), Vec::new());
    data.format_up = Some((DVec3::Y, "glTF has y up"));
    data.notes = notes;
    Ok(data)
}

/// Refuses required extensions that are not read, and notes others that are used.
///
/// - `others`: additional extensions that the caller reads.
pub(in crate::io) fn check_extensions(
    path: &Path,
    document: &Document<'_>,
    others: &[&str],
    notes: &mut Vec<String>,
) -> Result<()> {
    let names = |key: &str| -> BTreeSet<&str> {
        let is_known = |name: &&str| {
            [READ, OF_LIGHT, others]
                .iter()
                .any(|list| list.contains(name))
        };
        document.words(key).filter(|name| !is_known(name)).collect()
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
    // A damaged file may name any number of extensions, so the list is cut.
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

/// Primitive that several nodes share.
struct Unpacked {
    corners: usize,
    shape: Shape,
}

/// Returns all primitives of the drawn nodes, transformed to world space.
fn scene(buffers: &Buffers<'_>, notes: &mut Vec<String>) -> Result<Mesh> {
    let nodes = Nodes::new(buffers)?;
    let mut materials = Materials::new(buffers);
    let mut parts: Vec<MeshPart> = Vec::new();
    let mut left_out = LeftOut::default();
    let mut corners_left = MOST_CORNERS;
    // Number of nodes that name each mesh. Below, `unpacked` keeps the primitives of meshes that several nodes name.
    let mut named: HashMap<usize, usize> = HashMap::new();
    for &n in &nodes.shown {
        if let Some((mesh, _)) = nodes.all[n].mesh(buffers)? {
            *named.entry(mesh).or_default() += 1;
        }
    }
    let mut unpacked: HashMap<(usize, usize), Arc<Unpacked>> = HashMap::new();
    for &n in &nodes.shown {
        let node = &nodes.all[n];
        let Some((index, mesh)) = node.mesh(buffers)? else {
            continue;
        };
        let instances = instances(buffers, node)?;
        let joints = match node.skin()? {
            Some(skin) => Some(nodes::joints(buffers, &nodes, skin)?),
            None => None,
        };
        let weights = match node.weights()? {
            Some(weights) => weights,
            None => mesh.list("weights")?.unwrap_or_default(),
        };
        for (p, primitive) in mesh.objects("primitives")?.into_iter().enumerate() {
            let place = format!("mesh {index}, primitive {p}");
            if primitive.extension(SPLATS).is_some() {
                let expected = "a file named `.glb` or `.gltf`";
                let found = format!("Gaussian splats ({SPLATS}) under another name");
                return Err(Error::format(
                    buffers.path,
                    place,
                    expected,
                    found,
                    "rename it",
                ));
            }
            #[cfg(not(feature = "draco"))]
            check_has_copy(buffers, primitive, &place)?;
            let reader = PrimitiveReader {
                buffers,
                primitive,
                #[cfg(feature = "draco")]
                draco: draco::Primitive::of(buffers, primitive, &place)?,
                place,
            };
            // A primitive that several nodes share is unpacked once.
            let is_plain = joints.is_none() && node.weights()?.is_none();
            let key = is_plain.then_some((index, p));
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
            let material =
                materials.get(primitive.index("material")?, |set| reader.has_set(set))?;
            let joint_count = joints.as_ref().map(Vec::len);
            let known = match known {
                Some(known) => known,
                None => Arc::new(Unpacked {
                    corners: corners_of_one,
                    shape: reader.read(&weights, material.sets, joint_count)?,
                }),
            };
            let shape = &known.shape;
            if let Some(key) = key.filter(|key| named.get(&key.0).is_some_and(|&count| count > 1)) {
                unpacked.insert(key, Arc::clone(&known));
            }
            for instance in &instances {
                let world = node.world_from_node * *instance;
                let mut part = shape.placed(world, joints.as_deref(), material.material);
                finish(&mut part, &mut left_out);
                if !part.is_empty() {
                    parts.push(part);
                }
            }
        }
    }
    notes.extend(buffers.take_notes());
    notes.extend(materials.notes);
    notes.extend(left_out.notes());
    Ok(Mesh {
        parts,
        materials: materials.materials,
        textures: materials.textures,
    })
}

/// Refuses a primitive whose vertices exist only in Draco's packed form.
#[cfg(not(feature = "draco"))]
fn check_has_copy(buffers: &Buffers<'_>, primitive: Object<'_>, place: &str) -> Result<()> {
    let attributes = primitive.object("attributes")?;
    let mut accessors: Vec<usize> = primitive.index("indices")?.into_iter().collect();
    for name in ["POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0"] {
        if let Some(attributes) = attributes {
            accessors.extend(attributes.index(name)?);
        }
    }
    let has_no_bytes = |index: &usize| {
        let accessor = buffers.document.find("accessors", *index);
        accessor.is_some_and(|a| !a.has("bufferView"))
    };
    if primitive.extensions().any(|name| name == DRACO) && accessors.iter().any(has_no_bytes) {
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
