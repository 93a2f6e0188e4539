//! Reads the zones of a Tecplot file: their headers and numbers.

use std::path::Path;
use std::rc::Rc;

use super::scan::{Scanner, Token, text_of};
use crate::data::cells::CellKind;
use crate::error::{Error, Result};

/// Number of numbers that repetition may add beyond one for each byte of the file.
const LEAST_NUMBERS: usize = 1 << 20;

/// Greatest number of variables; far more than anything writes.
const MOST_VARIABLES: usize = 1 << 12;

/// The content of a file.
#[derive(Debug, Default)]
pub(super) struct File {
    pub(super) variables: Vec<String>,
    pub(super) zones: Vec<Zone>,
    /// Whether the file has text or geometry, which is left out.
    pub(super) has_others: bool,
}

/// A zone.
#[derive(Debug, Clone)]
pub(super) struct Zone {
    pub(super) shape: Shape,
    pub(super) time: Option<f64>,
    /// Whether each variable is at the cells.
    pub(super) at_cells: Vec<bool>,
    /// The numbers of each variable; `None` if it is passive.
    pub(super) values: Vec<Option<Rc<Vec<f64>>>>,
    /// Nodes of finite elements, counted from 0.
    pub(super) elements: Rc<Vec<u32>>,
}

/// Connection of a zone's nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// Nodes along i, j and k.
    Ordered([usize; 3]),
    /// Elements of one kind.
    Elements {
        kind: CellKind,
        corners: usize,
        nodes: usize,
        cells: usize,
    },
}

impl Shape {
    fn counts(self) -> Option<[usize; 2]> {
        let product = |dims: [usize; 3]| dims[0].checked_mul(dims[1])?.checked_mul(dims[2]);
        match self {
            Self::Ordered(dims) => Some([
                product(dims)?,
                product(dims.map(|n| n.saturating_sub(1).max(1)))?,
            ]),
            Self::Elements { nodes, cells, .. } => Some([nodes, cells]),
        }
    }
}

/// The header of a zone.
#[derive(Debug, Default)]
struct Header {
    sizes: [Option<usize>; 3],
    nodes: Option<usize>,
    elements: Option<usize>,
    is_block: bool,
    /// In upper case.
    kind: String,
    time: Option<f64>,
    at_cells: Vec<usize>,
    passive: Vec<usize>,
    /// Variables, and the zone whose numbers they share.
    shared: Vec<(usize, usize)>,
    shared_elements: Option<usize>,
}

/// Whether a record with this name may begin a file.
pub(super) fn is_start(word: &str) -> bool {
    ["TITLE", "VARIABLES", "ZONE", "FILETYPE"]
        .iter()
        .any(|start| word.eq_ignore_ascii_case(start))
}

pub(super) fn read(path: &Path, text: &str) -> Result<File> {
    let mut scanner = Scanner::new(path, text);
    let mut file = File::default();
    let mut budget = LEAST_NUMBERS + text.len();
    while let Some(token) = scanner.next() {
        let Token::Word(word) = token else {
            return Err(scanner.fault("record", "TITLE, VARIABLES or ZONE", &text_of(Some(token))));
        };
        match word.to_ascii_uppercase().as_str() {
            "TITLE" | "FILETYPE" => drop(scanner.value()?),
            "VARIABLES" => read_names(&mut scanner, &mut file.variables)?,
            "ZONE" => {
                if file.variables.is_empty() || file.variables.len() > MOST_VARIABLES {
                    let found = file.variables.len().to_string();
                    let expected = format!("names of 1 to {MOST_VARIABLES} variables before it");
                    return Err(scanner.fault("ZONE", &expected, &found));
                }
                let header = Header::read(&mut scanner, file.variables.len())?;
                let zone = read_zone(&mut scanner, &header, &file, &mut budget)?;
                file.zones.push(zone);
            }
            "DATASETAUXDATA" | "VARAUXDATA" | "AUXDATA" => scanner.skip_line(),
            "TEXT" | "GEOMETRY" | "CUSTOMLABELS" => {
                file.has_others = true;
                let is_zone =
                    |token| matches!(token, Token::Word(word) if word.eq_ignore_ascii_case("ZONE"));
                while scanner.peek().is_some_and(|token| !is_zone(token)) {
                    scanner.next();
                }
            }
            _ => return Err(scanner.fault("record", "TITLE, VARIABLES or ZONE", word)),
        }
    }
    if file.zones.is_empty() {
        return Err(scanner.fault("records", "at least one ZONE", ""));
    }
    Ok(file)
}

