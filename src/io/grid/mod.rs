//! Grids of solvers: PLOT3D, Tecplot, EnSight, OpenFOAM, Exodus and NetCDF, Gmsh, XDMF, CGNS, Nek5000, plotfiles; levels of refinement.

pub(super) mod amr;
mod block_cells;
mod budget;
pub(super) mod cgns;
pub(super) mod ensight;
mod face_cells;
pub(super) mod gmsh;
mod highest;
pub(super) mod nek;
#[cfg(feature = "netcdf")]
pub(super) mod netcdf;
pub(super) mod openfoam;
mod orders;
pub(super) mod plot3d;
pub(super) mod plotfile;
pub(super) mod tecplot;
pub(super) mod xdmf;
mod zones;
