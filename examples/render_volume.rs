//! Renders a curvilinear grid: file, field, transfer function, camera, picture.
//!
//!     cargo run --release --example render_volume [IMAGE]

use std::path::{Path, PathBuf};

use ewa_splat::sample::{FunctionOptions, SampleOptions, TransferChoice};
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Backend, Renderer, Settings, io, sample};
use glam::DVec3;

fn main() -> ewa_splat::Result<()> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let dataset = io::open(&fixtures.join("wake.xyz"), &io::OpenOptions::default())?;
    let options = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::File(fixtures.join("wake_transfer.json")),
            ..FunctionOptions::default()
        },
        ..SampleOptions::default()
    };
    let volume = sample::volume(dataset, &options)?.volume;

    // Uses a hardware GPU if there is one, otherwise the CPU.
    let mut renderer = Renderer::with_options(vec![volume], Backend::Auto)?;
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    let Some(camera) = viewpoint.camera(&renderer.visible_boxes(), Lens::FovDeg(35.0), [800, 600])
    else {
        println!("nothing is visible");
        return Ok(());
    };
    renderer.render(&camera, &Settings::default())?;

    let out = std::env::args_os()
        .nth(1)
        .map_or_else(|| PathBuf::from("wake.png"), PathBuf::from);
    io::write_image(&out, renderer.image())?;
    println!(
        "{}: {} particles, {} splat-pixels in {:.1} ms on {}",
        out.display(),
        renderer.particle_count(),
        renderer.counts().splat_pixels,
        renderer.times().frame,
        renderer.adapter().as_deref().unwrap_or("the processor"),
    );
    Ok(())
}
