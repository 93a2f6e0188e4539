//! Several inputs that ranks read in turn: each samples some of them, and hears what the others are.

use std::collections::HashMap;

use glam::DVec3;
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};

use super::input::DataOptions;
use super::progress::note;
use super::reads::{OneRead, Read, ReadAbout, note_missing, shows, uses};
use super::scene::Scene;
use super::source::Input;
use super::usage::Kind;
use crate::distributed::{Ranks, Share, dealt, hand_out, put, take, unknown};
use crate::io::Up;
use crate::prepared::about::Function;
use crate::sample::{SampleOptions, SampleReport, shared_functions};
use crate::scene::{TransferFunction, ValueSample};
use crate::{Error, Result};

/// What one says of an input that it has read, to the others.
#[derive(Debug, Serialize, Deserialize)]
struct Told {
    field: Option<String>,
    unit: Option<String>,
    /// The bits of the length over which opacities are stated.
    unit_distance: u64,
    kind: Kind,
    up: [f64; 3],
    front: Option<[f64; 3]>,
    is_plane: bool,
    is_of_mesh: bool,
    corners: Option<[[f64; 3]; 2]>,
    is_automatic: bool,
    field_asked: Option<String>,
    volume_count: usize,
    is_classified: bool,
    has_opacity: bool,
    /// For people.
    lines: Vec<String>,
    /// Whether it lacks the field that is asked for.
    is_lacking: bool,
}

/// An input that was read here, and what there is to say of it.
struct Own {
    read: Read,
    error: Option<Error>,
    lines: Vec<String>,
}

impl Told {
    fn of(own: &Own) -> Self {
        let about = &own.read.of;
        let (report, up) = (&about.report, &about.up);
        Self {
            field: report.field.clone(),
            unit: report.unit.clone(),
            unit_distance: report.unit_distance.to_bits(),
            kind: about.kind,
            up: up.direction.to_array(),
            front: up.front.map(|front| front.to_array()),
            is_plane: up.is_plane,
            is_of_mesh: up.is_of_mesh,
            corners: about.corners.map(|(a, b)| [a.to_array(), b.to_array()]),
            is_automatic: about.is_automatic,
            field_asked: about.field_asked.clone(),
            volume_count: about.volume_count,
            is_classified: about.is_classified,
            has_opacity: about.has_opacity,
            lines: own.lines.clone(),
            is_lacking: own.error.is_some(),
        }
    }

    fn about(self) -> ReadAbout {
        ReadAbout {
            report: SampleReport {
                field: self.field,
                unit: self.unit,
                unit_distance: f64::from_bits(self.unit_distance),
                ..SampleReport::default()
            },
            kind: self.kind,
            up: Up {
                direction: DVec3::from(self.up),
                reason: "as the rank says that has read it",
                front: self.front.map(DVec3::from),
                is_plane: self.is_plane,
                is_of_mesh: self.is_of_mesh,
            },
            corners: self.corners.map(|[a, b]| (a.into(), b.into())),
            is_automatic: self.is_automatic,
            field_asked: self.field_asked,
            volume_count: self.volume_count,
            is_classified: self.is_classified,
            has_opacity: self.has_opacity,
        }
    }
}

