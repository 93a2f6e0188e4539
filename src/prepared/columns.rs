//! Defines the columns of a prepared scene. A file has the columns in which any of its batches has entries.

use arrow_schema::{DataType, Field};

/// Type of the numbers in a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    U8,
    U16,
    I16,
    U32,
    F32,
    F64,
}

impl Number {
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn data_type(self) -> DataType {
        match self {
            Self::U8 => DataType::UInt8,
            Self::U16 => DataType::UInt16,
            Self::I16 => DataType::Int16,
            Self::U32 => DataType::UInt32,
            Self::F32 => DataType::Float32,
            Self::F64 => DataType::Float64,
        }
    }
}

/// Type of a column.
#[derive(Debug, Clone, Copy)]
pub(super) struct ColumnType {
    pub(super) name: &'static str,
    pub(super) number: Number,
    /// Number of numbers in an element.
    pub(super) width: usize,
    /// Whether each row has a list of elements, or a single one.
    pub(super) is_list: bool,
}

impl ColumnType {
    /// Bytes in an element.
    pub(super) fn stride(&self) -> usize {
        self.number.bytes() * self.width
    }

    /// Returns the column as an Arrow field without nulls.
    pub(super) fn field(&self) -> Field {
        let number = self.number.data_type();
        let element = match i32::try_from(self.width) {
            Ok(width) if width > 1 => {
                let number = Field::new("item", number, false);
                DataType::FixedSizeList(number.into(), width)
            }
            _ => number,
        };
        let own = if self.is_list {
            DataType::LargeList(Field::new("item", element, false).into())
        } else {
            element
        };
        Field::new(self.name, own, false)
    }
}

macro_rules! columns {
    ($($id:ident $name:literal $number:ident $width:literal $is_list:literal;)*) => {
        /// A column, by its place in [`COLUMNS`].
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub(super) enum Id { $($id),* }

        /// All columns, in the order of files.
        pub(super) const COLUMNS: &[(Id, ColumnType)] = &[$(
            (Id::$id, ColumnType { name: $name, number: Number::$number, width: $width, is_list: $is_list }),
        )*];
    };
}

// Name, type of numbers, numbers in an element, whether a row has a list.
columns! {
    Level "level" U32 1 false;
    Origin "origin" F64 3 false;
    HalfExtent "half_extent" F32 3 false;
    MaxSigma "max_sigma" F32 1 false;
    MinSigma "min_sigma" F32 1 false;
    MaxStrength "max_strength" F32 1 false;
    First "first" U32 1 false;
    Count "count" U32 1 false;
    ValueRange "value_range" F32 2 false;
    ValuesAround "values_around" F32 2 false;
    GreatestSpread "greatest_spread" F32 1 false;
    Parent "parent" U32 1 false;
    Crowding "crowding" F32 1 false;
    Density "density" F64 1 false;
    Visible "visible" F64 6 true;
    Bounds "merge_bounds" F32 7 true;
    Offset "offset" F32 3 true;
    Sigma "sigma" F32 1 true;
    Factor "factor" F32 6 true;
    Tangents "tangents" F32 6 true;
    Strength "strength" F32 1 true;
    Colour "colour" F32 3 true;
    Harmonics "harmonics" F32 1 true;
    ValueU8 "value_u8" U8 1 true;
    ValueI16 "value_i16" I16 1 true;
    ValueU16 "value_u16" U16 1 true;
    ValueF32 "value_f32" F32 1 true;
    Spread "spread" F32 1 true;
    MemberDepth "member_depth" F32 1 true;
    Model "local_model" U16 3 true;
    Normal "normal" U32 1 true;
    Cut "cut" U32 1 true;
    Planes "planes" F32 24 true;
    Index "index" U32 1 true;
}

impl Id {
    pub(super) fn column(self) -> &'static ColumnType {
        &COLUMNS[self as usize].1
    }

    /// Returns the column of a name.
    pub(super) fn named(name: &str) -> Option<Self> {
        let mut columns = COLUMNS.iter();
        columns.find(|(_, c)| c.name == name).map(|(id, _)| *id)
    }
}
