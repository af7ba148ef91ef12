//! What is swept, from text to checked values.

use tandem_cesn::Model;
use tandem_link::Impairments;
use tandem_operator::HumanKind;
use tandem_settings::{Document, Error, Section, settings, show};
use tandem_wire::Session;

use crate::{Blueprint, Configuration, Unbuildable};

settings! {
    /// What `tandem trial sweep` varies. The other sections of the file hold for every trial.
    pub struct SweepSettings("sweep") {
        /// The simulated humans.
        pub humans: Vec<HumanKind> = [HumanKind::Pursuit, HumanKind::Intermittent, HumanKind::Lagged, HumanKind::Compensating];
        /// How far their wishes depart from the family of the demonstrations, over the whole path: root mean square in
        /// millimetres.
        pub departures_mm: Vec<f64> = [0.0, 20.0, 30.0, 60.0], in 0.0..=200.0;
        /// The laws: a name of arbiter.law, "constant=W", either followed by further settings, as in
        /// "adaptive; arbiter.weight_floor=0.25".
        pub laws: Vec<String> = ["adaptive", "fixed", "human", "constant=0.1", "constant=0.25", "constant=0.75"];
        /// How many seeds, each of which is another person.
        pub seeds: u32 = 20, in 1..=10000;
        /// The first of them; the others follow.
        pub first_seed: u64 = 1;
        /// Amplitudes of the wished paths between the demonstrations (0.08, 0.11 and 0.14 m), in metres.
        pub inside_m: Vec<f64> = [0.083, 0.087, 0.09, 0.094, 0.1, 0.105, 0.118, 0.122, 0.128, 0.135], in -0.3..=0.3;
        /// Amplitudes outside of them, in metres.
        pub outside_m: Vec<f64> = [0.05, 0.06, 0.165, 0.18], in -0.3..=0.3;
    }
}

/// A grid that cannot be swept.
#[derive(Debug, thiserror::Error)]
pub enum BadGrid {
    /// A key that is unknown, misspelt or out of range.
    #[error(transparent)]
    Setting(#[from] Error),
    /// An axis of the grid without values.
    #[error("sweep.{key} is empty: give at least one")]
    Empty {
        /// Which key.
        key: &'static str,
    },
    /// A law that is none, or whose further settings are none.
    #[error("sweep.laws: {entry:?}: {why}")]
    Law {
        /// As it was given.
        entry: String,
        /// What is wrong with it.
        why: String,
    },
    /// Settings that cannot be right together.
    #[error(transparent)]
    Unbuildable(#[from] Unbuildable),
}

/// A law of the grid: what it is called in tables, and the whole configuration that it means.
#[derive(Clone, Debug)]
pub struct LawEntry {
    /// As it was given.
    pub name: String,
    /// The weight, if it is a constant and nothing else was changed: those are what a law has to beat.
    pub constant: Option<f64>,
    /// Everything that is set under it.
    pub configuration: Configuration,
}

/// What is swept.
#[derive(Clone)]
pub struct Grid {
    /// The axes.
    pub settings: SweepSettings,
    /// The laws, resolved.
    pub laws: Vec<LawEntry>,
    /// The configuration without any law's own settings, and the model.
    pub(crate) base: Blueprint,
}

impl Grid {
    /// Reads the `[sweep]` section and, for every law, the configuration around it.
    ///
    /// # Errors
    /// At the first thing that is wrong, by name; also when nodes cannot be built from a law's configuration.
    pub fn from_document(document: &Document, model: Model) -> Result<Self, BadGrid> {
        let settings: SweepSettings = document.section()?;
        let empty = [
            ("humans", settings.humans.is_empty()),
            ("departures_mm", settings.departures_mm.is_empty()),
            ("laws", settings.laws.is_empty()),
            (
                "inside_m and sweep.outside_m",
                settings.inside_m.is_empty() && settings.outside_m.is_empty(),
            ),
        ];
        if let Some((key, _)) = empty.into_iter().find(|(_, empty)| *empty) {
            return Err(BadGrid::Empty { key });
        }
        let mut document = document.clone();
        // A bad line is told most finely where messages stream as in real time; that time is virtual all the same.
        let impairments = Impairments::from_document(&document)?;
        document.set("loop.pace", if impairments.is_empty() { "max" } else { "real" });
        document.set("operator.source", "simulated");
        let base = Configuration::from_document_beside(&document, &[SweepSettings::NAME])?;
        let entries = settings.laws.iter().map(|entry| law(&document, entry));
        let laws = entries.collect::<Result<Vec<_>, _>>()?;
        let base = Blueprint::new(base, Session(1), Some(model))?;
        for law in &laws {
            let blueprint = base.with_configuration(law.configuration.clone())?;
            blueprint.arbiter()?;
            blueprint.predictor()?;
            blueprint.robot_sim()?;
        }
        Ok(Self { settings, laws, base })
    }

    /// Everything that decides what comes out, as TOML: two grids of the same text give the same results.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let hash = self.base.models().first().map(|model| model.hash()).unwrap_or_default();
        let hash: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
        format!(
            "# model {hash}\n{}\n{}",
            show(&self.settings),
            self.base.configuration().to_toml()
        )
    }

    /// How many contexts every cell has.
    #[must_use]
    pub fn contexts(&self) -> usize {
        self.settings.inside_m.len() + self.settings.outside_m.len()
    }
}

/// `NAME[=WEIGHT][; KEY=VALUE]…`
fn law(document: &Document, entry: &str) -> Result<LawEntry, BadGrid> {
    let refused = |why: String| BadGrid::Law {
        entry: entry.to_owned(),
        why,
    };
    let mut document = document.clone();
    let mut parts = entry.split(';').map(str::trim);
    let head = parts.next().unwrap_or_default();
    let (name, weight) = match head.split_once('=') {
        Some((name, weight)) => (name.trim(), Some(weight.trim())),
        None => (head, None),
    };
    document.set("arbiter.law", name);
    match (name, weight) {
        ("constant", Some(weight)) => document.set("arbiter.constant_weight", weight),
        ("constant", None) => return Err(refused("say which weight, as in constant=0.25".to_owned())),
        (_, Some(_)) => return Err(refused("only a constant has a weight".to_owned())),
        (_, None) => {}
    }
    let mut plain = true;
    for part in parts.filter(|part| !part.is_empty()) {
        let Some((key, value)) = part.split_once('=') else {
            return Err(refused(format!(
                "{part:?}: write KEY=VALUE, as in arbiter.weight_floor=0.25"
            )));
        };
        document.set(key.trim(), value.trim());
        plain = false;
    }
    let read = Configuration::from_document_beside(&document, &[SweepSettings::NAME]);
    let configuration = read.map_err(|why| refused(why.to_string()))?;
    let constant = match name {
        "constant" => Some(configuration.arbiter.constant_weight),
        "fixed" => Some(0.5),
        "human" => Some(1.0),
        "robot" => Some(0.0),
        _ => None,
    };
    Ok(LawEntry {
        name: entry.to_owned(),
        constant: constant.filter(|_| plain),
        configuration,
    })
}
