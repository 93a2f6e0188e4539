//! Makes the shadows of a scene: for each light, a grid of the optical depth of volumes and a map of the
//! nearest opaque surface. Both back ends read them in the stage `light`.
//!
//! | file | subject |
//! |---|---|
//! | `occluder.rs` | particles as a light sees them |
//! | `grid.rs` | optical depths of volumes |
//! | `map.rs` | opaque surfaces |
//! | `lookup.rs` | the transmittance to a particle |
//!
//! Rows of cells are divided into strips. A strip is filled by one thread, from the particles that touch it in
//! their order, so the numbers do not depend on the number of threads.

mod grid;
mod lookup;
mod map;
mod occluder;

use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::blocks::{BlockedScene, BlockedVolume, Rule, cull};
use crate::error::Result;
use crate::frame::shadows::{LightGrid, ShadowGrids};
use crate::record::{BlockView, ChoiceUniform, LightShadow};
use crate::scene::Shadows;
use crate::task::{Task, check};
use crate::view::{Camera, ClipPlane, Projection};
use grid::Grid;
pub(crate) use lookup::{
    GREATEST_LEAN, SHADOW_DIRECTIONS, SHADOW_TAPS, STEEPEST_SHADOW, kernel_transmittance,
    surfel_transmittance,
};
use map::Map;
use occluder::{Axes, REACH, Run};

/// Words of all grids together, without those of maps: 64 MiB.
const MOST_WORDS: f64 = (1 << 24) as f64;
/// The same for lights with a size. Their grids are sheared once for each direction; the sheared ones have at most [`MOST_WORDS`].
const MOST_SOFT_WORDS: f64 = (1 << 22) as f64;
/// Greatest distance of a direction from the middle of a light with a size, in its standard deviations.
const FARTHEST_TAP: f64 = 2.42;
/// Greatest number of texels of a map along a side, for one light; maps of several lights have as many in all: 16 MiB.
const MOST_TEXELS: f64 = 2048.0;
/// Greatest number of cells along a side.
const MOST_CELLS: f64 = 1024.0;
/// Side of a cell in standard deviations of the finer quarter of the kernels. Kernels have overlapping tails, so
/// that sums of many are smoother than one.
const CELL_SIGMAS: f64 = 1.0;
/// Side of a texel in standard deviations of the median surfel.
const TEXEL_SIGMAS: f64 = 1.0;
/// Greatest number of additions to a grid or a map, which bounds its time. If kernels are much larger than
/// the finest ones, cells are larger.
const MOST_ADDITIONS: f64 = 5e8;
/// Most blocks whose particles are made at a time. Surfels of opaque surfaces are held all together, 52 bytes each.
const MOST_BLOCKS: usize = 2048;

/// Lights and rules by which the shadows of a scene are made.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShadowRequest<'a> {
    /// Unit vectors toward the lights, world.
    pub(crate) directions: Vec<DVec3>,
    pub(crate) shadows: Shadows,
    /// Rules of classification.
    pub(crate) choice: &'a ChoiceUniform,
    pub(crate) clip: &'a [ClipPlane],
    pub(crate) task: Option<&'a Task>,
}

/// Makes the shadows of all lights.
///
/// # Errors
/// Work that was cancelled.
pub(crate) fn make_shadows(
    scene: &BlockedScene,
    request: &ShadowRequest<'_>,
) -> Result<ShadowGrids> {
    let mut out = ShadowGrids::default();
    for direction in &request.directions {
        check(request.task)?;
        let light = light_grid(scene, request, *direction, &mut out.words)?;
        out.lights.push(light);
    }
    // A binding needs a word.
    out.words.resize(out.words.len().max(1), 0.0);
    Ok(out)
}

/// A volume with its blocks that are shown, as the light sees them.
struct Shown<'a> {
    volume: &'a BlockedVolume,
    rule: Rule,
    views: Vec<BlockView>,
}

