//! How one input is read, alone or as one of several.

use glam::DVec3;
use indicatif::ProgressBar;

use super::input::DataOptions;
use super::progress::note;
use super::source::Input;
use super::usage::{Kind, Uses, is_surface};
use crate::io::{Dataset, Geometry, Mesh, Up};
use crate::sample::mesh::Spread;
use crate::sample::{LEAST_PER_NODE, SampleOptions, SampleReport, SampledScene, TransferChoice};
use crate::scene::{PointVolume, TransferFunction};
use crate::{Error, Result};

/// An input's volumes, and how they came about.
pub(super) struct Read {
    pub(super) volumes: Vec<PointVolume>,
    pub(super) selectors: Vec<String>,
    pub(super) of: ReadAbout,
}

/// What is known of an input besides its particles.
pub(super) struct ReadAbout {
    /// What is shown, in which unit, over which length, and of which values it is chosen.
    pub(super) report: SampleReport,
    pub(super) kind: Kind,
    pub(super) up: Up,
    /// The least and the greatest coordinates.
    pub(super) corners: Option<(DVec3, DVec3)>,
    /// Whether its transfer function is chosen from its own values.
    pub(super) is_automatic: bool,
    /// The field that it was asked for, if for any.
    pub(super) field_asked: Option<String>,
    /// How many volumes there are, whether a function shows any, and whether it gives the opacity of any.
    pub(super) volume_count: usize,
    pub(super) is_classified: bool,
    pub(super) has_opacity: bool,
}

/// What one of several inputs was read as, and the error that says that it lacks the field that is asked for: another may
/// have it.
pub(super) type OneRead = (Read, Option<Error>);

impl ReadAbout {
    /// What is said of a field that has one value everywhere: its picture shows nothing else.
    fn uniform(&self, input: &Input) -> Option<String> {
        let [least, greatest] = self.report.value_range?;
        let field = self.report.field.as_deref()?;
        let is_one = least >= greatest && self.report.sample_count > 1;
        let others = match input.time {
            Some(_) => "; other time steps may differ (--step, --time)",
            None => "",
        };
        is_one.then(|| format!("`{field}` is {least} everywhere{others}"))
    }

    /// Whether it is a grid, whose kernels follow the spacing, or splats.
    pub(super) fn is_grid_or_splats(&self) -> bool {
        !matches!(self.kind, Kind::Points | Kind::Mesh)
    }
}

/// How many surfels per unit area a picture shows of a mesh: `None` where that is not known.
pub(super) type MostPixels<'a> = &'a dyn Fn(&Mesh, Up) -> Result<Option<f64>>;

impl DataOptions {
    /// Reads and samples an input.
    ///
    /// - `is_alone`: whether there are no others, one of which may have what this lacks.
    /// - `say`: lines for people.
    ///
    /// # Errors
    /// What reading and sampling say.
    pub(super) fn read_one(
        &self,
        input: &Input,
        is_alone: bool,
        options: &SampleOptions,
        most_pixels: MostPixels<'_>,
        say: &mut dyn FnMut(&str),
    ) -> Result<OneRead> {
        let dataset = self.open(input)?;
        dataset.notes.iter().for_each(|note| say(note));
        let mut options = self.of_input(input, options);
        if let (Geometry::Mesh(mesh), true) = (&dataset.geometry, is_alone)
            && options.spread == Spread::Automatic
            && let Some(density) = most_pixels(mesh, dataset.up())?
        {
            options.spread = Spread::NoDenser(density);
        }
        let mut missing = None;
        // What one input lacks another may have.
        if let (Some(field), None, false) = (&options.field, &input.field, is_alone)
            && !matches!(dataset.geometry, Geometry::Mesh(_))
        {
            missing = absence(&dataset, field);
            options.field.take_if(|_| missing.is_some());
        }
        let read = read(dataset, &options)?;
        let warnings = read.of.report.warnings();
        warnings.iter().for_each(|line| say(line));
        if let Some(line) = read.of.uniform(input) {
            say(&line);
        }
        Ok((read, missing))
    }

    /// Samples an input again, by another function.
    ///
    /// # Errors
    /// Those of [`Self::read_one`].
    pub(super) fn read_again(
        &self,
        input: &Input,
        options: &SampleOptions,
        function: &TransferFunction,
        own: &mut Read,
        progress: &ProgressBar,
    ) -> Result<()> {
        progress.set_message(format!("reading {}", input.path.display()));
        // Freed before the next is there.
        own.volumes.clear();
        let options = SampleOptions {
            field: own.of.field_asked.clone(),
            transfer: TransferChoice::Given(function.clone()),
            keeps_value_sample: false,
            ..self.of_input(input, options)
        };
        *own = read(self.open(input)?, &options)?;
        Ok(())
    }

