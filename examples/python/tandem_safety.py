"""What every receiver that moves something checks, in plain Python: docs/wire.md, "Rules for whoever moves something".

Pure: no clock and no Zenoh; `now` is an argument, nanoseconds of the receiver's own monotonic clock.
"""

MILLISECOND = 1_000_000
SECOND = 1_000_000_000
LEAP = 50  # numbers may run ahead of the time that has passed by so many
REMEMBERED = 256  # states whose sending is remembered
REPEATED = 200  # repetitions of an emergency stop that one clear covers


class Refused(Exception):
    """A message that must be dropped; its only argument is the name of a `Refusal`."""


class Refusals:
    """How many messages were dropped, and why the last one was."""

    def __init__(self):
        self.count, self.last = 0, None

    def add(self, why):
        self.count, self.last = self.count + 1, why

    def said(self):
        return {"count": self.count, "last": self.last}


class Guard:
    """Admits one stream's messages in order, from one sender at a time, and knows when the stream is lost.

    A stranger has to wait for `succession` after the last message of the one before. Whoever lost its place to one may take it
    back after the timeout.
    """

    def __init__(self, timeout, succession=0):
        self.timeout, self.succession = timeout, max(timeout, succession)
        self.newest, self.before, self.arrived = None, None, 0

    def admit(self, now, head):
        if self.newest is not None:
            if self.newest["session"] != head["session"]:
                self._change(now, head)
            elif head["seq"] == self.newest["seq"]:
                raise Refused("Duplicate")
            elif head["seq"] < self.newest["seq"]:
                raise Refused("OutOfOrder")
            elif head["seq"] - self.newest["seq"] > LEAP + 2 * self.silent(now) // MILLISECOND:
                raise Refused("TooFarAhead")
        self.newest, self.arrived = {"session": head["session"], "seq": head["seq"]}, now

    def _change(self, now, head):
        """Another sender takes the place, if it may."""
        returning = self.before is not None and self.before["session"] == head["session"]
        if self.silent(now) <= (self.timeout if returning else self.succession):
            raise Refused("ForeignSession")
        if returning and head["seq"] <= self.before["seq"]:
            raise Refused("OutOfOrder")
        self.before = None if returning else self.newest  # whoever had only slipped in is a stranger again

    def silent(self, now):
        return max(0, now - self.arrived)

    def is_lost(self, now):
        return self.newest is None or self.silent(now) > self.timeout

    def session(self):
        return self.newest and self.newest["session"]


class Echoes:
    """Remembers when our states were sent, to tell how old the one was that an answer was made from."""

    def __init__(self, limit):
        self.limit, self.sent = limit, {}
        self.session, self.newest, self.outdated = None, 0, 0

    def note(self, now, identity):
        self.session, self.newest = identity["session"], identity["seq"]
        self.sent[self.newest] = now
        self.sent.pop(self.newest - REMEMBERED, None)

    def outdate(self):
        """The arm was put elsewhere: answers to the states so far mean nothing any more."""
        self.outdated = self.newest

    def admit(self, now, seen):
        known = seen is not None and seen["session"] == self.session and seen["seq"] > self.outdated
        if not known or seen["seq"] not in self.sent or now - self.sent[seen["seq"]] > self.limit:
            raise Refused("LoopTooOld")


class Rearm:
    """Makes motion wait for a fresh press after any stop, loss or change of sender.

    `state` is "Fresh" (nothing seen since), ("Spent", press), "Open" (seen released) or ("Armed", press).
    """

    def __init__(self):
        self.state, self.last = "Fresh", None

    def hear(self, motion):
        """Takes in what a setpoint says; returns what the robot says of itself."""
        name, what = motion
        if name == "Held":
            self._hear_held(what)
            return motion
        press = what["press"]
        if self.state == "Open" or (isinstance(self.state, tuple) and self.state[1] != press):
            self.state = ("Armed", press)
        elif self.state == "Fresh":
            self.state = ("Spent", press)
        if self.state != ("Armed", press):
            return ("Held", "AwaitingPress")
        self.last = press
        return motion

    def _hear_held(self, reason):
        if reason == "DeadmanReleased":
            self.state = "Open"
        elif self.state[0] == "Armed":
            self.state = ("Spent", self.state[1])
        elif self.state == "Fresh":
            # The sender is there and holds motion itself: it will permit only what it sees pressed after this.
            self.state = "Open" if self.last is None else ("Spent", self.last)

    def spend(self):
        """The robot stopped by itself: any other press will do."""
        if self.state[0] == "Armed":
            self.state = ("Spent", self.state[1])

    def forget(self):
        """Something was missed, or somebody else speaks: a press that is held by now does not count."""
        self.state = "Fresh"

    def change_hands(self):
        """Another operator drives: its press counts if motion was held in between."""
        self.last = None
        self.state = "Fresh" if self.state == "Fresh" or self.state[0] == "Armed" else "Open"


