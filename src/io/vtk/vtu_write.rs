//! Writes splats as a VTK unstructured grid of vertices (`.vtu`), for ParaView and other readers of VTK.
//!
//! | array of the points | content |
//! |---|---|
//! | `shape`, 9 numbers | R diag(s) Rᵀ, the standard deviations: a tensor glyph scaled by eigenvalues draws the splat at one sigma |
//! | `scale_0..2`, `rot_0..3` | standard deviations, and the quaternion w, x, y, z, as in tables of particles |
//! | `opacity` | peak opacity |
//! | `rgb`, bytes | the constant colour, sRGB-encoded |
//!
//! Everything is appended raw, little-endian, with lengths of 64 bits. Harmonics beyond the constant are not
//! written.

use std::fmt::Write;

use glam::{DMat3, DQuat, DVec3};

use crate::data::splats::SplatCloud;
use crate::io::splats::encoded_splats::{
    Encoded, byte, note_cut, note_harmonics_lost, note_mark_lost,
};
use crate::math::{HARMONIC_0, narrowed};

/// VTK's number of a vertex.
const VERTEX: u8 = 1;

pub(in crate::io) fn encode(cloud: &SplatCloud) -> Encoded {
    let count = cloud.positions.len();
    let mut file = Arrays::default();
    let mut cut_colours = 0;

    let shapes = (0..count).flat_map(|i| {
        let [w, x, y, z] = cloud.unit_rotation(i);
        let turn = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let scales = DVec3::from(cloud.thick_scales(i).map(f64::from));
        let shape = turn * DMat3::from_diagonal(scales) * turn.transpose();
        shape.to_cols_array().map(narrowed).map(f32::to_le_bytes)
    });
    let shapes: Vec<u8> = shapes.flatten().collect();
    file.push("Float32", "shape", 9, &shapes);
    for axis in 0..3 {
        let column = (0..count).flat_map(|i| cloud.thick_scales(i)[axis].to_le_bytes());
        file.push(
            "Float32",
            &format!("scale_{axis}"),
            1,
            &column.collect::<Vec<u8>>(),
        );
    }
    for part in 0..4 {
        let column = (0..count).flat_map(|i| narrowed(cloud.unit_rotation(i)[part]).to_le_bytes());
        file.push(
            "Float32",
            &format!("rot_{part}"),
            1,
            &column.collect::<Vec<u8>>(),
        );
    }
    let opacities = cloud.opacities.iter().flat_map(|a| a.to_le_bytes());
    file.push("Float32", "opacity", 1, &opacities.collect::<Vec<u8>>());
    let mut colours = Vec::with_capacity(3 * count);
    for i in 0..count {
        let code = |c: &f32| 255.0 * (0.5 + f64::from(HARMONIC_0) * f64::from(*c));
        let constant = cloud.coefficients(i)[..3].iter().map(code);
        colours.extend(constant.map(|code| byte(code, &mut cut_colours)));
    }
    file.push("UInt8", "rgb", 3, &colours);
    let point_data = std::mem::take(&mut file.elements);

    let positions = cloud.positions.iter().flat_map(|p| p.to_array());
    let positions: Vec<u8> = positions.flat_map(f64::to_le_bytes).collect();
    file.push("Float64", "Points", 3, &positions);
    let points = std::mem::take(&mut file.elements);

    let numbers = |from: u64| {
        (from..)
            .take(count)
            .flat_map(u64::to_le_bytes)
            .collect::<Vec<u8>>()
    };
    file.push("Int64", "connectivity", 1, &numbers(0));
    file.push("Int64", "offsets", 1, &numbers(1));
    file.push("UInt8", "types", 1, &vec![VERTEX; count]);
    let cells = std::mem::take(&mut file.elements);

    let head = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"{count}\" NumberOfCells=\"{count}\">\n\
         <PointData>\n{point_data}</PointData>\n<Points>\n{points}</Points>\n<Cells>\n{cells}</Cells>\n</Piece>\n\
         </UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_"
    );
    let mut bytes = head.into_bytes();
    bytes.append(&mut file.appended);
    bytes.extend(b"\n</AppendedData>\n</VTKFile>\n");

    let mut notes = Vec::new();
    note_harmonics_lost(&mut notes, cloud);
    note_mark_lost(&mut notes, cloud);
    note_cut(
        &mut notes,
        cut_colours,
        "colour channels outside 0 to 1 are cut",
    );
    Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum: f64::MIN_POSITIVE,
        order: Vec::new(),
        notes,
    }
}

/// Arrays of a file: the elements that describe them, and their bytes, each after its length.
#[derive(Default)]
struct Arrays {
    elements: String,
    appended: Vec<u8>,
}

impl Arrays {
    fn push(&mut self, kind: &str, name: &str, components: usize, bytes: &[u8]) {
        let offset = self.appended.len();
        // Writing to a string does not fail.
        let _ = writeln!(
            self.elements,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
             offset=\"{offset}\"/>"
        );
        self.appended.extend((bytes.len() as u64).to_le_bytes());
        self.appended.extend(bytes);
    }
}
