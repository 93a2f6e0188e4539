//! Tests wrong usage: the messages and exit statuses.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use crate::commands::{files, fixture, run, text};

/// A command line after the program's name, with `WAKE`, `DUCK` ... for files; the exit status; a
/// part of the message.
const WRONG: &[(&str, i32, &str)] = &[
    ("render", 2, "required arguments"),
    ("render WAKE", 2, "--out"),
    (
        "render WAKE --out a.png --size 0x4",
        2,
        "width and a height",
    ),
    (
        "render WAKE --out a.png --fov 180",
        2,
        "degrees from 1 to 179",
    ),
    (
        "render WAKE --out a.png --eye 1,2",
        2,
        "three finite numbers",
    ),
    (
        "render WAKE --out a.png --eye 1,2,3 --target 1,2,3",
        1,
        "away from the point looked at",
    ),
    (
        "render WAKE --out a.png --eye 1,2,3 --fit all",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --tolerance nan",
        2,
        "between 0 and 1",
    ),
    (
        "render WAKE --out a.png --filter best",
        2,
        "possible values",
    ),
    ("render WAKE --out a.png --range 2,1", 2, "lower one first"),
    ("render WAKE --out a.png --background 2,0,0", 2, "0 to 1"),
    (
        "render WAKE --out a.png --scale log --range -1,2",
        1,
        "above 0",
    ),
    (
        "render WAKE --out a.png --transfer-function no-such-map",
        1,
        "viridis, plasma",
    ),
    (
        "render WAKE --out a.png --lit --unlit",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --scale linear --transfer-function f.json",
        1,
        "a scale of its own",
    ),
    (
        "render BOX --out a.png --dims 2,2,2",
        1,
        "expected a raw volume, found none",
    ),
    (
        "render WAKE --out a.png --density 10",
        1,
        "expected a mesh, found none",
    ),
    (
        "render WAKE --out a.png --texture b.png",
        1,
        "expected a mesh, found none",
    ),
    (
        "render WAKE --out a.png --radius 1",
        1,
        "expected particles, found none",
    ),
    (
        "render WAKE --out a.png --isosurface 1e9",
        1,
        "one that the field has",
    ),
    (
        "render WAKE --out a.png --surface --isosurface .6",
        1,
        "expected one surface, found --surface beside it",
    ),
    (
        "render WAKE --out a.png --surface-opacity .3 --isosurface .6",
        1,
        "expected one surface, found --surface-opacity beside it",
    ),
    (
        "render WAKE --out a.png --surface --column-density",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --surface-opacity 1",
        2,
        "above 0 and below 1",
    ),
    (
        "render TABLE --out a.png --surface",
        1,
        "--surface: data: expected cells, found particles",
    ),
    (
        "render TABLE --out a.png --surface-opacity .3",
        1,
        "--surface-opacity: data: expected cells, found particles",
    ),
    (
        "render SPLATS --out a.png --surface",
        1,
        "expected cells, found splats",
    ),
    (
        "render BOX --out a.png --surface",
        1,
        "expected a grid, found none",
    ),
    (
        "render BOX --out a.png --surface-opacity .3",
        1,
        "--surface-opacity: inputs: expected a grid, found none",
    ),
    (
        "render WAKE --out a.png --surface --count 99 --shepard 1",
        1,
        "--shepard: inputs: expected a volume",
    ),
    (
        "render WAKE --out a.png --surface --count 99 --boundary soft",
        1,
        "--boundary: inputs: expected a volume",
    ),
    (
        "render WAKE --out a.png --surface --count 99 --opacity-scale 2",
        1,
        "--opacity-scale",
    ),
    (
        "render WAKE --out a.png --surface --count 99 --reference=data",
        1,
        "found the surface of --surface",
    ),
    (
        "render WAKE --out a.png --refine auto --column-density",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --opaque-edges auto --reference=kernels",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --surface --count 99 --clip 1,0,0,0 --cut-faces",
        1,
        "--cut-faces",
    ),
    ("render WAKE --out a.png --rate 5", 1, "--rate"),
    ("render WAKE --out a.png --turntable 4", 1, "turn_%04d.png"),
    ("render WAKE --out a.webm --turntable 4", 1, "a.mp4"),
    ("render WAKE --out a_%d.png --turntable 1", 2, "2..=100000"),
    (
        "render WAKE --out a_%d.png --turntable 4 --frames 3",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a_%d.png --turntable 4 --fit view",
        1,
        "--fit",
    ),
    (
        "render WAKE --out a_%d.png --turntable 4 --stats s.json",
        1,
        "one picture",
    ),
    (
        "render WAKE --out a_%d.png --camera-path none.json",
        1,
        "camera path",
    ),
    (
        "render WAKE@nothing --out a.png",
        1,
        "no field of that name",
    ),
    (
        "render WAKE WAKE --field nothing --out a.png",
        1,
        "no field of that name",
    ),
    (
        "render BOX --out a.png --range 0,1",
        1,
        "a transfer function shows",
    ),
    (
        "render BOX --out a.png --field f",
        1,
        "expected data with fields",
    ),
    (
        "render BOX --out a.png --boundary sharp",
        1,
        "expected a grid, found none",
    ),
    (
        "render SPLATS --out a.png --lit",
        1,
        "surfaces, or volumes with a field",
    ),
    (
        "render SPLATS --out a.png --opacity-scale 2",
        1,
        "whose opacity a transfer function gives",
    ),
    ("render SPLATS --out a.png --as mesh", 1, "read as a mesh"),
    (
        "render WAKE --out a.png --column-mean momentum",
        1,
        "--column-density beside it",
    ),
    (
        "render WAKE --out a.png --column-mean momentum --background white",
        1,
        "--column-density beside it",
    ),
    (
        "render WAKE --out a.png --slab-thickness 1 --column-density",
        2,
        "cannot be used with",
    ),
    (
        "render WAKE --out a.png --unit-distance 2",
        1,
        "a transfer function's file",
    ),
    (
        "render WAKE --out a.png --flatten .6 --opacity-scale 2",
        1,
        "--opacity-scale",
    ),
    (
        "render WAKE --out a.png --flatten .6 --composite slabs",
        1,
        "more than opaque surfaces",
    ),
    (
        "render WAKE --out a.png --isosurface .6 --boundary sharp",
        1,
        "--boundary sharp",
    ),
    (
        "render WAKE --out a.png --shepard 1 --boundary sharp",
        1,
        "--boundary sharp",
    ),
    (
        "render WAKE --out a.png --column-density --density 2",
        1,
        "expected a mesh, found none",
    ),
    (
        "render WAKE --out a.png --column-density --radius 2",
        1,
        "expected particles, found none",
    ),
    (
        "render WAKE --out a.png --composite maximum --classify particle",
        1,
        "not slabs",
    ),
    ("render WAKE --out a.png --show count --lit", 1, "--lit"),
    (
        "render BOX --out a.png --filter exact",
        1,
        "kernels that absorb light",
    ),
    (
        "render BOX --out a.png --opacity linear",
        1,
        "kernels that absorb light",
    ),
    (
        "render BOX --out a.png --composite sheets",
        1,
        "more than opaque surfaces",
    ),
    (
        "render BOX --out a.png --classify particle",
        1,
        "a transfer function shows",
    ),
    (
        "render BOX --out a.png --shape covariance",
        1,
        "expected particles, found none",
    ),
    (
        "render SPLATS --out a.png --thresholds 1,2",
        1,
        "kernels that absorb light",
    ),
    (
        "render SPLATS --out a.png --shepard 1",
        1,
        "a grid or particles",
    ),
    (
        "render TABLE --out a.png --length h",
        1,
        "expected particles with lengths, found vxx..vzz",
    ),
    (
        "render TABLE --out a.png --shape covariance",
        1,
        "whose shapes are not stated",
    ),
    (
        "render WAKE --out a.png --type gas",
        1,
        "expected a snapshot of particles, found none",
    ),
    (
        "render WAKE --out a.png --time-stamp t={time}",
        1,
        "whose times are stated",
    ),
    ("render WAKE --out a.png --type u8", 1, "--dims"),
    (
        "render SNAPSHOT --out a.png --dims 2,2,2 --type u8,u16",
        1,
        "one type of samples",
    ),
    (
        "render SNAPSHOT --out a.png --type stars",
        1,
        "one of `PartType0 (gas)`, `PartType1 (dark-matter)`",
    ),
    (
        "render SNAPSHOT --out a.png --type plasma",
        2,
        "dark-matter, disk",
    ),
    (
        "render SNAPSHOT SNAPSHOT --series --out a_%d.png --type gas,dark-matter",
        1,
        "one type of particles",
    ),
    ("info SNAPSHOT --type sinks", 1, "found `sinks`"),
    (
        "render WAKE --out a.png --crop 0,0,0,1,1",
        2,
        "the lower and the upper corner",
    ),
    (
        "render WAKE --out a.png --crop 0,0,0,1,-1,1",
        2,
        "the lower and the upper corner",
    ),
    (
        "render WAKE --out a.png --crop 0,0,0,1,inf,1",
        2,
        "six finite numbers",
    ),
    (
        "render WAKE --out a.png --crop 500,0,0,501,1,1",
        1,
        "found no centre of a cell from 500,0,0 to 501,1,1",
    ),
    (
        "convert BOX --out a.ply --crop 5,5,5,6,6,6",
        1,
        "which reach from 0,0,0 to 1,1,0",
    ),
    (
        "render WAKE --out a.png --rotate 0,0,0,90",
        2,
        "an axis, not 0,0,0",
    ),
    ("render WAKE --out a.png --rotate 0,0,1", 2, "an axis"),
    ("render WAKE --out a.png --resize 0", 2, "above 0"),
    ("render WAKE --out a.png --resize 1,2", 2, "such as 1,1,50"),
    (
        "render WAKE --out a.png --resize 1,0,1",
        2,
        "such as 1,1,50",
    ),
    ("render WAKE --out a.png --exaggerate 0", 2, "above 0"),
    (
        "render WAKE --out a.png --step last",
        1,
        "expected a file with steps of time",
    ),
    (
        "render WAKE --out a.png --translate 1,2",
        2,
        "three finite numbers",
    ),
    (
        "render WAKE --out a.png --resize 2 --resize none",
        1,
        "once for each of 1 input, found 2 times",
    ),
    (
        "convert BOX BOX --out a.ply --resize 2 --resize 2 --resize 2",
        1,
        "once for each of 2 inputs, found 3 times",
    ),
    ("render none.vtu --out a.png", 1, "none.vtu"),
    ("render WAKE --out none/a.png", 1, "an existing folder"),
    ("paint", 2, "unrecognized subcommand"),
];

