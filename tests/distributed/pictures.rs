//! Tests pictures of all kinds on any number of ranks.

use ewa_splat::render::{Advanced, Classification, Composite};
use ewa_splat::scene::{Colour, Lighting, Particles, PointVolume, Strength, TransferFunction};
use ewa_splat::view::{Camera, ClipPlane};
use ewa_splat::{ColumnSettings, Filter, Settings, Show};
use glam::DVec3;

use crate::ranks::{Frame, alone, assert_same, assert_same_column, together};
use crate::scenes::{ball, ellipsoids, lattice, plain, spheres};

fn camera(size: [usize; 2]) -> Camera {
    Camera::perspective(DVec3::NEG_Z * 4.0, DVec3::ZERO, DVec3::Y, 40.0, size)
}

fn flat(size: [usize; 2]) -> Camera {
    Camera::orthographic(DVec3::new(1.0, 2.0, -4.0), DVec3::ZERO, DVec3::Y, 3.0, size)
}

fn depths() -> Settings {
    Settings {
        depth: true,
        ..Settings::default()
    }
}

#[test]
fn kernels_over_one_another_near_and_far() {
    let frames = [
        // More ranks than tiles; the whole scene; from inside; from afar, where merged particles
        // stand for others.
        (camera([1, 1]), depths()),
        (camera([200, 150]), depths()),
        (
            Camera::perspective(DVec3::splat(0.1), DVec3::X, DVec3::Y, 90.0, [97, 130]),
            depths(),
        ),
        (
            Camera::perspective(DVec3::Z * 400.0, DVec3::ZERO, DVec3::Y, 20.0, [64, 64]),
            depths(),
        ),
        (flat([120, 90]), depths()),
        (
            camera([120, 90]),
            Settings {
                background: Some([0.1, 0.2, 0.3]),
                filter: Filter::Exact,
                advanced: Advanced {
                    linear_opacity: true,
                    ..Advanced::default()
                },
                ..Settings::default()
            },
        ),
        (
            camera([120, 90]),
            Settings {
                show: Show::Count,
                ..Settings::default()
            },
        ),
    ];
    let expected = assert_same(&[spheres(6000)], &frames);
    assert!(expected[1].shown() > 5000 && expected[1].counts.footprints_near > 0);
    assert!(expected[3].counts.blocks_merged > 0);
    assert!(expected[5].counts.footprints_exact > 0);
}

/// Returns an opaque ball of ellipsoids' values.
fn opaque() -> PointVolume {
    let shown = |v: f32| if v > 0.7 { 0.99 } else { 0.0 };
    let transfer = TransferFunction::from_curves(|v| [v, 0.5, 1.0 - v], shown, [0.0, 1.0], 0.1);
    PointVolume {
        transfer_function: Some(transfer.unwrap()),
        ..ellipsoids(4_000)
    }
}

#[test]
fn tiles_with_opaque_edges() {
    let narrow = Settings {
        low_pass_variance_px2: 0.15,
        depth: true,
        advanced: Advanced {
            opaque_edges: true,
            ..Advanced::default()
        },
        ..Settings::default()
    };
    let slabs = Settings {
        composite: Composite::SLABS,
        ..narrow.clone()
    };
    // The last picture is the first again: samples leave nothing behind.
    let frames = [
        (camera([120, 90]), narrow.clone()),
        (flat([50, 70]), slabs),
        (camera([120, 90]), narrow),
    ];
    let expected = assert_same(&[opaque(), spheres(600)], &frames);
    assert!(
        expected
            .iter()
            .all(|frame| frame.counts.supersampled_tiles > 3)
    );
    assert!(expected[0] == expected[2]);
}

#[test]
fn classified_kernels_in_pieces_and_in_layers() {
    let layered = |composite, classify| {
        let settings = Settings {
            composite,
            classify,
            depth: true,
            ..Settings::default()
        };
        (camera([40, 28]), settings)
    };
    let thickness = None;
    let extent = Classification::Extent;
    let frames = [
        (camera([40, 28]), depths()),
        (
            camera([40, 28]),
            Settings {
                classify: Classification::Particle,
                ..Settings::default()
            },
        ),
        layered(Composite::Sheets { thickness }, extent),
        layered(Composite::AxisSheets { thickness }, extent),
        layered(Composite::Slabs { thickness }, extent),
        layered(Composite::Slabs { thickness }, Classification::Slab),
        layered(Composite::Maximum { thickness }, extent),
        // Colours are drawn again after values.
        (flat([40, 28]), depths()),
    ];
    for scene in [ellipsoids(1500), lattice(12)] {
        let expected = assert_same(&[scene], &frames);
        assert!(expected[0].counts.pieces > 0);
        let shown: Vec<usize> = expected.iter().map(Frame::shown).collect();
        assert!(shown.iter().all(|&n| n > 150), "{shown:?}");
    }
}

