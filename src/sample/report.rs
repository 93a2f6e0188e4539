//! Defines the report of sampling: the choices made and the samples left out.

use std::borrow::Cow;

use glam::DVec3;

use crate::data::smoothing::SphKernel;
use crate::math::ExactSum;
use crate::scene::ValueSample;

/// Report on the sampling of a data set.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SampleReport {
    /// The scalar shown; `None` if masses and colours come from the file.
    pub field: Option<String>,
    /// Unit of the scalar, if the file states one.
    pub unit: Option<String>,
    /// Least and greatest finite value of the scalar.
    pub value_range: Option<[f64; 2]>,
    /// The length \[world units\] over which opacities are stated.
    pub unit_distance: f64,
    /// Meaning of the particles' lengths, in words; `None` if they have none.
    pub lengths: Option<String>,
    /// SPH kernel that columns of the particles draw
    /// ([`ColumnSettings::smoothing`](crate::render::ColumnSettings::smoothing)); `None` if they are no spheres that stand for
    /// one, or Gaussians are asked for.
    pub smoothing: Option<SphKernel>,
    /// Number of samples in the file; of triangles for a mesh.
    pub sample_count: usize,
    /// Number of particles made of the samples, and of their ghosts.
    pub particle_count: usize,
    /// Number of ghosts among the particles: kernels beyond a sharp boundary.
    pub ghost_count: usize,
    /// Number of particles that are parts of refined cells ([`Refinement`](super::Refinement)).
    pub refined_count: usize,
    /// Greatest level of these: an index of a cell is split into 2 to this power.
    pub refined_level: u8,
    /// True if kernels of the data may be refined for a picture: those of grids with values at nodes.
    pub may_refine: bool,
    /// Findings, in the order of the work.
    pub findings: Vec<Finding>,
    /// Evenness of the spread of surfels, for a mesh.
    pub mesh: Option<MeshReport>,
    /// Values from which an automatic transfer function was chosen, if the options keep them.
    pub value_sample: Option<ValueSample>,
}

/// Property that some samples have in common, such as a reason why they were left out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Number of samples.
    pub count: usize,
    /// Kind of samples: "nodes", "cells", "particles", "values".
    pub noun: Cow<'static, str>,
    /// The finding and its consequence.
    pub reason: Cow<'static, str>,
    /// True if the samples were left out.
    pub left_out: bool,
}

/// Returns the SPH kernel that columns of all data draw together; `None` unless it is the same for all.
pub fn common_smoothing<'a>(
    reports: impl IntoIterator<Item = &'a SampleReport>,
) -> Option<SphKernel> {
    let mut all = reports.into_iter().map(|report| report.smoothing);
    let first = all.next()?;
    first.filter(|_| all.all(|other| other == first))
}

impl SampleReport {
    /// Notes samples that were left out, if there are any.
    pub(super) fn leave_out(&mut self, count: usize, noun: &'static str, reason: &'static str) {
        self.find(count, noun, reason, true);
    }

    /// Notes samples that were kept despite a finding, if there are any.
    pub(super) fn note(&mut self, count: usize, noun: &'static str, reason: &'static str) {
        self.find(count, noun, reason, false);
    }

    fn find(&mut self, count: usize, noun: &'static str, reason: &'static str, left_out: bool) {
        if count > 0 {
            self.findings.push(Finding {
                count,
                noun: noun.into(),
                reason: reason.into(),
                left_out,
            });
        }
    }