#[test]
fn wrong_usage_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let sources = tempfile::tempdir().unwrap();
    let path = |name: &str| sources.path().join(name).to_str().unwrap().to_owned();
    let (cube, splats) = (path("box.obj"), path("three.splat"));
    std::fs::write(&cube, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    // Three splats of 32 bytes: position, scale, colour, rotation.
    let mut bytes = Vec::new();
    for i in 0..3u8 {
        let numbers = [f32::from(i), 0.0, 0.0, 0.3, 0.3, 0.3];
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend([200, 100, 50, 255, 255, 128, 128, 128]);
    }
    std::fs::write(&splats, bytes).unwrap();
    let wake = fixture("wake.xyz");
    for (line, status, part) in WRONG {
        let line = line
            .replace("WAKE", &wake)
            .replace("BOX", &cube)
            .replace("SPLATS", &splats)
            .replace("SNAPSHOT", &fixture("gadget_old.h5"))
            .replace("TABLE", &fixture("particles.csv"));
        let words: Vec<&str> = line.split(' ').collect();
        let output = run(folder.path(), &words);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(*status), "{line}: {said}");
        assert!(said.contains(part), "{line}: {said}");
        // An error is one line; a usage message has more.
        if *status == 1 {
            let faults = said.lines().filter(|l| l.starts_with("error: "));
            assert_eq!(faults.count(), 1, "{line}: {said}");
        }
        assert!(files(folder.path()).is_empty(), "{line}");
    }
}
