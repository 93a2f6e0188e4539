//! Parses values of command-line options.

use crate::data::particle_type::ParticleType;
use crate::edit::Displacement;
use crate::image::linear_from_srgb;
use crate::io::{RawType, StepChoice};
use crate::load::Input;
use crate::scene::{Light, LightFrame, MAX_SOFTNESS_DEG};
use crate::view::{Along, ClipPlane, Window};
use clap::builder::{PathBufValueParser, TypedValueParser};
use glam::{DQuat, DVec3, Vec3};

/// Returns the parser of an input.
pub(crate) fn input() -> impl TypedValueParser<Value = Input> {
    PathBufValueParser::new().map(Input::parse)
}

/// Parses `x,y,z`.
pub(crate) fn vector(text: &str) -> Result<DVec3, String> {
    numbers(text).map(DVec3::from)
}

/// Parses the edges of a box: `x,y,z`, or one number for a cube.
pub(crate) fn edges(text: &str) -> Result<DVec3, String> {
    let edges = match finite_numbers(text).as_deref() {
        Some(&[edge]) => Some(DVec3::splat(edge)),
        Some(&[x, y, z]) => Some(DVec3::new(x, y, z)),
        _ => None,
    };
    edges
        .filter(|edges| edges.min_element() > 0.0)
        .ok_or_else(|| "three edges above 0, such as 10,10,5, or one for a cube".into())
}

/// Parses a direction `x,y,z` into a unit vector.
pub(crate) fn direction(text: &str) -> Result<DVec3, String> {
    vector(text)?
        .try_normalize()
        .ok_or_else(|| "three numbers that are not all zero, such as 0,0,1".into())
}

/// Value of `--type`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum TypeName {
    /// Type of a raw volume's samples.
    Samples(RawType),
    /// Type of a snapshot's particles.
    Particles(ParticleType),
}

/// Parses the type of a raw volume's samples, or of particles.
pub(crate) fn type_name(text: &str) -> Result<TypeName, String> {
    let samples = match text {
        "u8" => Some(RawType::U8),
        "i16" => Some(RawType::I16),
        "u16" => Some(RawType::U16),
        "f32" => Some(RawType::F32),
        _ => None,
    };
    let particles = || ParticleType::of_name(text).map(TypeName::Particles);
    let found = samples.map(TypeName::Samples).or_else(particles);
    found.ok_or_else(|| {
        let names = ParticleType::NAMED.map(|t| t.to_string()).join(", ");
        format!("u8, i16, u16 or f32 of a raw volume; {names} or a number of particles")
    })
}

/// Parses a time step: `N` or `last`.
pub(crate) fn step(text: &str) -> Result<StepChoice, String> {
    if text.eq_ignore_ascii_case("last") {
        return Ok(StepChoice::Last);
    }
    let number = text.parse().map(StepChoice::Number);
    number.map_err(|_| "a step's number, counted from 0, or last".into())
}

/// Value, or `none`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OrNone<T>(pub(crate) Option<T>);

/// Extends a parser to accept `none`.
pub(crate) fn or_none<T>(
    parse: impl Fn(&str) -> Result<T, String> + Clone + Send + Sync,
) -> impl Fn(&str) -> Result<OrNone<T>, String> + Clone + Send + Sync {
    move |text| {
        if text.eq_ignore_ascii_case("none") {
            return Ok(OrNone(None));
        }
        parse(text).map(|value| OrNone(Some(value)))
    }
}

/// Parses `x,y,z,DEGREES`: an axis and a right-handed angle about it.
pub(crate) fn turn(text: &str) -> Result<DQuat, String> {
    let turn = match finite_numbers(text).as_deref() {
        Some(&[x, y, z, degrees]) => DVec3::new(x, y, z)
            .try_normalize()
            .map(|axis| DQuat::from_axis_angle(axis, degrees.to_radians())),
        _ => None,
    };
    turn.ok_or_else(|| "an axis, not 0,0,0, and degrees, such as 0,0,1,90".into())
}

