//! Grids of solvers: PLOT3D, Tecplot, EnSight, OpenFOAM, Exodus and NetCDF, plotfiles; levels of refinement.

pub(super) mod amr;
pub(super) mod ensight;
#[cfg(feature = "netcdf")]
pub(super) mod netcdf;
pub(super) mod openfoam;
pub(super) mod plot3d;
pub(super) mod plotfile;
pub(super) mod tecplot;
