//! Reads polyhedra in VTK's form.

/// The faces of a polyhedron that have three nodes or more.
pub(crate) fn polyhedron_faces(entries: &[u32]) -> impl Iterator<Item = &[u32]> {
    let mut rest = entries.get(1..).unwrap_or(&[]);
    std::iter::from_fn(move || {
        let (&count, tail) = rest.split_first()?;
        let (face, tail) = tail.split_at_checked(count as usize)?;
        rest = tail;
        Some(face)
    })
    .filter(|face| face.len() >= 3)
}
