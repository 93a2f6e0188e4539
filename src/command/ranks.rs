//! Runs `ewa-splat render --mpi`: many processes (ranks), of which the first writes files and
//! prints messages.

#[cfg(feature = "mpi")]
use std::sync::{Mutex, PoisonError};

use crate::collective::Collective;
use crate::message::{put, take};
#[cfg(feature = "mpi")]
use crate::ranks::{MpiGuard, MpiRank};
use crate::{Error, Image, Result};

/// Guard that ends MPI, after the last message of this process.
#[cfg(feature = "mpi")]
static GUARD: Mutex<Option<MpiGuard>> = Mutex::new(None);

/// Starts MPI. From now on only the first rank prints, and a rank that panics ends all ranks.
#[cfg(feature = "mpi")]
pub(crate) fn start() -> Result<Box<dyn Collective>> {
    let mut rank = MpiRank::world()?;
    *GUARD.lock().unwrap_or_else(PoisonError::into_inner) = rank.take_guard();
    let ranks: Box<dyn Collective> = Box::new(rank);
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
    drop(GUARD.lock().unwrap_or_else(PoisonError::into_inner).take());
}

/// Fails always: the command line refuses the option in a build without MPI.
#[cfg(not(feature = "mpi"))]
pub(crate) fn start() -> Result<Box<dyn Collective>> {
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
    ranks: &mut dyn Collective,
    count: usize,
    mut draw: impl FnMut(usize) -> Result<Image>,
    mut push: impl FnMut(&Image) -> Result<()>,
) -> Result<()> {
    let size = ranks.size();
    for first in (0..count).step_by(size) {
        let own = first + ranks.rank();
        let drawn = (own < count).then(|| draw(own)).transpose();
        let pictures = gather_images(ranks, drawn)?;
        let pushed = pictures.iter().try_for_each(&mut push);
        ranks.agree(pushed)?;
    }
    Ok(())
}

/// Gathers the ranks' images on the first rank, in the order of the ranks; other ranks get none.
fn gather_images(ranks: &mut dyn Collective, own: Result<Option<Image>>) -> Result<Vec<Image>> {
    let part = own.map(|image| {
        let mut part = Vec::new();
        if let Some(image) = image {
            put(&mut part, &[image.width as u64, image.height as u64]);
            put(&mut part, &image.pixels);
        }
        part
    });
    let parts = ranks.gather_on_first(part)?;
    let mut images = Vec::new();
    for part in parts.iter().filter(|part| !part.is_empty()) {
        let mut part = part.as_slice();
        let sides = take::<u64>(&mut part)?;
        let pixels = take(&mut part)?;
        let side = |n: usize| sides.get(n).map_or(0, |&n| usize::try_from(n).unwrap_or(0));
        images.push(Image {
            width: side(0),
            height: side(1),
            pixels,
        });
    }
    Ok(images)
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
