//! Who holds the lease: operators as the arbiter hears them, and which of them drives.
//!
//! ```text
//!            a fresh press                      silent for the lease's timeout, or given up
//!   Free ───────────────────▶ Held(operator) ─────────────────────────────────────────────▶ Free
//!                              │        ▲  │
//!                              │        └──┘ taken over by a supervisor; by a press of another one
//!                              │             while the holder has let go for long enough
//!                              └ another one presses: refused, counted
//! ```
//!
//! Whoever changes hands inherits no press: what is held at that moment does not count.

use bincode::{Decode, Encode};
use tandem_wire::{
    Claim, Command, Deadman, Envelope, Guard, Label, Lease, Malformed, Memory, Nanos, Rearm, Refusal, Remember,
    Session, Stamp, Wish,
};

use crate::hearing::Heard;

/// So many operators are heard at a time; more have to wait until one of them has fallen silent. A press does not take the
/// place of one who only watches: whoever is forgotten could be impersonated with what it said before.
const SEATS: usize = 8;

/// How long a lease lasts without its holder.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Terms {
    /// A holder that is silent for longer has lost it.
    pub(crate) timeout: Nanos,
    /// A holder that has let go for longer gives way to whoever presses.
    pub(crate) idle: Nanos,
}

/// What a command or a claim changed about who drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tenure {
    /// It comes from whoever is listened to.
    Same,
    /// It comes from somebody who only watches.
    Watching,
    /// Its sender is listened to from now on. A press that was made while nobody drove counts.
    Anew { pressed: bool },
    /// Nobody holds the lease any more.
    GivenUp,
}

/// An operator.
#[derive(Clone, Debug, Encode, Decode)]
struct Seat {
    session: Session,
    name: Label,
    guard: Guard,
    rearm: Rearm,
    command: Option<Heard<Command>>,
    /// A command was dropped for its loop age since the last one that was admitted.
    too_old: bool,
    /// Its claims, but for take-overs.
    claims: Guard,
    take_overs: Guard,
    /// When its deadman was last held, or it took over.
    held: Stamp,
}

/// The operators, and who of them drives.
#[derive(Clone, Debug)]
pub(crate) struct Desk {
    terms: Terms,
    guard: Guard,
    seats: Vec<Seat>,
    lease: Option<Lease>,
    /// Who last pressed in vain, and when.
    asked: Option<(Label, Stamp)>,
    /// Leases granted so far.
    granted: u32,
    /// Whose commands are answered: the holder's; if there is none, those of whoever was heard first.
    leading: Option<Session>,
}

impl Desk {
    pub(crate) fn new(guard: Guard, terms: Terms) -> Self {
        Self {
            terms,
            guard,
            seats: Vec::with_capacity(SEATS),
            lease: None,
            asked: None,
            granted: 0,
            leading: None,
        }
    }

    /// The lease in force.
    pub(crate) fn lease(&self) -> Option<Lease> {
        self.lease
    }

    /// Who would like to have it, for as long after a press in vain as a holder may sit idle.
    pub(crate) fn asks(&self, now: Stamp) -> Option<Label> {
        let (name, asked) = self.asked?;
        (now.since(asked) <= self.terms.idle).then_some(name)
    }

    /// The newest command of whoever is listened to.
    pub(crate) fn command(&self) -> Option<Heard<Command>> {
        self.leader()?.command
    }

    /// The stream of whoever is listened to.
    pub(crate) fn stream(&self) -> &Guard {
        self.leader().map_or(&self.guard, |seat| &seat.guard)
    }

    /// Whether commands numbered in `session` are listened to, or nobody's are yet.
    pub(crate) fn listens_to(&self, session: Session) -> bool {
        self.leading.is_none_or(|leading| leading == session)
    }

    /// Whether a command of theirs was dropped for its loop age since the last one that was admitted.
    pub(crate) fn too_old(&self) -> bool {
        self.leader().is_some_and(|seat| seat.too_old)
    }

    /// Notes that a command was dropped for its loop age.
    pub(crate) fn note_too_old(&mut self, session: Session) {
        if let Some(seat) = self.seats.iter_mut().find(|seat| seat.session == session) {
            seat.too_old = true;
        }
    }

    /// Takes in a command whose loop age is right.
    pub(crate) fn admit(&mut self, now: Stamp, command: &Envelope<Command>) -> Result<Tenure, Refusal> {
        let session = command.header.session;
        let at = self.seat(now, session)?;
        let seat = &mut self.seats[at];
        let was_lost = seat.guard.is_lost(now);
        seat.guard.admit(now, &command.header)?;
        if was_lost {
            // What was pressed meanwhile was pressed blind.
            seat.rearm.spend();
        }
        seat.command = Some(Heard::new(now, command));
        seat.too_old = false;
        let pressed = seat.rearm.see(command.body.deadman).is_some();
        let held = command.body.deadman != Deadman::Released;
        if held {
            seat.held = now;
        }
        match self.lease {
            Some(lease) if lease.holder == session => Ok(Tenure::Same),
            Some(lease) if pressed && self.is_idle(now, lease.holder) => Ok(self.grant(session, true)),
            Some(_) if held => {
                // A press that was refused once shall not move the robot by itself when the holder has let go for long.
                self.seats[at].rearm.exhaust();
                Err(Refusal::SecondOperator)
            }
            Some(_) => Ok(Tenure::Watching),
            None if pressed => Ok(self.grant(session, true)),
            None => Ok(self.listen(now, session)),
        }
    }

