//! Writes small sound files of every format, to be damaged.

use std::path::Path;
use std::sync::OnceLock;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::amr;
use super::dicom::{Coding, Slice};
use super::gadget;
use super::meshes::{RICH_OBJ, jpeg, rich_gltf};
use super::nifti::Nifti;
use super::openfoam;
use super::sog;
use super::splats::{
    Element, Ply, glb_packed, glb_splats, ksplat, packed_ply, some_splats, splat_ply,
    splat_records, spz, spz_streams, spz_unpacked, stored,
};
use super::tecplot;
use super::threemf;
use super::vtk_legacy::LegacyVtk;
use super::{Plot3dBlock, Plot3dEncoding, VtkEncoding, VtkPiece, XmlPiece, gzip, zlib};

/// Corners of a cube, in the order of VTK's hexahedra.
const CUBE: [f32; 24] = [
    0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., 0., 0., 1., 1., 0., 1., 1., 1., 1., 0., 1., 1.,
];

/// Returns names and contents of sound files.
pub(crate) fn seeds() -> &'static [(String, Vec<u8>)] {
    static SEEDS: OnceLock<Vec<(String, Vec<u8>)>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let mut seeds = Vec::new();
        for encoding in VtkEncoding::all() {
            let whole = VtkPiece {
                extent: "0 2 0 2 0 1",
                point_data: vec![
                    super::float32("a", 1, &[0.5; 18]),
                    super::int16("b", 3, &[7; 54]),
                ],
                cell_data: vec![super::uint8("c", 1, &[1, 2, 3, 4])],
            };
            let attributes = "WholeExtent=\"0 2 0 2 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"";
            seeds.push(("a.vti".into(), super::vti(encoding, attributes, &[whole])));
            let half = |extent| VtkPiece {
                extent,
                point_data: vec![super::uint16("a", 1, &[1, 2, 3, 4])],
                cell_data: vec![],
            };
            let halves = [half("0 1 0 1 0 0"), half("1 2 0 1 0 0")];
            let attributes = "WholeExtent=\"0 2 0 1 0 0\"";
            seeds.push(("b.vti".into(), super::vti(encoding, attributes, &halves)));
            seeds.extend(vtk_grids(encoding));
        }
        let series = br#"{"file-series-version":"1.0","files":[{"name":"a.vtk","time":0},{"name":"b.vtk","time":0.5}]}"#;
        for _ in 0..8 {
            seeds.push(("a.vtk.series".into(), series.to_vec()));
        }
        for file in legacy_vtk() {
            seeds.push(("a.vtk.gz".into(), gzip(&file)));
        }
        seeds.push(("a.dat.gz".into(), gzip(tecplot::BRICKS.as_bytes())));
        let halves = "{'descr': '<f2', 'fortran_order': False, 'shape': (4, 2), }     \n";
        seeds.push(("c.npy".into(), super::npy(1, halves, &[0x3c; 16])));
        // Two dimensions, with counts: 2 x 3 nodes, f32.
        let mut flat = [1_u32, 2, 3].map(u32::to_le_bytes).concat();
        flat.extend((0..12).flat_map(|i| (i as f32).to_le_bytes()));
        seeds.push(("flat.xyz".into(), flat));
        for encoding in Plot3dEncoding::all() {
            let coordinates: Vec<f64> = (0..24).map(f64::from).collect();
            seeds.push(("a.xyz".into(), encoding.grid([2, 2, 2], &coordinates, None)));
            seeds.push((
                "a.xyz".into(),
                encoding.grid([2, 2, 2], &coordinates, Some(&[1; 8])),
            ));
            seeds.push(("a.q".into(), encoding.solution([2, 2, 2], &[1.0; 40])));
            let two_functions = Plot3dBlock {
                dims: [2; 3],
                numbers: vec![1.0; 16],
                iblank: vec![],
            };
            seeds.push(("a.f".into(), encoding.functions(&[two_functions], 2)));
            if encoding.grid_count {
                let block = |dims: [i32; 3]| Plot3dBlock {
                    dims,
                    numbers: (0..3 * dims.iter().product::<i32>())
                        .map(f64::from)
                        .collect(),
                    iblank: vec![],
                };
                let two = [block([2, 3, 2]), block([3, 2, 2])];
                seeds.push(("b.xyz".into(), encoding.grids(&two)));
            }
        }
        for name in [
            "gadget_old",
            "gadget_old_packed",
            "swift",
            "swift_lossy",
            "phantom",
            "solids_in_time",
            "surface",
            "parts",
            "image_in_time",
            "levels_in_time",
        ] {
            let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
            let name = ["h5", "vtkhdf"].map(|ending| format!("{name}.{ending}"));
            let name = name.into_iter().find(|name| folder.join(name).is_file());
            let name = name.unwrap();
            let bytes = std::fs::read(folder.join(&name)).unwrap();
            for _ in 0..8 {
                seeds.push((name.clone(), bytes.clone()));
            }
        }
        seeds.extend(clouds_and_stacks());
        seeds.extend(dicom());
        for file in legacy_vtk() {
            seeds.push(("a.vtk".into(), file));
        }
        for _ in 0..16 {
            let plain = "{'descr': '>f8', 'fortran_order': True, 'shape': (3, 4), }    \n";
            seeds.push(("a.npy".into(), super::npy(1, plain, &[1; 96])));
            let named = "{'descr': [('x', '<f4'), ('y', '<f4'), ('z', '<f8'), ('v', '<i2', (2,)), \
                         ('', '|V4')], 'fortran_order': False, 'shape': (3,), }\n";
            seeds.push(("b.npy".into(), super::npy(2, named, &[2; 72])));
            let at = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3), }    \n";
            let mass = "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }     \n";
            let arrays = [
                ("pos.npy", super::npy(1, at, &[1; 72])),
                ("mass.npy", super::npy(1, mass, &[1; 12])),
            ];
            seeds.push(("a.npz".into(), super::npz(&arrays, true)));
            seeds.push(("b.npz".into(), super::npz(&arrays, false)));
            let text = b"# made\nx,y,z,h,name\n1,2,3,0.5,a\n4,5,6,nan,\"b\"\n7,8,9,,c\n";
            seeds.push(("a.csv".into(), text.to_vec()));
            seeds.push(("volume_4x4x4_uint8.raw".into(), vec![3; 64]));
        }
        for _ in 0..4 {
            seeds.extend(images());
        }
        for encoding in Ply::ALL {
            for degree in 0..4 {
                let splats = some_splats(3, degree);
                let file = splat_ply(encoding, "comment x\n", &splats, &["uchar flag"]);
                seeds.push(("a.ply".into(), file));
                seeds.push(("a.spz".into(), spz(2 + degree as u32 % 2, 0, &splats)));
                let vertices: &[&str] = &["list uchar int l", "float x", "double y", "short z"];
                let rows = [vec![1.0, 7.0, 0.5, 1.5, 2.0], vec![0.0, 3.5, 4.5, 5.0]];
                let others: &[&str] = &["list uchar int indices"];
                let elements: [Element<'_>; 2] = [
                    ("vertex", vertices, &rows),
                    ("range_grid", others, &[vec![3.0, 0.0, 1.0, 0.0]]),
                ];
                let packed = |bytes: &[u8]| {
                    use ruzstd::encoding::{CompressionLevel, compress_to_vec};
                    compress_to_vec(bytes, CompressionLevel::Fastest)
                };
                let pack: &dyn Fn(&[u8]) -> Vec<u8> = if degree == 1 { &stored } else { &packed };
                seeds.push((
                    "b.spz".into(),
                    spz_streams(0, &some_splats(9, degree), pack),
                ));
                // A record behind the arrays: its type, its length, four bytes.
                let record = [7_u32, 4, 1].map(u32::to_le_bytes).concat();
                let arrays = spz_unpacked(3, 2, &splats);
                seeds.push(("c.spz".into(), [arrays, record].concat()));
                seeds.push(("b.ply".into(), encoding.file("", &elements)));
                seeds.push(("c.ply".into(), mesh_ply(encoding)));
                if degree < 2 {
                    seeds.push(("e.ply".into(), packed_ply(encoding, degree, degree > 0)));
                }
                seeds.push(("d.ply".into(), strips_ply(encoding)));
            }
            for mode in 0..3 {
                let splats = [some_splats(3, 2), some_splats(3, 1)];
                let file = ksplat(mode, &[&splats[0], &splats[1]]);
                seeds.push(("a.ksplat".into(), file));
            }
            seeds.push(("a.splat".into(), splat_records(&some_splats(4, 0))));
            for degree in 0..2 {
                for _ in 0..4 {
                    seeds.push(("a.glb".into(), glb_splats(&some_splats(3, degree))));
                    let stream = spz(2, 0, &some_splats(3, degree));
                    seeds.push(("c.glb".into(), glb_packed(&stream)));
                }
            }
        }
        for name in ["scene.usda", "scene.usdc", "scene.usdz"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/usd").join(name);
            seeds.extend(vec![(name.into(), std::fs::read(path).unwrap()); 12]);
        }
        for degree in 0..3 {
            for version in [1, 2] {
                for packed in [false, true] {
                    let file = sog::archive(version, &some_splats(5, degree), packed);
                    seeds.push(("a.sog".into(), file));
                }
            }
        }
        for _ in 0..4 {
            seeds.push(("a.3mf".into(), threemf::rich()));
        }
        let mut picture = rich_gltf();
        let pixels: Vec<[u8; 4]> = (0..64_u8).map(|i| [4 * i, 255 - i, i, 255]).collect();
        picture.json["images"][0] = serde_json::json!({
            "uri": format!("data:image/webp;base64,{}", STANDARD.encode(sog::webp(8, &pixels))),
        });
        for _ in 0..8 {
            seeds.push(("c.gltf".into(), picture.text()));
        }
        for name in ["gradient_etc1s.ktx2", "gradient_uastc.ktx2"] {
            let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
            let bytes = std::fs::read(fixtures.join(name)).unwrap();
            picture.json["images"][0] = serde_json::json!({
                "uri": format!("data:image/ktx2;base64,{}", STANDARD.encode(bytes)),
            });
            for _ in 0..4 {
                seeds.push(("c.gltf".into(), picture.text()));
            }
        }
        for format in [
            image::ImageFormat::Tga,
            image::ImageFormat::Bmp,
            image::ImageFormat::Gif,
            image::ImageFormat::Tiff,
        ] {
            let numbers = pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
            let drawn = image::RgbImage::from_raw(8, 8, numbers).unwrap();
            let mut bytes = std::io::Cursor::new(Vec::new());
            image::DynamicImage::from(drawn)
                .write_to(&mut bytes, format)
                .unwrap();
            picture.json["images"][0] = serde_json::json!({
                "uri": format!("data:image/x;base64,{}", STANDARD.encode(bytes.into_inner())),
            });
            for _ in 0..4 {
                seeds.push(("c.gltf".into(), picture.text()));
            }
        }
        let mut image = rich_gltf();
        image.json["images"][0] = serde_json::json!({
            "uri": format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg(16, [9, 99, 199]))),
        });
        for name in ["draco", "draco_sequential", "meshopt", "meshopt_khr"] {
            let file = format!("fixtures/packed/{name}.glb");
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
            seeds.extend(vec![("p.glb".into(), std::fs::read(path).unwrap()); 6]);
        }
        for _ in 0..12 {
            seeds.push(("a.glb".into(), rich_gltf().glb()));
            seeds.push(("a.gltf".into(), rich_gltf().text()));
            seeds.push(("b.gltf".into(), image.text()));
            seeds.push(("a.obj".into(), RICH_OBJ.into()));
            seeds.push(("b.obj".into(), concave_obj()));
        }
        seeds
    })
}

