//! The files in which nodes kept their journals, found in a folder.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::Context as _;
use tandem_recorder::JournalPart;
use tandem_wire::NodeName;

/// All parts of all journals in `folder`, in the order in which they were written. What cannot be read is said.
pub(super) fn read(folder: &Path) -> anyhow::Result<Vec<JournalPart>> {
    let cannot = || format!("cannot read the folder {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(cannot)? {
        let path = entry.with_context(cannot)?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if let Some((node, run, number)) = name.and_then(parse) {
            files.push((node, run, number, path));
        }
    }
    files.sort();
    let mut all = Vec::new();
    for (node, .., path) in files {
        let cannot = || format!("cannot read {}", path.display());
        let file = BufReader::new(File::open(&path).with_context(cannot)?);
        let (parts, is_whole) = JournalPart::read_kept(node, file).with_context(cannot)?;
        if !is_whole {
            eprintln!("session: {} breaks off; what is whole of it is used", path.display());
        }
        all.extend(parts);
    }
    Ok(all)
}

/// A file's name is `NODE-RUN.NUMBER.journal`.
fn parse(name: &str) -> Option<(NodeName, String, u64)> {
    let (whose, number) = name.strip_suffix(".journal")?.rsplit_once('.')?;
    let (node, run) = whose.rsplit_once('-')?;
    let node = NodeName::ALL.into_iter().find(|known| known.as_str() == node)?;
    Some((node, run.to_owned(), number.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_says_whose_journal_it_is_and_which_file_of_it() {
        let read = parse("robot-sim-00000000000000ff.10.journal");
        assert_eq!(read, Some((NodeName::RobotSim, "00000000000000ff".to_owned(), 10)));
        for other in [
            "notes.txt",
            "nobody-1.0.journal",
            "arbiter-1.journal",
            "arbiter.0.journal",
        ] {
            assert_eq!(parse(other), None, "{other}");
        }
    }
}
