//! Tests post-classification: the field is splatted, and each slab of each pixel is classified and lit. The 2001
//! paper's conclusions leave this to future work; light is from the derivative of the resampling filter. Claim: sharper
//! iso-features on coarse data.
//!
//! The reference image is made on eight times as many nodes along each axis: the values that the nucleon's kernels
//! interpolate there, each classified.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "values are f32; places are held to the volume"
)]

use ewa_splat::Composite;
use ewa_splat::measure::compare;
use ewa_splat::render::Classification;
use ewa_splat::scene::{Lighting, TransferFunction, Values};
use ewa_splat::view::Camera;
use ewa_splat::{Renderer, Result, Settings};
use glam::DVec3;

use crate::papers::Arguments;
use crate::papers::pictures::{contrast, table_of};
use crate::papers::volumes::{Volume, nucleon, transfer};

/// Nodes of the reference along each axis for each node of the data.
const FINER: usize = 8;

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    println!(
        "{:>14} {:>28} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "data", "", "ms", "slab", "RMSE", "99.9 %", "FLIP", "contrast"
    );
    if let Some(nucleon) = nucleon()? {
        let shells = shells(&[
            (55.0, [0.1, 0.3, 0.9]),
            (130.0, [0.9, 0.5, 0.1]),
            (210.0, [0.9; 3]),
        ])?;
        one(arguments, &nucleon, &interpolated(&nucleon), &shells)?;
    }
    Ok(())
}

/// Renders one volume, coarse and fine, with classification before and after splatting, unlit and lit.
fn one(
    arguments: &Arguments,
    coarse: &Volume,
    fine: &Volume,
    shells: &TransferFunction,
) -> Result<()> {
    let scale = fine.dims[0] as f64 / coarse.dims[0] as f64;
    let side = coarse.dims[0] as f64;
    let camera = |scale: f64| {
        let eye = DVec3::new(0.9, -1.5, 0.8) * side * scale;
        Camera::perspective(eye, DVec3::ZERO, DVec3::Z, 38.0, [arguments.size; 2])
    };
    let slabs = Settings {
        composite: Composite::SLABS,
        background: Some([0.0; 3]),
        level_of_detail: false,
        ..Settings::default()
    };
    // Rays are as long, in the unit of opacity, as in the coarse volume.
    let of_fine = shells.clone().with_unit_distance(scale)?;
    let truth = {
        let mut renderer = Renderer::new(fine.scene(&of_fine)?)?;
        renderer.render(&camera(scale), &slabs)?.clone()
    };
    let mut renderer = Renderer::new(coarse.scene(shells)?)?;
    let thin = Some(0.25);
    let mut pictures = vec![truth.clone()];
    let (by_value, by_extent) = (Classification::Particle, Classification::Extent);
    let by_slab = Classification::Slab;
    for (name, classify, thickness, is_lit) in [
        ("values", by_value, None, false),
        ("extents", by_extent, None, false),
        ("slabs", by_slab, None, false),
        ("slabs a quarter thick", by_slab, thin, false),
        ("slabs, lit", by_slab, None, true),
        ("slabs a quarter thick, lit", by_slab, thin, true),
    ] {
        let settings = Settings {
            classify,
            composite: Composite::Slabs { thickness },
            lighting: is_lit.then(Lighting::default),
            ..slabs.clone()
        };
        let image = renderer.render(&camera(1.0), &settings)?.clone();
        let ms = renderer.times().frame;
        let thickness = renderer
            .layers()
            .map_or(f64::NAN, |layers| layers.thickness);
        print!("{:>14} {name:>28} {ms:>8.0} {thickness:>9.2}", coarse.name);
        if is_lit {
            println!();
        } else {
            let errors = compare(&image, &truth)?;
            println!(
                " {:>9.4} {:>9.3} {:>9.3} {:>9.2}",
                errors.rmse,
                errors.p999,
                errors.flip.unwrap_or(f64::NAN),
                contrast(&image, &truth)
            );
        }
        let file = format!("{}-{name}", coarse.name).replace([' ', ','], "-");
        arguments.write(&format!("classified-{file}.png"), &image)?;
        pictures.push(image);
    }
    // Reference image; by values; over extents; slabs a quarter thick.
    let row = [0, 1, 2, 4].map(|i| &pictures[i]);
    let file = coarse.name.replace(' ', "-");
    arguments.write(
        &format!("classified-{file}.png"),
        &table_of(&[row.to_vec()]),
    )
}

/// Returns a transfer function with thin shells around values, each of one colour.
fn shells(at: &[(f32, [f32; 3])]) -> Result<TransferFunction> {
    const HALF_WIDTH: f32 = 6.0;
    let mut points = vec![(0.0, at[0].1, 0.0)];
    for &(value, colour) in at {
        points.push((value - HALF_WIDTH, colour, 0.0));
        points.push((value, colour, 0.6));
        points.push((value + HALF_WIDTH, colour, 0.0));
    }
    transfer(&points)
}

/// Interpolates the values as volume kernels do: the mean under Gaussians of .6 node distances, on [`FINER`] times as
/// many nodes along each axis.
fn interpolated(volume: &Volume) -> Volume {
    const REACH: usize = 3;
    let n = volume.dims[0];
    // For each fine node along an axis: the first node that contributes to it, and the weights of the nodes from there
    // on.
    let weights: Vec<(usize, Vec<f64>)> = (0..n * FINER)
        .map(|i| {
            let at = (i as f64 + 0.5) / FINER as f64 - 0.5;
            let first = (at.round().max(0.0) as usize).saturating_sub(REACH);
            let end = (at.round().max(0.0) as usize + REACH + 1).min(n);
            let weights: Vec<f64> = (first..end)
                .map(|j| (-0.5 * ((j as f64 - at) / 0.6).powi(2)).exp())
                .collect();
            let sum: f64 = weights.iter().sum();
            (first, weights.iter().map(|w| w / sum).collect())
        })
        .collect();
    // One axis after the other; `stride` is that of the axis in the input.
    let along = |values: &[f64], dims: [usize; 3], axis: usize| -> Vec<f64> {
        let mut out_dims = dims;
        out_dims[axis] = n * FINER;
        let stride: usize = dims[..axis].iter().product();
        let [nx, ny, nz] = out_dims;
        (0..nx * ny * nz)
            .map(|i| {
                let mut cell = [i % nx, i / nx % ny, i / (nx * ny)];
                let (first, weights) = &weights[cell[axis]];
                cell[axis] = *first;
                let at = (cell[2] * dims[1] + cell[1]) * dims[0] + cell[0];
                let terms = weights.iter().enumerate();
                terms.map(|(k, w)| w * values[at + k * stride]).sum()
            })
            .collect()
    };
    let mut values: Vec<f64> = (0..n * n * n)
        .map(|i| f64::from(volume.values.get(i)))
        .collect();
    let mut dims = volume.dims;
    for axis in 0..3 {
        values = along(&values, dims, axis);
        dims[axis] = n * FINER;
    }
    Volume {
        name: volume.name,
        dims,
        values: Values::F32(values.iter().map(|v| *v as f32).collect()),
    }
}