/// Files that belong together: any of them may be damaged, and the first is opened.
pub(crate) struct Set {
    pub(crate) files: Vec<(String, Vec<u8>)>,
}

impl Set {
    /// Returns the name to open: that of the first file, or the pattern of numbered images.
    pub(crate) fn opened(&self) -> String {
        self.files[0].0.replace("0001.png", "%04d.png")
    }
}

/// Returns sound file sets of the formats that name other files; each set has a folder of its own.
pub(crate) fn sets() -> Vec<Set> {
    let mut sets = collections();
    sets.extend(simulations());
    let slice = |position, number| Slice {
        position,
        number,
        ..Slice::default()
    };
    for last in ["0\\0\\4", "0\\0\\5"] {
        let slices = [slice("0\\0\\0", 1), slice("0\\0\\2", 2), slice(last, 3)];
        let numbered = slices.iter().enumerate();
        let files = numbered.map(|(i, slice)| (format!("{i}.dcm"), slice.file()));
        sets.push(Set {
            files: files.collect(),
        });
    }
    let image = |shade: u8| super::meshes::png(2, &[[shade, 9, 99, 255]; 6]);
    let layer = |i: u8| (format!("s{i:04}.png"), image(40 * i));
    sets.push(Set {
        files: (1..4).map(layer).collect(),
    });
    sets
}

