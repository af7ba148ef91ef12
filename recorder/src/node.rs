//! The step machine: every message is passed on, and what a person wants to know of it is noted once.

mod journals;
mod notes;
mod rights;

use std::sync::Arc;

use tandem_wire::{
    Envelope, Malformed, Memory, Motion, Node, NodeName, Numbering, Outbox, Pace, Question, Remember, SECOND, Seq,
    Session, Setpoint, Stamp, State, Storage, Timing, Topic, Trial, Unreadable,
};

use crate::filling::Filling;
use crate::heard::{Entry, Heard, Level, Note, Sample};
use crate::tally::{Place, Tally};
use crate::watch::ClockWatch;
use notes::{forecast_note, info, motion_note, same_motion, warning};
use rights::Rights;

/// How often the counts are passed on while messages arrive.
const COUNTS_EVERY: u64 = SECOND;

/// Everything that can happen to the recorder.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A message arrived.
    Sample(Sample),
    /// Bytes arrived that are no message.
    Unreadable(Unreadable),
    /// The shell has looked how the session file is doing.
    Storage(Storage),
    /// The counts are due.
    Wake,
    /// A node appeared or vanished.
    Presence {
        /// Which node.
        peer: NodeName,
        /// Whether it is there.
        alive: bool,
    },
    /// The process is about to end.
    Stop,
}

/// Everything that the recorder can cause.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Keep this in the session file.
    Write(Arc<Heard>),
    /// Draw this in the view.
    Show(Arc<Heard>),
    /// Ask a node for what was missed of its journal.
    Ask(Question),
    /// Tell the others how the session file is doing.
    Say(Envelope<Storage>),
}

/// The recorder.
///
/// ```text
///            first message                 Stop                 all answered, or Stop again
///   Silent ──────────────────▶ Hearing ────────────▶ Closing ────────────────────────────▶ Closed
///     ▲ │                         │                    ▲
///     │ └──────────────────────── │ ────── Stop ───────┘
///     └─ the counts, a second ────┘
///        after that message
/// ```
#[derive(Clone, Debug)]
pub struct Recorder {
    timing: Timing,
    phase: Phase,
    tally: Tally,
    filling: Filling,
    /// The tick of the newest message: where a note of our own belongs.
    tick: u32,
    trial: Option<TrialSeen>,
    arbiter: Option<Motion>,
    robot: Option<Motion>,
    in_contact: bool,
    rights: Rights,
    sayings: Numbering,
    storage: Storage,
    clocks: ClockWatch,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    /// Nothing was heard since the counts were last passed on.
    Silent,
    /// Something was; the counts are due at this time.
    Hearing { counts_due: Stamp },
    /// Stopped: the ends of the journals are asked for.
    Closing,
    /// Whatever still arrives is ignored, for the file is being closed.
    Closed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TrialSeen {
    Begun(u32),
    Ended(u32),
}

impl Recorder {
    /// A recorder for nodes that run at this pace.
    #[must_use]
    pub fn new(timing: Timing) -> Self {
        Self {
            timing,
            phase: Phase::Silent,
            tally: Tally::default(),
            filling: Filling::default(),
            tick: 0,
            trial: None,
            arbiter: None,
            robot: None,
            in_contact: false,
            rights: Rights::default(),
            sayings: Numbering::new(Session(0)),
            storage: Storage::default(),
            clocks: ClockWatch::default(),
        }
    }

    /// The same recorder, which says what it has to say in this session.
    #[must_use]
    pub fn in_session(mut self, session: Session) -> Self {
        self.sayings = Numbering::new(session);
        self
    }

