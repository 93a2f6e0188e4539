//! Wavefront OBJ: polygon meshes as text, with materials in an MTL file.
//!
//! | statement | what is made of it |
//! |---|---|
//! | `v x y z` | a vertex, in f64; a fourth number (a weight of curves) is not used |
//! | `v x y z r g b` | its colour too, sRGB-encoded, 0 to 1, or 0 to 255 where one exceeds 1 |
//! | `vt u v`, `vn x y z` | texture coordinates, v upwards; normals |
//! | `f` with v, v/vt, v//vn, v/vt/vn | polygons of any size, concave ones too; indices from 1, or back from the latest |
//! | `usemtl`, `mtllib` | materials; see [`mtl`] |
//! | `o`, `g`, `s` | nothing: faces of one material are one part |
//! | `p`, `l`, `curv`, `surf` | nothing, with a note |
//!
//! OBJ does not say whether a surface is seen from behind. Where all that a material covers is
//! closed and encloses a volume, with its front outwards, it is not: see [`closed`].

mod closed;
mod mtl;
mod polygons;
mod scan;

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Affine2, DVec3, Vec2, Vec3};

pub(crate) use scan::looks_like;

use super::dataset::{Dataset, Geometry};
use super::file::read_all;
use super::mesh_part::{LeftOut, check_not_empty, finish};
use super::texture::ImageBudget;
use super::vtk_xml::clip;
use super::{AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap};
use crate::error::{Error, Result};
use crate::image::linear_from_srgb;
use mtl::{Map, MtlMaterial};
use polygons::Outcome;
use scan::{Group, Scan};

/// Reads a mesh; `texture` is bound to parts that have texture coordinates and no texture.
///
/// # Errors
/// No face, a line that breaks the format's rules, or a `texture` that cannot be read. Materials
/// and textures that cannot be read are told of in notes.
pub(crate) fn read(path: &Path, texture: Option<&Path>) -> Result<Dataset> {
    let bytes = read_all(path)?;
    let mut scan = scan::scan(path, &bytes)?;
    drop(bytes);
    let mut notes = std::mem::take(&mut scan.notes);
    if scan.groups.is_empty() {
        return Err(Error::format(
            path,
            "faces",
            "one face (`f`) or more",
            format!("{} vertices and no face", scan.vertex_count),
            "give a mesh; save points as PLY or CSV",
        ));
    }
    let mut parts = parts(path, &mut scan, &mut notes)?;
    let are_closed = closed::are_closed(&parts);

    let mut materials = Materials::new(path, &scan, &mut notes);
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
    notes.append(&mut materials.images.notes);
    let mut left_out = LeftOut::default();
    for (part, is_closed) in parts.iter_mut().zip(are_closed) {
        mesh.materials[part.material].is_double_sided |= !is_closed;
        finish(part, &mut left_out);
    }
    notes.extend(left_out.notes());
    parts.retain(|part| !part.triangles.is_empty());
    mesh.parts = parts;
    check_not_empty(path, &mesh)?;
    let mut data = Dataset::new(path, "Wavefront OBJ mesh", Geometry::Mesh(mesh), Vec::new());
    data.notes = notes;
    Ok(data)
}

