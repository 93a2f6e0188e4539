//! Wraps a communicator so that ranks learn of one another's failures.

use bytemuck::Pod;
#[cfg(feature = "prepared")]
use serde::{Serialize, de::DeserializeOwned};

use super::communicator::Communicator;
#[cfg(feature = "prepared")]
use super::message::unknown;
use super::message::{put, take};
use crate::blocks::Peers;
use crate::error::{Error, Result};
#[cfg(feature = "cli")]
use crate::image::Image;

/// Last byte of every part: whether the rest is the part itself, or the error that took its place.
const WHOLE: u8 = 0;
const FAILED: u8 = 1;

/// A communicator whose ranks take part in every collective call, even after a failure. The other ranks receive the
/// error, and none waits for a message that never comes.
#[derive(Debug)]
pub(crate) struct Ranks {
    communicator: Box<dyn Communicator>,
}

impl Ranks {
    pub(crate) fn new(communicator: Box<dyn Communicator>) -> Self {
        Self { communicator }
    }

    pub(crate) fn rank(&self) -> usize {
        self.communicator.rank()
    }

    pub(crate) fn size(&self) -> usize {
        self.communicator.size()
    }

    /// Begins to send a part to every rank, or this rank's error in place of the parts.
    ///
    /// # Errors
    /// This rank's error.
    pub(super) fn begin(&mut self, parts: Result<Vec<Vec<u8>>>) -> Result<()> {
        match parts {
            Ok(parts) => {
                let whole = parts.into_iter().map(|part| flagged(part, WHOLE));
                self.communicator.begin(whole.collect())
            }
            Err(error) => {
                let told = flagged(error.to_string().into_bytes(), FAILED);
                self.communicator.begin(vec![told; self.size()])?;
                Err(error)
            }
        }
    }

    /// Waits for the oldest exchange that is not completed; returns the part that each rank sent here.
    ///
    /// # Errors
    /// The error of the first rank that failed.
    pub(super) fn complete(&mut self) -> Result<Vec<Vec<u8>>> {
        unflagged(self.communicator.complete()?)
    }

    /// Gathers the part of each rank on all ranks; returns the error of the first rank that failed, if any did.
    pub(super) fn gather_to_all(&mut self, part: Result<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
        let flagged = match &part {
            Ok(part) => flagged(part.clone(), WHOLE),
            Err(error) => flagged(error.to_string().into_bytes(), FAILED),
        };
        let all = self
            .communicator
            .gather_to_all(&flagged)
            .and_then(unflagged);
        match part {
            // A rank that failed returns its own error.
            Err(error) => Err(error),
            Ok(_) => all,
        }
    }

