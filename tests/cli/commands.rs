//! Tests the command line for users: outputs, exit statuses, one-line errors, no files left behind.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub(crate) fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ewa-splat"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

pub(crate) fn fixture(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fixtures")
        .join(name);
    path.to_str().unwrap().to_string()
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(path: PathBuf) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

pub(crate) fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn renders_every_output_and_says_what_it_did() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, transfer) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    for image in ["a.png", "a.exr", "a.pfm", "a.npy"] {
        let output = run(
            folder.path(),
            &[
                "render",
                &wake,
                "--transfer-function",
                &transfer,
                "--size",
                "80x60",
                "--out",
                image,
                "--depth",
                "d.npy",
                "--stats",
                "s.json",
                "--frames",
                "2",
            ],
        );
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    assert_eq!(
        files(folder.path()),
        ["a.exr", "a.npy", "a.pfm", "a.png", "d.npy", "s.json"]
    );
    let exr = ewa_splat::io::read_image(&folder.path().join("a.exr")).unwrap();
    let npy = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
    assert_eq!(exr, npy);
    assert_eq!((npy.width, npy.height), (80, 60));
    assert!(
        npy.pixels.iter().any(|p| p[3] > 0.3),
        "an empty picture of the wake"
    );

    let stats = json(folder.path().join("s.json"));
    for key in [
        "/particles",
        "/surfels",
        "/blocks/total",
        "/blocks/culled",
        "/footprints",
        "/splat_pixels",
        "/bytes_per_particle",
        "/requirements",
        "/backend",
        "/adapter",
        "/times_ms/read",
        "/times_ms/prepare",
        "/times_ms/cull",
        "/times_ms/classify",
        "/times_ms/project",
        "/times_ms/sort",
        "/times_ms/bin",
        "/times_ms/rasterise",
        "/times_ms/resolve",
        "/times_ms/frame",
        "/time_to_picture_ms",
        "/frames",
    ] {
        assert!(
            stats.pointer(key).is_some_and(|v| !v.is_null()),
            "no {key} in {stats}"
        );
    }
    assert_eq!(stats["frames"], 2);
    assert!(stats["splat_pixels"].as_u64().unwrap() > 0);

    let equal = run(folder.path(), &["compare", "a.exr", "a.npy", "--json"]);
    let errors: serde_json::Value = serde_json::from_slice(&equal.stdout).unwrap();
    assert_eq!(errors["max"], 0.0);
}

#[test]
fn every_filter_and_camera_draws() {
    let folder = tempfile::tempdir().unwrap();
    let particles = fixture("particles.csv");
    std::fs::write(
        folder.path().join("camera.json"),
        r#"{"eye": [0, -14, 4], "target": [0, 0, 0], "fov_deg": 40}"#,
    )
    .unwrap();
    let filters = [
        "adaptive",
        "exact",
        "ewa",
        "reconstruction",
        "low-pass",
        "isotropic",
        "uniform-scaling",
    ];
    let cameras: [&[&str]; 4] = [
        &["--azimuth", "-20", "--elevation", "60", "--zoom", "1.5"],
        &["--ortho", "12"],
        &["--camera", "camera.json"],
        &["--eye", "-1,-15,2", "--target", "0,0,0", "--fov", "30"],
    ];
    for (filter, camera) in filters
        .iter()
        .map(|f| (*f, cameras[0]))
        .chain(cameras.iter().map(|c| ("adaptive", *c)))
    {
        let mut arguments = vec![
            "render", &particles, "--size", "64x64", "--out", "a.npy", "--filter", filter,
        ];
        arguments.extend(camera);
        let output = run(folder.path(), &arguments);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
        let covered = image.pixels.iter().filter(|p| p[3] > 0.05).count();
        assert!(covered > 100, "{filter} {camera:?}: {covered} pixels");
    }
}

#[test]
fn lone_particles_far_below_a_pixel_are_fainter() {
    let folder = tempfile::tempdir().unwrap();
    // Depth 20 in a tenth of a pixel: sigma is .1 world units at half a pixel per unit.
    let rows: Vec<String> = (0..9)
        .map(|i| format!("{},{},0,0.1,1.25", i % 3 * 20, i / 3 * 20))
        .collect();
    let table = format!("x,y,z,sigma,mass\n{}\n", rows.join("\n"));
    std::fs::write(folder.path().join("p.csv"), table).unwrap();
    let sum = |more: &[&str]| {
        let arguments = [
            "render", "p.csv", "--size", "64x64", "--eye", "20,20,9", "--target", "20,20,0",
        ];
        let arguments = [
            &arguments[..],
            &[
                "--up",
                "0,1,0",
                "--ortho",
                "128",
                "--low-pass",
                "1",
                "--out",
                "a.npy",
            ],
            more,
        ]
        .concat();
        let output = run(
            folder.path(),
            &[&arguments[..], &["--level-of-detail", "off"]].concat(),
        );
        assert!(output.status.success(), "{}", text(&output.stderr));
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
        image.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>()
    };
    let (by_depth, lone) = (sum(&[]), sum(&["--sub-pixel-opacity"]));
    // Areas 2 pi a of depths tau0 = 20: the ratio to the linear law is Ein(20)/20 = .179.
    let share = lone / by_depth;
    assert!((share - 0.179).abs() < 0.005, "{share}");
}

#[test]
fn a_grid_without_a_solution_is_described() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(fixture("wake.xyz"), folder.path().join("alone.xyz")).unwrap();
    let output = run(folder.path(), &["info", "alone.xyz"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success());
    assert!(
        text.contains("curvilinear grid") && text.contains("--solution"),
        "{text}"
    );
    // Nothing to draw is an error all the same.
    let output = run(folder.path(), &["render", "alone.xyz", "--out", "a.png"]);
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, particles) = (fixture("wake.xyz"), fixture("particles.csv"));
    let whole = std::fs::read(&wake).unwrap();
    let inputs = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = inputs.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_string()
    };
    let truncated = write("half.xyz", &whole[..whole.len() / 2]);
    let empty = write("empty.csv", b"");
    let huge = write("huge.xyz", &[&i32::MAX.to_le_bytes()[..]; 3].concat());
    let nan = write("nan.csv", b"x,y,z,sigma,mass\nnan,0,0,1,1\n");
    let table = write("bad.csv", b"x,y,z,sigma,mass\n0,0,0,one,1\n1,0,0,1,1\n");
    let transfer = write("bad.json", br#"{"range": [0, 1], "points": []}"#);
    let cases: [(&[&str], &str); 13] = [
        (&[&truncated], "bytes"),
        (&[&empty], "empty"),
        (&[&huge], "error"),
        (&[&nan], "particle"),
        (&[&table], "line 2, column `sigma`"),
        (&["missing.csv"], "missing.csv"),
        (&[&wake, "--field", "colour"], "density, momentum, energy"),
        (&[&wake, "--transfer-function", "no-such-map"], "viridis"),
        (&[&wake, "--transfer-function", &transfer], "bad.json"),
        (&[&wake, "--solution", &particles], "particles.csv: line 1"),
        (&[&wake, "--flatten", "6"], "has, from 0.37"),
        (
            &[&wake, "--flatten", ".6", "--unit-distance", "2"],
            "--unit-distance",
        ),
        (&[&wake, "--out", "no/folder.png"], "folder"),
    ];
    for (arguments, says) in cases {
        let mut all = vec!["render"];
        all.extend(arguments);
        if !arguments.contains(&"--out") {
            all.extend(["--out", "out.png"]);
        }
        let output = run(folder.path(), &all);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {text}");
        let line = text.lines().last().unwrap_or_default();
        assert!(
            line.starts_with("error: ") && line.contains(says),
            "{arguments:?}: {text}"
        );
        assert_eq!(text.matches("error: ").count(), 1, "{text}");
        assert!(files(folder.path()).is_empty(), "{arguments:?} left a file");
    }
}

