//! EWA splatting of unstructured point volumes.

pub mod error;
pub mod image;
pub mod io;
pub mod sample;
pub mod scene;

pub use error::{Error, Result};
pub use image::{DepthImage, Image};
