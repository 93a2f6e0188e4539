//! Builds palettes: sets of harmonics that many splats share.
//!
//! Equal sets count as one. The sets are divided in two along their widest axis, then each part again, until
//! there are as many parts as palette entries. Each entry is the mean of a part. At each division the entries
//! are split between the parts by the error left in each, and the plane between them is moved as in k-means
//! with two clusters. Nothing is random, and parts are divided in parallel.

use std::collections::HashMap;

use rayon::prelude::*;

/// Greatest number of a set's components: three colours of fifteen harmonics.
const MOST_COMPONENTS: usize = 45;

/// Power of a part's squared deviations by which it gets entries: d / (d + 2) for sets that fill about eight
/// dimensions.
const SHARE: f64 = 0.8;

/// Number of times that the plane between two parts is moved.
const MOVES: usize = 4;

/// Greatest depth of divisions: sets closer together than that stay in one part.
const MOST_ROUNDS: usize = 64;

/// A palette, and the entry of each set.
pub(super) struct Palette {
    /// The components of all entries, concatenated.
    pub(super) entries: Vec<f32>,
    /// The entry of each set.
    pub(super) labels: Vec<u16>,
}

/// Sets of numbers, concatenated.
#[derive(Clone, Copy)]
struct Sets<'a> {
    numbers: &'a [f32],
    components: usize,
    /// Number of splats with each set, stored at the first of equal sets.
    counts: &'a [u32],
}

/// Some of the sets, and the number of palette entries for them.
struct Part {
    members: Vec<u32>,
    entries: usize,
}

/// The sums of some sets and of their squares.
struct Sums {
    count: f64,
    first: [f64; MOST_COMPONENTS],
    second: [f64; MOST_COMPONENTS],
}

/// A palette of at most `most` entries for sets of `components` numbers.
///
/// - `numbers`: the sets, concatenated; fewer than 2^32 sets.
/// - `most`: from 1 to 65,536.
pub(super) fn palette(numbers: &[f32], components: usize, most: usize) -> Palette {
    let count = numbers.len() / components;
    let (firsts, counts) = distinct(numbers, components);
    let sets = Sets {
        numbers,
        components,
        counts: &counts,
    };
    let mut members = firsts.clone();
    members.sort_unstable();
    members.dedup();
    let mut parts = vec![Part {
        members,
        entries: most,
    }];
    for _ in 0..MOST_ROUNDS {
        if parts.iter().all(|part| part.entries <= 1) {
            break;
        }
        parts = parts
            .into_par_iter()
            .flat_map_iter(|part| sets.divide(part))
            .collect();
    }
    let mut palette = Palette {
        entries: Vec::with_capacity(parts.len() * components),
        labels: vec![0; count],
    };
    for (part, label) in parts.iter().zip(0..=u16::MAX) {
        let mean = sets.sums(&part.members).mean();
        palette.entries.extend(&mean[..components]);
        for &member in &part.members {
            palette.labels[member as usize] = label;
        }
    }
    for (i, &first) in firsts.iter().enumerate() {
        palette.labels[i] = palette.labels[first as usize];
    }
    palette
}

/// The first equal set of each set, and how many sets are equal to each of those.
fn distinct(numbers: &[f32], components: usize) -> (Vec<u32>, Vec<u32>) {
    let mut seen: HashMap<Vec<u32>, u32> = HashMap::new();
    let sets = numbers.chunks_exact(components).zip(0..);
    let mut counts = vec![0; numbers.len() / components];
    let firsts = sets
        .map(|(set, i)| {
            // 0 and -0 differ, which does no harm.
            let bits = set.iter().map(|x| x.to_bits()).collect();
            let first = *seen.entry(bits).or_insert(i);
            counts[first as usize] += 1;
            first
        })
        .collect();
    (firsts, counts)
}