#[test]
fn counts_are_written_as_numbers_and_in_colours() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, transfer) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let show = |out: &str, options: &[&str]| {
        let mut arguments = vec!["render", &wake, "--transfer-function", &transfer];
        arguments.extend(["--size", "80x60", "--show", "count", "--out", out]);
        arguments.extend(["--backend", "cpu", "--stats", "s.json"]);
        arguments.extend(options);
        let output = run(folder.path(), &arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{text}");
        text.lines().last().unwrap().to_string()
    };
    let read = |name: &str| ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
    let text = show("n.npy", &[]);
    let numbers = read("n.npy");
    let of = |p: &[f32; 4]| f64::from(p[0]);
    let sum: f64 = numbers.pixels.iter().map(of).sum();
    let greatest = numbers.pixels.iter().map(of).fold(0.0, f64::max);
    let stats = json(folder.path().join("s.json"));
    assert_eq!(stats["splat_pixels"].as_f64().unwrap(), sum);
    let said = format!("{greatest} at most, {:.1} on average", sum / 4800.0);
    assert!(text.contains(&said) && !text.contains("viridis"), "{text}");
    show("n.exr", &["--background", "1,1,1"]);
    assert_eq!(read("n.exr"), numbers);

    let text = show("n.png", &[]);
    assert!(text.contains(&said), "{text}");
    assert!(
        text.contains(&format!("viridis from 0 to {greatest}")),
        "{text}"
    );
    let colours = read("n.png");
    for (n, colour) in numbers.pixels.iter().zip(&colours.pixels) {
        // Viridis ends in a yellow whose red is the highest of all, and begins in a purple with
        // little green.
        assert!(of(n) < greatest || colour[0] > 0.98, "{n:?}: {colour:?}");
        assert!(
            of(n) > 0.9 * greatest || colour[0] < 0.9,
            "{n:?}: {colour:?}"
        );
        assert!(n[0] > 0.0 || colour[1] < 0.01, "{n:?}: {colour:?}");
        assert_eq!(colour[3], 1.0);
    }
}

#[test]
fn a_legend_is_drawn_over_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, transfer) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let render = |input: &str, more: &[&str]| {
        let arguments = [&["render", input, "--size", "240x200"], more].concat();
        run(folder.path(), &arguments)
    };
    let read = |name: &str| ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
    // A given camera leaves no columns free for the legend.
    let camera = ["--eye", "-6,-11,6", "--target", "-2.5,0,0", "--fov", "30"];
    let own = [&["--transfer-function", &transfer][..], &camera, &["--out"]].concat();
    let wake_with = own.as_slice();
    for (plain, drawn) in [("a.npy", "b.npy"), ("a.exr", "b.exr"), ("a.pfm", "b.pfm")] {
        let made = render(&wake, &[wake_with, &[plain]].concat());
        assert!(made.status.success());
        let made = render(&wake, &[wake_with, &[drawn, "--legend"]].concat());
        assert!(made.status.success(), "{}", text(&made.stderr));
        let (plain, drawn) = (read(plain), read(drawn));
        let is_changed: Vec<bool> = plain
            .pixels
            .iter()
            .zip(&drawn.pixels)
            .map(|(a, b)| a != b)
            .collect();
        // The changes lie within the upper right corner, and fill much of it.
        let changed = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            y.flat_map(|y| x.clone().map(move |x| y * 240 + x))
                .filter(|&i| is_changed[i])
                .count()
        };
        assert_eq!(changed(0..120, 0..200) + changed(120..240, 150..200), 0);
        assert!(changed(120..240, 0..150) > 5000);
    }
    assert_ne!(read("a.npy").pixels, read("b.npy").pixels);
    // A fitted camera leaves columns free: no data lie under the plate.
    let fitted = |more: &[&str]| {
        let arguments = [&["--transfer-function", &transfer][..], more].concat();
        assert!(render(&wake, &arguments).status.success());
    };
    fitted(&["--out", "f.npy", "--legend"]);
    let drawn = read("f.npy");
    let is_data = |x: usize| (0..200).any(|y| (0.01..0.8).contains(&drawn.pixel(x, y)[3]));
    let last = (0..240).rev().find(|&x| is_data(x)).unwrap();
    // The plate lets .15 through, along many rows at the top.
    let is_plate = |x: usize| {
        let rows = (12..60).filter(|&y| (drawn.pixel(x, y)[3] - 0.85).abs() < 1e-3);
        rows.count() > 20
    };
    let first = (0..240).find(|&x| is_plate(x)).unwrap();
    assert!(last < first, "{last} {first}");
    // Without a legend, the data use the whole picture.
    fitted(&["--out", "f.npy"]);
    let drawn = read("f.npy");
    assert!((first..240).any(|x| (0..200).any(|y| drawn.pixel(x, y)[3] > 0.01)));
    let made = render(
        &wake,
        &[wake_with, &["b.png", "--legend", "--background", "none"]].concat(),
    );
    assert!(made.status.success());
    // The two differ by less than a sixteenth of an sRGB step.
    for (a, b) in read("b.npy").pixels.iter().zip(&read("b.png").pixels) {
        assert!((a[3] - b[3]).abs() < 0.003);
    }
    let particles = fixture("particles.csv");
    let made = render(
        &particles,
        &["--column-density", "--out", "c.png", "--legend"],
    );
    assert!(made.status.success(), "{}", text(&made.stderr));
    let made = render(&particles, &["--column-density", "--out", "d.png"]);
    assert!(made.status.success());
    assert_ne!(read("c.png").pixels, read("d.png").pixels);
    // A scene without transfer functions is refused, and writes nothing.
    let before = files(folder.path());
    for (arguments, expected) in [
        (
            &["--column-density", "--out", "e.npy", "--legend"][..],
            "a png",
        ),
        (&["--show", "count", "--out", "e.npy", "--legend"], "--show"),
        (
            &["--size", "100x50", "--out", "e.npy", "--legend"],
            "at least",
        ),
    ] {
        let refused = run(folder.path(), &[&["render", &wake], arguments].concat());
        assert_eq!(refused.status.code(), Some(1));
        assert!(
            text(&refused.stderr).contains(expected),
            "{}",
            text(&refused.stderr)
        );
    }
    let refused = render(&fixture("vase.obj"), &["--out", "e.npy", "--legend"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("a field with a transfer function"));
    assert_eq!(files(folder.path()), before);
}

