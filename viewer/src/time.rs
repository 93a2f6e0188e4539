//! Selects the step of a series.

/// Steps of a series, and the current one.
#[derive(Debug, Clone, Default)]
pub(crate) struct Time {
    /// Time of each step, if a file states it; empty without a series.
    pub(crate) steps: Vec<Option<f64>>,
    pub(crate) step: usize,
    pub(crate) plays: bool,
    /// True if the step being read is another of the same series.
    is_next: bool,
}

impl Time {
    pub(crate) fn of(steps: Vec<Option<f64>>) -> Self {
        Self {
            steps,
            ..Self::default()
        }
    }

    /// Returns the number of steps; 0 without a series.
    pub(crate) fn count(&self) -> usize {
        self.steps.len()
    }

    pub(crate) fn go(&mut self, step: usize) {
        self.step = step;
        self.is_next = true;
    }

    /// Returns true if the step that was read keeps the transfer functions of the last one.
    pub(crate) fn keeps(&mut self) -> bool {
        std::mem::take(&mut self.is_next)
    }
}
