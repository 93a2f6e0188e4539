//! Puts the page, its program and the data into one file.

use std::env;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};

use super::files::Embedded;
use crate::io::write_atomically;
use crate::{Error, Result};

/// Environment variable that names the folder of the page.
const VARIABLE: &str = "EWA_SPLAT_PAGE";
/// Greatest number of characters of what is embedded: browsers read them as one text, which may have 2^29.
const MOST_CHARACTERS: u64 = 500_000_000;
/// Characters for the name and the view of splats.
const ROOM_FOR_VIEW: u64 = 2_000;
/// Scripts that the page imports.
const IMPORTED: [&str; 3] = ["command.js", "function.js", "view.js"];
const STYLE: &str = r#"<link rel="stylesheet" href="style.css">"#;
const SCRIPT: &str = r#"<script type="module" src="page.js"></script>"#;

/// The page without data.
pub(super) struct Page {
    /// Text up to the files.
    before: String,
    /// Text behind the view.
    after: String,
}

/// A part of a page.
enum Part<'a> {
    Text(String),
    File(&'a Embedded),
}

impl Page {
    /// Reads the built page.
    ///
    /// - `given`: folder that an option names.
    ///
    /// # Errors
    /// No page; one that is not complete.
    pub(super) fn open(given: Option<&Path>) -> Result<Self> {
        let folder = folder(given)?;
        let read = |name: &str| {
            let path = folder.join(name);
            std::fs::read(&path)
                .map_err(|e| Error::io(&path, "reading the page", e, "build it again: web/build"))
        };
        let text = |name: &str| {
            let path = folder.join(name);
            String::from_utf8(read(name)?)
                .map_err(|_| wrong(&path, "a text in UTF-8", "other bytes"))
        };
        let packed = |name: &str| -> Result<String> {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            let bytes = encoder
                .write_all(&read(name)?)
                .and_then(|()| encoder.finish());
            let bytes = bytes
                .map_err(|e| Error::io(folder.join(name), "packing", e, "close other programs"))?;
            Ok(STANDARD.encode(bytes))
        };
        let index = text("index.html")?;
        let style = format!("<style>\n{}</style>", text("style.css")?);
        let mut addresses = serde_json::Map::new();
        for name in IMPORTED {
            let address = format!(
                "data:text/javascript;base64,{}",
                STANDARD.encode(read(name)?)
            );
            addresses.insert(format!("./{name}"), address.into());
        }
        let page = text("page.js")?;
        if page.contains("</script") || page.contains("<!--") {
            return Err(wrong(
                &folder.join("page.js"),
                "a script that does not end another",
                "`</script` or `<!--`",
            ));
        }
        let (mut before, after) = cut(&folder, &index, SCRIPT)?;
        let (head, body) = cut(&folder, &before, STYLE)?;
        before = format!(
            "{head}{style}{body}<script type=\"importmap\">{}</script>\n\
             <script id=\"embedded\" type=\"application/json\">{{\"script\":\"{}\",\"module\":\"{}\",\"worker\":\"{}\",\"files\":[",
            json!({ "imports": addresses }),
            packed("simd/ewa_splat.js")?,
            packed("simd/ewa_splat_bg.wasm")?,
            packed("worker.js")?,
        );
        let after = format!("}}</script>\n<script type=\"module\">\n{page}</script>{after}");
        Ok(Self { before, after })
    }

