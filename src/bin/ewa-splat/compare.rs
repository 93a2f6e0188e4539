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
        println!("{}", serde_json::json!(errors));
        return Ok(());
    }
    println!("linear premultiplied RGBA, full scale 1");
    println!("rmse             {:.3e}", errors.rmse);
    println!("max              {:.3e}", errors.max);
    println!("99.9 percentile  {:.3e}", errors.p999);
    match errors.psnr {
        Some(psnr) => println!("psnr             {psnr:.2} dB"),
        None => println!("psnr             infinite: the images are equal"),
    }
    println!("mean difference  {:+.3e}", errors.mean_difference);
    Ok(())
}
