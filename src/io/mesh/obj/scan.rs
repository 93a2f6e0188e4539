//! Scans the text of an OBJ file in one pass.
//!
//! Real files have vertex colours on some vertices only, corners with and without texture coordinates in one
//! object, faces of one or two corners (points and lines), undefined materials and indices out of range. All of
//! that is resolved or noted here, while line numbers are known. The result is faces in groups, with indices
//! that are in range.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// Faces that share a material and the kinds of their corners' indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Group {
    /// Index into [`Scan::materials`], or none before the first `usemtl`.
    pub(super) material: Option<usize>,
    pub(super) has_coordinates: bool,
    pub(super) has_normals: bool,
}

/// The faces of a group.
#[derive(Debug, Default)]
pub(super) struct Faces {
    /// Indices of a vertex, texture coordinates and a normal, from 0. The index of a kind that its group lacks
    /// has no meaning.
    pub(super) corners: Vec<[u32; 3]>,
    /// End of each face's corners; a face has three or more.
    pub(super) ends: Vec<usize>,
    /// Corners of lines and of points.
    pub(super) lines: Vec<[[u32; 3]; 2]>,
    pub(super) points: Vec<[u32; 3]>,
}

/// The content of an OBJ file.
#[derive(Debug, Default)]
pub(super) struct Scan {
    pub(super) positions: Vec<DVec3>,
    /// Colours of vertices, sRGB-encoded; `None` for a vertex without. Empty if no vertex has one.
    pub(super) colours: Vec<Option<[f64; 3]>>,
    /// Texture coordinates, v upwards.
    pub(super) coordinates: Vec<[f64; 2]>,
    pub(super) normals: Vec<DVec3>,
    pub(super) groups: Vec<Group>,
    /// Faces of each group.
    pub(super) faces: Vec<Faces>,
    /// Names after `usemtl`.
    pub(super) materials: Vec<String>,
    /// Text after each `mtllib`.
    pub(super) libraries: Vec<String>,
    /// Notes on what was left out, for people.
    pub(super) notes: Vec<String>,
}

/// Whether a file's first bytes are OBJ text: every line begins with a keyword of the format, and one is a
/// vertex, a face or the name of a library.
pub(crate) fn looks_like(head: &[u8]) -> bool {
    const WORDS: &[&str] = &[
        "v", "vt", "vn", "vp", "f", "l", "p", "o", "g", "s", "mg", "mtllib", "usemtl",
    ];
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}');
    // The last line may be cut off.
    let end = text.rfind('\n').map_or(text.len(), |i| i + 1);
    let mut is_obj = false;
    for line in text[..end].lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            None => {}
            Some(word) if word.starts_with('#') => {}
            Some(word @ ("v" | "f")) => {
                let is_number = |w: &str| word == "f" || w.parse::<f64>().is_ok();
                if words.clone().count() < 3 || !words.take(3).all(is_number) {
                    return false;
                }
                is_obj = true;
            }
            Some("mtllib") => is_obj = true,
            Some(word) if WORDS.contains(&word) => {}
            Some(_) => return false,
        }
    }
    is_obj
}

/// The kinds of a corner's indices.
const KINDS: [(&str, &str); 3] = [
    ("v", "vertices"),
    ("vt", "texture coordinates"),
    ("vn", "normals"),
];

/// An index, from 1, of texture coordinates and normals that cannot exist.
const NOWHERE: usize = usize::MAX;

/// Reads all lines.
///
/// # Errors
/// A vertex without three numbers, or a face with a vertex that does not exist, each with its line. Faces whose
/// texture coordinates or normals do not exist have none, with a note.
pub(super) fn scan(path: &Path, bytes: &[u8]) -> Result<Scan> {
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader::new(path);
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .split('\n')
        .zip(1_usize..);
    let mut joined = String::new();
    while let Some((line, number)) = lines.next() {
        let mut line = line.trim_end_matches('\r');
        if line.ends_with('\\') {
            joined.clear();
            let mut part = line;
            while let Some(start) = part.strip_suffix('\\') {
                joined.push_str(start);
                joined.push(' ');
                let Some((next, _)) = lines.next() else {
                    part = "";
                    break;
                };
                part = next.trim_end_matches('\r');
            }
            joined.push_str(part);
            line = &joined;
        }
        reader.line(line, number)?;
    }
    reader.finish()
}

