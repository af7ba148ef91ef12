//! Which streams a bad line befalls, and what befalls each: the settings, and what they come to.

use std::fmt;

use tandem_settings::{Choice as _, Document, Error, Section as _, choices, settings, show, show_at};
use tandem_wire::{NodeName, Stamp, Topic};

choices! {
    /// A stream in one direction: what it carries, and to whom. The receiver's shell applies the line.
    pub enum Direction {
        /// Commands to the arbiter.
        Command = "command",
        /// Proposals to the arbiter.
        Proposal = "proposal",
        /// Setpoints to the robot.
        Setpoint = "setpoint",
        /// States to the operator.
        StateToOperator = "state-to-operator",
        /// States to the predictor.
        StateToPredictor = "state-to-predictor",
        /// States to the arbiter.
        StateToArbiter = "state-to-arbiter",
    }
}

/// A section that holds for all chosen streams and one that holds for a single stream have these keys in common.
macro_rules! line_settings {
    ($(#[$($about:tt)*])* pub struct $name:ident($section:literal) { $($more:tt)* }) => {
        settings! {
            $(#[$($about)*])*
            pub struct $name($section) {
                $($more)*
                /// How late every sample is, in milliseconds.
                pub delay_ms: f64 = 0.0, in 0.0..=10000.0;
                /// How much later still, at most; drawn evenly, in milliseconds.
                pub jitter_ms: f64 = 0.0, in 0.0..=10000.0;
                /// The share of samples that are lost.
                pub loss: f64 = 0.0, in 0.0..=1.0;
                /// The share of samples each of which comes a message's period and a half later, so that the next one
                /// overtakes it.
                pub reorder: f64 = 0.0, in 0.0..=1.0;
                /// When nothing passes: begin and length, in seconds of the receiver's time.
                pub outages_s: Vec<[f64; 2]> = [], in 0.0..=1000000.0;
                /// What all of it is drawn from.
                pub seed: u64 = 1;
            }
        }
    };
}

line_settings! {
    /// A bad line, on purpose, at the receiver of every stream chosen here; each is drawn for itself. A stream can have a
    /// section of its own, such as [impairment.command], with the same keys: that chooses it, too, and what is not said
    /// there is as here.
    pub struct ImpairmentSettings("impairment") {
        /// Which streams it befalls, besides those with a section of their own; none: none.
        pub streams: Vec<Direction> = [];
    }
}

line_settings! {
    /// The line of this stream.
    pub struct LineSettings("impairment.STREAM") {}
}

/// The bad lines of all streams.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Impairments {
    /// What befalls the chosen streams that have no line of their own.
    pub all: ImpairmentSettings,
    own: Vec<(Direction, LineSettings)>,
}

impl Direction {
    /// The section of its own line.
    #[must_use]
    pub const fn section(self) -> &'static str {
        match self {
            Self::Command => "impairment.command",
            Self::Proposal => "impairment.proposal",
            Self::Setpoint => "impairment.setpoint",
            Self::StateToOperator => "impairment.state-to-operator",
            Self::StateToPredictor => "impairment.state-to-predictor",
            Self::StateToArbiter => "impairment.state-to-arbiter",
        }
    }

    /// What it carries.
    #[must_use]
    pub const fn topic(self) -> Topic {
        match self {
            Self::Command => Topic::Command,
            Self::Proposal => Topic::Proposal,
            Self::Setpoint => Topic::Setpoint,
            Self::StateToOperator | Self::StateToPredictor | Self::StateToArbiter => Topic::State,
        }
    }

    /// Who receives it, and so applies the line.
    #[must_use]
    pub const fn receiver(self) -> NodeName {
        match self {
            Self::Command | Self::Proposal | Self::StateToArbiter => NodeName::Arbiter,
            Self::Setpoint => NodeName::RobotSim,
            Self::StateToOperator => NodeName::Operator,
            Self::StateToPredictor => NodeName::Predictor,
        }
    }
}

