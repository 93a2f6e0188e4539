//! Programs in C and Fortran on the library: their pictures are those of the Rust library, bit for bit.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use ewa_splat::image::DepthOf;
use ewa_splat::io::{Association, CellMesh, Dataset, Field, FieldSource, Geometry, write_deep};
use ewa_splat::render::Backdrop;
use ewa_splat::sample::{
    BoundaryChoice, FunctionOptions, KernelOptions, PurposeOptions, SampleOptions, TransferChoice,
    scene,
};
use ewa_splat::scene::{
    Lattice, LatticeSpacing, Lighting, TransferDefaults, TransferFunction, Values,
};
use ewa_splat::view::{Along, Camera, DEFAULT_FOV_DEG, Lens};
use ewa_splat::{ColumnSettings, DepthImage, Image, Renderer, SceneOptions, Settings};
use glam::{DMat3, DVec3};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Folder in which `cargo test` stores the library.
fn built() -> PathBuf {
    let own = std::env::current_exe().unwrap();
    own.ancestors().nth(2).unwrap().join("examples")
}

/// Compiles a program, if the compiler is there.
fn compiled(compiler: &OsString, source: &str, words: &[&str], folder: &Path) -> Option<PathBuf> {
    let program = folder.join("program");
    let library = built();
    let mut command = Command::new(compiler);
    command
        .arg(root().join(source))
        .args(words)
        .arg("-I")
        .arg(root().join("include"));
    command
        .arg("-L")
        .arg(&library)
        .arg("-lewa_splat_tested")
        .arg("-lm");
    command.arg(format!("-Wl,-rpath,{}", library.display()));
    let done = command.arg("-o").arg(&program).current_dir(folder).output();
    match done {
        Ok(done) => {
            assert!(
                done.status.success(),
                "{}",
                String::from_utf8_lossy(&done.stderr)
            );
            Some(program)
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            println!("no compiler {}: skipped", compiler.display());
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Runs a program of C in a folder of its own. It returns the file that the program writes.
fn run_c(source: &str) -> Option<Vec<u8>> {
    let (compiler, words) = compiler_of_c();
    run(&compiler, source, &words)
}

fn compiler_of_c() -> (OsString, [&'static str; 5]) {
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    (
        compiler,
        ["-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic"],
    )
}

fn run(compiler: &OsString, source: &str, words: &[&str]) -> Option<Vec<u8>> {
    // Linkers of other systems are told otherwise where a program finds its libraries.
    if !cfg!(target_os = "linux") {
        println!("programs are linked on Linux alone: skipped");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let program = compiled(compiler, source, words, folder.path())?;
    let out = folder.path().join("out");
    let done = Command::new(program).arg(&out).output().unwrap();
    let text = [done.stdout, done.stderr].concat();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&text));
    Some(std::fs::read(&out).unwrap_or_default())
}

fn bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_ne_bytes()).collect()
}

fn field(name: &str, values: impl Into<Values>) -> Field {
    Field {
        name: name.into(),
        association: Association::Nodes,
        source: FieldSource::Scalar(values.into()),
        unit: None,
    }
}

/// Options of the pictures that programs draw: kernels are classified over their extent.
fn options(name: &str) -> SampleOptions {
    SampleOptions {
        field: Some(name.into()),
        kernels: KernelOptions {
            boundary: BoundaryChoice::Automatic,
            ..KernelOptions::default()
        },
        purpose: PurposeOptions {
            local_models: true,
            ..PurposeOptions::default()
        },
        ..SampleOptions::default()
    }
}

fn renderer(geometry: Geometry, fields: Vec<Field>, options: &SampleOptions) -> Renderer {
    renderer_of(geometry, fields, options, false)
}

fn renderer_of(
    geometry: Geometry,
    fields: Vec<Field>,
    options: &SampleOptions,
    keep_shapes: bool,
) -> Renderer {
    let dataset = Dataset::new("test".as_ref(), "test", geometry, fields);
    let sampled = scene(dataset, options).unwrap();
    let detail = SceneOptions {
        level_of_detail: true,
        keep_shapes,
        ..SceneOptions::default()
    };
    Renderer::with_options(sampled.volumes, &detail).unwrap()
}

fn settings(renderer: &Renderer) -> Settings {
    Settings {
        low_pass_variance_px2: renderer.suitable_low_pass_px2(),
        lighting: Some(Lighting::default()),
        ..Settings::default()
    }
}

/// Returns a renderer of the particles that the programs of C draw.
fn particles(count: u16) -> Renderer {
    let of =
        |i: u64, prime: u64, count: u32| (i * prime % u64::from(count)) as f64 / f64::from(count);
    let place = |i| {
        DVec3::new(
            of(i, 7919, 1000),
            of(i, 104_729, 997),
            of(i, 1_299_709, 991),
        )
    };
    let positions = (0..u64::from(count)).map(place).collect();
    let radii: Vec<f64> = (0..count)
        .map(|i| 0.02 + f64::from(i % 5) / 100.0)
        .collect();
    let values: Vec<f32> = (0..count).map(|i| f32::from(i % 32)).collect();
    let fields = vec![field("radius", radii), field("pressure", values)];
    renderer(Geometry::Points { positions }, fields, &options("pressure"))
}

#[test]
fn particles_are_those_of_the_library() {
    let Some(found) = run_c("examples/points.c") else {
        return;
    };
    let mut renderer = particles(500);
    let eye = DVec3::new(2.0, -3.0, 2.0);
    let camera = Camera::perspective(eye, DVec3::splat(0.5), DVec3::Z, 35.0, [96, 72]);
    let settings = Settings {
        tolerance: 0.01,
        depth: true,
        ..settings(&renderer)
    };
    let mut expected = bytes(
        renderer
            .render(&camera, &settings)
            .unwrap()
            .pixels
            .as_flattened(),
    );
    expected.extend(bytes(&renderer.depth().unwrap().depths));
    assert!(expected.chunks(16).any(|pixel| pixel[..4] != [0; 4]));
    let is_wall = |i: usize| i % 96 < 48;
    let depths = (0..96 * 72).map(|i| if is_wall(i) { 3.2 } else { f32::INFINITY });
    let red = |i| {
        if is_wall(i) {
            [1.0, 0.0, 0.0, 1.0]
        } else {
            [0.0; 4]
        }
    };
    let (width, height) = (96, 72);
    let depth = DepthImage {
        width,
        height,
        depths: depths.collect(),
    };
    let wall = Image {
        width,
        height,
        pixels: (0..width * height).map(red).collect(),
    };
    let wall = Backdrop::new(depth).unwrap().with_colours(wall).unwrap();
    let before = settings;
    let settings = Settings {
        depth: false,
        backdrop: Some(Arc::new(wall)),
        ..before
    };
    let over = renderer.render(&camera, &settings).unwrap();
    expected.extend(bytes(over.pixels.as_flattened()));
    assert!(found == expected);
}

#[test]
fn time_steps_are_those_of_the_library() {
    let Some(found) = run_c("examples/steps.c") else {
        return;
    };
    let n = 9_u16;
    let index = |i: u16, j: u16, k: u16| i64::from((k * n + j) * n + i);
    let node = |at: u16| {
        let (i, j, k) = (
            f64::from(at % n),
            f64::from(at / n % n),
            f64::from(at / n / n),
        );
        DVec3::new(i, j, k + i / 16.0)
    };
    let nodes: Vec<DVec3> = (0..n * n * n).map(node).collect();
    let mut lists = Vec::new();
    for (k, j, i) in (0..512).map(|cell| (cell / 64, cell / 8 % 8, cell % 8)) {
        let face = |k| {
            [
                index(i, j, k),
                index(i + 1, j, k),
                index(i + 1, j + 1, k),
                index(i, j + 1, k),
            ]
        };
        lists.push(8);
        lists.extend([face(k), face(k + 1)].concat());
    }
    let mesh = CellMesh::of_lists(nodes, &[12; 512], &lists).unwrap();
    let defaults = TransferDefaults {
        range: [0.0, 6.0],
        unit_distance: 1.0,
    };
    let viridis = TransferFunction::named("viridis", &defaults).unwrap();
    let drawn = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Text(viridis.to_json()),
            ..FunctionOptions::default()
        },
        ..options("load")
    };
    let values = |step: u16| -> Vec<f32> {
        let value = |at: u16| f32::from((at % n + step) * (at / n % n)) / 16.0;
        (0..n * n * n).map(value).collect()
    };
    let geometry = || Geometry::Cells(mesh.clone());
    let mut expected = Vec::new();
    for step in 0..3 {
        let mut renderer = renderer_of(geometry(), vec![field("load", values(step))], &drawn, true);
        let up = ewa_splat::io::Up::of_scene([Dataset::new(
            "test".as_ref(),
            "test",
            geometry(),
            Vec::new(),
        )
        .up()]);
        let boxes = renderer.fitted_boxes();
        let camera = up
            .viewpoint()
            .camera(&boxes, Lens::FovDeg(DEFAULT_FOV_DEG), [80, 60]);
        let settings = settings(&renderer);
        let image = renderer.render(&camera.unwrap(), &settings).unwrap();
        expected.extend(image.to_srgb8());
    }
    let summed = SampleOptions {
        purpose: PurposeOptions {
            for_columns: true,
            ..PurposeOptions::default()
        },
        ..options("load")
    };
    let mut renderer = renderer(geometry(), vec![field("load", values(2))], &summed);
    let camera = Along::Z.fitted(&renderer.boxes(), None, [80, 60]).unwrap();
    let column = renderer
        .column_density(&camera, &ColumnSettings::default())
        .unwrap();
    let wide = column
        .values
        .iter()
        .flat_map(|&x| f64::from(x).to_ne_bytes());
    expected.extend(wide);
    assert_eq!(found.len(), expected.len());
    let picture = 4 * 80 * 60;
    for (step, (a, b)) in found
        .chunks(picture)
        .zip(expected.chunks(picture))
        .enumerate()
    {
        let far = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(a == b, "part {step}: {far:?}");
    }
    assert!(expected[..picture] != expected[picture..2 * picture]);
}

