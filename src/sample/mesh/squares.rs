//! Lays squares into large triangles: cells of a lattice, which need neither pieces nor relaxation.
//!
//! A band of one to some two spacings along a triangle's edges is left around its squares. It is cut along the
//! same lattice into smaller triangles, which become cells with the rest of the mesh. Each triangle has its own
//! lattice, along its first edge and shifted at random, so that no pattern continues from triangle to triangle.

use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::cells::random;
use super::normals::Normals;
use super::paint::Paints;
use super::surface::{Surface, Triangle};
use super::surfels::Surfel;
use crate::parallel;

/// Least radius, in spacings, of a triangle's inscribed circle for which it has squares: smaller triangles are
/// mostly band.
const LEAST_RADIUS: f64 = 4.0;

/// Least distance of squares from edges, in spacings: leaves the band room for cells of its own.
const MARGIN: f64 = 1.0;

/// Number of texture lookups along each side of a square.
const LOOKUPS: usize = 2;

/// Squares of one kind of surface, and the remainder of its triangles.
#[derive(Debug)]
pub(super) struct Squares {
    rows: Vec<Row>,
    pub(super) count: usize,
    /// Triangles without squares, and the bands of those with squares.
    pub(super) rest: Vec<Triangle>,
}

/// A row of adjacent squares with sides of one spacing.
#[derive(Debug, Clone, Copy)]
struct Row {
    triangle: Triangle,
    /// Start of the first square along the plane's axes: integers, relative to `shift`.
    first: DVec2,
    shift: DVec2,
    count: u32,
}

/// The plane of a triangle.
#[derive(Debug, Clone, Copy)]
struct Plane {
    /// First corner of the triangle.
    origin: DVec3,
    /// Unit vectors, the first along the first edge; their cross product points to the front.
    axes: [DVec3; 2],
    /// The corners in these axes.
    corners: [DVec2; 3],
    /// Maps plane coordinates to barycentric ones.
    barycentric_from_plane: DMat2,
}

impl Plane {
    fn new(surface: &Surface, triangle: &Triangle) -> Self {
        let [origin, e1, e2] = surface.edges_of(triangle);
        let x = e1.normalize();
        let y = e1.cross(e2).cross(x).normalize();
        let second = DVec2::new(e1.length(), 0.0);
        let third = DVec2::new(e2.dot(x), e2.dot(y));
        Self {
            origin,
            axes: [x, y],
            corners: [DVec2::ZERO, second, third],
            barycentric_from_plane: DMat2::from_cols(second, third).inverse(),
        }
    }

    /// Returns the radius of the inscribed circle of the triangle.
    fn inner_radius(&self) -> f64 {
        let [a, b, c] = self.corners;
        (b - a).perp_dot(c - a) / (a.distance(b) + b.distance(c) + c.distance(a))
    }

    /// Returns the part of the line at height `y` that lies at least [`MARGIN`] inside all edges.
    fn inside(&self, y: f64) -> [f64; 2] {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for side in 0..3 {
            let (from, to) = (self.corners[side], self.corners[(side + 1) % 3]);
            let inward = (to - from).normalize().perp();
            // inward . (x, y) >= least
            let least = inward.dot(from) + MARGIN - inward.y * y;
            if inward.x > 0.0 {
                low = low.max(least / inward.x);
            } else if inward.x < 0.0 {
                high = high.min(least / inward.x);
            } else if least > 0.0 {
                return [0.0, -1.0];
            }
        }
        [low, high]
    }

    /// Returns the squares of the row from `y` to `y + 1`: the number of the first (0 begins at `shift`), and
    /// their count.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number below that of all surfels"
    )]
    fn squares(&self, y: f64, shift: f64) -> (f64, u32) {
        let ([low, high], [low_above, high_above]) = (self.inside(y), self.inside(y + 1.0));
        let first = (low.max(low_above) - shift).ceil();
        let last = (high.min(high_above) - shift).floor();
        // No squares if the numbers are not finite.
        (first, (last - first).max(0.0) as u32)
    }
}

