//! The bodies of a mesh that kernels stand for: dual cells of nodes, or cells. Their levels are graded: bodies side by
//! side differ by one at most.

use glam::DVec4;

use super::incidence::CellsAround;
use super::levels::{Body, NONE, bend, joined};
use super::pieces::{Corners, each_piece};
use super::sharp::{DrawnCells, NodeParticles, Surface};
use crate::sample::positions::index_u32;
use crate::sample::refine::MOST_PARTS;
use crate::sample::refine::rule::Rule;

/// Greatest number of parts for each cell with one value, on average. Steps from cell to cell take parts wherever values
/// change. With any number of them, a crushed can has 39 times the kernels, an error of .6 levels of 255 instead of 1.0
/// and frames four times as long as those of whole cells, not 1.6 times.
const PARTS_PER_CELL: usize = 16;

/// Number of parts that take no noticeable time, however few cells there are.
const FEW_PARTS: usize = 1 << 16;

/// The bodies of a mesh, one for each of its samples, by their numbers.
pub(super) trait Bodies: Sync {
    /// Number of all nodes or cells.
    fn count(&self) -> usize;

    /// Returns the bodies, ascending.
    fn all(&self) -> Vec<u32>;

    /// Returns the body of a particle that is no ghost.
    fn of_particle(&self, particle: usize) -> u32;

    /// Returns a particle of a body, if it has one.
    fn particle(&self, body: u32) -> Option<usize>;

    /// Returns the cells in which a body lies.
    fn cells<'b>(&'b self, body: &'b u32) -> &'b [u32];

    /// Returns about the number of a body's pieces.
    fn piece_count(&self, body: u32) -> u64;

    /// Returns the greatest number of parts of all bodies.
    fn most_parts(&self) -> usize {
        MOST_PARTS
    }

    /// Returns true for bodies at the boundary.
    fn is_outermost(&self, body: u32, surface: &Surface) -> bool;

    /// Calls a function with the bodies of each group whose members lie side by side.
    fn each_group(&self, visit: &mut dyn FnMut(&[u32]));

    /// Returns a body; `None` if a position or a value is missing.
    fn body(&self, body: u32) -> Option<Body>;

    /// Returns the level that a rule asks for; `None` as for [`Self::body`].
    ///
    /// - `px`: returns the pixels per world unit at a body; `sigma`: deviation of its kernel at level 0.
    /// - `surface`: the faces whose tangent planes cut kernels, if any do.
    fn level(
        &self,
        body: u32,
        rule: &Rule,
        px: impl Fn(&Body) -> f64,
        sigma: f64,
        surface: Option<&Surface>,
    ) -> Option<u8>;
}

/// Dual cells of nodes. Those at one position have one body, with the number of the first.
pub(super) struct DualCells<'a> {
    pub(super) cells: &'a DrawnCells<'a>,
    pub(super) around: &'a CellsAround,
    pub(super) particles: &'a NodeParticles<'a>,
    /// Value of each node; NaN where it is not known.
    pub(super) values: &'a [f64],
}

