//! What plays a session: a machine without a clock, over the instants of its messages.
//!
//! ```text
//!            Toggle, Step, seeking to the end
//!   Running ─────────────────────────────────▶ Paused
//!     │  ▲                                       │
//!     │  └────────────── Toggle ─────────────────┘
//!     └── the last message, unless it loops ──▶ Ended
//! ```
//!
//! Every due time is counted from the moment at which playing began, resumed or changed its speed, never from the
//! message before, so that lateness does not add up. Messages of equal instants keep their order.

use std::ops::Range;

use tandem_wire::{MILLISECOND, Nanos, Stamp};

/// Speeds that a key changes to, in thousandths.
const STEPS: [u32; 10] = [100, 250, 500, 1000, 2000, 5000, 10_000, 25_000, 50_000, 100_000];
/// A pass of a loop takes at least this long, or a single instant would be repeated without end or pause.
const SHORTEST_PASS: Nanos = MILLISECOND;
/// At the highest speed this many messages are played before a key is looked for.
const BURST: usize = 64;

/// How fast time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Speed {
    /// In thousandths of the recorded speed.
    PerMille(u32),
    /// As fast as the target takes it.
    Max,
}

/// What is to be played, and how.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plan {
    /// The first instant that is played.
    pub from: Nanos,
    /// The last one.
    pub until: Nanos,
    /// How fast.
    pub speed: Speed,
    /// Whether it begins again at the end.
    pub repeats: bool,
    /// Whether it waits at the beginning until somebody wants it to go on.
    pub paused: bool,
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Event {
    /// The deadline came.
    Wake,
    /// Pause, or go on.
    Toggle,
    /// Pause, and play the next instant.
    Step,
    /// Pause, and go back to the instant before.
    StepBack,
    /// Go this far, in nanoseconds.
    SeekBy(i64),
    /// Go to this tenth of what is played.
    Tenth(u8),
    /// Go to the beginning.
    Home,
    /// Go to the end, and pause there.
    End,
    /// From now on begin again at the end, or no longer.
    ToggleLoop,
    /// What is played begins here.
    FromHere,
    /// What is played ends here. A loop begins again at once; otherwise it pauses here.
    UntilHere,
    /// The whole session is played.
    Whole,
    /// The next higher speed.
    Faster,
    /// The next lower speed.
    Slower,
}

/// What follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Output {
    /// Play this message, which was due at this time.
    Play { index: usize, due: Stamp },
    /// What is played next does not follow what was played last.
    Jumped { to: usize },
    /// Everything was played.
    Ended,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Running { since: Stamp, at: Nanos },
    Paused { at: Nanos },
    Ended,
}

/// The player.
#[derive(Clone, Debug)]
pub(crate) struct Player {
    instants: Vec<Nanos>,
    range: Range<usize>,
    plan: Plan,
    next: usize,
    state: State,
}

impl Player {
    /// A player of messages at these instants, which do not decrease; it begins at `now`.
    pub(crate) fn new(instants: Vec<Nanos>, plan: Plan, now: Stamp) -> Self {
        let last = instants.last().copied().unwrap_or(0);
        let until = plan.until.min(last);
        let from = plan.from.min(until);
        let range = range(&instants, plan.from, plan.until);
        let state = if plan.paused {
            State::Paused { at: from }
        } else {
            State::Running { since: now, at: from }
        };
        Self {
            next: range.start,
            instants,
            range,
            plan: Plan { from, until, ..plan },
            state,
        }
    }

    /// Begins now, whatever time has passed since it was made.
    pub(crate) const fn begin(&mut self, now: Stamp) {
        if let State::Running { since, .. } = &mut self.state {
            *since = now;
        }
    }

    /// The last instant of all.
    pub(crate) fn end(&self) -> Nanos {
        self.instants.last().copied().unwrap_or(0)
    }

