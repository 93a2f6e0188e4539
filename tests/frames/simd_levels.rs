//! Tests the rasteriser's vector loops, at every SIMD level of the processor, against the plainest
//! loop over pixels and sorted footprints, in f64.
#![allow(
    clippy::cast_possible_truncation,
    clippy::unwrap_used,
    reason = "inputs are narrowed on purpose; a test fails by panicking"
)]

use crate::common::Random;
use crate::common::depth_of;
use crate::common::frame::Frame;
use crate::common::scene::{self, Particle, difference, volume};
use ewa_splat::render::Advanced;
use ewa_splat::scene::{Colour, PointVolume, Strength};
use ewa_splat::stages::constants::{MAX_CUTOFF, TERMINATION_SHARE};
use ewa_splat::stages::cpu::{self, RasteriseSettings, SimdLevel, Tile};
use ewa_splat::stages::record::{
    ExactTerms, Footprint, PATH_AFFINE, PATH_EXACT, PATH_HALF_LINE, PATH_NEAR,
};
use ewa_splat::stages::splat::Axes;
use ewa_splat::stages::splat::{Filter, evaluate_near};
use ewa_splat::view::Projection;
use ewa_splat::{Image, Renderer, Settings, Show};
use glam::{DVec2, DVec3, Vec3};

const EPS: f64 = 5.960_464_477_539_063e-8;

/// Optical depth, and its largest error in f32.
struct Depth {
    tau: f64,
    /// Largest error of tau from roundings.
    error: f64,
    /// All of tau if rounding decides on which side of the cut-off the pixel falls.
    edge: f64,
}

/// Evaluates one footprint on the affine, exact or half-line path at a pixel, in f64 from its f32
/// words.
fn evaluate(frame: &Frame, f: &Footprint, terms: Option<&ExactTerms>, pixel: DVec2) -> Depth {
    let word = |v: [f32; 2]| DVec2::new(f64::from(v[0]), f64::from(v[1]));
    let d = pixel - word(f.centre_px);
    let (p, r) = (word(f.form_p), word(f.form_r));
    let (p_d, r_d) = (p.dot(d), r.dot(d));
    let mut q = p_d * p_d + r_d * r_d;
    // Six roundings of the products, which may cancel.
    let rounding = |row: DVec2| 6.0 * EPS * (row * d).abs().element_sum();
    let mut q_error = 2.0 * (p_d.abs() * rounding(p) + r_d.abs() * rounding(r)) + 4.0 * EPS * q;
    let mut tau = f64::from(f.tau);
    // The loop's stated bound for exp is 3e-6.
    let mut relative = 4e-6;
    let cutoff = f64::from(f.cutoff_squared);
    let path = f.path & 3;
    if path == PATH_EXACT {
        let terms = terms.unwrap();
        let g = word(terms.gradient) * d;
        let [hxx, hxy, hyy] = terms.hessian.map(f64::from);
        let h = DVec3::new(hxx * d.x * d.x, hxy * d.x * d.y, hyy * d.y * d.y);
        let w = 1.0 + g.element_sum() + h.element_sum();
        let w_error = 8.0 * EPS * (1.0 + g.abs().element_sum() + h.abs().element_sum());
        if w <= 0.0 {
            return Depth {
                tau: 0.0,
                error: 0.0,
                edge: if w > -w_error { tau } else { 0.0 },
            };
        }
        let focal = word(frame.uniform.focal_px);
        let slope = (pixel - word(frame.uniform.centre_px)) / focal;
        q_error = q_error / w + q * w_error / (w * w);
        q /= w;
        tau *= slope.extend(1.0).length() / w.sqrt();
        relative += w_error / w + 4.0 * EPS;
    }
    if path == PATH_HALF_LINE {
        let near = &frame.near[(f.path >> 2) as usize];
        let [gx, gy, z] = near.half_line.map(f64::from);
        let z = z + gx * d.x + gy * d.y;
        let size = z.abs() + (gx * d.x).abs() + (gy * d.y).abs();
        let sigma = f64::from(near.sigma.max(f32::MIN_POSITIVE));
        let behind = z / sigma + f64::from(MAX_CUTOFF);
        if behind.abs() < 1e-3 {
            // It may count or not: 1e-12 of a depth.
            return Depth {
                tau: 0.0,
                error: 0.0,
                edge: tau * 1e-11,
            };
        }
        if behind < 0.0 {
            tau = 0.0;
        }
        tau *= f64::from(ewa_splat::math::normal_cdf((z / sigma) as f32));
        // The slope of the normal distribution is below .4; its own error is 3e-7.
        relative += 1e-6;
        q_error += (8.0 * EPS * size / sigma).min(1.0);
    }
    let value = tau * (-0.5 * q).exp();
    let edge = if (q - cutoff).abs() <= q_error + 1e-6 * cutoff {
        value
    } else {
        0.0
    };
    let inside = q <= cutoff;
    Depth {
        tau: if inside { value } else { 0.0 },
        error: if inside {
            value * (relative + 0.5 * q_error)
        } else {
            0.0
        },
        edge,
    }
}

