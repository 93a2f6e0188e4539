//! Builds grids in which cells of higher order are cut into cells of first order.

use std::collections::HashMap;

use glam::DVec3;

use super::Element;
use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::math::narrowed;
use crate::scene::Values;

/// Greatest weight that counts as rounding, of a node outside the face or edge of a position.
const NOTHING: f64 = 1e-9;

/// Resolution of weights that distinguishes positions: this many steps from 0 to 1.
const WEIGHT_STEPS: f64 = 1e6;

/// Greatest number of small cells; sampling that many takes some gigabytes.
const MOST_CELLS: usize = 8_000_000;

/// Number of sampled cells that decide the fineness of all.
const LOOKED_AT: usize = 2000;

/// Fraction of the tested positions that may differ by more than the tolerance.
const TAIL: f64 = 0.001;

/// Elements of higher order, by the kind and number of nodes of their cells.
type Elements = HashMap<(CellKind, usize), Option<Element>>;

fn elements(mesh: &CellMesh) -> Elements {
    let mut known = Elements::new();
    for (i, &kind) in mesh.kinds.iter().enumerate() {
        if kind.is_of_higher_order() && (kind.is_solid() || kind.is_flat()) {
            let count = mesh.cell(i).len();
            let element = || Element::of(kind, count);
            known.entry((kind, count)).or_insert_with(element);
        }
    }
    known
}

/// Returns the number of steps into which each edge is to be cut, a multiple of the elements' order. Returns `None` if
/// no cell has a known element of higher order. If `may_stay` is true, it also returns `None` if the corners alone are
/// accurate enough.
///
/// Drawing is linear between corners of small cells. At the midpoint of two corners it is compared with the element:
/// positions may differ by `slack` of the cell's size, and values by `slack` of their range. At least 999 of 1000
/// midpoints must meet this.
///
/// - `values`: values of the nodes, or `None` if values belong to cells.
pub(crate) fn steps(
    mesh: &CellMesh,
    values: Option<&Values>,
    slack: f64,
    may_stay: bool,
) -> Option<i32> {
    let elements = elements(mesh);
    let known = elements.values().flatten();
    let order = known.map(|element| element.order).max()?;
    let range = values.and_then(Values::finite_range);
    let width = range.map_or(0.0, |[low, high]| high - low);
    let is_known = |i: &usize| {
        let key = (mesh.kinds[*i], mesh.cell(*i).len());
        matches!(elements.get(&key), Some(Some(_)))
    };
    let all: Vec<usize> = (0..mesh.cell_count()).filter(is_known).collect();
    let every = all.len().div_ceil(LOOKED_AT).max(1);
    let first = if may_stay { 1 } else { order };
    let mut chosen = first;
    for steps in [1, order, 2 * order, 4 * order] {
        if steps < first {
            continue;
        }
        let most = all
            .len()
            .saturating_mul(steps.pow(3).unsigned_abs() as usize);
        if most > MOST_CELLS && steps > first {
            break;
        }
        chosen = steps;
        let halves: HashMap<(CellKind, usize), Vec<Between>> = elements
            .iter()
            .filter_map(|(key, element)| Some((*key, between(element.as_ref()?, steps))))
            .collect();
        let (mut places, mut apart) = (0_usize, 0_usize);
        for &i in all.iter().step_by(every) {
            let cell = mesh.cell(i);
            let Some(halves) = halves.get(&(mesh.kinds[i], cell.len())) else {
                continue;
            };
            let nodes = || cell.iter().map(|&n| mesh.nodes[n as usize]);
            let size = nodes().fold(DVec3::NEG_INFINITY, DVec3::max)
                - nodes().fold(DVec3::INFINITY, DVec3::min);
            for difference in halves {
                let position: DVec3 = nodes().zip(difference).map(|(p, w)| p * *w).sum();
                let value = |values: &Values| -> f64 {
                    let of_cell = cell.iter().map(|&n| values.wide(n as usize));
                    of_cell.zip(difference).map(|(v, w)| v * w).sum()
                };
                let value = values.map_or(0.0, value).abs();
                places += 1;
                let is_far =
                    position.length() > slack * size.max_element() || value > slack * width;
                apart += usize::from(is_far);
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "some million at most")]
        let is_close = apart as f64 <= TAIL * places as f64;
        if is_close {
            break;
        }
    }
    (chosen > 1).then_some(chosen)
}

/// Node weights of the element at the midpoint of two corners of a small cell, minus those of the straight line.
type Between = Vec<f64>;

fn between(element: &Element, steps: i32) -> Vec<Between> {
    let mut all = Vec::new();
    for (kind, corners) in element.split(steps) {
        let pairs: &[(usize, usize)] = match kind {
            CellKind::HEXAHEDRON | CellKind::PYRAMID => &[(0, 1), (1, 2), (0, 4)],
            CellKind::WEDGE => &[(0, 1), (1, 2), (0, 3)],
            _ => &[(0, 1), (1, 2), (2, 3)],
        };
        for &(a, b) in pairs.iter().filter(|(_, b)| *b < corners.len()) {
            let (a, b) = (corners[a], corners[b]);
            let middle = element.weights([0, 1, 2].map(|axis| 0.5 * (a[axis] + b[axis])));
            let ends = element.weights(a).into_iter().zip(element.weights(b));
            let less = |(middle, (a, b)): (f64, (f64, f64))| middle - 0.5 * (a + b);
            all.push(middle.into_iter().zip(ends).map(less).collect());
        }
    }
    all
}

