//! Provides inputs, random kernels, reference formulas and frames for several test programs.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses a part, as a module of its own"
)]
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "judges narrow on purpose; a test fails by panicking"
)]

#[cfg(feature = "gpu")]
pub mod gpu;

use std::path::{Path, PathBuf};

use ewa_splat::image::DepthImage;
use ewa_splat::io::{Association, Field, FieldSource};
use ewa_splat::math::Factor;
use ewa_splat::render::Advanced;
use ewa_splat::scene::Values;
use ewa_splat::stages::record::ViewUniform;
use ewa_splat::stages::splat::{Filter, Kernel};
use glam::{DMat3, DVec3, Vec3};
use serde_json::Value;

/// Returns a field of single-precision numbers without a unit.
pub fn scalar(name: &str, association: Association, values: Vec<f32>) -> Field {
    Field {
        name: name.into(),
        association,
        source: FieldSource::Scalar(Values::F32(values)),
        unit: None,
    }
}

/// Returns the default of what is rarely changed, but with one sample a pixel: for laws along rays, and for images of
/// the kernels.
pub fn one_sample() -> Advanced {
    Advanced {
        opaque_edges: false,
        ..Advanced::default()
    }
}

/// Returns all of a list if every view and tolerance is to be tried (`EWA_ALL=1`); otherwise every
/// `step`-th from the `first` on. The default reduces breadth only: another test, or the rest of
/// the list, checks the same law.
pub fn some<T>(all: impl IntoIterator<Item = T>, first: usize, step: usize) -> Vec<T> {
    let is_all = std::env::var_os("EWA_ALL").is_some_and(|v| v == "1");
    let all = all.into_iter();
    if is_all {
        all.collect()
    } else {
        all.skip(first % step).step_by(step).collect()
    }
}

/// Reads a JSON file of `fixtures/`.
pub fn fixture(name: &str) -> Value {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Returns the path of a small third-party input beside the real data, or prints a note and returns
/// `None` if it is absent.
pub fn case(name: &str) -> Option<PathBuf> {
    real_data(&format!("../cases/{name}"))
}

/// Returns the path of a real data file, or prints a note and returns `None` if it is absent.
pub fn real_data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("EWA_DATA_DIR").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    if path.is_file() {
        return Some(path);
    }
    let required = std::env::var_os("EWA_REQUIRE_DATA").is_some_and(|v| v == "1");
    assert!(!required, "{} is required and absent", path.display());
    println!("skipped: no {}", path.display());
    None
}

/// Returns the nodes of a grid, i fastest: `at` maps index fractions, each 0..1, to positions.
pub fn grid_nodes(dims: [usize; 3], at: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let [ni, nj, nk] = dims;
    let fraction = |i: usize, n: usize| i as f64 / (n - 1) as f64;
    (0..ni * nj * nk)
        .map(|n| [n % ni, n / ni % nj, n / (ni * nj)])
        .map(|[i, j, k]| {
            at(DVec3::new(
                fraction(i, ni),
                fraction(j, nj),
                fraction(k, nk),
            ))
        })
        .collect()
}

/// Returns the number at a JSON pointer.
pub fn number(value: &Value, pointer: &str) -> f64 {
    value
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("no {pointer}"))
}

