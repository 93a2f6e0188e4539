//! Defines the options that select data and control their conversion to particles.

use std::path::PathBuf;

use crate::data::dataset::Dataset;
use crate::data::particle_type::ParticleType;
use crate::data::smoothing::{LengthMeaning, SphKernel};
use crate::error::{Hint, Parameter};
use crate::io::{OpenOptions, RawLayout, RawType, ReadAs, ScaleMeaning, StepChoice};
use crate::load::input::transfer_of;
use crate::load::{Input, Steps, is_prepared, steps};
use crate::sample::mesh::Spread;
use crate::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, ParticleShape, PurposeOptions, SampleOptions,
    Sampled, TransferChoice,
};
use crate::scene::{ScaleName, SplatRule};
use crate::{Error, Result};
use clap::{Args, ValueEnum};
use glam::DVec3;

use super::edits::EditOptions;
use super::parse::{self, Spacing, TypeName};
use super::progress::print;

#[derive(Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct DataOptions {
    /// Field to show; a vector field gives its magnitude, NAME:x a component, NAME@cells the one of cells
    #[arg(long, value_name = "NAME")]
    pub(crate) field: Option<String>,
    /// PLOT3D solution or functions of a grid; by default files beside it, named with q and with f or fun for xyz
    #[arg(long, value_name = "FILE")]
    pub(crate) solution: Option<PathBuf>,
    /// Read points with faces (PLY, VTK) as this [default: a mesh]
    #[arg(long = "as", value_enum, value_name = "WHAT")]
    pub(crate) read_as: Option<ReadAsName>,
    /// OBJ or PLY mesh: image for the parts that have texture coordinates and no texture
    #[arg(long, value_name = "FILE")]
    pub(crate) texture: Option<PathBuf>,
    /// Transfer function: a JSON file (ours or ParaView's), or a colour map's name for the colours of the automatic
    /// one
    #[arg(long, value_name = "FILE|NAME")]
    pub(crate) transfer_function: Option<String>,
    /// The range of an automatic transfer function or of a colour map [default: that of the values, less a
    /// thousandth at either end]
    #[arg(long, value_name = "LO,HI", value_parser = parse::range, allow_hyphen_values = true)]
    pub(crate) range: Option<[f64; 2]>,
    /// Space values in an automatic transfer function evenly or by their logarithm; symlog is for either sign
    /// [default: log where positive values lie over decades, otherwise linear]
    #[arg(long, value_name = "SCALE", value_enum)]
    pub(crate) scale: Option<Scale>,
    /// Make everything that a transfer function shows F times as dense
    #[arg(long, value_name = "F", value_parser = parse::positive, default_value_t = 1.0,
          hide_default_value = true, allow_hyphen_values = true)]
    pub(crate) opacity_scale: f64,
    /// Length over which the transfer function's opacity accumulates [default: mean spacing]
    #[arg(long, value_name = "D", value_parser = parse::positive, allow_hyphen_values = true)]
    pub(crate) unit_distance: Option<f64>,
    /// Kernel width: standard deviation over spacing [default: 0.6; 0.55 sharp, 0.7 smooth]
    #[arg(long, value_name = "RHO", value_parser = parse::positive, allow_hyphen_values = true)]
    pub(crate) kernel_width: Option<f64>,
    /// Files of several time steps: show this one, counted from 0, or `last` [default: the first]
    #[arg(long, value_name = "N|last", value_parser = parse::step, conflicts_with = "time")]
    pub(crate) step: Option<StepChoice>,
    /// Files of several time steps: show the one whose time is nearest to T
    #[arg(long, value_name = "T", value_parser = parse::finite, allow_hyphen_values = true)]
    pub(crate) time: Option<f64>,
    /// Particles: what their lengths mean, where the file's convention does not hold
    #[arg(long, value_enum, value_name = "MEANING")]
    pub(crate) length: Option<Length>,
    /// Particles: smoothing kernel of their lengths, which columns draw [default: the file's, or cubic]
    #[arg(long, value_enum, value_name = "KERNEL")]
    pub(crate) kernel: Option<Kernel>,
    /// Particles: one length for all instead of the file's; a standard deviation unless --length
    #[arg(long, value_name = "R", value_parser = parse::positive, allow_hyphen_values = true)]
    pub(crate) radius: Option<f64>,
    /// Splats of glTF files, columns scale_0..2 of tables: what they are, standard deviations or their natural logarithms
    /// [default: logarithms where any is negative]
    #[arg(long, value_enum, value_name = "WHAT")]
    pub(crate) scales: Option<Scales>,
    /// Splats of radiance fields: rule of their renderer [default: the file's]
    #[arg(long, value_enum, value_name = "RULE")]
    pub(crate) splat_rule: Option<SplatRuleName>,
    /// Particles: shape of those that state a length at most
    #[arg(long, value_enum, value_name = "SHAPE", default_value = "auto")]
    pub(crate) shape: Shape,
    /// Correct the cell volumes of irregular data N times to reproduce a uniform field
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true,
          value_parser = clap::value_parser!(u32).range(0..=100))]
    pub(crate) shepard: u32,
    /// Meshes: surfels per unit area [default: by the texture's texels and the mesh's size, no more than one
    /// for each pixel on half of those that it covers, a million in all]
    #[arg(long, value_name = "N", value_parser = parse::positive, allow_hyphen_values = true)]
    pub(crate) density: Option<f64>,
    /// Meshes: surfels in all. `convert`, splats: number to which they are merged
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..),
          conflicts_with_all = ["density", "spacing"])]
    pub(crate) count: Option<u32>,
    /// Grids: how the data end: cut sharply at their boundary, or softly, density falling to half at the
    /// faces [default: sharp where the transfer function shows any of the boundary; column densities: soft]
    #[arg(long, value_name = "HOW", value_enum)]
    pub(crate) boundary: Option<BoundaryName>,
    /// Show the iso-surface of this value alone, opaque and lit, in the transfer function's colour there
    #[arg(long = "isosurface", visible_alias = "flatten", value_name = "VALUE",
          value_parser = parse::finite, allow_hyphen_values = true)]
    pub(crate) flatten: Option<f64>,
    /// Grids: show the boundary alone, opaque, lit, coloured by the field
    #[arg(long)]
    pub(crate) surface: bool,
    /// Grids: show the boundary around the volume, with this opacity head-on
    #[arg(long, value_name = "A", value_parser = parse::share, allow_hyphen_values = true)]
    pub(crate) surface_opacity: Option<f64>,
    /// Raw volume: samples along x, y, z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims)]
    pub(crate) dims: Option<[usize; 3]>,
    /// Raw volume: distance between samples, one for all axes or three [default: 1]. Meshes: mean
    /// distance between surfels, one number
    #[arg(long, value_name = "D|x,y,z", value_parser = parse::spacing, allow_hyphen_values = true)]
    pub(crate) spacing: Option<Spacing>,
    /// Raw volume: position of the first sample
    #[arg(long, value_name = "x,y,z", value_parser = parse::vector, requires = "dims",
          default_value = "0,0,0", allow_hyphen_values = true)]
    pub(crate) origin: DVec3,
    /// Raw volume: type of a sample, u8, i16, u16 or f32 [default: u8]. Snapshots: which particles, gas, dark-matter,
    /// disk, bulge, stars, black-holes, dust, boundary, sinks, or a number N for PartTypeN or itype N; several with
    /// commas between them are drawn together [default: gas, or else the first type; Phantom: all but sinks]
    #[arg(long = "type", value_name = "TYPE", value_delimiter = ',', value_parser = parse::type_name)]
    types: Vec<TypeName>,
    /// Raw volume: byte order
    #[arg(long, value_enum, requires = "dims", default_value = "little")]
    pub(crate) endian: Endian,
    #[command(flatten)]
    pub(crate) edits: EditOptions,
    /// True if inputs with different axes are left unrotated.
    #[arg(skip)]
    pub(crate) keeps_axes: bool,
}

