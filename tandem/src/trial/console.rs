//! What a person is asked between trials: a pure state machine, lines in, texts and orders out.
//!
//! ```text
//!            Enter            Enter            the trial ends             Enter, s, f
//!  Offered ────────▶ Ready ────────▶ Driving ─────────────────▶ Judging ───────────────▶ Offered …
//!     ▲  │ q           │ q              │ Esc, r, a dead node     │  ▲ n TEXT
//!     │  ▼             ▼                │                         │  │
//!     │ Done          Done              │                         └──┘
//!     └─────────────────────────────────┴──────────── r ──────────┘
//! ```

use tandem_trials::run::{JudgedBy, TrialOutcome};

/// What happens to the console.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Heard {
    /// A line was typed.
    Line(String),
    /// There are no more lines.
    Closed,
    /// The trial ended by itself; the plan's rule says so.
    Ended {
        outcome: TrialOutcome,
        reason: Option<String>,
    },
    /// The trial cannot be judged and is offered again.
    Aborted(String),
}

/// What the console wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Show this.
    Say(String),
    /// Begin the trial.
    Drive,
    /// The trial counts, or was aborted, so.
    Record(Verdict),
    /// No more trials for now.
    Leave,
}

/// What is written down about a trial.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Verdict {
    pub(crate) outcome: TrialOutcome,
    pub(crate) judged_by: JudgedBy,
    pub(crate) reason: Option<String>,
    pub(crate) note: String,
}

/// Characters of a note.
const NOTE_MAX: usize = 2000;

#[derive(Clone, Debug, PartialEq, Eq)]
enum Stage {
    Offered,
    Ready,
    Driving,
    Judging(Verdict),
    Done,
}

/// One trial's prompts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Console {
    title: String,
    stage: Stage,
}

impl Console {
    /// Offers a trial under this title, such as "trial 3 of 28: context a083".
    pub(crate) fn offer(title: String) -> (Self, Vec<Order>) {
        let text = format!("\n{title}\nEnter: get ready   q: stop here for now");
        let stage = Stage::Offered;
        (Self { title, stage }, vec![Order::Say(text)])
    }

    /// Whether a line is awaited.
    pub(crate) fn awaits_line(&self) -> bool {
        matches!(self.stage, Stage::Offered | Stage::Ready | Stage::Judging(_))
    }

    /// Whether this trial's prompts are over.
    pub(crate) fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Takes in what happened.
    pub(crate) fn hear(&mut self, heard: Heard) -> Vec<Order> {
        let (stage, orders) = match (std::mem::replace(&mut self.stage, Stage::Done), heard) {
            (Stage::Offered, Heard::Line(line)) => self.offered(&line),
            (Stage::Ready, Heard::Line(line)) => Self::ready(&line),
            (Stage::Driving, Heard::Ended { outcome, reason }) => judging(outcome, reason),
            (Stage::Driving, Heard::Aborted(why)) => {
                let text = format!("The trial was aborted ({why}); it will be offered again.");
                (
                    Stage::Done,
                    vec![Order::Say(text), Order::Record(aborted(why, String::new()))],
                )
            }
            (Stage::Judging(verdict), Heard::Line(line)) => judged(verdict, &line),
            // Nobody is there any more: what was driven counts as the rule says.
            (Stage::Judging(verdict), Heard::Closed) => (Stage::Done, vec![Order::Record(verdict), Order::Leave]),
            (Stage::Offered | Stage::Ready, Heard::Closed) => (Stage::Done, vec![Order::Leave]),
            // Nothing that makes sense here: as if it had not been said.
            (stage, _) => (stage, Vec::new()),
        };
        self.stage = stage;
        orders
    }

    fn offered(&self, line: &str) -> (Stage, Vec<Order>) {
        match line.trim() {
            "" => {
                let text = "Ready? Arrows or WASD steer, Q and E lift and lower, space holds on and lets the robot lead.\n\
                            Letting go for a second ends the trial; Esc aborts it, R repeats it.\n\
                            Enter: go   q: stop here for now";
                (Stage::Ready, vec![Order::Say(text.to_owned())])
            }
            "q" => (Stage::Done, vec![Order::Leave]),
            _ => {
                let text = format!("{}\nEnter: get ready   q: stop here for now", self.title);
                (Stage::Offered, vec![Order::Say(text)])
            }
        }
    }

    fn ready(line: &str) -> (Stage, Vec<Order>) {
        match line.trim() {
            "" => (Stage::Driving, vec![Order::Say("Go!".to_owned()), Order::Drive]),
            "q" => (Stage::Done, vec![Order::Leave]),
            _ => (
                Stage::Ready,
                vec![Order::Say("Enter: go   q: stop here for now".to_owned())],
            ),
        }
    }
}

const CHOICES: &str = "Enter: accept   s: success   f: failure   r: repeat   n TEXT: note   q: accept and stop here";

fn judging(outcome: TrialOutcome, reason: Option<String>) -> (Stage, Vec<Order>) {
    let word = match outcome {
        TrialOutcome::Success => "a success",
        _ => "a failure",
    };
    let why = reason.as_ref().map_or_else(String::new, |why| format!(" ({why})"));
    let text = format!("By the plan's rule that was {word}{why}.\n{CHOICES}");
    let verdict = Verdict {
        outcome,
        judged_by: JudgedBy::Rule,
        reason,
        note: String::new(),
    };
    (Stage::Judging(verdict), vec![Order::Say(text)])
}

