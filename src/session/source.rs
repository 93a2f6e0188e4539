//! Defines sources: data sets with their sampling options, or surfels that are ready.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use crate::error::Result;
use crate::io::{Dataset, Geometry, Up};
use crate::sample::{
    BoundaryChoice, SampleOptions, SampleReport, Sampled, SampledScene, as_surface, is_surface,
    scene, shows_outside,
};
use crate::scene::Particles;
use crate::task::Task;

/// Data set with its sampling options, or surfels that are ready.
#[derive(Debug)]
pub struct Source {
    /// The data.
    pub data: Data,
    /// Options for sampling them.
    pub options: SampleOptions,
    /// Last sampled scene, until it is drawn.
    sampled: Mutex<Option<(SampleOptions, SampledScene)>>,
    /// Report of the first sampling.
    report: Mutex<Option<SampleReport>>,
}

/// Data of a source.
#[derive(Debug, Clone)]
pub enum Data {
    /// A data set, which is sampled.
    Set(Arc<Dataset>),
    /// Surfels that are ready.
    Surfels(Arc<Sampled>),
}

impl Source {
    /// Makes a source.
    pub fn new(data: Data, options: SampleOptions) -> Self {
        Self {
            data,
            options,
            sampled: Mutex::new(None),
            report: Mutex::new(None),
        }
    }

    /// Returns a source of the same data, not yet sampled.
    #[must_use]
    pub fn fresh(&self) -> Self {
        Self::new(self.data.clone(), self.options.clone())
    }

    /// Samples the source. A scene sampled before with the same options is returned, once.
    ///
    /// # Errors
    /// Data that cannot be sampled; cancelled work.
    pub fn scene(&self, options: &SampleOptions) -> Result<SampledScene> {
        let alike = |own: &SampleOptions| SampleOptions {
            task: None,
            ..own.clone()
        };
        let kept = self
            .sampled
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some((own, sampled)) = kept
            && alike(&own) == alike(options)
        {
            return Ok(sampled);
        }
        let sampled = match &self.data {
            Data::Set(dataset) => scene(Dataset::clone(dataset), options)?,
            Data::Surfels(ready) => SampledScene {
                volumes: vec![ready.volume.clone()],
                report: ready.report.clone(),
            },
        };
        let mut report = self.report.lock().unwrap_or_else(PoisonError::into_inner);
        report.get_or_insert_with(|| SampleReport {
            value_sample: None,
            ..sampled.report.clone()
        });
        Ok(sampled)
    }

    /// Returns the report of sampling. It samples the source now if this was not done before.
    ///
    /// # Errors
    /// As [`scene`](Self::scene).
    pub fn report(&self, task: &Task) -> Result<SampleReport> {
        let known = || {
            let report = self.report.lock();
            report.unwrap_or_else(PoisonError::into_inner).clone()
        };
        if let Some(report) = known() {
            return Ok(report);
        }
        let options = SampleOptions {
            task: Some(task.clone()),
            ..self.options.clone()
        };
        let sampled = self.scene(&options)?;
        let report = sampled.report.clone();
        let mut kept = self.sampled.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = Some((options, sampled));
        Ok(report)
    }

    /// Returns the field that makes columns sum masses, `Some(None)` if they do so by themselves; `None` without masses.
    pub fn masses(&self) -> Option<Option<String>> {
        let Data::Set(dataset) = &self.data else {
            return None;
        };
        if !matches!(dataset.geometry, Geometry::Points { .. }) {
            return None;
        }
        let has = |name: &str| {
            let mut names = dataset.fields.iter().map(|field| &field.name);
            names.any(|own| own.eq_ignore_ascii_case(name))
        };
        let of_snapshot = dataset.smoothing.as_ref();
        match of_snapshot.map(|smoothing| smoothing.mass.clone()) {
            Some(mass) => mass.map(Some),
            None if has("m") => Some(Some("m".into())),
            None => has("mass").then_some(None),
        }
    }

    /// Returns the direction up.
    pub fn up(&self) -> Up {
        match &self.data {
            Data::Set(dataset) => dataset.up(),
            Data::Surfels(_) => Up {
                is_of_mesh: true,
                ..Up::of_scene([])
            },
        }
    }

    /// Returns the least and the greatest coordinates.
    pub fn corners(&self) -> Option<(DVec3, DVec3)> {
        match &self.data {
            Data::Set(dataset) => dataset.bounds(),
            Data::Surfels(ready) => {
                let shapes = &ready.volume.particles;
                let Particles::Surfels { positions, .. } = shapes else {
                    return None;
                };
                let ends = positions.iter().map(|&p| (p, p));
                ends.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            }
        }
    }

    /// Returns true if no sampled data depend on the transfer function: no boundary, no opacity of
    /// a surface, no unit distance or opacity scale that was asked for.
    pub fn is_plain(&self) -> bool {
        let options = &self.options;
        let is_of_points = match &self.data {
            Data::Set(dataset) => matches!(dataset.geometry, Geometry::Points { .. }),
            Data::Surfels(_) => true,
        };
        let is_soft = options.kernels.boundary == BoundaryChoice::Soft && !self.is_mesh();
        let is_scaled = (options.function.opacity_scale - 1.0).abs() > 0.0;
        (is_of_points || is_soft)
            && options.flatten.is_none()
            && options.surface.is_none()
            && options.function.unit_distance.is_none()
            && !is_scaled
    }

    /// Returns true if it holds nothing, as some of the ranks that share data may.
    pub fn is_empty(&self) -> bool {
        match &self.data {
            Data::Set(dataset) => is_empty(dataset),
            Data::Surfels(ready) => ready.volume.particles.len() == 0,
        }
    }

    /// Returns true if it is a mesh.
    pub fn is_mesh(&self) -> bool {
        match &self.data {
            Data::Set(dataset) => matches!(dataset.geometry, Geometry::Mesh(_)),
            Data::Surfels(_) => false,
        }
    }

    /// Returns the mesh from which surfels are made, if any are.
    ///
    /// # Errors
    /// Data without a surface.
    pub fn surface(&self, for_columns: bool) -> Result<Option<Cow<'_, Dataset>>> {
        let Data::Set(dataset) = &self.data else {
            return Ok(None);
        };
        if is_empty(dataset) {
            return Ok(None);
        }
        if self.is_mesh() {
            return Ok(Some(Cow::Borrowed(&**dataset)));
        }
        let is_drawn = is_surface(dataset) || shows_outside(dataset, &self.options);
        if self.options.surface.is_none() && (for_columns || !is_drawn) {
            return Ok(None);
        }
        let surface = as_surface(Dataset::clone(dataset), &self.options)?;
        Ok(Some(Cow::Owned(surface)))
    }
}

/// Returns true if a data set has no points, cells or faces.
pub(super) fn is_empty(dataset: &Dataset) -> bool {
    match &dataset.geometry {
        Geometry::Points { positions } => positions.is_empty(),
        Geometry::Cells(mesh) => mesh.cell_count() == 0,
        Geometry::Lattice(lattice) => lattice.len() == 0,
        Geometry::Curvilinear { blocks } => blocks.iter().all(|block| block.nodes.is_empty()),
        Geometry::Splats(cloud) => cloud.positions.is_empty(),
        Geometry::Mesh(mesh) => mesh.parts.iter().all(|part| part.triangles.is_empty()),
    }
}
