//! Partitions the planes of a lattice (of constant k, the slowest index) among ranks, and exchanges them.

use std::ops::Range;

use bytemuck::Pod;

use crate::collective::Collective;
use crate::error::{Error, Result};
use crate::message::unknown;
use crate::scene::{Values, of_same_type};

/// Planes that stay together: whole bricks, and the longest cubes of levels of detail whose values are copied.
const LAYER: usize = 32;

/// Number of runs of planes on each rank, about: a view of a part of a lattice then meets planes of many ranks.
const RUNS: usize = 4;

/// Planes beside a run that a rank also needs: two layers around bricks, and one more because ghosts shift the lattice.
const BESIDE: usize = 3;

/// Bytes that are sent to a rank at a time.
const PARCEL: usize = 1 << 26;

/// Partition of a lattice's planes: ranks get runs in turn. If the lattice has ghosts, planes count from the first
/// ghost.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlaneRuns {
    /// The lattice's own planes.
    planes: usize,
    /// Number of planes in a run.
    len: usize,
    size: usize,
}

impl PlaneRuns {
    /// Partitions planes.
    ///
    /// - `planes`: number of planes of the lattice's own samples.
    /// - `size`: number of ranks.
    pub(crate) fn new(planes: usize, size: usize) -> Self {
        let layers = planes / (LAYER * RUNS * size);
        Self {
            planes,
            len: LAYER * layers.max(1),
            size,
        }
    }

    /// Returns the runs of a rank, of `planes` with ghosts or without; ascending.
    pub(super) fn runs(&self, planes: usize, rank: usize) -> impl Iterator<Item = Range<usize>> {
        let len = self.len;
        let first = (rank * len..planes).step_by(self.size * len);
        first.map(move |first| first..(first + len).min(planes))
    }

    /// Returns the lattice's own planes that a rank needs, with ghosts or without: its runs, and the planes beside
    /// them.
    pub(crate) fn wanted(&self, rank: usize) -> Vec<Range<usize>> {
        let runs = self.runs(self.planes + 2, rank);
        let mut wanted: Vec<Range<usize>> = Vec::new();
        for run in runs {
            let own = run.start.saturating_sub(BESIDE)..(run.end + BESIDE - 1).min(self.planes);
            match wanted.last_mut() {
                Some(last) if last.end >= own.start => last.end = own.end,
                _ => wanted.push(own),
            }
        }
        wanted
    }

    /// Returns the lattice's own planes in a rank's runs, which are among those that it needs. Those of all ranks are
    /// all planes, each once.
    pub(crate) fn own(&self, rank: usize) -> impl Iterator<Item = Range<usize>> {
        self.runs(self.planes, rank)
    }
}

/// Planes of a lattice: their values, one run after another.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Held {
    /// Runs of planes, in any order.
    pub(crate) runs: Vec<Range<usize>>,
    pub(crate) values: Values,
}

impl Held {
    /// Returns each run with the number of planes before it.
    fn starts(&self) -> impl Iterator<Item = (usize, &Range<usize>)> {
        self.runs.iter().scan(0, |before, run| {
            let start = *before;
            *before += run.len();
            Some((start, run))
        })
    }

    /// Returns the index of a plane among those that are here.
    pub(crate) fn place(&self, plane: usize) -> Option<usize> {
        let mut runs = self.starts();
        let (start, run) = runs.find(|(_, run)| run.contains(&plane))?;
        Some(start + plane - run.start)
    }

    /// Number of planes up to and including one; for ascending runs.
    pub(super) fn count_up_to(&self, plane: usize) -> usize {
        let of_run = |run: &Range<usize>| (plane + 1).clamp(run.start, run.end) - run.start;
        self.runs.iter().map(of_run).sum()
    }

    /// Exchanges planes, so that each rank gets those that it needs.
    ///
    /// - `samples`: number of samples in a plane.
    /// - `held`: runs that each rank holds; this rank's are here.
    /// - `wanted`: runs that each rank needs.
    ///
    /// # Errors
    /// A plane that no rank holds; a rank that is gone.
    pub(crate) fn collected(
        self,
        samples: usize,
        held: &[Vec<Range<usize>>],
        wanted: &[Vec<Range<usize>>],
        ranks: &mut dyn Collective,
    ) -> Result<Self> {
        if held == wanted {
            return Ok(self);
        }
        let traffic = Traffic { held, wanted };
        traffic.check()?;
        let rank = ranks.rank();
        let values = of_same_type!(&self.values, v => traffic.collect(&self, v, samples, ranks)?);
        Ok(Self {
            runs: wanted[rank].clone(),
            values,
        })
    }
}

/// Runs that all ranks hold and need.
struct Traffic<'a> {
    held: &'a [Vec<Range<usize>>],
    wanted: &'a [Vec<Range<usize>>],
}