#[test]
fn cut_faces_show_the_field_on_the_planes() {
    let folder = tempfile::tempdir().unwrap();
    // A field of one value, which its transfer function leaves nearly transparent.
    std::fs::write(folder.path().join("v.raw"), [100_u8; 4096]).unwrap();
    let transfer = r#"{"range": [0, 200], "color_space": "linear", "points":
        [{"value": 0, "color": [0, 0, 1], "opacity": 1e-6}, {"value": 200, "color": [1, 0, 0]}]}"#;
    std::fs::write(folder.path().join("t.json"), transfer).unwrap();
    let volume = [
        "render",
        "v.raw",
        "--dims",
        "16,16,16",
        "--transfer-function",
        "t.json",
    ];
    let view = [
        "--eye",
        "-30,7.5,7.5",
        "--target",
        "7.5,7.5,7.5",
        "--fov",
        "14",
        "--size",
        "40x40",
    ];
    let draw = |more: &[&str]| {
        let arguments = [
            &volume[..],
            &view,
            &["--out", "a.npy", "--clip", "1,0,0,-6.3"],
            more,
        ]
        .concat();
        run(folder.path(), &arguments)
    };
    let alpha = |pixel: [f32; 4]| pixel[3];
    let middle = || {
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
        image.pixel(20, 20)
    };
    assert!(draw(&[]).status.success());
    assert!(alpha(middle()) < 1e-3);
    let drawn = draw(&["--cut-faces"]);
    assert!(drawn.status.success(), "{}", text(&drawn.stderr));
    let [r, g, b, a] = middle();
    assert!(a > 0.99 && (r - 0.5).abs() < 0.01 && g < 0.01 && (b - 0.5).abs() < 0.01);
    // Without planes it is wrong usage, without a field an error.
    let arguments = [&volume[..], &["--out", "b.npy", "--cut-faces"]].concat();
    assert_eq!(run(folder.path(), &arguments).status.code(), Some(2));
    let mesh = fixture("vase.obj");
    let arguments = [
        "render",
        &mesh,
        "--out",
        "b.npy",
        "--clip",
        "1,0,0,0",
        "--cut-faces",
    ];
    let refused = run(folder.path(), &arguments);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("--cut-faces"));
}

#[test]
fn nothing_visible_is_a_result() {
    let folder = tempfile::tempdir().unwrap();
    let clear = r#"{"range": [0, 1], "points": [{"value": 0, "color": [1, 1, 1], "opacity": 0},
                    {"value": 1, "color": [1, 1, 1], "opacity": 0}]}"#;
    std::fs::write(folder.path().join("clear.json"), clear).unwrap();
    let wake = fixture("wake.xyz");
    let output = run(
        folder.path(),
        &[
            "render",
            &wake,
            "--transfer-function",
            "clear.json",
            "--size",
            "20x20",
            "--out",
            "a.npy",
        ],
    );
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("nothing visible"));
    let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
    assert!(image.pixels.iter().all(|p| *p == [0.0; 4]));
}

#[test]
fn info_tells_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["info", &fixture("wake.xyz"), "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["format"], "PLOT3D grid");
    let names: Vec<_> = info["fields"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| &f["name"])
        .collect();
    assert!(names.contains(&&serde_json::json!("mach")));
    assert_eq!(info["requirements"]["shape_floats"], 6);
    let table = run(folder.path(), &["info", &fixture("particles.csv")]);
    assert!(String::from_utf8_lossy(&table.stdout).contains("bytes per particle"));
}

#[test]
fn info_tells_ghosts_from_other_particles() {
    let folder = tempfile::tempdir().unwrap();
    let of = |more: &[&str]| {
        let pieces = fixture("pieces/duct.pvtu");
        let output = run(folder.path(), &[&["info", &pieces][..], more].concat());
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let counts = |more: &[&str]| {
        let info: serde_json::Value = serde_json::from_str(&of(more)).unwrap();
        [
            &info["geometry"]["nodes"],
            &info["particles"],
            &info["ghosts"],
        ]
        .map(|count| count.as_u64().unwrap())
    };
    let [nodes, particles, ghosts] = counts(&["--json"]);
    assert!(
        ghosts > 0 && particles - ghosts <= nodes,
        "{ghosts}, {particles}"
    );
    let soft = counts(&["--json", "--boundary", "soft"]);
    assert_eq!(soft, [nodes, particles - ghosts, 0]);
    let line =
        format!("particles          {particles}, {ghosts} of them ghosts beyond the boundary\n");
    assert!(of(&[]).contains(&line), "{line}");
    let soft = of(&["--boundary", "soft"]);
    assert!(
        soft.contains(&format!("particles          {}\n", particles - ghosts)),
        "{soft}"
    );
}

#[test]
fn info_describes_meshes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, format) in [
        ("vase.glb", "glTF mesh"),
        ("vase.obj", "Wavefront OBJ mesh"),
    ] {
        let output = run(folder.path(), &["info", &fixture(name), "--json"]);
        let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(info["format"], format);
        assert_eq!(info["geometry"]["triangles"], 1800);
        let material = &info["geometry"]["materials"][0];
        assert_eq!(material["name"], "glaze");
        assert_eq!(material["base_texture"], serde_json::json!([64, 64]));
        assert_eq!(info["notes"], serde_json::json!([]));
        let output = run(folder.path(), &["info", &fixture(name)]);
        let table = String::from_utf8_lossy(&output.stdout).into_owned();
        let line = "1800 triangles, \"glaze\", opaque, one-sided, texture 64 x 64";
        assert!(table.contains(line), "{table}");
    }
    // Uses the mesh alone, with an image named by hand.
    let mesh = std::fs::read_to_string(fixture("vase.obj")).unwrap();
    let plain = mesh.replace("mtllib vase.mtl", "");
    std::fs::write(folder.path().join("plain.obj"), plain).unwrap();
    let arguments = [
        "info",
        "plain.obj",
        "--json",
        "--texture",
        &fixture("vase.png"),
    ];
    let output = run(folder.path(), &arguments);
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let texture = &info["geometry"]["materials"][0]["base_texture"];
    assert_eq!(*texture, serde_json::json!([64, 64]));
}

/// A PLY square is read as a mesh with z up, or as its points when these are asked for.
#[test]
fn faces_are_a_mesh_unless_points_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
               property float z\nproperty float mass\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n\
               0 0 0 1\n4 0 0 1\n4 0 4 2\n0 0 4 2\n4 0 1 2 3\n";
    std::fs::write(folder.path().join("a.ply"), ply).unwrap();
    std::fs::write(folder.path().join("b.csv"), "x,y,z\n0,0,0\n1,1,1\n").unwrap();
    let info = |arguments: &[&str]| -> serde_json::Value {
        let arguments = [&["info", "--json"], arguments].concat();
        serde_json::from_slice(&run(folder.path(), &arguments).stdout).unwrap()
    };
    let mesh = info(&["a.ply"]);
    assert_eq!(mesh["geometry"]["triangles"], 2);
    assert_eq!(mesh["up"]["direction"], serde_json::json!([0.0, 0.0, 1.0]));
    let points = info(&["a.ply", "--as", "points"]);
    assert_eq!(points["geometry"]["count"], 4);
    assert_eq!(points["fields"][0]["name"], "mass");
    // A flat layer across y.
    assert_eq!(
        points["up"]["direction"],
        serde_json::json!([0.0, 1.0, 0.0])
    );
    let table = run(folder.path(), &["info", "a.ply"]);
    let table = String::from_utf8_lossy(&table.stdout).into_owned();
    assert!(table.contains("up                 0, 0, 1 ("), "{table}");

    let refused = run(folder.path(), &["info", "b.csv", "--as", "mesh"]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1));
    assert!(
        error.contains("found points without faces; leave --as out"),
        "{error}"
    );
}

