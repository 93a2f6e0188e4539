//! Implements ranks that are processes, over MPI.
//!
//! Calls go to the C interface, because the crate's own wrappers drop the return codes that are checked here. MPI's
//! lengths are 32-bit numbers: longer messages are sent in rounds.

#![allow(
    unsafe_code,
    reason = "MPI is a C library; this file alone calls it, with buffers that live until it is done with them"
)]

use std::collections::VecDeque;
use std::ffi::c_int;
use std::fmt;

use mpi::environment::{Threading, Universe};
use mpi::ffi;

use crate::collective::Collective;
use crate::error::{Error, Result};

/// Bytes in a round, from one rank to all others or from all to one.
const ROUND: usize = 1 << 30;

/// A rank of an MPI job that this program starts, or of a host program's communicator.
pub struct MpiRank {
    /// A duplicate of the caller's communicator, which reports errors instead of ending the program.
    communicator: ffi::MPI_Comm,
    rank: usize,
    size: usize,
    under_way: VecDeque<Exchange>,
    /// Ends MPI when dropped, if this rank started it.
    universe: Option<Universe>,
}

// SAFETY: a communicator is a handle that belongs to no thread. MPI was started so that any thread may call it, one at
// a time, and this communicator is called through `&mut`.
unsafe impl Send for MpiRank {}

impl fmt::Debug for MpiRank {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MpiRank")
            .field("rank", &self.rank)
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

/// Guard that ends MPI when it is dropped, after the guards of all processes of the job.
pub struct MpiGuard(#[expect(dead_code, reason = "dropping it ends MPI")] Universe);

impl fmt::Debug for MpiGuard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("MpiGuard")
    }
}

impl Drop for MpiGuard {
    fn drop(&mut self) {
        // SAFETY: the world's communicator is valid while MPI runs. An error ends the job.
        unsafe {
            ffi::MPI_Barrier(ffi::RSMPI_COMM_WORLD);
        }
    }
}

/// An exchange under way, in rounds.
struct Exchange {
    rounds: Vec<Round>,
    /// Number of bytes that each rank sends here.
    lengths: Vec<usize>,
}

/// One round of an exchange. Boxed slices do not move while MPI reads and writes them.
struct Round {
    request: ffi::MPI_Request,
    received: Box<[u8]>,
    places: Places,
    _sent: Box<[u8]>,
    _sent_places: Places,
}

/// Lengths and beginnings of the parts of a buffer.
struct Places {
    counts: Box<[c_int]>,
    firsts: Box<[c_int]>,
}

impl Places {
    /// Returns lengths and positions of the messages' parts in the buffer of a round, given the messages' lengths.
    fn of(lengths: &[usize], round: usize, cap: usize) -> Self {
        let count = |&len: &usize| len.saturating_sub(round * cap).min(cap);
        let mut first = 0;
        let firsts = lengths.iter().map(|len| {
            let own = first;
            first += count(len);
            narrow(own)
        });
        let firsts = firsts.collect();
        let counts = lengths.iter().map(|len| narrow(count(len))).collect();
        Self { counts, firsts }
    }

    fn len(&self) -> usize {
        self.counts.iter().map(|&count| count as usize).sum()
    }

    /// Returns a rank's part of the round's buffer.
    fn part<'a>(&self, buffer: &'a [u8], rank: usize) -> &'a [u8] {
        let first = self.firsts[rank] as usize;
        &buffer[first..first + self.counts[rank] as usize]
    }
}

/// Narrows a length: rounds hold no more than a `c_int` counts.
fn narrow(length: usize) -> c_int {
    c_int::try_from(length).unwrap_or(c_int::MAX)
}

/// Returns the most bytes that a pair of ranks sends in a round, and the number of rounds of the longest message.
fn rounds(longest: usize, size: usize) -> (usize, usize) {
    let cap = (ROUND / size).max(1);
    (cap, longest.div_ceil(cap).max(1))
}

