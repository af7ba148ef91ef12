//! The figures of the whole run.

use std::collections::BTreeMap;

use super::Report;
use super::case::{Case, Curves, thinned};
use super::ground::{Ground, corners};
use super::quantities::{EFFORT, QUANTITIES, Quantity};
use super::sentences::group_name;
use super::svg::{Scale, Svg, range};

/// Single trials that one column of dots or one panel of curves shows.
const SHOWN: usize = 60;
/// More conditions than these do not find room for their names beside each other.
const CROWDED: usize = 3;

/// Colours of conditions, by their place; more begin again.
pub(super) const COLOURS: usize = 7;

impl Report {
    fn colour(&self, condition: &str) -> usize {
        let place = self.setup.conditions.iter().position(|(name, _)| name == condition);
        place.unwrap_or(0) % COLOURS
    }

    /// Means with their 95 % intervals and single trials, per group and condition.
    pub(super) fn error_bars(&self, quantity: &Quantity, size: (f64, f64)) -> String {
        let (width, height) = size;
        let below = if self.setup.conditions.len() > CROWDED {
            75.0
        } else {
            62.0
        };
        let (left, right, top, bottom) = (52.0, width - 8.0, 12.0, height - below);
        let values = self.trials.iter().filter_map(|case| (quantity.of)(&case.measures));
        let bars = self.summaries.iter().filter_map(|summary| summary.mean(quantity.key));
        let ends = bars.flat_map(|mean| [-1.0, 1.0].map(|side| mean.mean + side * mean.margin.unwrap_or(0.0)));
        let Some((low, high)) = range(values.chain(ends)) else {
            return String::new();
        };
        let (low, high) = (low * quantity.factor, high * quantity.factor);
        let floor = if low >= 0.0 && low < 0.6 * high {
            0.0
        } else {
            low - 0.06 * (high - low)
        };
        let y = Scale::new((floor, high + 0.06 * (high - floor)), (bottom, top));
        let mut svg = Svg::new(
            width,
            height,
            &format!("{} per condition and group of contexts", quantity.label),
        );
        svg.grid_y(&y, (left, right), 6.0);
        let title = if quantity.unit.is_empty() {
            quantity.label.to_owned()
        } else {
            format!("{}, {}", quantity.label, quantity.unit)
        };
        svg.text_upwards((12.0, (top + bottom) / 2.0), &title);
        let column = (right - left) / self.groups.len().max(1) as f64;
        for (place, group) in self.groups.iter().enumerate() {
            let start = left + column * place as f64;
            if place > 0 {
                svg.line("axis", (start, top), (start, bottom + below - 12.0));
            }
            self.group_of_bars(&mut svg, quantity, group, (start, start + column), &y);
            svg.text(
                "mid strong",
                (start + column / 2.0, bottom + below - 12.0),
                &group_name(group),
            );
        }
        svg.line("axis", (left, bottom), (right, bottom));
        svg.finish()
    }

    fn group_of_bars(&self, svg: &mut Svg, quantity: &Quantity, group: &str, (from, to): (f64, f64), y: &Scale) {
        let count = self.setup.conditions.len().max(1) as f64;
        let room = (to - from) / count;
        for (place, (name, label)) in self.setup.conditions.iter().enumerate() {
            let x = from + room * (place as f64 + 0.5);
            let colour = self.colour(name);
            let cases = thinned(&self.cases(name, group), SHOWN);
            for (order, case) in cases.iter().enumerate() {
                if let Some(value) = (quantity.of)(&case.measures) {
                    let aside = room.min(60.0) * (0.14 + 0.05 * (order % 5) as f64);
                    let says = format!(
                        "trial {}, {}: {}",
                        case.identity.number,
                        case.identity.context,
                        quantity.with_unit(value)
                    );
                    svg.disc(
                        &format!("dot c{colour}"),
                        (x + aside, y.at(value * quantity.factor)),
                        2.4,
                        &says,
                    );
                }
            }
            if let Some(mean) = self.summary(name, group).and_then(|summary| summary.mean(quantity.key)) {
                let centre = y.at(mean.mean * quantity.factor);
                if let Some(margin) = mean.margin {
                    let (low, high) = (
                        (mean.mean - margin) * quantity.factor,
                        (mean.mean + margin) * quantity.factor,
                    );
                    svg.line(&format!("bar c{colour}"), (x, y.at(low)), (x, y.at(high)));
                    svg.line(&format!("bar c{colour}"), (x - 5.0, y.at(low)), (x + 5.0, y.at(low)));
                    svg.line(&format!("bar c{colour}"), (x - 5.0, y.at(high)), (x + 5.0, y.at(high)));
                }
                let says = format!(
                    "{label}: {} in the mean of {} trials",
                    quantity.with_unit(mean.mean),
                    mean.trials
                );
                svg.disc(&format!("mean c{colour}"), (x, centre), 4.5, &says);
            }
            // Many conditions: their names alternate between three rows.
            let rows = if self.setup.conditions.len() > CROWDED { 3 } else { 1 };
            let row = 16.0 + 13.0 * (place % rows) as f64;
            svg.text("mid", (x, y.start() + row), &shortened(label, room * rows as f64));
        }
    }

