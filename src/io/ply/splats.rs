//! Reads and writes the splat layout of PLY files (INRIA's). `table.rs` has the rows.

use std::path::Path;

use super::table::Table;
use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, sigmoid};
use crate::error::{Error, Result};
use crate::io::splats::encoded_splats::{Encoded, PlyForm, single_precision_quantum};
use crate::io::splats::splat_table::FILTER_NOTE;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count, narrowed};
use crate::scene::SplatRule;

pub(in crate::io) const SPLAT_FORMAT: &str = "PLY splats";
/// Properties `f_rest_` of degree 10: more than any program writes.
const MOST_REST: usize = 360;

/// The mark of a comment for splats that are, or are not, made for the anti-aliasing filter.
fn anti_aliasing_mark(comment: &str) -> Option<bool> {
    let words = comment.to_ascii_lowercase().replace(':', " ");
    match words.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["splatrendermode", mode] => Some(mode == "mip"),
        ["antialiased", flag] => Some(flag == "1"),
        _ => None,
    }
}

/// Reads the rows as splats.
pub(in crate::io) fn splats(
    table: &Table<'_>,
    comments: &[String],
    notes: &mut Vec<String>,
) -> Result<Dataset> {
    let path = table.path;
    let (positions, mut used) = table.positions()?;
    let constant = table.columns(["f_dc_0", "f_dc_1", "f_dc_2"])?;
    let [opacity] = table.columns(["opacity"])?;
    let [scale_0, scale_1] = table.columns(["scale_0", "scale_1"])?;
    let scale_2 = table.index("scale_2");
    let rotation = table.columns(["rot_0", "rot_1", "rot_2", "rot_3"])?;
    // No supported degree has more; a header of a million names is refused.
    let rest: Vec<usize> = (0..=MOST_REST)
        .map_while(|i| table.index(&format!("f_rest_{i}")))
        .collect();
    used.extend(constant);
    used.extend([opacity, scale_0, scale_1]);
    used.extend(scale_2);
    used.extend(rotation);
    let filter = table.index("filter_3D");
    used.extend(filter);
    used.extend(&rest);

    // Per channel (degree + 1)² - 1.
    let per_channel = rest.len() / 3;
    let degree = (0..=10_u8).find(|&d| 3 * (harmonics_count(d) - 1) == rest.len());
    let Some(degree) = degree else {
        return Err(Error::format(
            path,
            "header",
            "0, 9, 24 or 45 properties f_rest_0, f_rest_1, ...",
            rest.len().to_string(),
            "write the harmonics of a whole degree, red, green and blue",
        ));
    };
    if degree > MAX_HARMONICS_DEGREE {
        notes.push(format!(
            "harmonics of degree {degree}: those above {MAX_HARMONICS_DEGREE} are not used"
        ));
    }
    let degree = degree.min(MAX_HARMONICS_DEGREE);

    let count = positions.len();
    let stride = 3 * harmonics_count(degree);
    let mut harmonics = vec![0.0; count * stride];
    let mut fill = |slot: usize, member: usize| -> Result<()> {
        for (set, value) in harmonics
            .chunks_exact_mut(stride)
            .zip(table.floats(member)?)
        {
            set[slot] = value;
        }
        Ok(())
    };
    for (channel, &member) in constant.iter().enumerate() {
        fill(channel, member)?;
        for k in 1..harmonics_count(degree) {
            fill(3 * k + channel, rest[channel * per_channel + k - 1])?;
        }
    }
    let logarithms = [scale_0, scale_1].map(|member| table.floats(member));
    let [scale_0, scale_1] = logarithms;
    let (scale_0, scale_1) = (scale_0?, scale_1?);
    let scale_2 = scale_2.map(|member| table.floats(member)).transpose()?;
    if scale_2.is_none() {
        notes.push("no property `scale_2`: the splats are flat".into());
    }
    let scales = (0..count).map(|i| {
        let thickness = scale_2.as_ref().map_or(0.0, |s| s[i].exp());
        [scale_0[i].exp(), scale_1[i].exp(), thickness]
    });
    let mut rotations = vec![[0.0; 4]; count];
    for (k, &member) in rotation.iter().enumerate() {
        for (rotation, value) in rotations.iter_mut().zip(table.floats(member)?) {
            rotation[k] = value;
        }
    }
    let mut marks = comments.iter().filter_map(|c| anti_aliasing_mark(c));
    let mut cloud = SplatCloud {
        scales: scales.collect(),
        rotations,
        opacities: table.floats(opacity)?.into_iter().map(sigmoid).collect(),
        harmonics_degree: degree,
        harmonics,
        // Only Mip-Splatting writes a filter.
        rule: SplatRule::of_mark(marks.next_back().unwrap_or(filter.is_some())),
        positions,
        ..SplatCloud::default()
    };
    if let Some(member) = filter {
        cloud.widen(&table.floats(member)?);
        notes.push(FILTER_NOTE.into());
    }
    cloud.dataset(path, SPLAT_FORMAT, table.fields(&used)?)
}

