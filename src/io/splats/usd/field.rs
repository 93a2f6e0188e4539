//! Reads splats from the prims of a stage.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DVec3};

use super::super::placed::transform;
use super::stage::{Attribute, Prim, Stage, Value};
use super::xform::parent_from_prim;
use crate::data::splats::SplatCloud;
use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;
use crate::math::{MAX_HARMONICS_DEGREE, harmonics_count};
use crate::scene::SplatRule;

/// Schema of splats.
pub(super) const SPLATS: &str = "ParticleField3DGaussianSplat";
/// Schema of other fields of particles, with kernels by applied schemas.
pub(super) const FIELD: &str = "ParticleField";
/// Applied schemas of the kernels.
const ELLIPSOIDS: &str = "ParticleFieldKernelGaussianEllipsoidAPI";
pub(super) const SURFLETS: &str = "ParticleFieldKernelGaussianSurfletAPI";
const DISCS: &str = "ParticleFieldKernelConstantSurfletAPI";

/// Hints for the order of splats.
pub(super) const BY_DEPTH: &str = "zDepth";
pub(super) const BY_DISTANCE: &str = "cameraDistance";

/// Colour spaces of Rec. 709's primaries.
pub(super) const ENCODED: &str = "srgb_rec709_scene";
pub(super) const LINEAR: &str = "lin_rec709_scene";

/// Degree of harmonics that a prim does not state.
const USUAL_DEGREE: u8 = 3;
/// Greatest degree that a prim may state.
const MOST_DEGREE: u8 = 10;

/// Kinds of prims that are only containers.
const GROUPS: [&str; 3] = ["", "Xform", "Scope"];

/// Reasons for which prims are left out.
const HIDDEN: &str = "inactive, invisible, undefined, guides, proxies or prototypes";

const FLATTEN: &str = "write one layer of all: `usdcat --flatten FILE --out new.usda`";

/// Shapes of particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kernel {
    Ellipsoid,
    /// A Gaussian in the plane of x and y.
    Surflet,
    /// A disc of radius 1 in that plane.
    Disc,
}

/// The shape of a prim's particles; `None` if it has none.
fn kernel(prim: &Prim) -> Option<Kernel> {
    let has = |name: &str| prim.is_field() && prim.schemas.iter().any(|schema| schema == name);
    if prim.kind == SPLATS || has(ELLIPSOIDS) {
        Some(Kernel::Ellipsoid)
    } else if has(SURFLETS) {
        Some(Kernel::Surflet)
    } else {
        has(DISCS).then_some(Kernel::Disc)
    }
}

/// Properties that a prim has from itself and its ancestors.
#[derive(Clone)]
struct Inherited {
    is_shown: bool,
    world_from_prim: DAffine3,
    /// Prims that state the colour space and the purpose.
    colour_space: Option<usize>,
    purpose: Option<usize>,
    is_sampled: bool,
    /// Prim whose transform is not known.
    fault: Option<usize>,
}

