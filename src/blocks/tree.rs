//! Builds a tree of boxes over a point set: its subtrees become blocks, and clusters of particles.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::morton::morton_encode_u64_unorm;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;
use rdst::RadixSort;

/// Most points of which a tree is built at a time, unless they share a position; takes some 180 bytes each meanwhile.
pub(super) const CHUNK: usize = 1 << 16;

/// Greatest difference between the extents of a subtree's particles and of its box, in units of the whole box. Each
/// point is moved by up to a millionth along each axis, either way, and rounded.
const SLACK: f64 = 4e-6;

/// A BVH whose subtrees are runs of particles in block order.
#[derive(Debug, Clone, Default)]
pub(super) struct Tree {
    /// Nodes of all subtrees of at least two particles, in depth-first order: the root, all nodes of its first child,
    /// all nodes of its second. A child's index thus follows from the number of particles before it, and is not stored.
    nodes: Vec<Node>,
    /// Number of particles.
    count: u32,
    /// World units in a unit of its boxes.
    unit: f64,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Node {
    /// Number of particles in its first child.
    first: u32,
    /// Squared diagonal of its box, in the tree's units.
    size: f32,
}

/// Partial tree: a tree over some of the particles.
#[derive(Debug, Clone, Copy)]
pub(super) struct PartialTree<'a> {
    pub(super) tree: &'a Tree,
    /// Index of its first particle among the particles that are here.
    pub(super) at: usize,
    /// Index of its first particle in block order.
    pub(super) start: usize,
}

/// A subtree: one particle or more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Subtree {
    /// First particle in block order.
    start: u32,
    /// Number of particles.
    count: u32,
    /// Index of its root among the nodes, if it has at least two particles.
    node: u32,
}

impl Subtree {
    /// Particles of the subtree: a run of block order.
    pub(super) fn run(self) -> Range<usize> {
        let start = self.start as usize;
        start..start + self.count as usize
    }
}

impl Tree {
    /// Builds a tree over points; also returns the order of the points in which its subtrees are runs.
    ///
    /// Runs PLOC (obvhs) over each chunk of [`chunks`] by itself, which fits caches, and over the chunks' boxes.
    ///
    /// - `positions`: finite.
    /// - `numbers`: the caller's numbers of the points, which must ascend within each cell of [`Curve`]. The tree then
    ///   does not depend on the order of `positions`. Empty if `positions` has the caller's order.
    pub(super) fn over(positions: &[DVec3], numbers: &[u32]) -> (Self, Vec<u32>) {
        if positions.is_empty() {
            return (Self::default(), Vec::new());
        }
        let number = |i: u32| numbers.get(i as usize).copied().unwrap_or(i);
        let (lower, upper) = bounds(positions.par_iter());
        let units = Units::of(lower, upper);
        let point = |i: u32| units.point(positions[i as usize], number(i));
        let (members, chunks) = chunks(positions);
        let boxes: Vec<Aabb> = chunks
            .par_iter()
            .map(|chunk| {
                let points = members[chunk.clone()].iter().map(|&i| point(i));
                points.fold(Aabb::empty(), |all, p| all.union(&p))
            })
            .collect();
        let (top, places) = Self::over_boxes(&boxes, units);
        let chunk = |place: usize| &members[chunks[places[place] as usize].clone()];
        let all = Subtree {
            start: 0,
            count: chunks.len() as u32,
            node: 0,
        };
        Self::over_chunks(&top, all, chunk, point)
    }

    /// Builds a tree over boxes; also returns the order of the boxes in which its subtrees are runs.
    pub(super) fn over_boxes(boxes: &[Aabb], units: Units) -> (Self, Vec<u32>) {
        let mut nodes = vec![Node::default(); boxes.len().saturating_sub(1)];
        let order = lay_out(&ploc(&mut PlocBuilder::new(), boxes), &mut nodes);
        let tree = Self {
            nodes,
            count: boxes.len() as u32,
            unit: units.unit(),
        };
        (tree, order)
    }

