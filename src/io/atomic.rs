//! Outputs that are whole or absent.

use std::fs;
use std::io::Write;
use std::path::Path;

use crate::error::{Error, Result};

/// Writes a file so that nothing half-written is ever seen under its name: into a temporary
/// file in the same folder, which is then renamed.
///
/// The file gets the permissions that newly created files usually get. A link is followed;
/// what is no regular file (a pipe, `/dev/null`) is written to directly.
///
/// # Errors
/// The folder is missing, or the system refuses.
pub fn write_bytes_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
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
        Ok(meta) if !meta.is_file() => return fs::write(path, bytes).map_err(failed),
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
    let mut builder = tempfile::Builder::new();
    builder.prefix(".ewa-splat-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's umask is applied to this.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(failed)?;
    file.write_all(bytes).map_err(failed)?;
    file.persist(&target).map_err(|e| failed(e.error))?;
    Ok(())
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