/// Parses `x0,y0,z0,x1,y1,z1`.
pub(crate) fn corners(text: &str) -> Result<[DVec3; 2], String> {
    let corners = match finite_numbers(text).as_deref() {
        Some(&[x0, y0, z0, x1, y1, z1]) => [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)],
        _ => [DVec3::ZERO; 2],
    };
    match corners[0].cmplt(corners[1]).all() {
        true => Ok(corners),
        false => Err(
            "the lower and the upper corner of a box, six finite numbers such as 0,0,0,1,1,1"
                .into(),
        ),
    }
}

/// Value of `--spacing`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Spacing {
    /// One number: spacing of a mesh's surfels, or of a raw volume's samples along every axis.
    Even(f64),
    /// Spacing of a raw volume's samples along each axis: `x,y,z`.
    Axes(DVec3),
}

/// Parses `D` or `x,y,z`.
pub(crate) fn spacing(text: &str) -> Result<Spacing, String> {
    if text.contains(',') {
        vector(text).map(Spacing::Axes)
    } else {
        positive(text).map(Spacing::Even)
    }
}

/// Parses `F` or `x,y,z`, all above 0.
pub(crate) fn sizes(text: &str) -> Result<DVec3, String> {
    if !text.contains(',') {
        return positive(text).map(DVec3::splat);
    }
    match finite_numbers(text).as_deref() {
        Some(&[x, y, z]) if x.min(y).min(z) > 0.0 => Ok(DVec3::new(x, y, z)),
        _ => Err("a number above 0, or three such as 1,1,50".into()),
    }
}

/// Parses a colour: linear numbers `r,g,b`, or an sRGB-encoded web colour (a name or `#rrggbb`).
pub(crate) fn colour(text: &str) -> Result<[f32; 3], String> {
    let linear = numbers(text).ok().map(|rgb| DVec3::from(rgb).as_vec3());
    let encoded = || {
        let colour = csscolorparser::parse(text).ok().filter(|c| c.a >= 1.0)?;
        Some(Vec3::from(
            [colour.r, colour.g, colour.b].map(linear_from_srgb),
        ))
    };
    match linear.or_else(encoded) {
        Some(rgb) if rgb.min_element() >= 0.0 && rgb.max_element() <= 1.0 => Ok(rgb.into()),
        Some(_) => Err("three numbers from 0 to 1, or #rrggbb for 0 to 255".into()),
        None => Err(
            "three numbers from 0 to 1 such as 0.1,0.1,0.2, #1a1a33, or a name such as navy".into(),
        ),
    }
}

/// Value of `--background`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Background {
    /// No background.
    None,
    /// Linear colour.
    Colour([f32; 3]),
}

/// Parses a [`colour`] or `none`.
pub(crate) fn background(text: &str) -> Result<Background, String> {
    if text.eq_ignore_ascii_case("none") {
        return Ok(Background::None);
    }
    colour(text).map(Background::Colour)
}

/// Parses `x,y,z` or `x,y,z,r,g,b`: a direction in world space and a linear colour.
pub(crate) fn light(text: &str) -> Result<Light, String> {
    let (direction, colour) = match finite_numbers(text).as_deref() {
        Some(&[x, y, z]) => (DVec3::new(x, y, z), DVec3::ONE),
        Some(&[x, y, z, r, g, b]) => (DVec3::new(x, y, z), DVec3::new(r, g, b)),
        _ => (DVec3::ZERO, DVec3::ZERO),
    };
    if direction.try_normalize().is_none() || colour.min_element() < 0.0 {
        return Err(
            "a direction, not 0,0,0, and perhaps a colour of numbers from 0 up, such as 1,-1,2 or \
             1,-1,2,1,0.9,0.8"
                .into(),
        );
    }
    Ok(Light {
        direction,
        frame: LightFrame::World,
        colour: colour.as_vec3().into(),
    })
}

fn numbers(text: &str) -> Result<[f64; 3], String> {
    finite_numbers(text)
        .and_then(|v| <[f64; 3]>::try_from(v).ok())
        .ok_or_else(|| "three finite numbers with commas between, such as 1,0.5,-2".into())
}

fn finite_numbers(text: &str) -> Option<Vec<f64>> {
    let parsed: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse::<f64>()).collect();
    parsed.ok().filter(|v| v.iter().all(|x| x.is_finite()))
}

/// Value of `--clip`: the planes of a half-space or of a box.
#[derive(Debug, Clone)]
pub(crate) struct Clip(pub(crate) Vec<ClipPlane>);