/// The state of a scan.
struct Reader<'p> {
    path: &'p Path,
    scan: Scan,
    coloured: usize,
    material: Option<usize>,
    material_index: HashMap<String, usize>,
    groups: HashMap<Group, usize>,
    /// The greatest index of a vertex that is used before its definition, and the line of that use.
    ahead: (usize, usize),
    /// Number of elements that are left out.
    curves: usize,
    mixed: usize,
    corners: Vec<[usize; 3]>,
}

impl<'p> Reader<'p> {
    fn new(path: &'p Path) -> Self {
        Self {
            path,
            scan: Scan::default(),
            coloured: 0,
            material: None,
            material_index: HashMap::new(),
            groups: HashMap::new(),
            ahead: (0, 0),
            curves: 0,
            mixed: 0,
            corners: Vec::new(),
        }
    }

    fn line(&mut self, line: &str, number: usize) -> Result<()> {
        let line = line.trim();
        let keyword = line.split_whitespace().next().unwrap_or("");
        let rest = line[keyword.len()..].trim();
        let words = || {
            // A number may contain a `#` (`1.#QNAN`); a comment begins a word with it.
            rest.split_whitespace().take_while(|w| !w.starts_with('#'))
        };
        match keyword {
            "v" => {
                let count = words().count();
                if !matches!(count, 3 | 4 | 6 | 7) {
                    return Err(self.refuse(number, "v with 3, 4, 6 or 7 numbers", rest));
                }
                let position = self.numbers(words(), number)?;
                if count > 4 {
                    // A fourth number is a weight of curves; a seventh is an opacity.
                    let colour = self.numbers(words().skip(3), number)?;
                    self.scan.colours.resize(self.scan.positions.len(), None);
                    self.scan.colours.push(Some(colour));
                    self.coloured += 1;
                }
                self.scan.positions.push(position.into());
            }
            "vt" => {
                if words().next().is_none() {
                    return Err(self.refuse(number, "vt with one to three numbers", rest));
                }
                let both = words().take(2).chain(["0"]);
                let coordinates = self.numbers(both, number)?;
                self.scan.coordinates.push(coordinates);
            }
            "vn" => {
                if words().count() < 3 {
                    return Err(self.refuse(number, "vn with three numbers", rest));
                }
                let normal = self.numbers(words(), number)?;
                self.scan.normals.push(normal.into());
            }
            "f" | "fo" => self.face(words(), number)?,
            "l" => self.marks(words(), number, true)?,
            "p" => self.marks(words(), number, false)?,
            "curv" | "curv2" | "surf" => self.curves += 1,
            "usemtl" => {
                self.material = (!rest.is_empty()).then(|| {
                    let next = self.scan.materials.len();
                    *self
                        .material_index
                        .entry(rest.to_owned())
                        .or_insert_with(|| {
                            self.scan.materials.push(rest.to_owned());
                            next
                        })
                });
            }
            "mtllib" if !rest.is_empty() => self.scan.libraries.push(rest.to_owned()),
            // Names, smoothing groups, display attributes and comments do not describe the shape.
            _ => {}
        }
        Ok(())
    }

    fn refuse(&self, number: usize, expected: &str, found: &str) -> Error {
        Error::format(
            self.path,
            format!("line {number}"),
            expected,
            format!("`{}`", clip(found)),
            "correct the line, or save the mesh again",
        )
    }

