//! Reads and writes data files and images; each format has its own module.
//!
//! [`open`] recognises a data file by its content, then by its name. [`write_image`], [`write_depth`] and
//! [`read_image`] choose the format by the file's extension.
//!
//! Every reader compares the sizes in a header with the length of the file before it allocates. Every writer writes a
//! temporary file and renames it when it is complete.

pub(crate) mod bytes;
mod cloud;
mod folder;
mod format;
mod formats;
mod grid;
mod mesh;
mod open;
mod options;
mod particles;
mod parts;
mod picture;
mod ply;
pub(crate) mod refused;
pub(crate) mod splats;
mod time_steps;
mod volume;
mod vtk;

#[cfg(feature = "prepared")]
pub(crate) use self::bytes::atomic::write_atomically;
pub use self::bytes::atomic::write_bytes_atomically;
pub use self::bytes::file::Ranges;
#[cfg(feature = "cli")]
pub(crate) use self::folder::of_folder;
pub use self::format::{Family, Format};
pub(crate) use self::formats::recognise;
pub use self::formats::{format_of, formats};
pub(crate) use self::mesh::gltf::{is_gltf, read_gltf_cameras};
pub(crate) use self::mesh::mesh_part::leave_out_unused;
pub(crate) use self::mesh::polygons::triangles_with;
pub use self::open::{has_particle_types, open, read, read_with};
pub(crate) use self::open::{may_have_types, read_input};
pub use self::options::{OpenOptions, ReadAs};
pub(crate) use self::particles::hdf5::{CellRows, cell_rows};
pub(crate) use self::parts::planes::Planes;
pub(crate) use self::parts::rows::ROWS;
pub use self::parts::rows::RowFile;
#[cfg(feature = "cli")]
pub(crate) use self::picture::column_file::write_column_with;
pub use self::picture::column_file::{column_colours, column_look, column_picture, write_column};
#[cfg(feature = "cli")]
pub(crate) use self::picture::count_file::shown_count;
pub use self::picture::count_file::write_count;
pub use self::picture::deep_file::{check_deep_path, write_deep};
#[cfg(feature = "cli")]
pub(crate) use self::picture::fits::{is_fits, write_sky, write_sky_column};
#[cfg(feature = "cli")]
pub(crate) use self::picture::image_file::write_image_with;
pub use self::picture::image_file::{
    check_depth_path, check_folder, check_image_path, png_bytes, read_depth, read_image,
    write_depth, write_image, write_normals,
};
#[cfg(feature = "cli")]
pub(crate) use self::picture::stored::{Stored, StoredPicture, carries_record, read_stored};
pub use self::splats::encoded_splats::{PlyForm, SplatFileOptions, SpzVersion};
pub use self::splats::log_scales::ScaleMeaning;
pub use self::splats::splat_axes::SplatAxes;
pub use self::splats::write_splats::{FLAT_SHARE, WrittenSplats, check_splats_path, write_splats};
pub use self::time_steps::{Part, StepChoice, TimeStep};
pub use self::volume::raw::{RawLayout, RawType};
pub(crate) use self::vtk::pieces::{ArrayKey, ArraysSeen};
pub(crate) use self::vtk::vts_pieces::{BlockPlanes, VtsPieces};
pub(crate) use self::vtk::vtu_pieces::VtuPieces;
pub use crate::data::association::Association;
pub use crate::data::cells::{CellKind, CellMesh};
pub use crate::data::dataset::{CurvilinearBlock, Dataset, Field, FieldSource, Geometry};
pub use crate::data::gas::{GasState, HydrogenShare, MeanWeight};
pub use crate::data::mesh::{
    AlphaMode, Material, Mesh, MeshPart, Texture, TextureImage, TextureUse, Wrap,
};
pub use crate::data::particle_type::{ParticleCount, ParticleType};
pub use crate::data::smoothing::{LengthMeaning, Smoothing, SphKernel};
pub use crate::data::splats::SplatCloud;
pub use crate::data::spz_records::{SpzRecord, SpzRecords};
#[cfg(feature = "legend")]
pub use crate::data::up::Up;
