//! Computes reference images in f64: the images that splatting approximates.
//!
//! The integrator knows nothing of footprints, sorting or blocks. It follows rays through a scene's particles
//! and integrates equation 3 of Zwicker et al. 2001. Kernels may overlap; transmittance is in closed form. The
//! pixel's low-pass filter is applied to the image by supersampling, which is their equation 6. Every
//! approximation of the renderer is compared with it. `tests/frames/reference.rs` compares the integrator
//! itself with closed forms, a brute-force march and the published fixtures.
//!
//! Rays also meet the surfels of surfaces. The reference image of surfels is defined here; the renderer shares
//! this definition and nothing else. Along a ray each surfel has the weight area G(x), with G the Gaussian in
//! its plane and x the place where the ray meets the plane. Opaque surfels that lie together are averaged by
//! their weights, and cover min(1, sum of weights), the nearer before the farther. The covered share of a ray
//! ends at the surface, and volumes in front are integrated up to there (`surface.rs`; it defines which surfels
//! lie together). Translucent surfels are sheets of that weight times their optical depth. Clip planes cut the
//! ray; if there are any, one-sided surfels are seen from both sides.
//!
//! [`DataIntegrator`] computes the reference image of the data instead of their kernels. It integrates the
//! field of a grid itself, interpolated between its samples. Rays, the pixel's filter and clip planes are the
//! same.
//!
//! [`MeshTracer`] computes the reference image of a mesh: rays meet its triangles.
//!
//! Limits: a rod or a point (a variance of rank one or zero) has no line integral, and its reference image is
//! empty, because almost no ray meets it. [`PixelFilter::Kernels`] gives it the width of the pixel's filter and
//! shows it. Splats of radiance fields are refused: their opacity is a rule of drawing, not an integral.
//!
//! ```
//! use ewa_splat::reference::{Integrator, ReferenceSettings};
//! use ewa_splat::scene::PointVolume;
//! use ewa_splat::view::Camera;
//! use glam::DVec3;
//!
//! # fn main() -> ewa_splat::Result<()> {
//! let sphere = PointVolume::spheres([DVec3::ZERO], [0.5]).with_masses([1.0]);
//! let camera =
//!     Camera::perspective(DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO, DVec3::Z, 40.0, [16, 16]);
//! let integrator = Integrator::new(&[sphere])?;
//! let frame = integrator.render(&camera, &ReferenceSettings::default())?;
//! assert!(frame.error <= 1e-4);
//! // Along the axis the optical depth is g/(2 pi sigma^2); no filter stands in the way.
//! let ray = integrator.ray(&camera, camera.centre_px, 1e-12);
//! let depth: f64 = 1.0 / (std::f64::consts::TAU * 0.25);
//! assert!((ray.rgba[3] - (1.0 - (-depth).exp())).abs() < 1e-12);
//! # Ok(())
//! # }
//! ```

#![allow(
    clippy::cast_possible_truncation,
    reason = "pixels and levels are small; colours are narrowed on purpose"
)]

mod data;
mod gauss_kronrod;
mod kernel;
mod lit;
pub mod lobe;
mod mesh;
mod piece;
mod pixel;
mod ray;
mod settings;
mod sight;
mod surface;
mod traversal;

use glam::DVec2;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::image::DepthImage;
use crate::scene::{Classification, Colour, PointVolume, Strength};
use crate::view::{Camera, ClipPlane};
use kernel::{Kernel, Particle, Segment};
use pixel::{Detail, Rays};
use ray::Scratch;
use settings::check;
use sight::Sight;
use surface::Fragment;
use traversal::Traversal;

pub use data::DataIntegrator;
pub use mesh::{MeshTracer, MeshTracerSettings};
pub use ray::RayIntegral;
pub use settings::{PixelFilter, ReferenceFrame, ReferenceSettings};

/// A scene prepared for reference images: its visible particles, in f64.
#[derive(Debug, Clone)]
pub struct Integrator {
    particles: Vec<Particle>,
    /// Clip planes, world space.
    clip: Vec<ClipPlane>,
    /// Depths at which rays end.
    ends: Option<DepthImage>,
}

impl Integrator {
    /// Copies the scene's visible particles. Particles with numbers that are not finite are left out, as in the
    /// renderer.
    ///
    /// # Errors
    /// The errors of [`PointVolume::validate`]; splats, which state an opacity and no extinction; colours that
    /// depend on the view.
    pub fn new(scene: &[PointVolume]) -> Result<Self> {
        Self::classified(scene, Classification::default())
    }