    /// Returns the parts of a page with files.
    fn parts<'a>(&self, files: &'a [Embedded], view: &Value) -> Vec<Part<'a>> {
        // `<` could end or begin a script within the text.
        let safe = |value: &Value| value.to_string().replace('<', "\\u003c");
        let mut parts = Vec::new();
        for (i, file) in files.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            let name = safe(&Value::from(file.name.as_str()));
            parts.push(Part::Text(format!("{comma}{{\"name\":{name},\"data\":\"")));
            parts.push(Part::File(file));
            parts.push(Part::Text("\"}".into()));
        }
        parts.push(Part::Text(format!("],\"view\":{}", safe(view))));
        parts
    }

    /// Returns the number of bytes of a page.
    pub(super) fn length(&self, files: &[Embedded], view: &Value) -> u64 {
        let parts = self.parts(files, view).into_iter().map(|part| match part {
            Part::Text(text) => text.len() as u64,
            Part::File(file) => file.characters,
        });
        parts.sum::<u64>() + (self.before.len() + self.after.len()) as u64
    }

    /// Returns the number of characters that remain for a file of splats in a page of a size.
    ///
    /// # Errors
    /// A size that the page takes without data.
    pub(super) fn room(&self, most: u64) -> Result<u64> {
        let taken = self.length(&[], &Value::Null) + ROOM_FOR_VIEW;
        most.checked_sub(taken)
            .filter(|left| *left > 0)
            .ok_or_else(|| {
                let expected =
                    format!("more than {taken} bytes, which the page takes without data");
                Error::invalid("--size", "value", expected, most.to_string(), "state more")
            })
    }

    /// Writes the page with files, entirely or not at all. Returns the number of bytes.
    ///
    /// # Errors
    /// More than a browser reads; a file that cannot be written.
    pub(super) fn write(&self, out: &Path, files: &[Embedded], view: &Value) -> Result<u64> {
        let length = self.length(files, view);
        if length > MOST_CHARACTERS {
            let expected = format!("at most {MOST_CHARACTERS} characters, which browsers read");
            let advice = "add --size or --error, which make kernels of what is drawn";
            return Err(Error::format(
                out,
                "page",
                expected,
                length.to_string(),
                advice,
            ));
        }
        let parts = self.parts(files, view);
        write_atomically(out, |file| {
            let mut file = BufWriter::new(file);
            file.write_all(self.before.as_bytes())?;
            for part in &parts {
                match part {
                    Part::Text(text) => file.write_all(text.as_bytes())?,
                    Part::File(own) => own.write(&mut file)?,
                }
            }
            file.write_all(self.after.as_bytes())?;
            file.flush()
        })?;
        Ok(length)
    }
}

fn wrong(path: &Path, expected: &str, found: &str) -> Error {
    Error::format(path, "page", expected, found, "build it again: web/build")
}

/// Divides a text at a word that it has once.
fn cut(folder: &Path, text: &str, at: &str) -> Result<(String, String)> {
    match text.split(at).collect::<Vec<_>>().as_slice() {
        [before, after] => Ok(((*before).to_owned(), (*after).to_owned())),
        parts => {
            let found = format!("{} of them", parts.len() - 1);
            Err(wrong(
                &folder.join("index.html"),
                &format!("one `{at}`"),
                &found,
            ))
        }
    }
}

/// Finds the folder of the built page.
fn folder(given: Option<&Path>) -> Result<PathBuf> {
    let is_page =
        |folder: &PathBuf| folder.join("index.html").is_file() && folder.join("simd").is_dir();
    let advice = "build the page (web/build --simd, in the source of this program), and name its folder web/dist: --page";
    let named = given
        .map(PathBuf::from)
        .or_else(|| env::var_os(VARIABLE).map(PathBuf::from));
    if let Some(folder) = named {
        let found = "none, or one without vector instructions";
        return match is_page(&folder) {
            true => Ok(folder),
            false => Err(Error::format(
                &folder,
                "page",
                "the built page",
                found,
                advice,
            )),
        };
    }
    let program = env::current_exe()
        .and_then(|own| own.canonicalize())
        .unwrap_or_default();
    let beside = program
        .ancestors()
        .nth(2)
        .map(|above| above.join("share/ewa-splat/page"));
    let above = program
        .ancestors()
        .skip(1)
        .take(4)
        .map(|above| above.join("web/dist"));
    let mut all = beside.into_iter().chain(above);
    all.find(is_page).ok_or_else(|| {
        Error::invalid(
            "--page",
            "page",
            "the built page",
            "none beside the program",
            advice,
        )
    })
}
