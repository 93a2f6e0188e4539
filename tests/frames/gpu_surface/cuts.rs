//! Tests kernels that a boundary cuts, on both back ends.

use super::{cameras, gas, lists, on_cpu, on_device, spec_of, spheres_on_a_plane};
use crate::common::depth_of;
use crate::common::frame::Frame;
use crate::common::gpu::gpu;
use crate::common::scene::difference;
use ewa_splat::image::{DepthImage, Image};
use ewa_splat::stages::cpu::{self, Bins, Tile};
use ewa_splat::stages::gpu::{Projected, RasterSpec, SurfaceSpec, rasterise};
use ewa_splat::stages::record::{ExactTerms, ViewUniform};
use ewa_splat::stages::splat::{Axes, Interval};
use ewa_splat::{Filter, Settings};
use glam::Vec2;

/// Compares the terms by which surfaces cut kernels, and the cut kernels, on the CPU's input.
#[test]
fn kernels_are_cut_alike() {
    let Some(gpu) = gpu() else { return };
    for (name, camera) in cameras([130, 90]) {
        for filter in [Filter::Adaptive, Filter::Exact, Filter::Ewa] {
            let settings = Settings {
                filter,
                ..Settings::default()
            };
            let surface = Frame::new(spheres_on_a_plane(), &camera, &settings);
            let of_surface = SurfaceSpec {
                normals: false,
                ..spec_of(&surface)
            };
            let (tiles, surface) = on_cpu(&surface, &surface.bins(), of_surface);
            let mut frame = Frame::new(gas(600), &camera, &settings);
            project_cut(&mut frame);
            compare_depth_terms(&frame, &on_device(gpu, &frame, true));
            let bins = frame.bins();
            for (depth, linear_opacity) in [(true, false), (false, true)] {
                let spec = RasterSpec {
                    axes: Axes {
                        may_be_exact: frame.any_exact,
                        interval: Interval::Surface,
                        depth,
                        linear_opacity,
                        ..Axes::default()
                    },
                    near: !frame.near.is_empty(),
                    ..RasterSpec::default()
                };
                let (image, depths, splat_pixels) = cut_on_cpu(&frame, &bins, &tiles, spec);
                for chunks in [1, 3] {
                    let found = rasterise(
                        gpu,
                        &frame.uniform,
                        spec,
                        &frame.footprints,
                        &frame.exact,
                        &frame.near,
                        &lists(&frame, &bins),
                        chunks,
                        Some((&surface.image, &surface.depth)),
                        None,
                    )
                    .unwrap();
                    let pixels = image.pixels.iter().zip(&found.0.pixels);
                    // Some hundred layers; a cut-off within rounding differs by the tolerance.
                    let differ = |(p, q): &(&[f32; 4], &[f32; 4])| {
                        p.iter().zip(*q).any(|(x, y)| !((x - y).abs() <= 5e-6))
                    };
                    let differ = pixels.filter(differ).count();
                    println!(
                        "{name} {filter:?} {chunks} chunks: {differ} pixels, largest difference {:e}, {splat_pixels} and {} splat-pixels",
                        difference(&image, &found.0),
                        found.2
                    );
                    assert!(differ <= image.pixels.len() / 1000);
                    // A kernel behind the eye counts until its depth underflows, which happens
                    // sooner on the device.
                    let tails = if frame.near.is_empty() {
                        300
                    } else {
                        splat_pixels / 100
                    };
                    assert!(splat_pixels.abs_diff(found.2) <= tails, "{name}");
                    let Some(found) = &found.1 else { continue };
                    let depths = depths.depths.iter().zip(&found.depths);
                    let far =
                        |(x, y): &(&f32, &f32)| !((*x - *y).abs() <= 1e-5 * x.abs()) && x != y;
                    let differ = depths.filter(far).count();
                    assert!(
                        differ <= image.pixels.len() / 500,
                        "{name}: {differ} depths"
                    );
                }
            }
        }
    }
}

/// Projects the frame again, with kernels to be cut.
fn project_cut(frame: &mut Frame) {
    frame.exact = vec![ExactTerms::default(); frame.footprints.len()];
    frame.project_as(true);
}

fn compare_depth_terms(frame: &Frame, found: &Projected) {
    let mut count = 0;
    for (i, (e, f)) in frame.footprints.iter().zip(&found.footprints).enumerate() {
        if !e.is_visible() || !f.is_visible() || e.path != f.path || e.path & 2 != 0 {
            continue;
        }
        count += 1;
        let (a, b) = (frame.exact[i], found.exact[i]);
        // Axis ratios are up to 5, as those of the footprints: some dozens of roundings.
        let bound = 1e-5 * a.depth_sigma;
        let sigma = (a.depth_sigma - b.depth_sigma).abs();
        assert!(a.depth_sigma > 0.0 && sigma <= bound, "{a:?} {b:?}");
        let slope = Vec2::from(a.gradient).distance(b.gradient.into());
        let unit = Vec2::from(a.gradient).length().max(a.depth_sigma);
        assert!(slope <= 2e-5 * unit, "{a:?} {b:?}");
    }
    assert!(count > 100, "{count}");
}

fn cut_on_cpu(
    frame: &Frame,
    bins: &Bins,
    surface: &[Tile],
    spec: RasterSpec,
) -> (Image, DepthImage, u64) {
    let (tiles, splat_pixels) = frame.rasterised(bins, spec.axes, surface);
    let ViewUniform {
        size: [width, height],
        ..
    } = frame.uniform;
    let mut image = Image::new(width as usize, height as usize);
    cpu::resolve(&tiles, None, false, &mut image);
    let depth = depth_of(&tiles, [width as usize, height as usize]);
    (image, depth, splat_pixels)
}
