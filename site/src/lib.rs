//! A site: the machines, people and robots that trust each other, their certificates, and who may do what.
//!
//! A site is a folder. `site.toml` is its roster ([`Roster`]): every member, its role and its robots, in the open.
//! `ca.pem` is the authority that signed each member's certificate, `MEMBER.pem`; `MEMBER.key` is that member's secret
//! and `ca.key` the site's own. A machine holds the roster, `ca.pem` and the two files of the members it runs;
//! whoever issues certificates holds `ca.key` as well, on no machine that drives a robot.
//!
//! ```text
//!   tandem keys ──▶ Authority ──▶ site.toml ca.pem arbiter.pem arbiter.key …
//!                                     │
//!   tandem NODE --site DIR ──▶ Site ──┴▶ Identity ──▶ what Zenoh is told: tls, access_control
//! ```
//!
//! It refuses to know Zenoh: [`policy`] says in Zenoh's own words what each member may do, as text, and `tandem-link`
//! hands that over. Whether a certificate holds is asked of rustls, which Zenoh asks as well, so that the answer here is
//! the answer there.
//!
//! There is no revocation list on the wire. A common name is never given twice, a roster that does not list it as
//! trusted gives it nothing, and whoever listens enforces its own roster.
//!
//! Start reading at [`Site`].

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod authority;
mod certificate;
mod copy;
mod files;
mod folder;
mod knock;
pub mod policy;
mod roster;
mod trust;

pub use authority::{Authority, NewMember, Validity};
pub use certificate::{Certificate, Day};
pub use files::{Exposed, write_public, write_secret};
pub use folder::{CA_CERTIFICATE, CA_KEY, Identity, ROSTER, Site, SiteError};
pub use knock::{Knock, knock, touch};
pub use roster::{BadRoster, Member, Name, Revocation, Robots, Role, Roster};
pub use trust::{Distrust, client_configuration, trusts_as_client, trusts_as_server};
