//! Defines the options of `ewa-splat export`.

use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};

use crate::command::input::DataOptions;
use crate::command::parse;
use crate::command::render;
use crate::command::viewpoint::CameraOptions;
use crate::{Error, Result};

/// Options of `render` that say what is drawn and where, whatever the page shows.
const OF_ALL: [&str; 6] = [
    "inputs",
    "out",
    "keep_axes",
    "tolerance",
    "clip",
    "background",
];

/// Options of `render` that the page has for data as they are.
const OF_DATA: [&str; 18] = [
    "field",
    "transfer_function",
    "range",
    "scale",
    "opacity_scale",
    "step",
    "flatten",
    "surface",
    "composite",
    "slab_thickness",
    "lit",
    "unlit",
    "lights",
    "shadows",
    "shadow_softness",
    "column_density",
    "column_mean",
    "column_of",
];

/// Options of `render`, beside those of the data, whose effect splats keep.
const OF_SPLATS: [&str; 3] = ["lit", "unlit", "lights"];

/// Options of the page alone.
#[derive(Args)]
#[command(next_help_heading = "Page")]
pub(super) struct PageOptions {
    /// Folder of the built page, which `web/build` makes [default: EWA_SPLAT_PAGE, share/ewa-splat/page beside the
    /// program's folder, or web/dist above it]
    #[arg(long, value_name = "DIR")]
    pub(super) page: Option<PathBuf>,
    /// Greatest size of the page, such as 20M: larger data become kernels or splats of what is drawn, merged until they fit;
    /// what pictures lose is printed
    #[arg(id = "bytes", long = "size", value_name = "BYTES", value_parser = parse::bytes)]
    pub(super) bytes: Option<u64>,
    /// Make kernels or splats of what is drawn, and merge them while 99.9 % of the pixels of five pictures differ by less from those of
    /// the data (0 to 1)
    #[arg(long, value_name = "E", value_parser = parse::share, allow_hyphen_values = true)]
    pub(super) error: Option<f64>,
    /// Print the summary as JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// Arguments: those of the page, and those of `render` for what it shows.
pub(in crate::command) struct Arguments {
    pub(super) own: PageOptions,
    pub(super) render: render::Arguments,
    /// Identifiers and long names of the options of `render` that were given.
    given: Vec<(String, String)>,
}

impl FromArgMatches for Arguments {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let of_render = ids::<render::Arguments>();
        let options = Self::augment_args(Command::new("export"));
        let options = options
            .get_arguments()
            .filter(|own| of_render.iter().any(|id| own.get_id() == id));
        let given = options.filter_map(|option| {
            let id = option.get_id().as_str();
            let is_given = matches.value_source(id) == Some(ValueSource::CommandLine);
            let long = option.get_long().unwrap_or(id);
            is_given.then(|| (id.to_owned(), long.to_owned()))
        });
        Ok(Self {
            own: PageOptions::from_arg_matches(matches)?,
            given: given.collect(),
            render: render::Arguments::from_arg_matches(matches)?,
        })
    }

    fn update_from_arg_matches(
        &mut self,
        matches: &ArgMatches,
    ) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for Arguments {
    fn augment_args(command: Command) -> Command {
        let command = render::Arguments::augment_args(PageOptions::augment_args(command));
        let of_data = ids::<DataOptions>();
        let shown = |id: &str| {
            is_of_all(id) || OF_DATA.contains(&id) || of_data.iter().any(|own| own == id)
        };
        let hidden = ids::<render::Arguments>()
            .into_iter()
            .filter(|id| !shown(id));
        hidden
            .fold(command, |command, id| {
                command.mut_arg(id, |option| option.hide(true))
            })
            .mut_arg("inputs", |inputs| {
                inputs.help("File to show; with --size or --error, files to show together")
            })
            .mut_arg("out", |out| out.help("Page to write: html"))
            // The page is as large as its window; --size is that of the file.
            .mut_arg("size", |size| size.long("picture-size"))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// Returns the identifiers of options.
fn ids<T: Args>() -> Vec<String> {
    let options = T::augment_args(Command::new("export"));
    let ids = options
        .get_arguments()
        .map(|option| option.get_id().to_string());
    ids.collect()
}

/// Returns true for options that apply whatever the page shows.
fn is_of_all(id: &str) -> bool {
    OF_ALL.contains(&id) || ids::<CameraOptions>().iter().any(|own| own == id)
}

impl Arguments {
    /// Returns true if an option of `render` was given.
    pub(super) fn is_given(&self, id: &str) -> bool {
        self.given.iter().any(|(own, _)| own == id)
    }

    /// Returns true if an option says from where to look.
    pub(super) fn has_camera(&self) -> bool {
        let of_camera = ids::<CameraOptions>();
        self.given.iter().any(|(own, _)| of_camera.contains(own))
    }

    /// Checks that the page can show the data as they are.
    ///
    /// # Errors
    /// Several inputs; options that the page does not have.
    pub(super) fn as_they_are(&self) -> Result<()> {
        let fault = |option: String, expected: &str, found: &str| {
            let advice =
                "leave it out, or add --size or --error, which make kernels of what is drawn";
            Err(Error::invalid(option, "use", expected, found, advice))
        };
        if self.render.inputs.len() > 1 {
            return fault(
                "INPUT".into(),
                "one file, with those that it names",
                "several",
            );
        }
        match self
            .given
            .iter()
            .find(|(id, _)| !is_of_all(id) && !OF_DATA.contains(&id.as_str()))
        {
            None => Ok(()),
            Some((_, long)) => fault(
                format!("--{long}"),
                "what the page has a setting for",
                "another option",
            ),
        }
    }

    /// Checks that splats can show what is drawn.
    ///
    /// # Errors
    /// Options that have no effect on splats, or that they do not keep.
    pub(super) fn as_splats(&self) -> Result<()> {
        let of_data = ids::<DataOptions>();
        let keeps = |id: &str| {
            is_of_all(id) || OF_SPLATS.contains(&id) || of_data.iter().any(|own| own == id)
        };
        match self.given.iter().find(|(id, _)| !keeps(id)) {
            None => Ok(()),
            Some((_, long)) => {
                let expected = "what kernels keep, which --size and --error make of data";
                let advice = "leave it out, or both of them";
                Err(Error::invalid(
                    format!("--{long}"),
                    "use",
                    expected,
                    "another option",
                    advice,
                ))
            }
        }
    }
}