    /// The first numbers of a line; text that C libraries print for non-numbers is NaN.
    fn numbers<'w, const N: usize>(
        &self,
        mut words: impl Iterator<Item = &'w str>,
        number: usize,
    ) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for x in &mut numbers {
            let word = words.next().unwrap_or("");
            *x = match word.parse() {
                Ok(x) => x,
                Err(_) => {
                    let lower = word.to_ascii_lowercase();
                    // `-nan(ind)`, `1.#QNAN`, `-1.#INF`.
                    if !["nan", ".#", "inf"].iter().any(|w| lower.contains(w)) {
                        return Err(self.refuse(number, "a number", word));
                    }
                    f64::NAN
                }
            };
        }
        Ok(numbers)
    }

    /// Numbers of vertices, texture coordinates and normals so far.
    fn counts(&self) -> [usize; 3] {
        let scan = &self.scan;
        [
            scan.positions.len(),
            scan.coordinates.len(),
            scan.normals.len(),
        ]
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w str>, number: usize) -> Result<()> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for word in words {
            corners.push(self.corner(word, number)?);
        }
        match corners.len() {
            0 => return Err(self.refuse(number, "three corners or more after f", "")),
            1 | 2 => self.add_marks(&corners, corners.len() == 2),
            _ => {
                let has = |kind: usize| corners.iter().all(|c| c[kind] > 0);
                let some = |kind: usize| corners.iter().any(|c| c[kind] > 0);
                let group = Group {
                    material: self.material,
                    has_coordinates: has(1),
                    has_normals: has(2),
                };
                self.mixed += usize::from(some(1) && !has(1));
                let index = self.faces_of(group);
                let faces = &mut self.scan.faces[index];
                let used = [true, group.has_coordinates, group.has_normals];
                faces.corners.extend(corners.iter().map(|corner| {
                    [0, 1, 2].map(|kind| {
                        // Indices beyond 32 bits are refused at the end.
                        let index = u32::try_from(corner[kind]).unwrap_or(u32::MAX);
                        if used[kind] { index - 1 } else { 0 }
                    })
                }));
                faces.ends.push(faces.corners.len());
            }
        }
        self.corners = corners;
        Ok(())
    }

    /// Adds points, or lines from each to the next.
    fn marks<'w>(
        &mut self,
        words: impl Iterator<Item = &'w str>,
        number: usize,
        are_lines: bool,
    ) -> Result<()> {
        let corners: Result<Vec<_>> = words.map(|word| self.corner(word, number)).collect();
        self.add_marks(&corners?, are_lines);
        Ok(())
    }

    /// Adds lines and points, of which only the vertices are used.
    fn add_marks(&mut self, corners: &[[usize; 3]], are_lines: bool) {
        let index = self.faces_of(Group {
            material: self.material,
            has_coordinates: false,
            has_normals: false,
        });
        let faces = &mut self.scan.faces[index];
        let corner = |corner: &[usize; 3]| [u32::try_from(corner[0]).unwrap_or(u32::MAX) - 1, 0, 0];
        if are_lines {
            let pairs = corners.windows(2);
            faces
                .lines
                .extend(pairs.map(|pair| [corner(&pair[0]), corner(&pair[1])]));
        } else {
            faces.points.extend(corners.iter().map(corner));
        }
    }

    /// The indices of a corner, from 1; 0 for kinds that it lacks.
    fn corner(&mut self, word: &str, number: usize) -> Result<[usize; 3]> {
        let mut indices = [0; 3];
        let mut names = word.split('/');
        for (kind, index) in indices.iter_mut().enumerate() {
            let name = names.next().unwrap_or("");
            if name.is_empty() && kind > 0 {
                continue;
            }
            let count = self.counts()[kind];
            let [keyword, plural] = [KINDS[kind].0, KINDS[kind].1];
            let Ok(given) = name.parse::<i64>() else {
                return Err(self.refuse(number, "a corner as v, v/vt, v//vn or v/vt/vn", word));
            };
            let absolute = match usize::try_from(given.unsigned_abs()) {
                Ok(back) if given < 0 => (count + 1).checked_sub(back).filter(|i| *i > 0),
                Ok(index) => Some(index).filter(|i| *i > 0),
                Err(_) => None,
            };
            if kind > 0 {
                *index = absolute.unwrap_or(NOWHERE);
                continue;
            }
            *index = absolute.ok_or_else(|| {
                Error::format(
                    self.path,
                    format!("line {number}"),
                    format!("an index of one of the {count} {plural} above (`{keyword}`)"),
                    given.to_string(),
                    "the file is damaged: save it again",
                )
            })?;
            if *index > count.min(u32::MAX as usize) && *index > self.ahead.0 {
                self.ahead = (*index, number);
            }
        }
        if names.next().is_some() {
            return Err(self.refuse(number, "a corner as v, v/vt, v//vn or v/vt/vn", word));
        }
        Ok(indices)
    }

    /// Moves faces whose texture coordinates or normals do not exist to a group without them.
    fn leave_out(&mut self, kind: usize, count: usize) {
        let mut left_out = 0;
        for index in 0..self.scan.groups.len() {
            let group = self.scan.groups[index];
            let has = [true, group.has_coordinates, group.has_normals][kind];
            let is_known = |corner: &[u32; 3]| (corner[kind] as usize) < count;
            if !has || self.scan.faces[index].corners.iter().all(is_known) {
                continue;
            }
            let all = std::mem::take(&mut self.scan.faces[index]);
            let others = Group {
                has_coordinates: group.has_coordinates && kind != 1,
                has_normals: group.has_normals && kind != 2,
                ..group
            };
            let others = self.faces_of(others);
            let mut start = 0;
            for end in all.ends {
                let corners = &all.corners[start..end];
                start = end;
                let is_whole = corners.iter().all(is_known);
                left_out += usize::from(!is_whole);
                let faces = &mut self.scan.faces[if is_whole { index } else { others }];
                let named = |corner: &[u32; 3]| {
                    let mut corner = *corner;
                    corner[kind] *= u32::from(is_whole);
                    corner
                };
                faces.corners.extend(corners.iter().map(named));
                faces.ends.push(faces.corners.len());
            }
        }
        if left_out > 0 {
            let plural = KINDS[kind].1;
            self.scan.notes.push(format!(
                "{left_out} faces name {plural} that are not in the file: they have none"
            ));
        }
    }

    /// The index of a group's faces.
    fn faces_of(&mut self, group: Group) -> usize {
        *self.groups.entry(group).or_insert_with(|| {
            self.scan.groups.push(group);
            self.scan.faces.push(Faces::default());
            self.scan.faces.len() - 1
        })
    }

    fn finish(mut self) -> Result<Scan> {
        let counts = self.counts();
        let [keyword, plural] = [KINDS[0].0, KINDS[0].1];
        let (index, number) = self.ahead;
        // Vertices beyond the range of 32 bits cannot be used.
        let most = counts[0].min(u32::MAX as usize);
        if index > most {
            return Err(Error::format(
                self.path,
                format!("line {number}"),
                format!("an index of one of the file's {most} {plural} (`{keyword}`)"),
                index.to_string(),
                "the file is damaged or cut off: save it again",
            ));
        }
        for kind in [1, 2] {
            self.leave_out(kind, counts[kind]);
        }
        if self.curves > 0 {
            let note = format!(
                "{} free-form curves and surfaces are not shown",
                self.curves
            );
            self.scan.notes.push(note);
        }
        if self.mixed > 0 {
            self.scan.notes.push(format!(
                "{} faces have texture coordinates at some corners only: they are not used",
                self.mixed
            ));
        }
        if self.coloured > 0 && self.coloured < counts[0] {
            self.scan.colours.resize(counts[0], None);
            self.scan.notes.push(format!(
                "{} of {} vertices have no colour: they are white",
                counts[0] - self.coloured,
                counts[0]
            ));
        }
        Ok(self.scan)
    }
}
