//! Whether the files that are shown have changed.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, SystemTime};

use egui::Context;

/// Between two looks at the files. (Events of a file system would come sooner, and not from other machines.)
const PAUSE: Duration = Duration::from_secs(1);

/// How a file is: when it was written, and its length; nothing of one that is not there.
type Stamp = Option<(SystemTime, u64)>;

fn stamp(path: &Path) -> Stamp {
    let told = std::fs::metadata(path).ok()?;
    Some((told.modified().ok()?, told.len()))
}

/// Files, and how they were when they were read.
#[derive(Debug, Default)]
struct Files {
    paths: Vec<PathBuf>,
    known: Vec<Stamp>,
    /// How they were at the last look, where that is otherwise.
    seen: Option<Vec<Stamp>>,
    has_changed: bool,
}

impl Files {
    /// Looks at them once more: whether they have changed, and no longer do. What is missing is not read.
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

/// A thread that looks at files every second, so that the window sleeps while they stay.
#[derive(Debug, Default)]
pub(crate) struct Watch(Arc<Mutex<Files>>);

fn lock(files: &Mutex<Files>) -> MutexGuard<'_, Files> {
    files.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Begins to look, until the window is closed.
    pub(crate) fn start(&self, context: Context) {
        let files = Arc::downgrade(&self.0);
        std::thread::spawn(move || watch(&files, &context));
    }

    /// Other files, which are about to be read.
    pub(crate) fn set(&self, paths: Vec<PathBuf>) {
        let known = paths.iter().map(|path| stamp(path)).collect();
        *lock(&self.0) = Files {
            paths,
            known,
            ..Files::default()
        };
    }

    /// Whether they have changed since this was last asked.
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
        // It is being written.
        assert!(!files.look(vec![at(5, 3), at(1, 20)]));
        assert!(!files.look(vec![at(6, 8), at(1, 20)]));
        assert!(files.look(vec![at(6, 8), at(1, 20)]));
        assert!(files.has_changed);
        assert!(!files.look(vec![at(6, 8), at(1, 20)]));
        // One that is replaced is away for a moment.
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
