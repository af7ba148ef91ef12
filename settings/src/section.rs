//! One declaration per key, and all that follows from it.

use crate::document::Found;
use crate::error::Error;

/// The settings of one part of Tandem: a struct that knows the keys it is read from. [`settings!`](crate::settings)
/// declares one.
pub trait Section: Default {
    /// What stands between the brackets in the file.
    const NAME: &'static str;
    /// What the section is for: the struct's own documentation.
    const DOC: &'static str;

    /// The keys, in the order they were declared.
    fn keys() -> Vec<Key<Self>>;
}

/// One key of a section, as it was declared.
pub struct Key<S> {
    /// Its name, which is the field's.
    pub name: &'static str,
    /// What it means and in which unit: the field's own documentation.
    pub doc: &'static str,
    /// What it may be, in words; nothing if its type says it all.
    pub allowed: Option<String>,
    /// Puts what was found into the field, once checked.
    pub read: fn(&mut S, &Found) -> Result<(), Error>,
    /// The field in TOML.
    pub write: fn(&S) -> String,
}

/// The section as commented TOML: for every key its documentation, what is allowed, the default where another value
/// stands, and the value. Whatever a section has read, its print reads back the same.
pub fn show<S: Section>(settings: &S) -> String {
    show_at(S::NAME, settings)
}

/// The same under another name than its own: one of several that have the same keys.
pub fn show_at<S: Section>(section: &str, settings: &S) -> String {
    let default = S::default();
    let mut text = comment(S::DOC);
    text.push_str(&format!("[{section}]\n"));
    for key in S::keys() {
        let (value, usual) = ((key.write)(settings), (key.write)(&default));
        let allowed = key.allowed.map(|allowed| format!("allowed: {allowed}"));
        let usual = (value != usual).then(|| format!("default: {usual}"));
        let notes: Vec<String> = allowed.into_iter().chain(usual).collect();
        text.push('\n');
        text.push_str(&comment(key.doc));
        text.push_str(&comment(&notes.join("; ")));
        text.push_str(&format!("{} = {value}\n", key.name));
    }
    text
}

fn comment(text: &str) -> String {
    text.lines()
        .map(|line| format!("# {}", line.trim()).trim_end().to_owned() + "\n")
        .collect()
}

/// Declares a section: a struct whose fields are keys.
///
/// ```
/// tandem_settings::settings! {
///     /// Where the recorder writes.
///     #[derive(Eq)]
///     pub struct RecorderSettings("recorder") {
///         /// The folder sessions go to.
///         pub folder: String = "sessions";
///         /// How many seconds may be lost when the power fails.
///         pub chunk_s: u32 = 1, in 1..=60;
///     }
/// }
/// ```
///
/// A field reads `name: type = default, in range;` where the range may be left out. Its type is `bool`, `f64`, an
/// integer, `String`, a [`Choice`](crate::Choice), a `Vec` or an array of these; the range of an array is that of each
/// element. A nested section has dots in its name: `("link.tls")`. The struct is `Clone`, `Debug` and `PartialEq`
/// without asking, and further derives may stand above it. That a default lies in its own range is not checked here:
/// a test that reads back what [`show`](crate::show) prints of the default finds one that does not.
#[macro_export]
macro_rules! settings {
    ($(#[$($attribute:tt)*])* $vis:vis struct $section:ident($name:literal) {
        $(
            $(#[$($field_attribute:tt)*])*
            $field_vis:vis $field:ident: $type:ty = $default:expr $(, in $range:expr)?;
        )*
    }) => {
        $(#[$($attribute)*])*
        #[derive(Clone, Debug, PartialEq)]
        $vis struct $section {
            $($(#[$($field_attribute)*])* $field_vis $field: $type,)*
        }

        impl ::core::default::Default for $section {
            fn default() -> Self {
                Self { $($field: <$type as $crate::Value>::from_literal(&$default),)* }
            }
        }

        impl $crate::Section for $section {
            const NAME: &'static str = $name;
            const DOC: &'static str = ::core::concat!($($crate::doc_line!($($attribute)*)),*);

            fn keys() -> ::std::vec::Vec<$crate::Key<Self>> {
                ::std::vec![$($crate::Key {
                    name: ::core::stringify!($field),
                    doc: ::core::concat!($($crate::doc_line!($($field_attribute)*)),*),
                    allowed: <$type as $crate::Value>::allowed(&$crate::Limits::any()$(.within($range))?),
                    read: |section, found| {
                        let limits = $crate::Limits::any()$(.within($range))?;
                        section.$field = <$type as $crate::Value>::read(found, &limits)?;
                        ::core::result::Result::Ok(())
                    },
                    write: |section| $crate::Value::to_toml(&section.$field),
                }),*]
            }
        }
    };
}

/// The text of one attribute if it is a line of documentation, else nothing.
#[doc(hidden)]
#[macro_export]
macro_rules! doc_line {
    (doc = $line:literal) => {
        ::core::concat!($line, "\n")
    };
    ($($other:tt)*) => {
        ""
    };
}
