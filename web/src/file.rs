//! Reads files of the page in ranges.

use std::io;

use ewa_splat::io::Ranges;
use js_sys::{Function, Reflect, Uint8Array};
use wasm_bindgen::prelude::*;

/// A file that the caller gives.
#[derive(Debug)]
pub(crate) enum Given {
    /// Its bytes.
    Bytes(Uint8Array),
    /// An object with its `size`, and `read(from, length)`, which returns bytes.
    Object {
        object: JsValue,
        read: Function,
        size: u64,
    },
}

impl Given {
    /// Returns the file of a value; `None` if it is neither.
    pub(crate) fn of(value: JsValue) -> Option<Self> {
        let object = match value.dyn_into::<Uint8Array>() {
            Ok(bytes) => return Some(Self::Bytes(bytes)),
            Err(object) => object,
        };
        let of = |name: &str| Reflect::get(&object, &JsValue::from_str(name)).ok();
        let (read, size) = (of("read")?.dyn_into().ok()?, of("size")?.as_f64()?);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "sizes of files are whole numbers; others saturate"
        )]
        let size = size as u64;
        Some(Self::Object { object, read, size })
    }
}

impl Ranges for Given {
    fn len(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.length().into(),
            Self::Object { size, .. } => *size,
        }
    }

    fn read_at(&self, from: u64, into: &mut [u8]) -> io::Result<()> {
        let failed = || io::Error::other("the browser cannot read the file");
        let wanted = into.len();
        let found = match self {
            Self::Bytes(bytes) => {
                let from = u32::try_from(from).map_err(|_| failed())?;
                let length = u32::try_from(wanted).map_err(|_| failed())?;
                bytes.subarray(from, from.saturating_add(length))
            }
            Self::Object { object, read, .. } => {
                let found = read.call2(object, &(from as f64).into(), &(wanted as f64).into());
                let found = found.map_err(|_| failed())?;
                found.dyn_into().map_err(|_| failed())?
            }
        };
        if found.length() as usize != wanted {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        found.copy_to(into);
        Ok(())
    }
}
