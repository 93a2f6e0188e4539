//! Generates the data to be timed, once, and keeps them in a folder.
#![allow(
    clippy::cast_possible_truncation,
    reason = "data are made in f64 and kept in what their formats have"
)]

use std::fs::File;
use std::io::{BufWriter, Result, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::ZlibEncoder;

use crate::scenes::uniform;

/// Returns a file of the folder; `write` makes it if it does not exist.
fn made(
    folder: &Path,
    name: &str,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<()>,
) -> Result<PathBuf> {
    let path = folder.join(name);
    if !path.exists() {
        eprintln!("making {}", path.display());
        let part = folder.join(format!("{name}.part"));
        let mut out = BufWriter::new(File::create(&part)?);
        write(&mut out)?;
        out.flush()?;
        std::fs::rename(&part, &path)?;
    }
    Ok(path)
}

/// Writes a table of f32 columns in NumPy's format.
fn table(
    out: &mut impl Write,
    columns: &[&str],
    count: usize,
    mut row: impl FnMut(&mut Vec<f32>),
) -> Result<()> {
    let descr: Vec<String> = columns.iter().map(|c| format!("('{c}', '<f4')")).collect();
    let header = format!(
        "{{'descr': [{}], 'fortran_order': False, 'shape': ({count},), }}",
        descr.join(", ")
    );
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    out.write_all(b"\x93NUMPY\x01\x00")?;
    let length = u16::try_from(padded).expect("a short header");
    out.write_all(&length.to_le_bytes())?;
    writeln!(out, "{header:<width$}", width = padded - 1)?;
    let mut values = Vec::new();
    for _ in 0..count {
        values.clear();
        row(&mut values);
        assert_eq!(values.len(), columns.len());
        for value in &values {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(())
}

pub(crate) fn sph(folder: &Path) -> Result<PathBuf> {
    made(folder, "sph.npy", |out| write_sph(out, 1_000_000))
}

/// Writes particles with a smoothing length, clustered: half of them in thirty blobs.
pub(crate) fn write_sph(out: &mut impl Write, count: usize) -> Result<()> {
    let mut random = uniform(2);
    let blobs: Vec<[f32; 4]> = (0..30)
        .map(|_| [random(), random(), random(), 0.02 + 0.08 * random()])
        .collect();
    let mut row = 0;
    // The number of neighbours within a length does not depend on the number of particles: .012 for a million.
    let length = 1.2 / (count as f32).cbrt();
    table(out, &["x", "y", "z", "h", "mass", "rho"], count, |out| {
        let blob = blobs[row % blobs.len()];
        let at = if row % 2 == 0 {
            [random(), random(), random()]
        } else {
            // A sum of twelve uniform numbers is nearly normal.
            let mut normal = || (0..12).map(|_| random()).sum::<f32>() - 6.0;
            [0, 1, 2].map(|k| blob[k] + blob[3] * normal())
        };
        row += 1;
        let rho: f32 = 1.0
            + blobs
                .iter()
                .map(|b| {
                    let d2: f32 = (0..3).map(|k| (at[k] - b[k]).powi(2)).sum();
                    0.002 / b[3].powi(3) * (-0.5 * d2 / (b[3] * b[3])).exp()
                })
                .sum::<f32>();
        out.extend(at);
        out.extend([length * rho.powf(-1.0 / 3.0), 1.0 / count as f32, rho]);
    })
}

/// Writes ellipsoids with variances, masses and colours.
fn write_ellipsoids(out: &mut impl Write, count: usize, sigma: f32) -> Result<()> {
    let mut random = uniform(3);
    let columns = [
        "x", "y", "z", "vxx", "vxy", "vxz", "vyy", "vyz", "vzz", "mass", "r", "g", "b",
    ];
    table(out, &columns, count, |out| {
        let mut within = |a: f32, b: f32| a + (b - a) * random();
        out.extend([within(-1.0, 1.0), within(-1.0, 1.0), within(-1.0, 1.0)]);
        // L L^T of a lower triangle.
        let [a, c, f] = [(); 3].map(|()| sigma * within(0.5, 1.5));
        let [b, d, e] = [(); 3].map(|()| sigma * within(-0.5, 0.5));
        out.extend([
            a * a,
            a * b,
            a * d,
            b * b + c * c,
            b * d + c * e,
            d * d + e * e + f * f,
        ]);
        out.push(within(0.0, 0.02) / count as f32);
        out.extend([within(0.0, 1.0), within(0.0, 1.0), within(0.0, 1.0)]);
    })
}

pub(crate) fn ellipsoids(folder: &Path) -> Result<PathBuf> {
    made(folder, "ellipsoids.npy", |out| {
        write_ellipsoids(out, 1_000_000, 0.004)
    })
}

pub(crate) fn few_ellipsoids(folder: &Path) -> Result<PathBuf> {
    made(folder, "few_ellipsoids.npy", |out| {
        write_ellipsoids(out, 100_000, 0.02)
    })
}

pub(crate) fn spheres(folder: &Path) -> Result<PathBuf> {
    let mut random = uniform(4);
    made(folder, "spheres.npy", |out| {
        let columns = ["x", "y", "z", "sigma", "mass"];
        table(out, &columns, 20_000_000, |out| {
            out.extend([
                random(),
                random(),
                random(),
                0.001 + 0.001 * random(),
                2e-8 * random(),
            ]);
        })
    })
}

/// Evaluates a smooth field of six blobs, 0 to about 1.
fn field(at: [f64; 3]) -> f32 {
    const BLOBS: [[f64; 5]; 6] = [
        [0.25, 0.3, 0.3, 0.14, 0.9],
        [0.7, 0.3, 0.4, 0.11, 0.7],
        [0.5, 0.7, 0.3, 0.17, 0.8],
        [0.3, 0.6, 0.7, 0.12, 1.0],
        [0.7, 0.7, 0.7, 0.15, 0.6],
        [0.5, 0.4, 0.8, 0.1, 0.8],
    ];
    let sum: f64 = BLOBS
        .iter()
        .map(|b| {
            let d2: f64 = (0..3).map(|k| (at[k] - b[k]).powi(2)).sum();
            b[4] * (-0.5 * d2 / (b[3] * b[3])).exp()
        })
        .sum();
    sum as f32
}

/// Encodes an array of a VTK file, without base64: blocks of 32 KiB, compressed by zlib.
fn compressed(bytes: &[u8]) -> Result<Vec<u8>> {
    const BLOCK: usize = 1 << 15;
    let blocks: Vec<Vec<u8>> = bytes
        .chunks(BLOCK)
        .map(|block| {
            let mut out = ZlibEncoder::new(Vec::new(), Compression::fast());
            out.write_all(block)?;
            out.finish()
        })
        .collect::<Result<_>>()?;
    let sizes = [blocks.len(), BLOCK, bytes.len() % BLOCK]
        .into_iter()
        .chain(blocks.iter().map(Vec::len));
    let mut out: Vec<u8> = sizes.flat_map(|n| (n as u32).to_le_bytes()).collect();
    out.extend(blocks.concat());
    Ok(out)
}

/// Writes a VTK XML file with compressed, appended arrays; `body` has `{}` in place of each offset.
fn vtk(out: &mut impl Write, kind: &str, body: &str, arrays: &[Vec<u8>]) -> Result<()> {
    let arrays: Vec<Vec<u8>> = arrays
        .iter()
        .map(|a| compressed(a))
        .collect::<Result<_>>()?;
    let mut body = body.to_owned();
    let mut offset = 0;
    for array in &arrays {
        body = body.replacen("{}", &offset.to_string(), 1);
        offset += array.len();
    }
    write!(
        out,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"{kind}\" version=\"0.1\" byte_order=\"LittleEndian\" \
         header_type=\"UInt32\" compressor=\"vtkZLibDataCompressor\">\n{body}\n\
         <AppendedData encoding=\"raw\">\n_"
    )?;
    out.write_all(&arrays.concat())?;
    writeln!(out, "\n</AppendedData>\n</VTKFile>")
}

fn bytes<const N: usize>(values: impl IntoIterator<Item = [u8; N]>) -> Vec<u8> {
    values.into_iter().flatten().collect()
}

pub(crate) fn curvilinear(folder: &Path) -> Result<PathBuf> {
    made(folder, "sector.vts", |out| write_curvilinear(out, 128))
}

/// Writes a sector of a ring, bent and stretched, with `nodes` nodes along each axis.
pub(crate) fn write_curvilinear(out: &mut impl Write, nodes: usize) -> Result<()> {
    let (mut points, mut values) = (Vec::new(), Vec::new());
    for k in 0..nodes {
        for j in 0..nodes {
            for i in 0..nodes {
                let [u, v, w] = [i, j, k].map(|n| n as f64 / (nodes - 1) as f64);
                let radius = 1.0 + u * u;
                let (sine, cosine) = (2.0 * v).sin_cos();
                let at = [radius * cosine, radius * sine, w + 0.1 * (3.0 * u).sin()];
                points.extend(at.map(|x| (x as f32).to_le_bytes()));
                values.push(field([u, v, w]).to_le_bytes());
            }
        }
    }
    let e = format!("0 {0} 0 {0} 0 {0}", nodes - 1);
    let body = format!(
        "<StructuredGrid WholeExtent=\"{e}\"><Piece Extent=\"{e}\">\
         <PointData Scalars=\"f\"><DataArray type=\"Float32\" Name=\"f\" format=\"appended\" offset=\"{{}}\"/></PointData>\
         <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"appended\" offset=\"{{}}\"/></Points>\
         </Piece></StructuredGrid>"
    );
    vtk(
        out,
        "StructuredGrid",
        &body,
        &[bytes(values), bytes(points)],
    )
}

pub(crate) fn tetrahedra(folder: &Path) -> Result<PathBuf> {
    made(folder, "tetrahedra.vtu", |out| write_tetrahedra(out, 54))
}

/// Writes tetrahedra: cubes with jittered corners, `cubes` along each axis, six tetrahedra each.
pub(crate) fn write_tetrahedra(out: &mut impl Write, cubes: usize) -> Result<()> {
    let mut random = uniform(5);
    let (mut points, mut values) = (Vec::new(), Vec::new());
    for k in 0..=cubes {
        for j in 0..=cubes {
            for i in 0..=cubes {
                let at = [i, j, k].map(|n| {
                    let inner = n > 0 && n < cubes;
                    let jitter = if inner {
                        0.5 * f64::from(random() - 0.5)
                    } else {
                        0.0
                    };
                    (n as f64 + jitter) / cubes as f64
                });
                points.extend(at.map(|x| (x as f32).to_le_bytes()));
                values.push(field(at).to_le_bytes());
            }
        }
    }
    let mut cells = Vec::new();
    for k in 0..cubes {
        for j in 0..cubes {
            for i in 0..cubes {
                // From corner to corner along the axes, in each order.
                for order in [
                    [0, 1, 2],
                    [0, 2, 1],
                    [1, 0, 2],
                    [1, 2, 0],
                    [2, 0, 1],
                    [2, 1, 0],
                ] {
                    let mut at = [i, j, k];
                    for step in [None, Some(order[0]), Some(order[1]), Some(order[2])] {
                        if let Some(axis) = step {
                            at[axis] += 1;
                        }
                        let node = at[0] + (cubes + 1) * (at[1] + (cubes + 1) * at[2]);
                        cells.push((node as i32).to_le_bytes());
                    }
                }
            }
        }
    }
    let count = cells.len() / 4;
    let body = format!(
        "<UnstructuredGrid><Piece NumberOfPoints=\"{}\" NumberOfCells=\"{count}\">\
         <PointData Scalars=\"f\"><DataArray type=\"Float32\" Name=\"f\" format=\"appended\" offset=\"{{}}\"/></PointData>\
         <Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"appended\" offset=\"{{}}\"/></Points>\
         <Cells><DataArray type=\"Int32\" Name=\"connectivity\" format=\"appended\" offset=\"{{}}\"/>\
         <DataArray type=\"Int32\" Name=\"offsets\" format=\"appended\" offset=\"{{}}\"/>\
         <DataArray type=\"UInt8\" Name=\"types\" format=\"appended\" offset=\"{{}}\"/></Cells>\
         </Piece></UnstructuredGrid>",
        values.len()
    );
    let ends = (1..=count).map(|n| (4 * n as i32).to_le_bytes());
    let arrays = [
        bytes(values),
        bytes(points),
        bytes(cells),
        bytes(ends),
        vec![10; count],
    ];
    vtk(out, "UnstructuredGrid", &body, &arrays)
}

/// Makes a box of side 2 with one texture of 512 x 512 on each face.
pub(crate) fn textured_box(folder: &Path) -> Result<PathBuf> {
    const SIDE: u32 = 512;
    made(folder, "box.png", |out| {
        let mut random = uniform(6);
        let mut texels = Vec::new();
        for y in 0..SIDE {
            for x in 0..SIDE {
                let check = 80.0 + 120.0 * ((x / 32 + y / 32) % 2) as f32;
                texels.extend(
                    [check, 0.5 * check, 200.0 - check].map(|c| (c + 40.0 * random()) as u8),
                );
            }
        }
        let mut encoder = png::Encoder::new(out, SIDE, SIDE);
        encoder.set_color(png::ColorType::Rgb);
        Ok(encoder.write_header()?.write_image_data(&texels)?)
    })?;
    made(folder, "box.mtl", |out| {
        writeln!(out, "newmtl face\nKd 1 1 1\nmap_Kd box.png")
    })?;
    made(folder, "box.obj", |out| {
        writeln!(out, "mtllib box.mtl\nusemtl face")?;
        for corner in 0..8 {
            let at = [0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { -1 } else { 1 });
            writeln!(out, "v {} {} {}", at[0], at[1], at[2])?;
        }
        writeln!(out, "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1")?;
        for face in [
            [1, 3, 4, 2],
            [5, 6, 8, 7],
            [1, 2, 6, 5],
            [3, 7, 8, 4],
            [1, 5, 7, 3],
            [2, 4, 8, 6],
        ] {
            writeln!(
                out,
                "f {}/1 {}/2 {}/3 {}/4",
                face[0], face[1], face[2], face[3]
            )?;
        }
        Ok(())
    })
}

/// Returns a small file of particles in the repository.
pub(crate) fn small(_: &Path) -> Result<PathBuf> {
    Ok(Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/particles.csv"))
}

pub(crate) fn lattice(folder: &Path) -> Result<PathBuf> {
    made(folder, "lattice.raw", |out| write_lattice(out, 256))
}

/// Writes a lattice of bytes, `side` along each axis.
pub(crate) fn write_lattice(out: &mut impl Write, side: usize) -> Result<()> {
    for k in 0..side {
        for j in 0..side {
            for i in 0..side {
                let at = [i, j, k].map(|n| n as f64 / (side - 1) as f64);
                out.write_all(&[(200.0 * field(at)).min(255.0) as u8])?;
            }
        }
    }
    Ok(())
}

/// Writes a transfer function that shows a third of [`lattice`].
pub(crate) fn transfer_function(folder: &Path) -> Result<()> {
    let json = r#"{"range": [0, 255], "unit_distance": 4, "points": [
  {"value": 0, "color": [0, 0, 0.5], "opacity": 0}, {"value": 28, "color": [0, 0.2, 0.5], "opacity": 0},
  {"value": 120, "color": [0.2, 0.8, 0.6], "opacity": 0.15}, {"value": 255, "color": [1, 0.9, 0.3], "opacity": 0.5}]}"#;
    std::fs::write(folder.join("third.json"), json)
}
