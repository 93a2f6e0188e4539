//! x
use crate::support::splats::*;
use ewa_splat::io::*;
#[test]
fn generate() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/splats");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("scene.ply"), splat_ply(Ply::Little, "", &some_splats(3, 3), &[])).unwrap();
    for mode in 0..3 {
        std::fs::write(folder.join(format!("mode_{mode}.ksplat")), ksplat(mode, &[&some_splats(3, 2), &some_splats(7, 1)])).unwrap();
    }
    let data = open(&folder.join("scene.ply"), &OpenOptions::default()).unwrap();
    let Geometry::Splats(cloud) = data.geometry else { panic!() };
    let three = SplatFileOptions { up: Some(-glam::DVec3::Y), ..Default::default() };
    let four = SplatFileOptions { spz_version: Some(SpzVersion::Four), ..three };
    for (name, options) in [("ours.glb", three), ("ours.ply", three), ("ours.splat", three), ("ours.compressed.ply", three), ("ours_3.spz", three), ("ours_4.spz", four)] {
        write_splats(&folder.join(name), &cloud, &options).unwrap();
    }
}
