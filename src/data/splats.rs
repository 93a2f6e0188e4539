//! Defines splats as radiance fields store them, for all formats. `splat_axes.rs` has the axes of each.

use std::mem::take;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::spz_records::{Change, SpzRecords};
use crate::error::{Error, Result};
use crate::image::{linear_from_srgb, srgb_from_linear};
use crate::math::{
    HARMONIC_0, HarmonicsTransform, MAX_HARMONICS_DEGREE, harmonics_count, narrowed,
    rotation_matrix,
};
use crate::scene::SplatRule;
use crate::scene::storage::picked;

/// Anisotropic Gaussians with a peak opacity and a colour each. Their opacity on the image is peak x exp(-Q/2),
/// the same from every side: not the optical depth of a volume.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SplatCloud {
    /// Centres.
    pub positions: Vec<DVec3>,
    /// Standard deviations along the kernel's own axes, world units; the third is 0 if the file stores flat
    /// splats.
    pub scales: Vec<[f32; 3]>,
    /// Rotations as quaternions w, x, y, z of any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Peak opacities, 0 to 1.
    pub opacities: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub harmonics_degree: u8,
    /// (degree + 1)² coefficients of three colour channels per splat, one splat after another:
    /// R, G, B of the first coefficient, of the second, ...
    ///
    /// They multiply the harmonics, including the constant one of .28209479. With the basis Y of
    /// [`harmonics`](crate::math::harmonics) a colour is 1/2 + sum c_k Y_k(d), d the unit direction from the
    /// eye to the splat. It is an sRGB code, or linear light if `is_linear`; 0 if the sum is negative.
    pub harmonics: Vec<f32>,
    /// Whether colours are linear light, in which they are then composited; otherwise they are sRGB codes.
    pub is_linear: bool,
    /// Rule of the renderer that the file's splats were made for.
    pub rule: SplatRule,
    /// Whether the file states that splats are sorted by their distance from the eye; otherwise by their depth along the
    /// camera's axis, as most viewers do.
    pub by_distance: bool,
    /// Extension records of the SPZ file that the splats were read from.
    pub records: SpzRecords,
}

impl SplatCloud {
    /// Numbers of colour per splat: three for each of (degree + 1)² coefficients.
    pub fn harmonics_stride(&self) -> usize {
        3 * harmonics_count(self.harmonics_degree)
    }

    /// Checks that every array has one entry per splat.
    ///
    /// # Errors
    /// The first array of another length, or harmonics of a degree above [`MAX_HARMONICS_DEGREE`].
    pub fn validate(&self) -> Result<()> {
        let count = self.positions.len();
        let fault = |place: &str, expected: String, found: usize| {
            let advice = "give one entry for each splat";
            Err(Error::invalid(
                "splats",
                place,
                expected,
                found.to_string(),
                advice,
            ))
        };
        if self.harmonics_degree > MAX_HARMONICS_DEGREE {
            let expected = format!("at most {MAX_HARMONICS_DEGREE}");
            return fault(
                "degree of the harmonics",
                expected,
                self.harmonics_degree.into(),
            );
        }
        for (place, stride, len) in [
            ("scales", 1, self.scales.len()),
            ("rotations", 1, self.rotations.len()),
            ("opacities", 1, self.opacities.len()),
            ("harmonics", self.harmonics_stride(), self.harmonics.len()),
        ] {
            if count.checked_mul(stride) != Some(len) {
                return fault(place, format!("{stride} for each of {count}"), len);
            }
        }
        Ok(())
    }

    /// Appends the splats of another cloud; coefficients that one of the two lacks are 0. The rule does not
    /// change, unless there were no splats yet.
    ///
    /// If one cloud is linear and the other is encoded, one is converted. The encoded cloud becomes linear if its colours do not
    /// depend on the view; otherwise the linear cloud is encoded.
    pub fn append(&mut self, mut other: Self) {
        if self.positions.is_empty() {
            *self = other;
            return;
        }
        self.records.join(take(&mut other.records));
        if self.is_linear != other.is_linear {
            let (linear, encoded) = match self.is_linear {
                true => (&mut *self, &mut other),
                false => (&mut other, &mut *self),
            };
            if encoded.harmonics_degree == 0 {
                encoded.recolour(linear_from_srgb);
                encoded.is_linear = true;
            } else {
                linear.encode();
            }
        }
        let degree = self.harmonics_degree.max(other.harmonics_degree);
        self.raise_degree(degree);
        other.raise_degree(degree);
        self.positions.append(&mut other.positions);
        self.scales.append(&mut other.scales);
        self.rotations.append(&mut other.rotations);
        self.opacities.append(&mut other.opacities);
        self.harmonics.append(&mut other.harmonics);
    }