impl<'a> Sets<'a> {
    fn get(self, member: u32) -> &'a [f32] {
        let start = member as usize * self.components;
        &self.numbers[start..start + self.components]
    }

    fn sums(self, members: &[u32]) -> Sums {
        let mut sums = Sums::default();
        members
            .iter()
            .for_each(|&m| sums.add(self.get(m), self.counts[m as usize]));
        sums
    }

    /// Divides a part in two. A part with one entry, or without any error left, stays whole; if there are
    /// entries for all its sets, each set becomes a part.
    fn divide(self, part: Part) -> Vec<Part> {
        let Part {
            mut members,
            entries,
        } = part;
        let whole = self.sums(&members);
        if entries <= 1 || whole.deviation() <= 0.0 {
            return vec![Part {
                members,
                entries: 1,
            }];
        }
        if entries >= members.len() {
            let alone = |member| Part {
                members: vec![member],
                entries: 1,
            };
            return members.into_iter().map(alone).collect();
        }
        let (axis, middle) = whole.widest();
        let mut sides = self.two_sums(&members, |set| f64::from(set[axis]) > middle);
        for _ in 0..MOVES {
            let [below, above] = &sides;
            let moved = self.two_sums(&members, between(below, above));
            if moved.iter().any(|side| side.count < 1.0) {
                break;
            }
            sides = moved;
        }
        let is_above = between(&sides[0], &sides[1]);
        members.sort_by_key(|&m| is_above(self.get(m)));
        let first = members.partition_point(|&m| !is_above(self.get(m)));
        let above = members.split_off(first);
        if members.is_empty() || above.is_empty() {
            members.extend(above);
            return vec![Part {
                members,
                entries: 1,
            }];
        }
        let gains = [&members, &above].map(|m| self.sums(m).deviation().powf(SHARE));
        let share = gains[0] / (gains[0] + gains[1]);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of some entries"
        )]
        let own = (share * entries as f64).round() as usize;
        // Neither part gets more entries than it has members, nor none.
        let own = own
            .max(entries.saturating_sub(above.len()))
            .clamp(1, entries - 1)
            .min(members.len());
        let rest = entries - own;
        vec![
            Part {
                members,
                entries: own,
            },
            Part {
                members: above,
                entries: rest,
            },
        ]
    }

    /// The sums of the sets that are not above, and of those that are.
    fn two_sums(self, members: &[u32], is_above: impl Fn(&[f32]) -> bool) -> [Sums; 2] {
        let mut sides = [Sums::default(), Sums::default()];
        for &member in members {
            let set = self.get(member);
            sides[usize::from(is_above(set))].add(set, self.counts[member as usize]);
        }
        sides
    }
}

/// Whether a set is nearer to the second of two means.
fn between(below: &Sums, above: &Sums) -> impl Fn(&[f32]) -> bool + use<> {
    let [a, b] = [below.mean(), above.mean()];
    let pairs = || a.iter().zip(&b);
    let mut direction = [0.0; MOST_COMPONENTS];
    for (d, (a, b)) in direction.iter_mut().zip(pairs()) {
        *d = b - a;
    }
    let middle: f32 = pairs().map(|(a, b)| (b - a) * 0.5 * (a + b)).sum();
    move |set| {
        let along: f32 = set.iter().zip(&direction).map(|(x, d)| x * d).sum();
        along > middle
    }
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            count: 0.0,
            first: [0.0; MOST_COMPONENTS],
            second: [0.0; MOST_COMPONENTS],
        }
    }
}

impl Sums {
    fn add(&mut self, set: &[f32], times: u32) {
        let times = f64::from(times);
        self.count += times;
        let sums = self.first.iter_mut().zip(&mut self.second);
        for (&x, (first, second)) in set.iter().zip(sums) {
            let x = f64::from(x);
            *first += times * x;
            *second += times * x * x;
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 numbers")]
    fn mean(&self) -> [f32; MOST_COMPONENTS] {
        self.first.map(|sum| (sum / self.count) as f32)
    }

    /// The sums of squared deviations from the mean, for each component; 0 if only rounding is left.
    fn deviations(&self) -> [f64; MOST_COMPONENTS] {
        let mut deviations = [0.0; MOST_COMPONENTS];
        let sums = self.first.iter().zip(&self.second);
        for (deviation, (first, second)) in deviations.iter_mut().zip(sums) {
            let left = second - first * first / self.count;
            *deviation = if left > 1e-12 * second { left } else { 0.0 };
        }
        deviations
    }

    fn deviation(&self) -> f64 {
        self.deviations().iter().sum()
    }

    /// The component with the greatest deviation, and its mean.
    fn widest(&self) -> (usize, f64) {
        let deviations = self.deviations();
        let axes = 0..MOST_COMPONENTS;
        let widest = axes.fold(0, |m, i| if deviations[i] > deviations[m] { i } else { m });
        (widest, self.first[widest] / self.count)
    }
}