    /// Builds the tree over the points of a subtree of a tree over chunks; also returns the order of the points in
    /// which its subtrees are runs.
    ///
    /// - `chunk`: returns the points of the chunk at a place in the order of `top`.
    /// - `point`: returns the box of a point.
    pub(super) fn over_chunks<'a>(
        top: &Self,
        root: Subtree,
        chunk: impl Fn(usize) -> &'a [u32],
        point: impl Fn(u32) -> Aabb + Sync,
    ) -> (Self, Vec<u32>) {
        let counts: Vec<usize> = root.run().map(|place| chunk(place).len()).collect();
        let count = counts.iter().sum::<usize>();
        // A tree over n particles has n - 1 subtrees of at least two.
        let mut all = vec![Node::default(); count.saturating_sub(1)];
        let grafts = top.graft(root, &counts, |i, node| all[i] = node);
        let mut order = vec![0; count];
        let (mut rest, mut places, mut end) = (&mut all[..], &mut order[..], 0);
        let mut work = Vec::with_capacity(grafts.len());
        for (place, node) in root.run().zip(grafts) {
            let chunk = chunk(place);
            let (run, later) = places.split_at_mut(chunk.len());
            let mut own: &mut [Node] = &mut [];
            if chunk.len() > 1 {
                let (_, others) = rest.split_at_mut(node - end);
                (own, rest) = others.split_at_mut(chunk.len() - 1);
                end = node + chunk.len() - 1;
            }
            work.push((chunk, own, run));
            places = later;
        }
        work.into_par_iter()
            .for_each_init(PlocBuilder::new, |builder, (chunk, own, run)| {
                let points: Vec<Aabb> = chunk.iter().map(|&i| point(i)).collect();
                let order = lay_out(&ploc(builder, &points), own);
                for (place, i) in run.iter_mut().zip(order) {
                    *place = chunk[i as usize];
                }
            });
        let tree = Self {
            nodes: all,
            count: count as u32,
            unit: top.unit,
        };
        (tree, order)
    }

    /// Lays out the nodes of a subtree whose leaves become trees of their own; returns the index at which the nodes of
    /// each of these trees begin.
    ///
    /// - `counts`: number of particles in the tree of each leaf of the subtree, in order.
    /// - `put`: receives the index of each node, and the node.
    fn graft(
        &self,
        root: Subtree,
        counts: &[usize],
        mut put: impl FnMut(usize, Node),
    ) -> Vec<usize> {
        let sum = |sum: &mut usize, count: &usize| {
            *sum += count;
            Some(*sum)
        };
        // Number of particles up to each leaf.
        let before: Vec<usize> = std::iter::once(0)
            .chain(counts.iter().scan(0, sum))
            .collect();
        let count = |subtree: Subtree| {
            let first = (subtree.start - root.start) as usize;
            before[first + subtree.count as usize] - before[first]
        };
        let mut grafts = Vec::with_capacity(counts.len());
        let mut stack = vec![(root, 0)];
        while let Some((subtree, place)) = stack.pop() {
            let Some([first, second]) = self.children(subtree) else {
                grafts.push(place);
                continue;
            };
            let of_first = count(first);
            let node = Node {
                first: of_first as u32,
                size: self.size(subtree),
            };
            put(place, node);
            stack.push((second, place + of_first));
            stack.push((first, place + 1));
        }
        grafts
    }

    /// Returns the top tree, whose leaves are subtrees of this one.
    ///
    /// - `leaves`: runs of the subtrees, which together contain all particles.
    pub(super) fn above(&self, leaves: &[Range<usize>]) -> Self {
        let mut nodes = Vec::with_capacity(leaves.len().saturating_sub(1));
        let mut stack: Vec<Subtree> = self.root().into_iter().collect();
        let mut next = leaves;
        while let Some(subtree) = stack.pop() {
            if next.first() == Some(&subtree.run()) {
                next = &next[1..];
                continue;
            }
            let Some([first, second]) = self.children(subtree) else {
                continue;
            };
            nodes.push(Node {
                first: next.partition_point(|leaf| leaf.start < second.start as usize) as u32,
                size: self.size(subtree),
            });
            stack.push(second);
            stack.push(first);
        }
        Self {
            nodes,
            count: leaves.len() as u32,
            unit: self.unit,
        }
    }

    /// Replaces each leaf of this tree by a tree of its own.
    ///
    /// - `parts`: these trees, in the order of the leaves.
    pub(super) fn grafted(&self, parts: &[Self]) -> Self {
        let counts: Vec<usize> = parts.iter().map(|part| part.count as usize).collect();
        let count: usize = counts.iter().sum();
        let mut nodes = vec![Node::default(); count.saturating_sub(1)];
        if let Some(root) = self.root() {
            let grafts = self.graft(root, &counts, |i, node| nodes[i] = node);
            for (part, place) in parts.iter().zip(grafts) {
                nodes[place..place + part.nodes.len()].copy_from_slice(&part.nodes);
            }
        }
        Self {
            nodes,
            count: count as u32,
            unit: self.unit,
        }
    }

    /// Nodes, from which [`Self::of_nodes`] makes the tree again.
    pub(super) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Makes a tree of nodes whose boxes are in the units of this tree.
    pub(super) fn of_nodes(&self, nodes: Vec<Node>) -> Self {
        Self {
            count: nodes.len() as u32 + 1,
            nodes,
            unit: self.unit,
        }
    }

    /// Number of particles.
    pub(super) fn len(&self) -> usize {
        self.count as usize
    }

    /// Whether it has no particles.
    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns the whole tree as a subtree; `None` if there are no particles.
    fn root(&self) -> Option<Subtree> {
        (self.count > 0).then_some(Subtree {
            start: 0,
            count: self.count,
            node: 0,
        })
    }

    fn node(&self, of: Subtree) -> Option<&Node> {
        let node = of.node as usize;
        (of.count > 1).then(|| &self.nodes[node])
    }

    /// Returns the two parts of a subtree; `None` for a single particle.
    fn children(&self, of: Subtree) -> Option<[Subtree; 2]> {
        let first = self.node(of)?.first;
        Some([
            Subtree {
                start: of.start,
                count: first,
                node: of.node + 1,
            },
            Subtree {
                start: of.start + first,
                count: of.count - first,
                node: of.node + first,
            },
        ])
    }

    /// Squared diagonal of its box.
    fn size(&self, of: Subtree) -> f32 {
        self.node(of).map_or(0.0, |node| node.size)
    }

    /// Calls `each(run, diagonal)` for the root, and for the children of each subtree for which it returns true, in
    /// block order. `diagonal` is a lower bound on the diagonal of the subtree's box, world units.
    pub(super) fn visit(&self, mut each: impl FnMut(Range<usize>, f64) -> bool) {
        let mut stack: Vec<Subtree> = self.root().into_iter().collect();
        while let Some(subtree) = stack.pop() {
            let size = f64::from(self.size(subtree));
            let diagonal = (size.sqrt() - SLACK).max(0.0) * self.unit;
            if each(subtree.run(), diagonal) {
                stack.extend(self.children(subtree).into_iter().flatten().rev());
            }
        }
    }

    /// Returns the largest subtrees with at most `capacity` particles, in block order.
    pub(super) fn subtrees(&self, capacity: usize) -> Vec<Subtree> {
        self.largest(|run| run.len() <= capacity)
    }

    /// Returns the largest subtrees that are small enough or single particles, in block order.
    ///
    /// - `is_small`: whether a run of block order is small enough.
    pub(super) fn largest(&self, is_small: impl Fn(Range<usize>) -> bool) -> Vec<Subtree> {
        let mut found = Vec::new();
        let mut stack: Vec<Subtree> = self.root().into_iter().collect();
        while let Some(subtree) = stack.pop() {
            match self.children(subtree) {
                Some(children) if !is_small(subtree.run()) => {
                    stack.extend(children.into_iter().rev());
                }
                _ => found.push(subtree),
            }
        }
        found
    }

    /// Cuts a subtree into at most `count` subtrees. Always cuts the one with the widest box, so that the errors of
    /// merging are even.
    pub(super) fn clusters(&self, subtree: Subtree, count: usize) -> Vec<Subtree> {
        let widest = |subtree| Widest {
            size: self.size(subtree),
            subtree,
        };
        let mut heap = BinaryHeap::from([widest(subtree)]);
        let mut leaves = Vec::new();
        while heap.len() + leaves.len() < count {
            let Some(Widest { subtree, .. }) = heap.pop() else {
                break;
            };
            match self.children(subtree) {
                Some(children) => heap.extend(children.map(widest)),
                None => leaves.push(subtree),
            }
        }
        leaves.extend(heap.into_iter().map(|w| w.subtree));
        leaves.sort_unstable_by_key(|subtree| subtree.start);
        leaves
    }
}

