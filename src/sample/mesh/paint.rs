//! Computes colour and opacity of pieces, from material, texture and colours at corners.

use std::collections::HashMap;

use glam::DVec2;

use super::surface::Triangle;
use super::texture::{Pyramid, Weighing};
use crate::data::mesh::{AlphaMode, Material, Mesh, MeshPart, TextureUse};

/// The materials of a mesh, prepared for lookups.
#[derive(Debug)]
pub(super) struct Paints<'a> {
    mesh: &'a Mesh,
    pyramids: Vec<Pyramid<'a>>,
    /// Base and emissive texture of each material: indices into `pyramids`.
    textures: Vec<[Option<usize>; 2]>,
}

/// Colour of a piece: linear RGB times the visible share, and that share. The share is 1 for opaque surfaces,
/// the opacity of translucent ones, the part left by a mask.
pub(super) type Paint = [f64; 4];

impl<'a> Paints<'a> {
    /// Prepares the textures of materials that `is_used`; others are ignored.
    pub(super) fn new(mesh: &'a Mesh, is_used: &[bool]) -> Self {
        let mut paints = Self {
            mesh,
            pyramids: Vec::new(),
            textures: Vec::new(),
        };
        let mut known = HashMap::new();
        for (material, &is_used) in mesh.materials.iter().zip(is_used) {
            let base = (&material.base_texture, base_weighing(material));
            let emissive = (&material.emissive_texture, Weighing::Alike);
            let textures = [base, emissive].map(|(used, weighing)| {
                let index = used.as_ref().filter(|_| is_used)?.texture;
                let texture = mesh.textures.get(index)?;
                let bits = match weighing {
                    Weighing::Alike | Weighing::Numbers => 0,
                    Weighing::Alpha => 1,
                    Weighing::AtLeast(cutoff) => 2 | u64::from(cutoff.to_bits()) << 2,
                };
                Some(*known.entry((index, bits)).or_insert_with(|| {
                    paints.pyramids.push(Pyramid::new(texture, weighing));
                    paints.pyramids.len() - 1
                }))
            });
            paints.textures.push(textures);
        }
        paints
    }

    /// Returns the coat of a triangle of the mesh; `None` if texture coordinates are missing.
    pub(super) fn coat(&self, triangle: &Triangle) -> Option<Coat<'_>> {
        let part = &self.mesh.parts[triangle.part as usize];
        let indices = part.triangles[triangle.index as usize];
        let material = &self.mesh.materials[part.material];
        let [base, emissive] = self.textures[part.material];
        let laid = |used: &Option<TextureUse>, pyramid: Option<usize>| match (used, pyramid) {
            (Some(used), Some(pyramid)) if part.texture_coordinates.len() > used.coordinates => {
                Laid::of(used, part, indices, &self.pyramids[pyramid]).map(Some)
            }
            _ => Some(None),
        };
        let glows = material.emissive != [0.0; 3];
        let corner = |index: u32| part.colours.get(index as usize).unwrap_or(&[1.0; 4]);
        Some(Coat {
            material,
            base: laid(&material.base_texture, base)?,
            emissive: match glows {
                true => laid(&material.emissive_texture, emissive)?,
                false => None,
            },
            colours: (!part.colours.is_empty())
                .then(|| indices.map(|index| corner(index).map(f64::from))),
        })
    }
}

/// A texture on a triangle.
#[derive(Debug)]
pub(super) struct Laid<'a> {
    pyramid: &'a Pyramid<'a>,
    /// Texture coordinates of the first corner; then their differences along the two edges that begin there.
    origin: DVec2,
    pub(super) edges: [DVec2; 2],
}

impl<'a> Laid<'a> {
    /// Places a texture on the triangle of a part with the corners `indices`; `None` if one has no coordinates.
    pub(super) fn of(
        used: &TextureUse,
        part: &MeshPart,
        indices: [u32; 3],
        pyramid: &'a Pyramid<'a>,
    ) -> Option<Self> {
        let set = part.texture_coordinates.get(used.coordinates)?;
        let mut uv = [DVec2::ZERO; 3];
        for (uv, index) in uv.iter_mut().zip(indices) {
            let at = set.get(index as usize)?;
            *uv = used.transform.transform_point2(*at).as_dvec2();
        }
        let [origin, a, b] = uv;
        Some(Self {
            pyramid,
            origin,
            edges: [a - origin, b - origin],
        })
    }
}

