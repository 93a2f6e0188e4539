//! What was chosen and what was left out.

use std::borrow::Cow;

use super::mesh::MeshReport;
use crate::scene::ValueSample;

/// How a data set was sampled.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SampleReport {
    /// The scalar shown; `None` where masses and colours come from the file.
    pub field: Option<String>,
    /// Its unit, where the file states it.
    pub unit: Option<String>,
    /// Its least and greatest finite value.
    pub value_range: Option<[f64; 2]>,
    /// The length \[world units\] over which opacities are stated.
    pub unit_distance: f64,
    /// What the particles' lengths are taken for, in words; `None` where there are none.
    pub lengths: Option<String>,
    /// Samples in the file; triangles of a mesh.
    pub sample_count: usize,
    /// Particles made of them.
    pub particle_count: usize,
    /// What was found on the way, in the order of the work.
    pub findings: Vec<Finding>,
    /// How evenly surfels are spread, of a mesh.
    pub mesh: Option<MeshReport>,
    /// What an automatic transfer function was chosen from, where it was asked for.
    pub value_sample: Option<ValueSample>,
}

/// Samples with something about them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How many.
    pub count: usize,
    /// What they are: "nodes", "cells", "particles", "values".
    pub noun: Cow<'static, str>,
    /// What was found and done about it.
    pub reason: Cow<'static, str>,
    /// Whether they were left out.
    pub left_out: bool,
}

impl SampleReport {
    /// Notes samples that were left out, if there are any.
    pub(super) fn leave_out(&mut self, count: usize, noun: &'static str, reason: &'static str) {
        self.find(count, noun, reason, true);
    }

    /// Notes samples that were kept all the same, if there are any.
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

    /// Adds what was found of other samples of the same data.
    #[cfg(feature = "prepared")]
    pub(crate) fn add(&mut self, other: &Self) {
        self.sample_count += other.sample_count;
        self.particle_count += other.particle_count;
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

    /// How many samples were left out.
    pub fn left_out_count(&self) -> usize {
        let left_out = self.findings.iter().filter(|f| f.left_out);
        left_out.map(|f| f.count).sum()
    }

    /// One line for each finding, for people.
    pub fn warnings(&self) -> Vec<String> {
        self.findings.iter().map(Finding::line).collect()
    }
}

impl Finding {
    /// In a line for people.
    pub(super) fn line(&self) -> String {
        let left_out = if self.left_out { " left out" } else { "" };
        format!("{} {}{left_out}: {}", self.count, self.noun, self.reason)
    }
}
