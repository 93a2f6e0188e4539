//! Chooses how far the bodies of a mesh are refined.
//!
//! **Values at nodes**: the linear model of a node is its value and its mean gradient, by volume, of the pieces of its
//! cells. It misses most of the interpolant at the corners of these pieces: the middles of edges, faces and cells. The
//! level follows from that by [`Rule`], as on grids. Where the surface bends away from its tangent planes, that asks
//! for parts, too.
//!
//! **Values of cells** jump at faces, and a kernel blurs a jump over its own deviation: that has to be less than the
//! threshold, unless the function hardly changes from one side to the other.
//!
//! Bodies side by side then differ by one level at most.

use glam::{DVec3, DVec4, Vec4Swizzles as _};

use super::bodies::Bodies;
use super::pieces::Piece;
use super::sharp::{DrawnCells, SAME_PLANE, Surface};
use crate::sample::refine::rule::{Rule, least_level};

/// Greatest level of a dual cell: its pieces fall into 4³ parts.
const MOST_LEVEL: u8 = 3;

/// Greatest level that nodes of tetrahedra ask for. Fields are linear in tetrahedra, and their pieces are a third as
/// wide as dual cells already. On a reactor cut into 44,832 of them further levels took three times as long to read,
/// for an error of 2.2 levels of 255 at best and 3.2 at worst; this one leaves 2.3 of 3.6.
const MOST_LEVEL_OF_TETRAHEDRA: u8 = 1;

/// Greatest level of cells with one value. On a warped grid of 24³ cells a third one leaves 1.4 levels of 255 instead of
/// 2.5, for seven times the kernels.
const MOST_LEVEL_OF_CELLS: u8 = 2;

/// Share of a level's error that is left at the next one.
const PER_LEVEL: f64 = 3.0;

/// Factor by which less may be missed than on grids, whose indices are split one by one: on a reactor of 8,499 nodes
/// (`disk_out_ref`) 28,711 particles and an error of 1.74 levels of 255 for 23,065 and 2.01.
const STRICTNESS: f64 = 1.4;

/// A body that a kernel stands for: a node's dual cell, or a cell.
pub(super) struct Body {
    /// Position to which places are relative.
    pub(super) origin: DVec3,
    /// The sample's value.
    pub(super) value: f64,
    /// Least and greatest value within.
    pub(super) range: [f64; 2],
    /// Distance of the farthest corner of its cells.
    pub(super) radius: f64,
    pub(super) has_tetrahedra: bool,
    /// The pieces of each of its cells, with the range of values in the cell.
    pub(super) cells: Vec<(Vec<Piece>, [f64; 2])>,
}

/// No values.
pub(super) const NONE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

pub(super) fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Body {
    fn pieces(&self) -> impl Iterator<Item = &Piece> {
        self.cells.iter().flat_map(|(pieces, _)| pieces)
    }

    /// Returns the mean gradient of the pieces, by volume; `None` if they have none.
    fn gradient(&self) -> Option<DVec3> {
        let (mut sum, mut volume) = (DVec3::ZERO, 0.0);
        for piece in self.pieces() {
            let own = piece.volume();
            if let Some(gradient) = piece.gradient([0.5; 3]).filter(|_| own > 0.0) {
                sum += gradient * own;
                volume += own;
            }
        }
        (volume > 0.0).then(|| sum / volume)
    }

    /// Returns the level that a rule asks for in a dual cell.
    ///
    /// - `px`: pixels per world unit; `sigma`: deviation of the kernel at level 0.
    /// - `bend`: greatest second difference of the surface here \[world units\].
    pub(super) fn level(&self, rule: &Rule, px: f64, sigma: f64, bend: f64) -> u8 {
        let (Some(width), Some(gradient)) = (rule.finest(self.range), self.gradient()) else {
            return 0;
        };
        let missed = |v: &DVec4| (v.w - self.value - gradient.dot(v.xyz())).abs();
        let vertices = self.pieces().flat_map(Piece::vertices);
        let missed = vertices.map(missed).fold(0.0, f64::max);
        let excess = STRICTNESS * rule.excess(missed, width, gradient.length(), px);
        let level = least_level(excess, PER_LEVEL).max(rule.bend_level(bend, px));
        let most = match self.has_tetrahedra {
            true => MOST_LEVEL_OF_TETRAHEDRA,
            false => MOST_LEVEL,
        };
        level.min(Rule::most_level(sigma, px)).min(most)
    }

    /// Returns the level that a rule asks for in a cell with one value.
    ///
    /// - `around`: least and greatest value of the cell and those that share a node with it.
    /// - `px`, `sigma`: as for [`Self::level`].
    pub(super) fn level_of_constant(
        &self,
        rule: &Rule,
        around: [f64; 2],
        px: f64,
        sigma: f64,
    ) -> u8 {
        let jump = (around[1] - self.value).max(self.value - around[0]);
        // The kernel of a cell that is not shown reaches shown values; its parts do not.
        let most = match rule.shows(self.range) {
            true => MOST_LEVEL_OF_CELLS,
            false => 1,
        };
        rule.jump_level(around, jump, px, sigma).min(most)
    }
}

