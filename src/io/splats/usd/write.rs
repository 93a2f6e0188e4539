//! Writes splats as a layer in text, or as an archive of it.

use std::io::Write;
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::super::encoded_splats::{Encoded, note_mark_lost, offset, single_precision_quantum};
use super::field::{BY_DEPTH, BY_DISTANCE, ENCODED, FIELD, LINEAR, SPLATS, SURFLETS};
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::bytes::zip_write;
use crate::math::{harmonics_count, narrowed};
use crate::parallel;

/// Boundary of an archive's members, bytes.
const ALIGNMENT: usize = 64;

/// Reach of a splat in the prim's extent, standard deviations.
const REACH: f64 = 3.0;

/// Elements of an array that a thread writes at a time, and such pieces that are held at a time.
const PIECE: usize = 1 << 13;
const PIECES: usize = 64;

/// Containers of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Container {
    /// `.usda`: the layer.
    Text,
    /// `.usdz`: an archive with the layer.
    Archive,
}

/// Returns a file with one prim, its numbers in f32. Splats that are all flat become surflets.
pub(in crate::io) fn encode(
    path: &Path,
    cloud: &SplatCloud,
    container: Container,
) -> Result<Encoded> {
    let offset = offset(&cloud.positions);
    let text = layer(cloud, offset);
    let too_long = || {
        Error::format(
            path,
            "size",
            "fewer than 2^32 bytes in an archive",
            text.len().to_string(),
            "split the scene, or write .usda",
        )
    };
    let mut notes = Vec::new();
    note_mark_lost(&mut notes, cloud);
    Ok(Encoded {
        beside: Vec::new(),
        position_quantum: single_precision_quantum(cloud.positions.iter().map(|p| *p - offset)),
        order: Vec::new(),
        notes,
        bytes: match container {
            Container::Archive => {
                let members = [("splats.usda", text.as_slice())];
                zip_write::aligned(&members, ALIGNMENT).ok_or_else(too_long)?
            }
            Container::Text => text,
        },
    })
}

/// Returns the text of a layer.
///
/// - `offset`: subtracted from positions, and added by the prim's transform.
fn layer(cloud: &SplatCloud, offset: DVec3) -> Vec<u8> {
    // Surflets have no hint for their order.
    let is_flat = |s: &[f32; 3]| s[2] == 0.0 && s[0] > 0.0 && s[1] > 0.0;
    let are_flat = !cloud.by_distance && cloud.scales.iter().all(is_flat);
    let (kind, schemas) = match are_flat {
        true => {
            let attributes = [
                "Position",
                "Orientation",
                "Scale",
                "Opacity",
                "SphericalHarmonics",
            ];
            let attributes = attributes.map(|name| format!("\"ParticleField{name}AttributeAPI\""));
            let schemas = format!("\"{SURFLETS}\", {}, ", attributes.join(", "));
            (FIELD, schemas)
        }
        false => (SPLATS, String::new()),
    };
    let count = cloud.positions.len();
    let place = |i: usize| (cloud.positions[i] - offset).as_vec3().to_array();
    let mut out = Out(Vec::new());
    // Files that state no unit are in centimetres. glTF's are in metres.
    out.text(&format!(
        "#usda 1.0\n(\n    defaultPrim = \"splats\"\n    doc = \"ewa-splat {}\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\n\
         def {kind} \"splats\" (\n    prepend apiSchemas = [{schemas}\"ColorSpaceAPI\"]\n)\n{{\n",
        env!("CARGO_PKG_VERSION")
    ));
    let space = if cloud.is_linear { LINEAR } else { ENCODED };
    out.text(&format!(
        "    uniform token colorSpace:name = \"{space}\"\n"
    ));
    let extent = extent(cloud, offset);
    out.array("float3[] extent", 2, |i| extent[i]);
    out.array("float[] opacities", count, |i| [cloud.opacities[i]]);
    out.array("quatf[] orientations", count, |i| {
        cloud.unit_rotation(i).map(narrowed)
    });
    out.array("point3f[] positions", count, place);
    let sets = harmonics_count(cloud.harmonics_degree);
    let name = "float3[] radiance:sphericalHarmonicsCoefficients";
    out.array(name, count * sets, |i| {
        [0, 1, 2].map(|channel| cloud.harmonics[3 * i + channel])
    });
    out.text(&format!(
        "    uniform int radiance:sphericalHarmonicsDegree = {}\n",
        cloud.harmonics_degree
    ));
    out.array("float3[] scales", count, |i| match are_flat {
        true => cloud.scales[i],
        false => cloud.thick_scales(i),
    });
    if !are_flat {
        let order = if cloud.by_distance {
            BY_DISTANCE
        } else {
            BY_DEPTH
        };
        out.text(&format!(
            "    uniform token sortingModeHint = \"{order}\"\n"
        ));
    }
    if offset != DVec3::ZERO {
        let [x, y, z] = offset.to_array();
        out.text(&format!(
            "    double3 xformOp:translate = ({x:e}, {y:e}, {z:e})\n    \
             uniform token[] xformOpOrder = [\"xformOp:translate\"]\n"
        ));
    }
    out.text("}\n");
    out.0
}

