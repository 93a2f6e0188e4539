//! Writes NIfTI images.

/// Contents of a header; all other bytes are 0.
#[derive(Debug, Clone)]
pub(crate) struct Nifti {
    pub(crate) version: u8,
    pub(crate) big_endian: bool,
    /// True if the numbers are in the same file.
    pub(crate) attached: bool,
    /// Code of the numbers' type, and their sizes.
    pub(crate) datatype: i16,
    pub(crate) sizes: Vec<i16>,
    pub(crate) pixdim: [f32; 4],
    pub(crate) offset: f32,
    pub(crate) slope: [f32; 2],
    pub(crate) qform: Option<[f32; 6]>,
    pub(crate) sform: Option<[f32; 12]>,
}

impl Nifti {
    pub(crate) fn new(datatype: i16, sizes: &[i16]) -> Self {
        Self {
            version: 1,
            big_endian: false,
            attached: true,
            datatype,
            sizes: sizes.to_vec(),
            pixdim: [1.0; 4],
            offset: 0.0,
            slope: [0.0; 2],
            qform: None,
            sform: None,
        }
    }

    /// Returns the header, four bytes of flags if numbers follow, and the numbers.
    pub(crate) fn file(&self, body: &[u8]) -> Vec<u8> {
        let is_first = self.version == 1;
        let len = if is_first { 348 } else { 540 };
        let mut bytes = vec![0; len];
        let mut put = |at: usize, mut word: Vec<u8>| {
            if self.big_endian {
                word.reverse();
            }
            bytes[at..at + word.len()].copy_from_slice(&word);
        };
        put(0, (len as i32).to_le_bytes().to_vec());
        let real = |x: f32| match is_first {
            true => x.to_le_bytes().to_vec(),
            false => f64::from(x).to_le_bytes().to_vec(),
        };
        let code = |x: i16| match is_first {
            true => x.to_le_bytes().to_vec(),
            false => i32::from(x).to_le_bytes().to_vec(),
        };
        let count = |x: i16| match is_first {
            true => x.to_le_bytes().to_vec(),
            false => i64::from(x).to_le_bytes().to_vec(),
        };
        let place = |one: usize, two: usize, i: usize, step: usize| match is_first {
            true => one + i * step / 2,
            false => two + i * step,
        };
        put(place(40, 16, 0, 0), count(self.sizes.len() as i16));
        for (i, size) in self.sizes.iter().enumerate() {
            put(if is_first { 42 + 2 * i } else { 24 + 8 * i }, count(*size));
        }
        put(place(70, 12, 0, 0), self.datatype.to_le_bytes().to_vec());
        for (i, x) in self.pixdim.into_iter().enumerate() {
            put(place(76, 104, i, 8), real(x));
        }
        put(
            place(108, 168, 0, 0),
            match is_first {
                true => self.offset.to_le_bytes().to_vec(),
                false => (self.offset as i64).to_le_bytes().to_vec(),
            },
        );
        for (i, x) in self.slope.into_iter().enumerate() {
            put(place(112, 176, i, 8), real(x));
        }
        put(place(252, 344, 0, 0), code(self.qform.is_some().into()));
        put(place(254, 348, 0, 0), code(self.sform.is_some().into()));
        for (i, x) in self.qform.into_iter().flatten().enumerate() {
            put(place(256, 352, i, 8), real(x));
        }
        for (i, x) in self.sform.into_iter().flatten().enumerate() {
            put(place(280, 400, i, 8), real(x));
        }
        let letter = if self.attached { b'+' } else { b'i' };
        let magic = [b'n', letter, b'0' + self.version, 0];
        let at = if is_first { 344 } else { 4 };
        bytes[at..at + 4].copy_from_slice(&magic);
        if self.attached {
            bytes.extend([0; 4]);
        }
        bytes.extend(body);
        bytes
    }
}
