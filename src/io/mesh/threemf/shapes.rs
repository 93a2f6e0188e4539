//! Converts objects to parts of a mesh, with their materials.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;
use std::sync::Arc;

use glam::{Affine2, DAffine3, Vec2};

use super::model::{Content, Model, Object, Properties, Triangle};
use super::package::Package;
use crate::data::mesh::{AlphaMode, Material, MeshPart, Texture, TextureUse};
use crate::error::Result;
use crate::io::mesh::mesh_part::plain;
use crate::io::mesh::texture::ImageBudget;
use crate::io::vtk::xml::clip;

/// The material of a part.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Kind {
    /// No stated material.
    Plain,
    Coloured {
        is_translucent: bool,
    },
    /// The texture of this id in a file.
    Textured(String, u32),
}

/// The objects converted so far, and their materials.
#[derive(Default)]
pub(super) struct Shapes {
    made: HashMap<(String, u32), Rc<[MeshPart]>>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    /// `None` for a texture that cannot be read.
    known: HashMap<Kind, Option<usize>>,
    budget: ImageBudget,
    /// Number of triangles whose properties are missing or of another kind.
    unknown: usize,
    notes: BTreeSet<String>,
}

/// The corners of a part, as far as collected.
#[derive(Default)]
struct Collected {
    part: MeshPart,
    /// Indices by vertex, group of properties and index in the group.
    numbers: HashMap<(u32, Option<(u32, u32)>), u32>,
    coordinates: Vec<Vec2>,
}

impl Shapes {
    /// The parts of an object with a mesh, without a transform.
    pub(super) fn of_object(
        &mut self,
        package: &mut Package<'_>,
        file: &str,
        model: &Model,
        id: u32,
    ) -> Result<Rc<[MeshPart]>> {
        let key = (file.to_owned(), id);
        if let Some(known) = self.made.get(&key) {
            return Ok(Rc::clone(known));
        }
        let mut all: Vec<(usize, Collected)> = Vec::new();
        if let Some(object) = model.objects.get(&id) {
            self.collect(package, file, model, object, &mut all);
        }
        let finished = all.into_iter().map(|(material, mut collected)| {
            collected.part.material = material;
            if !collected.coordinates.is_empty() {
                collected.part.texture_coordinates = vec![collected.coordinates];
            }
            collected.part
        });
        let parts: Rc<[MeshPart]> = finished.collect();
        self.made.insert(key, Rc::clone(&parts));
        Ok(parts)
    }

    /// Sorts the triangles of an object by material.
    fn collect(
        &mut self,
        package: &mut Package<'_>,
        file: &str,
        model: &Model,
        object: &Object,
        all: &mut Vec<(usize, Collected)>,
    ) {
        let Content::Mesh {
            positions,
            triangles,
        } = &object.content
        else {
            return;
        };
        let of_object = object.property.map(|(group, index)| (group, [index; 3]));
        let found: Vec<_> = triangles
            .iter()
            .map(|triangle| (triangle, triangle.property.or(of_object)))
            .map(|(triangle, property)| (triangle, self.known_property(model, property)))
            .collect();
        let is_translucent = found.iter().any(|(_, property)| {
            let colours = property.iter().flat_map(|(_, all, indices)| match all {
                Properties::Colours(colours) => indices.map(|i| colours[i as usize]).to_vec(),
                Properties::Coordinates(..) => Vec::new(),
            });
            colours.into_iter().any(|colour| colour[3] < 1.0)
        });
        let has_colours = found
            .iter()
            .any(|(_, property)| matches!(property, Some((_, Properties::Colours(_), _))));
        for (triangle, property) in found {
            let mut property = property;
            let mut material = None;
            if let Some((_, Properties::Coordinates(texture, _), _)) = property {
                let kind = Kind::Textured(file.to_owned(), *texture);
                material = self.material(package, model, kind);
                if material.is_none() {
                    property = None;
                }
            }
            let kind = match has_colours {
                true => Kind::Coloured { is_translucent },
                false => Kind::Plain,
            };
            let material = material.or_else(|| self.material(package, model, kind));
            let Some(material) = material else { continue };
            let at = all.iter().position(|(known, _)| *known == material);
            let at = at.unwrap_or_else(|| {
                all.push((material, Collected::default()));
                all.len() - 1
            });
            let has_colours = has_colours && !self.is_textured(material);
            all[at].1.add(positions, triangle, property, has_colours);
        }
    }

    fn is_textured(&self, material: usize) -> bool {
        self.materials[material].base_texture.is_some()
    }

