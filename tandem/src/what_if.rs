//! `tandem what-if`: the human of a recorded session against another law or model, beside what was.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::Args;
use indicatif::ProgressBar;
use serde_json::{Value, json};
use tandem_recorder::{Evidence, Heading, Provenance, Recording, Side, save_what_if};
use tandem_trials::what_if::{Change, Comparison, LawChoice, NoAnswer, WhatIf};
use tandem_trials::{Measures, what_if};
use tandem_wire::{Pace, Stamp, Topic};

use crate::configuration::BadConfiguration;
use crate::{BUILD, Outcome, forecast, session, table, verify};

/// What takes longer shows how far it is.
const PATIENCE: Duration = Duration::from_secs(1);

#[derive(Args)]
pub(crate) struct WhatIfFlags {
    /// The session file.
    #[arg(value_name = "SESSION.mcap")]
    session: PathBuf,
    /// The law to meet: adaptive, attentive, fixed, human, robot, or constant=W with the human's weight W [default: the
    /// session's].
    #[arg(long, value_name = "LAW")]
    law: Option<LawChoice>,
    /// The model to meet [default: the session's].
    #[arg(long, value_name = "MODEL.cesn")]
    model: Option<PathBuf>,
    /// The folder for the picture of both, what-if-LAW.rrd, or what-if-LAW-MODEL.rrd with --model; made if it is not there
    /// [default: beside the session file].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Prints the figures as one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(flags: &WhatIfFlags) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let other = flags.model.as_deref().map(forecast::load).transpose()?;
    let recording = session::load(&flags.session, &[])?;
    let evidence = verify::read(&flags.session, &[])?;
    session::warn(&recording);
    let change = Change {
        law: flags.law,
        model: other,
    };
    let answer = ask(&recording, &evidence, &change, began)?;
    let picture = flags.picture(&answer);
    if let Some(folder) = &flags.out {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    draw(&picture, flags, &recording, &answer)?;
    let report = Report {
        answer: &answer,
        flags,
        picture: &picture,
        wall: began.elapsed(),
    };
    if flags.json {
        println!("{}", report.as_json());
    } else {
        println!("{}", report.as_text());
    }
    Ok(if recording.damage.is_empty() {
        Outcome::Done
    } else {
        Outcome::Incomplete
    })
}

fn ask(recording: &Recording, evidence: &Evidence, change: &Change, began: Instant) -> anyhow::Result<WhatIf> {
    let bar = ProgressBar::no_length();
    let answer = what_if(recording, evidence, change, |seconds| {
        if began.elapsed() > PATIENCE {
            bar.set_message(format!("{seconds:.0} s of the session"));
            bar.tick();
        }
    });
    bar.finish_and_clear();
    answer.map_err(|why| match why {
        NoAnswer::Unbuildable(why) => BadConfiguration::from(why).into(),
        why => anyhow::Error::from(why),
    })
}

/// Both runs in the order of time; at equal times the original comes first.
fn draw(path: &Path, flags: &WhatIfFlags, recording: &Recording, answer: &WhatIf) -> anyhow::Result<()> {
    let provenance = Provenance {
        robot: recording
            .robot
            .clone()
            .context("the file does not say which robot it is about")?,
        build: BUILD.to_owned(),
        epoch_unix_nanos: recording.epoch_unix_nanos,
    };
    let timing = answer.timing;
    let mut newest = Stamp(0);
    let original = recording.messages.iter().map(|message| {
        // A mark has no tick of its own: it stays where it arrived.
        newest = newest.max(timing.session_time(message.at, message.header.tick));
        (Side::Original, newest, message.topic, message.bytes.as_slice())
    });
    let mut messages: Vec<(Side, Stamp, Topic, &[u8])> = original.collect();
    let from = messages.first().map_or(Stamp(0), |(_, at, ..)| *at);
    let alternative = answer.messages.iter().filter(|said| said.at >= from);
    messages.extend(alternative.map(|said| (Side::Alternative, said.at, said.topic, said.bytes.as_slice())));
    messages.sort_by_key(|(_, at, ..)| *at);
    let words = words(flags, answer);
    let heading = Heading {
        name: &format!("law {}", answer.law),
        words: &words,
    };
    Ok(save_what_if(path, timing, &provenance, heading, messages)?)
}

/// What stands over the picture.
fn words(flags: &WhatIfFlags, answer: &WhatIf) -> String {
    let mut words = format!("**{}**\n", changed(flags, answer));
    for caveat in &answer.caveats {
        words.push_str(&format!("\n- {caveat}"));
    }
    words
}

fn changed(flags: &WhatIfFlags, answer: &WhatIf) -> String {
    let law = if answer.law == answer.law_then {
        format!("law {} as it was", answer.law)
    } else {
        format!("law {} instead of {}", answer.law, answer.law_then)
    };
    let model = flags.model.as_ref().map_or("model as it was".to_owned(), |path| {
        format!("model {} instead of the session's", path.display())
    });
    format!("What if: {law}, {model}")
}

impl WhatIfFlags {
    fn picture(&self, answer: &WhatIf) -> PathBuf {
        let folder = self.out.clone().or_else(|| self.session.parent().map(Path::to_owned));
        let law = answer.law.to_string().replace('=', "-");
        let model = self.model.as_ref().and_then(|path| path.file_stem());
        let model = model.map_or(String::new(), |stem| format!("-{}", stem.to_string_lossy()));
        folder.unwrap_or_default().join(format!("what-if-{law}{model}.rrd"))
    }
}

struct Report<'a> {
    answer: &'a WhatIf,
    flags: &'a WhatIfFlags,
    picture: &'a Path,
    wall: Duration,
}

