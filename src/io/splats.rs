//! Splats as radiance fields store them: what their formats share. `splat_axes.rs` has the axes of each.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::dataset::{Dataset, Field, Geometry};
use super::scalars::narrow;
use crate::error::{Advice, Error, Result};
use crate::math::{
    HARMONIC_0, HarmonicsTransform, MAX_HARMONICS_DEGREE, harmonics_count, rotation_matrix,
};

/// Anisotropic Gaussians with a peak opacity and a colour each. Their opacity on the image is
/// peak x exp(-Q/2), the same from every side: not the optical depth of a volume.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SplatCloud {
    /// Centres.
    pub positions: Vec<DVec3>,
    /// Standard deviations along the kernel's own axes, world units; the third is 0 where the
    /// file holds flat splats.
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
    /// They are what the harmonics are multiplied by, the constant one of .28209479 included:
    /// with the basis Y of [`harmonics`](crate::math::harmonics) a colour is
    /// 1/2 + sum c_k Y_k(d), d the unit direction from the eye to the splat; an sRGB-encoded
    /// value, 0 where the sum is negative.
    pub harmonics: Vec<f32>,
    /// Whether the file says that it was made for a low-pass filter that keeps a splat's
    /// opacity times its area.
    pub is_anti_aliased: bool,
}

impl SplatCloud {
    /// Numbers of colour per splat: three for each of (degree + 1)² coefficients.
    pub fn harmonics_stride(&self) -> usize {
        3 * harmonics_count(self.harmonics_degree)
    }

    /// Checks that every array has one entry per splat.
    ///
    /// # Errors
    /// The first of another length, or harmonics of a degree above
    /// [`MAX_HARMONICS_DEGREE`].
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

    /// Adds the splats of another cloud behind these; coefficients that one of the two does not have
    /// are 0. The mark of anti-aliased splats stays as it was, unless there were none yet.
    pub fn append(&mut self, mut other: Self) {
        if self.positions.is_empty() {
            *self = other;
            return;
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

    /// Turns all splats about the origin: positions, rotations and harmonics.
    ///
    /// - `rotation`: of unit length. Turns that take axes to axes are exact in positions, half turns in all numbers.
    pub(crate) fn turn(&mut self, rotation: DQuat) {
        let matrix = rotation_matrix(rotation);
        if matrix == DMat3::IDENTITY {
            return;
        }
        let place = |position: &mut DVec3| *position = matrix * *position;
        self.positions.par_iter_mut().for_each(place);
        for quaternion in &mut self.rotations {
            let [w, x, y, z] = quaternion.map(f64::from);
            let q = rotation * DQuat::from_xyzw(x, y, z, w);
            *quaternion = [q.w, q.x, q.y, q.z].map(narrow);
        }
        if self.harmonics_degree > 0 {
            let transform = HarmonicsTransform::new(matrix.transpose());
            let stride = self.harmonics_stride();
            let sets = self.harmonics.par_chunks_mut(stride);
            sets.for_each(|coefficients| transform.apply(coefficients));
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

impl SplatCloud {
    /// A data set of these splats.
    ///
    /// # Errors
    /// There is not a single splat.
    pub(crate) fn dataset(
        self,
        path: &Path,
        format: &'static str,
        fields: Vec<Field>,
    ) -> Result<Dataset> {
        if self.positions.is_empty() {
            return Err(Error::format(
                path,
                "splats",
                "at least one",
                "none",
                Advice::no_data("check that the file was written completely"),
            ));
        }
        Ok(Dataset::new(path, format, Geometry::Splats(self), fields))
    }
}

/// 1 / (1 + exp(-x)): the opacity of a logit.
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The coefficient of the constant harmonic that makes a colour, an sRGB code of 0 to 1.
pub(crate) fn constant_of_colour(code: f32) -> f32 {
    (code - 0.5) / HARMONIC_0
}