fn judged(mut verdict: Verdict, line: &str) -> (Stage, Vec<Order>) {
    let line = line.trim();
    let by_person = |verdict: Verdict, outcome| Verdict {
        outcome,
        judged_by: JudgedBy::Person,
        ..verdict
    };
    match line
        .split_once(' ')
        .map_or((line, ""), |(head, rest)| (head, rest.trim()))
    {
        ("", _) => (Stage::Done, vec![Order::Record(verdict)]),
        ("q", "") => (Stage::Done, vec![Order::Record(verdict), Order::Leave]),
        ("s", "") => (
            Stage::Done,
            vec![Order::Record(by_person(verdict, TrialOutcome::Success))],
        ),
        ("f", "") => (
            Stage::Done,
            vec![Order::Record(by_person(verdict, TrialOutcome::Failure))],
        ),
        ("r", "") => {
            let why = "repeated at the person's wish".to_owned();
            let repeated = Verdict {
                judged_by: JudgedBy::Person,
                ..aborted(why, verdict.note)
            };
            (Stage::Done, vec![Order::Record(repeated)])
        }
        ("n", note) if !note.is_empty() => {
            let kept: String = note.chars().filter(|letter| !letter.is_control()).collect();
            let separator = if verdict.note.is_empty() { "" } else { "; " };
            verdict.note = format!("{}{separator}{kept}", verdict.note)
                .chars()
                .take(NOTE_MAX)
                .collect();
            let text = format!("Noted: {}\n{CHOICES}", verdict.note);
            (Stage::Judging(verdict), vec![Order::Say(text)])
        }
        _ => (Stage::Judging(verdict), vec![Order::Say(CHOICES.to_owned())]),
    }
}

fn aborted(why: String, note: String) -> Verdict {
    Verdict {
        outcome: TrialOutcome::Aborted,
        judged_by: JudgedBy::Rule,
        reason: Some(why),
        note,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> Heard {
        Heard::Line(text.to_owned())
    }

    fn success() -> Heard {
        Heard::Ended {
            outcome: TrialOutcome::Success,
            reason: None,
        }
    }

    /// What a script comes to, without what is only said.
    fn play(script: &[Heard]) -> (Console, Vec<Order>) {
        let (mut console, _) = Console::offer("trial 1 of 2".to_owned());
        let orders = script.iter().flat_map(|heard| console.hear(heard.clone()));
        let orders = orders.filter(|order| !matches!(order, Order::Say(_))).collect();
        (console, orders)
    }

    fn recorded(script: &[Heard]) -> Verdict {
        let (console, orders) = play(script);
        assert!(console.is_done());
        match &orders[..] {
            [Order::Drive, Order::Record(verdict), ..] => verdict.clone(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn ready_go_and_accept_is_three_times_enter() {
        let verdict = recorded(&[line(""), line(""), success(), line("")]);
        assert_eq!(
            (verdict.outcome, verdict.judged_by),
            (TrialOutcome::Success, JudgedBy::Rule)
        );
    }

    #[test]
    fn the_person_overrules_the_plan_and_notes_stay() {
        let verdict = recorded(&[
            line(""),
            line(""),
            success(),
            line("n slipped"),
            line("n  twice\u{7}"),
            line("f"),
        ]);
        assert_eq!(
            (verdict.outcome, verdict.judged_by),
            (TrialOutcome::Failure, JudgedBy::Person)
        );
        assert_eq!(verdict.note, "slipped; twice");
    }

    #[test]
    fn a_repeated_trial_counts_as_aborted_with_its_reason() {
        let verdict = recorded(&[line(""), line(""), success(), line("r")]);
        assert_eq!(verdict.outcome, TrialOutcome::Aborted);
        assert_eq!(verdict.reason.as_deref(), Some("repeated at the person's wish"));
    }

    #[test]
    fn a_trial_that_dies_is_recorded_without_asking() {
        let verdict = recorded(&[line(""), line(""), Heard::Aborted("predictor vanished".to_owned())]);
        assert_eq!(verdict.reason.as_deref(), Some("predictor vanished"));
    }

    #[test]
    fn nothing_is_driven_before_both_enters_and_nothing_odd_is_taken_for_one() {
        for script in [
            vec![line("x"), line("go")],
            vec![line(""), line("yes")],
            vec![success(), success()],
        ] {
            let (console, orders) = play(&script);
            assert!(console.awaits_line() && orders.is_empty(), "{script:?}: {orders:?}");
        }
    }

    #[test]
    fn leaving_before_the_trial_records_nothing_and_after_it_keeps_the_verdict() {
        assert_eq!(play(&[line("q")]).1, [Order::Leave]);
        assert_eq!(play(&[line(""), Heard::Closed]).1, [Order::Leave]);
        let (_, orders) = play(&[line(""), line(""), success(), Heard::Closed]);
        assert!(
            matches!(orders[..], [Order::Drive, Order::Record(_), Order::Leave]),
            "{orders:?}"
        );
    }

    #[test]
    fn a_note_of_any_length_stays_bounded() {
        let long = format!("n {}", "ü".repeat(100_000));
        let verdict = recorded(&[line(""), line(""), success(), line(&long), line(&long), line("")]);
        assert_eq!(verdict.note.chars().count(), NOTE_MAX);
    }
}
