//! Finds faces inside a mesh that do not match one to one.
//!
//! A face that belongs to one cell alone is on the boundary if nothing lies on its other side. At hanging
//! nodes, diagonals that differ, tied interfaces and pieces with separate nodes, other cells lie there, behind
//! faces of their own. Each corner's part of a face is probed at [`ACROSS`]² places. A place is covered if a
//! face of another cell, with the opposite normal, lies within [`GAP`] of it along the normal.

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use crate::parallel;
use crate::sample::positions::index_u32;

/// Greatest gap between two faces of one interface, as a share of the larger face's size. The chords of a
/// circle of 16 cells lie that far from the circle, and kernels of that size show no such gap.
const GAP: f64 = 0.05;

/// Greatest gap as a share of the distance from a face to the middle of its cell, so that a thin cell does not
/// count as a gap.
const GAP_OF_DEPTH: f64 = 0.5;

/// Greatest cosine between the outward normals of two faces of one interface. It is -1 for parallel faces, and
/// greater for chords of one curve.
const OPPOSED: f64 = -0.5;

/// Number of probed places across a corner's part of a face, in each direction.
const ACROSS: usize = 3;

/// Tolerance by which a place may lie outside a triangle, as a share of it: positions on interfaces are
/// rounded.
const SLACK: f64 = 1e-3;

/// Tolerance between corners and middles of two coinciding faces, as a share of their size.
const SAME: f64 = 1e-3;

/// Greatest number of faces searched for one place. Meshes that fold over themselves exceed it: the place is
/// then undecided.
const MOST: usize = 256;

/// Greatest number of faces in the box of a face for which it is still probed place by place.
const MOST_NEAR: usize = 16 * MOST;

/// Share of the whole mesh by which boxes grow: obvhs works in f32, and faces at one place are moved apart.
const ROUNDING: f64 = 4e-6;

/// A face that belongs to one cell alone.
pub(in crate::sample) struct OuterFace {
    pub(in crate::sample) cell: u32,
    pub(in crate::sample) nodes: Vec<u32>,
    /// Normal into the cell, as long as the face's area.
    pub(in crate::sample) normal: DVec3,
    pub(in crate::sample) middle: DVec3,
    /// Distance from the face to the middle of its cell.
    pub(in crate::sample) depth: f64,
}

/// State of the far side of a face, in the part of one of its corners.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::sample) enum Side {
    /// Nothing lies there.
    Open,
    /// Other cells lie there.
    Covered,
    /// Other cells lie there, behind a face that is open elsewhere.
    Rim,
    /// Other cells lie behind a part of it, or the search was undecided.
    Partly,
}

/// Returns the sides at the corners of each face, in the order of its nodes; `None` for a face that is open
/// everywhere.
pub(in crate::sample) fn sides(nodes: &[DVec3], faces: &[OuterFace]) -> Vec<Option<Vec<Side>>> {
    let Some(index) = FaceIndex::new(nodes, faces) else {
        return (0..faces.len()).map(|_| None).collect();
    };
    let found: Vec<Option<Probed>> = (0..faces.len())
        .into_par_iter()
        .map(|face| index.probed(face))
        .collect();
    let is_covered = |&face: &u32| {
        let probed = found[face as usize].as_ref();
        probed.is_some_and(|probed| probed.sides.iter().all(|side| *side == Side::Covered))
    };
    let with_rims = |probed: &Option<Probed>| {
        let probed = probed.as_ref()?;
        let is_inner = probed.behind.iter().all(is_covered);
        let side = |side: &Side| match side {
            Side::Covered if !is_inner => Side::Rim,
            other => *other,
        };
        Some(probed.sides.iter().map(side).collect())
    };
    parallel::map(found.len(), |i| with_rims(&found[i]))
}

/// A face with other faces near its far side.
struct Probed {
    sides: Vec<Side>,
    /// The faces that cover this one.
    behind: Vec<u32>,
}

/// Bounding volume hierarchy of the faces.
struct FaceIndex<'a> {
    nodes: &'a [DVec3],
    faces: &'a [OuterFace],
    bvh: Bvh2,
    units: Units,
}

/// Scale of the boxes: the mesh has unit size in them, so that f32 neither overflows nor underflows.
#[derive(Clone, Copy)]
struct Units {
    middle: DVec3,
    widest: f64,
}

impl Units {
    fn boxed(self, low: DVec3, high: DVec3, margin: f64) -> Aabb {
        let corner = |v: DVec3| Vec3A::from(((v - self.middle) / self.widest).as_vec3());
        let margin = DVec3::splat(margin + ROUNDING * self.widest);
        Aabb::new(corner(low - margin), corner(high + margin))
    }
}

