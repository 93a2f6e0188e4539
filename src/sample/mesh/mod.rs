//! Turns meshes into surfels, spread evenly over the surface. Each has the shape of its cell and the colour of
//! the texture under it.
//!
//! 1. Triangles are cut into pieces, small compared with the distance between surfels.
//! 2. One site per surfel is placed along a curve through the pieces, one in each stretch of equal area.
//! 3. Pieces go to their nearest site and sites to their pieces' centroid, several times (Lloyd's relaxation).
//!    A site across a sharp edge, on the back of a sheet or on another component counts as far away.
//! 4. The pieces of a site are its cell. The surfel lies at the cell's centroid, in the plane of its mean
//!    normal. It has the cell's variance plus a blur, and the total area of the pieces.
//!
//! Surfels for viewers of splats are spread more densely at first. `fewer` merges those that look alike, and `composited`
//! solves for colours that show the surface's own where splats hide one another.
//!
//! Every piece belongs to one cell, so no triangle vanishes, however small. The areas of all cells add up to
//! that of the mesh. Meshes finer than the surfels are averaged like textures.

mod cells;
mod composited;
mod coverage;
mod fewer;
mod grid;
mod lines;
mod normals;
mod paint;
mod pieces;
mod spread;
mod squares;
mod surface;
mod surfels;
mod texture;

use crate::data::mesh::Mesh;
use crate::error::{Error, Hint, Result};
use crate::math::narrowed;
use crate::math::{normal_code, normal_of_code};
use crate::scene::{Colour, MAX_OPACITY, Particles, PointVolume, Strength};
use crate::task::Task;

pub use crate::sample::report::{CompositedReport, MeshReport};
use cells::Cells;
use composited::Look;
use coverage::Ripple;
use normals::Normals;
use paint::Paints;
pub use spread::{pixels_per_area, share_out, surfel_count};
use squares::Squares;
use surface::{Kind, Surface, area};
use surfels::{FAINTEST, Surfel};

/// Default standard deviation of a surfel over the spacing.
pub const SURFEL_WIDTH: f64 = 0.6;

/// Default standard deviation over the spacing of surfels that viewers composite as splats.
///
/// This renderer averages overlapping surfels, a viewer of splats composites them: the nearer hides its neighbours. Wide
/// kernels therefore blur a surface's colours and its outline. Narrow ones let through what is behind: 5 % at this width, 8 %
/// at .5, 3 % at .6. docs/surfels.md has the errors of pictures.
pub const SPLAT_WIDTH: f64 = 0.55;

/// Greatest number of surfels of a mesh. Sampling takes some 800 bytes for each.
pub const MOST_SURFELS: usize = 200_000_000;

/// Name of the mesh in errors, before the file's name is known.
pub(super) const THE_MESH: &str = "mesh";

/// Number of points at which the evenness of a mesh's surfels is measured.
const RIPPLE_POINTS: usize = 1 << 14;

/// Options for spreading surfels.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshOptions {
    /// Number of surfels.
    pub spread: Spread,
    /// Standard deviation over spacing; see [`SURFEL_WIDTH`].
    pub kernel_width: f64,
    /// True for viewers that composite surfels as splats, the nearer before the farther, instead of averaging them.
    /// Surfels are then small where the surface's colours change and large elsewhere, about as many as
    /// [`spread`](Self::spread) asks for. Their colours are solved so that the composited picture has the surface's.
    pub composited: bool,
    /// Seed of the spread. Another seed gives another spread, as even; the same seed gives the same.
    pub seed: u64,
    /// Receives the progress of the work, and may cancel it.
    pub task: Option<Task>,
}

impl Default for MeshOptions {
    fn default() -> Self {
        Self {
            spread: Spread::Automatic,
            kernel_width: SURFEL_WIDTH,
            composited: false,
            seed: 0,
            task: None,
        }
    }
}

/// Cosine of half a degree. If all surfels' normals are nearer than that to their surface's, no separate
/// normals are stored.
const SAME_NORMAL: f32 = 0.999_96;

/// Number of surfels for a surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Spread {
    /// One for each texel of the finest texture, by texels per area. Their spacing is at most 1/1000 of the
    /// bounding box's diagonal, and their number at most a million.
    #[default]
    Automatic,
    /// The same, but no more than this per unit area \[1/length²\]: [`pixels_per_area`] returns the density
    /// that a picture shows.
    NoDenser(f64),
    /// The same, and no more than a number in total: the mesh's share of a scene's surfels ([`share_out`]).
    Within {
        /// Greatest number of surfels per unit area \[1/length²\].
        density: f64,
        /// Greatest number of surfels in total.
        count: usize,
    },
    /// Surfels per unit area \[1/length²\].
    Density(f64),
    /// Square root of the area of a surfel \[length\].
    Spacing(f64),
    /// Number of surfels on the whole mesh.
    Count(usize),
}

