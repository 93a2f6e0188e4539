//! Computes the affine and exact footprints of [`LANES`] kernels of one block at once.
//!
//! Every step is a loop over lanes of the function that a single kernel uses ([`crate::splat`]). The
//! compiler turns it into vectors of the current instruction set. No product is fused with a sum, so the
//! numbers are the same for all instruction sets. [`super::footprint`] handles kernels that reach the
//! plane of the eye and numbers beyond f32.

use glam::{Vec2, Vec3};

use super::footprint::{affine_bounds, pixel_range};
use crate::constants::NEAR_MARGIN;
use crate::math::Factor;
use crate::record::{Carried, ExactTerms, Footprint, PATH_AFFINE, PATH_EXACT, ViewUniform};
use crate::splat::{
    Filter, ImageKernel, Kernel, ScreenFactor, affine_suffices, cutoff_radius, cutoff_share,
    defocus, depth_terms, edge_growth, exact_extent, exact_terms, meeting, project_kernel,
};

/// Number of kernels computed at once: as many as the widest vectors hold.
pub(super) const LANES: usize = 16;

/// `N` numbers for each lane, stored as `N` columns of lanes.
#[derive(Debug, Clone, Copy)]
struct Columns<const N: usize>([[f32; LANES]; N]);

impl<const N: usize> Columns<N> {
    const ZERO: Self = Self([[0.0; LANES]; N]);

    #[inline(always)]
    fn set(&mut self, lane: usize, numbers: [f32; N]) {
        for (column, number) in self.0.iter_mut().zip(numbers) {
            column[lane] = number;
        }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> [f32; N] {
        std::array::from_fn(|n| self.0[n][lane])
    }
}

/// Data that the kernels of a batch share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shared<'a> {
    pub(super) view: &'a ViewUniform,
    pub(super) filter: Filter,
    /// [`Block::crowding`](crate::blocks::Block::crowding).
    pub(super) crowding: f32,
    /// True if kernels may be cut, and need terms of their depth.
    pub(super) is_cut: bool,
}

/// Kernels of a block, and their footprints.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    kernels: Columns<13>,
    screens: Columns<15>,
    images: Columns<6>,
    terms: Columns<6>,
    forms: Columns<4>,
    /// Variance of the low-pass filter, and of a disc out of focus, px².
    low_pass: [f32; LANES],
    radius: [f32; LANES],
    tau: [f32; LANES],
    columns: [u32; LANES],
    rows: [u32; LANES],
    is_exact: [bool; LANES],
    is_plain: [bool; LANES],
}

impl Batch {
    pub(super) fn new() -> Self {
        Self {
            kernels: Columns::ZERO,
            screens: Columns::ZERO,
            images: Columns::ZERO,
            terms: Columns::ZERO,
            forms: Columns::ZERO,
            low_pass: [0.0; LANES],
            radius: [0.0; LANES],
            tau: [0.0; LANES],
            columns: [0; LANES],
            rows: [0; LANES],
            is_exact: [false; LANES],
            is_plain: [false; LANES],
        }
    }

