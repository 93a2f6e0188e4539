//! Finds the up direction of a data set, which an image shows at its top unless told otherwise.
//!
//! | data | up |
//! |---|---|
//! | glTF, its splats too; OBJ | +y: the convention of the formats or of their writers |
//! | splats of USD | +y, or +z if the file states it |
//! | other splats | -y: training scenes have y down, and all are read in their axes (`splat_axes.rs`) |
//! | particles in a flat layer across x or y | the axis across it |
//! | grids a cell thick or less, and meshes with fields in a plane, across an axis | +y for planes across z, +z for others: seen straight on |
//! | all else: grids, other particles, PLY and VTK meshes | +z; meshes of scanners vary |
//!
//! Splats whose box lies beside the origin are a part of a scene whose cameras stood around the origin. They
//! look right from there alone, so the default view is from the origin's side.

use glam::DVec3;

use super::dataset::{Dataset, Geometry};
use crate::math::Core;
use crate::view::Viewpoint;

/// A layer's thickness over the lesser of its other two extents, below which it is flat.
const FLAT: f64 = 0.25;

/// The up direction, and its reason.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Up {
    /// Unit vector along an axis; moving the data ([`edit::place`](crate::edit::place)) does not change it.
    pub direction: DVec3,
    /// For people, in a few words.
    pub reason: &'static str,
    /// The default direction of view, unit length, if the data have a front.
    pub front: Option<DVec3>,
    /// Whether the data are a plane, which is seen from its front without any elevation.
    pub is_plane: bool,
    /// Whether a mesh gave the direction; other data take precedence: see [`Up::of_scene`].
    pub is_of_mesh: bool,
}

impl Up {
    /// The default viewpoint: from the front if there is one, a plane straight on, all else from above.
    pub fn viewpoint(&self) -> Viewpoint {
        let up = self.direction;
        let front = self.front.map(|front| Viewpoint::azimuth_of(front, up));
        Viewpoint {
            azimuth_deg: front.unwrap_or(30.0),
            elevation_deg: if self.is_plane { 0.0 } else { 25.0 },
            zoom: 1.0,
            up,
        }
    }

    /// The up direction for an image of several data sets: that of the first data set that is no mesh; if all
    /// are meshes, that of the first; z if there are none.
    ///
    /// ```
    /// use ewa_splat::io::{OpenOptions, Up, read};
    /// use glam::DVec3;
    ///
    /// # fn main() -> ewa_splat::Result<()> {
    /// let mesh = read("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", &OpenOptions::default())?;
    /// let disc = read("b.csv", b"x,y,z\n0,0,0\n9,0,0\n0,0,9\n9,1,9\n", &OpenOptions::default())?;
    /// let grain = read("c.csv", b"x,y,z\n0,0,0\n9,9,9\n", &OpenOptions::default())?;
    /// assert_eq!(Up::of_scene([mesh.up()]).direction, DVec3::Y);
    /// assert_eq!(Up::of_scene([mesh.up(), grain.up()]).direction, DVec3::Z);
    /// assert_eq!(Up::of_scene([disc.up(), grain.up()]).direction, DVec3::Y);
    /// # Ok(())
    /// # }
    /// ```
    pub fn of_scene(all: impl IntoIterator<Item = Self>) -> Self {
        let none = Self {
            direction: DVec3::Z,
            reason: "no data",
            front: None,
            is_plane: false,
            is_of_mesh: true,
        };
        let first_of = |chosen: Option<Self>, next: Self| match chosen {
            Some(known) if next.is_of_mesh || !known.is_of_mesh => Some(known),
            _ => Some(next),
        };
        all.into_iter().fold(None, first_of).unwrap_or(none)
    }

    /// The up direction of a set of points, which depends on their bounds alone.
    ///
    /// - `corners`: the least and the greatest coordinates; `None` if none is finite.
    pub(crate) fn of_points(corners: Option<(DVec3, DVec3)>) -> Self {
        let positions = corners.map_or(Vec::new(), |(a, b)| vec![a, b]);
        let geometry = Geometry::Points { positions };
        Dataset::new(std::path::Path::new(""), "points", geometry, Vec::new()).up()
    }
}

