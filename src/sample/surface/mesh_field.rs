//! Makes surfels of surfaces with fields: each carries a value and takes its colour from a transfer function.
//!
//! The value of a surfel is the mean of the field over its cell. The field is linear between corners or
//! constant in each triangle. An automatic function or a named colour map sets the colours alone: the surface
//! is opaque. A function of the caller's sets opacities, too, if any of them is less than one; they apply to
//! the surface seen head-on.

use glam::DVec3;

use crate::data::association::Association;
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{AlphaMode, Material, Mesh, MeshPart};
use crate::error::Result;
use crate::math::narrowed;
use crate::sample::field::choice::{has_choice, shown_field};
use crate::sample::function::under_function;
use crate::sample::mesh::{self, MeshOptions};
use crate::sample::options::{SampleOptions, TransferChoice};
use crate::sample::report::SampleReport;
use crate::sample::sampled::SampledScene;
use crate::sample::scalar::{TakenScalar, check_len, take_scalar};
use crate::scene::{
    Colour, MAX_OPACITY, PointVolume, Strength, TransferFunction, ValueSample, Values,
};

/// Optical depth from which on a surface is opaque: it absorbs 99 % of the light.
const OPAQUE_DEPTH: f64 = 4.605;

/// Returns the field that a surface shows: the one named in the options, or the default one of a surface
/// without colours of its own.
///
/// # Errors
/// A surface without fields if one is named.
pub(in crate::sample) fn shown(
    dataset: &Dataset,
    options: &SampleOptions,
) -> Result<Option<String>> {
    let Geometry::Mesh(mesh) = &dataset.geometry else {
        return Ok(None);
    };
    if dataset.fields.is_empty() {
        return Ok(None);
    }
    if let Some(field) = &options.field {
        return Ok(Some(field.clone()));
    }
    if mesh.has_colours() || !has_choice(dataset) {
        return Ok(None);
    }
    shown_field(dataset, options).map(Some)
}

/// Values of a mesh under the function that shows them.
struct Valued {
    values: Values,
    function: TransferFunction,
    report: SampleReport,
    /// True for values of corners; false for values of triangles.
    of_corners: bool,
}

/// Returns the report on a mesh's field without making surfels: the field, and the values from which a function
/// of several meshes is chosen.
///
/// # Errors
/// A field that is missing or has the wrong length.
pub(in crate::sample) fn report(
    dataset: &Dataset,
    field: &str,
    options: &SampleOptions,
) -> Result<SampleReport> {
    let (association, values) = dataset.scalar(field)?;
    let taken = TakenScalar {
        name: field.to_owned(),
        association,
        values,
    };
    let mut report = under_field(dataset, taken, options)?.report;
    report.unit = dataset.unit(field).map(str::to_owned);
    Ok(report)
}

fn under_field(dataset: &Dataset, taken: TakenScalar, options: &SampleOptions) -> Result<Valued> {
    let Geometry::Mesh(own) = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let of_corners = taken.association == Association::Nodes;
    let expected = match of_corners {
        true => own.parts.iter().map(|part| part.positions.len()).sum(),
        false => own.triangle_count(),
    };
    check_len(dataset, &taken, expected)?;
    let mut report = SampleReport {
        field: Some(taken.name.clone()),
        sample_count: own.triangle_count(),
        ..SampleReport::default()
    };
    let areas = areas(own, of_corners);
    let sample = |values: &Values| ValueSample::of_body(values, &areas, &[]);
    let extent = dataset
        .bounds()
        .map_or(1.0, |(low, high)| (high - low).max_element());
    let (values, function) = under_function(taken.values, sample, extent, &mut report, options)?;
    Ok(Valued {
        values,
        function,
        report,
        of_corners,
    })
}

/// Makes the surfels of a mesh, coloured by the values of a field.
///
/// # Errors
/// A field that is missing or has the wrong length; no triangle with values; those of [`mesh::surfels`].
pub(in crate::sample) fn scene(
    mut dataset: Dataset,
    field: &str,
    mesh_options: &MeshOptions,
    options: &SampleOptions,
) -> Result<SampledScene> {
    let taken = take_scalar(&mut dataset, field)?;
    let Valued {
        values,
        function,
        mut report,
        of_corners,
    } = under_field(&dataset, taken, options)?;
    let Geometry::Mesh(own) = &dataset.geometry else {
        unreachable!("the caller matched the geometry")
    };
    let [low, high] = values.finite_range().unwrap_or([0.0, 1.0]).map(narrowed);
    let width = if high > low { high - low } else { 1.0 };
    // The mean of colours is taken in f64 and stored in f32, like values.
    let share = |i: usize| (values.get(i) - low) / width;
    let (mesh, unknown) = coloured(own, of_corners, share);
    report.leave_out(unknown, "triangles", "value not finite");
    // Values of a field are no codes that viewers composite.
    let mesh_options = MeshOptions {
        composited: false,
        ..mesh_options.clone()
    };
    let sampled = mesh::surfels(&mesh, &mesh_options)?;
    let is_own = matches!(
        options.function.transfer,
        TransferChoice::Given(_) | TransferChoice::File(_) | TransferChoice::Text(_)
    );
    let depth_of = |value: f32| match options.surface {
        Some(opacity) => -(-opacity).ln_1p(),
        None => f64::from(function.classify(value)[3]) * function.unit_distance(),
    };
    let is_seen_through = |i: usize| depth_of(values.get(i)) < OPAQUE_DEPTH;
    let is_clear = match options.surface {
        Some(opacity) => opacity < 1.0,
        None => is_own && (0..values.len()).any(is_seen_through),
    };
    let depth = is_clear.then_some(depth_of);
    let volumes = sampled.volumes.into_iter();
    let volumes: Vec<PointVolume> = volumes
        .map(|volume| valued(volume, &function, [low, width], depth))
        .collect();
    report.particle_count = sampled.report.surfel_count;
    report
        .findings
        .extend(sampled.report.findings.iter().cloned());
    report.mesh = Some(sampled.report);
    Ok(SampledScene { volumes, report })
}

