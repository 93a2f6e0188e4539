//! Detects changes of the files that are shown.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, SystemTime};

use egui::Context;

/// Pause between two checks of the files. (File-system events would come sooner, but not for remote
/// changes.)
const PAUSE: Duration = Duration::from_secs(1);

/// State of a file: modification time and length; `None` for an absent file.
type Stamp = Option<(SystemTime, u64)>;

fn stamp(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

/// Files, and their states when they were read.
#[derive(Debug, Default)]
struct Files {
    paths: Vec<PathBuf>,
    known: Vec<Stamp>,
    /// States at the last check, if they differ from `known`.
    seen: Option<Vec<Stamp>>,
    has_changed: bool,
}

impl Files {
    /// Compares the states of the files. Returns true if they have changed and have been stable
    /// since the last check. While a file is absent, it returns false.
    fn look(&mut self, now: Vec<Stamp>) -> bool {
        if now == self.known || now.contains(&None) {
            self.seen = None;
            return false;
        }
        if self.seen.as_ref() != Some(&now) {
            self.seen = Some(now);
            return false;
        }
        self.seen = None;
        self.known = now;
        self.has_changed = true;
        true
    }
}

/// Thread that checks files every second, so that the window sleeps while they do not change.
#[derive(Debug, Default)]
pub(crate) struct Watch(Arc<Mutex<Files>>);

fn lock(files: &Mutex<Files>) -> MutexGuard<'_, Files> {
    files.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Starts checking, until the window is closed.
    pub(crate) fn start(&self, context: Context) {
        let files = Arc::downgrade(&self.0);
        std::thread::spawn(move || watch(&files, &context));
    }

    /// Sets the files, which are about to be read.
    pub(crate) fn set(&self, paths: Vec<PathBuf>) {
        let known = paths.iter().map(|path| stamp(path)).collect();
        *lock(&self.0) = Files {
            paths,
            known,
            ..Files::default()
        };
    }

    /// Returns true if the files have changed since the last call.
    pub(crate) fn has_changed(&self) -> bool {
        std::mem::take(&mut lock(&self.0).has_changed)
    }
}

fn watch(files: &Weak<Mutex<Files>>, context: &Context) {
    loop {
        std::thread::sleep(PAUSE);
        let Some(files) = files.upgrade() else {
            return;
        };
        let paths = lock(&files).paths.clone();
        let now: Vec<Stamp> = paths.iter().map(|path| stamp(path)).collect();
        let mut files = lock(&files);
        if files.paths == paths && files.look(now) {
            context.request_repaint();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64, length: u64) -> Stamp {
        Some((
            SystemTime::UNIX_EPOCH + Duration::from_secs(seconds),
            length,
        ))
    }

    #[test]
    fn files_have_changed_once_they_no_longer_change() {
        let mut files = Files {
            known: vec![at(1, 10), at(1, 20)],
            ..Files::default()
        };
        assert!(!files.look(vec![at(1, 10), at(1, 20)]));
        // The file is being written.
        assert!(!files.look(vec![at(5, 3), at(1, 20)]));
        assert!(!files.look(vec![at(6, 8), at(1, 20)]));
        assert!(files.look(vec![at(6, 8), at(1, 20)]));
        assert!(files.has_changed);
        assert!(!files.look(vec![at(6, 8), at(1, 20)]));
        // A file that is being replaced is absent for a moment.
        assert!(!files.look(vec![None, at(1, 20)]));
        assert!(!files.look(vec![None, at(1, 20)]));
        assert!(!files.look(vec![at(9, 8), at(1, 20)]));
        assert!(files.look(vec![at(9, 8), at(1, 20)]));
    }

    #[test]
    fn stamps_are_of_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        assert_eq!(stamp(&path), None);
        std::fs::write(&path, "four").unwrap();
        assert_eq!(stamp(&path).unwrap().1, 4);
    }
}
