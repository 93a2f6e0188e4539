//! Positions of the nodes of a grid in metres, and its geometry.
//!
//! Longitudes λ and latitudes φ become x = M cos(φ₀) λ and y = M φ, with M the metres of a degree of latitude on a sphere
//! and φ₀ the latitude halfway between the least and the greatest: an equirectangular map, true to scale along φ₀ and
//! along all meridians. Its axes stay straight: a grid of latitudes and longitudes is a rectilinear one. Heights are
//! to the same scale.

use glam::DVec3;
use netcdf_reader::NcDimension;

use super::super::dataset::{CurvilinearBlock, Field, FieldSource, Geometry};
use super::super::vtr::reverse;
use super::NetcdfFile;
use super::axis::{Horizontal, METRES_PER_DEGREE, Vertical, pressure_height};
use crate::error::{Error, Result};
use crate::scene::{Lattice, LatticeSpacing, Values};

/// What share of a grid's width its levels are spread over where they are no lengths.
const LEVEL_SHARE: f64 = 0.1;

/// The places across.
pub(super) struct Plane {
    dims: [usize; 2],
    /// One number for each column and each row, or one of each for each node.
    is_straight: bool,
    x: Vec<f64>,
    y: Vec<f64>,
    /// Whether the numbers are metres.
    is_metric: bool,
    /// Where longitudes are true to scale.
    latitude: Option<f64>,
}

impl Plane {
    /// From one coordinate for each column and each row.
    pub(super) fn axes(kinds: [Option<Horizontal>; 2], x: Vec<f64>, y: Vec<f64>) -> Self {
        let dims = [x.len(), y.len()];
        Self::new(dims, true, kinds, x, y)
    }

    /// From two coordinates for each node, x fastest.
    pub(super) fn nodes(
        dims: [usize; 2],
        kinds: [Option<Horizontal>; 2],
        x: Vec<f64>,
        y: Vec<f64>,
    ) -> Self {
        Self::new(dims, false, kinds, x, y)
    }

    fn new(
        dims: [usize; 2],
        is_straight: bool,
        kinds: [Option<Horizontal>; 2],
        mut x: Vec<f64>,
        mut y: Vec<f64>,
    ) -> Self {
        use Horizontal as H;
        let mut latitude = None;
        let is_metric = match kinds {
            [Some(H::Longitude), Some(H::Latitude)] => {
                unwrap(&mut x, dims[0]);
                let middle = range(&y).map_or(0.0, |[least, greatest]| (least + greatest) / 2.0);
                latitude = Some(middle);
                let scale = METRES_PER_DEGREE * middle.to_radians().cos();
                x.iter_mut().for_each(|x| *x *= scale);
                y.iter_mut().for_each(|y| *y *= METRES_PER_DEGREE);
                true
            }
            [Some(H::X(Some(a))), Some(H::Y(Some(b)))] => {
                x.iter_mut().for_each(|x| *x *= a);
                y.iter_mut().for_each(|y| *y *= b);
                true
            }
            _ => false,
        };
        Self {
            dims,
            is_straight,
            x,
            y,
            is_metric,
            latitude,
        }
    }

    /// The greatest extent across.
    fn width(&self) -> f64 {
        let of = |numbers: &[f64]| range(numbers).map_or(0.0, |[a, b]| b - a);
        of(&self.x).max(of(&self.y))
    }

    /// About as long as a step from a node to the next.
    fn step(&self) -> f64 {
        let of = |numbers: &[f64], count: usize| {
            let extent = range(numbers).map_or(0.0, |[a, b]| b - a);
            extent / (count.max(2) - 1) as f64
        };
        let steps = [of(&self.x, self.dims[0]), of(&self.y, self.dims[1])];
        let least = steps[0].min(steps[1]);
        if least > 0.0 { least } else { 1.0 }
    }
}

/// The places upwards.
pub(super) enum Heights {
    /// A single layer.
    None,
    Levels(Vec<f64>),
    Nodes(Vec<f64>),
}

impl Heights {
    pub(super) fn of_nodes(kind: Vertical, mut numbers: Vec<f64>) -> Self {
        let factor = match kind {
            Vertical::Metres(metres) => metres,
            Vertical::Pressure(_) | Vertical::Level { .. } => 1.0,
        };
        numbers.iter_mut().for_each(|z| *z *= factor);
        Self::Nodes(numbers)
    }

