//! Tests valid variations of glTF files in parts that are not drawn: the picture stays the same.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use ewa_splat::io::{Dataset, Geometry, OpenOptions, SplatFileOptions, read};
use ewa_splat::scene::SplatRule;
use serde_json::{Value, json};

use crate::support::meshes::rich_gltf;
use crate::support::splats::{glb, glb_splats, some_splats};

/// JSON and binary chunk of a file.
type File = (Value, Vec<u8>);

fn files() -> [File; 2] {
    let mesh = rich_gltf();
    let splats = glb_splats(&some_splats(5, 1));
    let word = |at: usize| u32::from_le_bytes(splats[at..at + 4].try_into().unwrap()) as usize;
    let (json, bin) = splats[20..].split_at(word(12));
    let document = serde_json::from_slice(json).unwrap();
    [(mesh.json, mesh.bin), (document, bin[8..].to_vec())]
}

fn open(bytes: &[u8]) -> Dataset {
    match read("a.glb", bytes, &OpenOptions::default()) {
        Ok(data) => data,
        Err(error) => panic!("{error}"),
    }
}

/// Returns the drawn data as text.
fn shown(data: &Dataset) -> String {
    format!("{} {:?}", data.format, data.geometry)
}

/// Changes each object of the format, except the maps of attributes and extensions.
fn each_object(value: &mut Value, change: &mut dyn FnMut(&mut serde_json::Map<String, Value>)) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(|item| each_object(item, change)),
        Value::Object(members) => {
            for (key, member) in members.iter_mut() {
                match key.as_str() {
                    "attributes" | "targets" | "extras" => {}
                    "extensions" => {
                        let extensions = member.as_object_mut().into_iter();
                        let extensions = extensions.flat_map(|map| map.values_mut());
                        extensions.for_each(|e| each_object(e, change));
                    }
                    _ => each_object(member, change),
                }
            }
            change(members);
        }
        _ => {}
    }
}

/// Changes each integer to a number with a decimal point.
fn with_points(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(with_points),
        Value::Object(members) => members.values_mut().for_each(with_points),
        Value::Number(number) => {
            if let Some(whole) = number.as_u64() {
                *value = json!(whole as f64);
            }
        }
        _ => {}
    }
}

/// Returns contents of all JSON types.
fn contents() -> Vec<Value> {
    vec![
        json!(7),
        json!(-0.5),
        json!(true),
        Value::Null,
        json!("text \u{1f600} \u{0}"),
        json!([1, [2, []], null, {}]),
        json!({ "mesh": "x", "extras": 1, "nodes": { "a": [null] }, "extensions": 3 }),
    ]
}

type Change = Box<dyn Fn(&mut Value)>;

