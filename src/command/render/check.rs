//! Refuses impossible requests, and options that do not apply to the data.

use std::path::Path;

use super::options::{
    Arguments, BackendName, ClassifyName, CompositeName, FilterName, Method, Opacity, ShowName,
};
use crate::command::animation::Animation;
use crate::command::cut::add_faces;
use crate::command::outputs::{check_collisions, paths};
use crate::command::statistics::is_standard_output;
use crate::command::usage::{
    CLASSIFIED, first_given, is_filtered, is_surface, refuse_beside, refuse_unused,
};
use crate::command::{animation, ranks};
use crate::io::{check_deep_path, check_depth_path, check_folder, check_image_path, is_fits};
use crate::load::Loaded;
use crate::render::nothing_lit;
use crate::scene::{Particles, PointVolume};
use crate::{Error, Result};

impl Arguments {
    /// Expands the inputs, and refuses impossible requests before any input is read.
    ///
    /// - `is_first`: whether this is the rank that writes. Folders of outputs need not exist on
    ///   other ranks.
    pub(in crate::command) fn check(&mut self, is_first: bool) -> Result<()> {
        if self.mpi && self.backend == BackendName::Gpu {
            return Err(ranks::refuse("--backend gpu"));
        }
        let named = std::mem::take(&mut self.inputs);
        self.inputs = self.data.inputs(named, self.sequence.is_series())?;
        self.pass_on();
        if let Some(size) = self.backdrop.read()? {
            self.size.get_or_insert(size);
        }
        self.camera.read_file(self.wanted_size(), |named| {
            self.projection.is_lens_of(named)
        })?;
        self.check_projection()?;
        if is_first && self.ending.writes() {
            self.check_outputs()?;
        }
        if let Some(lighting) = self.lighting() {
            lighting.validate()?;
        }
        self.exposure
            .check(self.sequence.moves_camera(), self.data.edits.turns())?;
        self.check_slice()?;
        self.check_legend()?;
        self.annotations.check(self.numbers())?;
        self.annotations.check_time(&self.inputs)?;
        self.method.check()?;
        self.check_show()
    }

    /// Passes `--keep-axes`, and the field that columns sum, on to the options of the data.
    pub(in crate::command) fn pass_on(&mut self) {
        self.data.keeps_axes = self.keep_axes;
        let (column_of, weight) = (self.method.column_of.take(), self.method.weight.take());
        if let Some(field) = column_of.or(weight) {
            self.data.field = Some(field);
        }
    }

    /// Checks that all outputs can be written and overwrite no input.
    pub(in crate::command) fn check_outputs(&self) -> Result<()> {
        self.check_sequence()?;
        if let Some(path) = &self.output.deep {
            check_deep_path(path)?;
        }
        let layers = [&self.output.depth, &self.output.normals];
        for path in layers.into_iter().flatten() {
            check_depth_path(path)?;
        }
        let stats = self.output.stats.as_ref();
        let stats = stats.filter(|path| !is_standard_output(path));
        let texts = [stats, self.output.write_transfer_function.as_ref()];
        for path in texts.into_iter().flatten() {
            check_folder(path)?;
        }
        let outputs = [
            Some(&self.out),
            self.output.depth.as_ref(),
            self.output.normals.as_ref(),
            self.output.deep.as_ref(),
            stats,
            self.output.write_transfer_function.as_ref(),
        ];
        let inputs = paths(&self.inputs).chain(self.backdrop.files());
        check_collisions(inputs, outputs.into_iter().flatten())
    }

