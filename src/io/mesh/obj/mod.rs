//! Reads Wavefront OBJ: polygon meshes as text, with materials in an MTL file.
//!
//! | statement | result |
//! |---|---|
//! | `v x y z` | a vertex, in f64; a fourth number (a weight of curves) is not used |
//! | `v x y z r g b` | its colour too, sRGB-encoded: see [`crate::data::colour_columns`] |
//! | `vt u v`, `vn x y z` | texture coordinates, v upwards; normals |
//! | `f` with v, v/vt, v//vn, v/vt/vn | polygons of any size, concave ones too; indices from 1, or back from the latest; references to missing texture coordinates and normals are left out, with a note |
//! | `usemtl`, `mtllib` | materials; see [`mtl`] |
//! | `o`, `g`, `s` | ignored: faces of one material are one part |
//! | `p`, `l` (and `f` with one or two corners) | points and lines; vertices without any of these and without faces are a cloud of points |
//! | `curv`, `surf` | left out, with a note |
//!
//! OBJ does not state whether a surface is seen from behind. If the whole surface of a material is closed and
//! encloses a volume, with its front outwards, it is not: see [`super::closed`].

mod mtl;
mod scan;

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{Affine2, DVec3, Vec2};

pub(crate) use scan::looks_like;

use super::closed::are_closed;
use super::mesh_part::{LeftOut, check_not_empty, finish};
use super::polygons::{approximate_note, triangles};
use super::texture::{ImageBudget, find};
use crate::data::colour_columns::{ColourNumbers, ColourScale};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{
    AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap,
};
use crate::error::{Error, Result};
use crate::image::linear_from_srgb;
use crate::io::bytes::file::Input;
use crate::io::cloud::colour_fields;
use crate::io::particles::table;
use crate::io::vtk::xml::clip;
use crate::math::narrowed;
use mtl::{Map, MtlMaterial};
use scan::{Faces, Group, Scan};

/// Reads a mesh; `texture` is used for parts that have texture coordinates and no texture.
///
/// # Errors
/// No face, a line that breaks the format's rules, or a `texture` that cannot be read. Unreadable materials and
/// other textures are noted.
pub(crate) fn read(input: Input<'_>, texture: Option<&Path>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let mut scan = scan::scan(path, &bytes)?;
    drop(bytes);
    let mut notes = std::mem::take(&mut scan.notes);
    if scan.groups.is_empty() {
        return cloud(input, scan, notes);
    }
    let mut parts = parts(&scan, &mut notes);
    let are_closed = are_closed(&parts);

    let mut materials = Materials::new(input, &scan, &mut notes);
    if let Some(texture) = texture {
        materials.fallback = Some(materials.images.named_by_user(texture)?);
    }
    for (part, group) in parts.iter_mut().zip(&scan.groups) {
        part.material = materials.index(group, &scan);
        let material = &materials.mesh.materials[part.material];
        if material.base_texture.is_none() && material.emissive_texture.is_none() {
            part.texture_coordinates.clear();
        }
    }
    let mut mesh = materials.mesh;
    mesh.textures = materials.images.textures;
    notes.append(&mut materials.images.budget.notes);
    notes.append(&mut materials.images.notes);
    let mut left_out = LeftOut::default();
    for (part, is_closed) in parts.iter_mut().zip(are_closed) {
        mesh.materials[part.material].is_double_sided |= !is_closed;
        finish(part, &mut left_out);
    }
    notes.extend(left_out.notes());
    parts.retain(|part| !part.is_empty());
    mesh.parts = parts;
    check_not_empty(path, &mesh)?;
    let mut data = Dataset::new(path, "Wavefront OBJ mesh", Geometry::Mesh(mesh), Vec::new());
    data.format_up = Some((DVec3::Y, "OBJ mostly has y up"));
    data.notes = notes;
    Ok(data)
}