impl Squares {
    /// Lays squares into triangles that have space for them; `seed` shifts them.
    pub(super) fn new(surface: &Surface, triangles: &[Triangle], seed: u64) -> Self {
        let of_one = |(i, triangle): (usize, &Triangle)| {
            // A cheap test that holds for all small triangles: a circle of that radius has a greater area.
            let is_small = triangle.area < LEAST_RADIUS * LEAST_RADIUS;
            let plane = (!is_small).then(|| Plane::new(surface, triangle));
            let plane = plane.filter(|plane| plane.inner_radius() >= LEAST_RADIUS);
            plane.map(|plane| {
                let shift = |axis: u64| random(seed, 2 * i as u64 + axis);
                (*triangle, plane, DVec2::new(shift(0), shift(1)))
            })
        };
        let large: Vec<Option<_>> = triangles.par_iter().enumerate().map(of_one).collect();
        let small = triangles.iter().zip(&large).filter(|(_, l)| l.is_none());
        let mut squares = Self {
            rows: Vec::new(),
            count: 0,
            rest: small.map(|(triangle, _)| *triangle).collect(),
        };
        for (triangle, plane, shift) in large.into_iter().flatten() {
            squares.lay(&triangle, &plane, shift);
        }
        squares
    }

    fn lay(&mut self, triangle: &Triangle, plane: &Plane, shift: DVec2) {
        // The first row reaches into the triangle from below.
        let heights = rows_up_to(plane.corners[2].y - shift.y);
        let row = |i: usize| {
            let number = i as f64 - 1.0;
            let (first, count) = plane.squares(number + shift.y, shift.x);
            let row = Row {
                triangle: *triangle,
                first: DVec2::new(first, number),
                shift,
                count,
            };
            (row, band(plane, &row))
        };
        let found: Vec<(Row, Vec<Triangle>)> = parallel::map(heights, row);
        for (row, band) in found {
            self.count += row.count as usize;
            self.rest.extend(band);
            if row.count > 0 {
                self.rows.push(row);
            }
        }
    }

    /// Returns the surfels of all squares.
    ///
    /// - `kernel_width`: standard deviation of a surfel, in spacings.
    pub(super) fn surfels(
        &self,
        surface: &Surface,
        (paints, normals): (&Paints, &Normals),
        kernel_width: f64,
    ) -> Vec<Surfel> {
        let of_row = |row: &Row| {
            let plane = Plane::new(surface, &row.triangle);
            let coat = paints.coat(&row.triangle);
            let normals = normals.of(surface, &row.triangle);
            let lookups = match &coat {
                Some(coat) if !coat.is_plain() => LOOKUPS,
                _ => 1,
            };
            let side = 1.0 / lookups as f64;
            // Variance of a part of the square, mapped from the plane's axes.
            let m = plane.barycentric_from_plane;
            let spread = m * m.transpose() * (side * side / 12.0);
            let variance = [spread.x_axis.x, spread.x_axis.y, spread.y_axis.y];
            let [x, y] = plane.axes;
            let tangents = plane.axes.map(|axis| axis * kernel_width);
            let first = row.first + row.shift;
            (0..row.count).map(move |i| {
                let corner = first + DVec2::new(f64::from(i), 0.0);
                let mut paint = [0.0; 4];
                let mut unpainted = 0.0;
                for part in 0..lookups * lookups {
                    let at = DVec2::new((part % lookups) as f64, (part / lookups) as f64) + 0.5;
                    let middle = m * (corner + at * side);
                    match coat.as_ref().and_then(|c| c.of(middle, variance)) {
                        Some(found) => {
                            for (sum, p) in paint.iter_mut().zip(found) {
                                *sum += side * side * p;
                            }
                        }
                        None => unpainted += side * side,
                    }
                }
                let at = corner + 0.5;
                let [r, g, b, there] = paint;
                let whole = variance.map(|v| v * (lookups * lookups) as f64);
                let reflecting = normals.as_ref().map(|n| n.at(m * at, whole));
                Surfel {
                    centre: plane.origin + x * at.x + y * at.y,
                    tangents,
                    area: 1.0,
                    colour: [r / there, g / there, b / there],
                    share: there,
                    unpainted,
                    reflecting: reflecting.unwrap_or_default(),
                }
            })
        };
        self.rows.par_iter().flat_map_iter(of_row).collect()
    }
}

