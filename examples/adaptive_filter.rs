//! The checkerboard of Chen et al. 2004 (their Fig. 8 and Table 2): a slab of 512 x 512 x 3 opaque
//! black and white voxels, from near, where it recedes to the horizon and voxels are tens of
//! pixels wide, and from far, where they are half of one. What each filter costs and by how much
//! it is off.
//!
//!     cargo run --release --example adaptive_filter -- FOLDER [SIZE] [VOXELS] [FRAMES]
//!
//! Writes pictures and the maps of what draws which voxel to FOLDER.

use std::path::{Path, PathBuf};

use ewa_splat::constants::MAX_CUTOFF;
use ewa_splat::measure::{ImageErrors, PAPER_THRESHOLDS, compare, median_times};
use ewa_splat::render::StageTimes;
use ewa_splat::scene::{
    Colour, Lattice, Particles, PointVolume, Strength, TransferFunction, Values,
};
use ewa_splat::splat::Filter;
use ewa_splat::view::Camera;
use ewa_splat::{Error, Renderer, Result, Settings, Show, io};
use glam::DVec3;

/// Voxels along a side of a square.
const SQUARE: usize = 8;
/// Layers of voxels.
const LAYERS: usize = 3;
const FOV_DEG: f64 = 45.0;
/// Linear RGB behind the slab: neither black nor white.
const SKY: [f32; 3] = [0.1, 0.25, 0.5];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize, default: usize| {
        let given = arguments.get(i).and_then(|a| a.parse().ok());
        given.unwrap_or(default)
    };
    let folder = PathBuf::from(arguments.get(1).map_or("checkerboard", String::as_str));
    let (size, voxels, frames) = (number(2, 512), number(3, 512), number(4, 5).max(1));
    std::fs::create_dir_all(&folder)
        .map_err(|e| Error::io(&folder, "making the folder", e, "name a folder elsewhere"))?;
    let mut renderer = Renderer::new(vec![checkerboard(voxels)?])?;
    println!(
        "{voxels} x {voxels} x {LAYERS} voxels, {size} x {size} pixels, {} threads, medians of \
         {frames} frames; errors in 255ths, against everything exact",
        rayon::current_num_threads()
    );
    let side = voxels as f64;
    for (name, distance, height) in [("near", 0.02, 0.03), ("far", 2.0, 0.4)] {
        let eye = DVec3::new(0.0, -(0.5 + distance) * side, height * side);
        // From near, below the horizon by an eighth of the view's height; from far, the middle.
        let target = if name == "near" {
            eye + DVec3::new(0.0, 1.0, -(FOV_DEG.to_radians() / 2.0).tan() / 4.0)
        } else {
            DVec3::ZERO
        };
        let camera = Camera::perspective(eye, target, DVec3::Z, FOV_DEG, [size; 2]);
        measure(&mut renderer, &camera, name, frames, &folder)?;
    }
    Ok(())
}

/// One row of the table.
struct Row {
    name: &'static str,
    settings: Settings,
    errors: Option<ImageErrors>,
    footprints: usize,
    times: Vec<StageTimes>,
}

fn rows() -> Vec<Row> {
    let base = Settings {
        background: Some(SKY),
        ..Settings::default()
    };
    let of = |filter| Settings {
        filter,
        ..base.clone()
    };
    let all = [
        (
            "everything-exact",
            Settings {
                tolerance: 1e-6,
                cutoff: Some(MAX_CUTOFF),
                level_of_detail: false,
                ..of(Filter::Exact)
            },
        ),
        ("exact", of(Filter::Exact)),
        ("ewa", of(Filter::Ewa)),
        ("reconstruction", of(Filter::Reconstruction)),
        ("low-pass", of(Filter::LowPass)),
        ("adaptive", base.clone()),
        (
            "adaptive-none-merged",
            Settings {
                level_of_detail: false,
                ..base.clone()
            },
        ),
        (
            "thresholds",
            Settings {
                thresholds: Some(PAPER_THRESHOLDS),
                ..base.clone()
            },
        ),
    ];
    let row = |(name, settings)| Row {
        name,
        settings,
        errors: None,
        footprints: 0,
        times: Vec::new(),
    };
    all.map(row).into()
}

fn measure(
    renderer: &mut Renderer,
    camera: &Camera,
    view: &str,
    frames: usize,
    folder: &Path,
) -> Result<()> {
    let mut rows = rows();
    let truth = renderer.render(camera, &rows[0].settings)?.clone();
    for row in &mut rows {
        let image = renderer.render(camera, &row.settings)?;
        row.errors = Some(compare(&truth, image)?);
        let path = folder.join(format!("{view}-{}.png", row.name));
        io::write_image(&path, image)?;
        row.footprints = renderer.counts().footprints;
        if row.settings.filter == Filter::Adaptive {
            let choice = Settings {
                show: Show::Choice,
                ..row.settings.clone()
            };
            let path = folder.join(format!("{view}-{}-choice.png", row.name));
            io::write_image(&path, renderer.render(camera, &choice)?)?;
        }
    }
    // In rounds, so that a disturbance of the machine falls on all alike.
    for _ in 0..frames {
        for row in &mut rows {
            renderer.render(camera, &row.settings)?;
            row.times.push(renderer.times());
        }
    }
    println!(
        "\n{view:<24} {:>8} {:>10} {:>9} {:>9} {:>9} {:>11}",
        "ms", "of exact's", "rms", "99.9 %", "max", "footprints"
    );
    let frame = |row: &Row| median_times(&row.times).frame;
    let exact = rows
        .iter()
        .find(|row| row.name == "exact")
        .map_or(1.0, frame);
    for row in &rows {
        let Some(e) = row.errors else { continue };
        println!(
            "{:<24} {:>8.1} {:>10.2} {:>9.2} {:>9.2} {:>9.2} {:>11}",
            row.name,
            frame(row),
            frame(row) / exact,
            e.rmse * 255.0,
            e.p999 * 255.0,
            e.max * 255.0,
            row.footprints
        );
    }
    let [c_min, c_max] = PAPER_THRESHOLDS;
    println!("thresholds: c_min {c_min}, c_max {c_max} (1 + 2 tan²(fov/2))");
    Ok(())
}

/// The slab around the origin, a unit from voxel to voxel, z up.
fn checkerboard(voxels: usize) -> Result<PointVolume> {
    let dims = [voxels, voxels, LAYERS];
    let origin = dims.map(|n| 0.5 - 0.5 * n as f64);
    let values = (0..voxels * voxels * LAYERS)
        .map(|i| (i % voxels / SQUARE, i / voxels % voxels / SQUARE))
        .map(|(x, y)| if (x + y) % 2 == 0 { 0 } else { u8::MAX })
        .collect();
    let transfer = TransferFunction::from_curves(|v| [v / 255.0; 3], |_| 0.99, [0.0, 255.0], 1.0)?;
    Ok(PointVolume {
        particles: Particles::Lattice {
            lattice: Lattice::uniform(dims, DVec3::from(origin), DVec3::ONE),
            kernel_width: ewa_splat::sample::DEFAULT_KERNEL_WIDTH,
        },
        strength: Strength::Classified {
            volumes: Vec::new(),
        },
        colour: Colour::Classified,
        values: Some(Values::U8(values)),
        transfer_function: Some(transfer),
        normals: None,
    })
}