/// Makes the grid and the map of a light, and appends their words.
fn light_grid(
    scene: &BlockedScene,
    request: &ShadowRequest<'_>,
    direction: DVec3,
    words: &mut Vec<f32>,
) -> Result<LightGrid> {
    let away = -direction;
    let across = away.any_orthonormal_vector();
    let axes = DMat3::from_cols(across, away.cross(across), away).transpose();
    let camera = Camera {
        projection: Projection::Orthographic,
        eye: middle_of(scene),
        camera_from_world: axes,
        focal_px: DVec2::ONE,
        centre_px: DVec2::ZERO,
        width: 1,
        height: 1,
    };
    let mut shown = Vec::new();
    for volume in scene.data() {
        let mut views = Vec::new();
        cull(volume, &camera, None, request.choice, &mut views);
        let rule = Rule::of(volume);
        views.retain(|view| !is_clipped(volume, view, request.clip));
        shown.push(Shown {
            volume,
            rule,
            views,
        });
    }
    let is_surface = |shown: &&Shown<'_>| matches!(shown.rule, Rule::Surface { .. });
    let (surfaces, volumes): (Vec<&Shown<'_>>, Vec<&Shown<'_>>) =
        shown.iter().partition(is_surface);
    let of_volumes = Extent::of(&volumes, &axes);
    let of_surfaces = Extent::of(&surfaces, &axes);
    let mut light = LightGrid {
        corner: camera.eye,
        axes,
        cell: 1.0,
        shadow: LightShadow::default(),
    };
    let lights = request.directions.len().max(1) as f64;
    let most_texels = (MOST_TEXELS / lights.sqrt()).floor();
    let softness = request.shadows.softness_deg.to_radians().tan();
    light.shadow.softness = softness as f32;
    let mut corner = Vec3::ZERO;
    if let Some(extent) = &of_volumes {
        let most = if softness > 0.0 {
            MOST_SOFT_WORDS
        } else {
            MOST_WORDS
        };
        let cells = Cells::new(extent, most / lights, softness);
        light.cell = cells.side;
        light.corner = camera.eye + axes.transpose() * cells.corner.as_dvec3();
        corner = cells.corner;
        light.shadow.size = cells.size;
        light.shadow.first = words.len() as u32;
        let axes_of_cells = Axes {
            corner,
            per_unit: (1.0 / cells.side) as f32,
        };
        let mut grid = Grid::new(cells.size);
        for shown in &volumes {
            for run in shown.views.chunks(MOST_BLOCKS) {
                check(request.task)?;
                let run = Run::new(shown.volume, shown.rule, run, &camera, request.clip);
                grid.add(&run.kernels(&axes_of_cells));
            }
        }
        grid.finish(light.shadow.softness, request.task)?;
        words.append(&mut grid.depths);
    }
    if let Some(extent) = &of_surfaces {
        if of_volumes.is_none() {
            light.cell = extent.texel(most_texels);
        }
        let per_unit = 1.0 / light.cell;
        let texel = extent.texel(most_texels);
        let scale = light.cell / texel;
        light.shadow.map_scale = scale as f32;
        let lower = (extent.lower.truncate() - corner.truncate()) * per_unit as f32;
        let size = (extent.upper - extent.lower).truncate().as_dvec2() / texel;
        light.shadow.map_size = [size.x, size.y].map(|n| n.ceil().clamp(1.0, most_texels) as u32);
        light.shadow.map_corner = lower.into();
        light.shadow.map_first = words.len() as u32;
        light.shadow.bias = (texel * per_unit) as f32;
        let axes_of_texels = Axes {
            corner: Vec3::new(extent.lower.x, extent.lower.y, corner.z),
            per_unit: (1.0 / texel) as f32,
        };
        let mut all = Vec::new();
        for shown in &surfaces {
            for run in shown.views.chunks(MOST_BLOCKS) {
                check(request.task)?;
                let run = Run::new(shown.volume, shown.rule, run, &camera, request.clip);
                all.append(&mut run.kernels(&axes_of_texels));
            }
        }
        let map = Map::new(light.shadow.map_size, &all);
        words.extend(map.depths.iter().map(|depth| depth / scale as f32));
    }
    Ok(light)
}

/// Returns a point amid the scene, world units.
fn middle_of(scene: &BlockedScene) -> DVec3 {
    let boxes = scene.data().flat_map(|volume| &volume.blocks).map(|block| {
        let half = block.half_extent.as_dvec3();
        (block.origin - half, block.origin + half)
    });
    let bounds = boxes
        .filter(|(lower, upper)| lower.is_finite() && upper.is_finite())
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    bounds.map_or(DVec3::ZERO, |(lower, upper)| (lower + upper) / 2.0)
}

/// Returns whether a block lies entirely beyond a clip plane.
fn is_clipped(volume: &BlockedVolume, view: &BlockView, clip: &[ClipPlane]) -> bool {
    let block = &volume.blocks[view.block as usize];
    let half = block.half_extent.as_dvec3();
    clip.iter().filter_map(ClipPlane::normalised).any(|plane| {
        let reach = plane.normal.abs().dot(half) + f64::from(REACH * block.max_sigma);
        plane.inside(block.origin) < -reach
    })
}