    /// Returns whether kernels with this filter are projected in lanes.
    pub(super) fn takes(filter: Filter) -> bool {
        // The speed of the comparison method's enlargement does not matter.
        filter != Filter::UniformScaling
    }

    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, kernel: &Kernel) {
        let (u, Factor { x, y, z }) = (kernel.centre, kernel.factor);
        let numbers = [
            u.x,
            u.y,
            u.z,
            x.x,
            x.y,
            x.z,
            y.x,
            y.y,
            y.z,
            z.x,
            z.y,
            z.z,
            kernel.mass,
        ];
        self.kernels.set(lane, numbers);
    }

    /// Projects the kernels of all lanes, including lanes that were not set.
    #[inline(always)]
    pub(super) fn project(&mut self, shared: Shared<'_>) {
        let is_orthographic = shared.view.orthographic != 0;
        match (shared.filter, is_orthographic) {
            (Filter::Adaptive, false) => self.run::<{ Filter::Adaptive as usize }, false>(shared),
            (Filter::Exact, false) => self.run::<{ Filter::Exact as usize }, false>(shared),
            // Exact footprints gain nothing here.
            (Filter::Adaptive | Filter::Exact | Filter::Ewa, true) => {
                self.run::<{ Filter::Ewa as usize }, true>(shared);
            }
            (Filter::Reconstruction, true) => {
                self.run::<{ Filter::Reconstruction as usize }, true>(shared);
            }
            (Filter::LowPass, true) => self.run::<{ Filter::LowPass as usize }, true>(shared),
            (Filter::Isotropic, true) => self.run::<{ Filter::Isotropic as usize }, true>(shared),
            (Filter::Reconstruction, false) => {
                self.run::<{ Filter::Reconstruction as usize }, false>(shared);
            }
            (Filter::LowPass, false) => self.run::<{ Filter::LowPass as usize }, false>(shared),
            (Filter::Isotropic, false) => self.run::<{ Filter::Isotropic as usize }, false>(shared),
            (Filter::Ewa | Filter::UniformScaling, _) => {
                self.run::<{ Filter::Ewa as usize }, false>(shared);
            }
        }
    }

    #[inline(always)]
    fn run<const FILTER: usize, const ORTHOGRAPHIC: bool>(&mut self, shared: Shared<'_>) {
        let Shared {
            crowding, is_cut, ..
        } = shared;
        let filter = const { Filter::ALL[FILTER] };
        let may_be_exact = matches!(filter, Filter::Adaptive | Filter::Exact);
        // A copy with a known kind of camera: a load through a reference would prevent vector code.
        let view = &ViewUniform {
            orthographic: u32::from(ORTHOGRAPHIC),
            ..*shared.view
        };
        self.low_pass = [view.low_pass_variance_px2; LANES];
        if view.aperture > 0.0 {
            for lane in 0..LANES {
                self.low_pass[lane] += defocus(view, &self.kernel(lane));
            }
        }
        for lane in 0..LANES {
            let screen = project_kernel(view, &self.kernel(lane));
            let image = screen.filtered(filter, self.low_pass[lane]);
            self.screens.set(lane, of_screen(screen));
            self.images.set(lane, of_image(image));
            let depth = image.tau * image.enlargement * meeting(crowding);
            self.radius[lane] = cutoff_radius(depth, 1.0, view.tolerance, view.cutoff);
            self.tau[lane] = image.tau;
            self.is_exact[lane] = false;
        }
        if may_be_exact {
            for lane in 0..LANES {
                let (screen, image) = (self.screen(lane), self.image(lane));
                let terms = exact_terms(&screen, self.low_pass[lane], image.determinant);
                self.is_exact[lane] = filter == Filter::Exact
                    || !affine_suffices(view, &screen, &image, &terms, crowding);
                self.terms.set(lane, of_terms(terms));
            }
        }
        let any_exact = self.is_exact.iter().any(|is| *is);
        if any_exact {
            for lane in 0..LANES {
                let (screen, image) = (self.screen(lane), self.image(lane));
                let terms = terms_of(self.terms.get(lane));
                let r = self.radius[lane];
                let growth = edge_growth(view, &screen, &image, &terms, 1.1 * r);
                let depth = image.tau * image.enlargement * meeting(crowding);
                let wider = cutoff_radius(depth, growth, view.tolerance, view.cutoff);
                let is_exact = self.is_exact[lane];
                self.radius[lane] = if is_exact { r.max(wider) } else { r };
                let tau = image.tau / screen.ray_length;
                self.tau[lane] = if is_exact { tau } else { image.tau };
            }
        }
        if is_cut {
            for lane in 0..LANES {
                let (screen, z) = (self.screen(lane), self.kernels.0[2][lane]);
                let determinant = screen
                    .filtered(Filter::Ewa, self.low_pass[lane])
                    .determinant;
                let (slope, sigma) =
                    depth_terms(view, &screen, self.low_pass[lane], determinant, z);
                let own = self.terms.get(lane);
                let is_exact = self.is_exact[lane];
                let numbers = [slope.x, slope.y, 0.0, 0.0, 0.0, 0.0];
                let mut numbers: [f32; 6] =
                    std::array::from_fn(|n| if is_exact { own[n] } else { numbers[n] });
                numbers[5] = sigma;
                self.terms.set(lane, numbers);
            }
        }
        for lane in 0..LANES {
            let (screen, image) = (self.screen(lane), self.image(lane));
            let r = self.radius[lane];
            let [[p0, p1], [r0, r1]] = image.triangular_form();
            self.forms.set(lane, [p0, p1, r0, r1]);
            self.tau[lane] /= cutoff_share(r);
            let z = self.kernels.0[2][lane];
            let reach = self.kernel(lane).factor.z.length();
            let is_shape = screen.row_x.is_finite() && screen.row_y.is_finite();
            // Phrased so that NaN is handled elsewhere.
            self.is_plain[lane] = (z > NEAR_MARGIN * r * reach)
                & is_shape
                & (image.tau > 0.0)
                & (image.tau < f32::INFINITY);
            let half = affine_bounds(&image, r);
            self.columns[lane] = pixel_range(screen.centre_px.x, half.x, view.size[0]);
            self.rows[lane] = pixel_range(screen.centre_px.y, half.y, view.size[1]);
        }
        if any_exact {
            for lane in 0..LANES {
                let screen = self.screen(lane);
                let extent = exact_extent(&screen, self.low_pass[lane], self.radius[lane]);
                let (middle, half) = extent.unwrap_or((Vec2::NAN, Vec2::NAN));
                let is_exact = self.is_exact[lane];
                let centre = screen.centre_px + middle;
                let columns = pixel_range(centre.x, half.x, view.size[0]);
                let rows = pixel_range(centre.y, half.y, view.size[1]);
                self.columns[lane] = if is_exact {
                    columns
                } else {
                    self.columns[lane]
                };
                self.rows[lane] = if is_exact { rows } else { self.rows[lane] };
            }
        }
    }

    /// Returns whether the footprint of a lane was computed in lanes.
    #[inline(always)]
    pub(super) fn is_plain(&self, lane: usize) -> bool {
        self.is_plain[lane]
    }

    /// The footprint of a lane.
    #[inline(always)]
    pub(super) fn footprint(&self, lane: usize, carried: Carried, key: u32) -> Footprint {
        let [p0, p1, r0, r1] = self.forms.get(lane);
        let r = self.radius[lane];
        // If either range is empty, neither counts.
        let (columns, rows) = (self.columns[lane], self.rows[lane]);
        let is_visible = columns != 0 && rows != 0;
        Footprint {
            centre_px: [self.screens.0[0][lane], self.screens.0[1][lane]],
            form_p: [p0, p1],
            form_r: [r0, r1],
            tau: self.tau[lane],
            cutoff_squared: r * r,
            carried,
            depth: self.kernels.0[2][lane],
            path: if self.is_exact[lane] {
                PATH_EXACT
            } else {
                PATH_AFFINE
            },
            columns: if is_visible { columns } else { 0 },
            rows: if is_visible { rows } else { 0 },
            key,
        }
    }

    /// Returns the terms of a footprint that is exact or may be cut.
    #[inline(always)]
    pub(super) fn terms(&self, lane: usize, is_cut: bool) -> Option<ExactTerms> {
        let has_terms = is_cut || self.is_exact[lane];
        has_terms.then(|| terms_of(self.terms.get(lane)))
    }

    #[inline(always)]
    fn kernel(&self, lane: usize) -> Kernel {
        let [ux, uy, uz, x0, x1, x2, y0, y1, y2, z0, z1, z2, mass] = self.kernels.get(lane);
        Kernel {
            centre: Vec3::new(ux, uy, uz),
            factor: Factor {
                x: Vec3::new(x0, x1, x2),
                y: Vec3::new(y0, y1, y2),
                z: Vec3::new(z0, z1, z2),
            },
            mass,
        }
    }

    #[inline(always)]
    fn screen(&self, lane: usize) -> ScreenFactor {
        let [
            cx,
            cy,
            sx,
            sy,
            x0,
            x1,
            x2,
            y0,
            y1,
            y2,
            z0,
            z1,
            z2,
            ray_length,
            weight,
        ] = self.screens.get(lane);
        ScreenFactor {
            centre_px: Vec2::new(cx, cy),
            slope: Vec2::new(sx, sy),
            row_x: Vec3::new(x0, x1, x2),
            row_y: Vec3::new(y0, y1, y2),
            relative_depth: Vec3::new(z0, z1, z2),
            ray_length,
            weight,
        }
    }

    #[inline(always)]
    fn image(&self, lane: usize) -> ImageKernel {
        let [a, b, c, determinant, tau, enlargement] = self.images.get(lane);
        ImageKernel {
            a,
            b,
            c,
            determinant,
            tau,
            enlargement,
        }
    }
}

