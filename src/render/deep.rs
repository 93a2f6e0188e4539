//! Draws deep images: pictures whose rays end at ever more depths, until what lies between two of them is known.
//!
//! A picture with ends ([`Backdrop`]) gives the colour and the opacity that a pixel's ray has gathered up to a depth. In
//! every frame each pixel ends its ray in the middle of the interval that is least known. An interval is known once its
//! middle is what its ends predict, or if it adds almost nothing. Jumps, as at surfaces, are halved until their depth is.

use std::sync::Arc;

use rayon::prelude::*;

use super::renderer::Renderer;
use crate::constants::MAX_CUTOFF;
use crate::error::{Error, Result};
use crate::frame::backdrop::Backdrop;
use crate::frame::plan::FramePlan;
use crate::frame::settings::{Composite, Settings, Show};
use crate::image::{DeepImage, DeepSample, DepthImage, Image};
use crate::math::narrowed;
use crate::task::Stage;
use crate::view::{Camera, Projection};

/// Greatest number of frames. Opaque jumps take about 14 each, one after the other, volumes one for each of their samples.
const MOST_FRAMES: usize = 96;

/// Number of parts of the visible depths; a wider interval is halved even if its middle is what its ends predict.
const PARTS: f32 = 16.0;

/// Width of the depths of a surface, as a share of the visible depths.
const SURFACE_WIDTH: f32 = 1.0 / 8192.0;

/// Share of the tolerance by which the middle of a known interval may differ from what is predicted. The rest is for
/// samples that are joined, and for what lies between the middle and the ends.
const SHARE: f32 = 0.25;

/// Greatest opacity of an interval that may be known by its middle.
const MOST_OPACITY: f32 = 0.9;

/// A depth of a ray, and what the ray has gathered up to there.
#[derive(Debug, Clone, Copy)]
struct Knot {
    depth: f32,
    rgba: [f32; 4],
    /// True if the interval from here to the next knot is known.
    is_known: bool,
}

/// Bounds by which an interval is known.
struct Rule {
    /// Greatest part that may be missed.
    least: f32,
    /// Greatest width of an interval that is known by its middle.
    widest: f32,
    /// Width of the depths of a surface.
    narrow: f32,
}

