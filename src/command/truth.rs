//! Integrates reference images: of the kernels, or of the field that the data define.

use std::ffi::OsString;

use crate::reference::{DataIntegrator, Integrator, ReferenceFrame, ReferenceSettings};
use crate::scene::{Classification, PointVolume};
use crate::view::{Camera, ClipPlane};
use crate::{DepthImage, Error, Result};
use clap::ValueEnum;

use super::input::DataOptions;
use crate::load::Input;

#[derive(Clone, Copy, PartialEq, ValueEnum)]
pub(crate) enum ReferenceName {
    /// The kernels that are splatted
    Kernels,
    /// The data's own field, interpolated between its samples
    Data,
}

/// Joins `--reference data` and `--reference kernels` to one argument each, `--reference=data`.
/// Otherwise clap would take any word after the option as its value, even a file to render.
pub(crate) fn join_reference(arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    let mut ended = false;
    for argument in arguments {
        ended |= argument == "--";
        let follows = !ended && joined.last().is_some_and(|last| last == "--reference");
        let word = argument
            .to_str()
            .filter(|w| matches!(*w, "data" | "kernels"));
        match (word, joined.last_mut()) {
            (Some(word), Some(last)) if follows => {
                last.push("=");
                last.push(word);
            }
            _ => joined.push(argument),
        }
    }
    joined
}

pub(crate) enum Truth {
    Kernels(Integrator),
    Data(Box<DataIntegrator>),
}

impl Truth {
    pub(crate) fn of_kernels(
        scene: &[PointVolume],
        classification: Classification,
    ) -> Result<Self> {
        Integrator::classified(scene, classification).map(Self::Kernels)
    }

    /// Integrates the field of the one grid among the inputs. The grid is read again and shown by
    /// the transfer function of its kernels.
    pub(crate) fn of_data(
        data: &DataOptions,
        inputs: &[Input],
        scene: &[PointVolume],
        fields: &[Option<String>],
    ) -> Result<Self> {
        let refuse = |place: &str, expected: &str, found: String, advice: &str| {
            Err(Error::invalid(
                "--reference data",
                place,
                expected,
                found,
                advice.to_owned(),
            ))
        };
        if let Some(option) = data.surface_option() {
            let advice = format!("leave {option} out, or take --reference kernels");
            let found = format!("the surface of {option}");
            return refuse("scene", "a volume", found, &advice);
        }
        let [input] = inputs else {
            let found = format!("{} files", inputs.len());
            let advice = "integrate one file, or the kernels of all: --reference kernels";
            return refuse("inputs", "one file with a grid", found, advice);
        };
        let dataset = data.open(input)?;
        let ([volume], [Some(field)]) = (scene, fields) else {
            let found = format!("{} ({})", input.path.display(), dataset.format);
            let advice = "take --reference kernels";
            return refuse("scene", "a grid with a field", found, advice);
        };
        let Some(function) = volume.transfer_function.clone() else {
            let found = "strengths and colours of its own".into();
            let advice = "take --reference kernels, or name a --field";
            return refuse("data", "a field under a transfer function", found, advice);
        };
        let integrator = DataIntegrator::new(dataset, field, function)?;
        Ok(Self::Data(Box::new(integrator)))
    }

    pub(crate) fn clipped(self, planes: &[ClipPlane]) -> Self {
        match self {
            Self::Kernels(integrator) => Self::Kernels(integrator.clipped(planes)),
            Self::Data(integrator) => Self::Data(Box::new(integrator.clipped(planes))),
        }
    }

    pub(crate) fn ended(self, depth: Option<&DepthImage>) -> Self {
        match self {
            Self::Kernels(integrator) => Self::Kernels(integrator.ended(depth)),
            Self::Data(integrator) => Self::Data(Box::new(integrator.ended(depth))),
        }
    }

    pub(crate) fn render(
        &self,
        camera: &Camera,
        settings: &ReferenceSettings,
    ) -> Result<ReferenceFrame> {
        match self {
            Self::Kernels(integrator) => integrator.render(camera, settings),
            Self::Data(integrator) => integrator.render(camera, settings),
        }
    }

    /// Returns the number of integrated kernels.
    pub(crate) fn particle_count(&self) -> Option<usize> {
        match self {
            Self::Kernels(integrator) => Some(integrator.particle_count()),
            Self::Data(_) => None,
        }
    }

    /// Returns the number of cells that the integration leaves out.
    pub(crate) fn cells_left_out(&self) -> Option<usize> {
        match self {
            Self::Kernels(_) => None,
            Self::Data(integrator) => Some(integrator.left_out()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_value_of_an_option_is_joined_and_files_are_left_alone() {
        let join = |line: &str| {
            let words = line.split(' ').map(OsString::from);
            let joined = join_reference(words).into_iter();
            joined.map(|w| w.into_string().unwrap()).collect::<Vec<_>>()
        };
        for (line, expected) in [
            (
                "render --reference a.vtk --out b.png",
                vec!["render", "--reference", "a.vtk", "--out", "b.png"],
            ),
            (
                "render --reference data a.vtk",
                vec!["render", "--reference=data", "a.vtk"],
            ),
            (
                "render a.vtk --reference kernels",
                vec!["render", "a.vtk", "--reference=kernels"],
            ),
            (
                "render --reference=data data",
                vec!["render", "--reference=data", "data"],
            ),
            (
                "render a.vtk --reference",
                vec!["render", "a.vtk", "--reference"],
            ),
            (
                "render data --reference -- data",
                vec!["render", "data", "--reference", "--", "data"],
            ),
        ] {
            assert_eq!(join(line), expected);
        }
    }
}
