//! stub
use super::{Dataset, OpenOptions};
use crate::error::Result;
use crate::scene::{Lattice, Values};
use std::ops::Range;
use std::path::Path;
#[derive(Debug)]
pub(crate) struct Planes;
impl Planes {
    pub(crate) fn open(_: &Path, _: &OpenOptions, _: Option<&str>) -> Result<Option<Self>> {
        Ok(None)
    }
    pub(crate) fn lattice(&self) -> &Lattice {
        unimplemented!()
    }
    pub(crate) fn field(&self) -> &str {
        ""
    }
    pub(crate) fn path(&self) -> &Path {
        Path::new("")
    }
    pub(crate) fn unit(&self) -> Option<&str> {
        None
    }
    pub(crate) fn empty_values(&self) -> Values {
        unimplemented!()
    }
    pub(crate) fn notes(&self) -> &[String] {
        &[]
    }
    pub(crate) fn format(&self) -> &str {
        ""
    }
    pub(crate) fn head(&self) -> Result<Dataset> {
        unimplemented!()
    }
    pub(crate) fn read(&self, _: Range<usize>) -> Result<Values> {
        unimplemented!()
    }
}
