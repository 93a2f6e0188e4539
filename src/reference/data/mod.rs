//! Computes reference images of data on grids: images of the data's own field, not of its kernels.
//!
//! The difference between this image and that of [`super::Integrator`] is the error of the kernels. Here the
//! field is interpolated between its samples, and the transfer function classifies the interpolated value at
//! every place of a ray (classification after interpolation). There each kernel is classified by its sample and
//! has Gaussian extent. [`DataIntegrator`] lists the interpolation for each kind of data.
//!
//! Along a ray the field of each cell is a cubic. That is exact in lattices and tetrahedra, and accurate to a
//! hundredth of the requested error in other cells, whose maps Newton's method inverts. Cubics are divided at
//! their extrema and where they pass a corner of the transfer function. Nested rules integrate them to the
//! requested error (`emission.rs`). `tests/frames/reference_data.rs` compares the results with closed forms and
//! with a march in small steps.

mod cells;
mod cubic;
mod curvilinear;
mod emission;
mod function;
mod hexahedron;
mod lattice;
mod pieces;
mod running;
mod unstructured;

use crate::data::association::Association;
use glam::{DVec2, DVec3};

use super::pixel::{self, Detail, Rays};
use super::ray::RayIntegral;
use super::sight::Sight;
use super::{PixelFilter, ReferenceFrame, ReferenceSettings, check};
use crate::data::blanking::Blanking;
use crate::data::dataset::{CurvilinearBlock, Dataset, Geometry};
use crate::data::first_order::to_first_order;
use crate::error::{Error, Result};
use crate::image::DepthImage;
use crate::scene::TransferFunction;
use crate::view::{Camera, ClipPlane};
use cells::{Mesh, Scratch};
use emission::Emission;
use function::Function;
use lattice::Grid;

/// Greatest error of a field on cells of higher order once they are cut into cells of first order, as a share
/// of the field's range.
const ELEMENT_SLACK: f64 = 0.001;

/// A data set's own field under a transfer function.
///
/// | data | field | domain |
/// |---|---|---|
/// | lattice, values at nodes | trilinear between nodes | the box of the nodes |
/// | lattice, values of cells | trilinear between the cells' centres, constant from the outermost on | all cells |
/// | curvilinear grid, lattice with hidden cells or nodes | trilinear in each cell's own parameters; values of cells are constant in each | all cells |
/// | tetrahedra | linear; values of cells constant, here and below | all cells |
/// | hexahedra, voxels, wedges, pyramids | VTK's shape functions | all cells |
/// | prisms, polyhedra | linear in tetrahedra around the mean of the corners and the mean of each face's corners; the values there are the means, too | all cells |
///
/// Outside of the domain there is nothing. If several cells claim a place (blocks overlap, cells fold over), it
/// belongs to the first of them in the order of blocks and cells, so that no medium counts twice. Cells of
/// higher order are cut into cells of first order that reproduce the field to a thousandth of its range, or as
/// finely as memory allows.
///
/// [`Self::left_out`] counts the cells left out: cells with a position or a value that is not finite (infinity,
/// too: nothing can be interpolated between it and a number), blanked cells and those at a blanked node, cells
/// without volume, and cells inverted relative to most others of their kind.
///
/// ```
/// use ewa_splat::io::{Association, Dataset, Field, FieldSource, Geometry};
/// use ewa_splat::reference::DataIntegrator;
/// use ewa_splat::scene::{Lattice, TransferDefaults, TransferFunction, Values};
/// use ewa_splat::view::Camera;
/// use glam::DVec3;
///
/// # fn main() -> ewa_splat::Result<()> {
/// // Two nodes along each axis, all with the value 1: a uniform cube.
/// let lattice = Lattice::uniform([2; 3], DVec3::splat(-0.5), DVec3::ONE);
/// let source = FieldSource::Scalar(Values::U8(vec![1; 8]));
/// let field = Field { name: "value".into(), association: Association::Nodes, source, unit: None };
/// let data = Dataset::new("cube".as_ref(), "cube", Geometry::Lattice(lattice), vec![field]);
/// let defaults = TransferDefaults { range: [0.0, 1.0], unit_distance: 1.0 };
/// let function = TransferFunction::named("viridis", &defaults)?;
/// let extinction = f64::from(function.classify(1.0)[3]);
///
/// let integrator = DataIntegrator::new(data, "value", function)?;
/// let eye = DVec3::new(0.0, -5.0, 0.0);
/// let camera = Camera::orthographic(eye, DVec3::ZERO, DVec3::Z, 2.0, [8, 8]);
/// // Straight through: one unit of length.
/// let ray = integrator.ray(&camera, camera.centre_px, 1e-9);
/// assert!((ray.rgba[3] - (1.0 - (-extinction).exp())).abs() < 1e-9);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct DataIntegrator {
    domain: Domain,
    function: Function,
    left_out: usize,
    /// Clip planes, world space.
    clip: Vec<ClipPlane>,
    /// Depths at which rays end.
    ends: Option<DepthImage>,
}

