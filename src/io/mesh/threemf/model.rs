//! Parses a model: its objects, their properties, and the items to build.

use std::collections::HashMap;
use std::str::FromStr;

use glam::{DAffine3, DVec3, Vec2};
use roxmltree::Node;

use super::package::{Package, name_of};
use crate::data::mesh::Wrap;
use crate::error::Result;
use crate::image::linear_from_srgb;
use crate::io::vtk::xml::{child, clip};

/// The unit of a model that states none.
pub(super) const DEFAULT_UNIT: &str = "millimeter";

/// The content of one XML file.
pub(super) struct Model {
    pub(super) unit: String,
    pub(super) objects: HashMap<u32, Object>,
    pub(super) properties: HashMap<u32, Properties>,
    pub(super) textures: HashMap<u32, StatedTexture>,
    pub(super) items: Vec<Placed>,
}

/// An object, with its transform.
#[derive(Clone)]
pub(super) struct Placed {
    /// The file of the object's model, if it is another one.
    pub(super) file: Option<String>,
    pub(super) object: u32,
    pub(super) transform: DAffine3,
}

pub(super) struct Object {
    pub(super) content: Content,
    /// The default properties of triangles: a group and an index.
    pub(super) property: Option<(u32, u32)>,
}

pub(super) enum Content {
    Mesh {
        positions: Vec<DVec3>,
        triangles: Vec<Triangle>,
    },
    Components(Vec<Placed>),
}

#[derive(Clone, Copy)]
pub(super) struct Triangle {
    pub(super) corners: [u32; 3],
    /// The group of its corners' properties, and their indices.
    pub(super) property: Option<(u32, [u32; 3])>,
}

/// A group of properties.
pub(super) enum Properties {
    /// Linear RGBA.
    Colours(Vec<[f32; 4]>),
    /// Texture coordinates, v downwards, and the id of the texture.
    Coordinates(u32, Vec<Vec2>),
}

pub(super) struct StatedTexture {
    pub(super) file: String,
    pub(super) wrap: [Wrap; 2],
}

impl Model {
    pub(super) fn of(package: &Package<'_>, file: &str, text: &str) -> Result<Self> {
        let document = package.document(file, text)?;
        let reader = Reader { package, file };
        let root = document.root_element();
        let mut model = Self {
            unit: root.attribute("unit").unwrap_or(DEFAULT_UNIT).to_owned(),
            objects: HashMap::new(),
            properties: HashMap::new(),
            textures: HashMap::new(),
            items: Vec::new(),
        };
        for node in child(root, "resources").iter().flat_map(Node::children) {
            let group = match node.tag_name().name() {
                "object" => {
                    let object = reader.object(node)?;
                    model.objects.insert(reader.number(node, "id")?, object);
                    continue;
                }
                "texture2d" => {
                    let texture = reader.texture(node)?;
                    model.textures.insert(reader.number(node, "id")?, texture);
                    continue;
                }
                "basematerials" => Properties::Colours(reader.colours(node, "displaycolor")?),
                "colorgroup" => Properties::Colours(reader.colours(node, "color")?),
                "texture2dgroup" => {
                    let all = node.children().filter(Node::is_element);
                    let coordinates = all.map(|node| {
                        let [u, v] = [reader.number(node, "u")?, reader.number(node, "v")?];
                        let v: f32 = v;
                        Ok(Vec2::new(u, 1.0 - v))
                    });
                    let coordinates = coordinates.collect::<Result<_>>()?;
                    Properties::Coordinates(reader.number(node, "texid")?, coordinates)
                }
                _ => continue,
            };
            model.properties.insert(reader.number(node, "id")?, group);
        }
        for node in child(root, "build").iter().flat_map(Node::children) {
            if node.has_tag_name("item") {
                model.items.push(reader.placed(node)?);
            }
        }
        Ok(model)
    }

    /// All objects with meshes, without a transform, in the order of their ids.
    pub(super) fn all_meshes(&self) -> Vec<Placed> {
        let objects = self.objects.iter();
        let meshes = objects.filter(|(_, object)| matches!(object.content, Content::Mesh { .. }));
        let mut numbers: Vec<u32> = meshes.map(|(id, _)| *id).collect();
        numbers.sort_unstable();
        let placed = |object| Placed {
            file: None,
            object,
            transform: DAffine3::IDENTITY,
        };
        numbers.into_iter().map(placed).collect()
    }
}

/// Reads the elements of one file.
struct Reader<'p> {
    package: &'p Package<'p>,
    file: &'p str,
}

