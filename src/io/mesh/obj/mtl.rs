//! Reads MTL: the materials of OBJ files.
//!
//! | statement | result |
//! |---|---|
//! | `Kd r g b` | colour, sRGB-encoded: viewers have shown these numbers unconverted for decades. It multiplies `map_Kd`, but black does not: with a texture, `Kd 0 0 0` means "see the texture" |
//! | `Ke r g b` | emitted colour, sRGB-encoded |
//! | `d a` | opacity |
//! | `Tr t` | opacity 1 - t if 0 < t < 1; `Tr 0` and `Tr 1` are opaque, because programs differ in which of them they write for solids. `d` takes precedence |
//! | `map_Kd`, `map_Ke` | textures of both, with the options `-s`, `-o` and `-clamp` |
//! | `map_d` | opacity: the image's alpha channel, or its brightness if that is 1 everywhere |
//!
//! Notes report a `map_Ka` that is another image than that of `map_Kd`, and options of textures that are not
//! used. Everything else (reflections, bumps, `illum`) is left to the library's own lighting.

use std::io::Cursor;

use crate::io::vtk::xml::clip;

/// A material as stated in its file.
#[derive(Debug, Clone, Default)]
pub(super) struct MtlMaterial {
    pub(super) name: String,
    /// sRGB-encoded.
    pub(super) diffuse: Option<[f32; 3]>,
    /// sRGB-encoded.
    pub(super) emissive: [f32; 3],
    pub(super) opacity: f32,
    pub(super) diffuse_map: Option<Map>,
    pub(super) emissive_map: Option<Map>,
    pub(super) opacity_map: Option<Map>,
}

/// A texture statement.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Map {
    /// Path with slashes.
    pub(super) file: String,
    /// `-s u v`: factors of texture coordinates, v upwards.
    pub(super) scale: [f32; 2],
    /// `-o u v`: offsets added after the factors.
    pub(super) offset: [f32; 2],
    /// `-clamp on`.
    pub(super) is_clamped: bool,
}

/// Options of texture statements, without the file name, and the number of words after each.
const OPTIONS: &[(&str, usize)] = &[
    ("-blendu", 1),
    ("-blendv", 1),
    ("-boost", 1),
    ("-bm", 1),
    ("-cc", 1),
    ("-clamp", 1),
    ("-imfchan", 1),
    ("-mm", 2),
    ("-texres", 1),
    ("-type", 1),
];

impl Map {
    /// Parses options, then a file name that may contain spaces.
    fn parse(statement: &str) -> Option<Self> {
        let mut map = Self {
            file: String::new(),
            scale: [1.0; 2],
            offset: [0.0; 2],
            is_clamped: false,
        };
        let mut rest = statement.trim();
        let word = |rest: &mut &str| {
            let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
            let (word, others) = rest.split_at(end);
            *rest = others.trim_start();
            word.to_owned()
        };
        while rest.starts_with('-') {
            let mut after = rest;
            let option = word(&mut after).to_ascii_lowercase();
            if let Some((_, count)) = OPTIONS.iter().find(|(name, _)| *name == option) {
                let values: Vec<String> = (0..*count).map(|_| word(&mut after)).collect();
                if option == "-clamp" {
                    map.is_clamped = values[0].eq_ignore_ascii_case("on");
                }
            } else if matches!(option.as_str(), "-s" | "-o" | "-t") {
                // One to three numbers: missing ones keep their defaults.
                let values = match option.as_str() {
                    "-s" => &mut map.scale,
                    "-o" => &mut map.offset,
                    _ => &mut [0.0; 2],
                };
                for i in 0..3 {
                    let mut next = after;
                    let Ok(number) = word(&mut next).parse::<f32>() else {
                        break;
                    };
                    // A file name may be a number.
                    if next.is_empty() {
                        break;
                    }
                    after = next;
                    if let (Some(value), true) = (values.get_mut(i), number.is_finite()) {
                        *value = number;
                    }
                }
            } else {
                // A file whose name begins with a dash.
                break;
            }
            rest = after;
        }
        let file = rest.trim().trim_matches('"').replace('\\', "/");
        map.file = file;
        (!map.file.is_empty()).then_some(map)
    }
}

/// Options that change the image but are not used, and the values with which they change nothing.
const UNUSED: &[(&str, &[f32])] = &[
    ("-boost", &[]),
    ("-cc", &[]),
    ("-imfchan", &[]),
    ("-mm", &[0.0, 1.0]),
    ("-t", &[0.0, 0.0, 0.0]),
];