/// A figure that is compared: its name, its unit's factor, its digits, and where it stands.
type Figure = (&'static str, f64, usize, fn(&Measures) -> Option<f64>);

const FIGURES: [Figure; 9] = [
    ("human effort, m/s", 1.0, 3, |of| of.human_effort_mean_m_s),
    ("mean ω after the checkpoint", 1.0, 3, |of| of.weight_mean_after),
    ("disagreement, m/s", 1.0, 3, |of| of.disagreement_mean_m_s),
    ("smallest clearance, mm", 1e3, 1, |of| of.min_clearance_m),
    ("contacts", 1.0, 0, |of| Some(f64::from(of.contacts))),
    ("off the forecast, mean mm", 1e3, 1, |of| of.tracking_forecast_mean_m),
    ("off the forecast, at most mm", 1e3, 1, |of| of.tracking_forecast_max_m),
    ("from the goal at the end, mm", 1e3, 1, |of| of.goal_distance_m),
    ("stops", 1.0, 0, |of| u32::try_from(of.stops.len()).ok().map(f64::from)),
];

impl Report<'_> {
    fn as_text(&self) -> String {
        let answer = self.answer;
        let mut lines = vec![changed(self.flags, answer)];
        for trial in &answer.trials {
            lines.push(trial_text(trial));
        }
        // In real time no stamp is the same, whatever the robot does.
        if answer.timing.pace == Pace::Lockstep {
            let (same, all) = answer.same;
            lines.push(format!(
                "{same} of {all} states and setpoints are the original's, byte for byte"
            ));
        }
        lines.extend(answer.caveats.iter().map(|caveat| format!("not known: {caveat}")));
        lines.push(format!(
            "{:.1} s lived through again in {:.2} s   (see both: rerun {})",
            answer.span_s(),
            self.wall.as_secs_f64(),
            self.picture.display()
        ));
        lines.join("\n")
    }

    fn as_json(&self) -> Value {
        let answer = self.answer;
        json!({
            "law": answer.law.to_string(),
            "law_then": answer.law_then.to_string(),
            "model": self.flags.model.as_ref().map(|path| path.display().to_string()),
            "trials": answer.trials.iter().map(trial_json).collect::<Vec<_>>(),
            "same_as_original": answer.same.0,
            "states_and_setpoints": answer.same.1,
            "is_the_original": answer.is_the_original(),
            "not_known": answer.caveats,
            "rrd_path": self.picture.display().to_string(),
            "session_s": answer.span_s(),
            "wall_s": self.wall.as_secs_f64(),
        })
    }
}

fn trial_text(trial: &Comparison) -> String {
    let (trace, original) = &trial.original;
    let alternative = &trial.alternative.1;
    let text = |value: Option<f64>, digits: usize| value.map_or("–".to_owned(), |value| format!("{value:.digits$}"));
    let mut rows = vec![(
        "",
        format!("{:>10} {:>12} {:>12}", "as it was", "what if", "difference"),
    )];
    for (name, factor, digits, of) in FIGURES {
        let (then, now) = (of(original).map(|v| v * factor), of(alternative).map(|v| v * factor));
        let difference = then.zip(now).map(|(then, now)| format!("{:+.digits$}", now - then));
        rows.push((
            name,
            format!(
                "{:>10} {:>12} {:>12}",
                text(then, digits),
                text(now, digits),
                difference.unwrap_or_else(|| "–".to_owned())
            ),
        ));
    }
    let reached = |of: &Measures| if of.reached_goal { "reached" } else { "missed" };
    rows.push((
        "goal",
        format!("{:>10} {:>12}", reached(original), reached(alternative)),
    ));
    let apart = |value: Option<f64>| value.map_or("–".to_owned(), |metres| format!("{:.1}", metres * 1e3));
    rows.push((
        "off the recorded path, mm",
        format!(
            "{:>10} {:>12}   at most {}",
            "",
            apart(trial.apart_mean_m),
            apart(trial.apart_max_m)
        ),
    ));
    let parts = trial
        .parts_at
        .map_or("never".to_owned(), |tick| format!("at tick {tick}"));
    rows.push(("the two part", format!("{:>10} {parts:>12}", "")));
    format!("trial {} {}\n{}", trace.trial, trace.label, table::rows(&rows))
}

fn trial_json(trial: &Comparison) -> Value {
    json!({
        "trial": trial.original.0.trial,
        "label": trial.original.0.label,
        "original": trial.original.1,
        "alternative": trial.alternative.1,
        "off_recorded_path_mean_m": trial.apart_mean_m,
        "off_recorded_path_max_m": trial.apart_max_m,
        "parts_at_tick": trial.parts_at,
    })
}
