//! `ewa-splat compare`

use std::path::PathBuf;

use clap::Args;
use ewa_splat::Result;
use ewa_splat::io::read_image;

#[derive(Args)]
pub(crate) struct Arguments {
    /// The image taken as right: png, exr, pfm or npy
    a: PathBuf,
    /// The image compared with it
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let errors =
        ewa_splat::measure::compare(&read_image(&arguments.a)?, &read_image(&arguments.b)?)?;
    if arguments.json {
        crate::say!("{}", serde_json::json!(errors));
        return Ok(());
    }
    crate::say!("linear premultiplied RGBA, full scale 1");
    crate::say!("rmse             {:.3e}", errors.rmse);
    crate::say!("max              {:.3e}", errors.max);
    crate::say!("99.9 percentile  {:.3e}", errors.p999);
    match errors.psnr {
        Some(psnr) => crate::say!("psnr             {psnr:.2} dB"),
        None => crate::say!("psnr             infinite: the images are equal"),
    }
    crate::say!("mean difference  {:+.3e}", errors.mean_difference);
    Ok(())
}