impl Renderer {
    /// Draws a deep image: as [`Self::render`], with the colours and opacities along the ray of each pixel.
    ///
    /// Put something at any depth into it, and the picture differs from that with the same
    /// [`Settings::backdrop`] by about [`Settings::tolerance`] at most. It takes as many frames as pixels have samples,
    /// some ten to a hundred. Backgrounds are left out, and opaque edges are drawn at one sample a pixel. Afterwards
    /// [`Self::image`] is the whole picture.
    ///
    /// # Errors
    /// The errors of [`Self::render`]; a backdrop, colours that are composited in sRGB codes, or anything shown but the scene.
    pub fn render_deep(&mut self, camera: &Camera, settings: &Settings) -> Result<DeepImage> {
        let refuse = |expected: &str, found: &str| {
            let advice = "leave it out";
            Err(Error::invalid(
                "settings",
                "deep image",
                expected,
                found,
                advice,
            ))
        };
        if settings.backdrop.is_some() {
            return refuse(
                "all that lies along the rays",
                "a backdrop, which ends them",
            );
        }
        if settings.show != Show::Scene {
            return refuse("the scene", "counts or choices");
        }
        if let Composite::Maximum { .. } = settings.composite {
            return refuse("a composite of what lies along the rays", "a maximum");
        }
        settings.refuse_aperture("deep image")?;
        if self.blends_encoded(settings) {
            return refuse(
                "light that is composited linearly",
                "splats that are composited in sRGB codes; blend them linearly",
            );
        }
        let mut settings = Settings {
            background: None,
            depth: false,
            normals: false,
            ..settings.clone()
        };
        settings.advanced.opaque_edges = false;
        let size = [camera.width, camera.height];
        let whole = self.render(camera, &settings)?.clone();
        // Parts of a frame have the layers of the whole.
        if let Some(layers) = self.layers() {
            settings.composite = settings.composite.with_thickness(Some(layers.thickness));
        }
        let Some([nearest, farthest]) = self.visible_depths(camera, &settings)? else {
            return Ok(DeepImage {
                width: size[0],
                height: size[1],
                firsts: vec![0; size[0] * size[1] + 1],
                samples: Vec::new(),
            });
        };
        let least = settings.tolerance * SHARE;
        let rule = Rule {
            least,
            widest: (farthest - nearest) / PARTS,
            narrow: (farthest - nearest) * SURFACE_WIDTH,
        };
        let begin = |rgba: &[f32; 4]| {
            let is_known = adds_little([0.0; 4], *rgba, least);
            let knot = |depth, rgba, is_known| Knot {
                depth,
                rgba,
                is_known,
            };
            vec![
                knot(nearest, [0.0; 4], is_known),
                knot(farthest, *rgba, true),
            ]
        };
        let mut rays: Vec<Vec<Knot>> = whole.pixels.par_iter().map(begin).collect();
        let task = settings.task.take();
        let stage = Stage::new(task.as_ref(), "drawing depths", MOST_FRAMES);
        for _ in 0..MOST_FRAMES {
            stage.check()?;
            let middles: Vec<Option<(usize, f32)>> = rays.par_iter().map(|ray| next(ray)).collect();
            if middles.iter().all(Option::is_none) {
                break;
            }
            // Rays that are known end at once.
            let depths = middles
                .iter()
                .map(|m| m.map_or(nearest, |(_, depth)| depth));
            let depth = DepthImage {
                width: size[0],
                height: size[1],
                depths: depths.collect(),
            };
            let ended = Settings {
                backdrop: Some(Arc::new(Backdrop::new(depth)?)),
                ..settings.clone()
            };
            let image: &Image = self.render(camera, &ended)?;
            let pixels = image.pixels.par_iter();
            rays.par_iter_mut()
                .zip(middles)
                .zip(pixels)
                .for_each(|((ray, middle), rgba)| {
                    if let Some((at, depth)) = middle {
                        halve(ray, at, depth, *rgba, &rule);
                    }
                });
            stage.advance(1);
        }
        stage.reach(1.0);
        self.images.image = whole;
        Ok(joined(size, &rays, &rule))
    }

    /// Returns the least and the greatest depth of what may be visible; `None` if nothing is.
    fn visible_depths(&self, camera: &Camera, settings: &Settings) -> Result<Option<[f32; 2]>> {
        let plan = FramePlan::new(&self.scene, camera, settings)?;
        let row = camera.camera_from_world.row(2).abs();
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for block in self.scene.data().flat_map(|volume| &volume.blocks) {
            if plan.frustum.sees(camera, block, true) {
                let z = camera.camera_point(block.origin).z;
                let reach = f64::from(MAX_CUTOFF) * f64::from(block.max_sigma);
                let half = row.dot(block.half_extent.as_dvec3()) + reach;
                range = [range[0].min(z - half), range[1].max(z + half)];
            }
        }
        if camera.projection == Projection::Perspective {
            range[0] = range[0].max(1e-4 * range[1]);
        }
        Ok((range[0] < range[1]).then(|| range.map(narrowed)))
    }
}

/// Returns whether what a ray gathers between two depths is below a bound.
fn adds_little(from: [f32; 4], to: [f32; 4], bound: f32) -> bool {
    from.iter().zip(to).all(|(a, b)| (a - b).abs() <= bound)
}

