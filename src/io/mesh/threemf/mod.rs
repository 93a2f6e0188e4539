//! Reads 3MF: objects for 3D printing, as meshes in XML in a ZIP archive.
//!
//! | element | result |
//! |---|---|
//! | `model`, `unit` | coordinates stay as they are; a note names a unit other than the millimetre |
//! | `object` with `mesh` | `vertices` and `triangles` |
//! | `object` with `components` | other objects, transformed, including those of other models in the archive (`p:path`) |
//! | `build`, `item` | the objects to show, transformed |
//! | `basematerials`, `m:colorgroup` | colours of triangles or of their corners, sRGB-encoded |
//! | `m:texture2dgroup`, `m:texture2d` | texture coordinates, v upwards; images in the archive |
//! | `m:compositematerials`, `m:multiproperties` | left out, with a note |
//! | thumbnails, slices, beams | left out |
//!
//! Transforms are twelve numbers, rows of a matrix that multiplies a row of coordinates from the right.
//! Triangles run counter-clockwise seen from outside.
//!
//! Source: the 3MF Core Specification 1.3, its Materials and Properties Extension 1.2 and its Production Extension 1.1.

mod model;
mod package;
mod shapes;

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};

use super::closed::are_closed;
use super::mesh_part::{LeftOut, check_not_empty, finish};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{Mesh, MeshPart};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::zip;
use crate::io::vtk::xml::clip;
use model::{Content, Model};
use package::Package;
use shapes::Shapes;

/// Greatest depth of components: more is a cycle.
const DEEPEST: usize = 32;
/// Greatest number of placed objects, all components together.
const MOST_PLACED: usize = 1 << 20;
/// Greatest number of placed triangles' corners: components share meshes, so a small file can describe a scene
/// of any size.
const MOST_CORNERS: usize = 1 << 27;

/// Whether an archive contains a model.
pub(in crate::io) fn is_archive(entries: &[zip::Entry<'_>]) -> bool {
    entries.iter().any(|entry| entry.name.ends_with(".model"))
}

/// Reads a mesh.
///
/// # Errors
/// A damaged archive or XML; objects and corners that do not exist; a cycle of components; nothing to show.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let mut package = Package::of(path, &bytes)?;
    let first = package.first_model()?;
    let mut scene = Scene {
        models: BTreeMap::new(),
        shapes: Shapes::default(),
        parts: Vec::new(),
        placed: 0,
        corners: 0,
    };
    let mut notes = Vec::new();
    scene.model(&mut package, &first)?;
    let root = &scene.models[&first];
    let mut items = root.items.clone();
    if root.unit != model::DEFAULT_UNIT {
        notes.push(format!(
            "the file's unit of length is the {}",
            clip(&root.unit)
        ));
    }
    if items.is_empty() {
        items = root.all_meshes();
        notes.push("nothing is to be built: all objects are shown as they are".into());
    }
    for item in items {
        let file = item.file.as_deref().unwrap_or(&first);
        scene.place(&mut package, file, item.object, item.transform, 0)?;
    }

    let is_closed = are_closed(&scene.parts);
    let mut left_out = LeftOut::default();
    let mut is_open = vec![false; scene.shapes.materials.len()];
    for (part, is_closed) in scene.parts.iter_mut().zip(is_closed) {
        is_open[part.material] |= !is_closed;
        finish(part, &mut left_out);
    }
    for (material, is_open) in scene.shapes.materials.iter_mut().zip(is_open) {
        material.is_double_sided = is_open;
    }
    scene.parts.retain(|part| !part.triangles.is_empty());
    let mesh = Mesh {
        parts: scene.parts,
        materials: std::mem::take(&mut scene.shapes.materials),
        textures: std::mem::take(&mut scene.shapes.textures),
    };
    notes.extend(scene.shapes.notes());
    notes.extend(left_out.notes());
    check_not_empty(path, &mesh)?;
    let mut data = Dataset::new(path, "3MF mesh", Geometry::Mesh(mesh), Vec::new());
    data.format_up = Some((DVec3::Z, "3MF has z up"));
    data.notes = notes;
    Ok(data)
}

/// The models read and the parts placed so far.
struct Scene {
    /// Models by their names in the archive.
    models: BTreeMap<String, Model>,
    shapes: Shapes,
    parts: Vec<MeshPart>,
    placed: usize,
    corners: usize,
}

impl Scene {
    /// Reads a model, once.
    fn model(&mut self, package: &mut Package<'_>, file: &str) -> Result<()> {
        if !self.models.contains_key(file) {
            let text = package.text(file)?;
            let model = Model::of(package, file, &text)?;
            self.models.insert(file.to_owned(), model);
        }
        Ok(())
    }

    /// Places an object and all its components.
    fn place(
        &mut self,
        package: &mut Package<'_>,
        file: &str,
        id: u32,
        transform: DAffine3,
        depth: usize,
    ) -> Result<()> {
        self.model(package, file)?;
        let model = &self.models[file];
        let place = format!("object {id} of `{file}`");
        let Some(object) = model.objects.get(&id) else {
            let found = "none of this number".into();
            return Err(package.fault(&place, "an object", found));
        };
        self.placed += 1;
        if depth > DEEPEST || self.placed > MOST_PLACED {
            let expected = format!("components {DEEPEST} deep and {MOST_PLACED} objects at most");
            return Err(package.fault(&place, &expected, "more".into()));
        }
        match &object.content {
            Content::Components(components) => {
                for part in components.clone() {
                    let inner = part.file.as_deref().unwrap_or(file);
                    let all = transform * part.transform;
                    self.place(package, inner, part.object, all, depth + 1)?;
                }
            }
            Content::Mesh { triangles, .. } => {
                self.corners = self.corners.saturating_add(3 * triangles.len());
                if self.corners > MOST_CORNERS {
                    let advice = "export fewer instances, or a part of the scene";
                    let expected = format!("{MOST_CORNERS} corners of triangles at most");
                    let path = package.path;
                    return Err(Error::format(path, place, expected, "more", advice));
                }
                let parts = self.shapes.of_object(package, file, model, id)?;
                self.parts
                    .extend(parts.iter().map(|part| shapes::placed(part, transform)));
            }
        }
        Ok(())
    }
}
