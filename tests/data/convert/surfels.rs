//! Tests surfels as splats: closed surfaces, opacities, shapes and fronts.

use super::{norm, picture, unit, variance};
use crate::common::Random;
use ewa_splat::io::SplatCloud;
use ewa_splat::sample::mesh::{SPLAT_WIDTH, SURFEL_WIDTH};
use ewa_splat::sample::splat_cloud;
use ewa_splat::scene::{Particles, PointVolume, Strength};
use ewa_splat::view::Camera;
use glam::{DMat3, DVec2, DVec3};

/// Cells of a square surface: sites in the unit square with variances and areas, relaxed as in the
/// mesh sampler.
struct Cells {
    sites: Vec<DVec2>,
    variances: Vec<[f64; 3]>,
    areas: Vec<f64>,
}

impl Cells {
    /// Returns `side`² sites, jittered and then relaxed `rounds` times.
    fn new(side: usize, rounds: usize) -> Self {
        const PER_SITE: usize = 12;
        let mut random = Random::new(77);
        let count = side * side;
        let mut sites: Vec<DVec2> = (0..count)
            .map(|i| {
                let at = |k: usize, r: f64| (k as f64 + 0.5 + r) / side as f64;
                let r = [(); 2].map(|()| random.range(-0.45, 0.45));
                DVec2::new(at(i % side, r[0]), at(i / side, r[1]))
            })
            .collect();
        let fine = PER_SITE * side;
        let mut variances = Vec::new();
        let mut areas = Vec::new();
        for _ in 0..=rounds {
            let mut sums = vec![(0.0, DVec2::ZERO, [0.0; 3]); count];
            for i in 0..fine * fine {
                let at = |k: usize| (k as f64 + 0.5) / fine as f64;
                let p = DVec2::new(at(i % fine), at(i / fine));
                // Only sites of the neighbouring rows can be nearest.
                let near = |s: &usize| (sites[*s] - p).length_squared();
                let nearest = (0..count)
                    .filter(|&s| (sites[s] - p).abs().max_element() < 3.0 / side as f64)
                    .min_by(|a, b| near(a).total_cmp(&near(b)))
                    .unwrap();
                let (n, sum, squares) = &mut sums[nearest];
                *n += 1.0;
                *sum += p;
                let d = [p.x * p.x, p.x * p.y, p.y * p.y];
                *squares = [0, 1, 2].map(|k| squares[k] + d[k]);
            }
            variances.clear();
            areas.clear();
            for (site, (n, sum, squares)) in sites.iter_mut().zip(&sums) {
                let c = *sum / *n;
                *site = c;
                let centre = [c.x * c.x, c.x * c.y, c.y * c.y];
                variances.push([0, 1, 2].map(|k| squares[k] / n - centre[k]));
                areas.push(n / (fine * fine) as f64);
            }
        }
        Self {
            sites,
            variances,
            areas,
        }
    }

    /// Returns surfels in the plane z = 0 with standard deviations of `width` spacings.
    fn volume(&self, width: f64, strength: Strength) -> PointVolume {
        let tangents = self.variances.iter().map(|v| {
            let [xx, xy, yy] = v.map(|v| 12.0 * width * width * v);
            // Any factor will do, perpendicular or not.
            let a = xx.sqrt();
            let (b, c) = (xy / a, (yy - xy * xy / xx).sqrt());
            [a, b, 0.0, 0.0, c, 0.0].map(|x| x as f32)
        });
        // Converts Cholesky's rows to columns: t1 = (a, b), t2 = (0, c).
        PointVolume::new(
            Particles::Surfels {
                positions: self.sites.iter().map(|s| s.extend(0.0)).collect(),
                tangents: tangents.collect(),
                is_one_sided: false,
            },
            strength,
        )
        .with_colour([0.25, 0.5, 0.75])
    }

    fn areas(&self, factor: f64) -> Vec<f32> {
        self.areas.iter().map(|a| (a * factor) as f32).collect()
    }
}