/// Returns the vector of a polygon's area: half the sum of cross products around a point. Seen from its tip,
/// corners run anticlockwise.
fn area(corners: &[u32], place: impl Fn(u32) -> DVec3, middle: DVec3) -> DVec3 {
    let turned = (0..corners.len()).map(|i| {
        let (p, q) = (place(corners[i]), place(corners[(i + 1) % corners.len()]));
        (p - middle).cross(q - middle)
    });
    turned.sum::<DVec3>() * 0.5
}

/// Returns the mean of places.
pub(in crate::sample) fn middle_of(nodes: &[u32], place: impl Fn(u32) -> DVec3) -> DVec3 {
    nodes.iter().map(|&n| place(n)).sum::<DVec3>() / nodes.len().max(1) as f64
}

impl OuterFace {
    /// Makes a face of a cell; returns `None` for a face without an area, or one that is not finite.
    ///
    /// - `nodes`: corners of the face, in order around it.
    /// - `place`: position of a node.
    /// - `inner`: middle of the cell.
    pub(in crate::sample) fn new(
        cell: u32,
        nodes: &[u32],
        place: impl Fn(u32) -> DVec3,
        inner: DVec3,
    ) -> Option<Self> {
        let middle = middle_of(nodes, &place);
        let area = area(nodes, &place, middle);
        let normal = area * area.dot(inner - middle).signum();
        let is_sound = normal.is_finite() && normal.length() > 0.0;
        is_sound.then(|| Self {
            cell,
            nodes: nodes.to_vec(),
            normal,
            middle,
            depth: normal.normalize_or_zero().dot(inner - middle),
        })
    }

    /// Reverses the corners if they run clockwise, seen from outside the cell.
    pub(in crate::sample) fn turn_outwards(&mut self, place: impl Fn(u32) -> DVec3) {
        if area(&self.nodes, place, self.middle).dot(self.normal) > 0.0 {
            self.nodes.reverse();
        }
    }

    fn size(&self) -> f64 {
        self.normal.length().sqrt()
    }

    /// Distance within which others count as lying on the face.
    fn gap(&self) -> f64 {
        (GAP * self.size()).min(GAP_OF_DEPTH * self.depth)
    }

    /// Unit normal out of the cell.
    fn outward(&self) -> DVec3 {
        -self.normal.normalize_or_zero()
    }
}