/// The options of a texture statement that would change the image and are not used.
fn unused_options(statement: &str) -> Vec<&'static str> {
    let words: Vec<&str> = statement.split_whitespace().collect();
    let is_unused = |(option, neutral): &&(&str, &[f32])| {
        words.iter().enumerate().any(|(i, word)| {
            let values = words[i + 1..].iter().map_while(|w| w.parse::<f32>().ok());
            let values = values.take(neutral.len());
            word.eq_ignore_ascii_case(option)
                && (neutral.is_empty()
                    || values
                        .zip(*neutral)
                        .any(|(value, own)| (value - own).abs() > 0.0))
        })
    };
    UNUSED
        .iter()
        .filter(is_unused)
        .map(|(name, _)| *name)
        .collect()
}

/// Notes statements about a material's textures that are not used.
fn note_unused(material: &str, statements: &[(String, String)], notes: &mut Vec<String>) {
    let file_of = |name: &str| {
        let statement = statements.iter().find(|(own, _)| own == name);
        statement
            .and_then(|(_, rest)| Map::parse(rest))
            .map(|map| map.file)
    };
    if let Some(ambient) = file_of("map_ka")
        && file_of("map_kd").is_none_or(|diffuse| diffuse != ambient)
    {
        notes.push(format!(
            "material `{}`: `map_Ka` (`{}`) is not used, there is no ambient light: `map_Kd` has the colour",
            clip(material),
            clip(&ambient)
        ));
    }
    for (name, rest) in statements.iter().filter(|(name, _)| name != "map_ka") {
        let unused = unused_options(rest);
        if !unused.is_empty() {
            notes.push(format!(
                "material `{}`: options of `{name}` are not used: {}",
                clip(material),
                unused.join(", ")
            ));
        }
    }
}

/// Reads the materials of a library.
pub(super) fn read(bytes: &[u8], notes: &mut Vec<String>) -> Vec<MtlMaterial> {
    let text = String::from_utf8_lossy(bytes);
    let plain = plain(text.trim_start_matches('\u{feff}'), notes);
    let materials = match tobj::load_mtl_buf(&mut Cursor::new(plain)) {
        Ok((materials, _)) => materials,
        Err(e) => {
            notes.push(format!("materials cannot be read ({e})"));
            Vec::new()
        }
    };
    #[expect(
        clippy::cast_possible_truncation,
        reason = "colours need no more than f32"
    )]
    let narrow = |colour: [f64; 3]| colour.map(|c| c as f32);
    materials
        .into_iter()
        .map(|m| {
            let map = |text: Option<&String>| text.and_then(|t| Map::parse(t));
            let number = |text: Option<&String>| text.and_then(|t| t.parse::<f64>().ok());
            let transparency = number(m.unknown_param.get("Tr"));
            let opacity = match (m.dissolve, transparency) {
                (Some(d), _) => d.clamp(0.0, 1.0),
                (None, Some(t)) if t > 0.0 && t < 1.0 => 1.0 - t,
                _ => 1.0,
            };
            MtlMaterial {
                diffuse: m.diffuse.map(narrow),
                emissive: narrow(m.emissive.unwrap_or_default()),
                #[expect(clippy::cast_possible_truncation, reason = "an opacity")]
                opacity: opacity as f32,
                diffuse_map: map(m.diffuse_texture.as_ref()),
                emissive_map: map(m.unknown_param.get("map_Ke")),
                opacity_map: map(m.dissolve_texture.as_ref()),
                name: m.name,
            }
        })
        .collect()
}

