//! Defines drawables: what one call of a front end makes of arrays or a file.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::options::{Opening, Sampling};
use super::source::{Data, Source, is_empty};
use crate::error::{Error, Result};
use crate::io::Ranges;
use crate::io::bytes::file::Input;
use crate::io::{
    Association, Dataset, Field, FieldSource, Geometry, OpenOptions, StepChoice, Up, format_of,
    has_particle_types, may_have_types, open, read, read_input, recognise,
};
use crate::sample::{SampleOptions, SampleReport, Sampled, is_surface};
use crate::scene::Values;
use crate::task::Task;

/// Drawable made of one object: a volume, a surface, or the parts of a collection.
#[derive(Debug)]
pub struct Drawable {
    /// Its data sets.
    pub sources: Vec<Source>,
    /// Direction up, if it was given.
    pub up: Option<DVec3>,
}

/// Makes a field of an array.
pub fn field(name: &str, values: Values, association: Association) -> Field {
    Field {
        name: name.into(),
        association,
        source: FieldSource::Scalar(values),
        unit: None,
    }
}

/// Returns the error for an argument that does not fit.
fn fault(place: &str, expected: impl Into<String>, found: impl Into<String>) -> Error {
    Error::invalid("data", place, expected, found, "correct it")
}

impl Drawable {
    /// Makes a drawable of one data set. It checks now that its parts fit; samples are checked when
    /// they are drawn.
    ///
    /// # Errors
    /// Parts that do not fit; the boundary of data that are surfaces themselves.
    pub fn of(
        what: &'static str,
        geometry: Geometry,
        fields: Vec<Field>,
        sampling: Sampling,
    ) -> Result<Self> {
        let mut dataset = Dataset::new(what.as_ref(), what, geometry, fields);
        sampling.set_units(&mut dataset);
        // A rank may hold no cells of a mesh. Sampling refuses data of which nobody holds any.
        let is_empty = is_empty(&dataset);
        if !(is_empty && matches!(dataset.geometry, Geometry::Cells(_))) {
            dataset.validate()?;
        }
        if sampling.around.is_some() && is_surface(&dataset) && !is_empty {
            return Err(without_volume());
        }
        Ok(Self {
            sources: sources_of(Arc::new(dataset), sampling.options, sampling.around).collect(),
            up: sampling.up,
        })
    }

    /// Makes a drawable of surfels that are ready.
    pub fn of_surfels(sampled: Sampled, up: Option<DVec3>) -> Self {
        let data = Data::Surfels(Arc::new(sampled));
        Self {
            sources: vec![Source::new(data, SampleOptions::default())],
            up,
        }
    }

    /// Opens a file as a drawable: all parts of its first time step, or of another. From a
    /// snapshot, it takes the particles of each type that is named.
    ///
    /// # Errors
    /// Unreadable files; fields or time steps that they lack; nothing to draw.
    pub fn open(path: &Path, how: &Opening, sampling: &Sampling) -> Result<Self> {
        Self::of_files(path, None, how, sampling)
    }

    /// Opens a file that the caller reads in ranges, as [`open`](Self::open) does from the disk. Folders cannot be listed.
    ///
    /// - `beside`: returns other files that it names, by their paths, which begin with the folder of `name`.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open); `beside` returns `None` for a file that is needed.
    pub fn open_with(
        name: &str,
        file: &dyn Ranges,
        beside: &dyn Fn(&Path) -> Option<Box<dyn Ranges>>,
        how: &Opening,
        sampling: &Sampling,
    ) -> Result<Self> {
        let main = Input::of_ranges(Path::new(name), file, beside);
        Self::of_files(main.path, Some(main), how, sampling)
    }

