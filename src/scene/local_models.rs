//! Stores a linear model of the field over each kernel, so that a transfer function can be applied over the
//! kernel's extent and not to its value alone. A model takes six bytes per particle.
//!
//! | bits of a code | quantity | steps |
//! |---|---|---|
//! | 0 to 8, 9 to 17 | direction of the slope | octahedral coordinates, 510 steps from -1 to 1 |
//! | 18 to 27 | length of the slope | 0: none; 1023: the greatest, each step down 1/51 octave |
//! | 28 to 36, 37 | departure, its sign (1: below zero) | 0: none; 511: the greatest, each step down 1/25 octave |
//! | 38 to 42, 43 to 47 | range below and above | quarters of the slope's length, rounded up; 31: no bound |
//!
//! Errors at most: directions .0083 rad (axes are exact), lengths .68 %, departures 1.4 %. Lengths and
//! departures 2^20 times smaller than the greatest are stored as zero. Ranges are never too small.

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::storage::{Owned, Shared, Storage};
use super::transfer_function::LOBE_REACH;
use crate::error::Result;
use crate::math::{from_octahedral, to_octahedral};

/// Bits of each octahedral coordinate of a slope's direction.
pub(crate) const DIRECTION_BITS: u32 = 9;
/// Steps of a coordinate from -1 to 1: an even number, so that axes are among the directions.
pub(crate) const DIRECTION_STEPS: u32 = (1 << DIRECTION_BITS) - 2;
/// Bits of a slope's length.
pub(crate) const SLOPE_BITS: u32 = 10;
/// Steps of a slope's length per octave: twenty octaves in all.
pub(crate) const SLOPE_STEPS_PER_OCTAVE: u32 = 51;
/// Bits of a departure without its sign, which is the bit above.
pub(crate) const DEPARTURE_BITS: u32 = 9;
/// Steps of a departure per octave: twenty octaves in all.
pub(crate) const DEPARTURE_STEPS_PER_OCTAVE: u32 = 25;
/// Bits of the range below the value, and of that above.
pub(crate) const RANGE_BITS: u32 = 5;
/// Steps of a range per length of the slope.
pub(crate) const RANGE_STEPS: f32 = 4.0;

/// A range that a code cannot hold, or that is not known: it has no bound.
pub const NO_BOUND: f32 = f32::MAX;

/// The local linear model of a field over one kernel, whose variance is V = L Lᵀ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalModel {
    /// Lᵀ g \[value units\], g the field's gradient: the field's change over one standard deviation along each
    /// column of L. The length sqrt(gᵀ V g) is the standard deviation of the field's values over the kernel.
    pub slope: Vec3,
    /// Difference between the value at which masses are classified and the particle's own \[value units\]. It
    /// is tr(H V) / 2, which sharpens what sums of linear models blur (H: the field's second derivatives). If
    /// the kernel's centre c is not the sample's position x, g·(c - x) + (c - x)ᵀ H (c - x) / 2 is added.
    pub departure: f32,
    /// Distance of the least value around below the particle's own \[value units, from 0 up\]. Values outside
    /// the range value - below to value + above do not occur there, though the linear model reaches them.
    pub below: f32,
    /// Distance of the greatest value around above the particle's own.
    pub above: f32,
}

impl LocalModel {
    /// The model of a constant field.
    pub(crate) const NONE: Self = Self {
        slope: Vec3::ZERO,
        departure: 0.0,
        below: 0.0,
        above: 0.0,
    };

    /// Returns the range of values that a lobe of a kernel may have: the values around its sample, limited to the
    /// reach of its linear model.
    ///
    /// - `value`: the particle's own value.
    /// - `around`: least and greatest of the samples around.
    #[inline]
    pub(crate) fn reached(&self, value: f32, around: [f32; 2]) -> [f32; 2] {
        let middle = value + self.departure;
        let reach = LOBE_REACH * self.slope.length();
        [
            around[0].max(middle - reach).min(value),
            around[1].min(middle + reach).max(value),
        ]
    }
}

