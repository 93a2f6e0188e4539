//! Defines the options of `ewa-splat render`.

use std::path::PathBuf;

use super::backdrop::BackdropOptions;
use super::ending::Ending;
use super::exposure::ExposureOptions;
use super::projection::ProjectionOptions;
use crate::command::annotations::AnnotationOptions;
use crate::command::cut::CutOptions;
use crate::command::input::DataOptions;
use crate::command::legend::LegendOptions;
use crate::command::lit::LightOptions;
use crate::command::parse;
use crate::command::parse::{Background, Clip};
use crate::command::sequence::SequenceOptions;
use crate::command::truth::ReferenceName;
use crate::command::typed::Typed;
use crate::command::viewpoint::CameraOptions;
use crate::image::DepthOf;
use crate::load::Input;
use crate::scene::ScaleName;
use clap::{Args, ValueEnum};
use glam::DVec3;

#[derive(Args)]
pub(in crate::command) struct Arguments {
    /// Files to render together; FILE@FIELD shows another field of one, FILE@FIELD@FUNCTION by another transfer
    /// function
    #[arg(required = true, value_name = "FILE[@FIELD[@FUNCTION]]", value_parser = parse::input())]
    pub(in crate::command) inputs: Vec<Input>,
    /// Image to write: png, exr, pfm or npy
    #[arg(long, value_name = "FILE")]
    pub(in crate::command) out: PathBuf,
    /// Width and height in pixels [default: 1024x1024]
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    pub(in crate::command) size: Option<[usize; 2]>,
    /// Render on this back end
    #[arg(long, value_enum, default_value = "auto")]
    pub(in crate::command) backend: BackendName,
    /// Under mpirun or srun: the ranks share the scene and draw it together, on their processors, or draw the pictures
    /// of a sequence in turn; the first writes. The picture is that of one process. (A build with the feature mpi)
    #[arg(long, conflicts_with_all = ["reference", "measure_error", "calibrate", "column_mean"])]
    pub(in crate::command) mpi: bool,
    #[command(flatten)]
    pub(in crate::command) camera: CameraOptions,
    #[command(flatten)]
    pub(in crate::command) projection: ProjectionOptions,
    #[command(flatten)]
    pub(in crate::command) exposure: ExposureOptions,
    /// Leave inputs whose formats have other axes than the first has (y up beside z up) as they are, instead of turning
    /// them to it
    #[arg(long, help_heading = "Placement")]
    pub(in crate::command) keep_axes: bool,
    #[command(flatten)]
    pub(in crate::command) data: DataOptions,
    /// Particles of a periodic box with these edges: kernels that cross a face come in at the opposite one, and the
    /// picture ends at the faces
    #[arg(long, value_name = "x,y,z", value_parser = parse::edges, help_heading = "Particles",
          conflicts_with_all = ["mpi", "series", "reference"])]
    pub(in crate::command) periodic: Option<DVec3>,
    /// The point in the middle of the periodic box [default: half of its edges]
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, allow_hyphen_values = true,
          help_heading = "Particles", requires = "periodic")]
    pub(in crate::command) centre: Option<DVec3>,
    #[command(flatten)]
    pub(in crate::command) method: Method,
    #[command(flatten)]
    pub(in crate::command) light: LightOptions,
    #[command(flatten)]
    pub(in crate::command) output: Output,
    #[command(flatten)]
    pub(in crate::command) backdrop: BackdropOptions,
    #[command(flatten)]
    pub(in crate::command) cut: CutOptions,
    #[command(flatten)]
    pub(in crate::command) legend: LegendOptions,
    #[command(flatten)]
    pub(in crate::command) sequence: SequenceOptions,
    #[command(flatten)]
    pub(in crate::command) annotations: AnnotationOptions,
    /// Use of the picture once it is drawn.
    #[arg(skip)]
    pub(in crate::command) ending: Ending,
}

