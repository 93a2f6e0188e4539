//! Makes a surfel of a cell's pieces.

use glam::{DMat3, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::cells::Cells;
use super::normals::Normals;
use super::paint::Paints;
use super::pieces::variance;
use super::surface::{Surface, Triangle};
use crate::error::Result;
use crate::image::{linear_from_srgb, srgb_from_linear};
use crate::math::narrowed;
use crate::task::{Stage, Task};

/// Least visible share of a surfel; fainter ones are left out: less than one of 255 levels.
pub(super) const FAINTEST: f64 = 1.0 / 255.0;

/// Variance of a unit square along each axis.
pub(super) const SQUARE: f64 = 1.0 / 12.0;

/// Cells whose variance is below this share of a square's are blurred less, in proportion: wires and slivers
/// much narrower than the spacing keep their width.
const BLUR_OF_NARROW: f64 = 0.25;

/// Greatest distance of a point from a surfel's plane, in spacings; points beyond belong to another layer.
const SAME_LAYER: f64 = 0.5;

/// A surfel in the surface's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surfel {
    pub(super) centre: DVec3,
    /// One standard deviation along each principal axis; their cross product points to the front.
    pub(super) tangents: [DVec3; 2],
    pub(super) area: f64,
    /// Linear RGB of the visible part.
    pub(super) colour: [f64; 3],
    /// Visible share of the area, or the opacity.
    pub(super) share: f64,
    /// Area whose colour is not finite.
    pub(super) unpainted: f64,
    /// Normal for shading, of any length; zero if the surface is unlit.
    pub(super) reflecting: DVec3,
}

impl Surfel {
    /// Returns true if the surfel has a colour and a visible share.
    pub(super) fn is_seen(&self) -> bool {
        let is_painted = self.unpainted < self.area && self.colour.iter().all(|c| c.is_finite());
        is_painted && self.share >= FAINTEST
    }

    /// Returns the sRGB codes of the colour.
    pub(super) fn codes(&self) -> [f64; 3] {
        self.colour
            .map(|c| f64::from(srgb_from_linear(narrowed(c))))
    }

    /// Sets the colour by its sRGB codes.
    pub(super) fn set_codes(&mut self, codes: [f64; 3]) {
        self.colour = codes.map(|c| f64::from(linear_from_srgb(narrowed(c))));
    }

    /// Returns the unit normal of the surfel's plane, on its front.
    pub(super) fn normal(&self) -> DVec3 {
        let [t1, t2] = self.tangents;
        t1.cross(t2).normalize_or_zero()
    }

    /// Returns the area times the unit Gaussian at a point of the surface, seen along the surfel's normal.
    /// Returns zero if the surface faces away or belongs to another layer.
    pub(super) fn weight_at(&self, point: DVec3, normal: Vec3) -> f64 {
        let [t1, t2] = self.tangents;
        let cross = t1.cross(t2);
        let facing = cross.dot(normal.as_dvec3());
        if !(facing > 0.5 * cross.length()) {
            return 0.0;
        }
        let offset = point - self.centre;
        if offset.dot(cross).abs() > SAME_LAYER * cross.length() {
            return 0.0;
        }
        // The tangents are orthogonal here.
        let q = (offset.dot(t1) / t1.length_squared()).powi(2)
            + (offset.dot(t2) / t2.length_squared()).powi(2);
        self.area * (-0.5 * q).exp() / (std::f64::consts::TAU * cross.length())
    }
}

/// Returns the surfels of cells that have an area, in the order of the cells.
///
/// - `kernel_width`: standard deviation of the surfel of a square cell over the cell's side.
pub(super) fn surfels(
    surface: &Surface,
    triangles: &[Triangle],
    cells: &Cells,
    (paints, normals): (&Paints, &Normals),
    kernel_width: f64,
    task: Option<&Task>,
) -> Result<Vec<Surfel>> {
    let stage = Stage::new(task, "shaping surfels", cells.len());
    let found = (0..cells.len())
        .into_par_iter()
        .filter(|cell| stage.counts(*cell))
        .filter_map(|cell| {
            let pieces = cells.pieces_of(cell);
            surfel(
                surface,
                triangles,
                cells,
                pieces,
                (paints, normals),
                kernel_width,
            )
        })
        .collect();
    stage.check()?;
    Ok(found)
}

