//! Tests ParaView's colour maps: steps, categories, presets of any range, XML.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::path::Path;

use ewa_splat::image::linear_from_srgb;
use ewa_splat::io::read;
use ewa_splat::sample::{FunctionOptions, SampleOptions, TransferChoice, shared_functions, volume};
use ewa_splat::scene::{TransferDefaults, TransferFunction};

const DATA: [f32; 2] = [300.0, 1000.0];

fn function(text: &str) -> ewa_splat::Result<TransferFunction> {
    let defaults = TransferDefaults {
        range: DATA,
        unit_distance: 1.0,
    };
    TransferFunction::from_json(Path::new("map"), text, &defaults)
}

/// Returns the encoded colour at a value, in tenths.
fn colour(function: &TransferFunction, value: f32) -> [i32; 3] {
    let [r, g, b, _] = function.classify(value);
    [r, g, b].map(|x| {
        (0..=10)
            .find(|i| linear_from_srgb(*i as f32 / 10.0) >= x - 1e-2)
            .unwrap()
    })
}

const RED: [i32; 3] = [10, 0, 0];
const GREEN: [i32; 3] = [0, 10, 0];
const BLUE: [i32; 3] = [0, 0, 10];

#[test]
fn presets_are_stretched_and_maps_with_opacities_stay() {
    let colours = "\"ColorSpace\": \"RGB\", \"RGBPoints\": [-1, 0, 0, 1, 0, 0, 1, 0, 1, 1, 0, 0]";
    let preset = function(&format!("[{{{colours}, \"Name\": \"jet\"}}]")).unwrap();
    assert_eq!(preset.range(), DATA);
    assert_eq!(
        [300.0, 650.0, 1000.0].map(|v| colour(&preset, v)),
        [BLUE, GREEN, RED]
    );
    let own = function(&format!(
        "{{{colours}, \"Points\": [-1, 0, 0.5, 0, 1, 1, 0.5, 0]}}"
    ))
    .unwrap();
    assert_eq!(own.range(), [-1.0, 1.0]);
    assert_eq!(
        [-1.0, 0.0, 1.0].map(|v| colour(&own, v)),
        [BLUE, GREEN, RED]
    );
}

/// vtkColorTransferFunction gives a step the colour of the point at its end.
#[test]
fn steps_have_the_colour_of_their_ends() {
    let map = "{\"ColorSpace\": \"Step\", \"RGBPoints\": [0, 1, 0, 0, 1, 0, 1, 0, 3, 0, 0, 1], \
               \"Points\": [0, 1, 0.5, 0, 3, 1, 0.5, 0]}";
    let map = function(map).unwrap();
    for (value, expected) in [(0.1, GREEN), (0.9, GREEN), (1.1, BLUE), (2.9, BLUE)] {
        assert_eq!(colour(&map, value), expected, "{value}");
    }
}

#[test]
fn categories_have_their_colours() {
    let colours = "\"IndexedColors\": [1, 0, 0, 0, 1, 0, 0, 0, 1]";
    let plain = function(&format!("{{{colours}}}")).unwrap();
    let stated = format!(
        "{{{colours}, \"Annotations\": [\"10\", \"bone\", \"2\", \"air\", \"4\", \"skin\"]}}"
    );
    let stated = function(&stated).unwrap();
    for (function, values) in [(&plain, [0.0, 1.0, 2.0]), (&stated, [10.0, 2.0, 4.0])] {
        assert_eq!(values.map(|v| colour(function, v)), [RED, GREEN, BLUE]);
    }
    assert_eq!(colour(&plain, 1.4), GREEN);
    assert_eq!(colour(&stated, 6.0), BLUE);
    assert_eq!(colour(&stated, 8.0), RED);
}

#[test]
fn xml_maps_are_presets() {
    let text = "<?xml version=\"1.0\"?><ColorMaps><ColorMap name=\"a\" space=\"RGB\">\
        <Point x=\"0.2\" o=\"1\" r=\"0\" g=\"0\" b=\"1\"/><Point x=\"0.8\" o=\"1\" r=\"1\" g=\"0\" b=\"0\"/>\
        <NaN r=\"0\" g=\"1\" b=\"0\"/></ColorMap></ColorMaps>";
    let map = function(text).unwrap();
    assert_eq!(map.range(), DATA);
    assert_eq!([300.0, 1000.0].map(|v| colour(&map, v)), [BLUE, RED]);
    let step = function(&text.replace("RGB", "Step")).unwrap();
    assert_eq!(colour(&step, 310.0), RED);
    for (text, says) in [
        ("<a><b/></a>", "a `ColorMap`"),
        ("<ColorMap", "XML"),
        ("<ColorMap/>", "RGBPoints"),
    ] {
        let error = function(text).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// A note reports the stretched range, and data sets that are drawn together share it.
#[test]
fn presets_say_their_range_and_are_shared() {
    let preset = "{\"RGBPoints\": [-1, 0, 0, 1, 1, 1, 0, 0]}";
    let options = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Text(preset.into()),
            ..FunctionOptions::default()
        },
        field: Some("f".into()),
        ..SampleOptions::default()
    };
    let table = |first: usize| {
        let rows = (0..27).map(|i| format!("{},{},{},1,{}\n", i % 3, i / 3 % 3, i / 9, first + i));
        let text = format!("x,y,z,sigma,f\n{}", rows.collect::<String>());
        read("a.csv", text.as_bytes(), &Default::default()).unwrap()
    };
    let [mut a, mut b] = [0, 100].map(|first| volume(table(first), &options).unwrap());
    let said = a.report.warnings().join("\n");
    assert!(
        said.contains("from -1 to 1, stretched over the data's, 0 to 26"),
        "{said}"
    );
    let mut sampled = vec![(&mut a.report, &options), (&mut b.report, &options)];
    let shared = shared_functions(&mut sampled).unwrap();
    assert_eq!(
        (shared[0].0.range(), &shared[0].1),
        ([0.0, 126.0], &vec![0, 1])
    );
    // A given range replaces that of the data; a map with its own range refuses one.
    let ranged = SampleOptions {
        function: FunctionOptions {
            range: Some([-50.0, 50.0]),
            ..options.function.clone()
        },
        ..options.clone()
    };
    let ranged = volume(table(0), &ranged).unwrap();
    assert_eq!(
        ranged.volume.transfer_function.unwrap().range(),
        [-50.0, 50.0]
    );
    let own = preset.replace('}', ", \"Points\": [-1, 0, 0.5, 0, 1, 1, 0.5, 0]}");
    let own = SampleOptions {
        function: FunctionOptions {
            transfer: TransferChoice::Text(own),
            range: Some([0.0, 1.0]),
            ..options.function
        },
        ..options
    };
    let error = volume(table(0), &own).unwrap_err().to_string();
    assert!(error.contains("a range of its own"), "{error}");
}
