//! A sweep in words: every group as a table, and for the terminal what they come to.

use std::fmt::Write as _;

use crate::sweep::grid::Grid;
use crate::sweep::summary::{Contest, Figure, Group, Region, Ruling, Summary};

/// Every group, law by law, as a table in Markdown. Nothing is left out.
#[must_use]
pub fn table(grid: &Grid, summary: &Summary) -> String {
    let mut out = String::from(
        "Means ± standard error over seeds, after the checkpoint. `effort`: the human's velocity, mm/s. `wish`, \
         `forecast`: mean distance of the tool from the human's own wish and from the forecast, mm. `clearance`: \
         smallest distance to an obstacle, mean over trials, mm. `touched`, `goal`: share of trials that touched an \
         obstacle, that reached the goal.\n",
    );
    let heading = "law | effort | wish | forecast | clearance | touched | goal | ω | s";
    let mut last = String::new();
    for group in &summary.groups {
        let of = format!(
            "{}, departure {} mm, {}",
            group.human,
            group.departure_mm,
            region(group.region)
        );
        if of != last {
            let _ = writeln!(
                out,
                "\n### {of} the demonstrations\n\n| {heading} |\n|{}",
                " --- |".repeat(9)
            );
            last = of;
        }
        let _ = writeln!(out, "| {} |", row(group).join(" | "));
    }
    out.push_str("\n### Laws against each other: groups in which the first is better / the same / worse\n\n");
    out.push_str("| law | against | effort | wish | clearance | better in all | worse in all |\n|");
    out.push_str(&" --- |".repeat(7));
    out.push('\n');
    for contest in &summary.contests {
        let _ = writeln!(out, "| {} |", contest_row(contest).join(" | "));
    }
    let _ = writeln!(
        out,
        "\n{} trials, {} laws; \"all\" means worse in none of the three and better in at least one, or the reverse.",
        summary.trials,
        grid.laws.len()
    );
    out
}

/// What the sweep comes to, for a terminal.
#[must_use]
pub fn text(grid: &Grid, summary: &Summary) -> String {
    let mut out = String::new();
    if !summary.rulings.is_empty() {
        out.push_str("The adaptive law's effort, against the human alone / half and half / the best constant:\n\n");
        for ruling in &summary.rulings {
            let _ = writeln!(out, "  {}", ruling_line(ruling));
        }
        out.push('\n');
    }
    for region in [Region::Inside, Region::Outside] {
        overall(&mut out, grid, summary, region);
    }
    out.push_str("Groups (human × departure × inside, outside) in which a law is better / same / worse:\n\n");
    let rows: Vec<Vec<String>> = summary.contests.iter().map(contest_row).collect();
    let heading = [
        "law",
        "against",
        "effort",
        "wish",
        "clearance",
        "better in all",
        "worse in all",
    ];
    out.push_str(&aligned(&heading, &rows));
    out
}

fn overall(out: &mut String, grid: &Grid, summary: &Summary, wanted: Region) {
    let laws = grid.laws.iter().map(|law| {
        let groups: Vec<&Group> = summary
            .groups
            .iter()
            .filter(|group| group.region == wanted && group.law == law.name)
            .collect();
        let mean = |read: fn(&Group) -> Option<f64>| {
            let values: Vec<f64> = groups.iter().filter_map(|group| read(group)).collect();
            match values.len() {
                0 => "-".to_owned(),
                count => format!("{:.1}", values.iter().sum::<f64>() / count as f64),
            }
        };
        vec![
            law.name.clone(),
            mean(|group| Some(group.effort_m_s?.mean * 1e3)),
            mean(|group| Some(group.wish_error_m?.mean * 1e3)),
            mean(|group| Some(group.forecast_error_m?.mean * 1e3)),
            mean(|group| Some(group.clearance_m?.mean * 1e3)),
            mean(|group| Some(group.touched * 100.0)),
            mean(|group| Some(group.reached * 100.0)),
        ]
    });
    let _ = writeln!(
        out,
        "Mean over all humans and departures, {} the demonstrations:\n",
        region(wanted)
    );
    let heading = [
        "law",
        "effort mm/s",
        "wish mm",
        "forecast mm",
        "clearance mm",
        "touched %",
        "goal %",
    ];
    out.push_str(&aligned(&heading, &laws.collect::<Vec<_>>()));
    out.push('\n');
}

const fn region(region: Region) -> &'static str {
    match region {
        Region::Inside => "between",
        Region::Outside => "outside",
    }
}

fn row(group: &Group) -> Vec<String> {
    let with = |figure: Option<Figure>, scale: f64, digits: usize| match figure {
        None => "-".to_owned(),
        Some(Figure { mean, error: None }) => format!("{:.digits$}", mean * scale),
        Some(Figure {
            mean,
            error: Some(error),
        }) => format!("{:.digits$} ± {:.digits$}", mean * scale, error * scale),
    };
    let percent = |share: f64| format!("{:.0} %", share * 100.0);
    vec![
        group.law.clone(),
        with(group.effort_m_s, 1e3, 1),
        with(group.wish_error_m, 1e3, 1),
        with(group.forecast_error_m, 1e3, 1),
        with(group.clearance_m, 1e3, 1),
        percent(group.touched),
        percent(group.reached),
        with(group.weight, 1.0, 2),
        with(group.duration_s, 1.0, 1),
    ]
}

fn contest_row(contest: &Contest) -> Vec<String> {
    let triple = |[better, same, worse]: [usize; 3]| format!("{better} / {same} / {worse}");
    vec![
        contest.law.clone(),
        contest.against.clone(),
        triple(contest.effort),
        triple(contest.wish),
        triple(contest.clearance),
        contest.dominates.to_string(),
        contest.dominated.to_string(),
    ]
}

fn ruling_line(ruling: &Ruling) -> String {
    let share = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:+.0} %", share * 100.0));
    let best = ruling.best_constant.as_ref();
    let best = best.map_or("-".to_owned(), |(name, by)| format!("{:+.0} % ({name})", by * 100.0));
    format!(
        "{:<13} departure {:>3} mm, {:<7}  {:>6} / {:>6} / {:<22} {}",
        ruling.human,
        ruling.departure_mm,
        region(ruling.region),
        share(ruling.against_human),
        share(ruling.against_fixed),
        best,
        ruling.word
    )
}

/// Columns wide enough, the first two to the left, numbers to the right.
fn aligned(heading: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |column: usize| rows.iter().map(move |row| row[column].chars().count());
    let widths: Vec<usize> = (0..heading.len())
        .map(|column| {
            cells(column)
                .chain([heading[column].chars().count()])
                .max()
                .unwrap_or(0)
        })
        .collect();
    let numbers = |column: usize| {
        rows.iter()
            .all(|row| row[column].starts_with(|c: char| c.is_ascii_digit() || c == '-'))
    };
    let line = |row: &[String]| {
        let cell = |column: usize| {
            let (word, width) = (&row[column], widths[column]);
            if numbers(column) {
                format!("{word:>width$}")
            } else {
                format!("{word:<width$}")
            }
        };
        let cells: Vec<String> = (0..row.len()).map(cell).collect();
        format!("  {}\n", cells.join("  ").trim_end())
    };
    let heading: Vec<String> = heading.iter().map(|&word| word.to_owned()).collect();
    std::iter::once(line(&heading))
        .chain(rows.iter().map(|row| line(row)))
        .collect()
}
