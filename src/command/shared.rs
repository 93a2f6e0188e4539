//! Reads inputs that ranks share. If an input can be read in parts, each rank reads one; otherwise
//! the first rank reads it for all.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::mem::take;

use indicatif::ProgressBar;

use super::input::DataOptions;
use super::progress::note;
use super::scene::Pieces;
use crate::blocks::ParticleStream;
use crate::collective::Collective;
use crate::io::{Planes, RowFile};
use crate::load::parts::{
    PartRead, read_grid, read_pieces, read_planes, read_rows, read_together, scatter,
};
use crate::load::{Cameras, Input, Kind, Loaded, is_prepared};
use crate::prepared::{About, PointFile};
use crate::ranks::Share;
use crate::sample::{SampleOptions, SampleReport};
use crate::{Error, Result};

/// File that all ranks read together, each a part.
enum Together {
    Points(Box<PointFile>),
    Rows(Box<(RowFile, SampleOptions)>),
    Pieces(Box<(Pieces, SampleOptions)>),
    Planes(Box<Planes>),
}

impl Together {
    /// Returns a hash of the file, by which ranks check that all have opened the same one.
    fn number(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        match self {
            Self::Points(file) => (1, file.len(), file.field()).hash(&mut hasher),
            Self::Rows(rows) => (2, rows.0.count(), &rows.1.field).hash(&mut hasher),
            Self::Pieces(pieces) => {
                let (dims, lengths): (_, Vec<u64>) = match &pieces.0 {
                    Pieces::Cells(file) => ([0; 3], file.lengths().collect()),
                    Pieces::Grid(file) => (file.dims(), file.lengths().collect()),
                };
                (4, dims, lengths, &pieces.1.field).hash(&mut hasher);
            }
            Self::Planes(file) => {
                (3, file.lattice().dims, file.field()).hash(&mut hasher);
                file.empty_values().type_name().hash(&mut hasher);
            }
        }
        hasher.finish()
    }
}

