//! Renders a surface in a volume: a vase of opaque surfels, and smoke that rises out of it and
//! winds about it. Both are composited in depth order.
//!
//!     cargo run --release --example hybrid [IMAGE [WIDTH]]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use ewa_splat::math::lower_factor;
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::scene::{Particles, PointVolume, Strength};
use ewa_splat::view::{Lens, Viewpoint};
use ewa_splat::{Backend, Error, Renderer, Settings, io};
use glam::{DMat3, DVec3};

/// Number of kernels along the smoke's path.
const PUFFS: usize = 30_000;

fn main() -> ewa_splat::Result<()> {
    let mut arguments = std::env::args_os().skip(1);
    let out = arguments
        .next()
        .map_or_else(|| "hybrid.png".into(), PathBuf::from);
    let width: usize = arguments
        .next()
        .and_then(|n| n.to_str()?.parse().ok())
        .unwrap_or(800);

    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/vase.glb");
    let io::Geometry::Mesh(mesh) = io::open(&path, &io::OpenOptions::default())?.geometry else {
        return Err(Error::format(
            path,
            "file",
            "a mesh",
            "other data",
            "name a mesh",
        ));
    };
    let options = MeshOptions {
        spread: Spread::Count(150_000),
        ..MeshOptions::default()
    };
    let mut scene = surfels(&mesh, &options)?.volumes;
    let corners = mesh.parts.iter().flat_map(|part| &part.positions);
    let (lower, upper) = corners.fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(lower, upper), p| (lower.min(*p), upper.max(*p)),
    );
    scene.push(smoke((lower + upper) / 2.0, (upper - lower) / 2.0));

    let mut renderer = Renderer::with_options(scene, Backend::Auto)?;
    let viewpoint = Viewpoint {
        azimuth_deg: 20.0,
        elevation_deg: 18.0,
        zoom: 1.0,
        up: DVec3::Y,
    };
    let boxes = renderer.visible_boxes();
    let size = [width, width * 5 / 4];
    let Some(camera) = viewpoint.camera(&boxes, Lens::FovDeg(30.0), size) else {
        println!("nothing is visible");
        return Ok(());
    };
    let settings = Settings {
        background: Some([0.01, 0.012, 0.02]),
        ..Settings::default()
    };
    renderer.render(&camera, &settings)?;
    io::write_image(&out, renderer.image())?;
    let counts = renderer.counts();
    println!(
        "{}: {} surfels and {} kernels of smoke in {:.1} ms on {}",
        out.display(),
        counts.surfels,
        counts.footprints - counts.surfels,
        renderer.times().frame,
        renderer.adapter().as_deref().unwrap_or("the processor"),
    );
    Ok(())
}

/// Returns two strands of smoke that wind up around the vase's axis and widen with height. The
/// kernels are ellipsoids of equal mass, elongated along the path.
fn smoke(middle: DVec3, half: DVec3) -> PointVolume {
    let (mut positions, mut factors) = (Vec::with_capacity(PUFFS), Vec::with_capacity(PUFFS));
    // A low-discrepancy sequence (Roberts' R3) gives the same picture every time.
    let share = |n: usize, step: f64| (0.5 + n as f64 * step).fract();
    let radius = half.x.max(half.z);
    for n in 0..PUFFS {
        let along = share(n, 0.819_172_513_396_164_4);
        let (a, b) = (
            share(n, 0.671_043_606_703_789_2),
            share(n, 0.549_700_477_901_970_3),
        );
        let strand = TAU * 0.5 * (n % 2) as f64;
        let angle = TAU * 1.6 * along + strand;
        // The smoke leaves the mouth, passes around the belly and drifts away.
        let reach = radius * (1.25 + 0.25 * (TAU * 1.5 * along).sin());
        let height = middle.y + half.y * (2.1 * along - 0.85);
        let thick = radius * (0.05 + 0.12 * along);
        // The offset is normally distributed (Box and Muller).
        let spread = thick * (-2.0 * (a.max(1e-9)).ln()).sqrt();
        let (sin, cos) = (TAU * b).sin_cos();
        let outward = DVec3::new(angle.cos(), 0.0, angle.sin());
        let around = DVec3::new(-angle.sin(), 0.35, angle.cos()).normalize();
        let up = outward.cross(around);
        positions.push(
            DVec3::new(middle.x, height, middle.z)
                + outward * (reach + spread * cos)
                + up * (spread * sin),
        );
        let sigma = 0.35 * thick;
        let shape = DMat3::from_cols(around * (3.0 * sigma), outward * sigma, up * sigma);
        #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
        factors.push(lower_factor(shape).map(|l| l as f32));
    }
    #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
    let mass = (9.0 * radius * radius / PUFFS as f64) as f32;
    PointVolume::new(
        Particles::Anisotropic { positions, factors },
        Strength::Mass(vec![mass; PUFFS]),
    )
    .with_colour([0.75, 0.8, 0.9])
}
