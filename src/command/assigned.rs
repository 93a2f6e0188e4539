//! Reads several inputs on many ranks: each rank reads and samples some of them, and receives the
//! metadata of the others.

use indicatif::ProgressBar;

use super::input::DataOptions;
use super::progress::observer_of;
use crate::Result;
use crate::collective::Collective;
use crate::load::collection::{Collection, Gathered};
use crate::load::parts::{assigned, distribute};
use crate::load::{Cameras, Input, Loaded};
use crate::ranks::Share;
use crate::sample::SampleOptions;

impl DataOptions {
    /// Reads a scene of several inputs, some on each rank. Returns the scene with this rank's
    /// volumes, and its share.
    ///
    /// # Errors
    /// The errors of reading on any rank; a field that no input has; a rank that has ended.
    pub(super) fn assigned_inputs(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
        ranks: &mut dyn Collective,
    ) -> Result<(Loaded, Share)> {
        let checked = self.check_function(options);
        let checked = checked.and_then(|()| self.check_spacing());
        ranks.agree(checked)?;
        let lengths = inputs
            .iter()
            .map(|input| std::fs::metadata(&input.path).map_or(0, |meta| meta.len()));
        // All ranks use the file lengths that the first rank finds, so that they make the same
        // assignment.
        let lengths = ranks.gather_records(Ok(lengths.collect()))?.swap_remove(0);
        let (open, observer) = (self.open_options(), observer_of(progress));
        let collection = Collection {
            request: self.request(inputs, &open, options, cameras, &observer),
            own: assigned(&lengths, ranks.rank(), ranks.size()),
            beside: &[],
        };
        let Gathered {
            inputs, volumes, ..
        } = collection.read(&mut Some(ranks))?;
        let mut scene = Loaded::of_inputs(Vec::new(), inputs, options);
        scene = self.check_loaded(scene, options)?;
        let volumes = volumes.into_iter().flatten();
        let mut share = distribute(volumes.collect(), ranks)?;
        scene.volumes = std::mem::take(&mut share.volumes);
        Ok((scene, share))
    }
}
