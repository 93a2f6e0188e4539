//! Computes reference images under directional lights with shadows: single scattering.
//!
//! A particle reflects by the model of [`Lighting`], once for its centre, as the renderer defines it. What
//! differs from place to place is the transmittance to a light. It is integrated in closed form along the ray
//! to the light from every step of every ray. Opaque surfels hide a light by the shares that
//! `surface.rs` defines.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Integrator;
use super::kernel::{Kernel, Segment};
use super::settings::PixelFilter;
use super::sight::{Sight, between};
use super::surface::{Fragment, surfaces};
use super::traversal::Traversal;
use crate::error::Result;
use crate::math::normal_density_and_cdf;
use crate::scene::{LightFrame, Lighting};
use crate::view::{Camera, ClipPlane, Projection};

/// Directions that stand for a light with a size.
const DIRECTIONS: usize = 64;

/// Places of a kernel at which a ray is divided, standard deviations.
const EVENTS: [f64; 17] = [
    -4.0, -3.0, -2.5, -2.0, -1.5, -1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0,
];

/// Least distance between divisions, standard deviations of their kernels. The integral is of second order:
/// halving it changes no pixel of the tests by 1e-4.
const STEP: f64 = 0.3;

/// Least light of a step that counts.
const FAINT: f64 = 1e-7;

/// Colours of a particle: what it shows without light, and what each light adds.
#[derive(Debug, Clone, Default)]
struct Reflected {
    ambient: DVec3,
    lights: Vec<DVec3>,
}

struct View<'a> {
    sight: Sight<'a>,
    /// Kernels with the pixel's filter, and as they are.
    kernels: Vec<Kernel>,
    own: Vec<Kernel>,
    reflected: Vec<Reflected>,
    is_seen: Vec<bool>,
    toward_eye: Traversal,
    toward_light: Traversal,
    /// Unit vectors toward each light, camera space.
    directions: Vec<Vec<DVec3>>,
    clip: Vec<(DVec3, f64)>,
}

impl Integrator {
    /// Integrates pixels under lights, with their shadows if `lighting` has any: one ray through the centre of
    /// each, and the low-pass filter on kernels ([`PixelFilter::Kernels`]). Returns premultiplied linear colours and
    /// opacities.
    ///
    /// - `pixels`: columns and rows.
    ///
    /// # Errors
    /// Lights out of range; a camera without finite numbers.
    pub fn lit_pixels(
        &self,
        camera: &Camera,
        lighting: &Lighting,
        low_pass_variance_px2: f64,
        pixels: &[[usize; 2]],
    ) -> Result<Vec<[f64; 4]>> {
        lighting.validate()?;
        camera.validate()?;
        let view = View::new(self, camera, lighting, low_pass_variance_px2);
        let place = |[x, y]: &[usize; 2]| DVec2::new(*x as f64, *y as f64) + 0.5;
        Ok(pixels
            .par_iter()
            .map(|pixel| view.ray(place(pixel)))
            .collect())
    }
}

impl<'a> View<'a> {
    fn new(
        integrator: &'a Integrator,
        camera: &'a Camera,
        lighting: &Lighting,
        low_pass: f64,
    ) -> Self {
        let particles = &integrator.particles;
        let made = |filter| -> Vec<Kernel> {
            let of = |p| Kernel::new(p, camera, filter, low_pass);
            particles.iter().map(of).collect()
        };
        let kernels = made(PixelFilter::Kernels);
        let own = made(PixelFilter::Image);
        let turn = |p: &ClipPlane| (camera.camera_from_world * p.normal, p.inside(camera.eye));
        let lights: Vec<DVec3> = lighting
            .lights
            .iter()
            .map(|light| match light.frame {
                LightFrame::World => camera.camera_from_world * light.direction,
                LightFrame::Camera => light.direction,
            })
            .map(DVec3::normalize)
            .collect();
        let reflected = particles
            .iter()
            .zip(&own)
            .map(|(particle, kernel)| {
                let normal = camera.camera_from_world * particle.normal;
                let colour = DVec3::from(particle.colour);
                reflected(camera, lighting, &lights, kernel, normal, colour)
            })
            .collect();
        let softness = lighting.shadows.map_or(0.0, |own| own.softness_deg);
        let traversal = |kernels: &[Kernel]| {
            let bounds = |i: usize| (kernels[i].centre, kernels[i].half_extent());
            Traversal::new(kernels.len(), bounds)
        };
        let directions = match lighting.shadows {
            Some(_) => lights.iter().map(|l| spread(*l, softness)).collect(),
            None => vec![Vec::new(); lights.len()],
        };
        Self {
            sight: Sight::new(camera, &integrator.clip),
            toward_eye: traversal(&kernels),
            toward_light: traversal(&own),
            is_seen: own
                .iter()
                .map(|k| !integrator.clip.is_empty() || !k.is_turned_away(camera))
                .collect(),
            kernels,
            own,
            reflected,
            directions,
            clip: integrator.clip.iter().map(turn).collect(),
        }
    }