impl DualCells<'_> {
    /// Returns the drawn cells around a node.
    fn drawn(&self, node: u32) -> impl Iterator<Item = usize> {
        let cells = self.around.of(node).iter().map(|&cell| cell as usize);
        cells.filter(|&cell| self.cells.is_drawn(cell))
    }

    /// Returns a dual cell without its pieces; `None` if a position or a value is missing.
    fn bare(&self, node: u32) -> Option<Body> {
        let origin = self.cells.mesh.nodes[node as usize];
        let mut body = Body {
            origin,
            value: self.values[node as usize],
            range: NONE,
            radius: 0.0,
            has_tetrahedra: false,
            pieces: Vec::new(),
            tetrahedra: Vec::new(),
        };
        let mut corners = Vec::new();
        for cell in self.drawn(node) {
            self.cells.own_corners(cell, &mut corners);
            body.has_tetrahedra |= corners.len() == 4;
            for &corner in &corners {
                let distance = self.cells.mesh.nodes[corner as usize].distance(origin);
                if !self.values[corner as usize].is_finite() || !distance.is_finite() {
                    return None;
                }
                body.radius = body.radius.max(distance);
            }
            body.range = joined(body.range, self.range(&corners));
        }
        Some(body)
    }

    /// Returns the least and the greatest value of nodes.
    fn range(&self, nodes: &[u32]) -> [f64; 2] {
        let values = nodes.iter().map(|&n| [self.values[n as usize]; 2]);
        values.fold(NONE, joined)
    }

    /// Returns a dual cell with its pieces.
    ///
    /// - `for_level`: true if only a level is asked for. Tetrahedra then stay whole.
    fn whole(&self, node: u32, mut body: Body, for_level: bool) -> Option<Body> {
        if !body.value.is_finite() {
            return Some(body);
        }
        let mesh = self.cells.mesh;
        let (origin, value) = (body.origin, body.value);
        let place = |n: u32| (mesh.nodes[n as usize] - origin).extend(self.values[n as usize]);
        let is_own = |n: u32| self.cells.duals.first_of(n) == node;
        let (mut corners, mut of_cell) = (Corners::default(), Vec::new());
        let mut pieces = Vec::with_capacity(self.around.of(node).len());
        for cell in self.drawn(node) {
            self.cells.own_corners(cell, &mut of_cell);
            if for_level && let Some(others) = others_of_four(&of_cell, node) {
                let from_node = |n: u32| place(n) - DVec4::W * value;
                body.tetrahedra.push(others.map(from_node));
                continue;
            }
            let range = self.range(&of_cell);
            let each = |piece| pieces.push((piece, range));
            each_piece((mesh, cell), |n| Some(place(n)), is_own, &mut corners, each)?;
        }
        body.pieces = pieces;
        Some(body)
    }
}

/// Returns the other corners of a tetrahedron with a node; `None` for other cells, and for one whose corner here is
/// another node at the same position.
fn others_of_four(corners: &[u32], node: u32) -> Option<[u32; 3]> {
    let [a, b, c, d] = *<&[u32; 4]>::try_from(corners).ok()?;
    match [a, b, c, d].map(|n| n == node) {
        [true, false, false, false] => Some([b, c, d]),
        [false, true, false, false] => Some([a, c, d]),
        [false, false, true, false] => Some([a, b, d]),
        [false, false, false, true] => Some([a, b, c]),
        _ => None,
    }
}

impl Bodies for DualCells<'_> {
    fn count(&self) -> usize {
        self.cells.mesh.nodes.len()
    }

    fn all(&self) -> Vec<u32> {
        let all = (0..self.count()).map(index_u32);
        all.filter(|&n| self.cells.duals.first_of(n) == n).collect()
    }

    fn of_particle(&self, particle: usize) -> u32 {
        let node = self.particles.node(particle);
        self.cells.duals.first_of(node)
    }

    fn particle(&self, node: u32) -> Option<usize> {
        self.particles.first(node)
    }

    fn cells<'b>(&'b self, node: &'b u32) -> &'b [u32] {
        self.around.of(*node)
    }

    fn piece_count(&self, node: u32) -> u64 {
        self.around.of(node).len() as u64
    }

    fn is_outermost(&self, node: u32, surface: &Surface) -> bool {
        surface.nodes().binary_search(&node).is_ok()
    }

    fn each_group(&self, visit: &mut dyn FnMut(&[u32])) {
        let mut corners = Vec::new();
        let cells = 0..self.cells.mesh.cell_count();
        for cell in cells.filter(|&cell| self.cells.is_drawn(cell)) {
            self.cells.corners(cell, &mut corners);
            visit(&corners);
        }
    }

    fn body(&self, node: u32) -> Option<Body> {
        self.whole(node, self.bare(node)?, false)
    }

    fn level(
        &self,
        node: u32,
        rule: &Rule,
        px: impl Fn(&Body) -> f64,
        sigma: f64,
        surface: Option<&Surface>,
    ) -> Option<u8> {
        let bare = self.bare(node)?;
        let px = px(&bare);
        if !rule.shows(bare.range) || Rule::most_level(sigma, px) == 0 {
            return Some(0);
        }
        let bend = surface.map_or(0.0, |surface| bend(self.cells, surface, node));
        Some(self.whole(node, bare, true)?.level(rule, px, sigma, bend))
    }
}

