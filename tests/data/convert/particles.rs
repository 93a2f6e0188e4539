//! Tests particles and lattices as splats: opacities, air, and tables read from VTK.

use super::{Folder, norm, seen, some_cloud, variance};
use crate::common::Random;
use ewa_splat::io::{Dataset, Geometry};
use ewa_splat::sample::{LEAST_OPACITY, SampleOptions, splat_cloud, volume as sample};
use ewa_splat::scene::{Lattice, Particles, PointVolume, Strength, TransferFunction, Values};
use glam::{DMat3, DVec3};
use serde_json::json;

/// A table's column `opacity` is the splat's opacity, whatever the shape.
#[test]
fn opacities_of_tables_come_back() {
    let folder = Folder::new();
    let mut random = Random::new(12);
    let mut text = "x,y,z,vxx,vxy,vxz,vyy,vyz,vzz,opacity,r,g,b\n".to_owned();
    let mut rows = Vec::new();
    for i in 0..30 {
        let f = random.factor(0.5, 20.0);
        let v = f * f.transpose();
        let opacity = random.range(0.01, 0.95);
        let p = random.point(3.0);
        let colour = [0.02, 0.3 + 0.02 * f64::from(i), 0.9];
        let numbers = [
            p.x, p.y, p.z, v.x_axis.x, v.x_axis.y, v.x_axis.z, v.y_axis.y, v.y_axis.z, v.z_axis.z,
            opacity, colour[0], colour[1], colour[2],
        ];
        text += &(numbers.map(|x| x.to_string()).join(",") + "\n");
        rows.push((p, v, opacity, colour));
    }
    std::fs::write(folder.path("a.csv"), text).unwrap();
    let volume = sample(folder.read("a.csv"), &SampleOptions::default())
        .unwrap()
        .volume;
    let (cloud, report) = splat_cloud(&[volume]).unwrap();
    assert_eq!((report.splat_count, cloud.harmonics_degree), (30, 0));
    for (i, (p, v, opacity, colour)) in rows.into_iter().enumerate() {
        assert_eq!(cloud.positions[i], p);
        // Variances have f32 elements and ratios up to 400: their rounding affects the smallest
        // sigma.
        assert!(norm(variance(&cloud, i) - v) < 1e-5 * norm(v));
        assert!(
            (f64::from(cloud.opacities[i]) - opacity).abs() < 1e-4,
            "{i}"
        );
        let seen = seen(&cloud, i, DVec3::X);
        for (c, expected) in seen.into_iter().zip(colour) {
            let linear = f64::from(ewa_splat::image::linear_from_srgb(c));
            assert!((linear - expected).abs() < 1e-5, "{linear} {expected}");
        }
    }
}

