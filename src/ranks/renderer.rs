//! Defines the renderer of a scene that is partitioned among ranks.

use super::frames::RankFrames;
use super::share::{SMALL, Share};
use super::statistics::RankStats;
use crate::blocks::{AmplitudeSummary, BlockedScene};
use crate::collective::Collective;
use crate::error::Result;
use crate::image::{ColumnImage, DepthImage, Image, NormalImage};
use crate::render::{self, ColumnSettings, FrameCounts, SceneOptions, Settings};
use crate::scene::PointVolume;
use crate::view::{Bounds, Camera};

/// Renders a scene whose particles are partitioned among ranks. All ranks call the same functions in the same order;
/// the first rank gets the images.
#[derive(Debug)]
pub struct Renderer {
    frames: render::Renderer,
    visible: Vec<Bounds>,
    boxes: Vec<Bounds>,
}

/// Builds a renderer of the scene to which each rank contributes a share.
///
/// # Errors
/// The errors of [`Renderer::new`].
pub(crate) fn shared(
    share: Share,
    options: &SceneOptions,
    mut ranks: Box<dyn Collective>,
) -> Result<render::Renderer> {
    let shares = share.built(options, SMALL, &mut *ranks)?;
    let (scene, own) = BlockedScene::of_shares(shares);
    render::Renderer::of_shared(scene, RankFrames::of_shared(ranks, own))
}

impl Renderer {
    /// Builds a renderer of a scene of which every rank contributes any share. The ranks build the blocks together, and
    /// each keeps the particles of some blocks.
    ///
    /// No rank needs the memory of the whole scene, except for two kinds of volumes that every rank holds entirely. The
    /// first are small volumes: at most 262,144 particles for each rank, or sixty-four times as many in a lattice with
    /// fewer than 64 planes for each rank. The second are lattices that every rank contributes entirely
    /// ([`Share::planes`]).
    ///
    /// ```
    /// use ewa_splat::distributed::{Collective, Renderer, ThreadRank};
    /// use ewa_splat::{SceneOptions, Settings, scene::PointVolume, view::Camera};
    /// use glam::DVec3;
    ///
    /// let camera = Camera::perspective(DVec3::Y * -5.0, DVec3::ZERO, DVec3::Z, 40.0, [64, 48]);
    /// let draw = |rank: ThreadRank| -> ewa_splat::Result<bool> {
    ///     // One ball each, side by side.
    ///     let ball = PointVolume::spheres([DVec3::X * rank.rank() as f64], [0.5]).with_masses([1.0]);
    ///     let mut renderer = Renderer::new(rank, vec![ball], &SceneOptions::default())?;
    ///     Ok(renderer.render(&camera, &Settings::default())?.is_some())
    /// };
    /// let has_image = std::thread::scope(|scope| {
    ///     let ranks = ThreadRank::group(3).into_iter();
    ///     let threads: Vec<_> = ranks.map(|rank| scope.spawn(move || draw(rank))).collect();
    ///     threads.into_iter().map(|t| t.join().unwrap()).collect::<ewa_splat::Result<Vec<_>>>()
    /// });
    /// assert_eq!(has_image?, [true, false, false]);
    /// # Ok::<(), ewa_splat::Error>(())
    /// ```
    ///
    /// # Errors
    /// Shares of different volumes; the errors of [`Self::of_whole`].
    pub fn new(
        communicator: impl Collective + 'static,
        share: impl Into<Share>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let ranks = Box::new(communicator);
        Ok(Self::of(shared(share.into(), options, ranks)?))
    }

    pub(crate) fn of(frames: render::Renderer) -> Self {
        Self {
            visible: frames.visible_boxes(),
            boxes: frames.boxes(),
            frames,
        }
    }

    /// Builds a renderer of a scene that every rank holds entirely: with n ranks, each keeps every n-th run of blocks.
    /// Until then each rank needs the memory of the whole scene.
    ///
    /// # Errors
    /// The errors of [`render::Renderer::with_options`], on any rank; a rank that is gone.
    pub fn of_whole(
        communicator: impl Collective + 'static,
        scene: Vec<PointVolume>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks: Box<dyn Collective> = Box::new(communicator);
        let whole = render::Renderer::with_options(scene, options);
        Self::of_shared(ranks.agree(whole)?, ranks)
    }

    /// Builds a renderer of prepared scenes, which every rank has mapped. Each rank reads only the parts that it draws:
    /// no rank needs the memory of the whole.
    ///
    /// # Errors
    /// The errors of [`render::Renderer::with_options`], on any rank; a rank that is gone.
    #[cfg(feature = "prepared")]
    pub fn of_prepared(
        communicator: impl Collective + 'static,
        scenes: Vec<crate::prepared::PreparedScene>,
    ) -> Result<Self> {
        let mut ranks: Box<dyn Collective> = Box::new(communicator);
        let whole = render::Renderer::with_options(scenes, render::RendererOptions::default());
        Self::of_shared(ranks.agree(whole)?, ranks)
    }

    pub(crate) fn of_shared(whole: render::Renderer, ranks: Box<dyn Collective>) -> Result<Self> {
        let (visible, boxes) = (whole.visible_boxes(), whole.boxes());
        Ok(Self {
            frames: whole.over_ranks(ranks)?,
            visible,
            boxes,
        })
    }

    /// Draws a frame; returns its image on the first rank, `None` on others.
    ///
    /// # Errors
    /// The errors of [`render::Renderer::render`] on any rank; a rank that is gone.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<Option<&Image>> {
        self.frames.render(camera, settings)?;
        Ok(self.is_first().then(|| self.frames.image()))
    }

    /// Draws a column density; returns it on the first rank, `None` on others.
    ///
    /// # Errors
    /// The errors of [`render::Renderer::column_density`] on any rank; a rank that is gone.
    pub fn column_density(
        &mut self,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<Option<&ColumnImage>> {
        self.frames.column_density(camera, settings)?;
        Ok(self.is_first().then(|| self.frames.column()))
    }

    fn is_first(&self) -> bool {
        self.frames.rank() == Some(0)
    }

    /// Returns the last frame's depths on the first rank, if the settings asked for them.
    pub fn depth(&self) -> Option<&DepthImage> {
        self.frames.depth().filter(|_| self.is_first())
    }

    /// Returns the last frame's normals of opaque surfaces on the first rank, if the settings asked for them.
    pub fn normals(&self) -> Option<&NormalImage> {
        self.frames.normals().filter(|_| self.is_first())
    }

    /// Counts of the last frame, summed over all ranks.
    pub fn counts(&self) -> FrameCounts {
        self.frames.counts()
    }

    /// Statistics of each rank for the last frame, by rank.
    pub fn stats(&self) -> &[RankStats] {
        self.frames.rank_stats()
    }

    /// Summarises the scene's amplitudes, which [`Self::column_density`] sums along rays; the sum is that of the ranks'
    /// sums.
    pub fn amplitudes(&mut self) -> AmplitudeSummary {
        self.frames.amplitudes()
    }

    /// Returns the variance of the low-pass filter that suits the scene, as
    /// [`render::Renderer::suitable_low_pass_px2`].
    pub fn suitable_low_pass_px2(&self) -> f32 {
        self.frames.suitable_low_pass_px2()
    }

    /// Returns the middles and half extents of the boxes around the visible part of the whole scene, as it was made;
    /// world units.
    pub fn visible_boxes(&self) -> &[Bounds] {
        &self.visible
    }

    /// Returns the middles and half extents of the boxes around all particles of the whole scene, grown by one standard
    /// deviation; world units.
    pub fn boxes(&self) -> &[Bounds] {
        &self.boxes
    }
}
