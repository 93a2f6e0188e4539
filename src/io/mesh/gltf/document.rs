//! Parses the JSON of a glTF file. It keeps the members that the reader uses, and checks each when it is requested.
//!
//! The parser skips all other members, whatever JSON they contain: `extras`, animations, cameras, unsupported
//! extensions, and names that the format does not define. Integers may be written as `4.0`. `null` counts as absent.

use std::collections::HashMap;
use std::path::Path;

use serde::Deserializer;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

use crate::error::{Error, Result};
use crate::io::refused;
use crate::io::vtk::xml::clip;

/// Extension within [`SPLATS`] whose buffer view contains an SPZ stream.
pub(in crate::io) const PACKED_SPLATS: &str = "KHR_gaussian_splatting_compression_spz_2";

/// Extension for Gaussian splats.
pub(in crate::io) const SPLATS: &str = "KHR_gaussian_splatting";

/// Extension that packs the meshes of whole primitives.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// Extensions that the reader of splats supports.
pub(super) const OF_SPLATS: &[&str] = &[SPLATS, PACKED_SPLATS];

/// Extensions that are read.
pub(super) const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    #[cfg(feature = "draco")]
    DRACO,
    "EXT_texture_webp",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Advice for a file that breaks the format's rules.
pub(super) const BROKEN: &str = "the file is damaged or breaks the format's rules: export it again";

/// Names of the members that are kept, for all objects; `attributes` and `targets` keep all their members.
const MEMBERS: &[&str] = &[
    "accessors",
    "alphaCutoff",
    "alphaMode",
    "asset",
    "attributes",
    "baseColorFactor",
    "baseColorTexture",
    "buffer",
    "bufferView",
    "bufferViews",
    "buffers",
    "byteLength",
    "byteOffset",
    "byteStride",
    "children",
    "colorSpace",
    "componentType",
    "count",
    "diffuseFactor",
    "diffuseTexture",
    "doubleSided",
    "emissiveFactor",
    "emissiveStrength",
    "emissiveTexture",
    "extensions",
    "extensionsRequired",
    "extensionsUsed",
    "filter",
    "images",
    "index",
    "indices",
    "inverseBindMatrices",
    "joints",
    "kernel",
    "material",
    "materials",
    "matrix",
    "mesh",
    "meshes",
    "mode",
    "name",
    "nodes",
    "normalTexture",
    "normalized",
    "offset",
    "pbrMetallicRoughness",
    "primitives",
    "rotation",
    "sampler",
    "samplers",
    "scale",
    "scene",
    "scenes",
    "skin",
    "skins",
    "projection",
    "sortingMethod",
    "source",
    "sparse",
    "targets",
    "texCoord",
    "textures",
    "translation",
    "type",
    "uri",
    "values",
    "version",
    "weights",
    "wrapS",
    "wrapT",
];

/// Lists of a file's objects, and the noun in messages for one object of each.
const LISTS: &[(&str, &str)] = &[
    ("accessors", "accessor"),
    ("bufferViews", "buffer view"),
    ("buffers", "buffer"),
    ("images", "image"),
    ("materials", "material"),
    ("meshes", "mesh"),
    ("nodes", "node"),
    ("samplers", "sampler"),
    ("scenes", "scene"),
    ("skins", "skin"),
    ("textures", "texture"),
];

/// JSON of a file.
#[derive(Debug)]
pub(in crate::io) struct Document<'f> {
    path: &'f Path,
    root: Value,
}

impl<'f> Document<'f> {
    /// Parses the text.
    ///
    /// # Errors
    /// The text is no JSON, states another version of the format, or has a member instead of a list of objects.
    pub(in crate::io) fn parse(path: &'f Path, json: &[u8]) -> Result<Self> {
        let mut parser = serde_json::Deserializer::from_slice(json);
        let parsed = Kept::Object.deserialize(&mut parser);
        let root = parsed.and_then(|root| parser.end().map(|()| root));
        let root = root.map_err(|error| {
            let found = error.to_string();
            let found = match found.len() {
                0..=200 => found,
                _ => format!("{} ...", clip(&found)),
            };
            let advice = "the file is damaged or no glTF 2.0 file: export it again";
            Error::format(path, "JSON", "a glTF 2.0 asset", found, advice)
        })?;
        let version = root["asset"]["version"].as_str().unwrap_or("none");
        if !version.starts_with("2.") {
            let found = format!("`{}`", clip(version));
            let advice = "export it as glTF 2.0";
            // Other formats also have an asset.
            let keys: HashMap<String, IgnoredAny> =
                serde_json::from_slice(json).unwrap_or_default();
            if let Some((name, advice)) = refused::index(|key| keys.contains_key(key)) {
                let found = format!("{name}, which is not read");
                return Err(Error::format(
                    path,
                    "format",
                    "a glTF 2.0 asset",
                    found,
                    advice,
                ));
            }
            return Err(Error::format(path, "asset, version", "2.0", found, advice));
        }
        for (name, _) in LISTS {
            if !matches!(root[*name], Value::Array(_) | Value::Null) {
                let found = shortened(&root[*name]);
                let place = format!("JSON, {name}");
                return Err(Error::format(path, place, "a list", found, BROKEN));
            }
        }
        Ok(Self { path, root })
    }

