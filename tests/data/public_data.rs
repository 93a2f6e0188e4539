//! Tests that invalid values in public fields give an error and never a panic.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;
use std::sync::Arc;

use crate::common::scalar;

use ewa_splat::image::{ColumnImage, Image};
use ewa_splat::io::{
    Association, CellKind, CellMesh, CurvilinearBlock, Dataset, Field, FieldSource, Geometry,
    Material, Mesh, MeshPart, SplatCloud, SplatFileOptions, Texture, TextureImage, TextureUse,
    Wrap, column_colours, column_picture, write_splats,
};
use ewa_splat::measure::{compare, difference, flip, ssim};
use ewa_splat::sample::mesh::{MeshOptions, Spread, surfels};
use ewa_splat::sample::{
    KernelOptions, SampleOptions, cut_faces, scene, sound_splats, splat_cloud, volume,
};
use ewa_splat::scene::{
    Colour, Lattice, LatticeSpacing, Particles, PointVolume, SplatRule, Strength, TransferDefaults,
    TransferFunction, Values,
};
use ewa_splat::stages::cpu::for_each_tile;
use ewa_splat::stages::record::{Footprint, FootprintTerms};
use ewa_splat::{Error, Renderer};
use glam::{Affine2, DVec3, Vec2, Vec3};

/// Returns the text of an error about the caller's data.
fn refused<T>(result: ewa_splat::Result<T>) -> String {
    match result {
        Err(error @ (Error::Invalid { .. } | Error::Format { .. })) => error.to_string(),
        Err(other) => panic!("{other:?}"),
        Ok(_) => panic!("accepted"),
    }
}

fn lattice(dims: [usize; 3], coordinates: [&[f64]; 3]) -> Lattice {
    let spacing = LatticeSpacing::Rectilinear {
        coordinates: coordinates.map(<[f64]>::to_vec),
    };
    Lattice { dims, spacing }
}

/// Returns lattices whose samples have no positions, with parts of the errors.
fn unsound_lattices() -> Vec<(Lattice, &'static str)> {
    let half = usize::MAX / 2;
    let two = &[0.0, 1.0][..];
    vec![
        (lattice([3, 2, 2], [two, two, two]), "along x"),
        (lattice([2, 2, 3], [two, two, two]), "along z"),
        (lattice([2, 2, 2], [two, &[0.0, 1.0, 2.0], two]), "along y"),
        (lattice([2, 2, 2], [two, two, &[1.0, 0.0]]), "rise"),
        (lattice([2, 2, 2], [two, &[1.0, 1.0], two]), "rise"),
        (lattice([2, 2, 2], [two, &[f64::NAN, 1.0], two]), "finite"),
        (
            lattice([2, 2, 2], [&[0.0, f64::INFINITY], two, two]),
            "finite",
        ),
        (
            Lattice::uniform([half, 3, 1], DVec3::ZERO, DVec3::ONE),
            "product",
        ),
        (
            Lattice::uniform([usize::MAX; 3], DVec3::ZERO, DVec3::ONE),
            "product",
        ),
        (
            Lattice::uniform([2; 3], DVec3::NAN, DVec3::ONE),
            "origin and step",
        ),
        (
            Lattice::uniform([2; 3], DVec3::ZERO, DVec3::INFINITY),
            "origin and step",
        ),
    ]
}

fn dataset(geometry: Geometry, fields: Vec<Field>) -> Dataset {
    Dataset::new(Path::new("given"), "test", geometry, fields)
}

fn transfer_function() -> TransferFunction {
    let defaults = TransferDefaults {
        range: [0.0, 1.0],
        unit_distance: 1.0,
    };
    TransferFunction::named("viridis", &defaults).unwrap()
}

fn lattice_volume(lattice: Lattice, kernel_width: f64) -> PointVolume {
    let count = if lattice.len() < 1000 {
        lattice.len()
    } else {
        8
    };
    PointVolume::new(
        Particles::Lattice {
            lattice,
            kernel_width,
        },
        Strength::Classified {
            volumes: Vec::new(),
        },
    )
    .classified(Values::F32(vec![0.5; count]), transfer_function())
}

