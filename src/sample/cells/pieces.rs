//! Cuts cells into pieces: the part of a cell nearest to one of its corners, a hexahedron in the cell's parameters.
//!
//! A corner at which three faces meet has one piece. Its corners are those of a cube: the cell's corner, the middles
//! of its edges and faces there, and the cell's middle. Within a piece position and value are trilinear. So they are
//! in hexahedra, wedges and tetrahedra themselves, and the pieces follow their interpolants exactly. A pyramid is a
//! hexahedron whose upper face has collapsed; the piece of its apex is that upper half. Polyhedra and prisms have the
//! means of their corners in their middles; a corner of more than three faces has a piece per face, which ends in the
//! cell's middle.
//!
//! A piece falls into equal parts of its parameters. Their volumes, centroids and covariances come from two Gauss
//! points along each parameter: volumes are exact, and the covariance of a parallelepiped is.

use glam::{DMat3, DVec3, DVec4, Vec4Swizzles as _};

use crate::data::cells::{CellKind, CellMesh};
use crate::data::polyhedron::polyhedron_faces;
use crate::sample::field::gradient::SPANNING;
use crate::sample::points::neighbours::square;

/// Distance of a Gauss point from the middle, in half parts: 1/sqrt 3.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// A piece of a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    /// Position and value at its corners, the first parameter fastest; the cell's corner comes first, unless the
    /// piece is a pyramid's apex.
    vertices: [DVec4; 8],
    /// Signed volume.
    volume: f64,
}

/// A part of a piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct PieceShape {
    pub(super) volume: f64,
    /// Position and value at the centroid.
    pub(super) place: DVec4,
    /// Covariance of the body: xx, xy, xz, yy, yz, zz.
    pub(super) covariance: [f64; 6],
    /// Gradient of the interpolant in the middle.
    pub(super) gradient: DVec3,
}

/// Cell with the places of its corners. One serves many cells, which saves allocations.
#[derive(Default)]
pub(super) struct Corners {
    /// Numbers of the corners' nodes.
    nodes: Vec<u32>,
    /// Corners of the faces, one face after the other.
    of_faces: Vec<usize>,
    /// End of each face in `of_faces`.
    face_ends: Vec<usize>,
    places: Vec<DVec4>,
    is_pyramid: bool,
}

impl Corners {
    /// Takes a cell; returns `None` if a corner has no place.
    ///
    /// - `at`: returns position and value of a node.
    fn take(
        &mut self,
        mesh: &CellMesh,
        cell: usize,
        at: impl Fn(u32) -> Option<DVec4>,
    ) -> Option<()> {
        let (kind, entries) = (mesh.kinds[cell], mesh.cell(cell));
        self.nodes.clear();
        self.of_faces.clear();
        self.face_ends.clear();
        match kind.faces() {
            Some(faces) => {
                for face in faces {
                    self.of_faces.extend(face.iter().map(|&i| usize::from(i)));
                    self.face_ends.push(self.of_faces.len());
                }
                let last = self.of_faces.iter().max()?;
                self.nodes.extend(entries.get(..=*last)?);
            }
            None => {
                self.nodes.extend(polyhedron_faces(entries).flatten());
                self.nodes.sort_unstable();
                self.nodes.dedup();
                for face in polyhedron_faces(entries) {
                    let number = |n: &u32| self.nodes.partition_point(|other| other < n);
                    self.of_faces.extend(face.iter().map(number));
                    self.face_ends.push(self.of_faces.len());
                }
            }
        }
        self.places.clear();
        for &n in &self.nodes {
            self.places.push(at(n)?);
        }
        self.is_pyramid = is_pyramid(kind);
        Some(())
    }

    fn faces(&self) -> impl Iterator<Item = &[usize]> {
        let begins = std::iter::once(0).chain(self.face_ends.iter().copied());
        let ends = self.face_ends.iter().copied();
        begins
            .zip(ends)
            .map(|(begin, end)| &self.of_faces[begin..end])
    }

    fn mean(&self, corners: &[usize]) -> DVec4 {
        let sum: DVec4 = corners.iter().map(|&c| self.places[c]).sum();
        sum / corners.len() as f64
    }