    /// Whether any of some inputs can end sharply.
    pub(super) fn may_end_sharply<'a>(
        &self,
        mut reads: impl Iterator<Item = &'a ReadAbout>,
    ) -> bool {
        self.flatten.is_none() && self.shepard == 0 && reads.any(|read| read.kind.is_grid())
    }
}

/// Whether any of several inputs shows the field that is asked for.
pub(super) fn shows(reads: &[&ReadAbout], options: &SampleOptions) -> bool {
    let wanted = options.field.as_deref().unwrap_or_default();
    let mut shown = reads.iter().filter_map(|read| read.report.field.as_deref());
    shown.any(|shown| shown.eq_ignore_ascii_case(wanted))
}

/// Says that an input has not the field that others show.
pub(super) fn note_missing(input: &Input, options: &SampleOptions) {
    let field = options.field.as_deref().unwrap_or_default();
    note!(
        "{}: no field `{field}`: shown by its own",
        input.path.display()
    );
}

/// What inputs are, for options.
pub(super) fn uses(reads: &[&ReadAbout], options: &SampleOptions) -> Uses {
    let has_own = |read: &&ReadAbout| !read.is_automatic && read.report.field.is_some();
    Uses {
        kinds: reads.iter().map(|read| read.kind).collect(),
        is_classified: reads.iter().any(|read| read.is_classified),
        has_opacity: reads.iter().any(|read| read.has_opacity),
        has_file_function: reads.iter().any(has_own),
        for_columns: options.for_columns,
        of_prepared: None,
    }
}

/// Why a field cannot be shown, if it is not there.
fn absence(dataset: &Dataset, selector: &str) -> Option<Error> {
    let name = selector.rsplit_once(':').map_or(selector, |(name, _)| name);
    let is_there = |name: &str| {
        let mut names = dataset.fields.iter().map(|f| &f.name);
        names.any(|own| own.eq_ignore_ascii_case(name))
    };
    if is_there(selector) || is_there(name) {
        return None;
    }
    dataset.scalar(selector).err()
}

/// Bytes that a point takes at the least while it is sampled and sorted, beyond what was read: a hundred million spheres
/// with masses, 32 bytes each once they are read, take 67 at the peak.
const LEAST_PER_POINT: usize = 32;

/// The same of a value on a lattice ([`LEAST_PER_NODE`] of one on a grid): as it is read, and with ghosts or in blocks.
const LEAST_PER_CELL: usize = 2;

/// Refuses data that do not fit into memory once they are particles.
fn check_memory(dataset: &Dataset) -> Result<()> {
    let (count, each) = match &dataset.geometry {
        Geometry::Points { positions } => (positions.len(), LEAST_PER_POINT),
        Geometry::Lattice(lattice) => (lattice.len(), LEAST_PER_CELL),
        Geometry::Curvilinear { blocks } => {
            let counts = blocks.iter().map(|block| block.nodes.len());
            (counts.sum(), LEAST_PER_NODE)
        }
        // One kernel for each of either.
        Geometry::Cells(mesh) => (mesh.nodes.len().min(mesh.cell_count()), LEAST_PER_NODE),
        Geometry::Splats(splats) => (splats.positions.len(), LEAST_PER_POINT),
        // Surfels are counted before they are spread.
        Geometry::Mesh(_) => return Ok(()),
    };
    crate::memory::check(count, each).map_err(|e| e.in_file(&dataset.path))
}

/// Whether a transfer function is chosen from values.
pub(super) fn is_automatic(options: &SampleOptions) -> bool {
    let transfer = &options.transfer;
    matches!(
        transfer,
        TransferChoice::Automatic | TransferChoice::Named(_)
    )
}

pub(super) fn read(dataset: Dataset, options: &SampleOptions) -> Result<Read> {
    check_memory(&dataset)?;
    let kind = Kind::of(&dataset);
    let (up, corners) = (dataset.up(), dataset.bounds());
    let selectors = dataset.selectors();
    let SampledScene { volumes, report } = crate::sample::scene(dataset, options)?;
    let mut classified = volumes.iter().filter(|v| v.transfer_function.is_some());
    Ok(Read {
        selectors,
        of: ReadAbout {
            report,
            kind,
            up,
            corners,
            is_automatic: is_automatic(options),
            field_asked: options.field.clone(),
            volume_count: volumes.len(),
            is_classified: classified.clone().next().is_some(),
            has_opacity: classified.any(|volume| !is_surface(volume)),
        },
        volumes,
    })
}