/// Cells with one value each.
pub(super) struct CellBodies<'a> {
    pub(super) cells: &'a DrawnCells<'a>,
    pub(super) around: &'a CellsAround,
    /// Cell of each particle that is no ghost, ascending.
    pub(super) kept: &'a [u32],
    /// Value of each cell; NaN where it is not known.
    pub(super) values: &'a [f64],
}

impl CellBodies<'_> {
    /// Returns a cell without its pieces; `None` if its value or a position is missing.
    fn bare(&self, cell: u32) -> Option<Body> {
        let value = self.values[cell as usize];
        let mut corners = Vec::new();
        self.cells.own_corners(cell as usize, &mut corners);
        let places = || corners.iter().map(|&n| self.cells.mesh.nodes[n as usize]);
        let origin = places().next()?;
        let is_known = value.is_finite() && places().all(|x| x.is_finite());
        is_known.then(|| Body {
            origin,
            value,
            range: [value; 2],
            radius: places().map(|x| x.distance(origin)).fold(0.0, f64::max),
            has_tetrahedra: corners.len() == 4,
            pieces: Vec::new(),
            tetrahedra: Vec::new(),
        })
    }
}

impl Bodies for CellBodies<'_> {
    fn count(&self) -> usize {
        self.cells.mesh.cell_count()
    }

    fn all(&self) -> Vec<u32> {
        self.kept.to_vec()
    }

    fn of_particle(&self, particle: usize) -> u32 {
        self.kept[particle]
    }

    fn particle(&self, cell: u32) -> Option<usize> {
        self.kept.binary_search(&cell).ok()
    }

    fn cells<'b>(&'b self, cell: &'b u32) -> &'b [u32] {
        std::slice::from_ref(cell)
    }

    fn piece_count(&self, cell: u32) -> u64 {
        let mut corners = Vec::new();
        self.cells.own_corners(cell as usize, &mut corners);
        corners.len() as u64
    }

    fn most_parts(&self) -> usize {
        (PARTS_PER_CELL * self.kept.len()).clamp(FEW_PARTS, MOST_PARTS)
    }

    fn is_outermost(&self, cell: u32, surface: &Surface) -> bool {
        let mut corners = Vec::new();
        self.cells.corners(cell as usize, &mut corners);
        let nodes = surface.nodes();
        corners.iter().any(|n| nodes.binary_search(n).is_ok())
    }

    fn each_group(&self, visit: &mut dyn FnMut(&[u32])) {
        for node in (0..self.cells.mesh.nodes.len()).map(index_u32) {
            visit(self.around.of(node));
        }
    }

    fn body(&self, cell: u32) -> Option<Body> {
        let mut body = self.bare(cell)?;
        let mesh = self.cells.mesh;
        let at = |n: u32| Some((mesh.nodes[n as usize] - body.origin).extend(body.value));
        let (mut corners, mut pieces) = (Corners::default(), Vec::new());
        let each = |piece| pieces.push((piece, body.range));
        each_piece((mesh, cell as usize), at, |_| true, &mut corners, each)?;
        body.pieces = pieces;
        Some(body)
    }

    fn level(
        &self,
        cell: u32,
        rule: &Rule,
        px: impl Fn(&Body) -> f64,
        sigma: f64,
        _: Option<&Surface>,
    ) -> Option<u8> {
        let body = self.bare(cell)?;
        let mut corners = Vec::new();
        self.cells.corners(cell as usize, &mut corners);
        let beside = corners.iter().flat_map(|&n| self.around.of(n));
        let values = beside.map(|&cell| self.values[cell as usize]);
        let known = values.filter(|value| value.is_finite());
        let around = known.fold(NONE, |range, value| joined(range, [value; 2]));
        Some(body.level_of_constant(rule, around, px(&body), sigma))
    }
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
    use glam::DVec3;

    use super::*;
    use crate::data::blanking::Blanking;
    use crate::data::cells::CellMesh;
    use crate::sample::cells::duals::{Duals, turned};
    use crate::sample::cells::levels::MOST_LEVEL_OF_CELLS;
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
        with_cells(&mesh, of);
    }

    /// Calls a function with the cells of a mesh, and those around its nodes.
    fn with_cells(mesh: &CellMesh, of: impl FnOnce(&DrawnCells<'_>, &CellsAround)) {
        let all = 0..mesh.cell_count();
        let mut report = SampleReport::default();
        let turned = turned(mesh);
        let duals = Duals::new(mesh, &Blanking::NONE, &turned, &all, &mut report, None).unwrap();
        let cells = DrawnCells {
            mesh,
            duals: &duals,
            blanking: &Blanking::NONE,
        };
        of(&cells, &CellsAround::new(mesh, &duals.first));
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
    fn levels_of_tetrahedra_are_those_of_their_pieces() {
        let noise = |n: usize, d: usize| ((n * (d + 3)) as f64 * 1.7).sin();
        let nodes: Vec<DVec3> = (0..9)
            .chain([0])
            .map(|n| DVec3::new(noise(n, 0), noise(n, 1), noise(n, 2)) + 100.0)
            .collect();
        // All have node 0 but one, which has its copy; one is stated twice.
        let cells = [
            [1, 0, 2, 3],
            [4, 3, 0, 5],
            [0, 6, 7, 8],
            [2, 5, 8, 0],
            [0, 1, 4, 8],
        ];
        let cells = cells.iter().flat_map(|own| [&[4_i64][..], own].concat());
        let mut cells: Vec<i64> = cells.collect();
        cells.extend([4, 4, 3, 0, 5, 4, 9, 1, 6, 3]);
        let mesh = CellMesh::of_lists(nodes, &[10; 7], &cells).unwrap();
        let values: Vec<f64> = (0..10).map(|n| 0.5 + 0.3 * noise(n, 3)).collect();
        let rule = hat(1e3);
        with_cells(&mesh, |cells, around| {
            let kept: Vec<u32> = (0..10).collect();
            let nodes = DualCells {
                cells,
                around,
                particles: &NodeParticles::new(cells.duals, &kept),
                values: &values,
            };
            for node in 0..9 {
                // Pixels per unit from which on the node is split.
                let limit = |for_level: bool| {
                    let body = nodes.whole(node, nodes.bare(node)?, for_level)?;
                    let is_welded = node == 0;
                    assert_eq!(body.pieces.is_empty(), for_level && !is_welded);
                    assert_eq!(body.tetrahedra.is_empty(), !for_level);
                    let [mut low, mut high] = [1e-6, 1e6];
                    for _ in 0..60 {
                        let px = f64::sqrt(low * high);
                        match body.level(&rule, px, 1e9, 0.0) {
                            0 => low = px,
                            _ => high = px,
                        }
                    }
                    Some(low)
                };
                let [whole, pieces] = [true, false].map(limit);
                let (Some(whole), Some(pieces)) = (whole, pieces) else {
                    panic!("{node}");
                };
                assert!(
                    (whole / pieces - 1.0).abs() < 1e-9,
                    "{node} {whole} {pieces}"
                );
            }
        });
    }

    #[test]
    fn bodies_beside_unknown_values_stay_whole() {
        let mut values = vec![0.5; 27];
        values[0] = f64::NAN;
        with_nodes([2; 3], &values, |nodes| {
            assert!(nodes.body(13).is_none());
            let other = nodes.body(26).unwrap();
            assert_eq!((other.pieces.len(), other.range), (1, [0.5; 2]));
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
