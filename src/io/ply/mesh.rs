//! Reads meshes in PLY files: the meaning of their elements and properties. `header.rs` and `body.rs` have the
//! parser.
//!
//! | element | property | meaning |
//! |---|---|---|
//! | `vertex` | `x`, `y`, `z` | corners |
//! | | `red`, `green`, `blue`, `alpha`, or other names of colours | colours: see [`crate::data::colour_columns`] |
//! | | `nx`, `ny`, `nz` | normals |
//! | | `s`, `t`, or `u`, `v`, or `texture_u`, `texture_v`, or `texture_s`, `texture_t` | texture coordinates, v upwards |
//! | `face` | the list `vertex_indices` or `vertex_index` | a polygon of any size, concave ones too |
//! | | the list `texcoord` | u and v of each of its corners, in place of the vertices' |
//! | | `texnumber` | index of one of several textures, from 0 |
//! | | `red`, `green`, `blue`, `alpha`, or other names of colours | the colour of the whole polygon, if vertices have none |
//! | `tristrips` | the list `vertex_indices` or `vertex_index` | strips of triangles, one after another with -1 between them |
//!
//! Comments `TextureFile NAME` name textures. PLY does not state its units and axes, nor whether a surface is
//! seen from behind: a surface that is closed with its front outwards is not (see [`crate::io::mesh::closed`]).

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use glam::{Affine2, DVec3, Vec2, Vec3};

use super::header::{Element, Kind};
use super::table::Table;
use crate::data::colour_columns::{
    COLOUR_SETS, ColourNumbers, ColourScale, ColourSet, colour_sets,
};
use crate::data::dataset::{Dataset, Geometry};
use crate::data::mesh::{AlphaMode, Mesh, MeshPart, Texture, TextureUse, Wrap};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::io::bytes::scalars::ScalarType;
use crate::io::mesh::closed::are_closed;
use crate::io::mesh::mesh_part::{LeftOut, check_not_empty, finish, plain};
use crate::io::mesh::polygons::{approximate_note, strip, triangles};
use crate::io::mesh::texture::ImageBudget;
use crate::io::particles::table::list;
use crate::scene::Values;

const FORMAT: &str = "PLY mesh";

/// The polygons of a file, collected while its body is read.
#[derive(Debug)]
pub(in crate::io) struct Faces {
    vertex_count: usize,
    /// The properties that describe faces: element index, property index, role.
    roles: Vec<(usize, usize, Role)>,
    /// The element whose rows are being read.
    element: usize,
    /// Vertices of all polygons; strips are triangles already.
    corners: Vec<u32>,
    /// End of each polygon in `corners`.
    ends: Vec<usize>,
    /// u and v of corners, one after the other.
    coordinates: Vec<f32>,
    /// End of each polygon in `coordinates`.
    coordinate_ends: Vec<usize>,
    /// The texture index of each polygon.
    texture_numbers: Vec<u32>,
    /// Columns of the polygons' colour and opacity.
    channels: Vec<Channel>,
}

/// A column of the polygons' colours.
#[derive(Debug)]
struct Channel {
    name: &'static str,
    /// Indices of its element and its property; then the property's type.
    property: (usize, usize),
    scalar: ScalarType,
    numbers: Vec<f32>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    Polygon,
    Strips,
    Coordinates,
    TextureNumber,
    Channel,
}

impl Faces {
    /// Finds the properties of faces in a file with `vertex_count` vertices; `None` if it has none.
    pub(in crate::io) fn of(elements: &[Element], vertex_count: usize) -> Option<Self> {
        let mut roles = Vec::new();
        let mut channels: Vec<Channel> = Vec::new();
        for (e, element) in elements.iter().enumerate().filter(|(_, e)| e.count > 0) {
            for (p, property) in element.properties.iter().enumerate() {
                let is_list = matches!(property.kind, Kind::List { .. });
                let role = match (element.name.as_str(), property.name.as_str(), is_list) {
                    ("face", "vertex_indices" | "vertex_index", true) => Role::Polygon,
                    ("tristrips", "vertex_indices" | "vertex_index", true) => Role::Strips,
                    ("face", "texcoord", true) => Role::Coordinates,
                    ("face", "texnumber", false) => Role::TextureNumber,
                    ("face", name, false) => {
                        let mut names = COLOUR_SETS
                            .iter()
                            .flat_map(|set| set.names.into_iter().chain([set.alpha]));
                        let known = names.find(|known| known.eq_ignore_ascii_case(name));
                        if let (Some(name), Kind::Scalar(scalar)) = (known, property.kind)
                            && !channels.iter().any(|c| c.name == name)
                        {
                            channels.push(Channel {
                                name,
                                property: (e, p),
                                scalar,
                                numbers: Vec::new(),
                            });
                            roles.push((e, p, Role::Channel));
                        }
                        continue;
                    }
                    _ => continue,
                };
                // A second list of the same name is ignored.
                if !roles.iter().any(|(_, _, known)| *known == role) {
                    roles.push((e, p, role));
                }
            }
        }
        let has_faces = roles
            .iter()
            .any(|(_, _, role)| matches!(role, Role::Polygon | Role::Strips));
        has_faces.then(|| Self {
            vertex_count,
            roles,
            element: 0,
            corners: Vec::new(),
            ends: Vec::new(),
            coordinates: Vec::new(),
            coordinate_ends: Vec::new(),
            texture_numbers: Vec::new(),
            channels,
        })
    }

