//! Tests XDMF files: they give what VTK's reader gives of the same files, and what meshio and h5py were given.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};

use ewa_splat::io::{CellMesh, Dataset, Geometry, OpenOptions, format_of, read, read_with};

use crate::support::{at_step, cells, numbers};

fn path(name: &str) -> PathBuf {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    fixtures.join("xdmf").join(name)
}

fn fixture(name: &str, time_step: Option<usize>) -> Dataset {
    at_step(&path(name), time_step)
}

fn times(name: &str) -> Vec<Option<f64>> {
    let format = format_of(&path(name), &OpenOptions::default()).unwrap();
    let steps = format.time_steps(&path(name)).unwrap();
    steps.iter().map(|step| step.time).collect()
}

/// The field that the files of twelve nodes have.
fn linear(mesh: &CellMesh) -> Vec<f32> {
    let value = |p: &glam::DVec3| (p.x + 2.0 * p.y + 4.0 * p.z) as f32;
    mesh.nodes.iter().map(value).collect()
}

#[test]
fn all_forms_of_numbers_say_the_same() {
    for form in ["xml", "hdf", "binary"] {
        let data = fixture(&format!("mixed_{form}.xdmf"), None);
        let mesh = cells(&data);
        let kinds: Vec<u8> = mesh.kinds.iter().map(|kind| kind.0).collect();
        assert_eq!(kinds, [12, 14, 13, 10], "{form}");
        assert_eq!(mesh.cell(2), [1, 9, 2, 5, 10, 6], "{form}");
        assert_eq!(mesh.nodes[8].to_array(), [0.5, 0.5, 1.75], "{form}");
        let expected = linear(mesh);
        assert_eq!(numbers(&data, "T"), expected, "{form}");
        let second: Vec<f32> = expected.iter().map(|x| x + 2.0).collect();
        assert_eq!(numbers(&data, "v:2"), second, "{form}");
        assert_eq!(numbers(&data, "k"), [5.0, 6.0, 7.0, 8.0], "{form}");
    }
}

#[test]
fn functions_of_a_mesh_are_fields_of_one_grid_at_each_time() {
    assert_eq!(times("dolfinx.xdmf"), [Some(0.0), Some(0.5)]);
    for (step, i) in [(0, 0.0), (1, 1.0)] {
        let data = fixture("dolfinx.xdmf", Some(step));
        let mesh = cells(&data);
        assert_eq!((mesh.nodes.len(), mesh.cell_count()), (12, 2));
        let expected = linear(mesh);
        let of = |f: &dyn Fn(f32) -> f32| expected.iter().map(|x| f(*x)).collect::<Vec<f32>>();
        assert_eq!(data.field_names(), ["u", "p"]);
        assert_eq!(numbers(&data, "u:1"), of(&|x| x + 10.0 * i));
        assert_eq!(numbers(&data, "u:2"), of(&|x| -x));
        assert_eq!(numbers(&data, "p"), of(&|x| 100.0 * x + i));
    }
    assert_eq!(times("series.xdmf"), [Some(0.25), Some(1.5)]);
    let data = fixture("series.xdmf", Some(1));
    assert_eq!(numbers(&data, "c"), [1.5, 3.0]);
    assert_eq!(numbers(&data, "T")[11], 1.5 * 7.5);
    let notes = fixture("series.xdmf", None).notes.join(" ");
    assert!(
        notes.contains("The first of 2 time steps, of time 0.25"),
        "{notes}"
    );
}

