//! Reads primitives: the triangles, lines and points of meshes.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3, Vec2};

use super::accessor::{ANY_NUMBERS, Accessor, ComponentType, INDICES, Stated, Type};
use super::container::Buffers;
use super::document::Object;
use crate::data::mesh::MeshPart;
use crate::error::Result;
use crate::math::narrowed;

/// Elements of a primitive in the space of its mesh, morphed and not yet transformed to the world.
pub(super) struct Shape {
    /// Positions, elements, texture coordinates and colours, restricted to the vertices in use.
    part: MeshPart,
    /// Normals, of any length.
    normals: Vec<DVec3>,
    /// Joints and their weights for each vertex; empty without a skin.
    influences: Vec<Vec<(usize, f64)>>,
}

/// Assembly of vertices to elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Points,
    Lines,
    LineLoop,
    LineStrip,
    Triangles,
    TriangleStrip,
    TriangleFan,
}

impl Mode {
    /// All modes, in the order of their codes.
    const ALL: [Self; 7] = [
        Self::Points,
        Self::Lines,
        Self::LineLoop,
        Self::LineStrip,
        Self::Triangles,
        Self::TriangleStrip,
        Self::TriangleFan,
    ];
}

/// Primitive of a mesh, and its name in messages.
pub(super) struct PrimitiveReader<'b, 'f> {
    pub(super) buffers: &'b Buffers<'f>,
    pub(super) primitive: Object<'b>,
    pub(super) place: String,
    /// Data packed by `KHR_draco_mesh_compression`.
    #[cfg(feature = "draco")]
    pub(super) draco: Option<super::draco::Primitive<'b>>,
}

