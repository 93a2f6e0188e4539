//! Turns a mesh into surfels, draws them, writes them as splats and draws those again.
//!
//!     cargo run --release --example mesh_to_splats [MESH [SURFELS [FOLDER]]]

use std::path::{Path, PathBuf};
use std::time::Instant;

use ewa_splat::measure::compare;
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::sample::{SampleOptions, splat_cloud};
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Backend, Error, Renderer, Settings, io, sample};
use glam::DVec3;

fn main() -> ewa_splat::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let path = arguments.next().map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vase.glb"),
        PathBuf::from,
    );
    let count = arguments.next().and_then(|n| n.to_str()?.parse().ok());
    let folder = arguments.next().map_or_else(PathBuf::new, PathBuf::from);

    let io::Geometry::Mesh(mesh) = io::open(&path, &io::OpenOptions::default())?.geometry else {
        return Err(Error::format(
            path,
            "file",
            "a mesh",
            "other data",
            "name a mesh",
        ));
    };
    let start = Instant::now();
    let options = MeshOptions {
        spread: Spread::Count(count.unwrap_or(60_000)),
        ..MeshOptions::default()
    };
    let sampled = surfels(&mesh, &options)?;
    let report = &sampled.report;
    println!(
        "{} triangles: {} surfels, {:.4} apart, in {:.2} s; their weights add up to 1 within {:.3} \
         (root mean square), {:.3} (at most)",
        report.triangle_count,
        report.surfel_count,
        report.spacing,
        start.elapsed().as_secs_f64(),
        report.ripple,
        report.greatest_ripple,
    );
    let (cloud, _) = splat_cloud(&sampled.volumes)?;

    // Draws the surfels of an opaque surface.
    let mut renderer = Renderer::with_options(sampled.volumes, Backend::Cpu)?;
    let viewpoint = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 25.0,
        zoom: 1.0,
        up: DVec3::Y,
    };
    let boxes = renderer.visible_boxes();
    let Some(camera) = viewpoint.camera(&boxes, Lens::FovDeg(35.0), [512, 512]) else {
        println!("nothing is visible");
        return Ok(());
    };
    let settings = Settings {
        background: Some([0.05; 3]),
        ..Settings::default()
    };
    renderer.render(&camera, &settings)?;
    io::write_image(&folder.join("surfels.png"), renderer.image())?;
    println!(
        "surfels.png: {} splat-pixels in {:.1} ms",
        renderer.counts().splat_pixels,
        renderer.times().frame
    );

    // Draws the splats as viewers of radiance fields do.
    for (name, form) in [
        ("splats.ply", io::PlyForm::Volumetric),
        ("flat.ply", io::PlyForm::Surfels),
        ("splats.splat", io::PlyForm::Volumetric),
        ("splats.spz", io::PlyForm::Volumetric),
        ("splats.glb", io::PlyForm::Volumetric),
    ] {
        let file = folder.join(name);
        // The camera and the splats stay unrotated, because the data state no direction up.
        let options = io::SplatFileOptions {
            form,
            ..Default::default()
        };
        let written = io::write_splats(&file, &cloud, &options)?;
        let again = io::open(&file, &io::OpenOptions::default())?;
        let volume = sample::volume(again, &SampleOptions::default())?.volume;
        let mut splats = Renderer::with_options(vec![volume], Backend::Cpu)?;
        let image = splats.render(&camera, &settings)?;
        println!(
            "{name}: {} bytes, {:.1} dB from the surfels' picture",
            written.bytes,
            compare(image, renderer.image())?
                .psnr
                .unwrap_or(f64::INFINITY)
        );
        io::write_image(&file.with_extension("png"), image)?;
    }
    Ok(())
}
