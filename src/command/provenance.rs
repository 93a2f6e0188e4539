//! Records how a picture was made: the command, the program's version, its inputs and their hashes.
//!
//! Names of files stand without their folders, so that a picture tells nothing of where they lie or whose they are.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::opened;

/// Version of the record's format.
pub(crate) const FORMAT: u64 = 1;

/// Greatest length of a file that is hashed whole, bytes. Of longer ones the two ends are: mapped scenes may be far larger
/// than what a picture reads of them.
const MOST_WHOLE: u64 = 2 << 30;

/// Length of each end that is hashed, bytes.
const END: u64 = 64 << 20;

/// Bytes that are hashed for one record. Further files are not.
const MOST_IN_ALL: u64 = 4 << 30;

/// Greatest number of files that are hashed.
pub(crate) const MOST_FILES: usize = 1000;

/// Returns a file's name without its folders; that of the folder for `.` and `..`.
pub(crate) fn name_of(path: &Path) -> String {
    let own = path.file_name().map(OsStr::to_owned);
    let name = own.or_else(|| Some(path.canonicalize().ok()?.file_name()?.to_owned()));
    name.map_or_else(|| ".".into(), |name| name.to_string_lossy().into_owned())
}

/// Length and hash of a file, or the reason why it has none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Hashed {
    Whole {
        bytes: u64,
        sha256: String,
    },
    /// Hash of the first and the last 64 MiB, one after the other.
    Ends {
        bytes: u64,
        sha256: String,
    },
    Not(String),
}

impl Hashed {
    /// Hashes a file.
    pub(crate) fn of(path: &Path) -> Self {
        let read = || -> io::Result<Self> {
            // A pipe would wait for ever.
            let meta = std::fs::metadata(path)?;
            if meta.is_dir() {
                return Ok(Self::Not("a folder".into()));
            }
            if !meta.is_file() {
                return Ok(Self::Not("no regular file".into()));
            }
            let bytes = meta.len();
            let mut file = File::open(path)?;
            let mut hasher = Sha256::new();
            if bytes <= MOST_WHOLE {
                add(&mut hasher, &mut file, bytes)?;
                let sha256 = hex(hasher);
                return Ok(Self::Whole { bytes, sha256 });
            }
            add(&mut hasher, &mut file, END)?;
            file.seek(SeekFrom::Start(bytes - END))?;
            add(&mut hasher, &mut file, END)?;
            let sha256 = hex(hasher);
            Ok(Self::Ends { bytes, sha256 })
        };
        read().unwrap_or_else(|error| Self::Not(format!("not read again: {error}")))
    }

    /// Returns the entry of a record.
    fn entry(&self, file: &str) -> Value {
        match self {
            Self::Whole { bytes, sha256 } => {
                json!({ "file": file, "bytes": bytes, "sha256": sha256 })
            }
            Self::Ends { bytes, sha256 } => {
                json!({ "file": file, "bytes": bytes, "sha256_of_ends": sha256 })
            }
            Self::Not(reason) => json!({ "file": file, "not_hashed": reason }),
        }
    }

    /// Reads an entry of a record; `None` if it is damaged.
    pub(crate) fn of_entry(entry: &Value) -> Option<Self> {
        let text = |key: &str| entry[key].as_str().map(str::to_owned);
        if let Some(reason) = text("not_hashed") {
            return Some(Self::Not(reason));
        }
        let bytes = entry["bytes"].as_u64()?;
        match (text("sha256"), text("sha256_of_ends")) {
            (Some(sha256), _) => Some(Self::Whole { bytes, sha256 }),
            (None, Some(sha256)) => Some(Self::Ends { bytes, sha256 }),
            (None, None) => None,
        }
    }
}

fn add(hasher: &mut Sha256, file: &mut File, bytes: u64) -> io::Result<()> {
    let mut rest = file.take(bytes);
    let mut piece = vec![0; 1 << 20];
    loop {
        match rest.read(&mut piece)? {
            0 => return Ok(()),
            count => hasher.update(&piece[..count]),
        }
    }
}

fn hex(hasher: Sha256) -> String {
    hash_text(&hasher.finalize())
}

