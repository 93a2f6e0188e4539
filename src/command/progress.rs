//! What is said on standard error while the program works and beside its results: bars for long work,
//! hidden where it is no terminal, and notes. None of it with `--quiet`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::{Progress, Task};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// One for the whole program, as standard error is.
static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// From now on nothing is said but errors.
pub(crate) fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// One for the whole program: whether another process says what is to be said.
static IS_SILENT: AtomicBool = AtomicBool::new(false);

/// From now on nothing is said at all: another process speaks for this one.
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

/// Prints a line on standard error, unless the program is to be quiet.
macro_rules! note {
    ($($part:tt)*) => {
        if !$crate::command::progress::is_quiet() {
            eprintln!($($part)*);
        }
    };
}
pub(crate) use note;

/// Where bars are drawn.
fn target() -> ProgressDrawTarget {
    if is_quiet() {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    }
}

/// A bar without an end, which turns.
pub(crate) fn spinner() -> ProgressBar {
    let spinner =
        ProgressBar::with_draw_target(None, target()).with_style(ProgressStyle::default_spinner());
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

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
    let bar = ProgressBar::with_draw_target(Some(steps), target());
    match ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
