//! Tests splats in glTF: sound files, nodes that move them, and numbers of every type.

use super::{Folder, cloud_of, norm, seen, some_cloud, variance};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use ewa_splat::io::{OpenOptions, SplatCloud, open};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::{Value, json};

/// Returns the JSON and the numbers of a .glb file, after checking its container.
fn parts(bytes: &[u8]) -> (Value, Vec<u8>) {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(
        (&bytes[..4], word(4), word(8)),
        (&b"glTF"[..], 2, bytes.len())
    );
    let json_len = word(12);
    assert_eq!((&bytes[16..20], json_len % 4), (&b"JSON"[..], 0));
    let binary_at = 20 + json_len;
    assert_eq!(&bytes[binary_at + 4..binary_at + 8], b"BIN\0");
    let binary_len = word(binary_at);
    assert_eq!(
        (binary_len % 4, binary_at + 8 + binary_len),
        (0, bytes.len())
    );
    let json = serde_json::from_slice(&bytes[20..binary_at]).unwrap();
    (json, bytes[binary_at + 8..].to_vec())
}

#[test]
fn glb_files_are_sound_gltf() {
    let folder = Folder::new();
    for degree in 0..=3_u8 {
        let cloud = some_cloud(17, degree, 30);
        folder.write("glb", &cloud);
        let (json, binary) = parts(&std::fs::read(folder.path("a.glb")).unwrap());
        assert_eq!(json["asset"]["version"], "2.0");
        assert_eq!(json["extensionsUsed"], json!(["KHR_gaussian_splatting"]));
        assert_eq!(json["buffers"], json!([{ "byteLength": binary.len() }]));
        let primitive = &json["meshes"][0]["primitives"][0];
        assert_eq!(primitive["mode"], 0);
        let extension = &primitive["extensions"]["KHR_gaussian_splatting"];
        for (key, value) in [
            ("kernel", "ellipse"),
            ("colorSpace", "srgb_rec709_display"),
            ("projection", "perspective"),
            ("sortingMethod", "zDepth"),
        ] {
            assert_eq!(extension[key], value);
        }
        let mut expected = vec!["POSITION".to_owned()];
        expected.extend(
            ["OPACITY", "ROTATION", "SCALE"].map(|n| format!("KHR_gaussian_splatting:{n}")),
        );
        for l in 0..=degree {
            let of = |n| format!("KHR_gaussian_splatting:SH_DEGREE_{l}_COEF_{n}");
            expected.extend((0..=2 * l).map(of));
        }
        expected.sort();
        let attributes = primitive["attributes"].as_object().unwrap();
        let mut names: Vec<_> = attributes.keys().cloned().collect();
        names.sort();
        assert_eq!(names, expected);
        // Each accessor has its own view of whole words, and together they fill the buffer in
        // order.
        let mut end = 0;
        for (name, index) in attributes {
            let accessor = &json["accessors"][index.as_u64().unwrap() as usize];
            let width = match accessor["type"].as_str().unwrap() {
                "SCALAR" => 1,
                "VEC3" => 3,
                "VEC4" => 4,
                other => panic!("{other}"),
            };
            let is_scalar = name.ends_with("OPACITY");
            assert_eq!(
                (width == 1, width == 4),
                (is_scalar, name.ends_with("ROTATION"))
            );
            assert_eq!(
                (&accessor["componentType"], &accessor["count"]),
                (&json!(5126), &json!(17))
            );
            let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            assert_eq!(view["byteLength"], 4 * width * 17);
            assert_eq!(view["byteOffset"].as_u64().unwrap() % 4, 0);
            end = end.max(view["byteOffset"].as_u64().unwrap() + 4 * width * 17);
        }
        assert_eq!(end as usize, binary.len());
        let accessor = &json["accessors"][attributes["POSITION"].as_u64().unwrap() as usize];
        let lower = cloud
            .positions
            .iter()
            .copied()
            .fold(DVec3::INFINITY, DVec3::min);
        let upper = cloud
            .positions
            .iter()
            .copied()
            .fold(DVec3::NEG_INFINITY, DVec3::max);
        for (key, expected) in [("min", lower), ("max", upper)] {
            // The bounds equal those of the buffer, as glTF requires.
            let stated: Vec<f32> = serde_json::from_value(accessor[key].clone()).unwrap();
            assert_eq!(stated, expected.as_vec3().to_array());
        }
    }
}

