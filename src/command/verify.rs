//! Runs `ewa-splat verify`: draws tiles of a picture again by the record in it, and compares them.
//!
//! A record may come from anywhere. Its command is read by the program's own parser, must be `render`, and only says how to
//! draw: names of files are looked up beside the picture, in the current folder and below `--data`, and nothing is written.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::{Args, CommandFactory, FromArgMatches};
use serde_json::{Value, json};

use super::progress::note;
use super::provenance::{FORMAT, Hashed, Hashes, hash_of, name_of};
use super::render::{self, BackendName, Comparison, DEFAULT_TILES, Ending, Found};
use super::typed::{Role, renamed};
use super::{Command, words};
use crate::io::{StoredPicture, read_stored};
use crate::load::input::transfer_of;
use crate::opened;
use crate::sample::TransferChoice;
use crate::{Backend, Error, Result};

/// Greatest number of entries of folders that are searched for inputs.
const MOST_ENTRIES: usize = 1_000_000;

#[derive(Args)]
pub(crate) struct Arguments {
    /// Picture that `render` wrote: png or exr
    picture: PathBuf,
    /// Folder in which inputs are looked for, too, at any depth
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Number of tiles of 16 x 16 pixels that are drawn again, or `all` [default: 90, which find a change in 5 % of the
    /// tiles with a probability of 99 %]
    #[arg(long, value_name = "N|all", value_parser = tiles)]
    tiles: Option<Tiles>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Tiles that are drawn again.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Tiles {
    All,
    Some(usize),
}

fn tiles(text: &str) -> std::result::Result<Tiles, String> {
    if text == "all" {
        return Ok(Tiles::All);
    }
    let count = text.parse().ok().filter(|count| *count > 0);
    let count = count.map(Tiles::Some);
    count.ok_or_else(|| "a number of tiles above 0, or all".into())
}

/// Contents of a record.
struct Record {
    version: String,
    command: Vec<String>,
    frame: Option<usize>,
    backend: String,
    inputs: Vec<Given>,
}

/// A file that a record names.
struct Given {
    file: String,
    hash: Hashed,
}

/// Why an input does not serve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    Missing,
    Different,
}

/// Checks a picture, and prints what is found.
///
/// # Errors
/// A picture that cannot be read, without a record or with a damaged one; inputs that are missing or different; a
/// picture that differs from the one that is drawn by more than the tolerance.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.picture;
    let mut picture = read_stored(path)?;
    let text = picture.record.take().ok_or_else(|| {
        let expected = "a record of how the picture was made, as `render` writes it";
        let advice = "draw the picture again, without --no-provenance";
        Error::format(path, "record", expected, "none", advice)
    })?;
    let record = Record::parse(&text).map_err(|found| damaged(path, &found))?;
    let own = env!("CARGO_PKG_VERSION");
    if record.version != own {
        note!(
            "{}: made by version {}, compared by {own}",
            path.display(),
            plain(&record.version)
        );
    }
    let mut search = Search::new(arguments, &record)?;
    let mut render = record.arguments(path, &mut search)?;
    let mut faults = std::mem::take(&mut search.faults);
    let mut report = json!({
        "file": path.display().to_string(),
        "version": record.version,
        "own_version": own,
        "inputs": record.inputs.len(),
        "inputs_not_hashed": record.not_hashed(),
    });
    let mut found = None;
    if faults.is_empty() {
        let count = match arguments.tiles.unwrap_or(Tiles::Some(DEFAULT_TILES)) {
            Tiles::All => None,
            Tiles::Some(count) => Some(count),
        };
        found = Some(record.compared(path, picture, count, &mut render)?);
        faults = search.beside(&record);
    }
    report["faults"] = faults.iter().map(Fault::entry).collect();
    let result = match &found {
        _ if !faults.is_empty() => "inputs",
        Some(found) => describe(found, &mut report),
        None => "inputs",
    };
    report["result"] = json!(result);
    super::report(&report, arguments.json, print);
    match result {
        "equal" | "within tolerance" => Ok(()),
        "inputs" => Err(Error::format(
            path,
            "inputs",
            "the files that the record names",
            list(&faults),
            "name their folder by --data",
        )),
        _ => Err(Error::format(
            path,
            "pixels",
            "those that its record leads to",
            "others",
            "the picture, or what draws it, was changed since",
        )),
    }
}

