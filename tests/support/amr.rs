//! Writes levels of refinement as files: AMReX's plotfiles and VTK's XML.

use std::fmt::Write as _;

use super::{VtkEncoding, VtkPiece, float32, vti};

/// Level: the node spacing of its lattice, and the first and the last cell of each box.
pub(crate) struct Level {
    pub(crate) spacing: f64,
    pub(crate) boxes: Vec<[[i64; 3]; 2]>,
}

/// Names and contents of files; the first one names the others.
pub(crate) type Files = Vec<(String, Vec<u8>)>;

fn counts([first, last]: [[i64; 3]; 2]) -> [i64; 3] {
    [0, 1, 2].map(|axis| last[axis] - first[axis] + 1)
}

/// Returns a value for each cell of a box by its centre and its level, x fastest.
fn values(
    level: usize,
    of: &Level,
    ends: [[i64; 3]; 2],
    value: &dyn Fn([f64; 3], usize) -> f64,
) -> Vec<f64> {
    let [nx, ny, nz] = counts(ends);
    let cells = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
    let centre = |ijk: [i64; 3]| {
        [0, 1, 2].map(|axis| (0.5 + (ijk[axis] + ends[0][axis]) as f64) * of.spacing)
    };
    cells.map(|ijk| value(centre(ijk), level)).collect()
}

fn text([first, last]: [[i64; 3]; 2]) -> String {
    let join = |n: [i64; 3]| n.map(|n| n.to_string()).join(",");
    format!("(({}) ({}) (0,0,0))", join(first), join(last))
}

/// Writes a plotfile of one field, in doubles of either byte order, with `ghosts` ghost cells
/// around each box.
pub(crate) fn plotfile(
    levels: &[Level],
    big_endian: bool,
    ghosts: i64,
    value: &dyn Fn([f64; 3], usize) -> f64,
) -> Files {
    let finest = levels.len() - 1;
    let mut header = format!("HyperCLaw-V1.1\n1\nrho\n3\n0.5\n{finest}\n0 0 0\n8 8 8\n");
    header += &"2 ".repeat(finest);
    header += "\n";
    for level in levels {
        #[allow(clippy::cast_possible_truncation, reason = "of a few cells")]
        let last = (8.0 / level.spacing) as i64 - 1;
        header += &text([[0; 3], [last; 3]]);
        header += " ";
    }
    header += &format!("\n{}\n", "0 ".repeat(levels.len()));
    for Level { spacing, .. } in levels {
        writeln!(header, "{spacing} {spacing} {spacing}").unwrap();
    }
    header += "0\n0\n";
    let mut files = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let box_count = level.boxes.len();
        write!(header, "{l} {box_count} 0.5\n0\n").unwrap();
        let mut list = format!("1\n1\n1\n{ghosts}\n({box_count} 0\n");
        let mut data = Vec::new();
        let mut places = String::new();
        for &ends in &level.boxes {
            for (first, last) in ends[0].into_iter().zip(ends[1]) {
                let [a, b] = [first, last + 1].map(|n| n as f64 * level.spacing);
                writeln!(header, "{a} {b}").unwrap();
            }
            writeln!(list, "{}", text(ends)).unwrap();
            writeln!(places, "FabOnDisk: Cell_D_00000 {}", data.len()).unwrap();
            let wide = [ends[0].map(|n| n - ghosts), ends[1].map(|n| n + ghosts)];
            let order = if big_endian {
                "1 2 3 4 5 6 7 8"
            } else {
                "8 7 6 5 4 3 2 1"
            };
            let line = format!(
                "FAB ((8, (64 11 52 0 1 12 0 1023)),(8, ({order}))){} 1\n",
                text(wide)
            );
            data.extend(line.as_bytes());
            for x in values(l, level, wide, value) {
                data.extend(if big_endian {
                    x.to_be_bytes()
                } else {
                    x.to_le_bytes()
                });
            }
        }
        list += &format!(")\n{box_count}\n{places}\n");
        writeln!(header, "Level_{l}/Cell").unwrap();
        files.push((format!("Level_{l}/Cell_H"), list.into_bytes()));
        files.push((format!("Level_{l}/Cell_D_00000"), data));
    }
    files.insert(0, ("Header".to_owned(), header.into_bytes()));
    files
}

/// Writes the same data as VTK's XML: a list, and an image for each box.
pub(crate) fn vthb(
    levels: &[Level],
    is_old: bool,
    value: &dyn Fn([f64; 3], usize) -> f64,
) -> Files {
    let mut list = String::new();
    let mut files = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let spacing = [level.spacing; 3].map(|x| x.to_string()).join(" ");
        if !is_old {
            writeln!(list, "<Block level=\"{l}\" spacing=\"{spacing}\">").unwrap();
        }
        for (i, &ends) in level.boxes.iter().enumerate() {
            let name = format!("in/{l}_{i}.vti");
            let group = if is_old {
                format!("group=\"{l}\"")
            } else {
                String::new()
            };
            let [a, b] = ends;
            let extent = format!("{} {} {} {} {} {}", a[0], b[0], a[1], b[1], a[2], b[2]);
            writeln!(
                list,
                "<DataSet {group} amr_box=\"{extent}\" file=\"{name}\"/>"
            )
            .unwrap();
            let [nx, ny, nz] = counts(ends);
            // The leak is small: a test has few boxes.
            let extent: &'static str = format!("0 {nx} 0 {ny} 0 {nz}").leak();
            let origin = a.map(|n| (n as f64 * level.spacing).to_string()).join(" ");
            #[allow(
                clippy::cast_possible_truncation,
                reason = "fields are single precision"
            )]
            let numbers: Vec<f32> = values(l, level, ends, value)
                .iter()
                .map(|x| *x as f32)
                .collect();
            let piece = VtkPiece {
                extent,
                point_data: vec![],
                cell_data: vec![float32("rho", 1, &numbers)],
            };
            let attributes =
                format!("WholeExtent=\"{extent}\" Origin=\"{origin}\" Spacing=\"{spacing}\"");
            let encoding = VtkEncoding::all().into_iter().next().unwrap();
            files.push((name, vti(encoding, &attributes, &[piece])));
        }
        if !is_old {
            list += "</Block>\n";
        }
    }
    let kind = if is_old {
        "vtkHierarchicalBoxDataSet"
    } else {
        "vtkOverlappingAMR"
    };
    let text = format!("<VTKFile type=\"{kind}\"><{kind}>{list}</{kind}></VTKFile>");
    files.insert(0, ("a.vthb".to_owned(), text.into_bytes()));
    files
}

/// Returns a cube of side 8 with two levels, the finer in two boxes in its middle.
pub(crate) fn nested() -> Vec<Level> {
    vec![
        Level {
            spacing: 1.0,
            boxes: vec![[[0; 3], [3, 7, 7]], [[4, 0, 0], [7; 3]]],
        },
        Level {
            spacing: 0.5,
            boxes: vec![[[4; 3], [7, 11, 11]], [[8, 4, 4], [11; 3]]],
        },
    ]
}