/// Returns the greatest second difference of the surface at a node across its tangent planes \[world units\].
pub(super) fn bend(cells: &DrawnCells<'_>, surface: &Surface, node: u32) -> f64 {
    let at = |n: u32| cells.mesh.nodes[n as usize];
    let origin = at(node);
    let faces = || {
        surface
            .faces_at(node)
            .unwrap_or(&[])
            .iter()
            .map(|&face| surface.face(face))
    };
    let mut most = 0.0_f64;
    for own in faces() {
        let alike = |normal: DVec3| {
            normal
                .normalize_or_zero()
                .dot(own.normal.normalize_or_zero())
                > SAME_PLANE
        };
        let mean: DVec3 = faces().map(|face| face.normal).filter(|n| alike(*n)).sum();
        let normal = mean.normalize_or_zero();
        for &corner in &own.nodes {
            // As far to the other side, the surface is as high again.
            most = most.max(2.0 * normal.dot(at(corner) - origin).abs());
        }
    }
    most
}

/// Raises levels until bodies side by side differ by one at most.
///
/// - `bodies`: levels are of these.
/// - `may_split`: false for bodies that cannot be split.
pub(super) fn grade(bodies: &impl Bodies, levels: &mut [u8], may_split: &[bool]) {
    loop {
        let mut has_changed = false;
        bodies.each_group(&mut |group| {
            let most = group.iter().map(|&n| levels[n as usize]).max();
            let least = most.unwrap_or(0).saturating_sub(1);
            for &n in group.iter().filter(|&&n| may_split[n as usize]) {
                if levels[n as usize] < least {
                    levels[n as usize] = least;
                    has_changed = true;
                }
            }
        });
        if !has_changed {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::blanking::Blanking;
    use crate::data::cells::CellMesh;
    use crate::data::handedness::Handedness;
    use crate::sample::cells::bodies::{CellBodies, DualCells};
    use crate::sample::cells::duals::{Duals, turned};
    use crate::sample::cells::incidence::CellsAround;
    use crate::sample::cells::sharp::NodeParticles;
    use crate::sample::positions::index_u32;
    use crate::sample::refine::rule::ShownValues;
    use crate::sample::report::SampleReport;
    use crate::scene::TransferFunction;

    /// Calls a function with a block of cubes of side 1 from the origin on, which has one node more along each axis, and
    /// the cells around its nodes.
    fn with_block(counts: [usize; 3], of: impl FnOnce(&DrawnCells<'_>, &CellsAround)) {
        let [x, y, z] = counts.map(|n| n + 1);
        let place = |n: usize| DVec3::from([n % x, n / x % y, n / (x * y)].map(|i| i as f64));
        let nodes: Vec<DVec3> = (0..x * y * z).map(place).collect();
        let mut cells = Vec::new();
        for (k, j, i) in (0..counts[2])
            .flat_map(|k| (0..counts[1]).flat_map(move |j| (0..counts[0]).map(move |i| (k, j, i))))
        {
            let corner =
                |c: usize| (i + (c & 1) + x * (j + (c >> 1 & 1) + y * (k + (c >> 2)))) as i64;
            cells.push(8);
            cells.extend((0..8).map(corner));
        }
        let mesh = CellMesh::of_lists(nodes, &vec![11; counts.iter().product()], &cells).unwrap();
        let turned = turned(&mesh);
        let handedness = std::array::from_fn(|kind| Handedness::of(turned[kind]));
        let all = 0..mesh.cell_count();
        let mut report = SampleReport::default();
        let duals =
            Duals::new(&mesh, &Blanking::NONE, handedness, &all, &mut report, None).unwrap();
        let cells = DrawnCells {
            mesh: &mesh,
            duals: &duals,
            blanking: &Blanking::NONE,
        };
        of(&cells, &CellsAround::new(&mesh, &duals.first));
    }

    /// Calls a function with the dual cells of such a block, whose nodes have given values.
    fn with_nodes(counts: [usize; 3], values: &[f64], of: impl FnOnce(&DualCells<'_>)) {
        with_block(counts, |cells, around| {
            let kept: Vec<u32> = (0..values.len()).map(index_u32).collect();
            let particles = &NodeParticles::new(cells.duals, &kept);
            of(&DualCells {
                cells,
                around,
                particles,
                values,
            });
        });
    }

    fn hat(width: f32) -> Rule {
        let opacity = move |v: f32| (1.0 - (v - 0.5).abs() / width).max(0.0) * 0.5;
        let function =
            TransferFunction::from_curves(|_| [1.0; 3], opacity, [-1.0, 1.0], 1.0).unwrap();
        Rule::new(&ShownValues::of_function(&function), 1.0, 0.6)
    }

    #[test]
    fn nodes_of_a_cell_differ_by_one_level_at_most() {
        with_nodes([6, 1, 1], &[0.0; 28], |nodes| {
            let mut levels = vec![0; 28];
            levels[0] = 3;
            let mut may_split = vec![true; 28];
            may_split[8] = false;
            grade(nodes, &mut levels, &may_split);
            let row: Vec<u8> = levels[..7].to_vec();
            assert_eq!(row, [3, 2, 1, 0, 0, 0, 0]);
            assert_eq!((levels[7], levels[8], levels[9]), (2, 0, 1));
        });
    }

    #[test]
    fn cells_side_by_side_differ_by_one_level_at_most() {
        with_block([4, 2, 1], |cells, around| {
            let kept: Vec<u32> = (0..8).collect();
            let bodies = CellBodies {
                cells,
                around,
                kept: &kept,
                values: &[0.0; 8],
            };
            let mut levels = [3, 0, 0, 0, 0, 0, 0, 0];
            grade(&bodies, &mut levels, &[true; 8]);
            assert_eq!(levels, [3, 2, 1, 0, 2, 2, 1, 0]);
        });
    }

    #[test]
    fn nodes_are_split_where_the_field_bends_the_function_shows_and_a_pixel_sees_it() {
        let level = |width: f32, field: &dyn Fn(DVec3) -> f64, px: f64| {
            let place = |n: usize| DVec3::from([n % 3, n / 3 % 3, n / 9].map(|i| i as f64));
            let values: Vec<f64> = (0..27).map(|n| field(place(n) - 1.0)).collect();
            let mut found = 0;
            with_nodes([2; 3], &values, |nodes| {
                found = nodes.level(13, &hat(width), |_| px, 0.6, None).unwrap();
            });
            found
        };
        let kink = |s: DVec3| 0.5 + if s.x > 0.0 { s.x } else { 0.2 * s.x };
        assert!(level(0.05, &kink, 100.0) > 1);
        assert_eq!(level(0.05, &|s| 0.5 + s.x, 100.0), 0);
        assert_eq!(level(0.05, &|s| kink(s) - 2.0, 100.0), 0);
        // A wide feature does not show a small kink.
        assert_eq!(level(0.5, &|s| 0.5 + 0.02 * kink(s), 1e4), 0);
        // Half a pixel limits it: 1.8 px fall to .9.
        assert_eq!(level(0.05, &kink, 3.0), 1);
        assert_eq!(level(0.05, &kink, 1.0), 0);
    }

    #[test]
    fn cells_are_split_where_values_jump_the_function_shows_and_a_pixel_sees_it() {
        let level = |[own, beside]: [f64; 2], width: f32, px: f64| {
            let mut found = 0;
            with_block([2, 1, 1], |cells, around| {
                let bodies = CellBodies {
                    cells,
                    around,
                    kept: &[0, 1],
                    values: &[own, beside],
                };
                found = bodies.level(0, &hat(width), |_| px, 0.6, None).unwrap();
            });
            found
        };
        // A blur of 6 pixels asks for all levels, one of 1.2 for one.
        assert_eq!(level([0.5, 0.8], 0.1, 10.0), MOST_LEVEL_OF_CELLS);
        assert_eq!(level([0.5, 0.8], 0.1, 2.0), 1);
        assert_eq!(level([0.5, 0.8], 0.1, 1.0), 0);
        // Equal values, values of almost one colour, and values that nothing shows have no jump.
        assert_eq!(level([0.5, 0.5], 0.1, 10.0), 0);
        assert_eq!(level([0.5, 0.501], 0.1, 10.0), 0);
        assert_eq!(level([-0.5, -0.8], 0.1, 10.0), 0);
        // A cell that is not shown is split, so that it does not reach into shown values, and no further.
        assert_eq!(level([0.8, 0.5], 0.1, 10.0), 1);
    }

    #[test]
    fn bodies_beside_unknown_values_stay_whole() {
        let mut values = vec![0.5; 27];
        values[0] = f64::NAN;
        with_nodes([2; 3], &values, |nodes| {
            assert!(nodes.body(13).is_none());
            let other = nodes.body(26).unwrap();
            assert_eq!((other.cells.len(), other.range), (1, [0.5; 2]));
        });
        with_block([2, 1, 1], |cells, around| {
            let bodies = CellBodies {
                cells,
                around,
                kept: &[1],
                values: &[f64::NAN, 0.5],
            };
            assert!(bodies.body(0).is_none() && bodies.body(1).is_some());
        });
    }
}