#[test]
fn lattices_without_positions_are_refused() {
    for (lattice, words) in unsound_lattices() {
        let said = refused(lattice.validate());
        assert!(said.contains(words), "{said}");
        let field = scalar("f", Association::Nodes, vec![0.5; 8]);
        let data = dataset(Geometry::Lattice(lattice.clone()), vec![field]);
        let said = refused(volume(data.clone(), &SampleOptions::default()));
        assert!(
            said.starts_with("given: ") && said.contains(words),
            "{said}"
        );
        refused(scene(data, &SampleOptions::default()));
        let volume = lattice_volume(lattice, 0.6);
        refused(splat_cloud(std::slice::from_ref(&volume)));
        refused(cut_faces(&volume, &[]));
        refused(Renderer::new(vec![volume]));
    }
    // A lattice without samples is valid.
    for dims in [[0, 0, 0], [0, 3, 2], [2, 0, 2]] {
        let empty = Lattice::uniform(dims, DVec3::ZERO, DVec3::ONE);
        let mut renderer = Renderer::new(vec![lattice_volume(empty, 0.6)]).unwrap();
        let eye = DVec3::new(0.0, -5.0, 0.0);
        let camera = ewa_splat::view::Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 40.0, [9, 7]);
        let image = renderer
            .render(&camera, &ewa_splat::Settings::default())
            .unwrap();
        assert_eq!(image.pixels, vec![[0.0; 4]; 63]);
    }
}

#[test]
fn kernel_widths_are_positive() {
    for width in [0.0, -0.6, f64::NAN, f64::INFINITY] {
        let lattice = Lattice::uniform([2; 3], DVec3::ZERO, DVec3::ONE);
        let said = refused(Renderer::new(vec![lattice_volume(lattice.clone(), width)]));
        assert!(said.contains("kernel width"), "{said}");
        let options = SampleOptions {
            kernels: KernelOptions {
                width,
                ..KernelOptions::default()
            },
            ..SampleOptions::default()
        };
        let field = scalar("f", Association::Nodes, vec![0.5; 8]);
        refused(volume(
            dataset(Geometry::Lattice(lattice), vec![field]),
            &options,
        ));
        let options = MeshOptions {
            kernel_width: width,
            ..MeshOptions::default()
        };
        refused(surfels(&triangle(), &options));
    }
}

#[test]
fn an_invisible_footprint_touches_no_tile() {
    for (columns, rows) in [(0, 0), (0, 1 << 16), (1 << 16, 0), (5 | 3 << 16, 1 << 16)] {
        let footprint = Footprint {
            columns,
            rows,
            ..bytemuck::Zeroable::zeroed()
        };
        for_each_tile(&footprint, FootprintTerms::None, 0, 4, |tile| {
            panic!("{tile}")
        });
    }
}

#[test]
fn grids_hold_together() {
    let nodes = |n| vec![DVec3::ZERO; n];
    let values = |n| vec![scalar("f", Association::Nodes, vec![0.5; n])];
    for dims in [[2, 2, 3], [2, 2, 1], [usize::MAX, 3, 1], [usize::MAX; 3]] {
        let blocks = vec![CurvilinearBlock {
            dims,
            nodes: nodes(8),
        }];
        let data = dataset(Geometry::Curvilinear { blocks }, values(8));
        let said = refused(volume(data, &SampleOptions::default()));
        assert!(said.contains("8 positions"), "{said}");
    }
    let tetra = CellMesh {
        nodes: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
        kinds: vec![CellKind::TETRA],
        offsets: vec![0, 4],
        connectivity: vec![0, 1, 2, 3],
    };
    let sample = |mesh: CellMesh| {
        let data = dataset(Geometry::Cells(mesh), values(4));
        volume(data, &SampleOptions::default())
    };
    assert!(sample(tetra.clone()).is_ok());
    let faults: [fn(&mut CellMesh); 6] = [
        |m| m.offsets.clear(),
        |m| m.offsets = vec![0, 5],
        |m| m.offsets = vec![4, 0],
        |m| m.kinds.clear(),
        |m| m.connectivity[3] = 4,
        |m| m.nodes.clear(),
    ];
    for fault in faults {
        let mut mesh = tetra.clone();
        fault(&mut mesh);
        refused(sample(mesh));
    }
}