    /// What the tools did, a panel for each condition and group.
    pub(super) fn trajectories(&self) -> String {
        let corners = corners(self.trials.iter().map(|case| &case.curves));
        let groups = self
            .groups
            .iter()
            .filter(|group| *group != super::ALL || self.groups.len() == 1);
        let panels: Vec<(&String, &(String, String))> = groups
            .flat_map(|group| self.setup.conditions.iter().map(move |condition| (group, condition)))
            .filter(|(group, (name, _))| !self.cases(name, group).is_empty())
            .collect();
        let mut text = String::new();
        for (group, (name, label)) in panels {
            let cases = self.cases(name, group);
            text += &self.trajectory_panel(group, name, label, &cases, corners);
        }
        text
    }

    fn trajectory_panel(
        &self,
        group: &str,
        name: &str,
        label: &str,
        cases: &[&Case],
        corners: ((f64, f64), (f64, f64)),
    ) -> String {
        let (width, height) = (panel_width(self.setup.conditions.len()), 250.0);
        let mut svg = Svg::new(
            width,
            height,
            &format!("{label}, {}: what the tool did, seen from above", group_name(group)),
        );
        svg.text("strong", (4.0, 14.0), &format!("{label}: {}", group_name(group)));
        let ground = Ground::new(corners, (4.0, 22.0), (width - 8.0, height - 46.0));
        let shown = thinned(cases, SHOWN);
        if let Some(first) = shown.first() {
            ground.scenery(&mut svg, &first.curves);
        }
        for case in &shown {
            if case.curves.wish.is_empty() {
                svg.polyline(
                    "forecast faint",
                    ground.curve(case.curves.forecasts.last().map_or(&[], Vec::as_slice)),
                );
            } else {
                svg.polyline("wish faint", ground.curve(&case.curves.wish));
            }
        }
        let colour = self.colour(name);
        for case in &shown {
            svg.polyline(&format!("thin c{colour}"), ground.curve(&case.curves.tool));
        }
        for dot in shown.iter().filter_map(|case| case.curves.checkpoint) {
            svg.disc("checkpoint", ground.at(dot), 1.8, "");
        }
        ground.ruler(&mut svg, (6.0, height - 10.0));
        let count = if shown.len() < cases.len() {
            format!("{} of {} trials", shown.len(), cases.len())
        } else {
            format!("{} trials", cases.len())
        };
        svg.text("end", (width - 6.0, height - 6.0), &count);
        svg.finish()
    }

    /// ω from the checkpoint on, a panel for each group.
    pub(super) fn weights(&self) -> String {
        let groups = self
            .groups
            .iter()
            .filter(|group| *group != super::ALL || self.groups.len() == 1);
        groups.map(|group| self.weight_panel(group)).collect()
    }

    fn weight_panel(&self, group: &str) -> String {
        let (width, height) = (532.0, 230.0);
        let (left, right, top, bottom) = (44.0, width - 8.0, 24.0, height - 34.0);
        let all: Vec<&Case> = self
            .setup
            .conditions
            .iter()
            .flat_map(|(name, _)| self.cases(name, group))
            .collect();
        let longest = range(all.iter().flat_map(|case| after(&case.curves)).map(|(at, _)| at));
        let Some((_, end)) = longest else {
            return String::new();
        };
        let (x, y) = (
            Scale::new((-0.5, end.clamp(0.1, 60.0)), (left, right)),
            Scale::new((0.0, 1.0), (bottom, top)),
        );
        let mut svg = Svg::new(
            width,
            height,
            &format!("the human's weight after the checkpoint, {}", group_name(group)),
        );
        svg.text("strong", (left, 14.0), &group_name(group));
        svg.grid_y(&y, (left, right), 5.0);
        svg.grid_x(&x, (top, bottom), 8.0);
        svg.text(
            "mid",
            ((left + right) / 2.0, height - 5.0),
            "seconds after the checkpoint",
        );
        svg.text_upwards((12.0, (top + bottom) / 2.0), "the human's weight ω");
        for (name, _) in &self.setup.conditions {
            for case in thinned(&self.cases(name, group), SHOWN / 2) {
                let dots = after(&case.curves).filter(|(at, _)| (-0.5..=60.0).contains(at));
                let dots: Vec<(f64, f64)> = dots.map(|(at, weight)| (x.at(at), y.at(weight))).collect();
                svg.polyline(&format!("thin c{}", self.colour(name)), dots.into_iter());
            }
        }
        for (name, label) in &self.setup.conditions {
            let means = mean_weights(&self.cases(name, group));
            let dots: Vec<(f64, f64)> = means.iter().map(|(at, weight)| (x.at(*at), y.at(*weight))).collect();
            if let Some(last) = dots.last() {
                svg.text("end strong", (right - 4.0, (last.1 - 6.0).max(top + 10.0)), label);
            }
            svg.polyline(&format!("thick c{}", self.colour(name)), dots.into_iter());
        }
        svg.finish()
    }

