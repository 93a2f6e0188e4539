//! Reads typed numbers from buffers. All sizes are checked before the first number is read.

use std::borrow::Cow;

use super::container::Buffers;
use super::document::Object;
use crate::error::Result;
use crate::io::vtk::xml::clip;

/// Type of an accessor's elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum Type {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat4,
}

impl Type {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "SCALAR" => Self::Scalar,
            "VEC2" => Self::Vec2,
            "VEC3" => Self::Vec3,
            "VEC4" => Self::Vec4,
            "MAT4" => Self::Mat4,
            _ => return None,
        })
    }

    /// Returns the number of components.
    fn width(self) -> usize {
        match self {
            Self::Scalar => 1,
            Self::Vec2 => 2,
            Self::Vec3 => 3,
            Self::Vec4 => 4,
            Self::Mat4 => 16,
        }
    }
}

/// Number type of an element's components.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::io) enum ComponentType {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl ComponentType {
    /// Names the numbers in messages.
    fn plural(self) -> &'static str {
        match self {
            Self::I8 | Self::U8 => "bytes",
            Self::I16 | Self::U16 => "shorts",
            Self::U32 => "integers",
            Self::F32 => "floats",
        }
    }

    fn of_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Returns the size in bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// Component types of normalised or plain numbers of vertices.
pub(in crate::io) const ANY_NUMBERS: &[ComponentType] = &[
    ComponentType::U8,
    ComponentType::I8,
    ComponentType::U16,
    ComponentType::I16,
    ComponentType::F32,
];

/// Component types of indices.
pub(super) const INDICES: &[ComponentType] =
    &[ComponentType::U8, ComponentType::U16, ComponentType::U32];

/// Accessor whose elements all exist.
pub(in crate::io) struct Accessor<'b> {
    count: usize,
    /// Number of components of an element.
    width: usize,
    component: ComponentType,
    is_normalized: bool,
    /// Bytes from the first element on, and their stride; if `None`, all elements are 0.
    base: Option<(Cow<'b, [u8]>, usize)>,
    /// Sorted indices of the elements that are replaced, and the replacing bytes.
    sparse: Option<(Vec<usize>, &'b [u8])>,
}

/// Accessor as the file states it, before its bytes are found.
pub(super) struct Stated<'b> {
    accessor: Object<'b>,
    /// Place of the reference to it, for messages.
    pub(super) place: String,
    /// Number of components of an element.
    pub(super) width: usize,
    pub(super) component: ComponentType,
}

impl<'b> Stated<'b> {
    /// Finds the accessor at `place`, which may have any of these types.
    ///
    /// # Errors
    /// The accessor does not exist, or has another type.
    pub(super) fn find(
        buffers: &'b Buffers<'_>,
        index: usize,
        place: &str,
        types: &[Type],
        components: &[ComponentType],
    ) -> Result<Self> {
        let accessor = buffers.document.get("accessors", index, place)?;
        let place = format!("{place}, accessor {index}");
        let (kind, code) = (accessor.word("type")?, accessor.integer("componentType")?);
        let type_ = kind.and_then(Type::named).filter(|t| types.contains(t));
        let component = code.and_then(ComponentType::of_code);
        let component = component.filter(|c| components.contains(c));
        match (type_, component) {
            (Some(type_), Some(component)) => Ok(Self {
                accessor,
                place,
                width: type_.width(),
                component,
            }),
            _ => {
                let types = types.iter().map(|t| format!("{t:?}").to_uppercase());
                let mut numbers: Vec<&str> = components.iter().map(|c| c.plural()).collect();
                numbers.dedup();
                let numbers = match numbers.split_last() {
                    Some((last, rest)) if !rest.is_empty() => {
                        format!("{} or {last}", rest.join(", "))
                    }
                    _ => numbers.concat(),
                };
                let types = types.collect::<Vec<String>>().join(" or ");
                let expected = format!("{types} of {numbers}");
                let code = code.map_or("none".into(), |code| code.to_string());
                let found = format!("{} of component type {code}", clip(kind.unwrap_or("none")));
                Err(buffers.refuse(place, expected, found))
            }
        }
    }

