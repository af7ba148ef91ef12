//! What may stand right of the `=`: one [`Value`] per type a setting can have.

use std::convert::Infallible;
use std::fmt::Debug;

use crate::document::{Found, Raw};
use crate::error::Error;
use crate::limits::{Limits, plain};

/// A type that a setting can have: read from TOML within limits, and written back so that it reads the same.
///
/// A type of one's own is a [`Choice`], or hands each of these to the type it wraps.
pub trait Value: Sized {
    /// How a default is written in a declaration: `""` for a `String`, `[]` for a `Vec`.
    type Literal: ?Sized;
    /// What its range is made of; [`Infallible`], and so no range, for what has no order.
    type Limit: Copy + PartialOrd + Debug;

    /// The value a declaration's default stands for.
    fn from_literal(literal: &Self::Literal) -> Self;

    /// The kind of value, with its article, to follow "should be".
    fn expected() -> String;

    /// What was found, checked.
    fn read(found: &Found, limits: &Limits<Self::Limit>) -> Result<Self, Error>;

    /// The value in TOML, on one line.
    fn to_toml(&self) -> String;

    /// Which values are allowed, in words; nothing if all of the type are.
    fn allowed(limits: &Limits<Self::Limit>) -> Option<String> {
        limits.words()
    }
}

/// A closed list of names, such as the sharing laws. [`choices!`](crate::choices) declares one.
pub trait Choice: Copy + 'static {
    /// Every choice, in the order they are printed.
    const ALL: &'static [Self];

    /// What the choice is called in a settings file.
    fn name(self) -> &'static str;
}