    /// Opens a file on the disk, or `main` in memory.
    fn of_files(
        path: &Path,
        main: Option<Input<'_>>,
        how: &Opening,
        sampling: &Sampling,
    ) -> Result<Self> {
        let Opening {
            options: how,
            types,
            step,
        } = how;
        let format = match main {
            None => format_of(path, how),
            Some(main) => recognise(main, how),
        };
        // Errors of unreadable files are reported when they are read.
        let parts = match format {
            Ok(format) => {
                let steps = match main {
                    None => format.time_steps(path)?,
                    Some(main) => format.steps_of(main)?,
                };
                let step = (*step).unwrap_or(StepChoice::Number(0));
                let chosen = step.of(path, &steps)?;
                let parts = steps.into_iter().skip(chosen).take(1);
                let parts = parts.flat_map(|step| step.parts);
                parts.map(|part| (part.path, part.time_step)).collect()
            }
            Err(_) => vec![(path.to_path_buf(), None)],
        };
        let (mut sets, mut empty, mut nothing) = (Vec::new(), Vec::new(), None);
        for (path, time_step) in parts {
            let has_types = !types.is_empty()
                && match main {
                    None => has_particle_types(&path)?,
                    Some(main) => of_part(main, &path, may_have_types)?,
                };
            let types = types.iter().copied().map(Some);
            let types: Vec<_> = if has_types {
                types.collect()
            } else {
                vec![None]
            };
            for particle_type in types {
                let how = OpenOptions {
                    time_step,
                    particle_type: particle_type.or(how.particle_type),
                    ..how.clone()
                };
                let opened = match main {
                    None => open(&path, &how),
                    Some(main) => of_part(main, &path, |input| read_input(input, &how)),
                };
                match opened {
                    // Another part may hold something.
                    Err(error) if error.holds_nothing() => {
                        empty.push(path.display().to_string());
                        nothing.get_or_insert(error);
                    }
                    set => sets.push(set?),
                }
            }
        }
        if let (true, Some(error)) = (sets.is_empty(), nothing) {
            return Err(error);
        }
        if let (false, Some(set)) = (empty.is_empty(), sets.first_mut()) {
            let names = empty.join(", ");
            set.notes.push(format!(
                "parts that hold nothing to draw are left out: {names}"
            ));
        }
        Self::of_sets(sets, sampling)
    }

    /// Reads a drawable from the bytes of a file.
    ///
    /// # Errors
    /// Bytes that are no file of a known format; fields that it lacks.
    pub fn read(name: &str, bytes: &[u8], how: &OpenOptions, sampling: &Sampling) -> Result<Self> {
        Self::of_sets(vec![read(name, bytes, how)?], sampling)
    }

    /// Makes a drawable of data sets. A field that one data set lacks may be in another.
    fn of_sets(mut sets: Vec<Dataset>, sampling: &Sampling) -> Result<Self> {
        for set in &mut sets {
            sampling.set_units(set);
        }
        Self::of_shared(sets.into_iter().map(Arc::new).collect(), sampling)
    }

    /// Returns the same data, sampled with other options. Units stay as they were given first.
    ///
    /// # Errors
    /// A field that all data sets lack; the boundary of data that are surfaces themselves; surfels, which no options
    /// concern.
    pub fn sampled_by(&self, sampling: &Sampling) -> Result<Self> {
        let mut sets: Vec<Arc<Dataset>> = Vec::new();
        for source in &self.sources {
            let Data::Set(set) = &source.data else {
                let expected = "data that are sampled";
                return Err(Error::invalid(
                    "scene",
                    "kind",
                    expected,
                    "surfels",
                    "make them again",
                ));
            };
            // A volume and its boundary have one data set.
            if !sets.last().is_some_and(|last| Arc::ptr_eq(last, set)) {
                sets.push(Arc::clone(set));
            }
        }
        Self::of_shared(sets, sampling)
    }

    fn of_shared(sets: Vec<Arc<Dataset>>, sampling: &Sampling) -> Result<Self> {
        let Sampling {
            options,
            up,
            around,
            ..
        } = sampling;
        let lacks = |set: &Arc<Dataset>| {
            let field = options.field.as_deref()?;
            let has_none = matches!(set.geometry, Geometry::Mesh(_)) && set.fields.is_empty();
            set.scalar(field).err().filter(|_| !has_none)
        };
        let mut lacking: Vec<_> = sets.iter().map(lacks).collect();
        let is_lacking: Vec<bool> = lacking.iter().map(Option::is_some).collect();
        if is_lacking.iter().all(|lacks| *lacks)
            && let Some(error) = lacking.first_mut().and_then(Option::take)
        {
            return Err(error);
        }
        // Beside grids, surfaces are drawn as they are: they have no volume within.
        if around.is_some() && sets.iter().all(|set| is_surface(set)) {
            return Err(without_volume());
        }
        let sources = sets.into_iter().zip(is_lacking).flat_map(|(set, lacks)| {
            let around = around.filter(|_| !is_surface(&set));
            let own = SampleOptions {
                field: options.field.clone().filter(|_| !lacks),
                ..options.clone()
            };
            sources_of(set, own, around)
        });
        Ok(Self {
            sources: sources.collect(),
            up: *up,
        })
    }

