//! Implements ranks that are threads of one process.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};

use crate::collective::Collective;
use crate::error::{Error, Result};

/// One of several ranks in one process; each belongs to a thread of its own.
///
/// ```
/// use ewa_splat::distributed::{Collective, ThreadRank};
///
/// let ranks = ThreadRank::group(3);
/// let sums = std::thread::scope(|scope| {
///     let work = |mut rank: ThreadRank| {
///         let own = u8::try_from(rank.rank()).unwrap_or(u8::MAX);
///         let all = rank.gather(&[own])?;
///         Ok(all.iter().map(|part| usize::from(part[0])).sum())
///     };
///     let threads: Vec<_> = ranks.into_iter().map(|r| scope.spawn(move || work(r))).collect();
///     threads.into_iter().map(|t| t.join().unwrap()).collect::<ewa_splat::Result<Vec<usize>>>()
/// });
/// assert_eq!(sums?, [3, 3, 3]);
/// # Ok::<(), ewa_splat::Error>(())
/// ```
#[derive(Debug)]
pub struct ThreadRank {
    rank: usize,
    /// Channels to each rank.
    to: Vec<Sender<Vec<u8>>>,
    /// Channels from each rank.
    from: Vec<Receiver<Vec<u8>>>,
    /// Parts that this rank sent to itself.
    own: VecDeque<Vec<u8>>,
}

impl ThreadRank {
    /// Creates `size` ranks, at least one, in their order.
    pub fn group(size: usize) -> Vec<Self> {
        let size = size.max(1);
        // Channels from each rank to each rank.
        let mut to = Vec::with_capacity(size);
        let mut from: Vec<Vec<Receiver<Vec<u8>>>> = Vec::new();
        from.resize_with(size, Vec::new);
        for _ in 0..size {
            let (senders, receivers): (Vec<_>, Vec<_>) = (0..size).map(|_| channel()).unzip();
            to.push(senders);
            for (from, receiver) in from.iter_mut().zip(receivers) {
                from.push(receiver);
            }
        }
        let ends = to.into_iter().zip(from).enumerate();
        ends.map(|(rank, (to, from))| Self {
            rank,
            to,
            from,
            own: VecDeque::new(),
        })
        .collect()
    }
}

impl Collective for ThreadRank {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.to.len()
    }

    fn begin(&mut self, parts: Vec<Vec<u8>>) -> Result<()> {
        for (rank, part) in parts.into_iter().enumerate() {
            if rank == self.rank {
                self.own.push_back(part);
            } else {
                // A rank that is gone is reported when a part is expected from it.
                let _ = self.to[rank].send(part);
            }
        }
        Ok(())
    }

    fn complete(&mut self) -> Result<Vec<Vec<u8>>> {
        let gone = |rank: usize| {
            Error::of_rank(
                rank,
                "it has ended before the others were done with it".into(),
            )
        };
        let own = self.rank;
        let mut parts = Vec::with_capacity(self.from.len());
        for (rank, from) in self.from.iter().enumerate() {
            let part = if rank == own {
                self.own.pop_front()
            } else {
                from.recv().ok()
            };
            parts.push(part.ok_or_else(|| gone(rank))?);
        }
        Ok(parts)
    }

    fn gather(&mut self, part: &[u8]) -> Result<Vec<Vec<u8>>> {
        self.begin(vec![part.to_vec(); self.size()])?;
        self.complete()
    }
}
