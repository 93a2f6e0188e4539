//! Reads nodes, which place meshes in the scene.

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::accessor::{ANY_NUMBERS, Accessor, ComponentType, Type};
use super::container::Buffers;
use super::document::Object;
use crate::error::Result;

/// Node of the scene graph.
pub(in crate::io) struct Node<'b> {
    pub(in crate::io) world_from_node: DAffine3,
    pub(super) object: Object<'b>,
    pub(super) children: Vec<usize>,
}

impl<'b> Node<'b> {
    /// Returns the index of its mesh, and the mesh.
    ///
    /// # Errors
    /// The mesh does not exist.
    pub(in crate::io) fn mesh(
        &self,
        buffers: &'b Buffers<'_>,
    ) -> Result<Option<(usize, Object<'b>)>> {
        let Some(index) = self.object.index("mesh")? else {
            return Ok(None);
        };
        let place = format!("node {}", self.object.number_in_list());
        let mesh = buffers.document.get("meshes", index, &place)?;
        Ok(Some((index, mesh)))
    }

    /// Returns the index of its skin.
    pub(super) fn skin(&self) -> Result<Option<usize>> {
        self.object.index("skin")
    }

    /// Returns the weights of its morph targets, if it overrides the mesh's.
    pub(super) fn weights(&self) -> Result<Option<Vec<f64>>> {
        self.object.list("weights")
    }
}

/// Nodes of a file, with their world transforms.
pub(in crate::io) struct Nodes<'b> {
    pub(in crate::io) all: Vec<Node<'b>>,
    /// Indices of the nodes to draw, each once: those of the default scene, or of the first scene, or all.
    pub(in crate::io) shown: Vec<usize>,
}

impl<'b> Nodes<'b> {
    /// Computes the world transforms of all nodes.
    ///
    /// # Errors
    /// A child does not exist, a node has two parents or is its own ancestor, or a matrix is not affine.
    pub(in crate::io) fn new(buffers: &'b Buffers<'_>) -> Result<Self> {
        let count = buffers.document.count("nodes");
        let mut all = Vec::with_capacity(count);
        for i in 0..count {
            let object = buffers.document.get("nodes", i, "nodes")?;
            all.push(Node {
                world_from_node: DAffine3::IDENTITY,
                object,
                children: object.indices("children")?,
            });
        }
        let mut has_parent = vec![false; count];
        for (i, node) in all.iter().enumerate() {
            for &child in &node.children {
                match has_parent.get_mut(child) {
                    Some(has) if !*has => *has = true,
                    Some(_) => {
                        let place = format!("node {i}, children");
                        let expected = "nodes that have no other parent";
                        return Err(buffers.refuse(place, expected, format!("node {child}")));
                    }
                    None => {
                        let place = format!("node {i}, children");
                        let expected = format!("some of {count} nodes");
                        return Err(buffers.refuse(place, expected, format!("node {child}")));
                    }
                }
            }
        }
        let mut placed = 0;
        let mut open: Vec<(usize, DAffine3)> = (0..count)
            .filter(|&i| !has_parent[i])
            .map(|i| (i, DAffine3::IDENTITY))
            .collect();
        while let Some((i, world_from_parent)) = open.pop() {
            let node = &mut all[i];
            let world = world_from_parent * parent_from_node(buffers, node.object)?;
            node.world_from_node = world;
            placed += 1;
            open.extend(node.children.iter().map(|&child| (child, world)));
        }
        // Each node has at most one parent, so nodes that no root reaches are in loops.
        if placed < count {
            let expected = "a tree without loops";
            return Err(buffers.refuse("nodes", expected, "a node that is its own ancestor"));
        }
        let shown = shown(buffers, &all, &has_parent)?;
        Ok(Self { all, shown })
    }
}

/// Returns the nodes of the scene, parents before children.
fn shown(buffers: &Buffers<'_>, all: &[Node<'_>], has_parent: &[bool]) -> Result<Vec<usize>> {
    let document = buffers.document;
    let scene = match document.scene()? {
        Some(scene) => Some(document.get("scenes", scene, "scene")?),
        None => document.find("scenes", 0),
    };
    let roots: Vec<usize> = match scene {
        Some(scene) => scene.indices("nodes")?,
        None => (0..all.len()).filter(|&i| !has_parent[i]).collect(),
    };
    let mut is_shown = vec![false; all.len()];
    let mut shown = Vec::new();
    let mut open: Vec<usize> = roots.into_iter().rev().collect();
    while let Some(i) = open.pop() {
        match is_shown.get_mut(i) {
            Some(is) if !*is => *is = true,
            // The scene lists this node and an ancestor of it.
            Some(_) => continue,
            None => {
                let expected = format!("some of {} nodes", all.len());
                return Err(buffers.refuse("scene, nodes", expected, format!("node {i}")));
            }
        }
        shown.push(i);
        open.extend(all[i].children.iter().rev());
    }
    Ok(shown)
}