/// Parses `nx,ny,nz,d` or `x0,y0,z0,x1,y1,z1`.
pub(crate) fn clip(text: &str) -> Result<Clip, String> {
    let planes = match finite_numbers(text).as_deref() {
        Some(&[nx, ny, nz, distance]) => {
            let normal = DVec3::new(nx, ny, nz);
            let plane = ClipPlane { normal, distance };
            plane.normalised().map(|plane| vec![plane])
        }
        Some(&[x0, y0, z0, x1, y1, z1]) => {
            let (lower, upper) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
            let is_box = lower.cmplt(upper).all();
            is_box.then(|| ClipPlane::of_box(lower, upper).to_vec())
        }
        _ => None,
    };
    planes.map(Clip).ok_or_else(|| {
        "a normal and a distance, such as 0,0,1,-2.5, or the lower and the upper corner of a box, \
         such as 0,0,0,1,1,1"
            .into()
    })
}

/// Parses an axis to look along.
pub(crate) fn along(text: &str) -> Result<Along, String> {
    Along::of_name(text).ok_or_else(|| "an axis: x, y, z, -x, -y or -z".into())
}

/// Value of `--slice`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SlicePlane {
    /// The axis across which the plane lies.
    pub(crate) along: Along,
    /// The plane's coordinate along the axis.
    pub(crate) at: f64,
}

impl SlicePlane {
    /// Returns a point of the plane.
    pub(crate) fn through(&self) -> DVec3 {
        self.along.axis() * self.at
    }
}

/// Parses `x=V`, `y=V` or `z=V`.
pub(crate) fn slice(text: &str) -> Result<SlicePlane, String> {
    let parsed = text.split_once('=').and_then(|(axis, at)| {
        let axis = axis.trim();
        let along = Along::of_name(axis).filter(|_| !axis.starts_with('-'))?;
        let at = finite(at.trim()).ok()?;
        Some(SlicePlane { along, at })
    });
    parsed.ok_or_else(|| "an axis and a coordinate along it, such as z=0.5".into())
}

/// Value of `--window`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WindowBox {
    pub(crate) window: Window,
    /// Least and greatest coordinate along the line of sight, if given.
    pub(crate) depth: Option<[f64; 2]>,
}

/// Parses `x0,x1,y0,y1[,z0,z1]`.
pub(crate) fn window(text: &str) -> Result<WindowBox, String> {
    let parsed = match finite_numbers(text).as_deref() {
        Some(&[a, b, c, d]) => Some(([a, b], [c, d], None)),
        Some(&[a, b, c, d, e, f]) => Some(([a, b], [c, d], Some([e, f]))),
        _ => None,
    };
    let rises = |[a, b]: [f64; 2]| a < b && (b - a).is_finite();
    let is_window = |(across, upwards, depth): &([f64; 2], [f64; 2], Option<[f64; 2]>)| {
        rises(*across) && rises(*upwards) && depth.is_none_or(rises)
    };
    let made = parsed.filter(is_window).map(|(across, upwards, depth)| {
        let window = Window { across, upwards };
        WindowBox { window, depth }
    });
    made.ok_or_else(|| {
        "the least and the greatest coordinate across and upwards, such as 0,10,0,5, and along the line of sight if \
         wanted, such as 0,10,0,5,4,6"
            .into()
    })
}

/// Parses `WxH`.
pub(crate) fn size(text: &str) -> Result<[usize; 2], String> {
    let parsed = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    match parsed {
        Some([w, h]) if (1..=65_535).contains(&w) && (1..=65_535).contains(&h) => Ok([w, h]),
        _ => Err("a width and a height from 1 to 65535, such as 1024x768".into()),
    }
}

/// Parses the counts `X,Y,Z`.
pub(crate) fn dims(text: &str) -> Result<[usize; 3], String> {
    let parsed: Result<Vec<usize>, _> = text.split([',', 'x']).map(|t| t.trim().parse()).collect();
    match parsed.ok().and_then(|v| <[usize; 3]>::try_from(v).ok()) {
        Some(v) if v.iter().all(|&n| n > 0) => Ok(v),
        _ => Err("three positive counts, such as 256,256,128".into()),
    }
}

