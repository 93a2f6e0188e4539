//! Loads the inputs of a command, and refuses options that do not apply to them.

use indicatif::ProgressBar;

use super::input::{DataOptions, refused_surface};
use super::progress::observer_of;
use super::usage::Uses;
use crate::io::{OpenOptions, Planes, RowFile, VtsPieces, VtuPieces};
use crate::load::facts::is_automatic;
use crate::load::{
    Cameras, Edit, Input, Kind, Loaded, Observer, Request, Series, is_prepared, load, load_series,
};
use crate::prepared::PointFile;
use crate::sample::{PartitionedRows, SampleOptions, TransferChoice};
use crate::scene::PointVolume;
use crate::{Error, Result};

/// Grid in pieces that ranks may read separately.
pub(crate) enum Pieces {
    Cells(VtuPieces),
    Grid(VtsPieces),
}

/// Least number of points from which a scene is prepared as a stream.
const STREAMED: usize = 1 << 22;

impl DataOptions {
    /// Returns the request to load inputs by these options.
    ///
    /// - `open`: [`DataOptions::open_options`].
    /// - `cameras`: cameras of the pictures, which determine the number of surfels of meshes.
    pub(crate) fn request<'a>(
        &self,
        inputs: &'a [Input],
        open: &'a OpenOptions,
        sample: &'a SampleOptions,
        cameras: Cameras<'a>,
        observer: Observer<'a>,
    ) -> Request<'a> {
        Request {
            inputs,
            open,
            sample,
            cameras,
            keeps_axes: self.keeps_axes,
            observer,
        }
    }

    /// Loads all inputs as one scene, and refuses options that do not apply to it.
    ///
    /// - `cameras`: cameras of the pictures, which determine the number of surfels of meshes.
    pub(crate) fn scene(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
    ) -> Result<Loaded> {
        self.check_function(options)?;
        let has_data = || !inputs.iter().all(|input| is_prepared(&input.path));
        self.check_spacing().or_else(|error| match has_data() {
            true => Err(error),
            false => Ok(()),
        })?;
        let (open, observer) = (self.open_options(), observer_of(progress));
        let scene = load(&self.request(inputs, &open, options, cameras, &observer))?;
        self.check_loaded(scene, options)
    }

    /// Refuses options that do not apply to a scene.
    pub(super) fn check_loaded(&self, scene: Loaded, options: &SampleOptions) -> Result<Loaded> {
        self.check_use(&Uses::of(&scene, options))?;
        self.check_fields(&scene)?;
        Ok(scene)
    }

    /// Refuses an iso-surface if no volume shows a field.
    fn check_fields(&self, scene: &Loaded) -> Result<()> {
        match self.flatten.is_some() && scene.fields.iter().all(Option::is_none) {
            true => Err(refused_surface("a field", "none")),
            false => Ok(()),
        }
    }

    /// Refuses options that do not apply to the iso-surface, or to the transfer function, asked
    /// for.
    pub(super) fn check_function(&self, options: &SampleOptions) -> Result<()> {
        self.check_surface()?;
        if self.scale.is_some() && matches!(options.transfer, TransferChoice::File(_)) {
            let expected = "an automatic transfer function, or a named colour map";
            let found = "a file, which has a scale of its own";
            let advice = "change the file, or leave the scale out";
            return Err(Error::invalid(
                "--scale",
                "transfer function",
                expected,
                found,
                advice,
            ));
        }
        Ok(())
    }

    /// Opens an input as a stream of particles, if it is a file in which each point becomes one
    /// particle. The file must hold at least [`STREAMED`] points; fewer are sorted in memory.
    pub(crate) fn stream(
        &self,
        input: &Input,
        options: &SampleOptions,
    ) -> Result<Option<PointFile>> {
        let is_plain = input.field.is_none() && input.function.is_none();
        let rows = match is_plain {
            true => self.row_file(input)?,
            false => None,
        };
        let file = match rows {
            Some(rows) => PointFile::of(rows, options)?,
            None => None,
        };
        let Some(file) = file else {
            return Ok(None);
        };
        self.check_function(options)?;
        self.check_spacing()?;
        self.check_use(&Uses {
            kinds: vec![Kind::Points],
            is_classified: file.field().is_some(),
            has_opacity: file.field().is_some(),
            has_file_function: false,
            for_columns: options.for_columns,
            of_prepared: None,
        })?;
        Ok(Some(file))
    }

    /// Opens an input as points that show a field, if ranks may read its rows separately. Returns
    /// the sampling options, too.
    pub(crate) fn rows(
        &self,
        input: &Input,
        options: &SampleOptions,
    ) -> Result<Option<(RowFile, SampleOptions)>> {
        let options = input.sample_options(options);
        let Some(mut file) = self.row_file(input)? else {
            return Ok(None);
        };
        let head = file.read(0..1)?;
        if PartitionedRows::of(&head, &options).is_none() {
            return Ok(None);
        }
        self.check_function(&options)?;
        self.check_spacing()?;
        self.check_classified(Kind::Points, &options)?;
        Ok(Some((file, options)))
    }

    /// Opens an input as a file of at least [`STREAMED`] rows, if no option edits or selects its
    /// data.
    fn row_file(&self, input: &Input) -> Result<Option<RowFile>> {
        // Folders and patterns are read whole.
        let is_of_rows = input.path.is_file()
            && input.edit == Edit::default()
            && input.time_step.is_none()
            && self.read_as.is_none()
            && self.scales.is_none()
            && self.has_types() == input.particle_type.is_some();
        let rows = match is_of_rows {
            true => RowFile::open(&input.path, input.particle_type)?,
            false => None,
        };
        Ok(rows.filter(|rows| rows.count() >= STREAMED))
    }

    /// Opens an input as planes of a lattice, if it is one large file that ranks may read
    /// separately and no option edits it.
    pub(crate) fn planes(&self, input: &Input, options: &SampleOptions) -> Result<Option<Planes>> {
        let is_plain = input.path.is_file()
            && input.edit == Edit::default()
            && input.function.is_none()
            && input.time_step.is_none()
            && input.particle_type.is_none()
            && self.scales.is_none();
        let is_sampled_alone =
            options.flatten.is_none() && options.shepard_passes == 0 && !options.normals;
        if !(is_plain && is_sampled_alone) {
            return Ok(None);
        }
        self.check_function(options)?;
        self.check_spacing()?;
        let field = input.field.as_deref().or(options.field.as_deref());
        let file = Planes::open(&input.path, &self.open_options(), field)?;
        // A lattice one layer thick becomes a surface. A small one is read by the first rank for
        // all.
        let is_large = |file: &Planes| {
            let lattice = file.lattice();
            lattice.dims.iter().all(|&n| n > 1) && lattice.len() >= STREAMED
        };
        let kind = |file: &Planes| match file.format() {
            "raw volume" => Kind::Raw,
            _ => Kind::Grid,
        };
        // Sample types apply to raw volumes alone.
        let is_typed = |file: &Planes| !self.has_types() || kind(file) == Kind::Raw;
        let Some(file) = file.filter(|file| is_large(file) && is_typed(file)) else {
            return Ok(None);
        };
        self.check_classified(kind(&file), options)?;
        Ok(Some(file))
    }

    /// Opens an input as pieces of a grid, if it is an index of pieces that ranks may read
    /// separately and no option edits it.
    pub(crate) fn pieces(
        &self,
        input: &Input,
        options: &SampleOptions,
    ) -> Result<Option<(Pieces, SampleOptions)>> {
        let is_plain = input.path.is_file()
            && input.edit == Edit::default()
            && input.time_step.is_none()
            && input.particle_type.is_none()
            && self.read_as.is_none()
            && self.scales.is_none()
            && !self.has_types();
        let path = &input.path;
        let file = match is_plain {
            true => match VtuPieces::open(path)?.map(Pieces::Cells) {
                None => VtsPieces::open(path)?.map(Pieces::Grid),
                cells => cells,
            },
            false => None,
        };
        let Some(file) = file else {
            return Ok(None);
        };
        let options = input.sample_options(options);
        self.check_function(&options)?;
        self.check_spacing()?;
        Ok(Some((file, options)))
    }

    /// Refuses options that do not apply to one input of a kind that a transfer function shows.
    pub(super) fn check_classified(&self, kind: Kind, options: &SampleOptions) -> Result<()> {
        self.check_use(&Uses {
            kinds: vec![kind],
            is_classified: true,
            has_opacity: true,
            has_file_function: !is_automatic(options),
            for_columns: options.for_columns,
            of_prepared: None,
        })
    }

    /// Loads the choices that the steps of a series share.
    pub(crate) fn series(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        progress: &ProgressBar,
    ) -> Result<Series> {
        self.check_spacing()?;
        let (open, observer) = (self.open_options(), observer_of(progress));
        load_series(&self.request(inputs, &open, options, &|_, _| Ok(Vec::new()), &observer))
    }

    /// Reads the inputs again, and returns their volumes with kernels of another width.
    pub(crate) fn scene_at_kernel_width(
        &self,
        inputs: &[Input],
        kernel_width: f64,
    ) -> Result<Vec<PointVolume>> {
        let options = SampleOptions {
            kernel_width,
            ..self.sample_options()
        };
        let mut volumes = Vec::new();
        for input in inputs {
            let dataset = self.open(input)?;
            volumes.extend(crate::sample::scene(dataset, &input.sample_options(&options))?.volumes);
        }
        Ok(volumes)
    }
}
