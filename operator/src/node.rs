//! The step machine.

use bincode::{Decode, Encode};
use tandem_wire::{
    Claim, Command, Deadman, Emergency, Envelope, Label, Malformed, Memory, Node, NodeName, Numbering, Outbox, Pace,
    Refusal, Refusals, Remember, Session, Stamp, State, StateGuard, Storage, TaskFrame, Timing, Topic, Trial,
    Unreadable, Wish,
};

use crate::alarm::Alarm;
use crate::config::{HumanConfig, HumanSettings, KeyConfig, OperatorSettings, SourceKind};
use crate::device::{Asked, DeviceSample, Keyboard};
use crate::human::SimulatedHuman;
use crate::played::{Played, PlayedSample};
use crate::sight::{Eyes, Picture};
use crate::source::Source;
use crate::status::{Recording, Status};

/// Everything that can happen to an operator.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The robot published a state.
    State(Box<Envelope<State>>),
    /// The local device was sampled.
    Device(DeviceSample),
    /// A recording that is played was sampled.
    Played(PlayedSample),
    /// The recorder says how the session file is kept.
    Storage(Envelope<Storage>),
    /// A sample could not be read.
    Unreadable(Unreadable),
    /// A peer's token appeared or vanished; driving goes by states alone.
    Presence {
        /// Which peer.
        peer: NodeName,
        /// Whether it is there.
        alive: bool,
    },
    /// The deadline has come.
    Wake,
    /// The process is about to end.
    Stop,
    /// In lockstep: the sample of a tick does not come now.
    Missed {
        /// Whose sample.
        topic: Topic,
        /// Which tick's.
        tick: u32,
    },
}

/// Everything that an operator can cause.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// What the human wants.
    Command(Envelope<Command>),
    /// A trial was asked for.
    Trial(Envelope<Trial>),
    /// Something about the lease.
    Claim(Envelope<Claim>),
    /// An emergency stop.
    Emergency(Envelope<Emergency>),
    /// What the operator is doing, for a screen in the same process.
    Status(Status),
}

/// The operator; see the [crate's page](crate).
#[derive(Clone, Debug, PartialEq)]
pub struct Operator {
    timing: Timing,
    trial_label: String,
    commands: Numbering,
    trials: Numbering,
    claims: Numbering,
    take_overs: Numbering,
    emergencies: Numbering,
    session: Session,
    name: Label,
    alarm: Alarm,
    states: StateGuard,
    refused: Refusals,
    eyes: Eyes,
    picture: Picture,
    newest_trial: u32,
    source: Source,
    stream: Stream,
    /// In lockstep: the newest tick whose state did not come in time; it is answered already.
    missed: Option<u32>,
    /// The deadman of the newest command.
    pressed: Deadman,
    recording: Recording,
    status: Option<Status>,
}

/// Whether commands still flow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
enum Stream {
    /// The next command is due at `due`; `sent` is the deadman that the last one carried.
    Flowing { due: Stamp, sent: Deadman },
    /// The last command was sent: the process ends.
    Ended,
}

impl Operator {
    /// An operator that has seen nothing yet. All its random numbers come from `seed`.
    #[must_use]
    pub fn new(
        session: Session,
        timing: Timing,
        frame: TaskFrame,
        seed: u64,
        settings: &OperatorSettings,
        human: &HumanSettings,
    ) -> Self {
        let source = match settings.source {
            SourceKind::Simulated => {
                let config = HumanConfig::new(human, &timing, frame, seed);
                Source::Simulated(Box::new(SimulatedHuman::new(config)))
            }
            SourceKind::Keyboard => Source::Device(Keyboard::new(KeyConfig::new(settings, frame))),
            SourceKind::Replayed => Source::Played(Played::new(settings.device_timeout())),
        };
        Self {
            timing,
            trial_label: settings.trial_label.as_str().to_owned(),
            commands: Numbering::new(session),
            trials: Numbering::new(session),
            claims: Numbering::new(session),
            take_overs: Numbering::new(session),
            emergencies: Numbering::new(session),
            session,
            name: Label::new(&settings.name),
            alarm: Alarm::default(),
            states: StateGuard::new(&timing),
            refused: Refusals::default(),
            eyes: Eyes::new(frame),
            picture: Picture::Never,
            newest_trial: 0,
            source,
            stream: Stream::Flowing {
                due: Stamp(0),
                sent: Deadman::Released,
            },
            missed: None,
            pressed: Deadman::Released,
            recording: Recording::default(),
            status: None,
        }
    }