/// Returns EnSight cases in each form, and netCDF files.
fn simulations() -> Vec<Set> {
    let fixture = |name: &str| {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
        let file = name.rsplit_once('/').map_or(name, |(_, file)| file);
        (file.to_owned(), std::fs::read(path.join(name)).unwrap())
    };
    let case = |form: &str| Set {
        files: ["case", "geo", "flow", "p000", "p005"]
            .map(|ending| fixture(&format!("ensight/{form}.{ending}")))
            .into(),
    };
    let mut sets: Vec<Set> = ["text", "binary", "fortran"].map(case).into();
    let xdmf: [&[&str]; 6] = [
        &["uniform.xmf", "grid.bin", "grid.h5"],
        &["rectilinear.xmf", "grid.bin", "grid.h5"],
        &["curvilinear.xmf", "grid.bin", "grid.h5"],
        &["dolfinx.xdmf", "dolfinx.h5"],
        &["mixed_xml.xdmf"],
        &["quadratic.xdmf"],
    ];
    for names in xdmf {
        let files = names.iter().map(|name| fixture(&format!("xdmf/{name}")));
        sets.push(Set {
            files: files.collect(),
        });
    }
    for name in [
        "sections",
        "mixed",
        "polyhedra",
        "polyhedra_old",
        "parents",
        "structured",
    ] {
        sets.push(Set {
            files: vec![fixture(&format!("cgns/{name}.cgns"))],
        });
    }
    for names in [
        &["chan0.f00002", "chan0.f00001"][..],
        &["chan.nek5000", "chan0.f00001", "chan0.f00002"],
        &["flat0.f00000"],
    ] {
        let files = names.iter().map(|name| fixture(&format!("nek/{name}")));
        sets.push(Set {
            files: files.collect(),
        });
    }
    if cfg!(feature = "netcdf") {
        let names = [
            "blocks.ex2",
            "higher.exo",
            "regular.nc",
            "roms1.nc",
            "roms2.nc",
            "nemo.nc",
            "pressure.nc",
        ];
        sets.extend(names.map(|name| Set {
            files: vec![fixture(&format!("netcdf/{name}"))],
        }));
    }
    sets
}