    /// Returns the light along the ray through a place of the image: premultiplied colour and opacity.
    fn ray(&self, pixel_px: DVec2) -> [f64; 4] {
        let (origin, direction) = self.sight.ray(pixel_px);
        let Some([near, far]) = self.sight.span(pixel_px, origin, direction) else {
            return [0.0; 4];
        };
        let mut segments: Vec<(Segment, usize)> = Vec::new();
        let mut fragments: Vec<(Fragment, usize)> = Vec::new();
        self.toward_eye.each(origin, direction, |i| {
            let kernel = &self.kernels[i];
            let Some(segment) = kernel.along(origin, direction) else {
                return;
            };
            if kernel.plane.is_some_and(|plane| plane.is_opaque) {
                if self.is_seen[i] && segment.mean > near && segment.mean < far {
                    let fragment = Fragment {
                        depth: segment.mean,
                        weight: segment.tau,
                        reach: kernel.gap(direction, &segment),
                        colour: [0.0; 3],
                    };
                    fragments.push((fragment, i));
                }
            } else if self.is_seen[i] {
                segments.push((segment, i));
            }
        });
        let at = |t: f64| origin + direction * t;
        let mut out = [0.0; 4];
        let mut left = 1.0;
        for (depth, share, members) in grouped(fragments) {
            let end = depth.min(far);
            let (front, through) = self.volumes(&segments, at, [near, end]);
            let place = at(depth);
            let mut colour = DVec3::ZERO;
            let mut weights = 0.0;
            for (i, weight) in &members {
                colour += self.colour(*i, |l| self.passed(l, place, true)) * *weight;
                weights += weight;
            }
            let light = front + colour * (through / weights);
            add(&mut out, light * share, share);
            left -= share;
        }
        if left > 0.0 {
            let (light, through) = self.volumes(&segments, at, [near, far]);
            add(&mut out, light * left, (1.0 - through) * left);
        }
        out
    }

    /// Returns the light of volumes between two places of a ray, and the share of light behind that passes.
    fn volumes(
        &self,
        segments: &[(Segment, usize)],
        at: impl Fn(f64) -> DVec3,
        [near, far]: [f64; 2],
    ) -> (DVec3, f64) {
        let mut events: Vec<(f64, f64)> = Vec::new();
        for (s, _) in segments {
            let [from, to] = s.domain;
            for e in EVENTS {
                events.push((s.mean + e * s.sigma, s.sigma));
            }
            events.extend([from, to].map(|t| (t, 0.0)));
        }
        events.retain(|(t, _)| *t > near && *t < far && t.is_finite());
        events.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut cuts = vec![near];
        for (t, sigma) in events {
            if t - cuts[cuts.len() - 1] >= STEP * sigma {
                cuts.push(t);
            }
        }
        if far.is_finite() {
            cuts.push(far);
        }
        let up_to =
            |t: f64| -> Vec<f64> { segments.iter().map(|(s, _)| depth_before(s, t)).collect() };
        let mut light = DVec3::ZERO;
        let mut depth = 0.0_f64;
        let mut before = up_to(near);
        for pair in cuts.windows(2) {
            let after = up_to(pair[1]);
            let own: Vec<f64> = after.iter().zip(&before).map(|(a, b)| a - b).collect();
            let sum: f64 = own.iter().sum();
            let shown = (-depth).exp() * -(-sum).exp_m1();
            if shown > FAINT {
                let place = at(0.5 * (pair[0] + pair[1]));
                let passed: Vec<f64> = (0..self.directions.len())
                    .map(|l| self.passed(l, place, false))
                    .collect();
                let mut mean = DVec3::ZERO;
                for (own, (_, i)) in own.iter().zip(segments) {
                    if *own > 0.0 {
                        mean += self.colour(*i, |l| passed[l]) * (*own / sum);
                    }
                }
                light += mean * shown;
            }
            depth += sum;
            before = after;
        }
        (light, (-depth).exp())
    }

    /// Returns the colour of a particle.
    ///
    /// - `passed`: share of a light that reaches it.
    fn colour(&self, i: usize, passed: impl Fn(usize) -> f64) -> DVec3 {
        let reflected = &self.reflected[i];
        let lights = reflected.lights.iter().enumerate();
        let lights = lights.filter(|(_, light)| **light != DVec3::ZERO);
        reflected.ambient + lights.map(|(l, light)| *light * passed(l)).sum::<DVec3>()
    }

    /// Returns the share of a light that reaches a place, camera space.
    ///
    /// - `on_surface`: the place lies on opaque surfels, which do not hide it from themselves.
    fn passed(&self, light: usize, place: DVec3, on_surface: bool) -> f64 {
        let directions = &self.directions[light];
        if directions.is_empty() {
            return 1.0;
        }
        let sum: f64 = directions
            .iter()
            .map(|direction| self.passed_along(place, *direction, on_surface))
            .sum();
        sum / directions.len() as f64
    }