    /// Broadcasts the bytes of the first rank to all ranks.
    ///
    /// - `own`: `None` on other ranks.
    ///
    /// # Errors
    /// The first rank's error.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_first(&mut self, own: Result<Option<Vec<u8>>>) -> Result<Vec<u8>> {
        self.of_rank(0, own)
    }

    /// Broadcasts the bytes of a rank to all ranks, as [`Self::of_first`] does of the first.
    #[cfg(feature = "prepared")]
    pub(super) fn of_rank(&mut self, rank: usize, own: Result<Option<Vec<u8>>>) -> Result<Vec<u8>> {
        let size = self.size();
        let parts = own.map(|own| match own {
            Some(own) => vec![own; size],
            None => vec![Vec::new(); size],
        });
        Ok(self.exchange(parts)?.swap_remove(rank))
    }

    /// Gathers the bytes of each rank on the first rank; other ranks get none.
    #[cfg(feature = "cli")]
    pub(crate) fn gather_on_first(&mut self, own: Result<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
        let size = self.size();
        let parts = own.map(|own| {
            let mut parts = vec![Vec::new(); size];
            parts[0] = own;
            parts
        });
        self.exchange(parts)
    }

    /// Gathers the records of each rank on all ranks.
    pub(crate) fn gather_records<T: Pod>(
        &mut self,
        records: Result<Vec<T>>,
    ) -> Result<Vec<Vec<T>>> {
        let part = records.map(|records| {
            let mut part = Vec::new();
            put(&mut part, &records);
            part
        });
        let all = self.gather_to_all(part)?;
        all.iter().map(|part| take(&mut part.as_slice())).collect()
    }

    /// Returns the sum of the counts of all ranks before this one.
    #[cfg(feature = "cli")]
    pub(super) fn before(&mut self, own: usize) -> Result<u64> {
        let all = self.gather_records(Ok(vec![own as u64]))?;
        Ok(all[..self.rank()].iter().flatten().sum())
    }

    /// Gathers a value of each rank on all ranks, as JSON: its numbers must be finite.
    #[cfg(feature = "prepared")]
    pub(crate) fn told_by_all<T: Serialize + DeserializeOwned>(
        &mut self,
        own: &T,
    ) -> Result<Vec<T>> {
        let part = serde_json::to_vec(own).unwrap_or_default();
        let all = self.gather_to_all(Ok(part))?;
        all.iter().map(|part| heard(part)).collect()
    }

    /// Broadcasts a value of the first rank to all ranks; other ranks give `None`.
    ///
    /// # Errors
    /// The errors of [`Self::of_first`].
    #[cfg(feature = "cli")]
    pub(crate) fn told_by_first<T: Serialize + DeserializeOwned>(
        &mut self,
        own: Result<Option<T>>,
    ) -> Result<T> {
        let told = |own: T| serde_json::to_vec(&own).unwrap_or_default();
        heard(&self.of_first(own.map(|own| own.map(told)))?)
    }

    /// Returns the sums of the ranks' numbers, place by place.
    pub(super) fn sums(&mut self, numbers: Result<Vec<u64>>) -> Result<Vec<u64>> {
        let all = self.gather_records(numbers)?;
        let mut sums = Vec::new();
        for own in all {
            sums.resize(sums.len().max(own.len()), 0);
            for (sum, number) in sums.iter_mut().zip(own) {
                *sum += number;
            }
        }
        Ok(sums)
    }

    /// Gathers the ranks' images on the first rank, in the order of the ranks; other ranks get none.
    #[cfg(feature = "cli")]
    pub(crate) fn gather_images(&mut self, own: Result<Option<Image>>) -> Result<Vec<Image>> {
        let part = own.map(|image| {
            let mut part = Vec::new();
            if let Some(image) = image {
                put(&mut part, &[image.width as u64, image.height as u64]);
                put(&mut part, &image.pixels);
            }
            part
        });
        let parts = self.gather_on_first(part)?;
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

    /// Returns the first rank whose number differs from the first rank's.
    ///
    /// # Errors
    /// A rank that is gone.
    #[cfg(feature = "cli")]
    pub(crate) fn first_other(&mut self, own: u64) -> Result<Option<usize>> {
        let all = self.gather_records(Ok(vec![own]))?;
        Ok(all.iter().position(|other| *other != all[0]))
    }

    /// Returns the result of this rank if all ranks have one.
    ///
    /// # Errors
    /// The rank's own error, or that of the first rank without a result.
    pub(crate) fn agree<T>(&mut self, result: Result<T>) -> Result<T> {
        let mut value = None;
        let part = result.map(|own| {
            value = Some(own);
            Vec::new()
        });
        self.gather_to_all(part)?;
        value.ok_or(Error::Cancelled)
    }
}

impl Peers for Ranks {
    fn rank(&self) -> usize {
        self.communicator.rank()
    }

    fn size(&self) -> usize {
        self.communicator.size()
    }

    fn gather(&mut self, part: Result<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
        self.gather_to_all(part)
    }

    fn exchange(&mut self, parts: Result<Vec<Vec<u8>>>) -> Result<Vec<Vec<u8>>> {
        let begun = self.begin(parts);
        let parts = self.complete();
        begun.and(parts)
    }
}

#[cfg(feature = "prepared")]
fn heard<T: DeserializeOwned>(part: &[u8]) -> Result<T> {
    serde_json::from_slice(part).map_err(|e| unknown(&e.to_string()))
}

fn flagged(mut part: Vec<u8>, flag: u8) -> Vec<u8> {
    part.push(flag);
    part
}

fn unflagged(parts: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
    let without = |(rank, mut part): (usize, Vec<u8>)| match part.pop() {
        Some(WHOLE) => Ok(part),
        _ => Err(Error::of_rank(
            rank,
            String::from_utf8_lossy(&part).into_owned(),
        )),
    };
    parts.into_iter().enumerate().map(without).collect()
}