fn surfel(
    surface: &Surface,
    triangles: &[Triangle],
    cells: &Cells,
    indices: &[u32],
    (paints, normals): (&Paints, &Normals),
    kernel_width: f64,
) -> Option<Surfel> {
    let pieces = || indices.iter().map(|&i| &cells.pieces[i as usize]);
    let triangle_of = |piece: &super::pieces::Piece| &triangles[piece.triangle as usize];
    let reference = pieces().next()?.centre;
    let (mut area, mut first, mut facing) = (0.0, DVec3::ZERO, DVec3::ZERO);
    let mut greatest = (0.0, DVec3::Z);
    for piece in pieces() {
        let triangle = triangle_of(piece);
        let share = triangle.area * piece.share();
        let normal = triangle.normal.as_dvec3();
        area += share;
        first += share * (piece.centre - reference);
        facing += share * normal;
        if share > greatest.0 {
            greatest = (share, normal);
        }
    }
    if !(area > 0.0) {
        return None;
    }
    let centroid = first / area;
    let normal = facing.try_normalize().unwrap_or(greatest.1);

    let mut second = DMat3::ZERO;
    let mut paint = [0.0; 4];
    let mut reflecting = DVec3::ZERO;
    let mut unpainted = 0.0;
    let mut nearest = (f64::INFINITY, DVec3::ZERO, normal);
    for piece in pieces() {
        let triangle = triangle_of(piece);
        let share = triangle.area * piece.share();
        let [_, e1, e2] = surface.edges_of(triangle);
        let corners = piece.corners(triangle, e1, e2);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let from_middle = |b: DVec2| e1 * (b.x - middle.x) + e2 * (b.y - middle.y);
        let d = piece.centre - reference - centroid;
        second += (DMat3::from_cols(d * d.x, d * d.y, d * d.z)
            + variance(corners.map(from_middle)))
            * share;
        if d.length_squared() < nearest.0 {
            nearest = (d.length_squared(), d, triangle.normal.as_dvec3());
        }
        let flat = |i: usize, j: usize| {
            let square = |b: &DVec2| (b[i] - middle[i]) * (b[j] - middle[j]);
            corners.iter().map(square).sum::<f64>() / 12.0
        };
        let flat = [flat(0, 0), flat(0, 1), flat(1, 1)];
        if let Some(normals) = normals.of(surface, triangle) {
            reflecting += share * normals.at(middle, flat);
        }
        match paints.coat(triangle).and_then(|c| c.of(middle, flat)) {
            Some(p) => {
                for (sum, p) in paint.iter_mut().zip(p) {
                    *sum += share * p;
                }
            }
            None => unpainted += share,
        }
    }
    let tangents = tangents(second * (1.0 / area), normal, kernel_width);
    // The centroid of a curved cell lies beside the surface: move it back along the normal.
    let (_, toward, surface_normal) = nearest;
    let lift = toward.dot(surface_normal) / normal.dot(surface_normal);
    let reach = tangents[0].length().max(tangents[1].length());
    let lift = if lift.abs() <= reach { lift } else { 0.0 };
    let [r, g, b, there] = paint;
    Some(Surfel {
        centre: reference + centroid + lift * normal,
        tangents,
        area,
        colour: [r / there, g / there, b / there],
        share: there / area,
        unpainted,
        reflecting,
    })
}

/// Returns the standard deviations along the principal axes of a cell within its tangent plane, as vectors
/// whose cross product points along `normal`.
///
/// The variance is the cell's own plus a blur that is the same for all cells: (12 rho² - 1)/12 of a squared
/// spacing. Cells that tile a plane, blurred alike, add up to one whatever their shapes; Gaussians with the
/// same moments differ from that only by third moments. The alternative, 12 rho² times the cell's own variance,
/// is the same for a square cell, but blurs neighbours of unequal shape differently. With it sums were off by
/// 5.0 instead of 1.1 % rms on a plane, and by .8 instead of .04 % under a low-pass filter as wide as the
/// spacing.
fn tangents(variance: DMat3, normal: DVec3, kernel_width: f64) -> [DVec3; 2] {
    let blur = kernel_width * kernel_width - SQUARE;
    let sigma = |own: f64| {
        let added = if blur > 0.0 {
            blur * (own / (BLUR_OF_NARROW * SQUARE)).min(1.0)
        } else {
            blur / SQUARE * own
        };
        (own + added).sqrt()
    };
    axes(normal, |a, b| a.dot(variance * b), sigma)
}

/// Returns vectors along the principal axes of a variance within a plane, the longer first. Their cross product points
/// along `normal`.
///
/// - `variance`: a · V b of the variance V and two unit vectors.
/// - `sigma`: the length of a vector, of the variance along its axis.
pub(super) fn axes(
    normal: DVec3,
    variance: impl Fn(DVec3, DVec3) -> f64,
    sigma: impl Fn(f64) -> f64,
) -> [DVec3; 2] {
    let (x, y) = normal.any_orthonormal_pair();
    let (xx, xy, yy) = (variance(x, x), variance(x, y), variance(y, y));
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let root = half.hypot(xy);
    let along = if half >= 0.0 {
        DVec2::new(half + root, xy)
    } else {
        DVec2::new(xy, root - half)
    };
    let along = along.try_normalize().unwrap_or(DVec2::X);
    let long = mean + root;
    // From the determinant: a difference of mean and root would lose a narrow cell's width.
    let short = (xx * yy - xy * xy).max(0.0) / long;
    let axis = x * along.x + y * along.y;
    [axis * sigma(long), normal.cross(axis) * sigma(short)]
}
