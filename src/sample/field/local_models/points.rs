//! Fits local models of particles, by least squares over the nearest neighbours.

use glam::{DMat3, DVec3};

use super::quadratic::{Changes, LANES, Quadratic, fit, fit_together};
use super::{Range, STAGE, local_model, steepest};
use crate::error::Result;
use crate::parallel;
use crate::sample::points::neighbours::{LISTED, MOST_FITTED, Neighbours, PointIndex};
use crate::scene::{LocalModel, Values};
use crate::task::{Task, fill};

/// Number of neighbours to which models are fitted; neighbours at one position count once. Twice and four times
/// as many are used if these do not determine a quadratic.
pub(super) const NEIGHBOUR_COUNT: usize = 24;
/// Larger numbers of neighbours; see [`NEIGHBOUR_COUNT`].
const MORE_NEIGHBOURS: [usize; 2] = [2 * NEIGHBOUR_COUNT, 4 * NEIGHBOUR_COUNT];
const _: () = assert!(MORE_NEIGHBOURS[1] <= MOST_FITTED && NEIGHBOUR_COUNT <= LISTED);

/// Model of a point.
#[derive(Clone)]
struct Made {
    model: LocalModel,
    /// True if more neighbours than [`NEIGHBOUR_COUNT`] were needed.
    is_far: bool,
}

/// Fits one model for each of the first points. Also returns the points that needed more neighbours than
/// [`NEIGHBOUR_COUNT`].
///
/// - `index`: index of the points; `None` for fewer than two distinct positions.
/// - `count`: number of these points; the others are neighbours whose models belong to other ranks.
/// - `factor`: returns the factor of a kernel's variance, world units.
/// - `values`: one for each point. Points at one position count with their mean value. Values that are not
///   finite are ignored.
pub(super) fn models(
    index: Option<&PointIndex<'_>>,
    count: usize,
    factor: impl Fn(usize) -> DMat3 + Sync,
    values: &Values,
    task: Option<&Task>,
) -> Result<(Vec<LocalModel>, Vec<u32>)> {
    let flat = |i: usize| {
        let value = values.get(i);
        local_model(
            &Quadratic::default(),
            DMat3::ZERO,
            DVec3::ZERO,
            value,
            Range::of(value),
            1.0,
        )
    };
    let Some(index) = index else {
        return Ok(((0..count).map(flat).collect(), Vec::new()));
    };
    let of_group = |g: usize| {
        let ranges = index
            .group(g)
            .iter()
            .map(|&i| Range::of(values.get(i as usize)));
        let mean = index.mean_of(g, |i| values.get(i));
        (mean, ranges.fold(Range::EMPTY, Range::and))
    };
    let groups: Vec<(f64, Range)> = parallel::map(index.group_count(), of_group);
    // Lists the neighbours of a group; returns the range of the values.
    let around = |search: &mut Neighbours<'_>, g: usize, count: usize, changes: &mut Changes| {
        let (mean, mut range) = groups[g];
        changes.clear();
        for (other, _) in search.of(g, count) {
            let (other_mean, others) = groups[other];
            range = range.and(others);
            changes.push((index.offset(g, other), other_mean - mean));
        }
        range
    };
    let fit_some = |search: &mut Neighbours<'_>,
                    changes: &mut [Changes; LANES],
                    first: usize,
                    some: &mut [Option<Made>]| {
        let mut points = [None; LANES];
        let mut ranges = [Range::EMPTY; LANES];
        for n in 0..some.len() {
            changes[n].clear();
            let (point, g) = index.in_order(first + n);
            if (point as usize) < count {
                points[n] = Some((point as usize, g));
                ranges[n] = around(search, g, NEIGHBOUR_COUNT, &mut changes[n]);
            }
        }
        let fits = fit_together(&changes[..some.len()]);
        for (n, made) in some.iter_mut().enumerate() {
            let Some((i, g)) = points[n] else {
                continue;
            };
            let mut fitted = fits[n];
            let mut is_far = false;
            for count in MORE_NEIGHBOURS {
                if fitted.is_determined || !groups[g].0.is_finite() {
                    break;
                }
                around(search, g, count, &mut changes[n]);
                fitted = fit(&changes[n]);
                is_far = true;
            }
            let factor = factor(i);
            let steepest = steepest(factor, fitted.distance);
            let (value, range) = (values.get(i), ranges[n]);
            let model = local_model(
                &fitted.quadratic,
                factor,
                DVec3::ZERO,
                value,
                range,
                steepest,
            );
            *made = Some(Made { model, is_far });
        }
    };
    let mut found: Vec<Option<Made>> = vec![None; index.len()];
    fill(task, STAGE, &mut found, |first, some| {
        let mut search = index.search();
        let mut changes = <[Changes; LANES]>::default();
        for (n, some) in some.chunks_mut(LANES).enumerate() {
            fit_some(&mut search, &mut changes, first + LANES * n, some);
        }
    })?;
    let mut models: Vec<LocalModel> = (0..count).map(flat).collect();
    let mut far = Vec::new();
    for (place, model) in found.into_iter().enumerate() {
        if let Some(Made { model, is_far }) = model {
            let point = index.in_order(place).0;
            models[point as usize] = model;
            far.extend(is_far.then_some(point));
        }
    }
    Ok((models, far))
}

