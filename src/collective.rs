//! Defines groups of ranks that work together, and their collective operations.
//!
//! All ranks of a group call the same functions in the same order. A rank that fails sends its error in place of its
//! data: the other ranks receive the error, and none waits for a message that never comes. A group of one rank
//! ([`Alone`]) exchanges nothing: every operation returns its argument.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::ops::Range;

use bytemuck::Pod;
use serde::{Serialize, de::DeserializeOwned};

use crate::error::{Error, Result};
use crate::math::ExactSum;
use crate::message::unknown;

/// One rank's end of a group of ranks that work together, numbered from 0.
///
/// Every function but [`Self::rank`] and [`Self::size`] is collective: all ranks call the same functions in the same
/// order. Errors concern the connection itself (a rank that is gone). If a rank's own work fails, the caller must send
/// the error to the other ranks.
pub trait Collective: Debug + Send {
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
    fn gather(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>>;
}

/// A group of one rank.
#[derive(Debug, Default)]
pub struct Alone {
    under_way: VecDeque<Vec<Vec<u8>>>,
}

impl Collective for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()> {
        self.under_way.push_back(parts);
        Ok(())
    }

    fn complete(&mut self) -> Result<Vec<Vec<u8>>> {
        let parts = self.under_way.pop_front();
        parts.ok_or_else(|| Error::of_rank(0, "no exchange is under way".into()))
    }

    fn gather(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>> {
        Ok(vec![part.to_vec()])
    }
}

/// Last byte of every part: whether the rest is the part itself, or the error that took its place.
const WHOLE: u8 = 0;
const FAILED: u8 = 1;

/// Operations that carry errors. Each returns the rank's own error, or that of the first rank that failed.
impl dyn Collective + '_ {
    /// Begins to send a part to every rank, or this rank's error in place of the parts.
    ///
    /// # Errors
    /// This rank's error.
    pub(crate) fn begin_exchange(&mut self, parts: Result<Vec<Vec<u8>>>) -> Result<()> {
        match parts {
            Ok(parts) => {
                let whole = parts.into_iter().map(|part| flagged(part, WHOLE));
                self.begin(whole.collect())
            }
            Err(error) => {
                let text = flagged(error.to_string().into_bytes(), FAILED);
                self.begin(vec![text; self.size()])?;
                Err(error)
            }
        }
    }

    /// Waits for the oldest exchange that is not completed; returns the part that each rank sent here.
    ///
    /// # Errors
    /// The error of the first rank that failed.
    pub(crate) fn complete_exchange(&mut self) -> Result<Vec<Vec<u8>>> {
        unflagged(self.complete()?)
    }

    /// Sends a part to each rank; returns the parts that the ranks sent here, by rank.
    pub(crate) fn exchange(&mut self, parts: Result<Vec<Vec<u8>>>) -> Result<Vec<Vec<u8>>> {
        if self.size() == 1 {
            return parts;
        }
        let begun = self.begin_exchange(parts);
        let parts = self.complete_exchange();
        begun.and(parts)
    }

    /// Sends records to each rank; returns the records that the ranks sent here, by rank.
    pub(crate) fn exchange_records<T: Pod>(
        &mut self,
        parts: Result<Vec<Vec<T>>>,
    ) -> Result<Vec<Vec<T>>> {
        if self.size() == 1 {
            return parts;
        }
        let parts = parts.map(|parts| parts.into_iter().map(|part| bytes_of(&part)).collect());
        records_of(&self.exchange(parts)?)
    }

    /// Gathers the part of each rank on all ranks, by rank.
    pub(crate) fn gather_parts(&mut self, part: Result<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
        if self.size() == 1 {
            return part.map(|part| vec![part]);
        }
        let (part, error) = match part {
            Ok(part) => (flagged(part, WHOLE), None),
            Err(error) => (flagged(error.to_string().into_bytes(), FAILED), Some(error)),
        };
        let all = self.gather(&part).and_then(unflagged);
        error.map_or(all, Err)
    }

    /// Gathers the records of each rank on all ranks, by rank.
    pub(crate) fn gather_records<T: Pod>(
        &mut self,
        records: Result<Vec<T>>,
    ) -> Result<Vec<Vec<T>>> {
        if self.size() == 1 {
            return records.map(|records| vec![records]);
        }
        let part = records.map(|records| bytes_of(&records));
        records_of(&self.gather_parts(part)?)
    }

