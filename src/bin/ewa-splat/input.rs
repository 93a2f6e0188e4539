//! Options that say which data to read and how to turn it into particles.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use ewa_splat::Result;
use ewa_splat::io::{Dataset, OpenOptions, RawLayout, RawType};
use ewa_splat::sample::{SampleOptions, Sampled, TransferChoice};
use glam::DVec3;

use crate::parse;

#[derive(Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct DataOptions {
    /// Field to show; a vector field gives its magnitude, NAME:x a component
    #[arg(long, value_name = "NAME")]
    pub(crate) field: Option<String>,
    /// PLOT3D solution of a grid; by default a file beside it, named with q for xyz
    #[arg(long, value_name = "FILE")]
    pub(crate) solution: Option<PathBuf>,
    /// Transfer function: a JSON file (ours or ParaView's), or a colour map's name
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) transfer_function: Option<String>,
    /// Length over which the transfer function's opacity accumulates [default: mean spacing]
    #[arg(long, value_name = "D", value_parser = parse::positive)]
    pub(crate) unit_distance: Option<f64>,
    /// Kernel width: standard deviation over spacing [default: 0.6; 0.55 sharp, 0.7 smooth]
    #[arg(long, value_name = "RHO", value_parser = parse::positive)]
    pub(crate) kernel_width: Option<f64>,
    /// Raw volume: samples along x, y, z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims)]
    pub(crate) dims: Option<[usize; 3]>,
    /// Raw volume: distance between samples
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, requires = "dims",
          default_value = "1,1,1", allow_hyphen_values = true)]
    pub(crate) spacing: DVec3,
    /// Raw volume: position of the first sample
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, requires = "dims",
          default_value = "0,0,0", allow_hyphen_values = true)]
    pub(crate) origin: DVec3,
    /// Raw volume: type of a sample
    #[arg(long = "type", value_enum, requires = "dims", default_value = "u8")]
    pub(crate) scalar: Scalar,
    /// Raw volume: byte order
    #[arg(long, value_enum, requires = "dims", default_value = "little")]
    pub(crate) endian: Endian,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Scalar {
    U8,
    I16,
    U16,
    F32,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Endian {
    Little,
    Big,
}

impl DataOptions {
    pub(crate) fn open(&self, path: &Path) -> Result<Dataset> {
        let raw = self.dims.map(|dims| RawLayout {
            dims,
            spacing: self.spacing,
            origin: self.origin,
            scalar: match self.scalar {
                Scalar::U8 => RawType::U8,
                Scalar::I16 => RawType::I16,
                Scalar::U16 => RawType::U16,
                Scalar::F32 => RawType::F32,
            },
            big_endian: self.endian == Endian::Big,
        });
        ewa_splat::io::open(
            path,
            &OpenOptions {
                raw,
                solution: self.solution.clone(),
            },
        )
    }

    pub(crate) fn sample(&self, dataset: Dataset) -> Result<Sampled> {
        let defaults = SampleOptions::default();
        let options = SampleOptions {
            field: self.field.clone(),
            kernel_width: self.kernel_width.unwrap_or(defaults.kernel_width),
            transfer: match &self.transfer_function {
                None => TransferChoice::Automatic,
                // A colour map's name has no dot and no slash in it.
                Some(name) if name.contains(['.', '/', '\\']) || Path::new(name).exists() => {
                    TransferChoice::File(name.into())
                }
                Some(name) => TransferChoice::Named(name.clone()),
            },
            unit_distance: self.unit_distance,
        };
        ewa_splat::sample::volume(dataset, &options)
    }
}
