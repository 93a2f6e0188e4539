//! Typed numbers in buffers, checked in full before the first is read.
//!
//! The crate `gltf` has iterators for this; on short buffers they panic, or end early, and a
//! sparse accessor whose indices are not in order reads wrong. So its types are used, and the
//! bytes are read here.

use std::borrow::Cow;

use gltf_json::accessor::{ComponentType, Type};
use gltf_json::validation::Checked;
use gltf_json::{self as json, Index};

use super::container::Buffers;
use crate::error::Result;

/// The component types that hold normalised or plain numbers of vertices.
pub(super) const ANY_NUMBERS: &[ComponentType] = &[
    ComponentType::F32,
    ComponentType::U8,
    ComponentType::I8,
    ComponentType::U16,
    ComponentType::I16,
];

/// The component types of indices.
pub(super) const INDICES: &[ComponentType] =
    &[ComponentType::U8, ComponentType::U16, ComponentType::U32];

/// An accessor whose elements are all there.
pub(super) struct Accessor<'b> {
    count: usize,
    /// Components of an element.
    width: usize,
    component: ComponentType,
    is_normalized: bool,
    /// Bytes from the first element on and their stride; without them all elements are 0.
    base: Option<(Cow<'b, [u8]>, usize)>,
    /// Indices of the elements that are replaced, in order, and what replaces them.
    sparse: Option<(Vec<usize>, &'b [u8])>,
}

/// What an accessor says of itself.
pub(super) struct Stated<'b> {
    accessor: &'b json::Accessor,
    /// Where it is named, for messages.
    pub(super) place: String,
    /// Components of an element.
    pub(super) width: usize,
    pub(super) component: ComponentType,
}

impl<'b> Stated<'b> {
    /// The accessor at `place`, which may be of any of these types.
    ///
    /// # Errors
    /// No such accessor, or another type.
    pub(super) fn find(
        buffers: &'b Buffers<'_>,
        index: Index<json::Accessor>,
        place: &str,
        types: &[Type],
        components: &[ComponentType],
    ) -> Result<Self> {
        let accessor = buffers.root.get(index).ok_or_else(|| {
            let expected = format!("one of {} accessors", buffers.root.accessors.len());
            buffers.refuse(place, expected, format!("accessor {}", index.value()))
        })?;
        let place = format!("{place}, accessor {}", index.value());
        match (accessor.type_, accessor.component_type) {
            (Checked::Valid(t), Checked::Valid(c))
                if types.contains(&t) && components.contains(&c.0) =>
            {
                Ok(Self {
                    accessor,
                    place,
                    width: t.multiplicity(),
                    component: c.0,
                })
            }
            (t, c) => {
                let expected = format!("{types:?} of {components:?}");
                let found = format!("{t:?} of {c:?}");
                Err(buffers.refuse(place, expected, found))
            }
        }
    }

    /// It with elements from elsewhere, one after another: `component` says how their numbers are stored.
    #[cfg(feature = "draco")]
    pub(super) fn with_elements(self, bytes: Vec<u8>, component: ComponentType) -> Accessor<'b> {
        let size = self.width * component.size();
        Accessor {
            count: bytes.len() / size,
            width: self.width,
            component,
            is_normalized: self.accessor.normalized,
            base: Some((Cow::Owned(bytes), size)),
            sparse: None,
        }
    }

    /// Its elements in the buffers.
    ///
    /// # Errors
    /// Bytes that are not there.
    pub(super) fn open(self, buffers: &'b Buffers<'_>) -> Result<Accessor<'b>> {
        let Self {
            accessor: stated,
            place,
            width,
            component,
        } = self;
        let size = width * component.size();
        let too_many = |count: u64, room: usize| {
            let expected = format!("{count} elements");
            buffers.refuse(&place, expected, format!("room for {room}"))
        };
        let count = |count: u64, room: usize| {
            let fits = usize::try_from(count).ok().filter(|n| *n <= room);
            fits.ok_or_else(|| too_many(count, room))
        };
        let elements = |view, offset: u64, wanted: u64, size: usize, name: &str| {
            let (bytes, stride) = buffers.view(view, &format!("{place}{name}"))?;
            let stride = stride.unwrap_or(size);
            if stride < size {
                let expected = format!("a stride of {size} bytes or more");
                return Err(buffers.refuse(&place, expected, stride.to_string()));
            }
            let bytes = usize::try_from(offset).ok().and_then(|o| bytes.get(o..));
            let bytes = bytes.unwrap_or(&[]);
            let room = (bytes.len() + stride - size) / stride;
            count(wanted, room)?;
            Ok((bytes, stride))
        };
        let base = match stated.buffer_view {
            Some(view) => {
                let offset = stated.byte_offset.map_or(0, |o| o.0);
                let (bytes, stride) = elements(view, offset, stated.count.0, size, "")?;
                Some((Cow::Borrowed(bytes), stride))
            }
            None => None,
        };
        let count_all = match base {
            Some(_) => usize::try_from(stated.count.0).unwrap_or(usize::MAX),
            // Zeros need no bytes: but there is no sense in more of them than the file has.
            None => count(stated.count.0, buffers.byte_count())?,
        };
        let sparse = match &stated.sparse {
            None => None,
            Some(sparse) => {
                let Checked::Valid(kind) = sparse.indices.component_type else {
                    let expected = "indices of type U8, U16 or U32";
                    return Err(buffers.refuse(place, expected, "another type"));
                };
                let size_of_index = kind.0.size();
                let (bytes, stride) = elements(
                    sparse.indices.buffer_view,
                    sparse.indices.byte_offset.0,
                    sparse.count.0,
                    size_of_index,
                    ", sparse indices",
                )?;
                let (values, stride_of_values) = elements(
                    sparse.values.buffer_view,
                    sparse.values.byte_offset.0,
                    sparse.count.0,
                    size,
                    ", sparse values",
                )?;
                if stride_of_values != size {
                    let expected = "sparse values without a stride";
                    return Err(buffers.refuse(place, expected, stride_of_values.to_string()));
                }
                let count = usize::try_from(sparse.count.0).unwrap_or(0);
                let at = |i: usize| unsigned(kind.0, &bytes[i * stride..]) as usize;
                let indices: Vec<usize> = (0..count).map(at).collect();
                let is_sound = indices.is_sorted_by(|a, b| a < b)
                    && indices.last().is_none_or(|last| *last < count_all);
                if !is_sound {
                    let expected = format!("sparse indices that rise, below {count_all}");
                    return Err(buffers.refuse(place, expected, "others"));
                }
                Some((indices, values))
            }
        };
        Ok(Accessor {
            count: count_all,
            width,
            component,
            is_normalized: stated.normalized,
            base,
            sparse,
        })
    }
}