/// Reads vertices alone, as points.
///
/// # Errors
/// No vertices.
fn cloud(input: Input<'_>, scan: Scan, mut notes: Vec<String>) -> Result<Dataset> {
    let path = input.path;
    if scan.positions.is_empty() {
        return Err(Error::format(
            path,
            "vertices",
            "a vertex (`v`)",
            "none",
            "save the mesh again",
        ));
    }
    notes.push("there are no faces, lines and points: all vertices are drawn as points".into());
    if !scan.libraries.is_empty() {
        notes.push("files of materials are not used without faces".into());
    }
    let mut fields = Vec::new();
    if !scan.colours.is_empty() {
        let scale = colour_scale(scan.colours.iter().copied(), &mut notes);
        let white = [f64::from(scale.full()); 3];
        let channel = |c: usize| {
            let colours = scan.colours.iter();
            let encoded = |rgb: &Option<[f64; 3]>| scale.encoded(narrowed(rgb.unwrap_or(white)[c]));
            colours.map(encoded).collect()
        };
        fields = colour_fields([0, 1, 2].map(channel));
    }
    let mut data = table::dataset(path, "Wavefront OBJ points", scan.positions, fields)?;
    data.format_up = Some((DVec3::Y, "OBJ mostly has y up"));
    data.notes = notes;
    Ok(data)
}

/// The scale of vertices' colours.
fn colour_scale(
    colours: impl Iterator<Item = Option<[f64; 3]>> + Clone,
    notes: &mut Vec<String>,
) -> ColourScale {
    let numbers = colours.flatten().flatten().map(narrowed);
    let scale = ColourScale::of(None, ColourNumbers::of_floats(numbers));
    if let Some(assumed) = scale.assumed() {
        notes.push(format!("colours of vertices {assumed}"));
    }
    scale
}

/// One part for each group of faces, in order, with texture coordinates if the faces have them.
fn parts(scan: &Scan, notes: &mut Vec<String>) -> Vec<MeshPart> {
    let used = scan.faces.iter().flat_map(|faces| {
        let marks = faces.lines.as_flattened().iter().chain(&faces.points);
        faces.corners.iter().chain(marks)
    });
    let colours = used.map(|[v, ..]| scan.colours.get(*v as usize).copied().flatten());
    let colour_scale = colour_scale(colours, notes);
    let mut approximate = 0;
    let parts = scan
        .faces
        .iter()
        .zip(&scan.groups)
        .map(|(faces, group)| part_of(scan, faces, group, colour_scale, &mut approximate))
        .collect();
    notes.extend(approximate_note(approximate));
    parts
}

/// The faces of one group. Corners with the same vertex, texture coordinates and normal are merged.
fn part_of(
    scan: &Scan,
    faces: &Faces,
    group: &Group,
    colour_scale: ColourScale,
    approximate: &mut usize,
) -> MeshPart {
    let mut part = MeshPart::default();
    let mut coordinates = Vec::new();
    let mut index_of: HashMap<[u32; 3], u32> = HashMap::new();
    let mut indices = Vec::with_capacity(faces.corners.len());
    let marks = faces.lines.as_flattened().iter().chain(&faces.points);
    for corner in faces.corners.iter().chain(marks) {
        let next = u32::try_from(index_of.len()).unwrap_or(u32::MAX);
        let index = *index_of.entry(*corner).or_insert(next);
        indices.push(index);
        if index < next {
            continue;
        }
        let [v, vt, vn] = corner.map(|i| i as usize);
        part.positions.push(scan.positions[v]);
        if let Some(colour) = scan.colours.get(v) {
            part.colours.push(vertex_colour(*colour, colour_scale));
        }
        if group.has_coordinates {
            coordinates.push(texture_coordinates(scan.coordinates[vt]));
        }
        if group.has_normals {
            part.normals
                .push(scan.normals[vn].normalize_or_zero().as_vec3());
        }
    }
    if !coordinates.is_empty() {
        part.texture_coordinates.push(coordinates);
    }
    let (in_faces, others) = indices.split_at(faces.corners.len());
    let (in_lines, points) = others.split_at(2 * faces.lines.len());
    part.lines = in_lines.as_chunks::<2>().0.to_vec();
    part.points = points.to_vec();
    part.triangles = triangles(in_faces, &faces.ends, &part.positions, approximate);
    part
}

