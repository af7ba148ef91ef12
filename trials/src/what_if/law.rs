//! A law as people write it.

use std::fmt;
use std::str::FromStr;

use tandem_arbiter::{ArbiterSettings, LawName};
use tandem_settings::Choice as _;

/// A law by name, as in `fixed` or `constant=0.3`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LawChoice {
    /// Which.
    pub law: LawName,
    /// The human's weight, for the constant law.
    pub weight: Option<f64>,
}

impl LawChoice {
    /// The law of an arbiter.
    #[must_use]
    pub fn of(settings: &ArbiterSettings) -> Self {
        Self {
            law: settings.law,
            weight: (settings.law == LawName::Constant).then_some(settings.constant_weight),
        }
    }
}

impl FromStr for LawChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, weight) = match text.split_once('=') {
            Some((name, weight)) => (name, Some(weight)),
            None => (text, None),
        };
        let law = LawName::ALL.iter().copied().find(|law| law.name() == name);
        let weight = weight.map(|weight| weight.parse().ok().filter(|weight| (0.0..=1.0).contains(weight)));
        match (law, weight) {
            (Some(law @ LawName::Constant), Some(weight @ Some(_))) => Ok(Self { law, weight }),
            (Some(law), None) if law != LawName::Constant => Ok(Self { law, weight: None }),
            _ => {
                let plain = LawName::ALL.iter().filter(|law| **law != LawName::Constant);
                let plain: Vec<_> = plain.map(|law| law.name()).collect();
                let constant = LawName::Constant.name();
                Err(format!(
                    "choose {}, or {constant}=W with W from 0 to 1",
                    plain.join(", ")
                ))
            }
        }
    }
}

impl fmt::Display for LawChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.law.name())?;
        self.weight.map_or(Ok(()), |weight| write!(f, "={weight}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_law_of_the_settings_is_read_as_it_is_written() {
        for law in LawName::ALL {
            let text = match law {
                LawName::Constant => "constant=0.3",
                law => law.name(),
            };
            let read: LawChoice = text.parse().expect("a law");
            assert_eq!((read.law, read.to_string().as_str()), (*law, text));
        }
    }

    #[test]
    fn what_is_no_law_is_answered_with_all_that_are() {
        for text in [
            "constant",
            "constant=2",
            "constant=NaN",
            "constant=",
            "fixed=0.3",
            "fuzzy",
            "",
        ] {
            let why = text.parse::<LawChoice>().expect_err("no law");
            assert_eq!(
                why,
                "choose adaptive, fixed, human, robot, attentive, or constant=W with W from 0 to 1"
            );
        }
    }
}