/// Far from the origin, f32 cannot represent positions: a node stores the offset in f64.
#[test]
fn glb_keeps_positions_far_from_the_origin() {
    let folder = Folder::new();
    let mut cloud = some_cloud(20, 0, 31);
    let far = DVec3::new(4.0e8, -3.0e8, 1.25e8);
    for p in &mut cloud.positions {
        *p += far;
    }
    let written = folder.write("glb", &cloud);
    assert!(written.notes.is_empty() && written.position_quantum < 3e-7);
    let after = cloud_of(folder.read("a.glb"));
    for (a, b) in cloud.positions.iter().zip(&after.positions) {
        // Half an f32 step at 2, and f64 steps at 4e8.
        assert!((*a - *b).abs().max_element() < 3e-7, "{a} {b}");
    }
    // PLY has no place for an offset: the loss is reported.
    let written = folder.write("ply", &cloud);
    assert_eq!(written.position_quantum, 32.0);
    assert!(
        written.notes[0].contains("move the scene"),
        "{:?}",
        written.notes
    );
}

fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    crate::support::splats::glb(json, binary)
}

/// Returns the parts of a written file, for modification.
fn written_parts(folder: &Folder, cloud: &SplatCloud) -> (Value, Vec<u8>) {
    folder.write("glb", cloud);
    parts(&std::fs::read(folder.path("a.glb")).unwrap())
}

#[test]
fn nodes_move_splats() {
    let folder = Folder::new();
    let cloud = some_cloud(12, 3, 40);
    let (document, binary) = written_parts(&folder, &cloud);
    let rotation = DQuat::from_xyzw(0.5, -0.1, 0.3, 0.8).normalize();
    let of = |scale: DVec3| {
        DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::new(3.0, -2.0, 0.5))
    };
    for (scale, is_similar) in [
        (DVec3::ONE, true),
        (DVec3::splat(2.5), true),
        (DVec3::new(-2.0, 2.0, 2.0), true),
        (DVec3::new(0.5, 2.0, 1.0), false),
    ] {
        let parent = of(scale);
        for as_matrix in [false, true] {
            let mut json = document.clone();
            let child = json!({ "mesh": 0, "translation": [0.25, 0.0, -1.0] });
            let mut node = json!({ "children": [1] });
            if as_matrix {
                let [a, b, c] = [
                    parent.matrix3.x_axis,
                    parent.matrix3.y_axis,
                    parent.matrix3.z_axis,
                ];
                let t = parent.translation;
                node["matrix"] = json!([
                    a.x, a.y, a.z, 0.0, b.x, b.y, b.z, 0.0, c.x, c.y, c.z, 0.0, t.x, t.y, t.z, 1.0
                ]);
            } else {
                node["scale"] = json!(scale.to_array());
                node["rotation"] = json!(rotation.to_array());
                node["translation"] = json!(parent.translation.to_array());
            }
            json["nodes"] = json!([node, child]);
            let path = folder.path("moved.glb");
            std::fs::write(&path, glb(&json, &binary)).unwrap();
            let after = cloud_of(folder.read("moved.glb"));
            let world = parent * DAffine3::from_translation(DVec3::new(0.25, 0.0, -1.0));
            for i in 0..12 {
                let expected = world.transform_point3(cloud.positions[i]);
                assert!((after.positions[i] - expected).length() < 1e-12);
                let m = world.matrix3;
                let expected = m * variance(&cloud, i) * m.transpose();
                let apart = norm(variance(&after, i) - expected);
                // f32 scales and quaternions.
                assert!(apart < 2e-6 * norm(expected), "{scale}: {apart}");
                if is_similar {
                    for d in [
                        DVec3::X,
                        DVec3::new(0.3, -0.7, 0.2),
                        DVec3::new(-1.0, 1.0, 2.0),
                    ] {
                        let (a, b) = (seen(&cloud, i, d), seen(&after, i, m * d));
                        // Each side rounds sixteen f32 products.
                        assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-5), "{a:?} {b:?}");
                    }
                }
            }
        }
    }
    // The mean colour over all directions stays near the original if a node stretches: harmonics
    // contribute less light than the constant.
    let mut json = document.clone();
    json["nodes"][0]["scale"] = json!([1.0, 1.0, 3.0]);
    std::fs::write(folder.path("long.glb"), glb(&json, &binary)).unwrap();
    let after = cloud_of(folder.read("long.glb"));
    for i in 0..12 {
        let d = DVec3::new(0.4, 0.5, 0.6);
        let (a, b) = (
            seen(&cloud, i, d),
            seen(&after, i, d * DVec3::new(1.0, 1.0, 3.0)),
        );
        assert!((0..3).all(|c| (a[c] - b[c]).abs() < 0.5), "{a:?} {b:?}");
    }
}