    /// When it next wants to be woken; `None` while it waits for a key.
    pub(crate) fn deadline(&self) -> Option<Stamp> {
        match self.state {
            State::Running { .. } => Some(self.due(self.upcoming().unwrap_or(self.plan.until))),
            State::Paused { .. } | State::Ended => None,
        }
    }

    /// Where it stands.
    pub(crate) fn position(&self, now: Stamp) -> Nanos {
        match (self.state, self.plan.speed) {
            (State::Running { since, at }, Speed::PerMille(speed)) => {
                let gone = u128::from(now.since(since)) * u128::from(speed) / 1000;
                at.saturating_add(u64::try_from(gone).unwrap_or(u64::MAX))
                    .min(self.plan.until)
            }
            (State::Running { .. }, Speed::Max) => self.upcoming().unwrap_or(self.plan.until),
            (State::Paused { at }, _) => at,
            (State::Ended, _) => self.plan.until,
        }
    }

    /// Whether there is nothing to play.
    pub(crate) fn is_empty(&self) -> bool {
        self.range.is_empty()
    }

    /// The message that is played next.
    pub(crate) const fn next(&self) -> usize {
        self.next
    }

    /// From when until when it plays, if that is not the whole session.
    pub(crate) fn part(&self) -> Option<(Nanos, Nanos)> {
        let (from, until) = (self.plan.from, self.plan.until);
        (from > 0 || until < self.end()).then_some((from, until))
    }

    pub(crate) const fn repeats(&self) -> bool {
        self.plan.repeats
    }

    pub(crate) const fn speed(&self) -> Speed {
        self.plan.speed
    }

    pub(crate) const fn is_paused(&self) -> bool {
        matches!(self.state, State::Paused { .. })
    }

    /// Takes in one event and adds what follows from it.
    pub(crate) fn step(&mut self, now: Stamp, event: Event, outputs: &mut Vec<Output>) {
        if self.state == State::Ended {
            return;
        }
        match event {
            Event::Wake => self.wake(now, outputs),
            Event::Toggle => {
                let at = self.position(now);
                self.state = match self.state {
                    State::Paused { .. } => State::Running { since: now, at },
                    _ => State::Paused { at },
                };
            }
            Event::Step => self.step_on(now, outputs),
            Event::StepBack => {
                let before = self.next.saturating_sub(1).max(self.range.start);
                let at = self.instants.get(before).copied().unwrap_or(self.plan.from);
                self.seek(now, at, outputs);
                self.state = State::Paused { at };
            }
            Event::SeekBy(distance) => self.seek(now, self.position(now).saturating_add_signed(distance), outputs),
            Event::Tenth(tenth) => {
                let length = self.plan.until.saturating_sub(self.plan.from);
                self.seek(now, self.plan.from + length / 10 * u64::from(tenth), outputs);
            }
            Event::Home => self.seek(now, self.plan.from, outputs),
            Event::End => {
                self.seek(now, self.plan.until, outputs);
                self.state = State::Paused { at: self.plan.until };
            }
            Event::ToggleLoop => self.plan.repeats = !self.plan.repeats,
            Event::FromHere => {
                self.play_between(self.position(now), self.plan.until);
            }
            Event::UntilHere => {
                let at = self.position(now);
                if self.play_between(self.plan.from, at) && !self.plan.repeats {
                    self.state = State::Paused { at };
                }
            }
            Event::Whole => {
                self.play_between(0, self.end());
            }
            Event::Faster | Event::Slower => self.change_speed(now, event == Event::Faster),
        }
    }

    fn wake(&mut self, now: Stamp, outputs: &mut Vec<Output>) {
        let position = self.position(now);
        if !matches!(self.state, State::Running { .. }) {
            return;
        }
        let burst = match self.plan.speed {
            Speed::Max => BURST,
            Speed::PerMille(_) => usize::MAX,
        };
        let mut played = 0;
        while let Some(at) = self.upcoming() {
            let is_due = self.plan.speed == Speed::Max || at <= position;
            if !is_due || played == burst {
                return;
            }
            let due = if self.plan.speed == Speed::Max {
                now
            } else {
                self.due(at)
            };
            outputs.push(Output::Play { index: self.next, due });
            self.next += 1;
            played += 1;
        }
        if self.plan.speed == Speed::Max || now >= self.due(self.plan.until) {
            self.finish(now, outputs);
        }
    }