    /// Returns the number of objects in a list.
    pub(in crate::io) fn count(&self, list: &str) -> usize {
        self.root[list].as_array().map_or(0, Vec::len)
    }

    /// Finds an object by its index in one of the format's lists.
    pub(in crate::io) fn find(&self, list: &'static str, index: usize) -> Option<Object<'_>> {
        let noun = LISTS.iter().find(|(name, _)| *name == list)?.1;
        Some(Object {
            path: self.path,
            json: self.root[list].get(index)?,
            noun,
            index,
            within: "",
        })
    }

    /// Finds an object by its index, or returns an error at `place` that states the length of the list.
    ///
    /// # Errors
    /// The object does not exist.
    pub(in crate::io) fn get(
        &self,
        list: &'static str,
        index: usize,
        place: &str,
    ) -> Result<Object<'_>> {
        self.find(list, index).ok_or_else(|| {
            let known = LISTS.iter().find(|(name, _)| *name == list);
            let (name, noun) = match known {
                Some(("bufferViews", noun)) => ("buffer views", *noun),
                Some((name, noun)) => (*name, *noun),
                None => (list, list),
            };
            let expected = format!("one of {} {name}", self.count(list));
            let found = format!("{noun} {index}");
            Error::format(self.path, place, expected, found, BROKEN)
        })
    }

    /// Returns the index of the default scene, if the file states one.
    ///
    /// # Errors
    /// The member is no whole number.
    pub(in crate::io) fn scene(&self) -> Result<Option<usize>> {
        let root = Object {
            path: self.path,
            json: &self.root,
            noun: "file",
            index: 0,
            within: "",
        };
        root.index("scene")
    }

    /// Returns the words of a list.
    pub(super) fn words(&self, list: &str) -> impl Iterator<Item = &str> {
        let words = self.root[list].as_array().into_iter().flatten();
        words.filter_map(Value::as_str)
    }
}

/// JSON object of a file, with its place for messages. Only requested members are checked.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Object<'d> {
    path: &'d Path,
    json: &'d Value,
    noun: &'static str,
    index: usize,
    /// Member of the listed object that this object is; empty for the listed object itself.
    within: &'static str,
}

impl<'d> Object<'d> {
    fn refuse(&self, key: &str, expected: impl Into<String>, found: &Value) -> Error {
        let mut place = format!("{} {}", self.noun, self.index);
        for part in [self.within, key].into_iter().filter(|p| !p.is_empty()) {
            place.push_str(", ");
            place.push_str(part);
        }
        Error::format(self.path, place, expected, shortened(found), BROKEN)
    }

    /// Reads a member, if it exists.
    fn member<T>(
        &self,
        key: &str,
        expected: &str,
        read: impl FnOnce(&'d Value) -> Option<T>,
    ) -> Result<Option<T>> {
        match self.json.get(key) {
            None => Ok(None),
            Some(value) => match read(value) {
                Some(read) => Ok(Some(read)),
                None => Err(self.refuse(key, expected, value)),
            },
        }
    }

    /// Returns its index in its list.
    pub(in crate::io) fn number_in_list(&self) -> usize {
        self.index
    }

    /// Returns true if a member exists.
    pub(in crate::io) fn has(&self, key: &str) -> bool {
        self.json.get(key).is_some()
    }

    /// Reads a whole number, at least 0.
    pub(in crate::io) fn integer(&self, key: &str) -> Result<Option<u64>> {
        self.member(key, "a whole number from 0 on", whole)
    }

    /// Reads the index of another object.
    pub(in crate::io) fn index(&self, key: &str) -> Result<Option<usize>> {
        Ok(self
            .integer(key)?
            .map(|n| usize::try_from(n).unwrap_or(usize::MAX)))
    }

    /// Reads a number of elements or bytes.
    ///
    /// # Errors
    /// The member does not exist or is no whole number.
    pub(in crate::io) fn size(&self, key: &str) -> Result<u64> {
        let size = self.integer(key)?;
        size.ok_or_else(|| self.refuse(key, "a whole number from 0 on", &Value::Null))
    }

    /// Reads the indices of other objects; empty if absent.
    pub(in crate::io) fn indices(&self, key: &str) -> Result<Vec<usize>> {
        let read = |value: &Value| {
            let index = |item| whole(item).map(|n| usize::try_from(n).unwrap_or(usize::MAX));
            value.as_array()?.iter().map(index).collect()
        };
        let indices = self.member(key, "a list of whole numbers from 0 on", read)?;
        Ok(indices.unwrap_or_default())
    }

    /// Reads a number.
    pub(in crate::io) fn number(&self, key: &str) -> Result<Option<f64>> {
        self.member(key, "a number", Value::as_f64)
    }

    /// Reads a list of numbers.
    pub(in crate::io) fn list(&self, key: &str) -> Result<Option<Vec<f64>>> {
        let read = |value: &Value| value.as_array()?.iter().map(Value::as_f64).collect();
        self.member(key, "a list of numbers", read)
    }

    /// Reads a list of `N` numbers.
    pub(in crate::io) fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>> {
        let read = |value: &Value| {
            let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
            numbers?.try_into().ok()
        };
        self.member(key, &format!("{N} numbers"), read)
    }

    /// Returns true if a member exists and is true.
    pub(in crate::io) fn flag(&self, key: &str) -> Result<bool> {
        let flag = self.member(key, "true or false", Value::as_bool)?;
        Ok(flag.unwrap_or(false))
    }

    /// Reads a string, such as the name of a mode.
    pub(in crate::io) fn word(&self, key: &str) -> Result<Option<&'d str>> {
        self.member(key, "a word in quotes", Value::as_str)
    }

