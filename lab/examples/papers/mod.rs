//! Shares code among the examples that reproduce the papers' experiments: arguments and times here; reference images,
//! pictures and volumes in modules of their own.
#![allow(dead_code, reason = "each example uses a part")]

pub(crate) mod pictures;
pub(crate) mod truth;
pub(crate) mod volumes;

use std::path::PathBuf;

use ewa_splat::io::write_image;
use ewa_splat::view::{Camera, Lens, Viewpoint};
use ewa_splat::{Error, Image, Renderer, Result, Settings};
use glam::DVec3;

/// Arguments of an example: `FIGURE [FOLDER [SIZE [FRAMES]]]`.
#[derive(Debug)]
pub(crate) struct Arguments {
    /// Experiment to run, or `all`.
    pub(crate) figure: String,
    /// Folder for the images.
    pub(crate) folder: PathBuf,
    /// Pixels along a side of an image.
    pub(crate) size: usize,
    /// Number of frames of which a time is the median.
    pub(crate) frames: usize,
}

impl Arguments {
    /// Reads the program's arguments; creates the folder.
    pub(crate) fn read() -> Result<Self> {
        let given: Vec<String> = std::env::args().skip(1).collect();
        let number = |i: usize, default| {
            let given = given.get(i).and_then(|a| a.parse().ok());
            given.unwrap_or(default)
        };
        let text = |i: usize, default: &str| given.get(i).map_or(default, String::as_str).into();
        let folder: String = text(1, "papers");
        let folder = PathBuf::from(folder);
        std::fs::create_dir_all(&folder)
            .map_err(|e| Error::io(&folder, "making the folder", e, "name a folder elsewhere"))?;
        Ok(Self {
            figure: text(0, "all"),
            folder,
            size: number(2, 512).max(16),
            frames: number(3, 5).max(1),
        })
    }

    /// Runs the requested experiment, or all.
    ///
    /// # Errors
    /// The errors of the experiments; a figure that is none of `experiments`.
    pub(crate) fn run(&self, experiments: &[(&str, Experiment)]) -> Result<()> {
        let is_asked_for = |name: &str| self.figure == "all" || self.figure == name;
        let names: Vec<&str> = experiments.iter().map(|(name, _)| *name).collect();
        if !names.iter().any(|name| is_asked_for(name)) {
            return Err(Error::format(
                "command line",
                "figure",
                format!("all, or one of {}", names.join(", ")),
                self.figure.clone(),
                "give it first, then a folder for pictures",
            ));
        }
        for (name, experiment) in experiments.iter().filter(|(name, _)| is_asked_for(name)) {
            println!("== {name} ==");
            experiment(self)?;
            println!();
        }
        Ok(())
    }

    /// Writes an image to the folder.
    pub(crate) fn write(&self, name: &str, image: &Image) -> Result<()> {
        write_image(&self.folder.join(name), image)
    }
}

/// An experiment, which prints a table and writes images.
pub(crate) type Experiment = fn(&Arguments) -> Result<()>;

/// Returns a camera that sees everything a renderer shows, 30 degrees from the side and from above.
pub(crate) fn fitted_camera(renderer: &Renderer, size: usize) -> Option<Camera> {
    let view = Viewpoint {
        azimuth_deg: 30.0,
        elevation_deg: 30.0,
        zoom: 1.0,
        up: DVec3::Z,
    };
    view.camera(&renderer.visible_boxes(), Lens::FovDeg(30.0), [size; 2])
}

/// Returns the median.
pub(crate) fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Returns the median milliseconds of `frames` frames of each of the settings. Frames are timed in rounds, so that a
/// disturbance of the machine affects all alike. Each setting renders two frames and times the second: the first finds
/// the memory as the previous settings left it.
///
/// # Errors
/// The errors of the renderer.
pub(crate) fn times(
    renderer: &mut Renderer,
    camera: &Camera,
    settings: &[Settings],
    frames: usize,
) -> Result<Vec<f64>> {
    let mut all = vec![Vec::with_capacity(frames); settings.len()];
    for _ in 0..frames {
        for (settings, times) in settings.iter().zip(&mut all) {
            renderer.render(camera, settings)?;
            renderer.render(camera, settings)?;
            times.push(renderer.times().frame);
        }
    }
    Ok(all.iter_mut().map(|times| median(times)).collect())
}
