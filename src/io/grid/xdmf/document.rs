//! Parses the XML of an XDMF file, and follows references within it.
//!
//! | reference | what it stands for |
//! |---|---|
//! | `<xi:include xpointer="xpointer(PATH)"/>` | the elements that PATH selects, in its place |
//! | `<TAG Reference="XML">PATH</TAG>`, `<TAG Reference="PATH"/>` | the first element that PATH selects |
//!
//! PATH is the part of XPath that writers use: `/A/B`, `//A`, `*`, with the conditions `[2]`, `[last()]`,
//! `[@Name="x"]` and `[self::A or self::B]`.

use std::cell::Cell;
use std::fmt;
use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result};
use crate::io::vtk::xml::clip;

/// Most nodes of the document (elements, their text, and the space between them), for each byte of the file and in any case.
/// Entities could otherwise make any number.
const MOST_NODES: (f64, u32) = (0.125, 1 << 20);

/// Most references that lead from one to another.
const MOST_STEPS: usize = 16;

/// Most elements that are looked at to follow references, for each byte of the file and in any case.
const MOST_VISITS: (usize, usize) = (64, 1 << 22);

/// A parsed file.
pub(super) struct Xml<'a> {
    pub(super) path: &'a Path,
    document: Document<'a>,
    /// Number of elements that may still be looked at.
    visits: Cell<usize>,
}

/// Place of an element. Its line is counted when it is formatted, from the start of the file.
pub(super) struct Place<'n, 'd>(Node<'n, 'd>);

impl fmt::Display for Place<'_, '_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.0.document().text_pos_at(self.0.range().start).row;
        write!(
            f,
            "element `{}`, line {line}",
            clip(self.0.tag_name().name())
        )
    }
}

impl<'a> Xml<'a> {
    pub(super) fn parse(path: &'a Path, text: &'a str) -> Result<Self> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a length, which saturates"
        )]
        let most = ((text.len() as f64 * MOST_NODES.0) as u32).max(MOST_NODES.1);
        let options = ParsingOptions {
            // Writers name `Xdmf.dtd`, which is not read, and abbreviate file names by entities.
            allow_dtd: true,
            nodes_limit: most,
            ..ParsingOptions::default()
        };
        let text = text.trim_start_matches('\u{feff}').trim_start();
        let document = Document::parse_with_options(text, options).map_err(|error| {
            if matches!(error, roxmltree::Error::NodesLimitReached) {
                let (expected, advice) = (
                    format!("at most {most} XML nodes"),
                    "write steps in several files",
                );
                return Error::format(path, "XML", expected, "more", advice);
            }
            let found = error.to_string();
            Error::format(
                path,
                "XML",
                "sound XML",
                found,
                "the file is damaged: save it again",
            )
        })?;
        let visits = text
            .len()
            .saturating_mul(MOST_VISITS.0)
            .saturating_add(MOST_VISITS.1);
        Ok(Self {
            path,
            document,
            visits: Cell::new(visits),
        })
    }

    /// Returns the first domain.
    pub(super) fn domain(&self) -> Result<Node<'_, 'a>> {
        let root = self.document.root_element();
        let domain = root.children().find(|node| is(*node, "Domain"));
        let domain = domain.filter(|_| is(root, "Xdmf"));
        domain.ok_or_else(|| {
            let place = Xml::place(root).to_string();
            let advice = "save it again as XDMF 2 or 3";
            Error::format(self.path, place, "`Xdmf` with a `Domain`", "none", advice)
        })
    }

    /// Returns the place of an element, for errors.
    pub(super) fn place<'n, 'd>(node: Node<'n, 'd>) -> Place<'n, 'd> {
        Place(node)
    }

    pub(super) fn fault(
        &self,
        node: Node<'_, '_>,
        expected: impl Into<String>,
        found: impl AsRef<str>,
    ) -> Error {
        let advice = "correct the file, or write it again";
        let found = clip(found.as_ref());
        Error::format(
            self.path,
            Self::place(node).to_string(),
            expected,
            format!("`{found}`"),
            advice,
        )
    }

    /// Returns the elements in an element, with those that it includes.
    pub(super) fn children<'s>(&'s self, node: Node<'s, 'a>) -> Result<Vec<Node<'s, 'a>>> {
        let mut all = Vec::new();
        for child in node.children().filter(Node::is_element) {
            if !is(child, "include") {
                all.push(self.resolved(child)?);
                continue;
            }
            if child.attribute("href").is_some_and(|file| !file.is_empty()) {
                let expected = "elements of this file, by `xpointer`";
                return Err(self.fault(child, expected, "another file"));
            }
            let pointer = child.attribute("xpointer").unwrap_or_default().trim();
            let path = pointer.strip_prefix("xpointer(");
            let path = path.and_then(|path| path.trim_end().strip_suffix(')'));
            let path = path.ok_or_else(|| self.fault(child, "`xpointer(PATH)`", pointer))?;
            for found in self.select(child, path)? {
                all.push(self.resolved(found)?);
            }
        }
        Ok(all)
    }

    /// Returns the element that an element refers to, or the element itself.
    fn resolved<'s>(&'s self, mut node: Node<'s, 'a>) -> Result<Node<'s, 'a>> {
        for _ in 0..MOST_STEPS {
            let Some(reference) = node.attribute("Reference") else {
                return Ok(node);
            };
            let text = text(node);
            let path = match reference.trim() {
                "XML" => text.trim(),
                path => path,
            };
            let found = self.select(node, path)?;
            let found = found.into_iter().next();
            node = found.ok_or_else(|| self.fault(node, "a reference to an element", path))?;
        }
        Err(self.fault(node, "references that end", "more of them"))
    }

    /// Returns the elements that a path selects.
    fn select<'s>(&'s self, at: Node<'s, 'a>, path: &str) -> Result<Vec<Node<'s, 'a>>> {
        let fault = || {
            let expected = "a path such as `/Xdmf/Domain/Grid[1]/Topology`";
            self.fault(at, expected, path)
        };
        let mut rest = path.trim();
        let mut selected = vec![self.document.root()];
        if !rest.starts_with('/') {
            return Err(fault());
        }
        while !rest.is_empty() {
            let is_deep = rest.starts_with("//");
            rest = rest
                .strip_prefix(if is_deep { "//" } else { "/" })
                .ok_or_else(fault)?;
            let end = rest.find(['/', '[']).unwrap_or(rest.len());
            let name = rest[..end].trim();
            rest = &rest[end..];
            let mut conditions = Vec::new();
            while let Some(inside) = rest.strip_prefix('[') {
                let end = condition_end(inside).ok_or_else(fault)?;
                conditions.push(inside[..end].trim());
                rest = &inside[end + 1..];
            }
            let mut next: Vec<Node<'s, 'a>> = Vec::new();
            for node in selected {
                // Positions count among the children of one element.
                let parents: Vec<Node<'s, 'a>> = match is_deep {
                    true => node.descendants().filter(|n| n.has_children()).collect(),
                    false => vec![node],
                };
                self.visit(at, parents.len())?;
                for parent in parents {
                    let children = parent.children().filter(Node::is_element);
                    let mut found: Vec<Node<'s, 'a>> = Vec::new();
                    let mut seen = 0;
                    for child in children {
                        seen += 1;
                        if name == "*" || is(child, name) {
                            found.push(child);
                        }
                    }
                    self.visit(at, seen)?;
                    for condition in &conditions {
                        found = met(found, condition).ok_or_else(fault)?;
                    }
                    next.extend(found);
                }
            }
            selected = next;
        }
        Ok(selected)
    }

    fn visit(&self, at: Node<'_, '_>, count: usize) -> Result<()> {
        let left = self.visits.get().checked_sub(count);
        let left = left.ok_or_else(|| self.fault(at, "fewer references", "too many"))?;
        self.visits.set(left);
        Ok(())
    }
}