    /// Returns the name, if it is a string.
    pub(in crate::io) fn name(&self) -> Option<&'d str> {
        self.json.get("name")?.as_str()
    }

    /// Reads an object within this one.
    pub(in crate::io) fn object(&self, key: &'static str) -> Result<Option<Self>> {
        let of = |value: &'d Value| {
            value.is_object().then_some(Self {
                json: value,
                within: key,
                ..*self
            })
        };
        self.member(key, "an object", of)
    }

    /// Reads a list of objects within this one; empty if absent.
    pub(in crate::io) fn objects(&self, key: &'static str) -> Result<Vec<Self>> {
        let of = |value: &'d Value| {
            let items = value.as_array()?.iter();
            let object = |json: &'d Value| {
                json.is_object().then_some(Self {
                    json,
                    within: key,
                    ..*self
                })
            };
            items.map(object).collect()
        };
        Ok(self
            .member(key, "a list of objects", of)?
            .unwrap_or_default())
    }

    /// Returns this object's data for a supported extension.
    pub(in crate::io) fn extension(&self, name: &'static str) -> Option<Self> {
        let json = self.json.get("extensions")?.get(name)?;
        json.is_object().then_some(Self {
            json,
            within: name,
            ..*self
        })
    }

    /// Returns the names of all its extensions, supported or not.
    pub(in crate::io) fn extensions(&self) -> impl Iterator<Item = &'d str> {
        let extensions = self.json.get("extensions").and_then(Value::as_object);
        extensions
            .into_iter()
            .flat_map(|map| map.keys().map(String::as_str))
    }
}

/// Reads a whole number, at least 0, in any notation.
fn whole(value: &Value) -> Option<u64> {
    /// From this number on, doubles cannot represent every whole number.
    const END: f64 = 9_007_199_254_740_992.0;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a whole number in the range"
    )]
    let of_float = |x: f64| ((0.0..END).contains(&x) && x.fract() == 0.0).then_some(x as u64);
    value.as_u64().or_else(|| value.as_f64().and_then(of_float))
}

fn shortened(value: &Value) -> String {
    match value {
        Value::Null => "none".into(),
        // Lists may be long, so only their length is shown.
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Object(_) => "an object".into(),
        value => format!("`{}`", clip(&value.to_string())),
    }
}

/// Choice of the members of a value that are kept.
#[derive(Debug, Clone, Copy)]
enum Kept {
    /// Members of objects that are read.
    Object,
    /// All members of objects.
    Attributes,
    /// Names of all extensions, and contents of those that are supported.
    Extensions,
}

impl<'de> DeserializeSeed<'de> for Kept {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Kept {
    type Value = Value;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, flag: bool) -> Result<Value, E> {
        Ok(flag.into())
    }

    fn visit_u64<E>(self, number: u64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_i64<E>(self, number: i64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_f64<E>(self, number: f64) -> Result<Value, E> {
        Ok(number.into())
    }

    fn visit_str<E>(self, text: &str) -> Result<Value, E> {
        Ok(text.into())
    }

    fn visit_string<E>(self, text: String) -> Result<Value, E> {
        Ok(text.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut kept = Vec::new();
        while let Some(item) = items.next_element_seed(self)? {
            kept.push(item);
        }
        Ok(Value::Array(kept))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut kept = Map::new();
        while let Some(key) = members.next_key::<String>()? {
            let of_member = match (self, key.as_str()) {
                (Self::Object, "attributes" | "targets") => Some(Self::Attributes),
                (Self::Object, "extensions") => Some(Self::Extensions),
                (Self::Object, name) => MEMBERS.contains(&name).then_some(Self::Object),
                (Self::Attributes, _) => Some(Self::Attributes),
                (Self::Extensions, name) => {
                    let is_read = READ.contains(&name) || OF_SPLATS.contains(&name);
                    is_read.then_some(Self::Object)
                }
            };
            let value = match of_member {
                Some(of_member) => members.next_value_seed(of_member)?,
                None => {
                    members.next_value::<IgnoredAny>()?;
                    match self {
                        Self::Extensions => Value::Bool(true),
                        _ => continue,
                    }
                }
            };
            if !value.is_null() {
                kept.insert(key, value);
            }
        }
        Ok(Value::Object(kept))
    }
}
