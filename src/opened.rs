//! Notes the files that readers open, for records of how pictures were made.
//!
//! The note is one of the process, because readers open files on many threads and on the word of other files. Nothing is
//! noted before [`start`].

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Files that were opened; `None` if none are noted.
static OPENED: Mutex<Option<BTreeSet<PathBuf>>> = Mutex::new(None);

fn opened() -> MutexGuard<'static, Option<BTreeSet<PathBuf>>> {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Forgets the files that were noted, and notes all that are opened from now on.
#[cfg(feature = "cli")]
pub(crate) fn start() {
    *opened() = Some(BTreeSet::new());
}

/// Notes a file that is opened for its data.
pub(crate) fn note(path: &Path) {
    if let Some(files) = &mut *opened()
        && !files.contains(path)
    {
        files.insert(path.into());
    }
}

/// Returns the files that were opened since [`start`], in the order of their paths.
#[cfg(feature = "cli")]
pub(crate) fn files() -> Vec<PathBuf> {
    opened().iter().flatten().cloned().collect()
}