impl Impairments {
    /// The sections that they are read from.
    pub const SECTIONS: [&'static str; 7] = [
        ImpairmentSettings::NAME,
        Direction::Command.section(),
        Direction::Proposal.section(),
        Direction::Setpoint.section(),
        Direction::StateToOperator.section(),
        Direction::StateToPredictor.section(),
        Direction::StateToArbiter.section(),
    ];

    /// Reads `[impairment]` and the sections of single streams.
    ///
    /// # Errors
    /// At the first key that is unknown or out of range, with its place.
    pub fn from_document(document: &Document) -> Result<Self, Error> {
        let mut lines = Self {
            all: document.section()?,
            own: Vec::new(),
        };
        for &direction in Direction::ALL {
            let section = direction.section();
            let line = document.section_over(section, lines.all.line())?;
            if document.has_section(section) {
                lines.own.push((direction, line));
            }
        }
        Ok(lines)
    }

    /// The sections as commented TOML, which reads back the same. Streams without a line of their own have none.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let own = self.own.iter();
        let own = own.map(|(direction, line)| show_at(direction.section(), line));
        [show(&self.all)].into_iter().chain(own).collect::<Vec<_>>().join("\n")
    }

    /// Gives a stream a line of its own, which counts instead of the one for all.
    pub fn set(&mut self, direction: Direction, line: LineSettings) {
        match self.own.iter_mut().find(|(of, _)| *of == direction) {
            Some((_, own)) => *own = line,
            None => self.own.push((direction, line)),
        }
    }

    /// What befalls a stream, if it was chosen.
    #[must_use]
    pub fn line(&self, direction: Direction) -> Option<LineSettings> {
        let own = self.own.iter().find(|(of, _)| *of == direction);
        let chosen = || self.all.streams.contains(&direction).then(|| self.all.line());
        own.map(|(_, line)| line.clone()).or_else(chosen)
    }

    /// The streams that were chosen, each with what befalls it.
    pub fn lines(&self) -> impl Iterator<Item = (Direction, LineSettings)> + '_ {
        let all = Direction::ALL.iter();
        all.filter_map(|&direction| Some((direction, self.line(direction)?)))
    }

    /// Whether no stream was chosen.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.all.streams.is_empty() && self.own.is_empty()
    }

    /// The same for one trial: drawn for itself, and with outages told from its begin.
    #[must_use]
    pub fn of_trial(mut self, seed: u64, begin: Stamp) -> Self {
        let own = self
            .own
            .iter_mut()
            .map(|(_, line)| (&mut line.seed, &mut line.outages_s));
        for (drawn, outages) in own.chain([(&mut self.all.seed, &mut self.all.outages_s)]) {
            // TOML's integers have a sign.
            *drawn = (*drawn ^ seed) & i64::MAX.unsigned_abs();
            for [at, _] in outages {
                *at += begin.seconds();
            }
        }
        self
    }
}

impl ImpairmentSettings {
    /// What befalls a stream without a line of its own.
    #[must_use]
    pub fn line(&self) -> LineSettings {
        let Self {
            streams: _,
            delay_ms,
            jitter_ms,
            loss,
            reorder,
            outages_s,
            seed,
        } = self;
        LineSettings {
            delay_ms: *delay_ms,
            jitter_ms: *jitter_ms,
            loss: *loss,
            reorder: *reorder,
            outages_s: outages_s.clone(),
            seed: *seed,
        }
    }
}

/// In words, for every stream that was chosen: "command 100 ms late; setpoint 10 % lost".
impl fmt::Display for Impairments {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = self
            .lines()
            .map(|(direction, line)| format!("{} {line}", direction.name()));
        f.write_str(&lines.collect::<Vec<_>>().join("; "))
    }
}

/// In words: "100 ms late, 10 % lost".
impl fmt::Display for LineSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let some = |amount: f64, words: String| (amount > 0.0).then_some(words);
        let outages = self
            .outages_s
            .iter()
            .map(|[begin, length]| format!("cut at {begin} s for {length} s"));
        let parts = [
            some(self.delay_ms, format!("{} ms late", self.delay_ms)),
            some(self.jitter_ms, format!("up to {} ms of jitter", self.jitter_ms)),
            some(self.loss, format!("{} % lost", percent(self.loss))),
            some(self.reorder, format!("{} % overtaken", percent(self.reorder))),
        ];
        let words: Vec<String> = parts.into_iter().flatten().chain(outages).collect();
        match words.is_empty() {
            true => f.write_str("clean"),
            false => f.write_str(&words.join(", ")),
        }
    }
}

