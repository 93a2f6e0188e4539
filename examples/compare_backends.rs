//! Renders a file on the CPU and on the GPU, and prints the difference of the pictures and the
//! stages' times.
//!
//!     cargo run --release --example compare_backends [FILE]

use std::path::{Path, PathBuf};

use ewa_splat::measure::compare;
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Backend, Renderer, Settings, io, sample};
use glam::DVec3;

fn main() -> ewa_splat::Result<()> {
    let path = std::env::args_os().nth(1).map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/wake.xyz"),
        PathBuf::from,
    );
    let dataset = io::open(&path, &io::OpenOptions::default())?;
    let volume = sample::volume(dataset, &sample::SampleOptions::default())?.volume;
    let mut cpu = Renderer::new(vec![volume.clone()])?;
    let mut gpu = match Renderer::with_options(vec![volume], Backend::Gpu) {
        Ok(gpu) => gpu,
        Err(e) => {
            println!("nothing to compare with: {e}");
            return Ok(());
        }
    };
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    let Some(camera) = viewpoint.camera(&cpu.visible_boxes(), Lens::FovDeg(35.0), [512, 512])
    else {
        println!("nothing is visible");
        return Ok(());
    };
    let settings = Settings::default();
    for renderer in [&mut cpu, &mut gpu] {
        // The first frame makes buffers and pipelines; the second is timed.
        renderer.render(&camera, &settings)?;
        renderer.render(&camera, &settings)?;
        let t = renderer.times();
        println!(
            "{}\n  cull {:.2}, classify {:.2}, project {:.2}, sort {:.2}, bin {:.2}, \
             rasterise {:.2}, frame {:.2} ms",
            renderer.adapter().as_deref().unwrap_or("CPU"),
            t.cull,
            t.classify,
            t.project,
            t.sort,
            t.bin,
            t.rasterise,
            t.frame
        );
    }
    let errors = compare(gpu.image(), cpu.image())?;
    println!("largest difference {:.1e} of full scale", errors.max);
    Ok(())
}
