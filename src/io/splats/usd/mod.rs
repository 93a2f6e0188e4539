//! Reads and writes splats of OpenUSD: `ParticleField3DGaussianSplat` and fields of particles with other kernels, as
//! text (`.usda`), in binary form (`.usdc`), and either in an archive (`.usdz`).
//!
//! | attribute of a prim | type | contents |
//! |---|---|---|
//! | `positions` | `point3f[]` | centres |
//! | `scales` | `float3[]` | standard deviations; 1 if absent |
//! | `orientations` | `quatf[]` | quaternions: w, x, y, z in text; no rotation if absent |
//! | `opacities` | `float[]` | peak opacities, 0 to 1; 1 if absent |
//! | `radiance:sphericalHarmonicsDegree` | `int` | degree l of the harmonics; 3 if absent |
//! | `radiance:sphericalHarmonicsCoefficients` | `float3[]` | (l + 1)² sets of R, G, B for each splat, by degree and order as in PLY files; grey if absent |
//! | `sortingModeHint` | `token` | `zDepth`, the default, or `cameraDistance` |
//! | `colorSpace:name`, also of ancestors | `token` | space of the colours; sRGB codes if absent |
//!
//! Arrays in half floats have an `h` behind their name; those in single precision take precedence. The kernel is an
//! ellipsoid, or in a prim `ParticleField` what an applied schema names: surflets lie in their planes of x and y.
//!
//! Prims are drawn with the transforms of their ancestors. Other layers, variants and instances are not composed; of
//! samples in time the first is read. A layer has y up unless it states z.
//!
//! An archive is a ZIP archive of stored members, each at a multiple of 64 bytes. Its first member is the layer.
//!
//! Source: the schemas of OpenUSD 26.11 (`usdVol`), its specification of USDZ, and files of `usd-core` 26.11.

mod binary;
mod binary_write;
mod field;
mod layer;
mod stage;
mod text;
mod write;
mod xform;

use std::borrow::Cow;
use std::path::Path;

use glam::DVec3;

use self::stage::Stage;
pub(in crate::io) use self::write::{Container, encode};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::{Input, extension};
use crate::io::bytes::zip;
use crate::io::volume::raw::DEFLATE_RATIO;
use crate::io::vtk::xml::clip;

/// Name of the format.
pub(in crate::io) const FORMAT: &str = "USD splats";

/// Extensions of layers.
const LAYERS: [&str; 3] = ["usd", "usda", "usdc"];

/// Whether a file's first bytes are those of a layer.
pub(in crate::io) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(text::MAGIC) || head.starts_with(binary::MAGIC)
}

