//! Opaque surfels along one ray.
//!
//! A surfel is met where the ray meets its plane, with the weight area G(x), x the place in its
//! plane and G the Gaussian of its variance there, of unit integral: surfels that tile a surface
//! have weights that sum to about 1. Fragments that lie together are one surface: its colour and
//! depth are their weighted means (Shepard's), and it covers of the ray the sum of their weights, as
//! far as surfaces in front of it leave room. So all surfaces together cover min(1, sum of weights),
//! whatever counts as one surface; that decides only whose colour is seen, and where among volumes.
//!
//! Which fragments are one surface is a convention, and not the renderer's: along the ray they are
//! sorted, and each belongs to the surface of the one before it while the gap between the two, across
//! either plane, is no wider than the surfel is, one standard deviation along its longer axis.

/// A surfel where a ray meets it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fragment {
    /// Arc length along the ray.
    pub(super) depth: f64,
    /// area G(x).
    pub(super) weight: f64,
    /// To which gap along the ray it counts as one surface with the next.
    pub(super) reach: f64,
    pub(super) colour: [f64; 3],
}

/// A surface where a ray meets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    /// Arc length along the ray: its fragments' weighted mean.
    pub(super) depth: f64,
    /// What it covers of the ray.
    pub(super) share: f64,
    pub(super) colour: [f64; 3],
}

/// The surfaces of a ray, front to back, as far as they leave any of it; sorts `fragments`.
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
        // In any order: two that lie together, one behind them, one that is not seen.
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
        // The sum's rounding.
        assert!(
            (shares[0] - 0.4).abs() < 1e-15 && shares[1] == 0.5,
            "{shares:?}"
        );
        assert!((shares[2] - rest).abs() < 1e-15 && found.len() == 3);
        assert!((found[0].depth - (0.3 * 1.05 + 0.1) / 0.4).abs() < 1e-15);
        assert!((found[0].colour[0] - (0.3 * 2.0 + 0.1) / 0.4).abs() < 1e-15);
        // A wide surfel does not draw a small one in front of it into its surface.
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
