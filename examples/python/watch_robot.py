#!/usr/bin/env python3
"""Watches a robot: a line whenever something changes that a person wants to know, and a summary at the end.

    python examples/python/watch_robot.py --connect tcp/127.0.0.1:7447 --until-goal 60

Takes no part: it subscribes and says nothing. Exit code 0; 1 if `--until-goal` is given and the goal was not reached
with the robot at rest within so many seconds.
"""

import argparse
import json
import signal
import sys
import time

import tandem_wire as wire
from tandem_link import Link, arguments


class Watch:
    """What was seen so far. Pure: messages in, lines out."""

    def __init__(self):
        self.counts, self.unreadable, self.goal = {}, 0, None
        self.said, self.last, self.closest, self.presses = None, None, None, set()

    def see(self, suffix, data):
        """Takes in a message; a line for people if something changed."""
        try:
            head, body = wire.decode(suffix, data)
        except wire.Malformed:
            self.unreadable += 1
            return None
        self.counts[suffix] = self.counts.get(suffix, 0) + 1
        if suffix == "scene":
            self.goal = (body["goal"], body["goal_tolerance"])
        return self._state(head, body) if suffix == "state" else None

    def _state(self, head, state):
        self.last = state
        if state["motion"][0] == "Permitted":
            self.presses.add(state["motion"][1]["press"])
        near = state["closest"]
        if near and state["trial"] and (self.closest is None or near["distance"] < self.closest):
            self.closest = near["distance"]
        obeyed = state["obeys"] and state["obeys"]["setpoint"]
        shared = bool(obeyed and obeyed["guidance"])
        saying = (state["trial"], state["motion"][0], wire.in_words(state["motion"]), shared)
        if saying == self.said:
            return None
        self.said = saying
        x, y, z = state["tool"]["position"]
        driver = "human and robot" if shared else "the human alone"
        who = f", {driver}, weight {obeyed['weight']:.2f}" if obeyed and saying[1] == "Permitted" else ""
        return f"tick {head['tick']:6}  trial {state['trial']}  tool {x:.3f} {y:.3f} {z:.3f}  {saying[2]}{who}"

    def is_at_goal(self):
        """Whether a trial's goal is reached, with the robot at rest and the human's hand off."""
        if not self.last or not self.goal or not self.last["trial"] or not self.last["at_rest"]:
            return False
        goal, tolerance = self.goal
        apart = sum((a - b) ** 2 for a, b in zip(self.last["tool"]["position"], goal)) ** 0.5
        return apart <= tolerance and self.last["motion"][0] == "Held"

    def summary(self):
        return {
            "reached_goal": self.is_at_goal(),
            "messages": self.counts,
            "unreadable": self.unreadable,
            "presses": len(self.presses),
            "closest_m": self.closest,
        }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--until-goal", type=float, metavar="SECONDS", help="ends when the goal is reached")
    parser.add_argument("--json", action="store_true", help="the summary as JSON, and no lines")
    arguments(parser)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    link, watch = Link(options, ("command", "proposal", "setpoint", "state", "scene")), Watch()
    print(f"watch: watching robot {options.robot!r}", file=sys.stderr, flush=True)
    end = time.monotonic() + options.until_goal if options.until_goal else None
    try:
        while (end is None or time.monotonic() < end) and not (end and watch.is_at_goal()):
            item = link.next(0.2)
            line = watch.see(*item[1:]) if item else None
            if line and not options.json:
                print(line, flush=True)
    except KeyboardInterrupt:
        pass
    finally:
        link.close()
    summary = watch.summary()
    print(json.dumps(summary) if options.json else summary)
    return 0 if end is None or summary["reached_goal"] else 1


if __name__ == "__main__":
    sys.exit(main())
