//! Chooses the ticks of a scale and their labels.

/// A tick at mantissa x 10^exponent: decimal, so that labels are free of rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tick {
    mantissa: i64,
    exponent: i32,
}

/// Steps between ticks, to be multiplied by a power of ten.
const STEPS: [i64; 3] = [1, 2, 5];

/// Greatest number of characters up to which a plain number is easier to read than one with an exponent.
const PLAIN_LEN: usize = 6;

/// Distance beyond an end, in steps, up to which a tick is kept. Ends are rounded to f32, and a range from
/// .100000001 should have the tick .1.
const SLACK: f64 = 1e-6;

/// A range narrower than this share of its values belongs to a field of one value, widened by a few steps of
/// f32.
const ONE_VALUE: f64 = 1e-6;

/// Returns the tick of a number rounded to six digits.
fn single(value: f64) -> Option<Tick> {
    let digits = format!("{value:.5e}");
    let (mantissa, exponent) = digits.split_once('e')?;
    let mut tick = Tick {
        mantissa: mantissa.replace('.', "").parse().ok()?,
        exponent: exponent.parse::<i32>().ok()? - 5,
    };
    while tick.exponent < 0 && tick.mantissa % 10 == 0 {
        tick.mantissa /= 10;
        tick.exponent += 1;
    }
    Some(tick)
}

impl Tick {
    /// Returns the number, correctly rounded if 10^|exponent| is a double (up to 22), otherwise within an ulp
    /// or two.
    pub(super) fn value(self) -> f64 {
        let power = 10_f64.powi(self.exponent.abs());
        if self.exponent < 0 {
            self.mantissa as f64 / power
        } else {
            self.mantissa as f64 * power
        }
    }

    /// Formats without an exponent: "0.25", "-1500".
    fn plain(self) -> String {
        match usize::try_from(-self.exponent) {
            Ok(decimals) if decimals > 0 => {
                let digits = format!("{:0width$}", self.mantissa.abs(), width = decimals + 1);
                let (whole, part) = digits.split_at(digits.len() - decimals);
                format!("{}{whole}.{part}", self.sign())
            }
            _ if self.mantissa == 0 => "0".into(),
            _ => {
                let zeros = usize::try_from(self.exponent).unwrap_or(0);
                format!("{}{}", self.mantissa, "0".repeat(zeros))
            }
        }
    }

    /// Formats with an exponent: "2.5e-7".
    fn scientific(self) -> String {
        if self.mantissa == 0 {
            return "0".into();
        }
        let all = self.mantissa.abs().to_string();
        let digits = all.trim_end_matches('0');
        let exponent = i64::from(self.exponent) + all.len() as i64 - 1;
        let (first, rest) = digits.split_at(1);
        let point = if rest.is_empty() { "" } else { "." };
        let number = format!("{}{first}{point}{rest}", self.sign());
        match exponent {
            0 => number,
            _ => format!("{number}e{exponent}"),
        }
    }

    fn sign(self) -> &'static str {
        if self.mantissa < 0 { "-" } else { "" }
    }
}

/// Returns ticks at multiples of 1, 2 or 5 times a power of ten within `range`: as many as possible, but at
/// most `most`. There are at least two if `most` is 5 or more, and none if the range is empty or not finite.
pub(super) fn linear([low, high]: [f64; 2], most: usize) -> Vec<Tick> {
    let span = high - low;
    let greatest = low.abs().max(high.abs());
    if span > 0.0 && span < ONE_VALUE * greatest && greatest < f64::INFINITY {
        return single(0.5 * (low + high)).into_iter().collect();
    }
    shifted([low, high], most)
}

/// Returns the same for a range that may be narrower, relative to its values, than single precision resolves.
pub(super) fn shifted([low, high]: [f64; 2], most: usize) -> Vec<Tick> {
    let span = high - low;
    let first_exponent = (span / most as f64).log10().floor();
    if !(span > 0.0 && first_exponent.is_finite()) {
        return Vec::new();
    }
    let first_exponent = rounded(first_exponent);
    for exponent in first_exponent..=first_exponent + 2 {
        for step in STEPS {
            let unit = Tick {
                mantissa: step,
                exponent,
            };
            let unit = unit.value();
            let first = (low / unit - SLACK).ceil();
            let last = (high / unit + SLACK).floor();
            // Beyond 2^53 steps, neighbouring multiples are the same number.
            if last - first < most as f64 && first.abs().max(last.abs()) < 1e15 {
                let tick = |i: i64| Tick {
                    mantissa: i * step,
                    exponent,
                };
                #[expect(clippy::cast_possible_truncation, reason = "below 1e15")]
                return (first as i64..=last as i64).map(tick).collect();
            }
        }
    }
    Vec::new()
}