#[test]
fn fortran_draws_what_the_library_draws() {
    let named = std::env::var_os("FC");
    let compiler = named.unwrap_or_else(|| "gfortran".into());
    let Some(found) = run(&compiler, "examples/grid.f90", &["-std=f2018", "-Wall"]) else {
        return;
    };
    let value = |at: u16| f32::from((at % 12) * (at / 12 % 10) + 4 * (at / 120));
    let values: Vec<f32> = (0..12 * 10 * 8).map(value).collect();
    let lattice = Lattice {
        dims: [12, 10, 8],
        spacing: LatticeSpacing::Uniform {
            origin: DVec3::ZERO,
            step: DMat3::IDENTITY,
        },
    };
    let drawn = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Named("plasma".into()),
            ..FunctionOptions::default()
        },
        ..options("heat")
    };
    let geometry = Geometry::Lattice(lattice);
    let up = Dataset::new("test".as_ref(), "test", geometry.clone(), Vec::new()).up();
    let mut renderer = renderer(geometry, vec![field("heat", values)], &drawn);
    let boxes = renderer.fitted_boxes();
    let camera = up
        .viewpoint()
        .camera(&boxes, Lens::FovDeg(DEFAULT_FOV_DEG), [64, 48]);
    let settings = Settings {
        background: Some([0.0; 3]),
        ..settings(&renderer)
    };
    let image = renderer.render(&camera.unwrap(), &settings).unwrap();
    assert!(found == bytes(image.pixels.as_flattened()));
}

