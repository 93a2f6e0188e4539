//! Opens the device that the tests of the GPU back end share, and compares the back ends' pictures.

use std::collections::BTreeMap;
use std::panic::Location;
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Instant;

use ewa_splat::image::Image;
use ewa_splat::scene::PointVolume;
use ewa_splat::stages::constants::{SPLAT_CEILING, TERMINATION_SHARE, TILE_SIZE};
use ewa_splat::stages::cpu::{Bins, SimdLevel};
use ewa_splat::stages::record::{Footprint, PATH_CAPPED, PATH_EXACT, PATH_NEAR, PATH_PEAK};
use ewa_splat::stages::splat::evaluate_near;
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Settings};
use glam::{DVec2, Vec3};

use super::frame::Frame;

use ewa_splat::render::{AdapterChoice, Advanced, Gpu};

/// Opens the device, or prints a note and returns `None` if there is no adapter.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| match Gpu::open(AdapterChoice::Any) {
        Ok(gpu) => {
            println!("adapter: {}", gpu.adapter());
            Some(gpu)
        }
        Err(e) => {
            let required = std::env::var_os("EWA_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!required, "a GPU adapter is required: {e}");
            println!("skipped: {e}");
            None
        }
    })
    .as_ref()
}

/// Returns false if the tests run on a graphics card. Its roundings are not the CPU's: it fuses
/// operations, and its quotients, roots and logarithms have errors of their own.
pub fn is_software() -> bool {
    gpu().is_none_or(Gpu::is_software)
}

/// Opens the device for tests that compare full pictures. A graphics card runs them always, a
/// software adapter only with `EWA_PICTURES=1`. Tests of single stages, and a few pictures, check
/// the same formulas in a tenth of the time.
pub fn pictures() -> Option<&'static Gpu> {
    let is_asked = std::env::var_os("EWA_PICTURES").is_some_and(|v| v == "1");
    let gpu = gpu().filter(|gpu| is_asked || !gpu.is_software());
    if gpu.is_none() {
        println!("skipped: a whole picture on a software adapter (EWA_PICTURES=1)");
    }
    gpu
}

/// Largest difference between the two back ends' pictures, relative to full scale, at pixels not at
/// a threshold. It comes from f32 roundings in different orders along a ray of many layers.
pub const ALIKE: f32 = 2e-5;

/// As [`ALIKE`], on the device of the tests. A graphics card's fused operations and quotients change
/// the exponents of kernels by some roundings more; 9.2e-5 was measured on an H200.
pub fn rounding() -> f32 {
    if is_software() { ALIKE } else { 1e-4 }
}

/// Draws a scene on both back ends and compares the pictures. Returns the number of pixels that
/// differ at a threshold, or `None` if there is no adapter.
pub fn assert_alike(
    name: &str,
    scene: &PointVolume,
    camera: &Camera,
    settings: &Settings,
) -> Option<usize> {
    let gpu = gpu()?;
    let settings = Settings {
        advanced: Advanced {
            // The CPU uses no fused operations, as the device uses none.
            simd: SimdLevel::Baseline,
            ..settings.advanced
        },
        ..settings.clone()
    };
    let mut on_cpu = Renderer::new(vec![scene.clone()]).unwrap();
    on_cpu.render(camera, &settings).unwrap();
    let on_gpu = Renderer::new(vec![scene.clone()]).unwrap();
    let mut on_gpu = on_gpu.on(gpu.clone()).unwrap();
    on_gpu.render(camera, &settings).unwrap();
    let (a, b) = (on_cpu.image(), on_gpu.image());
    let differs = |(p, q): (&[f32; 4], &[f32; 4])| {
        p.iter()
            .zip(q)
            .any(|(x, y)| !((x - y).abs() <= rounding()) && x.to_bits() != y.to_bits())
    };
    println!("{name}: {:?} {:?}", on_cpu.counts(), on_gpu.counts());
    let (c, d) = (on_cpu.counts(), on_gpu.counts());
    assert_eq!(c.blocks, d.blocks, "{name}");
    // A hardware GPU's quotients and roots may fall on the other side of a threshold.
    let flips = if gpu.is_software() {
        0
    } else {
        2 + c.blocks / 1000
    };
    let alike = |a: usize, b: usize| a.abs_diff(b) <= flips;
    assert!(
        alike(c.blocks_culled, d.blocks_culled),
        "{name}: {c:?} {d:?}"
    );
    assert!(
        alike(c.blocks_merged, d.blocks_merged),
        "{name}: {c:?} {d:?}"
    );
    let mut filters = c.block_filters.iter().zip(d.block_filters);
    assert!(filters.all(|(&a, b)| alike(a, b)), "{name}: {c:?} {d:?}");
    assert_eq!(c.classified, d.classified, "{name}");
    // A footprint at the image's border may reach it on one back end only.
    let near = |a: usize, b: usize| a.abs_diff(b) <= 2 + a / 1000;
    assert!(near(c.footprints, d.footprints), "{name}: {c:?} {d:?}");
    assert!(near(c.tile_entries, d.tile_entries), "{name}: {c:?} {d:?}");
    let mut flips = 0;
    if a.pixels.iter().zip(&b.pixels).any(differs) {
        let frame = Frame::new(scene.clone(), camera, &settings);
        flips = explained_flips(&frame, &frame.bins(), a, b, rounding());
    }
    println!(
        "{name}: {flips} of {} pixels differ at a threshold",
        a.pixels.len()
    );
    if let (Some(a), Some(b)) = (on_cpu.depth(), on_gpu.depth()) {
        // Another footprint gives the depth if the opacity before it is within rounding of a half.
        let differ = |(x, y): &(&f32, &f32)| !((*x - *y).abs() <= 1e-5 * x.abs() || x == y);
        let count = a.depths.iter().zip(&b.depths).filter(differ).count();
        println!("{name}: {count} depths differ");
        assert!(count <= flips + 2 + a.depths.len() / 1000, "{name}");
    }
    assert_eq!(on_cpu.depth().is_some(), on_gpu.depth().is_some());
    Some(flips)
}

