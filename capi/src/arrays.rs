//! Defines numbers that were copied from the caller's arrays.

use ewa_splat::scene::Values;

use super::failure::{Failure, Result};

/// Numbers in the caller's type.
#[derive(Debug, Clone)]
pub(crate) enum Numbers {
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Numbers {
    /// Returns their number.
    pub(crate) fn count(&self) -> usize {
        match self {
            Self::U8(numbers) => numbers.len(),
            Self::I16(numbers) => numbers.len(),
            Self::U16(numbers) => numbers.len(),
            Self::I32(numbers) => numbers.len(),
            Self::I64(numbers) => numbers.len(),
            Self::F32(numbers) => numbers.len(),
            Self::F64(numbers) => numbers.len(),
        }
    }

    fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "EWA_U8",
            Self::I16(_) => "EWA_I16",
            Self::U16(_) => "EWA_U16",
            Self::I32(_) => "EWA_I32",
            Self::I64(_) => "EWA_I64",
            Self::F32(_) => "EWA_F32",
            Self::F64(_) => "EWA_F64",
        }
    }

    /// Returns values of a field.
    ///
    /// # Errors
    /// Integers of 64 bits, which double precision may not represent.
    pub(crate) fn values(self, name: &str) -> Result<Values> {
        Ok(match self {
            Self::U8(numbers) => numbers.into(),
            Self::I16(numbers) => numbers.into(),
            Self::U16(numbers) => numbers.into(),
            Self::I32(numbers) => {
                Values::from(numbers.into_iter().map(f64::from).collect::<Vec<_>>())
            }
            Self::F32(numbers) => numbers.into(),
            Self::F64(numbers) => numbers.into(),
            Self::I64(_) => return Err(self.refused(name, "values of at most 32 bits, or EWA_F64")),
        })
    }

    /// Returns coordinates.
    ///
    /// # Errors
    /// Integers.
    pub(crate) fn floats(self, name: &str) -> Result<Vec<f64>> {
        match self {
            Self::F32(numbers) => Ok(numbers.into_iter().map(f64::from).collect()),
            Self::F64(numbers) => Ok(numbers),
            other => Err(other.refused(name, "EWA_F32 or EWA_F64")),
        }
    }

    /// Returns indices.
    ///
    /// # Errors
    /// Other types than integers of 32 and 64 bits.
    pub(crate) fn indices(self, name: &str) -> Result<Vec<i64>> {
        match self {
            Self::I32(numbers) => Ok(numbers.into_iter().map(i64::from).collect()),
            Self::I64(numbers) => Ok(numbers),
            other => Err(other.refused(name, "EWA_I32 or EWA_I64")),
        }
    }

    /// Returns bytes.
    ///
    /// # Errors
    /// Another type.
    pub(crate) fn bytes(self, name: &str) -> Result<Vec<u8>> {
        match self {
            Self::U8(numbers) => Ok(numbers),
            other => Err(other.refused(name, "EWA_U8")),
        }
    }

    fn refused(&self, name: &str, expected: &str) -> Failure {
        let found = self.type_name();
        Failure::invalid(format!("{name}: expected {expected}, found {found}"))
    }
}