class Latch:
    """Holds every sender's emergency stop until it is cleared itself; tells the one that was heard last."""

    SENDERS = 4

    def __init__(self):
        self.stops = []  # (identity, by), the one that was heard last in front
        self.cleared = []

    def hear(self, head, emergency):
        """Takes in a message; says whether anything changed."""
        name, what = emergency
        if name == "Clear":
            return self._clear(what["stop"])
        return self._set({"session": head["session"], "seq": head["seq"]}, what["by"])

    def hear_of(self, motion):
        """A setpoint may tell of a stop that was missed here."""
        name, what = motion
        if name == "Held" and what[0] == "EmergencyStop" and self._place_of(what[1]["stop"]["session"]) is None:
            self._set(what[1]["stop"], what[1]["by"])

    def reason(self):
        """Why nothing may move, while a stop is in force."""
        return ("EmergencyStop", {"stop": self.stops[0][0], "by": self.stops[0][1]}) if self.stops else None

    def _place_of(self, sender):
        return next((at for at, (stop, _) in enumerate(self.stops) if stop["session"] == sender), None)

    def _set(self, identity, by):
        place = self._place_of(identity["session"])
        settled = self.cleared + ([] if place is None else [self.stops[place][0]])
        if any(is_covered(identity, before) for before in settled):
            return False
        if place is not None:
            del self.stops[place]
        elif len(self.stops) == self.SENDERS:
            del self.stops[0]
        self.stops.insert(0, (identity, by))
        return True

    def _clear(self, named):
        meant = next((at for at, (stop, _) in enumerate(self.stops) if is_covered(stop, named)), None)
        if meant is None:
            return False
        del self.stops[meant]
        self.cleared = [named] + self.cleared[: self.SENDERS - 1]
        return True


def is_covered(stop, named):
    """Whether a stop of this name is `named`, or came up to REPEATED before it from the same sender."""
    return stop["session"] == named["session"] and 0 <= named["seq"] - stop["seq"] <= REPEATED


class Hearing:
    """The stream of setpoints, as a robot hears it: everything above, in the order of the rules."""

    def __init__(self, timeout, loop_age_limit):
        self.guard, self.echoes = Guard(timeout, SECOND), Echoes(loop_age_limit)
        self.rearm, self.refusals = Rearm(), Refusals()
        self.alive, self.too_old, self.lease = False, False, None

    def admit(self, now, head, setpoint):
        """What the robot may do under this setpoint, as a `Motion`; raises `Refused`."""
        try:
            self.echoes.admit(now, setpoint["seen"])
            if setpoint["command"] and setpoint["motion"][0] == "Permitted":
                # The arbiter may have heard late itself of the state that the command answers.
                self.echoes.admit(now, setpoint["command"]["seen"])
        except Refused:
            self.too_old = True
            raise
        same = self.guard.session() == head["session"]
        others = self._check_lease(setpoint["lease"], same)
        self.guard.admit(now, head)
        self.too_old, self.alive = False, True
        if not same:
            self.rearm.forget()
            self.lease = None
        if others:
            self.rearm.change_hands()
        self.lease = setpoint["lease"] or self.lease
        motion = setpoint["motion"]
        if motion[0] == "Permitted" and setpoint["lease"] is None:
            motion = ("Held", "NoLease")
        return self.rearm.hear(motion)

    def _check_lease(self, new, same):
        """Refuses a lease that a later one of the same arbiter has outdated; says whether somebody else drives now."""
        known = self.lease
        if known is None or new is None:
            return new is not None
        if (new["number"], new["holder"]) == (known["number"], known["holder"]) and same:
            return False
        if same and self.alive and new["number"] <= known["number"]:
            raise Refused("SecondOperator")
        return True

    def newly_lost(self, now):
        """Reports the loss of the stream, once."""
        if not self.alive or not self.guard.is_lost(now):
            return None
        self.alive = False
        self.rearm.forget()
        return "LoopTooOld" if self.too_old else ("SetpointLost", {"silent": self.guard.silent(now)})


class Trials:
    """Which trial runs, and whose marks begin and end it."""

    REMEMBERED = 8

    def __init__(self):
        self.number, self.start, self.pending = 0, 0, None
        self.begun = []  # (session, newest number), last one first

    def take(self, head, mark):
        """Takes in a mark; says whether the trial that runs is over."""
        (name, what), session = mark, head["session"]
        if name == "End":
            over = bool(self.begun) and self.begun[0] == (session, what["number"])
            self.pending = None if over else self.pending
            return over
        newest = dict(self.begun).get(session, 0)
        if what["number"] <= newest:
            return False  # a repetition for those who come late, or a straggler
        others = [pair for pair in self.begun if pair[0] != session]
        self.begun = [(session, what["number"])] + others[: self.REMEMBERED - 1]
        self.pending = what["number"]
        return True