fn hash_text(hash: &[u8]) -> String {
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the SHA-256 of bytes.
pub(crate) fn hash_of(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

/// Hashes of files by path.
type Known = Arc<Mutex<BTreeMap<PathBuf, Hashed>>>;

/// Returns the bytes that were read for hashes.
fn spent(known: &BTreeMap<PathBuf, Hashed>) -> u64 {
    let bytes = known.values().map(|hash| match hash {
        Hashed::Whole { bytes, .. } => *bytes,
        Hashed::Ends { .. } => 2 * END,
        Hashed::Not(_) => 0,
    });
    bytes.sum()
}

/// Hashes of the files that a command reads. A thread of its own hashes while the picture is drawn.
#[derive(Debug, Default)]
pub(crate) struct Hashes {
    known: Known,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Hashes {
    /// Begins to hash the files that were opened so far.
    pub(crate) fn begin(&self) {
        let known = Arc::clone(&self.known);
        let hash = move || {
            for path in opened::files().into_iter().take(MOST_FILES) {
                let _ = recorded(&known, &path);
            }
        };
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if thread.is_none() {
            *thread = std::thread::Builder::new().spawn(hash).ok();
        }
    }

    /// Returns the entries of a record: the files that the command names, in its order, and then those that were read
    /// beside them, in the order of their names.
    pub(crate) fn entries(&self, given: &[PathBuf]) -> Vec<Value> {
        let thread = self
            .thread
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        // A thread that failed leaves the rest to this one.
        let _ = thread.map(JoinHandle::join);
        let real = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.into());
        let is_given: BTreeSet<PathBuf> = given.iter().map(|path| real(path)).collect();
        let mut beside: Vec<PathBuf> = opened::files();
        beside.retain(|path| !is_given.contains(&real(path)));
        beside.sort_by_cached_key(|path| (name_of(path), path.clone()));
        let left_out = (given.len() + beside.len()).saturating_sub(MOST_FILES);
        let mut entries: Vec<Value> = (given.iter().chain(&beside))
            .take(MOST_FILES)
            .map(|path| recorded(&self.known, path).entry(&name_of(path)))
            .collect();
        if left_out > 0 {
            let reason = format!("more than {MOST_FILES} files");
            entries.push(json!({ "files": left_out, "not_hashed": reason }));
        }
        entries
    }

    /// Returns the hash of a file.
    pub(crate) fn of(&self, path: &Path) -> Hashed {
        hashed(&self.known, path)
    }
}

/// Returns the hash of a file for a record: none once the files before it were long enough.
fn recorded(known: &Known, path: &Path) -> Hashed {
    let is_full = {
        let known = known.lock().unwrap_or_else(PoisonError::into_inner);
        !known.contains_key(path) && spent(&known) >= MOST_IN_ALL
    };
    match is_full {
        true => Hashed::Not(format!("more than {} GiB in all", MOST_IN_ALL >> 30)),
        false => hashed(known, path),
    }
}

/// Returns the hash of a file, which is read if it is not known.
fn hashed(known: &Known, path: &Path) -> Hashed {
    let lock = || known.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(hash) = lock().get(path) {
        return hash.clone();
    }
    let hash = Hashed::of(path);
    lock().insert(path.into(), hash.clone());
    hash
}

/// Returns JSON on one line in ASCII, which any header holds.
pub(crate) fn ascii(record: &Value) -> String {
    let mut text = String::new();
    for c in record.to_string().chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            let mut units = [0; 2];
            for unit in c.encode_utf16(&mut units) {
                text += &format!("\\u{unit:04x}");
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_sha_256() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(
            hash_text(&hash_of(b"abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"abc").unwrap();
        let hash = Hashed::of(&path);
        let Hashed::Whole { bytes: 3, sha256 } = &hash else {
            panic!("{hash:?}")
        };
        assert_eq!(*sha256, hash_text(&hash_of(b"abc")));
        assert_eq!(Hashed::of_entry(&hash.entry("a")), Some(hash));
        let folder = Hashed::of(folder.path());
        assert_eq!(folder, Hashed::Not("a folder".into()));
        assert_eq!(Hashed::of_entry(&folder.entry("a")), Some(folder));
        assert_eq!(Hashed::of_entry(&json!({ "file": "a" })), None);
    }

    #[test]
    #[cfg(unix)]
    fn of_long_files_the_ends_are_hashed() {
        use std::os::unix::fs::FileExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        // Holes take no room on the disk.
        let file = File::create(&path).unwrap();
        file.set_len(MOST_WHOLE + 1).unwrap();
        let ends = |at: u64| {
            file.write_at(b"x", at).unwrap();
            let hash = Hashed::of(&path);
            let Hashed::Ends { bytes, sha256 } = hash else {
                panic!("{hash:?}")
            };
            assert_eq!(bytes, MOST_WHOLE + 1);
            sha256
        };
        let first = ends(END);
        // What lies between is not looked at.
        assert_eq!(ends(END + 7), first);
        assert_ne!(ends(END - 1), first);
        let mut hasher = Sha256::new();
        let mut start = vec![0; usize::try_from(END).unwrap()];
        let zeros = start.clone();
        *start.last_mut().unwrap() = b'x';
        hasher.update(&start);
        hasher.update(&zeros);
        assert_eq!(ends(END + 9), hex(hasher));
    }

    #[test]
    fn records_are_ascii() {
        let record = json!({ "title": "ä 𝄞 \"q\"" });
        let text = ascii(&record);
        assert!(text.is_ascii(), "{text}");
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), record);
    }
}
