//! Leaves out cells on the boundary of others.

use crate::data::association::Association;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::Field;

/// Number of dimensions of a cell: 3 for solids, 2 for pieces of a surface, 1 for lines, 0 for points.
fn dimension(kind: CellKind) -> u8 {
    match kind.0 {
        0..=2 => 0,
        _ if kind.is_thin() => 1,
        _ if kind.is_flat() => 2,
        _ => 3,
    }
}

/// Leaves out all cells but those of the most dimensions, with their values; returns a note if there are others.
pub(super) fn keep_highest(mesh: &mut CellMesh, fields: &mut [Field]) -> Option<String> {
    let most = mesh.kinds.iter().map(|&kind| dimension(kind)).max()?;
    let is_kept = |i: &u32| dimension(mesh.kinds[*i as usize]) == most;
    let all = 0..u32::try_from(mesh.cell_count()).ok()?;
    let kept: Vec<u32> = all.filter(is_kept).collect();
    if kept.len() == mesh.cell_count() {
        return None;
    }
    let mut counts = [0_usize; 3];
    for &kind in &mesh.kinds {
        if let Some(count) = counts.get_mut(usize::from(dimension(kind)))
            && dimension(kind) < most
        {
            *count += 1;
        }
    }
    let of_cells = |field: &&mut Field| field.association == Association::Cells;
    for field in fields.iter_mut().filter(of_cells) {
        for values in field.arrays_mut() {
            *values = values.gather(&kept);
        }
    }
    let mut only = CellMesh {
        nodes: std::mem::take(&mut mesh.nodes),
        offsets: vec![0],
        ..CellMesh::default()
    };
    for &i in &kept {
        only.kinds.push(mesh.kinds[i as usize]);
        only.connectivity.extend(mesh.cell(i as usize));
        // No more entries than before, which were counted.
        only.offsets
            .push(u32::try_from(only.connectivity.len()).ok()?);
    }
    *mesh = only;
    let names = ["points", "lines", "pieces of surfaces"];
    let counted = names
        .iter()
        .zip(counts)
        .rev()
        .filter(|(_, count)| *count > 0);
    let counted: Vec<String> = counted
        .map(|(name, count)| format!("{count} {name}"))
        .collect();
    Some(format!(
        "Left out, because they bound other cells or lie among them: {}.",
        counted.join(", ")
    ))
}
