//! Computes the outline of a footprint's cut-off on the image, and tests which rectangles of pixels it
//! meets.
//!
//! Offsets are pixels from the footprint's centre, Q(d) = (p . d)² + (r . d)². Both kinds of outline
//! bound convex sets that contain the centre. A rectangle that does not contain the centre meets such a
//! set if and only if one of its edges that face the centre does.
//!
//! Twin: `shaders/shared/outline.wgsl`.

use glam::Vec2;

/// The outline of a footprint.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Outline {
    /// A kernel's outline: Q(d) - r² w(d) <= 0.
    Kernel(KernelOutline),
    /// The outline of a surfel that follows the homography of its plane: Q(d) <= r² (1 + g . d)².
    Plane(PlaneOutline),
}

/// Q(d) - r² w(d) = 0, a convex quadratic of the pixel offset.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KernelOutline {
    p: Vec2,
    r: Vec2,
    /// r² times the gradient and Hessian of w; zero on affine paths.
    gradient: Vec2,
    hessian: [f32; 3],
    cutoff_squared: f32,
    /// Point at which the quadratic is least.
    middle: Vec2,
}

impl KernelOutline {
    /// Returns the outline of an affine footprint: w = 1.
    pub(crate) fn affine(p: Vec2, r: Vec2, cutoff_squared: f32) -> Self {
        Self {
            p,
            r,
            gradient: Vec2::ZERO,
            hessian: [0.0; 3],
            cutoff_squared,
            middle: Vec2::ZERO,
        }
    }

    /// Returns the outline of a footprint with w(d) = 1 + gradient . d + hxx dx² + hxy dx dy + hyy dy².
    pub(crate) fn exact(
        p: Vec2,
        r: Vec2,
        cutoff_squared: f32,
        gradient: Vec2,
        hessian: [f32; 3],
    ) -> Self {
        let mut outline = Self {
            gradient: gradient * cutoff_squared,
            hessian: hessian.map(|h| h * cutoff_squared),
            ..Self::affine(p, r, cutoff_squared)
        };
        let (a, b, c) = outline.second();
        let determinant = a * c - b * b;
        if determinant > 0.0 {
            let g = outline.gradient * 0.5;
            outline.middle = Vec2::new(c * g.x - b * g.y, a * g.y - b * g.x) / determinant;
        }
        outline
    }

    /// Returns the coefficients of dx², 2 dx dy and dy².
    fn second(&self) -> (f32, f32, f32) {
        let [hxx, hxy, hyy] = self.hessian;
        (
            self.p.x * self.p.x + self.r.x * self.r.x - hxx,
            self.p.x * self.p.y + self.r.x * self.r.y - 0.5 * hxy,
            self.p.y * self.p.y + self.r.y * self.r.y - hyy,
        )
    }

    fn value(&self, d: Vec2) -> f32 {
        let [hxx, hxy, hyy] = self.hessian;
        let q = self.p.dot(d).powi(2) + self.r.dot(d).powi(2);
        let w = self.gradient.dot(d) + hxx * d.x * d.x + hxy * d.x * d.y + hyy * d.y * d.y;
        q - w - self.cutoff_squared
    }

    /// Returns whether the rectangle between two offsets meets the inside. NaN counts as inside.
    ///
    /// In a rectangle that does not contain the middle, the least value lies on an edge that faces the
    /// middle.
    #[inline]
    pub(crate) fn touches(&self, lower: Vec2, upper: Vec2) -> bool {
        let nearest = self.middle.clamp(lower, upper);
        if nearest == self.middle {
            return true;
        }
        let (a, b, c) = self.second();
        // A small slack: the value at a needle's edge is a difference of large numbers.
        let inside = |d: Vec2| !(self.value(d) > self.cutoff_squared * 1e-4);
        let on_column = |x: f32| {
            let y = (0.5 * self.gradient.y - b * x) / c;
            inside(Vec2::new(x, y.max(lower.y).min(upper.y)))
        };
        let on_row = |y: f32| {
            let x = (0.5 * self.gradient.x - b * y) / a;
            inside(Vec2::new(x.max(lower.x).min(upper.x), y))
        };
        (nearest.x != self.middle.x && on_column(nearest.x))
            || (nearest.y != self.middle.y && on_row(nearest.y))
    }
}

/// The side 1 + g . d > 0 of the conic Q(d) = r² (1 + g . d)²: an ellipse or the branch of a hyperbola.
///
/// With A = (p; r), |A d| - r g . d is the sum of a norm and a linear function, hence convex. So the set
/// where it is at most r is convex. Along a line of fixed dx it is sqrt(c t² + m²) - r gy t + const with
/// t = dy - y0, c = py² + ry² and m = |det A dx| / sqrt(c). Its minimum is at t = r gy m / sqrt(c (c - r²
/// gy²)); there is none if c <= r² gy².
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlaneOutline {
    p: Vec2,
    r: Vec2,
    gradient: Vec2,
    cutoff: f32,
    /// Minimum of |A d| on a column, y0 = `middle.y` dx, and likewise on a row.
    middle: Vec2,
    /// Shift t = `shift.y` |dx| on a column, and likewise on a row.
    shift: Vec2,
}

/// Bound on the error of each number in f32: sixteen roundings of the greatest term.
const ROUNDING: f32 = 1e-6;

/// Stands for an infinite shift: beyond any image, and within f32 when multiplied by an offset.
const ENDLESS: f32 = 1e30;