#[test]
fn surfaces_in_volumes_lit_and_clipped() {
    let lit = Settings {
        lighting: Some(Lighting::default()),
        depth: true,
        normals: true,
        ..Settings::default()
    };
    let clip = vec![ClipPlane {
        normal: DVec3::new(1.0, 0.2, 0.3),
        distance: 0.1,
    }];
    let clipped = Settings {
        clip,
        ..lit.clone()
    };
    let frames = [
        (camera([70, 50]), lit.clone()),
        (camera([70, 50]), clipped.clone()),
        (
            // The eye lies among the surfels.
            Camera::perspective(DVec3::Z * -0.71, DVec3::Z, DVec3::Y, 100.0, [40, 40]),
            clipped,
        ),
        (flat([70, 50]), lit),
    ];
    let surface = ball(3000, 0.7);
    let expected = assert_same(std::slice::from_ref(&surface), &frames);
    assert!(expected[0].counts.surfels > 1000);
    let all = [ellipsoids(1500), surface, lattice(12)];
    let expected = assert_same(&all, &frames);
    assert!(expected[2].counts.footprints_near > 0);
}

#[test]
fn column_densities_are_summed_in_one_order() {
    let settings = ColumnSettings::default();
    let scene = [spheres(6000), lattice(12), ellipsoids(1000)];
    for camera in [flat([130, 90]), camera([64, 100])] {
        let image = assert_same_column(&scene, &camera, &settings);
        assert!(image.values.iter().any(|v| *v > 0.0));
    }
    // One tile holds enough footprints for its list to be summed in parts, whose rounding would
    // show.
    let mut crowd = spheres(20_000);
    if let Particles::Isotropic { positions, .. } = &mut crowd.particles {
        positions.iter_mut().for_each(|p| *p *= 0.02);
    }
    assert_same_column(&[crowd], &flat([70, 60]), &settings);
}

#[test]
fn nothing_and_next_to_nothing() {
    let none = plain(
        Particles::Isotropic {
            positions: Vec::new(),
            sigmas: Vec::new(),
        },
        Strength::Mass(Vec::new()),
        Colour::Uniform([1.0; 3]),
    );
    let frames = [(camera([40, 30]), depths()), (camera([1, 1]), depths())];
    assert_same(&[], &frames);
    assert_same(std::slice::from_ref(&none), &frames);
    // All ranks together have one block.
    assert_same(&[none, spheres(3)], &frames);
    // Particles that are not finite belong to no rank.
    let mut broken = spheres(2000);
    if let Particles::Isotropic { positions, sigmas } = &mut broken.particles {
        positions[17].x = f64::NAN;
        positions[18].y = f64::INFINITY;
        sigmas[19] = f32::NAN;
    }
    assert_same(&[broken], &frames);
}

#[test]
fn shares_are_shares() {
    let scene: Vec<PointVolume> = vec![spheres(60_000)];
    let frames = [(camera([256, 192]), Settings::default())];
    let (_, one) = together(1, &scene, &frames);
    let (_, four) = together(4, &scene, &frames);
    for rank in &four {
        // Ranks may differ by a run of blocks.
        assert!(rank.particles.abs_diff(15_000) < 3000, "{}", rank.particles);
        // Each rank has a quarter of the particles, and all blocks.
        assert!(
            rank.bytes < one[0].bytes / 2,
            "{} of {}",
            rank.bytes,
            one[0].bytes
        );
        assert!(rank.footprints_made > 0 && rank.splat_pixels > 0);
    }
    // A few footprints of each rank go to more than one other rank.
    let sent: u64 = four.iter().map(|rank| rank.footprints_sent).sum();
    let made: u64 = four.iter().map(|rank| rank.footprints_made).sum();
    assert!(sent >= made && sent < 2 * made, "{sent} of {made}");
    assert_eq!(alone(&scene, &frames).len(), 1);
}
