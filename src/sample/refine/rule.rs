//! Decides how often the dual cell of a node is split along each index.
//!
//! The linear model of a kernel misses r = |∂²f - g·∂²x| / 4 of the interpolant at half a cell along an index (a
//! kink), and the mixed part between two indices (a twist). Both shift the surfaces of equal value by r / |g|, of
//! which a picture shows r / |g| over the size of a pixel. A cell is split until that is below a threshold in
//! pixels, or r is small against the finest feature of the transfer function nearby; an iso-surface is a feature of
//! no width. Half the cell has a third of
//! a kink and half of a twist.

use glam::{DVec3, DVec4, Vec4Swizzles as _};

use super::neighbourhood::Neighbourhood;
use super::outline::Outline;
use crate::sample::surface::iso_surface::place_of;
use crate::scene::{PointVolume, TransferFunction};

/// Greatest level: an index is split into at most 2^this.
pub(super) const MOST_LEVEL: u8 = 4;

/// Share of a feature's width that the linear model may miss whatever the picture shows.
const FEATURE_SHARE: f64 = 0.1;

/// Least standard deviation of a kernel \[px\] that is worth drawing by itself.
const LEAST_SIGMA_PX: f64 = 0.5;

/// Share of the second difference of a face by which its tangent plane is off within a kernel's extent.
const FACE_BEND: f64 = 0.4;

/// An interval of values that a picture shows, and the width of the finest feature in it.
#[derive(Debug, Clone, Copy)]
struct Feature {
    interval: [f64; 2],
    /// Least interval of values in which extinction or colour change by half of their greatest, twice: the half
    /// width of a hat, almost nothing for a step.
    width: f64,
}

/// Values that a picture shows.
#[derive(Debug, Clone)]
pub(in crate::sample) struct ShownValues(Vec<Feature>);

impl ShownValues {
    /// Returns the values that pictures of a volume show: those of its transfer function, or that of an iso-surface.
    /// Returns `None` for a volume without a function.
    ///
    /// - `surface`: value of the iso-surface, if there is one.
    pub(in crate::sample) fn new(volume: &PointVolume, surface: Option<f64>) -> Option<Self> {
        let function = volume.transfer_function.as_ref()?;
        Some(match surface {
            Some(value) => Self::of_value(place_of(function, value)),
            None => Self::of_function(function),
        })
    }

    fn of_value(value: f64) -> Self {
        // Values that equal it count.
        let interval = [value.next_down(), value.next_up()];
        let width = 0.0;
        Self(vec![Feature { interval, width }])
    }

    pub(in crate::sample) fn of_function(function: &TransferFunction) -> Self {
        let table = function.table();
        let [low, high] = function.range().map(f64::from);
        let per_entry = (high - low) / (table.len() - 1) as f64;
        let lobes = function.shown();
        let features = lobes.lobes().iter().map(|lobe| {
            let [first, last] = lobe.interval.map(f64::from);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "places in tables are held to their ends"
            )]
            let entry = |value: f64| {
                let place = ((value - low) / per_entry).round();
                (place.max(0.0) as usize).min(table.len() - 1)
            };
            let entries = &table[entry(first)..=entry(last)];
            let [below, above] = lobe.beyond.map(|extinction| extinction > 0.0);
            Feature {
                interval: [
                    if below { f64::NEG_INFINITY } else { first },
                    if above { f64::INFINITY } else { last },
                ],
                width: 2.0 * per_entry * finest(entries),
            }
        });
        Self(features.collect())
    }
}

/// Splits cells for the values that a picture shows.
pub(in crate::sample) struct Rule {
    features: Vec<Feature>,
    /// Greatest displacement of a surface of equal value \[px\].
    pub(super) threshold_px: f64,
    /// Standard deviation of kernels over the spacing.
    pub(in crate::sample) kernel_width: f64,
}

impl Rule {
    pub(in crate::sample) fn new(
        shown: &ShownValues,
        threshold_px: f64,
        kernel_width: f64,
    ) -> Self {
        Self {
            features: shown.0.clone(),
            threshold_px,
            kernel_width,
        }
    }

    /// Returns true if any value in a range is shown.
    pub(in crate::sample) fn shows(&self, [low, high]: [f64; 2]) -> bool {
        let meets = |f: &Feature| low < f.interval[1] && high > f.interval[0];
        self.features.iter().any(meets)
    }

    /// Returns the width of the finest feature that a range of values meets.
    pub(in crate::sample) fn finest(&self, [low, high]: [f64; 2]) -> Option<f64> {
        let met = self
            .features
            .iter()
            .filter(|f| low < f.interval[1] && high > f.interval[0]);
        met.map(|f| f.width).reduce(f64::min)
    }