    /// Adds the report on other samples of the same data.
    pub(crate) fn add(&mut self, other: &Self) {
        self.sample_count += other.sample_count;
        self.particle_count += other.particle_count;
        self.ghost_count += other.ghost_count;
        self.refined_count += other.refined_count;
        self.refined_level = self.refined_level.max(other.refined_level);
        self.may_refine |= other.may_refine;
        self.value_range = match (self.value_range, other.value_range) {
            (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
            (own, other) => own.or(other),
        };
        for found in &other.findings {
            let kind = |f: &Finding| (f.noun.clone(), f.reason.clone(), f.left_out);
            let is_same = |own: &&mut Finding| kind(own) == kind(found);
            match self.findings.iter_mut().find(is_same) {
                Some(own) => own.count += found.count,
                None => self.findings.push(found.clone()),
            }
        }
    }

    /// Returns the number of samples that were left out.
    pub fn left_out_count(&self) -> usize {
        let left_out = self.findings.iter().filter(|f| f.left_out);
        left_out.map(|f| f.count).sum()
    }

    /// Returns one line for each finding, for people.
    pub fn warnings(&self) -> Vec<String> {
        self.findings.iter().map(Finding::line).collect()
    }
}

impl Finding {
    /// Formats the finding as a line for people.
    pub(super) fn line(&self) -> String {
        let left_out = if self.left_out { " left out" } else { "" };
        format!("{} {}{left_out}: {}", self.count, self.noun, self.reason)
    }
}

/// Report on a part of the data, with the sum and the bounds that a report on all data needs.
#[derive(Debug, Default)]
pub(crate) struct Found {
    pub(crate) report: SampleReport,
    pub(crate) corners: Option<(DVec3, DVec3)>,
    /// Sum of the particles' volumes \[length³\].
    pub(crate) volume_sum: ExactSum,
}

impl Found {
    /// Returns findings on no particles, of the same kind as others.
    pub(crate) fn none_of(others: &SampleReport) -> Self {
        Self {
            report: SampleReport {
                value_range: None,
                sample_count: 0,
                particle_count: 0,
                ghost_count: 0,
                refined_count: 0,
                refined_level: 0,
                findings: Vec::new(),
                ..others.clone()
            },
            ..Self::default()
        }
    }

    pub(crate) fn extend(&mut self, (a, b): (DVec3, DVec3)) {
        let own = self.corners;
        self.corners = Some(own.map_or((a, b), |(low, high)| (low.min(a), high.max(b))));
    }
}

/// Report on the sampling of a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshReport {
    /// Number of triangles in the file.
    pub triangle_count: usize,
    /// Number of surfels made of them.
    pub surfel_count: usize,
    /// Number of kernels for lines and points.
    pub mark_count: usize,
    /// Area of all triangles \[length²\].
    pub area: f64,
    /// Square root of the mean area of a surfel \[length\].
    pub spacing: f64,
    /// Root mean square deviation from 1 of the sums of weights at points of the surface.
    pub ripple: f64,
    /// Greatest deviation from 1 of these sums.
    pub greatest_ripple: f64,
    /// How opaque surfels look in viewers that composite them, if they were merged for these.
    pub composited: Option<CompositedReport>,
    /// Findings, in the order of the work.
    pub findings: Vec<Finding>,
}

/// Expected look of surfels in viewers that composite them as splats, seen along the normals of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CompositedReport {
    /// Mean opacity over the surface. What is missing to 1 shows what is behind.
    pub opacity: f64,
    /// Root mean square error of colours, in sRGB codes from 0 to 1, at points of the surface, where it is covered.
    pub error: f64,
}

impl MeshReport {
    /// Returns one line for each finding, for people.
    pub fn warnings(&self) -> Vec<String> {
        self.findings.iter().map(Finding::line).collect()
    }

    /// Returns a summary in one line, for people.
    pub fn summary(&self) -> String {
        format!(
            "{} surfels {:.3e} apart on an area of {:.6e}, weights even to {:.1} %",
            self.surfel_count,
            self.spacing,
            self.area,
            100.0 * self.ripple
        )
    }

    pub(super) fn find(&mut self, count: usize, noun: &'static str, reason: &'static str) {
        if count > 0 {
            self.findings.push(Finding {
                count,
                noun: noun.into(),
                reason: reason.into(),
                left_out: true,
            });
        }
    }
}