fn damaged(path: &Path, found: &str) -> Error {
    let expected = "the record that `render` writes";
    let advice = "draw the picture again";
    Error::format(path, "record", expected, found, advice)
}

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// A text that names what was found in its place.
    fn parse(text: &str) -> std::result::Result<Self, String> {
        let json: Value = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let lacks = |key: &str| format!("one without a sound `{key}`");
        let string = |key: &str| {
            let value = json[key].as_str().map(str::to_owned);
            value.ok_or_else(|| lacks(key))
        };
        match json["format"].as_u64() {
            Some(FORMAT) => {}
            Some(other) => return Err(format!("one of format {other}, of a later version")),
            None => return Err(lacks("format")),
        }
        let list = |key: &str| json[key].as_array().ok_or_else(|| lacks(key));
        let word = |word: &Value| word.as_str().map(str::to_owned);
        let command: Option<Vec<String>> = list("command")?.iter().map(word).collect();
        let input = |entry: &Value| {
            Some(Given {
                file: entry["file"].as_str().unwrap_or_default().to_owned(),
                hash: Hashed::of_entry(entry)?,
            })
        };
        let inputs: Option<Vec<Given>> = list("inputs")?.iter().map(input).collect();
        let frame = match &json["frame"] {
            Value::Null => None,
            frame => {
                let frame = frame.as_u64().and_then(|frame| usize::try_from(frame).ok());
                Some(frame.ok_or_else(|| lacks("frame"))?)
            }
        };
        Ok(Self {
            version: string("version")?,
            command: command.ok_or_else(|| lacks("command"))?,
            frame,
            backend: string("backend")?,
            inputs: inputs.ok_or_else(|| lacks("inputs"))?,
        })
    }

    /// Returns the arguments of `render`, whose inputs are files that were found.
    ///
    /// # Errors
    /// Words that are no command to render; a missing file that is no input of the record.
    fn arguments(&self, path: &Path, search: &mut Search<'_>) -> Result<render::Arguments> {
        let unsound = |error: clap::Error| {
            let text = error.to_string();
            let line = text.lines().next().unwrap_or_default();
            damaged(path, &format!("a command that is not one: {line}"))
        };
        let mut program = super::Arguments::command();
        program.build();
        let parse = |program: &mut clap::Command, words: Vec<OsString>| {
            let words = std::iter::once("ewa-splat".into()).chain(words);
            program.try_get_matches_from_mut(words)
        };
        let words = self.command.iter().map(OsString::from).collect();
        let matches = parse(&mut program, words).map_err(unsound)?;
        let of_render = program.find_subcommand("render").cloned();
        let (Some(of_render), Some(matches)) = (of_render, matches.subcommand_matches("render"))
        else {
            return Err(damaged(path, "a command other than `render`"));
        };
        let mut rename = |name: &Path, role| search.find(name, role);
        let words = renamed(&of_render, matches, &mut rename)?;
        let matches = parse(&mut program, words).map_err(unsound)?;
        let parsed = super::Arguments::from_arg_matches(&matches).map_err(unsound)?;
        let Command::Render(mut render) = parsed.command else {
            return Err(damaged(path, "a command other than `render`"));
        };
        // Side outputs are never written; depths and normals go on to choose how the picture is drawn.
        render.out = path.into();
        render.mpi = false;
        render.method.measure_error = false;
        let output = &mut render.output;
        (output.stats, output.write_transfer_function, output.frames) = (None, None, None);
        for unwritten in [&mut output.depth, &mut output.normals] {
            *unwritten = unwritten.take().map(|_| PathBuf::new());
        }
        render.backend = match self.backend.as_str() {
            "gpu" => match Backend::Gpu.open() {
                Ok(_) => BackendName::Gpu,
                Err(error) => {
                    note!("{}; the CPU draws", words::line(&error));
                    BackendName::Cpu
                }
            },
            "cpu" => BackendName::Cpu,
            _ => render.backend,
        };
        Ok(*render)
    }

    /// Draws tiles again by a command, and compares them.
    fn compared(
        &self,
        path: &Path,
        picture: StoredPicture,
        count: Option<usize>,
        render: &mut render::Arguments,
    ) -> Result<Found> {
        // Another picture has other tiles, the same one the same.
        let bytes = std::fs::read(path);
        let bytes = bytes.map_err(|e| Error::io(path, "reading", e, "check the disk"))?;
        let [seed, ..] = *bytemuck::cast_slice::<u8, [u8; 8]>(&hash_of(&bytes)) else {
            unreachable!("a hash has 32 bytes")
        };
        let name = path.display().to_string();
        let seed = u64::from_le_bytes(seed);
        let comparison = Comparison::new(name, picture, self.frame, count, seed);
        render.ending = Ending::Compared(Box::new(comparison));
        render::run(render)?;
        let found = render.ending.comparison().and_then(Comparison::found);
        found.ok_or_else(|| damaged(path, "one that leads to no picture"))
    }

    /// Returns the number of inputs without a hash.
    fn not_hashed(&self) -> usize {
        let is_not = |given: &&Given| matches!(given.hash, Hashed::Not(_));
        self.inputs.iter().filter(is_not).count()
    }
}