/// Two splats, red over blue in a file whose y points down, are drawn alone and beside a mesh with
/// y up.
#[test]
fn what_is_up_is_drawn_up() {
    let folder = tempfile::tempdir().unwrap();
    let splat = |y: f32, colour: [u8; 4]| -> Vec<u8> {
        let floats = [0.0, y, 0.0, 0.2, 0.2, 0.2].map(f32::to_le_bytes).concat();
        [&floats[..], &colour, &[255, 128, 128, 128]].concat()
    };
    let splats = [splat(-1.0, [255, 0, 0, 255]), splat(1.0, [0, 0, 255, 255])].concat();
    std::fs::write(folder.path().join("a.splat"), splats).unwrap();
    let mesh = "v 0 0 0\nv .01 0 0\nv 0 .01 0\nf 1 2 3\n";
    std::fs::write(folder.path().join("b.obj"), mesh).unwrap();
    let is_red_above = |more: &[&str]| {
        let view = ["--size", "40x40", "--elevation", "0", "--out", "a.npy"];
        let arguments = [&["render"], more, &view].concat();
        let output = run(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
        let height_of = |channel: usize| {
            let sum = |f: &dyn Fn(usize) -> f32| -> f32 {
                let pixels = image.pixels.iter().enumerate();
                pixels.map(|(i, p)| f(i) * p[channel]).sum()
            };
            sum(&|i| (i / 40) as f32) / sum(&|_| 1.0)
        };
        height_of(0) + 10.0 < height_of(2)
    };
    assert!(is_red_above(&["a.splat"]));
    assert!(is_red_above(&["b.obj", "a.splat"]));
    assert!(!is_red_above(&["a.splat", "--up", "0,1,0"]));
}

/// A file of one splat gives the expected pixel.
#[test]
fn a_splat_file_is_described_and_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let mut record: Vec<u8> = [0.0_f32, 0.0, 0.0, 1.0, 1.0, 1.0]
        .map(f32::to_le_bytes)
        .concat();
    record.extend([255, 255, 0, 204, 255, 128, 128, 128]);
    std::fs::write(folder.path().join("a.splat"), record).unwrap();
    let output = run(folder.path(), &["info", "a.splat", "--json"]);
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(info["geometry"]["kind"], "splats");
    assert_eq!(info["geometry"]["degree"], 0);
    assert_eq!(info["requirements"]["peak_opacity"], true);
    let render = [
        "render", "a.splat", "--eye", "0,-8,0", "--target", "0,0,0", "--size", "9x9", "--out",
        "a.npy",
    ];
    let output = run(folder.path(), &render);
    assert!(output.status.success());
    let image = ewa_splat::io::read_image(&folder.path().join("a.npy")).unwrap();
    let [r, g, b, a] = image.pixel(4, 4);
    // The opacity is 204/255 at the centre of the middle pixel; red and green are full, and blue is
    // the rounding of the coefficient.
    assert!((a - 0.8).abs() < 1e-5 && (r - 0.8).abs() < 1e-5 && (g - 0.8).abs() < 1e-5);
    assert!(b.abs() < 1e-5);
    let output = run(folder.path(), &[&render[..], &["--reference"]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("without the reference"));
}

#[test]
fn measures_every_variant_and_writes_three_reports() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, transfer) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let mut arguments = vec![
        "measure",
        &wake,
        "--transfer-function",
        &transfer,
        "--size",
        "48x48",
        "--frames",
        "1",
    ];
    // A fine splatting stands in for the reference image, which takes long.
    let rendered = run(
        folder.path(),
        &[
            "render",
            &wake,
            "--transfer-function",
            &transfer,
            "--size",
            "48x48",
            "--filter",
            "exact",
            "--cutoff",
            "7",
            "--out",
            "true.exr",
        ],
    );
    assert!(rendered.status.success());
    for given in [
        "--reference-image",
        "--reference-kernels-image",
        "--reference-data-image",
    ] {
        arguments.extend([given, "true.exr"]);
    }
    arguments.extend(["--out", "new/folder"]);
    // Files of another run are replaced.
    let out = folder.path().join("new/folder");
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(out.join("report.json"), "of another run").unwrap();
    let output = run(folder.path(), &arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert_eq!(
        files(&out),
        [
            "reference-data.exr",
            "reference-kernels.exr",
            "reference.exr",
            "report.csv",
            "report.html",
            "report.json"
        ]
    );
    let report = json(out.join("report.json"));
    let csv = std::fs::read_to_string(out.join("report.csv")).unwrap();
    let html = std::fs::read_to_string(out.join("report.html")).unwrap();
    let rows = report["rows"].as_array().unwrap();
    let mut ids: Vec<&str> = rows.iter().map(|r| r["id"].as_str().unwrap()).collect();
    for id in &ids {
        assert!(csv.contains(&format!("\n{id},")), "{id}");
        assert!(html.contains(&format!("<code>{id}</code>")), "{id}");
    }
    assert_eq!(csv.lines().count(), rows.len() + 1);
    for group in ["tolerance", "filter", "cut-off", "opacity", "kernel width"] {
        assert!(rows.iter().any(|r| r["group"] == group), "{group}");
    }
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), rows.len());
    let budget = report["budget"]["rows"].as_array().unwrap();
    for row in rows
        .iter()
        .flat_map(|r| [&r["errors"], &r["from_data"], &r["from_baseline"]])
        .chain(budget.iter().map(|r| &r["alone"]))
    {
        for figure in ["rmse", "max", "p999", "mean_difference", "ssim", "flip"] {
            // JSON has no infinite numbers.
            assert!(row[figure].is_f64(), "{figure} in {row}");
        }
    }
    let of = |id: &str| budget.iter().find(|r| r["id"] == id).unwrap();
    assert!(of("splatting-sorting")["alone"]["rmse"].as_f64().unwrap() < 1e-4);
    assert!(
        of("budget-filter-isotropic")["alone"]["rmse"]
            .as_f64()
            .unwrap()
            > 1e-3
    );
    for text in ["<script", "http://", "https://"] {
        let inside = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!inside.contains(text), "{text}");
    }
}

