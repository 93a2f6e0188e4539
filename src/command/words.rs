//! Formats the library's errors and notes for the command line, with its option names.

use std::path::Path;

use serde_json::{Value, json};

use crate::Error;
use crate::error::{Advice, Hint, Parameter, Place};
use crate::load::Note;

/// Parts of an error.
struct Parts {
    kind: &'static str,
    /// File, device or kind of value.
    subject: String,
    is_file: bool,
    place: String,
    /// `None` for errors of the operating system.
    expected: Option<String>,
    found: String,
    advice: String,
}

/// Divides an error into its parts; `None` if it has none.
fn parts(error: &Error) -> Option<Parts> {
    let of_file = |path: &Path, place, expected, found, advice| Parts {
        kind: "format",
        subject: path.display().to_string(),
        is_file: true,
        place,
        expected: Some(expected),
        found,
        advice,
    };
    let of_device = |kind, place: &str, expected, found: &str, advice| Parts {
        kind,
        subject: "GPU".into(),
        is_file: false,
        place: place.into(),
        expected: Some(expected),
        found: found.into(),
        advice,
    };
    Some(match error {
        Error::Io {
            path,
            place,
            source,
            advice,
            ..
        } => Parts {
            kind: "io",
            expected: None,
            ..of_file(
                path,
                named(place),
                String::new(),
                source.to_string(),
                advised(advice),
            )
        },
        Error::Format {
            path,
            place,
            expected,
            found,
            advice,
            ..
        } => of_file(
            path,
            named(place),
            expected.clone(),
            found.clone(),
            advised(advice),
        ),
        Error::NoLayout {
            path, suggested, ..
        } => {
            let advice = suggested.map_or_else(
                || hint(Hint::GiveLayout),
                |layout| {
                    let [x, y, z] = layout.dims;
                    format!(
                        "its name suggests --dims {x},{y},{z} --type {}: add these options if they \
                         are right",
                        layout.scalar
                    )
                },
            );
            let expected = "its dimensions and type from the command line".into();
            of_file(
                path,
                "raw volume".into(),
                expected,
                "no --dims".into(),
                advice,
            )
        }
        Error::Invalid {
            what,
            place,
            expected,
            found,
            advice,
            ..
        } => Parts {
            kind: "invalid",
            subject: named(what),
            is_file: false,
            place: named(place),
            expected: Some(expected.clone()),
            found: found.clone(),
            advice: advised(advice),
        },
        Error::NoAdapter {
            place,
            expected,
            found,
            advice,
            ..
        } => of_device(
            "no-adapter",
            place,
            expected.clone(),
            found,
            advised(advice),
        ),
        Error::Unsupported {
            place,
            expected,
            found,
            advice,
            ..
        } => of_device(
            "unsupported",
            place,
            expected.clone(),
            found,
            advised(advice),
        ),
        Error::OutOfMemory {
            adapter,
            what,
            needed,
            found,
            ..
        } => {
            let expected = format!("{needed} bytes for the {what}");
            let advice = hint(Hint::SmallerSceneOrCpu);
            of_device("memory", adapter, expected, found, advice)
        }
        Error::DeviceLost { adapter, found, .. } => {
            let expected = "a device that answers".into();
            let advice = hint(Hint::StartAgainOrCpu);
            of_device("device-lost", adapter, expected, found, advice)
        }
        Error::OfRank { .. } | Error::Cancelled => return None,
    })
}

/// Formats an error in one line: `FILE: place: expected A, found B; do C`. It removes line breaks
/// from the messages of other libraries.
pub(crate) fn line(error: &Error) -> String {
    let Some(Parts {
        subject,
        place,
        expected,
        found,
        advice,
        ..
    }) = parts(error)
    else {
        return error.to_string().replace('\n', " ");
    };
    let text = match expected {
        Some(expected) => {
            format!("{subject}: {place}: expected {expected}, found {found}; {advice}")
        }
        None => format!("{subject}: {place}: {found}; {advice}"),
    };
    text.replace('\n', " ")
}

/// Returns an error as an object for programs. What does not apply is null.
pub(super) fn object(error: &Error) -> Value {
    let text = line(error);
    let Some(parts) = parts(error) else {
        let kind = match error {
            Error::Cancelled => "cancelled",
            _ => "rank",
        };
        return json!({ "kind": kind, "file": null, "what": null, "place": null, "expected": null, "found": null, "do": null, "text": text });
    };
    let (file, what) = match parts.is_file {
        true => (Some(parts.subject), None),
        false => (None, Some(parts.subject)),
    };
    json!({
        "kind": parts.kind,
        "file": file,
        "what": what,
        "place": parts.place,
        "expected": parts.expected,
        "found": parts.found,
        "do": parts.advice,
        "text": text,
    })
}

