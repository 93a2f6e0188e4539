//! Shows the field on clip planes as opaque surfels.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::constants::FAINT_SHARE;
use crate::error::{Error, Result};
use crate::math::narrowed;
use crate::sample::positions::index_u32;
use crate::scene::{Colour, Particles, PointVolume, Strength};
use crate::view::ClipPlane;

/// Greatest distance of a kernel from the plane, in standard deviations along the normal. Kernels beyond add
/// 6e-5 of the kernels' sum on average.
const REACH: f64 = 4.0;

/// Depth of surfels inside the plane, in standard deviations of their kernels along its normal. Without it,
/// rounding would let the plane cut away its own surfels.
const INSIDE: f64 = 0.05;

/// Makes the faces of clip planes through a volume: opaque surfels on each plane that show the field there.
/// Returns `None` if no plane meets a kernel.
///
/// A kernel that a plane crosses is sliced. A Gaussian restricted to the plane is a Gaussian in two dimensions,
/// with the conditional mean and variance:
///
/// - mean: m - V n d / s², s² = nᵀ V n, d the centre's signed distance from the plane,
/// - variance: V - V n nᵀ V / s², of rank two (in factors: L (I - u uᵀ) Lᵀ, u along Lᵀ n),
/// - weight: the kernel's cell volume times exp(-d²/(2 s²)) / (sqrt(2 pi) s) \[length²\].
///
/// Weights and slices sum to the same as cell volumes times kernels: to 1 within the volume, with the same
/// ripple. The surfels are a [`Strength::Surface`], which averages its colours by these areas and covers
/// everything behind it. They have the kernels' values, colours and transfer function, of which only the colour
/// is used.
///
/// Values whose extinction is below a hundredth of the function's greatest have no face: the air around a body
/// is no wall. The fronts of surfels face the side that is cut away; surfels are drawn from both sides. They
/// lie a little inside the plane (a twentieth of the kernel's standard deviation).
///
/// - `planes`: clip planes as [`ClipPlane`] defines them. A face is left out where other planes cut it away.
///   Clip the volume and its faces by the same planes when they are drawn.
///
/// Kernels without a finite value are left out. So are kernels that are flat parallel to a plane: the plane
/// contains them or misses them.
///
/// # Errors
/// A volume that is not classified or consists of surfels; colours that depend on the view; a plane without a
/// direction; errors of [`PointVolume::validate`].
pub fn cut_faces(volume: &PointVolume, planes: &[ClipPlane]) -> Result<Option<PointVolume>> {
    volume.validate()?;
    let Strength::Classified { volumes } = &volume.strength else {
        return refuse("masses or opacities of its own");
    };
    if matches!(volume.particles, Particles::Surfels { .. }) {
        return refuse("surfels");
    }
    if matches!(volume.colour, Colour::Harmonics { .. }) {
        return refuse("colours that depend on the view");
    }
    let Some(values) = &volume.values else {
        return refuse("no values");
    };
    let count = volume.particles.len();
    if u32::try_from(count).is_err() {
        return refuse("more than 4,294,967,295 particles");
    }
    let planes: Vec<ClipPlane> = planes.iter().map(normalised).collect::<Result<_>>()?;
    let extinction = |i: usize| match &volume.transfer_function {
        Some(transfer) => transfer.classify(values.get(i))[3],
        None => 0.0,
    };
    let greatest = volume
        .transfer_function
        .as_ref()
        .map_or(0.0, |t| t.max_extinction(f32::NEG_INFINITY, f32::INFINITY));
    let is_shown = |i: usize| {
        let own = extinction(i);
        values.get(i).is_finite() && own > 0.0 && own >= FAINT_SHARE * greatest
    };

    let mut indices = Vec::new();
    let mut areas = Vec::new();
    let (mut positions, mut tangents) = (Vec::new(), Vec::new());
    for (p, plane) in planes.iter().enumerate() {
        let face = |i: usize| {
            if !is_shown(i) {
                return None;
            }
            let (centre, factor, of_cell) = volume.particles.shape(i);
            let kernel = Kernel {
                centre,
                factor,
                volume: volumes.get(i).map_or(of_cell, |&v| f64::from(v)),
            };
            let slice = slice(&kernel, plane)?;
            let is_left = planes.iter().enumerate().all(|(o, other)| {
                o == p || other.inside(slice.position) >= -REACH * slice.sigma_along(other.normal)
            });
            let is_finite = slice.position.is_finite()
                && slice.area > 0.0
                && slice.area.is_finite()
                && slice.tangents.iter().all(|t| t.is_finite());
            (is_left && is_finite).then_some((i, slice))
        };
        let slices: Vec<(usize, Slice)> = (0..count).into_par_iter().filter_map(face).collect();
        for (i, slice) in slices {
            indices.push(index_u32(i));
            areas.push(slice.area);
            positions.push(slice.position);
            tangents.push(slice.tangents);
        }
    }
    if indices.is_empty() {
        return Ok(None);
    }
    let colour = match &volume.colour {
        Colour::PerParticle(colours) => {
            Colour::PerParticle(indices.iter().map(|&i| colours[i as usize]).collect())
        }
        other => other.clone(),
    };
    Ok(Some(PointVolume {
        particles: Particles::Surfels {
            positions,
            tangents,
            is_one_sided: false,
        },
        strength: Strength::Surface(areas),
        colour,
        values: Some(values.gather(&indices)),
        transfer_function: volume.transfer_function.clone(),
        boundary: None,
        normals: None,
        local_models: None,
    }))
}