/// A vertex's colour, linear; white if it has none although others have.
fn vertex_colour(stated: Option<[f64; 3]>, scale: ColourScale) -> [f32; 4] {
    // Numbers below 0 are no colour.
    let [r, g, b] = match stated.filter(|rgb| !rgb.iter().any(|c| *c < 0.0)) {
        Some(rgb) => rgb.map(|c| scale.linear(narrowed(c))),
        None => [1.0; 3],
    };
    [r, g, b, 1.0]
}

/// Texture coordinates, v downwards.
#[expect(
    clippy::cast_possible_truncation,
    reason = "texture coordinates need no more than f32"
)]
fn texture_coordinates([u, v]: [f64; 2]) -> Vec2 {
    Vec2::new(u as f32, (1.0 - v) as f32)
}

/// The materials of a mesh, made when parts first use them.
struct Materials<'a> {
    mesh: Mesh,
    library: HashMap<String, MtlMaterial>,
    images: Images<'a>,
    /// The texture for parts without one.
    fallback: Option<usize>,
    made: HashMap<(Option<usize>, bool), usize>,
}

impl<'a> Materials<'a> {
    /// Reads the libraries that a file names; notes report missing libraries and materials.
    fn new(input: Input<'a>, scan: &Scan, notes: &mut Vec<String>) -> Self {
        let mut library = HashMap::new();
        for statement in &scan.libraries {
            // The whole statement is one name, or several without spaces.
            let whole = find(input, statement);
            let names: Vec<&str> = match whole {
                Some(_) => vec![statement],
                None => statement.split_whitespace().collect(),
            };
            for name in names {
                let Some(file) = find(input, name) else {
                    notes.push(format!("no file `{}` of materials", clip(name)));
                    continue;
                };
                notes.extend(file.note);
                match input.read_beside(&file.path) {
                    Ok(bytes) => library.extend(
                        mtl::read(&bytes, notes)
                            .into_iter()
                            .map(|m| (m.name.clone(), m)),
                    ),
                    Err(e) => notes.push(e.to_string()),
                }
            }
        }
        let is_bare =
            |(group, faces): (&Group, &Faces)| group.material.is_none() && !faces.ends.is_empty();
        if !library.is_empty() && scan.groups.iter().zip(&scan.faces).any(is_bare) {
            let whose = match scan.materials.is_empty() {
                true => "faces name no material (`usemtl`)",
                false => "some faces come before the first `usemtl`",
            };
            notes.push(format!(
                "{whose}: the {} of the files of materials are not used for these, which are white",
                library.len()
            ));
        }
        let missing: Vec<&str> = scan
            .materials
            .iter()
            .map(String::as_str)
            .filter(|name| !library.contains_key(*name))
            .collect();
        if let Some(first) = missing.first() {
            let more = match missing.len() {
                1 => String::new(),
                n => format!(" and {} more", n - 1),
            };
            let first = clip(first);
            notes.push(format!(
                "no material `{first}`{more} in the files of materials: taken as white"
            ));
        }
        Self {
            mesh: Mesh::default(),
            library,
            images: Images::new(input),
            fallback: None,
            made: HashMap::new(),
        }
    }

    /// The material of a group of faces.
    fn index(&mut self, group: &Group, scan: &Scan) -> usize {
        let key = (group.material, group.has_coordinates);
        if let Some(&index) = self.made.get(&key) {
            return index;
        }
        let name = group.material.map_or("", |i| scan.materials[i].as_str());
        let stated = self.library.get(name).cloned().unwrap_or(MtlMaterial {
            name: name.to_owned(),
            opacity: 1.0,
            ..MtlMaterial::default()
        });
        let material = self.material(&stated, group.has_coordinates);
        self.mesh.materials.push(material);
        let index = self.mesh.materials.len() - 1;
        self.made.insert(key, index);
        index
    }

