//! Chooses how far the dual cells of a mesh's nodes are refined.
//!
//! The linear model of a node is its value and its mean gradient, by volume, of the pieces of its cells. It misses
//! most of the interpolant at the corners of these pieces: the middles of edges, faces and cells. The level follows
//! from that by [`Rule`], as on grids. Where the surface bends away from its tangent planes, that asks for parts, too.
//! Nodes of one cell then differ by one level at most.

use glam::{DVec3, DVec4, Vec4Swizzles as _};

use super::pieces::{Piece, pieces};
use super::sharp::{DrawnCells, SAME_PLANE, Surface};
use crate::sample::positions::index_u32;
use crate::sample::refine::rule::{Rule, least_level};

/// Greatest level of a dual cell: its pieces fall into 4³ parts.
const MOST_LEVEL: u8 = 3;

/// Greatest level that nodes of tetrahedra ask for. Fields are linear in tetrahedra, and their pieces are a third as
/// wide as dual cells already. On a reactor cut into 44,832 of them further levels took three times as long to read,
/// for an error of 2.2 levels of 255 at best and 3.2 at worst; this one leaves 2.3 of 3.6.
const MOST_LEVEL_OF_TETRAHEDRA: u8 = 1;

/// Share of a level's error that is left at the next one.
const PER_LEVEL: f64 = 3.0;

/// Factor by which less may be missed than on grids, whose indices are split one by one: on a reactor of 8,499 nodes
/// (`disk_out_ref`) 28,711 particles and an error of 1.74 levels of 255 for 23,065 and 2.01.
const STRICTNESS: f64 = 1.4;

/// The cells at a node, and their pieces there.
pub(super) struct DualCell {
    /// Position of the node, to which places are relative.
    pub(super) origin: DVec3,
    pub(super) value: f64,
    /// Least and greatest value of the cells' corners.
    pub(super) range: [f64; 2],
    /// Distance of the farthest corner.
    pub(super) radius: f64,
    pub(super) has_tetrahedra: bool,
    /// The pieces of each cell, with the range of its corners' values.
    pub(super) cells: Vec<(Vec<Piece>, [f64; 2])>,
}

/// Nodes of a mesh with their values.
pub(super) struct Nodes<'a> {
    pub(super) cells: &'a DrawnCells<'a>,
    /// Value of each node; NaN where it is not known.
    pub(super) values: &'a [f64],
}

impl Nodes<'_> {
    /// Returns the cells at a node, the first at its position; `None` if any lacks a position or a value.
    ///
    /// - `is_shown`: returns true for ranges of values that are worth their pieces.
    pub(super) fn dual_cell(
        &self,
        node: u32,
        around: &[u32],
        is_shown: impl Fn([f64; 2]) -> bool,
    ) -> Option<DualCell> {
        let mesh = self.cells.mesh;
        let drawn = || {
            let cells = around.iter().map(|&cell| cell as usize);
            cells.filter(|&cell| self.cells.is_drawn(cell))
        };
        let origin = mesh.nodes[node as usize];
        let mut dual = DualCell {
            origin,
            value: self.values[node as usize],
            range: NONE,
            radius: 0.0,
            has_tetrahedra: false,
            cells: Vec::new(),
        };
        let mut corners = Vec::new();
        let mut ranges = Vec::with_capacity(around.len());
        for cell in drawn() {
            self.cells.own_corners(cell, &mut corners);
            dual.has_tetrahedra |= corners.len() == 4;
            let mut range = NONE;
            for &corner in &corners {
                let value = self.values[corner as usize];
                let distance = mesh.nodes[corner as usize].distance(origin);
                if !value.is_finite() || !distance.is_finite() {
                    return None;
                }
                range = joined(range, [value; 2]);
                dual.radius = dual.radius.max(distance);
            }
            dual.range = joined(dual.range, range);
            ranges.push(range);
        }
        if !dual.value.is_finite() || ranges.is_empty() || !is_shown(dual.range) {
            return Some(dual);
        }
        let at = |n: u32| {
            let place = mesh.nodes[n as usize] - origin;
            Some(place.extend(self.values[n as usize]))
        };
        for (cell, range) in drawn().zip(ranges) {
            let is_own = |n: u32| self.cells.duals.first_of(n) == node;
            dual.cells.push((pieces(mesh, cell, at, is_own)?, range));
        }
        Some(dual)
    }
}

