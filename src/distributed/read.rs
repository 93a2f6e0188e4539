//! A file of points that ranks read together, each a run of its rows.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::ranks::Ranks;
use super::share::Share;
use crate::error::{Error, Result};
use crate::prepared::{Found, PointFile};
use crate::sample::{SampleReport, finding_line, summed_function};

/// What ranks read of a file.
#[derive(Debug)]
pub(crate) struct ReadShare {
    /// The particles of this rank's rows.
    pub(crate) share: Share,
    /// What all found: one line each, for people.
    pub(crate) warnings: Vec<String>,
}

/// What one found of its rows.
#[derive(Debug, Serialize, Deserialize)]
struct Told {
    sample_count: usize,
    particle_count: usize,
    value_range: Option<[f32; 2]>,
    corners: Option<[[f64; 3]; 2]>,
    /// The bits of a sum of volumes, which may be no number.
    volume_sum: u64,
    /// How many, of what, why, and whether they were left out.
    findings: Vec<(usize, String, String, bool)>,
}

impl Told {
    fn of(found: &Found) -> Self {
        let report = &found.report;
        let findings = report.findings.iter();
        Self {
            sample_count: report.sample_count,
            particle_count: report.particle_count,
            value_range: report.value_range,
            corners: found.corners.map(|(a, b)| [a.to_array(), b.to_array()]),
            volume_sum: found.volume_sum.to_bits(),
            findings: findings
                .map(|f| (f.count, f.noun.into(), f.reason.into(), f.left_out))
                .collect(),
        }
    }

    /// Adds what it tells, but for findings.
    fn add_to(&self, all: &mut Found) {
        all.report.add(&SampleReport {
            sample_count: self.sample_count,
            particle_count: self.particle_count,
            value_range: self.value_range,
            ..SampleReport::default()
        });
        if let Some([a, b]) = self.corners {
            all.extend((DVec3::from(a), DVec3::from(b)));
        }
        all.volume_sum += f64::from_bits(self.volume_sum);
    }
}

impl ReadShare {
    /// Reads this rank's rows. What the file says of all its particles, it knows of those of all ranks then.
    ///
    /// # Errors
    /// What reading says, on any rank; nothing that can be drawn; a rank that is gone.
    pub(crate) fn of(file: &mut PointFile, ranks: &mut Ranks) -> Result<Self> {
        let (rank, size) = (ranks.rank(), ranks.size());
        let mut own = None;
        let part = file.read_part(rank, size).map(|read| {
            // Finite numbers and words.
            let told = serde_json::to_vec(&Told::of(&read.1)).unwrap_or_default();
            own = Some(read);
            told
        });
        let parts = ranks.gather_to_all(part)?;
        let (mut volume, own) = own.ok_or(Error::Cancelled)?;
        let mut all = Found {
            report: SampleReport {
                sample_count: 0,
                particle_count: 0,
                value_range: None,
                ..own.report
            },
            corners: None,
            volume_sum: 0.0,
        };
        let mut findings: BTreeMap<(bool, String, String), usize> = BTreeMap::new();
        for part in &parts {
            let told: Told = serde_json::from_slice(part).map_err(|e| {
                let advice = "start the same program on every rank";
                let expected = "what this program finds of a file";
                Error::invalid("ranks", "message", expected, e.to_string(), advice)
            })?;
            told.add_to(&mut all);
            for (count, noun, reason, left_out) in told.findings {
                *findings.entry((left_out, noun, reason)).or_default() += count;
            }
        }
        let findings = findings.iter();
        let warnings = findings
            .map(|((left_out, noun, reason), count)| finding_line(*count, noun, reason, *left_out))
            .collect();
        file.keep(all)?;
        if file.field().is_some() {
            let report = file.report().cloned().unwrap_or_default();
            let function = summed_function(report.value_range, report.unit_distance)?;
            volume.transfer_function = Some(function);
        }
        Ok(Self {
            share: Share::from(vec![volume]),
            warnings,
        })
    }
}