/// Names in quotes, or words up to the next record.
fn read_names(scanner: &mut Scanner<'_>, names: &mut Vec<String>) -> Result<()> {
    let mut next = Some(scanner.value()?);
    names.clear();
    while let Some(token) = next {
        names.push(text_of(Some(token)).trim().to_owned());
        let is_record = match scanner.peek() {
            Some(Token::Quoted(_)) => false,
            Some(Token::Word(word)) => {
                is_start(word) || scanner.is_key() || word.to_ascii_uppercase().ends_with("AUXDATA")
            }
            _ => true,
        };
        next = if is_record { None } else { scanner.next() };
    }
    Ok(())
}

impl Header {
    fn read(scanner: &mut Scanner<'_>, variable_count: usize) -> Result<Self> {
        let mut header = Self::default();
        while scanner.is_key() || is_auxiliary(scanner.peek()) {
            let key = text_of(scanner.next()).to_ascii_uppercase();
            if key == "AUXDATA" {
                scanner.skip_line();
                continue;
            }
            let value = text_of(Some(scanner.value()?));
            let upper = value.to_ascii_uppercase();
            let count = || {
                let count = value.parse::<usize>().ok();
                count.ok_or_else(|| scanner.fault(&key, "a whole number", &value))
            };
            let group = |expected: &str| {
                let lists = lists(&value, variable_count);
                lists.ok_or_else(|| scanner.fault(&key, expected, &value))
            };
            match key.as_str() {
                "I" => header.sizes[0] = Some(count()?),
                "J" => header.sizes[1] = Some(count()?),
                "K" => header.sizes[2] = Some(count()?),
                "N" | "NODES" => header.nodes = Some(count()?),
                "E" | "ELEMENTS" => header.elements = Some(count()?),
                // Either key may have either's values: BLOCK, FEBLOCK.
                "F" | "DATAPACKING" => {
                    header.is_block = upper.ends_with("BLOCK");
                    if upper.starts_with("FE") && header.kind.is_empty() {
                        "FE".clone_into(&mut header.kind);
                    }
                }
                "ZONETYPE" => header.kind = upper,
                "ET" => header.kind = format!("FE{upper}"),
                "SOLUTIONTIME" => {
                    let time = value.parse().ok().filter(|time: &f64| time.is_finite());
                    let fault = || scanner.fault(&key, "a finite number", &value);
                    header.time = Some(time.ok_or_else(fault)?);
                }
                "VARLOCATION" => {
                    let expected = "lists of variables, as ([3,4]=CELLCENTERED)";
                    for (variables, location) in group(expected)? {
                        if location.eq_ignore_ascii_case("CELLCENTERED") {
                            header.at_cells.extend(variables);
                        }
                    }
                }
                "PASSIVEVARLIST" => {
                    for (variables, _) in group("lists of variables, as ([3,4])")? {
                        header.passive.extend(variables);
                    }
                }
                "VARSHARELIST" => {
                    for (variables, zone) in group("lists of variables, as ([1-3]=1)")? {
                        let zone = zone.parse::<usize>().ok().filter(|zone| *zone > 0);
                        let fault = || scanner.fault(&key, "numbers of zones", &value);
                        let zone = zone.ok_or_else(fault)? - 1;
                        header
                            .shared
                            .extend(variables.into_iter().map(|v| (v, zone)));
                    }
                }
                "CONNECTIVITYSHAREZONE" => header.shared_elements = count()?.checked_sub(1),
                _ => {}
            }
        }
        Ok(header)
    }

