//! Reproduces figure 9 for volumes. An iso-surface is drawn by volume kernels and by kernels that are flattened onto
//! it. The volume kernels' transfer function shows a band of values, or all values above one, and classifies values or
//! extents. Claim (section 5): flattening along the gradient makes iso-surfaces more precise. Tested on a ball of known
//! position, and on an engine.
#![allow(clippy::cast_possible_truncation, reason = "values are stored in f32")]

use std::f64::consts::TAU;

use ewa_splat::render::Classification;
use ewa_splat::scene::{Lighting, TransferFunction, Values};
use ewa_splat::view::Camera;
use ewa_splat::{Image, Renderer, Result, Settings};
use glam::{DVec2, DVec3};

use crate::papers::pictures::table_of;
use crate::papers::volumes::{Volume, engine, head, transfer};
use crate::papers::{Arguments, fitted_camera};

/// Cells along each side of the ball's volume.
const CELLS: usize = 48;
const RADIUS: f64 = 18.0;
/// Change of the value per cell.
const SLOPE: f64 = 8.0;
/// Value on the ball's surface.
const ON_BALL: f32 = 128.0;
/// Opacity of a cell on the surface.
const OPACITY: f32 = 0.9;
const BONE: [f32; 3] = [0.9, 0.8, 0.65];

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let ball = ball();
    let camera = Camera::orthographic(
        DVec3::new(0.0, -100.0, 0.0),
        DVec3::ZERO,
        DVec3::Z,
        CELLS as f64,
        [arguments.size; 2],
    );
    let pixel = CELLS as f64 / arguments.size as f64;
    println!(
        "\na ball of {RADIUS} cells, a pixel is {pixel:.3} cells: its silhouette, in cells: the mean \
         radius, how far it strays (rms), and how wide its edge is (90 to 10 %)"
    );
    println!("{:>26} {:>8} {:>8} {:>8}", "", "radius", "strays", "edge");
    let slope = SLOPE as f32;
    let narrow = || ball.scene(&band(ON_BALL, 0.5 * slope, OPACITY)?);
    let wide = || ball.scene(&band(ON_BALL, 1.5 * slope, OPACITY)?);
    let all = || ball.scene(&solid(ON_BALL, OPACITY)?);
    let (by_value, by_extent) = (Classification::Particle, Classification::Extent);
    for (name, scene, classify, top) in [
        ("a band of one cell", narrow()?, by_value, OPACITY),
        ("a band of three cells", wide()?, by_value, OPACITY),
        ("all from the value on", all()?, by_value, OPACITY),
        ("one cell, over extents", narrow()?, by_extent, OPACITY),
        ("three, over extents", wide()?, by_extent, OPACITY),
        ("all, over extents", all()?, by_extent, OPACITY),
        ("flattened", ball.surface(ON_BALL.into())?, by_extent, 1.0),
    ] {
        let mut renderer = Renderer::new(scene)?;
        let settings = Settings {
            classify,
            ..Settings::default()
        };
        let image = renderer.render(&camera, &settings)?;
        let [radius, strays, edge] = rim(image, top).map(|r| r * pixel);
        println!("{name:>26} {radius:>8.3} {strays:>8.3} {edge:>8.3}");
        arguments.write(&format!("ball-{}.png", name.replace(' ', "-")), image)?;
    }

    // Real data: the hard parts of an engine, or else a computed skull; translucent.
    let (data, value) = match engine()? {
        Some(engine) => (engine, 200.0),
        None => (head(arguments.size), 150.0),
    };
    let mut row = Vec::new();
    let shown = band(value, 0.1 * value, 0.2)?;
    for (scene, classify) in [
        (data.scene(&shown)?, by_value),
        (data.scene(&shown)?, by_extent),
        (data.surface(value.into())?, by_extent),
    ] {
        let mut renderer = Renderer::new(scene)?;
        let Some(camera) = fitted_camera(&renderer, arguments.size) else {
            continue;
        };
        let settings = Settings {
            background: Some([0.0; 3]),
            classify,
            lighting: Some(Lighting::default()),
            ..Settings::default()
        };
        row.push(renderer.render(&camera, &settings)?.clone());
    }
    println!(
        "{}: iso-surface.png, value {value}: a band by values, over extents, the surface",
        data.name
    );
    arguments.write("iso-surface.png", &table_of(&[row.iter().collect()]))
}

/// Shows values less than `reach` off.
fn band(value: f32, reach: f32, opacity: f32) -> Result<TransferFunction> {
    let edge = 0.01 * reach;
    transfer(&[
        (value - reach, BONE, 0.0),
        (value - reach + edge, BONE, opacity),
        (value + reach - edge, BONE, opacity),
        (value + reach, BONE, 0.0),
    ])
}

/// Shows values from one on.
fn solid(value: f32, opacity: f32) -> Result<TransferFunction> {
    transfer(&[(value - 0.1, BONE, 0.0), (value, BONE, opacity)])
}

/// Returns values that fall linearly from the middle in all directions.
fn ball() -> Volume {
    let at = |i: usize| i as f64 + 0.5 - 0.5 * CELLS as f64;
    let values = (0..CELLS.pow(3))
        .map(|i| DVec3::new(at(i % CELLS), at(i / CELLS % CELLS), at(i / CELLS / CELLS)))
        .map(|p| (f64::from(ON_BALL) + SLOPE * (RADIUS - p.length())).clamp(0.0, 255.0) as f32);
    Volume {
        name: "ball",
        dims: [CELLS; 3],
        values: Values::F32(values.collect()),
    }
}

/// Measures the silhouette of a ball around the middle of the image, pixels. Returns the mean radius at which its
/// opacity crosses one half, the root mean square deviation of that radius, and the width over which the opacity falls
/// from 90 % of `top`, its maximum, to 10 %.
fn rim(image: &Image, top: f32) -> [f64; 3] {
    const SIDES: u32 = 720;
    const PER_PIXEL: u32 = 8;
    let centre = DVec2::new(image.width as f64, image.height as f64) / 2.0;
    let longest = (centre.min_element() - 2.0) * f64::from(PER_PIXEL);
    let (mut sum, mut squares, mut edges) = (0.0, 0.0, 0.0);
    for side in 0..SIDES {
        let direction = DVec2::from_angle(TAU * f64::from(side) / f64::from(SIDES));
        // From outside: the radius at which the opacity first exceeds a share.
        let reach = |share: f64| {
            let mut steps = longest;
            while steps > 0.0
                && opacity(image, centre + direction * (steps / f64::from(PER_PIXEL))) < share
            {
                steps -= 1.0;
            }
            steps / f64::from(PER_PIXEL)
        };
        let half = reach(0.5);
        sum += half;
        squares += half * half;
        edges += reach(0.1) - reach(0.9 * f64::from(top));
    }
    let sides = f64::from(SIDES);
    let mean = sum / sides;
    [
        mean,
        (squares / sides - mean * mean).max(0.0).sqrt(),
        edges / sides,
    ]
}

/// Interpolates the opacity between the four pixels around a point.
fn opacity(image: &Image, place: DVec2) -> f64 {
    let corner = place - 0.5;
    let whole = corner.floor();
    let within = corner - whole;
    #[expect(clippy::cast_sign_loss, reason = "a place within the picture")]
    let [x, y] = [whole.x as usize, whole.y as usize];
    let at = |x: usize, y: usize| f64::from(image.pixel(x, y)[3]);
    let row = |y| at(x, y) + (at(x + 1, y) - at(x, y)) * within.x;
    row(y) + (row(y + 1) - row(y)) * within.y
}
