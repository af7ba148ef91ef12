//! Text in, checked settings out: how `tandem.toml` and the command line become values that cannot be wrong.
//!
//! A key is declared once, in [`settings!`], with its name, documentation, default and allowed range. From that one
//! line come the struct field and its docs, [`Default`], the reader with its errors, and the commented TOML that
//! [`show`] prints. Nothing else in the house spells a key, so nothing can disagree with it.
//!
//! ```
//! use tandem_settings::{Document, Section, choices, settings, show};
//!
//! choices! {
//!     /// Who gives the weight ω.
//!     pub enum Law {
//!         /// The width of the forecast's interval does.
//!         Adaptive = "adaptive",
//!         /// A constant does.
//!         Fixed = "fixed",
//!     }
//! }
//!
//! settings! {
//!     /// What the arbiter may do.
//!     pub struct ArbiterSettings("arbiter") {
//!         /// How long a command stream may be silent before motion stops, in milliseconds.
//!         pub timeout_ms: f64 = 100.0, in 20.0..=2000.0;
//!         /// The sharing law.
//!         pub law: Law = Law::Adaptive;
//!         /// Where the tool starts, in metres in the base frame.
//!         pub start_m: [f64; 3] = [0.5, -0.3, 0.15], in -2.0..=2.0;
//!         /// What the reservoir is drawn from.
//!         pub seed: u64 = 1;
//!         /// Addresses to listen on besides the usual one.
//!         pub listen: Vec<String> = [];
//!     }
//! }
//!
//! let text = "[arbiter]\ntimeout_ms = 250\n";
//! let mut document = Document::parse("tandem.toml", text)?;
//! document.set("arbiter.law", "fixed"); // as `--law fixed` does
//! let arbiter: ArbiterSettings = document.section()?;
//! document.finish(&[ArbiterSettings::NAME, "link.tls"])?;
//! assert_eq!(arbiter.timeout_ms, 250.0);
//! assert_eq!(arbiter.law, Law::Fixed);
//! assert_eq!(Document::parse("shown", &show(&arbiter))?.section::<ArbiterSettings>()?, arbiter);
//!
//! document.set("arbiter.timeout_ms", "5");
//! let refused = document.section::<ArbiterSettings>().unwrap_err();
//! assert_eq!(refused.to_string(), "command line: arbiter.timeout_ms = 5 is out of range; allowed: 20 to 2000");
//! # Ok::<(), tandem_settings::Error>(())
//! ```
//!
//! The print-out begins
//!
//! ```toml
//! # What the arbiter may do.
//! [arbiter]
//!
//! # How long a command stream may be silent before motion stops, in milliseconds.
//! # allowed: 20 to 2000; default: 100.0
//! timeout_ms = 250.0
//!
//! # The sharing law.
//! # allowed: "adaptive", "fixed"; default: "adaptive"
//! law = "fixed"
//! ```
//!
//! What a section has read, [`show`] prints and a section reads again, bit for bit; that is how settings travel inside
//! a recording. The crate refuses to know which sections exist, where the file lies, and what any key means: rules
//! that tie two keys together belong to the node that owns both. It follows TOML 1.1 as the `toml` crate parses it.
//!
//! Start reading in `section.rs` for the declaration, `value.rs` for what may stand right of the `=`, `document.rs` for
//! the text, and `error.rs` for every way it can be wrong.

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod document;
mod error;
mod limits;
mod section;
mod value;

pub use document::{Document, Found};
pub use error::{Error, Place};
pub use limits::Limits;
pub use section::{Key, Section, show, show_at};
pub use value::{Choice, Value};
