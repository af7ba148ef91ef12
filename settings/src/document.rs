//! The text: a settings file with the command line laid over it, every value remembering where it was given.

mod layers;

use std::collections::BTreeMap;
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use crate::error::{Error, Place};
use crate::section::Section;

/// A settings file, parsed but not yet believed: [`section`](Document::section) checks one part of it at a time.
///
/// Tables lie flat, `[link.tls]` beside `[link]`, under the name their section goes by. The root's name is empty.
#[derive(Debug, Clone, Default)]
pub struct Document {
    tables: BTreeMap<String, Table>,
}

#[derive(Debug, Clone)]
struct Table {
    place: Place,
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug, Clone)]
struct Entry {
    /// Where the key stands; the value's place is its own.
    place: Place,
    found: Found,
}

/// A value as it was given: what a [`Value`](crate::Value) reads.
#[derive(Debug, Clone)]
pub struct Found {
    key: String,
    place: Place,
    raw: Raw,
    /// The word itself, if it was given on the command line, where strings and choices need no quotes.
    word: Option<String>,
}

#[derive(Debug, Clone)]
pub(crate) enum Raw {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    String(String),
    Array(Vec<Found>),
    /// Something no setting is made of, by its name.
    Other(&'static str),
}

impl Document {
    /// Parses `text`. Errors will call it `file`.
    pub fn parse(file: &str, text: &str) -> Result<Self, Error> {
        let lines = Lines::new(file, text);
        let place = |offset| lines.place(offset);
        let root = DeTable::parse(text).map_err(|error| Error::Syntax {
            place: place(error.span().map_or(0, |span| span.start)),
            message: error.message().lines().collect::<Vec<_>>().join(", "),
        })?;
        Ok(Self {
            tables: flattened(root.into_inner(), &place),
        })
    }

    /// Lays a value from the command line over the file's. The `key` has its section in front; the `word` is TOML, or
    /// for a string or a choice simply the word. It is checked where the file's would be.
    pub fn set(&mut self, key: &str, word: &str) {
        let place = Place::CommandLine;
        let (section, name) = key.rsplit_once('.').unwrap_or(("", key));
        let raw = match DeValue::parse(word) {
            Ok(value) => Raw::new(key, value.into_inner(), &|_| Place::CommandLine),
            Err(_) => Raw::String(word.to_owned()),
        };
        let found = Found {
            key: key.to_owned(),
            place: place.clone(),
            raw,
            word: Some(word.to_owned()),
        };
        let table = self.tables.entry(section.to_owned());
        let table = table.or_insert_with(|| Table {
            place: place.clone(),
            entries: BTreeMap::new(),
        });
        table.entries.insert(name.to_owned(), Entry { place, found });
    }

    /// Reads one section, with defaults for the keys that are absent, and so for all of them if it is absent itself.
    pub fn section<S: Section>(&self) -> Result<S, Error> {
        self.section_at(S::NAME)
    }

    /// Reads a section under another name than its own: one of several that have the same keys, `[laws.a]`, `[laws.b]`.
    pub fn section_at<S: Section>(&self, section: &str) -> Result<S, Error> {
        self.section_over(section, S::default())
    }

    /// The same where the keys that are absent are as in `settings`: a section for one case, beside one for all.
    pub fn section_over<S: Section>(&self, section: &str, mut settings: S) -> Result<S, Error> {
        self.refuse_value(section)?;
        let keys = S::keys();
        let known = || keys.iter().map(|key| key.name.to_owned()).collect();
        self.refuse_strays(section, |name| keys.iter().any(|key| key.name == name), known)?;
        for key in &keys {
            if let Some(found) = self.found(section, key.name) {
                (key.read)(&mut settings, &found)?;
            }
        }
        Ok(settings)
    }

    /// Checks that nothing is left over: every section given is one of `known`, and no key stands outside of them.
    pub fn finish(&self, known: &[&str]) -> Result<(), Error> {
        let owned = || known.iter().map(|&section| section.to_owned()).collect::<Vec<_>>();
        known.iter().try_for_each(|section| self.refuse_value(section))?;
        let mut strangers = Vec::new();
        for (name, table) in self.tables.iter().filter(|(name, _)| !known.contains(&name.as_str())) {
            if name.is_empty() || known.iter().any(|section| is_inside(section, name)) {
                self.refuse_strays(name, |_| false, owned)?;
            } else {
                strangers.push((&table.place, name));
            }
        }
        match strangers.into_iter().min() {
            Some((place, section)) => Err(Error::UnknownSection {
                place: place.clone(),
                section: section.clone(),
                known: owned(),
            }),
            None => Ok(()),
        }
    }

    /// Checks that where the section would be there is no mere value, as in `arbiter = 5`.
    fn refuse_value(&self, section: &str) -> Result<(), Error> {
        let (outer, name) = section.rsplit_once('.').unwrap_or(("", section));
        match self.entry(outer, name) {
            Some(entry) => Err(entry.found.should_be("a section".to_owned())),
            None => Ok(()),
        }
    }

    /// Checks that every key of a table belongs there, and names the first in the file that does not.
    fn refuse_strays(
        &self,
        section: &str,
        belongs: impl Fn(&str) -> bool,
        known: impl Fn() -> Vec<String>,
    ) -> Result<(), Error> {
        let entries = self.tables.get(section).into_iter().flat_map(|table| &table.entries);
        let strays = entries.filter(|(name, _)| !belongs(name)).map(|(_, entry)| entry);
        match strays.min_by_key(|entry| &entry.place) {
            Some(Entry { place, found }) => Err(Error::UnknownKey {
                place: place.clone(),
                key: found.key.clone(),
                known: known(),
            }),
            None => Ok(()),
        }
    }

