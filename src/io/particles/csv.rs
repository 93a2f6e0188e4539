//! Reads particle tables in CSV.
//!
//! | lines | contents |
//! |---|---|
//! | `# ...` | a comment, anywhere; `# x,y,z,...` directly before the first row is the header, as `numpy.savetxt` writes it |
//! | first | column names, separated by `,`, `;` or tabs |
//! | others | one particle each |
//!
//! A column whose cells are all words (labels) is left out. A column that mixes words and numbers is an error, since
//! one of them is a mistake. An empty cell and `nan` are read as not-a-number, and `inf` as infinity; sampling counts
//! these values and leaves them out. Positions must not be empty.

use std::path::Path;

use glam::DVec3;

use super::table::{dataset, position_columns, scalar_field};
use crate::data::dataset::Dataset;
use crate::error::{Error, Result};
use crate::io::bytes::file::Input;

/// State of one column during reading.
#[derive(Debug, Default)]
struct Column {
    values: Vec<f64>,
    has_numbers: bool,
    /// Line and text of the first cell that is neither empty nor a number.
    first_word: Option<(u64, String)>,
}

/// Reads a table.
///
/// # Errors
/// No header, no positions, rows of different lengths, or a cell that is not a number; the
/// message names line and column.
pub(crate) fn read(input: Input<'_>) -> Result<Dataset> {
    let path = input.path;
    let bytes = input.read_all()?;
    parse(path, &bytes)
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Dataset> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let Header {
        names,
        separator,
        in_comment,
    } = header(path, bytes)?;
    let position = position_columns(path, names.iter().map(String::as_str))?;

    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .has_headers(false)
        .flexible(true)
        .from_reader(bytes);
    let mut positions = Vec::new();
    let mut columns: Vec<Column> = names.iter().map(|_| Column::default()).collect();
    let mut record = csv::ByteRecord::new();
    let mut skip_header = !in_comment;
    while reader.read_byte_record(&mut record).map_err(|e| {
        Error::format(
            path,
            "rows",
            "separated values",
            e.to_string(),
            "repair the row",
        )
    })? {
        if std::mem::take(&mut skip_header) {
            continue;
        }
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != names.len() {
            return Err(Error::format(
                path,
                format!("line {line}"),
                format!("{} cells, one per column", names.len()),
                format!("{} cells", record.len()),
                "complete the row or remove it",
            ));
        }
        let mut xyz = [0.0; 3];
        for (axis, column) in position.axes().into_iter().enumerate() {
            xyz[axis] = number(&record[column])
                .ok_or_else(|| bad_cell(path, line, &names[column], &shown(&record[column])))?;
        }
        positions.push(DVec3::from_array(xyz));
        for (i, (column, cell)) in columns.iter_mut().zip(&record).enumerate() {
            if position.contains(i) {
                continue;
            }
            let value = match number(cell) {
                Some(value) => {
                    column.has_numbers = true;
                    value
                }
                None => {
                    if !cell.is_empty() && column.first_word.is_none() {
                        column.first_word = Some((line, shown(cell)));
                    }
                    f64::NAN
                }
            };
            if let (true, Some((line, word))) = (column.has_numbers, &column.first_word) {
                return Err(bad_cell(path, *line, &names[i], word));
            }
            column.values.push(value);
        }
    }

    let fields = names
        .into_iter()
        .zip(columns)
        .enumerate()
        .filter(|(i, (_, column))| !position.contains(*i) && column.first_word.is_none())
        .map(|(i, (name, column))| {
            let name = if name.is_empty() {
                format!("column {}", i + 1)
            } else {
                name
            };
            scalar_field(name, column.values.into())
        })
        .collect();
    let flat = position.flatten(&mut positions);
    let mut data = dataset(path, "CSV particle table", positions, fields)?;
    data.notes.extend(flat);
    Ok(data)
}

/// Column names, and how they were found.
struct Header {
    names: Vec<String>,
    separator: u8,
    in_comment: bool,
}

/// Returns the character that separates the cells of a line.
fn separator_of(line: &[u8]) -> u8 {
    // Semicolons and tabs come first, because a decimal comma must not split a cell.
    let known = [b';', b'\t', b','];
    known.into_iter().find(|s| line.contains(s)).unwrap_or(b',')
}

fn header(path: &Path, bytes: &[u8]) -> Result<Header> {
    let mut comment: &[u8] = b"";
    let mut first: &[u8] = b"";
    for line in bytes.split(|&b| b == b'\n' || b == b'\r') {
        let line = line.trim_ascii();
        if let Some(text) = line.strip_prefix(b"#") {
            comment = text.trim_ascii();
        } else if !line.is_empty() {
            first = line;
            break;
        }
    }
    let split = |line: &[u8], separator: u8| -> Vec<String> {
        line.split(|&b| b == separator)
            .map(|name| {
                let name = String::from_utf8_lossy(name);
                name.trim().trim_matches('"').trim().to_owned()
            })
            .collect()
    };
    let separator = separator_of(first);
    let first_names = split(first, separator);
    if !first.is_empty()
        && first_names
            .iter()
            .all(|cell| number(cell.as_bytes()).is_some())
    {
        let names = split(comment, separator);
        if names.len() == first_names.len() {
            return Ok(Header {
                names,
                separator,
                in_comment: true,
            });
        }
        return Err(Error::format(
            path,
            "first line",
            "a header line with column names, x, y and z among them",
            "numbers only",
            "add a header line",
        ));
    }
    Ok(Header {
        names: first_names,
        separator,
        in_comment: false,
    })
}