impl MpiRank {
    /// Joins all processes that `mpirun` or `srun` started.
    ///
    /// # Errors
    /// MPI does not start, has been started already, or may not be called by any thread.
    pub fn world() -> Result<Self> {
        let refused = |found: &str| {
            let expected = "to start once, for calls from any thread";
            Error::invalid(
                "MPI",
                "start",
                expected,
                found,
                "start the program with mpirun or srun",
            )
        };
        let (universe, threading) = mpi::initialize_with_threading(Threading::Serialized)
            .ok_or_else(|| refused("it has been started"))?;
        if threading < Threading::Serialized {
            return Err(refused("a library for calls from one thread"));
        }
        // SAFETY: the world's communicator is valid while MPI runs.
        let mut rank = unsafe { Self::of_host(ffi::RSMPI_COMM_WORLD)? };
        rank.universe = Some(universe);
        Ok(rank)
    }

    /// Joins the processes of a host program's communicator. The host has started MPI for calls from any thread
    /// (`MPI_THREAD_SERIALIZED`). The communicator stays the host's: this rank uses a duplicate.
    ///
    /// # Errors
    /// The errors of MPI.
    ///
    /// # Safety
    /// The communicator is valid and no intercommunicator, and MPI runs until this rank is dropped.
    pub unsafe fn of_host(communicator: ffi::MPI_Comm) -> Result<Self> {
        let (mut rank, mut size) = (0, 0);
        // SAFETY: places for results live as long as the calls.
        let own = unsafe {
            let mut own = ffi::RSMPI_COMM_NULL;
            check(
                "duplicating the communicator",
                ffi::MPI_Comm_dup(communicator, &raw mut own),
            )?;
            let returns = ffi::MPI_Comm_set_errhandler(own, ffi::RSMPI_ERRORS_RETURN);
            check("errors that return", returns)?;
            check("rank", ffi::MPI_Comm_rank(own, &raw mut rank))?;
            check("size", ffi::MPI_Comm_size(own, &raw mut size))?;
            own
        };
        Ok(Self {
            communicator: own,
            rank: usize::try_from(rank).unwrap_or(0),
            size: usize::try_from(size).unwrap_or(1),
            under_way: VecDeque::new(),
            universe: None,
        })
    }

    /// As [`Self::of_host`], of a Fortran handle (`MPI_Comm_c2f`, or an `MPI_VAL` of Fortran 2008), for hosts whose
    /// compiler knows another `mpi.h` than this library.
    ///
    /// # Errors
    /// MPI that does not run; a thread from which it may not be called; no communicator, or one between two groups; the
    /// errors of MPI.
    ///
    /// # Safety
    /// The handle is zero or that of a communicator, and MPI runs until this rank is dropped.
    pub unsafe fn of_fortran(communicator: i32) -> Result<Self> {
        let refused = |expected: &str, found: &str, advice: &str| {
            Err(Error::invalid(
                "MPI",
                "communicator",
                expected,
                found,
                advice,
            ))
        };
        let (mut begun, mut ended, mut is_between) = (0, 0, 0);
        let (mut level, mut is_main) = (0, 0);
        // SAFETY: these may be called whether MPI runs or not.
        unsafe {
            ffi::MPI_Initialized(&raw mut begun);
            ffi::MPI_Finalized(&raw mut ended);
        }
        if begun == 0 || ended != 0 {
            let advice = "call it between MPI_Init_thread and MPI_Finalize";
            return refused("a running MPI", "one that does not run", advice);
        }
        // SAFETY: MPI runs, and the handle is as the caller guarantees; places for results live as long as the calls.
        unsafe {
            check("level of threads", ffi::MPI_Query_thread(&raw mut level))?;
            check("thread", ffi::MPI_Is_thread_main(&raw mut is_main))?;
            if level < ffi::RSMPI_THREAD_SERIALIZED && is_main == 0 {
                let advice =
                    "start MPI with MPI_THREAD_SERIALIZED, or call from the thread that started it";
                return refused("a thread that may call MPI", "another one", advice);
            }
            let own = ffi::RSMPI_Comm_f2c(communicator);
            // Open MPI returns a null pointer for unknown handles. Other libraries have numbers, none of them 0.
            let bytes: [u8; size_of::<ffi::MPI_Comm>()] = std::mem::transmute(own);
            if own == ffi::RSMPI_COMM_NULL || bytes.iter().all(|byte| *byte == 0) {
                let advice = "give the Fortran handle of a communicator, by MPI_Comm_c2f";
                return refused("a communicator", "none", advice);
            }
            let tested = ffi::MPI_Comm_test_inter(own, &raw mut is_between);
            check("kind of communicator", tested)?;
            if is_between != 0 {
                let advice = "give that of one group";
                return refused("a communicator of one group", "one between two", advice);
            }
            Self::of_host(own)
        }
    }

