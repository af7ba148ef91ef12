//! Every way a text can be wrong, and where.

use std::fmt;
use std::sync::Arc;

use thiserror::Error;

/// Why a text did not become settings. Each says where, what stood there, and what may stand there instead.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    /// The text is not TOML. The parser's own message is carried without its drawing of the line: the place says that.
    #[error("{place}: {message}")]
    Syntax {
        /// Where the parser gave up.
        place: Place,
        /// What the parser said, on one line.
        message: String,
    },
    /// A key nobody declared, most often a slip of the finger.
    #[error("{place}: unknown key {key}{}; known: {}", suggestion(last(.key), .known), .known.join(", "))]
    UnknownKey {
        /// Where the key stands.
        place: Place,
        /// The key with its section in front.
        key: String,
        /// What may stand there.
        known: Vec<String>,
    },
    /// A section nobody declared.
    #[error("{place}: unknown section {section}{}; known: {}", suggestion(.section, .known), .known.join(", "))]
    UnknownSection {
        /// Where its name stands.
        place: Place,
        /// Its name, dots included.
        section: String,
        /// The sections there are.
        known: Vec<String>,
    },
    /// A value of another kind than the key's.
    #[error("{place}: {key} should be {expected}, found {found}")]
    WrongType {
        /// Where the value stands.
        place: Place,
        /// The key with its section in front.
        key: String,
        /// The kind the key asks for.
        expected: String,
        /// The kind that was there.
        found: String,
    },
    /// A number beyond the key's range.
    #[error("{place}: {key} = {value} is out of range; allowed: {allowed}")]
    OutOfRange {
        /// Where the value stands.
        place: Place,
        /// The key with its section in front.
        key: String,
        /// The value, as read.
        value: String,
        /// The range, in words.
        allowed: String,
    },
    /// NaN or an infinity, which no key takes, whatever its range.
    #[error("{place}: {key} = {value} is not a finite number")]
    NotFinite {
        /// Where the value stands.
        place: Place,
        /// The key with its section in front.
        key: String,
        /// The value, as read.
        value: f64,
    },
    /// A name that is none of the key's choices.
    #[error("{place}: {key} = {value:?} is not a choice{}; allowed: {}", suggestion(.value, .known), .known.join(", "))]
    UnknownChoice {
        /// Where the value stands.
        place: Place,
        /// The key with its section in front.
        key: String,
        /// The name that was there.
        value: String,
        /// The names there are.
        known: Vec<String>,
    },
}

/// Where a key or a value was given.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Place {
    /// In a file. Lines and columns count from one, columns in characters.
    File {
        /// The name the document was parsed under.
        file: Arc<str>,
        /// The line.
        line: u32,
        /// The column.
        column: u32,
    },
    /// In a flag.
    CommandLine,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { file, line, column } => write!(f, "{file}:{line}:{column}"),
            Self::CommandLine => f.write_str("command line"),
        }
    }
}

fn last(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}

fn suggestion(word: &str, known: &[String]) -> String {
    match nearest(word, known) {
        Some(name) => format!(" (did you mean {name}?)"),
        None => String::new(),
    }
}

/// The known name fewest slips away, if that is at most a third of its letters: further off, a suggestion misleads.
fn nearest<'a>(word: &str, known: &'a [String]) -> Option<&'a str> {
    let slips = |name: &&String| distance(word, name);
    let name = known.iter().min_by_key(slips)?;
    (distance(word, name) <= name.chars().count().div_ceil(3)).then_some(name)
}

/// Levenshtein's distance: how many letters to insert, drop or replace to turn one word into the other.
fn distance(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, a) in from.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in to.iter().enumerate() {
            let replaced = diagonal + usize::from(a != *b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[to.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_counts_letters_inserted_dropped_and_replaced() {
        assert_eq!(distance("", "law"), 3);
        assert_eq!(distance("law", "law"), 0);
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("tiemout_ms", "timeout_ms"), 2);
    }

    #[test]
    fn a_slip_is_recognised_and_a_different_word_is_not() {
        let known = ["timeout_ms".to_owned(), "law".to_owned()];
        assert_eq!(nearest("tiemout_ms", &known), Some("timeout_ms"));
        assert_eq!(nearest("lwa", &known), None);
        assert_eq!(nearest("lav", &known), Some("law"));
        assert_eq!(nearest("colour", &known), None);
        assert_eq!(nearest("law", &[]), None);
    }
}
