//! Numbers points over all ranks.

use crate::collective::Collective;
use crate::error::Result;
use crate::scene::rows::twice;

/// Size of the sample of numbers that each rank sends, by which they are cut into even parts.
const SAMPLE: usize = 1024;

/// Returns the number of each point among those of all ranks, from 0 on without gaps.
///
/// - `count`: number of points here.
/// - `given`: numbers whose order the result keeps, or `None` to number by rank.
///
/// # Errors
/// A number that occurs twice.
pub(super) fn without_gaps(
    count: usize,
    given: Option<Vec<u64>>,
    ranks: &mut dyn Collective,
) -> Result<Vec<u64>> {
    let Some(given) = given else {
        let first = ranks.sum_before(Ok(count as u64))?;
        return Ok((first..first + count as u64).collect());
    };
    let mut order: Vec<usize> = (0..given.len()).collect();
    order.sort_unstable_by_key(|&i| given[i]);
    let sorted: Vec<u64> = order.iter().map(|&i| given[i]).collect();
    let step = sorted.len().div_ceil(SAMPLE).max(1);
    let sample: Vec<u64> = sorted.iter().step_by(step).copied().collect();
    let mut sample = ranks.gather_records(Ok(sample))?.concat();
    sample.sort_unstable();
    // Each rank counts the numbers from one cut to the next.
    let size = ranks.size();
    let cut = |rank: usize| {
        let number = sample.get(rank * sample.len() / size).copied();
        let number = number.filter(|_| rank > 0 && rank < size);
        number.map_or(if rank == 0 { 0 } else { sorted.len() }, |number| {
            sorted.partition_point(|own| *own < number)
        })
    };
    let parts = (0..size).map(|rank| sorted[cut(rank)..cut(rank + 1)].to_vec());
    let asked = ranks.exchange_records(Ok(parts.collect()))?;
    let mut all: Vec<(u64, usize, usize)> = Vec::new();
    for (rank, asked) in asked.iter().enumerate() {
        let asked = asked.iter().enumerate();
        all.extend(asked.map(|(place, number)| (*number, rank, place)));
    }
    all.sort_unstable();
    let count = match all.windows(2).find(|w| w[0].0 == w[1].0) {
        Some(pair) => Err(twice(pair[0].0)),
        None => Ok(all.len() as u64),
    };
    let first = ranks.sum_before(count)?;
    let mut answers: Vec<Vec<u64>> = asked.iter().map(|own| vec![0; own.len()]).collect();
    for (number, (_, rank, place)) in (first..).zip(&all) {
        answers[*rank][*place] = number;
    }
    let answers = ranks.exchange_records(Ok(answers))?.concat();
    let mut numbers = vec![0; order.len()];
    for (i, number) in order.into_iter().zip(answers) {
        numbers[i] = number;
    }
    Ok(numbers)
}