#[test]
fn measures_a_grid_against_its_own_field_by_the_low_pass_that_suits_it() {
    let folder = tempfile::tempdir().unwrap();
    let ramp: Vec<u8> = (0..216).map(|i| (i % 6 * 30 + i / 36 * 10) as u8).collect();
    std::fs::write(folder.path().join("ramp.raw"), ramp).unwrap();
    let arguments =
        "measure ramp.raw --dims 6,6,6 --type u8 --size 8x8 --frames 1 --reference-error 1e-1";
    let measure = |out: &str, more: &[&str]| {
        let mut arguments: Vec<&str> = arguments.split(' ').collect();
        arguments.extend(["--out", out]);
        arguments.extend(more);
        let output = run(folder.path(), &arguments);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}");
        json(folder.path().join(out).join("report.json"))
    };
    let low_pass = |report: &serde_json::Value| {
        let default = &report["rows"].as_array().unwrap()[0];
        assert_eq!(default["id"], "default");
        default["settings"]["low_pass_variance_px2"]
            .as_f64()
            .unwrap()
    };
    let report = measure("a", &[]);
    let soft = measure("soft", &["--boundary", "soft"]);
    assert!((low_pass(&report) - 0.15).abs() < 1e-6);
    // The reference images of the first run will do for another low-pass filter.
    let data = ["--reference-data-image", "a/reference-data.exr"];
    let kernels = ["--reference-kernels-image", "a/reference-kernels.exr"];
    let both = ["--reference-image", "a/reference.exr", "--low-pass", "1"];
    let wide = measure("b", &[&data[..], &kernels, &both].concat());
    assert!((low_pass(&wide) - 1.0).abs() < 1e-6);

    assert!(folder.path().join("a/reference-data.exr").exists());
    assert_eq!(report["about"]["reference_data"]["origin"], "integrated");
    let rows = report["rows"].as_array().unwrap();
    let rmse = |report: &serde_json::Value, id: &str, from: &str| {
        let rows = report["rows"].as_array().unwrap();
        let row = rows.iter().find(|r| r["id"] == id).unwrap();
        row[from]["rmse"].as_f64().unwrap()
    };
    // Soft kernels blur a linear field that the data cut sharply at their faces.
    assert!(rmse(&soft, "default", "from_data") > rmse(&soft, "default", "errors"));
    assert!(rmse(&soft, "default", "from_data") > 2.0 * rmse(&report, "default", "from_data"));
    assert!(rmse(&report, "post-classification", "from_data") < 0.2);
    let on_front = |key: &str| rows.iter().filter(|r| r[key] == true).count();
    assert!(on_front("on_front") > 0 && on_front("on_data_front") > 0);
    let budget = report["budget"]["rows"].as_array().unwrap();
    assert!(budget.iter().any(|r| r["id"] == "kernels-for-data"));
    let html = std::fs::read_to_string(folder.path().join("a/report.html")).unwrap();
    assert!(html.contains("Against the data"));
}

#[test]
fn a_reference_of_another_size_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let wake = fixture("wake.xyz");
    let small = ["render", &wake, "--size", "30x20", "--out", "small.npy"];
    assert!(run(folder.path(), &small).status.success());
    let output = run(
        folder.path(),
        &[
            "measure",
            &wake,
            "--out",
            "m",
            "--reference-image",
            "small.npy",
        ],
    );
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.contains("256 x 256") && text.contains("30x20"),
        "{text}"
    );
    assert_eq!(files(folder.path()), ["small.npy"]);
}

#[test]
fn compare_draws_the_difference() {
    let folder = tempfile::tempdir().unwrap();
    let particles = fixture("particles.csv");
    for (out, filter) in [("a.npy", "exact"), ("b.npy", "isotropic")] {
        let render = [
            "render", &particles, "--size", "40x30", "--out", out, "--filter", filter,
        ];
        assert!(run(folder.path(), &render).status.success());
    }
    let output = run(
        folder.path(),
        &[
            "compare",
            "a.npy",
            "b.npy",
            "--difference",
            "d.png",
            "--difference-scale",
            "0.5",
        ],
    );
    assert!(output.status.success());
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(
        text.contains("ssim") && text.contains("flip") && text.contains("0.5"),
        "{text}"
    );
    let shown = ewa_splat::io::read_image(&folder.path().join("d.png")).unwrap();
    assert_eq!((shown.width, shown.height), (40, 30));
    let over_itself = ["compare", "a.npy", "b.npy", "--difference", "a.npy"];
    assert_eq!(run(folder.path(), &over_itself).status.code(), Some(1));
}