/// Looks for the files that a record names.
struct Search<'a> {
    record: &'a Record,
    /// Places of each name.
    beside: Vec<PathBuf>,
    below: BTreeMap<OsString, Vec<PathBuf>>,
    hashes: Hashes,
    /// Number of files of each name that were looked for.
    asked: BTreeMap<String, usize>,
    faults: Vec<(String, Fault)>,
}

impl<'a> Search<'a> {
    fn new(arguments: &Arguments, record: &'a Record) -> Result<Self> {
        let parent = arguments.picture.parent();
        let folder = parent.filter(|folder| !folder.as_os_str().is_empty());
        let mut beside: Vec<PathBuf> = folder.map(Path::to_owned).into_iter().collect();
        beside.push(PathBuf::new());
        let mut below = BTreeMap::new();
        if let Some(data) = &arguments.data {
            index(data, &mut below)?;
        }
        Ok(Self {
            record,
            beside,
            below,
            hashes: Hashes::default(),
            asked: BTreeMap::new(),
            faults: Vec::new(),
        })
    }

    /// Returns the file that a word of the command stands for. If there is none, or another one, this is noted.
    fn find(&mut self, path: &Path, role: Role) -> Result<PathBuf> {
        let name = name_of(path);
        if role == Role::Output {
            return Ok(name.into());
        }
        let mut entries = self.record.inputs.iter().filter(|own| own.file == name);
        let asked = self.asked.entry(name.clone()).or_default();
        let entry = entries.nth(*asked);
        *asked += 1;
        let Some(entry) = entry else {
            // No file is taken that the record does not list.
            let is_file = matches!(transfer_of(&name), TransferChoice::File(_));
            if role == Role::Input || is_file {
                self.faults.push((name.clone(), Fault::Missing));
            }
            return Ok(name.into());
        };
        let mut fault = Fault::Missing;
        for candidate in self.candidates(&name) {
            match self.is_same(&candidate, &entry.hash) {
                true => return Ok(candidate),
                false => fault = Fault::Different,
            }
        }
        self.faults.push((name.clone(), fault));
        Ok(name.into())
    }

    /// Returns the existing files of a name.
    fn candidates(&self, name: &str) -> Vec<PathBuf> {
        let near = self.beside.iter().map(|folder| folder.join(name));
        let below = self.below.get(OsString::from(name).as_os_str());
        let below = below.into_iter().flatten().cloned();
        near.chain(below).filter(|path| path.exists()).collect()
    }

    fn is_same(&self, path: &Path, hash: &Hashed) -> bool {
        match hash {
            Hashed::Not(_) => true,
            hash => self.hashes.of(path) == *hash,
        }
    }

    /// Returns the files of the record that were read beside the inputs and are now missing or different.
    fn beside(&self, record: &Record) -> Vec<(String, Fault)> {
        let mut read: BTreeMap<String, Vec<Hashed>> = BTreeMap::new();
        for path in opened::files() {
            let hash = self.hashes.of(&path);
            read.entry(name_of(&path)).or_default().push(hash);
        }
        let fault = |given: &&Given| match (&given.hash, read.get(&given.file)) {
            (Hashed::Not(_), _) => None,
            // What the command names was looked at before.
            _ if self.asked.contains_key(&given.file) => None,
            (_, None) => Some((given.file.clone(), Fault::Missing)),
            (hash, Some(found)) => {
                let is_found = found.contains(hash);
                (!is_found).then(|| (given.file.clone(), Fault::Different))
            }
        };
        record
            .inputs
            .iter()
            .filter_map(|given| fault(&given))
            .collect()
    }
}