impl<'a> FaceIndex<'a> {
    /// Returns `None` for fewer than two faces, or if they have no extent.
    fn new(nodes: &'a [DVec3], faces: &'a [OuterFace]) -> Option<Self> {
        let of_face = |face: &OuterFace| {
            let places = face.nodes.iter().map(|&n| nodes[n as usize]);
            let (low, high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            places.fold((low, high), |(low, high), p| (low.min(p), high.max(p)))
        };
        let all = faces.par_iter().map(of_face);
        let none = || (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = all.reduce(none, |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let widest = (high - low).max_element();
        if faces.len() < 2 || !(widest > 0.0 && widest.is_finite()) {
            return None;
        }
        let units = Units {
            middle: (low + high) / 2.0,
            widest,
        };
        let boxed = |(number, face): (usize, &OuterFace)| {
            let (low, high) = of_face(face);
            let moved = moved(number) * widest;
            units.boxed(low + moved, high + moved, face.gap())
        };
        let boxes: Vec<Aabb> = faces.par_iter().enumerate().map(boxed).collect();
        let bvh = PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Minimum,
            &boxes,
            (0..index_u32(boxes.len())).collect(),
            SortPrecision::U64,
            0,
        );
        Some(Self {
            nodes,
            faces,
            bvh,
            units,
        })
    }

    /// Calls `visit` for the faces in a box until it returns false.
    fn within(&self, low: DVec3, high: DVec3, mut visit: impl FnMut(u32) -> bool) {
        let around = self.units.boxed(low, high, 0.0);
        self.bvh.aabb_traverse(around, |bvh, node| {
            let node = &bvh.nodes[node as usize];
            let first = node.first_index as usize;
            let mut members = bvh.primitive_indices[first..first + node.prim_count as usize].iter();
            members.all(|&face| visit(face))
        });
    }

    fn corner(&self, face: &OuterFace, i: usize) -> DVec3 {
        self.nodes[face.nodes[i % face.nodes.len()] as usize]
    }

    /// Returns the sides of a face; `None` if no other face is near.
    fn probed(&self, number: usize) -> Option<Probed> {
        let face = &self.faces[number];
        let (outward, gap) = (face.outward(), face.gap());
        let places = || (0..face.nodes.len()).map(|i| self.corner(face, i));
        let low = places().fold(DVec3::INFINITY, DVec3::min) - gap;
        let high = places().fold(DVec3::NEG_INFINITY, DVec3::max) + gap;
        let (mut is_near, mut same, mut count) = (false, None, 0);
        self.within(low, high, |other| {
            if self.may_cover(face, outward, other) {
                is_near = true;
                if self.is_same(face, &self.faces[other as usize]) {
                    same = Some(other);
                }
            }
            count += 1;
            is_near |= count > MOST_NEAR;
            same.is_none() && !(is_near && count > MOST)
        });
        if let Some(other) = same {
            return Some(Probed {
                sides: vec![Side::Covered; face.nodes.len()],
                behind: vec![other],
            });
        }
        if !is_near {
            return None;
        }
        let mut behind = Vec::new();
        let corners = 0..face.nodes.len();
        let sides: Vec<Side> = corners
            .map(|i| self.side(face, outward, i, &mut behind))
            .collect();
        behind.sort_unstable();
        behind.dedup();
        let is_open = sides.iter().all(|side| *side == Side::Open);
        (!is_open).then_some(Probed { sides, behind })
    }

    fn may_cover(&self, face: &OuterFace, outward: DVec3, other: u32) -> bool {
        let other = &self.faces[other as usize];
        other.cell != face.cell && other.outward().dot(outward) < OPPOSED
    }

    /// Returns true if two faces have the same corners up to rounding.
    fn is_same(&self, face: &OuterFace, other: &OuterFace) -> bool {
        let slack = SAME * face.size();
        let count = face.nodes.len();
        let is_corner = |i: usize| {
            let at = self.corner(face, i);
            (0..count).any(|j| self.corner(other, j).distance(at) <= slack)
        };
        other.nodes.len() == count
            && face.middle.distance(other.middle) <= slack
            && (0..count).all(is_corner)
    }

    /// Returns the side at one corner's part of a face, and adds the covering faces to `behind`.
    fn side(&self, face: &OuterFace, outward: DVec3, i: usize, behind: &mut Vec<u32>) -> Side {
        let own = self.corner(face, i);
        let next = own.midpoint(self.corner(face, i + 1));
        let before = own.midpoint(self.corner(face, i + face.nodes.len() - 1));
        let mut covered = 0;
        for m in 0..ACROSS * ACROSS {
            // Places on no diagonal, and at no fraction at which meshes are usually divided.
            let u = ((m % ACROSS) as f64 + 0.537) / ACROSS as f64;
            let v = ((m / ACROSS) as f64 + 0.471) / ACROSS as f64;
            let across = own.lerp(next, u);
            let place = across.lerp(before.lerp(face.middle, u), v);
            match self.behind(face, outward, place) {
                Some(Some(other)) => {
                    behind.push(other);
                    covered += 1;
                }
                Some(None) => {}
                None => return Side::Partly,
            }
        }
        match covered {
            0 => Side::Open,
            n if n == ACROSS * ACROSS => Side::Covered,
            _ => Side::Partly,
        }
    }

    /// Returns the face behind a place of a face, if there is one; `None` if too many faces are near to decide.
    fn behind(&self, face: &OuterFace, outward: DVec3, place: DVec3) -> Option<Option<u32>> {
        let reach = outward * face.gap();
        let (mut found, mut count) = (None, 0);
        let [low, high] = [
            (place - reach).min(place + reach),
            (place - reach).max(place + reach),
        ];
        self.within(low, high, |other| {
            count += 1;
            if self.may_cover(face, outward, other) {
                let of_other = &self.faces[other as usize];
                let out = face.gap().max(of_other.gap());
                // Inside the cells, search no deeper than their thickness allows.
                let thin = GAP_OF_DEPTH * face.depth.min(of_other.depth);
                if self.meets(of_other, place, outward, [-out.min(thin), out]) {
                    found = Some(other);
                }
            }
            found.is_none() && count < MOST
        });
        (found.is_some() || count < MOST).then_some(found)
    }

    /// Returns true if a line through a place meets a face within an interval of distances.
    fn meets(
        &self,
        face: &OuterFace,
        place: DVec3,
        direction: DVec3,
        [from, to]: [f64; 2],
    ) -> bool {
        (0..face.nodes.len()).any(|i| {
            let (a, b) = (self.corner(face, i), self.corner(face, i + 1));
            let (u, v) = (a - face.middle, b - face.middle);
            let normal = u.cross(v);
            let along = (face.middle - place).dot(normal) / normal.dot(direction);
            // Phrased so that NaN, from triangles seen edge-on, fails.
            if !(along >= from && along <= to) {
                return false;
            }
            let at = place + direction * along - face.middle;
            let area = normal.length_squared();
            let p = at.cross(v).dot(normal) / area;
            let q = u.cross(at).dot(normal) / area;
            p >= -SLACK && q >= -SLACK && p + q <= 1.0 + SLACK
        })
    }
}

/// Returns a displacement of at most a millionth of the whole: PLOC takes quadratic time for boxes at one
/// place.
fn moved(number: usize) -> DVec3 {
    let bits = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let axis = |shift: u32| (bits >> shift & 0xffff) as f64 / 65_536.0 - 0.5;
    DVec3::new(axis(16), axis(32), axis(48)) * 2e-6
}
