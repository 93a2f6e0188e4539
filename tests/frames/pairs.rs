//! Tests every pair of settings on a scene with all kinds of data. Either the pair draws what both
//! settings mean, by a law of each that holds with any other, or it is refused with an error; on
//! both back ends.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    reason = "a test may panic, and its numbers are small"
)]

use std::sync::Arc;

use ewa_splat::Filter;
use ewa_splat::math::normal_code;
use ewa_splat::render::{Advanced, Backdrop, SimdLevel};
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Lighting, Particles, PointVolume, Shadows, Strength,
    TransferFunction,
};
use ewa_splat::view::{Aperture, Camera, ClipPlane, Projection};
use ewa_splat::{Classification, Composite, DepthImage, Image, Renderer, Settings, Show};
use glam::{DMat3, DVec3};

use crate::common::scene::camera;

/// Setting, and its law: the effect on a picture, compared with the picture without the setting.
struct Setting {
    name: &'static str,
    apply: fn(&mut Settings),
    law: Law,
}

#[derive(Clone, Copy)]
enum Law {
    /// All channels of all pixels agree within this.
    SamePicture(f32),
    /// Opacity agrees everywhere, within this; the light may differ.
    AsOpaque(f32),
    /// Nowhere more opaque, somewhere less.
    LessOpaque,
    /// Nowhere less opaque.
    MoreOpaque,
    /// Kernels are summed before they are composited: as opaque as one by one. With an opacity of
    /// min(tau, 1), which is not multiplicative, at least as opaque.
    Summed(f32),
    /// Transparent parts show this colour.
    Behind([f32; 3]),
    /// Whole numbers, equal in all colours, whose sum is the number of splat-pixels; opaque.
    Counts,
    /// Colours from the list of choices, as opaque as the scene.
    Choices,
    /// Numbers between 0 and 1, and something of the scene is visible.
    Finite,
}

const BACKGROUND: [f32; 3] = [0.25, 0.5, 0.125];

fn plane(normal: DVec3, distance: f64) -> Vec<ClipPlane> {
    vec![ClipPlane { normal, distance }]
}

/// Returns a plane that stands in the middle of the lattice, in the right half of the picture.
fn halfway() -> Arc<Backdrop> {
    let [width, height] = [24, 24];
    let depth = |i: usize| match i % width < width / 2 {
        true => f32::INFINITY,
        false => 6.1,
    };
    let depths = (0..width * height).map(depth).collect();
    let depth = DepthImage {
        width,
        height,
        depths,
    };
    Arc::new(Backdrop::new(depth).unwrap())
}

/// Returns the default lights with shadows.
fn with_shadows(softness_deg: f64) -> Option<Lighting> {
    Some(Lighting {
        shadows: Some(Shadows { softness_deg }),
        ..Lighting::default()
    })
}

