//! Measures ewa-splat: the programs in `examples/` reproduce the papers' figures, time stages, and compare images with
//! reference images; `lab/benches/` time single stages.
