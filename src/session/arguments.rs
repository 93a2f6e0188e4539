//! Defines settings by name.

#[cfg(test)]
use std::convert::Infallible;
use std::path::PathBuf;

use crate::sample::TransferChoice;

/// Arguments by name, taken one by one. A front end refuses those that nothing took.
///
/// Names are the command line's, with `_` for `-`. Each method returns `None` if the argument is not given.
///
/// # Errors
/// An argument of another type, named in the error's text.
pub trait Arguments {
    /// Error of the front end.
    type Error;

    /// Takes a flag.
    fn flag(&mut self, name: &'static str) -> Result<Option<bool>, Self::Error>;
    /// Takes a number.
    fn float(&mut self, name: &'static str) -> Result<Option<f64>, Self::Error>;
    /// Takes a whole number.
    fn whole(&mut self, name: &'static str) -> Result<Option<i64>, Self::Error>;
    /// Takes a count.
    fn count(&mut self, name: &'static str) -> Result<Option<usize>, Self::Error>;
    /// Takes a text.
    fn text(&mut self, name: &'static str) -> Result<Option<String>, Self::Error>;
    /// Takes texts.
    fn texts(&mut self, name: &'static str) -> Result<Option<Vec<String>>, Self::Error>;
    /// Takes texts by name.
    fn pairs(&mut self, name: &'static str) -> Result<Option<Vec<(String, String)>>, Self::Error>;
    /// Takes a path.
    fn path(&mut self, name: &'static str) -> Result<Option<PathBuf>, Self::Error>;
    /// Takes several numbers.
    fn floats<const N: usize>(
        &mut self,
        name: &'static str,
    ) -> Result<Option<[f64; N]>, Self::Error>;
    /// Takes several counts.
    fn counts<const N: usize>(
        &mut self,
        name: &'static str,
    ) -> Result<Option<[usize; N]>, Self::Error>;
    /// Takes rows of numbers.
    fn rows<const N: usize>(
        &mut self,
        name: &'static str,
    ) -> Result<Option<Vec<[f64; N]>>, Self::Error>;
    /// Takes a transfer function.
    fn transfer(&mut self, name: &'static str) -> Result<Option<TransferChoice>, Self::Error>;
    /// Makes the error for an argument whose value cannot be used.
    fn refused(text: impl Into<String>) -> Self::Error;
}

/// Takes an argument that names one of several values.
///
/// # Errors
/// Another name.
pub fn choice<A: Arguments, T: Copy>(
    said: &mut A,
    name: &'static str,
    choices: &[(&str, T)],
) -> Result<Option<T>, A::Error> {
    let Some(text) = said.text(name)? else {
        return Ok(None);
    };
    let found = choices.iter().find(|(own, _)| *own == text);
    found.map(|(_, value)| Some(*value)).ok_or_else(|| {
        let names: Vec<&str> = choices.iter().map(|(own, _)| *own).collect();
        let names = names.join(", ");
        A::refused(format!("{name}: expected one of {names}, found {text}"))
    })
}

/// Takes a number within bounds.
///
/// # Errors
/// A number that `is` refuses.
pub fn number<A: Arguments>(
    said: &mut A,
    name: &'static str,
    expected: &str,
    is: impl Fn(f64) -> bool,
) -> Result<Option<f64>, A::Error> {
    let number = said.float(name)?;
    match number.filter(|x| !is(*x)) {
        None => Ok(number),
        Some(found) => Err(A::refused(format!(
            "{name}: expected {expected}, found {found}"
        ))),
    }
}

/// Takes a finite number above 0.
///
/// # Errors
/// Another number.
pub fn positive<A: Arguments>(said: &mut A, name: &'static str) -> Result<Option<f64>, A::Error> {
    number(said, name, "a number above 0", |x| x > 0.0 && x.is_finite())
}

/// Takes two finite numbers, the lower one first.
///
/// # Errors
/// Other numbers.
pub fn range<A: Arguments>(said: &mut A, name: &'static str) -> Result<Option<[f64; 2]>, A::Error> {
    let range = said.floats::<2>(name)?;
    match range.filter(|[a, b]| !(a < b && a.is_finite() && b.is_finite())) {
        None => Ok(range),
        Some([a, b]) => Err(A::refused(format!(
            "{name}: expected two finite numbers, the lower one first, found {a}, {b}"
        ))),
    }
}

/// Arguments of a caller who gives none.
#[cfg(test)]
#[derive(Debug)]
pub(super) struct Nothing;

#[cfg(test)]
impl Arguments for Nothing {
    type Error = Infallible;

    fn flag(&mut self, _: &'static str) -> Result<Option<bool>, Infallible> {
        Ok(None)
    }
    fn float(&mut self, _: &'static str) -> Result<Option<f64>, Infallible> {
        Ok(None)
    }
    fn whole(&mut self, _: &'static str) -> Result<Option<i64>, Infallible> {
        Ok(None)
    }
    fn count(&mut self, _: &'static str) -> Result<Option<usize>, Infallible> {
        Ok(None)
    }
    fn text(&mut self, _: &'static str) -> Result<Option<String>, Infallible> {
        Ok(None)
    }
    fn texts(&mut self, _: &'static str) -> Result<Option<Vec<String>>, Infallible> {
        Ok(None)
    }
    fn pairs(&mut self, _: &'static str) -> Result<Option<Vec<(String, String)>>, Infallible> {
        Ok(None)
    }
    fn path(&mut self, _: &'static str) -> Result<Option<PathBuf>, Infallible> {
        Ok(None)
    }
    fn floats<const N: usize>(&mut self, _: &'static str) -> Result<Option<[f64; N]>, Infallible> {
        Ok(None)
    }
    fn counts<const N: usize>(
        &mut self,
        _: &'static str,
    ) -> Result<Option<[usize; N]>, Infallible> {
        Ok(None)
    }
    fn rows<const N: usize>(
        &mut self,
        _: &'static str,
    ) -> Result<Option<Vec<[f64; N]>>, Infallible> {
        Ok(None)
    }
    fn transfer(&mut self, _: &'static str) -> Result<Option<TransferChoice>, Infallible> {
        Ok(None)
    }
    fn refused(text: impl Into<String>) -> Infallible {
        panic!("{}", text.into())
    }
}
