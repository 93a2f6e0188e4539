//! Measurements of ewa-splat: `examples/` are programs that draw the papers' figures, time stages and compare pictures with
//! the truth; `lab/benches/` time single stages.