/// Reads all splats that are shown. Returns notes, too.
///
/// # Errors
/// No splats; arrays that are too short; a degree or a transform that is not known.
pub(super) fn splats(path: &Path, mut stage: Stage) -> Result<(SplatCloud, Vec<String>)> {
    let mut cloud = SplatCloud::default();
    let mut notes = Vec::new();
    let mut others: BTreeMap<String, usize> = BTreeMap::new();
    let (mut hidden, mut arcs, mut sampled, mut found) = (0, 0, 0, 0);
    for (index, inherited) in inherited(&stage).into_iter().enumerate() {
        let prim = &stage.prims[index];
        arcs += usize::from(prim.has_arcs);
        let Some(kernel) = kernel(prim) else {
            if prim.is_defined && !GROUPS.contains(&prim.kind.as_str()) {
                *others.entry(clip(&prim.kind)).or_default() += 1;
            }
            continue;
        };
        found += 1;
        let word = |of: Option<usize>, name| stage.prims[of?].word(name).map(str::to_owned);
        let purpose = word(inherited.purpose, "purpose");
        let is_aid = matches!(purpose.as_deref(), Some("guide" | "proxy"));
        if !inherited.is_shown || is_aid {
            hidden += 1;
            continue;
        }
        let place = format!("prim `{}`", stage.path(index));
        if let Some(Err(name)) = inherited.fault.map(|at| parent_from_prim(&stage.prims[at])) {
            return Err(Error::format(
                path,
                place,
                "a transform that is known and finite",
                format!("`{}`, which is not", clip(&name)),
                "bake the transform into the points, or write it as `xformOp:transform`",
            ));
        }
        let colour_space = word(inherited.colour_space, "colorSpace:name");
        let mut reader = Reader {
            path,
            place,
            prim: &mut stage.prims[index],
            is_sampled: inherited.is_sampled,
            notes: &mut notes,
        };
        let mut part = reader.read(kernel, colour_space)?;
        sampled += usize::from(reader.is_sampled);
        let mixes = !cloud.positions.is_empty() && cloud.is_linear != part.is_linear;
        if mixes && cloud.harmonics_degree.max(part.harmonics_degree) > 0 {
            let note = "splats have two colour spaces: the colours of some lose their dependence on the view";
            note_once(&mut notes, note.into());
        }
        transform(&mut part, inherited.world_from_prim);
        cloud.append(part);
    }
    let has_arcs = arcs > 0 || stage.has_sublayers;
    if cloud.positions.is_empty() {
        let (content, advice) = match (found, has_arcs) {
            (0, true) => ("names of other layers and variants".into(), FLATTEN),
            (0, false) if others.is_empty() => ("none".into(), "give a file with splats"),
            (0, false) => (
                listed(&others),
                "give a file with splats; save meshes as glTF (.glb)",
            ),
            _ if hidden == found => (
                format!("{found} that are not shown ({HIDDEN})"),
                "show them, and write the file again",
            ),
            _ => (
                format!("{found} without positions"),
                "give a file with splats",
            ),
        };
        let expected = format!("prims `{SPLATS}`, or with the schema of another kernel");
        return Err(Error::format(path, "prims", expected, content, advice));
    }
    if hidden > 0 {
        let prims = if hidden == 1 {
            "prim of splats is"
        } else {
            "prims of splats are"
        };
        notes.push(format!("{hidden} {prims} not shown ({HIDDEN})"));
    }
    if sampled > 0 {
        notes.push("values that change in time are those of the first sample".into());
    }
    if has_arcs {
        notes.push(format!(
            "references, payloads, sublayers and variants are not read: {FLATTEN}"
        ));
    }
    if !others.is_empty() {
        notes.push(format!(
            "prims that are no splats are not read: {}",
            listed(&others)
        ));
    }
    Ok((cloud, notes))
}

fn note_once(notes: &mut Vec<String>, note: String) {
    if !notes.contains(&note) {
        notes.push(note);
    }
}

/// The most frequent kinds of prims, with their counts.
fn listed(kinds: &BTreeMap<String, usize>) -> String {
    const MOST: usize = 4;
    let mut kinds: Vec<(&String, &usize)> = kinds.iter().collect();
    kinds.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    let mut shown: Vec<String> = kinds.iter().map(|(k, n)| format!("{n} {k}")).collect();
    if shown.len() > MOST {
        let rest: usize = kinds[MOST..].iter().map(|(_, count)| **count).sum();
        shown.truncate(MOST);
        shown.push(format!("{rest} others"));
    }
    shown.join(", ")
}

