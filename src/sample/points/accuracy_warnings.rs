//! Warns of errors that pictures of particles will have, judged by positions and sizes.

use glam::DVec3;
use rayon::prelude::*;

use super::neighbours::PointIndex;
use crate::math::principal_sigmas;
use crate::scene::Particles;

/// Number of particles that are checked for crowding.
const SAMPLE: usize = 2000;

/// Number of other centres within one standard deviation of a kernel (geometric mean of its axes) from which
/// the kernel is crowded. Even particles have none, smoothed ones three or four. In larger crowds the order of
/// the centres hardly tells what lies in front.
const CROWD: usize = 32;

/// Share of the particles that may be crowded without a warning.
const MOST_CROWDED: f64 = 0.05;

/// A kernel is large if its longest standard deviation exceeds this share of the diagonal of the box of all
/// centres: it then covers a good part of the data.
const LARGE: f64 = 0.1;

/// Returns one sentence for each error that pictures of these particles will have. It looks for kernels that
/// are crowded beyond what sorting by centres can handle, and for kernels as large as the data.
///
/// Lattices and surfels have neither.
pub fn accuracy_warnings(particles: &Particles) -> Vec<String> {
    let sigmas: Vec<[f64; 3]> = match particles {
        Particles::Isotropic { sigmas, .. } => sigmas.iter().map(|&s| [f64::from(s); 3]).collect(),
        Particles::Anisotropic { factors, .. } => factors
            .par_iter()
            .map(|f| principal_sigmas(f.map(f64::from)))
            .collect(),
        Particles::Lattice { .. } | Particles::Surfels { .. } => return Vec::new(),
    };
    let positions = particles.positions();
    [crowded(positions, &sigmas), large(positions, &sigmas)]
        .into_iter()
        .flatten()
        .collect()
}

fn crowded(positions: &[DVec3], sigmas: &[[f64; 3]]) -> Option<String> {
    let index = PointIndex::new(positions)?;
    let count = index.len().min(SAMPLE);
    let is_crowded = |k: usize| {
        let (i, group) = index.in_order(k * index.len() / count);
        let [a, b, c] = sigmas[i as usize];
        let radius = (a * b * c).cbrt();
        let farthest = index.search().of(group, CROWD).last();
        farthest.is_some_and(|(_, squared)| squared < radius * radius)
    };
    // With fewer groups no particle has that many neighbours.
    if index.group_count() <= CROWD {
        return None;
    }
    let found = (0..count)
        .into_par_iter()
        .filter(|k| is_crowded(*k))
        .count();
    let share = found as f64 / count as f64;
    (share > MOST_CROWDED).then(|| {
        format!(
            "{:.0} % of the kernels have {CROWD} others or more within one standard deviation: drawn in the order of \
             their centres the nearer of them hide the others; smaller kernels, or slabs, do not",
            100.0 * share
        )
    })
}

fn large(positions: &[DVec3], sigmas: &[[f64; 3]]) -> Option<String> {
    let finite = positions.iter().filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
        (low.min(*p), high.max(*p))
    });
    let size = (high - low).length();
    let found = sigmas.iter().filter(|s| s[0] > LARGE * size).count();
    // A handful of kernels may well be as large as the box of their centres.
    let is_doubtful = found > 0 && positions.len() > CROWD && size > 0.0;
    is_doubtful.then(|| {
        let kernels = if found == 1 { "kernel has" } else { "kernels have" };
        format!(
            "{found} {kernels} a standard deviation above a tenth of the data's size: each covers a good part of \
             the picture and is sorted by one depth"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(n: u8, sigma: f32) -> Particles {
        let line = || (0..n).map(f64::from);
        let positions: Vec<DVec3> = line()
            .flat_map(|x| line().flat_map(move |y| line().map(move |z| DVec3::new(x, y, z))))
            .collect();
        let sigmas = vec![sigma; positions.len()];
        Particles::Isotropic { positions, sigmas }
    }

    #[test]
    fn even_kernels_raise_no_doubt_and_crowded_or_large_ones_do() {
        assert_eq!(accuracy_warnings(&cube(12, 0.6)), Vec::<String>::new());
        // Around the middle of a cubic lattice 26 others lie within 1.9 spacings, and 56 within 2.3.
        assert_eq!(accuracy_warnings(&cube(20, 1.9)), Vec::<String>::new());
        let found = accuracy_warnings(&cube(20, 2.3));
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains("32 others or more"), "{found:?}");
        let mut one = cube(12, 0.6);
        if let Particles::Isotropic { sigmas, .. } = &mut one {
            sigmas[5] = 4.0;
        }
        let found = accuracy_warnings(&one);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with("1 kernel has"), "{found:?}");
        // A single kernel has nothing to be compared with.
        assert_eq!(accuracy_warnings(&cube(1, 3.0)), Vec::<String>::new());
    }
}
