//! Decodes primitives that are packed by `KHR_draco_mesh_compression`.
//!
//! | key of the extension | contents |
//! |---|---|
//! | `bufferView` | view with the packed mesh: triangles, and attributes of their vertices |
//! | `attributes` | for names of attributes (`POSITION`, `TEXCOORD_0`), the identifier of the packed one |
//!
//! The primitive's accessors state the types and numbers of the attributes and the indices; they need no bytes.
//! Attributes that the extension does not name are not packed.
//!
//! Source: the text of the extension in Khronos' registry. The crate `draco-core` decodes.

use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};

use super::DRACO;
use super::accessor::{Accessor, ComponentType, Stated};
use super::container::Buffers;
use super::document::Object;
use crate::error::Result;
use crate::io::vtk::xml::clip;

/// Number of triangles that any file may have.
const FACES: usize = 1 << 17;

/// Additional triangles per byte of a packed mesh. Large meshes use about two bits per triangle.
const FACES_PER_BYTE: usize = 8;

/// Packed part of a primitive.
pub(super) struct Primitive<'b> {
    /// Identifiers of the packed attributes, by name.
    attributes: Option<Object<'b>>,
    mesh: &'b Mesh,
}

impl<'b> Primitive<'b> {
    /// Returns the packed mesh of a primitive, if it has one.
    ///
    /// # Errors
    /// The view does not exist, or the mesh is damaged or too large for the file's bytes.
    pub(super) fn of(
        buffers: &'b Buffers<'_>,
        primitive: Object<'b>,
        place: &str,
    ) -> Result<Option<Self>> {
        let Some(stated) = primitive.extension(DRACO) else {
            return Ok(None);
        };
        let place = format!("{place}, {DRACO}");
        let view = stated.index("bufferView")?;
        let view = view.ok_or_else(|| buffers.refuse(&place, "a `bufferView`", "none"))?;
        let mesh = buffers.packed_mesh(view, |bytes| unpack(buffers, bytes, &place))?;
        Ok(Some(Self {
            attributes: stated.object("attributes")?,
            mesh,
        }))
    }

    /// Returns the elements of an attribute, or of the `indices`.
    ///
    /// # Errors
    /// The packed mesh lacks the attribute, or has another number of components for it.
    pub(super) fn open(
        &self,
        buffers: &'b Buffers<'_>,
        name: &str,
        stated: Stated<'b>,
    ) -> Result<Accessor<'b>> {
        if name == "indices" {
            let corners = self.mesh.faces().iter().flatten();
            let bytes = corners.flat_map(|corner| corner.0.to_le_bytes()).collect();
            return Ok(stated.with_elements(bytes, ComponentType::U32));
        }
        let id = match self.attributes {
            Some(attributes) => attributes.integer(name)?,
            None => None,
        };
        let Some(id) = id else {
            return stated.open(buffers);
        };
        let attribute = u32::try_from(id).ok();
        let attribute = attribute.and_then(|id| self.mesh.attribute_by_unique_id(id));
        let width = attribute.map_or(0, |a| usize::from(a.num_components()));
        let (Some(attribute), true) = (attribute, width == stated.width) else {
            let expected = format!("{} components of a packed attribute", stated.width);
            let found = format!("{width} of attribute {id}");
            return Err(buffers.refuse(stated.place, expected, found));
        };
        let numbers = attribute.read_f32s(self.mesh.num_points(), width);
        let component = stated.component;
        let mut bytes = Vec::with_capacity(numbers.len() * component.size());
        append(&mut bytes, &numbers, component);
        Ok(stated.with_elements(bytes, component))
    }
}

/// Unpacks a mesh.
fn unpack(buffers: &Buffers<'_>, bytes: &[u8], place: &str) -> Result<Mesh> {
    let faces = FACES.saturating_add(bytes.len().saturating_mul(FACES_PER_BYTE));
    let limits = DecodeLimits::default()
        .with_max_faces(faces as u64)
        .with_max_points(3 * faces as u64)
        .with_max_decoded_bytes(buffers.room_to_unpack() as u64);
    let mut mesh = Mesh::new();
    let mut source = DecoderBuffer::new(bytes).with_limits(limits);
    MeshDecoder::new()
        .decode(&mut source, &mut mesh)
        .map_err(|error| {
            let found = clip(&error.to_string());
            buffers.refuse(place, "a mesh packed by Draco", found)
        })?;
    let point_count = mesh.num_points();
    if point_count > 3 * faces {
        let expected = format!("{} vertices at most", 3 * faces);
        return Err(buffers.refuse(place, expected, point_count.to_string()));
    }
    let mut values = 12 * mesh.num_faces();
    for id in 0..mesh.num_attributes() {
        values += mesh.attribute(id).buffer().data().len();
    }
    buffers.count_unpacked(values);
    Ok(mesh)
}

/// Appends numbers, stored as `component`.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers that a file stores in a smaller type than it says itself are held to that"
)]
fn append(bytes: &mut Vec<u8>, numbers: &[f32], component: ComponentType) {
    for &x in numbers {
        match component {
            ComponentType::I8 => bytes.extend((x as i8).to_le_bytes()),
            ComponentType::U8 => bytes.push(x as u8),
            ComponentType::I16 => bytes.extend((x as i16).to_le_bytes()),
            ComponentType::U16 => bytes.extend((x as u16).to_le_bytes()),
            ComponentType::U32 => bytes.extend((x as u32).to_le_bytes()),
            ComponentType::F32 => bytes.extend(x.to_le_bytes()),
        }
    }
}