/// Local models in vectors.
pub type LocalModels = LocalModelsIn<Owned>;

/// Local models of a volume's particles, six bytes each; the module's documentation has their bits.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalModelsIn<S: Storage> {
    pub(super) codes: S::Of<[u16; 3]>,
    greatest_slope: f32,
    greatest_departure: f32,
}

impl LocalModels {
    /// Encodes one model per particle. Slopes and departures that are not finite become zero; ranges that are
    /// not finite become [`NO_BOUND`].
    pub fn new(models: &[LocalModel]) -> Self {
        Self::scaled(models).coded(models)
    }

    /// Encodes models with given scales: [`Self::scales_of`] of these models and others.
    pub(crate) fn with(models: &[LocalModel], scales: [f32; 2]) -> Self {
        Self::scaled(&[]).with_scales(scales).coded(models)
    }

    /// The greatest slope and the greatest departure of models.
    pub(crate) fn scales_of(models: &[LocalModel]) -> [f32; 2] {
        Self::scaled(models).scales()
    }

    /// Encodes the models with the present scales.
    fn coded(mut self, models: &[LocalModel]) -> Self {
        self.codes = models.par_iter().map(|m| self.code(m)).collect();
        self
    }

    /// No models, with the scales of these.
    fn scaled(models: &[LocalModel]) -> Self {
        let greatest = |of: &(dyn Fn(&LocalModel) -> f32 + Sync)| {
            let finite = models.par_iter().map(of).filter(|x| x.is_finite());
            finite.reduce(|| 0.0, f32::max)
        };
        Self {
            codes: Vec::new(),
            greatest_slope: greatest(&|model| length_of(model.slope)),
            greatest_departure: greatest(&|model| model.departure.abs()),
        }
    }

    /// Changes some models, and appends others.
    ///
    /// - `changes`: index of the particle, in any order (`None` appends), and its model.
    /// - `greatest`: returns the greatest of given scales and of those of all partitions.
    ///
    /// # Errors
    /// The errors of `greatest`.
    pub(crate) fn changed(
        mut self,
        changes: &[(Option<usize>, LocalModel)],
        greatest: &mut dyn FnMut([f32; 2]) -> Result<[f32; 2]>,
    ) -> Result<Self> {
        let models: Vec<LocalModel> = changes.iter().map(|(_, model)| *model).collect();
        let [slope, departure] = greatest(Self::scales_of(&models))?;
        if slope <= self.greatest_slope && departure <= self.greatest_departure {
            let codes: Vec<[u16; 3]> = models.par_iter().map(|m| self.code(m)).collect();
            self.codes.reserve_exact(count_appended(changes));
            for ((i, _), code) in changes.iter().zip(codes) {
                match i {
                    Some(i) => self.codes[*i] = code,
                    None => self.codes.push(code),
                }
            }
            return Ok(self);
        }
        let mut all = Vec::with_capacity(self.len() + count_appended(changes));
        (0..self.len())
            .into_par_iter()
            .map(|i| self.get(i))
            .collect_into_vec(&mut all);
        for (i, model) in changes {
            match i {
                Some(i) => all[*i] = *model,
                None => all.push(*model),
            }
        }
        let scales = greatest(Self::scales_of(&all))?;
        Ok(Self::with(&all, scales))
    }

    /// No models, with the same scales.
    pub(crate) fn emptied(&self) -> Self {
        Self {
            codes: Vec::new(),
            ..*self
        }
    }

    /// The same codes, with other scales.
    pub(crate) fn with_scales(self, [greatest_slope, greatest_departure]: [f32; 2]) -> Self {
        Self {
            greatest_slope,
            greatest_departure,
            ..self
        }
    }

    /// Converts the codes to a renderer's storage.
    pub(crate) fn shared(self) -> LocalModelsIn<Shared> {
        LocalModelsIn {
            codes: self.codes.into(),
            greatest_slope: self.greatest_slope,
            greatest_departure: self.greatest_departure,
        }
    }
}