/// Surfels of a mesh, and a report on their sampling.
#[derive(Debug, Clone)]
pub struct SampledMesh {
    /// One volume for each kind of surface that occurs (opaque or translucent, seen from one side or from
    /// both). Then one of all lines and points.
    pub volumes: Vec<PointVolume>,
    /// Report on the sampling.
    pub report: MeshReport,
}

/// Spreads surfels over a mesh.
///
/// - Opaque materials become a [`Strength::Surface`]; alpha is ignored. With a mask, the area is that part of
///   the cell where alpha (of texture and material, not of corners) reaches the cut-off.
/// - Blended materials become a [`Strength::Translucent`] with area x -ln(1 - opacity). The opacity is the mean
///   over the cell, at most [`MAX_OPACITY`].
/// - Colours are linear means over the visible part of each cell. Emission of the material is added.
///
/// Lines become rows of round kernels, and points one kernel each. They are some two pixels wide in the picture
/// that `spread` is for ([`Spread::NoDenser`], [`Spread::Within`]), otherwise two thousandths of the bounding
/// box's diagonal. They have the colours of their ends and of the material, and no texture.
///
/// Texture lookups are Gaussian averages over each piece (EWA, Heckbert 1989), so a texture finer than the
/// surfels is filtered, not point-sampled.
///
/// The result depends on the seed, not on the number of threads.
///
/// # Errors
/// The errors of [`Mesh::validate`]; no triangle with an area; numbers that are not positive; more than
/// [`MOST_SURFELS`]; work that was cancelled.
pub fn surfels(mesh: &Mesh, options: &MeshOptions) -> Result<SampledMesh> {
    let advice = || format!("{SURFEL_WIDTH} is the default for surfels");
    super::options::check_kernel_width(options.kernel_width, advice)?;
    check_size(mesh)?;
    mesh.validate()?;
    let mut surface = Surface::new(mesh);
    let whole = surface.area();
    let marks = lines::kernels(mesh, options.spread);
    if let (Some(marks), false) = (&marks, whole > 0.0) {
        return Ok(SampledMesh {
            report: MeshReport {
                triangle_count: mesh.triangle_count(),
                mark_count: marks.particles.len(),
                ..MeshReport::default()
            },
            volumes: vec![marks.clone()],
        });
    }
    if !(whole > 0.0) {
        return Err(Error::invalid(
            THE_MESH,
            "triangles",
            "at least one with an area",
            format!("{} without", mesh.triangle_count()),
            Hint::LookAtFile,
        ));
    }
    let count = spread::count(&surface, options.spread)?;
    let finer = match options.composited {
        true => spread::finer(&surface, count),
        false => 1,
    };
    // From here on lengths are in spacings of the first surfels.
    surface.measure_in(surface.unit * (whole / (count * finer) as f64).sqrt());
    let whole = surface.area();
    let mut report = MeshReport {
        triangle_count: mesh.triangle_count(),
        area: whole * surface.unit * surface.unit,
        ..MeshReport::default()
    };
    let faults = surface.faults;
    report.find(
        faults.missing,
        "triangles",
        "a corner or the material does not exist",
    );
    report.find(faults.not_finite, "triangles", "a corner is not finite");
    report.find(faults.empty, "triangles", "without area");

    let mut is_used = vec![false; mesh.materials.len()];
    for triangle in surface.kinds.iter().flatten() {
        is_used[mesh.parts[triangle.part as usize].material] = true;
    }
    let paints = Paints::new(mesh, &is_used);
    let normals = Normals::new(&surface, &is_used);
    let looks = (&paints, &normals);
    let mut volumes = Vec::new();
    let mut ripple = Ripple::default();
    let mut look = Look::default();
    let mut losses = Losses::default();
    let task = options.task.as_ref();
    for (kind, triangles) in Kind::ALL.into_iter().zip(&surface.kinds) {
        if triangles.is_empty() {
            continue;
        }
        let share = area(triangles) / whole;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let wanted = ((count as f64 * share).round() as usize).max(1);
        let first = finer * wanted;
        let width = options.kernel_width;
        let squares = Squares::new(&surface, triangles, options.seed);
        let rest = &squares.rest;
        let left = first.saturating_sub(squares.count).max(1);
        let cells = Cells::new(&surface, rest, left, options.seed, task)?;
        let mut surfels = surfels::surfels(&surface, rest, &cells, looks, width, task)?;
        surfels.extend(squares.surfels(&surface, looks, width));
        let each = area(triangles) / RIPPLE_POINTS as f64;
        let mut points = coverage::points(&cells.pieces, rest, each);
        points.extend(squares.points(&surface, each));
        drop(cells);
        let of_kind = Ripple::of(&surfels, &points);
        ripple.count += of_kind.count;
        ripple.squares += of_kind.squares;
        ripple.greatest = ripple.greatest.max(of_kind.greatest);
        if options.composited {
            let few = match finer {
                1 => surfels.clone(),
                _ => fewer::merged(&surfels, wanted, width, task)?,
            };
            let first = std::mem::replace(&mut surfels, few);
            if !kind.is_pane {
                let of_kind = composited::solve(&mut surfels, &first, task)?;
                // Surfels that are not merged are looked at in their own middles, where they always cover.
                if finer > 1 {
                    look.append(of_kind);
                }
            }
        }
        let volume = volume(&surface, kind, &surfels, &mut losses);
        report.surfel_count += volume.particles.len();
        volumes.push(volume);
    }
    report.find(losses.colourless, "surfels", "colour not finite");
    report.find(losses.faint, "surfels", "less than 1/255 of them is there");
    report.find(
        losses.out_of_range,
        "surfels",
        "beyond single precision; rescale",
    );
    volumes.retain(|v| !v.particles.is_empty());
    if volumes.is_empty() {
        return Err(Error::invalid(
            THE_MESH,
            "surfels",
            "at least one that can be drawn",
            report.warnings().join(", "),
            Hint::LookAtFile,
        ));
    }
    report.spacing = (report.area / report.surfel_count as f64).sqrt();
    report.ripple = (ripple.squares / ripple.count.max(1) as f64).sqrt();
    report.greatest_ripple = ripple.greatest;
    report.composited = look.report();
    report.mark_count = marks.as_ref().map_or(0, |marks| marks.particles.len());
    volumes.extend(marks);
    Ok(SampledMesh { volumes, report })
}

