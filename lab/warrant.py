"""By what a robot moved: whether somebody held the deadman and the lease. Pure: messages in, what is wrong with them out.

    a state that says "moving" ──obeys──▶ its setpoint ──names──▶ lease and command ──says──▶ the deadman is held
                                                                                    ──answers──▶ a recent state

A robot may let itself move only while all of that is so. Whoever stands on its host sees every link: the state carries the
setpoint whole, and commands pass by on their way to the arbiter. With certificates an observer may not hear commands; then what
they say is not judged, and counted as such.
"""

# So long before a state that says "moving" the deadman was seen held at most, by whoever holds the lease: 100 ms until the
# arbiter misses commands, 20 ms to the next state, and as much again for a machine that is busy.
HELD_WITHIN_S = 0.25
# A state says whether the robot may move as soon as a setpoint has told it, and which setpoint it obeys from the next plan on:
# ten ticks later at most, and one for rounding.
TAKES_UP_S = 0.011
# So old may the state be that the command answers: half a second as the arbiter admits it, the command then counts for 100 ms,
# the setpoint for 110, and the next state comes 20 ms later.
ANSWERS_WITHIN_S = 0.75
REMEMBERED = 2000  # commands, or states: forty seconds of one operator's


class Warrants:
    """What operators were heard to say, and whether it lets a robot move."""

    def __init__(self):
        self.said = {}  # by a command's name: the press it holds, or None, and the name of the state that it answers
        self.sent = {}  # by a state's name: when it was sent
        self.held = {}  # by operator and press: when it was last seen held
        self.newest = {}  # by operator: the number of the last command
        self.waiting = (None, 0.0)  # the press of the setpoint that the arm has still to take up, and since when
        self.warranted = self.unjudged = 0  # states

    def hear(self, now, head, command):
        """Takes in a command, and gives the press that begins with it, if one does. What somebody says again is no news."""
        operator, number = head["session"], head["seq"]
        if number <= self.newest.get(operator, 0):
            return None
        self.newest[operator] = number
        deadman = command["deadman"]
        press = None if deadman == "Released" else deadman[1]["press"]
        keep(self.said, (operator, number), (press, command["seen"] and name_of(command["seen"])))
        begins = press is not None and (operator, press) not in self.held
        if press is not None:
            self.held[operator, press] = now
        return press if begins else None

    def missing(self, sent, head, state):
        """What a state that was sent then lacks to say "moving", in words; None if it lacks nothing, or does not say so."""
        keep(self.sent, name_of(head), sent)
        setpoint = state["obeys"] and state["obeys"]["setpoint"]
        taken_up = setpoint and setpoint["motion"] == state["motion"]
        if taken_up or state["motion"][0] != "Permitted":
            self.waiting = (None, sent)
        if state["motion"][0] != "Permitted":
            return None
        press = state["motion"][1]["press"]
        if not taken_up:
            return self._wait(sent, press)
        if not setpoint["lease"]:
            return "nobody holds the lease"
        if not setpoint["command"]:
            return "its setpoint was made from no command"
        holder, command = setpoint["lease"]["holder"], setpoint["command"]["id"]
        if command["session"] != holder:
            return "the command is not the lease holder's"
        if name_of(command) not in self.said:
            self.unjudged += 1
            return None
        why = self._deadman(sent, *self.said[name_of(command)], holder, press)
        self.warranted += why is None
        return why

    def _wait(self, sent, press):
        if self.waiting[0] != press:
            self.waiting = (press, sent)
        if sent - self.waiting[1] > TAKES_UP_S:
            return "the setpoint that it obeys does not let it move by this press"
        self.unjudged += 1
        return None

    def _deadman(self, sent, held, answers, holder, press):
        if held != press:
            return "the deadman was not held by this press"
        silent = sent - self.held[holder, press]
        if silent > HELD_WITHIN_S:
            return f"the deadman was last seen held {1e3 * silent:.0f} ms before"
        age = sent - self.sent.get(answers, sent)
        return f"the command answers a state that is {1e3 * age:.0f} ms old" if age > ANSWERS_WITHIN_S else None


def name_of(identity):
    return identity["session"], identity["seq"]


def keep(known, name, what):
    """Remembers what came first by a name, and forgets the oldest where there is too much."""
    known.setdefault(name, what)
    if len(known) > REMEMBERED:
        del known[next(iter(known))]
