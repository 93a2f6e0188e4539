//! Defines clusters: runs of particles, and sums over them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

use super::levels::{MergedCluster, Particle};
use super::moments::{Moments, Tensors};
use crate::blocks::merge::places::Places;
use crate::blocks::merged::MergeBounds;
use crate::blocks::source::{Member, Source};
use crate::math::{eigen, lower_factor};
use crate::scene::ColourIn;

/// A run of particles that are merged into one.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Cluster {
    /// Beginning in block order.
    start: u64,
    /// End in block order.
    end: u64,
    /// Sums over the members; their strength is 0 if no member has any.
    pub(in crate::blocks) sums: Sums,
}

impl Cluster {
    pub(super) fn new(run: Range<usize>, sums: Option<Sums>) -> Self {
        Self {
            start: run.start as u64,
            end: run.end as u64,
            sums: sums.unwrap_or_default(),
        }
    }

    /// Particles of the cluster: a run of block order.
    pub(in crate::blocks) fn run(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Returns an empty distribution about the cluster's mean value.
    pub(in crate::blocks) fn no_places(&self) -> Places {
        Places::new(self.sums.value, self.sums.spread())
    }

    /// Returns the sums if any member has strength.
    pub(super) fn drawn(&self) -> Option<&Sums> {
        (self.sums.strength > 0.0).then_some(&self.sums)
    }
}

/// Sums over a cluster's members, from which those of a larger cluster can be made. Means are weighted by strength.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Sums {
    /// Strength of all members together.
    pub(super) strength: f64,
    /// Centre, world units.
    pub(super) centre: DVec3,
    pub(super) moments: Tensors,
    /// Means of values, of their squares, of colours and of their squared lengths.
    pub(super) value: f64,
    pub(super) square: f64,
    pub(super) colour: DVec3,
    pub(super) colour_square: f64,
    /// Sum of strength² over the least area of the kernel.
    pub(super) depth: f64,
    /// Sum of the kernels' own volumes.
    pub(super) overlap: f64,
}

impl Sums {
    /// Sums over particles. Returns `None` if none has any strength.
    ///
    /// - `origin`: a point near them, so that relative positions keep their digits.
    pub(super) fn of_members(
        source: &Source<'_>,
        origin: DVec3,
        members: Range<usize>,
    ) -> Option<Self> {
        let visible: Vec<Member> = members.filter_map(|i| source.member(i, origin)).collect();
        let strength: f64 = visible.iter().map(|m| m.strength).sum();
        if !(strength > 0.0 && strength.is_finite()) {
            return None;
        }
        let share = |m: &Member| m.strength / strength;
        let centre: DVec3 = visible.iter().map(|m| m.offset * share(m)).sum();
        let mut sums = Self {
            strength,
            centre: origin + centre,
            ..Self::default()
        };
        let mut moments = Moments::default();
        for m in &visible {
            let (i, w) = (m.index, share(m));
            moments.add(w, m.offset - centre, &m.variance);
            for skew in &m.skews {
                moments.add_skew(w, *skew);
            }
            if let Some(values) = source.values {
                let v = f64::from(values.get(i));
                sums.value += w * v;
                sums.square += w * v * v;
            }
            if let ColourIn::PerParticle(colours) = source.colour {
                let c = DVec3::from(colours[i].map(f64::from));
                sums.colour += c * w;
                sums.colour_square += w * c.length_squared();
            }
            let [least, greatest] = source.sigmas(i).map(f64::from);
            sums.depth += m.strength.powi(2) / (std::f64::consts::TAU * least * greatest);
            sums.overlap += (4.0 * std::f64::consts::PI).powf(1.5) * least * greatest * greatest;
        }
        sums.moments = moments.tensors();
        Some(sums)
    }

    /// Sums over clusters. Returns `None` if none has any strength.
    pub(super) fn of_parts(parts: &[Cluster]) -> Option<Self> {
        let parts = || parts.iter().filter_map(Cluster::drawn);
        let strength: f64 = parts().map(|part| part.strength).sum();
        let near = parts().next()?.centre;
        let shares = || parts().map(|part| (part.strength / strength, part));
        let centre: DVec3 = shares().map(|(w, part)| (part.centre - near) * w).sum();
        let mut sums = Self {
            strength,
            centre: near + centre,
            ..Self::default()
        };
        for (w, part) in shares() {
            sums.moments
                .add(w, part.centre - near - centre, &part.moments);
            sums.value += w * part.value;
            sums.square += w * part.square;
            sums.colour += part.colour * w;
            sums.colour_square += w * part.colour_square;
            sums.depth += part.depth;
            sums.overlap += part.overlap;
        }
        Some(sums)
    }

    /// Returns half the width of the interval over which evenly spread values have the members' variance.
    pub(super) fn spread(&self) -> f64 {
        (3.0 * (self.square - self.value * self.value).max(0.0)).sqrt()
    }

    /// Returns the cluster as a particle with bounds on its error, except for the unevenness of its values.
    ///
    /// - `origin`: origin of its block.
    /// - `narrowest`: the least standard deviation in the block.
    pub(super) fn merged(&self, origin: DVec3, narrowest: f32) -> MergedCluster {
        let common = f64::from(narrowest).powi(2);
        let variance = self.moments.second;
        let (eigenvalues, axes) = eigen(variance);
        let sigmas = eigenvalues.max(DVec3::ZERO).map(f64::sqrt);
        let factor = lower_factor(axes * DMat3::from_diagonal(sigmas));
        let trace = variance[0] + variance[3] + variance[5];
        let member_depth = self.depth / self.strength.powi(2);
        let particle = Particle {
            centre: self.centre - origin,
            factor: factor.map(|l| l as f32),
            strength: self.strength as f32,
            colour: self.colour.as_vec3().into(),
            value: self.value as f32,
            spread: self.spread() as f32,
            member_depth: (member_depth * lone_share(self.overlap, sigmas)) as f32,
        };
        let colour_variance = self.colour_square - self.colour.length_squared();
        let mut bounds = MergeBounds {
            third_mean: 0.0,
            third: self.moments.third_norm().cbrt() as f32,
            fourth: self.moments.fourth_cumulant_norm().sqrt().sqrt() as f32,
            second: (trace - 3.0 * common).max(0.0).sqrt() as f32,
            spread: particle.spread,
            colour: colour_variance.max(0.0).sqrt() as f32,
            uneven: 0.0,
        };
        if !(trace + colour_variance + f64::from(bounds.third + bounds.fourth)).is_finite() {
            // Members without a finite shape or colour are never merged. The bound must be infinite, because `max`
            // would drop a NaN.
            bounds.third = f32::INFINITY;
        }
        MergedCluster {
            particle,
            bounds,
            widest: sigmas.max_element() as f32 * (1.0 + 2.0 * f32::EPSILON),
        }
    }
}

/// Returns the share of opacity that the kernels of a cluster have separately: 1 if they lie far apart, 0 if they
/// overlap as those of a lattice do.
///
/// - `overlap`: the sum of the kernels' own volumes (4 pi)^(3/2) sigma³, the inverse of the integral of the kernel's
///   square.
/// - `sigmas`: standard deviations of the cluster, whose volume is measured alike.
fn lone_share(overlap: f64, sigmas: DVec3) -> f64 {
    let room = (4.0 * std::f64::consts::PI).powf(1.5) * sigmas.element_product();
    if room > 0.0 {
        (-overlap / room).exp()
    } else {
        0.0
    }
}
