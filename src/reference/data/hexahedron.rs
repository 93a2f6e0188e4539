//! Intersects rays with hexahedra that are trilinear maps of three parameters.
//!
//! Wedges and pyramids are hexahedra with some coinciding corners. VTK's shape functions for them are the same
//! functions of position in other parameters.

use glam::{DMat3, DVec2, DVec3};

/// The corners, the first parameter fastest.
pub(super) type Corners = [DVec3; 8];

/// A part of a ray within a hexahedron.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub(super) from: f64,
    pub(super) to: f64,
    /// Approximate parameters at the ends and in the middle.
    pub(super) guides: [DVec3; 3],
}

impl Span {
    /// Estimates the parameters at `t` by a parabola.
    pub(super) fn guess(&self, t: f64) -> DVec3 {
        let s = (t - self.from) / (self.to - self.from);
        let [start, end, middle] = self.guides;
        start + (end - start) * s + (middle * 2.0 - start - end) * (2.0 * s * (1.0 - s))
    }
}

/// Tolerance, in a face's parameters, by which a ray may pass outside a face and still meet it. A ray at the
/// common edge of two faces thus meets at least one of them despite rounding. If two cells claim a part for
/// that reason, one of them gets it.
const EDGE: f64 = 1e-9;

/// Tolerance, in parameters, by which a place may lie outside a cell and still belong to it.
const INSIDE: f64 = 1e-7;

/// Greatest number of steps of Newton's method; from a guess accurate to a tenth, three suffice.
const MOST_STEPS: usize = 24;

/// Size of a step of Newton's method after which it ends: convergence is quadratic, so the remaining error is
/// the square of this.
const LAST_STEP: f64 = 1e-6;

/// Returns position and Jacobian at parameters `s`.
fn map([c000, c100, c010, c110, c001, c101, c011, c111]: &Corners, s: DVec3) -> (DVec3, DMat3) {
    let mix = |a: DVec3, b: DVec3, s: f64| a + (b - a) * s;
    let (e00, e10) = (mix(*c000, *c100, s.x), mix(*c010, *c110, s.x));
    let (e01, e11) = (mix(*c001, *c101, s.x), mix(*c011, *c111, s.x));
    let (f0, f1) = (mix(e00, e10, s.y), mix(e01, e11, s.y));
    let di = mix(
        mix(c100 - c000, c110 - c010, s.y),
        mix(c101 - c001, c111 - c011, s.y),
        s.z,
    );
    let dj = mix(e10 - e00, e11 - e01, s.z);
    (mix(f0, f1, s.z), DMat3::from_cols(di, dj, f1 - f0))
}

/// Returns the value at parameters `s` of a field that is trilinear in them.
pub(super) fn value(v: &[f64; 8], s: DVec3) -> f64 {
    let mix = |a: f64, b: f64, s: f64| a + (b - a) * s;
    let face = |c: usize| mix(mix(v[c], v[c + 1], s.x), mix(v[c + 2], v[c + 3], s.x), s.y);
    mix(face(0), face(4), s.z)
}

/// Returns the volume with the sign of the determinant, exactly. The determinant is quadratic in each
/// parameter, and two Gauss points along each integrate cubics.
pub(super) fn volume(corners: &Corners) -> f64 {
    const GAUSS: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];
    let at = |g: usize| DVec3::new(GAUSS[g & 1], GAUSS[g >> 1 & 1], GAUSS[g >> 2]);
    (0..8)
        .map(|g| map(corners, at(g)).1.determinant() / 8.0)
        .sum()
}

/// Returns the product of the longest edges along each parameter.
pub(super) fn longest_edges(c: &Corners) -> f64 {
    let longest = |step: usize| {
        let first = (0..8).filter(|i| i & step == 0);
        first.fold(0.0_f64, |l, i| l.max(c[i].distance(c[i + step])))
    };
    longest(1) * longest(2) * longest(4)
}

/// Finds the parameters of a place by Newton's method from a guess; `None` if it does not converge.
pub(super) fn locate(corners: &Corners, place: DVec3, guess: DVec3) -> Option<DVec3> {
    let mut s = guess;
    for _ in 0..MOST_STEPS {
        let (point, derivative) = map(corners, s);
        let miss = place - point;
        let step = solve(derivative, miss);
        if !step.is_finite() {
            // On the edge of a collapsed face: move off it.
            s += (DVec3::splat(0.5) - s) * 1e-3;
            continue;
        }
        let length = step.abs().max_element();
        s += if length > 1.0 { step / length } else { step };
        if length <= LAST_STEP {
            return Some(s);
        }
    }
    // Near such an edge one parameter is almost undetermined, and does not converge.
    let extent = corners.iter().map(|c| (*c - corners[0]).length());
    let miss = (map(corners, s).0 - place).length();
    (miss <= 1e-10 * extent.fold(0.0, f64::max)).then_some(s)
}

