//! PLOT3D grids and solutions: one binary grid, as NASA's codes write it.
//!
//! Grid (`.xyz`, `.x`, `.p3d`, `.bin`), i fastest, then j, then k:
//!
//! | what | type |
//! |---|---|
//! | number of grids, optional, 1 | i32 |
//! | ni, nj, nk | i32 x 3 |
//! | all x, all y, all z | f32 or f64, N = ni nj nk each |
//! | iblank, optional | i32 x N |
//!
//! Solution (`.q`, `.bin`):
//!
//! | what | type |
//! |---|---|
//! | number of grids, optional, 1 | i32 |
//! | ni, nj, nk | i32 x 3 |
//! | free-stream Mach number, angle of attack, Reynolds number, time | f32 or f64, x 4 |
//! | density, momentum x, y, z, energy | f32 or f64, N each |
//!
//! Fortran programs put a u32 with the record's byte count before and after each row of these
//! tables (the last two rows of the grid are one record). Nothing in a file says which of the
//! variants it is: the one is taken whose size agrees with the file's, in either byte order.
//! Solutions may be followed by zero bytes; grids may not.
//!
//! Derived fields use PLOT3D's non-dimensional perfect gas (velocities in units of the
//! free-stream speed of sound, gamma = 1.4).

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::dataset::{Association, CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
use super::file::{read_all, regular_len};
use super::scalars::{Encoding, ScalarType, Stride, doubles, values};
use crate::error::{Error, Result};
use crate::scene::Values;

/// Ratio of specific heats of air.
const GAMMA: f32 = 1.4;

/// One way to write a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Variant {
    double: bool,
    big_endian: bool,
    records: bool,
    grid_count: bool,
    /// Grids only.
    blanked: bool,
}

impl Variant {
    fn all() -> impl Iterator<Item = Self> {
        (0..32).map(|bits| Self {
            double: bits & 1 != 0,
            big_endian: bits & 2 != 0,
            records: bits & 4 != 0,
            grid_count: bits & 8 != 0,
            blanked: bits & 16 != 0,
        })
    }

    fn real(self) -> Encoding {
        Encoding {
            scalar: if self.double {
                ScalarType::F64
            } else {
                ScalarType::F32
            },
            big_endian: self.big_endian,
        }
    }

    fn word(self, bytes: &[u8], at: usize) -> Option<u32> {
        let word = <[u8; 4]>::try_from(bytes.get(at..at.checked_add(4)?)?).ok()?;
        Some(if self.big_endian {
            u32::from_be_bytes(word)
        } else {
            u32::from_le_bytes(word)
        })
    }

    /// The dimensions that stand where this variant has them: counts of at least 1 whose
    /// product is a plausible number of nodes.
    fn dims(self, bytes: &[u8]) -> Option<[usize; 3]> {
        let mark = if self.records { 4 } else { 0 };
        let mut at = mark;
        if self.grid_count {
            if self.word(bytes, at)? != 1 {
                return None;
            }
            at += 4 + 2 * mark;
        }
        let mut dims = [0; 3];
        for (i, n) in dims.iter_mut().enumerate() {
            *n = usize::try_from(self.word(bytes, at + 4 * i)?).ok()?;
            if *n == 0 || i32::try_from(*n).is_err() {
                return None;
            }
        }
        Some(dims)
    }

    /// The byte counts of the records of a grid or a solution of `nodes` nodes.
    fn record_sizes(self, kind: Kind, nodes: usize) -> Option<Vec<usize>> {
        let real = self.real().scalar.size();
        let per_node = match kind {
            Kind::Grid => 3 * real + if self.blanked { 4 } else { 0 },
            Kind::Solution => 5 * real,
        };
        let mut sizes = Vec::new();
        if self.grid_count {
            sizes.push(4);
        }
        sizes.push(12);
        if kind == Kind::Solution {
            sizes.push(4 * real);
        }
        sizes.push(nodes.checked_mul(per_node)?);
        Some(sizes)
    }

    /// Where the last record's contents start, and where the file's contents end.
    fn body(self, kind: Kind, dims: [usize; 3]) -> Option<(usize, usize)> {
        let nodes = dims[0].checked_mul(dims[1])?.checked_mul(dims[2])?;
        let mark = if self.records { 4 } else { 0 };
        let sizes = self.record_sizes(kind, nodes)?;
        let (last, before) = sizes.split_last()?;
        let start = before.iter().map(|n| n + 2 * mark).sum::<usize>() + mark;
        Some((start, start.checked_add(*last)?.checked_add(mark)?))
    }

