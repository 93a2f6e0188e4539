//! Quantises numbers to a codebook of 256.

use super::meta::Levels;

/// Number of groups of equal width, and of equal count, into which numbers are divided before the division into
/// levels.
const GROUPS: usize = 2048;

/// Power of a group's count that is its weight, so that the few outlying numbers, the largest splats among
/// them, get more than one level.
const WEIGHT: f64 = 0.5;

/// A codebook of 256 ascending numbers near to all values: the means of 256 runs of groups, with the least
/// squared error by the groups' weights. If there are no more than 256 different values, the codebook has
/// exactly these.
///
/// - `values`: finite.
pub(super) fn codebook(mut values: Vec<f32>) -> Levels {
    values.sort_unstable_by(f32::total_cmp);
    let mut distinct = values.clone();
    distinct.dedup();
    let Some(&most) = values.last() else {
        return [0.0; 256];
    };
    let mut levels = [most; 256];
    if distinct.len() <= levels.len() {
        levels[..distinct.len()].copy_from_slice(&distinct);
        return levels;
    }
    let sums = Sums::of(&values);
    let mut start = 0;
    for (level, end) in levels.iter_mut().zip(sums.best_ends()) {
        // If there are fewer groups than levels, some levels are left over.
        if end > start {
            *level = sums.mean(start, end);
        }
        start = end;
    }
    levels.sort_unstable_by(f32::total_cmp);
    levels
}

/// Sums over the first groups: of weights, and of weighted means and their squares, relative to the mean of
/// all.
struct Sums {
    mean: f64,
    weights: Vec<f64>,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Sums {
    fn of(values: &[f32]) -> Self {
        let mean_of = |values: &[f32]| {
            values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
        };
        let mean = mean_of(values);
        let mut sums = Self {
            mean,
            weights: vec![0.0],
            first: vec![0.0],
            second: vec![0.0],
        };
        let add = |sums: &mut Vec<f64>, x: f64| sums.push(sums.last().unwrap_or(&0.0) + x);
        let mut start = 0;
        for end in groups(values) {
            let weight = ((end - start) as f64).powf(WEIGHT);
            let above = mean_of(&values[start..end]) - mean;
            add(&mut sums.weights, weight);
            add(&mut sums.first, weight * above);
            add(&mut sums.second, weight * above * above);
            start = end;
        }
        sums
    }

    #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 numbers")]
    fn mean(&self, start: usize, end: usize) -> f32 {
        let sum = self.first[end] - self.first[start];
        (self.mean + sum / (self.weights[end] - self.weights[start])) as f32
    }

    /// The squared deviation of some groups from their mean.
    fn deviation(&self, start: usize, end: usize) -> f64 {
        let weight = self.weights[end] - self.weights[start];
        let sum = self.first[end] - self.first[start];
        let squares = self.second[end] - self.second[start];
        if weight > 0.0 {
            (squares - sum * sum / weight).max(0.0)
        } else {
            0.0
        }
    }

    /// Ends of the groups of each of 256 levels, with the least squared error. Dynamic programming: the later a
    /// run ends, the later its best start.
    fn best_ends(&self) -> Vec<usize> {
        let count = self.weights.len();
        let mut errors: Vec<f64> = (0..count).map(|end| self.deviation(0, end)).collect();
        let mut begins_of_runs = Vec::new();
        for _ in 1..256 {
            let mut next = vec![(0.0, 0); count];
            // Ranges of ends, with the range of starts for each.
            let mut open = vec![(0, count, 0, count)];
            while let Some((first, last, least, most)) = open.pop() {
                if first >= last {
                    continue;
                }
                let end = usize::midpoint(first, last);
                let best = (least..most.min(end + 1))
                    .map(|begin| (errors[begin] + self.deviation(begin, end), begin))
                    .min_by(|a, b| a.0.total_cmp(&b.0));
                let Some(best) = best else { continue };
                next[end] = best;
                open.push((first, end, least, best.1 + 1));
                open.push((end + 1, last, best.1, most));
            }
            errors = next.iter().map(|n| n.0).collect();
            begins_of_runs.push(next.into_iter().map(|n| n.1).collect::<Vec<_>>());
        }
        let mut end = count - 1;
        let mut ends = vec![end];
        for begins in begins_of_runs.iter().rev() {
            end = begins[end];
            ends.push(end);
        }
        ends.reverse();
        ends
    }
}

/// Ends of groups. Groups are no wider than one part in [`GROUPS`] of the range, and have at most that share of
/// the numbers: neither a few outlying numbers nor many close ones make the groups coarse.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of few groups"
)]
fn groups(values: &[f32]) -> Vec<usize> {
    let [least, most] = [values[0], values[values.len() - 1]].map(f64::from);
    let group = |i: usize| {
        let share = (f64::from(values[i]) - least) / (most - least);
        let of_width = (share * GROUPS as f64) as usize;
        (of_width, i * GROUPS / values.len())
    };
    let inner = (1..values.len()).filter(|&i| group(i) != group(i - 1));
    inner.chain([values.len()]).collect()
}