/// Units of boxes: obvhs works in f32.
#[derive(Debug, Clone, Copy)]
pub(super) struct Units {
    /// Origin of the units, so that a far origin costs no bits.
    middle: DVec3,
    scale: f64,
}

impl Units {
    /// Chooses units for points in a box.
    pub(super) fn of(lower: DVec3, upper: DVec3) -> Self {
        Self {
            middle: (lower + upper) / 2.0,
            // Unit size, so that areas neither overflow nor vanish at the scale of some scenes.
            scale: 1.0 / (upper - lower).max_element().max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the box of a point.
    pub(super) fn point(self, position: DVec3, number: u32) -> Aabb {
        let p = (position - self.middle) * self.scale;
        Aabb::from_point(Vec3A::from(p.as_vec3()) + jitter(number))
    }

    /// World units in one of these.
    fn unit(self) -> f64 {
        1.0 / self.scale
    }
}

/// Returns a displacement of up to a millionth of the whole. PLOC merges mutual nearest neighbours, and among points in
/// one place only one pair per pass is mutual. That is quadratic: 20 s for 1e5 points.
fn jitter(i: u32) -> Vec3A {
    let bits = u64::from(i).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let axis = |shift: u32| (bits >> shift & 0xffff) as f32 / 65_536.0 - 0.5;
    Vec3A::new(axis(16), axis(32), axis(48)) * 2e-6
}

fn bounds<'a>(points: impl ParallelIterator<Item = &'a DVec3>) -> (DVec3, DVec3) {
    let none = || (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points
        .fold(none, |(lower, upper), p| (lower.min(*p), upper.max(*p)))
        .reduce(none, |a, b| (a.0.min(b.0), a.1.max(b.1)))
}

fn ploc(builder: &mut PlocBuilder, boxes: &[Aabb]) -> Bvh2 {
    let (distance, sorted) = (PlocSearchDistance::Minimum, SortPrecision::U64);
    builder.build(
        distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        sorted,
        0,
    )
}

/// Puts the nodes of a BVH into depth-first order; returns the order of its primitives.
fn lay_out(bvh: &Bvh2, nodes: &mut [Node]) -> Vec<u32> {
    let primitive = |i: usize| bvh.primitive_indices[bvh.nodes[i].first_index as usize];
    // Children come after their parents.
    let mut counts = vec![1; bvh.nodes.len()];
    for i in (0..bvh.nodes.len()).rev() {
        let node = &bvh.nodes[i];
        if !node.is_leaf() {
            let child = node.first_index as usize;
            counts[i] = counts[child] + counts[child + 1];
        }
    }
    let mut order = Vec::with_capacity(nodes.len() + 1);
    let mut stack = vec![(0, 0)];
    while let Some((i, place)) = stack.pop() {
        let node = &bvh.nodes[i];
        if node.is_leaf() {
            order.push(primitive(i));
            continue;
        }
        let child = node.first_index as usize;
        let first = counts[child];
        nodes[place] = Node {
            first: first as u32,
            size: (node.aabb().max - node.aabb().min).length_squared(),
        };
        stack.push((child + 1, place + first));
        stack.push((child, place + 1));
    }
    order
}

/// Returns the indices of the points in the order of chunks, and the chunks. These are cells of an octree, or halves
/// and quarters of cells. They hold at most [`CHUNK`] points unless all of a chunk's points lie in one place.
fn chunks(positions: &[DVec3]) -> (Vec<u32>, Vec<Range<usize>>) {
    // The cell on Morton's curve in the upper half, the point's index in the lower half.
    let mut keys: Vec<u64> = (0..positions.len() as u64).collect();
    let mut chunks = Vec::new();
    let mut rest: Vec<Range<usize>> = std::iter::once(0..keys.len()).collect();
    while let Some(run) = rest.pop() {
        if run.len() <= CHUNK {
            chunks.push(run);
            continue;
        }
        let members = &mut keys[run.clone()];
        place(members, positions);
        if members[0] >> 32 == members[members.len() - 1] >> 32 {
            chunks.push(run);
            continue;
        }
        // Parts in one cell are sorted again, in their own bounds.
        let mut parts = vec![(run, 64_u32)];
        while let Some((part, bit)) = parts.pop() {
            if part.len() <= CHUNK || bit == 32 {
                rest.push(part);
                continue;
            }
            let members = &keys[part.clone()];
            let half = members.partition_point(|key| key >> (bit - 1) & 1 == 0);
            let middle = part.start + half;
            let halves = [middle..part.end, part.start..middle];
            parts.extend(
                halves
                    .into_iter()
                    .filter(|h| !h.is_empty())
                    .map(|h| (h, bit - 1)),
            );
        }
    }
    (keys.into_par_iter().map(|key| key as u32).collect(), chunks)
}

/// Sorts points, given by the low halves of `keys`, along Morton's curve through their bounds.
fn place(keys: &mut [u64], positions: &[DVec3]) {
    /// Mask of a point's index.
    const NUMBER: u64 = u32::MAX as u64;
    let at = |key: u64| &positions[(key & NUMBER) as usize];
    let (lower, upper) = bounds(keys.par_iter().map(|&key| at(key)));
    let curve = Curve::through(lower, upper);
    keys.par_iter_mut()
        .for_each(|key| *key = u64::from(curve.cell(*at(*key))) << 32 | (*key & NUMBER));
    keys.radix_sort_unstable();
}

/// Morton's curve through the 2^32 cells of a cube: 2^11, 2^11 and 2^10 along the axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curve {
    lower: DVec3,
    /// Half the edge of the cube.
    half: f64,
}

impl Curve {
    pub(super) fn through(lower: DVec3, upper: DVec3) -> Self {
        // Halved first, because the extent itself may overflow.
        let half = (upper / 2.0 - lower / 2.0).max_element();
        Self {
            lower,
            half: half.max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the number of a point's cell along the curve.
    pub(super) fn cell(&self, point: DVec3) -> u32 {
        // 1 would be beyond the last cell.
        let unit = (point / 2.0 - self.lower / 2.0) / self.half * (1.0 - f64::EPSILON);
        // The upper 32 of 63 bits.
        (morton_encode_u64_unorm(unit) >> 31) as u32
    }
}

/// A subtree, ordered by size.
#[derive(Debug, Clone, Copy)]
struct Widest {
    size: f32,
    subtree: Subtree,
}

impl PartialEq for Widest {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Widest {}

impl PartialOrd for Widest {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Widest {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_size = self.size.total_cmp(&other.size);
        by_size.then(other.subtree.start.cmp(&self.subtree.start))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a pseudo-random number from 0 to 1.
    fn number(n: usize) -> f64 {
        ((n as f64 * 12.9898).sin() * 43_758.547).fract().abs()
    }

    fn scattered(count: usize) -> Vec<DVec3> {
        let at = |n: usize| DVec3::new(number(3 * n), number(3 * n + 1), number(3 * n + 2));
        (0..count).map(at).collect()
    }

    /// Returns sets of several chunks: scattered points; many in one place; a dense cluster far narrower than a cell,
    /// and a few far away.
    fn sets() -> [Vec<DVec3>; 3] {
        let mut crowd = scattered(3_000);
        crowd.resize(CHUNK + 5_000, DVec3::new(0.3, 0.4, 0.5));
        let mut cluster: Vec<DVec3> = scattered(2 * CHUNK).iter().map(|p| *p * 1e-6).collect();
        cluster.extend(scattered(1_000).iter().map(|p| *p * 1e3 - 7.0));
        [scattered(2 * CHUNK), crowd, cluster]
    }

    #[test]
    fn chunks_are_all_points_and_small_where_these_lie_apart() {
        for (set, positions) in sets().into_iter().enumerate() {
            let (members, chunks) = chunks(&positions);
            let mut sorted = members.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().enumerate().all(|(n, &i)| n == i as usize));
            let mut runs = chunks.clone();
            runs.sort_unstable_by_key(|run| run.start);
            assert!(runs[0].start == 0 && runs[runs.len() - 1].end == members.len());
            assert!(runs.windows(2).all(|w| w[0].end == w[1].start));
            for run in &runs {
                let first = positions[members[run.start] as usize];
                let is_one_place = || {
                    members[run.clone()]
                        .iter()
                        .all(|&i| positions[i as usize] == first)
                };
                assert!(run.len() <= CHUNK || set == 1 && is_one_place());
            }
            // Cells of an octree do not overlap: the volumes of their boxes add up to no more than that of all.
            let volumes = runs.iter().map(|run| {
                let points = members[run.clone()]
                    .par_iter()
                    .map(|&i| &positions[i as usize]);
                let (lower, upper) = bounds(points);
                (upper - lower).element_product()
            });
            let (lower, upper) = bounds(positions.par_iter());
            assert!(volumes.sum::<f64>() <= (upper - lower).element_product() * (1.0 + 1e-9));
        }
    }

    #[test]
    fn subtrees_are_runs_in_boxes_of_their_size() {
        for positions in sets() {
            let (tree, order) = Tree::over(&positions, &[]);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().enumerate().all(|(n, &i)| n == i as usize));
            assert_eq!(tree.nodes.len(), positions.len() - 1);
            let root = tree.root().unwrap();
            assert_eq!(root.run(), 0..positions.len());
            // Every particle is moved by a millionth of the widest extent, either way, and rounded.
            let (lower, upper) = bounds(positions.par_iter());
            let slack = 2.0 * SLACK * (upper - lower).max_element();
            let mut is_met = vec![false; tree.nodes.len()];
            let mut singles = 0;
            let mut stack = vec![root];
            while let Some(subtree) = stack.pop() {
                let Some([first, second]) = tree.children(subtree) else {
                    assert_eq!(subtree.count, 1);
                    singles += 1;
                    continue;
                };
                assert!(!std::mem::replace(&mut is_met[subtree.node as usize], true));
                assert!(first.count > 0 && second.count > 0);
                let (own, a, b) = (subtree.run(), first.run(), second.run());
                assert!(own.start == a.start && a.end == b.start && b.end == own.end);
                if subtree.node % 97 == 0 {
                    let members = order[own].par_iter().map(|&i| &positions[i as usize]);
                    let (lower, upper) = bounds(members);
                    let size = f64::from(tree.size(subtree)).sqrt() * tree.unit;
                    assert!(((upper - lower).length() - size).abs() <= slack);
                }
                stack.extend([first, second]);
            }
            assert!(singles == positions.len() && is_met.into_iter().all(|met| met));
        }
    }

    #[test]
    fn trees_do_not_depend_on_threads() {
        let [positions, ..] = sets();
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let (tree, order) = pool.unwrap().install(|| Tree::over(&positions, &[]));
            (tree.nodes, order)
        };
        let one = with(1);
        assert!([2, 5].into_iter().all(|threads| with(threads) == one));
    }
}
