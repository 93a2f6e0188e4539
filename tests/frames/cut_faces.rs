//! Tests faces of clip planes: slices of kernels against brute-force numbers, their sums, their
//! colours.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::{Random, lower_factor};
use ewa_splat::sample::cut_faces;
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Particles, PointVolume, Strength, TransferDefaults,
    TransferFunction, Values,
};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{Renderer, Settings};
use glam::{DMat2, DMat3, DVec2, DVec3};

fn viridis(range: [f32; 2]) -> TransferFunction {
    let defaults = TransferDefaults {
        range,
        unit_distance: 0.1,
    };
    TransferFunction::named("viridis", &defaults).unwrap()
}

fn classified(particles: Particles, volumes: Vec<f32>, values: Vec<f32>) -> PointVolume {
    PointVolume::new(particles, Strength::Classified { volumes })
        .classified(Values::F32(values), viridis([-2.0, 2.0]))
}

/// Returns a sheared lattice of 20 x 22 x 24 samples about the origin.
fn sheared() -> Lattice {
    let step = DMat3::from_cols(
        DVec3::new(0.1, 0.0, 0.0),
        DVec3::new(0.03, 0.12, 0.0),
        DVec3::new(0.0, 0.02, 0.09),
    );
    Lattice {
        dims: [20, 22, 24],
        spacing: LatticeSpacing::Uniform {
            origin: -(step * DVec3::new(9.5, 10.5, 11.5)),
            step,
        },
    }
}

fn centres(lattice: &Lattice) -> Vec<DVec3> {
    let [nx, ny, _] = lattice.dims;
    let cell = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    (0..lattice.len())
        .map(|i| lattice.position(cell(i)))
        .collect()
}

/// Returns a volume on that lattice with a field of the position.
fn field(lattice: Lattice, value: impl Fn(DVec3) -> f64) -> PointVolume {
    let values = centres(&lattice)
        .into_iter()
        .map(|x| value(x) as f32)
        .collect();
    let particles = Particles::Lattice {
        lattice,
        kernel_width: 0.6,
    };
    classified(particles, Vec::new(), values)
}

/// Returns a plane along no axis, near the lattice's centre.
fn oblique() -> ClipPlane {
    let plane = ClipPlane {
        normal: DVec3::new(2.0, -1.0, 0.7),
        distance: 0.13,
    };
    plane.normalised().unwrap()
}

/// Returns the surfels of a face: positions, tangents and areas.
fn surfels(face: &PointVolume) -> Vec<(DVec3, [DVec3; 2], f64)> {
    face.validate().unwrap();
    let (
        Particles::Surfels {
            positions,
            tangents,
            is_one_sided: false,
        },
        Strength::Surface(areas),
    ) = (&face.particles, &face.strength)
    else {
        panic!("surfels of a surface, two-sided");
    };
    let of = |t: &[f32; 6]| {
        let [ax, ay, az, bx, by, bz] = t.map(f64::from);
        [DVec3::new(ax, ay, az), DVec3::new(bx, by, bz)]
    };
    let all = positions.iter().zip(tangents).zip(areas);
    all.map(|((p, t), a)| (*p, of(t), f64::from(*a))).collect()
}

/// Returns a surfel's kernel at a point of its plane.
fn weight(
    (position, [a, b], area): &(DVec3, [DVec3; 2], f64),
    plane: &ClipPlane,
    at: DVec3,
) -> f64 {
    let (u, v) = plane.normal.any_orthonormal_pair();
    let on = |x: DVec3| DVec2::new(x.dot(u), x.dot(v));
    let factor = DMat2::from_cols(on(*a), on(*b));
    let q = (factor.inverse() * on(at - *position)).length_squared();
    area * (-0.5 * q).exp() / (TAU * factor.determinant().abs())
}