fn has(runs: &[Range<usize>], plane: usize) -> bool {
    runs.iter().any(|run| run.contains(&plane))
}

impl Traffic<'_> {
    /// One past the last plane that any rank needs.
    fn end(&self) -> usize {
        let ends = self.wanted.iter().flatten().map(|run| run.end);
        ends.max().unwrap_or(0)
    }

    /// Returns the rank that sends a plane to a rank: the receiver itself, or the first rank that holds it.
    fn source(&self, to: usize, plane: usize) -> Option<usize> {
        if has(&self.held[to], plane) {
            return Some(to);
        }
        self.held.iter().position(|runs| has(runs, plane))
    }

    fn check(&self) -> Result<()> {
        let is_missing = |plane: &usize| !self.held.iter().any(|runs| has(runs, *plane));
        let planes = self.wanted.iter().flatten().flat_map(Clone::clone);
        let missing = planes.into_iter().find(is_missing);
        missing.map_or(Ok(()), |plane| {
            let advice = "give every plane to a rank";
            let expected = "all planes of a lattice";
            let found = format!("no rank that has plane {plane}");
            Err(Error::invalid(
                "scene",
                "shares of ranks",
                expected,
                found,
                advice,
            ))
        })
    }

    /// Returns the planes that this rank needs, one run after another.
    fn collect<T: Pod>(
        &self,
        own: &Held,
        values: &[T],
        samples: usize,
        ranks: &mut dyn Collective,
    ) -> Result<Vec<T>> {
        let (rank, size) = (ranks.rank(), ranks.size());
        let plane_of = |plane: usize| {
            let place = own.place(plane).unwrap_or(0);
            &values[place * samples..(place + 1) * samples]
        };
        let count: usize = self.wanted[rank].iter().map(Range::len).sum();
        let mut all = vec![T::zeroed(); count * samples];
        let targets = Held {
            runs: self.wanted[rank].clone(),
            values: Values::U8(Vec::new()),
        };
        let mut put = |plane: usize, own: &[T]| {
            for (start, run) in targets.starts() {
                if run.contains(&plane) {
                    let at = (start + plane - run.start) * samples;
                    all[at..at + samples].copy_from_slice(own);
                }
            }
        };
        // A plane may be sent to several ranks: memory holds a copy for each.
        let copies = |plane: usize| self.wanted.iter().filter(|own| has(own, plane)).count();
        let most = (0..self.end()).map(copies).max().unwrap_or(1);
        let step = (PARCEL / (most * samples * size_of::<T>()).max(1)).max(1);
        for first in (0..self.end()).step_by(step) {
            let planes = || first..first + step;
            let goes = |to: usize, plane: usize| {
                to != rank && has(&self.wanted[to], plane) && self.source(to, plane) == Some(rank)
            };
            let part = |to: usize| -> Vec<T> {
                let planes = planes().filter(|plane| goes(to, *plane));
                planes
                    .flat_map(|plane| plane_of(plane).iter().copied())
                    .collect()
            };
            let arrived = ranks.exchange_records(Ok((0..size).map(part).collect()))?;
            let mut taken = vec![0; size];
            for plane in planes().filter(|plane| has(&self.wanted[rank], *plane)) {
                let Some(from) = self.source(rank, plane) else {
                    continue;
                };
                if from == rank {
                    put(plane, plane_of(plane));
                    continue;
                }
                let at = taken[from];
                taken[from] += samples;
                match arrived[from].get(at..at + samples) {
                    Some(own) => put(plane, own),
                    None => return Err(unknown("others")),
                }
            }
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_all_are_all_planes_and_what_is_asked_for_holds_their_neighbours() {
        for (planes, size) in [(1, 1), (5, 3), (33, 2), (400, 3), (1000, 7), (9000, 16)] {
            let assigned = PlaneRuns::new(planes, size);
            for ghosts in [0, 2] {
                let mut owned = vec![0; planes + ghosts];
                for rank in 0..size {
                    let wanted = assigned.wanted(rank);
                    assert!(wanted.windows(2).all(|w| w[0].end < w[1].start));
                    for run in assigned.runs(planes + ghosts, rank) {
                        assert!(run.start.is_multiple_of(LAYER));
                        for plane in run.clone() {
                            owned[plane] += 1;
                        }
                        // Its own planes and two beside, if these are the lattice's own.
                        let first = (run.start + ghosts / 2).saturating_sub(2 + ghosts);
                        let end = (run.end + 2 - ghosts / 2).min(planes);
                        for plane in first..end {
                            assert!(has(&wanted, plane), "{plane} of {planes}, {size}");
                        }
                    }
                }
                assert!(owned.iter().all(|&n| n == 1));
            }
        }
    }
}