/// Returns where a condition ends: at a bracket outside quotes.
fn condition_end(text: &str) -> Option<usize> {
    let mut quote = None;
    for (i, c) in text.char_indices() {
        match quote {
            Some(open) if c == open => quote = None,
            Some(_) => {}
            None if c == '"' || c == '\'' => quote = Some(c),
            None if c == ']' => return Some(i),
            None => {}
        }
    }
    None
}

/// Returns the elements that meet a condition; `None` if it is not one of those that are known.
fn met<'s, 'a>(found: Vec<Node<'s, 'a>>, condition: &str) -> Option<Vec<Node<'s, 'a>>> {
    if condition == "last()" {
        return Some(found.into_iter().next_back().into_iter().collect());
    }
    if let Ok(number) = condition.parse::<usize>() {
        let at = number.checked_sub(1)?;
        return Some(found.into_iter().nth(at).into_iter().collect());
    }
    if let Some(attribute) = condition.strip_prefix('@') {
        let (name, value) = attribute.split_once('=')?;
        let value = value.trim();
        let quote = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let value = value.strip_prefix(quote)?.strip_suffix(quote)?;
        let is_it = |node: &Node<'_, '_>| node.attribute(name.trim()) == Some(value);
        return Some(found.into_iter().filter(is_it).collect());
    }
    let tags: Option<Vec<&str>> = condition
        .split(" or ")
        .map(|part| part.trim().strip_prefix("self::").map(str::trim))
        .collect();
    let tags = tags?;
    let is_it = |node: &Node<'_, '_>| tags.iter().any(|tag| is(*node, tag));
    Some(found.into_iter().filter(is_it).collect())
}

/// Returns true for an element of this name.
pub(super) fn is(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

/// Returns the text in an element, without that in its children.
pub(super) fn text(node: Node<'_, '_>) -> String {
    let parts = node.children().filter(Node::is_text);
    parts.filter_map(|part| part.text()).collect()
}

/// Returns the attribute of one of these names.
pub(super) fn attribute<'a>(node: Node<'a, '_>, names: &[&str]) -> Option<&'a str> {
    names
        .iter()
        .find_map(|name| node.attribute(*name))
        .map(str::trim)
}
