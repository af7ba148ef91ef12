//! The sweep as a picture: for every human and departure, what each law costs and what it gives.
//!
//! Each small panel is one human (row) at one departure (column), with scales of its own. To the left is less effort. The constants are joined
//! by a line in the order of their weights: it is the trade-off that sharing by a fixed weight offers, and a law that
//! is worth its name lies to the left of and below it (above it, for clearance).

use std::fmt::Write as _;

use tandem_settings::Choice;

use crate::sweep::grid::Grid;
use crate::sweep::summary::{Group, Region, Summary};

const PANEL: [f64; 2] = [150.0, 112.0];
const GAP: [f64; 2] = [34.0, 30.0];
const MARGIN: [f64; 2] = [124.0, 74.0];
/// Colours that differ in lightness too: Okabe and Ito (2008).
const COLOURS: [&str; 7] = [
    "#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3fbf",
];
const CONSTANTS: &str = "#777777";

/// A block of panels: one region and one thing that is weighed against effort.
struct Block {
    region: Region,
    title: &'static str,
    read: fn(&Group) -> Option<f64>,
}

const BLOCKS: [Block; 4] = [
    Block {
        region: Region::Inside,
        title: "between the demonstrations: distance from the human's wish, mm (lower is better)",
        read: |group| Some(group.wish_error_m?.mean * 1e3),
    },
    Block {
        region: Region::Outside,
        title: "outside the demonstrations: distance from the human's wish, mm (lower is better)",
        read: |group| Some(group.wish_error_m?.mean * 1e3),
    },
    Block {
        region: Region::Inside,
        title: "between the demonstrations: smallest clearance, mm (higher is better)",
        read: |group| Some(group.clearance_m?.mean * 1e3),
    },
    Block {
        region: Region::Outside,
        title: "outside the demonstrations: smallest clearance, mm (higher is better)",
        read: |group| Some(group.clearance_m?.mean * 1e3),
    },
];

/// The whole figure as one SVG.
#[must_use]
pub fn svg(grid: &Grid, summary: &Summary) -> String {
    let settings = &grid.settings;
    let (columns, rows) = (settings.departures_mm.len() as f64, settings.humans.len() as f64);
    let block = [
        MARGIN[0] + columns * (PANEL[0] + GAP[0]) + 10.0,
        MARGIN[1] + rows * (PANEL[1] + GAP[1]) + 34.0,
    ];
    let key_rows = grid.laws.len().div_ceil(3) as f64;
    let size = [block[0] * 2.0, block[1] * 2.0 + 30.0 + key_rows * 18.0];
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0} {1:.0}\" width=\"{0:.0}\" height=\"{1:.0}\" \
         font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        size[0], size[1]
    );
    for (index, what) in BLOCKS.iter().enumerate() {
        let corner = [block[0] * (index % 2) as f64, block[1] * (index / 2) as f64];
        draw_block(&mut out, grid, summary, what, corner);
    }
    key(&mut out, grid, [MARGIN[0], block[1] * 2.0 + 20.0]);
    out.push_str("</svg>\n");
    out
}

fn draw_block(out: &mut String, grid: &Grid, summary: &Summary, block: &Block, corner: [f64; 2]) {
    let settings = &grid.settings;
    let effort = |group: &Group| Some(group.effort_m_s?.mean * 1e3);
    let of_block: Vec<&Group> = summary
        .groups
        .iter()
        .filter(|group| group.region == block.region)
        .collect();
    text(
        out,
        [corner[0] + MARGIN[0], corner[1] + 22.0],
        "13",
        "start",
        block.title,
    );
    for (row, human) in settings.humans.iter().enumerate() {
        for (column, &departure) in settings.departures_mm.iter().enumerate() {
            let left = corner[0] + MARGIN[0] + column as f64 * (PANEL[0] + GAP[0]);
            let top = corner[1] + MARGIN[1] + row as f64 * (PANEL[1] + GAP[1]);
            if row == 0 {
                let label = format!("departure {departure} mm");
                text(out, [left + PANEL[0] / 2.0, top - 10.0], "11", "middle", &label);
            }
            if column == 0 {
                text(out, [left - 34.0, top + PANEL[1] / 2.0], "11", "end", human.name());
            }
            let here = |group: &&&Group| group.human == human.name() && (group.departure_mm - departure).abs() < 1e-9;
            let points: Vec<_> = of_block
                .iter()
                .filter(here)
                .filter_map(|group| Some((group, effort(group)?, (block.read)(group)?)))
                .collect();
            let (Some(x), Some(y)) = (
                Axis::over(points.iter().map(|point| point.1)),
                Axis::over(points.iter().map(|point| point.2)),
            ) else {
                continue;
            };
            ticks(out, [&x, &y], [left, top]);
            let points: Vec<Mark> = points
                .into_iter()
                .filter_map(|(group, effort, value)| {
                    let law = grid.laws.iter().position(|law| law.name == group.law)?;
                    Some(Mark {
                        law,
                        at: [x.place(effort, left, PANEL[0]), y.flipped(value, top, PANEL[1])],
                    })
                })
                .collect();
            panel(out, grid, &points, [left, top]);
        }
    }
    let bottom = corner[1] + MARGIN[1] + settings.humans.len() as f64 * (PANEL[1] + GAP[1]);
    let middle = corner[0] + MARGIN[0] + PANEL[0] / 2.0;
    text(out, [middle, bottom], "11", "middle", "effort, mm/s");
}