impl Dataset {
    /// The up direction: that of the format ([`Dataset::format_up`]) if it has one, else a guess from the data.
    pub fn up(&self) -> Up {
        let is_of_mesh = matches!(self.geometry, Geometry::Mesh(_));
        let guessed = match &self.geometry {
            Geometry::Splats(_) => (DVec3::NEG_Y, "training scenes of splats have y down"),
            Geometry::Points { positions } => of_layer(positions),
            Geometry::Mesh(_) => (
                DVec3::Z,
                "meshes of a format that states nothing: z by convention",
            ),
            Geometry::Lattice(_) | Geometry::Curvilinear { .. } | Geometry::Cells(_) => {
                (DVec3::Z, "grids: z by convention")
            }
        };
        let (direction, reason) = self.format_up.unwrap_or(guessed);
        let is_of_splats = matches!(self.geometry, Geometry::Splats(_));
        let bounds = self.bounds();
        let is_of_points = matches!(self.geometry, Geometry::Points { .. });
        // Meshes with fields are plots.
        let is_shown = !is_of_mesh || !self.fields.is_empty();
        let has_choice = self.format_up.is_none() && !is_of_splats && !is_of_points && is_shown;
        let thin = || bounds.map(|bounds| self.thin_axes(bounds));
        if let Some((direction, front)) = thin().filter(|_| has_choice).and_then(plane) {
            return Up {
                direction,
                reason: "a plane, seen straight on",
                front: Some(front),
                is_plane: true,
                is_of_mesh,
            };
        }
        let beside = match &self.geometry {
            Geometry::Splats(cloud) => bounds_of_most(&cloud.positions),
            _ => None,
        };
        Up {
            direction,
            reason,
            front: beside.and_then(|(lower, upper)| front(lower, upper)),
            is_plane: false,
            is_of_mesh,
        }
    }
}

/// Greatest thickness of a layer of cells, as a share of the lesser of its other two extents.
const LAYER: f64 = 0.5;

/// Greatest distance of nodes from a plane, as a share of the thickness between planes.
const PLANE: f64 = 1e-6;

/// The axes across which all finite nodes lie in the two end planes of their box.
pub(crate) fn in_end_planes(
    nodes: impl Iterator<Item = DVec3>,
    (lower, upper): (DVec3, DVec3),
) -> [bool; 3] {
    let (extent, slack) = (upper - lower, PLANE * (upper - lower));
    let mut are_in = [true; 3];
    for node in nodes.filter(|node| node.is_finite()) {
        for axis in 0..3 {
            let depth = node[axis] - lower[axis];
            are_in[axis] &= depth.min(extent[axis] - depth) <= slack[axis];
        }
        if are_in == [false; 3] {
            break;
        }
    }
    are_in
}

fn is_layer(extent: DVec3, axis: usize) -> bool {
    let others = [1, 2].map(|step| extent[(axis + step) % 3]);
    extent[axis] <= LAYER * others[0].min(others[1])
}

impl Dataset {
    /// The axes across which the data have at most two planes of nodes: one layer of cells.
    fn thin_axes(&self, (lower, upper): (DVec3, DVec3)) -> [bool; 3] {
        let extent = upper - lower;
        let nodes: Box<dyn Iterator<Item = DVec3> + '_> = match &self.geometry {
            Geometry::Lattice(lattice) => {
                let [x, y, _] = lattice.dims;
                let at = move |n: usize| lattice.position([n % x, n / x % y, n / (x * y)]);
                Box::new((0..lattice.len()).map(at))
            }
            Geometry::Curvilinear { blocks } => {
                Box::new(blocks.iter().flat_map(|block| block.nodes.iter().copied()))
            }
            Geometry::Cells(mesh) => Box::new(mesh.nodes.iter().copied()),
            _ => Box::new(std::iter::empty()),
        };
        let count = match &self.geometry {
            Geometry::Lattice(lattice) => lattice.len(),
            Geometry::Curvilinear { blocks } => blocks.iter().map(|b| b.nodes.len()).sum(),
            Geometry::Cells(mesh) => mesh.nodes.len(),
            _ => 0,
        };
        // One cell is no layer, and its corners do not show what lies between them.
        let is_layer = |axis: usize| count > 8 && is_layer(extent, axis);
        let is_thin = [0, 1, 2].map(|axis| extent[axis] <= 0.0 || is_layer(axis));
        if is_thin == [false; 3] {
            return is_thin;
        }
        let are_in = in_end_planes(nodes, (lower, upper));
        [0, 1, 2].map(|axis| is_thin[axis] && are_in[axis])
    }
}

/// The up direction of a plane across an axis, and the direction of view. As in plots, x points right with y or
/// z up; in a plane across x, y points right with z up.
fn plane(is_thin: [bool; 3]) -> Option<(DVec3, DVec3)> {
    match is_thin {
        [false, false, true] => Some((DVec3::Y, DVec3::NEG_Z)),
        [false, true, false] => Some((DVec3::Z, DVec3::Y)),
        [true, false, false] => Some((DVec3::Z, DVec3::NEG_X)),
        _ => None,
    }
}

/// Number of positions from which the box of most splats is computed.
const SPLATS: usize = 1 << 16;

/// The least and the greatest coordinates of positions without strays; `None` if none is finite.
fn bounds_of_most(positions: &[DVec3]) -> Option<(DVec3, DVec3)> {
    let some = positions
        .iter()
        .step_by(positions.len().div_ceil(SPLATS).max(1));
    let finite = some.filter(|p| p.is_finite());
    let points: Vec<(DVec3, f64)> = finite.map(|p| (*p, 1.0)).collect();
    let core = Core::of(&points);
    let kept = points
        .iter()
        .map(|(p, _)| *p)
        .filter(|p| core.is_none_or(|core| core.holds(*p)));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = kept.fold(none, |(low, high), p| (low.min(p), high.max(p)));
    low.is_finite().then_some((low, high))
}

