//! Defines a frame: settings, checks, the plan that both back ends read, uniforms, and the trait of a back end.

pub(crate) mod backdrop;
pub(crate) mod backend;
pub(crate) mod check;
pub(crate) mod plan;
pub(crate) mod probe;
pub(crate) mod settings;
pub(crate) mod shadows;
pub(crate) mod supersample;
pub(crate) mod uniforms;