/// Evaluates a footprint on any path at a pixel.
fn depth_at(frame: &Frame, i: usize, [x, y]: [usize; 2]) -> Depth {
    let f = &frame.footprints[i];
    if f.path & 3 != PATH_NEAR {
        let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        return evaluate(frame, f, frame.exact.get(i), pixel);
    }
    let slope = |i: usize, at: usize| {
        (at as f32 + 0.5 - frame.uniform.centre_px[i]) / frame.uniform.focal_px[i]
    };
    // This is the function under test; `footprint_laws.rs` checks it by quadrature.
    let terms = &frame.near[(f.path >> 2) as usize];
    let ray = Vec3::new(slope(0, x), slope(1, y), 1.0);
    let tau = f64::from(evaluate_near(terms, f.tau, ray, f.cutoff_squared));
    // The kernel is cut off where the half line leaves the ellipsoid, in whole tiles; `stages.rs`
    // checks that range by brute force. Beyond it, Q of the whole line may still be small.
    let within = |(first, end): (u32, u32), at: usize| (first..end).contains(&(at as u32));
    let drawn = within(f.column_range(), x) && within(f.row_range(), y);
    Depth {
        tau: if drawn { tau } else { 0.0 },
        error: 1e-6 * tau,
        edge: 0.0,
    }
}

/// Reference pixel: colour, alpha, depth, and the allowed differences.
struct Pixel {
    rgba: [f64; 4],
    allowed: f64,
    depth: f32,
    /// True if rounding decides which particle passes one half.
    depth_open: bool,
}

fn judge(frame: &Frame, order: &[usize], x: usize, y: usize) -> Pixel {
    let mut out = Pixel {
        rgba: [0.0; 4],
        allowed: 0.0,
        depth: f32::INFINITY,
        depth_open: false,
    };
    for &i in order {
        let f = &frame.footprints[i];
        let depth = depth_at(frame, i, [x, y]);
        let opacity = |tau: f64| {
            if frame.settings.advanced.linear_opacity {
                tau.min(1.0)
            } else {
                -(-tau).exp_m1()
            }
        };
        let before = out.rgba[3];
        let weight = opacity(depth.tau) * (1.0 - before);
        let after = before + weight;
        // d opacity / d tau = exp(-tau) at most 1; and the opacity's own 8e-7.
        let slope = if frame.settings.advanced.linear_opacity {
            1.0
        } else {
            (-depth.tau).exp()
        };
        out.allowed += (1.0 - before)
            * (depth.error * slope + 8e-7 * opacity(depth.tau) + opacity(depth.edge))
            + 2.0 * EPS * after * f64::from(u8::from(weight > 0.0));
        for (channel, c) in out.rgba.iter_mut().zip(f.carried.colour()) {
            *channel += weight * f64::from(c);
        }
        out.rgba[3] = after;
        if before < 0.5 && after >= 0.5 {
            let near = f.path & 3 == PATH_NEAR || f.path & 3 == PATH_HALF_LINE;
            out.depth = if near { f.depth.max(0.0) } else { f.depth };
        }
        out.depth_open |= (before - 0.5).abs().min((after - 0.5).abs()) <= out.allowed;
    }
    let transparent = f64::from(frame.settings.tolerance * TERMINATION_SHARE);
    if 1.0 - out.rgba[3] <= 2.0 * transparent + out.allowed {
        // The tile may have stopped early.
        out.allowed = 2.0 * out.allowed + transparent;
    }
    out
}