impl DataOptions {
    /// A scene of several inputs, of which each rank reads some, and this one's share, whose volumes are in the scene.
    ///
    /// # Errors
    /// What reading says, on any rank; a field that no input has; a rank that is gone.
    pub(super) fn dealt(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        progress: &ProgressBar,
        ranks: &mut Ranks,
    ) -> Result<(Scene, Share)> {
        let options = &SampleOptions {
            keeps_value_sample: !options.for_columns,
            ..options.clone()
        };
        let lengths = inputs
            .iter()
            .map(|input| std::fs::metadata(&input.path).map_or(0, |meta| meta.len()));
        // What the first rank sees is what all go by.
        let lengths = ranks.gather_records(Ok(lengths.collect()))?.swap_remove(0);
        let part = dealt(&lengths, ranks.rank(), ranks.size());
        let first = part.start;
        let own = self.read_some(inputs.get(part).unwrap_or_default(), options, progress);
        let mut own = ranks.agree(own)?;
        let told: Vec<Told> = own.iter().map(Told::of).collect();
        let told = ranks.told_by_all(&told)?.into_iter().flatten();
        let mut lacking = Vec::new();
        let mut reads = Vec::with_capacity(inputs.len());
        for (input, told) in inputs.iter().zip(told) {
            let path = input.path.display();
            for line in &told.lines {
                progress.suspend(|| note!("{path}: {line}"));
            }
            lacking.extend(told.is_lacking.then_some(input));
            reads.push(told.about());
        }
        let abouts: Vec<&ReadAbout> = reads.iter().collect();
        let is_shown = shows(&abouts, options);
        let error = own.iter_mut().find_map(|own| own.error.take());
        ranks.agree(error.filter(|_| !is_shown).map_or(Ok(()), Err))?;
        for input in lacking {
            progress.suspend(|| note_missing(input, options));
        }
        self.check_use(&uses(&abouts, options))?;
        let functions = self.functions_of_all(inputs, &reads, first, &mut own, options, ranks)?;
        let again = own.iter_mut().zip(first..).try_for_each(|(own, i)| {
            let function = functions.get(&i);
            function.map_or(Ok(()), |function| {
                self.read_again(&inputs[i], options, function, &mut own.read, progress)
            })
        });
        ranks.agree(again)?;
        let volumes = own.into_iter().flat_map(|own| own.read.volumes);
        let mut share = hand_out(volumes.collect(), ranks)?;
        let has_boundary = self.may_end_sharply(reads.iter());
        let scene = Scene::of_reads(std::mem::take(&mut share.volumes), reads, has_boundary);
        self.check_fields(&scene)?;
        Ok((scene, share))
    }

    fn read_some(
        &self,
        inputs: &[Input],
        options: &SampleOptions,
        progress: &ProgressBar,
    ) -> Result<Vec<Own>> {
        self.check_function(options)?;
        let read = |input: &Input| {
            progress.set_message(format!("reading {}", input.path.display()));
            let mut lines = Vec::new();
            let mut say = |line: &str| lines.push(line.to_owned());
            let (read, error): OneRead =
                self.read_one(input, false, options, &|_, _| Ok(None), &mut say)?;
            Ok(Own { read, error, lines })
        };
        inputs.iter().map(read).collect()
    }

    /// The functions that inputs share, by the inputs' numbers: the first rank chooses them, of the values of all.
    ///
    /// - `first`: the number of the first input that was read here.
    fn functions_of_all(
        &self,
        inputs: &[Input],
        reads: &[ReadAbout],
        first: usize,
        own: &mut [Own],
        options: &SampleOptions,
        ranks: &mut Ranks,
    ) -> Result<HashMap<usize, TransferFunction>> {
        let mut samples = Vec::new();
        for (own, i) in own.iter_mut().zip(first as u64..) {
            if let Some(sample) = own.read.of.report.value_sample.take() {
                let (records, has_surroundings) = sample.to_records();
                put(&mut samples, &[i, u64::from(has_surroundings)]);
                put(&mut samples, &records);
            }
        }
        let samples = ranks.gather_on_first(Ok(samples))?;
        let shared = (ranks.rank() == 0).then(|| {
            let mut reports: Vec<SampleReport> =
                reads.iter().map(|read| read.report.clone()).collect();
            for part in samples {
                let mut part = part.as_slice();
                while !part.is_empty() {
                    let (of, records) = (take::<u64>(&mut part)?, take::<[f64; 3]>(&mut part)?);
                    let report = of
                        .first()
                        .and_then(|&i| reports.get_mut(usize::try_from(i).ok()?));
                    if let Some(report) = report {
                        let has_surroundings = of.get(1) == Some(&1);
                        let sample = ValueSample::of_records(&records, has_surroundings);
                        report.value_sample = Some(sample);
                    }
                }
            }
            let own: Vec<SampleOptions> = inputs
                .iter()
                .map(|input| self.of_input(input, options))
                .collect();
            let mut reports: Vec<_> = reports.iter_mut().zip(&own).collect();
            let shared = shared_functions(&mut reports)?;
            let told: Vec<(Function, Vec<usize>)> = shared
                .into_iter()
                .map(|(function, members)| (Function::of(&function), members))
                .collect();
            Ok(told)
        });
        let shared: Vec<(Function, Vec<usize>)> = ranks.told_by_first(shared.transpose())?;
        let mut functions = HashMap::new();
        for (function, members) in shared {
            let function = function.transfer();
            let function = function.ok_or_else(|| unknown("no transfer function"))?;
            functions.extend(members.into_iter().map(|i| (i, function.clone())));
        }
        Ok(functions)
    }
}
