//! Sums the reports of all ranks on their parts of the data.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::collective::Collective;
use crate::error::Result;
use crate::math::ExactSum;
use crate::sample::{Finding, Found, SampleReport};

/// Summary of a rank's rows, as it sends it to the others.
#[derive(Debug, Serialize, Deserialize)]
struct Summary {
    sample_count: usize,
    particle_count: usize,
    value_range: Option<[f64; 2]>,
    corners: Option<[[f64; 3]; 2]>,
    /// Limbs of the sum of volumes ([`ExactSum::to_limbs`]).
    volume_sum: Vec<i64>,
    /// Count, noun and reason of each finding, and whether the particles were left out.
    findings: Vec<(usize, String, String, bool)>,
}

impl Summary {
    fn of(found: &Found) -> Self {
        let report = &found.report;
        let findings = report.findings.iter();
        Self {
            sample_count: report.sample_count,
            particle_count: report.particle_count,
            value_range: report.value_range,
            corners: found.corners.map(|(a, b)| [a.to_array(), b.to_array()]),
            volume_sum: found.volume_sum.to_limbs(),
            findings: findings
                .map(|f| {
                    (
                        f.count,
                        f.noun.to_string(),
                        f.reason.to_string(),
                        f.left_out,
                    )
                })
                .collect(),
        }
    }

    /// Adds this rank's summary to that of all ranks.
    fn add_to(self, all: &mut Found) {
        let findings = self.findings.into_iter();
        all.report.add(&SampleReport {
            sample_count: self.sample_count,
            particle_count: self.particle_count,
            value_range: self.value_range,
            findings: findings
                .map(|(count, noun, reason, left_out)| Finding {
                    count,
                    noun: noun.into(),
                    reason: reason.into(),
                    left_out,
                })
                .collect(),
            ..SampleReport::default()
        });
        if let Some([a, b]) = self.corners {
            all.extend((DVec3::from(a), DVec3::from(b)));
        }
        if let Some(sum) = ExactSum::of_limbs(&self.volume_sum) {
            all.volume_sum.add_all(sum);
        }
    }
}

/// Adds up the summaries of all ranks.
///
/// # Errors
/// A rank that is gone, or that runs another program.
pub(super) fn found_on_all(own: &Found, ranks: &mut dyn Collective) -> Result<Found> {
    let mut all = Found::none_of(&own.report);
    for summary in ranks.gather_values(Summary::of(own))? {
        summary.add_to(&mut all);
    }
    Ok(all)
}