/// Lists the files below a folder by name. Links to folders are not followed: they may form circles.
fn index(folder: &Path, found: &mut BTreeMap<OsString, Vec<PathBuf>>) -> Result<()> {
    let fault = |folder: &Path, e| {
        Error::io(
            folder,
            "listing the folder",
            e,
            "check its name and its permissions",
        )
    };
    let mut folders = vec![folder.to_path_buf()];
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).map_err(|e| fault(&folder, e))?;
        for entry in entries {
            let entry = entry.map_err(|e| fault(&folder, e))?;
            count += 1;
            if count > MOST_ENTRIES {
                let expected = format!("a folder of at most {MOST_ENTRIES} files");
                let advice = "name a smaller one";
                return Err(Error::format(&folder, "--data", expected, "more", advice));
            }
            let path = entry.path();
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                folders.push(path.clone());
            }
            found.entry(entry.file_name()).or_default().push(path);
        }
    }
    for paths in found.values_mut() {
        paths.sort();
    }
    Ok(())
}

impl Fault {
    fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Different => "different",
        }
    }

    fn entry((file, fault): &(String, Self)) -> Value {
        json!({ "file": file, "fault": fault.name() })
    }
}

/// Lists faults in words.
fn list(faults: &[(String, Fault)]) -> String {
    let of = |(file, fault): &(String, Fault)| format!("{} {}", plain(file), fault.name());
    faults.iter().map(of).collect::<Vec<_>>().join(", ")
}

/// Returns a text of a record for a terminal: without control characters, and not long.
fn plain(text: &str) -> String {
    let visible = text.chars().take(200);
    visible
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

/// Adds to a report what was found, and returns the result in words.
fn describe(found: &Found, report: &mut Value) -> &'static str {
    let tile =
        |(first, size): &([usize; 2], f64)| json!({ "pixel": first, "difference": finite(*size) });
    report["tiles"] = json!(found.all);
    report["tiles_compared"] = json!(found.compared);
    report["tiles_unequal"] = json!(found.unequal);
    report["tiles_different"] = json!(found.different.len());
    report["different"] = found.different.iter().map(tile).collect();
    report["greatest_difference"] = finite(found.greatest);
    report["tolerance"] = json!(found.tolerance);
    match (found.unequal, found.different.len()) {
        (0, _) => "equal",
        (_, 0) => "within tolerance",
        _ => "different",
    }
}

/// Returns a number, or null for an infinite one.
fn finite(number: f64) -> Value {
    json!(number.is_finite().then_some(number))
}

/// Greatest number of different tiles that are listed in words.
const MOST_LISTED: usize = 10;

/// Prints a report in words.
fn print(report: &Value) {
    let row = |name: &str, value: String| super::say!("{name:<18} {value}");
    let text = |value: &Value| match value {
        Value::String(text) => plain(text),
        Value::Null => "infinite".into(),
        other => other.to_string(),
    };
    let size = |value: &Value| match value.as_f64() {
        Some(size) => format!("{size:.2e}"),
        None => text(value),
    };
    row("version", text(&report["version"]));
    let faults: Vec<String> = (report["faults"].as_array().into_iter().flatten())
        .map(|fault| format!("{} {}", text(&fault["file"]), text(&fault["fault"])))
        .collect();
    let not_hashed = match report["inputs_not_hashed"].as_u64() {
        None | Some(0) => String::new(),
        Some(count) => format!(", {count} without a hash"),
    };
    let inputs = match faults.is_empty() {
        true => format!("{} as recorded{not_hashed}", report["inputs"]),
        false => faults.join(", "),
    };
    row("inputs", inputs);
    if !report["tiles"].is_null() {
        let tiles = format!(
            "{} of {} drawn again",
            report["tiles_compared"], report["tiles"]
        );
        row("tiles", tiles);
    }
    row("result", text(&report["result"]));
    if report["tiles_unequal"]
        .as_u64()
        .is_some_and(|count| count > 0)
    {
        let of = |key: &str| size(&report[key]);
        let (greatest, tolerance) = (of("greatest_difference"), of("tolerance"));
        row(
            "difference",
            format!("{greatest} at most, tolerance {tolerance}"),
        );
    }
    let different = report["different"].as_array().into_iter().flatten();
    for tile in different.take(MOST_LISTED) {
        let at = format!("{},{}", tile["pixel"][0], tile["pixel"][1]);
        row(
            "different at",
            format!("{at}: {}", size(&tile["difference"])),
        );
    }
    let count = report["tiles_different"].as_u64().unwrap_or(0);
    if count > MOST_LISTED as u64 {
        row("different", format!("{count} tiles in all"));
    }
}
