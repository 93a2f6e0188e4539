//! Chooses the level of detail of a frame's lattices: the coarsest whose picture differs from that of the samples by
//! less than the tolerance.
//!
//! The error of a level is measured. The errors of its blocks are estimated from the values, and added up along rays in
//! three directions. Where they are the greatest, both pictures are drawn and compared, with as many pixels for a cell as
//! the frame has at most. This is done once for a function, settings and a scale, and does not depend on frames before.
//! The CPU does it, so that all back ends choose the same level. Frames in motion
//! ([`Advanced::merge_slack`](crate::render::Advanced::merge_slack)) measure nothing and go by the last measurement, of
//! whatever function.

use glam::{DMat3, DVec3};

use super::renderer::{MeasuredLevels, Renderer, refuse_all};
use crate::blocks::{BlockError, BlockedParticles, BlockedScene, distance_interval};
use crate::error::Result;
use crate::frame::backend::DrawFrames;
use crate::frame::check::{check, check_scene};
use crate::frame::plan::FramePlan;
use crate::frame::probe::{ErrorMap, Probes, worst_places};
use crate::frame::settings::{Settings, Show};
use crate::image::Image;
use crate::splat::budget::COARSER_SHARE;
use crate::stats::Stopwatch;
use crate::view::{Camera, Projection, sphere_around};

/// Least tolerance at which coarser lattices are tried.
const LEAST_TOLERANCE: f32 = 1e-3;

/// Least number of samples of a lattice that has coarser ones. Fewer are drawn in less time than errors are measured in;
/// where they do not suffice, they are refined.
const LEAST_SAMPLES: usize = 1 << 21;

/// The same number for lattices that are coarser themselves.
const LEAST_OF_COARSER: usize = 1 << 15;

/// Share of a place's pixels whose errors may be greater.
const MOST_BEYOND: f32 = 0.01;

/// Directions to the eye in which errors are measured, in steps of a lattice: almost along its axes, where errors of
/// samples behind one another add up.
const DIRECTIONS: [[f64; 3]; 3] = [[0.08, -1.0, 0.05], [1.0, 0.06, -0.1], [-0.06, 0.09, 1.0]];

/// Number of places for each direction, besides one for each level.
const PLACES: usize = 2;

/// Scales at which errors are measured, as binary logarithms of the pixels for a cell. On smaller pictures the low-pass
/// filter takes away what coarser lattices lack. On larger ones a cell has many pixels, and errors stay the same.
const ZOOMS: [f64; 2] = [-3.0, 1.0];

/// Most pixels along each side of a picture in which errors are measured.
const MOST_PIXELS: f64 = 2048.0;

/// Number of measurements that are kept.
const KEPT: usize = 8;

impl Renderer {
    /// Returns the number of times that the lattices' samples were halved along each axis for the last frame. 0: the
    /// picture shows the samples themselves.
    pub fn lattice_level(&self) -> usize {
        self.report.counts.lattice_level
    }

    /// Returns the level at which a frame is drawn.
    ///
    /// # Errors
    /// The errors of [`Renderer::render`].
    pub(super) fn chosen(&mut self, camera: &Camera, settings: &Settings) -> Result<usize> {
        let tolerance = settings.tolerance * settings.advanced.merge_slack;
        let may_be_coarser = settings.draws_merged()
            && tolerance >= LEAST_TOLERANCE
            && settings.show == Show::Scene
            && !settings.depth
            && self.rank().is_none()
            && self.scene.has_coarser();
        if !may_be_coarser {
            return Ok(0);
        }
        check(camera, settings)?;
        check_scene(&self.scene, settings)?;
        let bound = tolerance * COARSER_SHARE;
        let within = |errors: &[f32]| {
            let level = errors.iter().rposition(|error| *error <= bound);
            level.map_or(0, |level| level + 1)
        };
        if settings.advanced.merge_slack > 1.0 {
            return Ok(within(&self.coarser.last));
        }
        let mut stopwatch = Stopwatch::start();
        // Coarser scenes are made with the transfer function itself, not with the carrier of values.
        self.carry(settings)?;
        let count = self.make_levels()?;
        if count == 0 {
            return Ok(0);
        }
        let Some(zoom) = self.zoom(count, camera, settings)? else {
            return Ok(0);
        };
        let mut key = settings.clone();
        (key.task, key.background, key.backdrop) = (None, None, None);
        // What is out of focus needs fewer samples.
        key.aperture = None;
        if let Some(lighting) = &mut key.lighting {
            // Errors are measured without shadows, which are as smooth as the finest lattice's or smoother.
            lighting.shadows = None;
        }
        self.coarser.last = self.measured(key, zoom, bound, count)?.to_vec();
        self.coarser.time = stopwatch.lap();
        Ok(within(&self.coarser.last))
    }