/// Formats the problem with a file for a reader who has its name and description. It omits the name
/// and the advice to look at the file.
pub(crate) fn problem(error: &Error) -> String {
    let text = line(error);
    let (Error::Format { path, .. } | Error::Io { path, .. } | Error::NoLayout { path, .. }) =
        error
    else {
        return text;
    };
    if let Error::Format {
        place,
        expected,
        found,
        advice: Advice::Hint(Hint::LookAtFile),
        ..
    } = error
    {
        let text = format!("{}: expected {expected}, found {found}", named(place));
        return text.replace('\n', " ");
    }
    let name = format!("{}: ", path.display());
    text.strip_prefix(&name).unwrap_or(&text).to_owned()
}

fn named(place: &Place) -> String {
    match place {
        Place::Parameter(parameter) => option(*parameter),
        other => other.to_string(),
    }
}

fn advised(advice: &Advice) -> String {
    match advice {
        Advice::Hint(step) => hint(*step),
        other => other.to_string(),
    }
}

/// Returns the option that sets a parameter.
fn option(parameter: Parameter) -> String {
    match parameter {
        Parameter::KernelWidth => "--kernel-width",
        Parameter::TransferFunction => "--transfer-function",
        Parameter::Flatten => "--isosurface",
        Parameter::Surface => "--surface",
        Parameter::SurfaceOpacity => "--surface-opacity",
        Parameter::SurfelDensity => "--density",
        Parameter::SurfelSpacing => "--spacing",
        Parameter::ReadAs => "--as",
        Parameter::ParticleType => "--type",
        Parameter::Scales => "--scales",
        Parameter::Step => "--step",
        Parameter::Time => "--time",
        Parameter::Exaggeration => "--exaggerate",
        Parameter::RawDims => "--dims",
        Parameter::RawGeometry => "--spacing and --origin",
    }
    .to_owned()
}

/// Formats advice for the command line.
fn hint(hint: Hint) -> String {
    match hint {
        Hint::NameField => "name one of these with --field",
        Hint::NameSolution => "for a PLOT3D grid name its solution with --solution",
        Hint::NameOwnSolution => {
            "name the grid's own solution with --solution, or move this file elsewhere"
        }
        Hint::GiveGridOfSolution => "give the grid as input and this file with --solution",
        Hint::NameOtherTexture => "name another image with --texture",
        Hint::GiveLayout => "add --dims X,Y,Z --type u8|i16|u16|f32",
        Hint::GiveRawData => "use its raw data with --dims and --type",
        Hint::ConvertOrGiveLayout => {
            "convert it to one of them; if it is a raw volume, add --dims and --type"
        }
        Hint::UnpackOrGiveLayout => {
            "unpack it with gunzip (raw volumes may stay compressed: add --dims and --type)"
        }
        Hint::CorrectDims => "correct --dims",
        Hint::CorrectDimsOrType => "correct --dims or --type",
        Hint::GiveMeaningOrRadius => "say what the lengths are with --length, or give --radius",
        Hint::AddSigmaOrGiveRadius => "add a column `sigma`, or give --radius",
        Hint::ResizeAlongAxes => "use --resize x,y,z",
        Hint::LeaveOut(parameter) => return format!("leave {} out", option(parameter)),
        Hint::LookAtFile => "look at the file with `ewa-splat info`",
        Hint::LookAtDataOrRaiseOpacity => {
            "look at the data with `ewa-splat info`, or raise the opacity"
        }
        Hint::DrawPicture => "render them without --column-density",
        Hint::UseCpu => "use --backend cpu",
        Hint::NarrowerImageOrCpu => "render a narrower image, or use --backend cpu",
        Hint::SmallerSceneOrCpu => {
            "render fewer particles or a smaller image, or use --backend cpu"
        }
        Hint::StartAgainOrCpu => "start again, with --backend cpu if it keeps failing",
        Hint::OtherAdapterOrCpu => "choose another with EWA_ADAPTER, or use --backend cpu",
        Hint::ListedAdapterOrCpu => {
            "choose one of these with EWA_ADAPTER or leave it unset, or use --backend cpu"
        }
        Hint::InstallDriverOrCpu => {
            "install the graphics driver (a software one: Mesa's lavapipe), or use --backend cpu"
        }
    }
    .to_owned()
}