/// Returns the area of each triangle, or for each corner a third of the triangles around it \[length²\].
fn areas(mesh: &Mesh, of_corners: bool) -> Vec<f32> {
    let mut all = Vec::new();
    for part in &mesh.parts {
        let mut corners = vec![0.0; part.positions.len()];
        for triangle in &part.triangles {
            let [a, b, c] = triangle.map(|i| part.positions[i as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            match of_corners {
                true => triangle
                    .iter()
                    .for_each(|&i| corners[i as usize] += area / 3.0),
                false => all.push(narrowed(area)),
            }
        }
        if of_corners {
            all.extend(corners.into_iter().map(narrowed));
        }
    }
    all
}

/// Returns the mesh with its values as colours, each of its materials replaced by an opaque one. The number
/// counts the triangles without a value.
fn coloured(mesh: &Mesh, of_corners: bool, share: impl Fn(usize) -> f32) -> (Mesh, usize) {
    let materials = mesh.materials.iter().map(|own| Material {
        is_double_sided: own.is_double_sided,
        alpha: AlphaMode::Opaque,
        base_colour: [1.0; 4],
        ..Material::default()
    });
    let mut parts = Vec::new();
    let (mut first_corner, mut first_triangle, mut unknown) = (0, 0, 0);
    for own in &mesh.parts {
        let of = |i: usize| {
            let share = share(i);
            [share, share, share, 1.0]
        };
        let mut part = MeshPart {
            material: own.material,
            is_flat: own.is_flat,
            ..MeshPart::default()
        };
        let is_known = |colour: &[f32; 4]| colour[0].is_finite();
        if of_corners {
            part.positions.clone_from(&own.positions);
            part.normals.clone_from(&own.normals);
            part.colours = (0..own.positions.len())
                .map(|i| of(first_corner + i))
                .collect();
            let colours = &part.colours;
            let is_whole = |t: &&[u32; 3]| t.iter().all(|&i| is_known(&colours[i as usize]));
            part.triangles = own.triangles.iter().filter(is_whole).copied().collect();
        } else {
            // Each triangle gets corners of its own, because values jump from triangle to triangle.
            for (i, triangle) in own.triangles.iter().enumerate() {
                let colour = of(first_triangle + i);
                if !is_known(&colour) {
                    continue;
                }
                let corner = |&i: &u32| own.positions[i as usize];
                let positions: Vec<DVec3> = triangle.iter().map(corner).collect();
                let next = u32::try_from(part.positions.len()).unwrap_or(u32::MAX);
                part.triangles
                    .push([next, next.saturating_add(1), next.saturating_add(2)]);
                part.positions.extend(positions);
                let normals = triangle.iter().filter_map(|&i| own.normals.get(i as usize));
                part.normals.extend(normals);
                part.colours.extend([colour; 3]);
            }
        }
        unknown += own.triangles.len() - part.triangles.len();
        first_corner += own.positions.len();
        first_triangle += own.triangles.len();
        parts.push(part);
    }
    let mesh = Mesh {
        parts,
        materials: materials.collect(),
        textures: Vec::new(),
    };
    (mesh, unknown)
}

/// Converts surfels whose colours are shares of a range into surfels with these values under a function.
///
/// - `depth`: optical depth at a value, of a surface that is not opaque.
fn valued(
    mut volume: PointVolume,
    function: &TransferFunction,
    [low, width]: [f32; 2],
    depth: Option<impl Fn(f32) -> f64>,
) -> PointVolume {
    let Colour::PerParticle(shares) = &volume.colour else {
        return volume;
    };
    let values: Vec<f32> = shares.iter().map(|rgb| low + width * rgb[0]).collect();
    if let (Some(depth), Strength::Surface(areas)) = (depth, &volume.strength) {
        let most = -(-MAX_OPACITY).ln_1p();
        let each = areas.iter().zip(&values);
        let strengths =
            each.map(|(area, value)| narrowed(f64::from(*area) * depth(*value).min(most)));
        volume.strength = Strength::Translucent(strengths.collect());
    }
    volume.values = Some(Values::F32(values));
    volume.colour = Colour::Classified;
    volume.transfer_function = Some(function.clone());
    volume
}