    /// Joins drawables to one.
    pub fn together<'a>(things: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let sources = things.clone().flat_map(|thing| &thing.sources);
        Self {
            sources: sources.map(Source::fresh).collect(),
            up: things.into_iter().find_map(|thing| thing.up),
        }
    }

    /// Returns the names of its fields.
    pub fn fields(&self) -> Vec<String> {
        let mut names = Vec::new();
        for source in &self.sources {
            if let Data::Set(dataset) = &source.data {
                for name in dataset.selectors() {
                    if !names.contains(&name) {
                        names.push(name);
                    }
                }
            }
        }
        names
    }

    /// Returns the same data with another field to show.
    ///
    /// # Errors
    /// A field that it lacks.
    pub fn showing(&self, field: &str) -> Result<Self> {
        let known = self.fields();
        if !known.iter().any(|name| name.eq_ignore_ascii_case(field)) {
            let names = known.join(", ");
            return Err(fault("field", format!("one of {names}"), field));
        }
        let sources = self.sources.iter().map(|source| {
            let mut source = source.fresh();
            source.options.field = Some(field.into());
            source
        });
        Ok(Self {
            sources: sources.collect(),
            up: self.up,
        })
    }

    /// Returns this drawable, of one data set, with other values of its field in the same unit.
    ///
    /// # Errors
    /// A drawable without one field of values; another number of values.
    pub fn with_values(&self, values: Values) -> Result<Self> {
        let ([source], Some(name)) = (self.sources.as_slice(), self.field_name()) else {
            let found = "one without, or parts of a collection";
            return Err(fault("values", "a volume with a field to show", found));
        };
        let Data::Set(dataset) = &source.data else {
            return Err(fault("values", "a volume", "surfels"));
        };
        let mut dataset = Dataset::clone(dataset);
        for field in &mut dataset.fields {
            if field.name.eq_ignore_ascii_case(&name)
                && let FieldSource::Scalar(own) = &mut field.source
            {
                if own.len() != values.len() {
                    let found = values.len().to_string();
                    return Err(fault("values", format!("{} of them", own.len()), found));
                }
                *own = values;
                let data = Data::Set(Arc::new(dataset));
                return Ok(Self {
                    sources: vec![Source::new(data, source.options.clone())],
                    up: self.up,
                });
            }
        }
        Err(fault("values", format!("a scalar field `{name}`"), "none"))
    }

    /// Returns the name of the field that was asked for.
    fn field_name(&self) -> Option<String> {
        let mut sources = self.sources.iter();
        sources.find_map(|source| source.options.field.clone())
    }

    /// Returns the notes of its data sets.
    pub fn notes(&self) -> Vec<String> {
        let notes = self.sources.iter().filter_map(|source| match &source.data {
            Data::Set(dataset) => Some(dataset.notes.clone()),
            Data::Surfels(_) => None,
        });
        notes.flatten().collect()
    }

    /// Returns the least and the greatest coordinates.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let all = self.sources.iter().filter_map(Source::corners);
        all.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Returns the reports of sampling, one for each data set. It samples now what was not sampled before.
    ///
    /// # Errors
    /// Data that cannot be sampled; cancelled work.
    pub fn reports(&self, task: &Task) -> Result<Vec<SampleReport>> {
        self.sources
            .iter()
            .map(|source| source.report(task))
            .collect()
    }

    /// Returns the direction up of each data set.
    pub fn ups(&self) -> impl Iterator<Item = Up> {
        let given = self.given_up();
        let sources = self.sources.iter();
        sources.map(move |source| given.unwrap_or_else(|| source.up()))
    }

    /// Returns the direction up that was given.
    pub(super) fn given_up(&self) -> Option<Up> {
        self.up.map(|direction| Up {
            direction,
            reason: "as it was said",
            front: None,
            is_plane: false,
            is_of_mesh: false,
        })
    }
}

/// Returns the error for the boundary of data that are surfaces themselves.
fn without_volume() -> Error {
    Error::invalid(
        "data",
        "surface_opacity",
        "a grid with a volume",
        "a surface",
        "leave it out",
    )
}

/// Calls `of` with a file in memory, or with one beside it.
fn of_part<T>(main: Input<'_>, path: &Path, of: impl FnOnce(Input<'_>) -> Result<T>) -> Result<T> {
    match path == main.path {
        true => of(main),
        false => main.with_beside(path, of),
    }
}

/// Makes the source of a data set, and that of its boundary if it is drawn around the volume.
///
/// - `around`: opacity of the boundary.
fn sources_of(
    dataset: Arc<Dataset>,
    options: SampleOptions,
    around: Option<f64>,
) -> impl Iterator<Item = Source> {
    let boundary = around.map(|opacity| {
        let options = SampleOptions {
            surface: Some(opacity),
            ..options.clone()
        };
        Source::new(Data::Set(Arc::clone(&dataset)), options)
    });
    std::iter::once(Source::new(Data::Set(dataset), options)).chain(boundary)
}