    /// Copies the particles as [`Integrator::new`] does, with kernels classified at their centres or over their
    /// extents ([`Classification::Slab`] counts as the latter).
    ///
    /// # Errors
    /// The errors of [`Integrator::new`].
    pub fn classified(scene: &[PointVolume], classification: Classification) -> Result<Self> {
        for volume in scene {
            volume.validate()?;
            let is_splats = matches!(volume.strength, Strength::PeakOpacity { .. })
                || matches!(volume.colour, Colour::Harmonics { .. });
            if is_splats {
                return Err(Error::invalid(
                    "reference",
                    "scene",
                    "volumes with an extinction to integrate, and surfaces",
                    "splats, whose opacity on the image is stated and depends on no integral",
                    "render them without the reference",
                ));
            }
        }
        Ok(Self {
            particles: kernel::particles(scene, classification),
            clip: Vec::new(),
            ends: None,
        })
    }

    /// Adds clip planes that cut the scene.
    pub fn clipped(mut self, planes: &[ClipPlane]) -> Self {
        self.clip.extend_from_slice(planes);
        self
    }

    /// Ends the rays through each pixel at its depth, as a [`Backdrop`](crate::render::Backdrop) does. Images must have the
    /// size of the depths. Without depths rays have no end.
    pub fn ended(mut self, depth: Option<&DepthImage>) -> Self {
        self.ends = depth.cloned();
        self
    }

    /// Returns the number of particles that have a mass or an area.
    pub fn particle_count(&self) -> usize {
        self.particles.len()
    }

    /// Returns the light along one ray, unfiltered.
    ///
    /// - `pixel_px`: place of the image that the ray passes through, pixels.
    /// - `error`: error of red, green and blue, full scale 1; the opacity is exact.
    pub fn ray(&self, camera: &Camera, pixel_px: DVec2, error: f64) -> RayIntegral {
        let view = View::list(self, camera, PixelFilter::Image, 0.0);
        view.integrate(pixel_px, error, &mut Scratch::default())
    }

    /// Renders the reference image.
    ///
    /// # Errors
    /// An image without pixels; settings out of range; work that was cancelled.
    pub fn render(&self, camera: &Camera, settings: &ReferenceSettings) -> Result<ReferenceFrame> {
        check(camera, settings, self.ends.as_ref())?;
        let h2 = settings.low_pass_variance_px2;
        let mut view = View::list(self, camera, settings.pixel_filter, h2);
        view.traversal = {
            let bounds = |i: usize| (view.kernels[i].centre, view.kernels[i].half_extent());
            Traversal::new(view.kernels.len(), bounds)
        };
        pixel::image(&view, settings)
    }
}

/// The kernels as one camera sees them.
struct View<'a> {
    sight: Sight<'a>,
    kernels: Vec<Kernel>,
    traversal: Traversal,
}

impl<'a> View<'a> {
    fn list(integrator: &'a Integrator, camera: &'a Camera, filter: PixelFilter, h2: f64) -> Self {
        let kernels: Vec<Kernel> = integrator
            .particles
            .iter()
            .map(|p| Kernel::new(p, camera, filter, h2))
            // A cut shows the inside of closed surfaces.
            .filter(|k| !integrator.clip.is_empty() || !k.is_turned_away(camera))
            .collect();
        Self {
            sight: Sight::new(camera, &integrator.clip).ended(integrator.ends.as_ref()),
            traversal: Traversal::of_all(kernels.len()),
            kernels,
        }
    }
}

impl Rays for View<'_> {
    type Scratch = Scratch;

    fn camera(&self) -> &Camera {
        self.sight.camera
    }

    fn integrate(&self, pixel_px: DVec2, error: f64, scratch: &mut Scratch) -> RayIntegral {
        let (origin, direction) = self.sight.ray(pixel_px);
        scratch.segments.clear();
        let Some([near, far]) = self.sight.span(pixel_px, origin, direction) else {
            return RayIntegral::default();
        };
        scratch.fragments.clear();
        self.traversal.each(origin, direction, |i| {
            let k = &self.kernels[i];
            let Some(segment) = k.along(origin, direction) else {
                return;
            };
            // Relative to the start of the visible part.
            let mean = segment.mean - near;
            if k.plane.is_some_and(|plane| plane.is_opaque) {
                if mean > 0.0 && mean < far - near {
                    scratch.fragments.push(Fragment {
                        depth: mean,
                        weight: segment.tau,
                        reach: k.gap(direction, &segment),
                        colour: segment.colour,
                    });
                }
            } else {
                let domain = segment.domain.map(|t| t - near);
                if domain[0] < domain[1] {
                    scratch.segments.push(Segment {
                        mean,
                        domain,
                        ..segment
                    });
                }
            }
        });
        ray::integrate(scratch, far - near, error)
    }

    fn details(&self, settings: &ReferenceSettings) -> Vec<Detail> {
        let kernels = self.kernels.par_iter();
        kernels
            .filter_map(|k| Detail::of(k, self.sight.camera, settings))
            .collect()
    }
}
