//! Which step of a series is shown.

/// The steps of a series, and which is shown.
#[derive(Debug, Clone, Default)]
pub(crate) struct Time {
    /// The time of each step, where a file states it; empty without a series.
    pub(crate) steps: Vec<Option<f64>>,
    pub(crate) step: usize,
    pub(crate) plays: bool,
    /// Whether the step that is read is another of the same series.
    is_next: bool,
}

impl Time {
    pub(crate) fn of(steps: Vec<Option<f64>>) -> Self {
        Self {
            steps,
            ..Self::default()
        }
    }

    /// How many steps there are; 0 without a series.
    pub(crate) fn count(&self) -> usize {
        self.steps.len()
    }

    pub(crate) fn go(&mut self, step: usize) {
        self.step = step;
        self.is_next = true;
    }

    /// Whether the functions of the last step hold for the one that was read.
    pub(crate) fn keeps(&mut self) -> bool {
        std::mem::take(&mut self.is_next)
    }
}