/// Formats a note on inputs with the options that change what it reports.
pub(super) fn note(note: &Note) -> String {
    let options = match note {
        Note::FirstStep { .. } => {
            "; --step N, --step last and --time T choose another, --series draws all"
        }
        Note::OtherAxes {
            is_turned: true, ..
        } => "; --keep-axes leaves it",
        Note::OtherAxes {
            is_turned: false, ..
        } => "; --rotate turns it",
        Note::Uniform {
            is_of_step: true, ..
        } => " (--step, --time)",
        _ => "",
    };
    format!("{note}{options}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_library_names_is_said_with_options() {
        let error = |place: Place, advice: Hint| {
            Error::invalid(Parameter::KernelWidth, place, "this", "that", advice)
        };
        for (place, advice, expected) in [
            (
                Parameter::RawDims.into(),
                Hint::LeaveOut(Parameter::Flatten),
                "--kernel-width: --dims: expected this, found that; leave --isosurface out",
            ),
            (
                "two\nlines".into(),
                Hint::CorrectDimsOrType,
                "--kernel-width: two lines: expected this, found that; correct --dims or --type",
            ),
        ] {
            assert_eq!(line(&error(place, advice)), expected);
        }
        let io = std::io::Error::other("a fault");
        let io = Error::io("a.raw", "reading", io, Hint::UseCpu);
        assert_eq!(line(&io), "a.raw: reading: a fault; use --backend cpu");
        let format = Error::format("a.vti", "arrays", "one", "none", Hint::NameField);
        assert_eq!(
            line(&format),
            "a.vti: arrays: expected one, found none; name one of these with --field"
        );
    }

    #[test]
    fn objects_have_the_parts_of_lines() {
        let io = std::io::Error::other("a fault");
        let io = object(&Error::io("a.raw", "reading", io, Hint::UseCpu));
        let expected = json!({ "kind": "io", "file": "a.raw", "what": null, "place": "reading", "expected": null,
            "found": "a fault", "do": "use --backend cpu", "text": "a.raw: reading: a fault; use --backend cpu" });
        assert_eq!(io, expected);
        let invalid = Error::invalid(Parameter::RawDims, "x", "1", "2", Hint::CorrectDims);
        let invalid = object(&invalid);
        assert_eq!(
            [&invalid["what"], &invalid["do"]],
            ["--dims", "correct --dims"]
        );
        assert_eq!(object(&Error::Cancelled)["kind"], "cancelled");
    }

    /// The hints name options, which scripts and people rely on. Every hint has its own words for
    /// the command line.
    #[test]
    fn hints_name_their_options() {
        let leave_out = Hint::LeaveOut(Parameter::Flatten);
        for (step, named) in [
            (Hint::NameField, &["--field"][..]),
            (Hint::NameSolution, &["--solution"]),
            (Hint::NameOwnSolution, &["--solution"]),
            (Hint::GiveGridOfSolution, &["--solution"]),
            (Hint::NameOtherTexture, &["--texture"]),
            (Hint::GiveLayout, &["--dims", "--type"]),
            (Hint::GiveRawData, &["--dims", "--type"]),
            (Hint::ConvertOrGiveLayout, &["--dims", "--type"]),
            (Hint::UnpackOrGiveLayout, &["gunzip", "--dims", "--type"]),
            (Hint::CorrectDims, &["--dims"]),
            (Hint::CorrectDimsOrType, &["--dims", "--type"]),
            (Hint::GiveMeaningOrRadius, &["--length", "--radius"]),
            (Hint::AddSigmaOrGiveRadius, &["`sigma`", "--radius"]),
            (Hint::ResizeAlongAxes, &["--resize"]),
            (leave_out, &["--isosurface"]),
            (Hint::LookAtFile, &["`ewa-splat info`"]),
            (Hint::LookAtDataOrRaiseOpacity, &["`ewa-splat info`"]),
            (Hint::DrawPicture, &["--column-density"]),
            (Hint::UseCpu, &["--backend cpu"]),
            (Hint::NarrowerImageOrCpu, &["--backend cpu"]),
            (Hint::SmallerSceneOrCpu, &["--backend cpu"]),
            (Hint::StartAgainOrCpu, &["--backend cpu"]),
            (Hint::OtherAdapterOrCpu, &["EWA_ADAPTER", "--backend cpu"]),
            (Hint::ListedAdapterOrCpu, &["EWA_ADAPTER", "--backend cpu"]),
            (Hint::InstallDriverOrCpu, &["lavapipe", "--backend cpu"]),
        ] {
            let words = hint(step);
            assert!(named.iter().all(|n| words.contains(n)), "{step:?}: {words}");
            // The library's own text names no option.
            let neutral = step.to_string();
            assert!(
                !neutral.contains("--") && !neutral.contains("ewa-splat"),
                "{neutral}"
            );
        }
    }
}