    /// Gathers a value of each rank on all ranks, by rank. Values are sent as JSON: their numbers must be finite.
    pub(crate) fn gather_values<T: Serialize + DeserializeOwned>(
        &mut self,
        own: T,
    ) -> Result<Vec<T>> {
        if self.size() == 1 {
            return Ok(vec![own]);
        }
        let all = self.gather_parts(Ok(json(&own)))?;
        all.iter().map(|part| of_json(part)).collect()
    }

    /// Gathers the bytes of each rank on the first rank; other ranks get empty parts.
    pub(crate) fn gather_on_first(&mut self, own: Result<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
        let size = self.size();
        let parts = own.map(|own| {
            let mut parts = vec![Vec::new(); size];
            parts[0] = own;
            parts
        });
        self.exchange(parts)
    }

    /// Broadcasts the bytes of a rank to all ranks.
    ///
    /// - `own`: `None` on other ranks.
    pub(crate) fn broadcast(
        &mut self,
        from: usize,
        own: Result<Option<Vec<u8>>>,
    ) -> Result<Vec<u8>> {
        let size = self.size();
        let parts = own.map(|own| vec![own.unwrap_or_default(); size]);
        Ok(self.exchange(parts)?.swap_remove(from))
    }

    /// Broadcasts a value of the first rank to all ranks, as JSON.
    ///
    /// - `own`: `None` on other ranks.
    pub(crate) fn broadcast_value<T: Serialize + DeserializeOwned>(
        &mut self,
        own: Result<Option<T>>,
    ) -> Result<T> {
        if self.size() == 1 {
            return own?.ok_or_else(|| unknown("no value"));
        }
        let own = own.map(|own| own.map(|own| json(&own)));
        of_json(&self.broadcast(0, own)?)
    }

    /// Reduces the records of all ranks, place by place; each rank reduces a part of the places.
    ///
    /// - `own`: as many records on every rank.
    pub(crate) fn reduce<T: Pod>(
        &mut self,
        own: Result<Vec<T>>,
        join: impl Fn(&mut T, &T),
    ) -> Result<Vec<T>> {
        let size = self.size();
        if size == 1 {
            return own;
        }
        let parts = own.map(|own| {
            let part = |rank| own[share(own.len(), size, rank)].to_vec();
            (0..size).map(part).collect()
        });
        let mut parts = self.exchange_records(parts)?.into_iter();
        let mut all = parts.next().unwrap_or_default();
        for part in parts {
            for (sum, own) in all.iter_mut().zip(&part) {
                join(sum, own);
            }
        }
        Ok(self.gather_records(Ok(all))?.concat())
    }

    /// Returns the sums of the ranks' numbers, place by place.
    ///
    /// - `own`: as many numbers on every rank.
    pub(crate) fn sums(&mut self, own: Result<Vec<u64>>) -> Result<Vec<u64>> {
        self.reduce(own, |sum, own| *sum += own)
    }

    /// Returns the sum of the ranks' numbers.
    pub(crate) fn sum(&mut self, own: Result<u64>) -> Result<u64> {
        Ok(self.gather_one(own)?.iter().sum())
    }

    /// Returns the sum of the numbers of all ranks before this one.
    pub(crate) fn sum_before(&mut self, own: Result<u64>) -> Result<u64> {
        Ok(self.gather_one(own)?[..self.rank()].iter().sum())
    }

    /// Returns the exact sum of the ranks' sums.
    pub(crate) fn exact_sum(&mut self, own: ExactSum) -> Result<ExactSum> {
        if self.size() == 1 {
            return Ok(own);
        }
        let mut all = ExactSum::default();
        for own in self.gather_records(Ok(own.to_limbs()))? {
            if let Some(own) = ExactSum::of_limbs(&own) {
                all.add_all(own);
            }
        }
        Ok(all)
    }

    /// Returns true if `own` is true on any rank.
    pub(crate) fn any(&mut self, own: bool) -> Result<bool> {
        Ok(self.sum(Ok(u64::from(own)))? > 0)
    }