    /// Whether the record marks, where this variant has them, say what they must.
    fn marks_agree(self, bytes: &[u8], kind: Kind, dims: [usize; 3]) -> bool {
        if !self.records {
            return true;
        }
        let nodes = dims.iter().product();
        let mut at = 0;
        self.record_sizes(kind, nodes).is_some_and(|sizes| {
            sizes.into_iter().all(|size| {
                let mark = u32::try_from(size).ok();
                let agrees = mark.is_some()
                    && self.word(bytes, at) == mark
                    && self.word(bytes, at + 4 + size) == mark;
                at += size + 8;
                agrees
            })
        })
    }

    fn describe(self) -> String {
        format!(
            "{} {}{}{}{}",
            if self.big_endian {
                "big-endian"
            } else {
                "little-endian"
            },
            if self.double { "f64" } else { "f32" },
            if self.records { ", record marks" } else { "" },
            if self.grid_count { ", grid count" } else { "" },
            if self.blanked { ", iblank" } else { "" },
        )
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Grid,
    Solution,
}

/// Whether a file of `len` bytes that begins with `head` has the size of a PLOT3D grid.
pub(crate) fn looks_like_grid(head: &[u8], len: u64) -> bool {
    sized_variants(head, len).next().is_some()
}

/// Variants, with their dimensions, whose size is that of the file.
fn sized_variants(head: &[u8], len: u64) -> impl Iterator<Item = (Variant, [usize; 3])> {
    Variant::all().filter_map(move |variant| {
        let dims = variant.dims(head)?;
        let (_, end) = variant.body(Kind::Grid, dims)?;
        (end as u64 == len).then_some((variant, dims))
    })
}

/// Reads a grid, and its solution: the one given, or one found beside it.
///
/// # Errors
/// No variant, or more than one, agrees with the file's size; the sizes are listed.
pub(crate) fn read(path: &Path, solution: Option<&Path>) -> Result<Dataset> {
    let bytes = read_all(path)?;
    let mut fitting: Vec<(Variant, [usize; 3])> = sized_variants(&bytes, bytes.len() as u64)
        .filter(|(variant, dims)| variant.marks_agree(&bytes, Kind::Grid, *dims))
        .collect();
    let (variant, dims) = match (fitting.pop(), fitting.pop()) {
        (Some(only), None) => only,
        (Some((a, _)), Some((b, _))) => {
            return Err(Error::format(
                path,
                "PLOT3D grid",
                "one way to read it",
                format!(
                    "at least two of the same size: {}; {}",
                    a.describe(),
                    b.describe()
                ),
                "write the grid with record marks",
            ));
        }
        (None, _) => return Err(no_grid(path, &bytes)),
    };

    let nodes: usize = dims.iter().product();
    let broken = || no_grid(path, &bytes);
    let (start, _) = variant.body(Kind::Grid, dims).ok_or_else(broken)?;
    let size = variant.real().scalar.size();
    let axis = |i: usize| {
        let stride = Stride {
            first: start + i * nodes * size,
            step: size,
            count: nodes,
        };
        doubles(&bytes, variant.real(), stride).ok_or_else(broken)
    };
    let mut positions: Vec<DVec3> = axis(0)?
        .into_iter()
        .map(|x| DVec3::new(x, 0., 0.))
        .collect();
    for (node, y) in positions.iter_mut().zip(axis(1)?) {
        node.y = y;
    }
    for (node, z) in positions.iter_mut().zip(axis(2)?) {
        node.z = z;
    }

    let mut fields = Vec::new();
    let solution = solution
        .map(Path::to_path_buf)
        .or_else(|| solution_beside(path));
    if let Some(solution) = solution {
        fields.extend(read_solution(&solution, path, variant, dims)?);
    }
    if variant.blanked {
        let first = start + 3 * nodes * size;
        let word = Encoding {
            scalar: ScalarType::I32,
            big_endian: variant.big_endian,
        };
        let blanks = doubles(
            &bytes,
            word,
            Stride {
                first,
                step: 4,
                count: nodes,
            },
        )
        .ok_or_else(broken)?;
        let blanks = blanks.into_iter().map(|b| {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "clamped to the type's range"
            )]
            {
                b.clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16
            }
        });
        // Derived fields stay last.
        let stored = fields
            .iter()
            .take_while(|f| !matches!(f.source, FieldSource::Derived(_)));
        let at = stored.count();
        fields.insert(
            at,
            node_field("iblank", FieldSource::Scalar(Values::I16(blanks.collect()))),
        );
    }
    let block = CurvilinearBlock {
        dims,
        nodes: positions,
    };
    let geometry = Geometry::Curvilinear {
        blocks: vec![block],
    };
    Ok(Dataset::new(path, "PLOT3D grid", geometry, fields))
}