    /// Returns what the linear model misses over what it may miss.
    ///
    /// - `missed`: greatest difference of the values; `width`: width of the finest feature.
    /// - `steepness`: length of the field's gradient; `px`: pixels per world unit.
    pub(in crate::sample) fn excess(
        &self,
        missed: f64,
        width: f64,
        steepness: f64,
        px: f64,
    ) -> f64 {
        // Phrased so that a field without a slope is judged by its values alone.
        let shift = missed * px / steepness / self.threshold_px;
        let in_values = missed / (FEATURE_SHARE * width);
        if shift < in_values { shift } else { in_values }
    }

    /// Returns the level at which a kernel blurs jumps between values of cells by no more than the threshold.
    ///
    /// - `around`: least and greatest value of the cells side by side.
    /// - `jump`: greatest difference from the kernel's value; `sigma`: deviation of the kernel at level 0.
    pub(in crate::sample) fn jump_level(
        &self,
        around: [f64; 2],
        jump: f64,
        px: f64,
        sigma: f64,
    ) -> u8 {
        let Some(width) = self.finest(around) else {
            return 0;
        };
        let level = least_level(self.excess(jump, width, jump / sigma, px), 2.0);
        level.min(Self::most_level(sigma, px))
    }

    /// Returns the level at which a face that bends leaves its tangent plane by no more than the threshold.
    ///
    /// - `bend`: second difference of the face across the plane \[world units\].
    pub(in crate::sample) fn bend_level(&self, bend: f64, px: f64) -> u8 {
        least_level(FACE_BEND * bend.abs() * px / self.threshold_px, 4.0)
    }

    /// Returns the greatest level at which a kernel is not below half a pixel.
    ///
    /// - `sigma`: its deviation at level 0 \[world units\].
    pub(in crate::sample) fn most_level(sigma: f64, px: f64) -> u8 {
        narrowed_level((sigma * px / LEAST_SIGMA_PX).log2().floor())
    }

    /// Returns true only if [`Self::levels`] of a dual cell that no face cuts are zero; false decides nothing.
    pub(super) fn keeps_whole(&self, own: &Outline, px: f64) -> bool {
        /// Covers the roundings of gradients.
        const MARGIN: f64 = 1.01;
        self.finest(own.range)
            .is_none_or(|width| self.excess(MARGIN * own.missed, width, own.steepness, px) <= 1.0)
    }

    /// Returns the levels of a node's dual cell along each index.
    ///
    /// - `px`: pixels per world unit at the node.
    /// - `beside`: true for each index along which a face of the grid cuts the node's kernel.
    pub(super) fn levels(&self, cell: &Neighbourhood, px: f64, beside: [bool; 3]) -> [u8; 3] {
        let Some(width) = self.finest(cell.range) else {
            return [0; 3];
        };
        let place = cell.place([None; 3]);
        let Some((gradient, _)) = place.derivatives() else {
            return [0; 3];
        };
        let steepness = gradient.length();
        let excess = |missed: f64| self.excess(missed, width, steepness, px);
        let missed = |d: DVec4| (d.w - gradient.dot(d.xyz())).abs();
        let kink = |a: usize| excess(missed(cell.second(a)) / 4.0);
        let mut levels = [0, 1, 2].map(|a| least_level(kink(a), 3.0));
        let lengths = [0, 1, 2].map(|a| place.jacobian.col(a).length());
        for [a, b] in [[0, 1], [0, 2], [1, 2]] {
            let twist = cell
                .mixed([a, b])
                .map(missed)
                .into_iter()
                .fold(0.0, f64::max);
            let level = least_level(excess(twist), 2.0);
            let first = match levels[a].cmp(&levels[b]) {
                std::cmp::Ordering::Greater => a,
                std::cmp::Ordering::Less => b,
                std::cmp::Ordering::Equal if lengths[a] < lengths[b] => b,
                std::cmp::Ordering::Equal => a,
            };
            levels[first] = levels[first].max(level);
        }
        for a in (0..3).filter(|&a| beside[a]) {
            let [b, c] = [(a + 1) % 3, (a + 2) % 3];
            let normal = place.jacobian.col(b).cross(place.jacobian.col(c));
            let normal = normal.try_normalize().unwrap_or(DVec3::ZERO);
            for along in [b, c] {
                let bend = normal.dot(cell.second(along).xyz());
                levels[along] = levels[along].max(self.bend_level(bend, px));
            }
        }
        [0, 1, 2].map(|a| levels[a].min(Self::most_level(self.kernel_width * lengths[a], px)))
    }
}

/// Returns the least level l with `excess` <= `base`^l, at most [`MOST_LEVEL`].
pub(in crate::sample) fn least_level(excess: f64, base: f64) -> u8 {
    // Phrased so that NaN gives 0.
    if excess > 1.0 {
        narrowed_level((excess.ln() / base.ln()).ceil())
    } else {
        0
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "held to the range"
)]
fn narrowed_level(level: f64) -> u8 {
    level.min(f64::from(MOST_LEVEL)).max(0.0) as u8
}