/// Number of pictures that [`hold_sampled`] compares at the start of each test line. Later it
/// compares every one whose number is a power of two. A software adapter takes seconds for some: it
/// compares the first of each line alone, unless `EWA_PICTURES=1`.
const FIRST: usize = 6;

/// Runs [`assert_alike`] on a sample of the pictures that each line of the tests draws.
#[track_caller]
pub fn hold_sampled(scene: &PointVolume, camera: &Camera, settings: &Settings) {
    static DRAWN: Mutex<BTreeMap<(&str, u32), usize>> = Mutex::new(BTreeMap::new());
    let line = Location::caller();
    let n = {
        let mut drawn = DRAWN.lock().unwrap_or_else(PoisonError::into_inner);
        let n = drawn.entry((line.file(), line.line())).or_default();
        *n += 1;
        *n - 1
    };
    if n == 0 || (n < FIRST || n.is_power_of_two()) && pictures().is_some() {
        let name = format!("{}:{}, picture {n}", line.file(), line.line());
        let start = Instant::now();
        if let Some(flips) = assert_alike(&name, scene, camera, settings) {
            println!("{name}: {flips} flips, {:.0?}", start.elapsed());
        }
    }
}

/// Counts the pixels of two pictures of one frame that differ by more than `rounding`. It fails if
/// such a pixel lies on no threshold: no kernel of its tile has its cut-off within rounding there,
/// and the tile's opacity is nowhere within rounding of the termination threshold. On a graphics
/// card, two kernels whose depths differ by roundings also explain a pixel.
pub fn explained_flips(frame: &Frame, bins: &Bins, a: &Image, b: &Image, rounding: f32) -> usize {
    let mut flips = 0;
    for (i, (p, q)) in a.pixels.iter().zip(&b.pixels).enumerate() {
        // NaN differs from everything but the same bits.
        let differs =
            |(x, y): (&f32, &f32)| !((x - y).abs() <= rounding) && x.to_bits() != y.to_bits();
        if !p.iter().zip(q).any(differs) {
            continue;
        }
        flips += 1;
        let (x, y) = (i % a.width, i / a.width);
        let tile = y / TILE_SIZE * frame.tiles[0] + x / TILE_SIZE;
        assert!(
            bins.tile(tile)
                .any(|n| is_on_cutoff(frame, n as usize, x, y))
                || ends_at_a_threshold(frame, bins, tile)
                || !is_software()
                    && most_of_a_swap(frame, bins, tile, x, y) >= most_difference(p, q),
            "pixel ({x}, {y}): {p:?} and {q:?}, and no threshold near"
        );
    }
    flips
}

/// Returns the greatest difference of a channel.
fn most_difference(p: &[f32; 4], q: &[f32; 4]) -> f64 {
    let differences = p.iter().zip(q).map(|(x, y)| f64::from((x - y).abs()));
    differences.fold(0.0, f64::max)
}