    /// Starts an element, whose rows [`Faces::take`] gets next. Returns whether any property of it is used.
    pub(in crate::io) fn begin(&mut self, element: usize) -> bool {
        self.element = element;
        self.roles.iter().any(|(e, _, _)| *e == element)
    }

    fn role(&self, property: usize) -> Option<Role> {
        let same = |(e, p, _): &&(usize, usize, Role)| (*e, *p) == (self.element, property);
        self.roles.iter().find(same).map(|(_, _, role)| *role)
    }

    /// Whether a property of the element is used.
    pub(in crate::io) fn wants(&self, property: usize) -> bool {
        self.role(property).is_some()
    }

    /// Stores the numbers of one property of a row.
    ///
    /// # Errors
    /// A vertex that does not exist: expected, found.
    pub(in crate::io) fn take(
        &mut self,
        property: usize,
        items: &[f64],
    ) -> Result<(), (String, String)> {
        match self.role(property) {
            Some(Role::Polygon) => {
                for &item in items {
                    let corner = self.vertex(item)?;
                    self.corners.push(corner);
                }
                self.ends.push(self.corners.len());
            }
            Some(Role::Strips) => {
                // -1, or the same bits as an unsigned number.
                let is_end = |item: &f64| *item < 0.0 || *item == f64::from(u32::MAX);
                let mut triangles = Vec::new();
                for run in items.split(is_end) {
                    let run = run.iter().map(|&item| self.vertex(item));
                    strip(&run.collect::<Result<Vec<u32>, _>>()?, &mut triangles);
                }
                for triangle in triangles {
                    self.corners.extend(triangle);
                    self.ends.push(self.corners.len());
                }
            }
            Some(Role::Coordinates) => {
                let items = items.iter().copied();
                self.coordinates.extend(items.map(crate::math::narrowed));
                self.coordinate_ends.push(self.coordinates.len());
            }
            Some(Role::TextureNumber) => {
                let number = items.first().copied().and_then(whole);
                self.texture_numbers.push(number.unwrap_or(u32::MAX));
            }
            Some(Role::Channel) => {
                let place = (self.element, property);
                let channel = self.channels.iter_mut().find(|c| c.property == place);
                if let (Some(channel), Some(&number)) = (channel, items.first()) {
                    channel.numbers.push(crate::math::narrowed(number));
                }
            }
            None => {}
        }
        Ok(())
    }

    /// The colours of polygons, one each, linear; empty if they have none.
    fn colours(&mut self, notes: &mut Vec<String>) -> Vec<[f32; 4]> {
        let count = self.ends.len();
        let channels = std::mem::take(&mut self.channels);
        // As many as polygons, unless these include strips.
        if channels.iter().any(|c| c.numbers.len() != count) {
            notes.push("colours of faces are not one for each: not used".into());
            return Vec::new();
        }
        let columns: Vec<(&str, Values)> = channels
            .into_iter()
            .map(|channel| (channel.name, channel.values()))
            .collect();
        let find = |name: &str| columns.iter().find(|(own, _)| *own == name).map(|(_, v)| v);
        let sets = colour_sets(find);
        let Some(&(set, channels)) = sets.first() else {
            return Vec::new();
        };
        linear_colours("faces", set, channels, find(set.alpha), notes)
    }

    fn vertex(&self, item: f64) -> Result<u32, (String, String)> {
        let vertex = whole(item).filter(|&i| (i as usize) < self.vertex_count);
        vertex.ok_or_else(|| {
            let expected = format!("vertices among {}, counted from 0", self.vertex_count);
            (expected, format!("vertex {item}"))
        })
    }