/// Returns all settings that change the picture. Settings of one field are in one group and form no
/// pair.
fn settings() -> Vec<(&'static str, Vec<Setting>)> {
    let one = |name, apply, law| Setting { name, apply, law };
    vec![
        (
            "composite",
            vec![
                one(
                    "sheets",
                    |s| s.composite = Composite::SHEETS,
                    Law::Summed(2e-4),
                ),
                one(
                    "axis-sheets",
                    |s| s.composite = Composite::AXIS_SHEETS,
                    Law::Summed(2e-4),
                ),
                one(
                    "slabs",
                    |s| s.composite = Composite::SLABS.with_thickness(Some(0.7)),
                    Law::Summed(2e-4),
                ),
                one(
                    "classified slabs",
                    |s| {
                        s.composite = Composite::SLABS.with_thickness(Some(0.7));
                        s.classify = Classification::Slab;
                    },
                    // The extinction is the same for all values, up to its table.
                    Law::Summed(2e-3),
                ),
            ],
        ),
        (
            "filter",
            vec![
                one("exact", |s| s.filter = Filter::Exact, Law::AsOpaque(2e-3)),
                one("ewa", |s| s.filter = Filter::Ewa, Law::AsOpaque(2e-2)),
                one("low-pass", |s| s.filter = Filter::LowPass, Law::Finite),
                one("isotropic", |s| s.filter = Filter::Isotropic, Law::Finite),
                one(
                    "uniform scaling",
                    |s| s.filter = Filter::UniformScaling,
                    Law::Finite,
                ),
                one(
                    "reconstruction",
                    |s| s.filter = Filter::Reconstruction,
                    Law::Finite,
                ),
            ],
        ),
        (
            "thresholds",
            vec![one(
                "thresholds",
                |s| s.advanced.thresholds = Some([0.3, 2.0]),
                Law::AsOpaque(4e-2),
            )],
        ),
        (
            "level of detail",
            vec![one(
                "level of detail",
                |s| s.level_of_detail = true,
                Law::SamePicture(4e-3),
            )],
        ),
        (
            "opacity",
            vec![one(
                "linear opacity",
                |s| s.advanced.linear_opacity = true,
                Law::MoreOpaque,
            )],
        ),
        (
            "show",
            vec![
                one("count", |s| s.show = Show::Count, Law::Counts),
                one("choice", |s| s.show = Show::Choice, Law::Choices),
            ],
        ),
        (
            "clip",
            vec![
                one(
                    "clipped beside everything",
                    |s| s.clip = plane(DVec3::X, 100.0),
                    Law::SamePicture(2e-5),
                ),
                one(
                    "clipped",
                    |s| s.clip = plane(DVec3::X, 0.1),
                    Law::LessOpaque,
                ),
            ],
        ),
        (
            "backdrop",
            vec![one(
                "ends of rays",
                |s| s.backdrop = Some(halfway()),
                Law::LessOpaque,
            )],
        ),
        (
            "background",
            vec![one(
                "background",
                |s| s.background = Some(BACKGROUND),
                Law::Behind(BACKGROUND),
            )],
        ),
        (
            "depth",
            vec![one("depth", |s| s.depth = true, Law::SamePicture(0.0))],
        ),
        (
            "normals",
            vec![one("normals", |s| s.normals = true, Law::SamePicture(0.0))],
        ),
        (
            "lighting",
            vec![
                one(
                    "light",
                    |s| s.lighting = Some(Lighting::default()),
                    Law::AsOpaque(1e-6),
                ),
                one(
                    "shadows",
                    |s| s.lighting = with_shadows(0.0),
                    Law::AsOpaque(1e-6),
                ),
                one(
                    "soft shadows",
                    |s| s.lighting = with_shadows(5.0),
                    Law::AsOpaque(1e-6),
                ),
            ],
        ),
        (
            "sub-pixel opacity",
            vec![one(
                "lone kernels",
                |s| s.advanced.sub_pixel_opacity = true,
                Law::LessOpaque,
            )],
        ),
        (
            "cut-off",
            vec![one(
                "cut-off",
                |s| s.cutoff = Some(5.0),
                Law::SamePicture(4e-3),
            )],
        ),
        (
            "tolerance",
            // The other tests' settings have a tighter one.
            vec![one(
                "tolerance",
                |s| s.tolerance = 1.0 / 255.0,
                Law::SamePicture(1.6e-2),
            )],
        ),
        (
            "low-pass",
            vec![one(
                "low-pass variance",
                |s| s.low_pass_variance_px2 = 2.0,
                Law::Finite,
            )],
        ),
        (
            "aperture",
            vec![one(
                "aperture",
                |s| {
                    s.aperture = Some(Aperture {
                        diameter: 0.2,
                        focus: 6.0,
                        pictures: 3,
                    });
                },
                Law::Finite,
            )],
        ),
    ]
}

