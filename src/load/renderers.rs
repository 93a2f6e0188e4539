//! Builds renderers of what ranks load.

use super::loaded::Loaded;
use super::parts::{read_together, scatter};
use crate::collective::Collective;
use crate::error::Result;
use crate::prepared::PointFile;
use crate::ranks::Renderer;
use crate::ranks::renderer::shared;
use crate::render::SceneOptions;
use crate::scene::PointVolume;

impl Renderer {
    /// Builds a renderer of a scene that these ranks have [loaded](super::load) together.
    ///
    /// # Errors
    /// The errors of [`Self::new`] and of [`Self::of_prepared`].
    pub fn of_loaded(
        communicator: impl Collective + 'static,
        mut scene: Loaded,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks: Box<dyn Collective> = Box::new(communicator);
        match scene.take_share(ranks.size()) {
            Some(share) => Ok(Self::of(shared(share, options, ranks)?)),
            None => {
                let whole = scene.renderer(options);
                Self::of_shared(ranks.agree(whole)?, ranks)
            }
        }
    }

    /// Builds a renderer of a file of points. Every rank reads a run of rows and holds some of the particles: no rank
    /// needs the memory of the whole.
    ///
    /// # Errors
    /// The errors of reading, on any rank; those of [`Self::new`].
    pub fn of_file(
        communicator: impl Collective + 'static,
        file: &mut PointFile,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks: Box<dyn Collective> = Box::new(communicator);
        let share = read_together(file, &mut *ranks)?;
        Ok(Self::of(shared(share, options, ranks)?))
    }

    /// Builds a renderer of a scene that only the first rank holds, for example of a file that one rank reads for all.
    ///
    /// The first rank needs the memory of the whole scene while it scatters the particles. The other ranks need the
    /// memory of their shares, and of the volumes that every rank holds entirely ([`Self::new`]). Lattices that store
    /// more than values (normals, for example) are such volumes.
    ///
    /// - `scene`: the volumes, on the first rank; ignored on other ranks.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn of_first(
        communicator: impl Collective + 'static,
        scene: Option<Vec<PointVolume>>,
        options: &SceneOptions,
    ) -> Result<Self> {
        let mut ranks: Box<dyn Collective> = Box::new(communicator);
        let share = scatter(scene, &mut *ranks)?;
        Ok(Self::of(shared(share, options, ranks)?))
    }
}
