//! A folder that keeps what is done, so that a sweep goes on where it was cut off.
//!
//! ```text
//!   DIR/sweep.toml      the grid with everything that decides what comes out
//!   DIR/cells/*.json    one file for each finished cell, written beside and renamed: there or not there
//! ```

use std::fs;
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

use crate::Unbuildable;
use crate::sweep::cell::{Cell, CellResult};
use crate::sweep::grid::Grid;

/// Why a sweep's folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The file system refused.
    #[error("cannot use {path}", path = path.display())]
    File {
        /// What was to be read or written.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The folder holds the results of another grid.
    #[error(
        "{path} belongs to another sweep (its line {line} differs: {theirs:?}, not {ours:?}); use another folder, or remove it",
        path = path.display()
    )]
    AnotherGrid {
        /// The grid's file.
        path: PathBuf,
        /// The first line that differs.
        line: usize,
        /// What it says there.
        theirs: String,
        /// What was asked for.
        ours: String,
    },
    /// Nodes cannot be built.
    #[error(transparent)]
    Unbuildable(#[from] Unbuildable),
}

/// The folder of one sweep.
#[derive(Clone, Debug)]
pub struct Store {
    cells: PathBuf,
}

impl Store {
    /// Opens a folder for a grid: a new one, or one that holds this same sweep.
    ///
    /// # Errors
    /// If it belongs to another sweep, or cannot be read and written.
    pub fn open(folder: &Path, grid: &Grid) -> Result<Self, StoreError> {
        let cells = folder.join("cells");
        fs::create_dir_all(&cells).map_err(|source| file(&cells, source))?;
        let path = folder.join("sweep.toml");
        let ours = grid.to_toml();
        match fs::read_to_string(&path) {
            Ok(theirs) if theirs == ours => {}
            Ok(theirs) => return Err(another(path, &theirs, &ours)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => write_whole(&path, ours.as_bytes())?,
            Err(source) => return Err(file(&path, source)),
        }
        Ok(Self { cells })
    }

    /// What is known of a cell. A file that is damaged counts as none: the cell runs again.
    #[must_use]
    pub fn load(&self, grid: &Grid, cell: Cell) -> Option<CellResult> {
        let text = fs::read(self.path(grid, cell)).ok()?;
        let result: CellResult = serde_json::from_slice(&text).ok()?;
        (result.cell == cell && result.runs.len() == grid.contexts()).then_some(result)
    }

    /// Keeps what came of a cell.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&self, grid: &Grid, result: &CellResult) -> Result<(), StoreError> {
        let path = self.path(grid, result.cell);
        let text = serde_json::to_vec(result).map_err(|error| file(&path, error.into()))?;
        write_whole(&path, &text)
    }

    fn path(&self, grid: &Grid, cell: Cell) -> PathBuf {
        self.cells.join(format!("{}.json", grid.name(cell)))
    }
}

fn file(path: &Path, source: std::io::Error) -> StoreError {
    StoreError::File {
        path: path.to_owned(),
        source,
    }
}

fn another(path: PathBuf, theirs: &str, ours: &str) -> StoreError {
    let line = theirs.lines().zip(ours.lines()).take_while(|(a, b)| a == b).count();
    let at = |text: &str| text.lines().nth(line).unwrap_or_default().to_owned();
    StoreError::AnotherGrid {
        path,
        line: line + 1,
        theirs: at(theirs),
        ours: at(ours),
    }
}

/// A file under its name is whole: it is written under another one first.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), StoreError> {
    let beside = path.with_extension(format!("{}.part", std::process::id()));
    let write = || {
        let mut out = fs::File::create(&beside)?;
        out.write_all(bytes)?;
        out.sync_data()?;
        fs::rename(&beside, path)
    };
    write().map_err(|source| file(path, source))
}

/// Runs every cell that the store lacks, on `threads` threads, and gives all results in the order of [`Grid::cells`].
/// `progress` is told how many cells of how many are done, and answers whether to go on; when it does not, what is
/// done is kept and given, in the same order.
///
/// # Errors
/// If a result cannot be kept, or nodes cannot be built.
pub fn work_off(
    grid: &Grid,
    store: &Store,
    threads: NonZeroUsize,
    mut progress: impl FnMut(usize, usize) -> bool,
) -> Result<Vec<CellResult>, StoreError> {
    let cells: Vec<Cell> = grid.cells().collect();
    let mut results: Vec<Option<CellResult>> = cells.iter().map(|cell| store.load(grid, *cell)).collect();
    let open: Vec<usize> = (0..cells.len()).filter(|at| results[*at].is_none()).collect();
    let mut done = cells.len() - open.len();
    let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(!progress(done, cells.len())));
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..threads.get().min(open.len()) {
            let (sender, next, stopped, open, cells) = (sender.clone(), &next, &stopped, &open, &cells);
            scope.spawn(move || {
                while !stopped.load(Ordering::Relaxed)
                    && let Some(&at) = open.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    // Whoever gave up listens no more.
                    let _ = sender.send((at, grid.run(cells[at])));
                }
            });
        }
        drop(sender);
        for (at, result) in receiver {
            let kept = result.map_err(StoreError::from).and_then(|result| {
                store.keep(grid, &result)?;
                Ok(result)
            });
            match kept {
                Ok(result) => results[at] = Some(result),
                Err(error) => {
                    stopped.store(true, Ordering::Relaxed);
                    return Err(error);
                }
            }
            done += 1;
            if !progress(done, cells.len()) {
                stopped.store(true, Ordering::Relaxed);
            }
        }
        Ok(())
    })?;
    Ok(results.into_iter().flatten().collect())
}
