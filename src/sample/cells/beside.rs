//! Chooses the kernels that take part in evening out, and evens them out.
//!
//! Volumes of the parts that are drawn change, and of the nodes' kernels beside them that are. Of all others those
//! count that reach one of these; their volumes stay.

use glam::DVec3;
use rayon::prelude::*;

use super::even::UnevenKernels;
use super::parts::PartKernel;
use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::math::principal_sigmas;
use crate::sample::kernels::sums::SUM_CUTOFF;
use crate::sample::points::neighbours::PointIndex;
use crate::sample::positions::index_u32;
use crate::task::Task;

/// The particles of a volume that are not split.
pub(super) struct WholeKernels<'a> {
    /// These particles, ascending.
    pub(super) particles: &'a [usize],
    pub(super) positions: &'a [DVec3],
    pub(super) factors: &'a [[f32; 6]],
    pub(super) volumes: &'a [f32],
    /// Number of particles that are no ghosts, and the particle of each ghost.
    pub(super) sample_count: usize,
    pub(super) ghosts: &'a [usize],
}

/// Volumes of kernels beside each other.
pub(super) struct EvenVolumes {
    /// Particles whose volumes change, and the factors.
    pub(super) particles: Vec<(usize, f64)>,
    /// Volume of each part.
    pub(super) parts: Vec<f64>,
    /// False if sums would take long, and nothing is evened out.
    pub(super) is_even: bool,
}

impl WholeKernels<'_> {
    /// Returns the particle that a particle mirrors, or itself.
    fn sample(&self, i: usize) -> usize {
        i.checked_sub(self.sample_count)
            .map_or(i, |ghost| self.ghosts[ghost])
    }

    fn reach(&self, i: usize) -> f64 {
        SUM_CUTOFF * principal_sigmas(self.factors[i].map(f64::from))[0]
    }

    /// Evens out these kernels and parts beside them.
    ///
    /// - `is_drawn`: true for each part that is drawn; `may_change`: returns true for particles that are drawn, and
    ///   beside which no kernel is missing.
    /// - `edges`: returns the planes that cut a particle.
    ///
    /// # Errors
    /// Work that was cancelled.
    pub(super) fn evened<'b>(
        &self,
        parts: &[PartKernel],
        is_drawn: &[bool],
        may_change: impl Fn(usize) -> bool + Sync,
        edges: impl Fn(usize) -> Option<&'b [[f32; 4]; MOST_EDGES]>,
        task: Option<&Task>,
    ) -> Result<EvenVolumes> {
        // The part that each mirrors; it changes if it is drawn or an image is.
        let mut own = 0;
        let mirrored: Vec<usize> = (0..parts.len())
            .map(|n| {
                own = if parts[n].is_image { own } else { n };
                own
            })
            .collect();
        let mut changes = vec![false; parts.len()];
        for (n, &own) in mirrored.iter().enumerate() {
            changes[own] |= is_drawn[n];
        }
        let changing = (0..parts.len()).filter(|&n| changes[n]);
        let mut places: Vec<DVec3> = changing.map(|n| parts[n].position).collect();
        let reach = |i: &usize| (self.positions[*i], self.reach(*i));
        let reaches: Vec<(DVec3, f64)> = self.particles.par_iter().map(reach).collect();
        let is_beside = near(&places, reaches.par_iter().copied());
        let beside = self.particles.iter().zip(is_beside);
        let beside = beside.filter(|&(&i, is)| is && i < self.sample_count && may_change(i));
        let beside: Vec<usize> = beside.map(|(&i, _)| i).collect();
        places.extend(beside.iter().map(|&i| self.positions[i]));
        let counts = near(&places, reaches.into_par_iter());
        let counts = self.particles.iter().zip(counts);
        let members: Vec<usize> = counts.filter_map(|(&i, is)| is.then_some(i)).collect();
        let of_part = |part: &PartKernel| {
            let reach = SUM_CUTOFF * principal_sigmas(part.factor)[0];
            (part.position, reach)
        };
        let part_counts = near(&places, parts.par_iter().map(of_part));

        let mut uneven = UnevenKernels::default();
        for &i in &members {
            let own = self.sample(i);
            let place = members.binary_search(&own);
            let is_fixed = place.is_err() || beside.binary_search(&own).is_err();
            let follows = index_u32(place.unwrap_or(uneven.positions.len()));
            let factor = self.factors[i].map(f64::from);
            let kernel = (self.positions[i], factor, f64::from(self.volumes[i]));
            uneven.push(kernel, edges(i), follows, is_fixed);
        }
        // Place of each part among the kernels.
        let mut place_of = vec![u32::MAX; parts.len()];
        for (n, part) in parts.iter().enumerate() {
            let own = mirrored[n];
            if !(part_counts[n] || changes[own]) {
                continue;
            }
            place_of[n] = index_u32(uneven.positions.len());
            let is_fixed = !changes[own] || part.is_partial || place_of[own] == u32::MAX;
            let follows = if is_fixed { place_of[n] } else { place_of[own] };
            let kernel = (part.position, part.factor, part.volume);
            uneven.push(kernel, part.edges.as_ref(), follows, is_fixed);
        }
        let is_even = uneven.even_out(task)?;
        let factors = members.iter().zip(&uneven.volumes);
        let factors = factors.map(|(&i, volume)| (i, volume / f64::from(self.volumes[i])));
        let of_parts = parts.iter().zip(&place_of);
        Ok(EvenVolumes {
            particles: factors.filter(|(_, factor)| *factor != 1.0).collect(),
            parts: of_parts
                .map(|(part, &place)| match place {
                    u32::MAX => part.volume,
                    place => uneven.volumes[place as usize],
                })
                .collect(),
            is_even,
        })
    }
}

/// Returns true for each centre that has any of some places within its reach.
fn near(places: &[DVec3], centres: impl IndexedParallelIterator<Item = (DVec3, f64)>) -> Vec<bool> {
    let Some(index) = PointIndex::new(places) else {
        return centres.map(|_| true).collect();
    };
    let is_near = |(centre, reach): (DVec3, f64)| index.last_within(centre, 0, reach).is_some();
    centres.map(is_near).collect()
}