impl PlaneOutline {
    /// Returns the outline of a surfel whose inverse depth at the offset d is 1 + `gradient` . d times
    /// its centre's.
    pub(crate) fn new(p: Vec2, r: Vec2, cutoff_squared: f32, gradient: Vec2) -> Self {
        let cutoff = cutoff_squared.sqrt();
        let (a, b, c) = (
            p.x * p.x + r.x * r.x,
            p.x * p.y + r.x * r.y,
            p.y * p.y + r.y * r.y,
        );
        let determinant = (p.x * r.y - p.y * r.x).abs();
        let shift = |c: f32, g: f32| {
            let drift = cutoff * g;
            let left = c - drift * drift;
            if left > 0.0 {
                drift * determinant / (c * left.sqrt())
            } else if drift < 0.0 {
                -ENDLESS
            } else {
                ENDLESS
            }
        };
        Self {
            p,
            r,
            gradient,
            cutoff,
            middle: Vec2::new(-b / a, -b / c),
            shift: Vec2::new(shift(a, gradient.x), shift(c, gradient.y)),
        }
    }

    /// Returns whether an offset is inside; NaN counts as inside.
    fn inside(&self, d: Vec2) -> bool {
        let (px, py) = (self.p.x * d.x, self.p.y * d.y);
        let (rx, ry) = (self.r.x * d.x, self.r.y * d.y);
        let (gx, gy) = (self.gradient.x * d.x, self.gradient.y * d.y);
        let (p, r) = (px + py, rx + ry);
        let q = p * p + r * r;
        // Never less than the rasteriser computes: each sum may be off by the roundings of its terms.
        let plane_terms = self.cutoff * (1.0 + gx.abs() + gy.abs());
        let form_terms = px.abs() + py.abs() + rx.abs() + ry.abs();
        let reach = self.cutoff * (1.0 + gx + gy) + ROUNDING * (plane_terms + form_terms);
        q.is_nan() || reach.is_nan() || (reach >= 0.0 && !(q > reach * reach))
    }

    /// Returns whether the rectangle between two offsets meets the inside. NaN counts as inside.
    #[inline]
    pub(crate) fn touches(&self, lower: Vec2, upper: Vec2) -> bool {
        if lower.is_nan() {
            return true;
        }
        let beside = lower.x > 0.0 || upper.x < 0.0;
        let above = lower.y > 0.0 || upper.y < 0.0;
        if !beside && !above {
            return true;
        }
        if beside {
            let x = if lower.x > 0.0 { lower.x } else { upper.x };
            let y = self.middle.y * x + self.shift.y * x.abs();
            if y.is_nan() || self.inside(Vec2::new(x, y.max(lower.y).min(upper.y))) {
                return true;
            }
        }
        if above {
            let y = if lower.y > 0.0 { lower.y } else { upper.y };
            let x = self.middle.x * y + self.shift.x * y.abs();
            return x.is_nan() || self.inside(Vec2::new(x.max(lower.x).min(upper.x), y));
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns whether any point of a fine grid in the rectangle is inside, in f64.
    fn any_inside(outline: &PlaneOutline, lower: Vec2, upper: Vec2) -> bool {
        let [p, r, g] = [outline.p, outline.r, outline.gradient].map(Vec2::as_dvec2);
        let cutoff = f64::from(outline.cutoff);
        let (lower, upper) = (lower.as_dvec2(), upper.as_dvec2());
        (0..=32).any(|i| {
            (0..=32).any(|j| {
                let share = glam::DVec2::new(f64::from(i), f64::from(j)) / 32.0;
                let d = lower + (upper - lower) * share;
                p.dot(d).hypot(r.dot(d)) <= cutoff * (1.0 + g.dot(d))
            })
        })
    }

    #[test]
    fn no_rectangle_that_meets_an_ellipse_or_a_branch_is_missed() {
        let mut state = 7_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            ((state >> 40) as f32) / 16_777_216.0
        };
        let (mut met, mut more, mut branches) = (0, 0, 0);
        for _ in 0..20_000 {
            let (sx, sy) = (1.0 + 30.0 * uniform(), 1.0 + 30.0 * uniform());
            let p = Vec2::new(1.0 / sx, 0.0);
            let r = Vec2::new((uniform() - 0.5) / sx, 1.0 / sy);
            let g = Vec2::new(uniform() - 0.5, uniform() - 0.5) / sx.min(sy);
            let outline = PlaneOutline::new(p, r, 9.0, g);
            branches += usize::from(outline.shift.abs().max_element() >= ENDLESS);
            let lower = Vec2::new(uniform() - 0.5, uniform() - 0.5) * 400.0;
            let upper = lower + Vec2::new(uniform(), uniform()) * 40.0;
            let touches = outline.touches(lower, upper);
            if any_inside(&outline, lower, upper) {
                met += 1;
                assert!(touches, "{outline:?}, {lower} to {upper}");
            } else {
                more += usize::from(touches);
            }
        }
        println!("{met} met, {more} more, {branches} without an end");
        assert!(met > 1000 && branches > 1000);
        // The grid misses sets that pass between its points.
        assert!(more * 20 < met);
    }

    #[test]
    fn what_is_not_a_number_keeps_the_tile() {
        let (p, r, g) = (Vec2::X, Vec2::Y, Vec2::splat(0.01));
        let far = Vec2::splat(1e3);
        assert!(!PlaneOutline::new(p, r, 9.0, g).touches(far, far + 16.0));
        for outline in [
            PlaneOutline::new(Vec2::NAN, r, 9.0, g),
            PlaneOutline::new(p, Vec2::NAN, 9.0, g),
            PlaneOutline::new(p, r, f32::NAN, g),
            PlaneOutline::new(p, r, 9.0, Vec2::NAN),
            PlaneOutline::new(Vec2::ZERO, Vec2::ZERO, 9.0, g),
        ] {
            assert!(outline.touches(far, far + 16.0), "{outline:?}");
        }
        assert!(PlaneOutline::new(p, r, 9.0, g).touches(Vec2::NAN, Vec2::NAN));
    }
}
