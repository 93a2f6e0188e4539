//! Bars for long work, hidden where standard error is no terminal.

use ewa_splat::{Progress, Task};
use indicatif::{ProgressBar, ProgressStyle};

/// Runs `work` with a bar that follows its task.
pub(crate) fn with_bar<T>(message: &'static str, work: impl FnOnce(Task) -> T) -> T {
    const STEPS: u64 = 1000;
    let bar = bar(STEPS).with_message(message);
    let shown = bar.clone();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a fraction of a thousand"
    )]
    let result = work(Task::observed(move |progress| {
        shown.set_position((progress.done * STEPS as f64) as u64);
    }));
    bar.finish_and_clear();
    result
}

/// A task whose stages are the messages of a bar; none where nobody sees it.
pub(crate) fn task_of(bar: &ProgressBar) -> Option<Task> {
    let shown = bar.clone();
    let tell = move |progress: Progress| shown.set_message(progress.to_string());
    (!bar.is_hidden()).then(|| Task::observed(tell))
}

/// A bar of so many steps.
pub(crate) fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    match ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
