//! Parses `meta.json`.

use std::path::Path;

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;
use crate::math::narrowed;

/// Values of the bytes of one channel.
pub(super) type Levels = [f32; 256];

/// The checked content of `meta.json`.
pub(super) struct Meta {
    pub(super) count: usize,
    pub(super) is_anti_aliased: bool,
    /// Least and greatest logarithms of positions.
    pub(super) bounds: [[f64; 3]; 2],
    /// Levels of three channels each.
    pub(super) scales: Vec<Levels>,
    pub(super) colours: Vec<Levels>,
    /// The logits of opacities; without them bytes are shares of 255.
    pub(super) logits: Option<Levels>,
    pub(super) harmonics: Option<Harmonics>,
    pub(super) means_files: [String; 2],
    pub(super) scales_file: String,
    pub(super) quats_file: String,
    pub(super) colours_file: String,
}

/// The harmonics beyond the constant one.
pub(super) struct Harmonics {
    /// The degree, if it is stated.
    pub(super) degree: Option<u8>,
    /// Number of the palette's entries, if it is stated.
    pub(super) count: Option<usize>,
    pub(super) levels: Levels,
    /// The palette, and the splats' indices in it.
    pub(super) files: [String; 2],
}

#[derive(Deserialize)]
struct Stated {
    version: Option<u64>,
    count: Option<usize>,
    #[serde(default)]
    antialias: bool,
    means: Channels,
    scales: Channels,
    quats: Channels,
    sh0: Channels,
    #[serde(rename = "shN")]
    harmonics: Option<Channels>,
}

/// Description of one property of splats; its parts differ between properties.
#[derive(Deserialize)]
struct Channels {
    shape: Option<Vec<usize>>,
    encoding: Option<String>,
    mins: Option<OneOrMore>,
    maxs: Option<OneOrMore>,
    /// Some writers left the first entry out.
    codebook: Option<Vec<Option<f64>>>,
    bands: Option<u8>,
    count: Option<usize>,
    files: Vec<String>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum OneOrMore {
    One(f64),
    More(Vec<f64>),
}

impl OneOrMore {
    fn numbers(&self) -> &[f64] {
        match self {
            Self::One(number) => std::slice::from_ref(number),
            Self::More(numbers) => numbers,
        }
    }
}

impl Meta {
    pub(super) fn of(path: &Path, json: &[u8]) -> Result<Self> {
        let fault = |place: &str, expected: &str, found: String| {
            let advice = "export the splats again, or as PLY or SPZ";
            Error::format(path, format!("meta.json, {place}"), expected, found, advice)
        };
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        let stated: Stated = serde_json::from_slice(json).map_err(|e| {
            let expected = "`means`, `scales`, `quats` and `sh0` with their files";
            fault("JSON", expected, clip(&e.to_string()))
        })?;
        let is_coded = match stated.version {
            None => false,
            Some(2) => true,
            Some(other) => {
                let found = format!("version {other}, which is not read");
                return Err(fault("`version`", "2, or none", found));
            }
        };
        let shape = stated.means.shape.as_ref();
        let count = match is_coded {
            true => stated.count,
            false => shape.and_then(|shape| shape.first().copied()),
        };
        let count = count.ok_or_else(|| {
            let place = if is_coded { "`count`" } else { "`means.shape`" };
            fault(place, "the number of splats", "nothing".into())
        })?;
        if let Some(other) = stated
            .quats
            .encoding
            .as_ref()
            .filter(|e| *e != "quaternion_packed")
        {
            let found = format!("`{}`, which is not read", clip(other));
            return Err(fault("`quats.encoding`", "quaternion_packed", found));
        }

        let bounds = |name: &str, of: &Channels, n: usize| -> Result<Vec<[f64; 2]>> {
            let numbers = |side: &Option<OneOrMore>| {
                let numbers = side.as_ref().map(|side| side.numbers().to_vec());
                numbers.filter(|numbers| numbers.len() == n)
            };
            match (numbers(&of.mins), numbers(&of.maxs)) {
                (Some(mins), Some(maxs)) => {
                    Ok(mins.into_iter().zip(maxs).map(|(a, b)| [a, b]).collect())
                }
                _ => {
                    let place = format!("`{name}.mins` and `{name}.maxs`");
                    let expected = format!("{n} numbers each");
                    Err(fault(&place, &expected, "others".into()))
                }
            }
        };
        let levels = |name: &str, of: &Channels, n: usize| -> Result<Vec<Levels>> {
            if !is_coded {
                return Ok(bounds(name, of, n)?.into_iter().map(between).collect());
            }
            let found = of.codebook.as_ref().map_or(0, Vec::len);
            let codebook = of.codebook.as_deref().and_then(codebook);
            codebook.map(|levels| vec![levels; n]).ok_or_else(|| {
                let expected = "256 numbers";
                fault(&format!("`{name}.codebook`"), expected, found.to_string())
            })
        };
        let file = |name: &str, of: &Channels, i: usize| {
            of.files.get(i).cloned().ok_or_else(|| {
                let expected = format!("{} names", i + 1);
                let found = of.files.len().to_string();
                fault(&format!("`{name}.files`"), &expected, found)
            })
        };

        let means = bounds("means", &stated.means, 3)?;
        let mut colours = levels("sh0", &stated.sh0, if is_coded { 3 } else { 4 })?;
        let harmonics = match &stated.harmonics {
            None => None,
            Some(of) => {
                if is_coded && of.bands.is_none_or(|bands| bands > 3) {
                    let found = of.bands.map_or("nothing".into(), |bands| bands.to_string());
                    return Err(fault("`shN.bands`", "0 to 3", found));
                }
                Some(Harmonics {
                    degree: of.bands.filter(|_| is_coded),
                    count: of.count.filter(|_| is_coded),
                    levels: levels("shN", of, 1)?[0],
                    files: [file("shN", of, 0)?, file("shN", of, 1)?],
                })
            }
        };
        Ok(Self {
            count,
            is_anti_aliased: stated.antialias,
            bounds: [0, 1].map(|side| [0, 1, 2].map(|axis| means[axis][side])),
            scales: levels("scales", &stated.scales, 3)?,
            logits: (!is_coded).then(|| colours.pop()).flatten(),
            colours,
            harmonics: harmonics.filter(|harmonics| harmonics.degree != Some(0)),
            means_files: [
                file("means", &stated.means, 0)?,
                file("means", &stated.means, 1)?,
            ],
            scales_file: file("scales", &stated.scales, 0)?,
            quats_file: file("quats", &stated.quats, 0)?,
            colours_file: file("sh0", &stated.sh0, 0)?,
        })
    }
}

/// Levels in even steps.
fn between([least, most]: [f64; 2]) -> Levels {
    let mut levels = [0.0; 256];
    for (byte, level) in (0..=u8::MAX).zip(&mut levels) {
        *level = narrowed(least + (most - least) * (f64::from(byte) / 255.0));
    }
    levels
}

/// Levels from a list; if the first was left out, it is extrapolated. `None` if there are not 256.
fn codebook(stated: &[Option<f64>]) -> Option<Levels> {
    let mut levels = [0.0; 256];
    let stated: &[Option<f64>; 256] = stated.try_into().ok()?;
    for (number, level) in stated.iter().zip(&mut levels).skip(1) {
        *level = narrowed((*number)?);
    }
    levels[0] = match stated[0] {
        Some(number) => narrowed(number),
        None => levels[1] + (levels[1] - levels[255]) / 255.0,
    };
    Some(levels)
}
