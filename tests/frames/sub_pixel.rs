//! Compares kernels smaller than a pixel with low-passed, much finer pictures.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use std::f64::consts::TAU;

use crate::common::Random;
use crate::common::scene::{self, Particle};
use ewa_splat::Filter;
use ewa_splat::render::Advanced;
use ewa_splat::view::Projection;
use ewa_splat::{Image, Settings};
use glam::DVec3;

/// Pixels of the fine picture along a side of one of the coarse picture's.
const FINER: usize = 16;
/// Reach of the filter in pixels, by which the fine picture is larger on each side: exp(-18) is
/// omitted.
const REACH: usize = 6;

fn settings(is_lone: bool) -> Settings {
    Settings {
        filter: Filter::Ewa,
        cutoff: Some(7.0),
        level_of_detail: false,
        advanced: Advanced {
            sub_pixel_opacity: is_lone,
            ..Advanced::default()
        },
        ..Settings::default()
    }
}

/// Draws particles with a camera of `size` x `size` pixels, each a world unit wide.
fn draw(particles: &[Particle], size: usize, is_lone: bool) -> Image {
    let camera = scene::camera(Projection::Orthographic, [1.0; 2], [size; 2]);
    scene::render(vec![scene::volume(particles)], &camera, &settings(is_lone))
}

/// Returns the picture's opacities by filtering a fine, unfiltered one with the filter of 1 px².
fn truth(particles: &[Particle], size: usize) -> Vec<f64> {
    let fine = (size + 2 * REACH) * FINER;
    let camera = scene::camera(Projection::Orthographic, [FINER as f64; 2], [fine; 2]);
    let settings = Settings {
        low_pass_variance_px2: 0.0,
        ..settings(false)
    };
    let image = scene::render(vec![scene::volume(particles)], &camera, &settings);
    // Sums at the centres of coarse pixels, along one axis after the other.
    let filter = |line: &dyn Fn(usize) -> f64, i: usize| -> f64 {
        let middle = ((i + REACH) as f64 + 0.5) * FINER as f64;
        let first = i * FINER + FINER / 2;
        (first..first + 2 * REACH * FINER)
            .map(|k| {
                let d = (k as f64 + 0.5 - middle) / FINER as f64;
                (-0.5 * d * d).exp() / (TAU.sqrt() * FINER as f64) * line(k)
            })
            .sum()
    };
    let rows: Vec<Vec<f64>> = (0..fine)
        .map(|y| {
            let line = |x: usize| f64::from(image.pixel(x, y)[3]);
            (0..size).map(|i| filter(&line, i)).collect()
        })
        .collect();
    let at = |i: usize, k: usize| filter(&|y| rows[y][i], k);
    (0..size * size).map(|p| at(p % size, p / size)).collect()
}

/// Returns the largest and the root-mean-square difference of opacities.
fn errors(image: &Image, truth: &[f64]) -> [f64; 2] {
    let differences = image
        .pixels
        .iter()
        .zip(truth)
        .map(|(p, t)| (f64::from(p[3]) - t).abs());
    let differences: Vec<f64> = differences.collect();
    let squares: f64 = differences.iter().map(|d| d * d).sum();
    let most = differences.iter().fold(0.0, |m: f64, d| m.max(*d));
    [most, (squares / truth.len() as f64).sqrt()]
}

/// Returns the errors of the picture by depth and as of lone kernels.
fn both(particles: &[Particle], size: usize) -> [[f64; 2]; 2] {
    let truth = truth(particles, size);
    [false, true].map(|is_lone| errors(&draw(particles, size, is_lone), &truth))
}

/// Returns a sphere of peak depth `tau0`.
fn sphere(x: f64, y: f64, z: f64, sigma: f64, tau0: f64) -> Particle {
    Particle::sphere(DVec3::new(x, y, z), sigma, TAU * sigma * sigma * tau0)
}

#[test]
fn a_lone_kernel_is_as_opaque_as_it_should_be() {
    // Kernels generally lie away from the centre of a pixel.
    for (sigma, tau0, allowed) in [
        // Peak and shape: a Gaussian of the filter's own width. The tolerance is the shape's error,
        // which the published finding leaves: it grows with the kernel's area and depth.
        (0.2, 1.0, 3e-4),
        (0.2, 10.0, 1e-3),
        (0.3, 10.0, 4e-3),
        (0.3, 100.0, 8e-3),
        (0.5, 10.0, 1.5e-2),
        (1.0, 3.0, 4e-2),
        (1.0, 100.0, 0.15),
        (3.0, 100.0, 0.15),
    ] {
        let [by_depth, lone] = both(&[sphere(0.3, -0.2, 50.0, sigma, tau0)], 32);
        println!(
            "sigma {sigma} px, depth {tau0}: {:.5} by depth, {:.5} lone",
            by_depth[0], lone[0]
        );
        assert!(lone[0] < allowed, "{sigma} {tau0}: {lone:?}");
        assert!(
            lone[0] < 0.7 * by_depth[0],
            "{sigma} {tau0}: {lone:?} of {by_depth:?}"
        );
    }
}

#[test]
fn sparse_opaque_kernels_come_nearer_to_the_truth() {
    let mut random = Random::new(5);
    let size = 48;
    for (count, sigma, tau0) in [(100, 0.2, 10.0), (100, 0.3, 30.0), (400, 0.2, 10.0)] {
        let particles: Vec<Particle> = (0..count)
            .map(|_| {
                let p = random.point(size as f64 / 2.0);
                sphere(p.x, p.y, 100.0 + p.z, sigma, tau0)
            })
            .collect();
        let [by_depth, lone] = both(&particles, size);
        println!(
            "{count} of sigma {sigma}, depth {tau0}: {by_depth:.4?} by depth, {lone:.4?} lone"
        );
        // If two share a pixel, the light past one may meet the other or not: neither rule is
        // exact.
        assert!(
            lone[1] < 0.2 * by_depth[1] && lone[0] < 0.5 * by_depth[0],
            "{count}"
        );
    }
}

#[test]
fn what_fills_pixels_together_becomes_too_faint() {
    // Layers of a lattice, two samples per pixel, with the default kernel width.
    let (spacing, sigma, size) = (0.5, 0.3, 24);
    for (layers, tau) in [(1, 1.0), (1, 4.0), (8, 1.0), (8, 4.0)] {
        let mut particles = Vec::new();
        for k in 0..layers {
            for j in -36..36 {
                for i in -36..36 {
                    let [x, y, z] = [i, j, k].map(|n| (f64::from(n) + 0.5) * spacing);
                    let tau0 = tau / f64::from(layers) * spacing * spacing / (TAU * sigma * sigma);
                    particles.push(sphere(x, y, 50.0 + z, sigma, tau0));
                }
            }
        }
        let [by_depth, lone] = both(&particles, size);
        println!(
            "{layers} layers of depth {tau}: {:.5} by depth, {:.5} lone",
            by_depth[0], lone[0]
        );
        // Depths are right for the uniform field: the lattice's ripple, and exp's 4e-7 of many.
        assert!(by_depth[0] < 3e-3);
        assert!(
            lone[0] > by_depth[0],
            "a claim of the settings' page no longer holds"
        );
    }
}