/// Returns sets of files that name others.
fn collections() -> Vec<Set> {
    let set = |files: &[(&str, &[u8])]| Set {
        files: files
            .iter()
            .map(|(name, bytes)| ((*name).into(), bytes.to_vec()))
            .collect(),
    };
    let collection = b"<VTKFile type=\"Collection\"><Collection>\
        <DataSet timestep=\"0.5\" part=\"0\" file=\"in/a.csv\"/>\
        <DataSet timestep=\"1\" file=\"b.csv\"/></Collection></VTKFile>";
    let blocks =
        b"<VTKFile type=\"vtkMultiBlockDataSet\"><vtkMultiBlockDataSet><Block index=\"0\">\
        <DataSet index=\"0\" file=\"in/a.csv\"/></Block><DataSet index=\"1\" file=\"b.vtm\"/>\
        </vtkMultiBlockDataSet></VTKFile>";
    let partitions = b"<VTKFile type=\"vtkPartitionedDataSet\"><vtkPartitionedDataSet>\
        <DataSet index=\"0\" file=\"b.csv\"/></vtkPartitionedDataSet></VTKFile>";
    let tables: [(&str, &[u8]); 2] = [
        ("in/a.csv", b"x,y,z,m\n0,0,0,1\n1,0,0,1\n"),
        ("b.csv", b"x,y,z,m\n0,0,0,1\n1,1,0,1\n"),
    ];
    let value = |[x, y, z]: [f64; 3], level: usize| x + y * z + level as f64;
    let levels = [false, true].map(|flag| {
        let one = [amr::Level {
            spacing: 8.0,
            boxes: vec![[[0; 3]; 2]],
        }];
        let two = [
            amr::Level {
                spacing: 4.0,
                boxes: vec![[[0; 3], [1; 3]]],
            },
            amr::Level {
                spacing: 2.0,
                boxes: vec![[[0; 3], [1; 3]], [[2, 0, 0], [3, 1, 1]]],
            },
        ];
        let levels: &[amr::Level] = if flag { &one } else { &two };
        [
            amr::plotfile(levels, flag, i64::from(flag), &value),
            amr::vthb(levels, flag, &value),
        ]
    });
    let mut sets = vec![
        set(&[("a.pvd", collection), tables[0], tables[1]]),
        set(&[
            ("a.vtm", blocks),
            tables[0],
            ("b.vtm", partitions),
            tables[1],
        ]),
    ];
    sets.extend(levels.into_iter().flatten().map(|files| Set { files }));
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/split");
    let piece = |name: &str| (name.to_owned(), std::fs::read(folder.join(name)).unwrap());
    let pieces = ["snap_010.1.hdf5", "snap_010.0.hdf5", "snap_010.2.hdf5"];
    sets.push(Set {
        files: pieces.map(piece).into(),
    });
    for text in tecplot::ALL {
        sets.push(set(&[("a.dat", text.as_bytes())]));
    }
    for form in gadget::Form::all() {
        sets.push(Set {
            files: vec![("a.snap".into(), form.snapshot(1, &gadget::SOME))],
        });
        let file = |i: usize| (format!("snap.{i}"), form.snapshot(2, &gadget::HALVES[i]));
        sets.push(Set {
            files: vec![file(1), file(0)],
        });
    }
    for form in openfoam::Form::all() {
        sets.push(Set { files: form.case() });
        sets.push(Set {
            files: form.decomposed(),
        });
    }
    sets
}

