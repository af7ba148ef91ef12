//! The crate seen from outside, a story per module: one program, since each links everything below it.

mod evidence;
mod full_disk;
mod journals;
mod live_viewer;
mod mixture;
mod properties;
mod reader;
mod scenarios;
mod script;
mod session_file;
mod sinks;
mod urdf;
mod view;