    /// Returns the accessor with elements from another source, stored one after another as `component`.
    #[cfg(feature = "draco")]
    pub(super) fn with_elements(self, bytes: Vec<u8>, component: ComponentType) -> Accessor<'b> {
        let size = self.width * component.size();
        Accessor {
            count: bytes.len() / size,
            width: self.width,
            component,
            is_normalized: self.is_normalized(),
            base: Some((Cow::Owned(bytes), size)),
            sparse: None,
        }
    }

    /// Returns true if integers represent fractions.
    #[cfg(feature = "draco")]
    fn is_normalized(&self) -> bool {
        self.accessor.flag("normalized").unwrap_or(false)
    }

    /// Finds the elements in the buffers.
    ///
    /// # Errors
    /// The bytes do not exist.
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
        let elements = |view: usize, offset: u64, wanted: u64, size: usize, name: &str| {
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
        let stated_count = stated.size("count")?;
        let base = match stated.index("bufferView")? {
            Some(view) => {
                let offset = stated.integer("byteOffset")?.unwrap_or(0);
                let (bytes, stride) = elements(view, offset, stated_count, size, "")?;
                Some((Cow::Borrowed(bytes), stride))
            }
            None => None,
        };
        let count_all = match base {
            Some(_) => usize::try_from(stated_count).unwrap_or(usize::MAX),
            // Zeros need no bytes, but a sound file has no more of them than it has bytes.
            None => count(stated_count, buffers.byte_count())?,
        };
        let sparse = match stated.object("sparse")? {
            None => None,
            Some(sparse) => {
                let part = |key: &'static str| -> Result<(Object<'_>, usize, u64)> {
                    let part = sparse.object(key)?;
                    let missing = || buffers.refuse(&place, format!("sparse {key}"), "none");
                    let part = part.ok_or_else(missing)?;
                    let view = part.index("bufferView")?.unwrap_or(usize::MAX);
                    Ok((part, view, part.integer("byteOffset")?.unwrap_or(0)))
                };
                let (indices, view, offset) = part("indices")?;
                let kind = indices.integer("componentType")?;
                let kind = kind.and_then(ComponentType::of_code);
                let Some(kind) = kind.filter(|kind| INDICES.contains(kind)) else {
                    let expected = "sparse indices of bytes, shorts or integers";
                    return Err(buffers.refuse(place, expected, "another type"));
                };
                let sparse_count = sparse.size("count")?;
                let (bytes, stride) =
                    elements(view, offset, sparse_count, kind.size(), ", sparse indices")?;
                let (_, view, offset) = part("values")?;
                let (values, stride_of_values) =
                    elements(view, offset, sparse_count, size, ", sparse values")?;
                if stride_of_values != size {
                    let expected = "sparse values without a stride";
                    return Err(buffers.refuse(place, expected, stride_of_values.to_string()));
                }
                let count = usize::try_from(sparse_count).unwrap_or(0);
                let at = |i: usize| unsigned(kind, &bytes[i * stride..]) as usize;
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
            is_normalized: stated.flag("normalized")?,
            base,
            sparse,
        })
    }
}

impl<'b> Accessor<'b> {
    /// Opens the accessor at `place`, which may have any of these types.
    ///
    /// # Errors
    /// The accessor has another type, or its bytes do not exist.
    pub(in crate::io) fn open(
        buffers: &'b Buffers<'_>,
        index: usize,
        place: &str,
        types: &[Type],
        components: &[ComponentType],
    ) -> Result<Self> {
        Stated::find(buffers, index, place, types, components)?.open(buffers)
    }

    /// Returns the number of elements.
    pub(in crate::io) fn len(&self) -> usize {
        self.count
    }

    /// Returns the number of components of an element.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Returns the bytes of an element, or `None` if it is 0; `i` must be in range.
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

    /// Returns element `i`, which must be in range, as numbers; missing components are 0. Normalised integers are
    /// fractions of the greatest one.
    pub(in crate::io) fn numbers<const N: usize>(&self, i: usize) -> [f64; N] {
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
            // The least signed integer represents -1, as does the one above it.
            (number / greatest).max(-1.0)
        } else {
            number
        }
    }

    /// Returns element `i`, which must be in range, as an index; for scalar accessors of [`INDICES`].
    pub(super) fn index(&self, i: usize) -> u32 {
        self.element(i)
            .map_or(0, |bytes| unsigned(self.component, bytes))
    }

    /// Returns element `i`, which must be in range, as four indices.
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

/// Reads an unsigned integer from the start of `bytes`.
fn unsigned(kind: ComponentType, bytes: &[u8]) -> u32 {
    match kind {
        ComponentType::U32 => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        _ => u32::from(bytes[0]),
    }
}
