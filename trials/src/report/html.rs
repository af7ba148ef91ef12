//! The report as one page that needs nothing else: no script, no font, no picture from elsewhere.

use super::comparison::Comparison;
use super::quantities::{EFFORT, QUANTITIES, rounded};
use super::sentences::{HOW_TO_READ, STEPS_ARE_NOT_INDEPENDENT, group_name, p_cell, quantity};
use super::svg::escaped;
use super::{ALL, Report};

const STYLE: &str = include_str!("report.css");

/// So many comparisons of one quantity are told in sentences, each.
const TOLD: usize = 8;
/// The columns of the table of paired tests.
const PAIRED_COLUMNS: usize = 11;

impl Report {
    /// The page.
    #[must_use]
    pub fn html(&self) -> String {
        let title = escaped(&self.setup.title);
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width\"><title>{title}: trial report</title>\n\
             <style>\n{STYLE}</style></head>\n<body>\n<h1>{title}</h1>\n<p class=\"lead\">{}</p>\n",
            escaped(&self.overview())
        );
        page += &format!(
            "<p class=\"small\">Made from a run by tandem {}.</p>\n",
            escaped(&self.setup.build)
        );
        page += &self.lines_part();
        if self.trials.is_empty() {
            page += "<p>There is no finished trial to report on.</p>\n";
        } else {
            page += &self.effort_part();
            page += &self.tests_part();
            page += &self.controls_part();
            page += &self.paths_part();
            page += &self.table_part();
            page += &self.trials_part();
        }
        for why in &self.setup.unreadable {
            page += &format!("<p class=\"bad\">Not read: {}</p>\n", escaped(why));
        }
        page += "</body></html>\n";
        // A number stays beside its unit.
        page.replace(" % ", "\u{a0}% ").replace(" mm", "\u{a0}mm")
    }

    fn lines_part(&self) -> String {
        let lines = self.setup.bad_lines.iter();
        let items: String = lines
            .map(|(trials, line)| format!("<li>{}: {}</li>\n", escaped(trials), escaped(line)))
            .collect();
        if items.is_empty() {
            return items;
        }
        format!("<p>Bad lines on purpose:</p>\n<ul>\n{items}</ul>\n")
    }

    fn effort_part(&self) -> String {
        let Some(effort) = quantity(EFFORT) else {
            return String::new();
        };
        let sentences = self.comparisons.iter().filter(|one| one.quantity == EFFORT);
        let all: Vec<&Comparison> = sentences.collect();
        // Many comparisons: a sentence for each would bury those that found something. The table has every one.
        let (told, rest) = if all.len() > TOLD {
            all.into_iter().partition(|one| one.holm_p.is_some_and(|p| p < 0.05))
        } else {
            (all, Vec::new())
        };
        let mut list: String = told
            .iter()
            .map(|one| format!("<li>{}</li>\n", escaped(&self.meaning(one))))
            .collect();
        if !rest.is_empty() {
            list += &format!(
                "<li>In {} other comparisons chance explains as much as was found, or nothing can be tested: see the table \
                 below.</li>\n",
                rest.len()
            );
        }
        format!(
            "<h2>Human effort</h2>\n<figure>{}<figcaption>The mean norm of the human's velocity over the steps after the \
             checkpoint, before weight and limits. Large dots: mean over trials with its 95 % interval (Student's t); \
             small dots: single trials.</figcaption></figure>\n<ul>{list}</ul>\n",
            self.error_bars(effort, (1080.0, 320.0))
        )
    }

    fn tests_part(&self) -> String {
        if self.comparisons.is_empty() {
            return "<h2>Tests</h2>\n<p>There is one condition only: nothing to compare.</p>\n".to_owned();
        }
        let mut text = format!(
            "<h2>Paired tests, one value per trial</h2>\n<p>{}</p>\n",
            escaped(HOW_TO_READ)
        );
        text += "<div class=\"wide\"><table class=\"tests\"><thead><tr><th>contexts</th><th>compared</th><th>pairs</th><th>difference</th>\
                 <th>95 % interval</th><th>d<sub>z</sub></th><th>rank-biserial</th><th>paired t</th><th>Wilcoxon</th>\
                 <th>permutation</th><th>after Holm</th></tr></thead><tbody>\n";
        let mut above = "";
        for one in &self.comparisons {
            if let Some(quantity) = quantity(one.quantity).filter(|quantity| quantity.key != above) {
                above = quantity.key;
                let heading = heading(quantity.label, quantity.unit);
                text += &format!("<tr class=\"part\"><th colspan=\"{PAIRED_COLUMNS}\">{heading}</th></tr>\n");
            }
            text += &self.paired_row(one);
        }
        text += "</tbody></table></div>\n<ul>";
        let others = self
            .comparisons
            .iter()
            .filter(|one| one.quantity != EFFORT && one.holm_p.is_some_and(|p| p < 0.05));
        text += &others
            .map(|one| format!("<li>{}</li>\n", escaped(&self.meaning(one))))
            .collect::<String>();
        text += "</ul>\n<h2>The paper's tests, one sample per step</h2>\n";
        text += &format!("<p>{}</p>\n", escaped(STEPS_ARE_NOT_INDEPENDENT));
        text += "<div class=\"wide\"><table class=\"tests\"><thead><tr><th>contexts</th><th>compared</th><th>N steps</th><th>N trials</th><th>t</th><th>p</th>\
                 <th>Welch t</th><th>p</th><th>U</th><th>p</th><th>Cohen's d</th><th>next-step correlation</th></tr></thead><tbody>\n";
        text += &self
            .comparisons
            .iter()
            .map(|one| self.steps_row(one))
            .collect::<String>();
        text += "</tbody></table></div>\n<ul>";
        for one in &self.comparisons {
            if let Some(steps) = &one.steps {
                text += &format!("<li>{}</li>\n", escaped(&self.steps_meaning(one, steps)));
            }
        }
        text + "</ul>\n"
    }

    fn paired_row(&self, one: &Comparison) -> String {
        let Some(quantity) = quantity(one.quantity) else {
            return String::new();
        };
        let p = |p: f64| escaped(&p_cell(p));
        let clear = if one.holm_p.is_some_and(|p| p < 0.05) {
            " class=\"clear\""
        } else {
            ""
        };
        // Where nothing can be tested one cell says why, instead of eight that repeat it.
        let head = format!(
            "<tr{clear}><td>{}</td><td>{} − {}</td><td>{}</td>",
            escaped(&one.group),
            escaped(self.label(&one.first)),
            escaped(self.label(&one.second)),
            one.pairs,
        );
        if one.paired_t.found().is_none() && one.wilcoxon.found().is_none() {
            let why = one.paired_t.text(|_| String::new());
            return format!("{head}<td class=\"none\" colspan=\"8\">{}</td></tr>\n", escaped(&why));
        }
        let difference = one.difference.text(|found| quantity.shown(found.value));
        let around = one
            .difference
            .text(|found| format!("{} to {}", quantity.shown(found.low), quantity.shown(found.high)));
        let effect = |answer: &super::Answer<crate::statistics::Interval>| {
            answer.text(|found| {
                format!(
                    "{} ({} to {})",
                    rounded(found.value, 2),
                    rounded(found.low, 2),
                    rounded(found.high, 2)
                )
            })
        };
        format!(
            "{head}<td>{difference}</td><td>{around}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
            effect(&one.d_z),
            effect(&one.rank_biserial),
            one.paired_t.text(|test| p(test.p)),
            one.wilcoxon.text(|test| p(test.p)),
            one.permutation.text(|test| p(test.p)),
            one.holm_p.map_or_else(|| "–".to_owned(), p),
        )
    }

    fn steps_row(&self, one: &Comparison) -> String {
        let Some(steps) = &one.steps else {
            return String::new();
        };
        let cells = [
            escaped(&one.group),
            escaped(&format!("{}, {}", self.label(&one.first), self.label(&one.second))),
            format!("{}, {}", steps.first_steps, steps.second_steps),
            format!("{}, {}", one.first_trials, one.second_trials),
            steps.student.text(|test| rounded(test.t, 2)),
            steps.student.text(|test| p_cell(test.p)),
            steps.welch.text(|test| rounded(test.t, 2)),
            steps.welch.text(|test| p_cell(test.p)),
            steps.mann_whitney.text(|test| format!("{:.0}", test.u)),
            steps.mann_whitney.text(|test| p_cell(test.p)),
            steps.cohen_d.text(|d| rounded(*d, 2)),
            steps
                .autocorrelation
                .map_or_else(|| "–".to_owned(), |r| format!("{r:.2}")),
        ];
        let cells: String = cells
            .iter()
            .map(|cell| format!("<td>{}</td>", cell.replace('<', "&lt;")))
            .collect();
        format!("<tr>{cells}</tr>\n")
    }

    fn controls_part(&self) -> String {
        format!(
            "<h2>Is it the law, or only the robot's share?</h2>\n<figure>{}<figcaption>Effort against the weight that the \
             human had, over {}; the dashed line joins conditions of constant weight. Below the line, a law does better \
             than a constant of its own mean weight.</figcaption></figure>\n<p>{}</p>\n",
            self.effort_by_weight(),
            escaped(&group_name(self.groups.last().map_or(ALL, String::as_str))),
            escaped(&self.controls_meaning())
        )
    }

    fn paths_part(&self) -> String {
        let others = QUANTITIES
            .iter()
            .filter(|quantity| quantity.tested && quantity.key != EFFORT);
        // The names of many conditions need the whole width.
        let small = if self.setup.conditions.len() > 4 { 1080.0 } else { 532.0 };
        let bars: String = others
            .map(|quantity| self.error_bars(quantity, (small, 250.0)))
            .collect();
        format!(
            "<h2>What the tool did</h2>\n<div class=\"panels\">{}</div>\n<p class=\"caption\">Seen from above, the robot's base \
             beyond the upper edge. Coloured: the tool. Dashed: where the simulated human wished to be, or else the \
             forecast. Small dots: the checkpoint, where the forecast was made. Discs: obstacles; green: the goal.</p>\n\
             <h2>Who led</h2>\n<div class=\"panels\">{}</div>\n<p class=\"caption\">Thin: single trials; thick: their mean, \
             while at least half of them still moved. ω = 1 is the human alone.</p>\n\
             <h2>Other figures</h2>\n<div class=\"panels\">{bars}</div>\n",
            self.trajectories(),
            self.weights()
        )
    }

    fn table_part(&self) -> String {
        let mut text = String::from(
            "<h2>All figures</h2>\n<p>Mean over trials ± half of its 95 % interval.</p>\n<div class=\"panels tables\">",
        );
        for group in &self.groups {
            text += &format!(
                "<div><h3>{}</h3>\n<table><thead><tr><th></th>",
                escaped(&group_name(group))
            );
            let summaries: Vec<_> = self
                .setup
                .conditions
                .iter()
                .filter_map(|(name, _)| self.summary(name, group))
                .collect();
            for summary in &summaries {
                text += &format!("<th>{}</th>", escaped(self.label(&summary.condition)));
            }
            text += "</tr></thead><tbody>\n";
            let row = |name: &str, cells: Vec<String>| {
                let cells: String = cells.iter().map(|cell| format!("<td>{cell}</td>")).collect();
                format!("<tr><td>{name}</td>{cells}</tr>\n")
            };
            text += &row(
                "trials",
                summaries.iter().map(|summary| summary.trials.to_string()).collect(),
            );
            text += &row(
                "shared steps",
                summaries.iter().map(|summary| summary.steps.to_string()).collect(),
            );
            text += &row(
                "successful",
                summaries.iter().map(|summary| summary.successes.to_string()).collect(),
            );
            for quantity in QUANTITIES {
                if summaries.iter().all(|summary| summary.mean(quantity.key).is_none()) {
                    continue;
                }
                let cells = summaries.iter().map(|summary| match summary.mean(quantity.key) {
                    Some(mean) => {
                        let margin = mean.margin.map(|margin| format!(" ± {}", quantity.shown(margin)));
                        format!("{}{}", quantity.shown(mean.mean), margin.unwrap_or_default())
                    }
                    None => "–".to_owned(),
                });
                text += &row(&heading(quantity.label, quantity.unit), cells.collect());
            }
            text += "</tbody></table>\n";
            for summary in summaries.iter().filter(|summary| !summary.stops.is_empty()) {
                let stops: Vec<String> = summary
                    .stops
                    .iter()
                    .map(|(why, count)| format!("{count} × {why}"))
                    .collect();
                text += &format!(
                    "<p class=\"small\">Stops under {}: {}.</p>\n",
                    escaped(self.label(&summary.condition)),
                    escaped(&stops.join("; "))
                );
            }
            text.push_str("</div>\n");
        }
        text.push_str("</div>\n");
        text
    }

    fn trials_part(&self) -> String {
        let mut text = String::from(
            "<h2>Every trial</h2>\n<p class=\"caption\"><span class=\"key tool\"></span> tool <span class=\"key forecast\">\
             </span> forecast <span class=\"key band\"></span> its interval <span class=\"key wish\"></span> the simulated \
             human's wish <span class=\"key human\"></span> the human's velocity, a quarter of a second long. Open circle: the \
             checkpoint.</p>\n",
        );
        text.push_str("<p class=\"index\">");
        for case in &self.trials {
            let number = case.identity.number;
            let class = if case.identity.success { "" } else { " class=\"bad\"" };
            text += &format!("<a{class} href=\"#trial-{number}\">{number}</a> ");
        }
        text.push_str("</p>\n");
        for case in &self.trials {
            text.push_str(&self.trial_section(case));
        }
        text
    }
}

fn heading(label: &str, unit: &str) -> String {
    if unit.is_empty() {
        escaped(label)
    } else {
        format!("{}, {unit}", escaped(label))
    }
}