/// Dimensions, origins and steps name the slowest axis first, and coordinates of axes the fastest.
#[test]
fn structured_grids_are_those_of_vtk() {
    let data = fixture("uniform.xmf", None);
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!("no lattice")
    };
    assert_eq!(lattice.dims, [4, 3, 2]);
    assert_eq!(lattice.position([1, 1, 1]).to_array(), [11.0, 22.0, 33.0]);
    let data = fixture("rectilinear.xmf", None);
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!("no lattice")
    };
    assert_eq!(lattice.position([3, 2, 1]).to_array(), [7.0, 5.0, 1.0]);
    let data = fixture("curvilinear.xmf", None);
    let Geometry::Curvilinear { blocks } = &data.geometry else {
        panic!("no curvilinear grid")
    };
    assert_eq!(blocks[0].dims, [4, 3, 2]);
    assert_eq!(blocks[0].nodes[23].to_array(), [3.2, 2.2, 1.15]);
    for name in ["uniform.xmf", "rectilinear.xmf", "curvilinear.xmf"] {
        let data = fixture(name, None);
        let count: Vec<f32> = (0..24_u8).map(f32::from).collect();
        assert_eq!(numbers(&data, "a"), count, "{name}");
        // A part of a dataset: every other number of the last of its four dimensions.
        let odd: Vec<f32> = (0..24_u8).map(|i| f32::from(49 + 2 * i)).collect();
        assert_eq!(numbers(&data, "second"), odd, "{name}");
        assert_eq!(
            numbers(&data, "c"),
            [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            "{name}"
        );
        assert_eq!(
            numbers(&data, "j:2"),
            [0.5, 1.0, 1.5, 2.0, 2.5, 3.0],
            "{name}"
        );
    }
}

/// Each grid of the file is one of VTK's quadratic cells in its own coordinates.
#[test]
fn quadratic_elements_have_their_nodes_in_the_order_of_vtk() {
    let data = fixture("quadratic.xdmf", None);
    assert_eq!(times("quadratic.xdmf"), [Some(2.5)]);
    let mesh = cells(&data);
    let kinds: Vec<(u8, usize)> = (0..mesh.cell_count())
        .map(|i| (mesh.kinds[i].0, mesh.cell(i).len()))
        .collect();
    let expected = [
        (24, 10),
        (25, 20),
        (33, 24),
        (29, 27),
        (26, 15),
        (32, 18),
        (27, 13),
    ];
    assert_eq!(kinds, expected);
    let along: Vec<f32> = mesh.nodes.iter().map(|p| p.x as f32).collect();
    assert_eq!(numbers(&data, "x"), along);
}

fn of_text(text: &str) -> ewa_splat::Result<Dataset> {
    read("a.xmf", text.as_bytes(), &OpenOptions::default())
}

#[test]
fn files_may_end_anywhere_and_companions_too() {
    for (name, companion) in [
        ("mixed_xml.xdmf", None),
        ("uniform.xmf", Some("grid.h5")),
        ("uniform.xmf", Some("grid.bin")),
        ("dolfinx.xdmf", Some("dolfinx.h5")),
    ] {
        let whole = std::fs::read(path(name)).unwrap();
        let options = OpenOptions::default();
        let sound = |file: &Path| std::fs::read(path(file.to_str().unwrap())).ok();
        assert!(read_with(name, &whole, &options, &sound).is_ok(), "{name}");
        let is_one_line = |data: ewa_splat::Result<Dataset>| match data {
            Ok(_) => panic!("{name} is read"),
            Err(error) => assert!(!error.to_string().trim_end().contains('\n'), "{error}"),
        };
        for len in 1..whole.trim_ascii_end().len() {
            is_one_line(read_with(name, &whole[..len], &options, &sound));
        }
        let Some(companion) = companion else { continue };
        let own = std::fs::read(path(companion)).unwrap();
        for len in (0..own.len()).step_by(7) {
            let cut = |file: &Path| match file.to_str() == Some(companion) {
                true => Some(own[..len].to_vec()),
                false => sound(file),
            };
            // The end of an HDF5 file may be unused.
            match read_with(name, &whole, &options, &cut) {
                Ok(_) if companion.ends_with(".h5") => {}
                other => is_one_line(other),
            }
        }
    }
}

