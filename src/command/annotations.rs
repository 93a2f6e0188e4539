//! Draws legends and annotations over a picture of `ewa-splat render`, and defines the options of
//! annotations.

use std::borrow::Cow;

use crate::annotate::{Annotations, check, draw};
use crate::legend::{ColourBar, check_legend_size, columns_beside_legend, draw_legend};
use crate::view::{Bounds, Camera};
use crate::{Error, Image, Result};
use clap::Args;

use super::info_table::significant;
use super::usage::first_given;
use crate::load::Input;

/// Placeholder for the time in a time stamp.
const TIME: &str = "{time}";

#[derive(Args, Clone)]
#[command(next_help_heading = "Annotations")]
pub(crate) struct AnnotationOptions {
    /// Draw the directions of x, y and z, as the camera sees them, into the lower left corner
    #[arg(long)]
    axes: bool,
    /// Draw the box of the data over the picture
    #[arg(long)]
    outline: bool,
    /// Draw a bar of a round length, as it is seen at the distance of the data's centre, into the lower right
    /// corner
    #[arg(long)]
    scale_bar: bool,
    /// Write a line into the upper left corner
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// Write a line into the lower left corner, such as the time that is shown: {time} in it stands for what a .pvd
    /// states
    #[arg(long, value_name = "TEXT")]
    time_stamp: Option<String>,
}

impl AnnotationOptions {
    pub(crate) fn has_axes(&self) -> bool {
        self.axes
    }

    pub(crate) fn has_outline(&self) -> bool {
        self.outline
    }

    /// Returns whether nothing is asked for.
    pub(crate) fn is_empty(&self) -> bool {
        self.first().is_none()
    }

    /// Returns the name of an option that draws in space, if one is given.
    pub(crate) fn in_space(&self) -> Option<&'static str> {
        self.first()
            .filter(|name| ["--axes", "--outline", "--scale-bar"].contains(name))
    }

    /// Returns the first option that is given.
    fn first(&self) -> Option<&'static str> {
        first_given([
            ("--axes", self.axes),
            ("--outline", self.outline),
            ("--scale-bar", self.scale_bar),
            ("--title", self.title.is_some()),
            ("--time-stamp", self.time_stamp.is_some()),
        ])
    }

    /// Refuses a time stamp if any time step has no time.
    pub(crate) fn check_time(&self, inputs: &[Input]) -> Result<()> {
        let is_asked = self
            .time_stamp
            .as_ref()
            .is_some_and(|text| text.contains(TIME));
        if !is_asked || inputs.iter().all(|input| input.time.is_some()) {
            return Ok(());
        }
        let expected = "inputs whose times are stated, by a .pvd file";
        let advice = "write the time itself";
        Err(Error::invalid(
            "--time-stamp",
            TIME,
            expected,
            "others",
            advice,
        ))
    }

    /// Returns these options with the time of a step in the stamp.
    pub(crate) fn at(&self, step: &[Input]) -> Self {
        let time = step.iter().find_map(|input| input.time);
        let stamped = |text: &String| match time {
            Some(time) => text.replace(TIME, &significant(time)),
            None => text.clone(),
        };
        Self {
            time_stamp: self.time_stamp.as_ref().map(stamped),
            ..self.clone()
        }
    }

    /// Refuses annotations on an output of numbers.
    ///
    /// - `numbers`: the option that writes numbers, and the value it expects instead; `None` for a
    ///   picture.
    pub(crate) fn check(&self, numbers: Option<(&'static str, &'static str)>) -> Result<()> {
        let (Some(option), Some((place, expected))) = (self.first(), numbers) else {
            return Ok(());
        };
        let advice = format!("leave {option} out");
        Err(Error::invalid(option, place, expected, "numbers", advice))
    }
}

/// Legends and annotations drawn over a picture.
pub(crate) struct Overlays {
    camera: Camera,
    annotations: Annotations,
    bars: Vec<ColourBar>,
}

impl Overlays {
    /// Checks that the legends and annotations fit into the camera's picture.
    ///
    /// - `bounds`: the box of the data.
    ///
    /// # Errors
    /// Any that does not fit.
    pub(crate) fn new(
        options: &AnnotationOptions,
        bars: Vec<ColourBar>,
        bounds: Option<Bounds>,
        camera: &Camera,
    ) -> Result<Self> {
        let annotations = Annotations {
            axes: options.axes,
            outline: bounds.filter(|_| options.outline),
            scale_at: bounds
                .filter(|_| options.scale_bar)
                .map(|(centre, _)| centre),
            title: options.title.clone(),
            title_columns: None,
            time_stamp: options.time_stamp.clone(),
        };
        check_legend_size(&bars, [camera.width, camera.height])?;
        check(camera, &annotations)?;
        let camera = camera.clone();
        Ok(Self {
            camera,
            annotations,
            bars,
        })
    }

    /// Returns these overlays with other colour bars.
    pub(crate) fn with_bars(self, bars: Vec<ColourBar>) -> Self {
        Self { bars, ..self }
    }

    /// Returns true if nothing is drawn over the picture.
    pub(crate) fn is_empty(&self) -> bool {
        self.bars.is_empty() && self.annotations == Annotations::default()
    }

    /// Returns a picture with all overlays drawn on it.
    pub(crate) fn drawn<'a>(&self, image: &'a Image) -> Result<Cow<'a, Image>> {
        if self.is_empty() {
            return Ok(Cow::Borrowed(image));
        }
        let mut image = image.clone();
        let size = [image.width, image.height];
        let annotations = Annotations {
            title_columns: Some(columns_beside_legend(&self.bars, size)?),
            ..self.annotations.clone()
        };
        draw(&mut image, &self.camera, &annotations)?;
        draw_legend(&self.bars, &mut image)?;
        Ok(Cow::Owned(image))
    }
}