#[derive(Debug, Clone)]
enum Domain {
    Lattice(Grid),
    Cells(Mesh),
}

impl DataIntegrator {
    /// Makes an integrator of one field of a lattice, a curvilinear or an unstructured grid.
    ///
    /// - `field`: selector of the field, as in [`Dataset::scalar`].
    /// - `function`: classifies the field's values, which are interpolated on its scale. The volume sampled
    ///   from the same data has its function in
    ///   [`PointVolume::transfer_function`](crate::scene::PointVolume::transfer_function).
    ///
    /// # Errors
    /// The errors of [`Dataset::validate`]; a field that is missing or has the wrong length. Particles, splats and
    /// meshes, which have no field between samples. Grids without volume, and those without a valid cell.
    pub fn new(dataset: Dataset, field: &str, function: TransferFunction) -> Result<Self> {
        dataset.validate()?;
        let (dataset, _) = to_first_order(dataset, field, ELEMENT_SLACK)?;
        let (association, values) = dataset.scalar(field)?;
        let values = function.value_scale().positions(values);
        let blanking = Blanking::of(&dataset)?;
        let counts = match &dataset.geometry {
            Geometry::Lattice(lattice) => {
                let cells = lattice.dims.map(|n| n.saturating_sub(1));
                [lattice.len(), cells.iter().product()]
            }
            Geometry::Curvilinear { blocks } => {
                let of = |association| {
                    let count =
                        |b: &CurvilinearBlock| b.dims_of(association).iter().product::<usize>();
                    blocks.iter().map(count).sum()
                };
                [of(Association::Nodes), of(Association::Cells)]
            }
            Geometry::Cells(mesh) => [mesh.nodes.len(), mesh.cell_count()],
            Geometry::Points { .. } | Geometry::Splats(_) | Geometry::Mesh(_) => {
                return Err(refused(&dataset));
            }
        };
        let expected = match association {
            Association::Nodes => counts[0],
            Association::Cells => counts[1],
        };
        let fault = |place: String, expected: &str, found: String, advice: &'static str| {
            Err(Error::format(&dataset.path, place, expected, found, advice))
        };
        if values.len() != expected {
            return fault(
                format!("field `{field}`"),
                &format!("{expected} values"),
                format!("{} values", values.len()),
                "the file is damaged",
            );
        }
        if counts.iter().any(|&n| n >= u32::MAX as usize) {
            let found = counts[0].max(counts[1]).to_string();
            let expected = "fewer than 2^32 - 1 nodes and cells";
            return fault("samples".into(), expected, found, "split the data set");
        }
        let (domain, left_out) = match &dataset.geometry {
            Geometry::Lattice(lattice)
                if blanking.hides_any() && lattice.dims.iter().all(|&n| n > 1) =>
            {
                let blocks = [CurvilinearBlock::of_lattice(lattice)];
                let (mesh, left_out) = curvilinear::mesh(&blocks, association, &values, &blanking);
                (Domain::Cells(mesh), left_out)
            }
            Geometry::Lattice(lattice) => {
                let Some(grid) = Grid::new(lattice, association, values) else {
                    let [x, y, z] = lattice.dims;
                    return fault(
                        "lattice".into(),
                        "a volume: at least two nodes along each axis, and steps that span space",
                        format!("{x} x {y} x {z} nodes"),
                        "there is nothing between the samples of a sheet; render it without --reference data",
                    );
                };
                let left_out = grid.left_out();
                (Domain::Lattice(grid), left_out)
            }
            Geometry::Curvilinear { blocks } => {
                let (mesh, left_out) = curvilinear::mesh(blocks, association, &values, &blanking);
                (Domain::Cells(mesh), left_out)
            }
            Geometry::Cells(mesh) => {
                let (mesh, left_out) = unstructured::mesh(mesh, association, &values, &blanking);
                (Domain::Cells(mesh), left_out)
            }
            _ => return Err(refused(&dataset)),
        };
        if matches!(&domain, Domain::Cells(mesh) if mesh.cell_count() == 0) {
            return fault(
                "cells".into(),
                "at least one with a volume, finite corners and values",
                format!("none; {left_out} left out"),
                "look at the file with `ewa-splat info`",
            );
        }
        Ok(Self {
            domain,
            function: Function::new(function),
            left_out,
            clip: Vec::new(),
            ends: None,
        })
    }

    /// Adds clip planes that cut the data.
    pub fn clipped(mut self, planes: &[ClipPlane]) -> Self {
        self.clip.extend_from_slice(planes);
        self
    }

    /// Ends the rays through each pixel at its depth, as a [`Backdrop`](crate::render::Backdrop) does. Images must have the
    /// size of the depths. Without depths rays have no end.
    pub fn ended(mut self, depth: Option<&DepthImage>) -> Self {
        self.ends = depth.cloned();
        self
    }

    /// Returns the number of cells that are left out of the domain.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Returns the light along one ray, unfiltered.
    ///
    /// - `pixel_px`: place of the image that the ray passes through, pixels.
    /// - `error`: error of each channel, full scale 1.
    pub fn ray(&self, camera: &Camera, pixel_px: DVec2, error: f64) -> RayIntegral {
        View::new(self, camera).integrate(pixel_px, error, &mut Scratch::default())
    }

    /// Renders the reference image.
    ///
    /// The pixels' filter is refined until the result no longer changes, as in [`super::Integrator`]. An
    /// isolated feature thinner than a pixel, such as a shell of the transfer function, is found only by the
    /// samples that meet it; no bound covers it.
    ///
    /// # Errors
    /// An image without pixels; settings out of range; a filter of kernels, because there are none; work that
    /// was cancelled.
    pub fn render(&self, camera: &Camera, settings: &ReferenceSettings) -> Result<ReferenceFrame> {
        check(camera, settings, self.ends.as_ref())?;
        if settings.pixel_filter == PixelFilter::Kernels {
            return Err(Error::invalid(
                "reference",
                "pixel filter",
                "one of the image",
                "one of kernels, where there are none",
                "take `PixelFilter::Image`",
            ));
        }
        pixel::image(&View::new(self, camera), settings)
    }

    /// Returns centre and radius of a ball around the domain, world space.
    fn ball(&self) -> (DVec3, f64) {
        match &self.domain {
            Domain::Lattice(grid) => grid.ball(),
            Domain::Cells(mesh) => mesh.ball(),
        }
    }
}

