//! Changes and adds the particles of a sharp boundary, and evens out their volumes.

use glam::Vec3;
use rayon::prelude::*;

use super::Kernel;
use super::even::CutKernels;
use crate::constants::MOST_EDGES;
use crate::error::Result;
use crate::sample::field::local_models::matrix_of;
use crate::sample::options::SampleOptions;
use crate::sample::own::Own;
use crate::sample::positions::index_u32;
use crate::sample::report::SampleReport;
use crate::scene::{
    Boundary, BoundaryPlanes, LocalModel, LocalModels, Particles, PointVolume, Strength,
};

/// A particle that is changed or added at the boundary.
pub(in crate::sample) struct SharpParticle {
    /// The particle itself, or the particle nearest to a ghost; then the one mirrored behind that.
    pub(in crate::sample) sources: [usize; 2],
    pub(in crate::sample) is_ghost: bool,
    /// New kernel, if it changes.
    pub(in crate::sample) kernel: Option<Kernel>,
    /// Value of a ghost, if it is not extrapolated from its sources.
    pub(in crate::sample) value: Option<f64>,
    pub(in crate::sample) edges: Option<[[f32; 4]; MOST_EDGES]>,
}

/// Evens out the volumes of particles inside a sharp boundary.
///
/// - `sums`: returns the sums of all kernels at the samples; `None` if volumes stay as they are.
pub(in crate::sample) fn even_out(
    volume: &mut PointVolume,
    ghosts: &Ghosts,
    own: &mut Own<'_>,
    sums: impl FnOnce(&CutKernels<'_>, &[f32]) -> Result<Option<Vec<f64>>>,
) -> Result<()> {
    let (
        Particles::Anisotropic { positions, factors },
        Strength::Classified { volumes },
        Some(Boundary::Planes(boundary)),
    ) = (&volume.particles, &mut volume.strength, &volume.boundary)
    else {
        return Ok(());
    };
    let kernels = CutKernels {
        positions,
        factors,
        boundary,
        sources: &ghosts.sources,
    };
    let sums = sums(&kernels, volumes)?;
    let found = sums.iter().flat_map(|sums| &sums[own.range.clone()]);
    let is_uneven = found.into_iter().any(|sum| !sum.is_nan());
    if own.ranks.any(is_uneven)? {
        let sums = sums.unwrap_or_else(|| vec![f64::NAN; kernels.own_count()]);
        kernels.even_out(volumes, &sums, ghosts.inside, own)?;
    }
    Ok(())
}

/// Particles that a sharp boundary has added.
pub(in crate::sample) struct Ghosts {
    /// Sample of each ghost; ghosts are the last particles.
    pub(in crate::sample) sources: Vec<usize>,
    /// Total volume of the data.
    inside: f64,
}

/// Changes and adds the particles of a boundary, if the options allow a sharp one.
///
/// - `changes`: in pieces, which are freed one after the other.
pub(in crate::sample) fn apply(
    volume: &mut PointVolume,
    report: &mut SampleReport,
    changes: Vec<Vec<SharpParticle>>,
    options: &SampleOptions,
    own: &mut Own<'_>,
) -> Result<Option<Ghosts>> {
    let range = own.range.clone();
    let is_own = |change: &SharpParticle| range.contains(&change.sources[0]);
    let all = || changes.iter().flatten();
    let on_boundary = all().filter(|c| c.kernel.is_some() && !c.is_ghost && is_own(c));
    let is_cut = options.cuts(volume, on_boundary.map(|c| c.sources[0]));
    if !own.ranks.any(is_cut)? {
        return Ok(None);
    }
    let (Particles::Anisotropic { positions, factors }, Strength::Classified { volumes }) =
        (&mut volume.particles, &mut volume.strength)
    else {
        return Ok(None);
    };
    let inside = own.sum(volumes[range.clone()].iter().copied().map(f64::from))?;
    // The gradient stays, over another kernel. The departure due to the samples' centroids is dropped.
    let over = |models: &LocalModels, source: usize, factor: &[f32; 6]| {
        let model = models.get(source);
        let gradient = matrix_of(factors[source]).transpose().inverse() * model.slope.as_dvec3();
        let slope = (matrix_of(*factor).transpose() * gradient).as_vec3();
        LocalModel {
            slope: if slope.is_finite() { slope } else { Vec3::ZERO },
            departure: 0.0,
            ..model
        }
    };
    if let Some(models) = volume.local_models.take() {
        let changed: Vec<(Option<usize>, LocalModel)> = changes
            .par_iter()
            .flatten()
            .filter_map(|change| {
                let source = change.sources[0];
                let factor = &change.kernel?.factor;
                // Particles that are not wanted have no models.
                match (is_own(change), change.is_ghost) {
                    (false, false) => None,
                    (false, true) => Some((None, LocalModel::NONE)),
                    (true, is_ghost) => {
                        Some(((!is_ghost).then_some(source), over(&models, source, factor)))
                    }
                }
            })
            .collect();
        let greatest = &mut |scales| own.ranks.max(scales);
        volume.local_models = Some(models.changed(&changed, greatest)?);
    }
    let ghost_count = all().filter(|c| c.is_ghost).count();
    let cut_count = all().filter(|c| c.edges.is_some()).count();
    // Exact capacity: these are the volume's largest arrays.
    positions.reserve_exact(ghost_count);
    factors.reserve_exact(ghost_count);
    volumes.reserve_exact(ghost_count);
    let mut boundary = BoundaryPlanes {
        of_particle: Vec::with_capacity(positions.len() + ghost_count),
        edges: Vec::with_capacity(cut_count),
    };
    boundary.of_particle.resize(positions.len(), 0);
    let mut sources = Vec::with_capacity(ghost_count);
    for change in changes.into_iter().flatten() {
        let mut word = 0;
        if let Some(edges) = change.edges {
            boundary.edges.push(edges);
            word = index_u32(boundary.edges.len());
        }
        let [source, _] = change.sources;
        match change.kernel {
            Some(kernel) if change.is_ghost => {
                positions.push(kernel.position);
                factors.push(kernel.factor);
                volumes.push(kernel.volume);
                boundary.of_particle.push(word);
                sources.push((change.sources, change.value));
                continue;
            }
            Some(kernel) => {
                positions[source] = kernel.position;
                factors[source] = kernel.factor;
                volumes[source] = kernel.volume;
            }
            None => {}
        }
        boundary.of_particle[source] = word;
    }
    if let Some(values) = &mut volume.values {
        values.extrapolate(&sources);
    }
    if let Some(normals) = &mut volume.normals {
        for ([nearest, _], _) in &sources {
            normals.push(normals[*nearest]);
        }
    }
    report.particle_count = positions.len();
    report.ghost_count = ghost_count;
    volume.boundary = Some(Boundary::Planes(boundary));
    Ok(Some(Ghosts {
        sources: sources.iter().map(|([nearest, _], _)| *nearest).collect(),
        inside,
    }))
}
