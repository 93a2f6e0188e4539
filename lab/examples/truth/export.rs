//! Writes the scene and its reference images for other renderers (`lab/examples/vtk_truth.py`).

use std::path::Path;

use ewa_splat::io::{Dataset, FieldSource, Geometry, write_image};
use ewa_splat::scene::Values;
use ewa_splat::{Error, Image, Result};
use serde_json::{Value, json};

use crate::functions::{Point, UNIT};
use crate::{EYE, FOV_DEG};

/// Writes `scene.json`, the description of the other files.
pub(crate) fn scene(folder: &Path, size: usize, functions: &[(&str, &[Point])]) -> Result<()> {
    let points = |points: &[Point]| -> Vec<Value> {
        let point = |&(value, opacity, colour): &Point| json!({ "value": value, "opacity": opacity, "color": colour });
        points.iter().map(point).collect()
    };
    let functions: Vec<Value> = functions
        .iter()
        .map(|(name, p)| json!({ "name": name, "points": points(p) }))
        .collect();
    let scene = json!({
        "size": size, "eye": EYE, "vertical_fov_deg": FOV_DEG, "unit_distance": UNIT,
        "functions": functions,
    });
    write(
        &folder.join("scene.json"),
        format!("{scene:#}\n").as_bytes(),
    )
}

/// Writes `truth-NAME.npy`: height x width x 4, premultiplied linear RGBA.
pub(crate) fn truth(folder: &Path, name: &str, size: usize, pixels: &[[f64; 4]]) -> Result<()> {
    let image = Image {
        width: size,
        height: size,
        pixels: pixels.iter().map(|p| p.map(|c| c as f32)).collect(),
    };
    write_image(&folder.join(format!("truth-{name}.npy")), &image)
}

/// Writes `NAME.values` (f32), `NAME.nodes` (x, y, z in f64) and `NAME.cells` (four u32 each), little-endian, as far as
/// the grid has them.
pub(crate) fn grid(folder: &Path, name: &str, dataset: &Dataset) -> Result<()> {
    let file = |what: &str| folder.join(format!("{name}.{what}"));
    if let FieldSource::Scalar(Values::F32(values)) = &dataset.fields[0].source {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        write(&file("values"), &bytes)?;
    }
    let nodes = match &dataset.geometry {
        Geometry::Curvilinear { blocks } => &blocks[0].nodes,
        Geometry::Cells(mesh) => {
            let cells = mesh.connectivity.iter().flat_map(|i| i.to_le_bytes());
            write(&file("cells"), &cells.collect::<Vec<u8>>())?;
            &mesh.nodes
        }
        _ => return Ok(()),
    };
    let bytes = nodes.iter().flat_map(|p| p.to_array());
    let bytes: Vec<u8> = bytes.flat_map(f64::to_le_bytes).collect();
    write(&file("nodes"), &bytes)
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    std::fs::write(path, bytes)
        .map_err(|e| Error::io(path, "writing", e, "name a folder that can be written"))
}
