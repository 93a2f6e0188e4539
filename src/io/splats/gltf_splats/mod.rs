//! Reads splats from glTF 2.0 files with the extension
//! [`KHR_gaussian_splatting`](https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting).
//!
//! A primitive of points contains splats if its `extensions` name this one. Each point has these attributes:
//!
//! | attribute | type | contents |
//! |---|---|---|
//! | `POSITION` | VEC3 | centre |
//! | `KHR_gaussian_splatting:SCALE` | VEC3 | standard deviations, linear; drafts until 2026 had logarithms: see [`super::log_scales`] |
//! | `KHR_gaussian_splatting:ROTATION` | VEC4 | quaternion x, y, z, w |
//! | `KHR_gaussian_splatting:OPACITY` | SCALAR | peak opacity, 0 to 1 |
//! | `KHR_gaussian_splatting:SH_DEGREE_l_COEF_n` | VEC3 | R, G, B of harmonic n = 0 to 2 l of degree l |
//!
//! The first drafts named scales and rotations `_SCALE` and `_ROTATION`, and stored the constant colour and the opacity
//! in `COLOR_0`. The reader takes these if the others are absent. Numbers may be bytes and shorts, as the extension and
//! `KHR_mesh_quantization` allow.
//!
//! `KHR_gaussian_splatting_compression_spz_2` packs all attributes in one buffer view, an SPZ stream in the axes of the
//! glTF file. The extension prescribes version 2; the reader accepts all versions. Accessors without views may name the
//! attributes.
//!
//! Nodes transform splats. Rotations and uniform scales are exact, and rotate the harmonics. For other linear
//! transforms, shapes stay exact, and harmonics of degree 1 and higher become the nearest ones. Primitives of other
//! kinds are not read.
//!
//! The modules of [`crate::io::mesh::gltf`] read the document, nodes and accessors.

mod write;

use crate::io::bytes::file::extension;
use crate::math::narrowed;
use std::collections::BTreeSet;

use glam::DVec3;

use super::log_scales::{self, ScaleMeaning};
use super::placed::transform;
use super::spz;
use crate::data::dataset::Dataset;
use crate::data::splats::{SplatCloud, constant_of_colour};
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;
use crate::io::mesh::gltf::{
    ANY_NUMBERS, Accessor, Buffers, ComponentType, Document, Nodes, Object, PACKED_SPLATS, SPLATS,
    Type, check_extensions, instances, split,
};
use crate::io::vtk::xml::clip;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count};
use crate::scene::SplatRule;

pub(in crate::io) use self::write::{Container, encode};

/// Name of the format.
pub(in crate::io) const FORMAT: &str = "glTF splats";

const EXTENSION: &str = SPLATS;
const PACKED: &str = PACKED_SPLATS;

/// Supported colour spaces; a file without one has the first.
const ENCODED: &str = "srgb_rec709_display";
const LINEAR: &str = "lin_rec709_display";

/// Orders in which splats hide one another; a file without one has the second.
const BY_DEPTH: &str = "zDepth";
const BY_DISTANCE: &str = "cameraDistance";

/// Number of splats that repeated meshes may give in any file. Larger files may have one for every eight bytes.
const MOST_OF_ANY_FILE: u64 = 1 << 17;

/// Returns the name of a harmonic's attribute.
fn harmonic_name(degree: u8, n: usize) -> String {
    format!("SH_DEGREE_{degree}_COEF_{n}")
}

