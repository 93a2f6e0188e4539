//! Computes medians and Pareto fronts.

use crate::render::StageTimes;

/// Returns the median of each stage over several frames; zeros for none.
pub fn median_times(times: &[StageTimes]) -> StageTimes {
    let of = |stage: fn(&StageTimes) -> f64| median(times.iter().map(stage).collect());
    StageTimes {
        choose: of(|t| t.choose),
        shadow: of(|t| t.shadow),
        cull: of(|t| t.cull),
        classify: of(|t| t.classify),
        project: of(|t| t.project),
        sort: of(|t| t.sort),
        bin: of(|t| t.bin),
        rasterise: of(|t| t.rasterise),
        resolve: of(|t| t.resolve),
        frame: of(|t| t.frame),
    }
}

/// Returns the middle value, or the mean of the two middle ones; 0 for none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[middle],
        _ => f64::midpoint(values[middle - 1], values[middle]),
    }
}

/// Returns the points that no other point beats: `points` are (time, error), smaller is better in both.
///
/// A point is beaten by one that is at least as good in both and better in one. The result has indices in the
/// order of time; of equal points only the first.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|&i| points[i].0.is_finite() && points[i].1.is_finite())
        .collect();
    // Stable sort: equal points keep their order.
    order.sort_by(|&a, &b| {
        let (a, b) = (points[a], points[b]);
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < least;
        least = least.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn medians_are_per_stage() {
        let frame = |sort, frame| StageTimes {
            sort,
            frame,
            ..StageTimes::default()
        };
        let odd = median_times(&[frame(3.0, 10.0), frame(1.0, 30.0), frame(2.0, 20.0)]);
        assert_eq!((odd.sort, odd.frame, odd.cull), (2.0, 20.0, 0.0));
        let even = median_times(&[frame(3.0, 10.0), frame(1.0, 30.0)]);
        assert_eq!((even.sort, even.frame), (2.0, 20.0));
        assert_eq!(median_times(&[]), StageTimes::default());
    }

    #[test]
    fn a_front_of_five() {
        let points = [(5.0, 0.1), (1.0, 0.9), (2.0, 0.9), (3.0, 0.2), (3.0, 0.2)];
        assert_eq!(pareto_front(&points), [1, 3, 0]);
        assert!(pareto_front(&[]).is_empty());
        assert!(pareto_front(&[(f64::NAN, 1.0)]).is_empty());
    }

    proptest! {
        #[test]
        fn what_is_on_the_front_is_not_beaten_and_what_is_not_is(
            points in prop::collection::vec((0u8..10, 0u8..10), 0..30),
        ) {
            let points: Vec<(f64, f64)> =
                points.iter().map(|&(a, b)| (a.into(), b.into())).collect();
            let front = pareto_front(&points);
            let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
            for (i, &p) in points.iter().enumerate() {
                let beaten = points.iter().any(|&other| beats(other, p));
                let first = points.iter().position(|&other| other == p) == Some(i);
                prop_assert_eq!(front.contains(&i), !beaten && first);
            }
        }
    }
}