#[test]
fn lattices_are_classified_and_their_air_left_out() {
    // Values 0 to 63 and NaN; opacity from value 32 on.
    let points = [(0.0, 0.0), (31.0, 0.0), (32.0, 0.5), (63.0, 0.5)].map(
        |(value, opacity)| json!({ "value": value, "color": [0.25, 0.5, 1.0], "opacity": opacity }),
    );
    let text = json!({ "range": [0, 63], "unit_distance": 2.0, "color_space": "linear",
                       "points": points })
    .to_string();
    let defaults = ewa_splat::scene::TransferDefaults {
        range: [0.0, 63.0],
        unit_distance: 2.0,
    };
    let transfer = TransferFunction::from_json("t".as_ref(), &text, &defaults).unwrap();
    let mut values: Vec<f32> = (0..64).map(|i| i as f32).collect();
    values[40] = f32::NAN;
    let spacing = DVec3::new(1.0, 2.0, 0.5);
    let volume = PointVolume::new(
        Particles::Lattice {
            lattice: Lattice::uniform([4, 4, 4], DVec3::X, spacing),
            kernel_width: 0.6,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(Values::F32(values), transfer);
    let (cloud, report) = splat_cloud(std::slice::from_ref(&volume)).unwrap();
    assert_eq!((report.particle_count, report.splat_count), (64, 31));
    assert_eq!((report.findings.len(), report.findings[0].count), (1, 33));
    // Node 33 = (1, 0, 2).
    assert_eq!(
        cloud.positions[1],
        DVec3::X + spacing * DVec3::new(1.0, 0.0, 2.0)
    );
    let extinction = std::f64::consts::LN_2 / 2.0;
    let tau = extinction * 1.0 / (std::f64::consts::TAU * 0.36 * 2.0 * 1.0);
    // The transfer function's table has steps.
    for i in 1..31 {
        let opacity = f64::from(cloud.opacities[i]);
        assert!(
            (opacity - (1.0 - (-tau).exp())).abs() < 1e-4,
            "{i}: {opacity}"
        );
        let v = variance(&cloud, i);
        let expected = DMat3::from_diagonal((spacing * 0.6).powf(2.0));
        assert!(norm(v - expected) < 1e-6 * norm(expected));
    }
    // A scene without visible particles is an error that says so.
    let mut dark = volume;
    dark.values = Some(Values::F32(vec![1.0; 64]));
    let error = splat_cloud(&[dark]).unwrap_err().to_string();
    assert!(
        error.contains("64 particles left out: transparent"),
        "{error}"
    );
}

/// Particles that an image might show are kept, however faint, and reported.
#[test]
fn faint_particles_are_counted() {
    let of = |opacity: f64| {
        let particle = crate::common::scene::Particle::sphere(DVec3::ZERO, 1.0, 1.0);
        let mass = -f64::ln_1p(-opacity) * std::f64::consts::TAU;
        crate::common::scene::Particle {
            mass: mass as f32,
            ..particle
        }
    };
    let least = f64::from(LEAST_OPACITY);
    let mut particles = vec![of(0.9 * least), of(1.1 * least), of(1.1 / 255.0), of(0.5)];
    particles.push(crate::common::scene::Particle {
        mass: f32::NAN,
        ..of(0.5)
    });
    particles.push(of(0.5).coloured([f32::NAN, 0.0, 0.0]));
    particles.push(crate::common::scene::Particle {
        position: DVec3::NAN,
        ..of(0.5)
    });
    let (cloud, report) = splat_cloud(&[crate::common::scene::volume(&particles)]).unwrap();
    assert_eq!((report.particle_count, report.splat_count), (7, 3));
    assert_eq!(cloud.positions.len(), 3);
    let counts: Vec<_> = report
        .findings
        .iter()
        .map(|f| (f.count, f.left_out))
        .collect();
    assert_eq!(
        counts,
        [(1, true), (1, true), (1, true), (1, true), (1, false)]
    );
    // A file's own splats are kept, however faint.
    let mut faint = some_cloud(3, 0, 1);
    faint.opacities = vec![1e-6, 0.0, 0.5];
    let data = Dataset::new("a".as_ref(), "splats", Geometry::Splats(faint), Vec::new());
    let volume = sample(data, &SampleOptions::default()).unwrap().volume;
    assert_eq!(splat_cloud(&[volume]).unwrap().1.splat_count, 3);
}

/// Vertices with shapes give the same positions to the last bit, and the same kernels as particles.
#[test]
fn vtk_grids_of_splats_are_particles_of_the_same_shapes() {
    let folder = Folder::new();
    let cloud = some_cloud(40, 1, 77);
    let written = folder.write("vtu", &cloud);
    assert!(
        written
            .notes
            .iter()
            .any(|note| note.contains("depend on the view"))
    );
    let data = folder.read("a.vtu");
    let Geometry::Points { positions } = &data.geometry else {
        panic!("particles expected");
    };
    assert_eq!(positions, &cloud.positions);
    let field = |name: &str| data.scalar(name).unwrap().1;
    // Rows of the tensor, whose square is the variance.
    let tensor: Vec<_> = (0..9).map(|k| field(&format!("shape:{k}"))).collect();
    let opacities = field("opacity");
    for i in 0..cloud.positions.len() {
        let rows: [f64; 9] = std::array::from_fn(|k| f64::from(tensor[k].get(i)));
        let shape = DMat3::from_cols_array(&rows);
        let expected = variance(&cloud, i);
        assert!(
            norm(shape * shape - expected) < 1e-5 * norm(expected),
            "{i}"
        );
        assert_eq!(opacities.get(i), cloud.opacities[i]);
    }
    let options = SampleOptions {
        field: Some("opacity".into()),
        ..SampleOptions::default()
    };
    let volume = sample(data, &options).unwrap().volume;
    let Particles::Anisotropic { factors, .. } = &volume.particles else {
        panic!("ellipsoids expected");
    };
    assert_eq!(factors.len(), cloud.positions.len());
    for (i, factor) in factors.iter().enumerate() {
        let [a, b, c, d, e, f] = factor.map(f64::from);
        let factor = DMat3::from_cols(
            DVec3::new(a, b, d),
            DVec3::new(0.0, c, e),
            DVec3::new(0.0, 0.0, f),
        );
        let expected = variance(&cloud, i);
        let found = factor * factor.transpose();
        assert!(
            norm(found - expected) < 1e-4 * norm(expected),
            "{i}: {found} {expected}"
        );
    }
}
