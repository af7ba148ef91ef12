#!/usr/bin/env python3
"""A robot for Tandem that is no arm: one point that goes where it is told, within its limits. It takes robot-sim's place.

    python examples/python/point_robot.py --listen tcp/127.0.0.1:7447
    tandem arbiter; tandem predictor; tandem operator        # each in a terminal of its own

`--lockstep` for nodes that run with `--set loop.pace=max`. Ends with Ctrl-C.

The robot itself (`PointRobot`) is pure: bytes and the time in, bytes out. All safety rules are those of docs/wire.md.
"""

import argparse
import math
import signal
import sys
import time

import tandem_wire as wire
from tandem_safety import MILLISECOND, SECOND, Hearing, Latch, Refused, Trials

STEP = 10 * MILLISECOND  # the point's own loop
POINTING_DOWN = (1.0, 0.0, 0.0, 0.0)
TOOL_FRAME = 8
TOOL_RADIUS = 0.005


class Settings:
    """Rates, limits and surroundings: Tandem's defaults."""

    lockstep = False
    period, stream_period = 100 * MILLISECOND, 20 * MILLISECOND
    timeout, loop_age_limit = 100 * MILLISECOND, 500 * MILLISECOND
    speed, acceleration = 0.5, 4.0  # m/s, m/s²
    start, goal, goal_tolerance = (0.5, -0.3, 0.15), (0.5, 0.3, 0.15), 0.010
    low, high = (0.2, -0.5, 0.02), (0.8, 0.5, 0.8)  # the workspace
    obstacles = ((0.5, -0.02), (0.5, 0.16))
    obstacle_radius, obstacle_height = 0.020, 0.20

    def scene(self):
        obstacle = {"radius": self.obstacle_radius, "height": self.obstacle_height}
        return {
            "obstacles": [{"foot": (x, y, 0.0), **obstacle} for x, y in self.obstacles],
            "bodies": [{"frame": TOOL_FRAME, "from": (0.0,) * 3, "to": (0.0,) * 3, "radius": TOOL_RADIUS}],
            "start": self.start,
            "goal": self.goal,
            "goal_tolerance": self.goal_tolerance,
            "workspace": {"min": self.low, "max": self.high},
            "period": self.period,
        }

    def clearance(self, place):
        """The smallest distance from the point's surface to an obstacle."""
        nearest = None
        for number, (x, y) in enumerate(self.obstacles):
            across = math.hypot(place[0] - x, place[1] - y) - self.obstacle_radius
            above = place[2] - self.obstacle_height
            if across > 0.0 and above > 0.0:
                distance = math.hypot(across, above)
            else:
                distance = max(across, above)
            if nearest is None or distance - TOOL_RADIUS < nearest["distance"]:
                nearest = {"distance": distance - TOOL_RADIUS, "body": 0, "obstacle": number}
        return nearest


def norm(vector):
    return math.sqrt(sum(part * part for part in vector))


def capped(vector, limit):
    length = norm(vector)
    return tuple(part * limit / length for part in vector) if length > limit else tuple(vector)


class Point:
    """The moving point: velocity ramps within the acceleration limit, and brakes before the walls."""

    def __init__(self, settings):
        self.settings, self.place, self.velocity = settings, settings.start, (0.0, 0.0, 0.0)

    def is_at_rest(self):
        return self.velocity == (0.0, 0.0, 0.0)

    def advance(self, wished):
        """One step towards this velocity."""
        limits, dt = self.settings, STEP * 1e-9
        wished = self._within_walls(capped(wished, limits.speed))
        change = tuple(wish - now for wish, now in zip(wished, self.velocity))
        change = capped(change, 0.8 * limits.acceleration * dt)
        self.velocity = self._within_walls(tuple(now + part for now, part in zip(self.velocity, change)))
        self.place = tuple(
            min(max(at + part * dt, low), high)
            for at, part, low, high in zip(self.place, self.velocity, limits.low, limits.high)
        )

    def _within_walls(self, velocity):
        """No faster towards a wall than what a third of the acceleration stops before it."""

        def room(distance):
            return math.sqrt(2.0 * 0.3 * self.settings.acceleration * max(0.0, distance))

        bounds = zip(velocity, self.place, self.settings.low, self.settings.high)
        return tuple(min(max(part, -room(at - low)), room(high - at)) for part, at, low, high in bounds)