fn middle(a: f32, b: f32) -> f32 {
    0.5 * a + 0.5 * b
}

/// The index of the level nearest to a value.
pub(super) fn nearest(levels: &Levels, value: f32) -> u8 {
    let above = levels.partition_point(|&level| level < value);
    let below = above.saturating_sub(1);
    let last = levels.len() - 1;
    let nearest = if value <= middle(levels[below], levels[above.min(last)]) {
        below
    } else {
        above.min(last)
    };
    u8::try_from(nearest).unwrap_or(u8::MAX)
}

#[cfg(test)]
mod tests {
    #![allow(
        clippy::cast_possible_truncation,
        reason = "numbers of a test are narrowed on purpose"
    )]

    use super::*;

    fn rms(values: &[f32], levels: &Levels) -> f64 {
        let error = |v: &f32| f64::from(v - levels[usize::from(nearest(levels, *v))]).powi(2);
        (values.iter().map(error).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn few_numbers_are_kept() {
        let values = vec![3.0, -1.0, 3.0, 0.5];
        let levels = codebook(values.clone());
        assert_eq!(levels[..4], [-1.0, 0.5, 3.0, 3.0]);
        assert!(rms(&values, &levels) <= 0.0);
        assert_eq!(codebook(Vec::new()), [0.0; 256]);
    }

    /// For evenly distributed numbers the best levels are even, with an rms error of 1 / sqrt 12 of a step. For
    /// a normal density the least error follows from Panter and Dite's integral, sqrt(pi sqrt 3 / 2) / 256 of
    /// its deviation; the weights use some of the levels for the tails.
    #[test]
    fn errors_are_nearly_as_small_as_can_be() {
        let even: Vec<f32> = (0..100_000).map(|i| i as f32 / 100_000.0).collect();
        let found = rms(&even, &codebook(even.clone())) * 256.0 * 12_f64.sqrt();
        assert!((0.999..1.02).contains(&found), "{found}");

        // A sum of twelve even numbers is nearly normal, without its tails.
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let normal: Vec<f32> = (0..100_000)
            .map(|_| ((0..12).map(|_| random()).sum::<f64>() - 6.0) as f32)
            .collect();
        let levels = codebook(normal.clone());
        let found = rms(&normal, &levels) * 256.0 / 2.72_f64.sqrt();
        assert!((0.9..1.2).contains(&found), "{found}");
        let error = |v: &f32| (v - levels[usize::from(nearest(&levels, *v))]).abs();
        let most = normal.iter().map(error).fold(0.0, f32::max);
        assert!(most < 0.1, "{most}");
    }

    #[test]
    fn the_nearest_level_is_found() {
        let mut levels = [10.0; 256];
        levels[..3].copy_from_slice(&[-2.0, 0.0, 1.0]);
        for (value, expected) in [
            (-9.0, -2.0),
            (-0.9, 0.0),
            (0.6, 1.0),
            (5.6, 10.0),
            (99.0, 10.0),
        ] {
            let found = levels[usize::from(nearest(&levels, value))];
            assert_eq!(found, expected, "{value}");
        }
    }
}
