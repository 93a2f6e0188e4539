//! A polygon mesh with its materials and textures, as OBJ and glTF files hold it.

use std::sync::Arc;

use glam::{Affine2, DVec3, Vec2, Vec3};

use crate::error::{Error, Result};

/// Triangles with materials, in world space: transforms of nodes are applied, and where one mirrors,
/// the triangles' winding is reversed, so that corners run counter-clockwise seen from the front.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Runs of triangles of one material.
    pub parts: Vec<MeshPart>,
    /// What the parts are made of.
    pub materials: Vec<Material>,
    /// What the materials name.
    pub textures: Vec<Texture>,
}

/// Triangles of one material, and lines and points beside them.
#[derive(Debug, Clone, Default)]
pub struct MeshPart {
    /// Corners, world units; finite.
    pub positions: Vec<DVec3>,
    /// Indices into `positions`; in range.
    pub triangles: Vec<[u32; 3]>,
    /// Lines as indices into `positions`; those of a polyline follow one another.
    pub lines: Vec<[u32; 2]>,
    /// Points as indices into `positions`.
    pub points: Vec<u32>,
    /// Unit normals per corner; empty where the file has none.
    pub normals: Vec<Vec3>,
    /// Whether triangles without normals are flat, as glTF says; those of other formats are smooth where they meet at
    /// less than 40 degrees.
    pub is_flat: bool,
    /// Texture coordinates per corner for each set, origin at the texture's top left corner, v down;
    /// sets that no material uses are left out and are empty.
    pub texture_coordinates: Vec<Vec<Vec2>>,
    /// Linear RGBA per corner that multiplies the material's colour; empty where the file has none.
    pub colours: Vec<[f32; 4]>,
    /// Index into [`Mesh::materials`].
    pub material: usize,
}

/// What a surface is made of, without light: colour and opacity.
#[derive(Debug, Clone)]
pub struct Material {
    /// The name in the file.
    pub name: String,
    /// Linear RGBA that multiplies the texture.
    pub base_colour: [f32; 4],
    /// The texture that holds colour (sRGB-encoded) and opacity.
    pub base_texture: Option<TextureUse>,
    /// Linear RGB that is added to the colour, times the texture below.
    pub emissive: [f32; 3],
    /// The texture of what is emitted (sRGB-encoded).
    pub emissive_texture: Option<TextureUse>,
    /// The texture of normals: red, green and blue, 0 to 1 for -1 to 1, to the right and to the top of the texture and
    /// outwards.
    pub normal_texture: Option<TextureUse>,
    /// What the first two components of those normals are multiplied by.
    pub normal_scale: f32,
    /// Whether light changes nothing.
    pub is_unlit: bool,
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether triangles are seen from behind, too.
    pub is_double_sided: bool,
}

/// What a material's alpha means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Nothing: all is opaque.
    Opaque,
    /// Opaque from this value on, absent below.
    Mask(f32),
    /// Opacity, the same from every side.
    Blend,
}

/// How a material uses a texture.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureUse {
    /// Index into [`Mesh::textures`].
    pub texture: usize,
    /// Which set of texture coordinates.
    pub coordinates: usize,
    /// From texture coordinates to those of the texture, in units of its size.
    pub transform: Affine2,
}

/// An image and how it goes on beyond its edges.
#[derive(Debug, Clone)]
pub struct Texture {
    /// The pixels, shared by all textures of one image.
    pub image: Arc<TextureImage>,
    /// Beyond the left and right edges, and beyond top and bottom.
    pub wrap: [Wrap; 2],
}

/// Pixels of 8 bits, as most files have them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextureImage {
    /// Columns; at least 1.
    pub width: usize,
    /// Rows; at least 1.
    pub height: usize,
    /// sRGB-encoded RGB and linear alpha, rows from the top.
    pub pixels: Vec<[u8; 4]>,
}

/// How a texture goes on beyond an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Wrap {
    /// Again from the other side.
    #[default]
    Repeat,
    /// Back and forth.
    MirroredRepeat,
    /// With the pixel at the edge.
    ClampToEdge,
}

impl Default for Material {
    /// White, opaque, seen from both sides.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_colour: [1.0; 4],
            base_texture: None,
            emissive: [0.0; 3],
            emissive_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            is_unlit: false,
            alpha: AlphaMode::Opaque,
            is_double_sided: true,
        }
    }
}

impl MeshPart {
    /// Whether it has no triangle, no line and no point.
    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.lines.is_empty() && self.points.is_empty()
    }
}

