//! Tests numbers that single precision cannot represent, in files of each kind that stores them.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::io::{Dataset, Field, FieldSource, OpenOptions, read};
use ewa_splat::sample::{SampleOptions, volume};
use ewa_splat::scene::{ValueScale, Values};

const COUNT: usize = 27;

fn wave(n: usize) -> f64 {
    101_325.0 + 0.01 * (n as f64).sin()
}

fn values_of(name: &str, bytes: &[u8]) -> Values {
    let data = read(name, bytes, &OpenOptions::default()).unwrap();
    let named = data
        .fields
        .iter()
        .find(|f| f.name == "p")
        .or(data.fields.first());
    match &named.unwrap().source {
        FieldSource::Scalar(values) => values.clone(),
        _ => panic!("{name}: no scalar"),
    }
}

#[test]
fn readers_keep_what_single_precision_loses() {
    let numbers: Vec<f64> = (0..COUNT).map(wave).collect();
    let text: Vec<String> = numbers.iter().map(|v| format!("{v:?}")).collect();
    let body: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
    let big: Vec<u8> = numbers.iter().flat_map(|v| v.to_be_bytes()).collect();
    let vti = format!(
        r#"<VTKFile type="ImageData" version="1.0"><ImageData WholeExtent="0 2 0 2 0 2" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 2 0 2 0 2"><PointData><DataArray type="Float64" Name="p" format="ascii">{}</DataArray></PointData></Piece></ImageData></VTKFile>"#,
        text.join(" ")
    );
    let legacy = |kind: &str, body: &[u8]| {
        let head = format!(
            "# vtk DataFile Version 3.0\np\n{kind}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 3 3\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 27\nSCALARS p double 1\nLOOKUP_TABLE default\n"
        );
        [head.as_bytes(), body, b"\n"].concat()
    };
    let rows: Vec<String> = (0..COUNT)
        .map(|n| format!("{},{},{},{}", n % 3, n / 3 % 3, n / 9, text[n]))
        .collect();
    let csv = format!("x,y,z,p\n{}\n", rows.join("\n"));
    let nrrd = |kind: &str, endian: &str, body: &[u8]| {
        let head = format!(
            "NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 3 3 3\nendian: {endian}\nencoding: raw\n\n"
        );
        [head.as_bytes(), body].concat()
    };
    for (name, file) in [
        ("a.vti", vti.into_bytes()),
        ("a.vtk", legacy("ASCII", text.join(" ").as_bytes())),
        ("b.vtk", legacy("BINARY", &big)),
        ("a.csv", csv.into_bytes()),
        ("a.nrrd", nrrd("double", "little", &body)),
        ("b.nrrd", nrrd("double", "big", &big)),
    ] {
        let values = values_of(name, &file);
        let mut found: Vec<f64> = (0..values.len()).map(|i| values.wide(i)).collect();
        let mut expected = numbers.clone();
        found.sort_by(f64::total_cmp);
        expected.sort_by(f64::total_cmp);
        assert_eq!(found, expected, "{name}");
    }
    // Integers are kept, too: a cell's number, for instance.
    let ids: Vec<u8> = (0..27_i64)
        .flat_map(|n| (3_000_000_000 + n).to_le_bytes())
        .collect();
    let values = values_of("ids.nrrd", &nrrd("int64", "little", &ids));
    assert!((0..27).any(|i| values.wide(i) == 3_000_000_001.0));
    // Numbers that single precision represents stay in it.
    let halves: Vec<u8> = (0..27)
        .flat_map(|n| (0.5 * f64::from(n)).to_le_bytes())
        .collect();
    assert!(matches!(
        values_of("c.nrrd", &nrrd("double", "little", &halves)),
        Values::F32(_)
    ));
}

#[test]
fn a_magnitude_keeps_the_digits_of_its_components() {
    let component = |n: usize| Values::from((0..3).map(|i| wave(3 * n + i)).collect::<Vec<f64>>());
    let mut data = read(
        "a.csv",
        b"x,y,z\n0,0,0\n1,0,0\n2,0,1\n",
        &OpenOptions::default(),
    )
    .unwrap();
    let source = FieldSource::Vector((0..3).map(component).collect());
    let association = ewa_splat::io::Association::Nodes;
    let field = Field {
        name: "u".into(),
        association,
        source,
        unit: None,
    };
    data.fields = vec![field];
    let (_, magnitude) = data.scalar("u").unwrap();
    for i in 0..3 {
        let squares: f64 = (0..3).map(|n| wave(3 * n + i).powi(2)).sum();
        assert!((magnitude.wide(i) - squares.sqrt()).abs() < 1e-9);
    }
}

/// Values far from 0 get the positions of the same field about 0.
#[test]
fn positions_are_the_differences() {
    let of = |origin: f64, factor: f64| {
        let numbers: Vec<f64> = (0..1000)
            .map(|n| origin + factor * (n as f64).sin())
            .collect();
        let text: Vec<String> = (0..1000)
            .map(|n| format!("{},{},{},{:?}", n % 10, n / 10 % 10, n / 100, numbers[n]))
            .collect();
        let csv = format!("x,y,z,p\n{}\n", text.join("\n"));
        let data: Dataset = read("a.csv", csv.as_bytes(), &OpenOptions::default()).unwrap();
        assert_eq!(data.path, Path::new("a.csv"));
        let options = SampleOptions {
            field: Some("p".into()),
            ..SampleOptions::default()
        };
        let sampled = volume(data, &options).unwrap();
        let transfer = sampled.volume.transfer_function.unwrap();
        (sampled.volume.values.unwrap(), transfer, numbers)
    };
    for (origin, factor) in [(1.7e9, 5.0), (-101_325.0, 0.01), (0.0, 1e250), (1e12, 1e-3)] {
        let (values, transfer, numbers) = of(origin, factor);
        let scale = transfer.value_scale();
        assert!(
            matches!(scale, ValueScale::Shifted { .. }),
            "{origin} {scale:?}"
        );
        for (i, number) in numbers.iter().enumerate() {
            let back = scale.value(values.get(i));
            assert!(
                (back - number).abs() < 1e-6 * factor + 2.0 * f64::EPSILON * origin.abs(),
                "{origin}: {back} {number}"
            );
        }
    }
    // Within single precision, nothing is shifted.
    let (values, transfer, numbers) = of(300.0, 40.0);
    assert_eq!(transfer.value_scale(), ValueScale::Linear);
    #[allow(clippy::cast_possible_truncation, reason = "as values are narrowed")]
    let is_narrowed = |i: usize| values.get(i) == numbers[i] as f32;
    assert!((0..1000).all(is_narrowed));
}
