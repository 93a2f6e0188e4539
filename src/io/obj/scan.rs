//! The text of an OBJ file, made plain before it is parsed.
//!
//! tobj reads numbers, corners and polygons well, and stumbles over what real files hold: a
//! vertex colour here and none there, corners with and without texture coordinates in one
//! object, lines taken for faces, tabs after keywords, materials that are not defined, indices
//! out of range without a line number. This pass settles all of that with line numbers at hand.
//! What it hands on holds `v`, `vt`, `vn`, then one object per kind of face, with absolute
//! indices that are in range.

use std::collections::HashMap;
use std::path::Path;

use crate::error::{Error, Result};
use crate::io::vtk_xml::clip;

/// The colour of a vertex that has none, where others have one: negative, so that it is known
/// whatever the scale of the others.
const NO_COLOUR: &str = " -1 -1 -1";

/// Faces that share a material and what their corners name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Group {
    /// Index into [`Scan::materials`], or none before the first `usemtl`.
    pub(super) material: Option<usize>,
    pub(super) has_coordinates: bool,
    pub(super) has_normals: bool,
}

/// An OBJ file in plain words.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// Vertices, coordinates, normals, then for each group `o` with its index and its faces.
    pub(super) text: String,
    pub(super) groups: Vec<Group>,
    /// Names after `usemtl`.
    pub(super) materials: Vec<String>,
    /// What stands after each `mtllib`.
    pub(super) libraries: Vec<String>,
    pub(super) has_colours: bool,
    pub(super) vertex_count: usize,
    /// What was left out, for people.
    pub(super) notes: Vec<String>,
}

/// Whether a file's first bytes are OBJ text: every line of them begins with a word that the
/// format knows, and one is a vertex, a face or the name of a library.
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

/// The kinds of things that corners name.
const KINDS: [(&str, &str); 3] = [
    ("v", "vertices"),
    ("vt", "texture coordinates"),
    ("vn", "normals"),
];

/// Reads all lines.
///
/// # Errors
/// A vertex without three numbers, or a face that names what is not there: with its line.
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
    /// Numbers of vertices, coordinates and normals so far.
    counts: [usize; 3],
    texts: [String; 3],
    coloured: usize,
    material: Option<usize>,
    material_index: HashMap<String, usize>,
    groups: HashMap<Group, usize>,
    faces: Vec<String>,
    /// The greatest index of each kind that came before what it names, and its line.
    ahead: [(usize, usize); 3],
    /// Elements that are left out.
    points: usize,
    lines: usize,
    curves: usize,
    mixed: usize,
    corners: Vec<[usize; 3]>,
}

