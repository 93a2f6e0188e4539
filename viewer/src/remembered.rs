//! What is remembered from one time to the next. (eframe keeps the window's place and which panels are open.)

use ewa_splat::command::Over;
use serde::{Deserialize, Serialize};

use crate::app::App;
use crate::orbit::Orbit;
use crate::output::Output;

/// The key of it among what eframe keeps.
const KEY: &str = "choices";

/// What was chosen last, and the views of the data that were shown last.
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
    /// What the views are of.
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

    /// Takes what was chosen the last time; views only of the same data.
    fn recall(&mut self, remembered: Remembered) {
        self.output = remembered.output;
        self.logarithmic_counts = remembered.logarithmic_counts;
        self.follows = remembered.follows;
        self.shows_panels = remembered.shows_panels;
        // What is asked for now outweighs what was chosen then.
        let asked = self.asked.over();
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

    /// Takes what is kept. What cannot be read is left out, and that is said.
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