struct Mark {
    law: usize,
    at: [f64; 2],
}

fn panel(out: &mut String, grid: &Grid, points: &[Mark], corner: [f64; 2]) {
    let _ = writeln!(
        out,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#bbbbbb\"/>",
        corner[0], corner[1], PANEL[0], PANEL[1]
    );
    let mut constants: Vec<(f64, [f64; 2])> = points
        .iter()
        .filter_map(|mark| Some((grid.laws[mark.law].constant?, mark.at)))
        .collect();
    constants.sort_by(|a, b| a.0.total_cmp(&b.0));
    let line: Vec<String> = constants
        .iter()
        .map(|(_, at)| format!("{:.1},{:.1}", at[0], at[1]))
        .collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{CONSTANTS}\"/>",
        line.join(" ")
    );
    for mark in points {
        symbol(out, grid, mark.law, mark.at);
    }
}

/// A constant is a small grey dot, larger with its weight; any other law has a colour.
fn symbol(out: &mut String, grid: &Grid, law: usize, at: [f64; 2]) {
    let before = grid.laws[..law].iter().filter(|law| law.constant.is_none()).count();
    let (radius, colour) = match grid.laws[law].constant {
        Some(weight) => (1.8 + 2.0 * weight, CONSTANTS),
        None => (4.5, COLOURS[before % COLOURS.len()]),
    };
    let _ = writeln!(
        out,
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"{colour}\" stroke=\"white\" stroke-width=\"0.6\"/>",
        at[0], at[1]
    );
}

fn key(out: &mut String, grid: &Grid, corner: [f64; 2]) {
    for (law, entry) in grid.laws.iter().enumerate() {
        let at = [
            corner[0] + (law % 3) as f64 * 480.0,
            corner[1] + (law / 3) as f64 * 18.0,
        ];
        symbol(out, grid, law, at);
        text(out, [at[0] + 10.0, at[1] + 4.0], "11", "start", &entry.name);
    }
}

/// The ends of both scales.
fn ticks(out: &mut String, [x, y]: [&Axis; 2], [left, top]: [f64; 2]) {
    text(out, [left - 4.0, top + 9.0], "10", "end", &format!("{:.0}", y.high));
    text(out, [left - 4.0, top + PANEL[1]], "10", "end", &format!("{:.0}", y.low));
    let below = top + PANEL[1] + 12.0;
    text(out, [left, below], "10", "start", &format!("{:.0}", x.low));
    text(out, [left + PANEL[0], below], "10", "end", &format!("{:.0}", x.high));
}

fn text(out: &mut String, at: [f64; 2], size: &str, anchor: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\">{words}</text>",
        at[0], at[1]
    );
}

/// A scale with a little room at both ends.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64>) -> Option<Self> {
        let ends = values.fold(None, |ends: Option<(f64, f64)>, value| {
            let (low, high) = ends.unwrap_or((value, value));
            Some((low.min(value), high.max(value)))
        });
        let (low, high) = ends?;
        let room = ((high - low) * 0.06).max(0.5);
        Some(Self {
            low: low - room,
            high: high + room,
        })
    }

    fn place(&self, value: f64, from: f64, length: f64) -> f64 {
        from + (value - self.low) / (self.high - self.low) * length
    }

    fn flipped(&self, value: f64, from: f64, length: f64) -> f64 {
        from + length - (value - self.low) / (self.high - self.low) * length
    }
}
