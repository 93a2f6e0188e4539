//! Writes binary Gadget snapshots in all forms.

/// Form of a snapshot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Form {
    /// True for format 2.
    pub(crate) has_names: bool,
    pub(crate) big_endian: bool,
    /// True for numbers of 64 bits.
    pub(crate) is_wide: bool,
}

/// Number of particles of each type, and the number of the first of them; the others follow. The
/// types are gas, dark matter and stars. Dark matter has its mass in the header.
pub(crate) type Counts = [(usize, usize); 3];

pub(crate) const SOME: Counts = [(4, 0), (3, 100), (2, 200)];
/// The same particles in two files.
pub(crate) const HALVES: [Counts; 2] = [[(3, 0), (0, 100), (1, 200)], [(1, 3), (3, 100), (1, 201)]];

/// The mass of dark matter.
pub(crate) const DARK: f64 = 7.5;

/// Returns a number that identifies the particle and the field.
pub(crate) fn value(particle: usize, field: usize) -> f64 {
    particle as f64 + field as f64 / 8.0
}

impl Form {
    pub(crate) fn all() -> Vec<Self> {
        let form = |bits: usize| Self {
            has_names: bits & 1 > 0,
            big_endian: bits & 2 > 0,
            is_wide: bits & 4 > 0,
        };
        (0..8).map(form).collect()
    }

    fn word(self, number: u32) -> [u8; 4] {
        match self.big_endian {
            true => number.to_be_bytes(),
            false => number.to_le_bytes(),
        }
    }

    fn double(self, number: f64) -> [u8; 8] {
        match self.big_endian {
            true => number.to_be_bytes(),
            false => number.to_le_bytes(),
        }
    }

    fn real(self, number: f64) -> Vec<u8> {
        match (self.is_wide, self.big_endian) {
            (true, _) => self.double(number).to_vec(),
            (false, true) => (number as f32).to_be_bytes().to_vec(),
            (false, false) => (number as f32).to_le_bytes().to_vec(),
        }
    }

    fn record(self, out: &mut Vec<u8>, name: &[u8; 4], bytes: &[u8]) {
        let mark = self.word(bytes.len() as u32);
        if self.has_names {
            out.extend(self.word(8));
            out.extend(name);
            out.extend(self.word(bytes.len() as u32 + 8));
            out.extend(self.word(8));
        }
        out.extend(mark);
        out.extend(bytes);
        out.extend(mark);
    }

    /// Writes one of `files` files.
    pub(crate) fn snapshot(self, files: u32, counts: &Counts) -> Vec<u8> {
        let [gas, dark, stars] = counts;
        let mut header = Vec::new();
        let per_type = [gas.0, dark.0, 0, 0, stars.0, 0];
        header.extend(per_type.iter().flat_map(|&n| self.word(n as u32)));
        let masses = [0.0, DARK, 0.0, 0.0, 0.0, 0.0];
        header.extend(masses.iter().flat_map(|&m| self.double(m)));
        header.extend(self.double(0.5));
        header.extend(self.double(1.0));
        header.resize(96, 0);
        header.extend([4, 3, 0, 0, 2, 0].iter().flat_map(|&n: &u32| self.word(n)));
        header.resize(124, 0);
        header.extend(self.word(files));
        for number in [10.0, 0.3, 0.7, 0.7] {
            header.extend(self.double(number));
        }
        header.resize(256, 0);
        let mut out = Vec::new();
        self.record(&mut out, b"HEAD", &header);
        let of = |range: (usize, usize)| range.1..range.1 + range.0;
        let all: Vec<usize> = of(*gas).chain(of(*dark)).chain(of(*stars)).collect();
        let own_mass: Vec<usize> = of(*gas).chain(of(*stars)).collect();
        let gas: Vec<usize> = of(*gas).collect();
        let reals = |particles: &[usize], fields: &[usize]| -> Vec<u8> {
            let of_particle = |&p: &usize| fields.iter().flat_map(move |&f| self.real(value(p, f)));
            particles.iter().flat_map(of_particle).collect()
        };
        self.record(&mut out, b"POS ", &reals(&all, &[0, 1, 2]));
        self.record(&mut out, b"VEL ", &reals(&all, &[3, 4, 5]));
        let ids: Vec<u8> = all.iter().flat_map(|&p| self.word(p as u32)).collect();
        self.record(&mut out, b"ID  ", &ids);
        self.record(&mut out, b"MASS", &reals(&own_mass, &[6]));
        if !gas.is_empty() {
            self.record(&mut out, b"U   ", &reals(&gas, &[7]));
            self.record(&mut out, b"RHO ", &reals(&gas, &[8]));
            self.record(&mut out, b"HSML", &reals(&gas, &[9]));
        }
        out
    }
}
