//! Supports processes made by `fork`, as Python's `multiprocessing` makes them on Linux.
//!
//! In the child, only the thread that forked still runs. Rayon's own pool has no workers there and
//! would wait for ever. The child cannot use its parent's devices.

use std::process;
use std::sync::OnceLock;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::frame::backend::Backend;

/// Process that worked first; Rayon's own pool belongs to it.
static FIRST: OnceLock<u32> = OnceLock::new();

/// Pools of the processes that were forked from it. None is freed: a process inherits its parents'
/// pools, whose workers it cannot end.
static POOLS: OnceLock<Box<Pool>> = OnceLock::new();

struct Pool {
    process: u32,
    threads: ThreadPool,
    next: OnceLock<Box<Pool>>,
}

/// Returns the number of this process; in a browser, where there are no processes, always the same.
pub(crate) fn own_process() -> u32 {
    match cfg!(target_family = "wasm") {
        true => 0,
        false => process::id(),
    }
}

/// Returns true if this process was forked from one that had worked.
pub(crate) fn is_forked() -> bool {
    FIRST.get().is_some_and(|first| *first != own_process())
}

/// Runs `work` in a pool that has workers for its parallel loops.
///
/// # Panics
/// If the system can start no thread.
pub fn with_workers<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let own = own_process();
    if *FIRST.get_or_init(|| own) == own {
        return work();
    }
    let mut place = &POOLS;
    let pool = loop {
        match place.get() {
            Some(pool) if pool.process == own => break pool,
            Some(pool) => place = &pool.next,
            None => {
                let threads = ThreadPoolBuilder::new().build();
                let threads = threads.unwrap_or_else(|error| panic!("no threads: {error}"));
                // If two threads race, both use the pool of the first.
                let _ = place.set(Box::new(Pool {
                    process: own,
                    threads,
                    next: OnceLock::new(),
                }));
            }
        }
    };
    pool.threads.install(work)
}

/// Returns the backend to use in this process.
///
/// # Errors
/// A GPU in a forked process: devices and their drivers do not survive a fork.
pub(crate) fn usable(backend: Backend) -> Result<Backend> {
    match backend {
        Backend::Auto if is_forked() => Ok(Backend::Cpu),
        Backend::Gpu if is_forked() => Err(Error::invalid(
            "backend",
            "process",
            "one that was started afresh, for a GPU",
            "one that was forked after pictures were drawn",
            "start processes afresh (multiprocessing's \"spawn\" or \"forkserver\"), or choose the CPU",
        )),
        backend => Ok(backend),
    }
}