/// Returns fixtures of scanners, of image programs and of simulations, written by other programs.
fn clouds_and_stacks() -> Vec<(String, Vec<u8>)> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut seeds = Vec::new();
    for name in [
        "cloud.e57",
        "cloud_0.las",
        "cloud_8.las",
        "cloud_ascii.pcd",
        "cloud_binary.pcd",
        "cloud_packed.pcd",
        "stack_bzip2.nrrd",
        "stack_deflate.tif",
        "stack_imagej.tif",
        "stack_lzw.tif",
        "stack_tiled.tif",
    ] {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        for _ in 0..4 {
            seeds.push((name.to_owned(), bytes.clone()));
        }
    }
    for name in [
        "spheres.lammpstrj",
        "atom.dump",
        "sheared.dump",
        "general.dump",
        "frames.extxyz",
        "plain.xyz",
        "velocities.gro",
        "dodecahedron.gro",
    ] {
        let bytes = std::fs::read(folder.join("atoms").join(name)).unwrap();
        seeds.push((format!("{name}.gz"), gzip(&bytes)));
        for _ in 0..4 {
            seeds.push((name.to_owned(), bytes.clone()));
        }
    }
    for name in [
        "solids22t",
        "solids22b",
        "solids22big",
        "solids40t",
        "solids41t",
        "solids41b",
        "solids41big",
        "second",
    ] {
        let bytes = std::fs::read(folder.join(format!("gmsh/{name}.msh"))).unwrap();
        for _ in 0..2 {
            seeds.push(("a.msh".to_owned(), bytes.clone()));
        }
    }
    for name in ["arepo.hdf5", "swift.hdf5"] {
        let bytes = std::fs::read(folder.join("gas").join(name)).unwrap();
        for _ in 0..2 {
            seeds.push((name.to_owned(), bytes.clone()));
        }
    }
    let text = b"2\n1.5 2 3 -312 128 90 77\n4 5 6 9 1 2 3\n";
    seeds.push(("a.pts".into(), text.to_vec()));
    seeds
}

