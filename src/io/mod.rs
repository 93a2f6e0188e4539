//! Files in and out, one file of code per format.

mod dataset;

pub use dataset::{Association, Dataset, Field, FieldSource, Geometry};