/// Returns ellipsoids of all sizes, some around the eye.
fn particles(seed: u64) -> Vec<Particle> {
    let mut random = Random::new(seed);
    (0..260)
        .map(|i| {
            let (size, ratio) = (random.log_range(3e-3, 0.3), random.log_range(1.0, 100.0));
            let near = i % 13 == 0;
            let factor = random.factor(size, if near { ratio.min(5.0) } else { ratio });
            let position = if near {
                random.point(0.3)
            } else {
                DVec3::new(
                    random.range(-2.0, 2.0),
                    random.range(-2.0, 2.0),
                    random.range(0.4, 4.0),
                )
            };
            Particle {
                position,
                factor,
                mass: (size * size / ratio * random.log_range(0.01, 20.0)) as f32,
                colour: random.point(0.5).to_array().map(|c| c as f32 + 0.5),
            }
        })
        .collect()
}

#[test]
fn every_level_is_the_plain_loop() {
    let levels = SimdLevel::available();
    println!("levels: {levels:?}");
    let particles = particles(1);
    let (mut worst, mut worst_share) = (0.0_f64, 0.0_f64);
    let (mut pixels, mut open) = (0, 0);
    let mut paths = [0_usize; 4];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for filter in Filter::ALL {
            for linear_opacity in [false, true] {
                // The size is no multiple of the tile, nor of any vector.
                let camera = scene::camera(projection, [31.0, 27.0], [53, 37]);
                let settings = Settings {
                    filter,
                    advanced: Advanced {
                        linear_opacity,
                        ..Advanced::default()
                    },
                    depth: true,
                    ..Settings::default()
                };
                let frame = Frame::new(volume(&particles), &camera, &settings);
                // The order comes from an independent stable sort by key.
                let mut order: Vec<usize> = (0..frame.footprints.len())
                    .filter(|&i| frame.footprints[i].is_visible())
                    .collect();
                order.sort_by_key(|&i| frame.footprints[i].key);
                for &i in &order {
                    paths[(frame.footprints[i].path & 3) as usize] += 1;
                }
                let mut renderer = Renderer::new(vec![volume(&particles)]).unwrap();
                let mut images = Vec::new();
                for &simd in &levels {
                    let settings = Settings {
                        advanced: Advanced {
                            simd,
                            ..settings.advanced
                        },
                        ..settings.clone()
                    };
                    renderer.render(&camera, &settings).unwrap();
                    images.push((renderer.image().clone(), renderer.depth().unwrap().clone()));
                }
                for y in 0..camera.height {
                    for x in 0..camera.width {
                        let judged = judge(&frame, &order, x, y);
                        pixels += 1;
                        open += usize::from(judged.depth_open);
                        for (level, (image, depth)) in levels.iter().zip(&images) {
                            let got = image.pixel(x, y);
                            for (c, value) in got.into_iter().enumerate() {
                                let error = (f64::from(value) - judged.rgba[c]).abs();
                                let allowed = judged.allowed + 1e-7;
                                assert!(
                                    error <= allowed,
                                    "{level:?}, {projection:?}, {filter:?}, linear \
                                     {linear_opacity}, ({x}, {y}) channel {c}: {} for {}, \
                                     allowed {allowed:e}",
                                    value,
                                    judged.rgba[c]
                                );
                                worst = worst.max(error);
                                worst_share = worst_share.max(error / allowed);
                            }
                            let at = depth.depths[y * camera.width + x];
                            assert!(
                                judged.depth_open || at == judged.depth,
                                "{level:?}: depth {at} for {}",
                                judged.depth
                            );
                        }
                    }
                }
            }
        }
    }
    println!(
        "{pixels} pixels: worst difference {worst:.1e}, largest share of its bound \
         {worst_share:.2}; depth left open at {open}; footprints on the affine, exact, near and \
         half-line path {paths:?}"
    );
    // Every path was drawn, and the depth test is conclusive nearly everywhere.
    for path in [PATH_AFFINE, PATH_EXACT, PATH_NEAR, PATH_HALF_LINE] {
        assert!(paths[path as usize] >= 20, "{paths:?}");
    }
    assert!(open * 20 < pixels, "{open} of {pixels}");
}

