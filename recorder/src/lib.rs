//! The recorder: hears everything that is said about one robot, keeps it in a session file, and shows it in Rerun.
//!
//! | in | out |
//! | --- | --- |
//! | every topic of the robot, as bytes | [`Output::Write`]: to the session file, everything, in the order it came |
//! | a node appears or vanishes | [`Output::Show`]: to the views, what is new to the eye |
//! | the counts are due; the process ends | both: notes for people, and counts of what was missed |
//! | how the session file is doing, from the shell | [`Output::Say`]: to whoever listens, when something is wrong with it |
//!
//! ```text
//!                first message                  Stop
//!     Silent ───────────────────▶ Hearing ─────────────▶ Closed
//!       ▲                           │
//!       └── counts, a second later ─┘
//! ```
//!
//! The [`Recorder`] is the pure node: it counts gaps, repetitions and unreadable samples ([`Counts`]), notices what a
//! person wants to read ([`Note`]: trials, stops with their reason, contact, losses), and passes everything on. The
//! only thing it publishes is that the session file is in trouble. Two pure translations follow: [`SessionFile`] is the shape of an MCAP file, [`View`] turns
//! messages into Rerun entities, alike for a live viewer, an `.rrd` file and replay. [`Sinks`] is the shell's part:
//! every file and viewer has a thread behind a bounded queue, so that none of them can hold up the node. What does
//! not fit is dropped, counted and shown.
//!
//! [`Recording`] reads a session file back, damaged or not, [`Reel`] single messages of one too long for memory, and
//! [`repair`] makes a damaged one whole.
//!
//! The recorder refuses to know how messages travel, what a robot's joints are, and whether what it hears is good:
//! it never takes part in a decision.
//!
//! Session files are MCAP (<https://mcap.dev>) with Foxglove's and our own self-describing protobuf; views are Rerun
//! 0.36. Start reading at [`Heard`], then [`Recorder`].

#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod arm;
mod budget;
mod config;
mod evidence;
mod filling;
mod heard;
mod node;
mod ports;
mod reader;
mod session_file;
mod sinks;
mod tally;
mod urdf;
mod view;
mod watch;

pub use budget::{Basis, Budget, Hop, HopBudget, Offset, Percentiles};
pub use config::{BadSettings, Live, RecorderConfig, RecorderSettings, ViewTarget};
pub use evidence::{Evidence, Fault, NoEvidence, RecordedNode, Run};
pub use heard::{Entry, Heard, JournalPart, Level, Note, Sample};
pub use node::{Event, Output, Recorder};
pub use reader::{
    ChannelRead, Damage, Keep, NodeRecord, Noted, OffsetRead, PLAYED, PartsReader, Place, ReadError, Recorded,
    Recording, Reel, ReelError, Repair, RepairError, Repaired, repair,
};
pub use session_file::{JOURNAL_ENCODING, Provenance, SessionFile, WriteError};
pub use sinks::{
    Closed, Drops, Ended, Heading, Lost, Notice, OpenError, Sinks, find_viewer, is_viewer_listening, part_path,
    save_what_if,
};
pub use tally::{ClockOffset, Counts, Gap, JournalCount, StreamCount};
pub use urdf::{Urdf, UrdfError};
pub use view::what_if::Side;
pub use view::{Drawing, Moment, View};
