//! Stage: sorts the footprints, front to back.

use rayon::prelude::*;
use rdst::RadixSort;

use crate::record::Footprint;

/// Number of footprints that a task lists.
const CHUNK: usize = 1 << 14;

/// Returns the index of the footprint in a word of the sorted order.
#[inline]
pub fn footprint_index(word: u64) -> usize {
    word as u32 as usize
}

/// Writes the indices of visible footprints in order of their depth keys, ties by index. The low half of
/// each word is the index, the high half the key.
///
/// Key and index form one word, so any radix sort gives the same stable order.
pub fn sort(footprints: &[Footprint], order: &mut Vec<u64>) {
    list(footprints, |footprint| footprint.key, order);
    order.radix_sort_unstable();
}

/// Writes the indices of visible footprints in their own order, in the format of [`sort`].
pub fn list_visible(footprints: &[Footprint], order: &mut Vec<u64>) {
    list(footprints, |_| 0, order);
}

/// Writes a word for each visible footprint: its key, and its index.
fn list(footprints: &[Footprint], key: impl Fn(&Footprint) -> u32 + Sync, order: &mut Vec<u64>) {
    order.resize(footprints.len(), 0);
    let words = order
        .par_chunks_mut(CHUNK)
        .zip(footprints.par_chunks(CHUNK));
    let of_chunk = |(chunk, (words, footprints)): (usize, (&mut [u64], &[Footprint]))| {
        let mut words = words.iter_mut();
        let numbered = ((chunk * CHUNK) as u64..).zip(footprints);
        let visible = numbered.filter(|(_, f)| f.is_visible());
        let written = visible
            .zip(&mut words)
            .map(|((i, f), word)| *word = u64::from(key(f)) << 32 | i);
        written.count()
    };
    let counts: Vec<usize> = words.enumerate().map(of_chunk).collect();
    let mut end = 0;
    for (chunk, count) in counts.into_iter().enumerate() {
        let start = chunk * CHUNK;
        if end < start {
            order.copy_within(start..start + count, end);
        }
        end += count;
    }
    order.truncate(end);
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn visible_footprints_are_listed_in_their_order_and_sorted_by_key() {
        let footprint = |i: usize| Footprint {
            key: (i * 7919 % 1000) as u32,
            // Three in five are visible, and none of one whole chunk.
            rows: u32::from(i % 5 < 3 && i / CHUNK != 1) << 16,
            ..Footprint::zeroed()
        };
        for count in [0, 1, 4, CHUNK, 3 * CHUNK + 77] {
            let footprints: Vec<Footprint> = (0..count).map(footprint).collect();
            let visible = (0..count).filter(|&i| footprints[i].is_visible());
            let expected: Vec<usize> = visible.collect();
            assert!(count < 4 || !expected.is_empty());
            // Words of an earlier frame do not matter.
            let mut order = vec![u64::MAX; 100];
            list_visible(&footprints, &mut order);
            let listed = |order: &[u64]| -> Vec<usize> {
                order.iter().map(|&word| footprint_index(word)).collect()
            };
            assert_eq!(listed(&order), expected);
            let mut sorted = expected;
            sorted.sort_by_key(|&i| footprints[i].key);
            sort(&footprints, &mut order);
            assert_eq!(listed(&order), sorted);
        }
    }
}
