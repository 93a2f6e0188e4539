//! Groups opaque surfels along one ray into surfaces.
//!
//! A surfel is met where the ray meets its plane. Its weight is area G(x), with x the place in its plane and G
//! the Gaussian of its variance there, of unit integral. Surfels that tile a surface have weights that sum to
//! about 1. Fragments that lie together form one surface. Its colour and depth are their weighted means
//! (Shepard's), and it covers the sum of their weights, as far as surfaces in front leave room. All surfaces
//! together thus cover min(1, sum of weights), however they are grouped. The grouping only decides whose colour
//! is seen, and where among volumes.
//!
//! The grouping is a convention, and not the renderer's. Fragments are sorted along the ray. Each belongs to
//! the surface of the one before it if the gap between the two, across either plane, is no wider than the
//! surfel: one standard deviation along its longer axis.

/// Intersection of a ray with a surfel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fragment {
    /// Arc length along the ray.
    pub(super) depth: f64,
    /// area G(x).
    pub(super) weight: f64,
    /// Greatest gap along the ray to the next fragment of the same surface.
    pub(super) reach: f64,
    pub(super) colour: [f64; 3],
}

/// Intersection of a ray with a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    /// Arc length along the ray: the weighted mean of its fragments.
    pub(super) depth: f64,
    /// Share of the ray that it covers.
    pub(super) share: f64,
    pub(super) colour: [f64; 3],
}

/// Finds the surfaces of a ray, front to back, until they cover all of it; sorts `fragments`.
pub(super) fn surfaces(fragments: &mut [Fragment], surfaces: &mut Vec<Surface>) {
    surfaces.clear();
    fragments.sort_unstable_by(|a, b| a.depth.total_cmp(&b.depth));
    let mut room = 1.0_f64;
    let is_one = |a: &Fragment, b: &Fragment| b.depth - a.depth <= a.reach.min(b.reach);
    for of_surface in fragments.chunk_by(is_one) {
        let weight: f64 = of_surface.iter().map(|f| f.weight).sum();
        let mean = |of: &dyn Fn(&Fragment) -> f64| {
            let sum: f64 = of_surface.iter().map(|f| f.weight * of(f)).sum();
            sum / weight
        };
        let share = weight.min(room);
        surfaces.push(Surface {
            depth: mean(&|f| f.depth),
            share,
            colour: [0, 1, 2].map(|c| mean(&|f| f.colour[c])),
        });
        room -= share;
        if room <= 0.0 {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fragments_join_while_gaps_are_small_and_cover_front_to_back() {
        let at = |depth, weight, red| Fragment {
            depth,
            weight,
            reach: 0.1,
            colour: [red, 0.0, 0.0],
        };
        // In any order: two that lie together, one behind them, one that is hidden.
        let mut fragments = [
            at(5.0, 9.0, 9.0),
            at(2.0, 0.5, 4.0),
            at(1.05, 0.3, 2.0),
            at(1.0, 0.1, 1.0),
        ];
        let mut found = Vec::new();
        surfaces(&mut fragments, &mut found);
        let shares: Vec<f64> = found.iter().map(|s| s.share).collect();
        let rest = 1.0 - (0.3 + 0.1) - 0.5;
        // Rounding of the sum.
        assert!(
            (shares[0] - 0.4).abs() < 1e-15 && shares[1] == 0.5,
            "{shares:?}"
        );
        assert!((shares[2] - rest).abs() < 1e-15 && found.len() == 3);
        assert!((found[0].depth - (0.3 * 1.05 + 0.1) / 0.4).abs() < 1e-15);
        assert!((found[0].colour[0] - (0.3 * 2.0 + 0.1) / 0.4).abs() < 1e-15);
        // A wide surfel does not merge with a small one in front of it.
        let mut fragments = [
            Fragment {
                reach: 10.0,
                ..at(2.0, 0.2, 1.0)
            },
            at(1.0, 0.2, 1.0),
        ];
        surfaces(&mut fragments, &mut found);
        assert_eq!(found.len(), 2);
        surfaces(&mut [], &mut found);
        assert_eq!(found, []);
    }
}