    /// Checks that the format of the output can hold the sequence or picture asked for.
    pub(in crate::command) fn check_sequence(&self) -> Result<()> {
        let fault = |option: &'static str, expected: &str, found: &str| {
            let advice = "leave it out";
            Err(Error::invalid(option, "use", expected, found, advice))
        };
        if self.sequence.has_rate() && !animation::is_animated(&self.out) {
            return fault(
                "--rate",
                "an .mp4, an .apng or a .gif",
                "files of one picture",
            );
        }
        match self.sequence.is_asked_for() {
            true if self.output.stats.is_some() => {
                fault("--stats", "one picture", "a sequence of them")
            }
            true => Animation::check_path(&self.out),
            false if self.projection.is_sky() => Ok(()),
            false => check_image_path(&self.out),
        }
    }

    /// Refuses options that the projection has no use for.
    fn check_projection(&self) -> Result<()> {
        self.projection.check()?;
        let fault = |option: &'static str, expected: &str, found: &str| {
            let place = "--projection";
            Err(Error::invalid(
                option,
                place,
                expected,
                found,
                "leave it out",
            ))
        };
        let named = self.camera.named();
        let is_bent = named.is_some_and(|named| named.mapping.is_some());
        if self.projection.is_lens() && !is_bent {
            return Err(Error::invalid(
                "--projection lens",
                "camera",
                "--camera with a file whose lens distorts, a fisheye or a sphere",
                "another one",
                "leave it out",
            ));
        }
        if !self.projection.is_panorama(named) {
            let of_perspective = || {
                let of_path = self.sequence.has_path().then_some("--camera-path");
                self.camera.of_perspective().or(of_path)
            };
            return match (self.camera.of_parallel_rays(), of_perspective()) {
                (Some(option), _) if self.projection.is_perspective() => {
                    fault(option, "ortho", "perspective")
                }
                (_, Some(option)) if self.projection.is_ortho() => {
                    fault(option, "perspective", "ortho")
                }
                _ => Ok(()),
            };
        }
        let (method, output) = (&self.method, &self.output);
        let of_planes = first_given([
            ("--reference", method.reference.is_some()),
            ("--measure-error", method.measure_error),
            ("--calibrate", method.calibrate),
            ("--slice", method.slice.is_some()),
            ("--column-mean", method.column_mean.is_some()),
            ("--deep", output.deep.is_some()),
            ("--depth-of", output.depth_of.of_deep().is_some()),
            ("--show count", matches!(output.show, ShowName::Count)),
            ("--mpi", self.mpi),
            ("--stereo", self.projection.stereo().is_some()),
        ]);
        let of_planes = of_planes
            .or_else(|| self.backdrop.first())
            .or_else(|| self.camera.of_planes())
            .or_else(|| self.annotations.in_space());
        if let Some(option) = of_planes {
            return fault(option, "perspective or ortho", "a panorama");
        }
        if self.camera.looks_twice() {
            return fault(
                "--target",
                "one direction",
                "--azimuth or --elevation beside it",
            );
        }
        if !self.projection.is_sky() {
            return Ok(());
        }
        let of_sky = first_given([
            ("--size", self.size.is_some()),
            (
                "--turntable, --camera-path or --series",
                self.sequence.is_asked_for(),
            ),
            ("--legend", self.legend.legend),
            ("--title or --time-stamp", !self.annotations.is_empty()),
        ]);
        match self.camera.of_direction().or(of_sky) {
            Some(option) => {
                let found = "healpix, a map in the data's axes, as large as --nside says";
                fault(option, "another one", found)
            }
            None => check_sky_path(&self.out),
        }
    }

    /// Refuses a camera that does not look at a slice from the front, and a back end that draws none.
    fn check_slice(&self) -> Result<()> {
        match &self.method.slice {
            Some(_) if self.backend == BackendName::Gpu => Err(Error::invalid(
                "--slice",
                "--backend",
                "cpu, which draws slices",
                "gpu",
                "leave --backend out",
            )),
            Some(slice) if self.camera.looks_beside(slice.along) => Err(Error::invalid(
                "--slice",
                "--along",
                "the axis of the slice",
                "another one",
                "leave --along out",
            )),
            _ => Ok(()),
        }
    }

    /// Refuses a legend if the output holds numbers: a legend belongs to a picture.
    pub(in crate::command) fn check_legend(&self) -> Result<()> {
        let fault = |place: &str, expected: &str, found: String| {
            let advice = "leave --legend out";
            Err(Error::invalid("--legend", place, expected, found, advice))
        };
        if !self.legend.legend {
            return Ok(());
        }
        if !matches!(self.output.show, ShowName::Scene) {
            return fault("--show", "scene", "choice or count".into());
        }
        if self.method.column_density && !self.is_png() {
            let found = self.out.display().to_string();
            return fault("--column-density", "a png, which is a picture", found);
        }
        Ok(())
    }

    /// Returns the option that writes numbers instead of a picture, and the value it expects for a
    /// picture.
    pub(in crate::command) fn numbers(&self) -> Option<(&'static str, &'static str)> {
        if matches!(self.output.show, ShowName::Count) {
            return Some(("--show", "scene or choice"));
        }
        let is_column = self.method.column_density && !self.is_png();
        is_column.then_some(("--column-density", "a png, which is a picture"))
    }

    /// Refuses options of light with `--show` other than `scene`. (A background is allowed: counts
    /// have one, too.)
    pub(in crate::command) fn check_show(&self) -> Result<()> {
        let shows_scene = matches!(self.output.show, ShowName::Scene);
        if self.output.depth_of.of_deep().is_some() && !shows_scene {
            let (expected, found) = ("the scene", "--show beside it");
            let advice = "leave it out";
            return Err(Error::invalid(
                "--depth-of",
                "what is shown",
                expected,
                found,
                advice,
            ));
        }
        if matches!(self.output.show, ShowName::Count) && self.backdrop.given.colours.is_some() {
            let (expected, found) = ("the scene", "--show count, which has no background");
            let advice = "leave it out";
            let option = "--background-image";
            return Err(Error::invalid(
                option,
                "what is shown",
                expected,
                found,
                advice,
            ));
        }
        let is_asked = self.is_lit() || self.light.is_unlit();
        if !is_asked || matches!(self.output.show, ShowName::Scene) {
            return Ok(());
        }
        let (option, found) = ("--lit, --unlit or --light", "--show beside it");
        let expected = "the scene";
        Err(Error::invalid(
            option,
            "what is shown",
            expected,
            found,
            "leave it out",
        ))
    }

    /// Checks that the options apply to the scene, and adds cut faces if they are asked for.
    pub(in crate::command) fn checked(&self, mut scene: Loaded) -> Result<Loaded> {
        let refused = [
            ("--reference", self.method.reference.is_some()),
            ("--cut-faces", self.cut.cut_faces),
            ("--column-mean", self.method.column_mean.is_some()),
            ("--periodic", self.periodic.is_some()),
            ("--velocity", self.exposure.motion().is_some()),
        ];
        refuse_beside(&scene.prepared, &refused)?;
        self.method.check_use(&scene.volumes)?;
        if self.is_lit() && !self.method.post_classification {
            check_lit(&scene.volumes)?;
        }
        if self.cut.cut_faces {
            let volumes = &mut scene.volumes;
            add_faces(volumes, &self.clip_planes(), self.is_lit())?;
        }
        Ok(scene)
    }
}