    fn on_state(&mut self, now: Stamp, state: &Envelope<State>, outbox: &mut Outbox<Output>) {
        if let Err(why) = self.states.admit(now, &state.header) {
            self.refused.add(why);
            return;
        }
        let (seen, sight) = self.eyes.see(state);
        self.alarm.see(self.session, &seen);
        self.picture = Picture::Live(seen);
        self.newest_trial = self.newest_trial.max(seen.trial);
        self.source.see(&sight);
        let answered = self.missed.is_some_and(|missed| state.header.tick <= missed);
        if self.timing.pace == Pace::Lockstep && self.stream != Stream::Ended && !answered {
            self.send(now, self.tick(), outbox);
        }
    }

    /// In lockstep every tick is answered: without its state, from what was seen before.
    fn on_missed(&mut self, now: Stamp, topic: Topic, tick: u32, outbox: &mut Outbox<Output>) {
        if topic != Topic::State || self.timing.pace != Pace::Lockstep {
            return;
        }
        self.missed = Some(tick);
        self.states.miss(tick);
        if self.stream != Stream::Ended {
            self.send(now, tick, outbox);
        }
    }

    fn on_device(&mut self, now: Stamp, sample: DeviceSample, outbox: &mut Outbox<Output>) {
        let live = self.picture.live().is_some();
        let asked = self.source.take(now, sample, live);
        if self.stream != Stream::Ended {
            self.ask(now, asked, outbox);
        }
        if asked.trial && live && self.stream != Stream::Ended {
            let begin = Trial::Begin {
                number: self.newest_trial.saturating_add(1),
                label: self.trial_label.clone(),
            };
            outbox.push(Output::Trial(self.trials.envelope(now, self.tick(), begin)));
        }
    }

    /// An emergency stop needs no picture; what is said about the lease needs none either.
    fn ask(&mut self, now: Stamp, asked: Asked, outbox: &mut Outbox<Output>) {
        if asked.stop {
            self.alarm.press();
            self.call_stop(now, outbox);
        }
        if asked.release {
            self.claim(now, Wish::Release, outbox);
        }
        if asked.take_over {
            self.claim(now, Wish::TakeOver, outbox);
        }
    }

    fn claim(&mut self, now: Stamp, wish: Wish, outbox: &mut Outbox<Output>) {
        let claim = Claim { wish, name: self.name };
        let tick = self.tick();
        let numbering = match wish {
            Wish::TakeOver => &mut self.take_overs,
            Wish::Drive | Wish::Release => &mut self.claims,
        };
        outbox.push(Output::Claim(numbering.envelope(now, tick, claim)));
    }

    fn call_stop(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        let stop = Emergency::Stop { by: self.name };
        outbox.push(Output::Emergency(self.emergencies.envelope(now, self.tick(), stop)));
    }

    /// Says goodbye. In lockstep a command only ever answers a state, and without one nothing moves anyway.
    fn on_stop(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        if self.timing.pace == Pace::Real && self.stream != Stream::Ended {
            self.claim(now, Wish::Release, outbox);
            let command = self.command(Deadman::Released);
            outbox.push(Output::Command(self.commands.envelope(now, self.tick(), command)));
        }
        self.stream = Stream::Ended;
    }

    /// What silence has ended by now, before anything else happens.
    fn expire(&mut self, now: Stamp) {
        self.source.expire(now);
        if let Picture::Live(seen) = self.picture
            && self.states.is_lost(now)
        {
            self.picture = Picture::Lost(seen);
            self.source.go_blind();
        }
    }

    /// In real time: sends what is due, and a changed deadman at once.
    fn flow(&mut self, now: Stamp, outbox: &mut Outbox<Output>) {
        let Stream::Flowing { due, sent } = self.stream else {
            return;
        };
        if self.timing.pace == Pace::Real && (now >= due || sent != self.deadman()) {
            self.send(now, self.tick(), outbox);
        }
    }

