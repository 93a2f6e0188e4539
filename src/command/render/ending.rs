//! Ends a picture: writes it with the record of how it was made, or compares it with one that was written before.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::options::Arguments;
use super::tiles::Comparison;
use crate::command::provenance::{FORMAT, Hashes, ascii};
use crate::command::typed::Typed;
use crate::image::{ColumnImage, Image};
use crate::io::{carries_record, shown_count, write_column_with, write_image_with};
use crate::render::SimdLevel;
use crate::view::Camera;
use crate::{Renderer, Result, Settings, Show};

/// What becomes of a picture.
#[derive(Default)]
pub(in crate::command) enum Ending {
    /// It is written without a record.
    #[default]
    Bare,
    /// It is written with a record.
    Recorded(Box<Recorded>),
    /// It is compared.
    Compared(Box<Comparison>),
}

/// Facts of a command that records state.
pub(in crate::command) struct Recorded {
    words: Vec<String>,
    given: Vec<PathBuf>,
    hashes: Hashes,
    /// True under `--mpi`: other ranks read files that this one does not know.
    is_shared: bool,
}

impl Ending {
    /// Returns the ending of a command that was typed.
    pub(in crate::command) fn recorded(typed: Typed, is_shared: bool) -> Self {
        Self::Recorded(Box::new(Recorded {
            words: typed.words,
            given: typed.files,
            hashes: Hashes::default(),
            is_shared,
        }))
    }

    /// Returns the comparison in place of which nothing is written.
    pub(in crate::command) fn comparison(&self) -> Option<&Comparison> {
        match self {
            Self::Compared(comparison) => Some(comparison),
            Self::Bare | Self::Recorded(_) => None,
        }
    }

    /// Returns false if nothing may be written.
    pub(super) fn writes(&self) -> bool {
        self.comparison().is_none()
    }
}

/// Facts of a drawn picture.
#[derive(Debug, Clone, Default)]
pub(super) struct Facts {
    /// Error that the picture may have. See [`Settings::tolerance`].
    pub(super) tolerance: f64,
    backend: &'static str,
    adapter: Option<String>,
    /// Error that was measured; null if none was.
    pub(super) measured_error: Value,
}

impl Facts {
    /// Returns the facts of a frame that a renderer has drawn.
    pub(super) fn of(renderer: &Renderer, tolerance: f32) -> Self {
        // The CPU may have taken over.
        let adapter = renderer.adapter().filter(|_| renderer.fallback().is_none());
        Self {
            tolerance: tolerance.into(),
            backend: if adapter.is_some() { "gpu" } else { "cpu" },
            adapter,
            measured_error: Value::Null,
        }
    }

    /// Returns the facts of a reference image.
    pub(super) fn of_reference(tolerance: f64, estimate: f64) -> Self {
        Self {
            tolerance,
            backend: "reference",
            adapter: None,
            measured_error: json!({ "estimate": estimate }),
        }
    }
}

/// The facts of the last picture of a sequence, which its drawing leaves for its ending.
pub(super) type LastFacts = RefCell<Facts>;

/// A drawn picture.
pub(super) enum Drawn<'a> {
    Picture(&'a Image),
    Count(&'a Image),
    Column(&'a ColumnImage),
}

impl Arguments {
    /// Begins to hash the files that were read, while the picture is drawn.
    pub(super) fn begin_record(&self) {
        if let Ending::Recorded(recorded) = &self.ending
            && carries_record(&self.out)
        {
            recorded.hashes.begin();
        }
    }

    /// Returns the record of a picture; `None` if none is wanted, or if the file has no place for one.
    ///
    /// - `frame`: number of the picture in its sequence.
    pub(super) fn record(&self, facts: &Facts, frame: Option<usize>) -> Option<String> {
        let Ending::Recorded(recorded) = &self.ending else {
            return None;
        };
        if !carries_record(&self.out) {
            return None;
        }
        let mut inputs = recorded.hashes.entries(&recorded.given);
        if recorded.is_shared {
            inputs.push(json!({ "not_hashed": "files that other ranks read beside these" }));
        }
        Some(ascii(&json!({
            "format": FORMAT,
            "program": env!("CARGO_PKG_NAME"),
            "version": env!("CARGO_PKG_VERSION"),
            "command": recorded.words,
            "frame": frame,
            "inputs": inputs,
            "tolerance": facts.tolerance,
            "backend": facts.backend,
            "adapter": facts.adapter,
            "simd": format!("{:?}", SimdLevel::best()),
            "measured_error": facts.measured_error,
        })))
    }

    /// Writes or compares the one picture of a command.
    pub(super) fn end(&self, drawn: &Drawn<'_>, facts: &Facts) -> Result<()> {
        if let Some(comparison) = self.ending.comparison() {
            return comparison.compare(drawn, facts.tolerance);
        }
        let record = self.record(facts, None);
        let record = record.as_deref();
        match drawn {
            Drawn::Picture(image) => write_image_with(&self.out, image, record),
            Drawn::Count(count) => {
                write_image_with(&self.out, &shown_count(&self.out, count), record)
            }
            Drawn::Column(column) => write_column_with(&self.out, column, record),
        }
    }

    /// Draws a frame: all of it to be written, or the tiles that are compared.
    pub(super) fn drawn<'a>(
        &self,
        renderer: &'a mut Renderer,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<&'a Image> {
        let Some(comparison) = self.ending.comparison() else {
            return renderer.render(camera, settings);
        };
        comparison.check_size([camera.width, camera.height])?;
        match comparison.tiles() {
            // Colours of counts follow from the greatest of the whole picture.
            Some(tiles) if settings.show != Show::Count => {
                renderer.render_tiles(camera, settings, tiles)
            }
            _ => renderer.render(camera, settings),
        }
    }

    /// Returns the path that a side output is written to, if it is asked for and anything is written.
    pub(super) fn beside<'a>(&self, path: Option<&'a PathBuf>) -> Option<&'a Path> {
        path.filter(|_| self.ending.writes()).map(PathBuf::as_path)
    }
}