impl Method {
    /// Refuses options of layers for a composite without layers, and options of column densities
    /// without these. (Clap does not enforce `requires` if the required option conflicts with a
    /// third that is given.)
    pub(in crate::command) fn check(&self) -> Result<()> {
        let refuse = |place: &str, expected: &str| {
            let found = self.composite().name();
            Err(Error::format(
                "settings",
                place,
                expected,
                found,
                "change it",
            ))
        };
        if self.post_classification && self.composite != CompositeName::Slabs {
            return refuse("composite of classified slabs", "slabs");
        }
        if self.slab_thickness.is_some() && self.composite == CompositeName::Over {
            return refuse(
                "composite of a thickness",
                "slabs, sheets, axis-sheets or maximum",
            );
        }
        let is_each = self.classify == ClassifyName::Particle;
        if is_each && (self.post_classification || self.composite == CompositeName::Maximum) {
            return refuse(
                "composite of particles classified one by one",
                "one that classifies these, not slabs",
            );
        }
        if self.column_mean.is_some() && !self.column_density {
            return Err(Error::invalid(
                "--column-mean",
                "what is written",
                "--column-density beside it",
                "none",
                "add it",
            ));
        }
        Ok(())
    }

    /// Refuses options that do not apply to any of the volumes.
    pub(in crate::command) fn check_use(&self, volumes: &[PointVolume]) -> Result<()> {
        let default = FilterName::Adaptive;
        let is_filtered = volumes.iter().any(is_filtered);
        let is_translucent = !volumes.iter().all(is_surface);
        let is_classified = volumes.iter().any(|v| v.transfer_function.is_some());
        let absorbing = "kernels that absorb light, not surfaces or splats";
        let is_over = self.composite == CompositeName::Over;
        let is_each = self.classify == ClassifyName::Particle;
        let is_linear = self.opacity == Opacity::Linear;
        refuse_unused(&[
            ("--filter", self.filter != default, is_filtered, absorbing),
            (
                "--thresholds",
                self.thresholds.is_some(),
                is_filtered,
                absorbing,
            ),
            ("--opacity", is_linear, is_filtered, absorbing),
            (
                "--sub-pixel-opacity",
                self.sub_pixel_opacity,
                is_filtered,
                absorbing,
            ),
            (
                "--composite",
                !is_over,
                is_translucent,
                "more than opaque surfaces",
            ),
            ("--classify", is_each, is_classified, CLASSIFIED),
        ])
    }
}

/// Refuses formats that hold no all-sky map.
fn check_sky_path(path: &Path) -> Result<()> {
    let is_npy = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("npy"));
    if !is_npy && !is_fits(path) {
        let found = path.display().to_string();
        let expected = "fits or npy, for an all-sky map";
        return Err(Error::invalid(
            "--out",
            "format",
            expected,
            found,
            "name another",
        ));
    }
    check_folder(path)
}

/// Refuses options of light if no volume has normals.
fn check_lit(scene: &[PointVolume]) -> Result<()> {
    let reflects = |volume: &PointVolume| {
        let is_surface = matches!(volume.particles, Particles::Surfels { .. });
        is_surface || volume.normals.is_some()
    };
    if scene.iter().any(reflects) {
        return Ok(());
    }
    Err(nothing_lit("--lit"))
}