#[test]
fn deep_images_are_those_of_the_library() {
    let Some(found) = run_deep() else {
        return;
    };
    let mut renderer = particles(500);
    let eye = DVec3::new(2.0, -3.0, 2.0);
    let camera = Camera::perspective(eye, DVec3::splat(0.5), DVec3::Z, 35.0, [48, 36]);
    let settings = Settings {
        tolerance: 0.01,
        ..settings(&renderer)
    };
    let deep = renderer.render_deep(&camera, &settings).unwrap();
    let counts = deep.firsts.windows(2).map(|pair| pair[1] - pair[0]);
    let mut expected: Vec<u8> = counts.flat_map(usize::to_ne_bytes).collect();
    let samples = &deep.samples;
    assert!(samples.len() > 48 * 36);
    expected.extend(bytes(
        &samples.iter().map(|own| own.front).collect::<Vec<_>>(),
    ));
    expected.extend(bytes(
        &samples.iter().map(|own| own.back).collect::<Vec<_>>(),
    ));
    expected.extend(bytes(
        &samples.iter().flat_map(|own| own.rgba).collect::<Vec<_>>(),
    ));
    let (width, height) = (48, 36);
    let depth = |i: usize| if i % 48 < 24 { 3.2 } else { f32::INFINITY };
    let wall = DepthImage {
        width,
        height,
        depths: (0..width * height).map(depth).collect(),
    };
    expected.extend(bytes(deep.before(&wall).unwrap().pixels.as_flattened()));
    expected.extend(bytes(&deep.transmittance(3.5)));
    for of in [DepthOf::Half, DepthOf::Entry, DepthOf::Exit, DepthOf::Mean] {
        expected.extend(bytes(&deep.depth(of).depths));
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.exr");
    write_deep(&path, &deep).unwrap();
    assert!(found == [std::fs::read(path).unwrap(), expected]);
}

/// Runs the program of deep images. It returns the file of OpenEXR and the other one.
fn run_deep() -> Option<[Vec<u8>; 2]> {
    if !cfg!(target_os = "linux") {
        println!("programs are linked on Linux alone: skipped");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let (compiler, words) = compiler_of_c();
    let program = compiled(&compiler, "examples/deep.c", &words, folder.path())?;
    let paths = ["deep.exr", "numbers"].map(|name| folder.path().join(name));
    let done = Command::new(program).args(&paths).output().unwrap();
    let text = [done.stdout, done.stderr].concat();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&text));
    Some(paths.map(|path| std::fs::read(path).unwrap()))
}

