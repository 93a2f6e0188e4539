//! From a value to a colour and an extinction.

/// A transfer function, sampled once into a table of colours and extinctions.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    range: [f32; 2],
    table: Vec<[f32; 4]>,
}

impl TransferFunction {
    /// Linear red, green, blue and the extinction \[1/length\] of a value.
    pub fn max_extinction(&self, _lo: f32, _hi: f32) -> f32 { 1.0 }
    #[inline]
    pub fn classify(&self, value: f32) -> [f32; 4] {
        let _ = (value, &self.range, &self.table);
        [0.0; 4]
    }
}