    /// Takes the guard that ends MPI, if this rank started MPI; the rank no longer ends it.
    pub fn take_guard(&mut self) -> Option<MpiGuard> {
        self.universe.take().map(MpiGuard)
    }

    /// Ends all processes of the job.
    pub fn end_all() {
        // SAFETY: the world's communicator is valid while MPI runs; if MPI does not run, there is nothing to end.
        unsafe {
            let (mut begun, mut ended) = (0, 0);
            ffi::MPI_Initialized(&raw mut begun);
            ffi::MPI_Finalized(&raw mut ended);
            if begun != 0 && ended == 0 {
                ffi::MPI_Abort(ffi::RSMPI_COMM_WORLD, 1);
            }
        }
    }

    /// Exchanges lengths. Returns the number of bytes that each rank sends here, and the greatest `longest` of all
    /// ranks.
    fn lengths(&self, own: &[usize], longest: usize) -> Result<(Vec<usize>, usize)> {
        let sent: Vec<u64> = own
            .iter()
            .flat_map(|&len| [len as u64, longest as u64])
            .collect();
        let mut received = vec![0_u64; sent.len()];
        // SAFETY: both buffers hold two numbers for each rank.
        check("lengths", unsafe {
            ffi::MPI_Alltoall(
                sent.as_ptr().cast(),
                2,
                ffi::RSMPI_UINT64_T,
                received.as_mut_ptr().cast(),
                2,
                ffi::RSMPI_UINT64_T,
                self.communicator,
            )
        })?;
        let number = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        let lengths = received.iter().step_by(2).map(|&n| number(n)).collect();
        let longest = received.iter().skip(1).step_by(2).map(|&n| number(n)).max();
        Ok((lengths, longest.unwrap_or(0)))
    }
}

impl Collective for MpiRank {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()> {
        let own: Vec<usize> = parts.iter().map(Vec::len).collect();
        let longest = own.iter().copied().max().unwrap_or(0);
        let (lengths, longest) = self.lengths(&own, longest)?;
        let (cap, count) = rounds(longest, self.size);
        let mut exchange = Exchange {
            rounds: Vec::with_capacity(count),
            lengths,
        };
        for round in 0..count {
            let sent_places = Places::of(&own, round, cap);
            let places = Places::of(&exchange.lengths, round, cap);
            let mut sent = Vec::with_capacity(sent_places.len());
            for (part, &len) in parts.iter().zip(&own) {
                sent.extend_from_slice(&part[(round * cap).min(len)..((round + 1) * cap).min(len)]);
            }
            let mut round = Round {
                // SAFETY: a constant of the library.
                request: unsafe { ffi::RSMPI_REQUEST_NULL },
                received: vec![0; places.len()].into(),
                places,
                _sent: sent.into(),
                _sent_places: sent_places,
            };
            // SAFETY: buffers and places live in the round until its request is waited for; places lie within them.
            check("exchange", unsafe {
                ffi::MPI_Ialltoallv(
                    round._sent.as_ptr().cast(),
                    round._sent_places.counts.as_ptr(),
                    round._sent_places.firsts.as_ptr(),
                    ffi::RSMPI_UINT8_T,
                    round.received.as_mut_ptr().cast(),
                    round.places.counts.as_ptr(),
                    round.places.firsts.as_ptr(),
                    ffi::RSMPI_UINT8_T,
                    self.communicator,
                    &raw mut round.request,
                )
            })?;
            exchange.rounds.push(round);
        }
        self.under_way.push_back(exchange);
        Ok(())
    }

