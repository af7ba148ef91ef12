#!/usr/bin/env python3
"""Stands on the robot's host and watches: one line of JSON on the output for whatever whoever drives the lab must know.

On its input: `begin N` begins trial N. Every line carries `now`, this machine's monotonic clock in seconds, and the robot's
clock beside it where a state brought it. Motion that begins by a press which had let the robot move before is told as `stale`;
what a state lacks that says it moves, as `unwarranted` (warrant.py). `warranted` states lacked nothing. A press of the
deadman that begins is told as `pressed`.
"""

import argparse
import json
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples" / "python"))
import tandem_wire as wire  # noqa: E402
from tandem_link import Link, arguments, fresh_session  # noqa: E402
from warrant import Warrants  # noqa: E402

MOVING_M_S = 0.03


class Observer:
    """What has been seen. Pure: arrivals in, lines out."""

    def __init__(self):
        self.used, self.said, self.newest, self.warrants = set(), None, (None, 0), Warrants()

    def take(self, now, suffix, head, body, begun):
        """The lines that a message is worth; `begun` is the moment at which its sender's clock began."""
        if suffix == "command":
            press = self.warrants.hear(now, head, body)
            if press is not None:
                yield {"pressed": press, "now": now}
            return
        # What somebody says again is no news.
        if head["session"] == self.newest[0] and head["seq"] <= self.newest[1]:
            return
        self.newest = (head["session"], head["seq"])
        missing = self.warrants.missing(begun + head["sent"] * 1e-9, head, body)
        if missing:
            yield {"unwarranted": missing, "now": now}
        line = self._state(now, head, body)
        if line:
            yield {**line, "warranted": self.warrants.warranted, "unjudged": self.warrants.unjudged}

    def _state(self, now, head, body):
        """A line for each state that differs from the one before in what matters."""
        permitted, moving = body["motion"][0] == "Permitted", wire_speed(body["tool_velocity"]) > MOVING_M_S
        obeyed = body["obeys"] and body["obeys"]["setpoint"]
        said = {
            "session": f"{head['session']:016x}",
            "trial": body["trial"],
            "permitted": permitted,
            "moving": moving and permitted,
            "at_rest": body["at_rest"],
            "why": wire.in_words(body["motion"]),
            "shared": bool(obeyed and obeyed["guidance"]),
        }
        was = self.said or {}
        stale = False
        if permitted and obeyed and obeyed["lease"]:
            press = (obeyed["lease"]["holder"], body["motion"][1]["press"])
            stale = not was.get("permitted") and press in self.used
            self.used.add(press)
        self.said = said
        if said == was and not stale:
            return None
        return {**said, "now": now, "robot_s": head["sent"] * 1e-9, "stale": stale}


def wire_speed(velocity):
    return sum(part * part for part in velocity) ** 0.5


class Origin:
    """The stamp of this machine's clock at which the robot's began: the least difference that there was."""

    def __init__(self):
        self.session, self.at = None, 0.0

    def narrow(self, now, head):
        """Takes in a state; whether it told anything new."""
        at = now - head["sent"] * 1e-9
        if head["session"] == self.session and at >= self.at - 1e-4:
            return False
        self.session, self.at = head["session"], at
        return True


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments(parser)
    parser.add_argument("--hears-commands", action="store_true", help="also judges whether the deadman is held")
    options = parser.parse_args()
    link = Link(options, ("state", "command") if options.hears_commands else ("state",))
    trials, session, observer, origin = link.publisher("trial", False), fresh_session(), Observer(), Origin()

    def tell(line):
        print(json.dumps(line), flush=True)

    def obey():
        for seq, line in enumerate(sys.stdin, 1):
            mark = ("Begin", {"number": int(line.split()[1]), "label": "lab"})
            trials.put(wire.encode("trial", wire.header(0, session, seq, time.monotonic_ns()), mark))
        link.inbox.put((0, "end", b""))

    threading.Thread(target=obey, daemon=True).start()
    while True:
        arrived, suffix, data = link.inbox.get()
        if suffix == "end":
            break
        try:
            head, body = wire.decode(suffix, data)
        except wire.Malformed:
            continue
        now = arrived * 1e-9
        if suffix == "state" and origin.narrow(now, head):
            tell({"origin": origin.at, "session": f"{origin.session:016x}"})
        for line in observer.take(now, suffix, head, body, origin.at):
            tell(line)
    link.close()


if __name__ == "__main__":
    main()
