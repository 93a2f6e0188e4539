//! Tests EnSight, Exodus and netCDF files: they give what VTK and numpy read.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::{Dataset, Geometry, OpenOptions, format_of, open};

use crate::common::real_data;
use crate::support::numbers;

fn fixture(name: &str, time_step: usize) -> Dataset {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    let options = OpenOptions {
        time_step: Some(time_step),
        ..OpenOptions::default()
    };
    open(&path, &options).unwrap()
}

#[test]
fn all_forms_of_ensight_say_the_same() {
    for form in ["text", "binary", "fortran"] {
        let data = fixture(&format!("ensight/{form}.case"), 1);
        let Geometry::Cells(cells) = &data.geometry else {
            panic!("{form}: no cells")
        };
        assert_eq!((cells.nodes.len(), cells.cell_count()), (24, 4), "{form}");
        let pressure = numbers(&data, "pressure");
        assert_eq!(pressure[..3], [1.0, 1.5, 2.0], "{form}");
        assert_eq!(pressure[12..14], [100.0, 101.0], "{form}");
        assert_eq!(numbers(&data, "flow:0")[..2], [4.0, 2.0], "{form}");
        let flow = numbers(&data, "flow:2");
        assert_eq!(flow[..2], [7.0, 3.0], "{form}");
        assert!(flow[2..].iter().all(|x| x.is_nan()), "{form}");
    }
}

#[test]
fn blocks_of_exodus_have_nan_where_they_lack_a_result() {
    let data = fixture("netcdf/blocks.ex2", 1);
    let Geometry::Cells(cells) = &data.geometry else {
        panic!("no cells")
    };
    let kinds: Vec<u8> = cells.kinds.iter().map(|k| k.0).collect();
    assert_eq!(kinds, [12, 14, 14, 10]);
    assert_eq!(cells.cell(2), [9, 12, 11, 10, 17]);
    let stress = numbers(&data, "stress");
    assert_eq!(stress[..3], [1110.0, 1210.0, 1211.0]);
    assert!(stress[3].is_nan());
    assert_eq!(numbers(&data, "Temp")[..2], [100.0, 104.0]);
    assert_eq!(numbers(&data, "vel:2")[..2], [100.0, 103.0]);
    // VTK's order is: edges of the top before upright ones, then left, right, front, back, bottom,
    // top and centre.
    let data = fixture("netcdf/higher.exo", 0);
    let Geometry::Cells(cells) = &data.geometry else {
        panic!("no cells")
    };
    let behind_corners = [16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20];
    assert_eq!(cells.cell(0)[12..], behind_corners);
}

#[test]
fn exodus_is_what_its_vtu_is() {
    let (Some(a), Some(b)) = (
        real_data("unstructured/disk_out_ref.ex2"),
        real_data("unstructured/disk_out_ref.vtu"),
    ) else {
        return;
    };
    let [a, b] = [a, b].map(|path| open(&path, &OpenOptions::default()).unwrap());
    let (Geometry::Cells(x), Geometry::Cells(y)) = (&a.geometry, &b.geometry) else {
        panic!("no cells")
    };
    assert_eq!(x.kinds, y.kinds);
    assert_eq!(x.connectivity.len(), y.connectivity.len());
    // VTK numbers nodes in the order in which cells name them.
    let pairs = || x.connectivity.iter().zip(&y.connectivity);
    let is_same = |(i, j): (&u32, &u32)| x.nodes[*i as usize] == y.nodes[*j as usize];
    assert!(pairs().all(is_same));
    for name in b.field_names() {
        let [of_x, of_y] = [&a, &b].map(|data| numbers(data, name));
        let is_same = |(i, j): (&u32, &u32)| of_x[*i as usize] == of_y[*j as usize];
        assert!(pairs().all(is_same), "{name}");
    }
}

#[test]
fn levels_of_roms_follow_the_ground() {
    // Node (2, 1, 0) at the second time, as numpy computes it by the documented formulas.
    for (name, z) in [("roms1.nc", -55.090_366_979), ("roms2.nc", -54.287_715_647)] {
        let data = fixture(&format!("netcdf/{name}"), 1);
        let Geometry::Curvilinear { blocks } = &data.geometry else {
            panic!("no curvilinear grid")
        };
        let nodes = &blocks[0].nodes;
        assert_eq!(blocks[0].dims, [4, 3, 4]);
        // The surface is in single precision.
        assert!((nodes[6].z - z).abs() < 1e-6, "{}", nodes[6]);
        assert!(nodes[0].z.is_nan());
        assert_eq!(numbers(&data, "temp")[1..3], [49.0, 50.0]);
    }
}

#[test]
fn packed_numbers_and_falling_axes_are_put_right() {
    let data = fixture("netcdf/regular.nc", 1);
    let Geometry::Lattice(lattice) = &data.geometry else {
        panic!("no lattice")
    };
    let last = lattice.position([3, 2, 2]);
    assert!(
        (last.y - 61.0 * 111_195.08).abs() < 10.0 && last.z.abs() < 1e-9,
        "{last}"
    );
    // The data run from north to south, and from the surface down: the last row of the last level
    // comes first.
    let values = numbers(&data, "thetao");
    assert!((values[0] - 20.68).abs() < 1e-5, "{}", values[0]);
    assert_eq!(values.iter().filter(|x| x.is_nan()).count(), 3);
    assert_eq!(data.unit("thetao"), Some("degC"));
    let format = format_of(&data.path, &OpenOptions::default()).unwrap();
    let steps = format.time_steps(&data.path).unwrap();
    let times: Vec<_> = steps.iter().map(|s| s.time).collect();
    assert_eq!(times, [Some(10.0), Some(11.5)]);
}