class PointRobot:
    """The robot. `hear` takes in a message, `wake` lets time pass; both return what is to be published."""

    def __init__(self, session, settings):
        self.session, self.settings = session, settings
        self.point, self.closest = Point(settings), settings.clearance(settings.start)
        self.hearing = Hearing(max(settings.timeout, 5 * self._message_period() // 2), settings.loop_age_limit)
        self.latch, self.trials = Latch(), Trials()
        self.motion, self.obeys, self.waiting = ("Held", "NoSetpointYet"), None, None
        self.untold = None  # why it stopped by itself, until a state has told it
        self.tick, self.in_step, self.time = 0, False, 0
        self.state_seq = self.scene_seq = 0
        self.next_state = self.next_scene = 0

    def _message_period(self):
        return self.settings.period if self.settings.lockstep else self.settings.stream_period

    def deadline(self):
        """When it wants to be woken in real time."""
        return min(self.next_state, self.next_scene, self.time + STEP)

    def hear(self, now, suffix, data):
        out = self._begin(now)
        names = {
            "setpoint": self._on_setpoint,
            "trial": self._on_trial,
            "estop": self._on_emergency,
            "estop/clear": self._on_emergency,
        }
        try:
            head, body = wire.decode_at(suffix, data)
            names[suffix](self._now(now), head, body, out)
        except wire.Malformed:
            self.hearing.refusals.add("Unreadable")
        except Refused as why:
            self.hearing.refusals.add(why.args[0])
        self._end(now, out)
        return out

    def wake(self, now):
        out = self._begin(now)
        self._end(now, out)
        return out

    def stop(self, now):
        """The process ends, and nothing will ramp the point down once it has: its ramp is simulated ahead, and told."""
        out = self._begin(now)
        self._hold("ShuttingDown")
        while not self.point.is_at_rest():
            self._step()
        self._publish_state(self._now(now), out)
        return out

    def _now(self, now):
        return self.tick * self.settings.period if self.settings.lockstep else max(now, self.time)

    def _begin(self, now):
        if not self.settings.lockstep:
            self._catch_up(now)
            self.tick = now // self.settings.period
        return []

    def _end(self, now, out):
        self._begin_pending_trial(now, out)
        if not self.settings.lockstep:
            now = self._now(now)
            if now >= self.next_scene:
                self._publish_scene(now, out)
            if now >= self.next_state:
                self._publish_state(now, out)

    def _on_setpoint(self, now, head, body, out):
        lockstep = self.settings.lockstep
        if lockstep and (not self.in_step or head["tick"] != self.tick):
            raise Refused("OutOfOrder")
        motion = self.hearing.admit(now, head, body)
        self.motion = self.untold if self.untold and motion[0] == "Held" else motion
        if body["motion"][0] == "Permitted" and self.trials.number == 0:
            self._hold("NoTrial")
        self.latch.hear_of(body["motion"])
        self._keep_stopped()
        self.waiting = {"id": wire.identity(head), "arrived": now, "moved": now, "setpoint": body}
        if lockstep:
            self.tick += 1
            self._catch_up(self._now(now))
            self._publish_state(self._now(now), out)

    def _on_trial(self, _now, head, mark, _out):
        if self.trials.take(head, mark):
            self.trials.number = 0
            if self.motion[0] == "Permitted":
                self._hold("TrialOver")

    def _on_emergency(self, now, head, emergency, out):
        if self.latch.hear(head, emergency):
            self.motion = ("Held", "AwaitingPress")
            self.hearing.rearm.forget()
            self._keep_stopped()
            if not self.settings.lockstep:
                self._publish_state(now, out)

    def _keep_stopped(self):
        """While an emergency stop is in force nothing else is said about motion, and no press counts."""
        if self.latch.reason():
            self.motion = ("Held", self.latch.reason())
            self.hearing.rearm.forget()

    def _hold(self, reason):
        self.motion = ("Held", reason)
        self.hearing.rearm.spend()
        self._keep_stopped()

    def _catch_up(self, now):
        """Every step up to now, under what was known then; the watchdog is asked at each."""
        while self.time + STEP <= now:
            self._watch(self.time)
            if self.motion[0] == "Held" and self.point.is_at_rest() and self.waiting is None:
                self.time = now - now % STEP
                break
            self._step()
        self._watch(now)

    def _watch(self, now):
        lost = None if self.settings.lockstep else self.hearing.newly_lost(now)
        if lost:
            stopped = ("Held", lost)
            self.untold = stopped if self.motion[0] == "Permitted" else self.untold
            self.motion = stopped
            self._keep_stopped()

    def _step(self):
        if self.waiting:
            self.obeys, self.waiting = self.waiting, None
            self.obeys["moved"] = max(self.time, self.obeys["arrived"])
        moving = self.motion[0] == "Permitted" and self.obeys
        self.point.advance(self.obeys["setpoint"]["velocity"] if moving else (0.0, 0.0, 0.0))
        self.time += STEP
        self.closest = min(self.closest, self.settings.clearance(self.point.place), key=lambda at: at["distance"])

    def _begin_pending_trial(self, now, out):
        lockstep, number = self.settings.lockstep, self.trials.pending
        standing = self.motion[0] == "Held" and self.point.is_at_rest()
        if number is None or not (lockstep or standing):
            return
        self.trials.pending = None
        self.hearing.rearm.spend()
        self.hearing.echoes.outdate()
        self.point, self.obeys, self.waiting = Point(self.settings), None, None
        self.closest = self.settings.clearance(self.point.place)
        if lockstep and self.in_step:
            # The state of this tick is out and speaks of the old place; the trial starts with the next one.
            self.tick += 1
        self.time = max(self.time, self._now(now) if lockstep else self.time)
        self.in_step, self.trials.number, self.trials.start = lockstep, number, self.tick
        self._publish_scene(self._now(now), out)
        self._publish_state(self._now(now), out)

    def _publish_scene(self, now, out):
        self.next_scene, self.scene_seq = (now // SECOND + 1) * SECOND, self.scene_seq + 1
        head = wire.header(self.tick, self.session, self.scene_seq, now)
        out.append(("scene", wire.encode("scene", head, self.settings.scene())))

    def _publish_state(self, now, out):
        period = self.settings.stream_period
        self.next_state, self.state_seq = (now // period + 1) * period, self.state_seq + 1
        self.untold = None
        pose, here = {"position": self.point.place, "orientation": POINTING_DOWN}, self.settings.clearance(self.point.place)
        state = {
            "trial": self.trials.number,
            "trial_start": self.trials.start,
            "joints": [0.0] * 7,
            "joint_velocities": [0.0] * 7,
            "links": [pose] * 8,
            "tool": pose,
            "tool_velocity": self.point.velocity,
            "clearance": here,
            "closest": self.closest,
            "motion": self.motion,
            "at_rest": self.point.is_at_rest(),
            "obeys": self.obeys,
            "arrivals": None,
            "refused": self.hearing.refusals.said(),
        }
        head = wire.header(self.tick, self.session, self.state_seq, now)
        self.hearing.echoes.note(now, wire.identity(head))
        self.closest = here
        out.append(("state", wire.encode("state", head, state)))


def run(options):
    """The shell: a clock, a queue, Zenoh."""
    from tandem_link import LOOP, Link, fresh_session

    settings = Settings()
    settings.lockstep = options.lockstep
    session = fresh_session()
    robot = PointRobot(session, settings)
    link = Link(options, ("setpoint", "trial", "estop", "estop/clear"), options.lockstep)
    publishers = {"state": link.publisher("state", True), "scene": link.publisher("scene", False)}
    info = {"session": session, "config": "", "seed": 0, "build": "point_robot.py", "model": b""}
    link.answer_info("robot-sim", info)
    link.appear("robot-sim")
    print(f"point-robot: ready, robot {options.robot!r}; Ctrl-C ends it", file=sys.stderr, flush=True)
    if options.lockstep:
        link.await_peers(name for name in LOOP if name != "robot-sim")
    began = time.monotonic_ns()

    def publish(out):
        for suffix, data in out:
            publishers[suffix].put(data)

    try:
        while True:
            now = time.monotonic_ns() - began
            limit = 1.0 if options.lockstep else (robot.deadline() - now) * 1e-9
            item = link.next(limit)
            now = time.monotonic_ns() - began
            if item is None:
                publish(robot.wake(now))
                continue
            arrived, suffix, data = item
            # What has waited here for as long as a lost stream would look fresh to the robot.
            if options.lockstep or now - (arrived - began) <= settings.timeout or suffix != "setpoint":
                publish(robot.hear(now, suffix, data))
    except KeyboardInterrupt:
        publish(robot.stop(time.monotonic_ns() - began))
    finally:
        link.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lockstep", action="store_true", help="time is driven by messages, as with loop.pace=max")
    from tandem_link import arguments

    arguments(parser)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run(parser.parse_args())


if __name__ == "__main__":
    main()