/// Returns the most that a pixel changes if neighbours in the order of depth change places where their
/// depths differ by roundings: the product of their opacities times the difference of their colours.
fn most_of_a_swap(frame: &Frame, bins: &Bins, tile: usize, x: usize, y: usize) -> f64 {
    let here: Vec<_> = bins
        .tile(tile)
        .map(|n| {
            let f = &frame.footprints[n as usize];
            let opacity = -(-optical_depth(frame, f, n as usize, x, y)).exp_m1();
            (f, opacity)
        })
        .filter(|(_, opacity)| *opacity > 0.0)
        .collect();
    let mut most = 0.0;
    for pair in here.windows(2) {
        let [(a, of_a), (b, of_b)] = [pair[0], pair[1]];
        if (a.depth - b.depth).abs() <= 8.0 * f32::EPSILON * a.depth.abs().max(b.depth.abs()) {
            let (c, d) = (a.carried.colour(), b.carried.colour());
            let colour = (0..3).map(|i| f64::from((c[i] - d[i]).abs()));
            most += of_a * of_b * colour.fold(0.0, f64::max);
        }
    }
    most
}

/// Returns true if a pixel centre lies within f32 rounding of a footprint's cut-off.
fn is_on_cutoff(frame: &Frame, n: usize, x: usize, y: usize) -> bool {
    let f = &frame.footprints[n];
    let wide = |v: [f32; 2]| DVec2::new(f64::from(v[0]), f64::from(v[1]));
    let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    if f.path & 3 == PATH_NEAR {
        let slope = (at - wide(frame.uniform.centre_px)) / wide(frame.uniform.focal_px);
        let ray = Vec3::new(slope.x as f32, slope.y as f32, 1.0);
        let terms = &frame.near[(f.path >> 2) as usize];
        let inside = |share: f32| evaluate_near(terms, 1.0, ray, f.cutoff_squared * share) > 0.0;
        return inside(1.0 + 1e-4) != inside(1.0 - 1e-4);
    }
    let d = at - wide(f.centre_px);
    let (p, r) = (wide(f.form_p).dot(d), wide(f.form_r).dot(d));
    let mut q = p * p + r * r;
    if f.path & 3 == PATH_EXACT {
        let terms = &frame.exact[n];
        let [hxx, hxy, hyy] = terms.hessian.map(f64::from);
        q /=
            1.0 + wide(terms.gradient).dot(d) + hxx * d.x * d.x + hxy * d.x * d.y + hyy * d.y * d.y;
    }
    let cutoff = f64::from(f.cutoff_squared);
    // The error of the centre, a few roundings of its coordinate, times the form's slope there.
    let slope = 2.0 * q.sqrt() * (wide(f.form_p).length() + wide(f.form_r).length());
    let pixel = 4.0 * f64::from(f32::EPSILON) * at.max_element().max(1.0);
    (q - cutoff).abs() <= 1e-5 * cutoff + slope * pixel
}

/// Returns true if the least opacity of a tile comes within rounding of the termination threshold.
fn ends_at_a_threshold(frame: &Frame, bins: &Bins, tile: usize) -> bool {
    let opaque = 1.0 - f64::from(frame.uniform.tolerance * TERMINATION_SHARE);
    let origin = [tile % frame.tiles[0], tile / frame.tiles[0]].map(|t| t * TILE_SIZE);
    let mut alphas = Vec::new();
    for y in origin[1]..(origin[1] + TILE_SIZE).min(frame.camera.height) {
        for x in origin[0]..(origin[0] + TILE_SIZE).min(frame.camera.width) {
            alphas.push(([x, y], 0.0_f64));
        }
    }
    for n in bins.tile(tile) {
        let f = &frame.footprints[n as usize];
        for ([x, y], alpha) in &mut alphas {
            let tau = optical_depth(frame, f, n as usize, *x, *y);
            let opacity = if f.path == PATH_CAPPED {
                tau.min(f64::from(SPLAT_CEILING))
            } else if f.path == PATH_PEAK || frame.settings.advanced.linear_opacity {
                tau.min(1.0)
            } else {
                -(-tau).exp_m1()
            };
            *alpha += opacity * (1.0 - *alpha);
        }
        let least = alphas.iter().map(|(_, a)| *a).fold(1.0, f64::min);
        if (least - opaque).abs() < 2e-6 {
            return true;
        }
    }
    false
}

/// Returns the optical depth (or opacity) of an affine footprint exactly; of other footprints
/// approximately.
fn optical_depth(frame: &Frame, f: &Footprint, n: usize, x: usize, y: usize) -> f64 {
    let wide = |v: [f32; 2]| DVec2::new(f64::from(v[0]), f64::from(v[1]));
    let d = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - wide(f.centre_px);
    let mut q = wide(f.form_p).dot(d).powi(2) + wide(f.form_r).dot(d).powi(2);
    if f.path == PATH_EXACT {
        let terms = &frame.exact[n];
        q /= 1.0 + wide(terms.gradient).dot(d);
    }
    let inside = q <= f64::from(f.cutoff_squared);
    f64::from(u8::from(inside)) * f64::from(f.tau) * (-0.5 * q).exp()
}