/// Reads the splats of a file's scene.
///
/// # Errors
/// JSON, containers, accessors or buffers break glTF's rules or are shorter than they state; an attribute is missing; a
/// further extension packs the splats.
pub(in crate::io) fn read(input: Input<'_>, meaning: Option<ScaleMeaning>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    let len = bytes.len() as u64;
    let chunks = split(path, &bytes)?;
    let document = Document::parse(path, chunks.json)?;
    let mut notes: Vec<String> = chunks.note.into_iter().map(str::to_owned).collect();
    check_extensions(path, &document, &[EXTENSION, PACKED], &mut notes)?;
    let buffers = Buffers::new(input, &document, chunks.bin, bytes.len());
    let nodes = Nodes::new(&buffers)?;
    let mut cloud = SplatCloud::default();
    let mut others = 0_usize;
    let mut logarithms = 0;
    // A file may show a mesh many times, but a kilobyte must not expand to gigabytes.
    let mut most = (len / 8).max(MOST_OF_ANY_FILE);
    let mut unpacked = BTreeSet::new();
    for &n in &nodes.shown {
        let node = &nodes.all[n];
        let Some((index, mesh)) = node.mesh(&buffers)? else {
            continue;
        };
        let instances = instances(&buffers, node)?;
        for (p, primitive) in mesh.objects("primitives")?.into_iter().enumerate() {
            let Some(extension) = primitive.extension(EXTENSION) else {
                others += 1;
                continue;
            };
            let color_space = extension.word("colorSpace")?;
            let mut part = match packed(&buffers, extension)? {
                Some(stream) => {
                    let (part, said) = spz::splats(path, stream)?;
                    // Packed splats may take fewer bytes; their stream has been checked against its size.
                    if unpacked.insert((index, p)) {
                        most += part.positions.len() as u64;
                    }
                    said.into_iter()
                        .for_each(|note| note_once(&mut notes, note));
                    part
                }
                None => {
                    let reader = Reader {
                        buffers: &buffers,
                        extension,
                        attributes: primitive.object("attributes")?,
                        place: format!("mesh {index}, primitive {p}"),
                    };
                    let mut part = reader.read()?;
                    // Logarithms are resolved before nodes scale the splats. SPZ defines its scales itself.
                    logarithms += log_scales::settle_splats(&mut part.scales, meaning);
                    part
                }
            };
            // Packed splats may be marked.
            if !part.rule.is_anti_aliased() {
                part.rule = SplatRule::Khr;
            }
            part.is_linear = color_space == Some(LINEAR);
            if let Some(other) = color_space.filter(|space| ![LINEAR, ENCODED].contains(space)) {
                let other = clip(other);
                let note = format!(
                    "colorSpace `{other}` is not known (it may be `{ENCODED}` or `{LINEAR}`): colours are taken for `{ENCODED}`"
                );
                note_once(&mut notes, note);
            }
            let mixes = !cloud.positions.is_empty() && cloud.is_linear != part.is_linear;
            if mixes && cloud.harmonics_degree.max(part.harmonics_degree) > 0 {
                let note =
                    "splats of two colour spaces: of some the colours do not depend on the view";
                note_once(&mut notes, note.into());
            }
            let kernel = extension.word("kernel")?;
            if let Some(kernel) = kernel.filter(|kernel| *kernel != "ellipse") {
                let note = format!("kernel `{}` is taken for `ellipse`", clip(kernel));
                note_once(&mut notes, note);
            }
            let projection = extension.word("projection")?;
            if let Some(other) = projection.filter(|projection| *projection != "perspective") {
                let note = format!("projection `{}` is taken for `perspective`", clip(other));
                note_once(&mut notes, note);
            }
            let sorting = extension.word("sortingMethod")?;
            part.by_distance = sorting != Some(BY_DEPTH);
            if let Some(other) = sorting.filter(|other| ![BY_DEPTH, BY_DISTANCE].contains(other)) {
                let other = clip(other);
                let note = format!("sortingMethod `{other}` is taken for `{BY_DISTANCE}`");
                note_once(&mut notes, note);
            }
            for instance in &instances {
                let world = node.world_from_node * *instance;
                if !world.is_finite() {
                    let found = "another";
                    return Err(buffers.refuse(format!("node {n}"), "a finite transform", found));
                }
                if (cloud.positions.len() + part.positions.len()) as u64 > most {
                    return Err(Error::format(
                        path,
                        "nodes",
                        format!("at most {most} splats in a file of {len} bytes"),
                        "more, by nodes that repeat meshes",
                        "show each mesh fewer times",
                    ));
                }
                let mut placed = part.clone();
                transform(&mut placed, world);
                cloud.append(placed);
            }
        }
    }
    notes.extend(buffers.take_notes());
    if logarithms > 0 {
        notes.push(log_scales::note(logarithms, "splats", meaning));
    }
    if others > 0 {
        notes.push(format!(
            "{others} primitives that are no splats are not read"
        ));
    }
    let mut data = cloud.dataset(path, FORMAT, Vec::new())?;
    data.format_up = Some((DVec3::Y, "glTF has y up"));
    data.notes = notes;
    Ok(data)
}

