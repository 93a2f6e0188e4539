//! Stage: sorts the footprints, front to back.

use rdst::RadixSort;

use crate::record::Footprint;

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
    order.clear();
    order.extend(
        (0_u64..)
            .zip(footprints)
            .filter(|(_, f)| f.is_visible())
            .map(|(i, f)| u64::from(f.key) << 32 | i),
    );
    order.radix_sort_unstable();
}
