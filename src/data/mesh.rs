//! Defines a polygon mesh with materials and textures, as OBJ and glTF files store it.

use std::sync::Arc;

use glam::{Affine2, DVec3, Vec2, Vec3};

use crate::error::{Error, Result};

/// Triangles with materials, in world space: transforms of nodes are applied. If a transform mirrors, the winding of
/// its triangles is reversed, so that corners run counter-clockwise seen from the front.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Parts of one material each.
    pub parts: Vec<MeshPart>,
    /// Materials of the parts.
    pub materials: Vec<Material>,
    /// Textures that the materials refer to.
    pub textures: Vec<Texture>,
}

/// Triangles of one material, with lines and points.
#[derive(Debug, Clone, Default)]
pub struct MeshPart {
    /// Corners, world units; finite.
    pub positions: Vec<DVec3>,
    /// Indices into `positions`; in range.
    pub triangles: Vec<[u32; 3]>,
    /// Lines as indices into `positions`; the lines of a polyline follow one another.
    pub lines: Vec<[u32; 2]>,
    /// Points as indices into `positions`.
    pub points: Vec<u32>,
    /// Unit normals per corner; empty if the file has none.
    pub normals: Vec<Vec3>,
    /// True if triangles without normals are flat, as in glTF. In other formats they are smooth if they meet at less
    /// than 40 degrees.
    pub is_flat: bool,
    /// Texture coordinates per corner for each set, origin at the texture's top left corner, v down. Sets that no
    /// material uses are empty.
    pub texture_coordinates: Vec<Vec<Vec2>>,
    /// Linear RGBA per corner that multiplies the material's colour; empty if the file has none.
    pub colours: Vec<[f32; 4]>,
    /// Index into [`Mesh::materials`].
    pub material: usize,
}

/// Material of a surface, without lighting: colour and opacity.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Linear RGBA that multiplies the texture.
    pub base_colour: [f32; 4],
    /// Texture with colour (sRGB-encoded) and opacity.
    pub base_texture: Option<TextureUse>,
    /// Linear RGB of emitted light, multiplied by the texture below.
    pub emissive: [f32; 3],
    /// Texture of the emitted light (sRGB-encoded).
    pub emissive_texture: Option<TextureUse>,
    /// Normal map: red, green and blue from 0 to 1 represent -1 to 1. The directions are the texture's right and top,
    /// and outwards.
    pub normal_texture: Option<TextureUse>,
    /// Factor of the first two components of those normals.
    pub normal_scale: f32,
    /// True if lighting has no effect.
    pub is_unlit: bool,
    /// Meaning of alpha.
    pub alpha: AlphaMode,
    /// True if triangles are visible from behind, too.
    pub is_double_sided: bool,
}

/// Meaning of a material's alpha.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored: the surface is opaque.
    Opaque,
    /// The surface is opaque where alpha is at least this value, and absent elsewhere.
    Mask(f32),
    /// Opacity, the same from every direction.
    Blend,
}

/// Reference from a material to a texture.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureUse {
    /// Index into [`Mesh::textures`].
    pub texture: usize,
    /// Index of the set of texture coordinates.
    pub coordinates: usize,
    /// Transform from texture coordinates to positions in the texture, in units of its size.
    pub transform: Affine2,
}

/// Image, and its continuation beyond its edges.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Pixels, shared by all textures of one image.
    pub image: Arc<TextureImage>,
    /// Continuation beyond the left and right edges, and beyond top and bottom.
    pub wrap: [Wrap; 2],
}

/// Image of 8-bit pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextureImage {
    /// Number of columns; at least 1.
    pub width: usize,
    /// Number of rows; at least 1.
    pub height: usize,
    /// sRGB-encoded RGB and linear alpha, rows from the top.
    pub pixels: Vec<[u8; 4]>,
}

/// Continuation of a texture beyond an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Wrap {
    /// Repeats the texture.
    #[default]
    Repeat,
    /// Repeats the texture, mirrored every other time.
    MirroredRepeat,
    /// Repeats the pixel at the edge.
    ClampToEdge,
}

impl Default for Material {
    /// White, opaque, visible from both sides.
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
    /// Returns true if there are no triangles, lines or points.
    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.lines.is_empty() && self.points.is_empty()
    }
}

impl Mesh {
    /// Creates a mesh from triangles in memory: white, opaque, visible from both sides.
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

    /// Sets a linear RGBA colour for each corner of the first part.
    #[must_use]
    pub fn with_colours(mut self, colours: impl Into<Vec<[f32; 4]>>) -> Self {
        if let Some(part) = self.parts.first_mut() {
            part.colours = colours.into();
        }
        self
    }

    /// Sets a repeating texture and the texture coordinates of each corner of the first part.
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

    /// Returns true if corners or textures define colours.
    pub(crate) fn has_colours(&self) -> bool {
        self.parts.iter().any(|part| !part.colours.is_empty())
            || self.materials.iter().any(|m| m.base_texture.is_some())
    }

    /// Checks that per-corner arrays have an entry for each corner, and that images have all their pixels. Triangles
    /// and parts may name a corner or a material that does not exist; the sampler of surfels leaves them out and counts
    /// them.
    ///
    /// # Errors
    /// The first array of another length, or a reference to a texture that does not exist.
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

    /// Returns the number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.parts.iter().map(|part| part.triangles.len()).sum()
    }

    /// Returns the number of lines.
    pub fn line_count(&self) -> usize {
        self.parts.iter().map(|part| part.lines.len()).sum()
    }

    /// Returns the number of points.
    pub fn point_count(&self) -> usize {
        self.parts.iter().map(|part| part.points.len()).sum()
    }
}
