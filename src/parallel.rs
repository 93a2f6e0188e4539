//! Spreads loops over threads.
//!
//! A parallel iterator compiles rayon's splitting once for each closure, some 1,900 lines of LLVM's code. These loops
//! call closures by reference, so that the splitting is compiled once. A call costs a nanosecond or two: short
//! loop bodies take chunks.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Calls `of` with each number below `count`.
pub(crate) fn each(count: usize, of: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(of);
}

/// Calls `of` with the number of each chunk of `size` elements, and the chunk.
pub(crate) fn chunks<T: Send>(all: &mut [T], size: usize, of: impl Fn(usize, &mut [T]) + Sync) {
    let chunks: Vec<Mutex<&mut [T]>> = all.chunks_mut(size.max(1)).map(Mutex::new).collect();
    each(chunks.len(), &|n| {
        let mut chunk = chunks[n].lock().unwrap_or_else(PoisonError::into_inner);
        of(n, &mut chunk);
    });
}

/// Calls `of` with each chunk as [`chunks`] does; returns the error of the first chunk that has one.
///
/// # Errors
/// The error of a call.
pub(crate) fn try_chunks<T: Send, E: Send>(
    all: &mut [T],
    size: usize,
    of: impl Fn(usize, &mut [T]) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let first: Mutex<Option<(usize, E)>> = Mutex::new(None);
    chunks(all, size, |n, chunk| {
        if let Err(error) = of(n, chunk) {
            let mut first = first.lock().unwrap_or_else(PoisonError::into_inner);
            if first.as_ref().is_none_or(|(before, _)| n < *before) {
                *first = Some((n, error));
            }
        }
    });
    match first.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some((_, error)) => Err(error),
        None => Ok(()),
    }
}

/// Returns `of(i)` for each `i` below `count`.
pub(crate) fn map<T: Send>(count: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_by(count, &of)
}

/// As [`map`], compiled once for each type of element.
fn map_by<T: Send>(count: usize, of: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    (0..count).into_par_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_element_is_made_once_and_the_first_error_is_returned() {
        for count in [0, 1, 63, 64, 10_000, 1_000_003] {
            let squares = map(count, |i| i as u64 * i as u64);
            assert_eq!(squares.len(), count);
            assert!((0..).zip(&squares).all(|(i, n)| *n == i * i));
            let mut all = vec![0; count];
            chunks(&mut all, 1000, |n, chunk| {
                chunk.iter_mut().for_each(|x| *x += 1 + n);
            });
            assert!(all.iter().enumerate().all(|(i, x)| *x == 1 + i / 1000));
            let refused = try_chunks(
                &mut all,
                10,
                |n, _| if n % 7 == 5 { Err(n) } else { Ok(()) },
            );
            assert_eq!(refused, if count > 50 { Err(5) } else { Ok(()) });
        }
    }
}
