//! Bars for long work, hidden where standard error is no terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Runs `work` with a bar that follows the fractions it reports.
pub(crate) fn with_bar<T>(
    message: &'static str,
    work: impl FnOnce(&(dyn Fn(f64) + Sync)) -> T,
) -> T {
    const STEPS: u64 = 1000;
    let bar = bar(STEPS).with_message(message);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a fraction of a thousand"
    )]
    let result = work(&|fraction| bar.set_position((fraction * STEPS as f64) as u64));
    bar.finish_and_clear();
    result
}

/// A bar of so many steps.
pub(crate) fn bar(steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(steps);
    match ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