#[test]
fn a_reference_states_its_error() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("p.csv"),
        "x,y,z,sigma,mass,r,g,b\n0,0,0,1,2,1,0,0\n0.5,1,0.5,0.7,1,0,1,0\n",
    )
    .unwrap();
    let render = |options: &[&str]| {
        let mut arguments = vec!["render", "p.csv", "--size", "24x20"];
        arguments.extend(options);
        run(folder.path(), &arguments)
    };
    let output = render(&[
        "--reference",
        "--tolerance",
        "1e-5",
        "--out",
        "true.npy",
        "--stats",
        "s.json",
    ]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
    let stats = json(folder.path().join("s.json"));
    assert_eq!(stats["backend"], "reference");
    assert!(stats["error_estimate"].as_f64().unwrap() <= 1e-5);
    assert!(stats["rays"].as_u64().unwrap() >= 24 * 20);
    // The splatted picture is near it: large kernels, low opacity, little overlap.
    assert!(render(&["--out", "splatted.npy"]).status.success());
    let read = |name: &str| ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
    let errors = ewa_splat::measure::compare(&read("true.npy"), &read("splatted.npy")).unwrap();
    assert!(errors.max > 0.0 && errors.max < 0.05, "{errors:?}");
    // Options that the integrator does not use are refused, not ignored.
    let output = render(&["--reference", "--filter", "ewa", "--out", "x.npy"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_reference_is_of_kernels_or_of_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let mut data: Vec<u8> = Vec::new();
    for i in 0..512_u32 {
        let [x, y, z] = [i % 8, i / 8 % 8, i / 64].map(|c| f64::from(c) - 3.5);
        data.push((255.0 * (-0.15 * (x * x + y * y + z * z)).exp()) as u8);
    }
    std::fs::write(folder.path().join("v.raw"), data).unwrap();
    std::fs::write(folder.path().join("p.csv"), "x,y,z,sigma,mass\n0,0,0,1,1\n").unwrap();
    let draw = |line: &str| {
        let line = format!("render {line} --size 12x12 --tolerance 1e-3 --refine off");
        run(folder.path(), &line.split(' ').collect::<Vec<_>>())
    };
    let read = |name: &str| ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
    // A file name after the option is an input. Kernels that faces cut would take a minute.
    for line in [
        "--reference v.raw --dims 8,8,8 --boundary soft --out a.npy",
        "--reference kernels v.raw --dims 8,8,8 --boundary soft --out b.npy",
        "v.raw --dims 8,8,8 --out c.npy --reference data --stats c.json",
        "v.raw --dims 8,8,8 --out d.npy --reference=data",
        "v.raw --dims 8,8,8 --out e.npy --composite slabs --post-classification",
    ] {
        let output = draw(line);
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    }
    let difference = |a: &str, b: &str| ewa_splat::measure::compare(&read(a), &read(b)).unwrap();
    assert!(difference("a.npy", "b.npy").max == 0.0 && difference("c.npy", "d.npy").max == 0.0);
    // With the same camera and transfer function, the pictures are near each other but not equal.
    let classified = difference("c.npy", "e.npy").rmse;
    assert!(classified > 1e-4 && classified < 0.03, "{classified}");
    let stats = json(folder.path().join("c.json"));
    assert_eq!(stats["cells_left_out"], 0);
    assert!(stats["error_estimate"].as_f64().unwrap() <= 1e-3);
    for (line, status, words) in [
        (
            "p.csv --reference data --out x.npy",
            1,
            "--reference kernels",
        ),
        (
            "v.raw p.csv --dims 8,8,8 --reference data --out x.npy",
            1,
            "2 files",
        ),
        (
            "v.raw --dims 8,8,8 --reference=splats --out x.npy",
            2,
            "splats",
        ),
    ] {
        let output = draw(line);
        assert_eq!(output.status.code(), Some(status), "{line}");
        assert!(
            text(&output.stderr).contains(words),
            "{}",
            text(&output.stderr)
        );
        assert!(!folder.path().join("x.npy").exists());
    }
}

/// Kernels that lie outside the domain of their data are drawn by no code path.
#[test]
fn footprints_are_those_of_all_paths() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = String::from(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 3\nORIGIN 0 0 0\n\
         SPACING 1 1 1\nPOINT_DATA 36\nSCALARS v float 1\nLOOKUP_TABLE default\n",
    );
    for i in 0..36 {
        file.push_str(&format!("{:.3} ", f64::from(i * 7 % 36) / 36.0));
    }
    std::fs::write(folder.path().join("a.vtk"), file).unwrap();
    for backend in ["cpu", "gpu"] {
        let line = format!(
            "render a.vtk --azimuth 30 --size 48x40 --backend {backend} --refine off --out a.png --stats s.json"
        );
        let words: Vec<&str> = line.split(' ').collect();
        let output = run(folder.path(), &words);
        if backend == "gpu" && !output.status.success() {
            // There is no adapter.
            assert!(std::env::var_os("EWA_REQUIRE_GPU").is_none());
            continue;
        }
        assert!(output.status.success(), "{}", text(&output.stderr));
        let stats = json(folder.path().join("s.json"));
        let paths = stats["footprint_paths"].as_object().unwrap();
        let sum: u64 = paths.values().map(|n| n.as_u64().unwrap()).sum();
        assert_eq!(
            stats["footprints"].as_u64(),
            Some(sum),
            "{backend}: {paths:?}"
        );
    }
}

#[test]
fn a_mesh_alone_has_as_many_surfels_as_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "square.obj",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
    );
    write("fog.csv", "x,y,z,sigma,mass\n0,0,-1,0.1,0.1\n");
    let surfels = |inputs: &[&str], options: &[&str]| {
        let shared = [
            "--size", "100x100", "--up", "0,1,0", "--out", "a.npy", "--stats", "s.json",
        ];
        let arguments = [&["render"], inputs, &shared, options].concat();
        let output = run(folder.path(), &arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        json(folder.path().join("s.json"))["surfels"]
            .as_u64()
            .unwrap()
    };
    // There are 50 pixels per unit of length; also at a distance of 2.
    let flat = ["--eye", "0,0,2", "--target", "0,0,0", "--ortho", "2"];
    assert_eq!(surfels(&["square.obj"], &flat), 2500);
    let near = [
        "--eye",
        "0,0,2",
        "--target",
        "0,0,0",
        "--fov",
        "53.13010235",
    ];
    assert_eq!(surfels(&["square.obj"], &near), 2500);
    // Seen at a slant of 60 degrees, the area is half.
    let slant = [
        "--eye",
        "0,1,0.577350269",
        "--target",
        "0,0,0",
        "--ortho",
        "2",
    ];
    assert_eq!(surfels(&["square.obj"], &slant), 1250);
    // Surfels asked for by density, and two meshes a thousandth of the diagonal apart.
    let asked = ["--density", "300"];
    assert_eq!(surfels(&["square.obj"], &[&flat[..], &asked].concat()), 300);
    assert_eq!(surfels(&["square.obj", "fog.csv"], &flat), 500_000);
}

