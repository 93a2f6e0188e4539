//! Merges the splats of a conversion to fewer, and measures what pictures lose.

use std::path::Path;

use clap::Args;
use glam::DVec3;
use serde_json::{Value, json};

use super::certificate::{cameras, codes, drawn, psnr, renderer_of, settings};
use super::parse;
use crate::constants::SPLAT_FLOOR;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::splats::SplatCloud;
use crate::image::Image;
use crate::measure::{FLIP_PIXELS_PER_DEGREE, flip};
use crate::render::Renderer;
use crate::sample::{SampleOptions, fewer_splats, index_u32, surface_report};
use crate::view::Camera;
use crate::{Error, Result};

/// Share of the splats that are left by one step towards a stated error.
pub(super) const STEP: f64 = 0.8;
/// Directions of the compared pictures: degrees around the axis that points up.
pub(super) const AZIMUTHS_DEG: [f64; 4] = [30.0, 120.0, 210.0, 300.0];

/// Options for merging splats.
#[derive(Args)]
pub(crate) struct FewerOptions {
    /// Merge splats while 99.9 % of pixels of four pictures change by less (0 to 1); of a mesh alone, take the fewest surfels whose
    /// pictures differ from the mesh itself by less
    #[arg(long, value_name = "E", value_parser = parse::share, allow_hyphen_values = true, conflicts_with = "count")]
    error: Option<f64>,
    /// When merging splats, keep those that their rule does not draw (below 1/255)
    #[arg(long)]
    keep_all: bool,
}

/// Pictures of splats from four sides.
pub(super) struct Pictures {
    pub(super) cameras: Vec<Camera>,
    pub(super) images: Vec<Image>,
}

impl Pictures {
    /// Draws splats.
    ///
    /// # Errors
    /// The errors of drawing; splats of which nothing is seen.
    pub(super) fn of(cloud: SplatCloud, up: DVec3) -> Result<Self> {
        let mut renderer = renderer_of_splats(cloud)?;
        let cameras = cameras(&renderer, up, &AZIMUTHS_DEG);
        if cameras.is_empty() {
            let expected = "splats of which something is seen";
            let advice = "leave --error out";
            return Err(Error::invalid(
                "pictures", "splats", expected, "none", advice,
            ));
        }
        let images = drawn(&mut renderer, &cameras, &settings())?;
        Ok(Self { cameras, images })
    }

    /// Draws other splats in the same views.
    pub(super) fn again(&self, cloud: SplatCloud) -> Result<Vec<Image>> {
        drawn(&mut renderer_of_splats(cloud)?, &self.cameras, &settings())
    }

    /// Summarises what pictures of fewer splats lose.
    ///
    /// - `given`: number of splats before.
    ///
    /// # Errors
    /// The errors of drawing.
    pub(super) fn summary(&self, given: usize, cloud: &SplatCloud) -> Result<Value> {
        let images = self.again(cloud.clone())?;
        let mut summary = losses(&self.images, &images);
        summary["given"] = json!(given);
        summary["splats"] = json!(cloud.positions.len());
        Ok(summary)
    }
}

/// Summarises what some pictures lose against others: their number, `psnr` (dB), `p999` and the mean of FLIP.
pub(super) fn losses(given: &[Image], found: &[Image]) -> Value {
    let pairs = given.iter().zip(found);
    let flips = pairs.filter_map(|(a, b)| flip(a, b, FLIP_PIXELS_PER_DEGREE));
    let flips: Vec<f64> = flips.collect();
    json!({
        "pictures": found.len(),
        "psnr": psnr(given, found),
        "p999": percentile(given, found, None),
        "flip": flips.iter().sum::<f64>() / flips.len().max(1) as f64,
    })
}

/// Returns a share of a count, 1 at least.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a count"
)]
pub(super) fn share(share: f64, count: usize) -> usize {
    ((share * count as f64) as usize).max(1)
}

fn renderer_of_splats(cloud: SplatCloud) -> Result<Renderer> {
    renderer_of(cloud.dataset(Path::new("splats"), "splats", Vec::new())?)
}

/// Returns the difference of sRGB codes that 99.9 % of pixels do not exceed in any channel.
///
/// - `compared`: whether each pixel of each picture counts; `None` for all.
pub(super) fn percentile(a: &[Image], b: &[Image], compared: Option<&[Vec<bool>]>) -> f64 {
    let pairs = a.iter().map(codes).zip(b.iter().map(codes)).enumerate();
    let of_pair = |(n, (a, b)): (usize, (Image, Image))| -> Vec<f32> {
        let largest = |(a, b): (&[f32; 4], &[f32; 4])| {
            a.iter()
                .zip(b)
                .fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()))
        };
        let all = a.pixels.iter().zip(&b.pixels).enumerate();
        let counted = all.filter(|(i, _)| compared.is_none_or(|compared| compared[n][*i]));
        counted.map(|(_, pair)| largest(pair)).collect()
    };
    let mut differences: Vec<f32> = pairs.flat_map(of_pair).collect();
    differences.sort_unstable_by(f32::total_cmp);
    let rank = (differences.len() * 999).div_ceil(1000);
    differences
        .get(rank.saturating_sub(1))
        .copied()
        .map_or(0.0, f64::from)
}