/// Chooses the interval of a ray that is halved next, and where: the one that adds most of those that are not known.
fn next(ray: &[Knot]) -> Option<(usize, f32)> {
    let open = (0..ray.len() - 1).filter(|&i| !ray[i].is_known);
    let added = |i: usize| ray[i + 1].rgba[3] - ray[i].rgba[3];
    let at = open.max_by(|&a, &b| added(a).total_cmp(&added(b)))?;
    Some((at, 0.5 * (ray[at].depth + ray[at + 1].depth)))
}

/// Adds the middle of an interval to a ray.
fn halve(ray: &mut Vec<Knot>, at: usize, depth: f32, rgba: [f32; 4], rule: &Rule) {
    let (from, to) = (ray[at], ray[at + 1]);
    // The middle says nothing of a first half that is opaque by itself.
    let is_predicted = between(&from, &to)[3] <= MOST_OPACITY
        && adds_little(predicted(&from, &to, depth), rgba, rule.least);
    let known = |a: [f32; 4], b: [f32; 4], width: f32| {
        adds_little(a, b, rule.least)
            || width <= rule.narrow
            || is_predicted && width <= rule.widest
    };
    ray[at].is_known = known(from.rgba, rgba, depth - from.depth);
    let middle = Knot {
        depth,
        rgba,
        is_known: known(rgba, to.rgba, to.depth - depth),
    };
    ray.insert(at + 1, middle);
}

/// Returns what a ray has gathered up to a depth between two others, if the optical depth is spread evenly between them.
fn predicted(from: &Knot, to: &Knot, depth: f32) -> [f32; 4] {
    let sample = DeepSample {
        front: from.depth,
        back: to.depth,
        rgba: between(from, to),
    };
    let mut rgba = from.rgba;
    let through = 1.0 - from.rgba[3];
    for (sum, own) in rgba.iter_mut().zip(sample.before(depth)) {
        *sum += through * own;
    }
    rgba
}

/// Returns what the part of a ray between two depths shows by itself.
fn between(from: &Knot, to: &Knot) -> [f32; 4] {
    let through = 1.0 - from.rgba[3];
    let mut rgba = [0.0; 4];
    if through > 0.0 {
        for ((own, a), b) in rgba.iter_mut().zip(from.rgba).zip(to.rgba) {
            *own = (b - a) / through;
        }
    }
    rgba[3] = rgba[3].clamp(0.0, 1.0);
    rgba
}

/// Makes samples of rays. Neighbouring intervals become one sample if it predicts the depths between them.
fn joined(size: [usize; 2], rays: &[Vec<Knot>], rule: &Rule) -> DeepImage {
    let of_ray = |ray: &Vec<Knot>| {
        let mut samples: Vec<DeepSample> = Vec::new();
        let mut first = 0;
        while first + 1 < ray.len() {
            let mut last = first + 1;
            if ray[first].rgba[3] >= 1.0 {
                // Nothing behind is visible.
                break;
            }
            let is_empty = |i: usize| ray[i].rgba == ray[i + 1].rgba;
            if is_empty(first) {
                first = last;
                continue;
            }
            while last + 1 < ray.len()
                && !is_empty(last)
                && (first + 1..=last).all(|k| {
                    let at = predicted(&ray[first], &ray[last + 1], ray[k].depth);
                    adds_little(at, ray[k].rgba, rule.least)
                })
            {
                last += 1;
            }
            let (from, to) = (&ray[first], &ray[last]);
            let is_surface = to.depth - from.depth <= 2.0 * rule.narrow;
            samples.push(DeepSample {
                front: if is_surface { to.depth } else { from.depth },
                back: to.depth,
                rgba: between(from, to),
            });
            first = last;
        }
        samples
    };
    let of_rays: Vec<Vec<DeepSample>> = rays.par_iter().map(of_ray).collect();
    let mut firsts = Vec::with_capacity(rays.len() + 1);
    firsts.push(0);
    for samples in &of_rays {
        firsts.push(firsts[firsts.len() - 1] + samples.len());
    }
    DeepImage {
        width: size[0],
        height: size[1],
        firsts,
        samples: of_rays.concat(),
    }
}
