//! Measures the memory that a process may still allocate, so that oversized data are refused before they are
//! read.

use std::cell::Cell;
use std::fs::read_to_string;
use std::path::Path;

use crate::error::{Error, Place, Result};

thread_local!(static TRIES: Cell<bool> = const { Cell::new(false) });

/// Runs an allocation that may fail: the caller reports the failure.
pub(crate) fn trying<T>(room: impl FnOnce() -> T) -> T {
    let before = TRIES.replace(true);
    let made = room();
    TRIES.set(before);
    made
}

/// Returns true while this thread makes an allocation that may fail. An allocator that ends the program when
/// memory runs out leaves such allocations alone.
#[doc(hidden)]
pub fn is_tried() -> bool {
    TRIES.try_with(Cell::get).unwrap_or(true)
}

/// Returns the memory left, in bytes: the least of what the machine, the process's control groups and its
/// address-space limit leave. The text names the limiting one. Returns `None` if no limit is known.
pub(crate) fn left() -> Option<(u64, &'static str)> {
    let machine = || {
        let text = read_to_string("/proc/meminfo").ok()?;
        Some((kilobytes(&text, "MemAvailable:")?, "the machine leaves"))
    };
    let group = || Some((group_left(Path::new("/"))?, "the control group leaves"));
    let addresses = || {
        let limits = read_to_string("/proc/self/limits").ok()?;
        let line = limits
            .lines()
            .find(|line| line.starts_with("Max address space"))?;
        let limit: u64 = line.split_whitespace().nth(3)?.parse().ok()?;
        let used = kilobytes(&read_to_string("/proc/self/status").ok()?, "VmSize:")?;
        Some((
            limit.saturating_sub(used),
            "the limit of addresses (ulimit -v) leaves",
        ))
    };
    // A module's memory has addresses of 32 bits.
    #[cfg(target_family = "wasm")]
    let module = || {
        let pages = core::arch::wasm32::memory_size::<0>() as u64;
        let left = (1_u64 << 32).saturating_sub(pages << 16);
        Some((left, "the memory of a page leaves"))
    };
    #[cfg(not(target_family = "wasm"))]
    let module = || None;
    let all = [machine(), group(), addresses(), module()];
    all.into_iter().flatten().min_by_key(|(bytes, _)| *bytes)
}

/// Parses the bytes of a line `NAME   123 kB`.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.starts_with(name))?;
    let number: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    number.checked_mul(1024)
}

/// Returns the memory that the process's control groups leave, of version 1 or 2. Their parent groups limit it,
/// too.
///
/// - `root`: root of the file system.
fn group_left(root: &Path) -> Option<u64> {
    let groups = read_to_string(root.join("proc/self/cgroup")).ok()?;
    let of_line = |line: &str| {
        let mut parts = line.splitn(3, ':');
        let (_, controllers, path) = (parts.next()?, parts.next()?, parts.next()?);
        let is_old = controllers.split(',').any(|name| name == "memory");
        let (folder, limit, usage) = match (controllers, is_old) {
            (_, true) => (
                "sys/fs/cgroup/memory",
                "memory.limit_in_bytes",
                "memory.usage_in_bytes",
            ),
            ("", _) => ("sys/fs/cgroup", "memory.max", "memory.current"),
            _ => return None,
        };
        let base = root.join(folder);
        let own = base.join(path.trim_start_matches('/'));
        let number = |at: &Path, name| -> Option<u64> {
            read_to_string(at.join(name)).ok()?.trim().parse().ok()
        };
        let of_group = |at: &Path| {
            // The usage includes the file cache, which can be reclaimed: subtract it.
            let stat = read_to_string(at.join("memory.stat")).unwrap_or_default();
            let cached = stat
                .lines()
                .find_map(|line| line.strip_prefix("inactive_file "));
            let cached: u64 = cached.and_then(|n| n.trim().parse().ok()).unwrap_or(0);
            let used = number(at, usage)?.saturating_sub(cached);
            Some(number(at, limit)?.saturating_sub(used))
        };
        let groups = own.ancestors().take_while(|at| at.starts_with(&base));
        groups.filter_map(of_group).min()
    };
    groups.lines().filter_map(of_line).min()
}