impl FewerOptions {
    /// Returns the options, and whether each is given.
    pub(super) fn asked(&self) -> [(&'static str, bool); 2] {
        [
            ("--error", self.error.is_some()),
            ("--keep-all", self.keep_all),
        ]
    }

    /// Returns the error that pictures of a mesh may have, if it is compared with the mesh itself: triangles in the colours of their materials.
    ///
    /// # Errors
    /// A field that is not there; an option that applies to merged splats alone.
    pub(super) fn of_mesh(
        &self,
        dataset: &Dataset,
        options: &SampleOptions,
    ) -> Result<Option<f64>> {
        let (Some(error), Geometry::Mesh(mesh)) = (self.error, &dataset.geometry) else {
            return Ok(None);
        };
        let has_marks = mesh.line_count() + mesh.point_count() > 0;
        if has_marks || surface_report(dataset, options)?.field.is_some() {
            return Ok(None);
        }
        if self.keep_all {
            let (expected, advice) = ("splats that --count or --error merges", "leave it out");
            return Err(Error::invalid(
                "--keep-all",
                "inputs",
                expected,
                "a mesh",
                advice,
            ));
        }
        Ok(Some(error))
    }

    /// Returns whether splats are merged.
    ///
    /// - `count`: number of splats that are to be left, or of a mesh's surfels.
    /// - The array: number of inputs that are meshes, and of all.
    ///
    /// # Errors
    /// A count for meshes beside other inputs; an option that applies to none of the inputs.
    pub(super) fn merges(&self, count: Option<u32>, [meshes, all]: [usize; 2]) -> Result<bool> {
        let refused = |option, place, expected, found| {
            let advice = "leave it out";
            Err(Error::invalid(option, place, expected, found, advice))
        };
        if count.is_some() && (1..all).contains(&meshes) {
            let expected = "meshes alone, for surfels, or none, for merged splats";
            return refused("--count", "inputs", expected, "meshes and other data");
        }
        let merges = self.error.is_some() || (count.is_some() && meshes == 0);
        if self.keep_all && !merges {
            let expected = "splats that --count or --error merges";
            return refused("--keep-all", "options", expected, "none");
        }
        Ok(merges)
    }

    /// Merges splats. Also returns what pictures lose; null if they cannot be drawn, which is noted.
    ///
    /// # Errors
    /// The errors of drawing, if they are to be merged by their pictures.
    pub(super) fn merged(
        &self,
        mut cloud: SplatCloud,
        count: Option<u32>,
        up: DVec3,
        notes: &mut Vec<String>,
    ) -> Result<(SplatCloud, Value)> {
        let given = cloud.positions.len();
        let pictures = match Pictures::of(cloud.clone(), up) {
            Err(error) if self.error.is_none() => {
                notes.push(format!("no pictures are compared: {error}"));
                None
            }
            pictures => Some(pictures?),
        };
        if cloud.rule.has_limits() && !self.keep_all {
            let seen = (0..given).filter(|&i| cloud.opacities[i] >= SPLAT_FLOOR);
            let seen: Vec<u32> = seen.map(index_u32).collect();
            if !seen.is_empty() && seen.len() < given {
                cloud = cloud.gathered(&seen);
            }
        }
        if let Some(count) = count {
            cloud = fewer_splats(cloud, count as usize, None)?;
        }
        if let (Some(most), Some(pictures)) = (self.error, &pictures) {
            loop {
                let before = cloud.positions.len();
                let fewer = fewer_splats(cloud.clone(), share(STEP, before), None)?;
                let is_same = fewer.positions.len() == before;
                if is_same
                    || percentile(&pictures.images, &pictures.again(fewer.clone())?, None) > most
                {
                    break;
                }
                cloud = fewer;
            }
        }
        let compared = pictures.map(|pictures| pictures.summary(given, &cloud));
        let summary = compared.transpose()?.unwrap_or(Value::Null);
        Ok((cloud, summary))
    }
}

/// Returns the line that people read.
pub(super) fn line(summary: &Value) -> Option<String> {
    let number = |key: &str| summary[key].as_f64();
    let mesh = &summary["mesh"];
    let of_mesh = match (mesh["splats"].as_f64(), mesh["given"].as_f64()) {
        (Some(error), Some(of_all)) => format!(
            "; beside the mesh itself within {error:.3}, all {given} within {of_all:.3}",
            given = summary["given"]
        ),
        _ => String::new(),
    };
    let (given, splats, pictures) = (number("given")?, number("splats")?, number("pictures")?);
    let psnr = match number("psnr") {
        Some(psnr) => format!("PSNR {psnr:.1} dB"),
        None => "no difference".into(),
    };
    Some(format!(
        "{given} splats to {splats}: in pictures from {pictures} sides {psnr} (sRGB codes), 99.9 % of pixels within {:.3}, FLIP {:.4}{of_mesh}",
        number("p999")?,
        number("flip")?
    ))
}
