//! The section of one trial: its figures, what the tool did, and ω over time.

use super::Report;
use super::case::Case;
use super::ground::{Ground, corners};
use super::quantities::QUANTITIES;
use super::svg::{Scale, Svg, escaped};

/// What a section lists of a trial's figures.
const LISTED: [&str; 8] = [
    "human_effort_mean_m_s",
    "weight_mean_after",
    "tracking_wish_after_mean_m",
    "tracking_forecast_mean_m",
    "min_clearance_m",
    "duration_s",
    "smoothness_sparc",
    "latency_p50_ms",
];

impl Report {
    /// The section of a trial.
    pub(super) fn trial_section(&self, case: &Case) -> String {
        let who = &case.identity;
        let number = who.number;
        let title = format!(
            "Trial {number}: {}, context {}{}",
            escaped(self.label(&who.condition)),
            escaped(&who.context),
            if who.group.is_empty() {
                String::new()
            } else {
                format!(" ({})", escaped(&who.group))
            }
        );
        let state = if who.success {
            ""
        } else {
            " <span class=\"bad\">not successful</span>"
        };
        format!(
            "<section class=\"trial\" id=\"trial-{number}\"><h3>{title}{state}</h3>\n<p class=\"facts\">{}</p>\n\
             <div class=\"row\">{}{}</div>\n{}</section>\n",
            facts(case),
            path_figure(case),
            weight_figure(case),
            self.session_line(case)
        )
    }

    fn session_line(&self, case: &Case) -> String {
        let who = &case.identity;
        if who.session.is_empty() {
            return String::new();
        }
        let session = escaped(&who.session);
        format!(
            "<p class=\"again\">See it again, from the run's folder: <code>tandem replay {} --from {:.1}</code> \
             (<a href=\"{session}\">session file</a>)</p>\n",
            escaped(&quoted(&who.session)),
            who.began_s.max(0.0)
        )
    }
}

/// A file's name as a shell reads it.
fn quoted(name: &str) -> String {
    if name
        .chars()
        .all(|letter| letter.is_ascii_alphanumeric() || "-_./".contains(letter))
    {
        name.to_owned()
    } else {
        format!("'{}'", name.replace('\'', "'\\''"))
    }
}

fn facts(case: &Case) -> String {
    let (who, measures) = (&case.identity, &case.measures);
    let mut facts = vec![format!(
        "participant {}, repetition {}",
        escaped(&who.participant),
        who.repetition
    )];
    let known = QUANTITIES.iter().filter(|quantity| LISTED.contains(&quantity.key));
    facts.extend(known.filter_map(|quantity| {
        Some(format!(
            "{} <b>{}</b>",
            quantity.label,
            quantity.with_unit((quantity.of)(measures)?)
        ))
    }));
    if measures.contacts > 0 {
        facts.push(format!("<span class=\"bad\">{} contacts</span>", measures.contacts));
    }
    if measures.drops.total() > 0 {
        facts.push(format!("{} messages dropped", measures.drops.total()));
    }
    let mut text = facts.join(" · ");
    for stop in measures.stops.iter().take(5) {
        text += &format!(
            "<br>stopped at tick {} by {}: {}",
            stop.tick,
            stop.by,
            escaped(&stop.reason)
        );
    }
    if measures.stops.len() > 5 {
        text += &format!("<br>and {} more stops", measures.stops.len() - 5);
    }
    if let Some(reason) = &who.reason {
        text += &format!("<br>{}", escaped(reason));
    }
    if !who.note.is_empty() {
        text += &format!("<br>note: {}", escaped(&who.note));
    }
    text
}

fn path_figure(case: &Case) -> String {
    let curves = &case.curves;
    let (width, height) = (600.0, 290.0);
    let mut svg = Svg::new(
        width,
        height,
        &format!("trial {}: paths seen from above", case.identity.number),
    );
    let ground = Ground::new(
        corners(std::iter::once(curves)),
        (4.0, 4.0),
        (width - 8.0, height - 30.0),
    );
    svg.polygon("band", ground.curve(&curves.band));
    ground.scenery(&mut svg, curves);
    for forecast in &curves.forecasts {
        svg.polyline("forecast", ground.curve(forecast));
    }
    svg.polyline("wish", ground.curve(&curves.wish));
    svg.lines(
        "human",
        curves.human.iter().map(|arrow| arrow.map(|dot| ground.at(dot))),
    );
    svg.polyline("tool", ground.curve(&curves.tool));
    if let Some(dot) = curves.checkpoint {
        svg.disc("checkpoint", ground.at(dot), 4.0, "checkpoint");
    }
    ground.ruler(&mut svg, (6.0, height - 10.0));
    svg.finish()
}

fn weight_figure(case: &Case) -> String {
    let curves = &case.curves;
    let (width, height) = (440.0, 290.0);
    let (left, right, top, bottom) = (44.0, width - 8.0, 14.0, height - 36.0);
    let end = curves.weight.last().map_or(1.0, |last| f64::from(last[0]));
    let (x, y) = (
        Scale::new((0.0, end), (left, right)),
        Scale::new((0.0, 1.0), (bottom, top)),
    );
    let mut svg = Svg::new(
        width,
        height,
        &format!("trial {}: the human's weight over time", case.identity.number),
    );
    svg.grid_y(&y, (left, right), 5.0);
    svg.grid_x(&x, (top, bottom), 8.0);
    svg.text(
        "mid",
        ((left + right) / 2.0, height - 6.0),
        "seconds since the trial began",
    );
    svg.text_upwards((12.0, (top + bottom) / 2.0), "the human's weight ω");
    if let Some(at) = curves.checkpoint_s {
        let at = x.at(f64::from(at));
        svg.line("control", (at, top), (at, bottom));
        svg.text("", (at + 4.0, top + 10.0), "checkpoint");
    }
    for stop in &curves.stops_s {
        svg.line("stop", (x.at(f64::from(*stop)), top), (x.at(f64::from(*stop)), bottom));
    }
    let weights = super::case::thinned(&curves.weight, 300);
    svg.polyline(
        "tool",
        weights
            .iter()
            .map(|[at, weight]| (x.at(f64::from(*at)), y.at(f64::from(*weight)))),
    );
    svg.finish()
}