/// Returns changes of a file that keep the drawn data.
fn variations() -> Vec<(String, Change)> {
    let mut all: Vec<(String, Change)> = Vec::new();
    let mut add = |name: String, change: Change| all.push((name, change));
    for content in contents() {
        for key in ["extras", "acmeMember"] {
            let content = content.clone();
            add(
                format!("{key} {content}"),
                Box::new(move |json| {
                    each_object(json, &mut |object| {
                        object.insert(key.into(), content.clone());
                    });
                }),
            );
        }
        add(
            format!("extensions {content}"),
            Box::new(move |json| {
                each_object(json, &mut |object| {
                    let extensions = object.entry("extensions").or_insert_with(|| json!({}));
                    extensions["ACME_any"] = content.clone();
                });
            }),
        );
    }
    for name in ["", "a/b\\c", "\u{202e}\u{0}ü", &"long ".repeat(1000)] {
        let name = name.to_owned();
        add(
            format!("name {:?}", name.get(..4)),
            Box::new(move |json| {
                each_object(json, &mut |object| {
                    object.entry("name").or_insert_with(|| json!(name));
                });
            }),
        );
    }
    let mut part = |list: &'static str, item: Value| {
        add(
            format!("{list} {item}"),
            Box::new(move |json| {
                let root = json.as_object_mut().unwrap();
                let items = root.entry(list).or_insert_with(|| json!([]));
                items.as_array_mut().unwrap().push(item.clone());
            }),
        );
    };
    // A pointer's target has no node.
    part(
        "animations",
        json!({
            "channels": [{ "sampler": 0, "target": { "path": "pointer", "extensions": {
                "KHR_animation_pointer": { "pointer": "/nodes/0/translation" } } } }],
            "samplers": [{ "input": 0, "output": 0, "interpolation": "ACME" }],
        }),
    );
    part("animations", json!({ "channels": [], "samplers": [] }));
    part(
        "cameras",
        json!({ "type": "orthographic", "orthographic": {} }),
    );
    part("cameras", json!({ "type": "acme" }));
    part("scenes", json!({}));
    part("scenes", json!({ "name": "empty", "extras": [] }));
    part(
        "accessors",
        json!({ "componentType": 5130, "count": 3, "type": "MAT3" }),
    );
    part(
        "bufferViews",
        json!({ "buffer": 0, "byteLength": 1, "target": 1 }),
    );
    part(
        "buffers",
        json!({ "byteLength": 9, "uri": "not%20there.bin" }),
    );
    part(
        "images",
        json!({ "uri": "not there.jxl", "mimeType": "image/jxl" }),
    );
    part("samplers", json!({ "magFilter": 1, "minFilter": "x" }));
    part(
        "textures",
        json!({ "extensions": { "ACME_texture": { "source": "x" } } }),
    );
    part(
        "materials",
        json!({
            "alphaMode": "ACME", "pbrMetallicRoughness": { "baseColorTexture": { "index": 99 } },
            "occlusionTexture": { "index": 99 },
        }),
    );
    part(
        "meshes",
        json!({ "primitives": [{ "attributes": { "POSITION": 99 }, "mode": 77 }] }),
    );
    part("skins", json!({ "joints": [], "skeleton": 99 }));
    part("extensionsUsed", json!("ACME_any"));
    add("whole numbers with points".into(), Box::new(with_points));
    add(
        "parts of materials that light shows".into(),
        Box::new(|json| {
            for material in json["materials"].as_array_mut().into_iter().flatten() {
                material["occlusionTexture"] = json!({ "index": 0.5, "strength": "x" });
                material["pbrMetallicRoughness"]["metallicFactor"] = json!("x");
                material["extensions"]["KHR_materials_sheen"] = json!(1);
            }
        }),
    );
    add(
        "cameras and lights of nodes".into(),
        Box::new(|json| {
            for node in json["nodes"].as_array_mut().unwrap() {
                node["camera"] = json!(99);
                node["extensions"]["KHR_lights_punctual"] = json!({ "light": 99 });
            }
        }),
    );
    add(
        "bounds and attributes of one's own".into(),
        Box::new(|json| {
            for accessor in json["accessors"].as_array_mut().unwrap() {
                accessor["min"] = json!(["x"]);
                accessor["max"] = json!({});
            }
            for mesh in json["meshes"].as_array_mut().unwrap() {
                mesh["primitives"][0]["attributes"]["_ACME"] = json!(99);
                mesh["primitives"][0]["attributes"]["TANGENT"] = json!(99);
            }
        }),
    );
    all
}

#[test]
fn what_nobody_draws_may_be_anything() {
    for (json, bin) in files() {
        let plain = open(&glb(&json, &bin));
        let expected = shown(&plain);
        for (name, change) in variations() {
            let mut changed = json.clone();
            change(&mut changed);
            let data = open(&glb(&changed, &bin));
            assert!(shown(&data) == expected, "{}: {name}", data.format);
            if !name.starts_with("extensionsUsed") {
                assert_eq!(data.notes, plain.notes, "{name}");
            }
        }
        // All changes at once.
        let mut changed = json.clone();
        for (name, change) in variations() {
            if !name.contains("acme") && !name.starts_with("name") {
                change(&mut changed);
            }
        }
        assert!(shown(&open(&glb(&changed, &bin))) == expected);
    }
}