    /// Returns the middle of two corners.
    fn edge(&self, a: usize, b: usize) -> DVec4 {
        (self.places[a] + self.places[b]) * 0.5
    }

    /// Returns the middle of a face.
    fn middle(&self, face: &[usize]) -> DVec4 {
        let apex = face.iter().find(|&&c| self.is_pyramid && c == 4);
        match apex {
            // Halfway up a face that has collapsed.
            Some(_) => {
                let base: Vec<usize> = face.iter().copied().filter(|&c| c != 4).collect();
                (self.mean(&base) + self.places[4]) * 0.5
            }
            None => self.mean(face),
        }
    }

    /// Returns the middle of the cell.
    fn centre(&self) -> DVec4 {
        match self.is_pyramid {
            true => (self.mean(&[0, 1, 2, 3]) + self.places[4]) * 0.5,
            false => {
                let sum: DVec4 = self.places.iter().sum();
                sum / self.places.len() as f64
            }
        }
    }

    /// Passes on the pieces at a corner.
    fn pieces_at(&self, corner: usize, mut each: impl FnMut(Piece)) {
        let mut add = |vertices| {
            if let Some(piece) = Piece::new(vertices) {
                each(piece);
            }
        };
        let [own, centre] = [self.places[corner], self.centre()];
        if self.is_pyramid && corner == 4 {
            let [a, b, c, d] = [0, 3, 1, 2].map(|base| self.edge(base, 4));
            add([a, b, c, d, own, own, own, own]);
            return;
        }
        // The corner before and the one after in each face at the corner.
        let mut around: Vec<([usize; 2], DVec4)> = Vec::with_capacity(3);
        for face in self.faces() {
            for i in (0..face.len()).filter(|&i| face[i] == corner) {
                let count = face.len();
                let beside = [face[(i + 1) % count], face[(i + count - 1) % count]];
                around.push((beside, self.middle(face)));
            }
        }
        if let [([a, b], ab), second, third] = around[..] {
            // The other two faces, the one at edge a first.
            let has = |(beside, _): &([usize; 2], DVec4), edge| beside.contains(&edge);
            let [at_a, at_b] = if has(&second, a) {
                [second, third]
            } else {
                [third, second]
            };
            let other =
                |(beside, _): ([usize; 2], DVec4), than| beside[usize::from(beside[0] == than)];
            let c = other(at_a, a);
            if has(&at_a, a) && has(&at_b, b) && c == other(at_b, b) && c != a && c != b {
                let [x, y, z] = [a, b, c].map(|to| self.edge(corner, to));
                add([own, x, y, ab, z, at_a.1, at_b.1, centre]);
                return;
            }
        }
        for ([a, b], middle) in around {
            let [x, y] = [a, b].map(|to| self.edge(corner, to));
            add([own, x, y, middle, centre, centre, centre, centre]);
        }
    }
}

fn is_pyramid(kind: CellKind) -> bool {
    matches!(kind.0, 14 | 27 | 37 | 74 | 81)
}

/// Passes on the pieces of a cell at those of its nodes that are wanted; returns `None` if a corner has no place.
///
/// - `at`: returns position and value of a node.
/// - `corners`: memory for the cell's corners.
pub(super) fn each_piece(
    (mesh, cell): (&CellMesh, usize),
    at: impl Fn(u32) -> Option<DVec4>,
    is_wanted: impl Fn(u32) -> bool,
    corners: &mut Corners,
    mut each: impl FnMut(Piece),
) -> Option<()> {
    corners.take(mesh, cell, at)?;
    for corner in (0..corners.nodes.len()).filter(|&c| is_wanted(corners.nodes[c])) {
        corners.pieces_at(corner, &mut each);
    }
    Some(())
}

impl Piece {
    /// Returns `None` for a piece without volume.
    fn new(vertices: [DVec4; 8]) -> Option<Self> {
        let mut piece = Self {
            vertices,
            volume: 0.0,
        };
        let terms = piece.determinants(&gauss_places([0.0; 3], 1.0));
        piece.volume = terms.iter().sum::<f64>() / 8.0;
        // Phrased so that NaN counts as none.
        (piece.volume.abs() > 0.0 && piece.volume.is_finite()).then_some(piece)
    }