/// Reads bytes and shorts, strides and offsets, buffers as text and beside the file.
#[test]
fn gltf_numbers_are_read_in_all_their_places() {
    let folder = Folder::new();
    let name = |n: &str| format!("KHR_gaussian_splatting:{n}");
    // Two splats: interleaved floats, then bytes and shorts.
    let mut binary = vec![9, 9, 9, 9];
    for (p, dc) in [
        ([1.0_f32, 2.0, 3.0], [0.1_f32, 0.2, 0.3]),
        ([4.0, 5.0, 6.0], [0.4, 0.5, 0.6]),
    ] {
        binary.extend(p.iter().chain(&dc).flat_map(|x| x.to_le_bytes()));
    }
    binary.extend([0_i8, 0, 0, 127, 0, -128, 0, 0].map(|b| b as u8));
    binary.extend([2_i8, 4, 8, 0, 1, 1, 1, 0].map(|b| b as u8));
    binary.extend([65_535_u16, 13_107].map(u16::to_le_bytes).concat());
    let accessor = |view: usize, offset: usize, code: u32, kind: &str, normalized: bool| {
        json!({ "bufferView": view, "byteOffset": offset, "componentType": code, "count": 2,
                "type": kind, "normalized": normalized })
    };
    let json = json!({
        "asset": { "version": "2.0" },
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [
            { "attributes": { "POSITION": 0 } },
            { "mode": 0,
              "attributes": { "POSITION": 0, name("SH_DEGREE_0_COEF_0"): 1, name("ROTATION"): 2,
                              name("SCALE"): 3, name("OPACITY"): 4 },
              "extensions": { "KHR_gaussian_splatting": { "kernel": "ellipse" } } },
        ] }],
        "accessors": [
            accessor(0, 0, 5126, "VEC3", false), accessor(0, 12, 5126, "VEC3", false),
            accessor(1, 0, 5120, "VEC4", true), accessor(1, 8, 5120, "VEC3", false),
            accessor(2, 0, 5123, "SCALAR", true),
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 4, "byteLength": 48, "byteStride": 24 },
            { "buffer": 0, "byteOffset": 52, "byteLength": 16, "byteStride": 4 },
            { "buffer": 0, "byteOffset": 68, "byteLength": 4 },
        ],
        "buffers": [{ "byteLength": binary.len() }],
    });
    let check = |file: &str| {
        let data = folder.read(file);
        assert!(data.notes[0].contains("1 primitives"), "{:?}", data.notes);
        let cloud = cloud_of(data);
        let [a, b] = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)];
        assert_eq!(cloud.positions, [a, b]);
        assert_eq!(cloud.harmonics, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!(
            cloud.rotations,
            [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]
        );
        assert_eq!(cloud.scales, [[2.0, 4.0, 8.0], [1.0; 3]]);
        assert_eq!(cloud.opacities, [1.0, 0.2]);
    };
    std::fs::write(folder.path("a.glb"), glb(&json, &binary)).unwrap();
    check("a.glb");
    let with_uri = |uri: &str| {
        let mut json = json.clone();
        json["buffers"][0]["uri"] = json!(uri);
        std::fs::write(folder.path("a.gltf"), json.to_string()).unwrap();
    };
    std::fs::write(folder.path("the data.bin"), &binary).unwrap();
    with_uri("the%20data.bin");
    check("a.gltf");
    let text = STANDARD.encode(&binary);
    with_uri(&format!("data:application/octet-stream;base64,{text}"));
    check("a.gltf");
    // Linear colours stay linear, 1/2 + .28209479 c, and are blended so.
    let mut linear = json.clone();
    linear["meshes"][0]["primitives"][1]["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
        json!("lin_rec709_display");
    std::fs::write(folder.path("a.glb"), glb(&linear, &binary)).unwrap();
    let cloud = cloud_of(folder.read("a.glb"));
    let code = 0.5 + 0.282_094_8 * cloud.harmonics[0];
    assert!((code - (0.5 + 0.282_094_8 * 0.1)).abs() < 1e-6 && cloud.is_linear);

    let refuse = |change: &dyn Fn(&mut Value), words: &str| {
        let mut json = json.clone();
        change(&mut json);
        std::fs::write(folder.path("a.glb"), glb(&json, &binary)).unwrap();
        let error = open(&folder.path("a.glb"), &OpenOptions::default()).unwrap_err();
        assert!(error.to_string().contains(words), "{words}: {error}");
    };
    let primitive = "/meshes/0/primitives/1";
    let set = |json: &mut Value, at: &str, value: Value| *json.pointer_mut(at).unwrap() = value;
    let attributes = format!("{primitive}/attributes");
    refuse(&|j| set(j, "/accessors/0/count", json!(3)), "3 elements");
    refuse(
        &|j| set(j, "/accessors/0/count", json!(u64::MAX)),
        "elements",
    );
    refuse(
        &|j| set(j, "/accessors/2/byteOffset", json!(13)),
        "2 elements",
    );
    refuse(&|j| set(j, "/accessors/4/count", json!(1)), "2 of each");
    refuse(
        &|j| set(j, "/accessors/0/componentType", json!(5125)),
        "bytes, shorts or floats",
    );
    refuse(
        &|j| set(j, "/accessors/2/componentType", json!(5125)),
        "bytes, shorts",
    );
    refuse(&|j| set(j, "/accessors/2/type", json!("VEC3")), "VEC4");
    refuse(
        &|j| set(j, "/accessors/0/bufferView", json!(null)),
        "without a buffer view",
    );
    refuse(
        &|j| j["accessors"][0]["sparse"] = json!({ "count": 1 }),
        "sparse indices",
    );
    refuse(
        &|j| set(j, "/accessors/0/bufferView", json!(7)),
        "buffer view 7",
    );
    refuse(
        &|j| set(j, "/bufferViews/0/byteStride", json!(4)),
        "12 bytes or more",
    );
    refuse(
        &|j| set(j, "/bufferViews/0/byteLength", json!(1_u64 << 40)),
        "a part of buffer 0",
    );
    refuse(&|j| set(j, "/bufferViews/0/buffer", json!(1)), "buffer 1");
    refuse(
        &|j| j["buffers"][0]["uri"] = json!("/etc/hostname"),
        "relative",
    );
    refuse(
        &|j| j["buffers"][0]["uri"] = json!("data:;base64,%%"),
        "base64",
    );
    refuse(&|j| set(j, "/nodes/0/mesh", json!(3)), "one of 1 meshes");
    refuse(
        &|j| j["nodes"] = json!([{ "children": [1] }, { "children": [1], "mesh": 0 }]),
        "no other parent",
    );
    refuse(
        &|j| {
            let scale = [1e308; 3];
            j["nodes"] =
                json!([{ "children": [1], "scale": scale }, { "mesh": 0, "scale": scale }]);
        },
        "finite",
    );
    refuse(&|j| j["nodes"] = json!([]), "none");
    refuse(
        &|j| {
            drop(
                j.pointer_mut(&attributes)
                    .unwrap()
                    .as_object_mut()
                    .unwrap()
                    .remove(&name("SCALE")),
            )
        },
        "none",
    );
    refuse(
        &|j| {
            set(j, &attributes, json!({}));
            let at = format!("{primitive}/extensions/KHR_gaussian_splatting");
            j.pointer_mut(&at).unwrap()["extensions"] = json!({ "KHR_packed": {} });
        },
        "KHR_packed",
    );
    // Many nodes share one mesh: more splats than a file of this size may hold.
    refuse(
        &|j| j["nodes"] = json!(vec![json!({ "mesh": 0 }); 70_000]),
        "repeat meshes",
    );
    let whole = glb(&json, &binary);
    for len in [10, 19, 40, whole.len() - 1] {
        std::fs::write(folder.path("cut.glb"), &whole[..len]).unwrap();
        assert!(
            open(&folder.path("cut.glb"), &OpenOptions::default()).is_err(),
            "{len}"
        );
    }
    // A glTF file without the extension is no splat file.
    let plain = json!({ "asset": { "version": "2.0" }, "meshes": [] });
    std::fs::write(folder.path("plain.gltf"), plain.to_string()).unwrap();
    let data = open(&folder.path("plain.gltf"), &OpenOptions::default());
    assert!(!data.is_ok_and(|d| d.format == "glTF splats"));
}