/// Returns the particles of `volume` with others among them, in one block with theirs.
fn with(good: &[Particle], poison: &[(DVec3, [f32; 6], f32)]) -> PointVolume {
    use ewa_splat::scene::Particles;
    let mut all = volume(good);
    let (
        Particles::Anisotropic { positions, factors },
        Strength::Mass(masses),
        Colour::PerParticle(colours),
    ) = (&mut all.particles, &mut all.strength, &mut all.colour)
    else {
        panic!("an anisotropic volume of masses")
    };
    for (i, (position, factor, mass)) in poison.iter().enumerate() {
        let at = (7 * i) % (positions.len() + 1);
        positions.insert(at, *position);
        factors.insert(at, *factor);
        masses.insert(at, *mass);
        colours.insert(at, [1.0, 0.0, 1.0]);
    }
    all
}

fn good() -> Vec<Particle> {
    particles(2).into_iter().take(100).collect()
}

fn all_finite(renderer: &Renderer) -> bool {
    renderer
        .image()
        .pixels
        .iter()
        .flatten()
        .all(|c| c.is_finite())
}

/// Renders with and without the poison, with every filter, projection and level, and passes both to
/// `check`.
fn poisoned(poison: &[(DVec3, [f32; 6], f32)], check: impl Fn(Filter, f32)) {
    let good = good();
    let mut clean = Renderer::new(vec![volume(&good)]).unwrap();
    let mut dirty = Renderer::new(vec![with(&good, poison)]).unwrap();
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let camera = scene::camera(projection, [31.0, 27.0], [37, 33]);
        for filter in Filter::ALL {
            for simd in SimdLevel::available() {
                let settings = Settings {
                    filter,
                    advanced: Advanced {
                        simd,
                        ..Advanced::default()
                    },
                    depth: true,
                    ..Settings::default()
                };
                let name = format!("{projection:?}, {filter:?}, {simd:?}");
                clean.render(&camera, &settings).unwrap();
                dirty.render(&camera, &settings).unwrap();
                assert!(all_finite(&dirty), "{name}");
                check(filter, difference(clean.image(), dirty.image()));
            }
        }
    }
}

const NAN: f32 = f32::NAN;
const INF: f32 = f32::INFINITY;

#[test]
fn poisoned_masses_and_shapes_draw_nothing() {
    let at = good()[3].position;
    let sphere = [0.1, 0.0, 0.1, 0.0, 0.0, 0.1];
    let mut poison: Vec<_> = [NAN, -NAN, INF, -INF, 0.0, -0.0, -1.0, 1e-45]
        .map(|mass| (at, sphere, mass))
        .to_vec();
    for l in [NAN, INF, -INF, 1e30, f32::MAX] {
        // A needle of 1e30 units along z should be visible: its depth depends on its width across
        // z.
        let places = if l.is_finite() { 0..1 } else { 0..6 };
        for place in places {
            let mut factor = sphere;
            factor[place] = l;
            poison.push((at, factor, 1e-3));
        }
        poison.push((at, [l; 6], 1.0));
    }
    // None of these is visible: a kernel 1e30 units wide has a depth of 1e-30. The others are in
    // the same block with the same origin, so nothing moves. Only the pure low-pass filter does not
    // need a shape.
    poisoned(&poison, |filter, error| {
        assert!(
            error < 1e-7 || filter == Filter::LowPass,
            "{filter:?}: {error:e}"
        );
    });
}

#[test]
fn extreme_but_legal_particles_give_finite_pixels() {
    let at = good()[3].position;
    let sphere = |s: f32| [s, 0.0, s, 0.0, 0.0, s];
    let mut poison = Vec::new();
    for sigma in [0.0, 1e-45, 1e-38, 1e-20, 1e10, 1e18] {
        for mass in [1e-45, 1e-30, 1.0, 1e10, 1e30, f32::MAX] {
            for depth in [0.0, 1e-30, 1e-3, 1.0, 1e15] {
                poison.push((at.truncate().extend(depth) * 0.1, sphere(sigma), mass));
            }
        }
    }
    poisoned(&poison, |_, _| ());
}