/// Text that is the same JSON, spelt differently.
#[test]
fn json_may_be_spelled_in_any_way() {
    for (json, bin) in files() {
        let expected = shown(&open(&glb(&json, &bin)));
        let text = json.to_string();
        let deep = format!("{{\"extras\":{}1{},", "[".repeat(500), "]".repeat(500));
        for spelled in [
            serde_json::to_string_pretty(&json).unwrap(),
            text.replace("\"meshes\"", "\"mesh\\u0065s\""),
            format!("\n\t {text} \r\n"),
            // Nesting beyond parsers' limits, and numbers beyond f64.
            text.replacen('{', &deep, 1),
            text.replacen('{', "{\"extras\":1e999,", 1),
        ] {
            let mut bytes = Vec::new();
            for (kind, chunk) in [(b"JSON", spelled.as_bytes()), (b"BIN\0", &bin)] {
                let mut chunk = chunk.to_vec();
                chunk.resize(chunk.len().next_multiple_of(4), b' ');
                bytes.extend((chunk.len() as u32).to_le_bytes());
                bytes.extend(kind);
                bytes.extend(chunk);
            }
            let len = (bytes.len() as u32 + 12).to_le_bytes();
            let file = [&b"glTF\x02\0\0\0"[..], &len, &bytes].concat();
            assert!(shown(&open(&file)) == expected, "{spelled:.80}");
        }
    }
}

#[test]
fn chunks_may_lack_padding_and_have_others_beside_them() {
    let chunk = |kind: &[u8; 4], bytes: &[u8]| {
        let len = (bytes.len() as u32).to_le_bytes();
        [&len, &kind[..], bytes].concat()
    };
    let file = |chunks: &[Vec<u8>]| {
        let chunks = chunks.concat();
        let len = (chunks.len() as u32 + 12).to_le_bytes();
        [&b"glTF\x02\0\0\0"[..], &len, &chunks].concat()
    };
    for (json, bin) in files() {
        let expected = shown(&open(&glb(&json, &bin)));
        for spaces in 0..4 {
            let text = format!("{json}{}", " ".repeat(spaces));
            let is_padded = text.len().is_multiple_of(4);
            let (text, binary) = (chunk(b"JSON", text.as_bytes()), chunk(b"BIN\0", &bin));
            let mut files = vec![file(&[text.clone(), binary.clone()])];
            if is_padded {
                // A chunk of another kind, and bytes after the end.
                let other = chunk(b"ACME", b"four");
                files.push(file(&[text.clone(), other.clone(), binary.clone()]));
                files.push(file(&[text.clone(), binary.clone(), other]));
            }
            for file in files {
                let data = open(&file);
                assert!(shown(&data) == expected, "{spaces} spaces");
                let is_noted = data.notes.iter().any(|note| note.contains("four bytes"));
                let is_whole = is_padded && bin.len().is_multiple_of(4);
                assert_eq!(is_noted, !is_whole, "{spaces}: {:?}", data.notes);
            }
        }
        let mut longer = glb(&json, &bin);
        longer.extend([0xff; 30]);
        let data = open(&longer);
        assert!(shown(&data) == expected);
        assert!(
            data.notes
                .iter()
                .any(|note| note.contains("bytes after the end"))
        );
    }
}

#[test]
fn what_is_drawn_is_checked() {
    let [(mesh, mesh_bin), (splats, splat_bin)] = files();
    for (file, pointer, value, words) in [
        (&mesh, "/nodes/0/mesh", json!("x"), "node 0, mesh"),
        (&mesh, "/nodes/0/mesh", json!(0.5), "a whole number"),
        (&mesh, "/nodes/0/mesh", json!(-1), "a whole number"),
        (&mesh, "/nodes/0/translation", json!([1, 2]), "3 numbers"),
        (
            &mesh,
            "/meshes/0/primitives",
            json!({}),
            "a list of objects",
        ),
        (&mesh, "/accessors/0/count", json!(1e300), "a whole number"),
        (
            &mesh,
            "/materials/0/alphaMode",
            json!("x"),
            "OPAQUE, MASK or BLEND",
        ),
        (&mesh, "/bufferViews", json!(1), "a list"),
        (&splats, "/accessors/0/count", json!(1e9), "elements"),
        (
            &splats,
            "/bufferViews/0/byteLength",
            json!(null),
            "buffer view 0, byteLength",
        ),
        (&splats, "/nodes/0/mesh", json!(4), "one of 1 meshes"),
    ] {
        let mut broken = file.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = broken.pointer_mut(parent).unwrap();
        parent[key] = value;
        let bin = if std::ptr::eq(file, &mesh) {
            &mesh_bin
        } else {
            &splat_bin
        };
        let error = read("a.glb", &glb(&broken, bin), &OpenOptions::default()).unwrap_err();
        let error = error.to_string();
        assert!(error.contains(words), "{pointer}: {error}");
    }
    // A required extension that is not supported, in either kind of file.
    for (mut json, bin) in files() {
        json["extensionsRequired"] = json!(["ACME_any"]);
        let error = read("a.glb", &glb(&json, &bin), &OpenOptions::default()).unwrap_err();
        assert!(
            error.to_string().contains("`ACME_any`, which is not"),
            "{error}"
        );
    }
}