    fn entry(&self, section: &str, name: &str) -> Option<&Entry> {
        self.tables.get(section)?.entries.get(name)
    }

    /// What was given for a key, be it a whole table.
    fn found(&self, section: &str, name: &str) -> Option<Found> {
        let key = joined(section, name);
        match (self.entry(section, name), self.tables.get(&key)) {
            (Some(entry), _) => Some(entry.found.clone()),
            (None, Some(Table { place, .. })) => Some(Found {
                key,
                place: place.clone(),
                raw: Raw::Other("a section"),
                word: None,
            }),
            (None, None) => None,
        }
    }
}

impl Found {
    fn new(key: String, place: Place, value: DeValue<'_>, place_at: &dyn Fn(usize) -> Place) -> Self {
        let raw = Raw::new(&key, value, place_at);
        Self {
            key,
            place,
            raw,
            word: None,
        }
    }

    /// The key with its section in front, and for an element of an array its index behind.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Where the value was given.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// That the value is of the wrong kind.
    pub fn should_be(&self, expected: String) -> Error {
        Error::WrongType {
            place: self.place.clone(),
            key: self.key.clone(),
            expected,
            found: self.raw.kind(),
        }
    }

    pub(crate) fn raw(&self) -> &Raw {
        &self.raw
    }

    /// The text of a string, or of any word on the command line.
    pub(crate) fn text(&self) -> Option<&str> {
        match (&self.word, &self.raw) {
            (Some(word), _) => Some(word),
            (None, Raw::String(text)) => Some(text),
            (None, _) => None,
        }
    }
}

impl Raw {
    fn new(key: &str, value: DeValue<'_>, place: &dyn Fn(usize) -> Place) -> Self {
        match value {
            DeValue::Boolean(value) => Self::Boolean(value),
            DeValue::Integer(digits) => match i64::from_str_radix(digits.as_str(), digits.radix()) {
                Ok(value) => Self::Integer(value),
                Err(_) => Self::Other("an integer of more than 64 bits"),
            },
            DeValue::Float(digits) => Self::Float(digits.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::String(text) => Self::String(text.into_owned()),
            DeValue::Datetime(_) => Self::Other("a date or time"),
            DeValue::Table(_) => Self::Other("a table"),
            DeValue::Array(values) => {
                let elements = values.into_iter().enumerate().map(|(index, value)| {
                    let at = place(value.span().start);
                    Found::new(format!("{key}[{index}]"), at, value.into_inner(), place)
                });
                Self::Array(elements.collect())
            }
        }
    }

    fn kind(&self) -> String {
        match self {
            Self::Boolean(value) => value.to_string(),
            Self::Integer(_) => "a whole number".to_owned(),
            Self::Float(_) => "a number".to_owned(),
            Self::String(_) => "a string".to_owned(),
            Self::Array(elements) => format!("an array of {}", elements.len()),
            Self::Other(name) => (*name).to_owned(),
        }
    }
}

/// Lays nested tables side by side. A list of tables yet to do rather than recursion: how deep a text may nest is the
/// parser's affair, and the stack is not asked to follow.
fn flattened(root: DeTable<'_>, place: &dyn Fn(usize) -> Place) -> BTreeMap<String, Table> {
    let mut tables = BTreeMap::new();
    let mut to_do = vec![(String::new(), place(0), root)];
    while let Some((section, section_place, table)) = to_do.pop() {
        let mut entries = BTreeMap::new();
        for (key, value) in table {
            let (key_place, value_place) = (place(key.span().start), place(value.span().start));
            let name = spelled(key.get_ref());
            let full = joined(&section, &name);
            match value.into_inner() {
                DeValue::Table(inner) => to_do.push((full, key_place, inner)),
                value => {
                    let found = Found::new(full, value_place, value, place);
                    entries.insert(
                        name,
                        Entry {
                            place: key_place,
                            found,
                        },
                    );
                }
            }
        }
        tables.insert(
            section,
            Table {
                place: section_place,
                entries,
            },
        );
    }
    tables
}

/// A key as one would write it: quoted if it must be, so that a dot in a name is not taken for nesting.
fn spelled(key: &str) -> String {
    let bare = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
    if !key.is_empty() && key.chars().all(bare) {
        key.to_owned()
    } else {
        format!("{key:?}")
    }
}

fn joined(section: &str, name: &str) -> String {
    if section.is_empty() {
        name.to_owned()
    } else {
        format!("{section}.{name}")
    }
}

fn is_inside(section: &str, outer: &str) -> bool {
    section.strip_prefix(outer).is_some_and(|rest| rest.starts_with('.'))
}

/// Where each line of a text starts.
struct Lines<'a> {
    file: Arc<str>,
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn new(file: &str, text: &'a str) -> Self {
        let after_breaks = text.match_indices('\n').map(|(offset, _)| offset + 1);
        Self {
            file: file.into(),
            text,
            starts: std::iter::once(0).chain(after_breaks).collect(),
        }
    }

    fn place(&self, offset: usize) -> Place {
        let line = self.starts.partition_point(|start| *start <= offset);
        let start = self.starts[line - 1];
        let column = self.text.get(start..offset).map_or(0, |before| before.chars().count()) + 1;
        let count = |number: usize| u32::try_from(number).unwrap_or(u32::MAX);
        Place::File {
            file: Arc::clone(&self.file),
            line: count(line),
            column: count(column),
        }
    }
}
