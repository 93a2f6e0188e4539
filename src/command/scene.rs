//! Loads the inputs of a command, and refuses options that do not apply to them.

use indicatif::ProgressBar;

use super::input::{DataOptions, refused_surface};
use super::progress::observer_of;
use super::usage::Uses;
use crate::collective::Alone;
use crate::io::OpenOptions;
use crate::load::facts::is_automatic;
use crate::load::{
    Cameras, Checks, Input, Kind, Loaded, Observer, Request, Series, is_prepared, load, load_series,
};
use crate::sample::{SampleOptions, TransferChoice};
use crate::scene::PointVolume;
use crate::{Error, Result};

/// Checks of the options for data on what they are applied to.
pub(crate) struct DataChecks<'a> {
    data: &'a DataOptions,
    inputs: &'a [Input],
    options: &'a SampleOptions,
    /// Checks of the command beyond those of the data.
    then: Option<&'a dyn Fn(Loaded) -> Result<Loaded>>,
}

impl<'a> DataChecks<'a> {
    /// Adds the checks of a command, which may complete the scene.
    pub(crate) fn and(self, then: &'a dyn Fn(Loaded) -> Result<Loaded>) -> Self {
        Self {
            then: Some(then),
            ..self
        }
    }
}

impl Checks for DataChecks<'_> {
    fn choices(&self) -> Result<()> {
        self.data.check_function(self.options)?;
        match self.inputs.iter().all(|input| is_prepared(&input.path)) {
            true => Ok(()),
            false => self.data.check_spacing(),
        }
    }

    fn input(&self, kind: Kind, is_classified: bool, sample: &SampleOptions) -> Result<()> {
        self.data.check_use(&Uses {
            kinds: vec![kind],
            is_classified,
            has_opacity: is_classified,
            has_file_function: is_classified && !is_automatic(sample),
            for_columns: sample.purpose.for_columns,
            of_prepared: None,
        })
    }

    fn scene(&self, scene: Loaded) -> Result<Loaded> {
        // Ranks that did not read the inputs know no facts of them.
        self.data.check_use(&Uses::of(&scene, self.options))?;
        self.data.check_fields(&scene)?;
        match self.then {
            Some(then) => then(scene),
            None => Ok(scene),
        }
    }
}

impl DataOptions {
    /// Returns the checks of these options.
    pub(crate) fn checks<'a>(
        &'a self,
        inputs: &'a [Input],
        options: &'a SampleOptions,
    ) -> DataChecks<'a> {
        DataChecks {
            data: self,
            inputs,
            options,
            then: None,
        }
    }

    /// Returns the request to load inputs by these options.
    ///
    /// - `open`: [`DataOptions::open_options`].
    /// - `cameras`: cameras of the pictures, which determine the number of surfels of meshes.
    pub(crate) fn request<'a>(
        &self,
        checks: &'a DataChecks<'a>,
        open: &'a OpenOptions,
        cameras: Cameras<'a>,
        observer: Observer<'a>,
    ) -> Request<'a> {
        Request {
            inputs: checks.inputs,
            open,
            sample: checks.options,
            cameras,
            keeps_axes: self.keeps_axes,
            takes_parts: true,
            checks,
            observer,
        }
    }

    /// Loads all inputs as one scene, and refuses options that do not apply to it.
    ///
    /// - `cameras`: cameras of the pictures, which determine the number of surfels of meshes.
    pub(crate) fn scene(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        cameras: Cameras<'_>,
        progress: &ProgressBar,
    ) -> Result<Loaded> {
        let (open, observer) = (self.open_options(), observer_of(progress));
        let checks = self.checks(inputs, options);
        load(
            &self.request(&checks, &open, cameras, &observer),
            &mut Alone::default(),
        )
    }

    /// Refuses an iso-surface if no volume shows a field.
    fn check_fields(&self, scene: &Loaded) -> Result<()> {
        match self.flatten.is_some() && scene.fields.iter().all(Option::is_none) {
            true => Err(refused_surface("a field", "none")),
            false => Ok(()),
        }
    }

    /// Refuses options that do not apply to the iso-surface, or to the transfer function, asked
    /// for.
    pub(super) fn check_function(&self, options: &SampleOptions) -> Result<()> {
        self.check_surface()?;
        if self.scale.is_some() && matches!(options.function.transfer, TransferChoice::File(_)) {
            let expected = "an automatic transfer function, or a named colour map";
            let found = "a file, which has a scale of its own";
            let advice = "change the file, or leave the scale out";
            return Err(Error::invalid(
                "--scale",
                "transfer function",
                expected,
                found,
                advice,
            ));
        }
        Ok(())
    }

    /// Loads the choices that the steps of a series share.
    pub(crate) fn series(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        progress: &ProgressBar,
    ) -> Result<Series> {
        let (open, observer) = (self.open_options(), observer_of(progress));
        let checks = self.checks(inputs, options);
        load_series(&self.request(&checks, &open, &|_, _| Ok(Vec::new()), &observer))
    }

    /// Reads the inputs again, and returns their volumes with kernels of another width.
    pub(crate) fn scene_at_kernel_width(
        &self,
        inputs: &[Input],
        kernel_width: f64,
    ) -> Result<Vec<PointVolume>> {
        let mut options = self.sample_options();
        options.kernels.width = kernel_width;
        let mut volumes = Vec::new();
        for input in inputs {
            let dataset = self.open(input)?;
            volumes.extend(crate::sample::scene(dataset, &input.sample_options(&options))?.volumes);
        }
        Ok(volumes)
    }
}