    /// Returns the renderer of a level that was chosen.
    pub(super) fn at_level(&mut self, level: usize) -> &mut Self {
        match level {
            0 => self,
            _ => &mut self.coarser.levels[level - 1],
        }
    }

    /// Makes the coarser scenes if they were not made before, and returns their number.
    fn make_levels(&mut self) -> Result<usize> {
        if !self.coarser.are_made {
            self.coarser.are_made = true;
            let mut least = LEAST_SAMPLES;
            while let Some(scene) = self
                .scene_at(self.coarser.levels.len())
                .coarser(least, None)?
            {
                match Self::of_scene(scene)?.on_device_of(self) {
                    Ok(level) => self.coarser.levels.push(level),
                    // The device has no room for more.
                    Err(error) if error.is_of_device() => break,
                    Err(error) => return Err(error),
                }
                least = LEAST_OF_COARSER;
            }
        }
        Ok(self.coarser.levels.len())
    }

    /// Returns the scale of a picture, rounded up; `None` if it shows no lattice.
    ///
    /// - `count`: the coarsest level, whose blocks are looked at.
    fn zoom(&self, count: usize, camera: &Camera, settings: &Settings) -> Result<Option<i32>> {
        let Some(spacing) = least_spacing(&steps(&self.scene)) else {
            return Ok(None);
        };
        let scene = self.scene_at(count);
        let plan = FramePlan::new(scene, camera, settings)?;
        let nearest = scene
            .data()
            .filter(|volume| matches!(volume.particles, BlockedParticles::Lattice(_)))
            .flat_map(|volume| &volume.blocks)
            .filter(|block| plan.frustum.sees(camera, block, false))
            .map(|block| {
                let (distance, radius) = distance_interval(camera, block, false);
                distance - radius
            })
            .fold(f64::INFINITY, f64::min);
        let pixels = match camera.projection {
            _ if nearest == f64::INFINITY => return Ok(None),
            Projection::Orthographic => camera.focal_px.max_element() * spacing,
            Projection::Perspective if nearest > 0.0 => {
                camera.focal_px.max_element() * spacing / nearest
            }
            Projection::Perspective => f64::INFINITY,
        };
        #[expect(clippy::cast_possible_truncation, reason = "clamped to a few numbers")]
        let zoom = pixels.log2().ceil().clamp(ZOOMS[0], ZOOMS[1]) as i32;
        Ok(Some(zoom))
    }

    /// Returns the errors of the coarser levels at a scale. If all are beyond the bound, they may be greater still.
    fn measured(
        &mut self,
        settings: Settings,
        zoom: i32,
        bound: f32,
        count: usize,
    ) -> Result<&[f32]> {
        let measured = &mut self.coarser.measured;
        let is_asked = |own: &MeasuredLevels| own.zoom == zoom && own.settings == settings;
        let found = measured.iter().position(is_asked);
        match found.filter(|found| measured[*found].suffices(bound)) {
            Some(found) => measured[found..].rotate_left(1),
            None => {
                let (errors, is_complete) = self.measure(&settings, zoom, bound, count)?;
                let measured = &mut self.coarser.measured;
                if let Some(found) = found {
                    measured.remove(found);
                } else if measured.len() == KEPT {
                    measured.remove(0);
                }
                measured.push(MeasuredLevels {
                    settings,
                    zoom,
                    errors,
                    is_complete,
                });
            }
        }
        let last = self.coarser.measured.last();
        Ok(last.map_or(&[], |own| &own.errors))
    }