    fn send(&mut self, now: Stamp, tick: u32, outbox: &mut Outbox<Output>) {
        let command = self.command(self.deadman());
        if self.alarm.calls() {
            self.call_stop(now, outbox);
        }
        if command.deadman != Deadman::Released && command.deadman != self.pressed {
            self.claim(now, Wish::Drive, outbox);
        }
        self.pressed = command.deadman;
        outbox.push(Output::Command(self.commands.envelope(now, tick, command)));
        if let Stream::Flowing { due, sent } = &mut self.stream {
            *sent = command.deadman;
            if now >= *due {
                // On the grid of periods, unless a whole one was missed: then from now on.
                let next = due.after(self.timing.stream_period);
                *due = if next > now {
                    next
                } else {
                    now.after(self.timing.stream_period)
                };
            }
        }
    }

    /// Nobody drives without a picture, and only a held deadman has a velocity.
    fn command(&self, deadman: Deadman) -> Command {
        Command {
            velocity: match deadman {
                Deadman::Held { .. } => self.source.velocity(),
                Deadman::Released => tandem_wire::Vec3::ZERO,
            },
            deadman,
            seen: self.picture.newest().map(|seen| seen.id),
        }
    }

    fn deadman(&self) -> Deadman {
        match self.picture.live() {
            Some(_) => self.source.deadman(),
            None => Deadman::Released,
        }
    }

    fn tick(&self) -> u32 {
        self.picture.newest().map_or(0, |seen| seen.tick)
    }

    fn show(&mut self, outbox: &mut Outbox<Output>) {
        let status = Status {
            activity: self.source.activity(),
            deadman: self.deadman(),
            seen: self.picture.live().copied(),
            session: self.session,
            wish: self.source.wish(),
            unheard_stop: self.alarm.calls(),
            recording: self.recording,
            refused: self.refused,
        };
        if self.status != Some(status) {
            self.status = Some(status);
            outbox.push(Output::Status(status));
        }
    }
}

impl Remember for Operator {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timing: _,
            trial_label: _,
            commands,
            trials,
            claims,
            take_overs,
            emergencies,
            session: _,
            name: _,
            alarm,
            states,
            refused,
            eyes,
            picture,
            newest_trial,
            source,
            stream,
            missed,
            pressed,
            // What the screen shows: a restored operator says it once more.
            status: _,
            recording: _,
        } = self;
        commands.remember(memory)?;
        trials.remember(memory)?;
        claims.remember(memory)?;
        take_overs.remember(memory)?;
        emergencies.remember(memory)?;
        memory.part(alarm)?;
        memory.part(pressed)?;
        states.remember(memory)?;
        memory.part(refused)?;
        eyes.remember(memory)?;
        memory.part(picture)?;
        memory.part(newest_trial)?;
        source.remember(memory)?;
        memory.part(stream)?;
        memory.part(missed)
    }
}

impl Node for Operator {
    type Event = Event;
    type Output = Output;

    fn step(&mut self, now: Stamp, event: Event, outbox: &mut Outbox<Output>) {
        self.expire(now);
        match event {
            Event::State(state) => self.on_state(now, &state, outbox),
            Event::Device(sample) => self.on_device(now, sample, outbox),
            Event::Played(sample) => self.source.take_played(now, sample, self.picture.live().is_some()),
            Event::Storage(storage) => self.recording = Recording::Told(storage.body),
            Event::Presence { peer, alive } => self.recording.hear_presence(peer, alive),
            Event::Unreadable(_) => self.refused.add(Refusal::Unreadable),
            Event::Stop => self.on_stop(now, outbox),
            Event::Wake => {}
            Event::Missed { topic, tick } => self.on_missed(now, topic, tick, outbox),
        }
        self.flow(now, outbox);
        self.show(outbox);
    }

    fn deadline(&self) -> Option<Stamp> {
        let Stream::Flowing { due, .. } = self.stream else {
            return None;
        };
        if self.timing.pace == Pace::Lockstep {
            return None;
        }
        let lost = self.picture.live().and_then(|_| self.states.deadline());
        [Some(due), lost, self.source.deadline()].into_iter().flatten().min()
    }

    fn trial(&self) -> u32 {
        self.picture.newest().map_or(0, |seen| seen.trial)
    }
}
