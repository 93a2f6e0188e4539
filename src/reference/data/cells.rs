//! Integrates along rays through cells of grids.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::super::traversal::Traversal;
use super::cubic::{CHEBYSHEV, Cubic};
use super::emission::Emission;
use super::hexahedron::{self, Corners, Ray, Span};
use super::pieces::{self, Piece, disjoint};

/// A cell, given by its corners.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Corners: eight of a hexahedron, the first index fastest; four of a tetrahedron, then [`NONE`].
    corners: [u32; 8],
    /// Number of the data's cell that contains this one.
    sample: u32,
}

/// Marks a missing corner.
const NONE: u32 = u32::MAX;

impl Cell {
    pub(super) fn hexahedron(corners: [u32; 8], sample: u32) -> Self {
        Self { corners, sample }
    }

    pub(super) fn tetrahedron([a, b, c, d]: [u32; 4], sample: u32) -> Self {
        Self {
            corners: [a, b, c, d, NONE, NONE, NONE, NONE],
            sample,
        }
    }

    fn is_tetrahedron(&self) -> bool {
        self.corners[4] == NONE
    }

    pub(super) fn nodes(&self) -> &[u32] {
        &self.corners[..if self.is_tetrahedron() { 4 } else { 8 }]
    }

    pub(super) fn places(&self, nodes: &[DVec3]) -> Corners {
        self.corners
            .map(|c| nodes.get(c as usize).copied().unwrap_or_default())
    }

    /// Returns the volume with the sign of its determinant.
    pub(super) fn volume(&self, nodes: &[DVec3]) -> f64 {
        let places = self.places(nodes);
        if self.is_tetrahedron() {
            edges(&places).determinant() / 6.0
        } else {
            hexahedron::volume(&places)
        }
    }
}

/// Returns the edges of a tetrahedron from its first corner.
fn edges([a, b, c, d, ..]: &Corners) -> DMat3 {
    DMat3::from_cols(b - a, c - a, d - a)
}

/// Values of a field at nodes or in cells.
#[derive(Debug, Clone)]
pub(super) enum Known {
    /// One value for each node.
    AtNodes(Vec<f64>),
    /// One value for each cell of the data, constant within the cell.
    InCells(Vec<f64>),
}

/// Cells with finite corners, finite values and a volume.
#[derive(Clone)]
pub(super) struct Mesh {
    /// Positions in world space, relative to `centre`.
    nodes: Vec<DVec3>,
    known: Known,
    cells: Vec<Cell>,
    centre: DVec3,
    radius: f64,
    /// BVH of the cells' boxes, relative to `centre`.
    traversal: Arc<Traversal>,
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mesh")
            .field("nodes", &self.nodes.len())
            .field("cells", &self.cells.len())
            .finish_non_exhaustive()
    }
}

/// Buffers that rays reuse.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    claims: Vec<Piece>,
    parts: Vec<Piece>,
    pieces: pieces::Scratch,
}

