//! Damages sound files at random.

use proptest::prelude::*;

/// One way to damage a file; positions are fractions of its length.
#[derive(Debug, Clone)]
pub(crate) enum Damage {
    /// Cut the rest off.
    Truncate(f64),
    /// Flip bits of a byte.
    Flip(f64, u8),
    /// Overwrite a word with an extreme one.
    Word(f64, u64, bool),
    /// Copy a stretch to another place.
    Splice(f64, f64, usize),
    /// Take a stretch out.
    Remove(f64, usize),
    /// Put a digit where there is one.
    Digit(f64, u8),
}

/// Returns any one damage.
pub(crate) fn damage() -> impl Strategy<Value = Damage> {
    let at = 0.0..1.0_f64;
    let extreme = prop_oneof![
        Just(u64::MAX),
        Just(u64::MAX / 2),
        Just(0),
        Just(1 << 31),
        Just(0x7fff_ffff_7fff_ffff),
        any::<u64>(),
    ];
    prop_oneof![
        at.clone().prop_map(Damage::Truncate),
        (at.clone(), any::<u8>()).prop_map(|(at, b)| Damage::Flip(at, b)),
        (at.clone(), extreme, any::<bool>()).prop_map(|(at, w, wide)| Damage::Word(at, w, wide)),
        (at.clone(), at.clone(), 1..64_usize).prop_map(|(a, b, n)| Damage::Splice(a, b, n)),
        (at.clone(), 1..64_usize).prop_map(|(at, n)| Damage::Remove(at, n)),
        (at, b'0'..=b'9').prop_map(|(at, d)| Damage::Digit(at, d)),
    ]
}

/// Applies a damage.
pub(crate) fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    let len = bytes.len();
    let index = |at: f64| (at * len as f64) as usize;
    if bytes.is_empty() {
        return;
    }
    match *damage {
        Damage::Truncate(at) => bytes.truncate(index(at)),
        Damage::Flip(at, bits) => bytes[index(at)] ^= bits,
        Damage::Word(at, word, wide) => {
            let n = if wide { 8 } else { 4 };
            for (b, w) in bytes[index(at)..].iter_mut().zip(&word.to_le_bytes()[..n]) {
                *b = *w;
            }
        }
        Damage::Splice(from, to, n) => {
            let stretch = bytes[index(from)..]
                .iter()
                .take(n)
                .copied()
                .collect::<Vec<_>>();
            let at = index(to);
            bytes.splice(at..at, stretch);
        }
        Damage::Remove(at, n) => {
            let at = index(at);
            bytes.drain(at..(at + n).min(len));
        }
        Damage::Digit(at, digit) => {
            let at = index(at);
            if let Some(b) = bytes[at..].iter_mut().find(|b| b.is_ascii_digit()) {
                *b = digit;
            }
        }
    }
}