/// The box of the splats without the offset.
fn extent(cloud: &SplatCloud, offset: DVec3) -> [[f32; 3]; 2] {
    let mut corners = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for (i, position) in cloud.positions.iter().enumerate() {
        let [w, x, y, z] = cloud.unit_rotation(i);
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
        let axes = axes * DMat3::from_diagonal(DVec3::from(cloud.scales[i].map(f64::from)));
        let rows = axes.transpose();
        let half = DVec3::new(
            rows.x_axis.length(),
            rows.y_axis.length(),
            rows.z_axis.length(),
        );
        let middle = *position - offset;
        corners[0] = corners[0].min(middle - REACH * half);
        corners[1] = corners[1].max(middle + REACH * half);
    }
    let most = f64::from(f32::MAX);
    corners.map(|corner| {
        let corner = corner.clamp(DVec3::splat(-most), DVec3::splat(most));
        corner.as_vec3().to_array()
    })
}

/// Text of a layer.
struct Out(Vec<u8>);

impl Out {
    fn text(&mut self, text: &str) {
        self.0.extend(text.as_bytes());
    }

    /// Appends an attribute with an array.
    ///
    /// - `declared`: its type and name.
    fn array<const N: usize>(
        &mut self,
        declared: &str,
        count: usize,
        of: impl Fn(usize) -> [f32; N] + Sync,
    ) {
        self.text(&format!("    {declared} = ["));
        let all = count.div_ceil(PIECE);
        for first in (0..all).step_by(PIECES) {
            let pieces = parallel::map(PIECES.min(all - first), |piece| {
                let start = (first + piece) * PIECE;
                let mut text = Vec::new();
                for i in start..(start + PIECE).min(count) {
                    if i > 0 {
                        text.extend(b", ");
                    }
                    element(&mut text, of(i));
                }
                text
            });
            for piece in pieces {
                self.0.extend(piece);
            }
        }
        self.text("]\n");
    }
}

/// Appends a number, or several in parentheses, with the fewest digits that are read as the same numbers.
fn element<const N: usize>(text: &mut Vec<u8>, numbers: [f32; N]) {
    if N > 1 {
        text.push(b'(');
    }
    for (i, number) in numbers.into_iter().enumerate() {
        if i > 0 {
            text.extend(b", ");
        }
        let size = number.abs();
        let is_plain = number == 0.0 || (1e-4..1e9).contains(&size);
        let written = match is_plain {
            true => write!(text, "{number}"),
            false => write!(text, "{number:e}"),
        };
        debug_assert!(written.is_ok(), "vectors take any text");
    }
    if N > 1 {
        text.push(b')');
    }
}
