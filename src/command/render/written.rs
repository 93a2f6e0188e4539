//! Writes pictures with the record of how they were made, or compares them with those that were written before.

use std::path::{Path, PathBuf};

use super::ending::{Ending, Facts, Recorded};
use super::options::Arguments;
use super::tiles::{Comparison, Drawn};
use crate::image::Image;
use crate::io::{
    carries_record, is_fits, shown_count, write_column_with, write_image_with, write_sky,
    write_sky_column,
};
use crate::render::ColumnSettings;
use crate::view::Camera;
use crate::{Renderer, Result, Settings, Show};

impl Arguments {
    /// Begins to hash the files that were read, while the picture is drawn.
    pub(super) fn begin_record(&self) {
        if let Some(recorded) = self.recorded() {
            recorded.begin();
        }
    }

    /// Returns the record of a picture; `None` if none is wanted, or if the file has no place for one.
    ///
    /// - `frame`: number of the picture in its sequence.
    pub(super) fn record(&self, facts: &Facts, frame: Option<usize>) -> Option<String> {
        Some(self.recorded()?.record(facts, frame))
    }

    fn recorded(&self) -> Option<&Recorded> {
        match &self.ending {
            Ending::Recorded(recorded) if carries_record(&self.out) => Some(recorded),
            _ => None,
        }
    }

    /// Writes or compares the one picture of a command.
    pub(super) fn end(&self, drawn: &Drawn<'_>, facts: &Facts) -> Result<()> {
        if let Some(comparison) = self.ending.comparison() {
            return comparison.compare(drawn, facts.tolerance);
        }
        let record = self.record(facts, None);
        let record = record.as_deref();
        match drawn {
            Drawn::Picture(image) if is_fits(&self.out) => write_sky(&self.out, image),
            Drawn::Column(column) if is_fits(&self.out) => write_sky_column(&self.out, column),
            Drawn::Picture(image) => write_image_with(&self.out, image, record),
            Drawn::Count(count) => {
                write_image_with(&self.out, &shown_count(&self.out, count), record)
            }
            Drawn::Column(column) => write_column_with(&self.out, column, record),
        }
    }

    /// Draws a frame: all of it to be written, or the tiles that are compared.
    pub(super) fn drawn<'a>(
        &self,
        renderer: &'a mut Renderer,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<&'a Image> {
        let comparison = self.ending.comparison();
        if let Some(comparison) = comparison {
            comparison.check_size(self.whole_size(camera))?;
        }
        if let Some(panorama) = self.panorama(camera) {
            return renderer.render_panorama(&panorama, settings);
        }
        if let Some(distance) = self.projection.stereo() {
            return renderer.render_stereo(camera, settings, distance);
        }
        match comparison.and_then(Comparison::tiles) {
            // Colours of counts follow from the greatest of the whole picture.
            Some(tiles) if settings.show != Show::Count => {
                renderer.render_tiles(camera, settings, tiles)
            }
            _ => renderer.render(camera, settings),
        }
    }

    /// Draws the columns of a picture or a panorama.
    pub(super) fn summed(
        &self,
        renderer: &mut Renderer,
        camera: &Camera,
        settings: &ColumnSettings,
    ) -> Result<()> {
        match self.panorama(camera) {
            Some(panorama) => renderer.column_panorama(&panorama, settings).map(|_| ()),
            None => renderer.column_density(camera, settings).map(|_| ()),
        }
    }

    /// Returns the path that a side output is written to, if it is asked for and anything is written.
    pub(super) fn beside<'a>(&self, path: Option<&'a PathBuf>) -> Option<&'a Path> {
        path.filter(|_| self.ending.writes()).map(PathBuf::as_path)
    }
}
