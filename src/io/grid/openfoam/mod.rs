//! Reads cases of OpenFOAM: a folder, or a ZIP archive of one.
//!
//! | file | content |
//! |---|---|
//! | `system/controlDict` | marks the folder as a case; it is opened for the folder, or for an empty `NAME.foam` or `NAME.OpenFOAM` in it |
//! | `constant/polyMesh/points` | nodes |
//! | `.../faces` | polygons by their nodes; in class `faceCompactList` the start of each, then the nodes of all |
//! | `.../owner`, `.../neighbour` | for each face the cell out of which its normal points, and the cell into which it points; faces of the boundary, which come last, have no neighbour |
//! | `TIME/NAME` | a field; classes `vol...Field` at the cells, `point...Field` at the nodes |
//! | `TIME/polyMesh/...` | the mesh, or its nodes, from this time on |
//! | `processorN/...` | a partition of the case with a mesh and times of its own |
//! | `constant/REGION/polyMesh/...`, `TIME/REGION/...` | one of several regions |
//!
//! Any of them may be compressed as `NAME.gz`. Each begins with a header (OpenFOAM's guide, "Basic input/output
//! format"):
//!
//! ```text
//! FoamFile
//! {
//!     format  binary;                         or ascii
//!     class   volVectorField;
//!     arch    "LSB;label=32;scalar=64";       of binary numbers, as it is where none is stated; or MSB
//!     object  U;
//! }
//! dimensions [0 1 -1 0 0 0 0];
//! internalField nonuniform List<vector> 2((0 0 1)(0 0 2));    or: uniform (0 0 1)
//! ```
//!
//! Lists are a count and the values in brackets, in binary files as bytes; `N{v}` is one value N times. The
//! partitions of a decomposed case are put one after another; the undivided case is read instead if it has as
//! many times. Patches of the boundary, values at faces and particles are left out.

mod case;
mod fields;
mod mesh;
mod text;

use std::path::{Path, PathBuf};

use self::case::Case;
use self::fields::{Found, Gathered};
use self::mesh::{MeshFiles, PolyMesh};
use crate::data::cells::CellMesh;
use crate::data::dataset::{Dataset, Geometry};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::bytes::file::extension;
use crate::io::bytes::zip::{self, Entry};
use crate::io::particles::table::list;
use crate::io::time_steps::{TimeStep, chosen, of_file};

const FORMAT: &str = "OpenFOAM case";

/// Extensions of the empty files that mark a case.
const MARKERS: [&str; 2] = ["foam", "openfoam"];

/// Number of bytes that the values of all fields may take, and that number per byte of the case's files. Fields
/// of one value take few bytes in a file, and many in memory.
const LEAST_BUDGET: usize = 16 << 20;
const BUDGET_PER_BYTE: usize = 4;

/// Whether a file that begins with `head` belongs to a case.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    let at = head.windows(8).position(|word| word == b"FoamFile");
    let Some(before) = at.map(|at| &head[..at]) else {
        return false;
    };
    let start = before.trim_ascii_start();
    start.is_empty() || start.starts_with(b"/*") || start.starts_with(b"//")
}