/// Pairs that contradict each other, with a word of the error.
const REFUSED: [(&str, &str, &str); 10] = [
    ("classified slabs", "shadows", "shadows"),
    ("classified slabs", "soft shadows", "shadows"),
    ("classified slabs", "choice", "what draws each kernel"),
    (
        "classified slabs",
        "lone kernels",
        "opacity of lone kernels",
    ),
    ("exact", "thresholds", "thresholds"),
    ("aperture", "thresholds", "thresholds"),
    ("aperture", "count", "counts"),
    ("aperture", "ends of rays", "backdrop"),
    ("aperture", "depth", "depths"),
    ("aperture", "normals", "normals"),
];

fn refusal(a: &Setting, b: &Setting) -> Option<&'static str> {
    let filters = [
        "exact",
        "ewa",
        "low-pass",
        "isotropic",
        "uniform scaling",
        "reconstruction",
    ];
    let is =
        |name: &str, s: &Setting| s.name == name || (name == "exact" && filters.contains(&s.name));
    REFUSED
        .iter()
        .find(|(x, y, _)| {
            // Only thresholds are refused with every filter.
            let pair = |s: &Setting, t: &Setting| {
                let first = if *y == "thresholds" {
                    is(x, s)
                } else {
                    s.name == *x
                };
                first && t.name == *y
            };
            pair(a, b) || pair(b, a)
        })
        .map(|(_, _, words)| *words)
}

