//! Reads PLOT3D solutions: the flow at the nodes of a grid, and fields derived from it.
//!
//! Derived fields use PLOT3D's non-dimensional perfect gas (velocities in units of the free-stream speed of
//! sound, gamma = 1.4).

use std::path::Path;

use super::companion::{Body, Companion};
use super::layout::{Content, Layout};
use super::node_field;
use crate::data::dataset::{Dataset, Field, FieldSource};
use crate::error::Result;
use crate::io::bytes::file::Input;
use crate::scene::Values;

/// Ratio of specific heats of air.
const GAMMA: f32 = 1.4;

/// The fields of the solution at all nodes of a grid, grid after grid.
///
/// # Errors
/// A solution of another grid, or of no readable size.
pub(super) fn read(
    path: &Path,
    grid: Input<'_>,
    grid_layout: &Layout,
) -> Result<(Vec<Field>, Vec<String>)> {
    let bytes = grid.read_beside(path)?;
    let companion = Companion::new(path, grid.path, Content::Solution, grid_layout);
    companion.read(&bytes, grid_layout, of_body)
}

fn of_body(body: &Body<'_>) -> Result<(Vec<Field>, Vec<String>)> {
    let variable = |v: usize| body.values(v);
    let axes = body.layout.axes;
    let (density, energy) = (variable(0)?, variable(1 + axes)?);
    let mut momentum = (1..=axes).map(variable).collect::<Result<Vec<_>>>()?;
    // In two dimensions the momentum along the third is 0.
    momentum.resize(3, Values::F32(vec![0.0; density.len()]));
    // A quantity that is nowhere above 0 was not stored, and nothing can be derived from it.
    let is_stored = |values: &Values| values.finite_range().is_some_and(|[_, most]| most > 0.0);
    let has = [is_stored(&density), is_stored(&energy)];
    let mut fields = vec![
        node_field("density", FieldSource::Scalar(density)),
        node_field("momentum", FieldSource::Vector(momentum)),
        node_field("energy", FieldSource::Scalar(energy)),
    ];
    let mut notes = Vec::new();
    let mut derive = |name: &str, needs: &[usize], how: fn(&Dataset) -> Result<Values>| match needs
        .iter()
        .find(|variable| !has[**variable])
    {
        None => fields.push(node_field(name, FieldSource::Derived(how))),
        Some(variable) => {
            let missing = ["density", "energy"][*variable];
            notes.push(format!(
                "{name} is not derived: {missing} is nowhere above 0"
            ));
        }
    };
    derive("velocity_magnitude", &[0], velocity_magnitude);
    derive("pressure", &[0, 1], pressure);
    derive("mach", &[0, 1], mach);
    Ok((fields, notes))
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

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::data::dataset::Geometry;

    #[test]
    fn uniform_flow_has_its_mach_number_and_pressure() {
        // Free stream of Mach 2 along x: rho = 1, a = 1, p = 1 / gamma, e = p / (gamma - 1) + rho u² / 2.
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
}