    fn on_sample(&mut self, now: Stamp, sample: Sample, outbox: &mut Outbox<Output>) {
        let (topic, header) = (sample.topic(), *sample.header());
        let sample = match sample {
            // No stream has this number: it answers a question.
            Sample::Journal(part) if header.seq == Seq(0) => return self.on_answer(now, part, outbox),
            other => other,
        };
        let place = self.tally.count(topic, &header);
        // Who marks a trial or stops a robot may count no ticks: then it happens now.
        let tick = match topic {
            Topic::Trial | Topic::Emergency | Topic::AllClear if header.tick == 0 => self.tick,
            _ => header.tick,
        };
        self.tick = tick;
        if let Place::AfterGap(missed) = place {
            self.on_gap(now, topic, missed, outbox);
        }
        if self.timing.pace == Pace::Real && matches!(place, Place::Next | Place::AfterGap(_)) {
            self.tally.time(now, topic, &header);
            self.tally.budget(&sample);
        }
        if let Sample::Journal(part) = &sample {
            self.tally.count_journal(part);
            if part.entries == 0 {
                return self.on_end(now, sample, outbox);
            }
            self.filling.hear(now, part, outbox);
        }
        let notes = match (&sample, place) {
            (_, Place::Late | Place::Repeated) => Vec::new(),
            (Sample::Setpoint(message), _) => self.on_setpoint(message),
            (Sample::State(message), _) => self.on_state(message),
            (Sample::Trial(message), _) => self.on_trial(&message.body),
            (Sample::Forecast(message), _) => vec![forecast_note(&message.body)],
            (Sample::Claim(message), _) => self.rights.hear_claim(message).into_iter().collect(),
            (Sample::Emergency(message), _) => self.rights.hear_emergency(message).into_iter().collect(),
            (Sample::Clock(NodeName::Recorder, message), _) => self.clocks.hear(&message.body),
            _ => Vec::new(),
        };
        self.pass_on(now, tick, sample, place, outbox);
        for note in notes {
            self.note(now, note, outbox);
        }
    }

    /// Everything is written, in the order it came; only what is new to the eye is shown.
    fn pass_on(&self, now: Stamp, tick: u32, sample: Sample, place: Place, outbox: &mut Outbox<Output>) {
        let fresh = matches!(place, Place::Next | Place::AfterGap(_));
        let visible = fresh && !matches!(sample, Sample::Journal(_) | Sample::Info(..) | Sample::Clock(..));
        let heard = Arc::new(self.heard(now, tick, Entry::Sample(sample)));
        if visible {
            outbox.push(Output::Show(Arc::clone(&heard)));
        }
        outbox.push(Output::Write(heard));
    }

    fn on_gap(&mut self, now: Stamp, topic: Topic, missed: u64, outbox: &mut Outbox<Output>) {
        let text = match missed {
            1 => format!("a message on {topic} was missed"),
            _ => format!("{missed} messages on {topic} were missed"),
        };
        self.note(now, warning(NodeName::Recorder, text), outbox);
    }

    fn on_setpoint(&mut self, message: &Envelope<Setpoint>) -> Vec<Note> {
        let motion = message.body.motion;
        let before = self.arbiter.replace(motion);
        let mut notes: Vec<Note> = self.rights.hear_lease(message.body.lease).into_iter().collect();
        notes.extend(self.rights.hear_asking(message.body.asks));
        notes.extend(motion_note(NodeName::Arbiter, before, motion));
        notes
    }

    fn on_state(&mut self, message: &Envelope<State>) -> Vec<Note> {
        let state = &message.body;
        let before = self.robot.replace(state.motion);
        // The robot repeats the arbiter's reason; only a reason of its own is news.
        let echoed = state
            .obeys
            .is_some_and(|obeyed| same_motion(obeyed.setpoint.motion, state.motion));
        let mut notes = Vec::new();
        if !echoed {
            notes.extend(motion_note(NodeName::RobotSim, before, state.motion));
        }
        notes.extend(self.contact_note(state));
        notes
    }

    fn contact_note(&mut self, state: &State) -> Option<Note> {
        let closest = state.closest.or(state.clearance)?;
        let touching = closest.distance.0 <= 0.0;
        let began = touching && !self.in_contact;
        self.in_contact = touching;
        began.then(|| Note {
            level: Level::Error,
            about: NodeName::RobotSim,
            is_routine: false,
            text: format!("contact: body {} touches obstacle {}", closest.body, closest.obstacle),
        })
    }

    fn on_trial(&mut self, trial: &Trial) -> Vec<Note> {
        let (seen, text) = match trial {
            Trial::Begin { number, label } => (TrialSeen::Begun(*number), format!("trial {number} begins: {label}")),
            Trial::End { number, outcome } => (TrialSeen::Ended(*number), format!("trial {number} ends: {outcome}")),
        };
        // A beginning is repeated for those who come late.
        if self.trial.replace(seen) == Some(seen) {
            return Vec::new();
        }
        vec![info(NodeName::RobotSim, text)]
    }