/// Returns ticks of a scale that is linear within `linear` of 0 and logarithmic beyond, on both sides: 0 and
/// powers of ten beyond `linear`. If these are too many, every second, third ... is used; if too few, the ticks
/// of a linear scale.
pub(super) fn symmetric([low, high]: [f64; 2], linear: f64, most: usize) -> Vec<Tick> {
    if !(low < high && low.is_finite() && high.is_finite() && linear > 0.0) {
        return Vec::new();
    }
    let reach = low.abs().max(high.abs());
    let of_decade = |exponent: i32| [-1, 1].map(|mantissa| Tick { mantissa, exponent });
    let is_within = |tick: &Tick| {
        (low * (1.0 + SLACK.copysign(low))..=high * (1.0 + SLACK)).contains(&tick.value())
    };
    let (first, last) = (
        rounded(linear.log10().ceil()),
        rounded(reach.log10().floor()),
    );
    for stride in 1..=(last - first).max(1) {
        let decades = (first..=last).filter(|e| (last - e) % stride == 0);
        let mut ticks: Vec<Tick> = decades.flat_map(of_decade).filter(is_within).collect();
        if low <= 0.0 && high >= 0.0 {
            ticks.push(Tick {
                mantissa: 0,
                exponent: 0,
            });
        }
        if ticks.len() <= most {
            ticks.sort_unstable_by(|a, b| a.value().total_cmp(&b.value()));
            if ticks.len() >= 2 {
                return ticks;
            }
            break;
        }
    }
    self::linear([low, high], most)
}

/// Returns ticks of a logarithmic scale: 1, 2 and 5 times powers of ten if these are at most `most`, otherwise
/// powers of ten. If those are too many, every second, third ... is used. A range of less than a decade or so
/// has the ticks of a linear scale.
pub(super) fn logarithmic([low, high]: [f64; 2], most: usize) -> Vec<Tick> {
    if !(low > 0.0 && low < high && high < f64::INFINITY) {
        return Vec::new();
    }
    let slack = 1.0 + SLACK;
    let is_within = |tick: &Tick| (low / slack..=high * slack).contains(&tick.value());
    let decades = rounded(low.log10().floor())..=rounded(high.log10().ceil());
    let of_decade = |exponent: i32| STEPS.map(|mantissa| Tick { mantissa, exponent });
    let fine: Vec<Tick> = decades
        .clone()
        .flat_map(of_decade)
        .filter(is_within)
        .collect();
    let powers: Vec<Tick> = fine.iter().filter(|t| t.mantissa == 1).copied().collect();
    if (2..=most).contains(&fine.len()) && !powers.is_empty() {
        return fine;
    }
    if powers.len() < 2 {
        return linear([low, high], most);
    }
    let stride = i32::try_from(powers.len().div_ceil(most)).unwrap_or(i32::MAX);
    let kept = powers.into_iter().filter(|t| t.exponent % stride == 0);
    kept.collect()
}

/// Returns the labels of ticks, all in one form: plain numbers if the longest is short, or no longer than with
/// an exponent.
pub(super) fn labels(ticks: &[Tick]) -> Vec<String> {
    let of = |form: fn(Tick) -> String| -> (usize, Vec<String>) {
        let labels: Vec<String> = ticks.iter().map(|&tick| form(tick)).collect();
        let len = labels.iter().map(|l| l.trim_start_matches('-').len()).max();
        (len.unwrap_or(0), labels)
    };
    let (plain_len, plain) = of(Tick::plain);
    let (scientific_len, scientific) = of(Tick::scientific);
    if plain_len <= PLAIN_LEN.max(scientific_len) {
        plain
    } else {
        scientific
    }
}