#[cfg(test)]
mod tests {
    use super::super::analytic::{Rms, blobs, random_point};
    use super::*;
    use crate::error::Error;
    use crate::math::narrowed;
    use crate::sample::{PurposeOptions, SampleOptions, points};
    use crate::scene::{Lattice, LatticeSpacing, LocalModels};

    /// Returns 20³ points at spacing 1/27 about 0, jittered by .35 of the spacing.
    fn scattered() -> Vec<DVec3> {
        let mut state = 3;
        let point = |i: usize| {
            let index = DVec3::from([i % 20, i / 20 % 20, i / 400].map(|i| i as f64 - 9.5));
            index / 27.0 + random_point(&mut state, 0.35 / 27.0)
        };
        (0..8000).map(point).collect()
    }

    fn models_of(positions: &[DVec3], sigma: f64, field: impl Fn(DVec3) -> f64) -> Vec<LocalModel> {
        let values = positions.iter().map(|&x| narrowed(field(x))).collect();
        let factor = |_| DMat3::from_diagonal(DVec3::splat(sigma));
        models(
            PointIndex::new(positions).as_ref(),
            positions.len(),
            factor,
            &Values::F32(values),
            None,
        )
        .unwrap()
        .0
    }

    #[test]
    fn jittered_points_err_by_some_percent() {
        let (positions, sigma) = (scattered(), 0.6 / 27.0);
        let found = models_of(&positions, sigma, |x| blobs(x).0);
        let [mut slopes, mut departures] = [Rms::default(), Rms::default()];
        for (x, model) in positions.iter().zip(&found) {
            if x.abs().max_element() > 7.5 / 27.0 {
                continue;
            }
            let (_, gradient, hessian) = blobs(*x);
            let slope = gradient * sigma;
            slopes.add((model.slope.as_dvec3() - slope).length(), slope.length());
            let trace = hessian.x_axis.x + hessian.y_axis.y + hessian.z_axis.z;
            let prefilter = 0.5 * trace * sigma * sigma;
            departures.add(f64::from(model.departure) - prefilter, prefilter);
        }
        let [slope, departure] = [slopes.share(), departures.share()];
        println!("slopes {slope}, departures {departure}");
        // Expected from theory: 2.0 % and 3.1 %.
        assert!(slope < 0.03 && departure < 0.05, "{slope} {departure}");
    }