/// One part for each group of faces, in its order, with texture coordinates where the faces have
/// them.
fn parts(path: &Path, scan: &mut Scan, notes: &mut Vec<String>) -> Result<Vec<MeshPart>> {
    let text = std::mem::take(&mut scan.text);
    let options = tobj::LoadOptions {
        single_index: true,
        ..tobj::LoadOptions::default()
    };
    // The text names no library.
    let loader = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) =
        tobj::load_obj_buf(&mut Cursor::new(text), &options, loader).map_err(|e| {
            Error::format(
                path,
                "mesh",
                "what the OBJ format allows",
                e.to_string(),
                "save the mesh again",
            )
        })?;
    let mut colour_scale = 1.0;
    if scan.has_colours {
        let colours = models.iter().flat_map(|m| &m.mesh.vertex_color);
        if colours.copied().any(|c| c > 1.0) {
            colour_scale = 255.0;
            notes.push("colours of vertices exceed 1 and are taken as 0 to 255".into());
        }
    }
    let mut approximate = 0;
    let mut parts = vec![MeshPart::default(); scan.groups.len()];
    for model in models {
        let part = model
            .name
            .parse()
            .ok()
            .and_then(|i: usize| parts.get_mut(i));
        if let Some(part) = part {
            *part = part_of(&model.mesh, colour_scale, &mut approximate);
        }
    }
    if approximate > 0 {
        notes.push(format!(
            "{approximate} polygons cross themselves or have no area: fans of triangles stand \
             for them"
        ));
    }
    Ok(parts)
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "directions, colours and texture coordinates are kept as f32"
)]
fn part_of(mesh: &tobj::Mesh, colour_scale: f64, approximate: &mut usize) -> MeshPart {
    let positions: Vec<DVec3> = mesh
        .positions
        .chunks_exact(3)
        .map(DVec3::from_slice)
        .collect();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    if mesh.face_arities.is_empty() {
        triangles = mesh.indices.as_chunks::<3>().0.to_vec();
    } else {
        let mut rest = mesh.indices.as_slice();
        let (mut corners, mut local) = (Vec::new(), Vec::new());
        for &arity in &mesh.face_arities {
            let (face, others) = rest.split_at(rest.len().min(arity as usize));
            rest = others;
            // A corner named twice in a row is one.
            let mut face = face.to_vec();
            face.dedup();
            while face.len() > 1 && face.first() == face.last() {
                face.pop();
            }
            if face.len() < 3 {
                // Left out and counted with the others that have no area.
                triangles.extend(face.first().map(|&i| [i; 3]));
                continue;
            }
            corners.clear();
            corners.extend(face.iter().map(|&i| positions[i as usize]));
            local.clear();
            if polygons::triangulate(&corners, &mut local) == Outcome::Approximate {
                *approximate += 1;
            }
            triangles.extend(local.iter().map(|t: &[usize; 3]| t.map(|i| face[i])));
        }
    }
    let colours = mesh.vertex_color.chunks_exact(3).map(|rgb| {
        // Vertices without a colour, among others with one, have a negative one.
        let is_white = rgb.iter().any(|c| *c < 0.0);
        let [r, g, b] = [0, 1, 2].map(|i| {
            if is_white {
                return 1.0;
            }
            linear_from_srgb((rgb[i] / colour_scale) as f32)
        });
        [r, g, b, 1.0]
    });
    let coordinates = mesh.texcoords.chunks_exact(2);
    let coordinates = coordinates.map(|uv| Vec2::new(uv[0] as f32, (1.0 - uv[1]) as f32));
    let normals = mesh.normals.chunks_exact(3);
    let normals = normals.map(|n| DVec3::from_slice(n).normalize_or_zero().as_vec3());
    MeshPart {
        triangles,
        normals: normals.collect::<Vec<Vec3>>(),
        texture_coordinates: if mesh.texcoords.is_empty() {
            Vec::new()
        } else {
            vec![coordinates.collect()]
        },
        colours: colours.collect(),
        material: 0,
        positions,
    }
}

/// The materials of a mesh, made as parts ask for them.
struct Materials {
    mesh: Mesh,
    library: HashMap<String, MtlMaterial>,
    images: Images,
    /// The texture for parts without one.
    fallback: Option<usize>,
    made: HashMap<(Option<usize>, bool), usize>,
}

