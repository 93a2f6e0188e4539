//! Reads the inputs of a command into one scene: their volumes, fields and transfer functions.

use std::path::Path;

use crate::data::up::Up;
use crate::io::{Planes, RowFile, VtsPieces, VtuPieces};
use crate::legend::title_of;
use crate::load::parts::PartRead;
use crate::prepared::{About, PointFile, PreparedScene};
use crate::sample::{PartitionedRows, SampleOptions, SampleReport, TransferChoice};
use crate::scene::PointVolume;
use crate::view::Bounds;
use crate::{Error, Result};
use glam::DVec3;
use indicatif::ProgressBar;

use super::edits::Edit;
use super::input::{DataOptions, refused_surface, transfer_of};
use super::prepared::{self, Members, is_prepared};
use super::reads::{ReadAbout, is_automatic, uses};
use super::source::Input;
use super::together::{Gathered, Series, Together};
use super::usage::{Kind, Uses};
use super::viewpoint::Cameras;

/// Contents of the inputs.
pub(crate) struct Scene {
    pub(crate) volumes: Vec<PointVolume>,
    /// Prepared scenes, and the volumes that stand in for theirs.
    pub(crate) prepared: Members,
    /// Name of the field that each volume shows.
    pub(crate) fields: Vec<Option<String>>,
    /// Titles of these fields in legends, with their units if these are known.
    pub(crate) titles: Vec<Option<String>>,
    /// Fields and components of the first input:
    /// [`Dataset::selectors`](crate::io::Dataset::selectors).
    pub(crate) selectors: Vec<String>,
    /// True if all inputs are grids, whose kernels follow the spacing.
    pub(crate) grids_only: bool,
    /// True if any of the data can be cut sharply at its boundary: grids, unless options prevent
    /// it.
    pub(crate) has_boundary: bool,
    /// Direction up: [`Up::of_scene`].
    pub(crate) up: Up,
    /// Least and greatest coordinates of each input's data.
    corners: Vec<(DVec3, DVec3)>,
}

impl Scene {
    /// Creates a scene without inputs.
    pub(crate) fn of_nothing() -> Self {
        Self::of_reads(Vec::new(), Vec::new(), false)
    }

    /// Creates a scene from the metadata of a point file that was read as a stream.
    pub(crate) fn of_stream(file: &PointFile) -> Self {
        let unit = file.report().and_then(|report| report.unit.as_deref());
        Self::of_points(file.field(), unit, file.up(), file.bounds())
    }

    /// Creates a scene from the metadata of a file of which every rank has read a part.
    ///
    /// - `is_grid`: whether the file holds a grid, not points.
    pub(crate) fn of_part(read: &PartRead, is_grid: bool) -> Self {
        let (field, unit) = (read.report.field.as_deref(), read.report.unit.as_deref());
        Self {
            grids_only: is_grid,
            has_boundary: is_grid,
            ..Self::of_points(field, unit, read.head.up(), read.corners)
        }
    }

    fn of_points(
        field: Option<&str>,
        unit: Option<&str>,
        up: Up,
        corners: Option<(DVec3, DVec3)>,
    ) -> Self {
        Self {
            volumes: Vec::new(),
            prepared: Vec::new(),
            fields: vec![field.map(str::to_owned)],
            titles: vec![field.map(|field| title_of(field, unit))],
            selectors: Vec::new(),
            grids_only: false,
            has_boundary: false,
            up,
            corners: corners.into_iter().collect(),
        }
    }

    /// Creates a scene from the metadata that another rank sent.
    pub(crate) fn of_about(about: About) -> Self {
        let up = prepared::up_of(&about);
        let corners = about.corners.into_iter();
        Self {
            volumes: Vec::new(),
            prepared: Vec::new(),
            fields: about.fields,
            titles: about.titles,
            selectors: Vec::new(),
            grids_only: false,
            has_boundary: false,
            up,
            corners: corners
                .map(|[a, b]| (DVec3::from(a), DVec3::from(b)))
                .collect(),
        }
    }