#[test]
fn points_and_surfaces_are_what_others_make_of_them() {
    let grid = |topology: &str, attributes: &str| {
        let text = format!(
            "<Xdmf><Domain><Grid>{topology}<Geometry GeometryType=\"XY\"><DataItem Dimensions=\"4 2\">0 0 1 0 1 1 0 1\
             </DataItem></Geometry>{attributes}</Grid></Domain></Xdmf>"
        );
        of_text(&text)
    };
    let mass = "<Attribute Name=\"m\" AttributeType=\"Scalar\" Center=\"Cell\"><DataItem Dimensions=\"4\">1 2 3 4</DataItem></Attribute>";
    let points = "<Topology TopologyType=\"Polyvertex\" NumberOfElements=\"4\"/>";
    let data = grid(points, mass).unwrap();
    assert!(matches!(&data.geometry, Geometry::Points { positions } if positions.len() == 4));
    assert_eq!(numbers(&data, "m"), [1.0, 2.0, 3.0, 4.0]);
    let quad = "<Topology TopologyType=\"Quadrilateral\" NumberOfElements=\"1\" BaseOffset=\"1\">\
                <DataItem Dimensions=\"1 4\" NumberType=\"Int\">1 2 3 4</DataItem></Topology>";
    let data = grid(quad, "").unwrap();
    assert!(matches!(&data.geometry, Geometry::Mesh(mesh) if mesh.parts[0].triangles.len() == 2));
    for (from, to, says) in [
        ("1 2 3 4", "1 2 3 5", "nodes among 4"),
        ("1 2 3 4", "1 2 3", "as many numbers"),
        ("Quadrilateral", "Quadrangle", "`Quadrangle`"),
        ("\"Int\"", "\"Int\" Format=\"HDF\"", "FILE:/PATH"),
        ("\"Int\"", "\"Int\" Format=\"JPEG\"", "XML, HDF or Binary"),
        (
            "\"Int\">1 2",
            "\"Int\" ItemType=\"Tree\">1 2",
            "HyperSlab or Function",
        ),
    ] {
        let error = grid(&quad.replacen(from, to, 1), "")
            .unwrap_err()
            .to_string();
        assert!(error.contains(says), "{to}: {error}");
    }
    let error = grid(quad, mass).unwrap_err().to_string();
    assert!(
        error.contains("a number for each of 1 cells") && error.contains("4 numbers"),
        "{error}"
    );
    for outside in ["../a.h5:/a", "/etc/a.h5:/a"] {
        let quad = quad.replace(
            "\"Int\">1 2 3 4",
            &format!("\"Int\" Format=\"HDF\">{outside}"),
        );
        let error = grid(&quad, "").unwrap_err().to_string();
        assert!(error.contains("beside this file"), "{error}");
    }
}

/// References in a circle, and entities that grow, end in an error.
#[test]
fn references_end() {
    for text in [
        "<Xdmf><Domain><Grid Reference=\"/Xdmf/Domain/Grid\"/></Domain></Xdmf>",
        "<Xdmf><Domain><Grid Reference=\"Grid\"/></Domain></Xdmf>",
        "<Xdmf xmlns:xi=\"a\"><Domain><Grid><xi:include xpointer=\"xpointer(/Xdmf/Domain/Grid[)\"/></Grid></Domain></Xdmf>",
        "<Xdmf xmlns:xi=\"a\"><Domain><Grid><xi:include href=\"b.xmf\" xpointer=\"xpointer(/Xdmf)\"/></Grid></Domain></Xdmf>",
        "<!DOCTYPE Xdmf [<!ENTITY a \"&b;&b;\"><!ENTITY b \"&a;&a;\">]><Xdmf><Domain>&a;</Domain></Xdmf>",
        "<Xdmf><Domain/></Xdmf>",
        "<Xdmf/>",
        "<a/>",
    ] {
        let error = of_text(text).unwrap_err().to_string();
        assert!(error.contains("expected"), "{error}");
    }
}