#[test]
fn positions_that_are_none_draw_nothing_and_move_nothing() {
    move_nothing(&[f64::NAN, f64::INFINITY, -f64::INFINITY]);
}

#[test]
fn far_outliers_draw_nothing_and_move_nothing() {
    move_nothing(&[1e300, -1e300, 1e30, -1e15, 1e9]);
}

fn move_nothing(far: &[f64]) {
    let sphere = [0.1, 0.0, 0.1, 0.0, 0.0, 0.1];
    for &x in far {
        let poison: Vec<_> = [
            DVec3::new(x, 0.0, 1.0),
            DVec3::new(0.0, x, 1.0),
            DVec3::new(x, x, x),
        ]
        .map(|p| (p, sphere, 1e-3))
        .to_vec();
        // None of these lies in the image.
        poisoned(&poison, |filter, error| {
            assert!(error < 1e-6, "{x}: {filter:?}: {error:e}")
        });
    }
}

#[test]
fn every_level_counts_the_same_splat_pixels() {
    // A multiple of the tile, and one more: at the image's border, a vector may extend beyond it.
    for width in [64, 65] {
        let camera = scene::camera(Projection::Perspective, [31.0, 27.0], [width, 48]);
        let mut counts = Vec::new();
        for simd in SimdLevel::available() {
            let mut renderer = Renderer::new(vec![volume(&particles(3))]).unwrap();
            let settings = Settings {
                advanced: Advanced {
                    simd,
                    ..Advanced::default()
                },
                tolerance: 1e-3,
                ..Settings::default()
            };
            renderer.render(&camera, &settings).unwrap();
            counts.push(renderer.counts().splat_pixels);
        }
        println!("{width} px wide, splat-pixels by level: {counts:?}");
        // A pixel on the edge of a cut-off may fall on either side: one in a thousand.
        let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
        assert!(most - least <= most / 1000, "{counts:?}");
    }
}

/// Returns the frame's pixels, depths and splat-pixels by the vector loops alone.
fn rasterise(frame: &Frame, level: SimdLevel) -> (Image, Vec<f32>, u64) {
    let (width, height) = (frame.camera.width, frame.camera.height);
    let mut tiles = vec![Tile::default(); frame.tiles[0] * frame.tiles[1]];
    let settings = RasteriseSettings {
        axes: Axes {
            linear_opacity: frame.settings.advanced.linear_opacity,
            depth: true,
            count: false,
            may_be_exact: frame.any_exact,
            ..Axes::default()
        },
        level,
        ends: None,
        task: None,
    };
    let count = cpu::rasterise(
        &frame.uniform,
        settings,
        &frame.footprints,
        &frame.exact,
        &frame.near,
        &frame.bins(),
        frame.tiles[0],
        &[],
        None,
        &mut tiles,
    );
    let mut image = Image::new(width, height);
    cpu::resolve(&tiles, None, false, &mut image);
    let depths = depth_of(&tiles, [width, height]).depths;
    (image, depths, count)
}

