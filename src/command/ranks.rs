//! Runs `ewa-splat render --mpi`: many processes (ranks), of which the first writes files and
//! prints messages.

#[cfg(feature = "mpi")]
use std::sync::{Mutex, PoisonError};

#[cfg(feature = "mpi")]
use mpi::environment::Universe;

#[cfg(feature = "mpi")]
use crate::distributed::MpiRank;
use crate::distributed::Ranks;
use crate::{Error, Image, Result};

/// MPI's state. Dropping it ends MPI, after the last message of this process.
#[cfg(feature = "mpi")]
static UNIVERSE: Mutex<Option<Universe>> = Mutex::new(None);

/// Starts MPI. From now on only the first rank prints, and a rank that panics ends all ranks.
#[cfg(feature = "mpi")]
pub(crate) fn start() -> Result<Ranks> {
    let mut rank = MpiRank::world()?;
    *UNIVERSE.lock().unwrap_or_else(PoisonError::into_inner) = rank.universe();
    let ranks = Ranks::new(Box::new(rank));
    let rank = ranks.rank();
    if rank != 0 {
        super::progress::be_silent();
    }
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        eprintln!("error: rank {rank}: a bug ended it");
        report(panic);
        MpiRank::end_all();
    }));
    Ok(ranks)
}

/// Ends MPI if it was started, after the last message of this process. Ranks must leave together:
/// if one fails, the launcher ends those that are left.
#[cfg(feature = "mpi")]
pub(crate) fn end() {
    let universe = UNIVERSE
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take();
    if universe.is_some() {
        MpiRank::wait_for_all();
    }
}

/// Fails always: the command line refuses the option in a build without MPI.
#[cfg(not(feature = "mpi"))]
pub(crate) fn start() -> Result<Ranks> {
    Err(Error::invalid(
        "--mpi",
        "this program",
        "one built with the feature mpi",
        "one without",
        WITHOUT,
    ))
}

/// Advice on building with MPI.
#[cfg(not(feature = "mpi"))]
pub(crate) const WITHOUT: &str = "build it with `cargo install --path . --features mpi`";

/// Draws pictures on the ranks in turn, one on each rank at a time. The first rank passes them to
/// `push` in their order.
pub(crate) fn in_turn(
    ranks: &mut Ranks,
    count: usize,
    mut draw: impl FnMut(usize) -> Result<Image>,
    mut push: impl FnMut(&Image) -> Result<()>,
) -> Result<()> {
    let size = ranks.size();
    for first in (0..count).step_by(size) {
        let own = first + ranks.rank();
        let drawn = (own < count).then(|| draw(own)).transpose();
        let pictures = ranks.gather_images(drawn)?;
        let pushed = pictures.iter().try_for_each(&mut push);
        ranks.agree(pushed)?;
    }
    Ok(())
}

/// Returns the error for an option that cannot be used with `--mpi`.
pub(crate) fn refuse(option: &'static str) -> Error {
    Error::invalid(
        option,
        "use",
        "one process",
        "--mpi beside it",
        "leave out one of the two",
    )
}