impl<'b> PrimitiveReader<'b, '_> {
    /// Returns the accessor of an attribute.
    fn attribute(&self, name: &str) -> Result<Option<usize>> {
        match self.primitive.object("attributes")? {
            Some(attributes) => attributes.index(name),
            None => Ok(None),
        }
    }

    fn open(
        &self,
        accessor: usize,
        name: &str,
        types: &[Type],
        components: &[ComponentType],
    ) -> Result<Accessor<'b>> {
        let place = format!("{}, {name}", self.place);
        let stated = Stated::find(self.buffers, accessor, &place, types, components)?;
        #[cfg(feature = "draco")]
        if let Some(draco) = &self.draco {
            return draco.open(self.buffers, name, stated);
        }
        stated.open(self.buffers)
    }

    /// Returns the mode in which vertices are assembled.
    ///
    /// # Errors
    /// The format has no such mode.
    fn mode(&self) -> Result<Mode> {
        let code = self.primitive.index("mode")?.unwrap_or(4);
        let mode = *Mode::ALL.get(code).ok_or_else(|| {
            let place = format!("{}, mode", self.place);
            self.buffers.refuse(place, "0 to 6", code.to_string())
        })?;
        #[cfg(feature = "draco")]
        if self.draco.is_some() {
            // The Draco decoder returns strips as triangles.
            return Ok(Mode::Triangles);
        }
        Ok(mode)
    }

    /// Opens an attribute, which must have as many elements as there are positions.
    fn vertices(
        &self,
        name: &str,
        types: &[Type],
        components: &[ComponentType],
        count: usize,
    ) -> Result<Option<Accessor<'b>>> {
        let Some(accessor) = self.attribute(name)? else {
            return Ok(None);
        };
        let accessor = self.open(accessor, name, types, components)?;
        self.check_count(name, accessor.len(), count)?;
        Ok(Some(accessor))
    }

    fn check_count(&self, name: &str, found: usize, count: usize) -> Result<()> {
        if found >= count {
            return Ok(());
        }
        let place = format!("{}, {name}", self.place);
        let expected = format!("{count} elements, as many as positions");
        Err(self.buffers.refuse(place, expected, found.to_string()))
    }

    /// Returns true if it has a set of texture coordinates.
    pub(super) fn has_set(&self, set: u32) -> bool {
        matches!(self.attribute(&format!("TEXCOORD_{set}")), Ok(Some(_)))
    }

    /// Returns the total number of corners of its triangles, lines and points.
    ///
    /// # Errors
    /// There are no positions, or accessors do not exist.
    pub(super) fn corner_count(&self) -> Result<usize> {
        let count = match self.primitive.index("indices")? {
            Some(accessor) => self
                .open(accessor, "indices", &[Type::Scalar], INDICES)?
                .len(),
            None => self.positions()?.len(),
        };
        Ok(match self.mode()? {
            Mode::Triangles | Mode::Lines | Mode::Points => count,
            Mode::TriangleStrip | Mode::TriangleFan => 3 * count.saturating_sub(2),
            Mode::LineLoop | Mode::LineStrip => 2 * count,
        })
    }

    fn positions(&self) -> Result<Accessor<'b>> {
        let accessor = self.attribute("POSITION")?.ok_or_else(|| {
            let expected = "an attribute POSITION";
            self.buffers.refuse(self.place.clone(), expected, "none")
        })?;
        self.open(accessor, "POSITION", &[Type::Vec3], ANY_NUMBERS)
    }

    /// Returns a part with only its triangles, lines and points, as indices of vertices.
    fn elements(&self, vertex_count: usize) -> Result<MeshPart> {
        let indices: Vec<u32> = match self.primitive.index("indices")? {
            Some(accessor) => {
                let accessor = self.open(accessor, "indices", &[Type::Scalar], INDICES)?;
                (0..accessor.len()).map(|i| accessor.index(i)).collect()
            }
            None => {
                let count = u32::try_from(vertex_count).unwrap_or(u32::MAX);
                (0..count).collect()
            }
        };
        if let Some(index) = indices.iter().find(|i| **i as usize >= vertex_count) {
            let place = format!("{}, indices", self.place);
            let expected = format!("indices of {vertex_count} vertices");
            return Err(self.buffers.refuse(place, expected, index.to_string()));
        }
        let mode = self.mode()?;
        let is_strip = mode == Mode::TriangleStrip;
        let mut part = MeshPart {
            is_flat: true,
            ..MeshPart::default()
        };
        match mode {
            Mode::TriangleStrip | Mode::TriangleFan => {
                let triangles = indices.windows(3).enumerate();
                let triangles = triangles.map(|(i, w)| match (is_strip, i % 2) {
                    (true, 0) => [w[0], w[1], w[2]],
                    (true, _) => [w[0], w[2], w[1]],
                    (false, _) => [w[1], w[2], indices[0]],
                });
                // Degenerate triangles, which join strips, are dropped.
                part.triangles = triangles
                    .filter(|[a, b, c]| a != b && b != c && c != a)
                    .collect();
            }
            Mode::Triangles => part.triangles = indices.as_chunks::<3>().0.to_vec(),
            Mode::Lines => part.lines = indices.as_chunks::<2>().0.to_vec(),
            Mode::LineStrip | Mode::LineLoop => {
                part.lines = indices.windows(2).map(|w| [w[0], w[1]]).collect();
                if let (Mode::LineLoop, [first, .., last]) = (mode, &*indices) {
                    part.lines.push([*last, *first]);
                }
            }
            Mode::Points => part.points = indices,
        }
        Ok(part)
    }

    /// Reads the primitive with these weights of morph targets and these sets of texture coordinates.
    ///
    /// # Errors
    /// An accessor has the wrong type, is shorter than it states, or has fewer elements than there are positions.
    pub(super) fn read(
        &self,
        weights: &[f64],
        sets: [Option<u32>; 2],
        joint_count: Option<usize>,
    ) -> Result<Shape> {
        let positions = self.positions()?;
        let count = positions.len();
        let mut part = self.elements(count)?;
        let used = gather(&mut part);
        let point = |accessor: &Accessor<'_>, i: usize| DVec3::from_array(accessor.numbers(i));

        let vec3 = [Type::Vec3];
        let normals = self.vertices("NORMAL", &vec3, ANY_NUMBERS, count)?;
        let mut shape = Shape {
            part: MeshPart {
                positions: used.iter().map(|&i| point(&positions, i)).collect(),
                ..part
            },
            normals: normals.map_or(Vec::new(), |normals| {
                used.iter().map(|&i| point(&normals, i)).collect()
            }),
            influences: Vec::new(),
        };
        self.morph(&mut shape, weights, &used, count)?;

        if let Some(last) = sets.iter().rposition(Option::is_some) {
            shape.part.texture_coordinates = vec![Vec::new(); last + 1];
        }
        for (coordinates, set) in shape.part.texture_coordinates.iter_mut().zip(sets) {
            let Some(set) = set else { continue };
            let name = format!("TEXCOORD_{set}");
            if let Some(accessor) = self.vertices(&name, &[Type::Vec2], ANY_NUMBERS, count)? {
                let uv = |&i: &usize| Vec2::from_array(accessor.numbers::<2>(i).map(narrowed));
                *coordinates = used.iter().map(uv).collect();
            }
        }
        let types = [Type::Vec3, Type::Vec4];
        if let Some(colours) = self.vertices("COLOR_0", &types, ANY_NUMBERS, count)? {
            let is_opaque = colours.width() < 4;
            let rgba = |&i: &usize| {
                let mut rgba = colours.numbers::<4>(i).map(narrowed);
                if is_opaque {
                    rgba[3] = 1.0;
                }
                rgba
            };
            shape.part.colours = used.iter().map(rgba).collect();
        }
        if let Some(joint_count) = joint_count {
            shape.influences = self.influences(&used, count, joint_count)?;
        }
        Ok(shape)
    }

    /// Adds the morph targets, multiplied by their weights.
    fn morph(
        &self,
        shape: &mut Shape,
        weights: &[f64],
        used: &[usize],
        count: usize,
    ) -> Result<()> {
        let targets = self.primitive.objects("targets")?;
        for (t, (target, &weight)) in targets.into_iter().zip(weights).enumerate() {
            if weight == 0.0 {
                continue;
            }
            let add = |name: &str, to: &mut [DVec3]| {
                let accessor = target.index(name)?.filter(|_| !to.is_empty());
                let Some(accessor) = accessor else {
                    return Ok(());
                };
                let name = format!("target {t}, {name}");
                let accessor = self.open(accessor, &name, &[Type::Vec3], ANY_NUMBERS)?;
                self.check_count(&name, accessor.len(), count)?;
                for (point, &i) in to.iter_mut().zip(used) {
                    *point += weight * DVec3::from_array(accessor.numbers(i));
                }
                Ok(())
            };
            add("POSITION", &mut shape.part.positions)?;
            add("NORMAL", &mut shape.normals)?;
        }
        Ok(())
    }

    /// Returns the joints that move each vertex, with weights that sum to 1.
    fn influences(
        &self,
        used: &[usize],
        count: usize,
        joint_count: usize,
    ) -> Result<Vec<Vec<(usize, f64)>>> {
        let mut influences = vec![Vec::new(); used.len()];
        for set in 0.. {
            let types = [Type::Vec4];
            let kinds = [ComponentType::U8, ComponentType::U16];
            let joints = self.vertices(&format!("JOINTS_{set}"), &types, &kinds, count)?;
            let weights = self.vertices(&format!("WEIGHTS_{set}"), &types, ANY_NUMBERS, count)?;
            let (Some(joints), Some(weights)) = (joints, weights) else {
                if set == 0 {
                    return Ok(Vec::new());
                }
                break;
            };
            for (of_corner, &i) in influences.iter_mut().zip(used) {
                let weights = weights.numbers::<4>(i);
                for (joint, weight) in joints.indices(i).into_iter().zip(weights) {
                    if !(weight > 0.0) {
                        continue;
                    }
                    let joint = joint as usize;
                    if joint >= joint_count {
                        let place = format!("{}, JOINTS_{set}", self.place);
                        let expected = format!("some of {joint_count} joints");
                        return Err(self.buffers.refuse(place, expected, joint.to_string()));
                    }
                    of_corner.push((joint, weight));
                }
            }
        }
        for of_corner in &mut influences {
            let sum: f64 = of_corner.iter().map(|(_, w)| w).sum();
            of_corner.iter_mut().for_each(|(_, w)| *w /= sum);
        }
        Ok(influences)
    }
}

