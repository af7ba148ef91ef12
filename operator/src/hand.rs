//! The hand on a device: when what it holds counts as a press of the deadman.

use bincode::{Decode, Encode};
use tandem_wire::{Deadman, Malformed, Memory, Nanos, Remember, Stamp};

/// Who holds what.
///
/// ```text
///          all up             a key goes down
///  Absent ────────▶ Open ─────────────────────────▶ Held ◀┐ keys change; pressed anew: next number
///    ▲ │             ▲  ◀──────── all up ───────────  │ └─┘
///    │ └─ keys down ─┼─▶ Spent ◀── no picture ────────┤
///    │               └──── │ ── pressed anew ─▶ Held  │
///    └─────────────────────┴────────── silence ───────┘
/// ```
///
/// What is already held when we first look is `Spent`: it must be let go before it counts.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
enum Grip<H> {
    Absent,
    Open(Contact),
    Held(Contact, H),
    Spent(Contact),
}

/// The newest sample's arrival and count of presses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
struct Contact {
    arrived: Stamp,
    presses: u8,
}

/// What the hand is doing, for whoever looks at the status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handling {
    /// No samples arrive.
    Absent,
    /// Nothing is held.
    Open,
    /// Something is held and counts.
    Held,
    /// It is held from before a loss: it must be let go first.
    Spent,
}

/// A hand on a device whose samples may stop at any time; `H` is what it may hold.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Hand<H> {
    timeout: Nanos,
    grip: Grip<H>,
    press: u32,
}

impl<H: Copy> Hand<H> {
    /// A hand that is absent after `timeout` of silence.
    pub(crate) const fn new(timeout: Nanos) -> Self {
        Self {
            timeout,
            grip: Grip::Absent,
            press: 0,
        }
    }

    /// Takes in a sample: what is held, and how often it was pressed so far, modulo 256.
    pub(crate) fn take(&mut self, now: Stamp, held: Option<H>, presses: u8, has_picture: bool) {
        let contact = Contact { arrived: now, presses };
        let anew = self.contact().is_some_and(|before| before.presses != presses);
        self.grip = match (self.grip, held) {
            (_, None) => Grip::Open(contact),
            (_, Some(_)) if !has_picture => Grip::Spent(contact),
            (Grip::Absent, Some(_)) => Grip::Spent(contact),
            (Grip::Spent(_), Some(_)) if !anew => Grip::Spent(contact),
            (Grip::Held(..), Some(what)) if !anew => Grip::Held(contact, what),
            (Grip::Open(_) | Grip::Spent(_) | Grip::Held(..), Some(what)) => {
                self.press = self.press.wrapping_add(1);
                Grip::Held(contact, what)
            }
        };
    }

    /// Lets time pass: a device that has been silent for too long is absent. Says whether it has become so.
    pub(crate) fn expire(&mut self, now: Stamp) -> bool {
        let expired = self.deadline().is_some_and(|deadline| now >= deadline);
        if expired {
            self.grip = Grip::Absent;
        }
        expired
    }

    /// There is no picture any more: what is held does not count.
    pub(crate) fn go_blind(&mut self) {
        if let Grip::Held(contact, _) = self.grip {
            self.grip = Grip::Spent(contact);
        }
    }

    pub(crate) fn deadline(&self) -> Option<Stamp> {
        self.contact()
            .map(|contact| contact.arrived.after(self.timeout).after(1))
    }

    /// What is held and counts.
    pub(crate) const fn held(&self) -> Option<H> {
        match self.grip {
            Grip::Held(_, what) => Some(what),
            Grip::Absent | Grip::Open(_) | Grip::Spent(_) => None,
        }
    }

    pub(crate) const fn deadman(&self) -> Deadman {
        match self.grip {
            Grip::Held(..) => Deadman::Held { press: self.press },
            Grip::Absent | Grip::Open(_) | Grip::Spent(_) => Deadman::Released,
        }
    }

    pub(crate) const fn handling(&self) -> Handling {
        match self.grip {
            Grip::Absent => Handling::Absent,
            Grip::Open(_) => Handling::Open,
            Grip::Held(..) => Handling::Held,
            Grip::Spent(_) => Handling::Spent,
        }
    }

    const fn contact(&self) -> Option<Contact> {
        match self.grip {
            Grip::Absent => None,
            Grip::Open(contact) | Grip::Held(contact, _) | Grip::Spent(contact) => Some(contact),
        }
    }
}

impl<H: Encode + Decode<()> + 'static> Remember for Hand<H> {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self {
            timeout: _,
            grip,
            press,
        } = self;
        memory.part(grip)?;
        memory.part(press)
    }
}