/// No values.
const NONE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl DualCell {
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

    /// Returns the level that a rule asks for.
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

/// Raises levels until the nodes of each cell differ by one at most. Levels are those of the first nodes at their
/// positions.
///
/// - `may_split`: false for nodes whose dual cells cannot be split.
pub(super) fn grade(cells: &DrawnCells<'_>, levels: &mut [u8], may_split: &[bool]) {
    let mut corners = Vec::new();
    loop {
        let mut has_changed = false;
        for cell in (0..cells.mesh.cell_count()).filter(|&cell| cells.is_drawn(cell)) {
            cells.corners(cell, &mut corners);
            let most = corners.iter().map(|&n| levels[n as usize]).max();
            let least = most.unwrap_or(0).saturating_sub(1);
            for &n in corners.iter().filter(|&&n| may_split[n as usize]) {
                if levels[n as usize] < least {
                    levels[n as usize] = least;
                    has_changed = true;
                }
            }
        }
        if !has_changed {
            return;
        }
    }
}

/// Returns the first nodes at their positions, ascending.
pub(super) fn first_nodes(cells: &DrawnCells<'_>) -> Vec<u32> {
    let all = (0..cells.mesh.nodes.len()).map(index_u32);
    all.filter(|&n| cells.duals.first_of(n) == n).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::blanking::Blanking;
    use crate::data::cells::CellMesh;
    use crate::data::handedness::Handedness;
    use crate::sample::cells::duals::{Duals, turned};
    use crate::sample::cells::incidence::CellsAround;
    use crate::sample::refine::rule::ShownValues;
    use crate::sample::report::SampleReport;
    use crate::scene::TransferFunction;

    /// Calls a function with a block of cubes of side 1 from the origin on, which has one node more along each axis.
    fn with_block(counts: [usize; 3], of: impl FnOnce(&DrawnCells<'_>)) {
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
        of(&DrawnCells {
            mesh: &mesh,
            duals: &duals,
            blanking: &Blanking::NONE,
        });
    }

    #[test]
    fn nodes_of_a_cell_differ_by_one_level_at_most() {
        with_block([6, 1, 1], |cells| {
            let mut levels = vec![0; cells.mesh.nodes.len()];
            levels[0] = 3;
            let mut may_split = vec![true; levels.len()];
            may_split[8] = false;
            grade(cells, &mut levels, &may_split);
            let row: Vec<u8> = levels[..7].to_vec();
            assert_eq!(row, [3, 2, 1, 0, 0, 0, 0]);
            assert_eq!((levels[7], levels[8], levels[9]), (2, 0, 1));
        });
    }

    #[test]
    fn cells_are_split_where_the_field_bends_the_function_shows_and_a_pixel_sees_it() {
        let hat = |width: f32| {
            let opacity = move |v: f32| (1.0 - (v - 0.5).abs() / width).max(0.0) * 0.5;
            TransferFunction::from_curves(|_| [1.0; 3], opacity, [-1.0, 1.0], 1.0).unwrap()
        };
        with_block([2; 3], |cells| {
            let around = CellsAround::new(cells.mesh, &[]);
            let level = |width: f32, field: &dyn Fn(DVec3) -> f64, px: f64| {
                let places = cells.mesh.nodes.iter();
                let values: Vec<f64> = places.map(|&x| field(x - 1.0)).collect();
                let nodes = Nodes {
                    cells,
                    values: &values,
                };
                let rule = Rule::new(&ShownValues::of_function(&hat(width)), 1.0, 0.6);
                let dual = nodes.dual_cell(13, around.of(13), |range| rule.shows(range));
                dual.unwrap().level(&rule, px, 0.6, 0.0)
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
        });
    }

    #[test]
    fn nodes_beside_unknown_values_stay_whole() {
        with_block([2; 3], |cells| {
            let around = CellsAround::new(cells.mesh, &[]);
            let mut values = vec![0.5; 27];
            values[0] = f64::NAN;
            let nodes = Nodes {
                cells,
                values: &values,
            };
            assert!(nodes.dual_cell(13, around.of(13), |_| true).is_none());
            let other = nodes.dual_cell(26, around.of(26), |_| true).unwrap();
            assert_eq!((other.cells.len(), other.range), (1, [0.5; 2]));
        });
    }
}