    fn finish(&mut self, now: Stamp, outputs: &mut Vec<Output>) {
        if !self.plan.repeats || self.range.is_empty() {
            self.state = State::Ended;
            outputs.push(Output::Ended);
            return;
        }
        let ended = match self.plan.speed {
            Speed::Max => now,
            Speed::PerMille(_) => self.due(self.plan.until),
        };
        let pass = self.plan.until.saturating_sub(self.plan.from);
        let since = ended.after(SHORTEST_PASS.saturating_sub(pass));
        let at = self.plan.from;
        self.state = State::Running { since, at };
        self.next = self.range.start;
        outputs.push(Output::Jumped { to: self.next });
    }

    /// Whether there is anything to play between these two; otherwise all stays as it is.
    fn play_between(&mut self, from: Nanos, until: Nanos) -> bool {
        let range = range(&self.instants, from, until);
        if range.is_empty() {
            return false;
        }
        self.range = range;
        self.plan = Plan {
            from,
            until,
            ..self.plan
        };
        true
    }

    fn step_on(&mut self, now: Stamp, outputs: &mut Vec<Output>) {
        let at = self.upcoming().unwrap_or(self.plan.until);
        while self.upcoming() == Some(at) {
            outputs.push(Output::Play {
                index: self.next,
                due: now,
            });
            self.next += 1;
        }
        self.state = State::Paused { at };
    }

    fn seek(&mut self, now: Stamp, to: Nanos, outputs: &mut Vec<Output>) {
        let at = to.clamp(self.plan.from, self.plan.until);
        self.next = self
            .instants
            .partition_point(|instant| *instant < at)
            .max(self.range.start);
        if matches!(self.state, State::Running { .. }) {
            self.state = State::Running { since: now, at };
        } else {
            self.state = State::Paused { at };
        }
        outputs.push(Output::Jumped { to: self.next });
    }

    fn change_speed(&mut self, now: Stamp, faster: bool) {
        let at = self.position(now);
        let speed = match self.plan.speed {
            Speed::Max => None,
            Speed::PerMille(speed) => Some(speed),
        };
        let changed = match (speed, faster) {
            (None, true) => return,
            (None, false) => STEPS.last().copied(),
            (Some(speed), true) => STEPS.iter().copied().find(|step| *step > speed),
            (Some(speed), false) => Some(STEPS.iter().copied().rfind(|step| *step < speed).unwrap_or(STEPS[0])),
        };
        self.plan.speed = changed.map_or(Speed::Max, Speed::PerMille);
        if matches!(self.state, State::Running { .. }) {
            self.state = State::Running { since: now, at };
        }
    }

    fn upcoming(&self) -> Option<Nanos> {
        self.instants
            .get(self.next)
            .copied()
            .filter(|_| self.next < self.range.end)
    }

    /// When an instant is due, rounded up: never early.
    fn due(&self, instant: Nanos) -> Stamp {
        match (self.state, self.plan.speed) {
            (State::Running { since, at }, Speed::PerMille(speed)) => {
                let ahead = u128::from(instant.saturating_sub(at)) * 1000;
                since.after(u64::try_from(ahead.div_ceil(u128::from(speed.max(1)))).unwrap_or(u64::MAX))
            }
            (State::Running { since, .. }, Speed::Max) => since,
            (State::Paused { .. } | State::Ended, _) => Stamp(u64::MAX),
        }
    }
}

/// The messages at these instants, none if they are turned around or beyond the end.
fn range(instants: &[Nanos], from: Nanos, until: Nanos) -> Range<usize> {
    let start = instants.partition_point(|at| *at < from);
    start..instants.partition_point(|at| *at <= until).max(start)
}

#[cfg(test)]
mod tests;