/// The box around particles as the light sees it, and the sizes of the particles.
struct Extent {
    lower: Vec3,
    upper: Vec3,
    /// Standard deviation of the finer quarter of kernels, world units.
    fine: f64,
    /// The greatest standard deviation of each block, world units, and its number of particles.
    greatest: Vec<(f64, u32)>,
}

impl Extent {
    /// Returns `None` without particles.
    fn of(shown: &[&Shown<'_>], axes: &DMat3) -> Option<Self> {
        let rows = [0, 1, 2].map(|i| axes.row(i).as_vec3().abs());
        let mut lower = Vec3::INFINITY;
        let mut upper = Vec3::NEG_INFINITY;
        let mut fine = Vec::new();
        let mut greatest = Vec::new();
        for (shown, view) in shown
            .iter()
            .flat_map(|s| s.views.iter().map(move |v| (s, v)))
        {
            let block = &shown.volume.blocks[view.block as usize];
            let half = Vec3::from(rows.map(|row| row.dot(block.half_extent)));
            // A piece may lie one more deviation away.
            let reach = half + (REACH + 1.0) * block.max_sigma;
            let origin = Vec3::from(view.origin_camera);
            if !(origin.is_finite() && reach.is_finite()) {
                continue;
            }
            lower = lower.min(origin - reach);
            upper = upper.max(origin + reach);
            let count = block.count;
            let (least, most) = (f64::from(block.min_sigma), f64::from(block.max_sigma));
            fine.push(((least * most).sqrt(), count));
            greatest.push((most, count));
        }
        lower.cmple(upper).all().then(|| Self {
            lower,
            upper,
            fine: quantile(fine, 0.25),
            greatest,
        })
    }

    /// Enlarges cells or texels until adding the particles takes at most [`MOST_ADDITIONS`].
    ///
    /// - `dimensions`: 3 for cells, 2 for texels.
    fn affordable(&self, mut side: f64, dimensions: i32) -> f64 {
        let additions = |side: f64| -> f64 {
            let of = |(sigma, count): &(f64, u32)| {
                f64::from(*count) * (2.0 * f64::from(REACH) * sigma / side + 2.0).powi(dimensions)
            };
            self.greatest.iter().map(of).sum()
        };
        while additions(side) > MOST_ADDITIONS {
            let larger = side * 1.1;
            // From here on, more than a cell for each particle would not help.
            if additions(larger) > 0.99 * additions(side) {
                break;
            }
            side = larger;
        }
        side
    }

    /// Returns the side of a texel of a map, world units.
    fn texel(&self, most: f64) -> f64 {
        let size = f64::from((self.upper - self.lower).truncate().max_element());
        let median = quantile(self.greatest.clone(), 0.5);
        let side = (TEXEL_SIGMAS * median).max(size / most);
        self.affordable(side.max(f64::MIN_POSITIVE), 2)
    }
}

/// Returns the quantile of numbers with weights.
fn quantile(mut of: Vec<(f64, u32)>, share: f64) -> f64 {
    of.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = of.iter().map(|(_, count)| f64::from(*count)).sum();
    let mut sum = 0.0;
    for (value, count) in &of {
        sum += f64::from(*count);
        if sum >= share * total {
            return *value;
        }
    }
    0.0
}

/// The cells of a grid.
struct Cells {
    /// Corner, relative to the light's eye.
    corner: Vec3,
    side: f64,
    size: [u32; 3],
}

impl Cells {
    /// Chooses the side of cells: by the kernels, and so that there are at most `most` words.
    ///
    /// - `softness`: tangent of the light's size.
    fn new(extent: &Extent, most: f64, softness: f64) -> Self {
        let size = (extent.upper - extent.lower).as_dvec3();
        let longest = size.max_element().max(f64::MIN_POSITIVE);
        let side = (CELL_SIGMAS * extent.fine).max(longest / MOST_CELLS);
        let mut side = extent.affordable(side, 3);
        let count = |side: f64| (size / side).ceil().max(DVec3::new(2.0, 2.0, 1.0));
        let sheared = |side: f64| {
            let cells = count(side);
            let reach = FARTHEST_TAP * softness * cells.z;
            (cells + DVec3::new(reach, reach, 1.0)).element_product()
        };
        while (count(side) + DVec3::Z).element_product() > most || sheared(side) > MOST_WORDS {
            side *= 1.02;
        }
        let cells = count(side);
        Self {
            corner: extent.lower,
            side,
            size: [cells.x, cells.y, cells.z].map(|n| n as u32),
        }
    }
}