impl Arguments {
    /// Records in the picture how it was made, unless this is not wanted.
    pub(in crate::command) fn record_as(&mut self, typed: Typed) {
        if !self.output.no_provenance {
            self.ending = Ending::recorded(typed, self.mpi);
        }
    }
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum BackendName {
    /// A hardware GPU where there is one or EWA_ADAPTER names one; the CPU otherwise, and for scenes that it
    /// draws before a driver is loaded
    Auto,
    /// A GPU, or a software adapter where there is no other; the environment variable EWA_ADAPTER
    /// chooses one by a part of its name
    Gpu,
    Cpu,
}

#[derive(Args)]
#[command(next_help_heading = "Method")]
pub(in crate::command) struct Method {
    /// Error in linear colour that approximations may add to 99.9 % of pixels [default: 1/255]
    #[arg(long, value_name = "T", value_parser = parse::tolerance)]
    pub(in crate::command) tolerance: Option<f32>,
    /// Draw kernels by this footprint; adaptive takes the cheapest that fits the tolerance
    #[arg(long, value_enum, default_value = "adaptive")]
    pub(in crate::command) filter: FilterName,
    /// For adaptive, instead of the tolerance: c_min,c_max of Chen et al. 2004. Kernels nearer than
    /// c_min r_k/r_h are drawn without the low-pass filter, those beyond c_max (1 + 2 tan²(fov/2))
    /// r_k/r_h by it alone; the paper's are 0.3,2
    #[arg(long, value_name = "CMIN,CMAX", value_parser = parse::thresholds)]
    pub(in crate::command) thresholds: Option<[f32; 2]>,
    /// Whether adaptive merges particles far below a pixel
    #[arg(long, value_enum, default_value = "auto", value_name = "auto|off")]
    pub(in crate::command) level_of_detail: Detail,
    /// How kernels that lie behind one another become a picture
    #[arg(long, value_enum, default_value = "over", conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) composite: CompositeName,
    /// Thickness of slabs (or sheets) in world units [default: slabs from the tolerance, sheets from
    /// the distance between samples]
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "composite",
          conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) slab_thickness: Option<f64>,
    /// With slabs: ask the transfer function for the mean value of each slab at each pixel, instead of
    /// for each particle
    #[arg(long, conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) post_classification: bool,
    /// Space in which colours are composited: auto is encoded for splats of radiance fields alone, as
    /// viewers show them, and linear elsewhere
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) blend: BlendName,
    /// Order in which kernels hide one another: auto is by depth for splats of radiance fields alone, as viewers
    /// sort them, and by distance elsewhere
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) order: OrderName,
    /// Ask the transfer function over each kernel's extent, with the field's slope, or at each
    /// sample's value alone
    #[arg(long, value_enum, default_value = "extent", conflicts_with_all = ["column_density"])]
    pub(in crate::command) classify: ClassifyName,
    /// Keep the side nx x + ny y + nz z + d >= 0 of everything, or (six numbers) what lies in a box;
    /// again for more, eight planes at most
    #[arg(long, value_name = "nx,ny,nz,d|x0,y0,z0,x1,y1,z1", value_parser = parse::clip,
          allow_hyphen_values = true)]
    pub(in crate::command) clip: Vec<Clip>,
    /// Opacity of an optical depth: 1 - exp(-tau), or min(tau, 1)
    #[arg(long, value_enum, default_value = "exponential")]
    pub(in crate::command) opacity: Opacity,
    /// Variance of the low-pass filter in square pixels [default: 0.15 for volumes with a field, 0.3 for
    /// bare particles, 1 with surfels or splats and for column densities]
    #[arg(long, value_name = "VARIANCE_PX2", value_parser = parse::variance)]
    pub(in crate::command) low_pass: Option<f32>,
    /// Cut-off radius in standard deviations [default: from the tolerance]
    #[arg(long, value_name = "R", value_parser = parse::cutoff)]
    pub(in crate::command) cutoff: Option<f32>,
    /// Give kernels smaller than a pixel the opacity that each has alone: right for sparse sets of
    /// opaque particles, too faint where they fill pixels together
    #[arg(long)]
    pub(in crate::command) sub_pixel_opacity: bool,
    /// Refine kernels of grids where the field bends between nodes, or jumps between cells, and the transfer
    /// function or the iso-surface shows it: nearer to the data's own field, for more kernels
    #[arg(
        long,
        value_enum,
        default_value = "auto",
        conflicts_with = "column_density"
    )]
    pub(in crate::command) refine: Detail,
    /// Draw tiles with opaque edges at four samples a pixel, and average their colours
    #[arg(long, value_enum, default_value = "auto", conflicts_with_all = ["reference", "column_density", "show"])]
    pub(in crate::command) opaque_edges: Detail,
    /// Draw a hundredth of the picture again with everything exact, and state with --stats, or in
    /// words, what the picture errs by
    #[arg(long, conflicts_with_all = ["reference", "column_density", "show"])]
    pub(in crate::command) measure_error: bool,
    /// Draw as fast as the tolerance allows by measurement instead of by bounds: at the greatest one at which
    /// a sample of the picture errs by less than half of the one that was asked for
    #[arg(long, conflicts_with_all = ["reference", "column_density", "show"])]
    pub(in crate::command) calibrate: bool,
    /// Integrate the true image in f64 instead of splatting: slow, to the error that --tolerance
    /// states [default: 1e-4]; of the kernels, or of the data's own field (one grid)
    #[arg(long, value_enum, value_name = "kernels|data", num_args = 0..=1, require_equals = true,
          default_missing_value = "kernels", hide_possible_values = true,
          conflicts_with_all = ["backend", "filter", "opacity", "cutoff", "depth", "frames",
                                "show", "sub_pixel_opacity"])]
    pub(in crate::command) reference: Option<ReferenceName>,
    /// Write the line integral of the field along each pixel's ray instead of a picture: no
    /// transfer function, no opacity; exr, pfm and npy hold the values, png their logarithm in
    /// viridis, or what --transfer-function NAME, --range and --scale say. Values are means over pixels, or filtered by
    /// --low-pass: below 1 that loses mass of kernels smaller than a pixel
    #[arg(long, conflicts_with_all = ["reference", "opacity", "background", "depth", "flatten",
                                      "surface", "surface_opacity", "opacity_scale", "write_transfer_function", "show",
                                      "sub_pixel_opacity"])]
    pub(in crate::command) column_density: bool,
    /// Beside --column-density: write the mean of this field along each ray, weighed by mass where it is known, or by
    /// what the columns are of
    #[arg(long, value_name = "FIELD")]
    pub(in crate::command) column_mean: Option<String>,
    /// Integrate this field as a density with --column-density, as --field does [default: mass where
    /// it is known, then a density]
    #[arg(long, value_name = "FIELD", requires = "column_density", conflicts_with_all = ["field", "column_mean"])]
    pub(in crate::command) column_of: Option<String>,
    /// Weigh the mean of --column-mean by this field times volume, as --field does [default: mass where
    /// it is known]
    #[arg(
        long,
        value_name = "FIELD",
        requires = "column_mean",
        conflicts_with = "field"
    )]
    pub(in crate::command) weight: Option<String>,
    /// Beside --column-density: write the field on this plane across an axis instead of its integral along the axis: the
    /// sum of the kernels at the pixels' centres, or with --column-mean the mean there
    #[arg(long, value_name = "AXIS=V", value_parser = parse::slice, allow_hyphen_values = true, requires = "column_density",
          conflicts_with_all = ["eye", "camera", "azimuth", "elevation", "up", "fov", "mpi", "filter", "thresholds",
                                "low_pass", "tolerance"])]
    pub(in crate::command) slice: Option<parse::SlicePlane>,
}