/// Returns true if the first line that is no comment names x and y, and perhaps z.
pub(crate) fn names_positions(head: &[u8]) -> bool {
    let path = Path::new("");
    header(path, head)
        .is_ok_and(|h| position_columns(path, h.names.iter().map(String::as_str)).is_ok())
}

/// Returns true if these first bytes are those of a table. Its lines have two or more cells that contain numbers. A
/// header, if present, has as many names.
pub(crate) fn looks_like_table(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let lines = head.split(|&b| b == b'\n' || b == b'\r');
    let lines = lines.map(<[u8]>::trim_ascii);
    let mut lines = lines.filter(|line| !line.is_empty() && !line.starts_with(b"#"));
    let (Some(first), second) = (lines.next(), lines.next()) else {
        return false;
    };
    let separator = separator_of(first);
    let cells = |line: &[u8]| -> Vec<bool> {
        let cells = line.split(|&b| b == separator);
        cells.map(|cell| number(cell).is_some()).collect()
    };
    let first = cells(first);
    let is_row = |second: &[u8]| {
        let second = cells(second);
        second.len() == first.len() && second.contains(&true)
    };
    first.len() > 1 && (second.is_some_and(is_row) || first.iter().all(|is_number| *is_number))
}

fn number(cell: &[u8]) -> Option<f64> {
    std::str::from_utf8(cell).ok()?.trim().parse().ok()
}

fn shown(cell: &[u8]) -> String {
    String::from_utf8_lossy(cell).chars().take(40).collect()
}

fn bad_cell(path: &Path, line: u64, column: &str, cell: &str) -> Error {
    Error::format(
        path,
        format!("line {line}, column `{column}`"),
        "a number",
        format!("`{cell}`"),
        "correct the cell, or write nan where there is no value",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::dataset::Geometry;
    use crate::scene::Values;

    fn parse_text(text: &str) -> Result<Dataset> {
        parse(Path::new("t.csv"), text.as_bytes())
    }

    #[test]
    fn paraview_s_columns_are_positions() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let text = "\"T\",\"Points:0\",\"Points:1\",\"Points:2\"\n5,1,2,3\n6,4,5,6\n";
        std::fs::write(file.path(), text).unwrap();
        let data = read(Input::of_file(file.path())).unwrap();
        let Geometry::Points { positions } = &data.geometry else {
            panic!()
        };
        assert_eq!(positions[1], DVec3::new(4.0, 5.0, 6.0));
        assert_eq!(data.field_names(), ["T"]);
    }

    #[test]
    fn separators_comments_and_cases_are_understood() {
        for text in [
            "X,y,Z,h,label\n1,2,3,0.5,a\n4,5,6,nan,b\n",
            "# made by hand\n\n X; y;Z;h ;label\r\n1;2;3;0.5;a\r\n# between\r\n4;5;6;;b\r\n",
            "\u{feff}X\ty\tZ\th\tlabel\n1\t2\t3\t0.5\ta\n4\t5\t6\tNaN\tb",
            "\"X\",\"y\",\"Z\",\"h\",\"label\"\n1,2,3,0.5,\"a\"\n4,5,6,nan,\"b, c\"\n",
        ] {
            let data = parse_text(text).unwrap();
            let Geometry::Points { positions } = &data.geometry else {
                panic!()
            };
            assert_eq!(positions, &[DVec3::new(1., 2., 3.), DVec3::new(4., 5., 6.)]);
            assert_eq!(data.field_names(), ["h"]);
            let (_, h) = data.scalar("H").unwrap();
            assert_eq!(h.get(0), 0.5);
            assert!(h.get(1).is_nan());
        }
    }

    #[test]
    fn a_header_may_stand_in_a_comment_as_numpy_writes_it() {
        let data = parse_text("# x,y,z,m\n1,2,3,4\n").unwrap();
        assert_eq!(data.scalar("m").unwrap().1, Values::F32(vec![4.0]));
    }

    #[test]
    fn particles_of_a_plane_lie_at_zero() {
        let data = parse_text("h,y,x\n.5,2,1\n.5,4,3\n").unwrap();
        let Geometry::Points { positions } = &data.geometry else {
            panic!()
        };
        assert_eq!(positions, &[DVec3::new(1., 2., 0.), DVec3::new(3., 4., 0.)]);
        assert_eq!(data.field_names(), ["h"]);
        assert!(data.notes[0].contains("z = 0"));
    }

    #[test]
    fn positions_keep_double_precision() {
        let data = parse_text("x,y,z\n1000000.0000001,0,0\n").unwrap();
        let Geometry::Points { positions } = &data.geometry else {
            panic!()
        };
        assert_eq!(positions[0].x, 1_000_000.000_000_1);
    }

    #[test]
    fn mistakes_are_named_by_line_and_column() {
        for (text, place) in [
            ("x,y,z,h\n1,2,3,4\n1,2,oops,4\n", "line 3, column `z`"),
            ("x,y,z,h\n1,2,3,4\n1,2,3,oops\n", "line 3, column `h`"),
            ("x,y,z,h\n1,2,3,oops\n1,2,3,4\n", "line 2, column `h`"),
            ("x,y,z\n1,2,\n", "line 2, column `z`"),
            ("x,y,z\n1,2,3\n1,2\n", "line 3"),
            ("x,z,h\n1,2,3\n", "no column `y`"),
            ("x,y,z,Z\n1,2,3,4\n", "more than one column `z`"),
            ("x,X,y,z\n1,2,3,4\n", "more than one column `x`"),
            ("1,2,3\n", "numbers only"),
            ("x,y,z\n", "at least one particle"),
            ("", "no column"),
        ] {
            let err = parse_text(text).unwrap_err().to_string();
            assert!(err.contains(place), "{err}");
        }
    }
}
