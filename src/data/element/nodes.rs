//! Lists the nodes of cells of higher order in VTK's numbering: corners, then edges, faces and the inside.
//!
//! Positions are whole numbers of steps, `order` steps per edge. In triangles, tetrahedra and wedges (their first two
//! axes), the numbers sum to at most `order`.

/// Position on the lattice of an element.
pub(super) type Place = [i32; 3];

fn add(a: Place, b: Place, times: i32) -> Place {
    [0, 1, 2].map(|axis| a[axis] + times * b[axis])
}

/// Returns one of `n` steps from one position to another.
fn step(from: Place, to: Place, n: i32) -> Place {
    [0, 1, 2].map(|axis| (to[axis] - from[axis]) / n)
}

/// Returns the positions between two corners, from the first to the second.
fn edge(from: Place, to: Place, n: i32) -> impl Iterator<Item = Place> {
    let along = step(from, to, n.max(1));
    (1..n).map(move |i| add(from, along, i))
}

/// Adds all nodes of a triangle of `n` steps between three corners; smaller triangles lie inside it.
fn triangle(corners: [Place; 3], n: i32, places: &mut Vec<Place>) {
    let [a, b, c] = corners;
    if n == 0 {
        places.push(a);
        return;
    }
    places.extend(corners);
    for (from, to) in [(a, b), (b, c), (c, a)] {
        places.extend(edge(from, to, n));
    }
    inside_triangle(corners, n, places);
}

/// Adds the nodes inside such a triangle.
fn inside_triangle([a, b, c]: [Place; 3], n: i32, places: &mut Vec<Place>) {
    if n < 3 {
        return;
    }
    let (u, v) = (step(a, b, n), step(a, c, n));
    let at = |i, j| add(add(a, u, i), v, j);
    triangle([at(1, 1), at(n - 2, 1), at(1, n - 2)], n - 3, places);
}

/// Adds the nodes inside a parallelogram, fastest along the first edge.
fn inside_quadrilateral(corner: Place, ends: [Place; 2], n: i32, places: &mut Vec<Place>) {
    let [u, v] = ends.map(|end| step(corner, end, n));
    for j in 1..n {
        places.extend((1..n).map(|i| add(add(corner, u, i), v, j)));
    }
}

pub(super) fn triangles(n: i32) -> Vec<Place> {
    let mut places = Vec::new();
    triangle([[0, 0, 0], [n, 0, 0], [0, n, 0]], n, &mut places);
    places
}

pub(super) fn tetrahedron(n: i32) -> Vec<Place> {
    let mut places = Vec::new();
    tetrahedron_at([0; 3], n, &mut places);
    places
}

/// Adds all nodes of a tetrahedron of `n` steps; smaller tetrahedra lie inside it.
fn tetrahedron_at(origin: Place, n: i32, places: &mut Vec<Place>) {
    if n == 0 {
        places.push(origin);
        return;
    }
    let corners = [[0, 0, 0], [n, 0, 0], [0, n, 0], [0, 0, n]];
    let [a, b, c, d] = corners.map(|corner| add(origin, corner, 1));
    places.extend([a, b, c, d]);
    for (from, to) in [(a, b), (b, c), (c, a), (a, d), (b, d), (c, d)] {
        places.extend(edge(from, to, n));
    }
    for face in [[a, b, d], [c, d, b], [a, d, c], [a, c, b]] {
        inside_triangle(face, n, places);
    }
    if n > 3 {
        tetrahedron_at(add(origin, [1; 3], 1), n - 4, places);
    }
}

pub(super) fn quadrilateral(n: i32) -> Vec<Place> {
    let [a, b, c, d] = [[0, 0, 0], [n, 0, 0], [n, n, 0], [0, n, 0]];
    let mut places = vec![a, b, c, d];
    for (from, to) in [(a, b), (b, c), (d, c), (a, d)] {
        places.extend(edge(from, to, n));
    }
    inside_quadrilateral(a, [b, d], n, &mut places);
    places
}

pub(super) fn hexahedron(n: i32) -> Vec<Place> {
    let bottom = [[0, 0, 0], [n, 0, 0], [n, n, 0], [0, n, 0]];
    let top = bottom.map(|place| add(place, [0, 0, n], 1));
    let mut places = [bottom, top].concat();
    for [a, b, c, d] in [bottom, top] {
        for (from, to) in [(a, b), (b, c), (d, c), (a, d)] {
            places.extend(edge(from, to, n));
        }
    }
    for (from, to) in bottom.into_iter().zip(top) {
        places.extend(edge(from, to, n));
    }
    let [x, y, z] = [[n, 0, 0], [0, n, 0], [0, 0, n]];
    for (u, v, across) in [(y, z, x), (x, z, y), (x, y, z)] {
        for far in [0, 1] {
            let corner = add([0; 3], across, far);
            let ends = [u, v].map(|end| add(corner, end, 1));
            inside_quadrilateral(corner, ends, n, &mut places);
        }
    }
    for k in 1..n {
        inside_quadrilateral([0, 0, k], [[n, 0, k], [0, n, k]], n, &mut places);
    }
    places
}

pub(super) fn wedge(n: i32) -> Vec<Place> {
    let layer = |k: i32| [[0, 0, k], [n, 0, k], [0, n, k]];
    let (bottom, top) = (layer(0), layer(n));
    let mut places = [bottom, top].concat();
    for [a, b, c] in [bottom, top] {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            places.extend(edge(from, to, n));
        }
    }
    for (from, to) in bottom.into_iter().zip(top) {
        places.extend(edge(from, to, n));
    }
    for face in [bottom, top] {
        inside_triangle(face, n, &mut places);
    }
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        inside_quadrilateral(bottom[i], [bottom[j], top[i]], n, &mut places);
    }
    for k in 1..n {
        inside_triangle(layer(k), n, &mut places);
    }
    places
}