#[test]
fn spaces_of_colours_that_are_not_known_are_said() {
    let [_, (mut json, bin)] = files();
    let splats = |json: &mut Value, space: Value| {
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
            space;
        open(&glb(json, &bin)).notes
    };
    assert!(splats(&mut json, json!("srgb_rec709_display")).is_empty());
    let notes = splats(&mut json, json!("acme_rec2020"));
    assert!(
        notes[0].contains("colorSpace `acme_rec2020` is not known"),
        "{notes:?}"
    );
}

#[test]
fn splats_end_at_three_deviations_and_other_projections_are_said() {
    let [_, (mut json, bin)] = files();
    let data = open(&glb(&json, &bin));
    let Geometry::Splats(cloud) = &data.geometry else {
        panic!("splats")
    };
    assert_eq!(cloud.rule, SplatRule::Khr);
    for (projection, is_said) in [("perspective", false), ("tangential", true)] {
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["projection"] =
            json!(projection);
        let notes = open(&glb(&json, &bin)).notes;
        assert_eq!(
            notes.iter().any(|note| note.contains("tangential")),
            is_said
        );
    }
}

/// Splats are sorted by distance unless the file says otherwise, and what is written says it again.
#[test]
fn orders_of_splats_are_those_of_the_file() {
    let [_, (mut json, bin)] = files();
    let mut sorted = |method: Option<&str>| {
        let extension =
            &mut json["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"];
        match method {
            Some(method) => extension["sortingMethod"] = json!(method),
            None => drop(extension.as_object_mut().unwrap().remove("sortingMethod")),
        }
        let data = open(&glb(&json, &bin));
        let Geometry::Splats(cloud) = data.geometry else {
            panic!("splats")
        };
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("again.glb");
        ewa_splat::io::write_splats(&out, &cloud, &SplatFileOptions::default()).unwrap();
        let again = ewa_splat::io::open(&out, &OpenOptions::default()).unwrap();
        let Geometry::Splats(again) = again.geometry else {
            panic!("splats")
        };
        assert_eq!(again.by_distance, cloud.by_distance);
        (cloud.by_distance, data.notes)
    };
    assert_eq!(sorted(None), (true, vec![]));
    assert_eq!(sorted(Some("cameraDistance")), (true, vec![]));
    assert_eq!(sorted(Some("zDepth")), (false, vec![]));
    let (by_distance, notes) = sorted(Some("acme"));
    assert!(
        by_distance && notes[0].contains("sortingMethod `acme`"),
        "{notes:?}"
    );
}

/// A mesh beside splats that no scene shows is a mesh. The extension's name in a comment does not
/// make a splat file.
#[test]
fn files_are_splats_where_they_show_some() {
    let [(mut json, bin), _] = files();
    json["extras"] = json!("KHR_gaussian_splatting");
    json["extensionsUsed"] = json!(["KHR_gaussian_splatting"]);
    let unseen = json!({ "primitives": [{ "attributes": {}, "mode": 0,
        "extensions": { "KHR_gaussian_splatting": {} } }] });
    json["meshes"].as_array_mut().unwrap().push(unseen);
    assert_eq!(open(&glb(&json, &bin)).format, "glTF mesh");
}