/// Converts the exponent of a finite number's power of ten: at most 308 in magnitude.
#[expect(clippy::cast_possible_truncation, reason = "at most 324 either way")]
fn rounded(exponent: f64) -> i32 {
    exponent as i32
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn texts(ticks: &[Tick]) -> String {
        labels(ticks).join(" ")
    }

    #[test]
    fn labels_are_what_a_person_would_write() {
        let linear = |low, high| texts(&linear([low, high], 7));
        assert_eq!(linear(0.0, 255.0), "0 50 100 150 200 250");
        // A field of one value.
        assert_eq!(linear(5.0, 5.000_004), "5");
        assert_eq!(linear(-0.25, -0.249_999_9), "-0.25");
        assert_eq!(linear(1e-9, 1e-9 * (1.0 + 5e-7)), "1e-9");
        assert_eq!(linear(0.0, 1.0), "0.0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(linear(-1.0, 1.0), "-1.0 -0.5 0.0 0.5 1.0");
        assert_eq!(linear(-250.0, -190.0), "-250 -240 -230 -220 -210 -200 -190");
        assert_eq!(linear(0.0, 6e-12), "0 1e-12 2e-12 3e-12 4e-12 5e-12 6e-12");
        assert_eq!(linear(0.0, 2.5e12), "0 5e11 1e12 1.5e12 2e12 2.5e12");
        assert_eq!(linear(0.0, 1e5), "0 20000 40000 60000 80000 100000");
        assert_eq!(
            linear(0.0, 5e-4),
            "0.0000 0.0001 0.0002 0.0003 0.0004 0.0005"
        );
        // A narrow range of large numbers: the labels have the digits that change.
        assert_eq!(
            linear(1e6, 1e6 + 2.0),
            "1000000.0 1000000.5 1000001.0 1000001.5 1000002.0"
        );
        let logarithmic = |low, high| texts(&logarithmic([low, high], 7));
        assert_eq!(logarithmic(1e-4, 1.0), "0.0001 0.001 0.01 0.1 1");
        assert_eq!(logarithmic(3e9, 3e13), "1e10 1e11 1e12 1e13");
        assert_eq!(logarithmic(1e-12, 1e12), "1e-12 1e-8 1e-4 1 1e4 1e8 1e12");
        assert_eq!(logarithmic(0.9, 60.0), "1 2 5 10 20 50");
        assert_eq!(logarithmic(2.1, 4.9), "2.5 3.0 3.5 4.0 4.5");
    }

    proptest! {
        #[test]
        fn linear_ticks_are_round_even_and_within(
            low in -1.0..1.0_f64, span in 1e-5..2.0_f64, scale in -12..=12_i32, most in 5..=7_usize,
        ) {
            let unit = 10_f64.powi(scale);
            let (low, high) = (low * unit, (low + span) * unit);
            let ticks = linear([low, high], most);
            prop_assert!((2..=most).contains(&ticks.len()), "{ticks:?}");
            let step = ticks[1].value() - ticks[0].value();
            for pair in ticks.windows(2) {
                let found = pair[1].mantissa - pair[0].mantissa;
                prop_assert_eq!(pair[0].exponent, pair[1].exponent);
                prop_assert!(STEPS.contains(&found));
                prop_assert_eq!(pair[0].mantissa % found, 0);
            }
            for tick in &ticks {
                let slack = 2.0 * SLACK * step;
                prop_assert!((low - slack..=high + slack).contains(&tick.value()));
            }
            // No further tick would have fitted.
            prop_assert!(ticks[0].value() - step < low && ticks[ticks.len() - 1].value() + step > high);
            // Labels are exact and distinct.
            let labels = labels(&ticks);
            for (tick, label) in ticks.iter().zip(&labels) {
                let read: f64 = label.parse().unwrap();
                prop_assert!((read - tick.value()).abs() <= 4.0 * f64::EPSILON * read.abs());
                prop_assert!(label.len() <= 14, "{}", label);
            }
        }

        #[test]
        fn logarithmic_ticks_rise_and_lie_within(
            low in -12.0..11.0_f64, decades in 0.05..24.0_f64, most in 5..=7_usize,
        ) {
            let range = [10_f64.powf(low), 10_f64.powf(low + decades)];
            let ticks = logarithmic(range, most);
            prop_assert!((2..=most).contains(&ticks.len()), "{ticks:?}");
            for pair in ticks.windows(2) {
                prop_assert!(pair[0].value() < pair[1].value());
            }
            for tick in &ticks {
                let slack = 1.0 + 2.0 * SLACK;
                prop_assert!((range[0] / slack..=range[1] * slack).contains(&tick.value()));
            }
        }
    }

    #[test]
    fn ranges_without_ticks_have_none() {
        for range in [
            [1.0, 1.0],
            [2.0, 1.0],
            [f64::NAN, 1.0],
            [0.0, f64::INFINITY],
        ] {
            assert!(linear(range, 7).is_empty());
            assert!(logarithmic(range, 7).is_empty());
        }
        assert!(logarithmic([0.0, 1.0], 7).is_empty());
        // The widest range of values possible.
        assert_eq!(linear([-8.5e37, 8.5e37], 7).len(), 3);
    }
}