impl<'p> Reader<'p> {
    fn new(path: &'p Path) -> Self {
        Self {
            path,
            scan: Scan::default(),
            counts: [0; 3],
            texts: Default::default(),
            coloured: 0,
            material: None,
            material_index: HashMap::new(),
            groups: HashMap::new(),
            faces: Vec::new(),
            ahead: [(0, 0); 3],
            points: 0,
            lines: 0,
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
            // A number may hold a `#` (`1.#QNAN`); a comment begins a word with it.
            rest.split_whitespace().take_while(|w| !w.starts_with('#'))
        };
        match keyword {
            "v" => {
                let count = words().count();
                if !matches!(count, 3 | 4 | 6 | 7) {
                    return Err(self.refuse(number, "v with 3, 4, 6 or 7 numbers", rest));
                }
                self.texts[0].push('v');
                self.numbers(0, words().take(3), number)?;
                if count > 4 {
                    // A fourth number is a weight of curves; a seventh is an opacity.
                    self.numbers(0, words().skip(3).take(3), number)?;
                    self.coloured += 1;
                }
                self.texts[0].push('\n');
                self.counts[0] += 1;
            }
            "vt" => {
                if words().next().is_none() {
                    return Err(self.refuse(number, "vt with one to three numbers", rest));
                }
                self.texts[1].push_str("vt");
                let both = words().take(2).chain(["0"]).take(2);
                self.numbers(1, both, number)?;
                self.texts[1].push('\n');
                self.counts[1] += 1;
            }
            "vn" => {
                if words().count() < 3 {
                    return Err(self.refuse(number, "vn with three numbers", rest));
                }
                self.texts[2].push_str("vn");
                self.numbers(2, words().take(3), number)?;
                self.texts[2].push('\n');
                self.counts[2] += 1;
            }
            "f" | "fo" => self.face(words(), number)?,
            "l" => self.lines += 1,
            "p" => self.points += 1,
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
            // Names, smoothing groups, display attributes and comments say nothing of the shape.
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

    /// Appends numbers to a text.
    fn numbers<'w>(
        &mut self,
        kind: usize,
        words: impl Iterator<Item = &'w str>,
        number: usize,
    ) -> Result<()> {
        for word in words {
            let plain = if word.parse::<f64>().is_ok() {
                word
            } else {
                let lower = word.to_ascii_lowercase();
                // What C libraries print: `-nan(ind)`, `1.#QNAN`, `-1.#INF`.
                if !["nan", ".#", "inf"].iter().any(|w| lower.contains(w)) {
                    return Err(self.refuse(number, "a number", word));
                }
                "nan"
            };
            self.texts[kind].push(' ');
            self.texts[kind].push_str(plain);
        }
        Ok(())
    }

    fn face<'w>(&mut self, words: impl Iterator<Item = &'w str>, number: usize) -> Result<()> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.clear();
        for word in words {
            corners.push(self.corner(word, number)?);
        }
        match corners.len() {
            0 => return Err(self.refuse(number, "three corners or more after f", "")),
            1 => self.points += 1,
            2 => self.lines += 1,
            _ => {
                let has = |kind: usize| corners.iter().all(|c| c[kind] > 0);
                let some = |kind: usize| corners.iter().any(|c| c[kind] > 0);
                let group = Group {
                    material: self.material,
                    has_coordinates: has(1),
                    has_normals: has(2),
                };
                self.mixed += usize::from(some(1) && !has(1));
                let index = *self.groups.entry(group).or_insert_with(|| {
                    self.scan.groups.push(group);
                    self.faces.push(String::new());
                    self.faces.len() - 1
                });
                let text = &mut self.faces[index];
                text.push('f');
                for [v, vt, vn] in &corners {
                    use std::fmt::Write;
                    // Writing to a string cannot fail.
                    let _ = match (group.has_coordinates, group.has_normals) {
                        (false, false) => write!(text, " {v}"),
                        (true, false) => write!(text, " {v}/{vt}"),
                        (false, true) => write!(text, " {v}//{vn}"),
                        (true, true) => write!(text, " {v}/{vt}/{vn}"),
                    };
                }
                text.push('\n');
            }
        }
        self.corners = corners;
        Ok(())
    }

    /// The indices that a corner names, from 1; 0 where it names none.
    fn corner(&mut self, word: &str, number: usize) -> Result<[usize; 3]> {
        let mut indices = [0; 3];
        let mut names = word.split('/');
        for (kind, index) in indices.iter_mut().enumerate() {
            let name = names.next().unwrap_or("");
            if name.is_empty() && kind > 0 {
                continue;
            }
            let count = self.counts[kind];
            let [keyword, plural] = [KINDS[kind].0, KINDS[kind].1];
            let Ok(given) = name.parse::<i64>() else {
                return Err(self.refuse(number, "a corner as v, v/vt, v//vn or v/vt/vn", word));
            };
            let absolute = match usize::try_from(given.unsigned_abs()) {
                Ok(back) if given < 0 => (count + 1).checked_sub(back).filter(|i| *i > 0),
                Ok(index) => Some(index).filter(|i| *i > 0),
                Err(_) => None,
            };
            *index = absolute.ok_or_else(|| {
                Error::format(
                    self.path,
                    format!("line {number}"),
                    format!("an index of one of the {count} {plural} above (`{keyword}`)"),
                    given.to_string(),
                    "the file is damaged: save it again",
                )
            })?;
            if *index > count && *index > self.ahead[kind].0 {
                self.ahead[kind] = (*index, number);
            }
        }
        if names.next().is_some() {
            return Err(self.refuse(number, "a corner as v, v/vt, v//vn or v/vt/vn", word));
        }
        Ok(indices)
    }

    fn finish(mut self) -> Result<Scan> {
        for (kind, (keyword, plural)) in KINDS.into_iter().enumerate() {
            let (index, number) = self.ahead[kind];
            if index > self.counts[kind] {
                return Err(Error::format(
                    self.path,
                    format!("line {number}"),
                    format!(
                        "an index of one of the file's {} {plural} (`{keyword}`)",
                        self.counts[kind]
                    ),
                    index.to_string(),
                    "the file is damaged or cut off: save it again",
                ));
            }
        }
        for (count, what) in [
            (self.points, "points are"),
            (self.lines, "lines are"),
            (self.curves, "free-form curves and surfaces are"),
        ] {
            if count > 0 {
                let note = format!("{count} {what} not shown: a mesh has faces");
                self.scan.notes.push(note);
            }
        }
        if self.mixed > 0 {
            self.scan.notes.push(format!(
                "{} faces have texture coordinates at some corners only: they are not used",
                self.mixed
            ));
        }
        let mut text = std::mem::take(&mut self.texts[0]);
        self.scan.vertex_count = self.counts[0];
        self.scan.has_colours = self.coloured > 0;
        if self.coloured > 0 && self.coloured < self.counts[0] {
            // tobj counts colours apart from vertices: give one to each.
            let mut whole = String::with_capacity(text.len() * 2);
            for line in text.lines() {
                whole.push_str(line);
                if line.split(' ').count() < 7 {
                    whole.push_str(NO_COLOUR);
                }
                whole.push('\n');
            }
            text = whole;
            self.scan.notes.push(format!(
                "{} of {} vertices have no colour: they are white",
                self.counts[0] - self.coloured,
                self.counts[0]
            ));
        }
        text.push_str(&self.texts[1]);
        text.push_str(&self.texts[2]);
        for (i, faces) in self.faces.iter().enumerate() {
            text.push_str("o ");
            text.push_str(&i.to_string());
            text.push('\n');
            text.push_str(faces);
        }
        self.scan.text = text;
        Ok(self.scan)
    }
}