impl<S: Storage> LocalModelsIn<S> {
    /// The models at `indices`, in that order.
    #[must_use]
    pub fn gather(&self, indices: &[u32]) -> Self {
        Self {
            codes: indices
                .iter()
                .map(|&i| self.codes[i as usize])
                .collect::<Vec<_>>()
                .into(),
            ..*self
        }
    }

    /// Makes models from [`Self::codes`] and [`Self::scales`] of others.
    #[cfg(feature = "prepared")]
    pub(crate) fn of_codes(
        codes: S::Of<[u16; 3]>,
        [greatest_slope, greatest_departure]: [f32; 2],
    ) -> Self {
        Self {
            codes,
            greatest_slope,
            greatest_departure,
        }
    }

    /// Number of models.
    pub fn len(&self) -> usize {
        self.codes.len()
    }

    /// Whether there are no models.
    pub fn is_empty(&self) -> bool {
        self.codes.is_empty()
    }

    /// The bits of each model, in words of sixteen, the lowest first.
    pub fn codes(&self) -> &[[u16; 3]] {
        &self.codes
    }

    /// The greatest length of a slope and the greatest departure up or down \[value units\]: references of the
    /// logarithmic codes.
    pub fn scales(&self) -> [f32; 2] {
        [self.greatest_slope, self.greatest_departure]
    }

    /// The greatest length of a slope \[value units\].
    pub fn greatest_slope(&self) -> f32 {
        self.greatest_slope
    }

    /// The model of particle `i`, in operations that shaders have too: integers, f32, and powers of two whose
    /// exponents lie between -1 and 0 or are whole.
    #[inline]
    pub fn get(&self, i: usize) -> LocalModel {
        let [low, middle, high] = self.codes[i].map(u64::from);
        let mut rest = low | middle << 16 | high << 32;
        #[expect(clippy::cast_possible_truncation, reason = "ten bits at most")]
        let mut take = |bits: u32| {
            let number = rest & ((1 << bits) - 1);
            rest >>= bits;
            number as u32
        };
        let coordinates = [take(DIRECTION_BITS), take(DIRECTION_BITS)];
        let coordinate = |step: u32| step as f32 * (2.0 / DIRECTION_STEPS as f32) - 1.0;
        let direction = from_octahedral(Vec2::from(coordinates.map(coordinate)));
        let slope = length(take(SLOPE_BITS), SLOPE, self.greatest_slope);
        let departure = length(take(DEPARTURE_BITS), DEPARTURE, self.greatest_departure);
        let is_below = take(1) == 1;
        let range = |steps: u32| {
            if steps < MOST_RANGE_STEPS {
                steps as f32 * (slope / RANGE_STEPS)
            } else {
                NO_BOUND
            }
        };
        LocalModel {
            slope: direction * slope,
            departure: if is_below { -departure } else { departure },
            below: range(take(RANGE_BITS)),
            above: range(take(RANGE_BITS)),
        }
    }

    /// The bits of a model.
    fn code(&self, model: &LocalModel) -> [u16; 3] {
        let direction = model.slope.as_dvec3().normalize_or(DVec3::Z);
        let coordinates = to_octahedral(direction.as_vec3());
        let half = DIRECTION_STEPS as f32 / 2.0;
        let [x, y] = (coordinates * half + half).round().as_uvec2().to_array();
        let slope = length_code(length_of(model.slope), SLOPE, self.greatest_slope);
        let departure = length_code(model.departure.abs(), DEPARTURE, self.greatest_departure);
        // Steps of the decoded slope.
        let step = length(slope, SLOPE, self.greatest_slope) / RANGE_STEPS;
        let mut bits = 0_u64;
        let mut count = 0;
        let mut put = |number: u32, width: u32| {
            bits |= u64::from(number) << count;
            count += width;
        };
        put(x, DIRECTION_BITS);
        put(y, DIRECTION_BITS);
        put(slope, SLOPE_BITS);
        put(departure, DEPARTURE_BITS);
        put(u32::from(departure > 0 && model.departure < 0.0), 1);
        put(range_code(model.below, step), RANGE_BITS);
        put(range_code(model.above, step), RANGE_BITS);
        #[expect(clippy::cast_possible_truncation, reason = "sixteen bits of them")]
        [0, 16, 32].map(|shift| (bits >> shift) as u16)
    }
}