    /// Measures the errors of the coarser levels at a scale, until all of them are beyond the bound. Also
    /// returns whether all directions were looked at.
    fn measure(
        &mut self,
        settings: &Settings,
        zoom: i32,
        bound: f32,
        count: usize,
    ) -> Result<(Vec<f32>, bool)> {
        let boxes = self.scene_at(count).visible_boxes();
        let steps = steps(&self.scene);
        let (Some((middle, radius)), Some(spacing), Some(step)) =
            (sphere_around(&boxes), least_spacing(&steps), steps.first())
        else {
            return Ok((vec![f32::INFINITY; count], true));
        };
        let per_length = f64::from(zoom).exp2() / spacing;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most the limit"
        )]
        let pixels = (2.0 * radius * per_length).ceil().clamp(1.0, MOST_PIXELS) as usize;
        let is_lit = settings.lighting.is_some();
        let block_errors: Vec<Vec<Vec<BlockError>>> = (1..=count)
            .map(|level| self.block_errors(level, is_lit))
            .collect();
        let height = pixels as f64 / per_length;
        let mut errors = vec![0.0_f32; count];
        for (n, direction) in DIRECTIONS.into_iter().enumerate() {
            let direction = (*step * DVec3::from(direction)).normalize();
            let eye = middle + 2.0 * radius * direction;
            let up = direction.any_orthonormal_vector();
            let camera = Camera::orthographic(eye, middle, up, height, [pixels; 2]);
            let plan = FramePlan::new(&self.scene, &camera, settings)?;
            let map = |(level, edges): (usize, bool)| {
                let errors = block_errors[level - 1].iter().map(Vec::as_slice);
                let volumes = self.scene_at(level).data().zip(errors);
                ErrorMap::new(volumes, edges, &plan)
            };
            // Edges are at the same places at each level.
            let maps = (1..=count)
                .map(|level| (level, false))
                .chain([(count, true)]);
            let maps: Vec<ErrorMap> = maps.map(map).collect();
            let places = worst_places(&maps, count + PLACES);
            // A few places refuse at little cost what errs everywhere.
            let first = if n == 0 { PLACES.min(places.len()) } else { 0 };
            for places in [&places[..first], &places[first..]] {
                if places.is_empty() {
                    continue;
                }
                let probes = Probes::new(places, &plan);
                let own = self.draw_places(&probes, &camera, settings)?;
                for (level, error) in (1..).zip(&mut errors) {
                    let at = self.at_level(level);
                    let coarser = at.draw_places(&probes, &camera, settings)?;
                    *error = error.max(probes.error(&own, &coarser, MOST_BEYOND));
                }
                if refuse_all(&errors, bound) {
                    return Ok((errors, false));
                }
            }
        }
        Ok((errors, true))
    }

    /// Estimates the errors of the blocks of each volume at a level.
    fn block_errors(&self, level: usize, is_lit: bool) -> Vec<Vec<BlockError>> {
        let pairs = self.scene_at(level).data().zip(self.scene.data());
        pairs
            .map(|(coarser, own)| coarser.errors_against(own, is_lit))
            .collect()
    }

    /// Returns the scene of a level.
    fn scene_at(&self, level: usize) -> &BlockedScene {
        match level {
            0 => &self.scene,
            _ => &self.coarser.levels[level - 1].scene,
        }
    }

    /// Draws some places of a picture.
    fn draw_places(
        &mut self,
        probes: &Probes,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<Image> {
        let plan = FramePlan {
            tiles: Some(probes.mask.clone()),
            ..FramePlan::new(&self.scene, camera, settings)?
        };
        let _ = self.cpu.draw(&self.scene, &plan, &mut self.samples)?;
        Ok(std::mem::take(&mut self.samples.image))
    }
}

/// Returns the mean steps between samples of the lattices of a scene, as columns.
fn steps(scene: &BlockedScene) -> Vec<DMat3> {
    let lattices = scene.data().filter_map(|volume| match &volume.particles {
        BlockedParticles::Lattice(grid) => Some(grid.lattice().mean_step()),
        _ => None,
    });
    lattices.collect()
}

/// Returns the least of some steps' lengths, world units.
fn least_spacing(steps: &[DMat3]) -> Option<f64> {
    let columns = steps
        .iter()
        .flat_map(|step| [step.x_axis, step.y_axis, step.z_axis]);
    let least = columns.map(DVec3::length).reduce(f64::min);
    least.filter(|least| *least > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measurements_that_end_early_decide_for_their_bound() {
        let measured = |errors: &[f32]| MeasuredLevels {
            settings: Settings::default(),
            zoom: 0,
            errors: errors.to_vec(),
            is_complete: false,
        };
        // A coarser level is within the bound though the finest is not: other directions have to be looked at.
        assert!(!refuse_all(&[0.02, 0.01], 0.015));
        assert!(!measured(&[0.02, 0.01]).suffices(0.015));
        assert!(refuse_all(&[0.02, 0.03], 0.015));
        assert!(measured(&[0.02, 0.03]).suffices(0.015));
        assert!(measured(&[0.02, 0.03]).suffices(0.001));
        assert!(!measured(&[0.02, 0.03]).suffices(0.025));
    }
}