#[inline(always)]
fn of_screen(s: ScreenFactor) -> [f32; 15] {
    let [x, y, z] = [s.row_x, s.row_y, s.relative_depth];
    let ([cx, cy], [sx, sy]) = (s.centre_px.to_array(), s.slope.to_array());
    [
        cx,
        cy,
        sx,
        sy,
        x.x,
        x.y,
        x.z,
        y.x,
        y.y,
        y.z,
        z.x,
        z.y,
        z.z,
        s.ray_length,
        s.weight,
    ]
}

#[inline(always)]
fn of_image(i: ImageKernel) -> [f32; 6] {
    [i.a, i.b, i.c, i.determinant, i.tau, i.enlargement]
}

#[inline(always)]
fn of_terms(terms: ExactTerms) -> [f32; 6] {
    let ([gx, gy], [hxx, hxy, hyy]) = (terms.gradient, terms.hessian);
    [gx, gy, hxx, hxy, hyy, terms.depth_sigma]
}

#[inline(always)]
fn terms_of([gx, gy, hxx, hxy, hyy, depth_sigma]: [f32; 6]) -> ExactTerms {
    ExactTerms {
        gradient: [gx, gy],
        hessian: [hxx, hxy, hyy],
        depth_sigma,
        edges: 0,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;
    use crate::cpu::project::footprint::footprint;
    use crate::simd::{SimdLevel, SimdWork, run_at};

    struct Project<'a>(&'a mut Batch, Shared<'a>);

    impl SimdWork for Project<'_> {
        type Output = ();

        #[inline(always)]
        fn run<const FMA: bool, const WIDTH: usize>(self) {
            self.0.project(self.1);
        }
    }

    fn view(filter: Filter, is_orthographic: bool) -> ViewUniform {
        let zeroed: ViewUniform = bytemuck::Zeroable::zeroed();
        ViewUniform {
            focal_px: [400.0, 380.0],
            centre_px: [160.0, 120.0],
            size: [320, 240],
            orthographic: is_orthographic.into(),
            filter_kind: filter as u32,
            low_pass_variance_px2: 0.3,
            tolerance: 1.0 / 255.0,
            ..zeroed
        }
    }

    /// A sequence of numbers from 0 to 1: the golden ratio's multiples, scrambled.
    struct Random(u64);

    impl Random {
        fn range(&mut self, low: f32, high: f32) -> f32 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            low + (high - low) * ((mixed ^ mixed >> 27) >> 40) as f32 / (1_u64 << 24) as f32
        }
    }

    /// Returns a random kernel: from far below a pixel to across the eye, from round to needles.
    fn kernel(random: &mut Random) -> Kernel {
        let mut vector = || Vec3::from_array(std::array::from_fn(|_| random.range(-1.0, 1.0)));
        let (place, x, y, z) = (vector(), vector(), vector(), vector());
        let width = 10_f32.powf(random.range(-4.0, 0.5));
        let thin = Vec3::new(1.0, 10_f32.powf(random.range(-4.0, 0.0)), 1.0);
        Kernel {
            centre: place + Vec3::Z * random.range(-0.5, 4.0),
            factor: Factor {
                x: x * thin * width,
                y: y * thin * width,
                z: z * thin * width,
            },
            mass: 10_f32.powf(random.range(-8.0, 0.0)),
        }
    }

    #[test]
    fn lanes_are_what_each_kernel_is_by_itself_at_every_level() {
        let mut random = Random(5);
        let (mut in_lanes, mut exact) = (0, 0);
        for filter in Filter::ALL.into_iter().filter(|f| Batch::takes(*f)) {
            for is_orthographic in [false, true] {
                let view = view(filter, is_orthographic);
                for round in 0..200 {
                    let shared = Shared {
                        view: &view,
                        filter,
                        crowding: if round % 3 == 0 { 4.0 } else { 1.0 },
                        is_cut: round % 2 == 0,
                    };
                    let kernels: [Kernel; LANES] = std::array::from_fn(|_| kernel(&mut random));
                    let mut batch = Batch::new();
                    for (lane, kernel) in kernels.iter().enumerate() {
                        batch.set(lane, kernel);
                    }
                    batch.project(shared);
                    for level in SimdLevel::available() {
                        let mut at_level = batch.clone();
                        run_at(level, Project(&mut at_level, shared));
                        for lane in 0..LANES {
                            let found = [&batch, &at_level].map(|b| b.own(lane, shared.is_cut));
                            assert_eq!(found[0], found[1], "{level:?}");
                        }
                    }
                    for (lane, kernel) in kernels.iter().enumerate() {
                        if !batch.is_plain(lane) {
                            continue;
                        }
                        let (mut terms, near) = (None, Mutex::new(Vec::new()));
                        let carried = Carried::of_sign(1.0);
                        let alone = footprint(
                            &view,
                            filter,
                            false,
                            kernel,
                            shared.crowding,
                            carried,
                            7,
                            shared.is_cut,
                            &mut terms,
                            &near,
                        );
                        assert!(near.into_inner().unwrap().is_empty());
                        let (own, own_terms) = batch.own(lane, shared.is_cut);
                        compare(&own, &alone, &format!("{filter:?} {kernel:?}"));
                        // The terms of a footprint that reaches no pixel are not read.
                        if alone.is_visible() {
                            assert_eq!(own_terms, terms, "{filter:?} {kernel:?}");
                        }
                        in_lanes += 1;
                        exact += u32::from(own.path == PATH_EXACT);
                    }
                }
            }
        }
        assert!(in_lanes > 20_000 && exact > 2000, "{in_lanes} {exact}");
    }

    impl Batch {
        fn own(&self, lane: usize, is_cut: bool) -> (Footprint, Option<ExactTerms>) {
            if !self.is_plain(lane) {
                return (bytemuck::Zeroable::zeroed(), None);
            }
            let footprint = self.footprint(lane, Carried::of_sign(1.0), 7);
            (footprint, self.terms(lane, is_cut))
        }
    }

    fn compare(own: &Footprint, alone: &Footprint, what: &str) {
        assert_eq!(own.is_visible(), alone.is_visible(), "{what}");
        if !alone.is_visible() {
            return;
        }
        // The same operations except for the order of two divisions.
        assert!((own.tau / alone.tau - 1.0).abs() < 3e-7, "{what}");
        let own = Footprint {
            tau: alone.tau,
            ..*own
        };
        assert_eq!(own, *alone, "{what}");
    }
}
