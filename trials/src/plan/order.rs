//! Which trial comes when: a function of the plan and the participant's code, and of nothing else.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use sha2::{Digest, Sha256};
use tandem_operator::LAST_STEP;

use super::{Blocks, Condition, Conditions, Context, Contexts, Participant, Plan};

/// One trial that a participant is to drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Its place in the participant's order, from 1.
    pub number: u32,
    /// Whether it is only practice.
    pub practice: bool,
    /// Which condition: an index into [`Plan::conditions`].
    pub condition: usize,
    /// Which context: an index into [`Plan::contexts`].
    pub context: usize,
    /// Which repetition, from 1.
    pub repetition: u32,
    /// The seed of its human. It does not depend on the condition: every condition meets the same wish and the same
    /// tremor.
    pub seed: u64,
}

impl Plan {
    /// How many trials a participant drives, practice included.
    #[must_use]
    pub fn trials(&self) -> u64 {
        let pairs = self.conditions.len() as u64 * self.contexts.len() as u64;
        pairs * u64::from(self.settings.repetitions) + u64::from(self.settings.practice)
    }

    /// The trials of a participant, in their order: practice, then repetition by repetition.
    #[must_use]
    pub fn slots(&self, participant: &Participant) -> Vec<Slot> {
        let mut order = Order::new(self, participant);
        let mut slots = Vec::new();
        let first = order.conditions(0);
        for practice in 0..self.settings.practice as usize {
            let (condition, context) = (first[practice % first.len()], practice % self.contexts.len());
            order.add(&mut slots, condition, context, 0, practice);
        }
        for repetition in 1..=self.settings.repetitions {
            match self.order.blocks {
                Blocks::Conditions => {
                    for condition in order.conditions(repetition as usize - 1) {
                        for context in order.contexts() {
                            order.add(&mut slots, condition, context, repetition, 0);
                        }
                    }
                }
                Blocks::Contexts => {
                    for (block, context) in order.contexts().into_iter().enumerate() {
                        for condition in order.conditions(block) {
                            order.add(&mut slots, condition, context, repetition, 0);
                        }
                    }
                }
            }
        }
        slots
    }

    /// The row of the Latin square that a participant gets: the place in the plan's list, or else the code's number.
    fn row(&self, participant: &Participant) -> u64 {
        let listed = self.participants().iter().position(|other| other == participant);
        listed.map_or_else(|| participant.place(), |place| place as u64)
    }

    /// How long a trial takes that goes as wished, in seconds, and the longest it may take.
    #[must_use]
    pub fn trial_seconds(&self, condition: &Condition, context: &Context) -> (f64, f64) {
        let limit = f64::from(self.settings.time_limit_s);
        let period = self
            .configuration(condition, context)
            .map_or(0.1, |configuration| configuration.rates.period_ms * 1e-3);
        (((LAST_STEP + 1.0) * period).min(limit), limit)
    }

    /// How long a participant rests, in seconds; simulated humans do not.
    #[must_use]
    pub fn pause_seconds(&self) -> f64 {
        let pauses = (0..self.trials()).skip(1).map(|done| self.pause_after(done));
        pauses.map(f64::from).sum()
    }

    /// The pause after so many trials, in seconds.
    #[must_use]
    pub fn pause_after(&self, done: u64) -> u32 {
        let long = u64::from(self.pauses.long_every);
        if self.settings.source == tandem_operator::SourceKind::Simulated {
            0
        } else if long > 0 && done.is_multiple_of(long) {
            self.pauses.long_s.max(self.pauses.between_s)
        } else {
            self.pauses.between_s
        }
    }
}

struct Order<'a> {
    plan: &'a Plan,
    participant: &'a Participant,
    row: u64,
    random: ChaCha8Rng,
}

impl<'a> Order<'a> {
    fn new(plan: &'a Plan, participant: &'a Participant) -> Self {
        let name = format!("tandem order {} {participant}", plan.settings.seed);
        Self {
            plan,
            participant,
            row: plan.row(participant),
            random: ChaCha8Rng::from_seed(Sha256::digest(name.as_bytes()).into()),
        }
    }