/// The direction from the origin to the middle of a box, if the box lies beside the origin by more than its own
/// size along some axis.
fn front(lower: DVec3, upper: DVec3) -> Option<DVec3> {
    let (middle, size) = (lower.midpoint(upper), upper - lower);
    let is_beside = middle.abs().cmpgt(1.5 * size).any();
    middle.try_normalize().filter(|_| is_beside)
}

/// The axis across a flat layer of particles (a disc of stars, say); z for others.
fn of_layer(positions: &[DVec3]) -> (DVec3, &'static str) {
    let finite = positions.iter().filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| {
        (a.min(*p), b.max(*p))
    });
    let extent = high - low;
    // Phrased so that an empty or overflowing extent is no layer.
    let is_thin = |axis: usize| {
        let others = [1, 2].map(|step| extent[(axis + step) % 3]);
        extent[axis].is_finite() && extent[axis] < FLAT * others[0].min(others[1])
    };
    match (is_thin(0), is_thin(1), is_thin(2)) {
        (true, ..) => (DVec3::X, "across a flat layer of particles"),
        (_, true, _) => (DVec3::Y, "across a flat layer of particles"),
        (.., true) => (DVec3::Z, "across a flat layer of particles"),
        _ => (DVec3::Z, "particles: z by convention"),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::data::cells::CellMesh;
    use crate::data::mesh::Mesh;
    use crate::data::splats::SplatCloud;

    fn up(geometry: Geometry) -> Up {
        Dataset::new(Path::new("a"), "made", geometry, Vec::new()).up()
    }

    #[test]
    fn splats_beside_the_origin_have_a_front() {
        let cloud = |middle: DVec3| SplatCloud {
            positions: vec![middle - 0.5, middle, middle + 0.5],
            ..SplatCloud::default()
        };
        let front = |middle| up(Geometry::Splats(cloud(middle))).front;
        assert_eq!(front(DVec3::ZERO), None);
        assert_eq!(front(DVec3::new(1.4, -1.4, 0.0)), None);
        assert_eq!(front(DVec3::new(0.0, 0.0, -2.0)), Some(DVec3::NEG_Z));
        assert_eq!(points([1.0; 3]).front, None);
    }

    fn points(extent: [f64; 3]) -> Up {
        let high = DVec3::from(extent);
        let positions = vec![
            DVec3::NAN,
            DVec3::ONE,
            DVec3::ONE + high,
            DVec3::ONE + high / 2.0,
        ];
        up(Geometry::Points { positions })
    }

    #[test]
    fn flat_layers_of_particles_lie() {
        for (extent, expected) in [
            ([1.0, 1.0, 1.0], DVec3::Z),
            ([4.0, 4.0, 0.5], DVec3::Z),
            ([4.0, 0.5, 4.0], DVec3::Y),
            ([0.5, 4.0, 4.0], DVec3::X),
            // On either side of a quarter of the lesser of the others.
            ([9.0, 0.99, 4.0], DVec3::Y),
            ([9.0, 1.01, 4.0], DVec3::Z),
            // Lines, a point and a sheet without any thickness.
            ([4.0, 0.0, 0.0], DVec3::Z),
            ([0.0, 4.0, 0.0], DVec3::Z),
            ([0.0; 3], DVec3::Z),
            ([4.0, 0.0, 4.0], DVec3::Y),
        ] {
            assert_eq!(points(extent).direction, expected, "{extent:?}");
        }
        assert_eq!(points([f64::MAX, f64::INFINITY, 1.0]).direction, DVec3::Z);
        let nothing = Geometry::Points { positions: vec![] };
        assert_eq!(up(nothing).direction, DVec3::Z);
    }

    #[test]
    fn the_first_that_is_no_mesh_says_what_is_up() {
        let mesh = up(Geometry::Mesh(Mesh::default()));
        let splats = up(Geometry::Splats(SplatCloud::default()));
        let grid = up(Geometry::Cells(CellMesh::default()));
        let [y_mesh, layer] = [
            Up {
                direction: DVec3::Y,
                ..mesh
            },
            points([4.0, 0.5, 4.0]),
        ];
        for (all, expected) in [
            (vec![], DVec3::Z),
            (vec![mesh], DVec3::Z),
            (vec![y_mesh, mesh], DVec3::Y),
            (vec![mesh, y_mesh], DVec3::Z),
            (vec![y_mesh, grid], DVec3::Z),
            (vec![y_mesh, mesh, splats, grid], DVec3::NEG_Y),
            (vec![grid, splats], DVec3::Z),
            (vec![layer, mesh, grid], DVec3::Y),
        ] {
            assert_eq!(Up::of_scene(all.clone()).direction, expected, "{all:?}");
        }
    }
}