#[test]
fn fields_fit_their_samples() {
    let points = || Geometry::Points {
        positions: (0..8).map(|i| DVec3::splat(f64::from(i))).collect(),
    };
    let cube = || Geometry::Lattice(Lattice::uniform([2; 3], DVec3::ZERO, DVec3::ONE));
    for geometry in [points(), cube()] {
        for len in [0, 7, 9] {
            let field = scalar("f", Association::Nodes, vec![0.5; len]);
            let options = SampleOptions {
                field: Some("f".into()),
                ..SampleOptions::default()
            };
            refused(volume(dataset(geometry.clone(), vec![field]), &options));
        }
        let of = |n: usize| Values::F32(vec![0.5; n]);
        let vector = Field {
            name: "v".into(),
            association: Association::Nodes,
            source: FieldSource::Vector(vec![of(8), of(7), of(8)]),
            unit: None,
        };
        let data = dataset(geometry.clone(), vec![vector]);
        refused(data.scalar("v"));
        refused(data.field_scalar(&data.fields[0]));
        for selector in ["v", "v:y"] {
            let options = SampleOptions {
                field: Some(selector.into()),
                ..SampleOptions::default()
            };
            refused(volume(data.clone(), &options));
        }
    }
    let options = SampleOptions {
        kernels: KernelOptions {
            shepard_passes: u32::MAX,
            ..KernelOptions::default()
        },
        ..SampleOptions::default()
    };
    let said = refused(volume(
        dataset(cube(), vec![scalar("f", Association::Nodes, vec![1.0; 8])]),
        &options,
    ));
    assert!(said.contains("at most 100"), "{said}");
}

fn splats() -> SplatCloud {
    SplatCloud {
        positions: vec![DVec3::ZERO, DVec3::X],
        scales: vec![[0.1; 3]; 2],
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacities: vec![0.5; 2],
        harmonics_degree: 1,
        harmonics: vec![0.1; 24],
        rule: SplatRule::Exact,
        is_linear: false,
        ..SplatCloud::default()
    }
}

#[test]
fn splats_have_one_entry_each() {
    let folder = tempfile::tempdir().unwrap();
    let sample = |cloud: SplatCloud| {
        volume(
            dataset(Geometry::Splats(cloud), Vec::new()),
            &SampleOptions::default(),
        )
    };
    assert!(splats().validate().is_ok() && sample(splats()).is_ok());
    let faults: [fn(&mut SplatCloud); 8] = [
        |c| c.scales.truncate(1),
        |c| c.rotations.clear(),
        |c| c.opacities.push(1.0),
        |c| c.harmonics.truncate(23),
        |c| c.harmonics.clear(),
        |c| c.harmonics_degree = 2,
        |c| c.harmonics_degree = u8::MAX,
        |c| {
            c.harmonics_degree = 9;
            c.harmonics = vec![0.0; 600];
        },
    ];
    for fault in faults {
        let mut cloud = splats();
        fault(&mut cloud);
        refused(cloud.validate());
        refused(sample(cloud.clone()));
        refused(sound_splats(cloud.clone()));
        for name in ["a.ply", "a.splat", "a.spz", "a.glb"] {
            let path = folder.path().join(name);
            refused(write_splats(&path, &cloud, &SplatFileOptions::default()));
            assert!(!path.exists());
        }
    }
}

/// Returns a textured triangle.
fn triangle() -> Mesh {
    let image = TextureImage {
        width: 2,
        height: 2,
        pixels: vec![[200, 100, 50, 255]; 4],
    };
    Mesh {
        parts: vec![MeshPart {
            is_flat: false,
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            lines: Vec::new(),
            points: Vec::new(),
            normals: vec![Vec3::Z; 3],
            texture_coordinates: vec![vec![Vec2::ZERO, Vec2::X, Vec2::Y]],
            colours: vec![[1.0; 4]; 3],
            material: 0,
        }],
        materials: vec![Material {
            base_texture: Some(TextureUse {
                texture: 0,
                coordinates: 0,
                transform: Affine2::IDENTITY,
            }),
            ..Material::default()
        }],
        textures: vec![Texture {
            image: Arc::new(image),
            wrap: [Wrap::Repeat; 2],
        }],
    }
}