fn node_field(name: &str, source: FieldSource) -> Field {
    Field {
        name: name.to_owned(),
        association: Association::Nodes,
        source,
    }
}

/// The solution beside a grid: `xyz` in its name replaced by `q`, if there is such a file.
fn solution_beside(grid: &Path) -> Option<PathBuf> {
    let name = grid.file_name()?.to_str()?;
    let at = name.to_ascii_lowercase().rfind("xyz")?;
    let q = if name[at..].starts_with('X') {
        "Q"
    } else {
        "q"
    };
    let beside = grid.with_file_name(format!("{}{q}{}", &name[..at], &name[at + 3..]));
    regular_len(&beside).is_ok().then_some(beside)
}

fn read_solution(
    path: &Path,
    grid: &Path,
    grid_variant: Variant,
    dims: [usize; 3],
) -> Result<Vec<Field>> {
    let bytes = read_all(path)?;
    let mut found_dims = None;
    let mut sizes = Vec::new();
    let mut fitting: Vec<(Variant, usize)> = Vec::new();
    for variant in Variant::all().filter(|v| !v.blanked) {
        let Some(here) = variant.dims(&bytes) else {
            continue;
        };
        if here != dims {
            // In the wrong byte order, dimensions are far too large for the file.
            let body = variant.body(Kind::Solution, here);
            if body.is_some_and(|(_, end)| end <= bytes.len()) {
                found_dims = found_dims.or(Some(here));
            }
            continue;
        }
        let Some((_, end)) = variant.body(Kind::Solution, dims) else {
            continue;
        };
        sizes.push(format!("{end} bytes ({})", variant.describe()));
        if variant.marks_agree(&bytes, Kind::Solution, dims)
            && bytes
                .get(end..)
                .is_some_and(|rest| rest.iter().all(|&b| b == 0))
        {
            fitting.push((variant, end));
        }
    }
    // Trailing zeros make a large all-zero tail look like padding: exact sizes win, then the
    // grid's own way of writing.
    let exact = |&&(_, end): &&(Variant, usize)| end == bytes.len();
    let like_grid = |&&(v, _): &&(Variant, usize)| {
        Variant {
            blanked: grid_variant.blanked,
            ..v
        } == grid_variant
    };
    let chosen = match fitting.as_slice() {
        [only] => Some(only),
        _ => fitting
            .iter()
            .find(exact)
            .or_else(|| fitting.iter().find(like_grid)),
    };
    let Some(&(variant, end)) = chosen else {
        let [ni, nj, nk] = dims;
        let (expected, found) = if !fitting.is_empty() {
            let ways: Vec<String> = fitting.iter().map(|(v, _)| v.describe()).collect();
            (
                "one way to read it".to_owned(),
                format!("several: {}", ways.join("; ")),
            )
        } else if sizes.is_empty() {
            let found = found_dims.map_or("no dimensions".to_owned(), |[a, b, c]| {
                format!("{a} x {b} x {c} (or no PLOT3D solution)")
            });
            (format!("the grid's {ni} x {nj} x {nk} nodes"), found)
        } else {
            (
                format!("{}, then nothing but zeros", sizes.join(" or ")),
                format!("{} bytes", bytes.len()),
            )
        };
        return Err(Error::format(
            path,
            format!("PLOT3D solution of {}", grid.display()),
            expected,
            found,
            "name the grid's own solution with --solution, or move this file elsewhere",
        ));
    };
    debug_assert!(end <= bytes.len(), "the size was checked");

    let nodes: usize = dims.iter().product();
    let size = variant.real().scalar.size();
    let start = variant
        .body(Kind::Solution, dims)
        .map_or(0, |(start, _)| start);
    let variable = |i: usize| {
        let stride = Stride {
            first: start + i * nodes * size,
            step: size,
            count: nodes,
        };
        values(&bytes, variant.real(), stride).ok_or_else(|| {
            Error::format(
                path,
                "variables",
                "five per node",
                "fewer",
                "write the solution again",
            )
        })
    };
    Ok(vec![
        node_field("density", FieldSource::Scalar(variable(0)?)),
        node_field(
            "momentum",
            FieldSource::Vector(vec![variable(1)?, variable(2)?, variable(3)?]),
        ),
        node_field("energy", FieldSource::Scalar(variable(4)?)),
        node_field(
            "velocity_magnitude",
            FieldSource::Derived(velocity_magnitude),
        ),
        node_field("pressure", FieldSource::Derived(pressure)),
        node_field("mach", FieldSource::Derived(mach)),
    ])
}