fn refuse<T>(found: &str) -> Result<T> {
    Err(Error::invalid(
        "cut faces",
        "volume",
        "kernels of a field with a transfer function",
        found,
        "clip it without faces",
    ))
}

fn normalised(plane: &ClipPlane) -> Result<ClipPlane> {
    plane.normalised().ok_or_else(|| {
        let ClipPlane { normal, distance } = plane;
        Error::invalid(
            "cut faces",
            "clip plane",
            "a normal of finite numbers that is not zero, and a finite distance",
            format!("{},{},{},{distance}", normal.x, normal.y, normal.z),
            "correct the plane",
        )
    })
}

/// A particle: centre, a factor L of V = L Lᵀ, and cell volume.
struct Kernel {
    centre: DVec3,
    factor: DMat3,
    volume: f64,
}

/// The slice of a kernel by a plane.
struct Slice {
    position: DVec3,
    tangents: [f32; 6],
    area: f32,
}

impl Slice {
    /// Returns the standard deviation along a unit vector.
    fn sigma_along(&self, direction: DVec3) -> f64 {
        let [ax, ay, az, bx, by, bz] = self.tangents.map(f64::from);
        let along = [DVec3::new(ax, ay, az), DVec3::new(bx, by, bz)].map(|t| t.dot(direction));
        along[0].hypot(along[1])
    }
}

/// Slices a kernel by a plane with a unit normal; `None` if the plane does not meet the kernel.
fn slice(kernel: &Kernel, plane: &ClipPlane) -> Option<Slice> {
    let along = kernel.factor.transpose() * plane.normal;
    let sigma = along.length();
    let distance = plane.inside(kernel.centre);
    // Phrased so that NaN is left out.
    if !(sigma > 0.0 && distance.abs() <= REACH * sigma) {
        return None;
    }
    let along = along / sigma;
    let share = distance / sigma;
    // L times the directions perpendicular to u lies in the plane, because n . L e = |Lᵀ n| u . e.
    let (e1, e2) = along.any_orthonormal_pair();
    let (mut a, mut b) = (kernel.factor * e1, kernel.factor * e2);
    if a.cross(b).dot(plane.normal) > 0.0 {
        (a, b) = (b, a);
    }
    let mean = kernel.centre - kernel.factor * along * share;
    let density = (-0.5 * share * share).exp() / (std::f64::consts::TAU.sqrt() * sigma);
    Some(Slice {
        position: mean + plane.normal * (INSIDE * sigma),
        tangents: [a.x, a.y, a.z, b.x, b.y, b.z].map(narrowed),
        area: narrowed(kernel.volume * density),
    })
}
