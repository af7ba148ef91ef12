//! The whole situation in a line of words: who drives, how sure the robot is, how close it came, why it stands.

use tandem_wire::{Setpoint, State, Trial};

use super::{Sheet, colours, plots::Driver, xyz};

/// The line that stands over everything, and the word at the arm's hand.
#[derive(Debug, Default)]
pub(super) struct Status {
    clearance_mm: Option<f64>,
    /// The smallest of the trial.
    least_mm: Option<f64>,
    outcome: Option<String>,
    line: String,
}

impl Status {
    /// Forgets what the trial before came to.
    pub(super) fn begin_trial(&mut self) {
        self.outcome = None;
        self.least_mm = None;
    }

    pub(super) fn hear_trial(&mut self, trial: &Trial, sheet: &mut Sheet<'_>) {
        let Trial::End { number, outcome } = trial else {
            return;
        };
        let near = self
            .least_mm
            .map_or(String::new(), |mm| format!(" · clearance was at least {mm:.0} mm"));
        let text = format!("**Trial {number} is over: {outcome}**{near}");
        if self.outcome.replace(text.clone()).as_ref() != Some(&text) {
            self.say(text, sheet);
        }
    }

    pub(super) fn hear_state(&mut self, state: &State, sheet: &mut Sheet<'_>) {
        self.clearance_mm = state
            .closest
            .or(state.clearance)
            .map(|clearance| clearance.distance.0 * 1e3);
        if let Some(mm) = self.clearance_mm.filter(|_| state.trial != 0) {
            self.least_mm = Some(self.least_mm.map_or(mm, |least| least.min(mm)));
        }
        self.draw_word(state, sheet);
    }

    fn draw_word(&self, state: &State, sheet: &mut Sheet<'_>) {
        // The hand is above the tool, where the word hides neither path nor goal.
        if let Some(hand) = state.links.last() {
            let (text, colour) = if self.outcome.is_some() {
                ("over".to_owned(), colours::WORD)
            } else {
                word(state)
            };
            let word = rerun::Points3D::new([xyz(hand.position)])
                .with_radii([0.001])
                .with_colors([colour])
                .with_labels([text])
                .with_show_labels(true);
            sheet.draw("world/driver", &word);
        }
    }

    /// Said only when it reads differently; nothing is said after the end, so that the outcome stays to be read.
    pub(super) fn hear_setpoint(&mut self, setpoint: &Setpoint, sheet: &mut Sheet<'_>) {
        if self.outcome.is_some() {
            return;
        }
        let line = line(setpoint, self.clearance_mm);
        if line != self.line {
            self.say(line, sheet);
        }
    }

    fn say(&mut self, line: String, sheet: &mut Sheet<'_>) {
        sheet.draw("now", &rerun::TextDocument::from_markdown(line.as_str()));
        self.line = line;
    }
}

fn line(setpoint: &Setpoint, clearance_mm: Option<f64>) -> String {
    let (driver, human) = (Driver::of(setpoint), setpoint.weight.0 * 1e2);
    let who = match (driver, setpoint.motion.reason()) {
        (Driver::Shared, _) => format!("**Shared: human {human:.0} %, robot {:.0} %**", 1e2 - human),
        (_, Some(reason)) => format!("**Held: {reason}**"),
        (Driver::Robot, None) => "**The robot drives**".to_owned(),
        (Driver::Human | Driver::Held, None) => "**The human drives**".to_owned(),
    };
    let sure = setpoint.guidance.map_or("no forecast".to_owned(), |guidance| {
        let width = guidance.half_width;
        let widest = width.x.max(width.y).max(width.z) * 1e3;
        format!("forecast ±{widest:.0} mm, {:.1} × training", guidance.ratio.0)
    });
    let near = clearance_mm.map_or(String::new(), |mm| format!(" · clearance {mm:.0} mm"));
    format!("{who} · {sure}{near}")
}

/// Who drives, in a word, as the robot itself understands it.
fn word(state: &State) -> (String, rerun::Color) {
    let Some(reason) = state.motion.reason() else {
        return match &state.obeys {
            Some(obeyed) => {
                let driver = Driver::of(&obeyed.setpoint);
                (driver.name().to_owned(), driver.colour())
            }
            None => (String::new(), colours::WORD),
        };
    };
    (format!("held: {reason}"), colours::WORD)
}
