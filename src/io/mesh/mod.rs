//! Meshes: glTF, OBJ, STL and 3MF, with textures.

pub(super) mod closed;
pub(super) mod gltf;
#[cfg(feature = "ktx2")]
pub(super) mod ktx2;
pub(super) mod mesh_part;
pub(super) mod obj;
pub(super) mod polygons;
pub(super) mod stl;
pub(super) mod texture;
pub(super) mod threemf;
