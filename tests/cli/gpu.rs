//! Tests `--backend`: equal pictures, statistics, and refusals.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::gpu::{ALIKE, gpu};
use crate::common::scene::difference;
use ewa_splat::io::read_image;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name)
}

/// Runs `render` with EWA_ADAPTER set to `adapter`.
fn render(folder: &Path, file: &str, adapter: Option<&str>, options: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ewa-splat"));
    command
        .arg("render")
        .arg(fixture(file))
        // The picture is small, so that a software adapter draws it quickly.
        .args(["--size", "100x70"])
        .args(options)
        // Mesa complains on standard error if this variable is unset.
        .env("XDG_RUNTIME_DIR", folder)
        .current_dir(folder);
    if let Some(adapter) = adapter {
        command.env("EWA_ADAPTER", adapter);
    }
    command.output().unwrap()
}

fn succeed(folder: &Path, options: &[&str]) {
    let transfer = fixture("wake_transfer.json");
    let transfer = ["--transfer-function", transfer.to_str().unwrap()];
    let output = render(folder, "wake.xyz", None, &[&transfer[..], options].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{options:?}: {text}");
}

/// Expects one line that begins with `error: `, exit status 1, and no file. Returns the line.
fn refusal(folder: &Path, adapter: Option<&str>, options: &[&str]) -> String {
    let output = render(folder, "particles.csv", adapter, options);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{options:?}: {text}");
    assert!(text.starts_with("error: "), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0);
    text
}

fn stats(folder: &Path, name: &str) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn both_back_ends_draw_one_picture() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // The cut-off and termination thresholds lie below the compared precision, so that no pixel
    // flips at one. Tiles of several samples a pixel are chosen by the tolerance, too.
    let exact = ["--cutoff", "7", "--tolerance", "1e-6"];
    let options = [&exact[..], &["--refine", "off", "--opaque-edges", "off"]].concat();
    for backend in ["gpu", "cpu"] {
        let [out, depth, json] = ["", "_depth", "_stats"].map(|part| format!("{backend}{part}"));
        let (out, depth, json) = (out + ".npy", depth + ".npy", json + ".json");
        let own = [
            "--backend",
            backend,
            "--out",
            &out,
            "--depth",
            &depth,
            "--stats",
            &json,
            "--frames",
            "2",
        ];
        succeed(folder, &[&own[..], &options].concat());
    }
    let read = |name: &str| read_image(&folder.join(name)).unwrap();
    let (on_gpu, on_cpu) = (read("gpu.npy"), read("cpu.npy"));
    assert!(on_cpu.pixels.iter().any(|p| p[3] > 0.3), "an empty picture");
    let error = difference(&on_gpu, &on_cpu);
    println!("largest difference {error:.1e}");
    assert!(error <= ALIKE, "{error:e}");

    // Depths come from distinct footprints, so they differ where the opacity passes a half at
    // another one.
    let depths = |name: &str| {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        // The header's length is in bytes 8 and 9.
        let start = 10 + usize::from(bytes[8]) + 256 * usize::from(bytes[9]);
        let numbers = bytes[start..].as_chunks().0.iter();
        numbers.map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>()
    };
    let (on_gpu, on_cpu) = (depths("gpu_depth.npy"), depths("cpu_depth.npy"));
    assert_eq!(on_gpu.len(), 100 * 70);
    assert!(on_cpu.iter().any(|d| d.is_finite()));
    let differ = |(a, b): &(&f32, &f32)| !(a == b || (*a - *b).abs() <= 1e-5 * b.abs());
    let flips = on_gpu.iter().zip(&on_cpu).filter(differ).count();
    println!("{flips} depths differ");
    assert!(flips <= 7, "{flips} of 7,000 depths differ");

    let (on_gpu, on_cpu) = (
        stats(folder, "gpu_stats.json"),
        stats(folder, "cpu_stats.json"),
    );
    assert_eq!(on_gpu["backend"], "gpu");
    assert_eq!(on_gpu["adapter"], gpu.adapter());
    assert_eq!(on_cpu["backend"], "cpu");
    assert_eq!(on_gpu["frames"], 2);
    for key in ["particles", "blocks", "classified"] {
        assert_eq!(on_gpu[key], on_cpu[key], "{key}");
    }
    let times = &on_gpu["times_ms"];
    assert!(times["frame"].as_f64().unwrap() > 0.0);
    if gpu.has_timestamps() {
        let mut sum = 0.0;
        for stage in ["cull", "classify", "project", "sort", "bin", "rasterise"] {
            let ms = times[stage].as_f64().unwrap();
            assert!(ms > 0.0, "{stage}: {times}");
            sum += ms;
        }
        // The times are medians of two frames each.
        assert!(sum < 2.0 * times["frame"].as_f64().unwrap(), "{times}");
    }
}

