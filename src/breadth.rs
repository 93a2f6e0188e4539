//! Breadth of unit tests.

/// Returns the cases of a test: all with `EWA_ALL=1`, otherwise the first `few`. The others check the same law.
pub(crate) fn some<T>(mut all: Vec<T>, few: usize) -> Vec<T> {
    if std::env::var_os("EWA_ALL").is_none_or(|v| v != "1") {
        all.truncate(few);
    }
    all
}