impl Mesh {
    /// Triangles in memory, white, opaque, seen from both sides.
    ///
    /// - `positions`: corners, world units.
    /// - `triangles`: three corners each, counter-clockwise seen from the front.
    ///
    /// ```
    /// use ewa_splat::io::Mesh;
    /// use ewa_splat::sample::mesh::{MeshOptions, surfels};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    /// let mesh = Mesh::of_triangles(corners, [[0, 1, 2], [0, 1, 3]])
    ///     .with_colours([[1.0, 0.2, 0.1, 1.0]; 4]);
    /// let sampled = surfels(&mesh, &MeshOptions::default())?;
    /// assert!((sampled.report.area - 1.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn of_triangles(
        positions: impl Into<Vec<DVec3>>,
        triangles: impl Into<Vec<[u32; 3]>>,
    ) -> Self {
        Self {
            parts: vec![MeshPart {
                positions: positions.into(),
                triangles: triangles.into(),
                ..MeshPart::default()
            }],
            materials: vec![Material::default()],
            textures: Vec::new(),
        }
    }

    /// The same with a linear RGBA colour for each corner of its first part.
    #[must_use]
    pub fn with_colours(mut self, colours: impl Into<Vec<[f32; 4]>>) -> Self {
        if let Some(part) = self.parts.first_mut() {
            part.colours = colours.into();
        }
        self
    }

    /// The same with a texture that repeats, for which each corner of its first part has coordinates.
    ///
    /// - `coordinates`: origin at the texture's top left corner, v down.
    #[must_use]
    pub fn with_texture(
        mut self,
        coordinates: impl Into<Vec<Vec2>>,
        image: impl Into<Arc<TextureImage>>,
    ) -> Self {
        let texture = self.textures.len();
        self.textures.push(Texture {
            image: image.into(),
            wrap: [Wrap::Repeat; 2],
        });
        if let Some(part) = self.parts.first_mut() {
            part.texture_coordinates = vec![coordinates.into()];
            if let Some(material) = self.materials.get_mut(part.material) {
                material.base_texture = Some(TextureUse {
                    texture,
                    coordinates: 0,
                    transform: Affine2::IDENTITY,
                });
            }
        }
        self
    }

    /// Whether corners or textures say what colours it has.
    pub(crate) fn has_colours(&self) -> bool {
        self.parts.iter().any(|part| !part.colours.is_empty())
            || self.materials.iter().any(|m| m.base_texture.is_some())
    }

    /// Checks that what parts have per corner is there for each and that pictures have all their
    /// pixels. Triangles and parts that name a corner or a material that does not exist are left
    /// out, and counted, where surfels are made.
    ///
    /// # Errors
    /// The first array of another length, or the name of a texture that is none.
    pub fn validate(&self) -> Result<()> {
        let fault = |place: String, expected: String, found: String| {
            Err(Error::invalid(
                "mesh",
                place,
                expected,
                found,
                "correct the mesh",
            ))
        };
        for (i, part) in self.parts.iter().enumerate() {
            let count = part.positions.len();
            let sets = part.texture_coordinates.iter().map(Vec::len);
            let lengths = [
                ("normals", part.normals.len()),
                ("colours", part.colours.len()),
            ];
            let sets = sets.map(|len| ("texture coordinates", len));
            let wrong = lengths.into_iter().chain(sets);
            if let Some((name, len)) = { wrong }.find(|&(_, len)| len != 0 && len != count) {
                let expected = format!("none or one for each of {count} corners");
                return fault(format!("part {i}, {name}"), expected, len.to_string());
            }
        }
        for material in &self.materials {
            let textures = [
                &material.base_texture,
                &material.emissive_texture,
                &material.normal_texture,
            ];
            for used in textures.into_iter().flatten() {
                if used.texture >= self.textures.len() {
                    let place = format!("material `{}`", material.name);
                    let expected = format!("one of {} textures", self.textures.len());
                    return fault(place, expected, format!("number {}", used.texture));
                }
            }
        }
        for (i, texture) in self.textures.iter().enumerate() {
            let TextureImage {
                width,
                height,
                ref pixels,
            } = *texture.image;
            if pixels.is_empty() || width.checked_mul(height) != Some(pixels.len()) {
                let expected = "width x height pixels, at least one".to_owned();
                let found = format!("{width} x {height} with {} pixels", pixels.len());
                return fault(format!("texture {i}"), expected, found);
            }
        }
        Ok(())
    }

    /// How many triangles there are.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }

    /// How many lines there are.
    pub fn line_count(&self) -> usize {
        self.parts.iter().map(|part| part.lines.len()).sum()
    }

    /// How many points there are.
    pub fn point_count(&self) -> usize {
        self.parts.iter().map(|part| part.points.len()).sum()
    }
}
