//! Text → checked settings.

use tandem_settings::{Error, Found, Limits, Value, choices, settings};
use tandem_wire::{MILLISECOND, Nanos, SECOND, TaskFrame, Timing};

use crate::family::FamilyPath;
use crate::random::Draws;
use crate::wish::Spread;

choices! {
    /// Where motion comes from.
    pub enum SourceKind {
        /// A simulated human.
        Simulated = "simulated",
        /// The keyboard of this terminal.
        Keyboard = "keyboard",
        /// A recording: `tandem replay --drive` sets this itself.
        Replayed = "replayed",
    }
}

choices! {
    /// How the simulated human steers. The formulas stand in `policy.rs`.
    pub enum HumanKind {
        /// Goes part of the way to where it wants to be next.
        Pursuit = "pursuit",
        /// The same, but only when the movement would miss otherwise.
        Intermittent = "intermittent",
        /// Goes part of the way to where it wants to be now.
        Lagged = "lagged",
        /// Knows the robot's share and cancels it.
        Compensating = "compensating",
    }
}

/// What a trial is called: a line that any message, table and picture has room for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label(String);

impl Label {
    /// The most characters that it has.
    pub const MAX: usize = 100;

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Value for Label {
    type Literal = &'static str;
    type Limit = std::convert::Infallible;

    fn from_literal(literal: &&'static str) -> Self {
        Self((*literal).to_owned())
    }

    fn expected() -> String {
        String::expected()
    }

    fn read(found: &Found, limits: &Limits<Self::Limit>) -> Result<Self, Error> {
        let text = String::read(found, limits)?;
        if text.chars().count() <= Self::MAX && !text.contains(char::is_control) {
            return Ok(Self(text));
        }
        Err(Error::OutOfRange {
            place: found.place().clone(),
            key: found.key().to_owned(),
            value: format!("a text of {} characters", text.chars().count()),
            allowed: Self::allowed(limits).unwrap_or_default(),
        })
    }

    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    fn allowed(_: &Limits<Self::Limit>) -> Option<String> {
        Some(format!("one line of at most {} characters", Self::MAX))
    }
}

settings! {
    /// The operator: who steers, and how.
    pub struct OperatorSettings("operator") {
        /// Where motion comes from.
        pub source: SourceKind = SourceKind::Simulated;
        /// What others see this operator as; "supervisor" may take the lease over, see arbiter.supervisors; with certificates it takes that role, too.
        pub name: String = "operator";
        /// Speed of the tool while a key is held, in metres per second.
        pub keyboard_speed_m_s: f64 = 0.1, in 0.005..=0.5;
        /// A device that is silent for longer counts as released, in milliseconds.
        pub device_timeout_ms: u32 = 150, in 40..=1000;
        /// What trials begun from the keyboard are called.
        pub trial_label: Label = "keyboard";
    }
}

settings! {
    /// The simulated human.
    pub struct HumanSettings("operator.human") {
        /// How it steers.
        pub kind: HumanKind = HumanKind::Pursuit;
        /// Amplitude of the path it wishes to follow, in metres; demonstrated are 0.08, 0.11 and 0.14.
        pub amplitude_m: f64 = 0.12, in -0.3..=0.3;
        /// The share of the way that it goes in one control period.
        pub gain: f64 = 0.6, in 0.05..=1.0;
        /// Noise of the hand per axis and control period, standard deviation in millimetres.
        pub noise_mm: f64 = 1.5, in 0.0..=20.0;
        /// It never commands more than this, in metres per second.
        pub speed_cap_m_s: f64 = 0.5, in 0.05..=0.5;
        /// It acts on what it saw this long ago, in milliseconds; rounded to whole control periods.
        pub reaction_ms: u32 = 0, in 0..=1000;
        /// How far its wish lies from the path, along and across: root mean square in millimetres.
        pub deviation_mm: f64 = 5.0, in 0.0..=50.0;
        /// How much farther across, over the whole path: root mean square in millimetres.
        pub departure_mm: f64 = 0.0, in 0.0..=200.0;
        /// How far it departs only after the checkpoint, at the farthest: standard deviation in millimetres.
        pub late_departure_mm: f64 = 0.0, in 0.0..=200.0;
        /// Which of the seed's wishes and tremors it has; 0: that of the trial's number.
        pub wish: u32 = 0;
        /// It gives up after this long, in seconds.
        pub time_limit_s: u32 = 15, in 1..=3600;
    }
}

/// No source may command more than this, in metres per second.
pub(crate) const MAX_SPEED: f64 = 0.5;

/// What the simulated human needs to know, in metres, seconds and whole periods.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HumanConfig {
    pub(crate) kind: HumanKind,
    pub(crate) path: FamilyPath,
    pub(crate) frame: TaskFrame,
    pub(crate) seed: u64,
    /// The wish and tremor of every trial, instead of each one's own.
    pub(crate) wish: Option<u32>,
    pub(crate) gain: f64,
    pub(crate) noise: f64,
    pub(crate) speed_cap: f64,
    pub(crate) spread: Spread,
    pub(crate) period: Nanos,
    pub(crate) reaction_ticks: usize,
    pub(crate) patience_ticks: u32,
    pub(crate) limit_ticks: u32,
}