    fn complete(&mut self) -> Result<Vec<Vec<u8>>> {
        let Some(mut exchange) = self.under_way.pop_front() else {
            return Err(Error::of_rank(self.rank, "no exchange is under way".into()));
        };
        let capacity = |&len: &usize| Vec::with_capacity(len);
        let mut parts: Vec<Vec<u8>> = exchange.lengths.iter().map(capacity).collect();
        for round in &mut exchange.rounds {
            // SAFETY: the request was begun in `begin` and is waited for once.
            check("exchange", unsafe {
                ffi::MPI_Wait(&raw mut round.request, ffi::RSMPI_STATUS_IGNORE)
            })?;
            for (rank, part) in parts.iter_mut().enumerate() {
                part.extend_from_slice(round.places.part(&round.received, rank));
            }
        }
        Ok(parts)
    }

    fn gather(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>> {
        let (lengths, longest) = self.lengths(&vec![part.len(); self.size], part.len())?;
        let (cap, count) = rounds(longest, self.size);
        let capacity = |&len: &usize| Vec::with_capacity(len);
        let mut parts: Vec<Vec<u8>> = lengths.iter().map(capacity).collect();
        for round in 0..count {
            let own = &part[(round * cap).min(part.len())..((round + 1) * cap).min(part.len())];
            let places = Places::of(&lengths, round, cap);
            let mut received = vec![0; places.len()];
            // SAFETY: the buffers live as long as the call, and places lie within what is received.
            check("gathering", unsafe {
                ffi::MPI_Allgatherv(
                    own.as_ptr().cast(),
                    narrow(own.len()),
                    ffi::RSMPI_UINT8_T,
                    received.as_mut_ptr().cast(),
                    places.counts.as_ptr(),
                    places.firsts.as_ptr(),
                    ffi::RSMPI_UINT8_T,
                    self.communicator,
                )
            })?;
            for (rank, part) in parts.iter_mut().enumerate() {
                part.extend_from_slice(places.part(&received, rank));
            }
        }
        Ok(parts)
    }
}

impl Drop for MpiRank {
    fn drop(&mut self) {
        // MPI may still read and write these buffers: they must not be freed before it is done.
        while !self.under_way.is_empty() && self.complete().is_ok() {}
        std::mem::forget(std::mem::take(&mut self.under_way));
        // SAFETY: the duplicate is this rank's own and is freed once, unless a host has ended MPI before.
        unsafe {
            let mut ended = 0;
            ffi::MPI_Finalized(&raw mut ended);
            if ended == 0 {
                ffi::MPI_Comm_free(&raw mut self.communicator);
            }
        }
    }
}

/// Turns an error code of MPI into an error with MPI's text.
fn check(place: &str, code: c_int) -> Result<()> {
    if code == 0 {
        return Ok(());
    }
    let mut text = [0_u8; 1024];
    let mut length = 0;
    // SAFETY: a text has at most MPI_MAX_ERROR_STRING bytes: 512 in MPICH, 256 in Open MPI.
    unsafe {
        ffi::MPI_Error_string(code, text.as_mut_ptr().cast(), &raw mut length);
    }
    let length = usize::try_from(length).unwrap_or(0).min(text.len());
    let found = String::from_utf8_lossy(&text[..length]).into_owned();
    Err(Error::invalid(
        "MPI",
        place,
        "success",
        found,
        "look at the job's own messages",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rounds of messages of any lengths add up to the messages, and each fits 32-bit lengths.
    #[test]
    fn rounds_are_whole_messages() {
        for lengths in [
            vec![0, 0],
            vec![5, 0, 17],
            vec![ROUND * 3 + 1, 8, ROUND / 3],
        ] {
            let longest = lengths.iter().copied().max().unwrap_or(0);
            let (cap, count) = rounds(longest, lengths.len());
            let mut sums = vec![0; lengths.len()];
            for round in 0..count {
                let places = Places::of(&lengths, round, cap);
                assert!(places.len() <= ROUND);
                for (sum, &count) in sums.iter_mut().zip(&places.counts) {
                    *sum += count as usize;
                }
            }
            assert_eq!(sums, lengths);
        }
    }
}