/// Returns alpha over the inner half of the square, seen from `tilt_deg` off its normal.
fn inner_alphas(cloud: &SplatCloud, tilt_deg: f64) -> Vec<f64> {
    let (sin, cos) = tilt_deg.to_radians().sin_cos();
    let target = DVec3::new(0.5, 0.5, 0.0);
    let eye = target + DVec3::new(0.0, -sin, cos) * 5.0;
    // The foreshortened inner half fills the picture.
    let camera = Camera::orthographic(eye, target, DVec3::Y, 0.5 * cos, [160, 160]);
    let image = picture(cloud, &camera);
    let columns = 160.0 * cos / 1.0;
    let inner = (160.0 - columns) / 2.0;
    let pixels = image.pixels.iter().enumerate();
    let is_inner = |i: usize| (i % 160) as f64 >= inner && ((i % 160) as f64) < 160.0 - inner;
    pixels
        .filter(|(i, _)| tilt_deg == 0.0 || is_inner(*i))
        .map(|(_, p)| f64::from(p[3]))
        .collect()
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// Opaque surfels become splats that let little light through: 3 % on the mean, 5 % at the narrower width of converted
/// meshes. Wider ones let none through, less than a grey level at 99.9 % of all pixels, but they hide what is painted
/// beside them.
#[test]
fn opaque_surfels_close() {
    for rounds in [0, 3] {
        let cells = Cells::new(20, rounds);
        let volume = cells.volume(0.6, Strength::Surface(cells.areas(1.0)));
        let (cloud, report) = splat_cloud(&[volume]).unwrap();
        assert_eq!((report.particle_count, report.splat_count), (400, 400));
        let share = cloud.opacities.iter().filter(|a| **a == 1.0).count();
        assert_eq!(share, 400, "whole cells are opaque");
        for width in [0.5, SPLAT_WIDTH, SURFEL_WIDTH, 0.65, 0.7, 0.8, 0.9, 1.0] {
            let mut cloud = cloud.clone();
            let factor = (width / SURFEL_WIDTH) as f32;
            cloud.scales.iter_mut().flatten().for_each(|s| *s *= factor);
            let leaks = |tilt| inner_alphas(&cloud, tilt).into_iter().map(|a| 1.0 - a);
            let leaks: Vec<f64> = [0.0, 60.0].into_iter().flat_map(leaks).collect();
            let mean = leaks.iter().sum::<f64>() / leaks.len() as f64;
            let (most, p999) = (quantile(leaks.clone(), 1.0), quantile(leaks, 0.999));
            println!(
                "relaxed {rounds}, width {width}: mean {mean:.1e}, 99.9 % {p999:.1e}, most {most:.1e}"
            );
            if rounds == 3 && width >= 0.9 {
                assert!(p999 < 1.0 / 255.0, "{width}: {p999}");
            }
            // Cells of the last round leave 3.04 and 5.5 % open.
            for (own, most) in [(SURFEL_WIDTH, 0.031), (SPLAT_WIDTH, 0.056)] {
                if (width - own).abs() < 1e-9 {
                    assert!(mean < most, "{width}: {mean}");
                }
            }
            if width == 0.5 {
                assert!(mean > 0.05, "{width}: {mean}: narrower kernels would do");
            }
            if width <= 0.7 {
                assert!(
                    p999 > 1.0 / 255.0,
                    "{width}: {p999}: narrower kernels would do"
                );
            }
        }
    }
}

/// The splats of a pane transmit the same light as the pane, from any side.
#[test]
fn panes_keep_their_opacity() {
    let cells = Cells::new(20, 3);
    for opacity in [0.05, 0.3, 0.6, 0.9, 0.99] {
        let depth = -f64::ln_1p(-opacity);
        let volume = cells.volume(0.6, Strength::Translucent(cells.areas(depth)));
        let (cloud, _) = splat_cloud(&[volume]).unwrap();
        for tilt in [0.0, 45.0] {
            let alphas = inner_alphas(&cloud, tilt);
            let mean = alphas.iter().sum::<f64>() / alphas.len() as f64;
            let spread =
                alphas.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / alphas.len() as f64;
            let spread = spread.sqrt();
            println!("{opacity} at {tilt}: mean {mean:.4}, rms {spread:.4}");
            // The mean depth is the pane's. The mean alpha falls short of it (Jensen) by half the
            // depths' variance.
            assert!((mean - opacity).abs() < 0.03, "{opacity}: {mean}");
            assert!(spread < 0.08, "{opacity}: {spread}");
        }
    }
}

/// The splat at a position.
fn place_of(cloud: &SplatCloud, position: DVec3) -> usize {
    let found = cloud.positions.iter().position(|p| *p == position);
    found.expect("a splat at every site")
}

/// Masks: an eighth of a cell gives a quarter of the opacity; half a cell is opaque.
#[test]
fn what_is_hardly_there_is_hardly_opaque() {
    let cells = Cells::new(20, 3);
    let mut areas = cells.areas(1.0);
    for area in &mut areas[..100] {
        *area *= 0.125;
    }
    for area in &mut areas[100..200] {
        *area *= 0.6;
    }
    let (cloud, _) = splat_cloud(&[cells.volume(0.6, Strength::Surface(areas))]).unwrap();
    // Splats are written in an order without direction.
    let places = cells
        .sites
        .iter()
        .map(|site| place_of(&cloud, site.extend(0.0)));
    let places: Vec<usize> = places.collect();
    let of = |i: std::ops::Range<usize>| {
        let len = i.len() as f32;
        let opacities = places[i].iter().map(|&place| cloud.opacities[place]);
        opacities.sum::<f32>() / len
    };
    // Cells differ from squares by about 20 %.
    assert!((of(0..100) - 0.25).abs() < 0.06, "{}", of(0..100));
    assert!(of(100..200) > 0.97 && of(200..400) > 0.999);
    // Kernels stay as wide as they are.
    let scales = |width: f64| {
        let volume = cells.volume(width, Strength::Surface(cells.areas(1.0)));
        let (cloud, _) = splat_cloud(&[volume]).unwrap();
        let areas = cloud.scales.iter().map(|s| (s[0] * s[1]).sqrt());
        f64::from(areas.sum::<f32>() / 400.0)
    };
    let ratio = scales(1.1) / scales(0.3);
    assert!((ratio - 1.1 / 0.3).abs() < 1e-4, "{ratio}");
}

/// Scales and rotation give the surfel's variance. The third axis points to the front.
#[test]
fn surfels_keep_their_shape_and_front() {
    let mut random = Random::new(9);
    let tangents: Vec<[f32; 6]> = (0..50)
        .map(|_| [(); 6].map(|()| random.range(-1.0, 1.0) as f32))
        .collect();
    let volume = PointVolume::new(
        Particles::Surfels {
            positions: (0..50).map(|i| DVec3::X * f64::from(i)).collect(),
            tangents: tangents.clone(),
            is_one_sided: true,
        },
        Strength::Mass(vec![1.0; 50]),
    );
    let (cloud, report) = splat_cloud(&[volume]).unwrap();
    assert!(report.findings.iter().any(|f| f.reason.contains("both")));
    for (surfel, t) in tangents.iter().enumerate() {
        let i = place_of(&cloud, DVec3::X * surfel as f64);
        let [ax, ay, az, bx, by, bz] = t.map(f64::from);
        let (a, b) = (DVec3::new(ax, ay, az), DVec3::new(bx, by, bz));
        let expected = DMat3::from_cols(a * a.x, a * a.y, a * a.z)
            + DMat3::from_cols(b * b.x, b * b.y, b * b.z);
        let apart = norm(variance(&cloud, i) - expected);
        // f32 scales and quaternions.
        assert!(apart < 2e-6 * norm(expected), "{apart}");
        assert_eq!(cloud.scales[i][2], 0.0);
        let front = unit(cloud.rotations[i]) * DVec3::Z;
        assert!(front.dot(a.cross(b).normalize()) > 1.0 - 1e-6);
        let area = std::f64::consts::TAU * a.cross(b).length();
        let opacity = 1.0 - (-1.0 / area).exp();
        assert!((f64::from(cloud.opacities[i]) - opacity).abs() < 1e-6);
    }
}

/// The mesh of a cube is closed from every side, with its corners in place.
#[test]
fn a_mesh_becomes_a_closed_surface() {
    use ewa_splat::io::{Material, Mesh, MeshPart};
    use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
    let mut part = MeshPart::default();
    for i in 0..8_u32 {
        let at = |bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
        part.positions.push(DVec3::new(at(1), at(2), at(4)));
    }
    for face in [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ] {
        let [a, b, c, d]: [u32; 4] = face;
        part.triangles.extend([[a, b, c], [a, c, d]]);
    }
    let mesh = Mesh {
        parts: vec![part],
        materials: vec![Material {
            base_colour: [0.8, 0.4, 0.2, 1.0],
            is_double_sided: false,
            ..Material::default()
        }],
        textures: Vec::new(),
    };
    let options = MeshOptions {
        spread: Spread::Spacing(0.08),
        ..MeshOptions::default()
    };
    let sampled = surfels(&mesh, &options).unwrap();
    let (cloud, report) = splat_cloud(&sampled.volumes).unwrap();
    assert_eq!(report.splat_count, sampled.report.surfel_count);
    for eye in [DVec3::new(0.0, -8.0, 0.0), DVec3::new(5.0, -4.0, 3.0)] {
        let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 4.0, [160, 160]);
        let image = picture(&cloud, &camera);
        // Tests if a pixel's line meets the cube shrunk by a spacing: a ray against three slabs.
        let forward = (-eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let up = right.cross(forward);
        let mut leaks = Vec::new();
        for (i, p) in image.pixels.iter().enumerate() {
            let [x, y] = [i % 160, i / 160].map(|k| (k as f64 + 0.5 - 80.0) * 4.0 / 160.0);
            let from = right * x - up * y + eye;
            let (mut near, mut far) = (f64::MIN, f64::MAX);
            for k in 0..3 {
                let cuts = [-0.92, 0.92].map(|side| (side - from[k]) / forward[k]);
                if forward[k].abs() > 1e-9 {
                    near = near.max(cuts[0].min(cuts[1]));
                    far = far.min(cuts[0].max(cuts[1]));
                } else if from[k].abs() > 0.92 {
                    far = f64::MIN;
                }
            }
            if near < far {
                leaks.push(1.0 - f64::from(p[3]));
            }
        }
        let mean = leaks.iter().sum::<f64>() / leaks.len() as f64;
        let (p999, most) = (quantile(leaks.clone(), 0.999), quantile(leaks, 1.0));
        println!("cube: mean {mean:.1e}, 99.9 % {p999:.1e}, most {most:.1e}");
        assert!(p999 < 1.0 / 255.0, "{p999}");
        // The centre of the picture has the material's colour.
        let [r, g, b, _] = image.pixel(80, 80);
        for (c, expected) in [r, g, b].into_iter().zip([0.8, 0.4, 0.2]) {
            assert!((c - expected).abs() < 0.01, "{c}");
        }
    }
}