    /// Discards texture coordinates that are not two for each corner of each polygon, and texture indices that
    /// are not one for each polygon.
    fn check(&mut self, notes: &mut Vec<String>) {
        let fit = self.ends.len() == self.coordinate_ends.len()
            && (self.ends.iter().zip(&self.coordinate_ends)).all(|(e, c)| 2 * e == *c);
        if !fit {
            if !self.coordinates.is_empty() {
                notes.push(
                    "texture coordinates of faces are not two for each corner: not used".into(),
                );
            }
            self.coordinates.clear();
        }
        if self.texture_numbers.len() != self.ends.len() {
            self.texture_numbers.clear();
        }
    }
}

impl Channel {
    /// The column; in the file's type, if that decides which number means 1.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "these numbers were of this type"
    )]
    fn values(self) -> Values {
        match self.scalar {
            ScalarType::U8 => Values::U8(self.numbers.iter().map(|x| *x as u8).collect()),
            ScalarType::U16 => Values::U16(self.numbers.iter().map(|x| *x as u16).collect()),
            _ => Values::F32(self.numbers),
        }
    }
}

/// Linear RGBA from columns of colours, which may have non-finite numbers; notes state assumptions.
///
/// - `noun`: the objects with the colours, in the plural.
fn linear_colours(
    noun: &str,
    set: &ColourSet,
    channels: [&Values; 3],
    alpha: Option<&Values>,
    notes: &mut Vec<String>,
) -> Vec<[f32; 4]> {
    let scale = ColourScale::of(Some(set), ColourNumbers::of(channels));
    if let Some(assumed) = scale.assumed() {
        notes.push(format!("colours of {noun} {assumed}"));
    }
    let of_alpha = alpha.map(|alpha| (alpha, ColourScale::of(None, ColourNumbers::of([alpha]))));
    // Some programs without opacity write 0, with which nothing would be visible.
    let is_unseen = |alpha: &Values| alpha.finite_range().is_some_and(|[_, hi]| hi <= 0.0);
    let of_alpha = of_alpha.filter(|(alpha, _)| {
        let is_unseen = is_unseen(alpha);
        if is_unseen {
            notes.push(format!("the opacity of all {noun} is 0 and is not used"));
        }
        !is_unseen
    });
    let opacity = |i: usize| match of_alpha {
        Some((alpha, scale)) => scale.share(alpha.get(i)).clamp(0.0, 1.0),
        None => 1.0,
    };
    (0..channels[0].len())
        .map(|i| {
            let [r, g, b] = channels.map(|c| scale.linear(c.get(i)));
            [r, g, b, opacity(i)]
        })
        .collect()
}

/// A whole number from 0 on; `None` for any other.
fn whole(number: f64) -> Option<u32> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the range of the type, and compared after"
    )]
    let rounded = (0.0..=f64::from(u32::MAX))
        .contains(&number)
        .then_some(number as u32);
    rounded.filter(|&n| f64::from(n) == number)
}

/// Positions and properties of vertices; a property that they lack is empty.
#[derive(Debug)]
struct Vertices {
    positions: Vec<DVec3>,
    colours: Vec<[f32; 4]>,
    normals: Vec<Vec3>,
    coordinates: Vec<Vec2>,
}

