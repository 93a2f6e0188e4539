//! Tests prepared scenes: a file gives back the written data, bit for bit, and draws the same
//! pictures; damaged files are refused.

use std::path::{Path, PathBuf};

use ewa_splat::io::{OpenOptions, open};
use ewa_splat::prepared::{About, PreparedScene};
use ewa_splat::sample::mesh::Spread;
use ewa_splat::sample::{FunctionOptions, KernelOptions, SampleOptions, TransferChoice, scene};
use ewa_splat::scene::{
    Boundary, Colour, Lattice, LatticeSpacing, Particles, PointVolume, Strength, TransferFunction,
    Values,
};
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{
    Classification, ColumnSettings, Composite, Renderer, RendererOptions, SceneOptions, Settings,
};
use glam::DVec3;

use crate::common::{Random, some};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name)
}

fn sampled(name: &str, options: &SampleOptions) -> Vec<PointVolume> {
    let data = open(&fixture(name), &OpenOptions::default()).unwrap();
    scene(data, options).unwrap().volumes
}

fn grey(range: [f32; 2]) -> TransferFunction {
    let share = move |v: f32| ((v - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
    let shown = move |v: f32| if share(v) > 0.4 { 0.3 * share(v) } else { 0.0 };
    TransferFunction::from_curves(move |v| [share(v), 0.5, 0.2], shown, range, 1.0).unwrap()
}

fn of_lattice(spacing: LatticeSpacing, dims: [usize; 3], values: Values) -> PointVolume {
    PointVolume::new(
        Particles::Lattice {
            lattice: Lattice { dims, spacing },
            kernel_width: 0.6,
        },
        Strength::Classified { volumes: vec![] },
    )
    .classified(values, grey([0.0, 255.0]))
}

/// Returns a wave whose values identify the positions.
fn wave(dims: [usize; 3]) -> Vec<u8> {
    let [x, y, z] = dims;
    let value = |n: usize| {
        let at = [n % x, n / x % y, n / (x * y)].map(|i| i as f64 * 0.4);
        (127.0 + 120.0 * at[0].sin() * at[1].cos() * (0.3 * at[2]).sin()) as u8
    };
    (0..x * y * z).map(value).collect()
}

/// Returns scenes of every kind of particles, with all data that they may carry.
fn scenes() -> Vec<(&'static str, Vec<PointVolume>)> {
    let dims = [26, 15, 11];
    let uniform = LatticeSpacing::Uniform {
        origin: DVec3::new(0.1, 7.0, -3.0),
        step: glam::DMat3::from_cols_array(&[0.1, 0.02, 0.0, 0.0, 0.13, 0.0, 0.01, 0.0, 0.21]),
    };
    let line = |n: usize| (0..n).map(|i| (i as f64).powf(1.1)).collect::<Vec<f64>>();
    let rectilinear = LatticeSpacing::Rectilinear {
        coordinates: dims.map(line),
    };
    let bytes = wave(dims);
    let wide: Vec<i16> = bytes.iter().map(|v| i16::from(*v)).collect();
    let mut random = Random::new(5);
    let count = 5000;
    let positions: Vec<DVec3> = (0..count).map(|_| random.point(20.0)).collect();
    let colours = (0..count).map(|_| [0, 1, 2].map(|_| random.range(0.0, 1.0) as f32));
    let spheres = PointVolume {
        colour: Colour::PerParticle(colours.collect()),
        ..PointVolume::spheres(positions, vec![0.3; count]).with_masses(vec![0.2; count])
    };
    let with_normals = PointVolume {
        normals: Some((0..bytes.len() as u32).map(|i| i * 7919).collect()),
        ..of_lattice(rectilinear.clone(), dims, Values::U8(bytes.clone()))
    };
    let wake = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::File(fixture("wake_transfer.json")),
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    let few = SampleOptions {
        kernels: KernelOptions {
            spread: Spread::Count(1500),
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let mut both = vec![of_lattice(uniform.clone(), dims, Values::U8(bytes.clone()))];
    both.extend(sampled("vase.glb", &few));
    vec![
        (
            "a curvilinear grid, planes of its boundary and local models",
            sampled("wake.xyz", &wake),
        ),
        (
            "a lattice with faces",
            vec![PointVolume {
                boundary: Some(Boundary::Lattice),
                ..of_lattice(uniform.clone(), dims, Values::U8(bytes))
            }],
        ),
        (
            "a rectilinear lattice",
            vec![of_lattice(rectilinear, dims, Values::I16(wide))],
        ),
        ("a lattice with normals", vec![with_normals]),
        ("spheres with colours of their own", vec![spheres]),
        ("a snapshot", sampled("swift.h5", &SampleOptions::default())),
        ("a mesh", sampled("vase.glb", &few)),
        (
            "splats with harmonics",
            sampled("splats/scene.ply", &SampleOptions::default()),
        ),
        ("a grid and a mesh", both),
    ]
}

/// Returns cameras near and far.
fn cameras(renderer: &Renderer) -> [Camera; 2] {
    [2.5, 0.12].map(|zoom| {
        let view = Viewpoint {
            azimuth_deg: 30.0,
            elevation_deg: 25.0,
            zoom,
            up: DVec3::Z,
        };
        let boxes = renderer.visible_boxes();
        view.camera(&boxes, Lens::FovDeg(35.0), [40, 30]).unwrap()
    })
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn a_prepared_scene_is_the_scene_it_was_made_of() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.arrow");
    for (name, volumes) in scenes() {
        for level_of_detail in some([true, false], name.len(), 2) {
            let options = SceneOptions {
                level_of_detail,
                keep_indices: !level_of_detail,
                ..SceneOptions::default()
            };
            let about = About {
                fields: vec![Some("density".into()), None],
                up: [0.0, 1.0, 0.0],
                ..About::default()
            };
            let prepared = PreparedScene::new(volumes.clone(), &options).unwrap();
            let bytes = prepared.write(&path, &about).unwrap();
            assert_eq!(std::fs::metadata(&path).unwrap().len(), bytes, "{name}");
            let (mapped, told) = PreparedScene::open(&path).unwrap();
            assert_eq!(told, about);
            let mut found =
                Renderer::with_options(vec![mapped], RendererOptions::default()).unwrap();
            let mut expected = Renderer::with_options(volumes.clone(), &options).unwrap();
            // Compares everything: blocks, columns, functions, grids, by their debug output.
            let volumes = expected.volumes().iter().zip(found.volumes());
            for (a, b) in volumes {
                assert_eq!(format!("{a:?}"), format!("{b:?}"), "{name}");
            }
            assert_eq!(expected.volumes().len(), found.volumes().len());
            assert_eq!(expected.requirements(), found.requirements(), "{name}");
            assert_eq!(expected.visible_boxes(), found.visible_boxes(), "{name}");
            assert_eq!(expected.boxes(), found.boxes(), "{name}");
            assert_eq!(expected.amplitudes(), found.amplitudes(), "{name}");
            assert_eq!(expected.bytes_per_particle(), found.bytes_per_particle());
            for camera in cameras(&expected) {
                // Slabs need the data's own particles.
                let all = settings(name);
                let count = if level_of_detail { 1 } else { all.len() };
                for settings in all.into_iter().take(count) {
                    let a = expected.render(&camera, &settings).unwrap();
                    let b = found.render(&camera, &settings).unwrap();
                    assert_eq!(bits(&a.pixels.concat()), bits(&b.pixels.concat()), "{name}");
                    assert!(a.pixels.iter().any(|p| p[3] > 0.0), "{name} shows nothing");
                }
                let columns = ColumnSettings::default();
                let a = expected.column_density(&camera, &columns);
                let b = found.column_density(&camera, &columns);
                match (a, b) {
                    (Ok(a), Ok(b)) => assert_eq!(bits(&a.values), bits(&b.values), "{name}"),
                    (Err(a), Err(b)) => assert_eq!(a.to_string(), b.to_string()),
                    _ => panic!("{name}: columns of one alone"),
                }
            }
        }
    }
}

/// Returns settings for kernels one by one and, if possible, for slabs, whose thickness follows
/// from densities that the file stores.
fn settings(name: &str) -> Vec<Settings> {
    let mut all = vec![Settings::default()];
    if !name.contains("splats") && !name.contains("mesh") {
        let classify = match name {
            "spheres with colours of their own" => Classification::Extent,
            _ => Classification::Slab,
        };
        all.push(Settings {
            composite: Composite::SLABS,
            classify,
            ..Settings::default()
        });
    }
    all
}

/// Returns the bytes of a file with a scene of some hundred particles.
fn small() -> Vec<u8> {
    let mut random = Random::new(3);
    let positions: Vec<DVec3> = (0..700).map(|_| random.point(5.0)).collect();
    let spheres = PointVolume::spheres(positions, vec![0.3; 700]).with_masses(vec![0.2; 700]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.arrow");
    let scene = PreparedScene::new(vec![spheres], &SceneOptions::default()).unwrap();
    scene.write(&path, &About::default()).unwrap();
    std::fs::read(path).unwrap()
}

fn refusal(bytes: Vec<u8>) -> String {
    let error = PreparedScene::of_bytes(Path::new("a.arrow"), bytes).unwrap_err();
    error.to_string()
}

#[test]
fn a_file_that_is_cut_is_refused_wherever_that_is() {
    let whole = small();
    for len in (0..whole.len()).step_by(97) {
        let text = refusal(whole[..len].to_vec());
        assert!(
            text.starts_with("a.arrow: ") && !text.contains('\n'),
            "{text}"
        );
    }
}

#[test]
fn another_version_another_table_and_numbers_that_do_not_belong_together_are_refused() {
    let whole = small();
    let place_of = |text: &[u8]| {
        let found = whole.windows(text.len()).rposition(|w| w == text);
        found.unwrap_or_else(|| panic!("{:?} is there", String::from_utf8_lossy(text)))
    };
    let changed = |text: &[u8], other: &[u8]| {
        let mut bytes = whole.clone();
        // The footer's schema, which is the last, takes effect.
        let place = place_of(text);
        bytes[place..place + other.len()].copy_from_slice(other);
        refusal(bytes)
    };
    let version = changed(b"{\"version\":1", b"{\"version\":7");
    assert!(version.contains("version 1, found 7"), "{version}");
    let key = changed(b"ewa_splat", b"ewa_splot");
    assert!(key.contains("the key ewa_splat"), "{key}");
    let column = changed(b"half_extent", b"half_extend");
    assert!(column.contains("`half_extend`"), "{column}");
    let kind = changed(b"\"isotropic\"", b"\"isotropik\"");
    assert!(kind.contains("isotropik"), "{kind}");
}

#[test]
fn a_prepared_scene_is_recognised_and_is_no_data() {
    let error = ewa_splat::io::read("a.arrow", &small(), &OpenOptions::default()).unwrap_err();
    assert!(error.to_string().contains("drawn as they are"), "{error}");
}

/// A prepared scene beside others, and with another transfer function, equals volumes made here.
#[test]
fn prepared_scenes_join_and_take_other_functions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.arrow");
    let dims = [20, 13, 9];
    let spacing = LatticeSpacing::Rectilinear {
        coordinates: dims.map(|n| (0..n).map(|i| i as f64 * 0.3).collect()),
    };
    let lattice = of_lattice(spacing, dims, Values::U8(wave(dims)));
    let ball = PointVolume::spheres([DVec3::new(3.0, 2.0, 1.0)], [0.4]).with_masses([0.5]);
    let options = SceneOptions::default();
    let scene = PreparedScene::new(vec![lattice.clone()], &options).unwrap();
    scene.write(&path, &About::default()).unwrap();
    let mapped = PreparedScene::open(&path).unwrap().0;
    let other = PreparedScene::new(vec![ball.clone()], &options).unwrap();
    let mut found =
        Renderer::with_options(vec![mapped, other], RendererOptions::default()).unwrap();
    let mut expected = Renderer::new(vec![lattice, ball]).unwrap();
    let function = grey([50.0, 180.0]);
    for renderer in [&mut found, &mut expected] {
        renderer.set_transfer_function(0, function.clone()).unwrap();
    }
    assert_eq!(expected.visible_boxes(), found.visible_boxes());
    for camera in cameras(&expected) {
        let a = expected.render(&camera, &Settings::default()).unwrap();
        let b = found.render(&camera, &Settings::default()).unwrap();
        assert_eq!(bits(&a.pixels.concat()), bits(&b.pixels.concat()));
    }
}
