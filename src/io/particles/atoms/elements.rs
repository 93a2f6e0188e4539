//! Names the chemical elements.

/// Symbols by atomic number; 0 stands for an unknown element.
const SYMBOLS: &str = "X H He Li Be B C N O F Ne Na Mg Al Si P S Cl Ar K Ca Sc Ti V Cr Mn Fe Co Ni Cu Zn Ga Ge As Se Br \
                       Kr Rb Sr Y Zr Nb Mo Tc Ru Rh Pd Ag Cd In Sn Sb Te I Xe Cs Ba La Ce Pr Nd Pm Sm Eu Gd Tb Dy Ho \
                       Er Tm Yb Lu Hf Ta W Re Os Ir Pt Au Hg Tl Pb Bi Po At Rn Fr Ra Ac Th Pa U Np Pu Am Cm Bk Cf Es \
                       Fm Md No Lr Rf Db Sg Bh Hs Mt Ds Rg Cn Nh Fl Mc Lv Ts Og";

/// Returns the atomic number of a symbol.
pub(super) fn atomic_number(symbol: &str) -> Option<u8> {
    let at = SYMBOLS.split(' ').position(|known| known == symbol)?;
    u8::try_from(at).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_have_their_numbers() {
        for (symbol, number) in [
            ("H", 1),
            ("Fe", 26),
            ("In", 49),
            ("Lu", 71),
            ("U", 92),
            ("Og", 118),
        ] {
            assert_eq!(atomic_number(symbol), Some(number), "{symbol}");
        }
        assert_eq!(atomic_number("HW1"), None);
        assert_eq!(SYMBOLS.split(' ').count(), 119);
    }
}