    pub(super) fn vertices(&self) -> &[DVec4; 8] {
        &self.vertices
    }

    /// Returns position and value at a place of the parameters, from 0 to 1 each.
    fn at(&self, at: [f64; 3]) -> DVec4 {
        let [x, y, z] = at.map(|t| [1.0 - t, t]);
        let terms = self.vertices.iter().enumerate();
        terms
            .map(|(n, v)| *v * (x[n & 1] * y[n >> 1 & 1] * z[n >> 2]))
            .sum()
    }

    /// Returns the derivatives of position and value by each parameter. They are bilinear in the other two: the inner array
    /// counts along the next one.
    ///
    /// - `places`: places along each parameter.
    fn slopes<const N: usize>(&self, places: &[[f64; N]; 3]) -> [[[DVec4; N]; N]; 3] {
        let mut slopes = [[[DVec4::ZERO; N]; N]; 3];
        for (a, slopes) in slopes.iter_mut().enumerate() {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            let mut along_b = [[DVec4::ZERO; N]; 2];
            for (at_c, along_b) in along_b.iter_mut().enumerate() {
                let [low, high] = [at_c << c, 1 << b | at_c << c];
                let low = self.vertices[low | 1 << a] - self.vertices[low];
                let high = self.vertices[high | 1 << a] - self.vertices[high];
                for (slope, t) in along_b.iter_mut().zip(&places[b]) {
                    *slope = low + (high - low) * *t;
                }
            }
            for (slopes, t) in slopes.iter_mut().zip(&places[c]) {
                for (n, slope) in slopes.iter_mut().enumerate() {
                    *slope = along_b[0][n] + (along_b[1][n] - along_b[0][n]) * *t;
                }
            }
        }
        slopes
    }

    /// Returns the determinants of the Jacobian at the eight combinations of two places along each parameter, the first
    /// parameter fastest.
    fn determinants(&self, places: &[[f64; 2]; 3]) -> [f64; 8] {
        let slopes = self.slopes(places);
        let mut determinants = [0.0; 8];
        for (n, determinant) in determinants.iter_mut().enumerate() {
            let [i, j, k] = [n & 1, n >> 1 & 1, n >> 2];
            let [x, y, z] = [slopes[0][k][j], slopes[1][i][k], slopes[2][j][i]];
            *determinant = x.xyz().dot(y.xyz().cross(z.xyz()));
        }
        determinants
    }

    /// Returns the volume of the piece.
    pub(super) fn volume(&self) -> f64 {
        self.volume.abs()
    }

    /// Returns the middle of a part of the parameters, of `count`³ parts; the first parameter is fastest.
    pub(super) fn middle(count: usize, n: usize) -> [f64; 3] {
        let places = [n % count, n / count % count, n / (count * count)];
        places.map(|i| (i as f64 + 0.5) / count as f64)
    }

    /// Returns a part of the piece; `None` if it has no volume.
    pub(super) fn part(&self, count: usize, n: usize) -> Option<PieceShape> {
        let middle = Self::middle(count, n);
        let side = 1.0 / count as f64;
        let origin = self.at(middle);
        let (mut weight, mut first, mut second) = (0.0, DVec4::ZERO, [0.0; 6]);
        let places = gauss_places(middle.map(|t| t - 0.5 * side), side);
        for (n, determinant) in self.determinants(&places).into_iter().enumerate() {
            // Where a cell is turned over, it has no volume.
            let own = (determinant * self.volume.signum()).max(0.0);
            let at = std::array::from_fn(|a| places[a][n >> a & 1]);
            let offset = self.at(at) - origin;
            weight += own;
            first += offset * own;
            for (sum, square) in second.iter_mut().zip(square(offset.xyz())) {
                *sum += square * own;
            }
        }
        // Phrased so that NaN counts as no volume.
        if !(weight > 0.0) {
            return None;
        }
        let mean = first / weight;
        let of_mean = square(mean.xyz());
        Some(PieceShape {
            volume: weight / 8.0 * side.powi(3),
            place: origin + mean,
            covariance: std::array::from_fn(|i| second[i] / weight - of_mean[i]),
            gradient: self.gradient(middle)?,
        })
    }

