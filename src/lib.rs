//! EWA splatting of unstructured point volumes.

pub mod blocks;
pub mod constants;
pub mod cpu;
pub mod error;
pub mod image;
pub mod io;
pub mod layout;
pub mod math;
pub mod render;
pub mod scene;
pub mod splat;
pub mod view;

pub use error::{Error, Result};
pub use image::{DepthImage, Image};
pub use render::{Renderer, Settings};
