#!/usr/bin/env python3
"""Scenarios for the Python robot of examples/python: every safety rule of docs/wire.md once. Plain Python.

    python3 checks/point_robot.py

Exit code 0 if it did what it must, 1 if not.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples" / "python"))
sys.dont_write_bytecode = True

import tandem_wire as wire  # noqa: E402
from point_robot import PointRobot, Settings  # noqa: E402

MS = 1_000_000
ARBITER, OPERATOR, TRIALS = 7, 8, 9
RELEASED = ("Held", "DeadmanReleased")


class Bench:
    """A robot, a clock, and an arbiter that says what it is told to every 20 ms."""

    def __init__(self, trial=True):
        self.robot, self.now, self.seq, self.state = PointRobot(1, Settings()), 0, 0, None
        self.head, self.arbiter, self.lease = None, ARBITER, {"number": 1, "holder": OPERATOR, "name": "ada"}
        self.take(self.robot.wake(0))
        if trial:
            self.say("trial", TRIALS, ("Begin", {"number": 1, "label": ""}))
            self.idle(20)

    def take(self, out):
        for suffix, data in out:
            if suffix == "state":
                self.head, self.state = wire.decode("state", data)

    def say(self, suffix, session, body, seq=1):
        name = suffix.removesuffix("/clear")
        self.take(self.robot.hear(self.now, suffix, wire.encode(name, wire.header(0, session, seq, 0), body)))

    def setpoint(self, motion, velocity=(0.1, 0.0, 0.0), seen="newest", seq=None, command=None):
        self.seq += 1
        body = {
            "velocity": velocity if motion[0] == "Permitted" else (0.0, 0.0, 0.0),
            "motion": motion,
            "lease": self.lease,
            "asks": None,
            "law": "Human",
            "weight": 1.0,
            "human": velocity,
            "guidance": None,
            "blended": velocity,
            "limited": {"workspace": False, "speed": False, "acceleration": False},
            "command": command,
            "proposal": None,
            "seen": wire.identity(self.head) if seen == "newest" else seen,
            "refused": {"count": 0, "last": None},
        }
        self.say("setpoint", self.arbiter, body, seq or self.seq)

    def idle(self, millis):
        for _ in range(millis):
            self.now += MS
            if self.now >= self.robot.deadline():
                self.take(self.robot.wake(self.now))

    def flow(self, motion, times, **more):
        for _ in range(times):
            self.setpoint(motion, **more)
            self.idle(20)

    def drive(self, press=1):
        self.flow(RELEASED, 2)
        self.flow(("Permitted", {"press": press}), 20)

    def speed(self):
        return sum(part * part for part in self.state["tool_velocity"]) ** 0.5

    def reason(self):
        name, what = self.state["motion"]
        return None if name == "Permitted" else what if isinstance(what, str) else what[0]

    def refused(self):
        return self.state["refused"]["last"]


def it_drives_on_a_fresh_press():
    bench = Bench()
    bench.drive()
    assert bench.reason() is None and abs(bench.speed() - 0.1) < 1e-9


def a_press_that_was_held_before_does_not_count():
    bench = Bench()
    bench.flow(("Permitted", {"press": 1}), 20)
    assert bench.reason() == "AwaitingPress" and bench.speed() == 0.0
    bench.flow(("Permitted", {"press": 2}), 20)
    assert bench.reason() is None


def silence_stops_it_within_110_ms_and_the_old_press_is_spent():
    bench = Bench()
    bench.drive()
    bench.setpoint(("Permitted", {"press": 1}))
    bench.idle(130)
    assert bench.reason() == "SetpointLost", bench.state["motion"]
    assert bench.state["motion"][1][1]["silent"] <= 110 * MS, bench.state["motion"]
    bench.idle(200)
    assert bench.state["at_rest"]
    bench.flow(("Permitted", {"press": 1}), 20)
    assert bench.reason() == "AwaitingPress" and bench.state["at_rest"]


def a_stop_is_told_although_setpoints_come_again_before_the_next_state():
    bench = Bench()
    bench.drive()
    bench.idle(4)
    bench.setpoint(("Permitted", {"press": 1}))
    bench.idle(102)
    assert bench.reason() is None, "no state has come since the stop"
    bench.setpoint(("Permitted", {"press": 1}))
    bench.idle(20)
    assert bench.reason() == "SetpointLost", bench.state["motion"]
    bench.flow(("Permitted", {"press": 1}), 1)
    assert bench.reason() == "AwaitingPress"


def it_brakes_within_its_acceleration():
    bench = Bench()
    bench.flow(RELEASED, 2)
    bench.flow(("Permitted", {"press": 1}), 20, velocity=(0.0, 0.4, 0.0))
    before, steepest = bench.speed(), 0.0
    for _ in range(20):
        bench.flow(RELEASED, 1)
        steepest, before = max(steepest, before - bench.speed()), bench.speed()
    assert 0.0 < steepest <= 4.0 * 0.020 + 1e-9, steepest


def without_a_trial_nothing_moves():
    bench = Bench(trial=False)
    bench.drive()
    assert bench.reason() == "NoTrial" and bench.speed() == 0.0


def a_backlog_in_order_is_too_old():
    bench = Bench()
    bench.drive()
    old = wire.identity(bench.head)
    bench.idle(600)
    bench.flow(("Permitted", {"press": 2}), 20, seen=old)
    assert bench.refused() == "LoopTooOld" and bench.state["at_rest"]


def what_was_made_before_the_trial_is_too_old():
    bench = Bench(trial=False)
    bench.flow(RELEASED, 3)
    old = wire.identity(bench.head)
    bench.say("trial", TRIALS, ("Begin", {"number": 1, "label": ""}))
    bench.setpoint(RELEASED, seen=old)
    bench.idle(20)
    assert bench.refused() == "LoopTooOld"


def numbers_are_checked():
    for seq, why in ((0, "Duplicate"), (-1, "OutOfOrder"), (10**6, "TooFarAhead")):
        bench = Bench()
        bench.drive()
        bench.setpoint(RELEASED, seq=bench.seq + seq)
        bench.seq -= 1
        bench.idle(20)
        assert bench.refused() == why, (bench.refused(), why)


def a_command_that_answers_an_old_state_moves_nothing_however_fresh_the_arbiter_is():
    bench = Bench()
    bench.drive()
    used = {"id": {"session": OPERATOR, "seq": 1}, "sent": 0, "age": 0, "seen": wire.identity(bench.head)}
    bench.flow(("Permitted", {"press": 1}), 20, command=used)
    assert bench.reason() is None
    bench.flow(("Permitted", {"press": 1}), 20, command=used)
    assert bench.reason() == "LoopTooOld"


def a_second_arbiter_is_not_heard():
    bench = Bench()
    bench.drive()
    bench.arbiter = 70
    bench.setpoint(("Permitted", {"press": 9}))
    bench.idle(20)
    assert bench.refused() == "ForeignSession"
    bench.idle(200)
    bench.setpoint(("Permitted", {"press": 9}))
    bench.idle(20)
    assert bench.refused() == "ForeignSession", "one that falters keeps its place for a second"


def an_outdated_lease_is_refused_and_a_missing_one_holds():
    bench = Bench()
    bench.drive()
    bench.lease = {"number": 1, "holder": 80, "name": "eve"}
    bench.setpoint(("Permitted", {"press": 1}))
    bench.idle(20)
    assert bench.refused() == "SecondOperator"
    bench.lease = None
    bench.flow(("Permitted", {"press": 1}), 1)
    assert bench.reason() == "NoLease"


def another_holder_inherits_no_press():
    bench = Bench()
    bench.drive()
    bench.lease = {"number": 2, "holder": 80, "name": "eve"}
    bench.flow(("Permitted", {"press": 1}), 20)
    assert bench.reason() == "AwaitingPress" and bench.speed() == 0.0


def an_emergency_stop_stays_until_it_is_cleared_by_its_name():
    bench = Bench()
    bench.drive()
    bench.say("estop", 5, ("Stop", {"by": "ada"}), seq=3)
    assert bench.reason() == "EmergencyStop", "acknowledged at once"
    bench.say("estop/clear", 6, ("Clear", {"stop": {"session": 5, "seq": 2}, "by": "eve"}))
    bench.drive(press=2)
    assert bench.reason() == "EmergencyStop" and bench.state["at_rest"]
    bench.say("estop", 6, ("Clear", {"stop": {"session": 5, "seq": 4}, "by": "ada"}), seq=2)
    bench.idle(20)
    assert bench.refused() == "Unreadable", "who may stop may not therefore let go"
    bench.say("estop", 7, ("Stop", {"by": "bob"}))
    bench.say("estop/clear", 6, ("Clear", {"stop": {"session": 7, "seq": 1}, "by": "ada"}), seq=2)
    assert bench.reason() == "EmergencyStop", "every stop has to be cleared"
    bench.say("estop/clear", 6, ("Clear", {"stop": {"session": 5, "seq": 4}, "by": "ada"}), seq=3)
    bench.say("estop", 5, ("Stop", {"by": "ada"}), seq=4)
    bench.flow(("Permitted", {"press": 2}), 5)
    assert bench.reason() == "AwaitingPress", bench.state["motion"]
    bench.drive(press=3)
    assert bench.reason() is None


def walls_hold():
    bench = Bench()
    bench.flow(RELEASED, 2)
    bench.flow(("Permitted", {"press": 1}), 400, velocity=(9.0, -9.0, -9.0))
    x, y, z = bench.state["tool"]["position"]
    assert x <= 0.8 and y >= -0.5 and z >= 0.02 and (x, y, z) != Settings.start


def garbage_is_counted():
    bench = Bench()
    for data in (b"", bytes([wire.VERSION, 4]) + bytes(30), bytes(2000), bytes([wire.VERSION, 4]) + bytes(402)):
        bench.take(bench.robot.hear(bench.now, "setpoint", data))
    bench.idle(20)
    assert bench.state["refused"] == {"count": 4, "last": "Unreadable"}


def it_ends_at_rest():
    bench = Bench()
    bench.drive()
    bench.take(bench.robot.stop(bench.now))
    assert bench.reason() == "ShuttingDown" and bench.state["at_rest"]


SCENARIOS = [value for name, value in list(globals().items()) if callable(value) and name.islower() and value.__module__ == "__main__"]
failed = 0
for scenario in SCENARIOS:
    try:
        scenario()
    except AssertionError as error:
        failed += 1
        print(f"FAIL {scenario.__name__.replace('_', ' ')}: {error}")
print(f"point robot: {len(SCENARIOS)} scenarios, {failed} failed")
sys.exit(1 if failed or len(SCENARIOS) < 10 else 0)