impl DataOptions {
    /// Reads a scene that ranks share. Returns the scene with this rank's volumes, and the rank's
    /// share. The share is `None` for prepared scenes, which every rank reads whole.
    ///
    /// - `cameras`: cameras of the picture, which determine the number of surfels of meshes.
    /// - `takes_parts`: whether the data may be partitioned before they are checked.
    /// - `read`: reads the whole scene.
    /// - `check`: refuses a scene that the options do not apply to.
    ///
    /// # Errors
    /// The errors of reading and checking on any rank.
    #[allow(
        clippy::too_many_arguments,
        reason = "what a picture says of how its inputs are read"
    )]
    pub(crate) fn shared(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
        ranks: &mut dyn Collective,
        takes_parts: bool,
        read: impl FnOnce() -> Result<Loaded>,
        check: impl FnOnce(Loaded) -> Result<Loaded>,
    ) -> Result<(Loaded, Option<Share>)> {
        let is_whole = inputs.iter().any(|input| is_prepared(&input.path));
        let together = match inputs {
            [input] if !is_whole => self.together(input, options, takes_parts),
            _ => Ok(None),
        };
        let together = ranks.agree(together)?;
        // On some ranks, the path may name another file or none.
        let found = match &together {
            None if is_whole => 0,
            None => inputs.len() as u64,
            Some(together) => together.number(),
        };
        if let Some(rank) = ranks.first_other(found)? {
            let path = inputs
                .first()
                .map_or("inputs".into(), |own| own.path.clone());
            let advice = "put it where every rank sees it, under one name";
            let expected = "the same file on every rank";
            let found = format!("another, or none, on rank {rank}");
            return Err(Error::format(&path, "ranks", expected, found, advice));
        }
        if is_whole {
            return Ok((read()?, None));
        }
        if inputs.len() > 1 && takes_parts {
            let (scene, share) = self.assigned_inputs(inputs, options, cameras, progress, ranks)?;
            return Ok((check(scene)?, Some(share)));
        }
        let Some(together) = together else {
            return self.of_first(inputs, options, ranks, read);
        };
        let say =
            |line: &String| progress.suspend(|| note!("{}: {line}", inputs[0].path.display()));
        let of_part = |mut own: PartRead, is_grid: bool| {
            own.head.notes.iter().for_each(say);
            own.report.warnings().iter().for_each(say);
            let mut scene = Loaded::of_part(&own, is_grid);
            scene.volumes = take(&mut own.share.volumes);
            (scene, own.share)
        };
        progress.set_message(format!("reading {}", inputs[0].path.display()));
        let (scene, share) = match together {
            Together::Points(mut file) => {
                file.notes().iter().for_each(say);
                let mut share = read_together(&mut file, ranks)?;
                let warnings = file.report().map_or(Vec::new(), SampleReport::warnings);
                warnings.iter().for_each(say);
                let mut scene = Loaded::of_stream(&file);
                scene.volumes = take(&mut share.volumes);
                (scene, share)
            }
            Together::Rows(mut rows) => {
                let (file, options) = &mut *rows;
                let Some(own) = read_rows(file, options, ranks)? else {
                    return self.of_first(inputs, options, ranks, read);
                };
                of_part(own, false)
            }
            Together::Pieces(pieces) => {
                let (file, options) = &*pieces;
                let own = match file {
                    Pieces::Cells(file) => read_pieces(file, options, ranks)?,
                    Pieces::Grid(file) => read_grid(file, options, ranks)?,
                };
                let Some(own) = own else {
                    return self.of_first(inputs, options, ranks, read);
                };
                self.check_classified(Kind::Grid, options)?;
                of_part(own, true)
            }
            Together::Planes(file) => {
                file.notes().iter().for_each(say);
                let (mut share, report) = read_planes(&file, options, ranks)?;
                report.warnings().iter().for_each(say);
                let volumes = take(&mut share.volumes);
                (Loaded::of_planes(&file, volumes, &report), share)
            }
        };
        Ok((check(scene)?, Some(share)))
    }

    /// Opens a file that ranks read together: many points, an index of pieces, or planes of a large
    /// lattice.
    fn together(
        &self,
        input: &Input,
        options: &SampleOptions,
        takes_parts: bool,
    ) -> Result<Option<Together>> {
        if !takes_parts {
            return Ok(None);
        }
        if let Some(file) = self.stream(input, options)? {
            return Ok(Some(Together::Points(Box::new(file))));
        }
        if let Some(rows) = self.rows(input, options)? {
            return Ok(Some(Together::Rows(Box::new(rows))));
        }
        if let Some(pieces) = self.pieces(input, options)? {
            return Ok(Some(Together::Pieces(Box::new(pieces))));
        }
        let planes = self.planes(input, options)?;
        Ok(planes.map(|file| Together::Planes(Box::new(file))))
    }

    /// Reads the inputs on the first rank and scatters the volumes. Other ranks receive the scene's
    /// metadata.
    fn of_first(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        ranks: &mut dyn Collective,
        read: impl FnOnce() -> Result<Loaded>,
    ) -> Result<(Loaded, Option<Share>)> {
        let own = match ranks.rank() {
            0 => read().map(Some),
            _ => Ok(None),
        };
        let mut own_scene = None;
        let own_metadata = own.map(|own| {
            own_scene = own;
            let about = own_scene.as_ref();
            about.map(|scene| scene.about(inputs, options.for_columns))
        });
        let about: About = ranks.broadcast_value(own_metadata)?;
        let volumes = own_scene.as_mut().map(|own| take(&mut own.volumes));
        let mut share = scatter(volumes, ranks)?;
        let mut scene = match own_scene {
            Some(own) => own,
            None => Loaded::of_about(about),
        };
        scene.volumes = take(&mut share.volumes);
        Ok((scene, Some(share)))
    }
}
