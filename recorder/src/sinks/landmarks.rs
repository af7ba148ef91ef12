//! What a new part of a session file needs so that it can be read alone: how the nodes are built, and what holds.

use std::collections::BTreeMap;
use std::sync::Arc;

use tandem_wire::{NodeName, Trial};

use crate::heard::{Entry, Heard, Sample};

/// The newest of each thing that lasts.
#[derive(Clone, Debug, Default)]
pub(super) struct Landmarks {
    infos: BTreeMap<NodeName, Arc<Heard>>,
    scene: Option<Arc<Heard>>,
    trial: Option<Arc<Heard>>,
    forecast: Option<Arc<Heard>>,
}

impl Landmarks {
    pub(super) fn hear(&mut self, heard: &Arc<Heard>) {
        let Entry::Sample(sample) = &heard.entry else { return };
        match sample {
            Sample::Info(node, _) => {
                self.infos.insert(*node, Arc::clone(heard));
            }
            Sample::Scene(_) => self.scene = Some(Arc::clone(heard)),
            Sample::Forecast(_) => self.forecast = Some(Arc::clone(heard)),
            Sample::Trial(message) => match message.body {
                Trial::Begin { .. } => self.trial = Some(Arc::clone(heard)),
                // What belonged to the trial is over with it.
                Trial::End { .. } => (self.trial, self.forecast) = (None, None),
            },
            _ => {}
        }
    }

    /// All of them, what the others rest on first.
    pub(super) fn all(&self) -> Vec<Arc<Heard>> {
        let lasting = [&self.scene, &self.trial, &self.forecast].into_iter().flatten();
        self.infos.values().chain(lasting).cloned().collect()
    }
}