    /// The properties of a triangle's corners, if they exist and are of a supported kind; others are counted.
    fn known_property<'m>(
        &mut self,
        model: &'m Model,
        stated: Option<(u32, [u32; 3])>,
    ) -> Option<(u32, &'m Properties, [u32; 3])> {
        let (group, indices) = stated?;
        let found = model.properties.get(&group).filter(|properties| {
            let count = match properties {
                Properties::Colours(colours) => colours.len(),
                Properties::Coordinates(_, coordinates) => coordinates.len(),
            };
            indices.iter().all(|index| (*index as usize) < count)
        });
        self.unknown += usize::from(found.is_none());
        found.map(|found| (group, found, indices))
    }

    /// The index of a material; `None` if its texture cannot be read.
    fn material(&mut self, package: &mut Package<'_>, model: &Model, kind: Kind) -> Option<usize> {
        if let Some(known) = self.known.get(&kind) {
            return *known;
        }
        let made = match &kind {
            Kind::Plain => Some(plain(false)),
            Kind::Coloured { is_translucent } => Some(Material {
                alpha: match is_translucent {
                    true => AlphaMode::Blend,
                    false => AlphaMode::Opaque,
                },
                ..plain(true)
            }),
            Kind::Textured(_, texture) => match self.texture(package, model, *texture) {
                Ok(texture) => Some(texture),
                Err(reason) => {
                    self.notes.insert(reason);
                    None
                }
            },
        };
        let index = made.map(|material| {
            self.materials.push(material);
            self.materials.len() - 1
        });
        self.known.insert(kind, index);
        index
    }

    /// A material with one texture.
    ///
    /// # Errors
    /// A note with the reason why there is none.
    fn texture(
        &mut self,
        package: &mut Package<'_>,
        model: &Model,
        texture: u32,
    ) -> Result<Material, String> {
        let none = || format!("texture {texture} is not there: it is not used");
        let stated = model.textures.get(&texture).ok_or_else(none)?;
        let bytes = package.bytes(&stated.file).map_err(|e| e.to_string())?;
        let image = self.budget.decode(&bytes).map_err(|reason| {
            let file = clip(&stated.file);
            format!("image `{file}` {reason}: its texture is not used")
        })?;
        let is_translucent = image.pixels.iter().any(|pixel| pixel[3] < u8::MAX);
        self.textures.push(Texture {
            image: Arc::new(image),
            wrap: stated.wrap,
        });
        Ok(Material {
            base_texture: Some(TextureUse {
                texture: self.textures.len() - 1,
                coordinates: 0,
                transform: Affine2::IDENTITY,
            }),
            alpha: match is_translucent {
                true => AlphaMode::Blend,
                false => AlphaMode::Opaque,
            },
            ..plain(true)
        })
    }

    /// Notes on everything that was left out.
    pub(super) fn notes(self) -> Vec<String> {
        let mut notes: Vec<String> = self.notes.into_iter().collect();
        if self.unknown > 0 {
            let count = self.unknown;
            notes.push(format!(
                "{count} triangles name properties of a kind that is not read, or that are not there: they are grey"
            ));
        }
        notes
    }
}

impl Collected {
    fn add(
        &mut self,
        positions: &[glam::DVec3],
        triangle: &Triangle,
        property: Option<(u32, &Properties, [u32; 3])>,
        has_colours: bool,
    ) {
        let corners = [0, 1, 2].map(|i| {
            let vertex = triangle.corners[i];
            let own = property.map(|(group, _, indices)| (group, indices[i]));
            let next = u32::try_from(self.part.positions.len()).unwrap_or(u32::MAX);
            let index = *self.numbers.entry((vertex, own)).or_insert(next);
            if index < next {
                return index;
            }
            self.part.positions.push(positions[vertex as usize]);
            match property {
                Some((_, Properties::Coordinates(_, coordinates), indices)) => {
                    self.coordinates.push(coordinates[indices[i] as usize]);
                }
                Some((_, Properties::Colours(colours), indices)) => {
                    self.part.colours.push(colours[indices[i] as usize]);
                }
                None if has_colours => self.part.colours.push(plain(false).base_colour),
                None => {}
            }
            index
        });
        self.part.triangles.push(corners);
    }
}

/// A transformed part; if the transform mirrors, triangles are reversed.
pub(super) fn placed(part: &MeshPart, transform: DAffine3) -> MeshPart {
    let mut placed = part.clone();
    for position in &mut placed.positions {
        *position = transform.transform_point3(*position);
    }
    if transform.matrix3.determinant() < 0.0 {
        for triangle in &mut placed.triangles {
            triangle.swap(1, 2);
        }
    }
    placed
}
