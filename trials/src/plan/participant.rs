//! Who takes part: a code and no name.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{is_name, shortened};

/// A participant's code: 1 to 32 of `a–z A–Z 0–9 _ -`, so that it can stand anywhere.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Participant(String);

/// Why a text is no participant's code.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{code:?} is no participant's code: use 1 to {CODE_MAX} letters (a to z), digits, '-' or '_'")]
pub struct BadCode {
    /// The text, or its beginning.
    pub code: String,
}

const CODE_MAX: usize = 32;

impl Participant {
    /// The code.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The number at the code's end, less one: `P07` is the seventh, 6. Without one, a number made from the letters.
    pub(super) fn place(&self) -> u64 {
        let head = self.0.trim_end_matches(|letter: char| letter.is_ascii_digit());
        match self.0[head.len()..].parse::<u64>() {
            Ok(number) => number.saturating_sub(1),
            Err(_) => self.0.bytes().fold(0, |sum, byte| sum * 31 % 9973 + u64::from(byte)),
        }
    }
}

impl FromStr for Participant {
    type Err = BadCode;

    fn from_str(code: &str) -> Result<Self, BadCode> {
        if is_name(code, CODE_MAX) {
            Ok(Self(code.to_owned()))
        } else {
            let code = shortened(code);
            Err(BadCode { code })
        }
    }
}

impl TryFrom<String> for Participant {
    type Error = BadCode;

    fn try_from(code: String) -> Result<Self, BadCode> {
        code.parse()
    }
}

impl From<Participant> for String {
    fn from(participant: Participant) -> Self {
        participant.0
    }
}

impl fmt::Display for Participant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_codes_are_refused_and_shown_harmlessly() {
        let long = "x".repeat(10_000);
        for code in [
            "",
            ".",
            "..",
            "../P1",
            "P/1",
            "P\\1",
            "P 1",
            "P\n1",
            "Pä",
            "P\u{202e}1",
            "P\0",
            &long,
        ] {
            let refused = code.parse::<Participant>().unwrap_err().to_string();
            assert!(
                refused.len() < 250 && !refused.contains(['\n', '\0', '\u{202e}']),
                "{refused}"
            );
        }
        for code in ["P1", "p_01-x", "7", &"x".repeat(32)] {
            assert_eq!(code.parse::<Participant>().unwrap().as_str(), code);
        }
        assert!(serde_json::from_str::<Participant>("\"../P1\"").is_err());
    }

    #[test]
    fn a_code_s_number_says_its_place() {
        let place = |code: &str| code.parse::<Participant>().unwrap().place();
        assert_eq!([place("P1"), place("P07"), place("12"), place("P0")], [0, 6, 11, 0]);
        assert_ne!(place("desk"), place("bench"));
        assert!(place("P99999999999999999999999") < 10_000);
    }
}
