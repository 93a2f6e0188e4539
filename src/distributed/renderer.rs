//! A scene over ranks, and its pictures.

use super::communicator::Communicator;
use super::frames::RankFrames;
use super::ranks::Ranks;
use super::share::{SMALL, Share};
use super::statistics::RankStats;
use crate::blocks::{AmplitudeSummary, BlockedScene};
use crate::error::Result;
use crate::image::{ColumnImage, DepthImage, Image, NormalImage};
use crate::render::{self, ColumnSettings, FrameCounts, SceneOptions, Settings};
use crate::scene::PointVolume;
use crate::view::{Bounds, Camera};

/// A scene whose particles ranks share. All of them call the same functions in the same order; the first has the
/// images.
#[derive(Debug)]
pub struct Renderer {
    frames: render::Renderer,
    visible: Vec<Bounds>,
    boxes: Vec<Bounds>,
}

/// A renderer of what ranks have together.
///
/// # Errors
/// Those of [`Renderer::new`].
pub(crate) fn shared(
    share: Share,
    options: &SceneOptions,
    mut ranks: Ranks,
) -> Result<render::Renderer> {
    let shares = share.built(options, SMALL, &mut ranks)?;
    let (scene, own) = BlockedScene::of_shares(shares);
    render::Renderer::of_shared(scene, RankFrames::of_shared(ranks, own))
}

impl Renderer {
    /// Of a scene of which every rank brings a share, whichever: the blocks are made together, and each rank keeps the
    /// particles of some of them. No rank needs the memory of the whole, but for volumes of few particles (262,144 for each
    /// rank; of a lattice of fewer than 64 planes for each sixty-four times as many), which every rank builds by itself, and for
    /// lattices of which each has all ([`Share::planes`]).
    ///
    /// ```
    /// use ewa_splat::distributed::{Communicator, Renderer, ThreadRank};
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
    /// Shares that are not of the same volumes; those of [`Self::of_whole`].
    pub fn new(
        communicator: impl Communicator + 'static,
        share: impl Into<Share>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let ranks = Ranks::new(Box::new(communicator));
        Ok(Self::of(shared(share.into(), options, ranks)?))
    }

    /// Of a file of points, of which every rank reads a run of rows and has some of the particles: no rank needs the memory
    /// of the whole.
    ///
    /// # Errors
    /// What reading says, on any rank; those of [`Self::new`].
    #[cfg(feature = "prepared")]
    pub fn of_file(
        communicator: impl Communicator + 'static,
        file: &mut crate::prepared::PointFile,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks = Ranks::new(Box::new(communicator));
        let share = super::read::read_together(file, &mut ranks)?;
        Ok(Self::of(shared(share, options, ranks)?))
    }

    /// Of a scene that the first rank alone has, such as of a file that one reads for all: the others get their shares of
    /// its particles, and need the memory of these, and of the volumes of which every rank has all ([`Self::new`]; lattices that
    /// have more than values are among them); the first needs that of the whole while it hands it out.
    ///
    /// - `scene`: on the first rank the volumes; what others give counts nothing.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    #[cfg(feature = "prepared")]
    pub fn of_first(
        communicator: impl Communicator + 'static,
        scene: Option<Vec<PointVolume>>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks = Ranks::new(Box::new(communicator));
        let share = super::scatter::scatter(scene, &mut ranks)?;
        Ok(Self::of(shared(share, options, ranks)?))
    }

    fn of(frames: render::Renderer) -> Self {
        Self {
            visible: frames.visible_boxes(),
            boxes: frames.boxes(),
            frames,
        }
    }

    /// Of a scene that every rank has as a whole: each keeps its share of it, every so many blocks. While these are
    /// made, each rank needs the memory of the whole.
    ///
    /// # Errors
    /// Those of [`render::Renderer::with_options`], on any rank; a rank that is gone.
    pub fn of_whole(
        communicator: impl Communicator + 'static,
        scene: Vec<PointVolume>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks = Ranks::new(Box::new(communicator));
        let whole = render::Renderer::with_options(scene, options);
        Self::shared(ranks.agree(whole)?, ranks)
    }

    /// Of prepared scenes, which every rank has mapped: each reads of them what it draws, so that no rank needs the
    /// memory of the whole.
    ///
    /// # Errors
    /// Those of [`render::Renderer::of_prepared`], on any rank; a rank that is gone.
    #[cfg(feature = "prepared")]
    pub fn of_prepared(
        communicator: impl Communicator + 'static,
        scenes: Vec<crate::prepared::PreparedScene>,
    ) -> Result<Self> {
        let mut ranks = Ranks::new(Box::new(communicator));
        let whole = render::Renderer::of_prepared(scenes);
        Self::shared(ranks.agree(whole)?, ranks)
    }

    fn shared(whole: render::Renderer, ranks: Ranks) -> Result<Self> {
        let (visible, boxes) = (whole.visible_boxes(), whole.boxes());
        Ok(Self {
            frames: whole.over_ranks(ranks)?,
            visible,
            boxes,
        })
    }

    /// Draws a frame; its image on the first rank, nothing on others.
    ///
    /// # Errors
    /// Those of [`render::Renderer::render`] on any rank; a rank that is gone.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<Option<&Image>> {
        self.frames.render(camera, settings)?;
        Ok(self.is_first().then(|| self.frames.image()))
    }

    /// Draws a column density; on the first rank, nothing on others.
    ///
    /// # Errors
    /// Those of [`render::Renderer::column_density`] on any rank; a rank that is gone.
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

    /// The last frame's depths on the first rank, where the settings asked for them.
    pub fn depth(&self) -> Option<&DepthImage> {
        self.frames.depth().filter(|_| self.is_first())
    }

    /// The last frame's normals of opaque surfaces on the first rank, where the settings asked for them.
    pub fn normals(&self) -> Option<&NormalImage> {
        self.frames.normals().filter(|_| self.is_first())
    }

    /// What all ranks together counted for the last frame.
    pub fn counts(&self) -> FrameCounts {
        self.frames.counts()
    }

    /// What each rank has and did for the last frame, by rank.
    pub fn stats(&self) -> &[RankStats] {
        self.frames.rank_stats()
    }

    /// The amplitudes of the scene, of which [`Self::column_density`] makes columns; their sum is that of the ranks'
    /// sums.
    pub fn amplitudes(&mut self) -> AmplitudeSummary {
        self.frames.amplitudes()
    }

    /// The variance of the low-pass filter that suits the scene, as [`render::Renderer::suitable_low_pass_px2`].
    pub fn suitable_low_pass_px2(&self) -> f32 {
        self.frames.suitable_low_pass_px2()
    }

    /// Middles and half extents of the boxes that hold what is visible of the whole scene, as it was made; world units.
    pub fn visible_boxes(&self) -> &[Bounds] {
        &self.visible
    }

    /// Middles and half extents of the boxes that hold all particles of the whole scene, grown by one standard
    /// deviation; world units.
    pub fn boxes(&self) -> &[Bounds] {
        &self.boxes
    }
}