/// Returns images with headers, with their numbers after them, and STL.
fn images() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    let shorts: Vec<u8> = (0..48).collect();
    for (encoding, body) in [
        (
            "raw\nline skip: 1\nbyte skip: 2",
            [b"x\n12", &shorts[..]].concat(),
        ),
        ("gzip", gzip(&shorts)),
        ("hex", b"0102 0304 ".repeat(12)),
        ("text", b"7 -9\n".repeat(12)),
    ] {
        for axes in [
            "dimension: 3\nsizes: 2 3 4\nspace directions: (1,0,0) (0,.5,.5) (0,-.5,.5)\nspace origin: (1,2,3)",
            "dimension: 4\nsizes: 2 2 3 2\nkinds: vector domain domain domain\nspacings: nan 1 2 3",
            "dimension: 3\nsizes: 6 2 2\nkinds: domain domain time\naxis mins: 0 1 2\naxis maxs: 3 4 5",
        ] {
            let head = format!(
                "NRRD0004\n# x\ntype: short\nendian: big\n{axes}\nencoding: {encoding}\n\n"
            );
            seeds.push(("a.nrrd".into(), [head.as_bytes(), &body].concat()));
        }
    }
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1.5 0\nendloop\nendfacet\nendsolid\n";
    seeds.push(("a.stl".into(), text.into()));
    for (comment, attributes) in [
        (&b"solid facet"[..], 0x801f_u16),
        (b"COLOR=abcd", 0x1234),
        (b"", 0),
    ] {
        let mut binary = comment.to_vec();
        binary.resize(80, 0);
        binary.extend(2_u32.to_le_bytes());
        for corners in [[0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0; 9]] {
            binary.extend([0; 12]);
            binary.extend(corners.iter().flat_map(|x| x.to_le_bytes()));
            binary.extend(attributes.to_le_bytes());
        }
        seeds.push(("a.stl".into(), binary));
    }
    for version in [1, 2] {
        for big_endian in [false, true] {
            let placed = Nifti {
                version,
                big_endian,
                slope: [0.5, 1.0],
                sform: Some([0.0, 0.0, 2.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 3.0, 0.0, 3.0]),
                ..Nifti::new(4, &[2, 3, 4])
            };
            let turned = Nifti {
                qform: Some([0.5, 0.5, 0.5, 1.0, 2.0, 3.0]),
                sform: None,
                ..Nifti::new(2, &[2, 2, 2, 2, 3])
            };
            seeds.push(("a.nii".into(), placed.file(&shorts)));
            seeds.push(("a.nii.gz".into(), gzip(&placed.file(&shorts))));
            seeds.push(("b.nii".into(), turned.file(&shorts)));
        }
    }
    for (fields, body) in [
        (
            "CompressedData = True\nCompressedDataSize = 59",
            zlib(&shorts),
        ),
        (
            "BinaryDataByteOrderMSB = True\nHeaderSize = -1",
            [b"123", &shorts[..]].concat(),
        ),
        ("BinaryData = False", b"7 -9\n".repeat(12)),
    ] {
        for sizes in [
            "NDims = 3\nDimSize = 2 3 4\nTransformMatrix = 1 0 0 0 .6 .8 0 -.8 .6\nOffset = 1 2 3",
            "NDims = 3\nDimSize = 2 3 2\nElementNumberOfChannels = 2\nElementSpacing = 1 2 3",
            "NDims = 4\nDimSize = 2 2 3 2\nPosition = 1 2 3 4",
        ] {
            let head = format!(
                "ObjectType = Image\n{sizes}\n{fields}\nElementType = MET_SHORT\nElementDataFile = LOCAL\n"
            );
            seeds.push(("a.mha".into(), [head.as_bytes(), &body].concat()));
        }
    }
    seeds
}