    /// Effort against the weight that the human had: constants as a line, so that a law can be seen above or below it.
    pub(super) fn effort_by_weight(&self) -> String {
        let group = self.groups.last().map_or(super::ALL, String::as_str);
        let Some(effort) = QUANTITIES.iter().find(|quantity| quantity.key == EFFORT) else {
            return String::new();
        };
        let mut points: Vec<(&str, &str, f64, f64, f64)> = self
            .setup
            .conditions
            .iter()
            .filter_map(|(name, label)| {
                let summary = self.summary(name, group)?;
                let mean = summary.mean(EFFORT)?;
                let weight = summary.mean("weight_mean_after")?.mean;
                Some((
                    name.as_str(),
                    label.as_str(),
                    weight,
                    mean.mean * effort.factor,
                    mean.margin.unwrap_or(0.0) * effort.factor,
                ))
            })
            .collect();
        let Some((_, high)) = range(points.iter().map(|(_, _, _, mean, margin)| mean + margin)) else {
            return String::new();
        };
        let (width, height) = (532.0, 300.0);
        let (left, right, top, bottom) = (52.0, width - 12.0, 12.0, height - 40.0);
        let (x, y) = (
            Scale::new((-0.03, 1.03), (left, right)),
            Scale::new((0.0, high * 1.08), (bottom, top)),
        );
        let mut svg = Svg::new(width, height, "human effort against the human's mean weight");
        svg.grid_y(&y, (left, right), 6.0);
        svg.grid_x(&x, (top, bottom), 10.0);
        svg.text(
            "mid",
            ((left + right) / 2.0, height - 6.0),
            "the human's mean weight ω after the checkpoint",
        );
        svg.text_upwards((12.0, (top + bottom) / 2.0), "human effort, mm/s");
        if let Some(controls) = &self.controls {
            let line = controls
                .constants
                .iter()
                .map(|(_, weight, mean)| (x.at(*weight), y.at(mean * effort.factor)));
            svg.polyline("control", line);
        }
        points.sort_by(|a, b| a.2.total_cmp(&b.2));
        for (place, (name, label, weight, mean, margin)) in points.into_iter().enumerate() {
            let colour = self.colour(name);
            svg.line(
                &format!("bar c{colour}"),
                (x.at(weight), y.at(mean - margin)),
                (x.at(weight), y.at(mean + margin)),
            );
            svg.disc(
                &format!("mean c{colour}"),
                (x.at(weight), y.at(mean)),
                5.0,
                &format!("{label}: ω {weight:.2}, {mean:.1} mm/s"),
            );
            let class = if weight > 0.8 { "end strong" } else { "strong" };
            // Neighbours' names lie on different sides of their dots.
            let below = if place % 2 == 0 { -7.0 } else { 16.0 };
            let aside = if weight > 0.8 { -9.0 } else { 9.0 };
            svg.text(class, (x.at(weight) + aside, y.at(mean) + below), label);
        }
        svg.finish()
    }
}

/// Two conditions lie beside each other, group by group; of more there are three in a row.
const fn panel_width(conditions: usize) -> f64 {
    if conditions <= 2 { 532.0 } else { 352.0 }
}

/// As much of a text as fits, at seven pixels a letter.
fn shortened(text: &str, room: f64) -> String {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few dozen letters"
    )]
    let most = (room * 0.93 / 7.0).clamp(4.0, 60.0) as usize;
    if text.chars().count() <= most {
        text.to_owned()
    } else {
        text.chars().take(most - 1).chain(['…']).collect()
    }
}

/// ω by seconds since the checkpoint; nothing without one.
fn after(curves: &Curves) -> impl Iterator<Item = (f64, f64)> + '_ {
    let checkpoint = curves.checkpoint_s.map(f64::from);
    let dots = curves.weight.iter();
    dots.filter_map(move |[at, weight]| Some((f64::from(*at) - checkpoint?, f64::from(*weight))))
}

/// The mean over trials at each period since the checkpoint, where at least half of them still move.
fn mean_weights(cases: &[&Case]) -> Vec<(f64, f64)> {
    let mut sums: BTreeMap<i64, (f64, usize, f64)> = BTreeMap::new();
    for case in cases {
        let period = f64::from(case.curves.period_s).max(1e-3);
        for (at, weight) in after(&case.curves).filter(|(at, _)| (-0.5..=60.0).contains(at)) {
            #[expect(clippy::cast_possible_truncation, reason = "between −500 and 60 000")]
            let place = (at / period).round() as i64;
            let sum = sums.entry(place).or_default();
            *sum = (sum.0 + weight, sum.1 + 1, at);
        }
    }
    let kept = sums.into_values().filter(|(_, count, _)| 2 * count >= cases.len());
    kept.map(|(sum, count, at)| (at, sum / count as f64)).collect()
}