/// Declares an enum whose variants are picked by name, each name written once:
///
/// ```
/// tandem_settings::choices! {
///     /// Where motion comes from.
///     #[derive(Hash)]
///     pub enum Source {
///         /// The first gamepad that answers.
///         Gamepad = "gamepad",
///         /// A simulated human.
///         Human = "human",
///     }
/// }
/// ```
///
/// The enum is `Copy`, `Debug` and `Eq` without asking.
#[macro_export]
macro_rules! choices {
    ($(#[$attribute:meta])* $vis:vis enum $choice:ident {
        $($(#[$variant_attribute:meta])* $variant:ident = $name:literal),+ $(,)?
    }) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $choice {
            $($(#[$variant_attribute])* $variant,)+
        }

        impl $crate::Choice for $choice {
            const ALL: &'static [Self] = &[$(Self::$variant),+];

            fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }
    };
}

impl<T: Choice> Value for T {
    type Literal = Self;
    type Limit = Infallible;

    fn from_literal(literal: &Self) -> Self {
        *literal
    }

    fn expected() -> String {
        format!("one of {}", names::<Self>())
    }

    fn read(found: &Found, _: &Limits<Infallible>) -> Result<Self, Error> {
        let name = found.text().ok_or_else(|| found.should_be(Self::expected()))?;
        let choice = Self::ALL.iter().copied().find(|choice| choice.name() == name);
        choice.ok_or_else(|| Error::UnknownChoice {
            place: found.place().clone(),
            key: found.key().to_owned(),
            value: name.to_owned(),
            known: Self::ALL.iter().map(|choice| choice.name().to_owned()).collect(),
        })
    }

    fn to_toml(&self) -> String {
        quoted(self.name())
    }

    fn allowed(_: &Limits<Infallible>) -> Option<String> {
        Some(names::<Self>())
    }
}

impl Value for bool {
    type Literal = Self;
    type Limit = Infallible;

    fn from_literal(literal: &Self) -> Self {
        *literal
    }

    fn expected() -> String {
        "true or false".to_owned()
    }

    fn read(found: &Found, _: &Limits<Infallible>) -> Result<Self, Error> {
        match found.raw() {
            Raw::Boolean(value) => Ok(*value),
            _ => Err(found.should_be(Self::expected())),
        }
    }

    fn to_toml(&self) -> String {
        self.to_string()
    }
}

impl Value for f64 {
    type Literal = Self;
    type Limit = Self;

    fn from_literal(literal: &Self) -> Self {
        *literal
    }

    fn expected() -> String {
        "a number".to_owned()
    }

    /// Takes whole numbers too. Beyond 2⁵³ they round to the nearest float, as their digits with `.0` behind would.
    fn read(found: &Found, limits: &Limits<Self>) -> Result<Self, Error> {
        let value = match found.raw() {
            Raw::Float(value) => *value,
            Raw::Integer(value) => *value as Self,
            _ => return Err(found.should_be(Self::expected())),
        };
        if !value.is_finite() {
            Err(Error::NotFinite {
                place: found.place().clone(),
                key: found.key().to_owned(),
                value,
            })
        } else if limits.contain(value) {
            Ok(value)
        } else {
            Err(out_of_range(found, value, limits))
        }
    }

    /// Rust's `Debug` gives the shortest digits that read back to the same bits, always with a point or an exponent,
    /// which TOML needs to see a float.
    fn to_toml(&self) -> String {
        format!("{self:?}")
    }
}

/// TOML's integers are `i64`, so a type that reaches further is read up to there.
macro_rules! whole_number {
    ($($integer:ty: $most:expr;)+) => {$(
        impl Value for $integer {
            type Literal = Self;
            type Limit = Self;

            fn from_literal(literal: &Self) -> Self {
                *literal
            }

            fn expected() -> String {
                "a whole number".to_owned()
            }

            fn read(found: &Found, limits: &Limits<Self>) -> Result<Self, Error> {
                let Raw::Integer(given) = found.raw() else {
                    return Err(found.should_be(Self::expected()));
                };
                let value = Self::try_from(*given).ok().filter(|value| limits.contain(*value));
                value.ok_or_else(|| out_of_range(found, *given, &limits.or(Self::MIN, $most)))
            }

            fn to_toml(&self) -> String {
                self.to_string()
            }
        }
    )+};
}

whole_number! {
    u8: u8::MAX;
    u16: u16::MAX;
    u32: u32::MAX;
    u64: i64::MAX.unsigned_abs();
    usize: usize::MAX;
    i64: i64::MAX;
}

impl Value for String {
    type Literal = &'static str;
    type Limit = Infallible;

    fn from_literal(literal: &&'static str) -> Self {
        (*literal).to_owned()
    }

    fn expected() -> String {
        "a string".to_owned()
    }

    fn read(found: &Found, _: &Limits<Infallible>) -> Result<Self, Error> {
        found
            .text()
            .map(str::to_owned)
            .ok_or_else(|| found.should_be(Self::expected()))
    }

    fn to_toml(&self) -> String {
        quoted(self)
    }
}

impl<T: Value> Value for Vec<T>
where
    T::Literal: Sized,
{
    type Literal = [T::Literal];
    type Limit = T::Limit;

    fn from_literal(literal: &[T::Literal]) -> Self {
        literal.iter().map(T::from_literal).collect()
    }

    fn expected() -> String {
        format!("an array, each {}", T::expected())
    }

    fn read(found: &Found, limits: &Limits<T::Limit>) -> Result<Self, Error> {
        match found.raw() {
            Raw::Array(elements) => elements.iter().map(|element| T::read(element, limits)).collect(),
            _ => Err(found.should_be(Self::expected())),
        }
    }

    fn to_toml(&self) -> String {
        array_to_toml(self)
    }

    fn allowed(limits: &Limits<T::Limit>) -> Option<String> {
        T::allowed(limits).map(|each| format!("each {each}"))
    }
}

impl<T: Value, const N: usize> Value for [T; N]
where
    T::Literal: Sized,
{
    type Literal = [T::Literal; N];
    type Limit = T::Limit;

    fn from_literal(literal: &[T::Literal; N]) -> Self {
        literal.each_ref().map(T::from_literal)
    }

    fn expected() -> String {
        format!("an array of {N}, each {}", T::expected())
    }

    fn read(found: &Found, limits: &Limits<T::Limit>) -> Result<Self, Error> {
        let Raw::Array(elements) = found.raw() else {
            return Err(found.should_be(Self::expected()));
        };
        let values = elements
            .iter()
            .map(|element| T::read(element, limits))
            .collect::<Result<Vec<T>, Error>>()?;
        Self::try_from(values)
            .ok()
            .ok_or_else(|| found.should_be(Self::expected()))
    }

    fn to_toml(&self) -> String {
        array_to_toml(self)
    }

    fn allowed(limits: &Limits<T::Limit>) -> Option<String> {
        Vec::<T>::allowed(limits)
    }
}

fn out_of_range<T: Copy + PartialOrd + Debug>(found: &Found, value: impl Debug, limits: &Limits<T>) -> Error {
    Error::OutOfRange {
        place: found.place().clone(),
        key: found.key().to_owned(),
        value: plain(value),
        allowed: limits.words().unwrap_or_default(),
    }
}

fn names<T: Choice>() -> String {
    T::ALL
        .iter()
        .map(|choice| quoted(choice.name()))
        .collect::<Vec<_>>()
        .join(", ")
}

fn array_to_toml<T: Value>(values: &[T]) -> String {
    let values: Vec<String> = values.iter().map(T::to_toml).collect();
    format!("[{}]", values.join(", "))
}

/// A TOML basic string. It stays on one line whatever the text holds, so that it can also stand in a comment.
fn quoted(text: &str) -> String {
    let mut quoted = String::from('"');
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            _ if letter.is_control() => quoted.push_str(&format!("\\u{:04X}", u32::from(letter))),
            _ => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}