fn refused(dataset: &Dataset) -> Error {
    let (found, advice) = match dataset.geometry {
        Geometry::Mesh(_) => ("a mesh, which has no field", "leave it out"),
        Geometry::Splats(_) => ("splats, which are kernels", "integrate the kernels"),
        _ => (
            "particles, between which nothing is stated but by their kernels",
            "integrate the kernels",
        ),
    };
    Error::format(
        &dataset.path,
        "data to integrate",
        "a lattice, a curvilinear or an unstructured grid",
        found,
        advice,
    )
}

/// The data as one camera sees them.
struct View<'a> {
    sight: Sight<'a>,
    data: &'a DataIntegrator,
    centre: DVec3,
    radius: f64,
}

impl<'a> View<'a> {
    fn new(data: &'a DataIntegrator, camera: &'a Camera) -> Self {
        let (centre, radius) = data.ball();
        Self {
            sight: Sight::new(camera, &data.clip).ended(data.ends.as_ref()),
            data,
            centre,
            // Enlarged, so that rounding stays within.
            radius: radius * (1.0 + 1e-9),
        }
    }
}

impl Rays for View<'_> {
    type Scratch = Scratch;

    fn camera(&self) -> &Camera {
        self.sight.camera
    }

    fn integrate(&self, pixel_px: DVec2, error: f64, scratch: &mut Scratch) -> RayIntegral {
        let camera = self.sight.camera;
        let (origin, direction) = self.sight.ray(pixel_px);
        let nothing = RayIntegral::default();
        let Some([near, far]) = self.sight.span(pixel_px, origin, direction) else {
            return nothing;
        };
        // From where the ray comes near the data: a distant eye costs no digits.
        let centre = camera.camera_point(self.centre);
        let nearest = (centre - origin).dot(direction);
        let beside = (origin + direction * nearest - centre).length_squared();
        let half = (self.radius * self.radius - beside).sqrt();
        let (near, far) = (near.max(nearest - half), far.min(nearest + half));
        // Phrased so that NaN, from a ray that misses, fails.
        if !(half > 0.0 && near < far) {
            return nothing;
        }
        let world = camera.camera_from_world.transpose();
        let from_centre = world * (origin + direction * near - centre);
        let (start, direction) = (self.centre + from_centre, world * direction);
        let length = far - near;
        let mut emission = Emission::new(&self.data.function, error, length);
        match &self.data.domain {
            Domain::Lattice(grid) => grid.integrate(start, direction, length, &mut emission),
            Domain::Cells(mesh) => {
                mesh.integrate(start, direction, length, &mut emission, scratch);
            }
        }
        emission.finish()
    }

    fn details(&self, settings: &ReferenceSettings) -> Vec<Detail> {
        let camera = self.sight.camera;
        let centre = camera.camera_point(self.centre);
        let all = Detail::of_ball(centre, self.radius, camera, settings);
        all.into_iter().collect()
    }
}