/// Returns a point of the plane, within `reach` of the origin's projection.
fn point_on(plane: &ClipPlane, random: &mut Random, reach: f64) -> DVec3 {
    let x = random.point(reach);
    x - plane.normal * plane.inside(x)
}

#[test]
fn slices_have_the_moments_of_the_kernel_on_the_plane() {
    let mut random = Random::new(1);
    for case in 0..24 {
        let is_sphere = case % 4 == 0;
        let factor = if is_sphere {
            DMat3::from_diagonal(DVec3::splat(0.4))
        } else {
            random.factor(0.6, [3.0, 10.0, 30.0][case % 3])
        };
        let centre = random.point(2.0);
        let normal = random.point(1.0).normalize();
        let sigma = (factor.transpose() * normal).length();
        // Planes lie up to three and a half standard deviations off.
        let off = random.range(-3.5, 3.5) * sigma;
        let plane = ClipPlane {
            normal: normal * 3.0,
            distance: 3.0 * (off - normal.dot(centre)),
        };
        let volume = 0.7_f32;
        let particles = if is_sphere {
            Particles::Isotropic {
                positions: vec![centre],
                sigmas: vec![0.4],
            }
        } else {
            Particles::Anisotropic {
                positions: vec![centre],
                factors: vec![lower_factor(&factor)],
            }
        };
        let volume = classified(particles, vec![volume], vec![0.5]);
        let face = cut_faces(&volume, &[plane]).unwrap().unwrap();
        let found = surfels(&face);
        assert_eq!(found.len(), 1);
        let (position, [a, b], area) = found[0];

        // Sums over a grid of the plane, seven of the largest deviations wide about the projection.
        let inverse = factor.inverse();
        let (u, v) = normal.any_orthonormal_pair();
        let foot = position - normal * (normal.dot(position - centre) + off);
        let [su, sv] = [u, v].map(|axis| a.dot(axis).hypot(b.dot(axis)));
        let (mut mass, mut first, mut second) = (0.0, DVec2::ZERO, DMat2::ZERO);
        let steps = 1400;
        let cell = 14.0 / f64::from(steps);
        for i in 0..steps {
            for k in 0..steps {
                let at = |i: i32| (f64::from(i) + 0.5) * cell - 7.0;
                let d = DVec2::new(at(i) * su, at(k) * sv);
                let q = (inverse * (foot + u * d.x + v * d.y - centre)).length_squared();
                let w = (-0.5 * q).exp();
                mass += w;
                first += d * w;
                second += DMat2::from_cols(d * d.x, d * d.y) * w;
            }
        }
        let mean = first / mass;
        let variance = second * (1.0 / mass) - DMat2::from_cols(mean * mean.x, mean * mean.y);
        let density = 1.0 / (TAU.powf(1.5) * factor.determinant().abs());
        let integral = 0.7 * mass * density * cell * cell * su * sv;
        // The grid omits 1e-9 beyond seven deviations; f32 factors have axis ratios to 30.
        assert!(
            (area / integral - 1.0).abs() < 2e-5,
            "{case}: {area} {integral}"
        );
        assert!(
            (mean / DVec2::new(su, sv)).length() < 2e-5,
            "{case}: {mean}"
        );
        let on = |x: DVec3| DVec2::new(x.dot(u), x.dot(v));
        let outer = |x: DVec2| DMat2::from_cols(x * x.x, x * x.y);
        let expected = outer(on(a)) + outer(on(b));
        for (x, y, size) in [(0, 0, su * su), (0, 1, su * sv), (1, 1, sv * sv)] {
            let error = (variance.col(x)[y] - expected.col(x)[y]).abs();
            assert!(error < 2e-5 * size, "{case}: {variance} {expected}");
        }
        // Points lie in the plane, a twentieth of a deviation inside; the front faces the removed
        // side.
        for t in [a, b] {
            assert!(t.dot(normal).abs() < 1e-6 * t.length().max(sigma), "{case}");
        }
        let inside = (normal.dot(position - centre) + off) / sigma;
        assert!((inside - 0.05).abs() < 1e-6, "{case}: {inside}");
        assert!(a.cross(b).dot(normal) < 0.0);
    }
}

