//! Defines the interface of a communicator, which carries messages between ranks.

use std::fmt::Debug;

use crate::error::Result;

/// One rank's end of a group of ranks that work together, numbered from 0.
///
/// Every function but [`Self::rank`] and [`Self::size`] is collective: all ranks call the same functions in the same
/// order. Errors concern the connection itself (a rank that is gone). If a rank's own work fails, the caller must send
/// the error to the other ranks.
pub trait Communicator: Debug + Send {
    /// This rank's number.
    fn rank(&self) -> usize;

    /// Number of ranks, at least one.
    fn size(&self) -> usize;

    /// Begins to send a part to every rank, this one included; returns while the parts are under way.
    ///
    /// - `parts`: one for each rank, in the order of ranks.
    ///
    /// # Errors
    /// The parts cannot be sent.
    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()>;

    /// Waits for the oldest exchange that was begun and not completed; returns the part that each rank sent here, by
    /// rank.
    ///
    /// # Errors
    /// A rank that is gone.
    fn complete(&mut self) -> Result<Vec<Vec<u8>>>;

    /// Gathers a part of each rank on all ranks, by rank. No exchange may be under way.
    ///
    /// # Errors
    /// A rank that is gone.
    fn gather_to_all(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>>;
}
