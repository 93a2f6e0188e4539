//! Stores choices from one session to the next. (eframe stores the window's position and which
//! panels are open.)

use ewa_splat::command::Over;
use serde::{Deserialize, Serialize};

use crate::app::App;
use crate::orbit::Orbit;
use crate::output::Output;

/// Key of the choices in eframe's storage.
const KEY: &str = "choices";

/// Choices of the last session, and the saved views of its data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Remembered {
    output: Output,
    logarithmic_counts: bool,
    follows: bool,
    shows_panels: bool,
    legend: bool,
    axes: bool,
    outline: bool,
    /// Inputs that the views belong to.
    inputs: Vec<String>,
    views: Vec<Orbit>,
}

impl Default for Remembered {
    fn default() -> Self {
        Self {
            output: Output::default(),
            logarithmic_counts: true,
            follows: true,
            shows_panels: true,
            legend: true,
            axes: true,
            outline: false,
            inputs: Vec::new(),
            views: Vec::new(),
        }
    }
}

impl App {
    fn remembered(&self) -> Remembered {
        Remembered {
            output: self.output.clone(),
            logarithmic_counts: self.logarithmic_counts,
            follows: self.follows,
            shows_panels: self.shows_panels,
            legend: self.over.legend,
            axes: self.over.axes,
            outline: self.over.outline,
            inputs: self.inputs.clone(),
            views: self.saved.clone(),
        }
    }

    /// Restores the choices of the last session. Views are restored only for the same data.
    fn recall(&mut self, remembered: Remembered) {
        self.output = remembered.output;
        self.logarithmic_counts = remembered.logarithmic_counts;
        self.follows = remembered.follows;
        self.shows_panels = remembered.shows_panels;
        // Options on the command line take precedence over remembered choices.
        let asked = self.request.over();
        self.over = Over {
            legend: asked.legend || remembered.legend,
            axes: asked.axes || remembered.axes,
            outline: asked.outline || remembered.outline,
        };
        if remembered.inputs == self.inputs {
            let views = remembered.views.into_iter();
            self.saved = views.filter(Orbit::is_a_view).collect();
        }
    }

    /// Restores from storage. If the storage cannot be read, it keeps the defaults and shows a
    /// message.
    pub(crate) fn recall_from(&mut self, storage: Option<&dyn eframe::Storage>) {
        let Some(text) = storage.and_then(|storage| storage.get_string(KEY)) else {
            return;
        };
        match serde_json::from_str(&text) {
            Ok(remembered) => self.recall(remembered),
            Err(error) => self.say(format!("the last choices are left out: {error}")),
        }
    }

    pub(crate) fn keep_in(&self, storage: &mut dyn eframe::Storage) {
        if let Ok(text) = serde_json::to_string(&self.remembered()) {
            storage.set_string(KEY, text);
        }
    }
}