/// Returns a mesh with all that a PLY file can state of one: colours, normals, texture coordinates
/// of vertices and of faces, two absent textures, a concave polygon.
fn mesh_ply(encoding: Ply) -> Vec<u8> {
    let vertices: &[&str] = &[
        "float x",
        "float y",
        "double z",
        "float nx",
        "float ny",
        "float nz",
        "uchar red",
        "uchar green",
        "uchar blue",
        "uchar alpha",
        "float s",
        "float t",
        "short quality",
    ];
    let places = [[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0], [0.0, 3.0]];
    let rows = places.map(|[x, y]| {
        vec![
            x,
            y,
            0.5,
            0.0,
            0.0,
            1.0,
            250.0,
            100.0,
            7.0,
            128.0,
            x / 3.0,
            y / 3.0,
            9.0,
        ]
    });
    let faces: &[&str] = &[
        "list uchar int vertex_indices",
        "list uchar float texcoord",
        "uchar texnumber",
    ];
    let uv = [0.0, 0.0, 0.5, 0.0, 0.5, 0.5, 0.0, 0.5];
    let polygons = [
        [&[4.0, 0.0, 1.0, 2.0, 3.0, 8.0], &uv[..], &[0.0]].concat(),
        [&[3.0, 0.0, 3.0, 4.0, 6.0], &uv[..6], &[1.0]].concat(),
    ];
    let elements: [Element<'_>; 2] = [("vertex", vertices, &rows), ("face", faces, &polygons)];
    encoding.file(
        "comment TextureFile a.png\ncomment TextureFile b.png\n",
        &elements,
    )
}

/// Returns separate strips of triangles.
fn strips_ply(encoding: Ply) -> Vec<u8> {
    let vertices: &[&str] = &[
        "float x",
        "float y",
        "float z",
        "float red",
        "float green",
        "float blue",
    ];
    let rows: Vec<Vec<f64>> = (0..8)
        .map(|i| vec![f64::from(i / 2), f64::from(i % 2), 1.0, 0.5, 0.25, 0.0])
        .collect();
    let strip = vec![9.0, 0.0, 1.0, 2.0, 3.0, -1.0, 4.0, 5.0, 6.0, 7.0];
    let list: &[&str] = &["list int int vertex_indices"];
    let elements: [Element<'_>; 2] = [("vertex", vertices, &rows), ("tristrips", list, &[strip])];
    encoding.file("", &elements)
}

/// Returns polygons that a fan does not triangulate: a star, and a ring with a cut.
fn concave_obj() -> Vec<u8> {
    let mut text = String::from("g a\n");
    for i in 0..20 {
        let (angle, radius) = (f64::from(i) * 0.314, if i % 2 == 0 { 1.0 } else { 0.4 });
        let [x, y] = [radius * angle.cos(), radius * angle.sin()];
        text.push_str(&format!("v {x:.3} {y:.3} 0.5\nvt {x:.2} {y:.2}\n"));
    }
    text.push_str("usemtl b\nf");
    for i in 1..=20 {
        text.push_str(&format!(" {i}/{i}"));
    }
    text.push_str("\nf 1 5 9 13 17 1 2 18 14 10 6 2\nf -1 -3 -2 -4\n");
    text.into_bytes()
}

/// Returns small legacy VTK files of every kind, in text and binary, in the old and the new style.
pub(crate) fn legacy_vtk() -> Vec<Vec<u8>> {
    let coordinates = super::float32("", 3, &CUBE);
    let values = |vtk: &mut LegacyVtk, cells: i32| {
        vtk.line("POINT_DATA 8");
        vtk.lines("SCALARS s short 1\nLOOKUP_TABLE default");
        vtk.numbers(&super::int16("", 1, &[1, 2, 3, 4, 5, 6, 7, 8]));
        vtk.lines("METADATA\nCOMPONENT_NAMES\ns\n");
        vtk.line("");
        vtk.line("PEDIGREE_IDS id string");
        vtk.texts(&["a", "b", "c", "d", "e", "f", "g", "h"]);
        vtk.line(&format!("CELL_DATA {cells}"));
        let cells = vec![0.25; cells as usize];
        vtk.field(&[super::float64("c", 1, &cells)]);
    };
    let write = |vtk: &mut LegacyVtk, kind: usize| match kind {
        0 => {
            vtk.lines("DATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1");
            values(vtk, 1);
        }
        1 => {
            vtk.lines("DATASET RECTILINEAR_GRID\nDIMENSIONS 2 2 2");
            for axis in ["X", "Y", "Z"] {
                let heading = format!("{axis}_COORDINATES 2");
                vtk.array(&heading, &super::float32("", 1, &[0.0, 1.0]));
            }
            values(vtk, 1);
        }
        2 => {
            vtk.lines("DATASET STRUCTURED_GRID\nDIMENSIONS 2 2 2");
            vtk.array("POINTS 8", &coordinates);
            values(vtk, 1);
        }
        3 => {
            vtk.line("DATASET UNSTRUCTURED_GRID");
            vtk.array("POINTS 8", &coordinates);
            let faces = [4, 3, 0, 1, 2, 3, 0, 1, 3, 3, 0, 2, 3, 3, 1, 2, 3];
            vtk.cells("CELLS", &[&[4, 5, 6, 7], &faces]);
            vtk.line("CELL_TYPES 2");
            vtk.numbers(&super::int32("", 1, &[10, 42]));
            values(vtk, 2);
        }
        _ => {
            vtk.line("DATASET POLYDATA");
            vtk.array("POINTS 8", &coordinates);
            vtk.cells("VERTICES", &[&[0]]);
            vtk.cells("POLYGONS", &[&[0, 1, 2], &[2, 3, 4, 5]]);
            vtk.cells("TRIANGLE_STRIPS", &[&[0, 1, 4, 5]]);
            values(vtk, 4);
        }
    };
    let mut files = Vec::new();
    for (version, binary) in [("3.0", false), ("5.1", false), ("3.0", true), ("5.1", true)] {
        for kind in 0..5 {
            let mut vtk = LegacyVtk::new(version, binary, false);
            write(&mut vtk, kind);
            files.push(vtk.file);
        }
    }
    files
}

/// Returns one file of each other VTK XML format, of two pieces each.
pub(crate) fn vtk_grids(encoding: VtkEncoding) -> Vec<(String, Vec<u8>)> {
    let values = ("PointData", vec![super::uint8("a", 1, &[1; 8])]);
    let points = ("Points", vec![super::float32("Points", 3, &CUBE)]);
    let axis = |name, numbers: &[f64]| super::float64(name, 1, numbers);
    let halves = |geometry: [&(&'static str, Vec<super::VtkArray>); 2]| {
        let mut halves = Vec::new();
        for (extent, geometry) in ["0 1 0 1 0 1", "1 2 0 1 0 1"].into_iter().zip(geometry) {
            halves.push(XmlPiece {
                attributes: format!("Extent=\"{extent}\""),
                elements: vec![values.clone(), geometry.clone()],
            });
        }
        halves
    };
    let coordinates = |x: [f64; 2]| {
        let (y, z) = (axis("y", &[0.0, 1.0]), axis("z", &[5.0, 3.0]));
        ("Coordinates", vec![axis("x", &x), y, z])
    };
    let boxes = halves([&coordinates([0.0, 1.0]), &coordinates([1.0, 4.0])]);
    let blocks = halves([&points, &points]);

    let mut cells = vec![
        super::int32("connectivity", 1, &[0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3]),
        super::int64("offsets", 1, &[8, 12]),
        super::uint8("types", 1, &[12, 42]),
    ];
    let faces = [4, 3, 0, 1, 3, 3, 1, 2, 3, 3, 2, 0, 3, 3, 0, 2, 1];
    let streams = [
        super::int64("faces", 1, &faces),
        super::int64("faceoffsets", 1, &[-1, 17]),
    ];
    let shared = [
        super::int64(
            "face_connectivity",
            1,
            &[0, 1, 3, 1, 2, 3, 2, 0, 3, 0, 2, 1],
        ),
        super::int64("face_offsets", 1, &[3, 6, 9, 12]),
        super::int64("polyhedron_to_faces", 1, &[0, 1, 2, 3]),
        super::int64("polyhedron_offsets", 1, &[0, 4]),
    ];
    let mut solids = Vec::new();
    for faces in [&streams[..], &shared] {
        cells.truncate(3);
        cells.extend_from_slice(faces);
        solids.push(XmlPiece {
            attributes: "NumberOfPoints=\"8\" NumberOfCells=\"2\"".into(),
            elements: vec![values.clone(), points.clone(), ("Cells", cells.clone())],
        });
    }
    let runs = |nodes: &[i32], end| {
        let offsets = super::int32("offsets", 1, &[end]);
        vec![super::int32("connectivity", 1, nodes), offsets]
    };
    let surface = XmlPiece {
        attributes: "NumberOfPoints=\"8\" NumberOfVerts=\"1\" NumberOfPolys=\"1\" \
                     NumberOfStrips=\"1\""
            .into(),
        elements: vec![
            (
                "PointData",
                vec![
                    super::uint8("colours", 3, &[99; 24]),
                    super::float32("Normals", 3, &CUBE),
                ],
            ),
            ("CellData", vec![super::uint8("vtkGhostType", 1, &[0; 3])]),
            points.clone(),
            ("Verts", runs(&[7], 1)),
            ("Polys", runs(&[0, 1, 2, 3], 4)),
            ("Strips", runs(&[0, 1, 4, 5, 7], 5)),
        ],
    };
    let lone = XmlPiece {
        attributes: "NumberOfPoints=\"8\" NumberOfVerts=\"1\" NumberOfLines=\"1\"".into(),
        elements: vec![
            values.clone(),
            points.clone(),
            ("Verts", runs(&[7], 1)),
            ("Lines", runs(&[0, 1, 2, 3], 4)),
        ],
    };
    let whole = "WholeExtent=\"0 2 0 1 0 1\"";
    let file = |name: &str, kind, attributes, pieces: &[XmlPiece]| {
        let bytes = super::vtk_xml(encoding, kind, attributes, pieces);
        (name.to_owned(), bytes)
    };
    vec![
        file("a.vtr", "RectilinearGrid", whole, &boxes),
        file("a.vts", "StructuredGrid", whole, &blocks),
        file("a.vtu", "UnstructuredGrid", "", &solids),
        file("a.vtp", "PolyData", "", &[surface.clone(), surface]),
        file("b.vtp", "PolyData", "", &[lone.clone(), lone]),
    ]
}

/// Returns DICOM files: those of `fixtures/dicom`, and slices without and with a sequence.
fn dicom() -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dicom");
    let names = [
        "baseline",
        "big_endian",
        "deflated",
        "enhanced",
        "lossless",
        "oblique/a",
        "rgb",
        "rle",
    ];
    let mut files: Vec<Vec<u8>> = names
        .iter()
        .map(|name| std::fs::read(folder.join(format!("{name}.dcm"))).unwrap())
        .collect();
    for coding in [Coding::Explicit, Coding::Implicit, Coding::BigEndian] {
        let slice = Slice {
            coding,
            bits: [16, 12, 11],
            padding: Some(3),
            more: vec![(0x0028_1052, "DS", "-1024"), (0x0028_1053, "DS", "0.5")],
            ..Slice::default()
        };
        files.push(slice.file());
    }
    let named = files.into_iter().map(|file| ("a.dcm".to_owned(), file));
    let four_times = named.flat_map(|seed| std::iter::repeat_n(seed, 4));
    four_times.collect()
}