/// Whether an archive contains a case.
pub(in crate::io) fn is_archive(entries: &[Entry<'_>]) -> bool {
    case::roots(entries).next().is_some()
}

/// The control file of the case in a folder, or in the folder of a marker file.
pub(in crate::io) fn case_in(path: &Path) -> Option<PathBuf> {
    let ending = extension(path);
    let folder = match path.is_dir() {
        true => path,
        false if MARKERS.contains(&ending.as_str()) => path.parent()?,
        false => return None,
    };
    let control = folder.join(case::CONTROL);
    control.is_file().then_some(control)
}

/// The time steps of a case: one for each folder of a time.
///
/// # Errors
/// A broken archive, or a file of a case other than its control file.
pub(in crate::io) fn steps(input: Input<'_>) -> Result<Vec<TimeStep>> {
    let bytes = archive(input)?;
    let (case, _) = case_of(input, bytes.as_deref())?;
    let times = Layout::of(&case).times();
    Ok(of_file(input.path, &times))
}

/// Reads one time step of a case.
///
/// # Errors
/// As [`steps`]; a step that does not exist; a missing or damaged mesh; damaged fields.
pub(in crate::io) fn read(input: Input<'_>, time_step: Option<usize>) -> Result<Dataset> {
    let bytes = archive(input)?;
    let (case, others) = case_of(input, bytes.as_deref())?;
    let layout = Layout::of(&case);
    let times = layout.times();
    let (step, note) = match times.is_empty() {
        true => (0, None),
        false => chosen(input.path, &times, time_step)?,
    };
    let mut reading = Reading {
        layout: &layout,
        step,
        mesh: CellMesh {
            offsets: vec![0],
            ..CellMesh::default()
        },
        fields: Vec::new(),
        notes: note.into_iter().collect(),
        bytes: 0,
    };
    if !others.is_empty() {
        let shown = list(others.iter().map(|root| root.trim_end_matches('/')));
        let note = format!("The first case of the archive; the others are in {shown}.");
        reading.notes.push(note);
    }
    reading.run()?;
    let Reading {
        mesh,
        fields,
        notes,
        ..
    } = reading;
    mesh.check(input.path)?;
    let fields = fields.into_iter().flat_map(Gathered::fields).collect();
    Ok(Dataset {
        notes,
        ..Dataset::new(input.path, FORMAT, Geometry::Cells(mesh), fields)
    })
}

/// The bytes of an archive; `None` for other files.
fn archive(input: Input<'_>) -> Result<Option<std::borrow::Cow<'_, [u8]>>> {
    let (head, _) = input.head(zip::MAGIC.len())?;
    match head == zip::MAGIC {
        true => input.read_all().map(Some),
        false => Ok(None),
    }
}

/// The case of a file, and the folders of other cases in the same archive.
fn case_of<'a>(input: Input<'a>, archive: Option<&'a [u8]>) -> Result<(Case<'a>, Vec<String>)> {
    let path = input.path;
    if let Some(bytes) = archive {
        return Case::of_archive(path, bytes);
    }
    let refuse = |expected: &str, found: &str, advice: &str| {
        Err(Error::format(path, FORMAT, expected, found, advice))
    };
    if !input.is_on_disk() {
        let advice = "give a ZIP archive of the case's folder";
        return refuse("files that can be listed", "bytes in memory", advice);
    }
    if !path.ends_with(case::CONTROL) && path != Path::new("controlDict") {
        let advice = "give the case's folder";
        return refuse(case::CONTROL, "another file of a case", advice);
    }
    let system = path.parent().unwrap_or(Path::new(""));
    let root = match system.parent() {
        None => PathBuf::from(".."),
        Some(folder) if folder.as_os_str().is_empty() => PathBuf::from("."),
        Some(folder) => folder.to_path_buf(),
    };
    Ok((Case::Folder(root), Vec::new()))
}

/// The location of the mesh and the fields in a case.
struct Layout<'c> {
    case: &'c Case<'c>,
    /// Prefixes of their names: empty, or the folders of the partitions.
    pieces: Vec<String>,
    /// Times and the names of their folders.
    times: Vec<(f64, String)>,
    /// The folder of the region, with a `/`, or empty.
    region: String,
    other_regions: Vec<String>,
}

/// The folders of times, sorted by time.
fn times_in(case: &Case<'_>, folder: &str) -> Vec<(f64, String)> {
    let names = case.list(folder).into_iter();
    let mut times: Vec<(f64, String)> = names
        .filter(|name| name.starts_with(|c: char| c.is_ascii_digit() || c == '-'))
        .filter_map(|name| {
            let time: f64 = name.parse().ok()?;
            time.is_finite().then_some((time, name))
        })
        .collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    times
}

impl<'c> Layout<'c> {
    fn of(case: &'c Case<'c>) -> Self {
        let of_processor = |name: String| {
            let number: u32 = name.strip_prefix("processor")?.parse().ok()?;
            Some((number, format!("{name}/")))
        };
        let mut pieces: Vec<(u32, String)> =
            case.list("").into_iter().filter_map(of_processor).collect();
        pieces.sort();
        let mut layout = Self {
            case,
            pieces: vec![String::new()],
            times: times_in(case, ""),
            region: String::new(),
            other_regions: Vec::new(),
        };
        if let Some((_, first)) = pieces.first() {
            let times = times_in(case, first.trim_end_matches('/'));
            let last = layout.times.len().saturating_sub(1);
            let is_whole = layout.found("", last, "faces").is_some();
            if !is_whole || times.len() > layout.times.len() {
                layout.times = times;
                layout.pieces = pieces.into_iter().map(|(_, piece)| piece).collect();
            }
        }
        let first = layout.pieces[0].clone();
        let last = layout.times.len().saturating_sub(1);
        if layout.found(&first, last, "faces").is_none() {
            let constant = format!("{first}constant");
            let has_mesh = |name: &String| case.has(&format!("{constant}/{name}/polyMesh/faces"));
            let mut regions = case.list(&constant).into_iter().filter(has_mesh);
            if let Some(region) = regions.next() {
                layout.region = format!("{region}/");
                layout.other_regions = regions.collect();
            }
        }
        layout
    }

    fn times(&self) -> Vec<f64> {
        self.times.iter().map(|(time, _)| *time).collect()
    }

    /// The name of a file of the mesh at a time: the last one written up to then.
    fn found(&self, piece: &str, step: usize, name: &str) -> Option<String> {
        let until = self.times.iter().take(step + 1).rev();
        let folders = until.map(|(_, folder)| folder.as_str());
        let region = &self.region;
        folders
            .chain(["constant"])
            .map(|folder| format!("{piece}{folder}/{region}polyMesh/{name}"))
            .find(|name| self.case.has(name))
    }
}

