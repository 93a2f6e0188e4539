//! The bodies of a mesh that kernels stand for: dual cells of nodes, or cells.

use super::incidence::CellsAround;
use super::levels::{Body, NONE, bend, joined};
use super::pieces::pieces;
use super::sharp::{DrawnCells, NodeParticles, Surface};
use crate::sample::positions::index_u32;
use crate::sample::refine::rule::Rule;

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

    /// Returns true for bodies at the boundary.
    fn is_outermost(&self, body: u32, surface: &Surface) -> bool;

    /// Calls a function with the bodies of each group whose members lie side by side.
    fn each_group(&self, visit: &mut dyn FnMut(&[u32]));

    /// Returns a body; `None` if a position or a value is missing.
    fn body(&self, body: u32) -> Option<Body>;

    /// Returns a body, and the level that a rule asks for; `None` as for [`Self::body`].
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
    /// Returns a dual cell, with pieces if any of its values are shown.
    fn of(&self, node: u32, is_shown: impl Fn([f64; 2]) -> bool) -> Option<Body> {
        let mesh = self.cells.mesh;
        let drawn = || {
            let cells = self.around.of(node).iter().map(|&cell| cell as usize);
            cells.filter(|&cell| self.cells.is_drawn(cell))
        };
        let origin = mesh.nodes[node as usize];
        let mut body = Body {
            origin,
            value: self.values[node as usize],
            range: NONE,
            radius: 0.0,
            has_tetrahedra: false,
            cells: Vec::new(),
        };
        let mut corners = Vec::new();
        let mut ranges = Vec::new();
        for cell in drawn() {
            self.cells.own_corners(cell, &mut corners);
            body.has_tetrahedra |= corners.len() == 4;
            let mut range = NONE;
            for &corner in &corners {
                let value = self.values[corner as usize];
                let distance = mesh.nodes[corner as usize].distance(origin);
                if !value.is_finite() || !distance.is_finite() {
                    return None;
                }
                range = joined(range, [value; 2]);
                body.radius = body.radius.max(distance);
            }
            body.range = joined(body.range, range);
            ranges.push(range);
        }
        if !body.value.is_finite() || ranges.is_empty() || !is_shown(body.range) {
            return Some(body);
        }
        let at = |n: u32| {
            let place = mesh.nodes[n as usize] - origin;
            Some(place.extend(self.values[n as usize]))
        };
        for (cell, range) in drawn().zip(ranges) {
            let is_own = |n: u32| self.cells.duals.first_of(n) == node;
            body.cells.push((pieces(mesh, cell, at, is_own)?, range));
        }
        Some(body)
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
        self.of(node, |_| true)
    }

    fn level(
        &self,
        node: u32,
        rule: &Rule,
        px: impl Fn(&Body) -> f64,
        sigma: f64,
        surface: Option<&Surface>,
    ) -> Option<u8> {
        let body = self.of(node, |range| rule.shows(range))?;
        let bend = surface.map_or(0.0, |surface| bend(self.cells, surface, node));
        Some(body.level(rule, px(&body), sigma, bend))
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
            cells: Vec::new(),
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
        let pieces = pieces(mesh, cell as usize, at, |_| true)?;
        body.cells.push((pieces, body.range));
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
