//! A section with a key of every type, and one inside another.

use std::ops::Bound;

use tandem_settings::{Document, Error, Section, choices, settings};

choices! {
    /// Who gives the weight.
    pub(crate) enum Law {
        /// The forecast does.
        Adaptive = "adaptive",
        /// A constant does.
        Fixed = "fixed",
    }
}

settings! {
    /// What the arbiter may do.
    ///
    /// One of these per arm.
    pub(crate) struct ArbiterSettings("arbiter") {
        /// How long a command stream may be silent before motion stops, in milliseconds.
        pub(crate) timeout_ms: f64 = 100.0, in 20.0..=2000.0;
        /// How fast the past is forgotten, unitless.
        pub(crate) leak: f64 = 0.3, in (Bound::Excluded(0.0), Bound::Included(1.0));
        /// A number without limits.
        pub(crate) offset: f64 = -0.0;
        /// The sharing law.
        pub(crate) law: Law = Law::Adaptive;
        /// Whether to record.
        pub(crate) record: bool = true;
        /// What to call the session.
        pub(crate) label: String = "";
        /// Where the tool starts, in metres.
        pub(crate) start_m: [f64; 3] = [0.5, -0.3, 0.15], in -2.0..=2.0;
        /// What the weights are drawn from.
        pub(crate) seed: u64 = 1;
        /// How many units the reservoir has.
        pub(crate) units: usize = 300, in 1..;
        /// The port.
        pub(crate) port: u16 = 7447;
        /// Addresses to listen on.
        pub(crate) listen: Vec<String> = ["tcp/[::]:7447"];
        /// Laws to compare.
        pub(crate) laws: Vec<Law> = [];
    }
}

settings! {
    /// The certificates.
    pub(crate) struct TlsSettings("link.tls") {
        /// Who signed them.
        pub(crate) authority: String = "";
    }
}

pub(crate) const KNOWN: &[&str] = &[ArbiterSettings::NAME, TlsSettings::NAME];

pub(crate) fn read(text: &str) -> Result<ArbiterSettings, Error> {
    let document = Document::parse("tandem.toml", text)?;
    let arbiter = document.section()?;
    document.section::<TlsSettings>()?;
    document.finish(KNOWN)?;
    Ok(arbiter)
}
