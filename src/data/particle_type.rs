//! Defines the types of particles in snapshots, as named by `--type` and
//! [`OpenOptions::particle_type`](crate::io::OpenOptions).

use std::fmt;

/// A type of particles in a snapshot.
///
/// | type | Gadget, Gizmo, Arepo, SWIFT | Phantom |
/// |---|---|---|
/// | gas | `PartType0` | itype 1 |
/// | dark matter | `PartType1` | itype 5 |
/// | disk | `PartType2` | |
/// | bulge | `PartType3` | itype 6 |
/// | stars | `PartType4` | itype 4 |
/// | black holes | `PartType5` | |
/// | dust | `PartType3` | from the header's `idust` (7) to before `idustbound` |
/// | boundary | `PartType5` | itype 3, and from `idustbound` on |
/// | sinks | `PartType3` | group `sinks` |
/// | a number N | `PartTypeN` | itype N |
///
/// The meaning of Gadget's numbers differs between codes, and files do not state it. 3 is Gadget's bulge,
/// Gizmo's dust and SWIFT's sinks; 5 is Gadget's boundary and the black holes of its descendants. Either name
/// selects the number. Tipsy snapshots have gas, dark matter and stars, with the numbers 0, 1 and 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ParticleType {
    /// Gas.
    Gas,
    /// Dark matter.
    DarkMatter,
    /// Stars of a disk.
    Disk,
    /// Stars of a bulge.
    Bulge,
    /// Stars.
    Stars,
    /// Black holes.
    BlackHoles,
    /// Dust.
    Dust,
    /// Boundary particles.
    Boundary,
    /// Points that accrete.
    Sinks,
    /// The code's own number.
    Number(u32),
}

impl ParticleType {
    /// All types with names.
    pub const NAMED: [Self; 9] = [
        Self::Gas,
        Self::DarkMatter,
        Self::Disk,
        Self::Bulge,
        Self::Stars,
        Self::BlackHoles,
        Self::Dust,
        Self::Boundary,
        Self::Sinks,
    ];

    /// The type with a name as written by `Display`, or with a number.
    ///
    /// ```
    /// use ewa_splat::io::ParticleType;
    ///
    /// assert_eq!(ParticleType::of_name("dark-matter"), Some(ParticleType::DarkMatter));
    /// assert_eq!(ParticleType::of_name("4"), Some(ParticleType::Number(4)));
    /// assert_eq!(ParticleType::of_name("plasma"), None);
    /// ```
    pub fn of_name(name: &str) -> Option<Self> {
        let named = Self::NAMED.into_iter().find(|t| t.to_string() == name);
        named.or_else(|| name.parse().ok().map(Self::Number))
    }
}

impl fmt::Display for ParticleType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gas => "gas",
            Self::DarkMatter => "dark-matter",
            Self::Disk => "disk",
            Self::Bulge => "bulge",
            Self::Stars => "stars",
            Self::BlackHoles => "black-holes",
            Self::Dust => "dust",
            Self::Boundary => "boundary",
            Self::Sinks => "sinks",
            Self::Number(number) => return write!(f, "{number}"),
        })
    }
}

/// The particles of one type in a snapshot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ParticleCount {
    /// Name in the file: `PartType1`, `itype 1`, `sinks`.
    pub name: String,
    /// Types that select these particles: several if codes disagree, none if there is only a number.
    pub types: Vec<ParticleType>,
    /// Number of particles.
    pub count: usize,
    /// Whether the data set includes them.
    pub is_read: bool,
}

impl ParticleCount {
    /// Whether these are the particles of a type.
    ///
    /// - `number`: the code's own number of these particles.
    pub(crate) fn is(&self, number: Option<u32>, wanted: ParticleType) -> bool {
        match wanted {
            ParticleType::Number(n) => number == Some(n),
            named => self.types.contains(&named),
        }
    }
}

impl fmt::Display for ParticleCount {
    /// `PartType5 (boundary or black-holes)`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        let names: Vec<String> = self.types.iter().map(ParticleType::to_string).collect();
        if names.is_empty() || names == [self.name.as_str()] {
            return Ok(());
        }
        write!(f, " ({})", names.join(" or "))
    }
}