#[test]
fn weights_sum_to_one_within_a_lattice() {
    let lattice = sheared();
    let positions = centres(&lattice);
    let LatticeSpacing::Uniform { step, .. } = lattice.spacing else {
        panic!("uniform")
    };
    let factor = step * 0.6;
    let inverse = factor.inverse();
    let density = step.determinant() / (TAU.powf(1.5) * factor.determinant());
    let plane = oblique();
    let face = cut_faces(&field(lattice, |_| 1.0), &[plane])
        .unwrap()
        .unwrap();
    let surfels = surfels(&face);
    let mut random = Random::new(2);
    for _ in 0..200 {
        let at = point_on(&plane, &mut random, 0.4);
        let sum: f64 = surfels.iter().map(|s| weight(s, &plane, at)).sum();
        let kernels = positions
            .iter()
            .map(|c| (inverse * (at - *c)).length_squared());
        let brute: f64 = kernels.map(|q| density * (-0.5 * q).exp()).sum();
        // The part beyond four deviations of the plane: 6.4e-5 on average, twice that if samples
        // lie just beyond; and f32 roundings.
        assert!((sum - brute).abs() < 1.5e-4, "{sum} {brute}");
        // The ripple of a cubic lattice at .6: 6 exp(-2 pi² .36) = .0049, and second harmonics.
        assert!((sum - 1.0).abs() < 0.007, "{sum}");
    }
}

#[test]
fn a_linear_field_has_its_values_on_an_oblique_plane() {
    let slope = DVec3::new(0.7, -0.4, 1.1);
    let face = cut_faces(&field(sheared(), |x| slope.dot(x)), &[oblique()]);
    let face = face.unwrap().unwrap();
    let surfels = surfels(&face);
    let values = face.values.as_ref().unwrap();
    assert_eq!(face.colour, Colour::Classified);
    let mut random = Random::new(3);
    for _ in 0..200 {
        let at = point_on(&oblique(), &mut random, 0.4);
        let (mut sum, mut mean) = (0.0, 0.0);
        for (i, surfel) in surfels.iter().enumerate() {
            let w = weight(surfel, &oblique(), at);
            sum += w;
            mean += w * f64::from(values.get(i));
        }
        // The mean offset of kernels is their variance times the sum's relative slope. A ripple of
        // .0049 to either side gives .36 2 pi .0049 = .011 of a cell along each index.
        let error = (mean / sum - slope.dot(at)).abs();
        let cell = 0.1 * 0.7 + 0.12 * 0.4 + 0.09 * 1.1;
        assert!(error < 0.011 * cell, "{error}");
    }
}

#[test]
fn a_constant_field_is_drawn_in_its_colour() {
    let value = 0.8;
    let volume = field(sheared(), |_| value);
    let colour = viridis([-2.0, 2.0]).classify(value as f32);
    let plane = oblique();
    let face = cut_faces(&volume, &[plane]).unwrap().unwrap();
    // The face is seen from the removed side.
    let foot = -plane.normal * plane.distance;
    let eye = foot - plane.normal * 4.0;
    let camera = Camera::perspective(eye, foot, DVec3::Z, 9.0, [64, 64]);
    let mut renderer = Renderer::new(vec![face]).unwrap();
    let image = renderer.render(&camera, &Settings::default()).unwrap();
    for pixel in &image.pixels {
        // The mean of one colour: the roundings of some fifty weights.
        for (c, expected) in colour[..3].iter().enumerate() {
            assert!((pixel[c] / pixel[3] - expected).abs() < 2e-6, "{pixel:?}");
        }
        // A sheet of weights about 1 is opaque to within their ripple.
        assert!(pixel[3] > 0.99, "{pixel:?}");
    }
}

