// Reads cells of a lattice in bricks: nothing is stored per particle. Twins: `BrickGrid` in
// src/blocks/brick.rs, `BlockShapes` in src/cpu/project/shapes.rs.

// A sample of a rectilinear lattice's axis. Twin: `AxisSample`.
struct AxisSample {
    offset: f32,
    sigma: f32,
    extent: f32,
    bend: f32,
}

@group(0) @binding(0) var<storage, read> lattice: LatticeUniform;
// Samples of x, then of y, then of z; empty for a uniform lattice. If the box of the samples cuts
// kernels, the distances inside the lower and the upper face follow: in `offset` and `sigma`.
@group(0) @binding(1) var<storage, read> axes: array<AxisSample>;

// Returns the first cell of a brick.
fn corner(block: u32) -> vec3<u32> {
    let b = lattice.first_brick + block;
    let bx = lattice.bricks[0];
    let by = lattice.bricks[1];
    return vec3<u32>(b % bx, b / bx % by, b / (bx * by)) * vec3<u32>(BRICK_X, BRICK_Y, BRICK_Z);
}

// Returns cell `local` of the brick whose first cell is `first`.
fn cell_of(first: vec3<u32>, local: u32) -> vec3<u32> {
    return first
        + vec3<u32>(local % BRICK_X, local / BRICK_X % BRICK_Y, local / (BRICK_X * BRICK_Y));
}

// Returns the indices of a cell's samples in `axes`.
fn samples_of(cell: vec3<u32>) -> vec3<u32> {
    return cell + vec3<u32>(0u, lattice.dims[0], lattice.dims[0] + lattice.dims[1]);
}

// Index in arrays with one entry per particle.
fn particle_index(block: u32, local: u32) -> u32 {
    return block * (BRICK_X * BRICK_Y * BRICK_Z) + local;
}

// Greatest number of a block's kernels that overlap at a point, as a multiple of OVERLAP: cells lie
// apart.
fn crowding_of(block: u32) -> f32 {
    return 1.0;
}

// Offset from the block's origin, world units.
fn world_offset(block: u32, local: u32) -> vec3<f32> {
    let first = corner(block);
    let cell = cell_of(first, local);
    let dims = vec3<u32>(lattice.dims[0], lattice.dims[1], lattice.dims[2]);
    let end = min(first + vec3<u32>(BRICK_X, BRICK_Y, BRICK_Z), dims);
    var units = vec3<f32>(cell - first) - 0.5 * vec3<f32>(end - first - 1u);
    if lattice.has_axes != 0u {
        let i = samples_of(cell);
        units = vec3<f32>(axes[i.x].offset, axes[i.y].offset, axes[i.z].offset);
    }
    return times(columns_of(lattice.basis), units);
}

// Factor of the variance, camera space.
fn camera_factor(rotation: mat3x3<f32>, block: u32, local: u32) -> Factor {
    if lattice.has_axes != 0u {
        let i = samples_of(cell_of(corner(block), local));
        let basis = columns_of(lattice.basis);
        return factor_of_columns(
            times(rotation, basis[0]) * axes[i.x].sigma,
            times(rotation, basis[1]) * axes[i.y].sigma,
            times(rotation, basis[2]) * axes[i.z].sigma,
        );
    }
    let f = columns_of(lattice.factor);
    return factor_of_columns(times(rotation, f[0]), times(rotation, f[1]), times(rotation, f[2]));
}

// Returns face k of the samples' box that cuts a cell's kernel, for each axis the lower and the upper
// one; not finite if there is none. The distances from the faces follow the samples of the axes.
fn edge_of(block: u32, local: u32, k: u32) -> vec4<f32> {
    if lattice.first_face == 0u {
        return vec4<f32>(0.0, 0.0, 0.0, infinity());
    }
    let axis = k / 2u;
    let at = lattice.first_face - 1u + samples_of(cell_of(corner(block), local))[axis];
    let normal = vector(lattice.face_normals[axis]);
    if k % 2u == 0u {
        return vec4<f32>(normal, axes[at].offset);
    }
    return vec4<f32>(-normal, axes[at].sigma);
}

fn columns_of(m: array<array<f32, 3>, 3>) -> mat3x3<f32> {
    return mat3x3<f32>(vector(m[0]), vector(m[1]), vector(m[2]));
}

// Returns the axis of a piece in the frame of the factor's columns: it turns with the kernel.
fn piece_axis(rotation: mat3x3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return axis;
}
