//! Binds `ewa_splat` to Python: converts arrays to scenes, and scenes to arrays.
//!
//! The package around it (`python/ewa_splat`) holds the documentation. It converts arrays to the
//! layouts accepted here, and reads other packages' objects.

mod arrays;
mod camera;
mod deep;
mod drawable;
mod errors;
mod pictures;
mod program;
mod renderer;
mod settings;
mod task;

/// The compiled part of `ewa_splat`.
#[pyo3::pymodule]
mod _core {
    #[pymodule_export]
    use super::deep::Deep;
    #[pymodule_export]
    use super::drawable::Drawable;
    #[pymodule_export]
    use super::pictures::{
        column_colours, column_look, compare, read_image, write_column, write_image,
    };
    #[pymodule_export]
    use super::program::main;
    #[pymodule_export]
    use super::renderer::Renderer;
    #[pymodule_export]
    use super::settings::check_transfer_function;
}
