//! Defines the storage of columns of numbers: vectors of a volume's own, or a renderer's columns, which may be
//! parts of a file mapped into memory.
//!
//! The two stay apart, because readers and samplers append to vectors and index them in loops: a [`Column`] would copy
//! or branch there. A volume's values are narrowed, too, when they become a renderer's.

use std::fmt;
use std::ops::Deref;
#[cfg(feature = "prepared")]
use std::sync::Arc;

use bytemuck::Pod;
#[cfg(feature = "prepared")]
use yoke::Yoke;

/// Storage of a volume's columns: [`Owned`] or [`Shared`].
pub trait Storage {
    /// A column of `T`s.
    type Of<T: Pod + Send + Sync>: Deref<Target = [T]> + From<Vec<T>> + Default;
}

/// In vectors: volumes that callers make.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Owned {}

/// In [`Column`]s: volumes that a renderer keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shared {}

impl Storage for Owned {
    type Of<T: Pod + Send + Sync> = Vec<T>;
}

impl Storage for Shared {
    type Of<T: Pod + Send + Sync> = Column<T>;
}

/// Bytes that stay in place as long as anything refers to them.
#[cfg(feature = "prepared")]
pub(crate) type SharedBytes = Arc<dyn AsRef<[u8]> + Send + Sync>;

/// A slice and its owner: a vector, or a part of shared bytes.
#[derive(Clone)]
pub struct Column<T: 'static>(Kept<T>);

#[derive(Clone)]
enum Kept<T: 'static> {
    Vector(Vec<T>),
    #[cfg(feature = "prepared")]
    Part(Yoke<&'static [T], SharedBytes>),
}

#[cfg(feature = "prepared")]
impl<T: Pod> Column<T> {
    /// A part of shared bytes. `None` if the part exceeds the bytes, is no whole number of `T`s, or is not
    /// aligned for them.
    pub(crate) fn of_part(bytes: SharedBytes, part: std::ops::Range<usize>) -> Option<Self> {
        let whole = Yoke::try_attach_to_cart(bytes, |bytes| {
            let part = bytes.as_ref().get(part).ok_or(())?;
            bytemuck::try_cast_slice(part).map_err(|_| ())
        });
        whole.ok().map(|part| Self(Kept::Part(part)))
    }
}

impl<T> Column<T> {
    /// Whether the column is a part of shared bytes: of a mapped file.
    pub(crate) fn is_mapped(&self) -> bool {
        match &self.0 {
            Kept::Vector(_) => false,
            #[cfg(feature = "prepared")]
            Kept::Part(_) => true,
        }
    }
}

impl<T: Clone> Column<T> {
    /// Mutable access to the elements; shared bytes are copied first.
    pub fn to_mut(&mut self) -> &mut Vec<T> {
        #[cfg(feature = "prepared")]
        if let Kept::Part(part) = &self.0 {
            self.0 = Kept::Vector(part.get().to_vec());
        }
        match &mut self.0 {
            Kept::Vector(vector) => vector,
            #[cfg(feature = "prepared")]
            Kept::Part(_) => unreachable!("it was copied"),
        }
    }
}

impl<T> Deref for Column<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Kept::Vector(vector) => vector,
            #[cfg(feature = "prepared")]
            Kept::Part(part) => part.get(),
        }
    }
}

impl<T> From<Vec<T>> for Column<T> {
    fn from(vector: Vec<T>) -> Self {
        Self(Kept::Vector(vector))
    }
}

impl<T> Default for Column<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> FromIterator<T> for Column<T> {
    fn from_iter<I: IntoIterator<Item = T>>(elements: I) -> Self {
        elements.into_iter().collect::<Vec<T>>().into()
    }
}

impl<T: PartialEq> PartialEq for Column<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: fmt::Debug> fmt::Debug for Column<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(all(test, feature = "prepared"))]
mod tests {
    use super::*;

    #[test]
    fn parts_are_slices_of_what_others_keep_and_faults_are_none() {
        // Aligned for f64, whatever the allocator.
        let words: Vec<f64> = vec![1.0, 2.0, 3.0];
        struct Words(Vec<f64>);
        impl AsRef<[u8]> for Words {
            fn as_ref(&self) -> &[u8] {
                bytemuck::cast_slice(&self.0)
            }
        }
        let bytes: SharedBytes = Arc::new(Words(words));
        let column = Column::<f64>::of_part(Arc::clone(&bytes), 8..24).unwrap();
        assert_eq!(*column, [2.0, 3.0]);
        let other = column.clone();
        drop((bytes, column));
        // The clone keeps the bytes.
        assert_eq!(*other, [2.0, 3.0]);
        let mut changed = other.clone();
        changed.to_mut()[0] = 5.0;
        assert_eq!((&*changed, &*other), (&[5.0, 3.0][..], &[2.0, 3.0][..]));
        let bytes: SharedBytes = Arc::new(Words(vec![0.0; 2]));
        for part in [0..17, 8..24, 4..12, 24..32] {
            assert!(Column::<f64>::of_part(Arc::clone(&bytes), part).is_none());
        }
        assert_eq!(Column::from(vec![7_u8]), [7].into_iter().collect());
    }
}

/// Picks particles' entries of a column, `width` each.
pub(crate) fn picked<T: Copy>(column: &[T], width: usize, indices: &[u32]) -> Vec<T> {
    if width == 1 {
        return indices.iter().map(|&i| column[i as usize]).collect();
    }
    let mut all = Vec::with_capacity(width * indices.len());
    for &i in indices {
        all.extend_from_slice(&column[i as usize * width..][..width]);
    }
    all
}