/// Appearance of the picture of a column density: the colour map's name, the range of the values
/// and their scale, each if asked for.
pub(in crate::command) struct ColumnLook<'a> {
    pub(in crate::command) map: Option<&'a str>,
    pub(in crate::command) range: Option<[f32; 2]>,
    pub(in crate::command) scale: Option<ScaleName>,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum FilterName {
    Adaptive,
    Exact,
    Ewa,
    Reconstruction,
    LowPass,
    Isotropic,
    UniformScaling,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum CompositeName {
    /// Each kernel by itself, in the order of their centres
    Over,
    /// Whole kernels summed in sheets parallel to the image
    Sheets,
    /// Whole kernels summed in sheets across the volume's axis nearest to the view
    AxisSheets,
    /// Kernels sliced into slabs parallel to the image: converges to the true integral
    Slabs,
    /// The colour of the greatest mean value over the slabs of each ray
    Maximum,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum BlendName {
    /// The space that the scene's colours are made for
    Auto,
    /// sRGB codes, decoded afterwards
    Encoded,
    /// Linear light
    Linear,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum OrderName {
    /// The order that the scene's kernels are made for
    Auto,
    /// By the distance from the eye
    Distance,
    /// By the depth along the camera's axis
    Depth,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum ClassifyName {
    /// Over each kernel's extent
    Extent,
    /// At its value alone
    Particle,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum Opacity {
    Exponential,
    Linear,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum Detail {
    Auto,
    Off,
}

#[derive(Clone, Copy, ValueEnum)]
pub(in crate::command) enum ShowName {
    /// The picture
    Scene,
    /// Each splat in the colour of what draws it: exact red, affine green, reconstruction kernel
    /// alone blue, low-pass filter alone yellow, round cyan; merged in shades of magenta
    Choice,
    /// How many kernels each pixel evaluates until it is opaque, whatever the background: exr, pfm
    /// and npy hold the numbers, png has viridis from 0 to the largest
    Count,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(in crate::command) enum DepthOfName {
    /// The kernel at which half the light is gone
    Kernel,
    /// Place within kernels where half of the light from behind is gone
    Half,
    /// Place of the first 256th of the pixel's opacity
    Entry,
    /// Place where all but a 256th of the pixel's opacity is reached
    Exit,
    /// Place where half of the pixel's own opacity is reached
    Median,
    /// The mean of the depths, weighted by what each adds to the opacity
    Mean,
}

impl DepthOfName {
    /// Returns the depth of a deep image; `None` for that of kernels.
    pub(in crate::command) fn of_deep(self) -> Option<DepthOf> {
        match self {
            Self::Kernel => None,
            Self::Half => Some(DepthOf::Half),
            Self::Entry => Some(DepthOf::Entry),
            Self::Exit => Some(DepthOf::Exit),
            Self::Median => Some(DepthOf::Median),
            Self::Mean => Some(DepthOf::Mean),
        }
    }
}

#[derive(Args)]
#[command(next_help_heading = "Output")]
pub(in crate::command) struct Output {
    /// Show this in the image
    #[arg(long, value_enum, default_value = "scene")]
    pub(in crate::command) show: ShowName,
    /// Colour behind everything: linear numbers from 0 to 1, a name or #rrggbb of the web, or none, which leaves
    /// the image transparent [default: a dark grey, #1c1c21, of png; none of others, and in another renderer's picture]
    #[arg(long, value_name = "r,g,b|NAME|none", value_parser = parse::background, allow_hyphen_values = true)]
    pub(in crate::command) background: Option<Background>,
    /// Write counts, memory and times as JSON; - to standard output
    #[arg(long, value_name = "FILE")]
    pub(in crate::command) stats: Option<PathBuf>,
    /// Write the depth at which half the light is gone: exr, pfm or npy
    #[arg(long, value_name = "FILE")]
    pub(in crate::command) depth: Option<PathBuf>,
    /// Depth that --depth writes
    #[arg(long, value_enum, default_value = "kernel", requires = "depth",
          conflicts_with_all = ["depth_in", "background_image", "mpi"])]
    pub(in crate::command) depth_of: DepthOfName,
    /// Write a deep image: colours and opacities along the ray of each pixel, so that another program can put things at
    /// any depth into the picture; exr
    #[arg(long, value_name = "FILE", conflicts_with_all = ["reference", "column_density", "mpi", "depth_in",
          "background_image", "turntable", "camera_path", "series", "show"])]
    pub(in crate::command) deep: Option<PathBuf>,
    /// Write the transfer function that is drawn as a JSON file, which --transfer-function reads
    #[arg(long, value_name = "FILE")]
    pub(in crate::command) write_transfer_function: Option<PathBuf>,
    /// Write the normals of opaque surfels, world space: exr, pfm or npy
    #[arg(long, value_name = "FILE", conflicts_with_all = ["reference", "column_density"])]
    pub(in crate::command) normals: Option<PathBuf>,
    /// Leave out of a png or exr how it was made: the command, the version, names and hashes of inputs. `verify` needs
    /// them
    #[arg(long)]
    pub(in crate::command) no_provenance: bool,
    /// Render the frame N times after a warm-up and report median times
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(in crate::command) frames: Option<u32>,
}
