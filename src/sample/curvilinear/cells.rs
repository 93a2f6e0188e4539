//! Refines kernels of curvilinear grids with values of cells, as those of meshes of hexahedra.
//!
//! The field is constant in each cell, so that cells are split where values jump from one to the next, whatever their
//! order in the grid. Blocks that touch, and cells beside finer ones, are then as in any mesh.

use rayon::prelude::*;

use crate::data::association::Association;
use crate::data::blanking::Blanking;
use crate::data::cells::{CellKind, CellMesh};
use crate::data::dataset::CurvilinearBlock;
use crate::error::Result;
use crate::math::principal_sigmas;
use crate::sample::cells::refine_cells;
use crate::sample::options::SampleOptions;
use crate::sample::positions::index_u32;
use crate::sample::refine::rule::{Rule, ShownValues};
use crate::sample::sampled::Sampled;
use crate::scene::Particles;

/// Refines a volume of the cells of blocks if any of its values jumps visibly.
///
/// - `kept`: cell of each particle, ascending.
///
/// # Errors
/// Work that was cancelled.
pub(super) fn refine_blocks(
    blocks: &[CurvilinearBlock],
    blanking: &Blanking,
    kept: &[u32],
    sampled: &mut Sampled,
    options: &SampleOptions,
) -> Result<()> {
    match asks(blocks, kept, sampled, options) {
        true => refine_cells(&hexahedra(blocks), blanking, kept, sampled, options),
        false => Ok(()),
    }
}

/// Returns true if values jump visibly between any two cells of a block that share a face.
fn asks(
    blocks: &[CurvilinearBlock],
    kept: &[u32],
    sampled: &Sampled,
    options: &SampleOptions,
) -> bool {
    let volume = &sampled.volume;
    let (
        Some(values),
        Some(shown),
        Some(refinement),
        Particles::Anisotropic { positions, factors },
    ) = (
        &volume.values,
        ShownValues::new(volume, options.flatten),
        &options.refinement,
        &volume.particles,
    )
    else {
        return false;
    };
    let width = options.kernels.width;
    let rule = Rule::new(&shown, refinement.threshold_px, width);
    let mut first = 0;
    blocks.iter().any(|block| {
        let dims = block.dims_of(Association::Cells);
        let of_block = first..first + dims.iter().product::<usize>();
        first = of_block.end;
        let strides = [1, dims[0], dims[0] * dims[1]];
        let particle = |cell: usize| kept.binary_search(&index_u32(cell)).ok();
        let jumps = |(i, cell): (usize, usize)| {
            let place = cell - of_block.start;
            let value = values.wide(i);
            let after = (0..3).filter(|&a| place / strides[a] % dims[a] + 1 < dims[a]);
            let mut beside = after.filter_map(|a| particle(cell + strides[a]));
            let sigma = principal_sigmas(factors[i].map(f64::from))[0];
            let px = refinement.px(positions[i], sigma / width);
            beside.any(|other| {
                let other = values.wide(other);
                let range = [value.min(other), value.max(other)];
                rule.jump_level(range, range[1] - range[0], px, sigma) > 0
            })
        };
        let start = kept.partition_point(|&cell| (cell as usize) < of_block.start);
        let end = kept.partition_point(|&cell| (cell as usize) < of_block.end);
        let own = kept[start..end].par_iter().enumerate();
        own.map(|(i, &cell)| (start + i, cell as usize)).any(jumps)
    })
}

/// Returns the cells of blocks as hexahedra; nodes and cells keep their numbers.
fn hexahedra(blocks: &[CurvilinearBlock]) -> CellMesh {
    let mut connectivity = Vec::new();
    let mut first = 0;
    for block in blocks {
        let ([x, y, _], [i, j, k]) = (block.dims, block.dims_of(Association::Cells));
        for n in 0..i * j * k {
            let low = first + n % i + x * (n / i % j + y * (n / (i * j)));
            let corners = [0, 1, 1 + x, x].map(|offset| low + offset);
            connectivity.extend(corners.map(index_u32));
            connectivity.extend(corners.map(|corner| index_u32(corner + x * y)));
        }
        first += block.nodes.len();
    }
    let count = connectivity.len() / 8;
    CellMesh {
        nodes: blocks
            .iter()
            .flat_map(|block| &block.nodes)
            .copied()
            .collect(),
        kinds: vec![CellKind::HEXAHEDRON; count],
        offsets: (0..=count).map(|n| index_u32(8 * n)).collect(),
        connectivity,
    }
}
