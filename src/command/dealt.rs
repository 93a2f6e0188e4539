//! Several inputs that ranks read in turn: each samples some of them, and hears what the others are.

use indicatif::ProgressBar;

use super::input::DataOptions;
use super::reads::uses;
use super::scene::Scene;
use super::source::Input;
use super::together::{Gathered, Together};
use super::viewpoint::Cameras;
use crate::Result;
use crate::distributed::{Ranks, Share, dealt, hand_out};
use crate::sample::SampleOptions;

impl DataOptions {
    /// A scene of several inputs, of which each rank reads some, and this one's share, whose volumes are in the scene.
    ///
    /// # Errors
    /// What reading says, on any rank; a field that no input has; a rank that is gone.
    pub(super) fn dealt(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
        ranks: &mut Ranks,
    ) -> Result<(Scene, Share)> {
        let checked = self.check_function(options);
        ranks.agree(checked)?;
        let lengths = inputs
            .iter()
            .map(|input| std::fs::metadata(&input.path).map_or(0, |meta| meta.len()));
        // What the first rank sees is what all go by.
        let lengths = ranks.gather_records(Ok(lengths.collect()))?.swap_remove(0);
        let together = Together {
            data: self,
            inputs,
            own: dealt(&lengths, ranks.rank(), ranks.size()),
            options,
            cameras,
            beside: &[],
            progress,
        };
        let Gathered {
            abouts, volumes, ..
        } = together.read(&mut Some(ranks))?;
        self.check_use(&uses(&abouts, options))?;
        let volumes = volumes.into_iter().flatten();
        let mut share = hand_out(volumes.collect(), ranks)?;
        let has_boundary = self.may_end_sharply(abouts.iter());
        let scene = Scene::of_reads(std::mem::take(&mut share.volumes), abouts, has_boundary);
        self.check_fields(&scene)?;
        Ok((scene, share))
    }
}