/// Returns the properties of all prims, in their order: parents come first.
fn inherited(stage: &Stage) -> Vec<Inherited> {
    let mut all: Vec<Inherited> = Vec::with_capacity(stage.prims.len());
    for (index, prim) in stage.prims.iter().enumerate() {
        let root = Inherited {
            is_shown: true,
            world_from_prim: DAffine3::IDENTITY,
            colour_space: None,
            purpose: None,
            is_sampled: false,
            fault: None,
        };
        let mut own = prim.parent.map_or(root, |parent| all[parent].clone());
        let is_hidden = prim.word("visibility") == Some("invisible");
        own.is_shown &= prim.is_defined && !prim.is_inactive && !is_hidden;
        // Prototypes are drawn where their instances are.
        own.is_shown &= prim.kind != "PointInstancer";
        if prim.word("purpose").is_some() {
            own.purpose = Some(index);
        }
        if prim.word("colorSpace:name").is_some() {
            own.colour_space = Some(index);
        }
        match parent_from_prim(prim) {
            Err(_) => own.fault = Some(index),
            Ok(local) if local.is_reset => {
                own.world_from_prim = local.transform;
                own.is_sampled = local.is_sampled;
                own.fault = None;
            }
            Ok(local) => {
                own.world_from_prim *= local.transform;
                own.is_sampled |= local.is_sampled;
            }
        }
        all.push(own);
    }
    all
}

/// A prim of splats.
struct Reader<'a> {
    path: &'a Path,
    place: String,
    prim: &'a mut Prim,
    is_sampled: bool,
    notes: &'a mut Vec<String>,
}

