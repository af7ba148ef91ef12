//! A recorded session for tests that read one.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::Process;

/// One demo in lockstep, recorded once for all tests of a file.
pub(crate) fn session() -> PathBuf {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("demo.mcap");
        let demo = Process::output(&["demo", "--pace", "max", "--seed", "5", "--record", text(&path)]);
        assert!(demo.status.success(), "{}", String::from_utf8_lossy(&demo.stderr));
        folder
    });
    folder.path().join("demo.mcap")
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}
