//! Next steps and values that every front end words in its own way.

use std::fmt;

/// A step that helps and for which front ends have an option, an argument or a button.
///
/// Its text is for callers of the library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hint {
    /// Name one of the fields that are there.
    NameField,
    /// Name the solution of a PLOT3D grid.
    NameSolution,
    /// Name the solution that belongs to a PLOT3D grid, or keep another from being taken for it.
    NameOwnSolution,
    /// Give a PLOT3D grid as the input, and what was given as its solution.
    GiveGridOfSolution,
    /// Name another image as the texture of a mesh.
    NameOtherTexture,
    /// Say how a raw volume is laid out.
    GiveLayout,
    /// Give the raw data that a header belongs to, and say how they are laid out.
    GiveRawData,
    /// Convert a file of unknown format, or say how it is laid out if it is a raw volume.
    ConvertOrGiveLayout,
    /// Unpack a file, or say how it is laid out if it is a raw volume.
    UnpackOrGiveLayout,
    /// Correct the counts of samples of a raw volume.
    CorrectDims,
    /// Correct the counts of samples of a raw volume, or their type.
    CorrectDimsOrType,
    /// Say what the lengths of particles mean, or give one for all.
    GiveMeaningOrRadius,
    /// Add a column of standard deviations, or give one length for all particles.
    AddSigmaOrGiveRadius,
    /// Resize data by a factor for each axis.
    ResizeAlongAxes,
    /// Leave an optional value out.
    LeaveOut(Parameter),
    /// Look at what the file holds.
    LookAtFile,
    /// Look at what the data hold, or raise their opacity.
    LookAtDataOrRaiseOpacity,
    /// Draw a picture in place of column densities.
    DrawPicture,
    /// Draw on the CPU.
    UseCpu,
    /// Draw a narrower image, or on the CPU.
    NarrowerImageOrCpu,
    /// Draw fewer particles or a smaller image, or on the CPU.
    SmallerSceneOrCpu,
    /// Start again, on the CPU if the device keeps failing.
    StartAgainOrCpu,
    /// Choose another adapter, or draw on the CPU.
    OtherAdapterOrCpu,
    /// Choose one of the adapters that there are, or draw on the CPU.
    ListedAdapterOrCpu,
    /// Install a graphics driver, or draw on the CPU.
    InstallDriverOrCpu,
}

/// A value that the caller gives and that front ends call by names of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Parameter {
    /// [`KernelOptions::width`](crate::sample::KernelOptions::width).
    KernelWidth,
    /// [`FunctionOptions::transfer`](crate::sample::FunctionOptions::transfer).
    TransferFunction,
    /// [`SampleOptions::flatten`](crate::sample::SampleOptions::flatten).
    Flatten,
    /// [`SampleOptions::surface`](crate::sample::SampleOptions::surface), opaque.
    Surface,
    /// [`SampleOptions::surface`](crate::sample::SampleOptions::surface), translucent.
    SurfaceOpacity,
    /// [`Spread::Density`](crate::sample::mesh::Spread::Density).
    SurfelDensity,
    /// [`Spread::Spacing`](crate::sample::mesh::Spread::Spacing).
    SurfelSpacing,
    /// [`OpenOptions::read_as`](crate::io::OpenOptions::read_as).
    ReadAs,
    /// [`OpenOptions::particle_type`](crate::io::OpenOptions::particle_type).
    ParticleType,
    /// [`OpenOptions::scales`](crate::io::OpenOptions::scales).
    Scales,
    /// Number of a time step: [`StepChoice::Number`](crate::io::StepChoice::Number).
    Step,
    /// Time of a time step: [`StepChoice::Time`](crate::io::StepChoice::Time).
    Time,
    /// Factor of heights.
    Exaggeration,
    /// [`RawLayout::dims`](crate::io::RawLayout::dims).
    RawDims,
    /// [`RawLayout::spacing`](crate::io::RawLayout::spacing) and
    /// [`RawLayout::origin`](crate::io::RawLayout::origin).
    RawGeometry,
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NameField => "name one of these",
            Self::NameSolution => "for a PLOT3D grid name its solution",
            Self::NameOwnSolution => "name the grid's own solution, or move this file elsewhere",
            Self::GiveGridOfSolution => "give the grid as input and this file as its solution",
            Self::NameOtherTexture => "name another image as the texture",
            Self::GiveLayout => "say how it is laid out",
            Self::GiveRawData => "use its raw data with their layout",
            Self::ConvertOrGiveLayout => {
                "convert it to one of them; if it is a raw volume, say how it is laid out"
            }
            Self::UnpackOrGiveLayout => {
                "unpack it with gunzip (raw volumes may stay compressed: say how they are laid out)"
            }
            Self::CorrectDims => "correct the dimensions",
            Self::CorrectDimsOrType => "correct the dimensions or the type",
            Self::GiveMeaningOrRadius => "say what the lengths mean, or give one radius for all",
            Self::AddSigmaOrGiveRadius => "add a column `sigma`, or give one radius for all",
            Self::ResizeAlongAxes => "resize the data by three factors",
            Self::LeaveOut(parameter) => return write!(f, "leave {parameter} out"),
            Self::LookAtFile => "look at what the file holds",
            Self::LookAtDataOrRaiseOpacity => "look at what the data hold, or raise the opacity",
            Self::DrawPicture => "render them instead",
            Self::UseCpu => "draw on the CPU",
            Self::NarrowerImageOrCpu => "render a narrower image, or draw on the CPU",
            Self::SmallerSceneOrCpu => {
                "render fewer particles or a smaller image, or draw on the CPU"
            }
            Self::StartAgainOrCpu => "start again, on the CPU if it keeps failing",
            Self::OtherAdapterOrCpu => "choose another with EWA_ADAPTER, or draw on the CPU",
            Self::ListedAdapterOrCpu => {
                "choose one of these with EWA_ADAPTER or leave it unset, or draw on the CPU"
            }
            Self::InstallDriverOrCpu => {
                "install the graphics driver (a software one: Mesa's lavapipe), or draw on the CPU"
            }
        })
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::KernelWidth => "kernel width",
            Self::TransferFunction => "transfer function",
            Self::Flatten => "value to flatten at",
            Self::Surface => "surface of the boundary",
            Self::SurfaceOpacity => "opacity of the boundary",
            Self::SurfelDensity => "density of surfels",
            Self::SurfelSpacing => "spacing of surfels",
            Self::ReadAs => "what it is to be read as",
            Self::ParticleType => "the type of particles",
            Self::Scales => "the meaning of scales",
            Self::Step => "time step",
            Self::Time => "time",
            Self::Exaggeration => "factor of heights",
            Self::RawDims => "dimensions",
            Self::RawGeometry => "spacing and origin",
        })
    }
}
