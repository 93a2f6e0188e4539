//! Defines the metadata of a prepared scene: the value of the schema's key `ewa_splat`, JSON.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::blocks::AmplitudeSummary;
use crate::scene::headers::{ColourHeader, StrengthHeader, ValuesHeader};
use crate::scene::{Lattice, LatticeSpacing, TransferFunction, ValueScale};

/// Version of the files that are written, and the only one that is read.
pub(super) const VERSION: u32 = 1;

/// Metadata that a front end keeps of the data in a scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Files that the scene was made of.
    pub inputs: Vec<String>,
    /// Field that each volume shows, by name.
    pub fields: Vec<Option<String>>,
    /// Titles of these fields in legends.
    pub titles: Vec<Option<String>>,
    /// Least and greatest coordinates of the data; empty if none is finite.
    pub corners: Vec<[[f64; 3]; 2]>,
    /// Upward direction, unit length.
    pub up: [f64; 3],
    /// Default direction of view, if the data have a front.
    pub front: Option<[f64; 3]>,
    /// Whether the data are a plane.
    pub is_plane: bool,
    /// Whether a mesh determines the upward direction; it is then ignored beside other data.
    pub is_of_mesh: bool,
    /// Whether the scene was made for column densities, which have no sharp boundaries.
    pub for_columns: bool,
}

/// Whole value of the key.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Head {
    pub(super) version: u32,
    pub(super) about: About,
    pub(super) volumes: Vec<Volume>,
}

/// A volume and its levels of detail; each is a batch of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Volume {
    pub(super) transfer_function: Option<Function>,
    pub(super) amplitudes: Amplitudes,
    pub(super) lattice: Option<Grid>,
    /// Headers of the volume itself, then of its levels of detail, the finest first.
    pub(super) batches: Vec<BatchHead>,
}

/// Header of a batch: the kind of its particles and columns.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BatchHead {
    pub(crate) particles: Particles,
    pub(crate) strength: StrengthHeader,
    pub(crate) colour: ColourHeader,
    pub(crate) values: Option<ValuesHeader>,
    /// Scales of the local models' codes.
    pub(crate) local_model_scales: Option<[f32; 2]>,
    pub(crate) has_normals: bool,
    pub(crate) has_indices: bool,
    pub(crate) has_planes: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Particles {
    /// Cubes of `cube` cells of the lattice along each edge.
    Lattice {
        cube: usize,
    },
    Isotropic,
    Anisotropic,
    Surfels {
        is_one_sided: bool,
    },
}

/// Stored form of [`AmplitudeSummary`].
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Amplitudes {
    largest: f64,
    sum: f64,
    not_finite: usize,
}

/// A lattice with its ghosts, and the faces that cut its kernels.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Grid {
    pub(crate) dims: [usize; 3],
    pub(crate) spacing: Spacing,
    pub(crate) kernel_width: f64,
    /// Ghosts before the first sample along each axis, and as many behind the last; `None` if no face cuts kernels.
    pub(crate) ghosts: Option<[usize; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Spacing {
    /// Position of the first sample, and the columns of the step.
    Uniform {
        origin: [f64; 3],
        step: [[f64; 3]; 3],
    },
    /// Coordinates along x, y and z.
    Rectilinear { coordinates: [Vec<f64>; 3] },
}

/// A transfer function, bit for bit.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Function {
    range: [f32; 2],
    scale: Scale,
    unit_distance: f64,
    /// Red, green, blue and extinction of each entry, f32, little-endian, as base64.
    table: String,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Scale {
    Linear,
    Shifted { origin: f64, unit: f64 },
    Log,
    Symlog { linear: f32 },
}

impl Function {
    pub(crate) fn of(transfer: &TransferFunction) -> Self {
        let entries = transfer.table().as_flattened();
        let bytes: Vec<u8> = entries.iter().flat_map(|x| x.to_le_bytes()).collect();
        Self {
            range: transfer.range(),
            scale: match transfer.value_scale() {
                ValueScale::Linear => Scale::Linear,
                ValueScale::Shifted { origin, unit } => Scale::Shifted { origin, unit },
                ValueScale::Log => Scale::Log,
                ValueScale::Symlog { linear } => Scale::Symlog { linear },
            },
            unit_distance: transfer.unit_distance(),
            table: STANDARD.encode(bytes),
        }
    }

    /// Decodes the function; `None` if it is not valid.
    pub(crate) fn transfer(&self) -> Option<TransferFunction> {
        let bytes = STANDARD.decode(&self.table).ok()?;
        let (words, []) = bytes.as_chunks::<4>() else {
            return None;
        };
        let numbers: Vec<f32> = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
        let (entries, []) = numbers.as_chunks::<4>() else {
            return None;
        };
        let scale = match self.scale {
            Scale::Linear => ValueScale::Linear,
            Scale::Shifted { origin, unit } if unit > 0.0 && (origin + unit).is_finite() => {
                ValueScale::Shifted { origin, unit }
            }
            Scale::Shifted { .. } => return None,
            Scale::Log => ValueScale::Log,
            Scale::Symlog { linear } if linear > 0.0 && linear.is_finite() => {
                ValueScale::Symlog { linear }
            }
            Scale::Symlog { .. } => return None,
        };
        let table = entries.to_vec();
        TransferFunction::of_entries(table, self.range, self.unit_distance, scale)
    }
}

impl Grid {
    pub(crate) fn of(lattice: &Lattice, kernel_width: f64, ghosts: Option<[usize; 3]>) -> Self {
        Self {
            dims: lattice.dims,
            spacing: match &lattice.spacing {
                LatticeSpacing::Uniform { origin, step } => Spacing::Uniform {
                    origin: origin.to_array(),
                    step: step.to_cols_array_2d(),
                },
                LatticeSpacing::Rectilinear { coordinates } => Spacing::Rectilinear {
                    coordinates: coordinates.clone(),
                },
            },
            kernel_width,
            ghosts,
        }
    }

    pub(crate) fn lattice(&self) -> Lattice {
        Lattice {
            dims: self.dims,
            spacing: match &self.spacing {
                Spacing::Uniform { origin, step } => LatticeSpacing::Uniform {
                    origin: DVec3::from(*origin),
                    step: DMat3::from_cols_array_2d(step),
                },
                Spacing::Rectilinear { coordinates } => LatticeSpacing::Rectilinear {
                    coordinates: coordinates.clone(),
                },
            },
        }
    }
}

impl From<AmplitudeSummary> for Amplitudes {
    fn from(summary: AmplitudeSummary) -> Self {
        Self {
            largest: summary.largest,
            sum: summary.sum,
            not_finite: summary.not_finite,
        }
    }
}

impl From<Amplitudes> for AmplitudeSummary {
    fn from(amplitudes: Amplitudes) -> Self {
        Self {
            largest: amplitudes.largest,
            sum: amplitudes.sum,
            not_finite: amplitudes.not_finite,
        }
    }
}