/// Returns the transform that a node states.
pub(super) fn parent_from_node(buffers: &Buffers<'_>, node: Object<'_>) -> Result<DAffine3> {
    if let Some(matrix) = node.numbers::<16>("matrix")? {
        let matrix = DMat4::from_cols_array(&matrix);
        return affine(matrix).ok_or_else(|| {
            let expected = "an affine matrix (its last row 0, 0, 0, 1)";
            let found = format!("{}", matrix.row(3));
            let place = format!("node {}, matrix", node.number_in_list());
            buffers.refuse(place, expected, found)
        });
    }
    let vector = |key: &str, otherwise| -> Result<DVec3> {
        Ok(node.numbers(key)?.map_or(otherwise, DVec3::from_array))
    };
    let rotation = node.numbers("rotation")?;
    Ok(DAffine3::from_scale_rotation_translation(
        vector("scale", DVec3::ONE)?,
        unit(rotation.map_or(DQuat::IDENTITY, DQuat::from_array)),
        vector("translation", DVec3::ZERO)?,
    ))
}

/// Normalises a quaternion; a zero or infinite one becomes the identity.
fn unit(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length > 0.0 && length.is_finite() {
        rotation / length
    } else {
        DQuat::IDENTITY
    }
}

fn affine(matrix: DMat4) -> Option<DAffine3> {
    // Some writers round the last row; a difference of a millionth is no perspective.
    const ROUNDING: f64 = 1e-6;
    let last = matrix.row(3) - glam::DVec4::W;
    (last.abs().max_element() <= ROUNDING).then(|| DAffine3::from_mat4(matrix))
}

/// Returns the matrices of a skin's joints: world from the mesh's bind pose.
///
/// # Errors
/// A skin or a joint does not exist, or there are fewer matrices than joints.
pub(super) fn joints(
    buffers: &Buffers<'_>,
    nodes: &Nodes<'_>,
    skin: usize,
) -> Result<Vec<DAffine3>> {
    let place = format!("skin {skin}");
    let skin = buffers.document.get("skins", skin, "node, skin")?;
    let joints = skin.indices("joints")?;
    let matrices = match skin.index("inverseBindMatrices")? {
        None => None,
        Some(accessor) => {
            let place = format!("{place}, inverseBindMatrices");
            let matrices = Accessor::open(
                buffers,
                accessor,
                &place,
                &[Type::Mat4],
                &[ComponentType::F32],
            )?;
            if matrices.len() < joints.len() {
                let expected = format!("{} matrices", joints.len());
                return Err(buffers.refuse(place, expected, matrices.len().to_string()));
            }
            Some(matrices)
        }
    };
    let joint = |(i, joint): (usize, &usize)| {
        let node = nodes.all.get(*joint).ok_or_else(|| {
            let expected = format!("some of {} nodes", nodes.all.len());
            let found = format!("node {joint}");
            buffers.refuse(format!("{place}, joints"), expected, found)
        })?;
        let bind = matrices.as_ref().map_or(DAffine3::IDENTITY, |m| {
            DAffine3::from_mat4(DMat4::from_cols_array(&m.numbers::<16>(i)))
        });
        Ok(node.world_from_node * bind)
    };
    joints.iter().enumerate().map(joint).collect()
}

/// Returns the transforms of a node's instances within it (`EXT_mesh_gpu_instancing`), or the identity for a node
/// without them.
///
/// # Errors
/// Accessors have unequal lengths or do not exist.
pub(in crate::io) fn instances(buffers: &Buffers<'_>, node: &Node<'_>) -> Result<Vec<DAffine3>> {
    let Some(stated) = node.object.extension("EXT_mesh_gpu_instancing") else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    let attributes = stated.object("attributes")?;
    let index = node.object.number_in_list();
    let place = format!("node {index}, EXT_mesh_gpu_instancing");
    let open = |name: &str, type_: Type| {
        let accessor = match attributes {
            Some(attributes) => attributes.index(name)?,
            None => None,
        };
        let Some(accessor) = accessor else {
            return Ok(None);
        };
        let place = format!("{place}, {name}");
        Accessor::open(buffers, accessor, &place, &[type_], ANY_NUMBERS).map(Some)
    };
    let translations = open("TRANSLATION", Type::Vec3)?;
    let rotations = open("ROTATION", Type::Vec4)?;
    let scales = open("SCALE", Type::Vec3)?;
    let mut lengths = [&translations, &rotations, &scales]
        .into_iter()
        .flatten()
        .map(Accessor::len);
    let Some(count) = lengths.next() else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    if let Some(other) = lengths.find(|n| *n != count) {
        let expected = format!("{count} of each attribute");
        return Err(buffers.refuse(place, expected, other.to_string()));
    }
    let vector = |accessor: &Option<Accessor<'_>>, i: usize, otherwise| {
        accessor
            .as_ref()
            .map_or(otherwise, |a| DVec3::from_array(a.numbers(i)))
    };
    let instance = |i: usize| {
        let rotation = rotations
            .as_ref()
            .map_or(DQuat::IDENTITY, |a| DQuat::from_array(a.numbers(i)));
        DAffine3::from_scale_rotation_translation(
            vector(&scales, i, DVec3::ONE),
            unit(rotation),
            vector(&translations, i, DVec3::ZERO),
        )
    };
    Ok((0..count).map(instance).collect())
}