    /// Creates a scene from a lattice of which every rank has read some planes.
    pub(crate) fn of_planes(
        file: &Planes,
        volumes: Vec<PointVolume>,
        report: &SampleReport,
    ) -> Self {
        let head = file.head();
        let title = title_of(file.field(), report.unit.as_deref());
        Self {
            volumes,
            prepared: Vec::new(),
            fields: vec![Some(file.field().to_owned())],
            titles: vec![Some(title)],
            selectors: Vec::new(),
            grids_only: true,
            has_boundary: true,
            up: Up::of_scene([head.up()]),
            corners: head.bounds().into_iter().collect(),
        }
    }

    /// Names the field of volumes that have no name yet, up to `count` volumes.
    fn name(&mut self, count: usize, report: SampleReport) {
        let (field, unit) = (report.field, report.unit);
        let title = field.as_deref().map(|f| title_of(f, unit.as_deref()));
        self.titles.resize(count, title);
        self.fields.resize(count, field);
    }

    /// Creates a scene from inputs of which every rank has read some.
    ///
    /// - `volumes`: volumes of all inputs; those of other ranks have no particles.
    pub(super) fn of_reads(
        volumes: Vec<PointVolume>,
        reads: Vec<ReadAbout>,
        has_boundary: bool,
    ) -> Self {
        let mut scene = Self {
            volumes,
            prepared: Vec::new(),
            fields: Vec::new(),
            titles: Vec::new(),
            selectors: Vec::new(),
            grids_only: reads.iter().all(ReadAbout::is_grid_or_splats),
            has_boundary,
            up: Up::of_scene(
                reads
                    .iter()
                    .filter(|read| !read.is_nothing)
                    .map(|read| read.up),
            ),
            corners: reads.iter().filter_map(|read| read.corners).collect(),
        };
        for read in reads {
            scene.name(scene.fields.len() + read.volume_count, read.report);
        }
        scene
    }

    /// Adds a prepared scene, and volumes that stand in for its own.
    fn add(&mut self, own: PreparedScene, about: About) {
        let first = self.volumes.len();
        self.volumes.extend(own.stand_ins());
        let count = self.volumes.len();
        self.fields.extend(about.fields);
        self.titles.extend(about.titles);
        self.fields.resize(count, None);
        self.titles.resize(count, None);
        let corners = about.corners.into_iter();
        self.corners
            .extend(corners.map(|[a, b]| (DVec3::from(a), DVec3::from(b))));
        self.prepared.push((first..count, own));
    }

    /// Returns the metadata that a prepared scene stores beside its particles.
    ///
    /// - `inputs`: the inputs of this scene.
    pub(crate) fn about(&self, inputs: &[Input], for_columns: bool) -> About {
        let name = |input: &Input| input.path.display().to_string();
        let corners = self.corners.iter();
        About {
            inputs: inputs.iter().map(name).collect(),
            fields: self.fields.clone(),
            titles: self.titles.clone(),
            corners: corners.map(|(a, b)| [a.to_array(), b.to_array()]).collect(),
            up: self.up.direction.to_array(),
            front: self.up.front.map(|front| front.to_array()),
            is_plane: self.up.is_plane,
            is_of_mesh: self.up.is_of_mesh,
            for_columns,
        }
    }

    /// Returns the box of all data, or `None` if no datum has a position.
    pub(crate) fn bounds(&self) -> Option<Bounds> {
        let corners = self.corners.iter().copied();
        let (lower, upper) = corners.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
        Some(((lower + upper) / 2.0, (upper - lower) / 2.0))
    }
}

/// Grid in pieces that ranks may read separately.
pub(crate) enum Pieces {
    Cells(VtuPieces),
    Grid(VtsPieces),
}

/// Least number of points from which a scene is prepared as a stream.
const STREAMED: usize = 1 << 22;