    /// - `name`: of the dimension, for notes.
    pub(super) fn of_levels(
        name: &str,
        kind: Vertical,
        mut numbers: Vec<f64>,
        plane: &Plane,
        notes: &mut Vec<String>,
    ) -> Self {
        let is_down = match kind {
            Vertical::Metres(metres) if plane.is_metric => {
                numbers.iter_mut().for_each(|z| *z *= metres);
                return Self::Levels(numbers);
            }
            Vertical::Pressure(pascals) if plane.is_metric && numbers.iter().all(|p| *p > 0.0) => {
                let height = |p: &mut f64| *p = pressure_height(*p * pascals);
                numbers.iter_mut().for_each(height);
                notes.push(
                    "Pressures are drawn as log-pressure heights: 0 at 1000 hPa, and 7 km for each factor e."
                        .to_owned(),
                );
                return Self::Levels(numbers);
            }
            Vertical::Metres(metres) => metres < 0.0,
            Vertical::Pressure(_) => true,
            Vertical::Level { is_down } => is_down,
        };
        let mut factor = 1.0;
        if plane.is_metric
            && let Some([least, greatest]) = range(&numbers)
            && greatest > least
        {
            factor = LEVEL_SHARE * plane.width() / (greatest - least);
            notes.push(format!(
                "Levels along `{name}` are no lengths: they are spread over a tenth of the grid's width."
            ));
        }
        if is_down {
            factor = -factor;
        }
        numbers.iter_mut().for_each(|z| *z *= factor);
        Self::Levels(numbers)
    }
}

/// ROMS' vertical coordinate, which follows the ground and the surface.
pub(super) struct Terrain {
    /// Whether `Vtransform` is 2.
    pub(super) is_second: bool,
    pub(super) critical_depth: f64,
    pub(super) s: Vec<f64>,
    pub(super) stretching: Vec<f64>,
    /// The ground, below 0.
    pub(super) depths: Vec<f64>,
    /// The surface above 0, where the file has it.
    pub(super) surface: Option<Vec<f64>>,
}

impl Terrain {
    pub(super) fn heights(self, file: &NetcdfFile<'_>, level: &NcDimension) -> Result<Heights> {
        let count = usize::try_from(level.size).unwrap_or(usize::MAX);
        let fault = |expected: String, found: usize| {
            let place = format!("variables of `{}`", level.name);
            Error::format(
                file.path,
                place,
                expected,
                found.to_string(),
                super::DAMAGED,
            )
        };
        for axis in [&self.s, &self.stretching] {
            if axis.len() != count {
                return Err(fault(format!("{count} numbers"), axis.len()));
            }
        }
        let nodes = self.depths.len().checked_mul(count);
        file.spend(|| "heights".to_owned(), nodes, size_of::<f64>())?;
        let mut heights = Vec::new();
        let hc = self.critical_depth;
        for (s, c) in self.s.iter().zip(&self.stretching) {
            for (i, &h) in self.depths.iter().enumerate() {
                let zeta = self.surface.as_ref().map_or(0.0, |surface| surface[i]);
                heights.push(if self.is_second {
                    let share = (hc * s + h * c) / (hc + h);
                    zeta + (zeta + h) * share
                } else {
                    let rest = hc * s + (h - hc) * c;
                    rest + zeta * (1.0 + rest / h)
                });
            }
        }
        Ok(Heights::Nodes(heights))
    }
}

