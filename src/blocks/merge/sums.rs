//! Clusters: runs of particles, and sums over them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

use super::levels::{MergedCluster, Particle};
use super::moments::{Moments, Tensors};
use super::source::{Member, Source};
use super::{MergeBounds, Places};
use crate::math::{eigen, lower_factor};
use crate::scene::ColourIn;

/// A run of particles that became one.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Cluster {
    /// Where it begins in block order.
    start: u64,
    /// Where it ends.
    end: u64,
    /// Of no strength where no member has any.
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

    /// Its particles: a run of block order.
    pub(in crate::blocks) fn run(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// Where values lie of which none has been looked at.
    pub(in crate::blocks) fn no_places(&self) -> Places {
        Places::new(self.sums.value, self.sums.spread())
    }

    /// Its sums, where any member has strength.
    pub(super) fn drawn(&self) -> Option<&Sums> {
        (self.sums.strength > 0.0).then_some(&self.sums)
    }
}

/// What a cluster knows of its members, enough to be one of a larger cluster's parts. Means are weighted by
/// strength.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub(in crate::blocks) struct Sums {
    /// Of all members together.
    pub(super) strength: f64,
    /// World units.
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
    /// Over particles. `None` where none has any strength.
    ///
    /// - `origin`: near them, so that their places keep their digits.
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

    /// Over clusters. `None` where none has any strength.
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

    /// Half the width of the interval over which the members' values, spread evenly, have the variance that they have.
    pub(super) fn spread(&self) -> f64 {
        (3.0 * (self.square - self.value * self.value).max(0.0)).sqrt()
    }

    /// The cluster as a particle, and what that leaves out but for how unevenly its values lie.
    ///
    /// - `origin`: of its block.
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
            // Members without a finite shape or colour are never merged: `max` would forget a NaN.
            bounds.third = f32::INFINITY;
        }
        MergedCluster {
            particle,
            bounds,
            widest: sigmas.max_element() as f32 * (1.0 + 2.0 * f32::EPSILON),
        }
    }
}

/// How much of their opacity the kernels of a cluster have each by itself: 1 where they lie far
/// apart, 0 where they overlap as those of a lattice do.
///
/// - `overlap`: the sum of the kernels' own volumes (4 pi)^(3/2) sigma³, the inverse of the integral
///   of the kernel's square.
/// - `sigmas`: of the cluster, whose volume is measured alike.
fn lone_share(overlap: f64, sigmas: DVec3) -> f64 {
    let room = (4.0 * std::f64::consts::PI).powf(1.5) * sigmas.element_product();
    if room > 0.0 {
        (-overlap / room).exp()
    } else {
        0.0
    }
}