impl Mesh {
    /// Makes a mesh of nodes in world space.
    pub(super) fn new(mut nodes: Vec<DVec3>, known: Known, cells: Vec<Cell>) -> Self {
        let used = || cells.iter().flat_map(Cell::nodes);
        let bounds = used().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &n| {
            let node = nodes[n as usize];
            [low.min(node), high.max(node)]
        });
        let centre = if cells.is_empty() {
            DVec3::ZERO
        } else {
            bounds[0] + (bounds[1] - bounds[0]) / 2.0
        };
        let radius = (bounds[1] - centre).length();
        for node in &mut nodes {
            *node -= centre;
        }
        let traversal = Traversal::new(cells.len(), |i| {
            let corners = cells[i].nodes().iter().map(|&n| nodes[n as usize]);
            let [low, high] = corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[l, h], c| {
                [l.min(c), h.max(c)]
            });
            ((low + high) / 2.0, (high - low) / 2.0)
        });
        Self {
            nodes,
            known,
            cells,
            centre,
            radius,
            traversal: Arc::new(traversal),
        }
    }

    pub(super) fn cell_count(&self) -> usize {
        self.cells.len()
    }

    /// Returns centre and radius of a ball around all cells.
    pub(super) fn ball(&self) -> (DVec3, f64) {
        (self.centre, self.radius)
    }

    /// Returns the values at the corners of a cell.
    fn values(&self, cell: &Cell) -> [f64; 8] {
        match &self.known {
            Known::AtNodes(values) => {
                let mut at = cell.corners.map(|c| values.get(c as usize).copied());
                if cell.is_tetrahedron() {
                    let first = at[0];
                    at[4..].fill(first);
                }
                at.map(Option::unwrap_or_default)
            }
            Known::InCells(values) => [values[cell.sample as usize]; 8],
        }
    }

    /// Adds the cells' emission along the ray `origin` + t `direction` (unit length), up to `end`.
    pub(super) fn integrate(
        &self,
        origin: DVec3,
        direction: DVec3,
        end: f64,
        emission: &mut Emission<'_>,
        scratch: &mut Scratch,
    ) {
        let ray = Ray::new(origin - self.centre, direction, end);
        let Scratch {
            claims,
            parts,
            pieces,
        } = scratch;
        claims.clear();
        self.traversal.each(ray.origin, direction, |i| {
            let cell = &self.cells[i];
            let places = cell.places(&self.nodes);
            if cell.is_tetrahedron() {
                if let Some([from, to]) = within_tetrahedron(&places, &ray) {
                    let guides = [DVec3::ZERO; 3];
                    claims.push(Piece::new(i, Span { from, to, guides }));
                }
                return;
            }
            hexahedron::spans(&places, &ray, |span| claims.push(Piece::new(i, span)));
        });
        disjoint(claims, pieces, parts);
        for part in parts.iter() {
            if !emission.goes_on() {
                return;
            }
            self.add(part, &ray, emission);
        }
    }

    fn add(&self, part: &Piece, ray: &Ray, emission: &mut Emission<'_>) {
        let cell = &self.cells[part.cell];
        let values = self.values(cell);
        let low = values.into_iter().fold(f64::INFINITY, f64::min);
        let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
        if emission.is_transparent(low, high) {
            return;
        }
        let places = cell.places(&self.nodes);
        let length = part.to - part.from;
        if low == high {
            emission.add(length, &Cubic::line(low, high));
        } else if cell.is_tetrahedron() {
            let inverse = edges(&places).inverse();
            let at = |t: f64| {
                let shares = inverse * (ray.at(t) - places[0]);
                let rises = DVec3::new(values[1], values[2], values[3]) - values[0];
                // Beyond a face only by rounding.
                (values[0] + shares.dot(rises)).clamp(low, high)
            };
            emission.add(length, &Cubic::line(at(part.from), at(part.to)));
        } else {
            let tolerance = emission.value_tolerance(low, high);
            let at = |t: f64| {
                let s = hexahedron::locate(&places, ray.at(t), part.span.guess(t))?;
                Some(hexahedron::value(&values, s).clamp(low, high))
            };
            follow(
                &at,
                [part.from, part.to],
                DEPTH,
                tolerance,
                emission,
                [low, high],
            );
        }
    }
}

/// Greatest number of halvings of the part of a ray within one cell.
const DEPTH: u32 = 12;

/// Adds a field along a ray as cubics. A part is halved until its cubic is accurate in the middle, where it
/// errs most.
fn follow(
    at: &impl Fn(f64) -> Option<f64>,
    [from, to]: [f64; 2],
    depth: u32,
    tolerance: f64,
    emission: &mut Emission<'_>,
    range: [f64; 2],
) {
    let middle = 0.5 * (from + to);
    let values = CHEBYSHEV.map(|s| at(from + (to - from) * s));
    if let ([Some(a), Some(b), Some(c), Some(d)], Some(truth)) = (values, at(middle)) {
        let cubic = Cubic::through([a, b, c, d]);
        if (cubic.at(0.5) - truth).abs() <= tolerance || depth == 0 {
            emission.add(to - from, &cubic);
            return;
        }
    } else if depth == 0 {
        emission.lose(to - from, range[0], range[1]);
        return;
    }
    if emission.goes_on() {
        follow(at, [from, middle], depth - 1, tolerance, emission, range);
        follow(at, [middle, to], depth - 1, tolerance, emission, range);
    }
}

/// Tolerance of barycentric coordinates below 0 within which a place belongs to a tetrahedron: two cells round
/// the position of their common face differently. Parts that both claim are given to one.
const OUTSIDE: f64 = 1e-11;

/// Returns the part of a ray within a tetrahedron: barycentric coordinates are linear along the ray.
fn within_tetrahedron(places: &Corners, ray: &Ray) -> Option<[f64; 2]> {
    let inverse = edges(places).inverse();
    let start = inverse * (ray.origin - places[0]);
    let rate = inverse * ray.direction;
    let starts = [start.x, start.y, start.z, 1.0 - start.element_sum()];
    let rates = [rate.x, rate.y, rate.z, -rate.element_sum()];
    let (mut from, mut to) = (0.0_f64, ray.end);
    for (start, rate) in starts.into_iter().zip(rates) {
        let place = -(start + OUTSIDE) / rate;
        if rate > 0.0 {
            from = from.max(place);
        } else if rate < 0.0 {
            to = to.min(place);
        } else if !(start >= -OUTSIDE) {
            return None;
        }
    }
    (from < to).then_some([from, to])
}
