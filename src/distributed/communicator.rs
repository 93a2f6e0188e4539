//! What ranks say to one another, however it travels.

use std::fmt::Debug;

use crate::error::Result;

/// One rank's end of a group of ranks that work together, numbered from 0.
///
/// Every function but [`Self::rank`] and [`Self::size`] is collective: all ranks call the same ones in the same
/// order. Errors are those of the way itself (a rank that is gone); what goes wrong within a rank is told to the
/// others by those who use it.
pub trait Communicator: Debug + Send {
    /// This one's number.
    fn rank(&self) -> usize;

    /// How many there are, at least one.
    fn size(&self) -> usize;

    /// Begins to send a part to every rank, this one among them; it goes on while this rank works.
    ///
    /// - `parts`: by rank, as many as there are.
    ///
    /// # Errors
    /// What keeps them from being sent.
    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()>;

    /// Waits for the oldest exchange that was begun and not completed: what each rank sent here, by rank.
    ///
    /// # Errors
    /// A rank that is gone.
    fn complete(&mut self) -> Result<Vec<Vec<u8>>>;

    /// What each rank gives, by rank, for all of them. No exchange is under way.
    ///
    /// # Errors
    /// A rank that is gone.
    fn gather_to_all(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>>;
}