#[test]
fn bad_input_ends_in_errors() {
    run_c("tests/errors.c");
}

#[test]
fn the_example_of_the_documentation_runs() {
    let page = std::fs::read_to_string(root().join("../docs/c.md")).unwrap();
    let (_, rest) = page.split_once("```c\n").unwrap();
    let (lines, _) = rest.split_once("```").unwrap();
    assert_eq!(lines.lines().count(), 10);
    let program = format!(
        "#include <stdio.h>\n#include \"ewa_splat.h\"\n\
         static uint8_t pixels[4 * 800 * 600];\nstatic double density[800 * 600];\n\
         int main(void) {{\nenum {{ n = 50 }};\ndouble x[n], y[n], z[n], h[n], m[n], mass = 0;\n\
         for (int i = 0; i < n; i++) {{\nx[i] = i % 5; y[i] = i / 5 % 5; z[i] = i / 25; h[i] = 1; m[i] = i;\n}}\n\
         {lines}\nfor (int i = 0; i < 800 * 600; i++) mass += density[i];\n\
         ewa_renderer_free(renderer);\newa_scene_free(scene);\n\
         return *ewa_last_error() || !(mass > 0) || !pixels[4 * (300 * 800 + 400) + 1];\n}}\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("program.c");
    std::fs::write(&source, program).unwrap();
    run_c(source.to_str().unwrap());
}

/// Names of functions in a text, each after `mark`, with their numbers of parameters.
fn functions(text: &str, mark: &str) -> BTreeSet<(String, usize)> {
    let found = text.match_indices(mark).filter_map(|(at, _)| {
        let (name, rest) = text[at + mark.len()..].split_once('(')?;
        let is_name = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        let parameters = rest.split_once(')')?.0.trim().trim_end_matches(',');
        let count = match parameters {
            "" | "void" => 0,
            parameters => parameters.split(',').count(),
        };
        is_name.then(|| (format!("ewa_{name}"), count))
    });
    found.collect()
}

#[test]
fn the_header_declares_what_the_library_exports() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap();
    let exported = functions(&read("src/border.rs"), "extern \"C\" fn ewa_");
    let header = read("include/ewa_splat.h");
    // Comments name functions, too.
    let code: String = header
        .split("/*")
        .filter_map(|part| part.split_once("*/"))
        .map(|part| part.1)
        .collect();
    let declared = functions(&code, "ewa_");
    assert!(exported.len() > 20);
    assert_eq!(declared, exported);
    // C++ takes it, too.
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("program.cc");
    std::fs::write(
        &source,
        "#include \"ewa_splat.h\"\nint main() { return ewa_abi_version() - EWA_ABI_VERSION; }\n",
    )
    .unwrap();
    let compiler = std::env::var_os("CXX").unwrap_or_else(|| "c++".into());
    let words = ["-Wall", "-Wextra", "-Werror", "-pedantic"];
    run(&compiler, source.to_str().unwrap(), &words);
}