/// Number of changes that append a model.
fn count_appended(changes: &[(Option<usize>, LocalModel)]) -> usize {
    changes.iter().filter(|(i, _)| i.is_none()).count()
}

/// Length of a vector; its square may exceed f32.
#[expect(
    clippy::cast_possible_truncation,
    reason = "rounding to f32; too great lengths become infinite, which is no slope"
)]
fn length_of(slope: Vec3) -> f32 {
    slope.as_dvec3().length() as f32
}

/// Logarithmic codes: the greatest, and steps in an octave.
type Scale = [u32; 2];
const SLOPE: Scale = [(1 << SLOPE_BITS) - 1, SLOPE_STEPS_PER_OCTAVE];
const DEPARTURE: Scale = [(1 << DEPARTURE_BITS) - 1, DEPARTURE_STEPS_PER_OCTAVE];
const MOST_RANGE_STEPS: u32 = (1 << RANGE_BITS) - 1;

/// The length of a code: `greatest` for the greatest code, 0 for 0.
#[inline]
fn length(code: u32, [most, per_octave]: Scale, greatest: f32) -> f32 {
    if code == 0 {
        return 0.0;
    }
    // Whole octaves separately: powers of two of greater exponents lose digits on some devices.
    let [octaves, steps] = [(most - code) / per_octave, (most - code) % per_octave];
    greatest * (-(steps as f32) / per_octave as f32).exp2() / (1_u32 << octaves) as f32
}

/// The code nearest to a length in ratio. It is 0 for a length that is not finite, too small for the codes, or
/// below f32's full precision, where shaders may flush to zero.
fn length_code(length: f32, [most, per_octave]: Scale, greatest: f32) -> u32 {
    if !(length >= 2.0 * f32::MIN_POSITIVE && length.is_finite()) {
        return 0;
    }
    let octaves = (f64::from(greatest) / f64::from(length)).log2();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "from 0 to 150 octaves"
    )]
    let steps = (octaves * f64::from(per_octave)).round() as u32;
    most.saturating_sub(steps)
}

