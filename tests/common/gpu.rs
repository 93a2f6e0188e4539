//! The device that the tests of the GPU back end share.

use std::sync::OnceLock;

use ewa_splat::gpu::{AdapterChoice, Gpu};

/// An open device, or `None` (with a word about it) where there is no adapter.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| match Gpu::open(AdapterChoice::Any) {
        Ok(gpu) => {
            println!("adapter: {}", gpu.adapter());
            Some(gpu)
        }
        Err(e) => {
            let required = std::env::var_os("EWA_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!required, "a GPU adapter is required: {e}");
            println!("skipped: {e}");
            None
        }
    })
    .as_ref()
}