/// Applies `f(density, |momentum|, energy)` to every node.
fn derive(data: &Dataset, f: fn(f32, f32, f32) -> f32) -> Result<Values> {
    let (_, density) = data.scalar("density")?;
    let (_, momentum) = data.scalar("momentum")?;
    let (_, energy) = data.scalar("energy")?;
    let nodes = 0..density.len();
    Ok(Values::F32(
        nodes
            .map(|i| f(density.get(i), momentum.get(i), energy.get(i)))
            .collect(),
    ))
}

/// |u| = |rho u| / rho.
fn velocity_magnitude(data: &Dataset) -> Result<Values> {
    derive(data, |density, momentum, _| momentum / density)
}

/// p = (gamma - 1) (e - rho |u|² / 2).
fn perfect_gas_pressure(density: f32, momentum: f32, energy: f32) -> f32 {
    (GAMMA - 1.0) * (energy - 0.5 * momentum * momentum / density)
}

fn pressure(data: &Dataset) -> Result<Values> {
    derive(data, perfect_gas_pressure)
}

/// |u| / c with the speed of sound c = sqrt(gamma p / rho).
fn mach(data: &Dataset) -> Result<Values> {
    derive(data, |density, momentum, energy| {
        let pressure = perfect_gas_pressure(density, momentum, energy);
        momentum / density / (GAMMA * pressure / density).sqrt()
    })
}

/// Why a file is no grid that can be read: several grids, a solution, text, or another size.
fn no_grid(path: &Path, bytes: &[u8]) -> Error {
    let len = bytes.len();
    let error = |expected: String, found: String, advice: &str| {
        Error::format(path, "PLOT3D grid", expected, found, advice)
    };
    for variant in Variant::all().filter(|v| v.grid_count && !v.blanked) {
        if let Some(count) = grid_count_of_multi_grid(variant, bytes) {
            return error(
                "a single grid".to_owned(),
                format!("{count} grids"),
                "several grids in one file are not read yet: write one file per grid",
            );
        }
        for single in [
            variant,
            Variant {
                grid_count: false,
                ..variant
            },
        ] {
            let solution_end = single
                .dims(bytes)
                .and_then(|dims| Some((single.body(Kind::Solution, dims)?.1, dims)));
            if let Some((end, dims)) = solution_end
                && bytes
                    .get(end..)
                    .is_some_and(|rest| rest.iter().all(|&b| b == 0))
                && single.marks_agree(bytes, Kind::Solution, dims)
            {
                return error(
                    "node positions".to_owned(),
                    "a solution (density, momentum, energy)".to_owned(),
                    "give the grid as input and this file with --solution",
                );
            }
        }
    }
    if bytes
        .iter()
        .take(256)
        .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace())
    {
        return error(
            "a binary file".to_owned(),
            "text".to_owned(),
            "ASCII PLOT3D is not read: write the grid unformatted or as a C binary",
        );
    }
    let mut tried: Vec<String> = Vec::new();
    for variant in Variant::all() {
        if let Some(dims) = variant.dims(bytes)
            && let Some((_, end)) = variant.body(Kind::Grid, dims)
            && (end as u64) < (len as u64).saturating_mul(1 << 20)
        {
            let [ni, nj, nk] = dims;
            tried.push(format!(
                "{end} for {ni} x {nj} x {nk} {}",
                variant.describe()
            ));
        }
    }
    let tried = if tried.is_empty() {
        "three node counts at the start, in either byte order".to_owned()
    } else {
        format!("one of these sizes in bytes: {}", tried.join("; "))
    };
    error(
        tried,
        format!("{len} bytes"),
        "check that the file is whole and is a PLOT3D grid",
    )
}

