//! Colour and opacity of pieces: material, texture and colours at corners.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec2};

use super::surface::Triangle;
use super::texture::{Pyramid, Weighing};
use crate::io::{AlphaMode, Material, Mesh, MeshPart, TextureUse};

/// The materials of a mesh, made ready.
#[derive(Debug)]
pub(super) struct Paints<'a> {
    mesh: &'a Mesh,
    pyramids: Vec<Pyramid<'a>>,
    /// For each material, its base texture and what it emits: indices into `pyramids`.
    textures: Vec<[Option<usize>; 2]>,
}

/// What a piece shows: linear RGB times the share that is there, and that share: 1 for opaque
/// surfaces, the opacity of translucent ones, the part left by a mask.
pub(super) type Paint = [f64; 4];

impl<'a> Paints<'a> {
    /// Textures of materials that `is_used`; others are not looked at.
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
                    Weighing::Alike => 0,
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

    /// Of a piece of a triangle with these barycentric corners; `None` where texture coordinates or
    /// colours are not finite.
    pub(super) fn of(&self, triangle: &Triangle, corners: &[DVec2; 3]) -> Option<Paint> {
        let part = &self.mesh.parts[triangle.part as usize];
        let indices = part.triangles[triangle.index as usize];
        let material = &self.mesh.materials[part.material];
        let [base_texture, emissive_texture] = self.textures[part.material];
        let lookup = |used: &Option<TextureUse>, pyramid: Option<usize>| match (used, pyramid) {
            (Some(used), Some(pyramid)) => {
                let Some(set) = part.texture_coordinates.get(used.coordinates) else {
                    return Some([1.0; 4]);
                };
                let (centre, variance) = footprint(set, indices, used, corners)?;
                Some(self.pyramids[pyramid].filtered(centre, variance))
            }
            _ => Some([1.0; 4]),
        };
        let texel = lookup(&material.base_texture, base_texture)?;
        let corner_colour = colour_at_corners(part, indices, corners);
        let factor = |i: usize| f64::from(material.base_colour[i]) * corner_colour[i];
        let [r, g, b, weight] = texel;
        let (shared, there) = match material.alpha {
            AlphaMode::Opaque => (1.0, weight),
            AlphaMode::Mask(cutoff) if base_texture.is_none() => {
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
            let glow = lookup(&material.emissive_texture, emissive_texture)?;
            for i in 0..3 {
                paint[i] += f64::from(material.emissive[i]) * glow[i] * there;
            }
        }
        paint.iter().all(|p| p.is_finite()).then_some(paint)
    }
}

/// How alpha weighs in averages of a material's base texture.
fn base_weighing(material: &Material) -> Weighing {
    match material.alpha {
        AlphaMode::Opaque => Weighing::Alike,
        AlphaMode::Blend => Weighing::Alpha,
        AlphaMode::Mask(cutoff) => Weighing::AtLeast(cutoff / material.base_colour[3]),
    }
}

/// Centre and variance of a piece in the texture.
fn footprint(
    set: &[Vec2],
    indices: [u32; 3],
    used: &TextureUse,
    corners: &[DVec2; 3],
) -> Option<(DVec2, [f64; 3])> {
    let mut uv = [DVec2::ZERO; 3];
    for (uv, &index) in uv.iter_mut().zip(&indices) {
        let at = set.get(index as usize)?;
        *uv = used.transform.transform_point2(*at).as_dvec2();
    }
    let [origin, e1, e2] = [uv[0], uv[1] - uv[0], uv[2] - uv[0]];
    let at = corners.map(|b| e1 * b.x + e2 * b.y);
    let middle = (at[0] + at[1] + at[2]) / 3.0;
    let mut variance = [0.0; 3];
    for corner in at {
        let d = corner - middle;
        variance[0] += d.x * d.x / 12.0;
        variance[1] += d.x * d.y / 12.0;
        variance[2] += d.y * d.y / 12.0;
    }
    Some((origin + middle, variance))
}

/// The mean of the colours given at corners; white where there are none.
fn colour_at_corners(part: &MeshPart, indices: [u32; 3], corners: &[DVec2; 3]) -> [f64; 4] {
    if part.colours.is_empty() {
        return [1.0; 4];
    }
    let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
    let shares = DVec3::new(1.0 - middle.x - middle.y, middle.x, middle.y).to_array();
    let mut sum = [0.0; 4];
    for (share, &index) in shares.iter().zip(&indices) {
        let colour = part.colours.get(index as usize).unwrap_or(&[1.0; 4]);
        for (sum, &c) in sum.iter_mut().zip(colour) {
            *sum += share * f64::from(c);
        }
    }
    sum
}
