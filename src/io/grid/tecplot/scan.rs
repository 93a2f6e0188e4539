//! Scans words, strings and lists of a Tecplot file.

use std::path::Path;

use crate::error::{Error, Result};

/// A token of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Token<'a> {
    /// The text between quotes.
    Quoted(&'a str),
    /// The text between brackets, nested brackets included.
    Group(&'a str),
    Equals,
    /// Anything else between white space and commas.
    Word(&'a str),
}

/// A text, and the position in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scanner<'a> {
    path: &'a Path,
    text: &'a str,
    at: usize,
}

impl<'a> Scanner<'a> {
    pub(super) fn new(path: &'a Path, text: &'a str) -> Self {
        Self { path, text, at: 0 }
    }

    pub(super) fn fault(&self, place: &str, expected: &str, found: &str) -> Error {
        let line = self.text[..self.at].bytes().filter(|b| *b == b'\n').count() + 1;
        let found: String = found.chars().filter(|c| !c.is_control()).take(40).collect();
        let found = match found.is_empty() {
            true => "nothing".to_owned(),
            false => format!("`{found}`"),
        };
        let advice = "the file is damaged: save it again";
        let place = format!("{place}, line {line}");
        Error::format(self.path, place, expected, found, advice)
    }

    fn skip_space(&mut self) {
        loop {
            let rest = &self.text[self.at..];
            let is_space = |c: char| c.is_whitespace() || c == ',';
            let trimmed = rest.trim_start_matches(is_space);
            self.at += rest.len() - trimmed.len();
            if !trimmed.starts_with('#') {
                return;
            }
            self.skip_line();
        }
    }

    pub(super) fn skip_line(&mut self) {
        let rest = &self.text[self.at..];
        self.at += rest.find('\n').map_or(rest.len(), |end| end + 1);
    }

    /// The next token; `None` at the end. A token without its closing quote or bracket extends to the end of
    /// the file.
    pub(super) fn next(&mut self) -> Option<Token<'a>> {
        self.skip_space();
        let rest = &self.text[self.at..];
        let first = rest.chars().next()?;
        let (length, token) = match first {
            '=' => (1, Token::Equals),
            '"' | '\'' => {
                let end = rest[1..].find(first).map_or(rest.len(), |end| end + 1);
                ((end + 1).min(rest.len()), Token::Quoted(&rest[1..end]))
            }
            '(' => {
                let mut depth = 0;
                let end = rest.char_indices().find(|(_, c)| {
                    match c {
                        '(' => depth += 1,
                        ')' => depth -= 1,
                        _ => {}
                    }
                    depth == 0
                });
                let end = end.map_or(rest.len(), |(end, _)| end);
                ((end + 1).min(rest.len()), Token::Group(&rest[1..end]))
            }
            _ => {
                let is_end = |c: char| c.is_whitespace() || ",=(\"#".contains(c);
                let end = rest
                    .find(is_end)
                    .unwrap_or(rest.len())
                    .max(first.len_utf8());
                (end, Token::Word(&rest[..end]))
            }
        };
        self.at += length;
        Some(token)
    }

    pub(super) fn peek(&self) -> Option<Token<'a>> {
        let mut ahead = *self;
        ahead.next()
    }

    /// Whether the next tokens are a word and `=`.
    pub(super) fn is_key(&self) -> bool {
        let mut ahead = *self;
        matches!(ahead.next(), Some(Token::Word(_))) && ahead.next() == Some(Token::Equals)
    }

    /// The token after a word and `=`.
    pub(super) fn value(&mut self) -> Result<Token<'a>> {
        let found = self.next();
        if found != Some(Token::Equals) {
            return Err(self.fault("header", "`=`", &text_of(found)));
        }
        self.next()
            .ok_or_else(|| self.fault("header", "a value", ""))
    }
}

/// The text of a token, for messages and for values.
pub(super) fn text_of(token: Option<Token<'_>>) -> String {
    match token {
        Some(Token::Quoted(text) | Token::Group(text) | Token::Word(text)) => text.to_owned(),
        Some(Token::Equals) => "=".to_owned(),
        None => String::new(),
    }
}