/// The number of grids, where the file has the size of a grid file of two or more.
fn grid_count_of_multi_grid(variant: Variant, bytes: &[u8]) -> Option<usize> {
    let mark = if variant.records { 4 } else { 0 };
    let count = usize::try_from(variant.word(bytes, mark)?).ok()?;
    if count < 2 || count > bytes.len() / 12 {
        return None;
    }
    let first = 4 + 3 * mark;
    let mut nodes: u64 = 0;
    for grid in 0..count {
        let mut product: u64 = 1;
        for i in 0..3 {
            let n = variant.word(bytes, first + 12 * grid + 4 * i)?;
            product = product.checked_mul(u64::from(n)).filter(|&p| p > 0)?;
        }
        nodes = nodes.checked_add(product)?;
    }
    let marks = 2 * mark * (2 + count);
    let fixed = (4 + 12 * count + marks) as u64;
    let real = variant.real().scalar.size() as u64;
    [3 * real, 3 * real + 4]
        .into_iter()
        .any(|per_node| {
            nodes
                .checked_mul(per_node)
                .and_then(|n| n.checked_add(fixed))
                == Some(bytes.len() as u64)
        })
        .then_some(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_flow_has_its_mach_number_and_pressure() {
        // Free stream of Mach 2 along x: rho = 1, a = 1, p = 1 / gamma,
        // e = p / (gamma - 1) + rho u² / 2.
        let energy = 1.0 / (GAMMA * (GAMMA - 1.0)) + 2.0;
        let data = Dataset::new(
            Path::new("free-stream"),
            "",
            Geometry::Points {
                positions: vec![DVec3::ZERO],
            },
            vec![
                node_field("density", FieldSource::Scalar(Values::F32(vec![1.0]))),
                node_field(
                    "momentum",
                    FieldSource::Vector([2.0, 0.0, 0.0].map(|m| Values::F32(vec![m])).into()),
                ),
                node_field("energy", FieldSource::Scalar(Values::F32(vec![energy]))),
            ],
        );
        // A few roundings of f32.
        let close = |values: Values, x: f32| (values.get(0) - x).abs() < 1e-6 * x;
        assert!(close(pressure(&data).unwrap(), 1.0 / GAMMA));
        assert!(close(mach(&data).unwrap(), 2.0));
        assert!(close(velocity_magnitude(&data).unwrap(), 2.0));
    }

    #[test]
    fn variants_differ_in_size_so_that_one_fits() {
        // A grid count of 1 could be mistaken for a dimension; the size tells them apart for
        // all grids of more than one node.
        for dims in [[2_u32, 3, 4], [1, 2, 3], [3, 1, 1], [1, 1, 5]] {
            for variant in Variant::all() {
                let dims_usize = dims.map(|n| n as usize);
                let nodes = dims_usize.iter().product();
                let mut bytes = Vec::new();
                let word = |n: u32| {
                    if variant.big_endian {
                        n.to_be_bytes()
                    } else {
                        n.to_le_bytes()
                    }
                };
                for (i, size) in variant
                    .record_sizes(Kind::Grid, nodes)
                    .unwrap()
                    .into_iter()
                    .enumerate()
                {
                    let mark = word(u32::try_from(size).unwrap());
                    if variant.records {
                        bytes.extend(mark);
                    }
                    match (i, variant.grid_count) {
                        (0, true) => bytes.extend(word(1)),
                        (0, false) | (1, true) => bytes.extend(dims.iter().flat_map(|&n| word(n))),
                        _ => bytes.extend(vec![0x3f; size]),
                    }
                    if variant.records {
                        bytes.extend(mark);
                    }
                }
                let fitting: Vec<_> = sized_variants(&bytes, bytes.len() as u64)
                    .filter(|(v, d)| v.marks_agree(&bytes, Kind::Grid, *d))
                    .collect();
                assert_eq!(fitting, [(variant, dims_usize)]);
            }
        }
    }

    #[test]
    fn the_solution_is_looked_for_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let beside = |grid: &str| {
            solution_beside(&folder.path().join(grid))
                .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
        };
        assert_eq!(beside("finxyz.bin"), None);
        for name in ["finq.bin", "fin.q", "FINQ.BIN"] {
            std::fs::write(folder.path().join(name), [1]).unwrap();
        }
        assert_eq!(beside("finxyz.bin").as_deref(), Some("finq.bin"));
        assert_eq!(beside("fin.xyz").as_deref(), Some("fin.q"));
        assert_eq!(beside("FINXYZ.BIN").as_deref(), Some("FINQ.BIN"));
        assert_eq!(beside("fin.bin"), None);
    }
}