/// Numbers of surfels that cannot be drawn.
#[derive(Debug, Default)]
struct Losses {
    colourless: usize,
    faint: usize,
    out_of_range: usize,
}

/// Checks that corners and triangles fit 32-bit indices.
fn check_size(mesh: &Mesh) -> Result<()> {
    let corners: usize = mesh.parts.iter().map(|part| part.positions.len()).sum();
    let greatest = corners.max(mesh.triangle_count());
    if u32::try_from(greatest).is_ok() {
        return Ok(());
    }
    Err(Error::invalid(
        THE_MESH,
        "corners and triangles",
        "fewer than 2^32",
        greatest.to_string(),
        "split the mesh",
    ))
}

/// Converts surfels to world units and to the types that the scene stores.
fn volume(surface: &Surface, kind: Kind, surfels: &[Surfel], losses: &mut Losses) -> PointVolume {
    let mut positions = Vec::with_capacity(surfels.len());
    let mut tangents = Vec::with_capacity(surfels.len());
    let mut strengths = Vec::with_capacity(surfels.len());
    let mut colours = Vec::with_capacity(surfels.len());
    let mut normals = Vec::with_capacity(surfels.len());
    let mut is_flat = true;
    for surfel in surfels {
        if surfel.unpainted >= surfel.area {
            losses.colourless += 1;
            continue;
        }
        if !(surfel.share >= FAINTEST) {
            losses.faint += 1;
            continue;
        }
        let area = surfel.area * surface.unit * surface.unit;
        let strength = if kind.is_pane {
            -(-surfel.share.min(MAX_OPACITY)).ln_1p() * area
        } else {
            surfel.share * area
        };
        let strength = narrowed(strength);
        let [t1, t2] = surfel.tangents.map(|t| (t * surface.unit).as_vec3());
        let colour = surfel.colour.map(narrowed);
        let is_sound = |x: &f32| x.is_finite();
        let shape = [t1.x, t1.y, t1.z, t2.x, t2.y, t2.z];
        if !(strength >= f32::MIN_POSITIVE
            && strength.is_finite()
            && shape.iter().all(is_sound)
            && colour.iter().all(is_sound)
            && t1.length_squared().min(t2.length_squared()) >= f32::MIN_POSITIVE)
        {
            losses.out_of_range += 1;
            continue;
        }
        positions.push(surface.world(surfel.centre));
        tangents.push(shape);
        strengths.push(strength);
        colours.push(colour);
        let code = normal_code(surfel.reflecting);
        let plane = t1.cross(t2).try_normalize().unwrap_or_default();
        is_flat &= normal_of_code(code).dot(plane) > SAME_NORMAL;
        normals.push(code);
    }
    PointVolume {
        particles: Particles::Surfels {
            positions,
            tangents,
            is_one_sided: kind.is_one_sided,
        },
        strength: if kind.is_pane {
            Strength::Translucent(strengths)
        } else {
            Strength::Surface(strengths)
        },
        colour: Colour::PerParticle(colours),
        values: None,
        transfer_function: None,
        boundary: None,
        normals: (!is_flat).then_some(normals),
        local_models: None,
    }
}