    /// The order of the conditions in a block.
    fn conditions(&mut self, block: usize) -> Vec<usize> {
        let count = self.plan.conditions.len();
        match self.plan.order.conditions {
            Conditions::Fixed => (0..count).collect(),
            Conditions::Random => self.shuffled(count),
            // From block to block a participant goes on to the next row.
            Conditions::LatinSquare => williams(count, self.row.wrapping_add(block as u64)),
        }
    }

    fn contexts(&mut self) -> Vec<usize> {
        let count = self.plan.contexts.len();
        match self.plan.order.contexts {
            Contexts::Fixed => (0..count).collect(),
            Contexts::Random => self.shuffled(count),
        }
    }

    /// Fisher and Yates; the bias of the multiplication is below 2⁻⁴⁸.
    fn shuffled(&mut self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            let drawn = (u128::from(self.random.next_u64()) * (last as u128 + 1)) >> 64;
            order.swap(last, usize::try_from(drawn).unwrap_or(last).min(last));
        }
        order
    }

    fn add(&self, slots: &mut Vec<Slot>, condition: usize, context: usize, repetition: u32, practice: usize) {
        slots.push(Slot {
            number: u32::try_from(slots.len() + 1).unwrap_or(u32::MAX),
            practice: repetition == 0,
            condition,
            context,
            repetition,
            seed: self.seed(context, repetition, practice),
        });
    }

    /// Below 2⁶³, for a settings file holds no larger number.
    fn seed(&self, context: usize, repetition: u32, practice: usize) -> u64 {
        let name = format!(
            "tandem trial {} {} {} {repetition} {practice}",
            self.plan.settings.seed, self.participant, self.plan.contexts[context].name
        );
        let digest = Sha256::digest(name.as_bytes());
        let bytes: [u8; 8] = std::array::from_fn(|at| digest[at]);
        u64::from_le_bytes(bytes) >> 1
    }
}

/// A row of the Latin square of `count` conditions that is balanced for what comes right before what, after Williams
/// (1949): 0, 1, n−1, 2, n−2, … shifted by the row. An odd `count` needs the mirrored rows as well, so `2 count` in all.
fn williams(count: usize, row: u64) -> Vec<usize> {
    if count == 0 {
        return Vec::new();
    }
    let rows = if count.is_multiple_of(2) { count } else { 2 * count };
    let row = usize::try_from(row % rows as u64).unwrap_or(0);
    let zigzag = |at: usize| {
        if at % 2 == 1 {
            at.div_ceil(2)
        } else {
            (count - at / 2) % count
        }
    };
    let mut order: Vec<usize> = (0..count).map(|at| (zigzag(at) + row) % count).collect();
    if row >= count {
        order.reverse();
    }
    order
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn every_condition_stands_at_every_place_and_after_every_other_equally_often() {
        for count in 2..=7_usize {
            let rows = if count % 2 == 0 { count } else { 2 * count };
            let mut places = BTreeMap::new();
            let mut pairs = BTreeMap::new();
            for row in 0..rows as u64 {
                let order = williams(count, row);
                for (place, condition) in order.iter().enumerate() {
                    *places.entry((place, *condition)).or_insert(0) += 1;
                }
                for pair in order.windows(2) {
                    *pairs.entry((pair[0], pair[1])).or_insert(0) += 1;
                }
            }
            assert_eq!(places.len(), count * count);
            assert!(
                places.values().all(|times| *times == rows / count),
                "{count}: {places:?}"
            );
            assert_eq!(pairs.len(), count * (count - 1));
            assert!(pairs.values().all(|times| *times == rows / count), "{count}: {pairs:?}");
        }
    }

    #[test]
    fn rows_repeat_however_far_one_counts() {
        assert_eq!(williams(4, 1), williams(4, 5));
        assert_eq!(williams(3, u64::MAX).len(), 3);
        assert!(williams(0, 3).is_empty());
    }
}