impl<'b> Accessor<'b> {
    /// The accessor at `place`, which may be of any of these types.
    ///
    /// # Errors
    /// Another type, or bytes that are not there.
    pub(super) fn open(
        buffers: &'b Buffers<'_>,
        index: Index<json::Accessor>,
        place: &str,
        types: &[Type],
        components: &[ComponentType],
    ) -> Result<Self> {
        Stated::find(buffers, index, place, types, components)?.open(buffers)
    }

    /// How many elements there are.
    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Components of an element.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// The bytes of an element, or `None` where it is 0; `i` is in range.
    fn element(&self, i: usize) -> Option<&[u8]> {
        if let Some((indices, values)) = &self.sparse
            && let Ok(k) = indices.binary_search(&i)
        {
            return Some(&values[k * self.width * self.component.size()..]);
        }
        self.base
            .as_ref()
            .map(|(bytes, stride)| &bytes[i * stride..])
    }

    /// Element `i`, which is in range, as numbers; those that it does not have are 0. Normalised
    /// integers are fractions of the greatest one.
    pub(super) fn numbers<const N: usize>(&self, i: usize) -> [f64; N] {
        let mut numbers = [0.0; N];
        if let Some(bytes) = self.element(i) {
            let components = bytes.chunks_exact(self.component.size());
            for (number, bytes) in numbers.iter_mut().zip(components.take(self.width)) {
                *number = self.number(bytes);
            }
        }
        numbers
    }

    fn number(&self, bytes: &[u8]) -> f64 {
        let two = || [bytes[0], bytes[1]];
        let (number, greatest) = match self.component {
            ComponentType::F32 => {
                let four = [bytes[0], bytes[1], bytes[2], bytes[3]];
                return f64::from(f32::from_le_bytes(four));
            }
            ComponentType::I8 => (f64::from(i8::from_le_bytes([bytes[0]])), 127.0),
            ComponentType::I16 => (f64::from(i16::from_le_bytes(two())), 32767.0),
            kind @ ComponentType::U8 => (f64::from(unsigned(kind, bytes)), 255.0),
            kind @ ComponentType::U16 => (f64::from(unsigned(kind, bytes)), 65535.0),
            kind @ ComponentType::U32 => (f64::from(unsigned(kind, bytes)), 4_294_967_295.0),
        };
        if self.is_normalized {
            // The least signed integer stands for -1, as the one above it.
            (number / greatest).max(-1.0)
        } else {
            number
        }
    }

    /// Element `i`, which is in range, as an index; of a scalar accessor of [`INDICES`].
    pub(super) fn index(&self, i: usize) -> u32 {
        self.element(i)
            .map_or(0, |bytes| unsigned(self.component, bytes))
    }

    /// Element `i`, which is in range, as four indices.
    pub(super) fn indices(&self, i: usize) -> [u32; 4] {
        let Some(bytes) = self.element(i) else {
            return [0; 4];
        };
        let size = self.component.size();
        std::array::from_fn(|k| {
            let bytes = bytes.get(k * size..).filter(|_| k < self.width);
            bytes.map_or(0, |b| unsigned(self.component, b))
        })
    }
}

/// An unsigned integer at the start of bytes that hold one.
fn unsigned(kind: ComponentType, bytes: &[u8]) -> u32 {
    match kind {
        ComponentType::U32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from(bytes[0]),
    }
}