/// So long the human presses on while the robot does not move, before letting go and pressing anew.
const PATIENCE: Nanos = 500 * MILLISECOND;
/// At least two: the robot's answer to a press takes one period to be seen.
const MIN_PATIENCE_TICKS: u32 = 2;
/// A reaction takes no more periods than this, whatever the period: it bounds what the human remembers.
const MAX_REACTION_TICKS: u64 = 1000;

impl HumanConfig {
    pub(crate) fn new(settings: &HumanSettings, timing: &Timing, frame: TaskFrame, seed: u64) -> Self {
        let period = timing.period.max(1);
        let ticks = |nanos: Nanos| u32::try_from(nanos.div_ceil(period)).unwrap_or(u32::MAX);
        let reaction = (u64::from(settings.reaction_ms) * MILLISECOND + period / 2) / period;
        Self {
            kind: settings.kind,
            path: FamilyPath::new(settings.amplitude_m),
            frame,
            seed,
            wish: (settings.wish > 0).then_some(settings.wish),
            gain: settings.gain,
            noise: settings.noise_mm * 1e-3,
            speed_cap: settings.speed_cap_m_s,
            spread: Spread {
                deviation: settings.deviation_mm * 1e-3,
                departure: settings.departure_mm * 1e-3,
                late_departure: settings.late_departure_mm * 1e-3,
            },
            period,
            reaction_ticks: usize::try_from(reaction.min(MAX_REACTION_TICKS)).expect("a thousand fits"),
            patience_ticks: ticks(PATIENCE).max(MIN_PATIENCE_TICKS),
            limit_ticks: ticks(u64::from(settings.time_limit_s) * SECOND),
        }
    }

    /// The random numbers of a trial.
    pub(crate) fn draws(&self, trial: u32) -> Draws {
        Draws::new(self.seed, self.wish.unwrap_or(trial))
    }

    pub(crate) fn period_s(&self) -> f64 {
        tandem_wire::seconds(self.period)
    }
}

/// What the device's side needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KeyConfig {
    pub(crate) frame: TaskFrame,
    pub(crate) speed: f64,
    pub(crate) timeout: Nanos,
}

impl KeyConfig {
    pub(crate) fn new(settings: &OperatorSettings, frame: TaskFrame) -> Self {
        Self {
            frame,
            speed: settings.keyboard_speed_m_s,
            timeout: settings.device_timeout(),
        }
    }
}

impl OperatorSettings {
    /// After this much silence a device counts as released.
    pub(crate) fn device_timeout(&self) -> Nanos {
        u64::from(self.device_timeout_ms) * MILLISECOND
    }
}

#[cfg(test)]
mod tests {
    use tandem_settings::{Document, Section, show};

    use super::*;

    #[test]
    fn every_default_lies_in_its_own_range() {
        let (operator, human) = (OperatorSettings::default(), HumanSettings::default());
        let text = format!("{}\n{}", show(&operator), show(&human));
        let document = Document::parse("defaults", &text).unwrap();
        assert_eq!(document.section::<OperatorSettings>().unwrap(), operator);
        assert_eq!(document.section::<HumanSettings>().unwrap(), human);
        document.finish(&[OperatorSettings::NAME, HumanSettings::NAME]).unwrap();
    }

    #[test]
    fn a_label_is_one_line_that_fits_into_a_message() {
        let read = |label: &str| {
            let mut document = Document::default();
            document.set("operator.trial_label", label);
            document.section::<OperatorSettings>()
        };
        assert_eq!(read("ümläut 12").unwrap().trial_label.as_str(), "ümläut 12");
        for wrong in [&"x".repeat(101), "two\nlines"] {
            let refused = read(wrong).unwrap_err().to_string();
            assert!(
                refused.ends_with("allowed: one line of at most 100 characters"),
                "{refused}"
            );
        }
    }

    #[test]
    fn times_become_whole_periods() {
        let settings = HumanSettings {
            reaction_ms: 249,
            ..HumanSettings::default()
        };
        let human = HumanConfig::new(&settings, &Timing::default(), TaskFrame::default(), 1);
        assert_eq!(
            (human.reaction_ticks, human.patience_ticks, human.limit_ticks),
            (2, 5, 150)
        );
        let odd = Timing {
            period: 0,
            ..Timing::default()
        };
        assert_eq!(
            HumanConfig::new(&settings, &odd, TaskFrame::default(), 1).reaction_ticks,
            1000
        );
    }
}