/// A share in per cent without the noise of its binary digits.
fn percent(share: f64) -> f64 {
    (share * 1e6).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Impairments, Error> {
        let document = Document::parse("tandem.toml", text)?;
        let read = Impairments::from_document(&document)?;
        document.finish(&Impairments::SECTIONS)?;
        Ok(read)
    }

    #[test]
    fn a_streams_own_section_chooses_it_and_leaves_the_rest_as_for_all() {
        let lines =
            read("[impairment]\nstreams = ['proposal']\ndelay_ms = 20\n[impairment.command]\nloss = 0.1").unwrap();
        let befallen: Vec<_> = lines
            .lines()
            .map(|(direction, line)| (direction, line.delay_ms, line.loss))
            .collect();
        assert_eq!(
            befallen,
            [(Direction::Command, 20.0, 0.1), (Direction::Proposal, 20.0, 0.0)]
        );
        assert_eq!(lines.line(Direction::Setpoint), None);
        assert!(!lines.is_empty() && read("[impairment]\ndelay_ms = 20").unwrap().is_empty());
    }

    #[test]
    fn what_is_printed_reads_back_the_same() {
        for text in [
            "",
            "[impairment]\nloss = 0.1\n[impairment.setpoint]\n[impairment.state-to-arbiter]\njitter_ms = 3.5",
        ] {
            let lines = read(text).unwrap();
            assert_eq!(read(&lines.to_toml()).unwrap(), lines);
        }
    }

    #[test]
    fn a_stream_that_is_none_and_a_key_that_is_none_are_named() {
        let refused = read("[impairment.comand]\nloss = 0.1").unwrap_err().to_string();
        assert!(refused.contains("impairment.comand"), "{refused}");
        let refused = read("[impairment.command]\nstreams = []").unwrap_err().to_string();
        assert!(
            refused.contains("tandem.toml:2:1") && refused.contains("impairment.command.streams"),
            "{refused}"
        );
        let refused = read("[impairment]\ncommand = 5").unwrap_err().to_string();
        assert!(refused.contains("impairment.command"), "{refused}");
    }

    #[test]
    fn a_trial_draws_for_itself_and_tells_outages_from_its_begin() {
        let lines =
            read("[impairment.command]\noutages_s = [[1.0, 0.5]]\n[impairment]\nstreams = ['proposal']").unwrap();
        let trial = lines.clone().of_trial(6, Stamp(2_000_000_000));
        let line = trial.line(Direction::Command).unwrap();
        assert_eq!((line.seed, line.outages_s), (1 ^ 6, vec![[3.0, 0.5]]));
        assert_eq!(trial.line(Direction::Proposal).unwrap().seed, 1 ^ 6);
    }

    #[test]
    fn a_line_is_told_in_words() {
        let mut line = LineSettings::default();
        assert_eq!(line.to_string(), "clean");
        (line.delay_ms, line.loss, line.outages_s) = (100.0, 0.07, vec![[3.0, 0.5]]);
        assert_eq!(line.to_string(), "100 ms late, 7 % lost, cut at 3 s for 0.5 s");
        let lines = read("[impairment.command]\ndelay_ms = 100.0\n[impairment.setpoint]").unwrap();
        assert_eq!(lines.to_string(), "command 100 ms late; setpoint clean");
    }

    #[test]
    fn the_sections_are_those_of_the_streams() {
        let streams = Direction::ALL
            .iter()
            .map(|direction| format!("impairment.{}", direction.name()));
        let sections: Vec<String> = [ImpairmentSettings::NAME.to_owned()]
            .into_iter()
            .chain(streams)
            .collect();
        assert_eq!(sections, Impairments::SECTIONS);
    }
}