    fn shape(&self, scanner: &Scanner<'_>) -> Result<Shape> {
        if matches!(self.kind.as_str(), "" | "ORDERED") {
            let dims = self.sizes.map(|n| n.unwrap_or(1));
            if dims.contains(&0) {
                return Err(scanner.fault("ZONE", "one node or more along each axis", "0"));
            }
            return Ok(Shape::Ordered(dims));
        }
        let (kind, corners) = match self.kind.as_str() {
            "FELINESEG" => (CellKind::LINE, 2),
            "FETRIANGLE" => (CellKind::TRIANGLE, 3),
            "FEQUADRILATERAL" => (CellKind::QUAD, 4),
            "FETETRAHEDRON" => (CellKind::TETRA, 4),
            "FEBRICK" => (CellKind::HEXAHEDRON, 8),
            other => {
                let expected =
                    "ORDERED, or elements with up to eight corners (FETRIANGLE, ..., FEBRICK)";
                return Err(scanner.fault("ZONETYPE", expected, other));
            }
        };
        // Old files state them as I and J.
        let nodes = self.nodes.or(self.sizes[0]);
        let cells = self.elements.or(self.sizes[1]);
        match (nodes, cells) {
            (Some(nodes), Some(cells)) => Ok(Shape::Elements {
                kind,
                corners,
                nodes,
                cells,
            }),
            _ => Err(scanner.fault("ZONE", "the numbers of nodes and elements (N, E)", "")),
        }
    }
}

fn is_auxiliary(token: Option<Token<'_>>) -> bool {
    matches!(token, Some(Token::Word(word)) if word.eq_ignore_ascii_case("AUXDATA"))
}

/// Parses the lists of `[1-3,5]=A, [4]=B`, counted from 0, each with its value. In `A, A, B`, which has no
/// lists, each value is that of one variable.
fn lists(text: &str, variable_count: usize) -> Option<Vec<(Vec<usize>, String)>> {
    let mut found = Vec::new();
    if !text.contains('[') {
        let words = text
            .split([',', ' '])
            .map(str::trim)
            .filter(|w| !w.is_empty());
        for (i, word) in words.enumerate() {
            found.push((vec![i], word.to_owned()));
        }
        return (found.len() <= variable_count).then_some(found);
    }
    let mut rest = text;
    while let Some((_, after)) = rest.split_once('[') {
        let (list, tail) = after.split_once(']')?;
        let mut variables = Vec::new();
        for part in list.split(',').map(str::trim) {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let number = |text: &str| text.trim().parse::<usize>().ok();
            let range = number(first)?..=number(last)?;
            if *range.start() == 0 || *range.end() > variable_count {
                return None;
            }
            variables.extend(range.map(|v| v - 1));
            if variables.len() > variable_count {
                return None;
            }
        }
        let value = tail.trim_start().strip_prefix('=').unwrap_or("");
        let end = value.find(['[', ',']).unwrap_or(value.len());
        found.push((variables, value[..end].trim().to_owned()));
        rest = &tail[tail.find('[').unwrap_or(tail.len())..];
    }
    Some(found)
}

/// Iterates over the numbers of a zone, with repeated ones expanded.
struct Numbers<'s, 'a> {
    scanner: &'s mut Scanner<'a>,
    budget: &'s mut usize,
    repeated: (usize, f64),
}

impl Numbers<'_, '_> {
    fn next(&mut self) -> Result<f64> {
        if self.repeated.0 == 0 {
            let token = self.scanner.next();
            let word = match token {
                Some(Token::Word(word)) => word,
                _ => "",
            };
            let parsed = match word.split_once('*') {
                Some((count, number)) => count.parse().ok().zip(parse(number)),
                None => parse(word).map(|number| (1, number)),
            };
            let parsed = parsed.filter(|(count, _)| *count > 0);
            self.repeated = parsed.ok_or_else(|| self.scanner.fault("ZONE", "a number", word))?;
        }
        let Some(left) = self.budget.checked_sub(1) else {
            let expected = "about as many numbers as the file has bytes";
            return Err(self.scanner.fault("ZONE", expected, "more, by repetition"));
        };
        *self.budget = left;
        self.repeated.0 -= 1;
        Ok(self.repeated.1)
    }
}

