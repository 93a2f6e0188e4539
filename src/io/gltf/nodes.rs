//! Nodes: where meshes stand.

use glam::{DAffine3, DMat4, DQuat, DVec3};
use gltf_json::{Index, Node, Root};

use super::accessor::{ANY_NUMBERS, Accessor};
use super::container::Buffers;
use crate::error::Result;
use gltf_json::accessor::{ComponentType, Type};

/// The nodes of a file, with their places in the world.
pub(super) struct Nodes {
    pub(super) world_from_node: Vec<DAffine3>,
    /// The nodes to show, each once: those of the default scene, or of the first, or all.
    pub(super) shown: Vec<usize>,
}

impl Nodes {
    /// Places all nodes.
    ///
    /// # Errors
    /// Children that are not there, nodes with two parents or that are their own ancestors, and
    /// matrices that are not affine.
    pub(super) fn new(buffers: &Buffers<'_>) -> Result<Self> {
        let root = buffers.root;
        let count = root.nodes.len();
        let mut has_parent = vec![false; count];
        for (i, node) in root.nodes.iter().enumerate() {
            for child in children(node) {
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
        let mut world_from_node = vec![None; count];
        let mut open: Vec<(usize, DAffine3)> = (0..count)
            .filter(|&i| !has_parent[i])
            .map(|i| (i, DAffine3::IDENTITY))
            .collect();
        while let Some((i, world_from_parent)) = open.pop() {
            let node = &root.nodes[i];
            let world = world_from_parent * parent_from_node(buffers, i, node)?;
            world_from_node[i] = Some(world);
            open.extend(children(node).map(|child| (child, world)));
        }
        let world_from_node: Option<Vec<DAffine3>> = world_from_node.iter().copied().collect();
        let world_from_node = world_from_node.ok_or_else(|| {
            let expected = "a tree without loops";
            buffers.refuse("nodes", expected, "a node that is its own ancestor")
        })?;
        let shown = shown(buffers, &has_parent)?;
        Ok(Self {
            world_from_node,
            shown,
        })
    }
}

fn children(node: &Node) -> impl DoubleEndedIterator<Item = usize> {
    node.children.iter().flatten().map(Index::value)
}

/// The nodes of the scene, parents before children.
fn shown(buffers: &Buffers<'_>, has_parent: &[bool]) -> Result<Vec<usize>> {
    let root: &Root = buffers.root;
    let roots: Vec<usize> = match (root.scene, root.scenes.first()) {
        (Some(scene), _) => {
            let scene = root.get(scene).ok_or_else(|| {
                let expected = format!("one of {} scenes", root.scenes.len());
                buffers.refuse("scene", expected, scene.value().to_string())
            })?;
            scene.nodes.iter().map(Index::value).collect()
        }
        (None, Some(scene)) => scene.nodes.iter().map(Index::value).collect(),
        (None, None) => (0..has_parent.len()).filter(|&i| !has_parent[i]).collect(),
    };
    let mut is_shown = vec![false; has_parent.len()];
    let mut shown = Vec::new();
    let mut open: Vec<usize> = roots.into_iter().rev().collect();
    while let Some(i) = open.pop() {
        match is_shown.get_mut(i) {
            Some(is) if !*is => *is = true,
            // Listed beside its ancestor.
            Some(_) => continue,
            None => {
                let expected = format!("some of {} nodes", has_parent.len());
                return Err(buffers.refuse("scene, nodes", expected, format!("node {i}")));
            }
        }
        shown.push(i);
        open.extend(children(&root.nodes[i]).rev());
    }
    Ok(shown)
}

fn parent_from_node(buffers: &Buffers<'_>, index: usize, node: &Node) -> Result<DAffine3> {
    if let Some(matrix) = node.matrix {
        let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        return affine(matrix).ok_or_else(|| {
            let expected = "an affine matrix (its last row 0, 0, 0, 1)";
            let found = format!("{}", matrix.row(3));
            buffers.refuse(format!("node {index}, matrix"), expected, found)
        });
    }
    let vector = |v: Option<[f32; 3]>, otherwise| {
        v.map_or(otherwise, |v| DVec3::from_array(v.map(f64::from)))
    };
    let rotation = node
        .rotation
        .map_or(DQuat::IDENTITY, |q| DQuat::from_array(q.0.map(f64::from)));
    Ok(DAffine3::from_scale_rotation_translation(
        vector(node.scale, DVec3::ONE),
        unit(rotation),
        vector(node.translation, DVec3::ZERO),
    ))
}

/// A unit quaternion; none at all turns nothing.
fn unit(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length > 0.0 && length.is_finite() {
        rotation / length
    } else {
        DQuat::IDENTITY
    }
}

fn affine(matrix: DMat4) -> Option<DAffine3> {
    // Some writers round here: a sixteenth of a million is no perspective.
    const ROUNDING: f64 = 1e-6;
    let last = matrix.row(3) - glam::DVec4::W;
    (last.abs().max_element() <= ROUNDING).then(|| DAffine3::from_mat4(matrix))
}

/// The matrices of a skin's joints: world from the mesh's bind pose.
///
/// # Errors
/// A skin or a joint that is not there, or fewer matrices than joints.
pub(super) fn joints(
    buffers: &Buffers<'_>,
    nodes: &Nodes,
    skin: Index<gltf_json::Skin>,
) -> Result<Vec<DAffine3>> {
    let place = format!("skin {}", skin.value());
    let skin = buffers.root.get(skin).ok_or_else(|| {
        let expected = format!("one of {} skins", buffers.root.skins.len());
        buffers.refuse("node, skin", expected, place.clone())
    })?;
    let matrices = match skin.inverse_bind_matrices {
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
            if matrices.len() < skin.joints.len() {
                let expected = format!("{} matrices", skin.joints.len());
                return Err(buffers.refuse(place, expected, matrices.len().to_string()));
            }
            Some(matrices)
        }
    };
    let joint = |(i, joint): (usize, &Index<Node>)| {
        let world = nodes.world_from_node.get(joint.value()).ok_or_else(|| {
            let expected = format!("some of {} nodes", nodes.world_from_node.len());
            let found = format!("node {}", joint.value());
            buffers.refuse(format!("{place}, joints"), expected, found)
        })?;
        let bind = matrices.as_ref().map_or(DAffine3::IDENTITY, |m| {
            DAffine3::from_mat4(DMat4::from_cols_array(&m.numbers::<16>(i)))
        });
        Ok(*world * bind)
    };
    skin.joints.iter().enumerate().map(joint).collect()
}

/// The places of a node's instances within it (`EXT_mesh_gpu_instancing`), or the one that a
/// node without them has.
///
/// # Errors
/// Accessors of unequal lengths, or that are not there.
pub(super) fn instances(buffers: &Buffers<'_>, index: usize, node: &Node) -> Result<Vec<DAffine3>> {
    let extension = node.extensions.as_ref();
    let Some(attributes) = extension.and_then(|e| e.others.get("EXT_mesh_gpu_instancing")) else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    let place = format!("node {index}, EXT_mesh_gpu_instancing");
    let open = |name: &str, type_: Type| {
        let Some(number) = attributes["attributes"].get(name) else {
            return Ok(None);
        };
        let accessor = number.as_u64().and_then(|n| u32::try_from(n).ok());
        let accessor = Index::new(accessor.unwrap_or(u32::MAX));
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
