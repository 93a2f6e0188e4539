//! Holds the prims of a layer, with the attributes that splats need.

use std::collections::BTreeMap;

use crate::io::vtk::xml::clip;

/// Greatest depth of prims below the root.
const MOST_DEPTH: usize = 256;

/// Number of prims that any file may have. Larger files may have one for every 64 bytes.
const MOST_PRIMS: usize = 1 << 16;

/// Beginning of the schemas of fields of particles.
const FIELDS: &str = "ParticleField";

/// A layer of a stage.
#[derive(Debug)]
pub(super) struct Stage {
    /// Prims, each after its parent.
    pub(super) prims: Vec<Prim>,
    /// `upAxis`, if the layer states it.
    pub(super) up_axis: Option<String>,
    /// Whether the layer names sublayers.
    pub(super) has_sublayers: bool,
    most_prims: usize,
}

/// A prim.
#[derive(Debug, Default)]
pub(super) struct Prim {
    pub(super) parent: Option<usize>,
    pub(super) depth: usize,
    pub(super) name: String,
    /// Name of its schema; empty if it has none.
    pub(super) kind: String,
    /// Whether it is defined, and neither an override nor a class.
    pub(super) is_defined: bool,
    pub(super) is_inactive: bool,
    /// Whether it names references, payloads, inherited prims or variants.
    pub(super) has_arcs: bool,
    /// Names of applied schemas.
    pub(super) schemas: Vec<String>,
    /// Attributes of [`kind_of`] by name.
    pub(super) attributes: BTreeMap<String, Attribute>,
}

/// An attribute with a value.
#[derive(Debug)]
pub(super) struct Attribute {
    pub(super) value: Value,
    /// Whether the value is the first of several in time.
    pub(super) is_sampled: bool,
    /// `colorSpace` in the metadata.
    pub(super) colour_space: Option<String>,
}

/// A value, without the shape of its elements.
#[derive(Debug)]
pub(super) enum Value {
    /// Arrays. Quaternions are w, x, y, z.
    Floats(Vec<f32>),
    /// Single numbers, vectors, quaternions (w, x, y, z) and matrices, row by row.
    Numbers(Vec<f64>),
    /// Tokens and strings, one or an array.
    Words(Vec<String>),
}

/// Kinds of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Floats,
    Numbers,
    Words,
}

/// The kind of an attribute's value; `None` for attributes that splats do not need.
pub(super) fn kind_of(name: &str) -> Option<Kind> {
    match name {
        "positions"
        | "positionsh"
        | "orientations"
        | "orientationsh"
        | "scales"
        | "scalesh"
        | "opacities"
        | "opacitiesh"
        | "radiance:sphericalHarmonicsCoefficients"
        | "radiance:sphericalHarmonicsCoefficientsh" => Some(Kind::Floats),
        "radiance:sphericalHarmonicsDegree" => Some(Kind::Numbers),
        "xformOpOrder" | "visibility" | "purpose" | "sortingModeHint" | "projectionModeHint"
        | "colorSpace:name" => Some(Kind::Words),
        // Connections have their own names: `xformOp:translate.connect`.
        _ if name.starts_with("xformOp:") && !name.contains('.') => Some(Kind::Numbers),
        _ => None,
    }
}

impl Stage {
    /// A stage without prims.
    ///
    /// - `len`: length of the file in bytes.
    pub(super) fn new(len: usize) -> Self {
        Self {
            prims: Vec::new(),
            up_axis: None,
            has_sublayers: false,
            most_prims: MOST_PRIMS.max(len / 64),
        }
    }

    /// Appends a prim below `parent` and returns its index; `None` if it lies too deep or is one too many.
    pub(super) fn add(&mut self, parent: Option<usize>, prim: Prim) -> Option<usize> {
        let depth = parent.map_or(0, |p| self.prims[p].depth + 1);
        if depth > MOST_DEPTH || self.prims.len() >= self.most_prims {
            return None;
        }
        self.prims.push(Prim {
            parent,
            depth,
            ..prim
        });
        Some(self.prims.len() - 1)
    }

    /// A prim and its ancestors, from the prim upwards.
    pub(super) fn upwards(&self, index: usize) -> impl Iterator<Item = &Prim> {
        let parent = |prim: &&Prim| Some(&self.prims[prim.parent?]);
        std::iter::successors(Some(&self.prims[index]), parent)
    }

    /// The path of a prim, for messages.
    pub(super) fn path(&self, index: usize) -> String {
        let mut names: Vec<String> = self.upwards(index).map(|prim| clip(&prim.name)).collect();
        names.push(String::new());
        names.reverse();
        names.join("/")
    }
}

impl Prim {
    /// Whether it is a field of particles. Other prims have arrays of the same names.
    pub(super) fn is_field(&self) -> bool {
        self.kind.starts_with(FIELDS)
    }

    /// Keeps the attribute's value. Samples in time take precedence over a default.
    pub(super) fn keep(&mut self, name: &str, attribute: Attribute) {
        let is_kept = self.attributes.get(name).is_none_or(|a| !a.is_sampled);
        if is_kept || attribute.is_sampled {
            self.attributes.insert(name.to_owned(), attribute);
        }
    }

    /// The numbers of an attribute that is no array.
    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        match &self.attributes.get(name)?.value {
            Value::Numbers(numbers) => Some(numbers),
            _ => None,
        }
    }

    /// The words of an attribute.
    pub(super) fn words(&self, name: &str) -> Option<&[String]> {
        match &self.attributes.get(name)?.value {
            Value::Words(words) => Some(words),
            _ => None,
        }
    }

    /// The only word of an attribute.
    pub(super) fn word(&self, name: &str) -> Option<&str> {
        match self.words(name)? {
            [word] => Some(word),
            _ => None,
        }
    }
}
