//! Defines what becomes of a picture: it is written with the record of how it was made, or compared with one that was
//! written before.

use std::cell::RefCell;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::tiles::Comparison;
use crate::Renderer;
use crate::command::provenance::{FORMAT, Hashes, ascii};
use crate::command::typed::Typed;
use crate::render::SimdLevel;

/// Use of a picture once it is drawn.
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

impl Recorded {
    /// Begins to hash the files that were read, while the picture is drawn.
    pub(super) fn begin(&self) {
        self.hashes.begin();
    }

    /// Returns the record of a picture.
    ///
    /// - `frame`: number of the picture in its sequence.
    pub(super) fn record(&self, facts: &Facts, frame: Option<usize>) -> String {
        let mut inputs = self.hashes.entries(&self.given);
        if self.is_shared {
            inputs.push(json!({ "not_hashed": "files that other ranks read beside these" }));
        }
        ascii(&json!({
            "format": FORMAT,
            "program": env!("CARGO_PKG_NAME"),
            "version": env!("CARGO_PKG_VERSION"),
            "command": self.words,
            "frame": frame,
            "inputs": inputs,
            "tolerance": facts.tolerance,
            "backend": facts.backend,
            "adapter": facts.adapter,
            "simd": format!("{:?}", SimdLevel::best()),
            "measured_error": facts.measured_error,
        }))
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