#[test]
fn the_loop_of_aligned_footprints_is_the_general_one() {
    let camera = scene::camera(Projection::Perspective, [31.0, 27.0], [53, 37]);
    let mut random = Random::new(4);
    let mut worst = 0.0_f32;
    for linear_opacity in [false, true] {
        let settings = Settings {
            filter: Filter::Isotropic,
            advanced: Advanced {
                linear_opacity,
                ..Advanced::default()
            },
            // No tile stops early, which would depend on rounding.
            tolerance: 1e-6,
            ..Settings::default()
        };
        let mut aligned = Frame::new(volume(&particles(4)), &camera, &settings);
        // Round footprints, and footprints that are narrower along an axis.
        for (i, f) in aligned.footprints.iter_mut().enumerate() {
            let narrower = random.range(1.0, 4.0) as f32;
            match i % 3 {
                0 => {}
                1 => f.form_r[1] *= narrower,
                _ => {
                    let form = f.form_p[0];
                    (f.form_p, f.form_r) = ([0.0, form], [form * narrower, 0.0]);
                }
            }
        }
        // A slant of 1e-30 of a pixel is far below rounding: the general loop draws the same.
        let mut general = Frame::new(volume(&particles(4)), &camera, &settings);
        general.footprints.clone_from(&aligned.footprints);
        for f in &mut general.footprints {
            for number in f.form_p.iter_mut().chain(&mut f.form_r) {
                *number = number.max(1e-30);
            }
        }
        let paths = |f: &Footprint| f.is_visible() && f.path == PATH_AFFINE;
        assert!(aligned.footprints.iter().filter(|f| paths(f)).count() > 150);
        for level in SimdLevel::available() {
            let (image, depths, count) = rasterise(&aligned, level);
            let (expected, expected_depths, expected_count) = rasterise(&general, level);
            assert_eq!(count, expected_count, "{level:?}");
            let flips = depths.iter().zip(&expected_depths).filter(|(a, b)| a != b);
            // An opacity within rounding of one half passes it one kernel later.
            assert!(flips.count() <= 1, "{level:?}");
            worst = worst.max(difference(&image, &expected));
        }
    }
    println!("largest difference {worst:.1e}");
    // Three exponentials, each off by 3e-6, relative, change a pixel by at most a share of x
    // exp(-x) <= .37 of that. Some hundred layers round by 2^-25.
    assert!(worst < 7e-6, "{worst:e}");
}

#[test]
fn pixels_count_the_kernels_within_their_cut_off() {
    let particles = particles(5);
    let mut open = 0;
    for projection in [Projection::Perspective, Projection::Orthographic] {
        for filter in [Filter::Adaptive, Filter::Ewa, Filter::Isotropic] {
            let camera = scene::camera(projection, [31.0, 27.0], [53, 37]);
            let drawn = Settings {
                filter,
                depth: true,
                // No tile stops early.
                tolerance: 1e-6,
                ..Settings::default()
            };
            let frame = Frame::new(volume(&particles), &camera, &drawn);
            let mut renderer = Renderer::new(vec![volume(&particles)]).unwrap();
            for simd in SimdLevel::available() {
                let drawn = Settings {
                    advanced: Advanced {
                        simd,
                        ..drawn.advanced
                    },
                    ..drawn.clone()
                };
                renderer.render(&camera, &drawn).unwrap();
                let (depth, counts) = (renderer.depth().cloned(), renderer.counts());
                let counted = Settings {
                    show: Show::Count,
                    background: Some([0.2, 0.4, 0.8]),
                    ..drawn
                };
                renderer.render(&camera, &counted).unwrap();
                assert_eq!(renderer.counts(), counts);
                assert_eq!(renderer.depth().cloned(), depth);
                assert_eq!(sum_of_counts(renderer.image()), counts.splat_pixels);
                for (i, pixel) in renderer.image().pixels.iter().enumerate() {
                    let (inside, edges) = count(&frame, i % 53, i / 53);
                    open += usize::from(edges > 0);
                    let n = pixel[0] as usize;
                    assert!(
                        (inside..=inside + edges).contains(&n),
                        "{simd:?}, {projection:?}, {filter:?}, pixel {i}: {n} for {inside}"
                    );
                }
            }
        }
    }
    println!("left open at {open} pixels");
    assert!(open < 53 * 37 / 4, "{open}");
}

/// Returns the sum of kernels in a picture of counts, whose pixels must all be numbers.
fn sum_of_counts(image: &Image) -> u64 {
    let count = |p: &[f32; 4]| {
        assert_eq!(*p, [p[0].trunc(), p[0], p[0], 1.0]);
        p[0] as u64
    };
    image.pixels.iter().map(count).sum()
}

/// Returns the number of kernels certainly at a pixel, and the number for which rounding decides.
fn count(frame: &Frame, x: usize, y: usize) -> (usize, usize) {
    let (mut inside, mut edges) = (0, 0);
    for i in (0..frame.footprints.len()).filter(|&i| frame.footprints[i].is_visible()) {
        let depth = depth_at(frame, i, [x, y]);
        // A depth that underflows may count or not.
        let is_edge = depth.edge > 0.0 || (depth.tau > 0.0 && depth.tau < 1e-30);
        edges += usize::from(is_edge);
        inside += usize::from(!is_edge && depth.tau > 0.0);
    }
    (inside, edges)
}
