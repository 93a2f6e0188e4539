//! Fields: the one that is shown, its gradients, local models and statistics.

pub(crate) mod choice;
pub(crate) mod field_choice;
pub(crate) mod fit;
pub(crate) mod gradient;
pub(crate) mod local_models;
pub(crate) mod picked;
pub(crate) mod statistics;
pub(crate) mod together;