#[test]
fn faces_are_cut_by_other_planes() {
    let volume = field(sheared(), |x| x.x);
    let planes = [
        ClipPlane {
            normal: DVec3::X,
            distance: 0.0,
        },
        ClipPlane {
            normal: DVec3::Y * 2.0,
            distance: -0.2,
        },
    ];
    let whole = cut_faces(&volume, &planes[..1]).unwrap().unwrap();
    let both = cut_faces(&volume, &planes).unwrap().unwrap();
    let (whole, both) = (surfels(&whole), surfels(&both));
    // The kernels' deviations in y are .6 x .12.
    let reach = 4.0 * 0.6 * (0.12_f64.powi(2) + 0.02_f64.powi(2)).sqrt();
    let of_first = |s: &&(DVec3, [DVec3; 2], f64)| s.0.x.abs() < 0.05 * 0.07;
    let kept: Vec<_> = both.iter().filter(of_first).collect();
    for surfel in &whole {
        let is_kept = kept.contains(&surfel);
        assert!(!is_kept || surfel.0.y >= 0.1 - reach);
        assert!(is_kept || surfel.0.y < 0.1);
    }
    assert!(kept.len() < whole.len());
    // The second face keeps what the first leaves.
    assert!(both.len() > kept.len() + 100);
}

#[test]
fn what_cannot_be_cut_is_left_out_or_refused() {
    let plane = oblique();
    let mut volume = field(sheared(), |x| x.x);
    let far = ClipPlane {
        distance: 99.0,
        ..plane
    };
    assert_eq!(cut_faces(&volume, &[far]).unwrap(), None);
    assert_eq!(cut_faces(&volume, &[]).unwrap(), None);
    let none = ClipPlane {
        normal: DVec3::ZERO,
        ..plane
    };
    let error = cut_faces(&volume, &[none]).unwrap_err().to_string();
    assert!(error.contains("clip plane"), "{error}");

    // Invalid values, and kernels that no plane slices.
    let all = surfels(&cut_faces(&volume, &[plane]).unwrap().unwrap()).len();
    let Some(Values::F32(values)) = &mut volume.values else {
        panic!("f32")
    };
    for (i, value) in values.iter_mut().enumerate() {
        *value = [*value, f32::NAN, f32::INFINITY][i % 3];
    }
    let third = surfels(&cut_faces(&volume, &[plane]).unwrap().unwrap()).len();
    assert!(third.abs_diff(all / 3) < 20, "{third} of {all}");
    let poison = |position: DVec3, factor: [f32; 6], volume: f32| {
        let particles = Particles::Anisotropic {
            positions: vec![position],
            factors: vec![factor],
        };
        cut_faces(&classified(particles, vec![volume], vec![0.0]), &[plane]).unwrap()
    };
    let sound = [0.5, 0.0, 0.5, 0.0, 0.0, 0.5];
    assert!(poison(DVec3::ZERO, sound, 1.0).is_some());
    assert_eq!(poison(DVec3::ZERO, [0.0; 6], 1.0), None);
    assert_eq!(poison(DVec3::ZERO, [f32::NAN; 6], 1.0), None);
    assert_eq!(poison(DVec3::NAN, sound, 1.0), None);
    assert_eq!(poison(DVec3::ZERO, sound, f32::INFINITY), None);
    assert_eq!(poison(DVec3::ZERO, sound, -1.0), None);

    let given = PointVolume {
        strength: Strength::Mass(vec![1.0; 10_560]),
        ..field(sheared(), |x| x.x)
    };
    let error = cut_faces(&given, &[plane]).unwrap_err().to_string();
    assert!(error.contains("transfer function"), "{error}");
    let face = cut_faces(&field(sheared(), |x| x.x), &[plane])
        .unwrap()
        .unwrap();
    assert!(cut_faces(&face, &[plane]).is_err());
}