/// Whether an archive's first member is a layer.
pub(in crate::io) fn is_archive(entries: &[zip::Entry<'_>]) -> bool {
    let first = entries.first();
    first.is_some_and(|entry| LAYERS.contains(&extension(Path::new(&entry.name)).as_str()))
}

/// Reads the splats of a layer.
///
/// # Errors
/// Bytes that break the format's rules; no splats; arrays of other lengths than the positions'.
pub(in crate::io) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let stage = {
        let bytes = input.read_all()?;
        let bytes = match bytes.starts_with(zip::MAGIC) {
            true => unpacked(path, &bytes)?,
            false => bytes,
        };
        parse(path, &bytes)?
    };
    let up = match stage.up_axis.as_deref() {
        Some("Z") => (DVec3::Z, "the USD file has z up"),
        _ => (DVec3::Y, "the USD file has y up"),
    };
    let (cloud, notes) = field::splats(path, stage)?;
    let mut data = cloud.dataset(path, FORMAT, Vec::new())?;
    data.format_up = Some(up);
    data.notes = notes;
    Ok(data)
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Stage> {
    if bytes.starts_with(binary::MAGIC) {
        binary::parse(path, bytes)
    } else if bytes.starts_with(text::MAGIC) {
        text::parse(path, bytes)
    } else {
        Err(Error::format(
            path,
            "header",
            "`#usda` or `PXR-USDC`",
            "other bytes",
            "give a USD file",
        ))
    }
}

/// The first layer of an archive.
fn unpacked<'a>(path: &Path, bytes: &'a [u8]) -> Result<Cow<'a, [u8]>> {
    let broken = |found: String| {
        let expected = "a sound archive that begins with a layer";
        let advice = "the file is cut off or damaged: get it again";
        Error::format(path, "USDZ archive", expected, found, advice)
    };
    let entries = zip::entries(bytes).map_err(broken)?;
    let first = entries.first().ok_or_else(|| broken("no members".into()))?;
    if !is_archive(&entries) {
        return Err(broken(format!("`{}`", clip(&first.name))));
    }
    let packed = first.packed.len() as u64;
    if first.size > packed.saturating_mul(DEFLATE_RATIO) {
        return Err(broken(format!("{} bytes packed into {packed}", first.size)));
    }
    let name = clip(&first.name);
    first
        .contents()
        .map_err(|found| broken(format!("`{name}`: {found}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::dataset::Geometry;
    use crate::data::splats::SplatCloud;
    use crate::error::Result;
    use crate::io::{OpenOptions, read};

    fn opened(name: &str, text: &str) -> Result<(SplatCloud, Dataset)> {
        let data = read(name, text.as_bytes(), &OpenOptions::default())?;
        match data.geometry {
            Geometry::Splats(ref cloud) => Ok((cloud.clone(), data)),
            ref other => panic!("{other:?}"),
        }
    }

    fn refused(text: &str) -> String {
        opened("a.usda", text).unwrap_err().to_string()
    }

    /// A layer with one prim of splats.
    fn layer(metadata: &str, body: &str) -> String {
        format!(
            "#usda 1.0\n({metadata})\ndef Xform \"w\" {{\n def {SPLATS} \"s\" {{ {body} }}\n}}\n"
        )
    }

    use super::field::SPLATS;

    #[test]
    fn text_of_any_style_is_read() {
        let text = "#usda 1.0\n( \"a ) description\"\n upAxis = \"Z\"; defaultPrim = 'w'\n\
            customLayerData = { dictionary a = { string b = \"}\" } }\n\
            subLayers = [ ] # none )\n)\n\
            over \"unused\" { point3f[] positions = [(9, 9, 9)] }\n\
            def Xform \"w\" ( kind = \"}\"; prepend references = @@@x)@y@@@</a> (offset = 1) doc = \"\"\"a \"b\" )\n\"\"\" )\n\
            {\n  reorder nameChildren = [\"s\", \"t\"]\n\
              double3 xformOp:translate.timeSamples = { -1.5: (1, 0, 0), 2: (5, 5, 5), }\n\
              /* } */ uniform token[] xformOpOrder = [\"xformOp:translate\"] // }\n\
              rel material:binding = </m/a> (\n bindMaterialAs = \"x\" )\n\
              variantSet \"v\" = { \"one\" { def Mesh \"no\" { } } }\n\
              def ParticleField3DGaussianSplat \"s\"\n  (active = true)\n  {\n\
                custom string note = 'it\\'s'\n    float[] opacities\n\
                point3f[] positions = [(1, 2, 3),\n (4.5, -5e-1, +.25)] ( doc = \"]\" )\n\
                float[] opacities = [ 0.5, 1.0 ]\n    token visibility.connect = </a.b>\n\
                quath[] orientationsh = None\n    half3[] scalesh = [(1,1,2), (3,3,3)]\n\
                uniform token sortingModeHint = \"rayHitDistance\"\n  }\n\
              def Mesh \"m\" { point3f[] points = [(0,0,0)] }\n}\n";
        let (cloud, data) = opened("a.usda", text).unwrap();
        let positions = [DVec3::new(2.0, 2.0, 3.0), DVec3::new(5.5, -0.5, 0.25)];
        assert_eq!(cloud.positions, positions);
        assert_eq!(cloud.opacities, [0.5, 1.0]);
        assert_eq!(cloud.scales, [[1.0, 1.0, 2.0], [3.0; 3]]);
        assert_eq!(cloud.rotations, [[1.0, 0.0, 0.0, 0.0]; 2]);
        assert_eq!(
            (cloud.harmonics_degree, &cloud.harmonics),
            (0, &vec![0.0; 6])
        );
        assert!(cloud.by_distance && !cloud.is_linear);
        assert_eq!(data.up().direction, DVec3::Z);
        let notes = data.notes.join("\n");
        for words in ["first sample", "references", "1 Mesh", "rayHitDistance"] {
            assert!(notes.contains(words), "{words}: {notes}");
        }
    }

    #[test]
    fn what_is_not_shown_is_left_out() {
        const ONE: &str = "point3f[] positions = [(1, 2, 3)]";
        for (metadata, body) in [
            ("", "token visibility = \"invisible\""),
            ("", "uniform token purpose = \"guide\""),
            ("", "uniform token purpose = \"proxy\""),
        ] {
            let text = layer(metadata, &format!("{ONE}\n{body}"));
            assert!(refused(&text).contains("inactive, invisible"), "{body}");
        }
        let sound = layer("", ONE);
        for (from, to) in [
            ("def Xform", "class Xform"),
            ("def Xform", "over"),
            ("def Xform", "def PointInstancer"),
            ("\"w\"", "\"w\" (active = false)"),
        ] {
            let text = sound.replace(from, to);
            assert!(refused(&text).contains("inactive, invisible"), "{to}");
        }
        assert_eq!(opened("a.usd", &sound).unwrap().0.positions.len(), 1);
    }

    #[test]
    fn kernels_and_colour_spaces_are_those_of_schemas() {
        const ONE: &str = "point3f[] positions = [(1, 2, 3)]\nfloat3[] scales = [(2, 4, 6)]";
        let text = layer("", ONE);
        let of = |schema: &str| {
            let to = format!(
                "def ParticleField \"s\" (prepend apiSchemas = [\"{schema}\", \"ColorSpaceAPI\"])"
            );
            let text = text.replace(&format!("def {SPLATS} \"s\""), &to);
            opened("a.usda", &text).map(|(cloud, _)| cloud.scales[0])
        };
        let kernel = |name: &str| of(&format!("ParticleFieldKernel{name}API")).unwrap();
        assert_eq!(kernel("GaussianEllipsoid"), [2.0, 4.0, 6.0]);
        assert_eq!(kernel("GaussianSurflet"), [2.0, 4.0, 0.0]);
        assert_eq!(kernel("ConstantSurflet"), [1.0, 2.0, 0.0]);
        assert!(of("ParticleFieldPositionAttributeAPI").is_err());
        for (name, is_linear, is_noted) in [
            ("lin_rec709_scene", true, false),
            ("srgb_rec709_scene", false, false),
            ("lin_ap1_scene", true, true),
            ("raw", false, true),
        ] {
            let space = format!("uniform token colorSpace:name = \"{name}\"");
            let own = format!(
                "float3[] radiance:sphericalHarmonicsCoefficients = [(1, 1, 1)] (colorSpace = \"{name}\")\n uniform int radiance:sphericalHarmonicsDegree = 0"
            );
            for body in [space, own] {
                let (cloud, data) =
                    opened("a.usda", &layer("", &format!("{ONE}\n{body}"))).unwrap();
                assert_eq!(cloud.is_linear, is_linear, "{body}");
                assert_eq!(!data.notes.is_empty(), is_noted, "{body}");
            }
        }
    }

    #[test]
    fn lengths_and_degrees_are_checked() {
        let with = |body: &str| {
            let text = format!("point3f[] positions = [(1, 2, 3), (4, 5, 6)]\n{body}");
            opened("a.usda", &layer("", &text)).map_err(|e| e.to_string())
        };
        for (body, words) in [
            (
                "float[] opacities = [1]",
                "attribute `opacities`: expected 2",
            ),
            (
                "float3[] scales = [(1, 1, 1)]",
                "`/w/s`, attribute `scales`: expected 6",
            ),
            ("quatf[] orientations = [(1, 0, 0, 0)]", "expected 8"),
            // Degree 3 where none is stated.
            (
                "float3[] radiance:sphericalHarmonicsCoefficients = [(1, 1, 1)]",
                "expected 96",
            ),
            (
                "half3[] radiance:sphericalHarmonicsCoefficientsh = []\n uniform int radiance:sphericalHarmonicsDegree = 11",
                "degree from 0 to 10",
            ),
            (
                "float[] opacities = [1, x]",
                "line 5: expected numbers, found `x] }`",
            ),
            ("float[] opacities = [[[1, 1", "closing bracket"),
            (
                "double3 xformOp:scale = (0, 0, 0)\n uniform token[] xformOpOrder = [\"!invert!xformOp:scale\"]",
                "`!invert!xformOp:scale`",
            ),
        ] {
            let error = with(body).unwrap_err();
            assert!(error.contains(words), "{words}: {error}");
        }
        let (cloud, data) = with("float[] opacities = [.5, .25, 1]").unwrap();
        assert_eq!(cloud.opacities, [0.5, 0.25]);
        assert!(data.notes[0].contains("beyond those of the positions"));
        for (text, words) in [
            (
                "#usda 1.0\ndef Mesh \"m\" {}",
                "1 Mesh; give a file with splats; save meshes",
            ),
            ("#usda 1.0\ndef \"m\" (payload = @a.usd@) {}", "--flatten"),
            ("#usda 1.0\n(subLayers = [@a.usd@])", "--flatten"),
            ("#usda 1.0\n", "found none"),
            ("#usda 1.0\ndef Mesh \"m\" {", "end of the file"),
            ("#usda 1.0\n}", "expected a word"),
            (
                &format!("#usda 1.0\n{}", "def \"a\" {".repeat(300)),
                "too many of them",
            ),
        ] {
            let error = refused(text);
            assert!(error.contains(words), "{text}: {error}");
        }
        let error = opened("a.usd", "nothing").unwrap_err().to_string();
        assert!(error.contains("PXR-USDC"), "{error}");
    }
}
