//! Finds a ball that contains almost all of the weight of a set of points.

use glam::DVec3;

/// Share of the weight that may lie outside.
const OUTSIDE: f64 = 0.005;

/// Margin, as a factor of the radius: a normal distribution of a million points extends that far beyond its
/// 99.5 % radius.
const MARGIN: f64 = 1.5;

/// Greatest weight of a point, in units of the median weight; larger weights are clamped.
const MOST: f64 = 64.0;

/// Greatest weight of a point, as a share of the number of points. One point tells little about the others, and
/// several may lie outside together.
const MOST_SHARE: f64 = OUTSIDE / 4.0;

/// Least number of points for a core: among fewer, none counts as stray.
const LEAST: usize = 64;

/// A ball that contains almost all of the weight of a set of points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Core {
    centre: DVec3,
    radius: f64,
}

impl Core {
    /// Returns the ball around the weighted medians of the coordinates that contains 99.5 % of the weight, with
    /// a margin. Returns `None` for few points, or if no point has a weight.
    ///
    /// Sums are of integers, so they do not depend on the order of the points.
    ///
    /// - `points`: finite positions, with weights from 0 up.
    pub(crate) fn of(points: &[(DVec3, f64)]) -> Option<Self> {
        /// The integer that represents the greatest weight.
        const UNITS: f64 = (1 << 24) as f64;
        if points.len() < LEAST {
            return None;
        }
        // Clamped, because a point that outweighs all others together would hide them.
        let mut all: Vec<f64> = points.iter().map(|(_, w)| *w).collect();
        let half = all.len() / 2;
        let median = *all.select_nth_unstable_by(half, f64::total_cmp).1;
        let most = if median > 0.0 {
            MOST.min(MOST_SHARE * points.len() as f64).max(1.0) * median
        } else {
            f64::MAX
        };
        let greatest = points
            .iter()
            .fold(0.0_f64, |all, (_, w)| all.max(w.min(most)));
        if !(greatest > 0.0 && greatest.is_finite()) {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "from 0 to 2^24"
        )]
        let weights: Vec<u64> = points
            .iter()
            .map(|(_, w)| (w.min(most) / greatest * UNITS).round() as u64)
            .collect();
        let median = |axis: usize| {
            let coordinates = points.iter().map(|(p, _)| p[axis]);
            quantile(coordinates, &weights, 0.5)
        };
        let centre = DVec3::new(median(0), median(1), median(2));
        let distances = points.iter().map(|(p, _)| p.distance(centre));
        let radius = MARGIN * quantile(distances, &weights, 1.0 - OUTSIDE);
        (centre.is_finite() && radius.is_finite()).then_some(Self { centre, radius })
    }

    /// Returns true if a point is in the ball.
    pub(crate) fn holds(&self, point: DVec3) -> bool {
        point.distance(self.centre) <= self.radius
    }
}

/// Returns the number below which a share of the weight lies, rounded up in its 21st binary digit.
fn quantile(numbers: impl Iterator<Item = f64> + Clone, weights: &[u64], share: f64) -> f64 {
    let total: u64 = weights.iter().sum();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a share of a number of 64 bits, in 53"
    )]
    let wanted = ((total as f64 * share).ceil() as u64).clamp(1, total.max(1));
    // Counts by the upper 16 of the upper 32 bits, then by the lower 16 of these.
    let [mut below, mut upper] = [0; 2];
    for digit in 0..2 {
        let mut counts = vec![0_u64; 1 << 16];
        for (number, weight) in numbers.clone().zip(weights) {
            let bits = ordered(number) >> 32;
            match digit {
                0 => counts[(bits >> 16) as usize] += weight,
                _ if bits >> 16 == upper => counts[(bits & 0xffff) as usize] += weight,
                _ => {}
            }
        }
        let mut place = 0;
        while place + 1 < counts.len() && below + counts[place] < wanted {
            below += counts[place];
            place += 1;
        }
        upper = upper << 16 | place as u64;
    }
    number_of(upper << 32 | 0xffff_ffff)
}

/// Maps a number to bits that sort like the numbers.
fn ordered(x: f64) -> u64 {
    let bits = x.to_bits();
    if bits >> 63 == 0 {
        bits | 1 << 63
    } else {
        !bits
    }
}

fn number_of(ordered: u64) -> f64 {
    f64::from_bits(if ordered >> 63 == 0 {
        !ordered
    } else {
        ordered & !(1 << 63)
    })
}
