//! Who goes first where threads share a core.

/// How far back: a thread of this rank gets a tenth of what one that controls gets, where both want all of a core.
const BACK: i32 = 10;

/// Lets the calling thread, and all that it starts from then on, stand back for those that control: for what is only for
/// the record or for show. Nothing needs it to be right; where the system does not know ranks of single threads, nothing
/// happens.
pub fn stand_back() {
    // Elsewhere it would be the whole process that stands back.
    #[cfg(target_os = "linux")]
    // One who may not stand back stays where they are.
    let _ = rustix::process::nice(BACK);
}