impl Reader<'_> {
    fn place(&self, node: Node<'_, '_>, attribute: &str) -> String {
        format!(
            "`{}`, {}, `{attribute}`",
            self.file,
            clip(node.tag_name().name())
        )
    }

    /// The number in a required attribute.
    fn number<T: FromStr>(&self, node: Node<'_, '_>, name: &str) -> Result<T> {
        let text = node.attribute(name).unwrap_or("");
        text.trim().parse().map_err(|_| {
            let place = self.place(node, name);
            let found = format!("`{}`", clip(text));
            self.package.fault(&place, "a number", found)
        })
    }

    /// The number in an optional attribute.
    fn stated<T: FromStr>(&self, node: Node<'_, '_>, name: &str) -> Result<Option<T>> {
        let is_stated = node.attribute(name).is_some();
        is_stated.then(|| self.number(node, name)).transpose()
    }

    fn placed(&self, node: Node<'_, '_>) -> Result<Placed> {
        // The attribute belongs to the production extension: it is in a namespace.
        let mut attributes = node.attributes();
        let file = attributes.find(|attribute| attribute.name() == "path");
        Ok(Placed {
            file: file.map(|attribute| name_of(attribute.value()).to_owned()),
            object: self.number(node, "objectid")?,
            transform: self.transform(node)?,
        })
    }

    fn transform(&self, node: Node<'_, '_>) -> Result<DAffine3> {
        let Some(text) = node.attribute("transform") else {
            return Ok(DAffine3::IDENTITY);
        };
        let numbers = text.split_ascii_whitespace().map(|word| word.parse().ok());
        let numbers: Option<Vec<f64>> = numbers.collect();
        let numbers = numbers.and_then(|numbers| <[f64; 12]>::try_from(numbers).ok());
        // Rows of the file's matrix are columns of this one.
        let transform = numbers.map(|numbers| DAffine3::from_cols_array(&numbers));
        transform.ok_or_else(|| {
            let found = format!("`{}`", clip(text));
            let place = self.place(node, "transform");
            self.package.fault(&place, "twelve numbers", found)
        })
    }

    fn object(&self, node: Node<'_, '_>) -> Result<Object> {
        let group = self.stated(node, "pid")?;
        let property = match group {
            Some(group) => Some((group, self.stated(node, "pindex")?.unwrap_or(0))),
            None => None,
        };
        let content = match child(node, "mesh") {
            Some(mesh) => self.mesh(mesh)?,
            None => {
                let components = child(node, "components");
                let components = components.iter().flat_map(Node::children);
                let components = components.filter(|node| node.has_tag_name("component"));
                Content::Components(
                    components
                        .map(|node| self.placed(node))
                        .collect::<Result<_>>()?,
                )
            }
        };
        Ok(Object { content, property })
    }

    fn mesh(&self, node: Node<'_, '_>) -> Result<Content> {
        let elements = |list: &str, name: &'static str| {
            let list = child(node, list);
            let all = list.map(|list| list.children().filter(move |n| n.has_tag_name(name)));
            all.into_iter().flatten()
        };
        let mut positions = Vec::new();
        for vertex in elements("vertices", "vertex") {
            let axis = |name| self.number(vertex, name);
            positions.push(DVec3::new(axis("x")?, axis("y")?, axis("z")?));
        }
        let mut triangles = Vec::new();
        for triangle in elements("triangles", "triangle") {
            let corner = |name| -> Result<u32> {
                let index = self.number(triangle, name)?;
                if (index as usize) < positions.len() {
                    return Ok(index);
                }
                let expected = format!("one of {} vertices", positions.len());
                let place = self.place(triangle, name);
                Err(self.package.fault(&place, &expected, index.to_string()))
            };
            let corners = [corner("v1")?, corner("v2")?, corner("v3")?];
            let property = match self.stated(triangle, "p1")? {
                None => None,
                Some(first) => {
                    let second = self.stated(triangle, "p2")?.unwrap_or(first);
                    let third = self.stated(triangle, "p3")?.unwrap_or(first);
                    Some([first, second, third])
                }
            };
            // Without a group of their own, indices refer to the object's group.
            let group = match self.stated(triangle, "pid")? {
                Some(group) => Some(group),
                None => node
                    .parent()
                    .map_or(Ok(None), |object| self.stated(object, "pid"))?,
            };
            triangles.push(Triangle {
                corners,
                property: group.zip(property),
            });
        }
        Ok(Content::Mesh {
            positions,
            triangles,
        })
    }

    fn texture(&self, node: Node<'_, '_>) -> Result<StatedTexture> {
        let wrap = |name: &str| match node.attribute(name) {
            Some("mirror") => Wrap::MirroredRepeat,
            Some("clamp" | "none") => Wrap::ClampToEdge,
            _ => Wrap::Repeat,
        };
        let Some(file) = node.attribute("path") else {
            let place = self.place(node, "path");
            return Err(self
                .package
                .fault(&place, "a file in the archive", "none".into()));
        };
        Ok(StatedTexture {
            file: name_of(file).to_owned(),
            wrap: ["tilestyleu", "tilestylev"].map(wrap),
        })
    }

    /// The colours of a group's elements, linear.
    fn colours(&self, node: Node<'_, '_>, attribute: &str) -> Result<Vec<[f32; 4]>> {
        let all = node.children().filter(Node::is_element);
        let colour = |node: Node<'_, '_>| {
            // A base material need not have one.
            let text = node.attribute(attribute).unwrap_or("#FFFFFF").trim();
            colour(text).ok_or_else(|| {
                let found = format!("`{}`", clip(text));
                let place = self.place(node, attribute);
                self.package.fault(&place, "#RRGGBB or #RRGGBBAA", found)
            })
        };
        all.map(colour).collect()
    }
}

/// `#RRGGBB` or `#RRGGBBAA`, sRGB-encoded, as linear RGBA.
fn colour(text: &str) -> Option<[f32; 4]> {
    let digits = text.strip_prefix('#')?;
    let is_hex = digits.bytes().all(|b| b.is_ascii_hexdigit());
    if !is_hex || !matches!(digits.len(), 6 | 8) {
        return None;
    }
    let part = |i: usize| match digits.get(2 * i..2 * i + 2) {
        Some(pair) => u8::from_str_radix(pair, 16).ok(),
        None => Some(u8::MAX),
    };
    let [r, g, b, a] = [part(0)?, part(1)?, part(2)?, part(3)?].map(|byte| f32::from(byte) / 255.0);
    let [r, g, b] = [r, g, b].map(linear_from_srgb);
    Some([r, g, b, a])
}
