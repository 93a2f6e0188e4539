//! Tests automatic transfer functions of data: backgrounds, signs, flat data, units.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic; test data narrow to f32 on purpose"
)]

use std::path::Path;

use ewa_splat::io::{Association, Dataset, Field, FieldSource, Geometry};
use ewa_splat::sample::{SampleOptions, volume};
use ewa_splat::scene::{
    AutomaticOptions, Lattice, TransferFunction, ValueSample, ValueScale, Values,
};
use glam::DVec3;

/// Returns a number from 0 to 1 for each seed.
fn random(n: usize) -> f64 {
    let z = (n as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as f64 / u64::MAX as f64
}

fn of_grid(values: &Values) -> TransferFunction {
    let sample = ValueSample::of_grid(values, &[], 1.0);
    TransferFunction::automatic(&sample, &AutomaticOptions::default()).unwrap()
}

/// Returns noise from 0 to 59 and a body about 140, of which `saturated` parts in a thousand have
/// the value `level`.
fn scan(level: u8, saturated: f64) -> Values {
    let value = |n: usize| match 1000.0 * random(3 * n) {
        kind if kind < saturated => level,
        kind if kind < 300.0 => 130 + (20.0 * random(3 * n + 1)) as u8,
        _ => (60.0 * random(3 * n + 1)) as u8,
    };
    Values::U8((0..64_000).map(value).collect())
}

#[test]
fn one_saturated_level_is_no_background() {
    for (values, air, body, level) in [
        (scan(255, 45.0), 30, 140, 255),
        (scan(255, 90.0), 30, 140, 255),
    ] {
        let t = of_grid(&values);
        let alpha = |value: u8| t.classify(value.into())[3];
        assert!(
            alpha(air) <= 0.0 && alpha(air / 2) <= 0.0,
            "air {}",
            alpha(air)
        );
        assert!(alpha(body) > 0.0 && alpha(level) > alpha(body));
    }
    // The reverse: bright noise and a dark level.
    let Values::U8(bytes) = scan(255, 45.0) else {
        unreachable!()
    };
    let t = of_grid(&Values::U8(bytes.into_iter().map(|b| 255 - b).collect()));
    let alpha = |value: f32| t.classify(value)[3];
    assert!(alpha(225.0) <= 0.0 && alpha(115.0) > 0.0 && alpha(0.0) > alpha(115.0));
}

#[test]
fn padding_below_the_air_is_clear_as_well() {
    let value = |n: usize| match random(3 * n) {
        kind if kind < 0.2 => -3024,
        kind if kind < 0.4 => 40 + (100.0 * random(3 * n + 1)) as i16,
        kind if kind < 0.42 => 3071,
        _ => -1050 + (100.0 * random(3 * n + 1)) as i16,
    };
    let t = of_grid(&Values::I16((0..64_000).map(value).collect()));
    let alpha = |value: f32| t.classify(value)[3];
    assert!(
        alpha(-3024.0) <= 0.0 && alpha(-1000.0) <= 0.0,
        "{}",
        alpha(-1000.0)
    );
    assert!(alpha(500.0) > 0.0 && alpha(3071.0) > alpha(500.0));
}

#[test]
fn levels_that_are_backgrounds_stay_so() {
    // A masked image: a third is 0, the rest a broad mode.
    let value = |n: usize| match random(3 * n) {
        kind if kind < 0.33 => 0,
        _ => 100 + (100.0 * (random(3 * n + 1) + random(3 * n + 2)) / 2.0) as u8,
    };
    let t = of_grid(&Values::U8((0..64_000).map(value).collect()));
    assert!(t.classify(0.0)[3] <= 0.0 && t.classify(180.0)[3] > 0.0);
    // The free stream lies inside the range.
    let value = |n: usize| match random(3 * n) {
        kind if kind < 0.5 => 1.0,
        _ => (3.0 * random(3 * n + 1)) as f32,
    };
    let t = of_grid(&Values::F32((0..64_000).map(value).collect()));
    assert!(t.classify(1.0)[3] <= 0.0 && t.classify(2.8)[3] > 0.0);
}

#[test]
fn the_sign_of_a_logarithm_is_none() {
    // As many values lie below 1 as above, over decades.
    let value = |n: usize| 10_f64.powf(8.0 * random(2 * n) - 4.0) as f32;
    let values = Values::F32((0..20_000).map(value).collect());
    let sample = ValueSample::of_body(&values, &vec![1.0; 20_000], &[]);
    let of = |colour_map: Option<&str>| {
        let options = AutomaticOptions {
            colour_map,
            ..AutomaticOptions::default()
        };
        TransferFunction::automatic(&sample, &options).unwrap()
    };
    let own = of(None);
    assert_eq!(own.value_scale(), ValueScale::Log);
    let colours = |t: &TransferFunction| -> Vec<[f32; 3]> {
        t.table().iter().map(|e| [e[0], e[1], e[2]]).collect()
    };
    assert_eq!(colours(&own), colours(&of(Some("inferno"))));
    // A field of both signs gets a diverging colour map.
    let signed: Vec<f32> = (0..20_000).map(|n| (random(n) - 0.5) as f32).collect();
    let sample = ValueSample::of_body(&signed.into(), &vec![1.0; 20_000], &[]);
    let t = TransferFunction::automatic(&sample, &AutomaticOptions::default()).unwrap();
    let ([red, _, blue, _], [.., low, _]) = (t.classify(0.45), t.classify(-0.45));
    assert!(red > blue && low > 0.3);
}

/// Makes a field on a lattice of cells with these edges.
fn lattice(dims: [usize; 3], spacing: DVec3, value: impl Fn(f64) -> f64) -> Dataset {
    let count: usize = dims.iter().product();
    let of = |n: usize| value((n % dims[0]) as f64 / dims[0] as f64 + 0.1 * random(n));
    let values: Vec<f64> = (0..count).map(of).collect();
    let field = Field {
        name: "v".into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values.into()),
        unit: None,
    };
    let lattice = Lattice::uniform(dims, DVec3::ZERO, spacing);
    Dataset::new(
        Path::new("test"),
        "test",
        Geometry::Lattice(lattice),
        vec![field],
    )
}