impl Materials {
    /// Reads the libraries that a file names, and tells of those and of materials that are not
    /// there.
    fn new(path: &Path, scan: &Scan, notes: &mut Vec<String>) -> Self {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut library = HashMap::new();
        for statement in &scan.libraries {
            // The whole statement is one name, or several without spaces.
            let whole = find(folder, statement);
            let names: Vec<&str> = match whole {
                Some(_) => vec![statement],
                None => statement.split_whitespace().collect(),
            };
            for name in names {
                let Some(file) = find(folder, name) else {
                    notes.push(format!("no file `{}` of materials", clip(name)));
                    continue;
                };
                match read_all(&file) {
                    Ok(bytes) => library.extend(
                        mtl::read(&bytes, notes)
                            .into_iter()
                            .map(|m| (m.name.clone(), m)),
                    ),
                    Err(e) => notes.push(e.to_string()),
                }
            }
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
            images: Images::new(folder),
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
                // As with Kd: black with a texture stands for the texture.
                (Some(_), Some(_)) if is_dark => [1.0; 3],
                // Light through a texture that cannot be read would be light everywhere.
                (Some(_), None) => [0.0; 3],
                _ => stated.emissive.map(linear_from_srgb),
            },
            emissive_texture: emissive,
            alpha,
            is_double_sided: false,
        }
    }
}

/// The file that a statement names: relative to the folder, or by its last name in it, as for
/// paths of another machine.
fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.replace('\\', "/");
    let last = name.rsplit('/').next().unwrap_or("");
    [name.as_str(), last]
        .into_iter()
        .filter(|n| !n.is_empty())
        .map(|n| folder.join(n))
        .find(|file| file.is_file())
}

/// What a texture is made of: two textures of one key are one.
#[derive(PartialEq, Eq, Hash)]
struct TextureKey {
    /// The file of its colour; without it, it is white.
    colour: Option<String>,
    /// The file of its opacity.
    opacity: Option<String>,
    is_clamped: bool,
}

/// Textures, each decoded once.
struct Images {
    folder: PathBuf,
    budget: ImageBudget,
    decoded: HashMap<String, Option<Arc<TextureImage>>>,
    textures: Vec<Texture>,
    /// Textures, and whether they cut out.
    made: HashMap<TextureKey, (usize, bool)>,
    notes: Vec<String>,
}

impl Images {
    fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_path_buf(),
            budget: ImageBudget::default(),
            decoded: HashMap::new(),
            textures: Vec::new(),
            made: HashMap::new(),
            notes: Vec::new(),
        }
    }

    /// The texture that the user names: an error where it cannot be read.
    fn named_by_user(&mut self, path: &Path) -> Result<usize> {
        let decoded = self.budget.decode(&read_all(path)?).map_err(|reason| {
            Error::format(
                path,
                "texture",
                "a PNG or JPEG image",
                format!("a file that {reason}"),
                "name another image with --texture",
            )
        })?;
        self.textures.push(Texture {
            image: Arc::new(decoded),
            wrap: [Wrap::Repeat; 2],
        });
        Ok(self.textures.len() - 1)
    }

    /// An image, or `None` and a note.
    fn decode(&mut self, name: &str) -> Option<Arc<TextureImage>> {
        if let Some(known) = self.decoded.get(name) {
            return known.clone();
        }
        let decoded = match find(&self.folder, name) {
            None => Err(format!("no file `{}`", clip(name))),
            Some(file) => read_all(&file)
                .map_err(|e| e.to_string())
                .and_then(|bytes| {
                    self.budget
                        .decode(&bytes)
                        .map_err(|reason| format!("image `{}` {reason}", clip(name)))
                }),
        };
        let decoded = match decoded {
            Ok(decoded) => Some(Arc::new(decoded)),
            Err(reason) => {
                self.notes
                    .push(format!("{reason}: its texture is not used"));
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

    /// The texture of colour and opacity of a material, and whether it cuts out: all opacities
    /// are 0 or 1.
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

    /// A texture of one image's colour (or white) and another's opacity.
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
                    // An image that is its own opacity has it.
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

/// A use of a texture under the options of its statement. They speak of v upwards: 1 - v turns
/// into s v + (1 - s - o).
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

/// An image with another's opacity, at the nearest pixel: its alpha channel, or its brightness
/// where that is 1 all over.
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
