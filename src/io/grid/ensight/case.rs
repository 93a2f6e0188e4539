//! Parses the case file, which names the files of the geometry and the variables and lists the times.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::io::grid::ensight::stream::DAMAGED;
use crate::io::particles::table::list;
use crate::io::volume::voxels::beside;

/// Contents of a case file.
#[derive(Default)]
pub(super) struct Case {
    pub(super) model: Option<Named>,
    pub(super) variables: Vec<Variable>,
    time_sets: Vec<TimeSet>,
    file_sets: Vec<FileSet>,
    /// Names of entries that are not read.
    pub(super) left_out: Vec<String>,
}

/// Name of a file, or a pattern for one file per step, with the numbers of its sets.
#[derive(Clone)]
pub(super) struct Named {
    time_set: Option<u32>,
    file_set: Option<u32>,
    pattern: String,
}

/// Variable of nodes or of elements.
pub(super) struct Variable {
    pub(super) name: String,
    pub(super) components: usize,
    pub(super) is_of_nodes: bool,
    pub(super) file: Named,
}

#[derive(Default)]
struct TimeSet {
    number: u32,
    count: usize,
    start: usize,
    increment: usize,
    numbers: Vec<usize>,
    values: Vec<f64>,
}

#[derive(Default)]
struct FileSet {
    number: u32,
    /// For each file, the index in its name (if it has one) and the number of steps in it.
    files: Vec<(Option<usize>, usize)>,
}

/// File, and the index of a step in it.
pub(super) struct Place {
    pub(super) path: PathBuf,
    pub(super) step: usize,
}

/// Returns true if a text is that of a case file.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = lines(&text);
    let is_format = lines.next().is_some_and(|line| line.trim() == "FORMAT");
    is_format
        && lines
            .next()
            .is_some_and(|line| line.trim_start().starts_with("type"))
}

/// Returns the lines that are neither empty nor comments.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().map(str::trim);
    lines.filter(|line| !line.is_empty() && !line.starts_with('#'))
}

/// Splits a line into words; quoted text is one word.
fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        let (word, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => rest
                .split_once(|c: char| c.is_ascii_whitespace())
                .unwrap_or((rest, "")),
        };
        words.push(word.to_owned());
        rest = after.trim_start();
    }
    words
}