/// Grid in which cells of higher order are cut, with the origin of its nodes and cells.
#[derive(Debug)]
pub(crate) struct Subdivision {
    /// All original nodes, then the new ones.
    pub(crate) mesh: CellMesh,
    /// For each cell, the original cell that it is or is a part of.
    pub(crate) parents: Vec<u32>,
    /// Number of original cells that were cut.
    pub(crate) cut: usize,
    /// For each new node, the original nodes and their weights.
    between: Vec<Vec<(u32, f64)>>,
}

impl Subdivision {
    /// Cuts the known cells of higher order, each edge into `steps` steps. Returns `None` if there would be too many
    /// nodes for their indices or for memory.
    pub(crate) fn new(mesh: &CellMesh, steps: i32) -> Option<Self> {
        let elements = elements(mesh);
        let templates: HashMap<(CellKind, usize), Template> = elements
            .iter()
            .filter_map(|(key, element)| Some((*key, Template::new(element.as_ref()?, steps))))
            .collect();
        let mut cut = Self {
            mesh: CellMesh {
                nodes: mesh.nodes.clone(),
                offsets: vec![0],
                ..CellMesh::default()
            },
            parents: Vec::new(),
            cut: 0,
            between: Vec::new(),
        };
        let mut known: HashMap<Vec<(u32, i64)>, u32> = HashMap::new();
        for (i, parent) in (0..mesh.cell_count()).zip(0_u32..) {
            let (kind, cell) = (mesh.kinds[i], mesh.cell(i));
            let Some(template) = templates.get(&(kind, cell.len())) else {
                cut.push(kind, parent, cell.iter().copied())?;
                continue;
            };
            cut.cut += 1;
            let mut nodes = Vec::with_capacity(template.places.len());
            for place in &template.places {
                nodes.push(match place[..] {
                    [(only, _)] => cell[only],
                    _ => cut.node(mesh, cell, place, &mut known)?,
                });
            }
            for (kind, corners) in &template.cells {
                cut.push(*kind, parent, corners.iter().map(|&corner| nodes[corner]))?;
            }
        }
        Some(cut)
    }

    fn push(
        &mut self,
        kind: CellKind,
        parent: u32,
        nodes: impl Iterator<Item = u32>,
    ) -> Option<()> {
        self.mesh.kinds.push(kind);
        self.mesh.connectivity.extend(nodes);
        self.mesh
            .offsets
            .push(u32::try_from(self.mesh.connectivity.len()).ok()?);
        self.parents.push(parent);
        Some(())
    }

    /// Returns a new node of a cell; all cells that meet there share it.
    fn node(
        &mut self,
        mesh: &CellMesh,
        cell: &[u32],
        place: &[(usize, f64)],
        known: &mut HashMap<Vec<(u32, i64)>, u32>,
    ) -> Option<u32> {
        let mut weights: Vec<(u32, f64)> = place.iter().map(|&(n, w)| (cell[n], w)).collect();
        weights.sort_unstable_by_key(|(node, _)| *node);
        #[expect(clippy::cast_possible_truncation, reason = "weights are a few at most")]
        let key = weights
            .iter()
            .map(|(n, w)| (*n, (w * WEIGHT_STEPS).round() as i64));
        let key = key.collect();
        if let Some(node) = known.get(&key) {
            return Some(*node);
        }
        let node = u32::try_from(self.mesh.nodes.len()).ok()?;
        let position = weights.iter().map(|(n, w)| mesh.nodes[*n as usize] * *w);
        self.mesh.nodes.push(position.sum());
        self.between.push(weights);
        known.insert(key, node);
        Some(node)
    }

    /// Interpolates a field of the original grid at the nodes or cells of the cut one.
    pub(crate) fn values(&self, association: Association, values: &Values) -> Values {
        match association {
            Association::Cells => values.gather(&self.parents),
            Association::Nodes => {
                let stated = (0..values.len()).map(|i| values.wide(i));
                let of = |weights: &Vec<(u32, f64)>| {
                    let value = |(n, w): &(u32, f64)| values.wide(*n as usize) * w;
                    weights.iter().map(value).sum::<f64>()
                };
                let all: Vec<f64> = stated.chain(self.between.iter().map(of)).collect();
                // Values in single precision stay in single precision.
                match values {
                    Values::F64(_) => all.into(),
                    _ => Values::F32(all.into_iter().map(narrowed).collect()),
                }
            }
        }
    }
}

/// Cut that all cells of one element share.
struct Template {
    /// Small cells, as indices of their corners in `places`.
    cells: Vec<(CellKind, Vec<usize>)>,
    /// For each corner, the nodes of the element that contribute, with their weights.
    places: Vec<Vec<(usize, f64)>>,
}

impl Template {
    fn new(element: &Element, steps: i32) -> Self {
        let mut numbers: HashMap<[u64; 3], usize> = HashMap::new();
        let mut places = Vec::new();
        let mut number = |at: [f64; 3]| {
            *numbers.entry(at.map(f64::to_bits)).or_insert_with(|| {
                let weights = element.weights(at).into_iter().enumerate();
                places.push(weights.filter(|(_, w)| w.abs() > NOTHING).collect());
                places.len() - 1
            })
        };
        let cells = element.split(steps).into_iter();
        let cells = cells
            .map(|(kind, corners)| (kind, corners.into_iter().map(&mut number).collect()))
            .collect();
        Self { cells, places }
    }
}