/// Makes a mesh from its vertices and faces.
///
/// - `comments`: of the header.
/// - `texture`: the user's image, for meshes with texture coordinates and no texture.
///
/// # Errors
/// No positions, no triangle with an area, or a `texture` that cannot be read. Unreadable textures that the
/// file names are noted.
pub(in crate::io) fn dataset(
    input: Input<'_>,
    table: &Table<'_>,
    mut faces: Faces,
    comments: &[String],
    texture: Option<&Path>,
    mut notes: Vec<String>,
) -> Result<Dataset> {
    faces.check(&mut notes);
    let vertices = Vertices::read(table, &mut notes)?;
    let mut face_colours = faces.colours(&mut notes);
    if !(face_colours.is_empty() || vertices.colours.is_empty()) {
        notes.push("colours of faces are not used beside those of vertices".into());
        face_colours.clear();
    }
    let has_coordinates = !(faces.coordinates.is_empty() && vertices.coordinates.is_empty());
    let mut images = ImageBudget::default();
    let mut mesh = Mesh::default();
    let add = |mesh: &mut Mesh, image| {
        mesh.textures.push(Texture {
            image: Arc::new(image),
            wrap: [Wrap::Repeat; 2],
        });
        mesh.textures.len() - 1
    };
    let fallback = match texture {
        Some(path) => Some(images.named_by_user(input, path)?),
        None => None,
    };
    let fallback = fallback.map(|image| add(&mut mesh, image));
    let names = comments.iter().filter_map(|c| texture_file(c));
    let mut named = Vec::new();
    for name in names {
        if !has_coordinates {
            notes
                .push("it names textures and has no texture coordinates: they are not used".into());
            break;
        }
        let image = images.named(input, name);
        let image = image.map_err(|note| notes.push(note)).ok();
        named.push(image.map(|image| add(&mut mesh, image)));
    }
    notes.append(&mut images.notes);

    let mut approximate = 0;
    for (number, group) in groups(faces, face_colours, named.len()) {
        let mut part = group.part(&vertices, &mut approximate);
        let texture = named.get(number).copied().flatten().or(fallback);
        let texture = texture.filter(|_| has_coordinates);
        part.material = mesh.materials.len();
        let mut material = plain(!part.colours.is_empty() || texture.is_some());
        match texture {
            Some(texture) => {
                if !part.colours.is_empty() {
                    notes.push("colours are not used beside the texture".into());
                    part.colours.clear();
                }
                material.base_texture = Some(TextureUse {
                    texture,
                    coordinates: 0,
                    transform: Affine2::IDENTITY,
                });
            }
            None => part.texture_coordinates.clear(),
        }
        if part.colours.iter().any(|c| c[3] < 1.0) {
            material.alpha = AlphaMode::Blend;
        }
        mesh.materials.push(material);
        mesh.parts.push(part);
    }
    notes.extend(approximate_note(approximate));
    let are_closed = are_closed(&mesh.parts);
    let mut left_out = LeftOut::default();
    for (part, is_closed) in mesh.parts.iter_mut().zip(are_closed) {
        mesh.materials[part.material].is_double_sided = !is_closed;
        finish(part, &mut left_out);
    }
    notes.extend(left_out.notes());
    notes.dedup();
    mesh.parts.retain(|part| !part.triangles.is_empty());
    check_not_empty(table.path, &mesh)?;
    let mut data = Dataset::new(table.path, FORMAT, Geometry::Mesh(mesh), Vec::new());
    data.notes = notes;
    Ok(data)
}

/// The file that a comment names as a texture.
fn texture_file(comment: &str) -> Option<&str> {
    let (word, name) = comment.split_once(char::is_whitespace)?;
    word.eq_ignore_ascii_case("TextureFile")
        .then(|| name.trim())
        .filter(|name| !name.is_empty())
}

/// Polygons of one texture.
#[derive(Debug, Default)]
struct Group {
    corners: Vec<u32>,
    ends: Vec<usize>,
    /// u and v for each corner, or nothing.
    coordinates: Vec<f32>,
    /// The colour of each polygon, or nothing.
    colours: Vec<[f32; 4]>,
    /// Whether corners are renumbered: the group has only some of the polygons, or vertices have another
    /// texture position or another colour in each polygon.
    is_renumbered: bool,
}

/// Groups the polygons by their textures, of which there are `texture_count`.
///
/// - `colours`: the colour of each polygon, or none.
fn groups(faces: Faces, colours: Vec<[f32; 4]>, texture_count: usize) -> Vec<(usize, Group)> {
    if texture_count < 2 || faces.texture_numbers.is_empty() {
        let whole = Group {
            is_renumbered: !(faces.coordinates.is_empty() && colours.is_empty()),
            colours,
            corners: faces.corners,
            ends: faces.ends,
            coordinates: faces.coordinates,
        };
        return vec![(0, whole)];
    }
    // The last group has the polygons without a valid texture.
    let mut groups: Vec<Group> = Vec::new();
    groups.resize_with(texture_count + 1, Group::default);
    let mut start = 0;
    for (i, (&end, &number)) in faces.ends.iter().zip(&faces.texture_numbers).enumerate() {
        let group = &mut groups[texture_count.min(number as usize)];
        group.is_renumbered = true;
        group.corners.extend_from_slice(&faces.corners[start..end]);
        group.ends.push(group.corners.len());
        group.colours.extend(colours.get(i));
        if !faces.coordinates.is_empty() {
            let coordinates = &faces.coordinates[2 * start..2 * end];
            group.coordinates.extend_from_slice(coordinates);
        }
        start = end;
    }
    let numbered = groups.into_iter().enumerate();
    numbered.filter(|(_, g)| !g.ends.is_empty()).collect()
}

