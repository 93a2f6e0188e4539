//! Provides volumes of bytes: real ones if available, and a computed one.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "values are held to a byte"
)]

use std::path::{Path, PathBuf};

use ewa_splat::Result;
use ewa_splat::io::{
    Association, Dataset, Field, FieldSource, Geometry, OpenOptions, RawLayout, RawType, open,
};
use ewa_splat::sample::{SampleOptions, scene};
use ewa_splat::scene::{ColourSpace, ControlPoint, Lattice, PointVolume, TransferFunction, Values};
use glam::DVec3;

/// A volume of bytes, a unit between voxels, its middle at the origin.
#[derive(Debug, Clone)]
pub(crate) struct Volume {
    pub(crate) name: &'static str,
    pub(crate) dims: [usize; 3],
    pub(crate) values: Values,
}

impl Volume {
    /// Returns the volume as a data set.
    pub(crate) fn dataset(&self) -> Dataset {
        let first = self.dims.map(|n| 0.5 - 0.5 * n as f64);
        let field = Field {
            name: "value".into(),
            association: Association::Nodes,
            source: FieldSource::Scalar(self.values.clone()),
            unit: None,
        };
        Dataset::new(
            Path::new(self.name),
            "volume",
            Geometry::Lattice(Lattice::uniform(self.dims, DVec3::from(first), DVec3::ONE)),
            vec![field],
        )
    }

    /// Returns the iso-surface at a value, as opaque surfels.
    ///
    /// # Errors
    /// The errors of the sampler.
    pub(crate) fn surface(&self, value: f64) -> Result<Vec<PointVolume>> {
        let options = SampleOptions {
            flatten: Some(value),
            ..SampleOptions::default()
        };
        Ok(scene(self.dataset(), &options)?.volumes)
    }

    /// Returns the volume's kernels, classified by `transfer`.
    ///
    /// # Errors
    /// The errors of the sampler.
    pub(crate) fn scene(&self, transfer: &TransferFunction) -> Result<Vec<PointVolume>> {
        let mut volumes = scene(self.dataset(), &SampleOptions::default())?.volumes;
        for volume in &mut volumes {
            volume.transfer_function = Some(transfer.clone());
        }
        Ok(volumes)
    }

    /// Returns a part of the volume.
    pub(crate) fn part(&self, first: [usize; 3], dims: [usize; 3]) -> Self {
        let [nx, ny, _] = self.dims;
        let [dx, dy, dz] = dims;
        let values = (0..dx * dy * dz)
            .map(|i| {
                [
                    i % dx + first[0],
                    i / dx % dy + first[1],
                    i / (dx * dy) + first[2],
                ]
            })
            .map(|[x, y, z]| self.values.get((z * ny + y) * nx + x));
        Self {
            name: self.name,
            dims,
            values: Values::F32(values.collect()),
        }
    }
}

/// Makes a transfer function of opacities per cell and colours (linear) at values, linear between them.
///
/// # Errors
/// Points out of order.
pub(crate) fn transfer(points: &[(f32, [f32; 3], f32)]) -> Result<TransferFunction> {
    let points: Vec<ControlPoint> = points
        .iter()
        .map(|&(value, colour, opacity)| ControlPoint {
            value,
            colour: Some(colour),
            opacity: Some(opacity),
        })
        .collect();
    TransferFunction::from_points(&points, ColourSpace::Linear, [0.0, 255.0], 1.0)
}

/// Returns the CT of an engine block, if available.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn engine() -> Result<Option<Volume>> {
    real("engine", "engine_256x256x128_uint8.raw", [256, 256, 128])
}

/// Returns the simulated nucleon, if available.
///
/// # Errors
/// A file that cannot be read.
pub(crate) fn nucleon() -> Result<Option<Volume>> {
    real("nucleon", "nucleon_41x41x41_uint8.raw", [41; 3])
}

/// Reads a raw volume from the folder of real data (`EWA_DATA_DIR`, or `../shared/data`); `None`, with a message, if it
/// is absent.
fn real(name: &'static str, file: &str, dims: [usize; 3]) -> Result<Option<Volume>> {
    let folder = std::env::var_os("EWA_DATA_DIR").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join("volumes").join(file);
    if !path.is_file() {
        println!("no {}: {name} is left out", path.display());
        return Ok(None);
    }
    let options = OpenOptions {
        raw: Some(RawLayout::new(dims, RawType::U8)),
        ..OpenOptions::default()
    };
    let (_, values) = open(&path, &options)?.scalar("value")?;
    Ok(Some(Volume { name, dims, values }))
}

/// Computes a head: skin (60 to 90) around a skull (200) around a brain that varies (100 to 130), with eye sockets. It
/// has 128 voxels along each axis for images of 512, fewer for smaller ones. Edges are two voxels of 128 wide, as a
/// scanner's are.
pub(crate) fn head(size: usize) -> Volume {
    let side = (size / 4).clamp(32, 128);
    // 1 within, 0 outside, over an edge of `width`.
    let within = |distance: f64, width: f64| 0.5 - 0.5 * (distance / width).tanh();
    let ellipsoid = |p: DVec3, centre: [f64; 3], radii: [f64; 3]| {
        let radii = DVec3::from(radii);
        ((p - DVec3::from(centre)) / radii).length() - 1.0
    };
    let value = |p: DVec3| {
        let edge = 0.03;
        let skin = within(ellipsoid(p, [0.0; 3], [0.72, 0.88, 0.92]), edge);
        let sockets = [-0.27, 0.27].map(|x| within(ellipsoid(p, [x, -0.75, 0.1], [0.17; 3]), 0.1));
        let skull = within(ellipsoid(p, [0.0; 3], [0.64, 0.80, 0.84]), edge)
            * (1.0 - sockets[0])
            * (1.0 - sockets[1]);
        let brain = within(ellipsoid(p, [0.0; 3], [0.55, 0.71, 0.75]), edge);
        let folds = 15.0 * (17.0 * p.x).sin() * (14.0 * p.y + 2.0 * p.z).sin() * (15.0 * p.z).cos();
        let flesh = 75.0 + 15.0 * (5.0 * p.z).sin();
        skin * (flesh + skull * (200.0 - flesh + brain * (115.0 + folds - 200.0)))
    };
    let at = |i: usize| (i as f64 + 0.5) / side as f64 * 2.0 - 1.0;
    let values = (0..side.pow(3)).map(|i| {
        value(DVec3::new(
            at(i % side),
            at(i / side % side),
            at(i / (side * side)),
        ))
    });
    Volume {
        name: "computed head",
        dims: [side; 3],
        values: Values::U8(values.map(|v| v.clamp(0.0, 255.0).round() as u8).collect()),
    }
}