    /// Keeps the splats at `indices`, in that order.
    pub(crate) fn gathered(mut self, indices: &[u32]) -> Self {
        let all = 0..indices.len().max(self.positions.len());
        if !indices.iter().map(|i| *i as usize).eq(all) {
            self.records.change(Change::Splats);
        }
        Self {
            positions: picked(&self.positions, 1, indices),
            scales: picked(&self.scales, 1, indices),
            rotations: picked(&self.rotations, 1, indices),
            opacities: picked(&self.opacities, 1, indices),
            harmonics: picked(&self.harmonics, self.harmonics_stride(), indices),
            ..self
        }
    }

    /// Rotates all splats about the origin: positions, rotations and harmonics.
    ///
    /// - `rotation`: of unit length. Rotations that map axes to axes are exact in positions, half turns in all
    ///   numbers.
    pub(crate) fn turn(&mut self, rotation: DQuat) {
        let matrix = rotation_matrix(rotation);
        if matrix == DMat3::IDENTITY {
            return;
        }
        self.records.change(Change::Places);
        let place = |position: &mut DVec3| *position = matrix * *position;
        self.positions.par_iter_mut().for_each(place);
        for quaternion in &mut self.rotations {
            let [w, x, y, z] = quaternion.map(f64::from);
            let q = rotation * DQuat::from_xyzw(x, y, z, w);
            *quaternion = [q.w, q.x, q.y, q.z].map(narrowed);
        }
        if self.harmonics_degree > 0 {
            let transform = HarmonicsTransform::new(matrix.transpose());
            let stride = self.harmonics_stride();
            let sets = self.harmonics.par_chunks_mut(stride);
            sets.for_each(|coefficients| transform.apply(coefficients));
        }
    }

    /// Converts colours in linear light to sRGB codes; view-dependent colours keep only their constant. Returns
    /// whether there were such.
    pub(crate) fn encode(&mut self) -> bool {
        if !self.is_linear {
            return false;
        }
        let depended = self.harmonics_degree > 0;
        if depended {
            let stride = self.harmonics_stride();
            let sets = self.harmonics.chunks_exact(stride);
            self.harmonics = sets.flat_map(|set| &set[..3]).copied().collect();
            self.harmonics_degree = 0;
        }
        self.recolour(srgb_from_linear);
        self.is_linear = false;
        depended
    }

    /// Replaces colours that do not depend on the view.
    fn recolour(&mut self, of: fn(f32) -> f32) {
        for c in &mut self.harmonics {
            *c = constant_of_colour(of(0.5 + HARMONIC_0 * *c));
        }
    }

    /// Applies the 3-D filter of Yu et al. 2024, *Mip-Splatting*, as its authors do. Standard deviations s
    /// become sqrt(s² + f²). Opacities are multiplied by the square root of the ratio of the determinants of
    /// the two variances. Flat splats keep their plane.
    ///
    /// - `filters`: f of each splat, world units.
    pub(crate) fn widen(&mut self, filters: &[f32]) {
        let is_flat = self.scales.iter().all(|s| s[2] == 0.0);
        let axes = if is_flat { 2 } else { 3 };
        let splats = self.scales.iter_mut().zip(&mut self.opacities);
        for ((scales, opacity), filter) in splats.zip(filters) {
            let filter = f64::from(*filter);
            let mut share = 1.0;
            for scale in &mut scales[..axes] {
                let before = f64::from(*scale);
                let after = before.hypot(filter);
                // An axis without width stays without.
                if after > 0.0 {
                    share *= before / after;
                }
                *scale = narrowed(after);
            }
            *opacity = narrowed(f64::from(*opacity) * share);
        }
    }

    fn raise_degree(&mut self, degree: u8) {
        let (from, to) = (self.harmonics_stride(), 3 * harmonics_count(degree));
        if from == to {
            return;
        }
        let mut raised = Vec::with_capacity(self.positions.len() * to);
        for set in self.harmonics.chunks_exact(from) {
            raised.extend(set);
            raised.resize(raised.len() + to - from, 0.0);
        }
        self.harmonics = raised;
        self.harmonics_degree = degree;
    }
}

/// 1 / (1 + exp(-x)): the opacity of a logit.
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The coefficients of the constant harmonic for a colour in linear light, as sRGB codes.
pub(crate) fn constants_of_light(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|c| constant_of_colour(srgb_from_linear(c.max(0.0))))
}

/// The coefficient of the constant harmonic for a colour, as a rule an sRGB code of 0 to 1.
pub(crate) fn constant_of_colour(code: f32) -> f32 {
    (code - 0.5) / HARMONIC_0
}
