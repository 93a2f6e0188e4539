//! Writes files atomically: they are complete or absent.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, Result};

/// Writes a file through a temporary file in the same folder, which is renamed when it is complete. A half-written file
/// never appears under the name.
///
/// The file gets the usual permissions of new files. A link is followed. A path that is no regular file (a pipe,
/// `/dev/null`) is written to directly.
///
/// # Errors
/// The folder is missing, or the system refuses.
pub fn write_bytes_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |file| file.write_all(bytes))
}

/// Writes a file part by part, atomically as [`write_bytes_atomically`] does.
///
/// - `write`: writes into an empty file.
pub(crate) fn write_atomically<T>(
    path: &Path,
    write: impl FnOnce(&mut File) -> io::Result<T>,
) -> Result<T> {
    let failed = |e| {
        Error::io(
            path,
            "writing",
            e,
            "check the folder, its permissions and the disk",
        )
    };
    match fs::metadata(path) {
        Ok(meta) if meta.is_dir() => {
            return Err(Error::format(
                path,
                "writing",
                "a file name",
                "a directory",
                "name a file in it",
            ));
        }
        Ok(meta) if !meta.is_file() => {
            let opened = File::options().write(true).open(path);
            return opened.and_then(|mut file| write(&mut file)).map_err(failed);
        }
        _ => {}
    }
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(Error::format(
            path,
            "writing",
            "an existing folder",
            format!("no folder {}", folder.display()),
            "create the folder first",
        ));
    }
    let (mut file, temporary) = Temporary::create(folder).map_err(failed)?;
    let written = write(&mut file).map_err(failed)?;
    // Some systems do not rename an open file.
    drop(file);
    fs::rename(&temporary.path, &target).map_err(failed)?;
    Ok(written)
}

/// Temporary file, removed on drop unless it has been renamed.
struct Temporary {
    path: PathBuf,
}

impl Temporary {
    /// Greatest number of names to try. Files that another process left behind may occupy some.
    const MOST_NAMES: usize = 1000;

    /// Creates a file that did not exist, with the permissions of any new file.
    fn create(folder: &Path) -> io::Result<(File, Self)> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let mut names = 0;
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let path = folder.join(format!(".ewa-splat-{}-{number}.tmp", std::process::id()));
            names += 1;
            match File::create_new(&path) {
                Err(e) if e.kind() == ErrorKind::AlreadyExists && names < Self::MOST_NAMES => {}
                created => return Ok((created?, Self { path })),
            }
        }
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // After a rename this name does not exist; any other error could not be reported here.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_written_or_replaced_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        for text in ["first", "second"] {
            write_bytes_atomically(&path, text.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_any_new_file() {
        let folder = tempfile::tempdir().unwrap();
        let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
        write_bytes_atomically(&ours, b"x").unwrap();
        fs::write(&plain, b"x").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn names_that_are_taken_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (_, first) = Temporary::create(folder.path()).unwrap();
        let name = first.path.file_name().unwrap().to_str().unwrap().to_owned();
        let digits = name.trim_end_matches(".tmp").rsplit('-').next().unwrap();
        let number: u64 = digits.parse().unwrap();
        let prefix = name.strip_suffix(&format!("{digits}.tmp")).unwrap();
        // Files of an earlier process with the same number occupy the next names.
        for next in number + 1..number + 40 {
            let left = folder.path().join(format!("{prefix}{next}.tmp"));
            fs::write(left, b"other").unwrap();
        }
        let path = first.path.clone();
        assert!(path.is_file());
        drop(first);
        assert!(!path.exists());
        write_bytes_atomically(&folder.path().join("a.json"), b"x").unwrap();
        let mut others = 0;
        for entry in fs::read_dir(folder.path()).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().unwrap() == "tmp" {
                assert_eq!(fs::read(path).unwrap(), b"other");
                others += 1;
            }
        }
        assert_eq!(others, 39);
    }

    #[test]
    fn a_missing_folder_and_a_directory_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        for path in [
            folder.path().join("none/a.png"),
            folder.path().to_path_buf(),
        ] {
            let err = write_bytes_atomically(&path, b"x").unwrap_err();
            assert!(matches!(err, Error::Format { .. }), "{err}");
        }
    }
}
