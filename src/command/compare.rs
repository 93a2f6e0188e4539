//! Runs `ewa-splat compare`.

use std::path::PathBuf;

use crate::Result;
use crate::io::{check_image_path, read_image, write_image};
use crate::measure::{compare, difference, difference_scale};
use clap::Args;
use serde_json::json;

use super::outputs::check_collisions;
use super::parse;

#[derive(Args)]
pub(crate) struct Arguments {
    /// The image taken as right: png, exr, pfm or npy
    a: PathBuf,
    /// The image compared with it
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Write a picture of the difference, the largest channel of each pixel: black is none
    #[arg(long, value_name = "FILE")]
    difference: Option<PathBuf>,
    /// The difference that its brightest colour stands for [default: the 99.9 percentile, rounded
    /// up]
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "difference")]
    difference_scale: Option<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(path) = &arguments.difference {
        check_image_path(path)?;
        check_collisions(
            [&arguments.a, &arguments.b].into_iter(),
            std::iter::once(path),
        )?;
    }
    let (first, second) = (read_image(&arguments.a)?, read_image(&arguments.b)?);
    let errors = compare(&first, &second)?;
    let scale = arguments
        .difference_scale
        .unwrap_or_else(|| difference_scale(&errors));
    if let Some(path) = &arguments.difference {
        write_image(path, &difference(&first, &second, scale)?)?;
    }
    let mut report = json!(errors);
    if let Some(path) = &arguments.difference {
        let file = path.display().to_string();
        report["difference"] = json!({ "file": file, "brightest": scale });
    }
    if arguments.json {
        super::say!("{report}");
        return Ok(());
    }
    super::say!("linear premultiplied RGBA, full scale 1");
    super::say!("rmse             {:.3e}", errors.rmse);
    super::say!("max              {:.3e}", errors.max);
    super::say!("99.9 percentile  {:.3e}", errors.p999);
    match errors.psnr {
        Some(psnr) => super::say!("psnr             {psnr:.2} dB"),
        None => super::say!("psnr             infinite: the images are equal"),
    }
    super::say!("mean difference  {:+.3e}", errors.mean_difference);
    match errors.ssim {
        Some(ssim) => super::say!("ssim             {ssim:.6}"),
        None => super::say!("ssim             none: the images are smaller than its window"),
    }
    if let Some(flip) = errors.flip {
        super::say!("flip             {flip:.6}");
    }
    if let Some(path) = &arguments.difference {
        super::say!("{}: black 0, brightest {scale}", path.display());
    }
    Ok(())
}