    /// Takes in a claim. `may_take_over` says whether its sender is a supervisor.
    pub(crate) fn claim(
        &mut self,
        now: Stamp,
        claim: &Envelope<Claim>,
        may_take_over: bool,
    ) -> Result<Tenure, Refusal> {
        let (session, Claim { wish, name }) = (claim.header.session, claim.body);
        let seat = self.seats.iter_mut().find(|seat| seat.session == session);
        let seat = seat.ok_or(Refusal::ForeignSession)?;
        let stream = match wish {
            Wish::TakeOver => &mut seat.take_overs,
            Wish::Drive | Wish::Release => &mut seat.claims,
        };
        stream.admit(now, &claim.header)?;
        seat.name = name;
        let holds = self.lease.is_some_and(|lease| lease.holder == session);
        if let Some(lease) = self.lease.as_mut().filter(|_| holds) {
            lease.name = name;
        }
        match wish {
            Wish::Drive => {
                if self.lease.is_some() && !holds {
                    self.asked = Some((name, now));
                }
                Ok(Tenure::Same)
            }
            Wish::Release if holds => Ok(self.give_up()),
            Wish::Release => Ok(Tenure::Same),
            Wish::TakeOver if holds => Ok(Tenure::Same),
            Wish::TakeOver if may_take_over => {
                // As long as whoever let go: else one who has watched for long would give way before it can press.
                seat.held = now;
                Ok(self.grant(session, false))
            }
            Wish::TakeOver => Err(Refusal::NotSupervisor),
        }
    }

    /// Ends a lease whose holder has been silent for too long; says whether it did.
    pub(crate) fn expire(&mut self, now: Stamp) -> bool {
        let lost = self.expires().is_some_and(|at| now >= at);
        if lost {
            self.give_up();
        }
        lost
    }

    /// When the lease ends unless its holder is heard.
    pub(crate) fn expires(&self) -> Option<Stamp> {
        let holder = self.lease?.holder;
        let seat = self.seats.iter().find(|seat| seat.session == holder)?;
        Some(seat.command?.arrived.after(self.terms.timeout).after(1))
    }

    fn leader(&self) -> Option<&Seat> {
        let leading = self.leading?;
        self.seats.iter().find(|seat| seat.session == leading)
    }

    /// The place of an operator; a new one takes an empty place, or that of one who was lost longest.
    fn seat(&mut self, now: Stamp, session: Session) -> Result<usize, Refusal> {
        if let Some(at) = self.seats.iter().position(|seat| seat.session == session) {
            return Ok(at);
        }
        let seat = Seat {
            session,
            name: Label::default(),
            guard: self.guard.clone(),
            rearm: Rearm::default(),
            command: None,
            too_old: false,
            claims: self.guard.clone(),
            take_overs: self.guard.clone(),
            held: now,
        };
        if self.seats.len() < SEATS {
            self.seats.push(seat);
            return Ok(self.seats.len() - 1);
        }
        let holder = self.lease.map(|lease| lease.holder);
        let gone = |seat: &Seat| seat.guard.is_lost(now) && Some(seat.session) != holder;
        let silent = |at: &usize| self.seats[*at].guard.silent(now);
        let oldest = (0..SEATS).filter(|at| gone(&self.seats[*at])).max_by_key(silent);
        let at = oldest.ok_or(Refusal::NoSeat)?;
        self.seats[at] = seat;
        Ok(at)
    }

    /// Whether an operator has let go for so long that it gives way.
    fn is_idle(&self, now: Stamp, session: Session) -> bool {
        let seat = self.seats.iter().find(|seat| seat.session == session);
        seat.is_none_or(|seat| now.since(seat.held) > self.terms.idle)
    }

    fn grant(&mut self, session: Session, pressed: bool) -> Tenure {
        let name = self.seats.iter().find(|seat| seat.session == session);
        self.asked = None;
        self.granted = self.granted.saturating_add(1);
        self.lease = Some(Lease {
            number: self.granted,
            holder: session,
            name: name.map_or(Label::default(), |seat| seat.name),
        });
        self.spend_presses();
        let same = self.leading.replace(session) == Some(session);
        if same && pressed {
            Tenure::Same
        } else {
            Tenure::Anew { pressed }
        }
    }

    fn give_up(&mut self) -> Tenure {
        self.lease = None;
        self.spend_presses();
        Tenure::GivenUp
    }

    fn spend_presses(&mut self) {
        self.seats.iter_mut().for_each(|seat| seat.rearm.spend());
    }

    /// Nobody holds the lease: whoever is listened to stays so until lost.
    fn listen(&mut self, now: Stamp, session: Session) -> Tenure {
        match self.leader() {
            Some(seat) if seat.session == session => Tenure::Same,
            Some(seat) if !seat.guard.is_lost(now) => Tenure::Watching,
            _ => {
                self.leading = Some(session);
                Tenure::Anew { pressed: false }
            }
        }
    }
}

impl Remember for Desk {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            terms: _,
            guard: _,
            seats,
            lease,
            asked,
            granted,
            leading,
        } = self;
        memory.part(seats)?;
        memory.part(lease)?;
        memory.part(asked)?;
        memory.part(granted)?;
        memory.part(leading)
    }
}
