//! Tests conversion to splats: every format is read back, pictures stay the same, and files are
//! sound.
#![allow(
    clippy::unwrap_used,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a test may panic, and its numbers are small"
)]

mod command_line;
mod formats;
mod gltf;
mod particles;
mod surfels;

use std::path::PathBuf;

use crate::common::Random;
use crate::common::scene::render;
use ewa_splat::io::{
    Dataset, Geometry, OpenOptions, PlyForm, SplatCloud, SplatFileOptions, WrittenSplats, open,
    write_splats,
};
use ewa_splat::math::{harmonics, harmonics_sum};
use ewa_splat::sample::{SampleOptions, volume as sample};
use ewa_splat::scene::SplatRule;
use ewa_splat::view::Camera;
use ewa_splat::{Image, Settings};
use glam::{DMat3, DQuat, DVec3};

const FORMATS: [&str; 10] = [
    "ply", "splat", "ksplat", "spz", "glb", "gltf", "usda", "usdc", "usdz", "csv",
];

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> Dataset {
        open(&self.path(name), &OpenOptions::default()).unwrap()
    }

    fn write(&self, extension: &str, cloud: &SplatCloud) -> WrittenSplats {
        let path = self.path(&format!("a.{extension}"));
        let written = write_splats(&path, cloud, &SplatFileOptions::default()).unwrap();
        assert_eq!(
            written.bytes as u64,
            std::fs::metadata(&path).unwrap().len()
        );
        written
    }

    /// Writes a cloud and reads it again.
    fn again(&self, extension: &str, cloud: &SplatCloud) -> SplatCloud {
        self.write(extension, cloud);
        cloud_of(self.read(&format!("a.{extension}")))
    }

    fn refuse(&self, extension: &str, cloud: &SplatCloud, form: PlyForm) -> String {
        let path = self.path(&format!("refused.{extension}"));
        let error = write_splats(&path, cloud, &of_form(form))
            .unwrap_err()
            .to_string();
        assert!(!path.exists(), "left behind");
        error
    }
}

fn of_form(form: PlyForm) -> SplatFileOptions {
    SplatFileOptions {
        form,
        ..SplatFileOptions::default()
    }
}

fn cloud_of(data: Dataset) -> SplatCloud {
    match data.geometry {
        Geometry::Splats(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

/// Returns splats of any rotation, sizes within a decade, and colours in and around 0 to 1.
fn some_cloud(count: usize, degree: u8, seed: u64) -> SplatCloud {
    let mut random = Random::new(seed);
    let mut cloud = SplatCloud {
        harmonics_degree: degree,
        ..SplatCloud::default()
    };
    for _ in 0..count {
        // Positions are representable in f32: this is no test of rounding.
        cloud.positions.push(random.point(2.0).as_vec3().as_dvec3());
        cloud
            .scales
            .push([0, 1, 2].map(|_| random.log_range(0.03, 0.3) as f32));
        let q = DQuat::from_mat3(&random.rotation()) * random.range(0.5, 2.0);
        cloud.rotations.push([q.w, q.x, q.y, q.z].map(|c| c as f32));
        cloud.opacities.push(random.range(0.02, 0.98) as f32);
        for k in 0..cloud.harmonics_stride() {
            let most = if k < 3 { 1.7 } else { 0.3 };
            cloud.harmonics.push(random.range(-most, most) as f32);
        }
    }
    cloud
}

/// Returns the rotation of a unit quaternion w, x, y, z.
fn unit(q: [f32; 4]) -> DQuat {
    let [w, x, y, z] = q.map(f64::from);
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// V = R diag(s)² Rᵀ.
fn variance(cloud: &SplatCloud, i: usize) -> DMat3 {
    let f = DMat3::from_quat(unit(cloud.rotations[i]))
        * DMat3::from_diagonal(DVec3::from(cloud.scales[i].map(f64::from)));
    f * f.transpose()
}

fn norm(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn picture(cloud: &SplatCloud, camera: &Camera) -> Image {
    let geometry = Geometry::Splats(cloud.clone());
    let data = Dataset::new("a".as_ref(), "splats", geometry, Vec::new());
    // The rule of a format is none of its losses.
    let mut options = SampleOptions::default();
    options.kernels.splat_rule = Some(SplatRule::Exact);
    let volume = sample(data, &options).unwrap().volume;
    render(vec![volume], camera, &Settings::default())
}

fn rms(a: &Image, b: &Image) -> f64 {
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / (4 * a.pixels.len()) as f64).sqrt()
}

/// Returns the colours of splat `i` seen along `d`.
fn seen(cloud: &SplatCloud, i: usize, d: DVec3) -> [f32; 3] {
    let stride = cloud.harmonics_stride();
    let set = &cloud.harmonics[i * stride..][..stride];
    harmonics_sum(set, &harmonics(d.normalize().as_vec3()))
}
