//! Names inputs: a file with the field and the transfer function that it shows.

use std::fmt;
use std::path::{Path, PathBuf};

use super::edit::Edit;
use crate::Result;
use crate::data::association::Association;
use crate::data::dataset::Dataset;
use crate::data::particle_type::ParticleType;
use crate::edit::{note_displacement, open_within};
use crate::io::OpenOptions;
use crate::sample::{FunctionOptions, SampleOptions, TransferChoice};
use crate::scene::TransferFunction;

/// File, and its choices where they differ from the options of all inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Path of the file. A folder with a SOG scene stands for its index file.
    pub path: PathBuf,
    /// Field to show.
    pub field: Option<String>,
    /// Transfer function: a file, or the name of a colour map.
    pub function: Option<String>,
    /// Transfer function in place of all choices of one.
    pub transfer: Option<TransferFunction>,
    /// Type of the particles to show, for a snapshot that holds several types.
    pub particle_type: Option<ParticleType>,
    /// Opacity of the boundary, for an input that shows its boundary
    /// ([`SampleOptions::surface`](crate::sample::SampleOptions::surface)).
    pub surface: Option<f64>,
    /// Number of the series' step that the file belongs to.
    pub step: usize,
    /// Number of the time step within a file that holds several.
    pub time_step: Option<usize>,
    /// Time that the file or its collection states.
    pub time: Option<f64>,
    /// Placement and crop box.
    pub edit: Edit,
}

impl Input {
    /// Makes an input that shows a file by the options of all inputs.
    pub fn file(path: PathBuf) -> Self {
        Self {
            path,
            field: None,
            function: None,
            transfer: None,
            particle_type: None,
            surface: None,
            step: 0,
            time_step: None,
            time: None,
            edit: Edit::default(),
        }
    }

    /// Parses `FILE`, `FILE@FIELD` or `FILE@FIELD@FUNCTION`. `FIELD@nodes` and `FIELD@cells` name a
    /// field of nodes or of cells. If a file with the whole name exists, the name means that file.
    pub fn parse(path: PathBuf) -> Self {
        let text = path
            .to_str()
            .filter(|text| text.contains('@') && !path.exists());
        let parts: Vec<&str> = text.map_or_else(Vec::new, |text| text.split('@').collect());
        let stated = |part: &str| (!part.is_empty()).then(|| part.to_owned());
        let of = |word: &str| Association::of_name(word).is_some();
        match parts.as_slice() {
            [file, field, word, function @ ..] if of(word) && function.len() < 2 => Self {
                field: Some(format!("{field}@{word}")),
                function: function.first().copied().and_then(stated),
                ..Self::file(file.into())
            },
            [file, field] => Self {
                field: stated(field),
                ..Self::file(file.into())
            },
            [file, field, function] => Self {
                field: stated(field),
                function: stated(function),
                ..Self::file(file.into())
            },
            _ => Self::file(path),
        }
    }

    /// Returns this input with the particles of one type.
    #[must_use]
    pub fn of_type(&self, particles: ParticleType) -> Self {
        Self {
            particle_type: Some(particles),
            ..self.clone()
        }
    }

    /// Returns this input with its boundary in place of its volume.
    ///
    /// - `opacity`: opacity of the boundary seen head-on.
    #[must_use]
    pub fn of_surface(&self, opacity: f64) -> Self {
        Self {
            surface: Some(opacity),
            ..self.clone()
        }
    }

    /// Opens the file, places its data and crops them.
    ///
    /// - `options`: options of all inputs.
    ///
    /// # Errors
    /// The errors of [`io::open`](crate::io::open) and of [`Edit::applied`].
    pub fn open(&self, options: &OpenOptions) -> Result<Dataset> {
        let options = OpenOptions {
            particle_type: self.particle_type,
            time_step: self.time_step,
            ..options.clone()
        };
        match self.edit.crop_alone() {
            Some([lower, upper]) => {
                let mut data = open_within(&self.path, &options, lower, upper)?;
                data.notes.extend(note_displacement(&data));
                Ok(data)
            }
            None => self.edit.applied(crate::io::open(&self.path, &options)?),
        }
    }

    /// Returns the sampling options of this input.
    ///
    /// - `options`: options of all inputs.
    pub(crate) fn sample_options(&self, options: &SampleOptions) -> SampleOptions {
        let mut own = options.clone();
        own.field = self.field.clone().or(own.field);
        own.surface = self.surface.or(own.surface);
        if let Some(function) = &self.function {
            own.function.transfer = transfer_of(function);
        }
        if let Some(function) = &self.transfer {
            own.function = FunctionOptions {
                transfer: TransferChoice::Given(function.clone()),
                ..FunctionOptions::default()
            };
        }
        own
    }
}

/// Formats the input as [`Input::parse`] reads it.
impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [&self.field, &self.function];
        let stated = parts.iter().rposition(|part| part.is_some());
        let stated = stated.map_or(&parts[..0], |last| &parts[..=last]);
        self.path.display().fmt(f)?;
        for part in stated {
            write!(f, "@{}", part.as_deref().unwrap_or_default())?;
        }
        Ok(())
    }
}

/// Interprets the name of a transfer function: a file, or the name of a colour map, which has no
/// dot or slash.
pub(crate) fn transfer_of(name: &str) -> TransferChoice {
    if name.contains(['.', '/', '\\']) || Path::new(name).exists() {
        TransferChoice::File(name.into())
    } else {
        TransferChoice::Named(name.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_name_a_file_a_field_and_a_function() {
        let parse = |text: &str| Input::parse(text.into());
        let of = |path: &str, field: Option<&str>, function: Option<&str>| Input {
            field: field.map(str::to_owned),
            function: function.map(str::to_owned),
            ..Input::file(path.into())
        };
        assert_eq!(parse("a.vtu"), of("a.vtu", None, None));
        assert_eq!(parse("a.vtu@p"), of("a.vtu", Some("p"), None));
        assert_eq!(
            parse("a.vtu@v:x@f.json"),
            of("a.vtu", Some("v:x"), Some("f.json"))
        );
        assert_eq!(parse("a.vtu@@plasma"), of("a.vtu", None, Some("plasma")));
        assert_eq!(parse("a.vtu@p@cells"), of("a.vtu", Some("p@cells"), None));
        assert_eq!(
            parse("a.vtu@p@nodes@plasma"),
            of("a.vtu", Some("p@nodes"), Some("plasma"))
        );
        assert_eq!(parse("a@b@c@d"), of("a@b@c@d", None, None));
        for text in ["a.vtu", "a.vtu@p", "a.vtu@@plasma", "a.vtu@v:x@f.json"] {
            assert_eq!(parse(text).to_string(), text);
        }
    }
}