#[test]
fn a_transfer_function_is_written_scaled_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let values = (0..4096)
        .map(|i: i32| (i % 16 + i / 256) as u8)
        .collect::<Vec<_>>();
    std::fs::write(folder.path().join("ramp.raw"), values).unwrap();
    // Colours choose which kernels are refined, and which tiles have samples.
    let draw = |out: &str, options: &[&str]| {
        let line =
            "render ramp.raw --dims 16,16,16 --size 40x40 --refine off --opaque-edges off --out";
        let shared: Vec<&str> = line.split(' ').chain([out]).collect();
        let output = run(folder.path(), &[&shared[..], options].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let image = ewa_splat::io::read_image(&folder.path().join(out)).unwrap();
        image.pixels.into_flattened()
    };
    let greatest = |a: &[f32], b: &[f32]| {
        a.iter()
            .zip(b)
            .fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()))
    };
    let own = draw("a.npy", &["--write-transfer-function", "t.json"]);
    let again = draw("b.npy", &["--transfer-function", "t.json"]);
    // The written opacities are within 5e-4 of the originals.
    assert!(greatest(&own, &again) < 0.01, "{}", greatest(&own, &again));
    // A colour map changes colours alone; opacities stay.
    let plasma = draw("c.npy", &["--transfer-function", "plasma"]);
    let alphas = |picture: &[f32]| {
        picture
            .iter()
            .copied()
            .skip(3)
            .step_by(4)
            .collect::<Vec<f32>>()
    };
    assert!(greatest(&alphas(&own), &alphas(&plasma)) < 1e-3);
    assert!(greatest(&own, &plasma) > 0.05);
    // Twice the density squares the transmittances.
    let dense = draw("d.npy", &["--opacity-scale", "2"]);
    let squared: Vec<f32> = alphas(&own)
        .iter()
        .map(|a| 1.0 - (1.0 - a).powi(2))
        .collect();
    assert!(greatest(&alphas(&dense), &squared) < 0.004);
    draw(
        "e.npy",
        &["--range", "3,9", "--write-transfer-function", "e.json"],
    );
    assert_eq!(
        json(folder.path().join("e.json"))["range"],
        serde_json::json!([3.0, 9.0])
    );
    for (options, expected) in [
        (&["--range", "9,3"][..], "the lower one first"),
        (
            &["--range", "3,9", "--transfer-function", "t.json"],
            "a range of its own",
        ),
        (&["--opacity-scale", "0"], "above 0"),
        (
            &["--column-density", "--opacity-scale", "2"],
            "cannot be used with",
        ),
    ] {
        let shared = ["render", "ramp.raw", "--dims", "16,16,16", "--out", "f.npy"];
        let output = run(folder.path(), &[&shared[..], options].concat());
        assert!(!output.status.success());
        assert!(
            text(&output.stderr).contains(expected),
            "{}",
            text(&output.stderr)
        );
    }
    std::fs::write(
        folder.path().join("s.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    )
    .unwrap();
    let none = [
        "render",
        "s.obj",
        "--out",
        "g.npy",
        "--write-transfer-function",
        "g.json",
    ];
    let output = run(folder.path(), &none);
    assert!(!output.status.success() && text(&output.stderr).contains("one transfer function"));
    assert!(!folder.path().join("g.json").exists());
}

#[test]
fn a_target_moves_a_fitted_camera() {
    let folder = tempfile::tempdir().unwrap();
    // The camera is fitted to both of two specks.
    let specks = "x,y,z,sigma,mass\n-2,0,0,0.05,0.1\n2,0,1,0.05,0.1\n";
    std::fs::write(folder.path().join("two.csv"), specks).unwrap();
    let draw = |options: &[&str]| {
        let shared = ["render", "two.csv", "--size", "41x41", "--out", "a.npy"];
        let output = run(folder.path(), &[&shared[..], options].concat());
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy"));
        (output.status.success(), text(&output.stderr), image)
    };
    let middle = |options: &[&str]| draw(options).2.unwrap().pixel(20, 20)[3];
    assert!(middle(&["--zoom", "2"]) < 1e-4);
    for (target, zoom) in [("-2,0,0", "1"), ("2,0,1", "3"), ("2,0,1", "0.7")] {
        let found = middle(&["--target", target, "--zoom", zoom, "--azimuth", "70"]);
        assert!(found > 0.02, "{target} {zoom}: {found}");
    }
    assert!(middle(&["--target", "2,0,1", "--ortho", "3"]) > 0.02);
    let (succeeded, message, _) = draw(&["--eye", "1,2,3", "--target", "1,2,3"]);
    assert!(
        !succeeded && message.contains("an eye away from the point looked at"),
        "{message}"
    );
}

#[test]
fn a_background_has_numbers_or_a_name() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("fog.csv"),
        "x,y,z,sigma,mass\n0,0,0,0.1,0.1\n",
    )
    .unwrap();
    let draw = |background: &str| {
        let arguments = [
            "render",
            "fog.csv",
            "--size",
            "8x8",
            "--out",
            "a.npy",
            "--background",
            background,
        ];
        let output = run(folder.path(), &arguments);
        let image = ewa_splat::io::read_image(&folder.path().join("a.npy"));
        let corner = image.map_or([f32::NAN; 4], |image| image.pixel(0, 0));
        (output.status.success(), text(&output.stderr), corner)
    };
    let (_, _, numbers) = draw("0,0.21586052,1");
    // 128/255 is encoded: linear .2159.
    for same in ["#0080ff", "rgb(0,128,255)"] {
        for (a, b) in draw(same).2.iter().zip(numbers) {
            assert!((a - b).abs() < 1e-4, "{same}");
        }
    }
    assert_eq!(draw("navy").2, draw("#000080").2);
    assert!(draw("None").2[3] < 0.9);
    // The default background of a picture for display is dark grey.
    let pixel = |more: &[&str]| {
        let words = ["render", "fog.csv", "--size", "8x8", "--out", "a.png"];
        assert!(
            run(folder.path(), &[&words[..], more].concat())
                .status
                .success()
        );
        let image = ewa_splat::io::read_image(&folder.path().join("a.png")).unwrap();
        image.pixel(0, 0)
    };
    let clear = pixel(&["--background", "none"]);
    let shown = pixel(&[]);
    assert!(clear[3] < 0.9 && shown[3] >= 1.0);
    // sRGB #1c1c21, to within half a level of a byte.
    for (c, grey) in [0.0116, 0.0116, 0.0152].into_iter().enumerate() {
        let expected = clear[c] + (1.0 - clear[3]) * grey;
        assert!((shown[c] - expected).abs() < 0.005, "{c}");
    }
    for (wrong, expected) in [
        ("255,255,255", "#rrggbb"),
        ("-1,0,0", "0 to 1"),
        ("nave", "a name such as navy"),
        ("#12345", "#1a1a33"),
        ("transparent", "a name such as navy"),
    ] {
        let (succeeded, message, _) = draw(wrong);
        assert!(
            !succeeded && message.contains(expected),
            "{wrong}: {message}"
        );
    }
}