/// Returns a lattice with a field of one extinction, small kernels, and a tilted square of surfels
/// that passes through it and covers some pixels in part.
fn scene() -> Vec<PointVolume> {
    let n = 9;
    let step = DMat3::from_diagonal(DVec3::splat(0.25));
    let origin = DVec3::new(-1.0, -1.0, 5.0);
    let lattice = Lattice {
        dims: [n; 3],
        spacing: LatticeSpacing::Uniform { origin, step },
    };
    let nodes = (0..lattice.len()).map(|i| [i % n, i / n % n, i / (n * n)]);
    let values: Vec<f32> = nodes
        .map(|cell| {
            let x = lattice.position(cell) - DVec3::new(0.2, -0.1, 6.0);
            (0.5 + 0.3 * x.x + 0.2 * (3.0 * x.y).sin()) as f32
        })
        .collect();
    let colours = |v: f32| [v, 0.2 + 0.5 * v, 1.0 - v];
    let transfer = TransferFunction::from_curves(colours, |_| 0.4, [0.0, 1.0], 1.0).unwrap();
    let normals = vec![0x4000_2000_u32; values.len()];
    let field = PointVolume {
        normals: Some(normals),
        ..PointVolume::lattice(lattice, values, transfer)
    };
    let (mut positions, mut tangents, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let (step, s) = (0.15, 0.09_f32);
    for y in -6..=6 {
        for x in -4..=4 {
            let (x, y) = (f64::from(x) * step, f64::from(y) * step);
            positions.push(DVec3::new(x + 0.3, y, 6.0 + 0.5 * x));
            tangents.push([s, 0.0, 0.5 * s, 0.0, s, 0.0]);
            areas.push((step * step * 1.25_f64.sqrt()) as f32);
        }
    }
    // The normals are rounder than the surfels' surface.
    let rounder = |p: &DVec3| normal_code(DVec3::new(0.5 + 0.3 * p.x, 0.3 * p.y, -1.0));
    let normals = positions.iter().map(rounder).collect();
    let surface = PointVolume {
        colour: Colour::Uniform([0.9, 0.3, 0.1]),
        normals: Some(normals),
        ..PointVolume::new(
            Particles::Surfels {
                positions,
                tangents,
                is_one_sided: false,
            },
            Strength::Surface(areas),
        )
    };
    vec![field, surface]
}

fn eye() -> Camera {
    camera(Projection::Perspective, [48.0; 2], [24, 24])
}

fn base() -> Settings {
    Settings {
        tolerance: 1e-4,
        level_of_detail: false,
        advanced: Advanced {
            // The CPU uses no fused operations, as the device uses none.
            simd: SimdLevel::Baseline,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

/// Picture, and the number of its splat-pixels.
struct Drawn {
    image: Image,
    splat_pixels: u64,
}

fn draw(renderer: &mut Renderer, settings: &Settings) -> Result<Drawn, String> {
    match renderer.render(&eye(), settings) {
        Ok(image) => {
            let image = image.clone();
            Ok(Drawn {
                image,
                splat_pixels: renderer.counts().splat_pixels,
            })
        }
        Err(error) => Err(error.to_string()),
    }
}

impl Law {
    /// Compares a picture with the setting to the one without it.
    fn hold(
        self,
        name: &str,
        with: &Drawn,
        without: &Drawn,
        beside: &Settings,
    ) -> Result<(), String> {
        let ensure = |holds: bool, what: String| {
            if holds {
                Ok(())
            } else {
                Err(format!("{name}: {what}"))
            }
        };
        let pairs = || with.image.pixels.iter().zip(&without.image.pixels);
        let worst = |of: &dyn Fn(&[f32; 4], &[f32; 4]) -> f32| {
            pairs().map(|(a, b)| of(a, b)).fold(f32::MIN, f32::max)
        };
        let off = |a: &[f32; 4], b: &[f32; 4]| {
            let channels = a.iter().zip(b);
            channels.map(|(x, y)| (x - y).abs()).fold(0.0, f32::max)
        };
        // Many settings change the colours of choices and the numbers of kernels.
        let shows_scene = beside.show == Show::Scene;
        if beside.show == Show::Count && !matches!(self, Self::Counts) {
            return Self::Counts.hold(name, with, without, beside);
        }
        match self {
            Self::SamePicture(most) if shows_scene => {
                let most_off = worst(&off);
                ensure(most_off <= most, most_off.to_string())?;
            }
            Self::SamePicture(most) | Self::AsOpaque(most) => {
                let most_off = worst(&|a, b| (a[3] - b[3]).abs());
                ensure(most_off <= most, most_off.to_string())?;
            }
            Self::Summed(most) => {
                let most_less = worst(&|a, b| b[3] - a[3]);
                let most_more = worst(&|a, b| a[3] - b[3]);
                ensure(most_less <= most, most_less.to_string())?;
                ensure(
                    most_more <= most || beside.advanced.linear_opacity,
                    most_more.to_string(),
                )?;
            }
            Self::LessOpaque => {
                // Roundings, and the smaller part that the cut-off of fainter kernels omits.
                let most_more = worst(&|a, b| a[3] - b[3]);
                ensure(most_more <= 3e-4, most_more.to_string())?;
                // Without a low-pass filter to spread them, lone kernels do not change.
                let unfiltered = [Filter::Reconstruction, Filter::UniformScaling];
                if beside.background.is_none() && !unfiltered.contains(&beside.filter) {
                    let most_less = worst(&|a, b| b[3] - a[3]);
                    ensure(most_less > 5e-4, format!("no less anywhere, {most_less}"))?;
                }
            }
            Self::MoreOpaque => {
                let most_less = worst(&|a, b| b[3] - a[3]);
                ensure(most_less <= 1e-4, most_less.to_string())?;
            }
            Self::Behind(colour) => {
                let expected = |p: &[f32; 4]| {
                    let behind = |i: usize| p[i] + (1.0 - p[3]) * colour[i];
                    [behind(0), behind(1), behind(2), 1.0]
                };
                let most_off = worst(&|a, b| off(a, &expected(b)));
                ensure(most_off <= 1e-6, most_off.to_string())?;
            }
            Self::Counts => {
                let sum: f64 = with.image.pixels.iter().map(|p| f64::from(p[0])).sum();
                ensure(
                    sum as u64 == with.splat_pixels,
                    format!("{sum} of {}", with.splat_pixels),
                )?;
                let is_count = |p: &[f32; 4]| {
                    p[0].fract() == 0.0 && p[0] == p[1] && p[0] == p[2] && p[3] == 1.0
                };
                ensure(with.image.pixels.iter().all(is_count), "no counts".into())?;
                ensure(sum > 0.0, "nothing counted".into())?;
            }
            Self::Choices => {
                if beside.background.is_none() {
                    let most_off = worst(&|a, b| (a[3] - b[3]).abs());
                    ensure(most_off <= 1e-6, most_off.to_string())?;
                }
                Self::Finite.hold(name, with, without, beside)?;
            }
            Self::Finite => {
                let is_colour = |x: &f32| (0.0..=1.001).contains(x);
                let pixels = with.image.pixels.as_flattened();
                ensure(pixels.iter().all(is_colour), "no colours".into())?;
                let is_seen = with.image.pixels.iter().any(|p| p[3] > 0.1);
                ensure(is_seen, "nothing is seen".into())?;
            }
        }
        Ok(())
    }
}

#[test]
fn every_pair_of_settings_means_both_or_is_refused() {
    let mut on_cpu = Renderer::new(scene()).unwrap();
    #[cfg(feature = "gpu")]
    let mut on_gpu = crate::common::gpu::pictures()
        .map(|gpu| Renderer::new(scene()).unwrap().on(gpu.clone()).unwrap());
    let all = settings();
    let groups: Vec<(usize, &Setting)> = (0..)
        .zip(&all)
        .flat_map(|(group, (_, settings))| settings.iter().map(move |s| (group, s)))
        .collect();
    let with = |settings: &[&Setting]| {
        let mut out = base();
        settings.iter().for_each(|s| (s.apply)(&mut out));
        out
    };
    let bare = draw(&mut on_cpu, &base()).unwrap();
    let alone: Vec<Drawn> = groups
        .iter()
        .map(|(_, s)| {
            let settings = with(&[s]);
            let drawn = draw(&mut on_cpu, &settings).unwrap();
            s.law.hold(s.name, &drawn, &bare, &base()).unwrap();
            drawn
        })
        .collect();
    let (mut drawn_pairs, mut refused) = (0, 0);
    let mut faults = Vec::new();
    for (i, (group_a, a)) in groups.iter().enumerate() {
        for (j, (group_b, b)) in groups.iter().enumerate().skip(i + 1) {
            if group_a == group_b {
                continue;
            }
            let name = format!("{} and {}", a.name, b.name);
            let both = with(&[a, b]);
            let drawn = draw(&mut on_cpu, &both);
            if let Some(words) = refusal(a, b) {
                match drawn {
                    Err(error) if error.contains(words) => {}
                    Err(error) => faults.push(format!("{name}: {error}")),
                    Ok(_) => faults.push(format!("{name} is drawn")),
                }
                refused += 1;
                continue;
            }
            let drawn = match drawn {
                Ok(drawn) => drawn,
                Err(error) => {
                    faults.push(format!("{name}: {error}"));
                    continue;
                }
            };
            faults.extend(a.law.hold(&name, &drawn, &alone[j], &with(&[b])).err());
            faults.extend(b.law.hold(&name, &drawn, &alone[i], &with(&[a])).err());
            drawn_pairs += 1;
            #[cfg(feature = "gpu")]
            if let Some(on_gpu) = &mut on_gpu {
                let twin = draw(on_gpu, &both).unwrap_or_else(|error| panic!("{name}: {error}"));
                let pixels = drawn.image.pixels.iter().zip(&twin.image.pixels);
                let differs = |(p, q): &(&[f32; 4], &[f32; 4])| {
                    let channels = p.iter().zip(*q);
                    // Counts differ only by the flips below.
                    channels.fold(0.0_f32, |most, (x, y)| most.max((x - y).abs())) > 2e-5
                };
                // A pixel within rounding of a cut-off may fall on either side of it.
                let flips = pixels.filter(differs).count();
                if flips > 1 {
                    faults.push(format!(
                        "{name}: {flips} pixels differ between the back ends"
                    ));
                }
            }
        }
    }
    println!("{drawn_pairs} pairs drawn, {refused} refused");
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(drawn_pairs > 200 && refused == 15);
}