/// The state of reading a case.
struct Reading<'c> {
    layout: &'c Layout<'c>,
    step: usize,
    mesh: CellMesh,
    fields: Vec<Gathered>,
    notes: Vec<String>,
    /// Size in bytes of the files read so far.
    bytes: usize,
}

impl Reading<'_> {
    fn run(&mut self) -> Result<()> {
        let layout = self.layout;
        if let Some(region) = layout.region.strip_suffix('/') {
            let others = layout.other_regions.iter().map(String::as_str);
            let note = match layout.other_regions.is_empty() {
                true => format!("The region `{region}`."),
                false => format!("The region `{region}`; left out: {}.", list(others)),
            };
            self.notes.push(note);
        }
        if layout.pieces.len() > 1 {
            let count = layout.pieces.len();
            self.notes
                .push(format!("Put together from {count} processors' pieces."));
        }
        for (i, piece) in layout.pieces.iter().enumerate() {
            let counts = self.read_mesh(piece)?;
            if let Some((_, time)) = layout.times.get(self.step) {
                let folder = format!("{piece}{time}/{}", layout.region);
                self.read_fields(folder.trim_end_matches('/'), counts, i == 0)?;
            }
        }
        Ok(())
    }

    /// Appends the mesh of a partition, and returns its numbers of cells and nodes.
    fn read_mesh(&mut self, piece: &str) -> Result<[usize; 2]> {
        let layout = self.layout;
        let mut file = |name: &str| {
            let found = layout.found(piece, self.step, name);
            let found = found.map(|found| layout.case.read(&found)).transpose()?;
            let file = found.flatten().ok_or_else(|| {
                let folder = format!("{piece}constant/{}polyMesh", layout.region);
                Error::format(
                    layout.case.path_of(&folder),
                    "mesh",
                    "points, faces, owner and neighbour",
                    format!("no `{name}`"),
                    "make the mesh (blockMesh, ...), or unpack collated files (decomposePar)",
                )
            })?;
            self.bytes += file.bytes.len();
            Ok(file)
        };
        let files = MeshFiles {
            points: file("points")?,
            faces: file("faces")?,
            owner: file("owner")?,
            neighbour: file("neighbour")?,
        };
        let mesh = PolyMesh::read(&files)?;
        let counts = [mesh.cell_count, mesh.point_count()];
        mesh.append_to(&mut self.mesh).map_err(|mesh::TooMany| {
            Error::format(
                &files.faces.path,
                "mesh",
                format!("at most {} entries of cells", u32::MAX),
                "more",
                "give the pieces of a decomposed case one by one",
            )
        })?;
        Ok(counts)
    }

    /// Appends the fields of a partition at the time.
    ///
    /// - `counts`: numbers of cells and nodes of the partition.
    fn read_fields(&mut self, folder: &str, counts: [usize; 2], is_first: bool) -> Result<()> {
        let case = self.layout.case;
        let (mut others, mut computed, mut large) = (Vec::new(), Vec::new(), Vec::new());
        let mut found = Vec::new();
        let mut size: usize = self.fields.iter().map(Gathered::size).sum();
        let names = case.list(folder);
        for name in &names {
            let Some(file) = case.read(&format!("{folder}/{name}"))? else {
                continue;
            };
            self.bytes += file.bytes.len();
            match fields::read(&file, counts)? {
                Found::Field(field) => {
                    size += field.size();
                    if size > LEAST_BUDGET + BUDGET_PER_BYTE * self.bytes {
                        size -= field.size();
                        large.push(name.as_str());
                    } else {
                        found.push(field);
                    }
                }
                Found::Other(class) => others.push(format!("{name} ({class})")),
                Found::Computed => computed.push(name.as_str()),
            }
        }
        let had: Vec<String> = self.fields.iter().map(|f| f.name.clone()).collect();
        if is_first {
            self.fields = found;
        } else {
            self.fields.retain_mut(|field| {
                let at = found.iter().position(|other| other.name == field.name);
                at.is_some_and(|at| field.append(found.swap_remove(at)))
            });
        }
        let is_kept = |name: &&String| self.fields.iter().any(|f| f.name == **name);
        let lost = had.iter().filter(|name| !is_kept(name)).map(String::as_str);
        let lost: Vec<&str> = lost.collect();
        for (names, why) in [
            (lost, format!("not all pieces have them: {folder}")),
            (
                computed,
                "their values are computed when the case is run".to_owned(),
            ),
            (
                large,
                "they take more memory than the case's size allows".to_owned(),
            ),
        ] {
            if !names.is_empty() {
                let shown = list(names.into_iter());
                self.notes
                    .push(format!("Left out, because {why}: {shown}."));
            }
        }
        if !is_first {
            return Ok(());
        }
        if !others.is_empty() {
            let shown = list(others.iter().map(String::as_str));
            let note = format!("Left out, because they hold no values of cells or nodes: {shown}.");
            self.notes.push(note);
        }
        if names.iter().any(|name| name == "lagrangian") {
            self.notes
                .push("Lagrangian particles are left out.".to_owned());
        }
        Ok(())
    }
}