/// The camera determines the number of a mesh's surfels and then draws it, though a pipe can be
/// read only once.
#[cfg(unix)]
#[test]
fn a_camera_comes_through_a_pipe() {
    use std::io::Write;
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("corner.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    )
    .unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_ewa-splat"))
        .args(["render", "corner.obj", "--camera", "/dev/stdin"])
        .args(["--size", "20x20", "--out", "a.npy", "--backend", "cpu"])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let camera = br#"{"eye": [0, 0, 2], "target": [0, 0, 0], "up": [0, 1, 0], "ortho_height": 2}"#;
    child.stdin.take().unwrap().write_all(camera).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
}

#[test]
fn a_reference_shows_surfaces_alone_and_among_volumes() {
    let folder = tempfile::tempdir().unwrap();
    let vase = fixture("vase.obj");
    // The vase cuts two clouds.
    std::fs::write(
        folder.path().join("smoke.csv"),
        "x,y,z,sigma,mass,r,g,b\n0,1.2,0.8,0.3,0.4,0,1,0\n0.6,0.5,0.6,0.2,0.2,0,0,1\n",
    )
    .unwrap();
    let read = |name: &str| ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
    let mut pictures = Vec::new();
    for (name, inputs) in [
        ("alone", &[vase.as_str()][..]),
        ("smoke", &[vase.as_str(), "smoke.csv"]),
    ] {
        let options = [
            "--spacing",
            "0.08",
            "--size",
            "24x24",
            "--eye",
            "0,1.2,6",
            "--target",
            "0,1.2,0",
        ];
        let (truth, splatted) = (format!("{name}.npy"), format!("{name}-splatted.npy"));
        for more in [&["--reference", "--out", &truth][..], &["--out", &splatted]] {
            let arguments = [&["render"], inputs, &options, more].concat();
            let output = run(folder.path(), &arguments);
            assert!(output.status.success(), "{}", text(&output.stderr));
        }
        let truth = read(&truth);
        let errors = ewa_splat::measure::compare(&truth, &read(&splatted)).unwrap();
        println!("{name}: {errors:?}");
        // Silhouettes count as covered from .85 in one and from 1 in the other.
        assert!(
            errors.rmse < 0.06 && errors.max < 0.35,
            "{name}: {errors:?}"
        );
        let covered = truth.pixels.iter().filter(|p| p[3] > 0.9).count();
        assert!(covered > 50, "{name}: {covered}");
        pictures.push(truth);
    }
    assert_ne!(pictures[0], pictures[1]);

    let arguments = [
        "measure",
        &vase,
        "smoke.csv",
        "--spacing",
        "0.15",
        "--size",
        "12x12",
        "--frames",
        "1",
        "--reference-error",
        "1e-2",
        "--out",
        "report",
    ];
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report = json(folder.path().join("report/report.json"));
    let rows = report["rows"].as_array().unwrap();
    assert!(rows.len() > 10);
    // Particles and a mesh define no field apart from their kernels.
    assert!(rows.iter().all(|r| r["from_data"].is_null()));
    assert!(report["about"]["reference_data"].is_null());
}

#[test]
fn light_changes_colours_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let wake = fixture("wake.xyz");
    let draw = |out: &str, more: &[&str]| {
        let arguments = [
            "render",
            &wake,
            "--size",
            "60x40",
            "--backend",
            "cpu",
            "--out",
            out,
        ];
        let output = run(folder.path(), &[&arguments[..], more].concat());
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        std::fs::read(folder.path().join(out)).unwrap()
    };
    let plain = draw("a.npy", &[]);
    let lit = draw("b.npy", &["--lit", "--stats", "s.json"]);
    assert_ne!(plain, lit);
    assert_eq!(
        json(folder.path().join("s.json"))["requirements"][0]["normals"],
        true
    );
    let one = draw("c.npy", &["--light", "-1,0,2"]);
    assert_ne!(lit, one);
    assert_eq!(one, draw("d.npy", &["--lit", "--light=-2,0,4,1,1,1"]));
    assert_ne!(
        one,
        draw("e.npy", &["--light", "-1,0,2", "--light", "0,1,0,0.5,0,0"])
    );
    // An iso-surface is visible by its shading.
    let surface = draw("f.npy", &["--flatten", ".6"]);
    assert_eq!(surface, draw("g.npy", &["--isosurface", ".6", "--lit"]));
    assert_ne!(surface, lit);
    let refused = |status: i32, more: &[&str]| {
        let arguments = ["render", &wake, "--out", "no.png"];
        let output = run(folder.path(), &[&arguments[..], more].concat());
        assert_eq!(output.status.code(), Some(status), "{more:?}");
        assert!(!folder.path().join("no.png").exists());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    for bad in [
        "0,0,0",
        "1,2",
        "1,2,3,4",
        "1,2,3,-1,0,0",
        "a,b,c",
        "1,2,inf",
        "",
    ] {
        assert!(refused(2, &["--light", bad]).contains("direction"), "{bad}");
    }
    refused(2, &["--lit", "--reference"]);
    refused(2, &["--light", "1,0,0", "--column-density"]);
    let nine = refused(1, &["--light", "1,0,0"].repeat(9));
    assert!(nine.contains("at most 8"), "{nine}");
}

#[test]
fn compositing_and_clipping_reach_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, transfer) = (fixture("wake.xyz"), fixture("wake_transfer.json"));
    let draw = |name: &str, options: &[&str]| {
        let common = [
            "render",
            &wake,
            "--transfer-function",
            &transfer,
            "--size",
            "64x48",
            "--backend",
            "cpu",
            "--out",
            name,
            "--stats",
            "s.json",
        ];
        let output = run(folder.path(), &[&common[..], options].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let image = ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
        (image, json(folder.path().join("s.json")))
    };
    let (over, stats) = draw("over.npy", &[]);
    assert!(stats["layer_thickness"].is_null());
    let thick = ["--composite", "slabs", "--slab-thickness", "0.25"];
    let (_, stats) = draw("thick.npy", &thick);
    assert_eq!(stats["layer_thickness"], 0.25);
    let opacity =
        |image: &ewa_splat::Image| -> f64 { image.pixels.iter().map(|p| f64::from(p[3])).sum() };
    for mode in ["sheets", "axis-sheets", "slabs"] {
        let (layered, stats) = draw("layered.npy", &["--composite", mode]);
        assert!(stats["layer_thickness"].as_f64().unwrap() > 0.0, "{stats}");
        // Colours mix differently, opacities do not, except where tiles stop early: a share of the
        // tolerance.
        let (a, b) = (opacity(&over), opacity(&layered));
        assert!((a - b).abs() < 1e-3 * a, "{mode}: {a} {b}");
        assert_ne!(over, layered, "{mode}");
    }
    let (half, _) = draw("half.npy", &["--clip", "0,0,1,0"]);
    let (other, _) = draw("other.npy", &["--clip", "0,0,-1,0"]);
    let (boxed, _) = draw("boxed.npy", &["--clip", "-1e3,-1e3,-1e3,1e3,1e3,1e3"]);
    assert_eq!(boxed, over);
    assert!(opacity(&half) < 0.9 * opacity(&over));
    assert!(opacity(&other) < 0.9 * opacity(&over));
    // The camera is fitted to the remaining eighth of the length, which fills a third as much of
    // the picture, not an eighth.
    let covered = |image: &ewa_splat::Image| image.pixels.iter().filter(|p| p[3] > 0.01).count();
    let (piece, _) = draw("piece.npy", &["--clip", "0,-9,-9,1,9,9"]);
    assert!(covered(&piece) > covered(&over) / 3, "{}", covered(&piece));
    let slabs = ["--composite", "slabs", "--slab-thickness", "0.1"];
    let (before, _) = draw("before.npy", &slabs);
    let (after, _) = draw(
        "after.npy",
        &[&slabs[..], &["--post-classification"]].concat(),
    );
    let (lit, _) = draw(
        "lit.npy",
        &[&slabs[..], &["--post-classification", "--lit"]].concat(),
    );
    assert_ne!(before, after);
    assert_ne!(after, lit);
    for useless in [vec!["--slab-thickness", "1"], vec!["--post-classification"]] {
        let input = ["render", &wake, "--out", "bad.png"];
        let output = run(folder.path(), &[&input[..], &useless].concat());
        assert!(!output.status.success(), "{useless:?}");
        assert!(text(&output.stderr).contains("composite"), "{useless:?}");
    }
    for bad in ["1,2,3", "0,0,0,1", "1,1,1,0,0,0", "1,2,3,x"] {
        let output = run(
            folder.path(),
            &["render", &wake, "--clip", bad, "--out", "bad.png"],
        );
        assert_eq!(output.status.code(), Some(2), "{bad}");
    }
}

/// Cameras of another program choose the view and the size. A file of several is a sequence, too.
#[test]
fn cameras_of_a_capture_draw_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let (wake, model) = (fixture("wake.xyz"), fixture("cameras/text"));
    let draw = |more: &[&str]| {
        let own = ["render", &wake, "--backend", "cpu", "--refine", "off"];
        let output = run(folder.path(), &[&own, more].concat());
        (output.status.success(), text(&output.stderr))
    };
    let size = |name: &str| {
        let image = ewa_splat::io::read_image(&folder.path().join(name)).unwrap();
        [image.width, image.height]
    };
    let of = |more: &[&'static str]| {
        draw(&[&["--camera", model.as_str(), "--out", "a.png"], more].concat())
    };
    let (is_drawn, said) = of(&["--size", "40x30"]);
    assert!(
        is_drawn && said.contains("3 cameras: a/one.png is taken"),
        "{said}"
    );
    assert_eq!(size("a.png"), [40, 30]);
    for more in [
        &["--camera-name", "c.png"][..],
        &["--camera-name", "2", "--size", "20x15"],
    ] {
        let (is_drawn, said) = of(more);
        assert!(
            is_drawn && said.contains("distorts") && !said.contains("is taken"),
            "{said}"
        );
        assert_eq!(
            size("a.png"),
            if more.len() == 2 {
                [640, 480]
            } else {
                [20, 15]
            }
        );
    }
    let (is_drawn, said) = draw(&["--camera", &model, "--camera-name", "3", "--out", "b.png"]);
    assert!(
        !is_drawn && said.contains("a/one.png, b two.jpg, c.png"),
        "{said}"
    );
    let small = ["--size", "40x30", "--out", "p_%02d.png"];
    let (is_drawn, said) = draw(&[&["--camera-path", model.as_str()][..], &small].concat());
    assert!(is_drawn && said.contains("distorts"), "{said}");
    assert_eq!(
        files(folder.path())
            .iter()
            .filter(|name| name.starts_with("p_"))
            .count(),
        3
    );
    assert_eq!(size("p_02.png"), [40, 30]);
}