impl DataOptions {
    /// Reads and samples all inputs as one scene, and prints what was left out: [`Together`].
    ///
    /// - `cameras`: cameras of the pictures, which determine the number of surfels of meshes.
    pub(crate) fn scene(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
    ) -> Result<Scene> {
        self.check_function(options)?;
        // Opens each input that is a prepared scene.
        let mut opened = Vec::new();
        let all = inputs;
        let mut data = Vec::new();
        for input in all {
            let own = is_prepared(&input.path);
            let own = own.then(|| prepared::open(input, options.for_columns));
            if own.is_none() {
                data.push(input.clone());
            }
            opened.push(own.transpose()?);
        }
        let beside: Vec<_> = opened
            .iter()
            .flatten()
            .map(|(_, about)| {
                let corners = about.corners.iter();
                let corners = corners.map(|[a, b]| (DVec3::from(*a), DVec3::from(*b)));
                let corners = corners.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
                (corners, prepared::up_of(about))
            })
            .collect();
        let together = Together {
            data: self,
            inputs: &data,
            own: 0..data.len(),
            options,
            cameras,
            beside: &beside,
            progress,
        };
        let Gathered {
            abouts,
            volumes,
            selectors,
        } = together.read(&mut None)?;
        let mut shown = uses(&abouts, options);
        let is_prepared = data.is_empty() && !all.is_empty();
        shown.of_prepared = is_prepared.then(|| {
            let scenes = opened.iter().flatten();
            scenes
                .flat_map(|(scene, _)| scene.requirements())
                .any(|r| r.classification)
        });
        self.check_use(&shown)?;
        let mut scene = Scene {
            volumes: Vec::new(),
            prepared: Vec::new(),
            fields: Vec::new(),
            titles: Vec::new(),
            selectors: match opened.first() {
                Some(Some(_)) => Vec::new(),
                _ => selectors,
            },
            grids_only: opened.iter().all(Option::is_none)
                && abouts.iter().all(ReadAbout::is_grid_or_splats),
            has_boundary: self.may_end_sharply(abouts.iter()),
            up: Up::of_scene([]),
            corners: abouts.iter().filter_map(|read| read.corners).collect(),
        };
        let mut ups = Vec::new();
        let mut reads = abouts.into_iter().zip(volumes);
        for (input, own) in all.iter().zip(opened) {
            if let Some((own, about)) = own {
                ups.push(prepared::up_of(&about));
                scene.add(self.shown(own, &input.path, is_prepared)?, about);
                continue;
            }
            let Some((read, volumes)) = reads.next() else {
                break;
            };
            if !read.is_nothing {
                ups.push(read.up);
            }
            scene.volumes.extend(volumes);
            scene.name(scene.volumes.len(), read.report);
        }
        self.check_fields(&scene)?;
        scene.up = Up::of_scene(ups);
        Ok(scene)
    }

    /// Refuses an iso-surface if no volume shows a field.
    pub(super) fn check_fields(&self, scene: &Scene) -> Result<()> {
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
        let options = self.of_input(input, options);
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
        let options = self.of_input(input, options);
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

    /// Applies the transfer function that was asked for to a prepared scene.
    ///
    /// - `is_alone`: whether the scene is the only input. With others, the function may be meant
    ///   for them.
    fn shown(&self, scene: PreparedScene, path: &Path, is_alone: bool) -> Result<PreparedScene> {
        match self.sample_options().transfer {
            TransferChoice::File(function) if is_alone => {
                prepared::with_function(scene, path, &function)
            }
            _ => Ok(scene),
        }
    }

    /// Returns the sampling options of one input.
    pub(super) fn of_input(&self, input: &Input, options: &SampleOptions) -> SampleOptions {
        let mut own = options.clone();
        own.field = input.field.clone().or(own.field);
        if let Some(function) = &input.function {
            own.transfer = transfer_of(function);
        }
        own
    }

    /// Reads what the steps of a series share: one field, a transfer function of the values of all
    /// steps, and the box of each step.
    pub(crate) fn series(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        progress: &ProgressBar,
    ) -> Result<Series> {
        let options = SampleOptions {
            keeps_value_sample: true,
            local_models: false,
            ..options.clone()
        };
        let together = Together {
            data: self,
            inputs,
            own: 0..inputs.len(),
            options: &options,
            cameras: &|_, _| Ok(Vec::new()),
            beside: &[],
            progress,
        };
        together.series()
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
            volumes.extend(crate::sample::scene(dataset, &self.of_input(input, &options))?.volumes);
        }
        Ok(volumes)
    }
}