/// Returns the least number of entries in which the extinction changes by half of its greatest, or a colour by
/// a half; all entries if neither does.
fn finest(entries: &[[f32; 4]]) -> f64 {
    let peak = entries
        .iter()
        .fold(0.0_f32, |peak, entry| peak.max(entry[3]));
    let mut least = entries.len();
    for (i, a) in entries.iter().enumerate() {
        let changes = |b: &[f32; 4]| {
            let shows = a[3].min(b[3]) >= 0.1 * peak;
            (b[3] - a[3]).abs() >= 0.5 * peak
                || (shows && (0..3).any(|c| (b[c] - a[c]).abs() >= 0.5))
        };
        let near = &entries[i + 1..entries.len().min(i + least)];
        if let Some(n) = near.iter().position(changes) {
            least = n + 1;
        }
    }
    least as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::field::gradient::Samples;

    fn hat(width: f32) -> TransferFunction {
        let opacity = move |v: f32| (1.0 - (v - 0.5).abs() / width).max(0.0) * 0.5;
        TransferFunction::from_curves(|_| [1.0; 3], opacity, [-1.0, 1.0], 1.0).unwrap()
    }

    fn levels(function: &TransferFunction, field: impl Fn(DVec3) -> f64, px: f64) -> [u8; 3] {
        levels_of(&ShownValues::of_function(function), field, px)
    }

    fn levels_of(shown: &ShownValues, field: impl Fn(DVec3) -> f64, px: f64) -> [u8; 3] {
        let samples = Samples {
            dims: [3; 3],
            periods: [None; 3],
            at: |n: [usize; 3]| {
                let index = DVec3::from(n.map(|i| i as f64 - 1.0));
                Some((index, field(index)))
            },
        };
        let cell = Neighbourhood::new(&samples, [1; 3]).unwrap();
        Rule::new(shown, 1.0, 0.6).levels(&cell, px, [false; 3])
    }

    #[test]
    fn features_are_as_wide_as_half_a_hat_and_steps_have_no_width() {
        let of = |function: &TransferFunction| ShownValues::of_function(function).0[0].width;
        // From half the extinction to its tip, twice; extinction is steeper than opacity at the tip.
        let hat = of(&hat(0.2));
        assert!((0.15..0.21).contains(&hat), "{hat}");
        let step = |v: f32| if v > 0.0 { 0.9 } else { 0.0 };
        let step = TransferFunction::from_curves(|_| [1.0; 3], step, [-1.0, 1.0], 1.0).unwrap();
        assert!(of(&step) < 2e-3);
        // Colours count where they show.
        let colour = |v: f32| {
            if v > 0.0 {
                [1.0, 0.0, 0.0]
            } else {
                [0.0, 0.0, 1.0]
            }
        };
        let flat = TransferFunction::from_curves(colour, |_| 0.3, [-1.0, 1.0], 1.0).unwrap();
        assert!(of(&flat) < 2e-3);
    }

    #[test]
    fn cells_are_split_where_the_field_bends_the_function_shows_and_a_pixel_sees_it() {
        let narrow = hat(0.05);
        let kink = |s: DVec3| 0.5 + if s.x > 0.0 { s.x } else { 0.2 * s.x };
        // The model is off by .2 of a cell at half a cell, .33 cells of its own slope: 33 px of 100.
        let [i, j, k] = levels(&narrow, kink, 100.0);
        assert!(i > 0 && j == 0 && k == 0, "{i} {j} {k}");
        assert_eq!(levels(&narrow, kink, 2.0), [0; 3]);
        assert_eq!(levels(&narrow, |s| 0.5 + s.x, 100.0), [0; 3]);
        assert_eq!(levels(&narrow, |s| kink(s) - 2.0, 100.0), [0; 3]);
        // A wide feature does not show a small kink.
        let slight = |s: DVec3| 0.5 + 0.02 * kink(s);
        assert!(levels(&narrow, slight, 1e4)[0] > 0 || levels(&hat(0.5), slight, 1e4) == [0; 3]);
        assert_eq!(levels(&hat(0.5), slight, 1e4), [0; 3]);
        // A twist.
        let [i, j, k] = levels(&narrow, |s| 0.5 + s.z + 0.8 * s.x * s.y, 100.0);
        assert!(i.max(j) > 0 && k == 0, "{i} {j} {k}");
        // An iso-surface shows a slight kink as well, and nothing where the field does not take its value.
        let surface = ShownValues::of_value(0.51);
        assert!(levels_of(&surface, slight, 1e4)[0] > 0);
        assert_eq!(levels_of(&surface, |s| kink(s) - 2.0, 1e4), [0; 3]);
        assert_eq!(levels_of(&surface, |s| 0.5 + s.x, 1e4), [0; 3]);
        // Pixels limit it.
        let few = levels(&narrow, kink, 4.0);
        assert!(few[0] <= 2, "{few:?}");
    }
}
