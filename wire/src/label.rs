//! A name in words, short enough to travel in every message.

use std::fmt;

use bincode::{Decode, Encode};

/// The longest name, in bytes of UTF-8.
pub const LABEL_BYTES: usize = 24;

/// Who somebody says they are: for people to read, never to decide by.
///
/// At most [`LABEL_BYTES`] bytes; what is longer is cut at a letter. Whatever bytes arrive can be shown: control characters
/// and broken letters are replaced.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash, Encode, Decode)]
pub struct Label([u8; LABEL_BYTES]);

impl Label {
    /// The name, cut to what fits.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let mut bytes = [0; LABEL_BYTES];
        let mut end = name.len().min(LABEL_BYTES);
        while !name.is_char_boundary(end) {
            end -= 1;
        }
        bytes[..end].copy_from_slice(&name.as_bytes()[..end]);
        Self(bytes)
    }

    /// Whether it says nothing.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0[0] == 0
    }
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = self.0.iter().position(|byte| *byte == 0).unwrap_or(LABEL_BYTES);
        let text = String::from_utf8_lossy(&self.0[..end]);
        let shown = text
            .chars()
            .map(|letter| if letter.is_control() { '\u{fffd}' } else { letter });
        f.write_str(&shown.collect::<String>())
    }
}

impl fmt::Debug for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_cut_at_a_letter_and_any_bytes_can_be_shown() {
        assert_eq!(Label::new("ada").to_string(), "ada");
        assert_eq!(Label::new(&"ü".repeat(20)).to_string(), "ü".repeat(12));
        assert_eq!(Label::new("a\u{1b}[2Jb").to_string(), "a\u{fffd}[2Jb");
        assert_eq!(Label([0xff; LABEL_BYTES]).to_string(), "\u{fffd}".repeat(LABEL_BYTES));
        assert!(Label::default().is_empty() && !Label::new("x").is_empty());
    }
}