#[test]
fn both_back_ends_sum_one_column_density() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let sums = ["gpu", "cpu"].map(|backend| {
        let (out, json) = (format!("{backend}.npy"), format!("{backend}.json"));
        let options = ["--column-density", "--backend", backend, "--out", &out];
        let output = render(
            folder,
            "swift.h5",
            None,
            &[&options[..], &["--stats", &json]].concat(),
        );
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{backend}: {text}");
        let stats = stats(folder, &json);
        assert_eq!(stats["backend"], backend);
        stats["column_density"]["sum_times_area"].as_f64().unwrap()
    });
    assert_eq!(stats(folder, "gpu.json")["adapter"], gpu.adapter());
    assert!(sums[1] > 0.0);
    // Both conserve the mass.
    assert!((sums[0] / sums[1] - 1.0).abs() < 1e-5, "{sums:?}");
}

#[test]
fn the_back_end_is_chosen_as_asked() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let options = ["--out", "a.npy", "--stats", "s.json"];
    succeed(folder, &[&options[..], &["--backend", "auto"]].concat());
    let hardware = if gpu.is_software() { "cpu" } else { "gpu" };
    assert_eq!(stats(folder, "s.json")["backend"], hardware);
    succeed(folder, &options);
    assert_eq!(stats(folder, "s.json")["backend"], hardware, "the default");
    // A small scene is drawn before a driver would be loaded.
    let output = render(folder, "particles.csv", None, &options);
    assert!(output.status.success(), "{output:?}");
    assert_eq!(stats(folder, "s.json")["backend"], "cpu", "a small scene");
}

#[test]
fn what_the_gpu_cannot_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // The same holds without any adapter.
    let nonsense = ["--out", "a.npy", "--stats", "s.json", "--backend", "gpu"];
    let text = refusal(folder, Some("nonsense"), &nonsense);
    assert!(
        text.contains("nonsense") && text.contains("EWA_ADAPTER") && text.contains("--backend cpu"),
        "{text}"
    );
    if let Some(gpu) = gpu() {
        assert!(text.contains(&gpu.adapter()), "{text}");
    }
    // If no option asks for a GPU, none is looked for.
    let output = render(
        folder,
        "particles.csv",
        Some("nonsense"),
        &["--out", "a.npy", "--backend", "cpu"],
    );
    assert!(output.status.success());
}

/// Without a desktop, Mesa's layers look for one. They complain on standard error unless the
/// program prevents it.
#[test]
fn drivers_say_nothing_where_there_is_no_desktop() {
    if gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for runtime in [None, Some("relative")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ewa-splat"));
        command
            .args(["render", "--size", "40x30", "--out", "a.png", "--backend"])
            .args(["gpu", "--quiet"])
            .arg(fixture("particles.csv"))
            .env_remove("XDG_RUNTIME_DIR")
            // This variable would disable the layer that complains.
            .env_remove("NODEVICE_SELECT")
            .current_dir(folder.path());
        if let Some(runtime) = runtime {
            command.env("XDG_RUNTIME_DIR", runtime);
        }
        let output = command.output().unwrap();
        assert!(output.status.success());
        assert_eq!(String::from_utf8_lossy(&output.stderr), "", "{runtime:?}");
    }
}
