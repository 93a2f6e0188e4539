//! Tests lines and points of meshes in pictures: about two pixels wide, closed, and of their
//! colours.

use ewa_splat::io::{Material, Mesh, MeshPart};
use ewa_splat::sample::mesh::{MeshOptions, Spread, pixels_per_area, surfels};
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Settings};
use glam::DVec3;

const SIZE: usize = 96;

/// Returns a camera that looks down the z axis at a square of 4 by 4.
fn camera() -> Camera {
    Camera::orthographic(DVec3::Z * 5.0, DVec3::ZERO, DVec3::Y, 4.0, [SIZE, SIZE])
}

/// Returns the picture's RGBA, by row and column.
fn picture(part: MeshPart, density: Option<f64>) -> Vec<[f32; 4]> {
    let mesh = Mesh {
        parts: vec![part],
        materials: vec![Material::default()],
        textures: Vec::new(),
    };
    let density = density.or_else(|| pixels_per_area(&mesh, &camera()));
    let options = MeshOptions {
        spread: Spread::NoDenser(density.unwrap()),
        ..MeshOptions::default()
    };
    let sampled = surfels(&mesh, &options).unwrap();
    let mut renderer = Renderer::new(sampled.volumes).unwrap();
    let image = renderer.render(&camera(), &Settings::default()).unwrap();
    image.pixels.clone()
}

fn colours(count: usize, rgba: [f32; 4]) -> Vec<[f32; 4]> {
    vec![rgba; count]
}

#[test]
fn a_line_is_two_pixels_wide_closed_and_of_its_colour() {
    let ends = [DVec3::new(-1.5, 0.1, 0.0), DVec3::new(1.5, 0.1, 0.0)];
    // The line is the same in one piece and in a thousand.
    for pieces in [1_u32, 1000] {
        let share = |i: u32| f64::from(i) / f64::from(pieces);
        let positions: Vec<DVec3> = (0..=pieces)
            .map(|i| ends[0].lerp(ends[1], share(i)))
            .collect();
        let pixels = picture(
            MeshPart {
                lines: (0..pieces).map(|i| [i, i + 1]).collect(),
                colours: colours(positions.len(), [0.9, 0.4, 0.1, 1.0]),
                positions,
                ..MeshPart::default()
            },
            None,
        );
        // 72 pixels long, with a rounded end on either side.
        let columns = SIZE / 2 - 34..SIZE / 2 + 34;
        for x in columns {
            let column = (0..SIZE).map(|y| pixels[y * SIZE + x]);
            let width: f32 = column.clone().map(|p| p[3]).sum();
            assert!((1.9..2.8).contains(&width), "{pieces}, {x}: {width}");
            let most = column.max_by(|a, b| a[3].total_cmp(&b[3])).unwrap();
            assert!(most[3] > 0.9, "{pieces}, {x}: {most:?}");
            for (c, stated) in [0.9, 0.4, 0.1].into_iter().enumerate() {
                assert!((most[c] / most[3] - stated).abs() < 0.01, "{most:?}");
            }
        }
        let all: f32 = pixels.iter().map(|p| p[3]).sum();
        assert!((72.0 * 2.2..74.5 * 2.6).contains(&all), "{pieces}: {all}");
    }
}

#[test]
fn a_point_is_two_pixels_wide() {
    let pixels = picture(
        MeshPart {
            positions: vec![DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0)],
            points: vec![0, 1],
            colours: colours(2, [0.0, 1.0, 0.0, 1.0]),
            ..MeshPart::default()
        },
        None,
    );
    let half: Vec<_> = pixels.iter().filter(|p| p[3] > 0.45).collect();
    assert!((6..=12).contains(&half.len()), "{}", half.len());
    assert!(half.iter().all(|p| p[0] < 1e-6 && p[1] > 0.4));
}

#[test]
fn surfaces_hide_lines_behind_them_and_lines_before_them_are_seen() {
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    for (z, red) in [(-1.0, 0.0), (1.0, 0.9)] {
        let square = [(-1., -1.), (1., -1.), (1., 1.), (-1., 1.)];
        let mut positions: Vec<DVec3> = square.map(|(x, y)| corner(x, y, 0.0)).to_vec();
        positions.extend([corner(-0.8, 0.0, z), corner(0.8, 0.0, z)]);
        let blue = colours(4, [0.0, 0.0, 1.0, 1.0]);
        let pixels = picture(
            MeshPart {
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                lines: vec![[4, 5]],
                colours: [blue, colours(2, [1.0, 0.0, 0.0, 1.0])].concat(),
                positions,
                ..MeshPart::default()
            },
            Some((SIZE as f64 / 4.0).powi(2)),
        );
        let column = (0..SIZE).map(|y| pixels[y * SIZE + SIZE / 2][0]);
        let most = column.fold(0.0, f32::max);
        assert!((most - red).abs() < 0.1, "{z}: {most}");
    }
}