#[test]
fn meshes_hold_together() {
    let options = MeshOptions {
        spread: Spread::Count(20),
        ..MeshOptions::default()
    };
    let sample = |mesh: &Mesh| surfels(mesh, &options);
    assert!(sample(&triangle()).is_ok());
    let picture = |width, height, count| {
        Arc::new(TextureImage {
            width,
            height,
            pixels: vec![[9; 4]; count],
        })
    };
    for (width, height, count) in [
        (2, 2, 3),
        (2, 2, 5),
        (0, 0, 0),
        (0, 4, 4),
        (usize::MAX, 2, 4),
    ] {
        let mut mesh = triangle();
        mesh.textures[0].image = picture(width, height, count);
        refused(mesh.validate());
        refused(sample(&mesh));
    }
    let faults: [fn(&mut Mesh); 7] = [
        |m| m.parts[0].normals.truncate(2),
        |m| m.parts[0].colours.push([1.0; 4]),
        |m| m.parts[0].texture_coordinates[0].truncate(1),
        |m| m.textures.clear(),
        |m| m.parts[0].triangles[0][2] = 3,
        |m| m.parts[0].material = 1,
        |m| m.parts.clear(),
    ];
    for fault in faults {
        let mut mesh = triangle();
        fault(&mut mesh);
        refused(sample(&mesh));
        let said = refused(scene(
            dataset(Geometry::Mesh(mesh), Vec::new()),
            &SampleOptions::default(),
        ));
        assert!(said.starts_with("given: "), "{said}");
    }
    // If the coordinate set that its material names is absent, a part has no texture.
    let mut mesh = triangle();
    if let Some(used) = &mut mesh.materials[0].base_texture {
        used.coordinates = usize::MAX;
    }
    assert!(sample(&mesh).is_ok());
}

#[test]
fn images_have_all_their_pixels() {
    let whole = Image::new(16, 16);
    for (width, height, count) in [(16, 16, 255), (16, 16, 257), (usize::MAX, 2, 256)] {
        let broken = Image {
            width,
            height,
            pixels: vec![[0.5; 4]; count],
        };
        for (a, b) in [(&whole, &broken), (&broken, &whole), (&broken, &broken)] {
            refused(compare(a, b));
            refused(difference(a, b, 1.0));
            assert_eq!((ssim(a, b), flip(a, b, 67.0)), (None, None));
        }
        let column = ColumnImage {
            width,
            height,
            values: vec![1.0; count],
            pixel_area: None,
        };
        let whole = ColumnImage {
            width: 1,
            height: 1,
            values: vec![1.0],
            pixel_area: None,
        };
        let colours = column_colours(&whole, None, None, None).unwrap().unwrap();
        assert_eq!(column_picture(&column, &colours), Image::new(0, 0));
    }
    for poison in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
        assert_eq!(flip(&whole, &whole, poison), None);
    }
}

#[test]
fn volumes_have_one_entry_for_each_particle() {
    let sound = || {
        PointVolume::new(
            Particles::Anisotropic {
                positions: vec![DVec3::ZERO, DVec3::X],
                factors: vec![[0.1, 0.0, 0.1, 0.0, 0.0, 0.1]; 2],
            },
            Strength::Mass(vec![1.0; 2]),
        )
        .with_colours(vec![[1.0; 3]; 2])
    };
    assert!(Renderer::new(vec![sound()]).is_ok());
    let faults: [fn(&mut PointVolume); 7] = [
        |v| v.strength = Strength::Mass(vec![1.0]),
        |v| v.strength = Strength::Surface(vec![1.0; 2]),
        |v| {
            v.strength = Strength::Classified {
                volumes: vec![1.0; 2],
            }
        },
        |v| v.colour = Colour::PerParticle(vec![[1.0; 3]; 3]),
        |v| {
            v.colour = Colour::Harmonics {
                degree: 1,
                coefficients: vec![0.0; 23],
                is_linear: false,
            }
        },
        |v| v.values = Some(Values::U8(vec![0])),
        |v| v.normals = Some(vec![0; 3]),
    ];
    for fault in faults {
        let mut volume = sound();
        fault(&mut volume);
        refused(splat_cloud(std::slice::from_ref(&volume)));
        refused(Renderer::new(vec![volume]));
    }
}
