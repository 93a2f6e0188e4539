//! The splat layout of PLY files (INRIA's): what its properties mean. `ply.rs` has the table.

use super::dataset::Dataset;
use super::ply::Table;
use super::splats::{SplatCloud, sigmoid};
use crate::error::{Error, Result};
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count};

const SPLAT_FORMAT: &str = "PLY splats";
/// Properties `f_rest_` of degree 10: more than any program writes.
const MOST_REST: usize = 360;

/// Whether a comment says that splats are, or are not, made for the anti-aliasing filter.
fn anti_aliasing_mark(comment: &str) -> Option<bool> {
    let words = comment.to_ascii_lowercase().replace(':', " ");
    match words.split_ascii_whitespace().collect::<Vec<_>>()[..] {
        ["splatrendermode", mode] => Some(mode == "mip"),
        ["antialiased", flag] => Some(flag == "1"),
        _ => None,
    }
}

/// Reads the rows as splats.
pub(super) fn splats(
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
    // No degree that is read has more; a header of a million names is none.
    let rest: Vec<usize> = (0..=MOST_REST)
        .map_while(|i| table.index(&format!("f_rest_{i}")))
        .collect();
    used.extend(constant);
    used.extend([opacity, scale_0, scale_1]);
    used.extend(scale_2);
    used.extend(rotation);
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
    let cloud = SplatCloud {
        scales: scales.collect(),
        rotations,
        opacities: table.floats(opacity)?.into_iter().map(sigmoid).collect(),
        harmonics_degree: degree,
        harmonics,
        is_anti_aliased: marks.next_back().unwrap_or(false),
        positions,
    };
    cloud.dataset(path, SPLAT_FORMAT, table.fields(&used)?)
}
