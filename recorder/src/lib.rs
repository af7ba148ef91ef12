//! wip
#![forbid(unsafe_code)]
mod arm;
mod config;
mod heard;
mod node;
mod ports;
mod tally;
pub use config::*;
pub use heard::*;
pub use node::*;
pub use tally::*;
mod session_file;
mod sinks;
mod view;
pub use view::*;
pub use session_file::*;
pub use sinks::*;