fn note_once(notes: &mut Vec<String>, note: String) {
    if !notes.contains(&note) {
        notes.push(note);
    }
}

/// Returns true if a file is glTF with splats in its scene. `head` contains its first bytes; the JSON is searched.
pub(in crate::io) fn looks_like(input: Input<'_>, head: &[u8]) -> bool {
    let is_named = extension(input.path) == "gltf";
    if !is_named && !crate::io::mesh::gltf::looks_like(head) {
        return false;
    }
    let Ok(bytes) = input.read_all() else {
        return false;
    };
    let Ok(chunks) = split(input.path, &bytes) else {
        return false;
    };
    let name = EXTENSION.as_bytes();
    if !chunks.json.windows(name.len()).any(|w| w == name) {
        return false;
    }
    let shows_splats = || -> Result<bool> {
        let document = Document::parse(input.path, chunks.json)?;
        let buffers = Buffers::new(input, &document, chunks.bin, bytes.len());
        let nodes = Nodes::new(&buffers)?;
        for &n in &nodes.shown {
            if let Some((_, mesh)) = nodes.all[n].mesh(&buffers)? {
                let primitives = mesh.objects("primitives")?;
                if primitives.iter().any(|p| p.extension(EXTENSION).is_some()) {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    };
    // A broken file counts as one with splats, so that the reader reports its error.
    shows_splats().unwrap_or(true)
}

/// Returns the SPZ stream that packs a primitive's numbers, or `None` if they are not packed.
///
/// # Errors
/// The view does not exist.
fn packed<'b>(buffers: &'b Buffers<'_>, extension: Object<'b>) -> Result<Option<&'b [u8]>> {
    let Some(packed) = extension.extension(PACKED) else {
        return Ok(None);
    };
    let view = packed.index("bufferView")?;
    let missing = || buffers.refuse(PACKED, "a buffer view that is there", "none");
    let (bytes, _) = buffers.view(view.ok_or_else(missing)?, PACKED)?;
    Ok(Some(bytes))
}

/// Primitive of splats whose numbers are in accessors.
struct Reader<'b, 'f> {
    buffers: &'b Buffers<'f>,
    extension: Object<'b>,
    attributes: Option<Object<'b>>,
    place: String,
}

impl Reader<'_, '_> {
    fn has(&self, name: &str) -> bool {
        self.attributes
            .is_some_and(|attributes| attributes.has(name))
    }

    /// Reads an attribute of `N` numbers per point.
    fn floats<const N: usize>(&self, name: &str) -> Result<Vec<[f32; N]>> {
        let place = format!("{}, attribute `{name}`", self.place);
        let index = match self.attributes {
            Some(attributes) => attributes.index(name)?,
            None => None,
        };
        let accessor = index.and_then(|i| self.buffers.document.find("accessors", i));
        let has_bytes = accessor.is_some_and(|a| a.has("bufferView") || a.has("sparse"));
        if accessor.is_some() && !has_bytes || index.is_none() {
            let (expected, found, advice) = match self.extension.extensions().next() {
                Some(packing) => (
                    "numbers that are not packed",
                    format!("the extension `{}`", clip(packing)),
                    "save the splats without it",
                ),
                None if index.is_none() => (
                    "one",
                    "none".into(),
                    "write all that the extension asks for",
                ),
                None => (
                    "numbers",
                    "an accessor without a buffer view".into(),
                    "write all numbers into a buffer",
                ),
            };
            return Err(Error::format(
                self.buffers.path,
                place,
                expected,
                found,
                advice,
            ));
        }
        let type_ = [
            Type::Scalar,
            Type::Scalar,
            Type::Vec2,
            Type::Vec3,
            Type::Vec4,
        ][N];
        // The extension and `KHR_mesh_quantization` allow bytes and shorts for these attributes. Harmonics are floats.
        let is_short = ["SCALE", "ROTATION", "OPACITY", "POSITION", "COLOR_0"]
            .iter()
            .any(|n| name.ends_with(n));
        let components = match is_short {
            true => ANY_NUMBERS,
            false => &[ComponentType::F32],
        };
        let index = index.unwrap_or(usize::MAX);
        let accessor = Accessor::open(self.buffers, index, &place, &[type_], components)?;
        let numbers = |i: usize| accessor.numbers::<N>(i).map(narrowed);
        Ok((0..accessor.len()).map(numbers).collect())
    }

    /// Reads the splats in the primitive's own space.
    fn read(&self) -> Result<SplatCloud> {
        let positions = self.floats::<3>("POSITION")?;
        let count = positions.len();
        let has = |name: &str| self.has(name);
        let opacity = format!("{EXTENSION}:OPACITY");
        let constant = format!("{EXTENSION}:{}", harmonic_name(0, 0));
        let is_draft = (!has(&opacity) || !has(&constant)) && has("COLOR_0");
        let draft_colours = match is_draft {
            true => Some(self.floats::<4>("COLOR_0")?),
            false => None,
        };
        let named = |name: &str| {
            let (final_name, draft) = (format!("{EXTENSION}:{name}"), format!("_{name}"));
            if has(&final_name) || !has(&draft) {
                final_name
            } else {
                draft
            }
        };
        let mut harmonics: Vec<Vec<[f32; 3]>> = Vec::new();
        let mut degree = 0;
        for l in 0..=MAX_HARMONICS_DEGREE {
            let is_there = has(&format!("{EXTENSION}:{}", harmonic_name(l, 0)));
            if l > 0 && !is_there {
                break;
            }
            degree = l;
            if let (0, Some(colours), false) = (l, &draft_colours, is_there) {
                let constants = colours.iter().map(|[r, g, b, _]| [r, g, b]);
                harmonics.push(
                    constants
                        .map(|rgb| rgb.map(|c| constant_of_colour(*c)))
                        .collect(),
                );
                continue;
            }
            for n in 0..=2 * usize::from(l) {
                let name = format!("{EXTENSION}:{}", harmonic_name(l, n));
                harmonics.push(self.floats::<3>(&name)?);
            }
        }
        let scales = self.floats::<3>(&named("SCALE"))?;
        let rotations = self.floats::<4>(&named("ROTATION"))?;
        let opacities = match &draft_colours {
            Some(colours) if !has(&opacity) => colours.iter().map(|[.., a]| [*a]).collect(),
            _ => self.floats::<1>(&opacity)?,
        };
        let lengths = [scales.len(), rotations.len(), opacities.len()];
        let lengths = lengths.into_iter().chain(harmonics.iter().map(Vec::len));
        if let Some(len) = lengths.into_iter().find(|&len| len != count) {
            return Err(Error::format(
                self.buffers.path,
                "attributes",
                format!("{count} of each, as of POSITION"),
                len.to_string(),
                "the file is damaged: get it again",
            ));
        }
        let mut coefficients = Vec::with_capacity(count * 3 * harmonics_count(degree));
        for i in 0..count {
            coefficients.extend(harmonics.iter().flat_map(|rgb| rgb[i]));
        }
        Ok(SplatCloud {
            positions: positions
                .into_iter()
                .map(|p| DVec3::from(p.map(f64::from)))
                .collect(),
            scales,
            rotations: rotations
                .into_iter()
                .map(|[x, y, z, w]| [w, x, y, z])
                .collect(),
            opacities: opacities.into_iter().map(|[a]| a).collect(),
            harmonics_degree: degree,
            harmonics: coefficients,
            rule: SplatRule::Khr,
            is_linear: false,
            ..SplatCloud::default()
        })
    }
}