impl Squares {
    /// Returns places in the squares, one for every `each` squares, with their normals.
    pub(super) fn points(&self, surface: &Surface, each: f64) -> Vec<(DVec3, Vec3)> {
        let mut points = Vec::new();
        let mut passed = 0.0;
        for row in &self.rows {
            let end = passed + f64::from(row.count);
            let plane = Plane::new(surface, &row.triangle);
            let [x, y] = plane.axes;
            while (points.len() as f64 + 0.5) * each < end {
                let n = points.len() as f64;
                let column = ((n + 0.5) * each - passed).floor();
                // Evenly over the square: the additive sequence of the plastic number.
                let within = DVec2::new(n * 0.754_877_666_246_692_7, n * 0.569_840_290_998_053_2);
                let at = row.first + row.shift + DVec2::new(column, 0.0) + within.fract();
                points.push((plane.origin + x * at.x + y * at.y, row.triangle.normal));
            }
            passed = end;
        }
        points
    }
}

/// Returns the part of a triangle that a row of the lattice leaves beside its squares, as triangles.
fn band(plane: &Plane, row: &Row) -> Vec<Triangle> {
    let y = row.first.y + row.shift.y;
    let strip = cut(&plane.corners, DVec2::Y, y);
    let strip = cut(&strip, DVec2::NEG_Y, -(y + 1.0));
    let Some((low, high)) = extent(&strip) else {
        return Vec::new();
    };
    let mut parts = Vec::new();
    let mut column = (low - row.shift.x).floor();
    while column + row.shift.x < high {
        if row.count > 0 && (column - row.first.x).abs() < 0.5 {
            column += f64::from(row.count);
            continue;
        }
        let left = column + row.shift.x;
        let square = cut(&cut(&strip, DVec2::X, left), DVec2::NEG_X, -(left + 1.0));
        for i in 2..square.len() {
            let corners = [square[0], square[i - 1], square[i]];
            let area = 0.5 * (corners[1] - corners[0]).perp_dot(corners[2] - corners[0]);
            if area > 0.0 {
                parts.push(Triangle {
                    corners: corners.map(|c| plane.barycentric_from_plane * c),
                    area,
                    ..row.triangle
                });
            }
        }
        column += 1.0;
    }
    parts
}

/// Returns the part of a convex polygon in which `normal . place >= least`.
fn cut(polygon: &[DVec2], normal: DVec2, least: f64) -> Vec<DVec2> {
    let mut left = Vec::with_capacity(polygon.len() + 1);
    for (i, &to) in polygon.iter().enumerate() {
        let from = polygon[(i + polygon.len() - 1) % polygon.len()];
        let (before, after) = (normal.dot(from) - least, normal.dot(to) - least);
        if (before < 0.0) != (after < 0.0) {
            left.push(from + (to - from) * (before / (before - after)));
        }
        if after >= 0.0 {
            left.push(to);
        }
    }
    left
}

/// Returns the least and greatest x.
fn extent(polygon: &[DVec2]) -> Option<(f64, f64)> {
    let all = polygon.iter().map(|p| (p.x, p.x));
    all.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// Returns the number of rows that begin below `height`, counted from the one that begins at -1.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rows of squares, fewer than surfels"
)]
fn rows_up_to(height: f64) -> usize {
    (height.ceil() + 1.0).max(0.0) as usize
}
