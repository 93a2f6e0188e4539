// Factors of variance matrices: V = F Fᵀ, by rows. Twin: src/math/factor.rs.

struct Factor {
    x: vec3<f32>,
    y: vec3<f32>,
    z: vec3<f32>,
}

// Returns the factor with these columns.
fn factor_of_columns(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> Factor {
    return Factor(
        vec3<f32>(a.x, b.x, c.x),
        vec3<f32>(a.y, b.y, c.y),
        vec3<f32>(a.z, b.z, c.z),
    );
}

// Returns the factor of a sphere of standard deviation `sigma`.
fn sphere(sigma: f32) -> Factor {
    return Factor(
        vec3<f32>(sigma, 0.0, 0.0),
        vec3<f32>(0.0, sigma, 0.0),
        vec3<f32>(0.0, 0.0, sigma),
    );
}

// Returns `rotation` times the lower-triangular factor (l00, l10, l11, l20, l21, l22).
fn rotated(rotation: mat3x3<f32>, lower: array<f32, 6>) -> Factor {
    return factor_of_columns(
        times(rotation, vec3<f32>(lower[0], lower[1], lower[3])),
        rotation[1] * lower[2] + rotation[2] * lower[4],
        rotation[2] * lower[5],
    );
}

// Returns the three columns of F.
fn columns(f: Factor) -> array<vec3<f32>, 3> {
    return array<vec3<f32>, 3>(
        vec3<f32>(f.x.x, f.y.x, f.z.x),
        vec3<f32>(f.x.y, f.y.y, f.z.y),
        vec3<f32>(f.x.z, f.y.z, f.z.z),
    );
}

// Returns the terms of a piece that are stored as a particle.
fn piece_terms(words: ClassifiedParticle) -> PieceTerms {
    let axis = array<f32, 3>(bitcast<f32>(words.view), bitcast<f32>(words.local), words.mass);
    return PieceTerms(axis, words.carried[0], words.carried[1], 0u);
}

// A kernel or a piece of one.
struct Piece {
    // False for a whole kernel.
    exists: bool,
    factor: Factor,
    // Distance of its centre from the kernel's.
    shift: vec3<f32>,
}

// Returns a piece of a kernel: narrower along an axis, and moved. Twin: `PieceTerms::applied`.
//
// - `factor`: the kernel's, camera space.
fn piece_of(terms: PieceTerms, rotation: mat3x3<f32>, factor: Factor) -> Piece {
    var piece = Piece(false, factor, vec3<f32>(0.0));
    if terms.width == 1.0 && terms.shift == 0.0 {
        return piece;
    }
    let axis = piece_axis(rotation, vector(terms.axis));
    let along = vec3<f32>(dot3(factor.x, axis), dot3(factor.y, axis), dot3(factor.z, axis));
    let change = terms.width - 1.0;
    piece.exists = true;
    piece.factor.x = factor.x + axis * (change * along.x);
    piece.factor.y = factor.y + axis * (change * along.y);
    piece.factor.z = factor.z + axis * (change * along.z);
    piece.shift = along * terms.shift;
    return piece;
}
