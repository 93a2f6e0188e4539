//! Stand-in until the sampling branch lands.
#![allow(missing_docs)]
use crate::error::Result;
use crate::io::{Dataset, Geometry};
use crate::scene::*;
#[derive(Debug, Clone)]
pub enum TransferChoice { Automatic, File(std::path::PathBuf), Named(String) }
#[derive(Debug, Clone)]
pub struct SampleOptions { pub field: Option<String>, pub kernel_width: f64, pub transfer: TransferChoice, pub unit_distance: Option<f64> }
impl Default for SampleOptions { fn default() -> Self { Self { field: None, kernel_width: 0.6, transfer: TransferChoice::Automatic, unit_distance: None } } }
#[derive(Debug)]
pub struct Report;
impl Report { pub fn warnings(&self) -> Vec<String> { Vec::new() } }
#[derive(Debug)]
pub struct Sampled { pub volume: PointVolume, pub report: Report }
pub fn volume(dataset: Dataset, o: &SampleOptions) -> Result<Sampled> {
    let (_, values) = dataset.scalar(o.field.as_deref().unwrap_or(dataset.field_names()[0]))?;
    let d = TransferDefaults { range: values.finite_range().unwrap(), unit_distance: o.unit_distance.unwrap_or(1.0) };
    let tf = match &o.transfer {
        TransferChoice::Automatic => TransferFunction::automatic(&values, &d)?,
        TransferChoice::Named(n) => TransferFunction::named(n, &d)?,
        TransferChoice::File(f) => TransferFunction::from_json(f, &std::fs::read_to_string(f).unwrap(), &d)?,
    };
    let Geometry::Lattice(lattice) = dataset.geometry else { todo!() };
    Ok(Sampled { volume: PointVolume { particles: Particles::Lattice { lattice, kernel_width: o.kernel_width },
        strength: Strength::Classified { volumes: vec![] }, colour: Colour::Classified, values: Some(values), transfer_function: Some(tf) }, report: Report })
}
