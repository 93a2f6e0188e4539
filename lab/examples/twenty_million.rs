//! Renders twenty million particles of arbitrary shape and 1 px on the GPU and on the processor, and prints the
//! difference between the images.
//!
//!     cargo run --release -p ewa-splat-lab --example twenty_million [PARTICLES] [WIDTH] [HEIGHT] [IMAGE]

mod scenes;

use std::path::Path;

use ewa_splat::measure::compare;
use ewa_splat::{Backend, Renderer, Result, Settings, io};
use scenes::{camera, particles};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |i: usize, default: usize| {
        let given = arguments.get(i).and_then(|a| a.parse().ok());
        given.unwrap_or(default)
    };
    let count = number(1, 20_000_000);
    let size = [number(2, 1920), number(3, 1080)];
    let draw = |backend| -> Result<Renderer> {
        let scene = particles(count, size[1], 1.0);
        let mut renderer = Renderer::with_options(vec![scene], backend)?;
        renderer.render(&camera(size), &Settings::default())?;
        let (c, t) = (renderer.counts(), renderer.times());
        println!(
            "{}: {} footprints, {} entries, {} splat-pixels; the first frame {:.0} ms, of which \
             classify {:.0}, project {:.0}, sort {:.0}, bin {:.0}, rasterise {:.0}",
            renderer.adapter().as_deref().unwrap_or("the processor"),
            c.footprints,
            c.tile_entries,
            c.splat_pixels,
            t.frame,
            t.classify,
            t.project,
            t.sort,
            t.bin,
            t.rasterise
        );
        Ok(renderer)
    };
    println!("{count} particles, {} x {}", size[0], size[1]);
    // One after the other, to save memory.
    let image = draw(Backend::Gpu)?.image().clone();
    if let Some(path) = arguments.get(4) {
        io::write_image(Path::new(path), &image)?;
    }
    let errors = compare(&image, draw(Backend::Cpu)?.image())?;
    println!("largest difference {:.1e} of full scale", errors.max);
    Ok(())
}