/// Refuses particles that take more memory than there is.
///
/// - `count`: number of particles.
/// - `each`: least memory \[bytes\] of a particle while the scene is made.
pub(crate) fn check(count: usize, each: usize) -> Result<()> {
    let needed = (count as u64).saturating_mul(each as u64);
    match left() {
        Some((left, whose)) if needed > left => Err(Error::invalid(
            "memory",
            format!("{count} particles"),
            format!(
                "{} at the least while they are sorted into blocks",
                gigabytes(needed)
            ),
            format!("{}, which {whose}", gigabytes(left)),
            "take a part of the data (--crop), or prepare the scene (convert --out FILE.arrow; of what is no stream where there \
             is more memory): it is then drawn from the disk",
        )),
        _ => Ok(()),
    }
}

/// Refuses data that exceed the memory, before they are read.
///
/// - `bytes`: size in memory according to the header.
pub(crate) fn check_room(path: &Path, place: impl Into<Place>, bytes: u64) -> Result<()> {
    match no_room(bytes) {
        Some([expected, found]) => Err(Error::format(
            path,
            place,
            expected,
            found,
            "read it where there is more memory, or save a part of it",
        )),
        None => Ok(()),
    }
}

/// Returns the expected and the found size of data that exceed the memory; `None` if the memory suffices.
pub(crate) fn no_room(bytes: u64) -> Option<[String; 2]> {
    /// Least size for which the system is queried: a query reads several files.
    const LEAST: u64 = 1 << 28;
    if bytes < LEAST {
        return None;
    }
    let (left, whose) = left().filter(|(left, _)| bytes > *left)?;
    let expected = format!("numbers that fit into {}, which {whose}", gigabytes(left));
    Some([expected, gigabytes(bytes)])
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.2} GB", bytes as f64 * 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_what_the_narrowest_group_leaves() {
        let root = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write("proc/self/cgroup", "0::/job/step\n");
        write("sys/fs/cgroup/job/memory.max", "1000\n");
        write("sys/fs/cgroup/job/memory.current", "700\n");
        write(
            "sys/fs/cgroup/job/memory.stat",
            "anon 3\ninactive_file 150\n",
        );
        write("sys/fs/cgroup/job/step/memory.max", "max\n");
        write("sys/fs/cgroup/job/step/memory.current", "700\n");
        assert_eq!(group_left(root.path()), Some(450));
        write("sys/fs/cgroup/job/step/memory.max", "800\n");
        assert_eq!(group_left(root.path()), Some(100));
        write("proc/self/cgroup", "4:memory:/old\n0::/\n");
        assert_eq!(group_left(root.path()), None);
        write("sys/fs/cgroup/memory/old/memory.limit_in_bytes", "500\n");
        write("sys/fs/cgroup/memory/old/memory.usage_in_bytes", "600\n");
        assert_eq!(group_left(root.path()), Some(0));
    }

    #[test]
    fn what_does_not_fit_is_refused_before_it_is_tried() {
        assert!(check(1000, 100).is_ok());
        if left().is_some() {
            let error = check(usize::MAX / 256, 200).unwrap_err().to_string();
            assert!(
                error.starts_with("memory: ") && error.contains("--crop"),
                "{error}"
            );
        }
    }

    #[test]
    fn numbers_without_room_are_refused_by_what_a_header_says() {
        let path = Path::new("a.nrrd");
        assert!(check_room(path, "header, the sizes", 1 << 20).is_ok());
        if left().is_some() {
            assert!(no_room(1 << 20).is_none());
            let error = check_room(path, "header, the sizes", 1 << 60);
            let error = error.unwrap_err().to_string();
            assert!(
                error.starts_with("a.nrrd: header, the sizes: ")
                    && error.contains("found 11529215"),
                "{error}"
            );
        }
    }

    #[test]
    fn rooms_that_may_be_refused_are_told_apart() {
        assert!(!is_tried());
        assert!(trying(is_tried));
        assert!(!is_tried());
    }
}
