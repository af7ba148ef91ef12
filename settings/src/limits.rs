//! The range a number may lie in, and its words.

use std::fmt::Debug;
use std::ops::{Bound, RangeBounds};

/// The range of one key: what stands behind `in` in its declaration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits<T> {
    low: Bound<T>,
    high: Bound<T>,
}

impl<T: Copy + PartialOrd + Debug> Limits<T> {
    /// No limits.
    pub fn any() -> Self {
        Self {
            low: Bound::Unbounded,
            high: Bound::Unbounded,
        }
    }

    /// The limits of `range`, which may be any of Rust's ranges, or a pair of [`Bound`]s to leave the low end out.
    pub fn within(self, range: impl RangeBounds<T>) -> Self {
        Self {
            low: range.start_bound().cloned(),
            high: range.end_bound().cloned(),
        }
    }

    /// These limits with open ends closed by what the type itself can hold.
    pub(crate) fn or(self, least: T, most: T) -> Self {
        let closed = |end, otherwise| {
            if matches!(end, Bound::Unbounded) {
                Bound::Included(otherwise)
            } else {
                end
            }
        };
        Self {
            low: closed(self.low, least),
            high: closed(self.high, most),
        }
    }

    pub(crate) fn contain(&self, value: T) -> bool {
        (self.low, self.high).contains(&value)
    }

    /// The range in words, such as `20 to 2000` or `above 0, at most 1`; nothing if there are no limits.
    pub(crate) fn words(&self) -> Option<String> {
        let low = match self.low {
            Bound::Included(low) => Some(format!("at least {}", plain(low))),
            Bound::Excluded(low) => Some(format!("above {}", plain(low))),
            Bound::Unbounded => None,
        };
        let high = match self.high {
            Bound::Included(high) => Some(format!("at most {}", plain(high))),
            Bound::Excluded(high) => Some(format!("below {}", plain(high))),
            Bound::Unbounded => None,
        };
        match (self.low, self.high) {
            (Bound::Included(low), Bound::Included(high)) => Some(format!("{} to {}", plain(low), plain(high))),
            _ => low.into_iter().chain(high).reduce(|low, high| format!("{low}, {high}")),
        }
    }
}

/// A number as people write it: shortest digits that name it exactly, no `.0`, an exponent once it is far from one.
pub(crate) fn plain(number: impl Debug) -> String {
    let digits = format!("{number:?}");
    digits.strip_suffix(".0").unwrap_or(&digits).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_range_has_its_words() {
        let words = |limits: Limits<f64>| limits.words();
        assert_eq!(words(Limits::any()), None);
        assert_eq!(
            words(Limits::any().within(20.0..=2000.0)).as_deref(),
            Some("20 to 2000")
        );
        assert_eq!(
            words(Limits::any().within(0.0..1.0)).as_deref(),
            Some("at least 0, below 1")
        );
        assert_eq!(words(Limits::any().within(1e-9..)).as_deref(), Some("at least 1e-9"));
        assert_eq!(words(Limits::any().within(..=1e300)).as_deref(), Some("at most 1e300"));
        let leak = (Bound::Excluded(0.0), Bound::Included(1.0));
        assert_eq!(words(Limits::any().within(leak)).as_deref(), Some("above 0, at most 1"));
    }

    #[test]
    fn nan_lies_in_no_closed_range() {
        assert!(!Limits::any().within(0.0..=1.0).contain(f64::NAN));
    }
}