/// Returns the numbers at a JSON pointer.
pub fn numbers(value: &Value, pointer: &str) -> Vec<f64> {
    let list = value.pointer(pointer).and_then(Value::as_array);
    let list = list.unwrap_or_else(|| panic!("no {pointer}"));
    list.iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Makes a kernel from camera-space rows of its factor.
pub fn kernel(centre: [f32; 3], rows: [[f32; 3]; 3], mass: f32) -> Kernel {
    let [x, y, z] = rows.map(Vec3::from);
    Kernel {
        centre: Vec3::from(centre),
        factor: Factor { x, y, z },
        mass,
    }
}

/// Makes a perspective view of 1024 x 768.
pub fn view(focal_px: [f32; 2], centre_px: [f32; 2], h2: f32) -> ViewUniform {
    ViewUniform {
        focal_px,
        centre_px,
        size: [1024, 768],
        orthographic: 0,
        filter_kind: Filter::Exact as u32,
        low_pass_variance_px2: h2,
        tolerance: 1.0 / 255.0,
        cutoff: 0.0,
        key_scale: 1.0,
        ..bytemuck::Zeroable::zeroed()
    }
}

/// Evaluates one splat at a pixel in the plainest form, f32. The rasteriser's vector loop must
/// equal it.
pub mod scalar {
    use ewa_splat::stages::record::{ExactTerms, ViewUniform};
    use ewa_splat::stages::splat::{ImageKernel, ScreenFactor};
    use glam::{Vec2, Vec3};

    /// Returns (Q, tau) of the affine footprint.
    pub fn affine(screen: &ScreenFactor, image: &ImageKernel, pixel: Vec2) -> (f32, f32) {
        let d = pixel - screen.centre_px;
        let [p, r] = image.triangular_form().map(Vec2::from);
        let q = p.dot(d).powi(2) + r.dot(d).powi(2);
        (q, image.tau * (-0.5 * q).exp())
    }

    /// Returns (w, tau) of the exact footprint.
    pub fn exact(
        view: &ViewUniform,
        screen: &ScreenFactor,
        image: &ImageKernel,
        terms: &ExactTerms,
        pixel: Vec2,
    ) -> (f32, f32) {
        let d = pixel - screen.centre_px;
        let [hxx, hxy, hyy] = terms.hessian;
        let w = 1.0
            + Vec2::from(terms.gradient).dot(d)
            + hxx * d.x * d.x
            + hxy * d.x * d.y
            + hyy * d.y * d.y;
        let (q, _) = affine(screen, image, pixel);
        let slope = (pixel - Vec2::from(view.centre_px)) / Vec2::from(view.focal_px);
        let ray = Vec3::new(slope.x, slope.y, 1.0).length();
        (
            w,
            image.tau * ray / screen.ray_length / w.sqrt() * (-0.5 * q / w).exp(),
        )
    }
}

/// SplitMix64 (Steele et al. 2014), seeded so that a failure can be reproduced.
pub struct Random(u64);

impl Random {
    /// Creates the generator of the sequence number `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Returns 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Returns a number uniform in \[low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a number whose logarithm is uniform.
    pub fn log_range(&mut self, low: f64, high: f64) -> f64 {
        self.range(low.ln(), high.ln()).exp()
    }

    /// Returns an index below `count`.
    pub fn index(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Returns a point uniform in a cube.
    pub fn point(&mut self, half_side: f64) -> DVec3 {
        let mut x = || self.range(-half_side, half_side);
        DVec3::new(x(), x(), x())
    }

    /// Returns an approximately uniform rotation: two random directions, orthonormalised.
    pub fn rotation(&mut self) -> DMat3 {
        loop {
            let (a, b) = (self.point(1.0), self.point(1.0));
            if a.length() < 1.0 && a.length() > 0.1 && a.cross(b).length() > 0.05 {
                let x = a.normalize();
                let z = a.cross(b).normalize();
                return DMat3::from_cols(x, z.cross(x), z);
            }
        }
    }

    /// Returns a factor in a random direction. Its largest standard deviation is `largest`, its
    /// smallest `largest / ratio`, and one lies between.
    pub fn factor(&mut self, largest: f64, ratio: f64) -> DMat3 {
        let sigmas = DVec3::new(
            largest,
            largest / self.log_range(1.0, ratio),
            largest / ratio,
        );
        self.rotation() * DMat3::from_diagonal(sigmas) * self.rotation()
    }
}

/// Returns the lower-triangular L with L Lᵀ = F Fᵀ, packed as the particles store it. Gram-Schmidt
/// on the rows of F avoids forming the variance.
pub fn lower_factor(f: &DMat3) -> [f32; 6] {
    let (r0, r1, r2) = (f.row(0), f.row(1), f.row(2));
    let l00 = r0.length();
    let e0 = r0.normalize_or_zero();
    let l10 = r1.dot(e0);
    let rest = r1 - e0 * l10;
    let l11 = rest.length();
    let e1 = rest.normalize_or_zero();
    let (l20, l21) = (r2.dot(e0), r2.dot(e1));
    let l22 = (r2 - e0 * l20 - e1 * l21).length();
    [l00, l10, l11, l20, l21, l22].map(|l| l as f32)
}

/// Computes the expected values of the formulas in f64, by other methods: it forms variances,
/// inverts matrices and sums integrals. The relative error is about 1e-16 times the square of the
/// axis ratio.
pub mod judge {
    use ewa_splat::stages::record::ViewUniform;
    use ewa_splat::stages::splat::Kernel;
    use glam::{DMat2, DMat3, DVec2, DVec3};

    /// Kernel in camera space with its variance.
    #[derive(Debug, Clone, Copy)]
    pub struct Body {
        /// u_k.
        pub centre: DVec3,
        /// V, no filter added.
        pub variance: DMat3,
        /// g.
        pub mass: f64,
    }

    impl Body {
        /// Converts an f32 kernel without rounding.
        pub fn of(kernel: &Kernel) -> Self {
            let f = &kernel.factor;
            let rows = [f.x, f.y, f.z].map(glam::Vec3::as_dvec3);
            let f = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            Self {
                centre: kernel.centre.as_dvec3(),
                variance: f * f.transpose(),
                mass: f64::from(kernel.mass),
            }
        }

        /// Returns V + depth² diag(h²/fx², h²/fy², 0): the low-pass filter in three dimensions.
        pub fn low_passed(&self, focal: DVec2, h2: f64, depth: f64) -> Self {
            let slope = DVec2::splat(depth) / focal;
            let added = DMat3::from_diagonal((slope * slope * h2).extend(0.0));
            Self {
                variance: self.variance + added,
                ..*self
            }
        }

        /// Returns g times the integral of the Gaussian along the whole line t D, Euclidean arc
        /// length.
        pub fn line_integral(&self, d: DVec3) -> f64 {
            let adjugate = adjugate(&self.variance);
            let c = self.centre.cross(d);
            let across = d.dot(adjugate * d);
            let q = c.dot(self.variance * c) / across;
            self.mass * d.length() / (std::f64::consts::TAU * across.sqrt()) * (-0.5 * q).exp()
        }

        /// Returns the largest value of any line integral along z.
        pub fn line_integral_orthographic(&self) -> f64 {
            let v = &self.variance;
            let determinant = v.x_axis.x * v.y_axis.y - v.x_axis.y * v.x_axis.y;
            self.mass / (std::f64::consts::TAU * determinant.sqrt())
        }

        /// Returns g times the integral along the half line start + t D, t > 0, by Simpson's rule
        /// on the Gaussian itself.
        pub fn half_line_integral(&self, start: DVec3, d: DVec3) -> f64 {
            let inverse = self.variance.inverse();
            let u = self.centre - start;
            let (mean, sigma) = {
                let curvature = d.dot(inverse * d);
                (d.dot(inverse * u) / curvature, curvature.sqrt().recip())
            };
            let (from, to) = ((mean - 9.0 * sigma).max(0.0), mean + 9.0 * sigma);
            if to <= from {
                return 0.0;
            }
            const STEPS: usize = 400;
            let step = (to - from) / STEPS as f64;
            let sum: f64 = (0..=STEPS)
                .map(|i| {
                    let x = d * (from + step * i as f64) - u;
                    let weight = if i == 0 || i == STEPS {
                        1.0
                    } else {
                        2.0 + 2.0 * (i % 2) as f64
                    };
                    weight * (-0.5 * x.dot(inverse * x)).exp()
                })
                .sum();
            let peak = (std::f64::consts::TAU.powi(3) * self.variance.determinant())
                .sqrt()
                .recip();
            self.mass * d.length() * peak * sum * step / 3.0
        }

        /// Returns the footprint's variance in px² by the paper's Jacobian of a perspective camera.
        pub fn projected(&self, focal: DVec2) -> DMat2 {
            let u = self.centre;
            let x = DVec3::new(focal.x / u.z, 0.0, -focal.x * u.x / (u.z * u.z));
            let y = DVec3::new(0.0, focal.y / u.z, -focal.y * u.y / (u.z * u.z));
            let (vx, vy) = (self.variance * x, self.variance * y);
            DMat2::from_cols(
                DVec2::new(x.dot(vx), x.dot(vy)),
                DVec2::new(x.dot(vy), y.dot(vy)),
            )
        }
    }

    /// Returns adj(V) of a symmetric V.
    pub fn adjugate(v: &DMat3) -> DMat3 {
        DMat3::from_cols(
            v.y_axis.cross(v.z_axis),
            v.z_axis.cross(v.x_axis),
            v.x_axis.cross(v.y_axis),
        )
    }

    /// Returns the lower-triangular factor of a 2x2 variance, by columns.
    pub fn cholesky(v: &DMat2) -> DMat2 {
        let l0 = v.x_axis.x.sqrt();
        let l1 = v.x_axis.y / l0;
        let l2 = (v.y_axis.y - l1 * l1).max(0.0).sqrt();
        DMat2::from_cols(DVec2::new(l0, l1), DVec2::new(0.0, l2))
    }

    /// Returns the smaller and the larger eigenvalue of a 2x2 variance.
    pub fn eigenvalues(v: &DMat2) -> (f64, f64) {
        let (a, b, c) = (v.x_axis.x, v.x_axis.y, v.y_axis.y);
        let large = 0.5 * (a + c) + (0.5 * (a - c)).hypot(b);
        ((a * c - b * b) / large, large)
    }

    /// Returns the focal lengths of a view.
    pub fn focal(view: &ViewUniform) -> DVec2 {
        DVec2::new(f64::from(view.focal_px[0]), f64::from(view.focal_px[1]))
    }
}

/// Draws random kernels in front of a perspective camera, with the reference values for them.
pub mod draw {
    use ewa_splat::stages::record::ViewUniform;
    use ewa_splat::stages::splat::Kernel;
    use glam::{DMat2, DVec2, DVec3};

    use super::judge::{self, Body};
    use super::{Random, kernel, view};

    /// Half a unit in the last place of f32, relative.
    pub const EPS: f64 = 5.960_464_477_539_063e-8;

    /// Ranges from which a test draws its kernels.
    #[derive(Debug, Clone, Copy)]
    pub struct Draw {
        /// Largest axis ratio.
        pub ratio: f64,
        /// Smallest and largest value of the largest standard deviation over the distance.
        pub size: [f64; 2],
        /// Largest angle between the direction of the kernel's centre and the optical axis.
        pub off_axis_deg: f64,
        pub h2: f32,
    }

    /// Draws a kernel in front of the camera. Its ellipsoid at 3.4 standard deviations, the default
    /// cut-off, does not touch the camera plane.
    pub fn draw(random: &mut Random, from: Draw) -> (ViewUniform, Kernel) {
        loop {
            let fx = random.log_range(100.0, 2000.0);
            let fy = fx * random.log_range(0.5, 2.0);
            let v = view([fx as f32, fy as f32], [512.0, 384.0], from.h2);
            let distance = random.log_range(1.0, 1000.0);
            let (angle, around) = (
                random.range(0.0, from.off_axis_deg).to_radians(),
                random.range(0.0, 6.3),
            );
            let direction = DVec3::new(
                angle.sin() * around.cos(),
                angle.sin() * around.sin(),
                angle.cos(),
            );
            let largest = distance * random.log_range(from.size[0], from.size[1]);
            let ratio = random.log_range(1.0, from.ratio);
            let factor = random.factor(largest, ratio);
            let rows = [0, 1, 2].map(|i| factor.row(i).as_vec3().to_array());
            let k = kernel((direction * distance).as_vec3().to_array(), rows, 1.0);
            if 3.4 * k.factor.z.length() < k.centre.z {
                return (v, k);
            }
        }
    }

    /// Returns D through the pixel at offset `d` from the kernel's own, f64 centre.
    pub fn ray(v: &ViewUniform, body: &Body, d: DVec2) -> DVec3 {
        let slope = body.centre.truncate() / body.centre.z + d / judge::focal(v);
        slope.extend(1.0)
    }

    /// Returns the low-passed body, its footprint's variance and that variance's factor.
    pub fn judged(v: &ViewUniform, k: &Kernel) -> (Body, DMat2, DMat2) {
        let bare = Body::of(k);
        let body = bare.low_passed(
            judge::focal(v),
            f64::from(v.low_pass_variance_px2),
            bare.centre.z,
        );
        let variance = body.projected(judge::focal(v));
        (body, variance, judge::cholesky(&variance))
    }
}

/// Makes scenes and cameras with little code.
pub mod scene {
    use ewa_splat::render::Advanced;
    use ewa_splat::scene::{Colour, Particles, PointVolume, Strength};
    use ewa_splat::view::{Camera, Projection};
    use ewa_splat::{Image, Renderer, Settings};
    use glam::{DMat3, DVec2, DVec3};

    /// Particle in world space.
    #[derive(Debug, Clone, Copy)]
    pub struct Particle {
        pub position: DVec3,
        /// A factor F of the variance F Fᵀ.
        pub factor: DMat3,
        pub mass: f32,
        pub colour: [f32; 3],
    }

    impl Particle {
        /// Makes a white sphere.
        pub fn sphere(position: DVec3, sigma: f64, mass: f64) -> Self {
            Self {
                position,
                factor: DMat3::from_diagonal(DVec3::splat(sigma)),
                mass: mass as f32,
                colour: [1.0; 3],
            }
        }

        /// Returns this particle in another colour.
        pub fn coloured(self, colour: [f32; 3]) -> Self {
            Self { colour, ..self }
        }
    }

    /// Makes an anisotropic volume.
    pub fn volume(particles: &[Particle]) -> PointVolume {
        PointVolume {
            colour: Colour::PerParticle(particles.iter().map(|p| p.colour).collect()),
            ..PointVolume::new(
                Particles::Anisotropic {
                    positions: particles.iter().map(|p| p.position).collect(),
                    factors: particles
                        .iter()
                        .map(|p| super::lower_factor(&p.factor))
                        .collect(),
                },
                Strength::Mass(particles.iter().map(|p| p.mass).collect()),
            )
        }
    }

    /// Makes a camera at the origin that looks along +z with x to the right and y down.
    pub fn camera(projection: Projection, focal: [f64; 2], size: [usize; 2]) -> Camera {
        Camera {
            projection,
            eye: DVec3::ZERO,
            camera_from_world: DMat3::IDENTITY,
            focal_px: DVec2::from(focal),
            centre_px: DVec2::new(size[0] as f64, size[1] as f64) / 2.0,
            width: size[0],
            height: size[1],
        }
    }

    /// Draws a hundred or more overlapping kernels with total depth 1 to 100. Cameras are wide to
    /// narrow and look past them by up to 45 degrees.
    pub fn overlapping(random: &mut super::Random) -> (Vec<Particle>, Camera) {
        let focal = DVec2::new(1.2, 1.0) * random.log_range(50.0, 5000.0);
        let mut camera = camera(Projection::Perspective, focal.into(), [64, 64]);
        let past = random.point(0.7).truncate();
        camera.centre_px -= focal * past;
        let window = 36.0 / focal.y;
        let count = 100 + random.index(900);
        let depth = random.log_range(1.0, 100.0);
        let eps = random.log_range(0.2, 6.0) / focal.y;
        let particles = (0..count)
            .map(|_| {
                let slope = past + random.point(window).truncate();
                let z = random.range(3.0, 6.0);
                let largest = z * eps * random.log_range(0.5, 2.0);
                let ratio = random.log_range(1.0, 10.0);
                let factor = random.factor(largest, ratio);
                let position = (slope * z).extend(z);
                let v = factor * factor.transpose();
                let area = std::f64::consts::TAU * v.determinant().cbrt();
                // All kernels together have the optical depth `depth` in their window.
                let mass = depth * (2.0 * window * z).powi(2) / count as f64;
                let mass = mass * random.log_range(0.3, 3.0);
                Particle {
                    position,
                    factor,
                    mass: mass.min(area * 100.0) as f32,
                    colour: [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32),
                }
            })
            .collect();
        (particles, camera)
    }

    /// Returns settings that put the optical depths tau into the alpha channel (for tau below 1),
    /// without a cut-off.
    pub fn linear() -> Settings {
        Settings {
            advanced: Advanced {
                linear_opacity: true,
                ..Advanced::default()
            },
            cutoff: Some(7.0),
            ..Settings::default()
        }
    }

    /// Renders once, on the CPU. Pictures of one volume are compared with the GPU's, by sampling.
    #[track_caller]
    pub fn render(scene: Vec<PointVolume>, camera: &Camera, settings: &Settings) -> Image {
        #[cfg(feature = "gpu")]
        if let [volume] = scene.as_slice() {
            super::gpu::hold_sampled(volume, camera, settings);
        }
        let mut renderer = Renderer::new(scene).unwrap();
        renderer.render(camera, settings).unwrap();
        renderer.image().clone()
    }

    /// Returns the largest difference in any channel of any pixel; NaN counts as infinite.
    pub fn difference(a: &Image, b: &Image) -> f32 {
        assert_eq!((a.width, a.height), (b.width, b.height));
        let channels = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
        channels.fold(0.0, |most, (x, y)| {
            let d = (x - y).abs();
            if d <= most {
                most
            } else if d.is_nan() {
                f32::INFINITY
            } else {
                d
            }
        })
    }

    /// Returns the sum of alpha over the pixels.
    pub fn alpha_sum(image: &Image) -> f64 {
        image.pixels.iter().map(|p| f64::from(p[3])).sum()
    }
}

/// Splits a frame into its stages, up to the sorted order.
pub mod frame {
    use ewa_splat::Filter;
    use ewa_splat::Settings;
    use ewa_splat::render::{Classification, SimdLevel};
    use ewa_splat::scene::PointVolume;
    use ewa_splat::stages::blocks::{BlockedVolume, DepthRange, Frustum, cull, distance_interval};
    use ewa_splat::stages::constants::{MAX_CUTOFF, TILE_SIZE};
    use ewa_splat::stages::cpu::{self, Bins, ProjectOutput, RasteriseSettings, Tile};
    use ewa_splat::stages::record::{
        BlockView, ChoiceUniform, ClassifiedParticle, ExactTerms, Footprint, FootprintTerms,
        KeyKind, NearTerms, PieceTerms, SurfelTerms, ViewUniform,
    };
    use ewa_splat::stages::splat::Axes;
    use ewa_splat::view::{Camera, Projection};

    /// Data that the stages of one frame of one volume pass on.
    #[derive(Debug)]
    pub struct Frame {
        pub volume: BlockedVolume,
        pub camera: Camera,
        pub settings: Settings,
        pub frustum: Frustum,
        pub views: Vec<BlockView>,
        pub uniform: ViewUniform,
        pub classified: Vec<ClassifiedParticle>,
        /// Their terms, if kernels are classified over their extents.
        pub pieces: Vec<PieceTerms>,
        pub footprints: Vec<Footprint>,
        pub exact: Vec<ExactTerms>,
        pub surfels: Vec<SurfelTerms>,
        pub near: Vec<NearTerms>,
        pub any_exact: bool,
        pub order: Vec<u64>,
        /// Number of tiles along x and y.
        pub tiles: [usize; 2],
    }

    impl Frame {
        /// Runs cull, classify, project and sort.
        pub fn new(volume: PointVolume, camera: &Camera, settings: &Settings) -> Self {
            let margin = f64::from(MAX_CUTOFF) * f64::from(settings.low_pass_variance_px2).sqrt();
            Self::with(volume, camera, settings, Frustum::new(camera, margin))
        }

        /// Runs the same stages on all blocks in front of the eye's plane, even beside the image:
        /// an enormous margin opens the camera's frustum to nearly 180 degrees.
        pub fn uncut(volume: PointVolume, camera: &Camera, settings: &Settings) -> Self {
            Self::with(volume, camera, settings, Frustum::new(camera, 1e9))
        }

        /// Rasterises its lists in the plainest code, without fused operations. Returns the tiles
        /// and the count of splat-pixels.
        pub fn rasterised(&self, bins: &Bins, axes: Axes, surface: &[Tile]) -> (Vec<Tile>, u64) {
            let mut tiles = vec![Tile::default(); self.tiles[0] * self.tiles[1]];
            let settings = RasteriseSettings {
                axes,
                level: SimdLevel::Baseline,
                ends: None,
                task: None,
            };
            let splat_pixels = cpu::rasterise(
                &self.uniform,
                settings,
                &self.footprints,
                &self.exact,
                &self.near,
                bins,
                self.tiles[0],
                surface,
                None,
                &mut tiles,
            );
            (tiles, splat_pixels)
        }

        fn with(
            volume: PointVolume,
            camera: &Camera,
            settings: &Settings,
            frustum: Frustum,
        ) -> Self {
            let volume = BlockedVolume::new(volume);
            let mut views = Vec::new();
            let by_extent = settings.classify != Classification::Particle && volume.lobes.is_some();
            let choice = ChoiceUniform {
                classified_by: by_extent.into(),
                ..bytemuck::Zeroable::zeroed()
            };
            cull(&volume, camera, Some(&frustum), &choice, &mut views);
            let interval = |v: &BlockView| {
                let block = &volume.blocks[v.block as usize];
                distance_interval(camera, block, v.is_spread())
            };
            let range = DepthRange::of(views.iter().map(interval));
            for v in &mut views {
                let block = &volume.blocks[v.block as usize];
                v.key = range.key(distance_interval(camera, block, false).0);
                v.filter_kind = settings.filter as u32;
            }
            let uniform = ViewUniform {
                focal_px: camera.focal_px.as_vec2().into(),
                centre_px: camera.centre_px.as_vec2().into(),
                size: [camera.width as u32, camera.height as u32],
                orthographic: u32::from(camera.projection == Projection::Orthographic),
                key_kind: match camera.projection {
                    Projection::Perspective => KeyKind::Distance as u32,
                    Projection::Orthographic => KeyKind::Depth as u32,
                },
                filter_kind: settings.filter as u32,
                low_pass_variance_px2: settings.low_pass_variance_px2,
                tolerance: settings.tolerance,
                cutoff: settings.cutoff.unwrap_or(0.0),
                key_scale: range.keys_per_unit(),
                ..bytemuck::Zeroable::zeroed()
            };
            let mut found = cpu::Pieces::default();
            let total = if by_extent {
                found.find(&volume, &mut views)
            } else {
                cpu::count_classified(&volume, &mut views)
            };
            let mut classified: Vec<ClassifiedParticle> = vec![bytemuck::Zeroable::zeroed(); total];
            let mut pieces = vec![PieceTerms::WHOLE; if by_extent { total } else { 0 }];
            if by_extent {
                found.place(&mut classified, &mut pieces);
            } else {
                cpu::classify(&volume, &views, &mut classified);
            }
            let may_be_exact = matches!(settings.filter, Filter::Adaptive | Filter::Exact)
                && camera.projection == Projection::Perspective
                && !volume.is_surface();
            let surfels = if volume.is_surface() { total } else { 0 };
            let mut frame = Self {
                footprints: vec![bytemuck::Zeroable::zeroed(); total],
                exact: vec![ExactTerms::default(); if may_be_exact { total } else { 0 }],
                surfels: vec![SurfelTerms::default(); surfels],
                near: Vec::new(),
                any_exact: false,
                order: Vec::new(),
                tiles: [
                    camera.width.div_ceil(TILE_SIZE),
                    camera.height.div_ceil(TILE_SIZE),
                ],
                camera: camera.clone(),
                settings: settings.clone(),
                volume,
                frustum,
                views,
                uniform,
                classified,
                pieces,
            };
            frame.project();
            cpu::sort(&frame.footprints, &mut frame.order);
            frame
        }

        /// Runs the projection alone, again.
        pub fn project(&mut self) {
            self.project_as(false);
        }

        /// Runs the projection again; if `is_cut`, of kernels that are to be cut.
        pub fn project_as(&mut self, is_cut: bool) {
            let mut output = ProjectOutput::default();
            cpu::project(
                &cpu::ProjectInput {
                    volume: &self.volume,
                    views: &self.views,
                    classified: &self.classified,
                    pieces: &self.pieces,
                    view: &self.uniform,
                    rotation: self.camera.camera_from_world.as_mat3(),
                    is_cut,
                    has_edges: false,
                    level: cpu::SimdLevel::best(),
                },
                &mut self.footprints,
                &mut self.exact,
                &mut self.surfels,
                &output,
            );
            self.any_exact = output.exact_count() > 0;
            self.near = output.near().to_vec();
        }

        /// Returns the additional terms of the footprints.
        pub fn terms(&self) -> FootprintTerms<'_> {
            if self.volume.is_surface() {
                FootprintTerms::Surfel(&self.surfels)
            } else {
                FootprintTerms::Exact(&self.exact)
            }
        }

        /// Returns the tiles' lists.
        pub fn bins(&self) -> Bins {
            let mut bins = Bins::default();
            cpu::bin(
                &self.footprints,
                self.terms(),
                &self.order,
                self.tiles[0],
                0..self.tiles[0] * self.tiles[1],
                &mut bins,
            );
            bins
        }
    }
}

/// Returns the depths of tiles that cover an image of a given size.
pub fn depth_of(tiles: &[ewa_splat::stages::cpu::Tile], [width, height]: [usize; 2]) -> DepthImage {
    let mut image = DepthImage {
        width,
        height,
        depths: vec![0.0; width * height],
    };
    ewa_splat::stages::cpu::resolve_depth(tiles, &mut image);
    image
}