    /// Returns the greatest of the ranks' numbers, place by place.
    pub(crate) fn max<const N: usize>(&mut self, own: [f32; N]) -> Result<[f32; N]>
    where
        [f32; N]: Pod,
    {
        let all = self.gather_one(Ok(own))?.into_iter();
        let greatest = |a: [f32; N], b: [f32; N]| std::array::from_fn(|n| a[n].max(b[n]));
        Ok(all.reduce(greatest).unwrap_or(own))
    }

    /// Returns the least of the ranks' numbers.
    pub(crate) fn min(&mut self, own: f64) -> Result<f64> {
        Ok(self.gather_one(Ok(own))?.into_iter().fold(own, f64::min))
    }

    /// Returns the result of this rank if all ranks have one.
    ///
    /// # Errors
    /// The rank's own error, or that of the first rank without a result.
    pub(crate) fn agree<T>(&mut self, result: Result<T>) -> Result<T> {
        if self.size() == 1 {
            return result;
        }
        let mut value = None;
        let part = result.map(|own| {
            value = Some(own);
            Vec::new()
        });
        self.gather_parts(part)?;
        value.ok_or(Error::Cancelled)
    }

    /// Returns the first rank whose number differs from the first rank's.
    pub(crate) fn first_other(&mut self, own: u64) -> Result<Option<usize>> {
        let all = self.gather_one(Ok(own))?;
        Ok(all.iter().position(|other| *other != all[0]))
    }

    /// Gathers one record of each rank on all ranks.
    pub(crate) fn gather_one<T: Pod>(&mut self, own: Result<T>) -> Result<Vec<T>> {
        Ok(self.gather_records(own.map(|own| vec![own]))?.concat())
    }
}

/// Returns a rank's share of `count` things.
pub(crate) fn share(count: usize, size: usize, rank: usize) -> Range<usize> {
    rank * count / size..(rank + 1) * count / size
}

/// Returns records as bytes, with room for the flag.
fn bytes_of<T: Pod>(records: &[T]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(size_of_val(records) + 1);
    bytes.extend_from_slice(bytemuck::cast_slice(records));
    bytes
}

fn records_of<T: Pod>(parts: &[Vec<u8>]) -> Result<Vec<Vec<T>>> {
    let records = |part: &Vec<u8>| {
        // Records of no bytes are none.
        let is_whole = part.len().is_multiple_of(size_of::<T>().max(1));
        is_whole
            .then(|| bytemuck::pod_collect_to_vec(part))
            .ok_or_else(|| unknown("a part of a record"))
    };
    parts.iter().map(records).collect()
}

fn json<T: Serialize>(own: &T) -> Vec<u8> {
    serde_json::to_vec(own).unwrap_or_default()
}

fn of_json<T: DeserializeOwned>(part: &[u8]) -> Result<T> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_rank_gets_its_own_arguments_back() {
        let ranks: &mut dyn Collective = &mut Alone::default();
        let part = vec![1, 2, 3];
        let place = part.as_ptr();
        let parts = ranks.exchange(Ok(vec![part])).unwrap();
        assert_eq!((parts.len(), parts[0].as_ptr()), (1, place));
        let records = ranks.gather_records(Ok(parts.concat())).unwrap();
        assert_eq!(records, [[1, 2, 3]]);
        assert_eq!(ranks.sums(Ok(vec![4, 5])).unwrap(), [4, 5]);
        assert_eq!(ranks.sum_before(Ok(7)).unwrap(), 0);
        assert!(ranks.any(true).unwrap() && !ranks.any(false).unwrap());
        assert_eq!(ranks.max([1.5, -2.0]).unwrap(), [1.5, -2.0]);
        assert_eq!(ranks.agree(Ok("own")).unwrap(), "own");
        assert!(ranks.agree::<()>(Err(Error::Cancelled)).is_err());
        assert_eq!(ranks.gather_values(f64::NAN).unwrap().len(), 1);
        assert_eq!(ranks.broadcast(0, Ok(Some(vec![9]))).unwrap(), [9]);
        ranks.begin_exchange(Ok(vec![vec![8]])).unwrap();
        assert_eq!(ranks.complete_exchange().unwrap(), [[8]]);
        assert!(ranks.complete_exchange().is_err());
    }
}