/// The geometry of a grid, whose fields are turned round with its axes.
///
/// # Errors
/// Coordinates of another number than the nodes.
pub(super) fn geometry(
    file: &NetcdfFile<'_>,
    plane: Plane,
    heights: Heights,
    fields: &mut [Field],
    notes: &mut Vec<String>,
) -> Result<Geometry> {
    if let Some(latitude) = plane.latitude {
        notes.push(format!(
            "Longitudes and latitudes are laid out on a plane in metres, true to scale at latitude {latitude:.1}, and heights to the same scale."
        ));
    }
    let [nx, ny] = plane.dims;
    let across = nx.saturating_mul(ny);
    let count = fields.first().map_or(0, |field| match &field.source {
        FieldSource::Scalar(values) => values.len(),
        FieldSource::Vector(_) | FieldSource::Derived(_) => 0,
    });
    let layers = match &heights {
        Heights::None => 1,
        Heights::Levels(levels) => levels.len(),
        Heights::Nodes(nodes) => nodes.len() / across.max(1),
    };
    if across.checked_mul(layers) != Some(count) {
        let expected = format!("coordinates of {count} nodes");
        let found = format!("{nx} x {ny} x {layers}");
        return Err(Error::format(
            file.path,
            "coordinates",
            expected,
            found,
            super::DAMAGED,
        ));
    }
    if plane.is_straight
        && let Heights::Levels(levels) = &heights
        && let Some(coordinates) = rising([&plane.x, &plane.y, levels], fields)
    {
        let dims = [nx, ny, layers];
        let spacing = LatticeSpacing::Rectilinear { coordinates };
        return Ok(Geometry::Lattice(Lattice { dims, spacing }));
    }
    let heights = match heights {
        Heights::None => {
            notes.push("A single layer: drawn as thick as its steps are long.".to_owned());
            fields.iter_mut().for_each(double);
            let half = plane.step() / 2.0;
            Heights::Levels(vec![-half, half])
        }
        other => other,
    };
    let layers = match &heights {
        Heights::Levels(levels) => levels.len(),
        Heights::None | Heights::Nodes(_) => layers,
    };
    let nodes = across.checked_mul(layers);
    file.spend(|| "positions".to_owned(), nodes, size_of::<DVec3>())?;
    let node = |i: usize| {
        let (column, layer) = (i % across, i / across);
        let (x, y) = match plane.is_straight {
            true => (plane.x[column % nx], plane.y[column / nx]),
            false => (plane.x[column], plane.y[column]),
        };
        let z = match &heights {
            Heights::Levels(levels) => levels[layer],
            Heights::Nodes(nodes) => nodes[i],
            Heights::None => 0.0,
        };
        DVec3::new(x, y, z)
    };
    let nodes = (0..across * layers).map(node).collect();
    let dims = [nx, ny, layers];
    let blocks = vec![CurvilinearBlock { dims, nodes }];
    Ok(Geometry::Curvilinear { blocks })
}

/// Coordinates that rise throughout, after those that fall are turned round with the fields; `None`, and nothing turned,
/// where one does neither.
fn rising(axes: [&[f64]; 3], fields: &mut [Field]) -> Option<[Vec<f64>; 3]> {
    let is_finite = axes.iter().all(|axis| axis.iter().all(|x| x.is_finite()));
    let rises = |axis: &[f64]| axis.windows(2).all(|w| w[0] < w[1]);
    let falls = |axis: &[f64]| axis.windows(2).all(|w| w[0] > w[1]);
    if !is_finite || !axes.iter().all(|axis| rises(axis) || falls(axis)) {
        return None;
    }
    let dims = axes.map(<[f64]>::len);
    let mut coordinates = axes.map(<[f64]>::to_vec);
    for (axis, numbers) in coordinates.iter_mut().enumerate() {
        if rises(numbers) {
            continue;
        }
        numbers.reverse();
        for field in fields.iter_mut() {
            if let FieldSource::Scalar(values) = &mut field.source {
                reverse(values, dims, axis);
            }
        }
    }
    Some(coordinates)
}

/// The values of a layer once more, for its other side.
fn double(field: &mut Field) {
    if let FieldSource::Scalar(Values::F32(values)) = &mut field.source {
        values.extend_from_within(..);
    }
}

/// Longitudes that do not jump by a turn from a node to the next: along each row, and from row to row.
fn unwrap(longitudes: &mut [f64], width: usize) {
    let near = |longitude: f64, reference: f64| {
        let turns = ((reference - longitude) / 360.0).round();
        if turns.is_finite() {
            longitude + 360.0 * turns
        } else {
            longitude
        }
    };
    let mut above = None;
    for row in longitudes.chunks_mut(width.max(1)) {
        let mut last = above;
        let mut first = None;
        for longitude in row.iter_mut().filter(|longitude| longitude.is_finite()) {
            *longitude = last.map_or(*longitude, |last| near(*longitude, last));
            last = Some(*longitude);
            first = first.or(last);
        }
        above = first.or(above);
    }
}

/// The least and the greatest number that are finite.
fn range(numbers: &[f64]) -> Option<[f64; 2]> {
    let finite = numbers.iter().copied().filter(|x| x.is_finite());
    finite
        .map(|x| [x, x])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}
