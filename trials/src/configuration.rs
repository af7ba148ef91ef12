//! Everything that can be set, checked.

use tandem_arbiter::ArbiterSettings;
use tandem_link::{ClockSettings, Impairments, LinkSettings, LoopSettings, TaskSettings};
use tandem_operator::{HumanSettings, OperatorSettings};
use tandem_predictor::PredictorSettings;
use tandem_recorder::RecorderSettings;
use tandem_robot_sim::RobotSimSettings;
use tandem_settings::{Document, Error, Section, show};

use crate::drive::DriveSettings;

/// The settings of every part, each checked by itself.
#[derive(Clone, Debug, Default)]
pub struct Configuration {
    /// Who to talk to.
    pub link: LinkSettings,
    /// How clocks are watched.
    pub clock: ClockSettings,
    /// Bad lines, on purpose.
    pub impairment: Impairments,
    /// Rates, limits in time and the seed.
    pub rates: LoopSettings,
    /// Where the task lies.
    pub task: TaskSettings,
    /// The operator.
    pub operator: OperatorSettings,
    /// The simulated human.
    pub human: HumanSettings,
    /// The predictor.
    pub predictor: PredictorSettings,
    /// The arbiter.
    pub arbiter: ArbiterSettings,
    /// The simulated robot.
    pub robot: RobotSimSettings,
    /// The recorder.
    pub recorder: RecorderSettings,
    /// Driving along a recording.
    pub replay: DriveSettings,
}

impl Configuration {
    /// The sections it is read from.
    pub const SECTIONS: [&'static str; 18] = [
        LinkSettings::NAME,
        ClockSettings::NAME,
        Impairments::SECTIONS[0],
        Impairments::SECTIONS[1],
        Impairments::SECTIONS[2],
        Impairments::SECTIONS[3],
        Impairments::SECTIONS[4],
        Impairments::SECTIONS[5],
        Impairments::SECTIONS[6],
        LoopSettings::NAME,
        TaskSettings::NAME,
        OperatorSettings::NAME,
        HumanSettings::NAME,
        PredictorSettings::NAME,
        ArbiterSettings::NAME,
        RobotSimSettings::NAME,
        RecorderSettings::NAME,
        DriveSettings::NAME,
    ];

    /// Reads every section and refuses what belongs to none.
    ///
    /// # Errors
    /// At the first key that is unknown, misspelt or out of range, with its place.
    pub fn from_document(document: &Document) -> Result<Self, Error> {
        Self::from_document_beside(document, &[])
    }

    /// The same for a document that also holds `others`: sections that somebody else reads.
    ///
    /// # Errors
    /// At the first key that is unknown, misspelt or out of range, with its place.
    pub fn from_document_beside(document: &Document, others: &[&str]) -> Result<Self, Error> {
        let configuration = Self {
            link: document.section()?,
            clock: document.section()?,
            impairment: Impairments::from_document(document)?,
            rates: document.section()?,
            task: document.section()?,
            operator: document.section()?,
            human: document.section()?,
            predictor: document.section()?,
            arbiter: document.section()?,
            robot: document.section()?,
            recorder: document.section()?,
            replay: document.section()?,
        };
        document.finish(&[&Self::SECTIONS, others].concat())?;
        Ok(configuration)
    }

    /// The whole configuration as commented TOML, which reads back the same.
    #[must_use]
    pub fn to_toml(&self) -> String {
        [
            show(&self.link),
            show(&self.clock),
            self.impairment.to_toml(),
            show(&self.rates),
            show(&self.task),
            show(&self.operator),
            show(&self.human),
            show(&self.predictor),
            show(&self.arbiter),
            show(&self.robot),
            show(&self.recorder),
            show(&self.replay),
        ]
        .join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shown_is_read_back_whole() {
        let mut configuration = Configuration::default();
        configuration.arbiter.weight_floor = 0.1 + 0.2;
        let shown = configuration.to_toml();
        let read = Configuration::from_document(&Document::parse("shown", &shown).unwrap()).unwrap();
        assert_eq!(read.arbiter, configuration.arbiter);
        assert_eq!(read.to_toml(), shown);
    }
}