/// Solves A x = b for x by Cramer's rule; not finite if A is singular.
fn solve(a: DMat3, b: DVec3) -> DVec3 {
    let [x, y, z] = [a.x_axis, a.y_axis, a.z_axis];
    let yz = y.cross(z);
    let solved = DVec3::new(b.dot(yz), x.dot(b.cross(z)), x.dot(y.cross(b)));
    solved / x.dot(yz)
}

fn is_inside(s: DVec3) -> bool {
    (s - 0.5).abs().max_element() <= 0.5 + INSIDE
}

/// Intersection of a ray with a face.
#[derive(Clone, Copy, Default)]
struct Hit {
    t: f64,
    s: DVec3,
}

/// A ray, and two directions perpendicular to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: DVec3,
    /// Unit vector.
    pub(super) direction: DVec3,
    across: [DVec3; 2],
    /// End of the ray; it begins at 0.
    pub(super) end: f64,
}

impl Ray {
    pub(super) fn new(origin: DVec3, direction: DVec3, end: f64) -> Self {
        let (u, v) = direction.any_orthonormal_pair();
        Self {
            origin,
            direction,
            across: [u, v],
            end,
        }
    }

    pub(super) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// Calls `each` with the parts of a ray within a hexahedron, in order.
///
/// Each face is a bilinear patch, which the ray meets at most twice: where the patch, projected along the ray,
/// is 0. That is a quadratic equation (Ramsey, Potter and Hansen 2004). A part between two hits belongs to the
/// cell if its middle does; a twisted cell may have several parts.
pub(super) fn spans(corners: &Corners, ray: &Ray, mut each: impl FnMut(Span)) {
    let flat = corners.map(|c| {
        let c = c - ray.origin;
        DVec2::new(c.dot(ray.across[0]), c.dot(ray.across[1]))
    });
    let low = flat.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let high = flat.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    let extent = (high - low).max_element();
    let margin = EDGE * extent;
    // Phrased so that NaN fails.
    if !(low.max_element() <= margin && high.min_element() >= -margin) {
        return;
    }
    let depths = corners.map(|c| (c - ray.origin).dot(ray.direction));
    let mut hits = [Hit::default(); 12];
    let mut count = 0;
    for axis in 0..3_usize {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        for side in 0..2_usize {
            let first = side << axis;
            let places = [
                first,
                first | 1 << b,
                first | 1 << c,
                first | 1 << b | 1 << c,
            ];
            patch(places.map(|i| flat[i]), |u, v| {
                let [d00, d10, d01, d11] = places.map(|i| depths[i]);
                let t = d00 + u * (d10 - d00) + v * (d01 - d00) + u * v * (d11 - d10 - d01 + d00);
                let mut s = [0.0; 3];
                (s[axis], s[b], s[c]) = (side as f64, u, v);
                if count < hits.len() && t.is_finite() {
                    hits[count] = Hit { t, s: s.into() };
                    count += 1;
                }
            });
        }
    }
    let hits = &mut hits[..count];
    hits.sort_unstable_by(|a, b| a.t.total_cmp(&b.t));
    for pair in hits.windows(2) {
        let (from, to) = (pair[0].t.max(0.0), pair[1].t.min(ray.end));
        let whole = pair[1].t - pair[0].t;
        if !(to > from) {
            continue;
        }
        let at = |t: f64| pair[0].s + (pair[1].s - pair[0].s) * ((t - pair[0].t) / whole);
        let middle = 0.5 * (from + to);
        let place = ray.at(middle);
        let found = locate(corners, place, at(middle)).filter(|s| is_inside(*s));
        let again = || locate(corners, place, DVec3::splat(0.5)).filter(|s| is_inside(*s));
        if let Some(s) = found.or_else(again) {
            each(Span {
                from,
                to,
                guides: [at(from), at(to), s],
            });
        }
    }
}

/// Calls `hit` with the parameters at which a bilinear patch in the plane is 0. The corners are 00, 10, 01 and
/// 11.
fn patch([q00, q10, q01, q11]: [DVec2; 4], mut hit: impl FnMut(f64, f64)) {
    // a + u b + v (c + u d) = 0; the cross product of a + u b with c + u d eliminates v.
    let (a, b, c) = (q00, q10 - q00, q01 - q00);
    let d = (q11 - q10) - c;
    let within = |x: f64| (-EDGE..=1.0 + EDGE).contains(&x);
    let size = [a, b, c, d].map(|v| v.abs().max_element());
    let size = size.into_iter().fold(0.0, f64::max);
    let [p, q, r] = [b.perp_dot(d), a.perp_dot(d) + b.perp_dot(c), a.perp_dot(c)];
    // Seen edge-on: other faces delimit the part.
    if !(p.abs().max(q.abs()).max(r.abs()) > 1e-15 * size * size) {
        return;
    }
    let discriminant = q * q - 4.0 * p * r;
    // Rounding may make a tangent ray miss the patch.
    let rounding = 1e-14 * (q * q).max((4.0 * p * r).abs());
    if discriminant < -rounding {
        return;
    }
    let larger = -0.5 * (q + discriminant.max(0.0).sqrt().copysign(q));
    let roots = [larger / p, r / larger];
    for (i, &u) in roots.iter().enumerate() {
        // A double root counts once.
        if !within(u) || (i == 1 && u == roots[0]) {
            continue;
        }
        let (constant, slope) = (a + b * u, c + d * u);
        let v = -constant.dot(slope) / slope.length_squared();
        // If an edge has collapsed, v is arbitrary there, and the root u has no meaning.
        if within(v) && (constant + slope * v).abs().max_element() <= 1e-7 * size {
            hit(u, v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a cube with corners moved by up to `twist`.
    fn twisted(twist: f64) -> Corners {
        std::array::from_fn(|c| {
            let corner = DVec3::new((c & 1) as f64, (c >> 1 & 1) as f64, (c >> 2) as f64);
            let wave = |i: usize| (1.7 * c as f64 + 2.1 * i as f64).sin() * twist;
            corner + DVec3::new(wave(0), wave(1), wave(2))
        })
    }

    #[test]
    fn places_are_located_and_spans_are_where_places_are_inside() {
        let corners = twisted(0.15);
        for i in 0..200 {
            let share = |k: f64| (f64::from(i) * k).fract();
            let s = DVec3::new(share(0.618), share(0.414), share(0.732));
            let (place, _) = map(&corners, s);
            let found = locate(&corners, place, DVec3::splat(0.5)).unwrap();
            assert!((found - s).abs().max_element() < 1e-12, "{s} {found}");

            let toward = DVec3::new(share(0.271) - 0.5, share(0.577) - 0.5, share(0.302) - 0.5);
            let direction = toward.normalize();
            let ray = Ray::new(place - 4.0 * direction, direction, 8.0);
            let mut found = Vec::new();
            spans(&corners, &ray, |span| found.push([span.from, span.to]));
            // Marched in small steps: the same places are inside.
            for step in 0..800 {
                let t = 0.01 * (f64::from(step) + 0.5);
                let truth = locate(&corners, ray.at(t), DVec3::splat(0.5));
                let near_end = found.iter().flatten().any(|e| (e - t).abs() < 1e-6);
                let claimed = found.iter().any(|[a, b]| *a <= t && t <= *b);
                assert!(
                    near_end || claimed == truth.is_some_and(is_inside),
                    "{i} {t}"
                );
            }
        }
    }

    #[test]
    fn wedges_and_pyramids_are_collapsed_hexahedra() {
        let node = DVec3::new;
        let base = [
            node(0.0, 0.0, 0.0),
            node(1.0, 0.0, 0.0),
            node(0.0, 1.0, 0.0),
        ];
        let top = base.map(|n| n + DVec3::Z);
        let [a, b, c] = base;
        let [d, e, f] = top;
        let wedge = [a, b, c, c, d, e, f, f];
        assert!((volume(&wedge) - 0.5).abs() < 1e-15);
        let pyramid = [a, b, c, node(1.0, 1.0, 0.0), d, d, d, d];
        assert!((volume(&pyramid) - 1.0 / 3.0).abs() < 1e-15);
        // A ray at height z along x: the wedge is cut at x = 1 - y, the pyramid at x = 1 - z.
        let ray = Ray::new(node(-1.0, 0.25, 0.4), DVec3::X, 9.0);
        for (cell, length) in [(wedge, 0.75), (pyramid, 0.6)] {
            let mut found = 0.0;
            spans(&cell, &ray, |span| found += span.to - span.from);
            assert!((found - length).abs() < 1e-12, "{found}");
        }
    }
}