/// Renumbers the vertices that a part uses, in order of their use, and returns their old indices.
fn gather(part: &mut MeshPart) -> Vec<usize> {
    let mut used = Vec::new();
    let mut index_of: HashMap<u32, u32> = HashMap::new();
    let in_triangles = part.triangles.as_flattened_mut().iter_mut();
    let in_lines = part.lines.as_flattened_mut().iter_mut();
    for i in in_triangles.chain(in_lines).chain(&mut part.points) {
        // Their number is at most that of the corners, which is limited.
        let next = u32::try_from(used.len()).unwrap_or(u32::MAX);
        let vertex = *i;
        *i = *index_of.entry(vertex).or_insert_with(|| {
            used.push(vertex as usize);
            next
        });
    }
    used
}

impl Shape {
    /// Returns the part in world space, transformed by its node or by its joints.
    pub(super) fn placed(
        &self,
        world_from_mesh: DAffine3,
        joints: Option<&[DAffine3]>,
        material: usize,
    ) -> MeshPart {
        let transform = |i: usize| match (joints, self.influences.get(i)) {
            (Some(joints), Some(of_corner)) => {
                let mut sum = DAffine3::ZERO;
                for &(joint, weight) in of_corner {
                    sum.matrix3 += joints[joint].matrix3 * weight;
                    sum.translation += joints[joint].translation * weight;
                }
                sum
            }
            _ => world_from_mesh,
        };
        let mut part = self.part.clone();
        part.material = material;
        let mut is_mirrored = vec![false; part.positions.len()];
        for (i, position) in part.positions.iter_mut().enumerate() {
            let transform = transform(i);
            *position = transform.transform_point3(*position);
            is_mirrored[i] = transform.matrix3.determinant() < 0.0;
            if let Some(normal) = self.normals.get(i) {
                let normal = cofactors(transform.matrix3) * *normal;
                let normal = if is_mirrored[i] { -normal } else { normal };
                part.normals.push(normal.normalize_or_zero().as_vec3());
            }
        }
        for triangle in &mut part.triangles {
            if is_mirrored[triangle[0] as usize] {
                triangle.swap(1, 2);
            }
        }
        part
    }
}

/// Returns the inverse transpose times the determinant. It transforms normals, and exists for singular matrices too.
fn cofactors(m: DMat3) -> DMat3 {
    DMat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    )
}
