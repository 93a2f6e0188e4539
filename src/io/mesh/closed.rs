//! Finds the surfaces that enclose a volume. They need to be drawn from outside only.

use std::collections::HashMap;

use glam::DVec3;

use crate::data::mesh::MeshPart;

/// Returns for each part whether all its components are closed and oriented outwards.
///
/// Corners at the same position are merged. A connected component may run through several parts. It is closed if each
/// of its edges has two triangles that pass it in opposite directions. It is oriented outwards if it encloses a
/// positive volume. Triangles with a corner that is not finite are skipped.
pub(crate) fn are_closed(parts: &[MeshPart]) -> Vec<bool> {
    let mut vertices: HashMap<[u64; 3], u32> = HashMap::new();
    let mut places: Vec<DVec3> = Vec::new();
    let mut triangles: Vec<(usize, [u32; 3])> = Vec::new();
    for (p, part) in parts.iter().enumerate() {
        let welded: Vec<u32> = part
            .positions
            .iter()
            .map(|&position| {
                // Adding zero turns -0 into +0, so both are one position.
                let key = (position + DVec3::ZERO).to_array().map(f64::to_bits);
                let next = u32::try_from(places.len()).unwrap_or(u32::MAX);
                *vertices.entry(key).or_insert_with(|| {
                    places.push(position);
                    next
                })
            })
            .collect();
        for triangle in &part.triangles {
            let [a, b, c] = triangle.map(|i| welded[i as usize]);
            let is_finite = triangle
                .iter()
                .all(|&i| part.positions[i as usize].is_finite());
            // A triangle with two equal corners closes nothing and opens nothing.
            if is_finite && a != b && b != c && c != a {
                triangles.push((p, [a, b, c]));
            }
        }
    }
    drop(vertices);

    let mut components = Components::new(places.len());
    let mut edges: Vec<([u32; 2], bool)> = Vec::with_capacity(3 * triangles.len());
    for &(_, [a, b, c]) in &triangles {
        components.join(a, b);
        components.join(b, c);
        for [from, to] in [[a, b], [b, c], [c, a]] {
            edges.push(([from.min(to), from.max(to)], from < to));
        }
    }
    edges.sort_unstable();
    let mut is_open = vec![false; places.len()];
    for edge in edges.chunk_by(|a, b| a.0 == b.0) {
        if !matches!(edge, [(_, false), (_, true)]) {
            is_open[components.root(edge[0].0[0]) as usize] = true;
        }
    }
    // Six times the volume, measured from a corner of the component.
    let mut volumes = vec![0.0; places.len()];
    for &(_, triangle) in &triangles {
        let root = components.root(triangle[0]) as usize;
        let [a, b, c] = triangle.map(|i| places[i as usize] - places[root]);
        volumes[root] += a.dot(b.cross(c));
    }
    let mut are_closed = vec![true; parts.len()];
    for &(part, triangle) in &triangles {
        let root = components.root(triangle[0]) as usize;
        are_closed[part] &= !is_open[root] && volumes[root] > 0.0;
    }
    are_closed
}

/// Disjoint sets of vertices.
struct Components {
    parents: Vec<u32>,
}

impl Components {
    fn new(count: usize) -> Self {
        Self {
            parents: (0..count)
                .map(|i| u32::try_from(i).unwrap_or(u32::MAX))
                .collect(),
        }
    }

    fn root(&mut self, mut vertex: u32) -> u32 {
        loop {
            let parent = self.parents[vertex as usize];
            if parent == vertex {
                return vertex;
            }
            // Halving the path keeps later searches short.
            let above = self.parents[parent as usize];
            self.parents[vertex as usize] = above;
            vertex = above;
        }
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [self.root(a), self.root(b)];
        self.parents[a.max(b) as usize] = a.min(b);
    }
}