/// Number of steps that cover `range`.
fn range_code(range: f32, step: f32) -> u32 {
    let reaches = |steps: &u32| range <= *steps as f32 * step;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "casts saturate, and NaN gives 0"
    )]
    let below = ((range / step) as u32).saturating_sub(1);
    // No number of steps covers NaN.
    (below..MOST_RANGE_STEPS)
        .find(reaches)
        .unwrap_or(MOST_RANGE_STEPS)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn model(slope: Vec3, departure: f32, below: f32, above: f32) -> LocalModel {
        LocalModel {
            slope,
            departure,
            below,
            above,
        }
    }

    /// Encodes and decodes a model beside one with the greatest slope and departure.
    fn coded(one: LocalModel, greatest: [f32; 2]) -> LocalModel {
        let scale = model(Vec3::X * greatest[0], greatest[1], 0.0, 0.0);
        LocalModels::new(&[scale, one]).get(1)
    }

    /// Half a step of 2 / 510 along each coordinate, sqrt(2) together, stretched by at most 3: in the middle of
    /// the octahedron's faces.
    const DIRECTION: f32 = 8.32e-3;
    /// 2^(1 / (2 x 51)) - 1.
    const LENGTH: f32 = 6.83e-3;
    /// 2^(1 / (2 x 25)) - 1.
    const HEIGHT: f32 = 1.397e-2;

    fn is_within(a: f32, b: f32, share: f32) -> bool {
        // f32's own rounding, some ten times.
        (a - b).abs() <= (share + 1e-6) * b.abs()
    }

    #[test]
    fn codes_fill_six_bytes() {
        let bits = 2 * DIRECTION_BITS + SLOPE_BITS + DEPARTURE_BITS + 1 + 2 * RANGE_BITS;
        assert_eq!(bits, 48);
        for [most, per_octave] in [SLOPE, DEPARTURE] {
            assert!(most > 20 * per_octave);
        }
    }

    #[test]
    fn directions_of_the_whole_sphere_survive() {
        let mut worst = 0.0_f32;
        for i in 0..20_000 {
            let (z, a) = (1.0 - (i as f32 + 0.5) / 10_000.0, 2.399_963 * i as f32);
            let r = (1.0 - z * z).sqrt();
            let slope = Vec3::new(r * a.cos(), r * a.sin(), z);
            let read = coded(model(slope, 0.0, 0.0, 0.0), [1.0, 0.0]).slope;
            worst = worst.max((read.normalize() - slope).length());
        }
        // The bound is attained, not only kept.
        assert!((0.8 * DIRECTION..DIRECTION).contains(&worst), "{worst}");
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            let read = coded(model(axis, 0.0, 0.0, 0.0), [1.0, 0.0]);
            assert_eq!(read.slope, axis);
        }
    }

    proptest! {
        #[test]
        fn models_survive_within_the_stated_errors(
            direction in prop::array::uniform3(-1.0_f32..1.0),
            down in 0.0_f32..19.9,
            departure_down in 0.0_f32..19.9,
            is_below in any::<bool>(),
            ranges in prop::array::uniform2(0.0_f32..12.0),
            greatest in -100.0_f32..100.0,
        ) {
            let unit = Vec3::from(direction).normalize_or(Vec3::Y);
            let (greatest, w) = (greatest.exp2(), (greatest - down).exp2());
            let departure = 3.0 * (-departure_down).exp2() * if is_below { -1.0 } else { 1.0 };
            let [below, above] = ranges.map(|r| r * w);
            let read = coded(model(unit * w, departure, below, above), [greatest, 3.0]);
            let read_w = length_of(read.slope);
            prop_assert!(is_within(read_w, w, LENGTH), "{read_w} {w}");
            prop_assert!((read.slope / read_w - unit).length() < DIRECTION);
            prop_assert!(is_within(read.departure, departure, HEIGHT));
            for (read, range) in [(read.below, below), (read.above, above)] {
                prop_assert!(read >= range);
                // A step of a quarter too much, or no bound if seven and a half are not enough.
                let most = if range < 7.4 * w { range + 0.26 * w } else { NO_BOUND };
                prop_assert!(read <= most, "{range} {read} {w}");
            }
        }
    }

    #[test]
    fn zero_and_what_is_too_small_are_zero() {
        let still = model(Vec3::ZERO, 0.0, 0.0, 0.0);
        assert_eq!(LocalModels::new(&[still]).get(0), still);
        assert_eq!(coded(still, [5.0, 5.0]), still);
        let small = model(Vec3::X * 1e-7, -1e-7, 0.0, 1e-9);
        // Quarters of a zero slope cover no range.
        let read = coded(small, [1.0, 1.0]);
        assert_eq!(read, model(Vec3::ZERO, 0.0, 0.0, NO_BOUND));
        // Shaders may flush numbers below f32's full precision to zero.
        let denormal = model(Vec3::Y * 1e-38, 1e-39, 0.0, 0.0);
        assert_eq!(LocalModels::new(&[denormal]).get(0), still);
    }

    #[test]
    fn what_is_not_finite_is_zero_or_without_bound() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let poison = model(Vec3::new(1.0, bad, 0.0), bad, f32::NAN, f32::INFINITY);
            let sound = model(Vec3::Z, -2.0, 0.0, 0.25);
            let models = LocalModels::new(&[poison, sound, sound]);
            let expected = model(Vec3::ZERO, 0.0, NO_BOUND, NO_BOUND);
            assert_eq!(models.get(0), expected);
            assert_eq!(models.get(1), sound);
            assert_eq!(models.scales(), [1.0, 2.0]);
        }
        let huge = model(Vec3::splat(f32::MAX), f32::MAX, f32::MAX, 0.0);
        let read = LocalModels::new(&[huge]).get(0);
        assert_eq!((read.slope, read.departure), (Vec3::ZERO, f32::MAX));
    }

    #[test]
    fn the_greatest_are_kept_and_gathered_models_read_the_same() {
        let models: Vec<LocalModel> = (0..40)
            .map(|i| {
                let x = i as f32;
                model(Vec3::new(x, 1.0 - x, 0.5 * x), 7.0 - x, 0.1 * x, x)
            })
            .collect();
        let coded = LocalModels::new(&models);
        assert_eq!((coded.len(), coded.is_empty()), (40, false));
        assert_eq!(coded.greatest_slope(), models[39].slope.length());
        assert_eq!(coded.scales()[1], 32.0);
        assert_eq!(coded.get(39).departure, -32.0);
        let gathered = coded.gather(&[39, 3, 3]);
        assert_eq!(gathered.codes().len(), 3);
        for (place, i) in [39, 3, 3].into_iter().enumerate() {
            assert_eq!(gathered.get(place), coded.get(i));
        }
        assert!(LocalModels::new(&[]).is_empty());
    }

    #[test]
    fn changed_models_read_as_if_all_were_new() {
        let of = |scale: f32| {
            let models = (0..30).map(|i| {
                let x = scale * i as f32;
                model(Vec3::new(x, 2.0 - x, 0.5), 3.0 - x, 0.2 * x, x)
            });
            models.collect::<Vec<_>>()
        };
        let all = of(1.0);
        let some = model(Vec3::new(0.1, -0.4, 0.2), -0.7, 0.3, 0.1);
        // Within the scales of the others, and beyond them.
        for other in [
            some,
            model(Vec3::Y * 90.0, 2.0, 0.0, 0.0),
            model(Vec3::X, -99.0, 1.0, 0.0),
        ] {
            let changes = [
                (Some(4), other),
                (None, some),
                (Some(0), some),
                (None, other),
            ];
            let changed = LocalModels::new(&all).changed(&changes, &mut Ok).unwrap();
            let mut truth = all.clone();
            (truth[4], truth[0]) = (other, some);
            truth.extend([some, other]);
            let scales = LocalModels::new(&truth).scales();
            for (a, b) in changed.scales().into_iter().zip(scales) {
                assert!(is_within(a, b, 0.0), "{a} {b}");
            }
            assert_eq!(changed.len(), 32);
            for (i, truth) in truth.iter().enumerate() {
                let read = changed.get(i);
                // Encoded twice if scales grow.
                let off = (read.slope - truth.slope).length();
                assert!(off <= 2.0 * (LENGTH + DIRECTION) * truth.slope.length());
                assert!(is_within(read.departure, truth.departure, 2.0 * HEIGHT));
                assert!(read.below >= truth.below && read.above >= truth.above);
            }
        }
    }

    /// The bits as the module's documentation has them: shaders read these.
    #[test]
    fn bits_lie_where_they_are_said_to() {
        let models = LocalModels::new(&[
            model(Vec3::Z * 4.0, 1.0, 0.0, 0.0),
            model(Vec3::X * 2.0, -0.5, 1.0, 9.0),
        ]);
        let [low, middle, high] = models.codes()[1].map(u64::from);
        let code = low | middle << 16 | high << 32;
        let field = |from: u64, bits: u64| code >> from & ((1 << bits) - 1);
        assert_eq!([field(0, 9), field(9, 9)], [510, 255]);
        assert_eq!(field(18, 10), 1023 - 51);
        assert_eq!([field(28, 9), field(37, 1)], [511 - 25, 1]);
        assert_eq!([field(38, 5), field(43, 5)], [2, 18]);
    }
}