/// A number, in which Fortran may write `D` before the exponent.
fn parse(word: &str) -> Option<f64> {
    word.parse()
        .ok()
        .or_else(|| word.replace(['D', 'd'], "e").parse().ok())
}

fn read_zone(
    scanner: &mut Scanner<'_>,
    header: &Header,
    file: &File,
    budget: &mut usize,
) -> Result<Zone> {
    let shape = header.shape(scanner)?;
    let count = file.variables.len();
    let mut at_cells = vec![false; count];
    header.at_cells.iter().for_each(|&v| at_cells[v] = true);
    if at_cells.contains(&true) && !header.is_block {
        let expected = "DATAPACKING=BLOCK where variables are at cells";
        return Err(scanner.fault("VARLOCATION", expected, "points"));
    }
    let no_zone = |scanner: &Scanner<'_>, zone: usize| {
        let expected = "a zone before this one, of as many nodes and elements";
        scanner.fault(
            "ZONE, what it shares",
            expected,
            &format!("zone {}", zone + 1),
        )
    };
    let Some(sizes) = shape.counts() else {
        return Err(scanner.fault("ZONE", "counts of nodes that fit into memory", "more"));
    };
    let mut values: Vec<Option<Rc<Vec<f64>>>> = vec![None; count];
    let mut own: Vec<usize> = (0..count).filter(|v| !header.passive.contains(v)).collect();
    for &(variable, zone) in &header.shared {
        let shared = file
            .zones
            .get(zone)
            .and_then(|zone| zone.values[variable].clone());
        let size = sizes[usize::from(at_cells[variable])];
        let shared = shared.filter(|shared| shared.len() == size);
        values[variable] = Some(shared.ok_or_else(|| no_zone(scanner, zone))?);
        own.retain(|&v| v != variable);
    }
    let mut numbers = Numbers {
        scanner: &mut *scanner,
        budget,
        repeated: (0, 0.0),
    };
    let mut read: Vec<Vec<f64>> = vec![Vec::new(); own.len()];
    if header.is_block {
        for (&variable, out) in own.iter().zip(&mut read) {
            for _ in 0..sizes[usize::from(at_cells[variable])] {
                out.push(numbers.next()?);
            }
        }
    } else if !own.is_empty() {
        for _ in 0..sizes[0] {
            for out in &mut read {
                out.push(numbers.next()?);
            }
        }
    }
    if numbers.repeated.0 > 0 {
        return Err(scanner.fault("ZONE", "as many numbers as it has", "more, by repetition"));
    }
    for (variable, out) in own.into_iter().zip(read) {
        values[variable] = Some(Rc::new(out));
    }
    let mut elements = Rc::default();
    if let Shape::Elements {
        corners,
        nodes,
        cells,
        ..
    } = &shape
    {
        elements = match header.shared_elements {
            Some(zone) => {
                let of_zone = file
                    .zones
                    .get(zone)
                    .filter(|zone| zone.elements.len() == cells.saturating_mul(*corners));
                let fits =
                    of_zone.filter(|zone| zone.elements.iter().all(|&n| (n as usize) < *nodes));
                Rc::clone(&fits.ok_or_else(|| no_zone(scanner, zone))?.elements)
            }
            None => Rc::new(read_elements(scanner, *cells, *corners, *nodes)?),
        };
    }
    Ok(Zone {
        shape,
        time: header.time,
        at_cells,
        values,
        elements,
    })
}

fn read_elements(
    scanner: &mut Scanner<'_>,
    cells: usize,
    corners: usize,
    nodes: usize,
) -> Result<Vec<u32>> {
    let mut elements = Vec::new();
    for _ in 0..cells {
        for _ in 0..corners {
            let word = text_of(scanner.next());
            let node = word.parse::<u32>().ok().and_then(|n| n.checked_sub(1));
            let node = node.filter(|&n| (n as usize) < nodes);
            let fault = || -> Error {
                scanner.fault("elements", &format!("a node from 1 to {nodes}"), &word)
            };
            elements.push(node.ok_or_else(fault)?);
        }
    }
    Ok(elements)
}
