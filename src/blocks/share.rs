//! Partitions the blocks of a scene among owners: each keeps all blocks, and the particles of some.

use std::ops::Range;

use super::points::Picking;
use super::room::MEMORY;
use crate::blocks::volume::{BlockedParticles, BlockedVolume};
use crate::error::Result;
use crate::scene::columns::Columns;

/// Number of runs of a volume's blocks for each owner, about: a view of a part of the scene then meets blocks of all
/// owners.
const RUNS: usize = 64;

/// Most blocks in a run.
const LONGEST_RUN: usize = 64;

/// Returns the blocks of a volume that one of several owners has: runs in turn, ascending.
///
/// - `first`: owner of the first run.
pub(crate) fn runs_in_turn(
    block_count: usize,
    owners: usize,
    owner: usize,
    first: usize,
) -> Vec<Range<u32>> {
    let len = (block_count / (RUNS * owners)).clamp(1, LONGEST_RUN);
    let turn = (owner + owners - first % owners) % owners;
    (turn * len..block_count)
        .step_by(owners * len)
        .map(|start| start as u32..(start + len).min(block_count) as u32)
        .collect()
}

impl BlockedVolume {
    /// Drops the particles of all but some blocks.
    ///
    /// The blocks themselves stay: the blocks that a frame draws do not depend on the partition of the particles. A
    /// lattice keeps its values, which neighbouring cells need. Mapped particles stay as they are: pages of other
    /// owners' particles are never read.
    ///
    /// - `own`: blocks to keep, ascending. Other blocks' particles must not be read afterwards.
    pub(super) fn keep(&mut self, own: &[Range<u32>]) -> Result<()> {
        if matches!(self.particles, BlockedParticles::Lattice(_)) || self.is_mapped() {
            return Ok(());
        }
        let mut order = Vec::new();
        let mut next = own.iter().cloned().flatten().peekable();
        for (i, block) in (0..).zip(&mut self.blocks) {
            let first = block.first;
            block.first = 0;
            if next.next_if_eq(&i).is_some() {
                block.first = order.len() as u32;
                order.extend(first..first + block.count);
            }
        }
        self.visit(&mut Picking {
            order: &order,
            room: MEMORY,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_all_owners_are_all_blocks() {
        for (blocks, owners) in [(0, 3), (1, 7), (5, 2), (1000, 1), (1000, 7), (100_000, 4)] {
            for first in 0..3 {
                let mut owned = vec![0; blocks];
                let mut most = 0;
                for owner in 0..owners {
                    let runs = runs_in_turn(blocks, owners, owner, first);
                    assert!(runs.windows(2).all(|w| w[0].end <= w[1].start));
                    let own: Vec<u32> = runs.into_iter().flatten().collect();
                    own.iter().for_each(|&i| owned[i as usize] += 1);
                    most = most.max(own.len());
                }
                assert!(owned.iter().all(|&n| n == 1));
                // At most one run more than other owners.
                assert!(most <= blocks / owners + LONGEST_RUN);
            }
        }
    }
}