    fn passed_along(&self, place: DVec3, direction: DVec3, on_surface: bool) -> f64 {
        let [near, far] = between(&self.clip, place, direction, 0.0);
        if near >= far {
            return 1.0;
        }
        let mut depth = 0.0;
        let mut fragments = Vec::new();
        self.toward_light.each(place, direction, |i| {
            let kernel = &self.own[i];
            let Some(segment) = kernel.along(place, direction) else {
                return;
            };
            if kernel.plane.is_some_and(|plane| plane.is_opaque) {
                let gap = kernel.gap(direction, &segment);
                let begin = if on_surface { near.max(gap) } else { near };
                if segment.mean > begin && segment.mean < far {
                    fragments.push(Fragment {
                        depth: segment.mean,
                        weight: segment.tau,
                        reach: gap,
                        colour: [0.0; 3],
                    });
                }
            } else {
                depth += depth_before(&segment, far) - depth_before(&segment, near);
            }
        });
        let mut met = Vec::new();
        surfaces(&mut fragments, &mut met);
        let hidden: f64 = met.iter().map(|surface| surface.share).sum();
        (-depth).exp() * (1.0 - hidden).max(0.0)
    }
}

/// A surface along a ray: its depth, its share, and its surfels with their weights.
type Group = (f64, f64, Vec<(usize, f64)>);

/// Returns the surfaces of a ray, as `surface.rs` groups them, with the surfels of each.
fn grouped(mut all: Vec<(Fragment, usize)>) -> Vec<Group> {
    all.sort_by(|a, b| a.0.depth.total_cmp(&b.0.depth));
    let is_one = |a: &(Fragment, usize), b: &(Fragment, usize)| {
        b.0.depth - a.0.depth <= a.0.reach.min(b.0.reach)
    };
    let mut room = 1.0_f64;
    let mut out = Vec::new();
    for group in all.chunk_by(is_one) {
        let weight: f64 = group.iter().map(|(f, _)| f.weight).sum();
        let depth: f64 = group.iter().map(|(f, _)| f.weight * f.depth).sum::<f64>() / weight;
        let share = weight.min(room);
        let members = group.iter().map(|(f, i)| (*i, f.weight)).collect();
        out.push((depth, share, members));
        room -= share;
        if room <= 0.0 {
            break;
        }
    }
    out
}

fn add(out: &mut [f64; 4], light: DVec3, opacity: f64) {
    for (sum, own) in out.iter_mut().zip(light.extend(opacity).to_array()) {
        *sum += own;
    }
}

/// Returns the optical depth of a kernel before a place of its ray.
fn depth_before(s: &Segment, t: f64) -> f64 {
    let share = |t: f64| {
        if t.is_infinite() || s.sigma == 0.0 {
            return if t > s.mean { 1.0 } else { 0.0 };
        }
        normal_density_and_cdf([(t - s.mean) / s.sigma]).1[0]
    };
    let [from, to] = s.domain;
    s.tau * (share(t.clamp(from, to)) - share(from))
}

/// Returns what a particle reflects: the model of [`Lighting`] in f64.
fn reflected(
    camera: &Camera,
    lighting: &Lighting,
    lights: &[DVec3],
    kernel: &Kernel,
    stored: DVec3,
    colour: DVec3,
) -> Reflected {
    let to_eye = match camera.projection {
        Projection::Perspective => -kernel.centre.normalize_or_zero(),
        Projection::Orthographic => -DVec3::Z,
    };
    let is_surface = kernel.plane.is_some();
    let mut normal = stored;
    if let Some(plane) = &kernel.plane {
        let outward = if plane.normal.dot(to_eye) < 0.0 {
            -plane.normal
        } else {
            plane.normal
        };
        normal = match stored == DVec3::ZERO {
            true => outward,
            false => stored * stored.dot(outward).signum(),
        };
    }
    if normal == DVec3::ZERO {
        return Reflected {
            ambient: colour,
            lights: Vec::new(),
        };
    }
    let seen = |cosine: f64| match is_surface {
        true => cosine.max(0.0),
        false => cosine.abs(),
    };
    let of_light = |(light, direction): (&crate::scene::Light, &DVec3)| {
        let diffuse = seen(normal.dot(*direction));
        if diffuse <= 0.0 {
            return DVec3::ZERO;
        }
        let halfway = (*direction + to_eye).normalize_or_zero();
        let highlight = seen(normal.dot(halfway)).powf(lighting.shininess.into());
        let own = DVec3::from(light.colour.map(f64::from));
        let matte = colour * own * (f64::from(lighting.diffuse) * diffuse);
        matte + own * (f64::from(lighting.specular) * highlight)
    };
    Reflected {
        ambient: colour * f64::from(lighting.ambient),
        lights: lighting.lights.iter().zip(lights).map(of_light).collect(),
    }
}

/// Returns directions whose tangents are spread about a light's as a Gaussian.
fn spread(light: DVec3, softness_deg: f64) -> Vec<DVec3> {
    if softness_deg == 0.0 {
        return vec![light];
    }
    let scale = softness_deg.to_radians().tan();
    let (a, b) = light.any_orthonormal_pair();
    (0..DIRECTIONS)
        .map(|i| {
            let radius = (-2.0 * (1.0 - (i as f64 + 0.5) / DIRECTIONS as f64).ln()).sqrt();
            let angle = i as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
            let across = a * angle.cos() + b * angle.sin();
            (light + across * (radius * scale)).normalize()
        })
        .collect()
}