    /// Returns the gradient of the interpolant; `None` where the piece is flat.
    pub(super) fn gradient(&self, at: [f64; 3]) -> Option<DVec3> {
        let [[[x]], [[y]], [[z]]] = self.slopes(&at.map(|t| [t]));
        let jacobian = DMat3::from_cols(x.xyz(), y.xyz(), z.xyz());
        let lengths = x.xyz().length() * y.xyz().length() * z.xyz().length();
        // Phrased so that NaN counts as flat.
        let spans = jacobian.determinant().abs() > SPANNING * lengths;
        let rises = DVec3::new(x.w, y.w, z.w);
        spans.then(|| jacobian.inverse().transpose() * rises)
    }
}

/// Returns the places of the Gauss points of a cube of the parameters along each of them.
fn gauss_places(low: [f64; 3], side: f64) -> [[f64; 2]; 3] {
    low.map(|low| [-GAUSS, GAUSS].map(|from_middle| low + 0.5 * side * (1.0 + from_middle)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEDGE: [DVec3; 6] = [
        DVec3::ZERO,
        DVec3::Y,
        DVec3::X,
        DVec3::new(0.1, 0.0, 1.0),
        DVec3::new(0.0, 1.1, 1.2),
        DVec3::new(1.0, 0.2, 0.9),
    ];

    /// Returns a mesh of one cell, with a field at its nodes.
    fn cell(kind: u8, nodes: &[DVec3], entries: &[i64]) -> CellMesh {
        let list: Vec<i64> = [&[entries.len() as i64], entries].concat();
        CellMesh::of_lists(nodes, &[kind], &list).unwrap()
    }

    fn cube() -> Vec<DVec3> {
        let corner = |n: usize| DVec3::from([0, 1, 2].map(|a| (n >> a & 1) as f64));
        let mut nodes: Vec<DVec3> = (0..8).map(corner).collect();
        nodes[7] += DVec3::new(0.2, 0.1, -0.1);
        nodes[4] -= DVec3::new(0.1, 0.2, 0.1);
        nodes
    }

    /// Cells of every shape, with their volumes.
    fn shapes() -> Vec<(CellMesh, f64)> {
        let unit = cube();
        let pyramid = [0, 1, 3, 2].map(|n| DVec3::from([n & 1, n >> 1, 0].map(f64::from)));
        let pyramid = [&pyramid[..], &[DVec3::new(0.4, 0.5, 2.0)]].concat();
        let faces = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let faces = faces.iter().flat_map(|face| [&[4_i64][..], face].concat());
        let polyhedron: Vec<i64> = std::iter::once(6).chain(faces).collect();
        let of = |mesh: CellMesh| {
            let mut parts = Vec::new();
            let volume = super::super::duals::cut(&mesh, 0, &mut parts).0;
            (mesh, volume.abs())
        };
        vec![
            of(cell(10, &unit, &[0, 1, 2, 4])),
            of(cell(11, &unit, &[0, 1, 2, 3, 4, 5, 6, 7])),
            of(cell(13, &WEDGE, &[0, 1, 2, 3, 4, 5])),
            of(cell(14, &pyramid, &[0, 1, 2, 3, 4])),
            of(cell(42, &unit, &polyhedron)),
        ]
    }

    fn pieces(
        mesh: &CellMesh,
        at: impl Fn(u32) -> Option<DVec4>,
        is_wanted: impl Fn(u32) -> bool,
    ) -> Vec<Piece> {
        let mut all = Vec::new();
        let mut corners = Corners::default();
        each_piece((mesh, 0), at, is_wanted, &mut corners, |piece| {
            all.push(piece)
        })
        .unwrap();
        all
    }

    fn linear(x: DVec3) -> f64 {
        2.0 + x.dot(DVec3::new(1.0, -2.0, 0.5))
    }

    fn of_linear(mesh: &CellMesh) -> Vec<Piece> {
        let at = |n: u32| {
            let x = mesh.nodes[n as usize];
            Some(x.extend(linear(x)))
        };
        pieces(mesh, at, |_| true)
    }

    #[test]
    fn pieces_fill_the_cell() {
        for (mesh, volume) in shapes() {
            let all = of_linear(&mesh);
            let kind = mesh.kinds[0];
            let sum: f64 = all.iter().map(Piece::volume).sum();
            // Bilinear faces, where the dual cells have flat triangles.
            assert!((sum / volume - 1.0).abs() < 2e-3, "{kind:?} {sum} {volume}");
            for count in [1, 2, 4] {
                let parts = all
                    .iter()
                    .flat_map(|p| (0..count * count * count).map(|n| p.part(count, n).unwrap()));
                let parts: f64 = parts.map(|part| part.volume).sum();
                assert!((parts / sum - 1.0).abs() < 1e-12, "{kind:?} {count}");
            }
        }
    }

    #[test]
    fn every_corner_has_its_pieces() {
        let counts = |mesh: &CellMesh| of_linear(mesh).len();
        let counts: Vec<usize> = shapes().iter().map(|(mesh, _)| counts(mesh)).collect();
        assert_eq!(counts, [4, 8, 6, 5, 8]);
    }

    #[test]
    fn linear_fields_have_their_values_and_gradients() {
        for (mesh, _) in shapes() {
            for piece in of_linear(&mesh) {
                for n in 0..8 {
                    let part = piece.part(2, n).unwrap();
                    let error = part.place.w - linear(part.place.xyz());
                    assert!(error.abs() < 1e-12, "{:?} {error}", mesh.kinds[0]);
                    let gradient = part.gradient - DVec3::new(1.0, -2.0, 0.5);
                    assert!(gradient.length() < 1e-10, "{:?}", mesh.kinds[0]);
                }
            }
        }
    }

    #[test]
    fn hexahedra_have_the_gradient_of_their_trilinear_field() {
        let unit: Vec<DVec3> = (0..8_u32)
            .map(|n| DVec3::from([n & 1, n >> 1 & 1, n >> 2].map(f64::from)))
            .collect();
        let mesh = cell(11, &unit, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let field = |x: DVec3| x.x * x.y - 2.0 * x.x * x.y * x.z;
        let at = |n: u32| Some(unit[n as usize].extend(field(unit[n as usize])));
        for piece in pieces(&mesh, at, |n| n == 3) {
            let part = piece.part(4, 37).unwrap();
            let x = part.place.xyz();
            assert!((part.place.w - field(x)).abs() < 1e-12);
            let [u, v, w] = x.to_array();
            let gradient = DVec3::new(v - 2.0 * v * w, u - 2.0 * u * w, -2.0 * u * v);
            assert!((part.gradient - gradient).length() < 1e-12);
            // A cube of an eighth has a twelfth of its side's square.
            let variance = 1.0 / 64.0 / 12.0;
            assert!(
                (part.covariance[0] - variance).abs() < 1e-15 && part.covariance[1].abs() < 1e-15
            );
        }
    }

    #[test]
    fn faulty_cells_have_no_pieces_rather_than_a_panic() {
        let mut nodes = cube();
        nodes[5] = DVec3::NAN;
        let mesh = cell(11, &nodes, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let all = of_linear(&mesh);
        assert!(all.iter().all(|p| p.volume().is_finite()));
        let flat = vec![DVec3::ZERO; 8];
        assert!(of_linear(&cell(11, &flat, &[0, 1, 2, 3, 4, 5, 6, 7])).is_empty());
        // A node that repeats collapses an edge.
        let repeated = cell(12, &cube(), &[0, 1, 3, 2, 4, 5, 5, 4]);
        for piece in of_linear(&repeated) {
            assert!((0..8).all(|n| piece.part(2, n).is_none_or(|p| p.volume.is_finite())));
        }
    }
}