impl Case {
    /// # Errors
    /// The format is not EnSight Gold; a line that decides which file is read cannot be parsed.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Self> {
        let mut case = Self::default();
        let mut section = String::new();
        let mut last_key = String::new();
        for line in lines(text) {
            let is_section = ["FORMAT", "GEOMETRY", "VARIABLE", "TIME", "FILE", "MATERIAL"];
            if is_section.contains(&line) {
                section = line.to_owned();
                continue;
            }
            let (key, value) = match line.split_once(':') {
                Some((key, value)) => (key.trim().to_ascii_lowercase(), value),
                // A list of numbers continues on lines without a key.
                None => (last_key.clone(), line),
            };
            match section.as_str() {
                "FORMAT" if key == "type" => check_type(path, value)?,
                "GEOMETRY" if key == "model" => case.model = Named::parse(&words(value), 0),
                "GEOMETRY" => case.left_out.push(key.clone()),
                "VARIABLE" => case.variable(&key, value),
                "TIME" => case.time(path, &key, value)?,
                "FILE" => case.file(&key, value),
                _ => {}
            }
            last_key = key;
        }
        Ok(case)
    }

    fn variable(&mut self, key: &str, value: &str) {
        let words = words(value);
        let is_complex = key.starts_with("complex ");
        let kind = key.strip_prefix("complex ").unwrap_or(key);
        let (kind, is_of_nodes) = match kind.split_once(" per ") {
            Some((kind, "node")) => (kind, true),
            Some((kind, "element")) => (kind, false),
            _ => {
                let at = words.len().min(1);
                self.left_out.extend(words.into_iter().take(at));
                return;
            }
        };
        let components = match kind {
            "scalar" => 1,
            "vector" => 3,
            "tensor symm" | "tensor" => 6,
            "tensor asym" => 9,
            _ => {
                self.left_out.push(key.to_owned());
                return;
            }
        };
        let mut add = |name: String, file: Option<Named>| {
            self.variables.extend(file.map(|file| Variable {
                name,
                components,
                is_of_nodes,
                file,
            }));
        };
        // The line ends with the name and the file, or with the files of the real and imaginary part and the frequency.
        let behind = if is_complex { 3 } else { 1 };
        let Some(at) = words.len().checked_sub(behind + 1) else {
            return;
        };
        let name = &words[at];
        if is_complex {
            for (part, end) in [("_r", 1), ("_i", 2)] {
                let mut words = words.clone();
                words[at + 1] = words[at + end].clone();
                words.truncate(at + 2);
                add(format!("{name}{part}"), Named::parse(&words, 1));
            }
        } else {
            add(name.clone(), Named::parse(&words, 1));
        }
    }

    fn time(&mut self, path: &Path, key: &str, value: &str) -> Result<()> {
        let numbers = words(value);
        if key == "time set" {
            self.time_sets.push(TimeSet {
                number: number(&numbers).unwrap_or(0),
                increment: 1,
                ..TimeSet::default()
            });
            return Ok(());
        }
        let Some(set) = self.time_sets.last_mut() else {
            return Ok(());
        };
        match key {
            "number of steps" => set.count = number(&numbers).unwrap_or(0),
            "filename start number" => set.start = number(&numbers).unwrap_or(0),
            "filename increment" => set.increment = number(&numbers).unwrap_or(1),
            "filename numbers" => set
                .numbers
                .extend(numbers.iter().filter_map(|w| w.parse::<usize>().ok())),
            "time values" => set
                .values
                .extend(numbers.iter().filter_map(|w| w.parse::<f64>().ok())),
            "filename numbers file" | "time values file" => {
                let expected = "times and numbers of files in the case file itself";
                let advice = "write them into it";
                return Err(Error::format(path, "TIME", expected, key, advice));
            }
            _ => {}
        }
        Ok(())
    }

    fn file(&mut self, key: &str, value: &str) {
        let numbers = words(value);
        if key == "file set" {
            self.file_sets.push(FileSet {
                number: number(&numbers).unwrap_or(0),
                files: Vec::new(),
            });
            return;
        }
        let Some(set) = self.file_sets.last_mut() else {
            return;
        };
        match key {
            "filename index" => set.files.push((number(&numbers), 0)),
            "number of steps" => {
                let count = number(&numbers).unwrap_or(0);
                match set.files.last_mut() {
                    Some((Some(_), steps)) if *steps == 0 => *steps = count,
                    _ => set.files.push((None, count)),
                }
            }
            _ => {}
        }
    }

    /// Returns the times of all sets, sorted, each once.
    pub(super) fn times(&self) -> Vec<f64> {
        let used = |set: &&TimeSet| {
            let files = self.variables.iter().map(|v| &v.file).chain(&self.model);
            files
                .into_iter()
                .any(|file| file.time_set == Some(set.number))
        };
        let sets = self.time_sets.iter().filter(used);
        let mut times: Vec<f64> = sets.flat_map(|set| set.values.iter().copied()).collect();
        times.retain(|time| time.is_finite());
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }

    /// Returns the file of a named entry at a time.
    ///
    /// # Errors
    /// A set does not exist, or a path leads outside the folder of the case file.
    pub(super) fn place(&self, path: &Path, named: &Named, time: Option<f64>) -> Result<Place> {
        let missing = |what: &str, number: u32| {
            let expected = format!("{what} {number}, which a file is said to have");
            Error::format(path, "sets", expected, "none of this number", DAMAGED)
        };
        let mut step = 0;
        let mut number = None;
        if let Some(of) = named.time_set {
            let set = self.time_sets.iter().find(|set| set.number == of);
            let set = set.ok_or_else(|| missing("time set", of))?;
            // The step is the last one that is not later.
            let time = time.unwrap_or(f64::NEG_INFINITY);
            step = set
                .values
                .iter()
                .filter(|t| **t <= time)
                .count()
                .saturating_sub(1);
            let counted = set.start.saturating_add(step.saturating_mul(set.increment));
            number = Some(set.numbers.get(step).copied().unwrap_or(counted));
        }
        let mut in_file = 0;
        if let Some(of) = named.file_set {
            let set = self.file_sets.iter().find(|set| set.number == of);
            let set = set.ok_or_else(|| missing("file set", of))?;
            let mut before = 0;
            for &(index, steps) in &set.files {
                if step < before + steps {
                    number = index.or(number);
                    in_file = step - before;
                    break;
                }
                before = before.saturating_add(steps);
            }
        }
        let name = match number {
            Some(number) => numbered(&named.pattern, number),
            None => named.pattern.clone(),
        };
        let path = beside(path, &name)?;
        Ok(Place {
            path,
            step: in_file,
        })
    }

    /// Returns a note of the entries that are left out.
    pub(super) fn note(&self) -> Option<String> {
        let names = || list(self.left_out.iter().map(String::as_str));
        (!self.left_out.is_empty()).then(|| format!("Left out: {}.", names()))
    }
}

impl Named {
    /// - `words`: the numbers of its sets, `before` other words, the file's name, and words that are ignored.
    fn parse(words: &[String], before: usize) -> Option<Self> {
        let is_number = |w: &&String| w.parse::<u32>().is_ok();
        let sets: Vec<u32> = words
            .iter()
            .take(words.len().saturating_sub(before + 1).min(2))
            .take_while(is_number)
            .filter_map(|w| w.parse().ok())
            .collect();
        Some(Self {
            time_set: sets.first().copied(),
            file_set: sets.get(1).copied(),
            pattern: words.get(sets.len() + before)?.clone(),
        })
    }
}

fn check_type(path: &Path, value: &str) -> Result<()> {
    let kind = value.trim().to_ascii_lowercase();
    if kind == "ensight gold" {
        return Ok(());
    }
    let (found, advice) = if kind.starts_with("master_server") {
        let advice = "give one of the case files that it names";
        ("a list of EnSight's servers".to_owned(), advice)
    } else {
        let shown: String = kind.chars().take(40).collect();
        let advice = "save it as EnSight Gold, or as VTK XML";
        (format!("`{shown}`, which is not read"), advice)
    };
    Err(Error::format(
        path,
        "FORMAT, type",
        "`ensight gold`",
        found,
        advice,
    ))
}

fn number<T: std::str::FromStr>(words: &[String]) -> Option<T> {
    words.first()?.parse().ok()
}

/// Replaces the asterisks of a name by a number, padded to their width.
fn numbered(pattern: &str, number: usize) -> String {
    let Some(first) = pattern.find('*') else {
        return pattern.to_owned();
    };
    let rest = pattern[first..].trim_start_matches('*');
    let width = pattern.len() - first - rest.len();
    format!("{}{number:0width$}{rest}", &pattern[..first])
}