/// The used statements, in the spelling and with the words that tobj accepts: it panics on colours of fewer
/// than three numbers, and rejects a file for one bad line.
fn plain(text: &str, notes: &mut Vec<String>) -> String {
    let mut plain = String::new();
    // The current material: its name, and its texture statements.
    let mut current = (String::new(), Vec::new());
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let mut joined = line.to_owned();
        while let Some(start) = joined.strip_suffix('\\') {
            // A file name may end in a backslash; a continued statement has a space before it.
            if !start.ends_with(char::is_whitespace) {
                break;
            }
            joined = format!("{start}{}", lines.next().unwrap_or(""));
        }
        let line = joined.trim();
        let keyword = line.split_whitespace().next().unwrap_or("");
        let rest = line[keyword.len()..].trim();
        let mut words = rest.split_whitespace();
        let finite = |word: &str| word.parse::<f64>().ok().filter(|x| x.is_finite());
        let statement = match keyword.to_ascii_lowercase().as_str() {
            "newmtl" => {
                let name = if rest.is_empty() { "(unnamed)" } else { rest };
                note_unused(&current.0, &current.1, notes);
                current = (name.to_owned(), Vec::new());
                Some(format!("newmtl {name}"))
            }
            colour @ ("kd" | "ke") => {
                let name = if colour == "kd" { "Kd" } else { "Ke" };
                let numbers: Option<Vec<f64>> = words.clone().take(3).map(finite).collect();
                match numbers.as_deref() {
                    // One number is all three.
                    Some([grey]) => Some(format!("{name} {grey} {grey} {grey}")),
                    Some([r, g, b]) => Some(format!("{name} {r} {g} {b}")),
                    _ => {
                        notes.push(format!("`{}` is not used: no RGB colour", clip(line)));
                        None
                    }
                }
            }
            "d" => words.find_map(finite).map(|d| format!("d {d}")),
            "tr" => words.find_map(finite).map(|t| format!("Tr {t}")),
            "map_ka" => {
                current.1.push(("map_ka".to_owned(), rest.to_owned()));
                None
            }
            map @ ("map_kd" | "map_ke" | "map_d") if !rest.is_empty() => {
                current.1.push((map.to_owned(), rest.to_owned()));
                let name = match map {
                    "map_kd" => "map_Kd",
                    "map_ke" => "map_Ke",
                    _ => "map_d",
                };
                Some(format!("{name} {rest}"))
            }
            _ => None,
        };
        if let Some(statement) = statement {
            plain.push_str(&statement);
            plain.push('\n');
        }
    }
    note_unused(&current.0, &current.1, notes);
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_come_before_names_with_spaces() {
        let map = Map::parse(
            "-blendu off -s 2 3 -o 0.25 -clamp on -bm 1.5 -mm 0 1 \\maps\\old fuze uv.jpg  ",
        )
        .unwrap();
        let expected = Map {
            file: "/maps/old fuze uv.jpg".into(),
            scale: [2.0, 3.0],
            offset: [0.25, 0.0],
            is_clamped: true,
        };
        assert_eq!(map, expected);
        for (text, file, scale) in [
            ("-s 1 2 3 4.png", "4.png", [1.0, 2.0]),
            ("-s 1 2 3", "3", [1.0, 2.0]),
            ("-dash.png", "-dash.png", [1.0, 1.0]),
            ("\"a b.png\"", "a b.png", [1.0, 1.0]),
        ] {
            let map = Map::parse(text).unwrap();
            assert_eq!((map.file.as_str(), map.scale), (file, scale), "{text}");
        }
        assert_eq!(Map::parse("-clamp on"), None);
        assert_eq!(Map::parse("  "), None);
    }

    #[test]
    fn opacities_follow_the_rule() {
        for (text, opacity) in [
            ("", 1.0),
            ("d 0.25", 0.25),
            ("d -halo 0.5", 0.5),
            ("d 7", 1.0),
            ("Tr 1.000000", 1.0),
            ("Tr 0", 1.0),
            ("Tr 0.25", 0.75),
            ("tr 0.25\nd 0.5", 0.5),
            ("d 0.5\nTr 1", 0.5),
            ("d nan", 1.0),
        ] {
            let file = format!("newmtl a\t \n{text}\n");
            let materials = read(file.as_bytes(), &mut Vec::new());
            assert_eq!(materials[0].name, "a");
            assert_eq!(
                materials[0].opacity.to_bits(),
                f32::to_bits(opacity),
                "{text}"
            );
        }
    }

    #[test]
    fn statements_that_mean_nothing_are_passed_over() {
        let text = "Kd 1 1 1\nnewmtl\nKd 0.5\nKe 1 2\nNs\nillum x\nmap_Kd\nd\nmap_bump\n\
                    newmtl b\nKd spectral a.rfl 1\nKd\nKd 1 nan 1\nKD .1 .2 .3 # c\nKe 2 0 0\n";
        let mut notes = Vec::new();
        let materials = read(text.as_bytes(), &mut notes);
        let names: Vec<&str> = materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["(unnamed)", "b"]);
        assert_eq!(materials[0].diffuse, Some([0.5; 3]));
        assert_eq!(materials[1].diffuse, Some([0.1, 0.2, 0.3]));
        assert_eq!(materials[1].emissive, [2.0, 0.0, 0.0]);
        assert_eq!(notes.len(), 4, "{notes:?}");
    }
}