impl Reader<'_> {
    /// Takes an array, in single precision or else in half precision.
    fn take(&mut self, name: &str) -> Option<Attribute> {
        let half = format!("{name}h");
        let attributes = &mut self.prim.attributes;
        let found = attributes
            .remove(name)
            .or_else(|| attributes.remove(&half))?;
        self.is_sampled |= found.is_sampled;
        Some(found)
    }

    /// Takes the first `expected` numbers of an array, or fills one with a default.
    ///
    /// # Errors
    /// The array is too short, or longer by a part of an element.
    fn floats(&mut self, name: &str, expected: usize, default: &[f32]) -> Result<Vec<f32>> {
        let Some(Value::Floats(mut numbers)) = self.take(name).map(|a| a.value) else {
            return Ok(default.iter().copied().cycle().take(expected).collect());
        };
        if numbers.len() < expected {
            return Err(Error::format(
                self.path,
                format!("{}, attribute `{name}`", self.place),
                format!("{expected} numbers, as for each of the positions"),
                numbers.len().to_string(),
                "the file is damaged: get it again",
            ));
        }
        if numbers.len() > expected {
            numbers.truncate(expected);
            let note = format!("numbers of `{name}` beyond those of the positions are not used");
            note_once(self.notes, note);
        }
        Ok(numbers)
    }

    /// Reads the splats in the prim's own space.
    fn read(&mut self, kernel: Kernel, space: Option<String>) -> Result<SplatCloud> {
        const COEFFICIENTS: &str = "radiance:sphericalHarmonicsCoefficients";
        let positions = match self.take("positions").map(|a| a.value) {
            Some(Value::Floats(positions)) => positions,
            _ => Vec::new(),
        };
        let count = positions.len() / 3;
        let (stated, has_harmonics) = match self.prim.attributes.get(COEFFICIENTS) {
            Some(attribute) => (attribute.colour_space.clone(), true),
            None => {
                let half = self.prim.attributes.get(&format!("{COEFFICIENTS}h"));
                let stated = half.and_then(|attribute| attribute.colour_space.clone());
                (stated, half.is_some())
            }
        };
        let is_linear = self.is_linear(stated.or(space).as_deref());
        let stated_degree = if has_harmonics { self.degree()? } else { 0 };
        let stride = 3 * harmonics_count(stated_degree);
        let expected = count.saturating_mul(stride);
        let mut harmonics = self.floats(COEFFICIENTS, expected, &[0.0])?;
        let degree = stated_degree.min(MAX_HARMONICS_DEGREE);
        if stated_degree > degree {
            let used = 3 * harmonics_count(degree);
            let sets = harmonics.chunks_exact(stride);
            harmonics = sets.flat_map(|set| &set[..used]).copied().collect();
            let note = format!(
                "harmonics of degree {stated_degree}: those above {MAX_HARMONICS_DEGREE} are not used"
            );
            note_once(self.notes, note);
        }
        let scales = self.floats("scales", 3 * count, &[1.0])?;
        let mut scales = triples(&scales);
        match kernel {
            Kernel::Ellipsoid => {}
            Kernel::Surflet => scales.iter_mut().for_each(|s| s[2] = 0.0),
            Kernel::Disc => {
                // The Gaussian with the disc's variance.
                let of_disc = |[x, y, _]: [f32; 3]| [0.5 * x, 0.5 * y, 0.0];
                scales.iter_mut().for_each(|s| *s = of_disc(*s));
                let note = "constant surflets are taken for Gaussians of the same variance";
                note_once(self.notes, note.into());
            }
        }
        let rotations = self.floats("orientations", 4 * count, &[1.0, 0.0, 0.0, 0.0])?;
        let opacities = self.floats("opacities", count, &[1.0])?;
        let order = self.prim.word("sortingModeHint").unwrap_or(BY_DEPTH);
        if ![BY_DEPTH, BY_DISTANCE].contains(&order) {
            let note = format!(
                "sortingModeHint `{}` is taken for `{BY_DISTANCE}`",
                clip(order)
            );
            note_once(self.notes, note);
        }
        let projection = self.prim.word("projectionModeHint");
        if let Some(other) = projection.filter(|projection| *projection != "perspective") {
            let note = format!(
                "projectionModeHint `{}` is taken for `perspective`",
                clip(other)
            );
            note_once(self.notes, note);
        }
        Ok(SplatCloud {
            positions: positions
                .chunks_exact(3)
                .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()))
                .collect(),
            scales,
            rotations: rotations
                .chunks_exact(4)
                .map(|q| [q[0], q[1], q[2], q[3]])
                .collect(),
            opacities,
            harmonics_degree: degree,
            harmonics,
            is_linear,
            rule: SplatRule::Inria,
            by_distance: order != BY_DEPTH,
            ..SplatCloud::default()
        })
    }

    /// The degree of the harmonics.
    ///
    /// # Errors
    /// A number that is no degree.
    fn degree(&self) -> Result<u8> {
        const NAME: &str = "radiance:sphericalHarmonicsDegree";
        let found = match self.prim.numbers(NAME) {
            None => return Ok(USUAL_DEGREE),
            Some(numbers) => numbers.first().copied().unwrap_or(f64::NAN),
        };
        let is_it = |degree: &u8| f64::from(*degree).total_cmp(&found).is_eq();
        (0..=MOST_DEGREE).find(is_it).ok_or_else(|| {
            Error::format(
                self.path,
                format!("{}, attribute `{NAME}`", self.place),
                format!("a degree from 0 to {MOST_DEGREE}"),
                found.to_string(),
                "the file is damaged: get it again",
            )
        })
    }

    /// Whether colours of a space are linear light; without a space they are sRGB codes.
    fn is_linear(&mut self, space: Option<&str>) -> bool {
        match space {
            None | Some("" | ENCODED | "srgb_rec709_display") => false,
            Some(LINEAR | "lin_rec709_display") => true,
            Some(other) => {
                let is_linear = other.starts_with("lin_");
                let taken = if is_linear { LINEAR } else { ENCODED };
                let note = format!(
                    "colour space `{}` is taken for `{taken}`, its colours as they are",
                    clip(other)
                );
                note_once(self.notes, note);
                is_linear
            }
        }
    }
}

fn triples(numbers: &[f32]) -> Vec<[f32; 3]> {
    let each = numbers.chunks_exact(3);
    each.map(|s| [s[0], s[1], s[2]]).collect()
}
