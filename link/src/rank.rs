//! Who goes first where processes share a core.

/// How far back: a process of this rank gets a tenth of what one that controls gets, where both want all of a core.
const BACK: i32 = 10;

/// Lets the calling thread, and all that it starts from then on, stand back for those that control. For the first thread of a
/// process that only records or shows: a thread beside control must not stand back, for it may hold a lock of Zenoh's that
/// control waits for, and be kept from giving it away by any other program.
///
/// Nothing needs it to be right; where the system does not know ranks of single threads, nothing happens.
pub fn stand_back() {
    // Elsewhere it would be the whole process that stands back.
    #[cfg(target_os = "linux")]
    // One who may not stand back stays where they are.
    let _ = rustix::process::nice(BACK);
}
