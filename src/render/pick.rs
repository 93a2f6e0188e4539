//! Finds the particles that a pixel shows.

use glam::{DVec2, DVec3};

use super::renderer::Renderer;
use crate::blocks::BlockedVolume;
use crate::cpu::shares;
use crate::error::{Error, Result};
use crate::frame::check::{check, check_scene};
use crate::frame::plan::FramePlan;
use crate::frame::settings::{Settings, Show};
use crate::view::Camera;

/// A particle that a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Picked {
    /// Index of its volume in the scene.
    pub volume: usize,
    /// Index of the particle among those of the volume that the caller passed. For a lattice: index of
    /// the cell, x running fastest.
    pub particle: usize,
    /// Its centre, world units.
    pub position: DVec3,
    /// The depth z of its centre in camera space, world units.
    pub depth: f64,
    /// Its value, if a transfer function gives it its colour.
    pub value: Option<f32>,
    /// Its contribution to the pixel, as the value it would add to each channel if it were white. The
    /// shares sum to the pixel's opacity.
    pub share: f32,
}

impl Renderer {
    /// Returns the particles that a pixel of a frame shows, front to back, with the contribution of each.
    /// Use it to find what lies under the mouse.
    ///
    /// They are the caller's own particles, never merged ones, so the shares sum to the picture's opacity
    /// within the tolerance. The CPU finds them, whichever back end drew the frame. The time grows with
    /// the square of the number of kernels under the pixel. The scene must keep its particles' indices
    /// (see below); lattices always do.
    ///
    /// - `pixel`: column and row, from the top left.
    ///
    /// ```
    /// use ewa_splat::{SceneOptions, Renderer, Settings, scene::PointVolume, view::Camera};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let two = PointVolume::spheres([DVec3::ZERO, DVec3::Y], [0.2, 0.2]).with_masses([1.0, 1.0]);
    /// let options = SceneOptions { keep_indices: true, ..SceneOptions::default() };
    /// let mut renderer = Renderer::with_options(vec![two], &options)?;
    /// let eye = DVec3::new(0.0, -5.0, 0.0);
    /// let camera = Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, [64, 64]);
    /// let picked = renderer.pick(&camera, &Settings::default(), [32, 32])?;
    /// assert_eq!(picked[0].particle, 0);
    /// assert!(picked[0].share > picked[1].share);
    /// # Ok(())
    /// # }
    /// ```
    /// # Errors
    /// The errors of [`Renderer::render`]; a pixel outside the image; slabs classified as a whole, whose
    /// particles have no contribution of their own; volumes of points without
    /// [`SceneOptions::keep_indices`](super::SceneOptions).
    pub fn pick(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        [x, y]: [usize; 2],
    ) -> Result<Vec<Picked>> {
        let refuse = |place: &str, expected: &str, found: String, advice: &str| {
            Err(Error::invalid("settings", place, expected, found, advice))
        };
        check(camera, settings)?;
        check_scene(&self.scene, settings)?;
        if x >= camera.width || y >= camera.height {
            let expected = format!("one of {} x {}", camera.width, camera.height);
            return refuse(
                "pixel",
                &expected,
                format!("{x}, {y}"),
                "pick within the image",
            );
        }
        if settings.classifies_slabs() {
            let expected = "particles that are classified one by one";
            let found = "slabs classified by their mean values".into();
            return refuse("pick", expected, found, "pick with another composite");
        }
        if !self.scene.data().all(BlockedVolume::is_numbered) {
            let expected = "a scene that keeps its particles' numbers";
            let advice = "make the scene with SceneOptions { keep_indices: true, .. }";
            return refuse("pick", expected, "one that does not".into(), advice);
        }
        self.carry(settings)?;
        // Use the layers of the whole picture.
        let plan = FramePlan::new(&self.scene, camera, settings)?;
        let thickness = plan.of_volumes().and_then(|pass| pass.layers);
        let thickness = thickness.map(|layers| layers.thickness);
        let settings = Settings {
            composite: settings.composite.with_thickness(thickness),
            level_of_detail: false,
            show: Show::Scene,
            background: None,
            depth: false,
            normals: false,
            lighting: None,
            aperture: None,
            ..settings.clone()
        };
        let camera = Camera {
            centre_px: camera.centre_px - DVec2::new(x as f64, y as f64),
            width: 1,
            height: 1,
            ..camera.clone()
        };
        let plan = FramePlan {
            ends: plan.ends.map(|ends| ends.part([x, y], 1)),
            ..FramePlan::new(&self.scene, &camera, &settings)?
        };
        let mut picked: Vec<Picked> = shares(&self.scene, &plan)?
            .into_iter()
            .filter_map(|found| {
                let mut families = self.scene.families().iter();
                let blocked = &self.scene.volumes()[found.volume];
                let (index, offset) = blocked.place(found.block, found.local);
                let position = blocked.blocks[found.block as usize].origin + offset.as_dvec3();
                Some(Picked {
                    volume: families.position(|family| family.contains(&found.volume))?,
                    particle: blocked.number(index),
                    value: blocked.values.as_ref().map(|values| values.get(index)),
                    position,
                    depth: camera.camera_point(position).z,
                    share: found.share,
                })
            })
            .collect();
        picked.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        Ok(picked)
    }
}