    fn material(&mut self, stated: &MtlMaterial, has_coordinates: bool) -> Material {
        let images = &mut self.images;
        let mut alpha = if stated.opacity < 1.0 {
            AlphaMode::Blend
        } else {
            AlphaMode::Opaque
        };
        let (mut base, mut emissive) = (None, None);
        if has_coordinates {
            base = images.base(stated);
            if let Some((_, is_cut_out)) = base
                && stated.opacity_map.is_some()
                && images.has_opacity(stated)
            {
                alpha = if is_cut_out && stated.opacity >= 1.0 {
                    AlphaMode::Mask(0.5)
                } else {
                    AlphaMode::Blend
                };
            }
            let map = stated.emissive_map.as_ref();
            emissive = map.and_then(|map| Some(images.texture(Some(map), None)?.0));
        } else if stated.diffuse_map.is_some() || stated.opacity_map.is_some() {
            images.notes.push(format!(
                "faces of material `{}` have no texture coordinates: its texture is not used \
                 there",
                clip(&stated.name)
            ));
        }
        let mut base_texture = base.map(|(use_, _)| use_);
        let is_textured = base_texture.is_some() && stated.diffuse_map.is_some();
        if base_texture.is_none() && has_coordinates {
            base_texture = self.fallback.map(|texture| TextureUse {
                texture,
                coordinates: 0,
                transform: Affine2::IDENTITY,
            });
        }
        let diffuse = match stated.diffuse {
            Some(black) if is_textured && black.iter().all(|c| *c <= 0.0) => [1.0; 3],
            Some(colour) => colour,
            None => [1.0; 3],
        };
        let [r, g, b] = diffuse.map(linear_from_srgb);
        let is_dark = stated.emissive.iter().all(|c| *c <= 0.0);
        Material {
            name: stated.name.clone(),
            base_colour: [r, g, b, stated.opacity],
            base_texture,
            emissive: match (&stated.emissive_map, &emissive) {
                // As for Kd: with a texture, black means that the texture applies.
                (Some(_), Some(_)) if is_dark => [1.0; 3],
                // Light from a texture that cannot be read would be light everywhere.
                (Some(_), None) => [0.0; 3],
                _ => stated.emissive.map(linear_from_srgb),
            },
            emissive_texture: emissive,
            normal_texture: None,
            normal_scale: 1.0,
            is_unlit: false,
            alpha,
            is_double_sided: false,
        }
    }
}

/// Identity of a texture: textures with equal keys are one.
#[derive(PartialEq, Eq, Hash)]
struct TextureKey {
    /// The file of its colour; without one it is white.
    colour: Option<String>,
    /// The file of its opacity.
    opacity: Option<String>,
    is_clamped: bool,
}

/// Textures, each decoded once.
struct Images<'a> {
    input: Input<'a>,
    budget: ImageBudget,
    decoded: HashMap<String, Option<Arc<TextureImage>>>,
    textures: Vec<Texture>,
    /// Textures, and whether they cut out.
    made: HashMap<TextureKey, (usize, bool)>,
    notes: Vec<String>,
}

impl<'a> Images<'a> {
    fn new(input: Input<'a>) -> Self {
        Self {
            input,
            budget: ImageBudget::default(),
            decoded: HashMap::new(),
            textures: Vec::new(),
            made: HashMap::new(),
            notes: Vec::new(),
        }
    }

    /// The texture that the user gave; an error if it cannot be read.
    fn named_by_user(&mut self, path: &Path) -> Result<usize> {
        let decoded = self.budget.named_by_user(self.input, path)?;
        self.textures.push(Texture {
            image: Arc::new(decoded),
            wrap: [Wrap::Repeat; 2],
        });
        Ok(self.textures.len() - 1)
    }

    /// A decoded image; `None`, with a note, if it cannot be read.
    fn decode(&mut self, name: &str) -> Option<Arc<TextureImage>> {
        if let Some(known) = self.decoded.get(name) {
            return known.clone();
        }
        let decoded = match self.budget.named(self.input, name) {
            Ok(decoded) => Some(Arc::new(decoded)),
            Err(reason) => {
                self.notes.push(reason);
                None
            }
        };
        self.decoded.insert(name.to_owned(), decoded.clone());
        decoded
    }

    /// Whether a material's map of opacity can be read.
    fn has_opacity(&mut self, stated: &MtlMaterial) -> bool {
        let map = stated.opacity_map.as_ref();
        map.is_some_and(|map| self.decode(&map.file).is_some())
    }

