//! Chooses how far the bodies of a mesh are refined.
//!
//! **Values at nodes**: the linear model of a node is its value and its mean gradient, by volume, of the pieces of its
//! cells. It misses most of the interpolant at the corners of these pieces: the middles of edges, faces and cells. The
//! level follows from that by [`Rule`], as on grids. Where the surface bends away from its tangent planes, that asks
//! for parts, too.
//!
//! **Values of cells** jump at faces, and a kernel blurs a jump over its own deviation: that has to be less than the
//! threshold, unless the function hardly changes from one side to the other.

use glam::{DMat3, DVec3, DVec4, Vec4Swizzles as _};

use super::pieces::Piece;
use super::sharp::{DrawnCells, SAME_PLANE, Surface};
use crate::sample::field::gradient::SPANNING;
use crate::sample::refine::rule::{Rule, least_level};

/// Greatest level of a dual cell: its pieces fall into 4³ parts.
const MOST_LEVEL: u8 = 3;

/// Greatest level that nodes of tetrahedra ask for. Fields are linear in tetrahedra, and their pieces are a third as
/// wide as dual cells already. On a reactor cut into 44,832 of them further levels took three times as long to read,
/// for an error of 2.2 levels of 255 at best and 3.2 at worst; this one leaves 2.3 of 3.6.
const MOST_LEVEL_OF_TETRAHEDRA: u8 = 1;

/// Greatest level of cells with one value. On a warped grid of 24³ cells a third one leaves 1.4 levels of 255 instead of
/// 2.5, for seven times the kernels.
pub(super) const MOST_LEVEL_OF_CELLS: u8 = 2;

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
    /// Its pieces, each with the range of values in its cell.
    pub(super) pieces: Vec<(Piece, [f64; 2])>,
    /// Tetrahedra that take the place of their pieces where only a level is asked for, because fields are linear in
    /// them: offsets and differences of the value from the body's own corner to the others.
    pub(super) tetrahedra: Vec<[DVec4; 3]>,
}

/// Returns the gradient of a field in a tetrahedron, and the volume of one of its pieces; `None` if it is flat.
fn in_tetrahedron([a, b, c]: &[DVec4; 3]) -> Option<(DVec3, f64)> {
    let jacobian = DMat3::from_cols(a.xyz(), b.xyz(), c.xyz());
    let determinant = jacobian.determinant();
    let lengths = a.xyz().length() * b.xyz().length() * c.xyz().length();
    // Phrased so that NaN counts as flat.
    let spans = determinant.abs() > SPANNING * lengths;
    spans.then(|| {
        let rises = DVec3::new(a.w, b.w, c.w);
        let gradient = jacobian.inverse().transpose() * rises;
        (gradient, determinant.abs() / 24.0)
    })
}

/// Returns the greatest part of the values at the vertices of a tetrahedron's piece that a gradient misses: the middles
/// of its edges, of its faces, and its own.
///
/// - `missed`: returns the signed part that is missed at a corner.
fn missed_in(corners: &[DVec4; 3], missed: impl Fn(&DVec4) -> f64) -> f64 {
    let [a, b, c] = corners.each_ref().map(missed);
    let edges = a.abs().max(b.abs()).max(c.abs()) / 2.0;
    let faces = (a + b).abs().max((a + c).abs()).max((b + c).abs()) / 3.0;
    edges.max(faces).max((a + b + c).abs() / 4.0)
}

/// No values.
pub(super) const NONE: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

pub(super) fn joined(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Body {
    fn pieces(&self) -> impl Iterator<Item = &Piece> {
        self.pieces.iter().map(|(piece, _)| piece)
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
        for (gradient, own) in self.tetrahedra.iter().filter_map(in_tetrahedron) {
            sum += gradient * own;
            volume += own;
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
        let of_pieces = vertices.map(missed).fold(0.0, f64::max);
        let missed = |v: &DVec4| v.w - gradient.dot(v.xyz());
        let of_tetrahedra = self.tetrahedra.iter().map(|own| missed_in(own, missed));
        let missed = of_tetrahedra.fold(of_pieces, f64::max);
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
