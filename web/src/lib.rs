//! Draws data in a browser: the module that the page's worker loads.
//!
//! A worker calls one function at a time and waits for its promise. Data stay in the module; pictures leave it as bytes.

mod camera;
mod column;
mod file;
mod legend;
mod picture;
mod scene;
mod signal;

use ewa_splat::render::{AdapterChoice, Gpu};
use ewa_splat::scene::{TransferDefaults, TransferFunction};
use wasm_bindgen::prelude::*;

pub use column::Column;
pub use picture::Picture;
pub use scene::Scene;

/// Converts any error to JavaScript's, with its text.
fn thrown(error: impl std::fmt::Display) -> JsError {
    JsError::new(&error.to_string())
}

/// Keeps the text of a panic for the worker, which then starts a new module.
#[wasm_bindgen(start)]
fn start() {
    std::panic::set_hook(Box::new(|info| {
        let text = JsValue::from_str(&info.to_string());
        // The worker's own object; a module without one has nobody to tell.
        let _ = js_sys::Reflect::set(&js_sys::global(), &JsValue::from_str("panicked"), &text);
    }));
}

/// Version of the library.
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").into()
}

/// Names of the colour maps.
#[wasm_bindgen(js_name = colourMaps)]
pub fn colour_maps() -> Vec<String> {
    let names = ewa_splat::scene::COLOUR_MAP_NAMES;
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// Endings of the files that are read, without dots.
#[wasm_bindgen]
pub fn endings() -> Vec<String> {
    let formats = ewa_splat::io::formats();
    let endings = formats.iter().flat_map(|format| format.endings);
    endings.map(|ending| (*ending).to_owned()).collect()
}

/// Bytes of the module's memory.
#[wasm_bindgen(js_name = memoryBytes)]
pub fn memory_bytes() -> f64 {
    let memory: js_sys::WebAssembly::Memory = wasm_bindgen::memory().unchecked_into();
    let buffer: js_sys::ArrayBuffer = memory.buffer().unchecked_into();
    buffer.byte_length().into()
}

/// A device of WebGPU.
#[wasm_bindgen]
#[derive(Debug, Clone)]
pub struct Device {
    gpu: Gpu,
}

#[wasm_bindgen]
impl Device {
    /// Opens a device.
    ///
    /// # Errors
    /// No adapter, or one that cannot be opened.
    pub async fn open() -> Result<Device, JsError> {
        let gpu = Gpu::open_async(AdapterChoice::Any).await;
        Ok(Self {
            gpu: gpu.map_err(thrown)?,
        })
    }

    /// Name, driver and interface of the adapter.
    #[wasm_bindgen(getter)]
    pub fn adapter(&self) -> String {
        self.gpu.adapter()
    }

    /// True if the adapter runs in software.
    #[wasm_bindgen(getter, js_name = isSoftware)]
    pub fn is_software(&self) -> bool {
        self.gpu.is_software()
    }
}

/// A colour map as a transfer function over 0 to 1, in the form of its files.
///
/// # Errors
/// An unknown name.
#[wasm_bindgen(js_name = mapFunction)]
pub fn map_function(name: &str) -> Result<String, JsError> {
    let defaults = TransferDefaults {
        range: [0.0, 1.0],
        unit_distance: 1.0,
    };
    let function = TransferFunction::named(name, &defaults).map_err(thrown)?;
    Ok(function.to_json())
}
