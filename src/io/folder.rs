//! Finds the files that stand for folders.

use std::borrow::Cow;
use std::path::Path;

use super::bytes::file::{HEAD, Input};
use super::grid::{openfoam, plotfile};
use super::splats::sog;
#[cfg(feature = "dicom")]
use super::volume::dicom;

/// Returns the file to open for a folder that is a data set; returns any other path unchanged.
pub(crate) fn of_folder(path: &Path) -> Cow<'_, Path> {
    if let Some(case) = openfoam::case_in(path) {
        return Cow::Owned(case);
    }
    let stands_in = |name: &str, is_so: &dyn Fn(&Path, &[u8]) -> bool| {
        let file = path.join(name);
        let head = Input::of_file(&file).head(HEAD);
        let is_so = head.is_ok_and(|(head, _)| is_so(&file, &head));
        is_so.then_some(file)
    };
    let file = path.is_dir().then(|| {
        let plotfile = || stands_in(plotfile::HEADER, &|_, head| plotfile::looks_like(head));
        let scene = || stands_in(sog::files::META, &sog::looks_like);
        #[cfg(feature = "dicom")]
        let series = || dicom::series_in(path);
        #[cfg(not(feature = "dicom"))]
        let series = || None;
        plotfile().or_else(scene).or_else(series)
    });
    file.flatten().map_or(Cow::Borrowed(path), Cow::Owned)
}