/// The material, textures and corner colours of one triangle of the mesh.
#[derive(Debug)]
pub(super) struct Coat<'a> {
    material: &'a Material,
    base: Option<Laid<'a>>,
    emissive: Option<Laid<'a>>,
    /// Colours at the corners, if any.
    colours: Option<[[f64; 4]; 3]>,
}

impl Coat<'_> {
    /// Returns true if the colour is constant over the triangle.
    pub(super) fn is_plain(&self) -> bool {
        self.base.is_none() && self.emissive.is_none() && self.colours.is_none()
    }

    /// Returns the paint of a part of the triangle, given by its middle and its variance (xx, xy, yy) in
    /// barycentric coordinates along the two edges. Returns `None` if texture coordinates or colours are not
    /// finite.
    pub(super) fn of(&self, middle: DVec2, variance: [f64; 3]) -> Option<Paint> {
        let material = self.material;
        let lookup = |laid: &Option<Laid>| {
            laid.as_ref()
                .map_or([1.0; 4], |l| l.filtered(middle, variance))
        };
        let corner_colour = self.corner_colour(middle);
        let factor = |i: usize| f64::from(material.base_colour[i]) * corner_colour[i];
        let [r, g, b, weight] = lookup(&self.base);
        let (shared, there) = match material.alpha {
            AlphaMode::Opaque => (1.0, weight),
            AlphaMode::Mask(cutoff) if self.base.is_none() => {
                let is_there = factor(3) >= f64::from(cutoff);
                (f64::from(u8::from(is_there)), f64::from(u8::from(is_there)))
            }
            AlphaMode::Mask(_) => (1.0, weight),
            AlphaMode::Blend => {
                let alpha = factor(3).clamp(0.0, 1.0);
                (alpha, alpha * weight)
            }
        };
        let mut paint = [
            r * factor(0) * shared,
            g * factor(1) * shared,
            b * factor(2) * shared,
            there,
        ];
        if material.emissive != [0.0; 3] {
            let glow = lookup(&self.emissive);
            for i in 0..3 {
                paint[i] += f64::from(material.emissive[i]) * glow[i] * there;
            }
        }
        paint.iter().all(|p| p.is_finite()).then_some(paint)
    }

    /// Interpolates the colours at corners; white if there are none.
    fn corner_colour(&self, middle: DVec2) -> [f64; 4] {
        let Some(colours) = &self.colours else {
            return [1.0; 4];
        };
        let shares = [1.0 - middle.x - middle.y, middle.x, middle.y];
        let mut sum = [0.0; 4];
        for (share, colour) in shares.iter().zip(colours) {
            for (sum, &c) in sum.iter_mut().zip(colour) {
                *sum += share * c;
            }
        }
        sum
    }
}

impl Laid<'_> {
    pub(super) fn filtered(&self, middle: DVec2, [xx, xy, yy]: [f64; 3]) -> [f64; 4] {
        let [a, b] = self.edges;
        let between = |i: usize, j: usize| {
            xx * a[i] * a[j] + xy * (a[i] * b[j] + b[i] * a[j]) + yy * b[i] * b[j]
        };
        let centre = self.origin + a * middle.x + b * middle.y;
        self.pyramid
            .filtered(centre, [between(0, 0), between(0, 1), between(1, 1)])
    }
}

/// Returns the weighting of alpha in averages of a material's base texture.
fn base_weighing(material: &Material) -> Weighing {
    match material.alpha {
        AlphaMode::Opaque => Weighing::Alike,
        AlphaMode::Blend => Weighing::Alpha,
        AlphaMode::Mask(cutoff) => Weighing::AtLeast(cutoff / material.base_colour[3]),
    }
}