/// Greatest magnitude of a written logit: opacities stay 3.1e-7 from 0 and from 1.
const GREATEST_LOGIT: f64 = 15.0;

/// Returns the names of the columns behind positions and normals.
///
/// - `scales`: number of scales.
pub(in crate::io) fn columns(cloud: &SplatCloud, scales: usize) -> Vec<String> {
    let rest = harmonics_count(cloud.harmonics_degree) - 1;
    let numbered =
        |name: &str, count: usize| (0..count).map(move |i| format!("{name}_{i}")).collect();
    let names: [Vec<String>; 5] = [
        numbered("f_dc", 3),
        numbered("f_rest", 3 * rest),
        vec!["opacity".to_owned()],
        numbered("scale", scales),
        numbered("rot", 4),
    ];
    names.concat()
}

/// Calls `put` with the numbers of splat `i` in these columns.
pub(in crate::io) fn row(cloud: &SplatCloud, scales: usize, i: usize, mut put: impl FnMut(f32)) {
    let coefficients = cloud.coefficients(i);
    coefficients[..3].iter().copied().for_each(&mut put);
    for channel in 0..3 {
        let others = coefficients[3..].iter().skip(channel).step_by(3);
        others.copied().for_each(&mut put);
    }
    let opacity = f64::from(cloud.opacities[i]);
    let logit = (opacity / (1.0 - opacity)).ln();
    put(narrowed(logit.clamp(-GREATEST_LOGIT, GREATEST_LOGIT)));
    let own = match scales {
        3 => cloud.thick_scales(i),
        _ => cloud.scales[i],
    };
    for scale in &own[..scales] {
        put(narrowed(f64::from(*scale).ln()));
    }
    cloud
        .unit_rotation(i)
        .map(narrowed)
        .into_iter()
        .for_each(put);
}

/// Encodes splats: binary, little-endian, with normals of zeros as in the layout.
pub(in crate::io) fn encode(path: &Path, cloud: &SplatCloud, form: PlyForm) -> Result<Encoded> {
    let count = cloud.positions.len();
    let is_flat = form == PlyForm::Surfels;
    let thick = || cloud.scales.iter().position(|s| s[2] > 0.0);
    if let (true, Some(i)) = (is_flat, thick()) {
        return Err(Error::format(
            path,
            format!("splat {i}"),
            "a flat splat, its third scale 0",
            cloud.scales[i][2].to_string(),
            "write the form with three scales",
        ));
    }
    let scales = if is_flat { 2 } else { 3 };
    let mode = match (is_flat, cloud.rule.is_anti_aliased()) {
        (true, _) => "2dgs",
        (false, true) => "mip",
        (false, false) => "default",
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment SplatRenderMode: {mode}\n{}\
         element vertex {count}\n",
        // The mode of surfels has no place for it.
        if is_flat && cloud.rule.is_anti_aliased() {
            "comment antialiased 1\n"
        } else {
            ""
        },
    );
    let positions = ["x", "y", "z", "nx", "ny", "nz"].map(str::to_owned);
    let names = [positions.to_vec(), columns(cloud, scales)].concat();
    for name in &names {
        bytes += &format!("property float {name}\n");
    }
    bytes += "end_header\n";
    let mut bytes = bytes.into_bytes();
    bytes.reserve_exact(4 * names.len() * count);
    for i in 0..count {
        let mut put = |value: f32| bytes.extend(value.to_le_bytes());
        let position = cloud.positions[i].as_vec3().to_array();
        position.into_iter().chain([0.0; 3]).for_each(&mut put);
        row(cloud, scales, i, put);
    }
    Ok(Encoded {
        bytes,
        beside: Vec::new(),
        position_quantum: single_precision_quantum(cloud.positions.iter().copied()),
        order: Vec::new(),
        notes: Vec::new(),
    })
}
