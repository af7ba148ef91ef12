//! A small sweep: what it finds, that it keeps it, and what it refuses.

use std::num::NonZeroUsize;

use crate::support::model;
use tandem_settings::Document;
use tandem_trials::sweep::{Grid, Store, StoreError, Summary, svg, table, text, work_off};

const SMALL: &str = "[sweep]\nhumans = [\"pursuit\"]\ndepartures_mm = [0, 60]\nseeds = 2\n\
                     inside_m = [0.1]\noutside_m = [0.18]\nlaws = [\"human\", \"constant=0.1\", \"adaptive\"]\n";

fn grid(text: &str) -> Grid {
    Grid::from_document(&Document::parse("plan", text).expect("TOML"), model()).expect("a grid")
}

fn refused(text: &str) -> String {
    let grid = Grid::from_document(&Document::parse("plan", text).expect("TOML"), model());
    grid.err().expect("it is refused").to_string()
}

fn threads(count: usize) -> NonZeroUsize {
    NonZeroUsize::new(count).expect("not none")
}

#[test]
fn a_sweep_that_is_cut_short_goes_on_and_comes_to_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = grid(SMALL);
    let store = Store::open(folder.path(), &grid).expect("a store");
    let first = work_off(&grid, &store, threads(1), |done, _| done < 5).expect("it runs");
    assert!((5..8).contains(&first.len()), "{}", first.len());
    assert_eq!(Summary::of(&grid, &first).missing_cells, 12 - first.len());

    let store = Store::open(folder.path(), &grid).expect("the same store");
    let mut seen = Vec::new();
    let all = work_off(&grid, &store, threads(2), |done, all| {
        seen.push((done, all));
        true
    });
    let all = all.expect("it runs");
    assert_eq!(
        seen.first(),
        Some(&(first.len(), 12)),
        "what was done does not run again"
    );
    assert_eq!(seen.last(), Some(&(12, 12)));

    let elsewhere = tempfile::tempdir().expect("a folder");
    let fresh = Store::open(elsewhere.path(), &grid).expect("a store");
    let again = work_off(&grid, &fresh, threads(2), |_, _| true).expect("it runs");
    assert!(all == again, "neither threads nor interruptions change a number");
}

#[test]
fn every_group_is_told_and_every_law_is_compared() {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = grid(SMALL);
    let store = Store::open(folder.path(), &grid).expect("a store");
    let results = work_off(&grid, &store, threads(2), |_, _| true).expect("it runs");
    let summary = Summary::of(&grid, &results);
    assert_eq!(summary.trials, 2 * 3 * 2 * 2);
    assert_eq!(summary.groups.len(), 2 * 2 * 3);
    assert_eq!(summary.contests.len(), 2, "the adaptive law against the two others");
    assert_eq!(summary.rulings.len(), 4);
    let contest = &summary.contests[0];
    assert_eq!(contest.effort.iter().sum::<usize>(), 4, "each group is one verdict");
    let group = |law: &str, departure_mm: f64| {
        let found = summary
            .groups
            .iter()
            .find(|group| group.law == law && group.departure_mm == departure_mm);
        found.expect("the group is there")
    };
    let effort = |law: &str| group(law, 0.0).effort_m_s.expect("an effort").mean;
    assert!(
        effort("constant=0.1") < 0.8 * effort("human"),
        "a robot that is right spares the human: {} of {}",
        effort("constant=0.1"),
        effort("human")
    );
    let error = |law: &str| group(law, 60.0).wish_error_m.expect("an error").mean;
    assert!(error("human") < error("constant=0.1"), "who departs is held back");
    for words in [table(&grid, &summary), text(&grid, &summary), svg(&grid, &summary)] {
        assert!(
            words.contains("adaptive") && words.contains("constant=0.1") && !words.contains("NaN"),
            "{words}"
        );
    }
}

#[test]
fn a_damaged_cell_runs_again_and_another_sweeps_folder_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let grid = grid(SMALL);
    let store = Store::open(folder.path(), &grid).expect("a store");
    let cell = grid.cells().next().expect("a cell");
    let result = grid.run(cell).expect("it runs");
    store.keep(&grid, &result).expect("it is kept");
    assert!(store.load(&grid, cell) == Some(result));
    let path = folder.path().join("cells").join(format!("{}.json", grid.name(cell)));
    let whole = std::fs::read(&path).expect("the cell's file");
    std::fs::write(&path, &whole[..whole.len() / 2]).expect("half of it");
    assert!(store.load(&grid, cell).is_none());

    let other = self::grid(&SMALL.replace("seeds = 2", "seeds = 3"));
    let refused = Store::open(folder.path(), &other).expect_err("it is another one");
    assert!(matches!(refused, StoreError::AnotherGrid { .. }), "{refused}");
    assert!(refused.to_string().contains("seeds = 2"), "{refused}");
}

#[test]
fn a_grid_that_makes_no_sense_is_refused_by_name() {
    for (change, with, said) in [
        ("\"adaptive\"", "\"adptive\"", "adptive"),
        ("constant=0.1", "constant", "say which weight"),
        ("constant=0.1", "constant=7", "0 to 1"),
        ("constant=0.1", "human=0.1", "only a constant"),
        ("\"adaptive\"", "\"adaptive; arbiter.weight_flor=1\"", "weight_flor"),
        ("\"adaptive\"", "\"adaptive; floor\"", "KEY=VALUE"),
        ("[0, 60]", "[]", "departures_mm is empty"),
        ("seeds = 2", "seeds = 0", "seeds"),
        ("seeds = 2", "sedes = 2", "sedes"),
    ] {
        let refused = refused(&SMALL.replace(change, with));
        assert!(refused.contains(said), "{with}: {refused}");
    }
}