    /// The texture of a material's colour and opacity, and whether it cuts out: whether all opacities are 0 or
    /// 1.
    fn base(&mut self, stated: &MtlMaterial) -> Option<(TextureUse, bool)> {
        let colour = stated
            .diffuse_map
            .as_ref()
            .filter(|map| self.decode(&map.file).is_some());
        let opacity = stated
            .opacity_map
            .as_ref()
            .filter(|map| self.decode(&map.file).is_some());
        match (colour, opacity) {
            (Some(colour), opacity) => {
                if let Some(opacity) = opacity
                    && (opacity.scale, opacity.offset) != (colour.scale, colour.offset)
                {
                    self.notes.push(format!(
                        "material `{}` places map_d unlike map_Kd: it is placed like it",
                        clip(&stated.name)
                    ));
                }
                self.texture(Some(colour), opacity)
            }
            (None, Some(opacity)) => self.texture(None, Some(opacity)),
            (None, None) => None,
        }
    }

    /// A texture from one image's colour (or white) and another's opacity.
    fn texture(
        &mut self,
        colour: Option<&Map>,
        opacity: Option<&Map>,
    ) -> Option<(TextureUse, bool)> {
        let placing = colour.or(opacity)?;
        let image = self.decode(&placing.file)?;
        let opacity = opacity.and_then(|map| Some((map, self.decode(&map.file)?)));
        let key = TextureKey {
            colour: colour.map(|map| map.file.clone()),
            opacity: opacity.as_ref().map(|(map, _)| map.file.clone()),
            is_clamped: placing.is_clamped,
        };
        let (texture, is_cut_out) = match self.made.get(&key) {
            Some(&known) => known,
            None => {
                let mut image = match &opacity {
                    // An image that is its own opacity map already has it.
                    Some((_, opacity)) if !Arc::ptr_eq(&image, opacity) || colour.is_none() => {
                        with_opacity(&image, opacity)
                    }
                    _ => (*image).clone(),
                };
                if colour.is_none() {
                    for pixel in &mut image.pixels {
                        *pixel = [255, 255, 255, pixel[3]];
                    }
                }
                self.push(key, image)
            }
        };
        Some((placed(texture, placing), is_cut_out))
    }

    fn push(&mut self, key: TextureKey, image: TextureImage) -> (usize, bool) {
        let is_cut_out = image.pixels.iter().all(|p| matches!(p[3], 0 | 255));
        self.textures.push(Texture {
            image: Arc::new(image),
            wrap: [if key.is_clamped {
                Wrap::ClampToEdge
            } else {
                Wrap::Repeat
            }; 2],
        });
        let made = (self.textures.len() - 1, is_cut_out);
        self.made.insert(key, made);
        made
    }
}

/// A use of a texture with the options of its statement. The options assume v upwards: 1 - v becomes s v + (1 -
/// s - o).
fn placed(texture: usize, map: &Map) -> TextureUse {
    let [su, sv] = map.scale;
    let [ou, ov] = map.offset;
    TextureUse {
        texture,
        coordinates: 0,
        transform: Affine2::from_scale_angle_translation(
            Vec2::new(su, sv),
            0.0,
            Vec2::new(ou, 1.0 - sv - ov),
        ),
    }
}

/// An image with another's opacity, from the nearest pixel: its alpha channel, or its brightness if that is 1
/// everywhere.
fn with_opacity(image: &TextureImage, opacity: &TextureImage) -> TextureImage {
    let mut image = image.clone();
    let has_alpha = opacity.pixels.iter().any(|p| p[3] < u8::MAX);
    for (i, pixel) in image.pixels.iter_mut().enumerate() {
        let x = (2 * (i % image.width) + 1) * opacity.width / (2 * image.width);
        let y = (2 * (i / image.width) + 1) * opacity.height / (2 * image.height);
        let [r, g, b, a] = opacity.pixels[y * opacity.width + x];
        pixel[3] = if has_alpha {
            a
        } else {
            // The mean of a grey pixel is itself.
            let sum = u16::from(r) + u16::from(g) + u16::from(b);
            u8::try_from(sum / 3).unwrap_or(u8::MAX)
        };
    }
    image
}