/// Returns the mean optical depth of lines along an axis.
fn depth(dataset: Dataset, axis: usize) -> f64 {
    let Geometry::Lattice(own) = &dataset.geometry else {
        unreachable!()
    };
    let ends = [own.position([0; 3]), own.position(own.dims.map(|n| n - 1))];
    let cells = own.dims[axis] as f64 / (own.dims[axis] - 1) as f64;
    let length = (ends[1] - ends[0])[axis] * cells;
    let sampled = volume(dataset, &SampleOptions::default()).unwrap().volume;
    let (values, t) = (sampled.values.unwrap(), sampled.transfer_function.unwrap());
    let all = (0..values.len()).map(|i| f64::from(t.classify(values.get(i))[3]));
    length * all.sum::<f64>() / values.len() as f64
}

#[test]
fn flat_data_have_the_depth_across_them() {
    let value = |x: f64| x * x;
    for (dims, spacing) in [
        ([40, 40, 2], DVec3::new(1.0, 1.0, 1.0)),
        ([40, 40, 8], DVec3::new(100.0, 100.0, 0.5)),
        ([2, 60, 50], DVec3::new(0.01, 1.0, 1.0)),
    ] {
        let thin = (0..3).min_by(|&a, &b| {
            let width = |i: usize| spacing[i] * dims[i] as f64;
            width(a).total_cmp(&width(b))
        });
        let found = depth(lattice(dims, spacing, value), thin.unwrap());
        assert!((0.7..=1.6).contains(&found), "{dims:?}: {found}");
    }
    // A cube has the same depth along each edge.
    let cube = depth(lattice([20; 3], DVec3::ONE, value), 2);
    assert!((cube - 1.5).abs() < 0.1, "{cube}");
}

#[test]
fn the_function_does_not_depend_on_units() {
    let of = |length: f64, factor: f64| {
        let dataset = lattice([24, 20, 4], length * DVec3::new(3.0, 3.0, 1.0), |x| {
            factor * (1.0 + x * x)
        });
        let sampled = volume(dataset, &SampleOptions::default()).unwrap();
        sampled.volume.transfer_function.unwrap()
    };
    let one = of(1.0, 1.0);
    for (length, factor) in [(1e3, 1.0), (1e-3, 100.0), (1e3, 1e-2)] {
        let other = of(length, factor);
        for (a, b) in one.table().iter().zip(other.table()) {
            assert!((0..3).all(|i| (a[i] - b[i]).abs() < 1e-3), "{a:?} {b:?}");
            let b = f64::from(b[3]) * length;
            let a = f64::from(a[3]);
            assert!((a - b).abs() < 1e-2 * a.max(0.01), "{a} {b}");
        }
    }
}