    #[test]
    fn quadratic_fields_are_exact_whatever_the_width() {
        let field = |x: DVec3| x.x - 2.0 * x.y * x.z + 3.0 * x.z * x.z - x.x * x.x;
        for sigma in [0.001, 0.02] {
            let positions = scattered();
            for (x, model) in positions.iter().zip(models_of(&positions, sigma, field)) {
                let gradient = DVec3::new(1.0 - 2.0 * x.x, -2.0 * x.z, 6.0 * x.z - 2.0 * x.y);
                let off = (model.slope.as_dvec3() - sigma * gradient).length();
                assert!(off < 1e-3 * sigma, "{x}: {off}");
                // Values of .5 in f32 err by 3e-8, which over squares of the spacing is 1e-4.
                let off = (f64::from(model.departure) - 2.0 * sigma * sigma).abs();
                assert!(off < 5e-3 * sigma * sigma, "{x}: {off}");
            }
        }
    }

    #[test]
    fn lone_points_lines_and_duplicates_are_borne() {
        let field = |x: DVec3| 2.0 * x.x + 5.0 * x.y;
        for few in [
            vec![],
            vec![DVec3::ONE],
            vec![DVec3::ONE; 50],
            vec![DVec3::NAN, DVec3::X],
        ] {
            for model in models_of(&few, 1.0, field) {
                assert_eq!((model.slope, model.departure), (glam::Vec3::ZERO, 0.0));
            }
        }
        let line: Vec<DVec3> = (0..60).map(|i| DVec3::X * f64::from(i)).collect();
        for model in models_of(&line, 0.5, field) {
            assert!((model.slope - glam::Vec3::X).length() < 1e-3, "{model:?}");
            assert!(model.departure.abs() < 1e-3, "{model:?}");
            assert!(model.above + model.below >= 46.0, "{model:?}");
        }
        let mut crowded = scattered();
        crowded.extend([crowded[0]; 3000]);
        for (x, model) in crowded.iter().zip(models_of(&crowded, 0.02, field)) {
            let off = (model.slope.as_dvec3() - 0.02 * DVec3::new(2.0, 5.0, 0.0)).length();
            assert!(off < 1e-4, "{x}: {off}");
        }
    }

    #[test]
    fn volumes_of_particles_carry_them_where_wanted() {
        let positions = scattered();
        let values: Vec<f32> = positions.iter().map(|x| narrowed(x.x)).collect();
        let sampled = |options: &SampleOptions| points(positions.clone(), values.clone(), options);
        let options = SampleOptions::default();
        let mut with = sampled(&options).unwrap().volume;
        assert_eq!(with.local_models.as_ref().map(LocalModels::len), Some(8000));
        with.validate().unwrap();
        with.local_models = with.local_models.map(|m| m.gather(&[1, 2]));
        assert!(with.validate().is_err());
        let without = SampleOptions {
            purpose: PurposeOptions {
                local_models: false,
                ..options.purpose
            },
            ..options.clone()
        };
        let mut without = sampled(&without).unwrap().volume;
        assert_eq!(without.local_models, None);
        // Lattices need no models: they use their values.
        let lattice = Lattice {
            dims: [2; 3],
            spacing: LatticeSpacing::Uniform {
                origin: DVec3::ZERO,
                step: DMat3::IDENTITY,
            },
        };
        without.particles = crate::scene::Particles::Lattice {
            lattice,
            kernel_width: 0.6,
        };
        without.values = Some(Values::F32(vec![0.0; 8]));
        without.strength = crate::scene::Strength::Classified { volumes: vec![] };
        without.validate().unwrap();
        super::super::complete(&mut without, None, &options).unwrap();
        assert_eq!(without.local_models, None);
        let still = LocalModel {
            slope: glam::Vec3::ZERO,
            departure: 0.0,
            below: 0.0,
            above: 0.0,
        };
        without.local_models = Some(LocalModels::new(&[still; 8]));
        assert!(without.validate().is_err());
        // Cancelled work ends.
        let task = Task::new();
        task.cancel();
        let values = Values::F32(values);
        let factor = |_| DMat3::IDENTITY;
        let index = PointIndex::new(&positions);
        let count = positions.len();
        let cancelled = models(index.as_ref(), count, factor, &values, Some(&task));
        assert!(matches!(cancelled, Err(Error::Cancelled)));
    }
}