/// A file of these grids.
fn of_grids(grids: &str) -> String {
    format!(r#"<?xml version="1.0"?><Xdmf Version="3.0"><Domain>{grids}</Domain></Xdmf>"#)
}

/// A uniform grid of four nodes at a time, with cells as numbers of a mixed topology.
fn grid_at(time: f64, cells: &str) -> String {
    let item = |dims: &str, text: &str| {
        format!(r#"<DataItem Dimensions="{dims}" Format="XML">{text}</DataItem>"#)
    };
    let nodes = item("4 3", "0 0 0 1 0 0 0 1 0 0 0 1");
    let (cells, values) = (
        item(&cells.split(' ').count().to_string(), cells),
        item("4", "0 1 2 3"),
    );
    format!(
        r#"<Grid Name="b"><Time Value="{time}"/><Topology TopologyType="Mixed">{cells}</Topology>
        <Geometry GeometryType="XYZ">{nodes}</Geometry><Attribute Name="f" Center="Node">{values}</Attribute></Grid>"#
    )
}

#[test]
fn collections_have_the_times_of_their_blocks() {
    let tetrahedron = "6 0 1 2 3";
    let folder = tempfile::tempdir().unwrap();
    let times = |text: String| -> Vec<Option<f64>> {
        let path = folder.path().join("a.xdmf");
        std::fs::write(&path, text).unwrap();
        let format = format_of(&path, &OpenOptions::default()).unwrap();
        let steps = format.time_steps(&path).unwrap();
        steps.iter().map(|step| step.time).collect()
    };
    let block = |time| {
        format!(
            r#"<Grid GridType="Collection">{}</Grid>"#,
            grid_at(time, tetrahedron)
        )
    };
    let both = block(0.5) + &block(2.5);
    let nested = format!(r#"<Grid GridType="Collection" CollectionType="Temporal">{both}</Grid>"#);
    assert_eq!(times(of_grids(&nested)), [Some(0.5), Some(2.5)]);
    // A type of collection makes a grid one.
    let short = format!(r#"<Grid CollectionType="Temporal">{both}</Grid>"#);
    assert_eq!(times(of_grids(&short)), [Some(0.5), Some(2.5)]);
    // More steps than a document of the usual length has nodes for.
    let steps: String = (0..4000)
        .map(|i| grid_at(f64::from(i), tetrahedron))
        .collect();
    let many = format!(r#"<Grid GridType="Collection" CollectionType="Temporal">{steps}</Grid>"#);
    assert_eq!(times(of_grids(&many)).len(), 4000);
}

#[test]
fn faces_of_cells_are_left_out_with_a_note() {
    let data = of_text(&of_grids(&grid_at(0.0, "6 0 1 2 3 4 0 1 2"))).unwrap();
    assert_eq!(cells(&data).cell_count(), 1);
    let notes = data.notes.join(" ");
    assert!(notes.contains("1 pieces of surfaces"), "{notes}");
}

#[test]
fn short_numbers_and_commas_are_read() {
    let side = 96;
    let count = side * side * side;
    let numbers = "1 ".repeat(count);
    let text = of_grids(&format!(
        r#"<Grid><Topology TopologyType="3DCoRectMesh" Dimensions="{side},{side},{side}"/><Geometry
        GeometryType="ORIGIN_DXDYDZ"><DataItem Dimensions="3" Format="XML">0 0 0</DataItem><DataItem Dimensions="3"
        Format="XML">1 1 1</DataItem></Geometry><Attribute Name="f" Center="Node"><DataItem Dimensions="{count}"
        Format="XML">{numbers}</DataItem></Attribute></Grid>"#
    ));
    let data = of_text(&text).unwrap();
    assert!(matches!(&data.geometry, Geometry::Lattice(lattice) if lattice.dims == [side; 3]));
}
