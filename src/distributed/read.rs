//! A file of points that ranks read together, each a run of its rows.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::ranks::Ranks;
use super::share::Share;
use crate::error::{Error, Result};
use crate::prepared::{Found, PointFile};
use crate::sample::{Finding, SampleReport, summed_function};

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

    /// Adds what it tells.
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
        all.volume_sum += f64::from_bits(self.volume_sum);
    }
}

/// Reads this rank's rows: its particles. What the file says of its particles is of those of all ranks then.
///
/// # Errors
/// What reading says, on any rank; nothing that can be drawn; a rank that is gone.
pub(crate) fn read_together(file: &mut PointFile, ranks: &mut Ranks) -> Result<Share> {
    let mut own = None;
    let part = file.read_part(ranks.rank(), ranks.size()).map(|read| {
        // Finite numbers and words.
        let told = serde_json::to_vec(&Told::of(&read.1)).unwrap_or_default();
        own = Some(read);
        told
    });
    let parts = ranks.gather_to_all(part)?;
    let (mut volume, own) = own.ok_or(Error::Cancelled)?;
    let mut all = Found::none_of(&own.report);
    for part in &parts {
        let told: Told = serde_json::from_slice(part).map_err(|e| {
            let advice = "start the same program on every rank";
            let expected = "what this program finds of a file";
            Error::invalid("ranks", "message", expected, e.to_string(), advice)
        })?;
        told.add_to(&mut all);
    }
    file.keep(all)?;
    if file.field().is_some() {
        let report = file.report().cloned().unwrap_or_default();
        let function = summed_function(report.value_range, report.unit_distance)?;
        volume.transfer_function = Some(function);
    }
    Ok(Share::from(vec![volume]))
}
