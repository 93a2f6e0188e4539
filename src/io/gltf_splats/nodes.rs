//! Where the nodes of the scene put meshes.

use std::path::Path;

use glam::{DAffine3, DMat4, DQuat, DVec3};

use super::document::{Node, Root};
use crate::error::{Error, Result};

/// The meshes of the scene, and the map from each to the world; the first scene where none is named,
/// and where there is none, all nodes that are nobody's children.
///
/// # Errors
/// Nodes or meshes that are not there, nodes that are their own ancestors or have two parents, maps
/// that are not finite.
pub(super) fn placed_meshes(path: &Path, root: &Root) -> Result<Vec<(usize, DAffine3)>> {
    let fault = |place: String, expected: &str, found: &str| {
        let advice = "the file is damaged: get it again";
        Error::format(path, place, expected, found, advice)
    };
    let roots: Vec<usize> = match root.scenes.get(root.scene.unwrap_or(0)) {
        Some(scene) => scene.nodes.clone(),
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            for &child in root.nodes.iter().flat_map(|n| &n.children) {
                if let Some(is_child) = is_child.get_mut(child) {
                    *is_child = true;
                }
            }
            (0..root.nodes.len()).filter(|&i| !is_child[i]).collect()
        }
    };
    let mut placed = Vec::new();
    let mut is_visited = vec![false; root.nodes.len()];
    let mut stack: Vec<(usize, DAffine3)> = roots
        .into_iter()
        .rev()
        .map(|i| (i, DAffine3::IDENTITY))
        .collect();
    while let Some((index, world_from_parent)) = stack.pop() {
        let Some(node) = root.nodes.get(index) else {
            return Err(fault(
                format!("node {index}"),
                "a node that is there",
                "none",
            ));
        };
        if std::mem::replace(&mut is_visited[index], true) {
            return Err(fault(
                format!("node {index}"),
                "one parent",
                "two, or itself",
            ));
        }
        let world = world_from_parent * local(node);
        if !world.is_finite() {
            return Err(fault(
                format!("node {index}"),
                "a finite transform",
                "another",
            ));
        }
        if let Some(mesh) = node.mesh {
            if mesh >= root.meshes.len() {
                return Err(fault(
                    format!("node {index}"),
                    "a mesh that is there",
                    "none",
                ));
            }
            placed.push((mesh, world));
        }
        stack.extend(node.children.iter().rev().map(|&child| (child, world)));
    }
    Ok(placed)
}

/// The map from a node to its parent.
fn local(node: &Node) -> DAffine3 {
    if let Some(matrix) = &node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
    }
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    // Files round their unit quaternions.
    let rotation = if rotation.length() > 0.0 {
        rotation.normalize()
    } else {
        DQuat::IDENTITY
    };
    DAffine3::from_scale_rotation_translation(
        node.scale.map_or(DVec3::ONE, DVec3::from),
        rotation,
        node.translation.map_or(DVec3::ZERO, DVec3::from),
    )
}