impl Group {
    /// The polygons as triangles; `approximate` counts those replaced by a fan.
    fn part(self, vertices: &Vertices, approximate: &mut usize) -> MeshPart {
        let mut part = MeshPart::default();
        let mut coordinates = Vec::new();
        let mut indices = self.corners;
        if self.is_renumbered {
            let (uvs, _) = self.coordinates.as_chunks::<2>();
            let mut index_of: HashMap<(u32, [u32; 2], [u32; 4]), u32> = HashMap::new();
            let mut polygon = 0;
            for (i, index) in indices.iter_mut().enumerate() {
                while self.ends.get(polygon).is_some_and(|end| *end <= i) {
                    polygon += 1;
                }
                let colour = self.colours.get(polygon);
                let uv = uvs.get(i).map(|uv| Vec2::new(uv[0], 1.0 - uv[1]));
                let of_uv = uv.unwrap_or_default().to_array().map(f32::to_bits);
                let of_colour = colour.copied().unwrap_or_default().map(f32::to_bits);
                let next = u32::try_from(index_of.len()).unwrap_or(u32::MAX);
                let vertex = *index as usize;
                *index = *index_of.entry((*index, of_uv, of_colour)).or_insert(next);
                if *index < next {
                    continue;
                }
                part.positions.push(vertices.positions[vertex]);
                part.colours.extend(colour.or(vertices.colours.get(vertex)));
                part.normals.extend(vertices.normals.get(vertex));
                coordinates.extend(uv.or(vertices.coordinates.get(vertex).copied()));
            }
        } else {
            part.positions.clone_from(&vertices.positions);
            part.colours.clone_from(&vertices.colours);
            part.normals.clone_from(&vertices.normals);
            coordinates.clone_from(&vertices.coordinates);
        }
        if !coordinates.is_empty() {
            part.texture_coordinates.push(coordinates);
        }
        part.triangles = triangles(&indices, &self.ends, &part.positions, approximate);
        part
    }
}

impl Vertices {
    /// Reads the columns that a mesh uses; notes name the others.
    fn read(table: &Table<'_>, notes: &mut Vec<String>) -> Result<Self> {
        let (positions, mut used) = table.positions()?;
        let mut columns = |names: &[&str]| -> Result<Option<Vec<Vec<f32>>>> {
            let members: Option<Vec<usize>> = names.iter().map(|name| table.index(name)).collect();
            let Some(members) = members else {
                return Ok(None);
            };
            used.extend(&members);
            let columns: Result<_> = members.into_iter().map(|m| table.floats(m)).collect();
            columns.map(Some)
        };
        let mut vertices = Self {
            positions,
            colours: Vec::new(),
            normals: Vec::new(),
            coordinates: Vec::new(),
        };
        for names in [
            ["s", "t"],
            ["u", "v"],
            ["texture_u", "texture_v"],
            ["texture_s", "texture_t"],
        ] {
            if let Some([u, v]) = columns(&names)?.as_deref() {
                // v is upwards in the file.
                let pairs = u.iter().zip(v).map(|(&u, &v)| Vec2::new(u, 1.0 - v));
                vertices.coordinates = pairs.collect();
                break;
            }
        }
        if let Some([x, y, z]) = columns(&["nx", "ny", "nz"])?.as_deref() {
            let normals = x
                .iter()
                .zip(y)
                .zip(z)
                .map(|((&x, &y), &z)| Vec3::new(x, y, z));
            vertices.normals = normals.collect();
        }
        let find = |name: &str| table.index_of(name);
        if let Some((set, members)) = colour_sets(find).first() {
            let mut column = |member: usize| {
                used.push(member);
                table.values(member)
            };
            let channels: Result<Vec<Values>> = members.iter().map(|m| column(*m)).collect();
            let alpha = find(set.alpha).map(column).transpose()?;
            if let [r, g, b] = channels?.as_slice() {
                let channels = [r, g, b];
                vertices.colours = linear_colours("vertices", set, channels, alpha.as_ref(), notes);
            }
        }
        let members = table.rows.members.iter().enumerate();
        let others = members.filter(|(i, _)| !used.contains(i));
        let mut others = others.map(|(_, member)| member.name.as_str()).peekable();
        if others.peek().is_some() {
            notes.push(format!(
                "columns of a mesh's vertices are not shown: {}",
                list(others)
            ));
        }
        Ok(vertices)
    }
}
