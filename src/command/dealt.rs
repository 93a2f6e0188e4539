//! Reads several inputs on many ranks: each rank reads and samples some of them, and receives the
//! metadata of the others.

use indicatif::ProgressBar;

use super::input::DataOptions;
use super::reads::uses;
use super::scene::Scene;
use super::source::Input;
use super::together::{Gathered, Together};
use super::viewpoint::Cameras;
use crate::Result;
use crate::collective::Collective;
use crate::load::parts::{assigned, distribute};
use crate::ranks::Share;
use crate::sample::SampleOptions;

impl DataOptions {
    /// Reads a scene of several inputs, some on each rank. Returns the scene with this rank's
    /// volumes, and its share.
    ///
    /// # Errors
    /// The errors of reading on any rank; a field that no input has; a rank that has ended.
    pub(super) fn dealt(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
        ranks: &mut dyn Collective,
    ) -> Result<(Scene, Share)> {
        let checked = self.check_function(options);
        ranks.agree(checked)?;
        let lengths = inputs
            .iter()
            .map(|input| std::fs::metadata(&input.path).map_or(0, |meta| meta.len()));
        // All ranks use the file lengths that the first rank finds, so that they make the same
        // assignment.
        let lengths = ranks.gather_records(Ok(lengths.collect()))?.swap_remove(0);
        let together = Together {
            data: self,
            inputs,
            own: assigned(&lengths, ranks.rank(), ranks.size()),
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
        let mut share = distribute(volumes.collect(), ranks)?;
        let has_boundary = self.may_end_sharply(abouts.iter());
        let scene = Scene::of_reads(std::mem::take(&mut share.volumes), abouts, has_boundary);
        self.check_fields(&scene)?;
        Ok((scene, share))
    }
}