/// Parses `c_min,c_max`.
pub(crate) fn thresholds(text: &str) -> Result<[f32; 2], String> {
    let parsed: Result<Vec<f32>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match parsed.ok().and_then(|v| <[f32; 2]>::try_from(v).ok()) {
        Some([low, high]) if low >= 0.0 && low <= high && high.is_finite() => Ok([low, high]),
        _ => Err("two numbers from 0 up, the second not less, such as 0.3,2.0".into()),
    }
}

/// Parses `NEAR,FAR`: distances of two planes.
pub(crate) fn near_and_far(text: &str) -> Result<[f64; 2], String> {
    let parsed: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match parsed.ok().and_then(|v| <[f64; 2]>::try_from(v).ok()) {
        Some([near, far]) if near < far && far.is_finite() && near.is_finite() => Ok([near, far]),
        _ => Err("two numbers, the second greater, such as 0.1,100".into()),
    }
}

/// Parses `NAME` or `NAME,F`: a field by which points are moved, and its factor.
pub(crate) fn displacement(text: &str) -> Result<Displacement, String> {
    let (field, factor) = match text.rsplit_once(',') {
        Some((field, factor)) => (field, factor.trim().parse::<f64>().ok()),
        None => (text, Some(1.0)),
    };
    let factor = factor.filter(|factor| factor.is_finite() && !field.is_empty());
    let factor = factor.ok_or("the name of a vector field, or NAME,F with a finite number F")?;
    Ok(Displacement {
        field: field.to_owned(),
        factor,
    })
}

/// Parses a finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err("a finite number above 0".into()),
    }
}

/// Parses a number between 0 and 1.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v < 1.0 => Ok(v),
        _ => Err("a number above 0 and below 1".into()),
    }
}

/// Parses a number of bytes, perhaps with k, M or G behind it: thousands, millions, thousands of millions.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the number is between 1 and 1e15"
)]
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let (number, factor) = match text.strip_suffix(['k', 'K', 'M', 'G']) {
        None => (text, 1.0),
        Some(number) if text.ends_with('M') => (number, 1e6),
        Some(number) if text.ends_with('G') => (number, 1e9),
        Some(number) => (number, 1e3),
    };
    match number.parse::<f64>().map(|number| number * factor) {
        Ok(bytes) if (1.0..=1e15).contains(&bytes) => Ok(bytes as u64),
        _ => Err("a number of bytes above 0, such as 20M".into()),
    }
}

/// Parses a range of values `LO,HI`.
pub(crate) fn range(text: &str) -> Result<[f64; 2], String> {
    match finite_numbers(text).and_then(|v| <[f64; 2]>::try_from(v).ok()) {
        Some([lo, hi]) if lo < hi && lo.is_finite() && hi.is_finite() => Ok([lo, hi]),
        _ => Err("two finite numbers, the lower one first, such as 0,1".into()),
    }
}

/// Parses a finite number.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err("a finite number".into()),
    }
}

/// Parses the softness of shadows in degrees.
pub(crate) fn softness(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (0.0..=MAX_SOFTNESS_DEG).contains(&v) => Ok(v),
        _ => Err(format!("degrees from 0 to {MAX_SOFTNESS_DEG}")),
    }
}

/// Parses a field of view in degrees.
pub(crate) fn fov(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if (1.0..=179.0).contains(&v) => Ok(v),
        _ => Err("degrees from 1 to 179".into()),
    }
}

/// Parses a tolerance.
pub(crate) fn tolerance(text: &str) -> Result<f32, String> {
    let value = match text.split_once('/') {
        Some((a, b)) => a
            .parse::<f32>()
            .ok()
            .zip(b.parse::<f32>().ok())
            .map(|(a, b)| a / b),
        None => text.parse::<f32>().ok(),
    };
    match value {
        Some(v) if v > 0.0 && v < 1.0 => Ok(v),
        _ => Err("a number between 0 and 1, such as 0.004 or 1/255".into()),
    }
}

/// Parses a cut-off radius.
pub(crate) fn cutoff(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if v > 0.0 && v <= 7.0 => Ok(v),
        _ => Err("standard deviations, above 0 and at most 7".into()),
    }
}

/// Parses a variance in square pixels.
pub(crate) fn variance(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(v) if v >= 0.0 && v.is_finite() => Ok(v),
        _ => Err("a finite number from 0 up".into()),
    }
}
