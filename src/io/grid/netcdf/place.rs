//! Computes the positions of a grid's nodes in metres, and its geometry.
//!
//! Longitudes λ and latitudes φ become x = M cos(φ₀) λ and y = M φ. M is the metres of a degree of latitude on
//! a sphere, and φ₀ the latitude halfway between the least and the greatest. This equirectangular map is true
//! to scale along φ₀ and along all meridians. Its axes stay straight, so a grid of latitudes and longitudes is
//! a rectilinear one. Heights have the same scale.

use glam::DVec3;
use netcdf_reader::NcDimension;

use super::NetcdfFile;
use super::axis::{Horizontal, METRES_PER_DEGREE, Vertical, pressure_height};
use crate::data::dataset::{CurvilinearBlock, Field, FieldSource, Geometry};
use crate::error::{Error, Result};
use crate::io::vtk::vtr::reverse;
use crate::scene::{Lattice, LatticeSpacing};

/// Share of a grid's width over which its levels are spread if they are no lengths.
const LEVEL_SHARE: f64 = 0.1;

/// The horizontal positions.
pub(super) struct Plane {
    dims: [usize; 2],
    /// Whether each column and each row has one coordinate; otherwise each node has both.
    is_straight: bool,
    x: Vec<f64>,
    y: Vec<f64>,
    /// Whether the numbers are metres.
    is_metric: bool,
    /// The latitude at which longitudes are true to scale.
    latitude: Option<f64>,
}

impl Plane {
    /// Makes a plane from one coordinate for each column and each row.
    pub(super) fn axes(kinds: [Option<Horizontal>; 2], x: Vec<f64>, y: Vec<f64>) -> Self {
        let dims = [x.len(), y.len()];
        Self::new(dims, true, kinds, x, y)
    }

    /// Makes a plane from two coordinates for each node, x fastest.
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

    /// The greater of the two horizontal extents.
    fn width(&self) -> f64 {
        let of = |numbers: &[f64]| range(numbers).map_or(0.0, |[a, b]| b - a);
        of(&self.x).max(of(&self.y))
    }
}

/// The vertical positions.
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

    /// - `name`: name of the dimension, for notes.
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
    /// Heights of the ground, below 0.
    pub(super) depths: Vec<f64>,
    /// Heights of the surface above 0, if the file has them.
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

/// The geometry of a grid. Fields are reversed with its axes.
///
/// # Errors
/// Coordinates whose number is not that of the nodes.
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
    // A layer is a surface.
    let heights = match heights {
        Heights::None => Heights::Levels(vec![0.0]),
        other => other,
    };
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

/// Rising coordinates: falling ones are reversed, and the fields with them. `None`, with nothing reversed, if
/// one axis neither rises nor falls.
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

/// Removes jumps of a turn between the longitudes of neighbouring nodes: along each row, and from row to row.
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

/// The least and the greatest finite number.
fn range(numbers: &[f64]) -> Option<[f64; 2]> {
    let finite = numbers.iter().copied().filter(|x| x.is_finite());
    finite
        .map(|x| [x, x])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}