/// Reading of points with faces.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum ReadAsName {
    /// The points as particles, with all that is known of them as fields
    Points,
    /// A mesh
    Mesh,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Scale {
    Linear,
    Log,
    Symlog,
}

/// Meaning of kernels' scales.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Scales {
    /// Standard deviations
    Linear,
    /// Their natural logarithms
    Log,
}

/// Rule by which splats are drawn.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum SplatRuleName {
    /// Nothing beyond 3 standard deviations
    Khr,
    /// No opacity below 1/255, .99 at most
    Inria,
    /// The same, and opacity times area stays as pixels widen a splat
    Mip,
    /// No limits
    Exact,
}

/// Meaning of a particle's length.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Length {
    /// The smoothing length h
    H,
    /// The radius at which the kernel ends
    Support,
    /// One standard deviation
    Sigma,
    /// Full width at half maximum
    Fwhm,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Kernel {
    /// Cubic spline M4, support 2 h
    Cubic,
    /// Quartic spline M5, support 2.5 h
    Quartic,
    /// Quintic spline M6, support 3 h
    Quintic,
    /// Wendland C2, support 2 h
    WendlandC2,
    /// Wendland C4, support 2 h
    WendlandC4,
    /// Wendland C6, support 2 h
    WendlandC6,
    /// The file's or cubic, drawn as a Gaussian of its variance
    Gaussian,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum BoundaryName {
    /// Kernels are cut at the boundary, and density goes on up to it
    Sharp,
    /// Kernels run out beyond it
    Soft,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Shape {
    /// Spheres; ellipsoids where particles without lengths are truly anisotropic
    Auto,
    /// Spheres
    Isotropic,
    /// After the covariance of the nearest neighbours (particles without lengths)
    Covariance,
    /// After Yu and Turk 2013 (particles with lengths)
    YuTurk,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum Endian {
    Little,
    Big,
}

pub(crate) fn refused_surface(expected: &'static str, found: &'static str) -> Error {
    let advice = Hint::LeaveOut(Parameter::Flatten);
    Error::invalid(Parameter::Flatten, "data", expected, found, advice)
}

impl DataOptions {
    /// Opens an input, places it and crops it.
    pub(crate) fn open(&self, input: &Input) -> Result<Dataset> {
        self.check_spacing()?;
        input.open(&self.open_options())
    }

    /// Returns the options for opening files, common to all inputs.
    pub(crate) fn open_options(&self) -> OpenOptions {
        let raw = self.dims.map(|dims| RawLayout {
            dims,
            spacing: match self.spacing {
                None => DVec3::ONE,
                Some(Spacing::Even(distance)) => DVec3::splat(distance),
                Some(Spacing::Axes(axes)) => axes,
            },
            origin: self.origin,
            scalar: self.sample_types().next().unwrap_or(RawType::U8),
            big_endian: self.endian == Endian::Big,
        });
        OpenOptions {
            raw,
            solution: self.solution.clone(),
            texture: self.texture.clone(),
            read_as: self.read_as.map(|name| match name {
                ReadAsName::Points => ReadAs::Points,
                ReadAsName::Mesh => ReadAs::Mesh,
            }),
            particle_type: None,
            time_step: None,
            scales: self.scales.map(|meaning| match meaning {
                Scales::Linear => ScaleMeaning::Linear,
                Scales::Log => ScaleMeaning::Logarithms,
            }),
        }
    }

    /// Returns the sample types that `--type` names.
    fn sample_types(&self) -> impl Iterator<Item = RawType> {
        self.types.iter().filter_map(|name| match name {
            TypeName::Samples(samples) => Some(*samples),
            TypeName::Particles(_) => None,
        })
    }

    /// Returns the particle types that `--type` names, without repetitions.
    fn particle_types(&self) -> Vec<ParticleType> {
        let mut types = Vec::new();
        for name in &self.types {
            if let TypeName::Particles(particles) = name
                && !types.contains(particles)
            {
                types.push(*particles);
            }
        }
        types
    }

    /// Stores the edits of each input.
    ///
    /// # Errors
    /// The errors of [`EditOptions::of_inputs`](super::edits::EditOptions::of_inputs).
    pub(crate) fn note_edits(&self, inputs: &mut [Input]) -> Result<()> {
        let edits = self.edits.of_inputs(inputs.len())?;
        for (input, edit) in inputs.iter_mut().zip(edits) {
            input.edit = edit;
        }
        Ok(())
    }

    /// Resolves the inputs of a picture: their edits, the files of collections, the particle
    /// types of snapshots, and boundaries beside volumes.
    ///
    /// - `is_series`: whether the inputs are time steps.
    ///
    /// # Errors
    /// The errors of [`Self::note_edits`], [`steps`] and [`Self::resolved`].
    pub(crate) fn inputs(&self, mut named: Vec<Input>, is_series: bool) -> Result<Vec<Input>> {
        self.note_edits(&mut named)?;
        let shown = match (is_series, self.step_choice()) {
            (false, None) => Steps::First,
            (false, Some(choice)) => Steps::One(choice),
            (true, None) => Steps::Series,
            (true, Some(_)) => {
                let found = "one step of time beside them";
                let advice = "leave --step and --time out, or --series";
                return Err(Error::invalid(
                    "--series",
                    "use",
                    "all steps of time",
                    found,
                    advice,
                ));
            }
        };
        let inputs = steps(named, shown, &self.open_options(), &print)?;
        let inputs = self.resolved(inputs, is_series)?;
        let Some(opacity) = self.surface_opacity else {
            return Ok(inputs);
        };
        // The boundary is an input of its own: both show one field by one transfer function.
        let with_surface = inputs.into_iter().flat_map(|input| {
            let is_data = !is_prepared(&input.path);
            let surface = is_data.then(|| input.of_surface(opacity));
            std::iter::once(input).chain(surface)
        });
        Ok(with_surface.collect())
    }

    /// Returns true if the boundary of grids is shown in place of their volumes.
    pub(crate) fn is_boundary_alone(&self) -> bool {
        self.surface && self.surface_opacity.is_none()
    }

    /// Returns the option that shows the boundary of grids, if one is given.
    fn boundary_option(&self) -> Option<&'static str> {
        match self.surface_opacity {
            Some(_) => Some("--surface-opacity"),
            None => self.surface.then_some("--surface"),
        }
    }

    /// Returns the option that shows a surface of the data, if one is given.
    pub(crate) fn surface_option(&self) -> Option<&'static str> {
        let is_iso = self.flatten.is_some();
        is_iso.then_some("--isosurface").or(self.boundary_option())
    }

    /// Returns the time step that was asked for.
    pub(crate) fn step_choice(&self) -> Option<StepChoice> {
        self.step.or_else(|| self.time.map(StepChoice::Time))
    }

    /// Replaces each snapshot by one input for each particle type that was asked for.
    ///
    /// - `is_series`: whether the inputs are time steps.
    ///
    /// # Errors
    /// Sample or particle types for inputs that have none; more types than the input allows.
    pub(crate) fn resolved(&self, inputs: Vec<Input>, is_series: bool) -> Result<Vec<Input>> {
        let fault = |place: &str, expected: &str, found: String, advice: &str| {
            Err(Error::invalid("--type", place, expected, found, advice))
        };
        let samples: Vec<RawType> = self.sample_types().collect();
        if !samples.is_empty() && self.dims.is_none() {
            let expected = "--dims X,Y,Z beside the type of a raw volume's samples";
            return fault("use", expected, "none".into(), "add it");
        }
        if samples.len() > 1 {
            let found = format!("{} of them", samples.len());
            return fault("use", "one type of samples", found, "leave the others out");
        }
        let types = self.particle_types();
        if types.is_empty() {
            return Ok(inputs);
        }
        if is_series && types.len() > 1 {
            let found = format!("{} of them", types.len());
            let advice = "name one, or leave --series out";
            return fault("use", "one type of particles in a series", found, advice);
        }
        let has_types = |input: &Input| crate::io::has_particle_types(&input.path).unwrap_or(false);
        let have_types: Vec<bool> = inputs.iter().map(has_types).collect();
        if !have_types.contains(&true) {
            let expected = "a snapshot of particles";
            return fault("inputs", expected, "none".into(), "leave it out");
        }
        let of_type = |(input, has_types): (Input, bool)| match has_types {
            true => types.iter().map(|t| input.of_type(*t)).collect(),
            false => vec![input],
        };
        Ok(inputs
            .into_iter()
            .zip(have_types)
            .flat_map(of_type)
            .collect())
    }

    /// Returns true if sample or particle types were asked for.
    pub(crate) fn has_types(&self) -> bool {
        !self.types.is_empty()
    }

    /// Checks `--spacing`. Without a raw volume, the option applies to meshes, as `--density` does.
    pub(crate) fn check_spacing(&self) -> Result<()> {
        let fault = |expected: &str, found: String, advice: &str| {
            Err(Error::invalid(
                "--spacing",
                "value",
                expected,
                found,
                advice,
            ))
        };
        match (self.dims, self.spacing, self.density) {
            (None, Some(Spacing::Axes(axes)), _) => fault(
                "one number for meshes, or --dims X,Y,Z beside three",
                format!("{},{},{} without --dims", axes.x, axes.y, axes.z),
                "add --dims, or give one number",
            ),
            (None, Some(Spacing::Even(_)), Some(density)) => fault(
                "either a spacing of surfels or their density",
                format!("--density {density}, too"),
                "leave one of them out",
            ),
            _ => Ok(()),
        }
    }

    /// Refuses `--isosurface` together with options that do not apply to an opaque surface.
    pub(crate) fn check_surface(&self) -> Result<()> {
        if let (true, Some(beside)) = (self.flatten.is_some(), self.boundary_option()) {
            let found = format!("{beside} beside it");
            let advice = "leave one of them out";
            let (option, expected) = (Parameter::Flatten, "one surface");
            return Err(Error::invalid(option, "use", expected, found, advice));
        }
        if self.flatten.is_some() && self.unit_distance.is_some() {
            let found = "--unit-distance beside it";
            return Err(refused_surface("an opaque surface", found));
        }
        Ok(())
    }

    /// Returns the standard deviation of a kernel, relative to the sample spacing.
    pub(crate) fn kernel_width(&self) -> f64 {
        self.kernel_width
            .unwrap_or(SampleOptions::default().kernels.width)
    }

    pub(crate) fn sample(&self, dataset: Dataset) -> Result<Sampled> {
        crate::sample::volume(dataset, &self.sample_options())
    }

    pub(crate) fn scale_name(&self) -> Option<ScaleName> {
        self.scale.map(|scale| match scale {
            Scale::Linear => ScaleName::Linear,
            Scale::Log => ScaleName::Log,
            Scale::Symlog => ScaleName::Symlog,
        })
    }

    pub(crate) fn sample_options(&self) -> SampleOptions {
        SampleOptions {
            field: self.field.clone(),
            preferred_field: None,
            kernels: KernelOptions {
                width: self.kernel_width(),
                length: self.length.map(|length| match length {
                    Length::H => LengthMeaning::SmoothingLength,
                    Length::Support => LengthMeaning::Support,
                    Length::Sigma => LengthMeaning::Sigma,
                    Length::Fwhm => LengthMeaning::Fwhm,
                }),
                smoothing: self.kernel.and_then(|kernel| match kernel {
                    Kernel::Cubic => Some(SphKernel::CubicSpline),
                    Kernel::Quartic => Some(SphKernel::QuarticSpline),
                    Kernel::Quintic => Some(SphKernel::QuinticSpline),
                    Kernel::WendlandC2 => Some(SphKernel::WendlandC2),
                    Kernel::WendlandC4 => Some(SphKernel::WendlandC4),
                    Kernel::WendlandC6 => Some(SphKernel::WendlandC6),
                    Kernel::Gaussian => None,
                }),
                gaussian: matches!(self.kernel, Some(Kernel::Gaussian)),
                radius: self.radius,
                shape: match self.shape {
                    Shape::Auto => ParticleShape::Automatic,
                    Shape::Isotropic => ParticleShape::Isotropic,
                    Shape::Covariance => ParticleShape::Covariance,
                    Shape::YuTurk => ParticleShape::YuTurk,
                },
                shepard_passes: self.shepard,
                boundary: match self.boundary {
                    None => BoundaryChoice::Automatic,
                    Some(BoundaryName::Sharp) => BoundaryChoice::Sharp,
                    Some(BoundaryName::Soft) => BoundaryChoice::Soft,
                },
                spread: match (self.count, self.density, self.spacing) {
                    (Some(count), ..) => Spread::Count(count as usize),
                    (None, Some(density), _) => Spread::Density(density),
                    (None, None, Some(Spacing::Even(distance))) => Spread::Spacing(distance),
                    (None, None, _) => Spread::Automatic,
                },
                composited: None,
                splat_rule: self.splat_rule.map(|rule| match rule {
                    SplatRuleName::Khr => SplatRule::Khr,
                    SplatRuleName::Inria => SplatRule::Inria,
                    SplatRuleName::Mip => SplatRule::Mip,
                    SplatRuleName::Exact => SplatRule::Exact,
                }),
                seed: 0,
            },
            function: FunctionOptions {
                transfer: self
                    .transfer_function
                    .as_deref()
                    .map_or(TransferChoice::Automatic, transfer_of),
                unit_distance: self.unit_distance,
                range: self.range,
                scale: self.scale_name(),
                opacity_scale: self.opacity_scale,
            },
            purpose: PurposeOptions::default(),
            flatten: self.flatten,
            surface: self.is_boundary_alone().then_some(1.0),
            refinement: None,
            periodic: None,
            motion: None,
            task: None,
        }
    }
}
