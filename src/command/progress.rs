//! Prints progress bars and notes on standard error while the program works.
//!
//! Bars are hidden if standard error is no terminal. `--quiet` suppresses both.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::words;
use crate::load::Event;
use crate::{Progress, Task};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Flag of `--quiet`, global as standard error is.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Suppresses everything but errors from now on.
pub(crate) fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// Flag of silence, global: another process prints all messages.
static IS_SILENT: AtomicBool = AtomicBool::new(false);

/// Suppresses everything, errors too, from now on: another process prints for this one.
#[cfg(feature = "mpi")]
pub(crate) fn be_silent() {
    IS_SILENT.store(true, Ordering::Relaxed);
    be_quiet();
}

pub(crate) fn is_silent() -> bool {
    IS_SILENT.load(Ordering::Relaxed)
}

pub(crate) fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Prints a line on standard error, unless `--quiet` suppresses it.
macro_rules! note {
    ($($part:tt)*) => {
        if !$crate::command::progress::is_quiet() {
            eprintln!($($part)*);
        }
    };
}
pub(crate) use note;

/// Returns the target on which bars are drawn.
fn target() -> ProgressDrawTarget {
    if is_quiet() {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    }
}

/// Returns a spinner: a bar without a known length.
pub(crate) fn spinner() -> ProgressBar {
    let spinner =
        ProgressBar::with_draw_target(None, target()).with_style(ProgressStyle::default_spinner());
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

/// Runs `work` with a bar that shows its task's progress.
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

/// Returns a task that shows its stages as messages of a bar; `None` if the bar is hidden.
pub(crate) fn task_of(bar: &ProgressBar) -> Option<Task> {
    let shown = bar.clone();
    let tell = move |progress: Progress| shown.set_message(progress.to_string());
    (!bar.is_hidden()).then(|| Task::observed(tell))
}

/// Prints a note of reading.
pub(crate) fn print(event: Event<'_>) {
    if let Event::Note(text) = event {
        note!("{}", words::note(&text));
    }
}

/// Returns a function that prints the notes of reading above a bar, and shows the file that is read
/// as its message.
pub(crate) fn observer_of(bar: &ProgressBar) -> impl Fn(Event<'_>) {
    move |event| match event {
        Event::Reading(path) => bar.set_message(format!("reading {}", path.display())),
        note => bar.suspend(|| print(note)),
    }
}

/// Returns a bar with the given number of steps.
pub(crate) fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(steps), target());
    match ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