    fn on_unreadable(&mut self, now: Stamp, sample: Unreadable, outbox: &mut Outbox<Output>) {
        let before = self.tally.count_unreadable(sample.topic);
        if before == 0 {
            let text = format!("a sample on {} cannot be read: {}", sample.topic, sample.why);
            self.note(now, warning(NodeName::Recorder, text), outbox);
        }
    }

    fn on_presence(&mut self, now: Stamp, peer: NodeName, alive: bool, outbox: &mut Outbox<Output>) {
        self.filling.presence(peer, alive);
        let note = if alive {
            info(peer, "appeared".to_owned())
        } else {
            Note {
                is_routine: true,
                ..warning(peer, "vanished".to_owned())
            }
        };
        self.note(now, note, outbox);
    }

    /// Remembers that the counts have changed.
    fn touch(&mut self, now: Stamp) {
        if matches!(self.phase, Phase::Silent) {
            let counts_due = now.after(COUNTS_EVERY);
            self.phase = Phase::Hearing { counts_due };
        }
    }

    fn pass_on_due_counts(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if let Phase::Hearing { counts_due } = self.phase
            && now >= counts_due
        {
            self.pass_on_counts(now, outbox);
            self.phase = Phase::Silent;
        }
    }

    /// Asks for what is missing at the journals' ends, once. Being stopped again is final.
    fn on_stop(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        match self.phase {
            Phase::Closing => self.finish(now, outbox),
            _ => {
                self.phase = Phase::Closing;
                self.filling.close(now, outbox);
            }
        }
    }

    fn finish(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.pass_on_counts(now, outbox);
        self.phase = Phase::Closed;
    }

    fn pass_on_counts(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        self.both(now, Entry::Counts(self.tally.counts()), outbox);
        self.filling.expect_look();
    }

    fn note(&self, now: Stamp, note: Note, outbox: &mut Outbox<Output>) {
        self.both(now, Entry::Note(note), outbox);
    }

    fn both(&self, now: Stamp, entry: Entry, outbox: &mut Outbox<Output>) {
        let heard = Arc::new(self.heard(now, self.tick, entry));
        outbox.push(Output::Show(Arc::clone(&heard)));
        outbox.push(Output::Write(heard));
    }

    fn heard(&self, now: Stamp, tick: u32, entry: Entry) -> Heard {
        Heard {
            at: now,
            session_time: self.timing.session_time(now, tick),
            tick,
            entry,
        }
    }
}

impl Remember for Recorder {
    /// Nothing: nobody executes a recorder again, for what it hears is the recording itself.
    fn remember(&mut self, _: &mut Memory<'_>) -> Result<(), Malformed> {
        Ok(())
    }
}

impl Node for Recorder {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        if matches!(self.phase, Phase::Closed) {
            return;
        }
        self.pass_on_due_counts(now, outbox);
        match event {
            Event::Sample(sample) => {
                self.touch(now);
                self.on_sample(now, sample, outbox);
            }
            Event::Unreadable(sample) => {
                self.touch(now);
                self.on_unreadable(now, sample, outbox);
            }
            Event::Storage(storage) => self.on_storage(now, storage, outbox),
            Event::Wake => {}
            Event::Presence { peer, alive } => self.on_presence(now, peer, alive, outbox),
            Event::Stop => self.on_stop(now, outbox),
        }
        self.filling.ask(now, outbox);
        for note in self.filling.take_notes() {
            self.note(now, note, outbox);
        }
        if matches!(self.phase, Phase::Closing) && self.filling.is_settled() {
            self.finish(now, outbox);
        }
    }

    fn deadline(&self) -> Option<Stamp> {
        let counts = match self.phase {
            Phase::Hearing { counts_due } => Some(counts_due),
            Phase::Closed => return None,
            Phase::Silent | Phase::Closing => None,
        };
        counts.into_iter().chain(self.filling.deadline()).min()
    }

    fn lingers(&self) -> bool {
        matches!(self.phase, Phase::Closing)
    }

    fn trial(&self) -> u32 {
        0
    }
}
