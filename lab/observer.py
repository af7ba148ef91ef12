#!/usr/bin/env python3
"""Stands on the robot's host and watches: one line of JSON on the output for whatever whoever drives the lab must know.

On its input: `begin N` begins trial N. Every line carries `now`, this machine's monotonic clock in seconds, and the robot's
clock beside it where a state brought it. Motion that begins by a press which had let the robot move before is told as `stale`.
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

MOVING_M_S = 0.03


class Observer:
    """What has been seen. Pure: arrivals in, lines out."""

    def __init__(self):
        self.used, self.said, self.newest = set(), None, (None, 0)

    def state(self, now, head, body):
        """A line for each state that differs from the one before in what matters. What somebody says again is no news."""
        if head["session"] == self.newest[0] and head["seq"] <= self.newest[1]:
            return None
        self.newest = (head["session"], head["seq"])
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


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    arguments(parser)
    link, observer = Link(parser.parse_args(), ("state",)), Observer()
    trials, session, offset = link.publisher("trial", False), fresh_session(), None

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
        line = observer.state(now, head, body)
        # The least difference there was: the stamp of this machine's clock at which the robot's clock began.
        origin = (head["session"], now - head["sent"] * 1e-9)
        if offset is None or offset[0] != origin[0] or origin[1] < offset[1] - 1e-4:
            offset = origin
            print(json.dumps({"origin": origin[1], "session": f"{origin[0]:016x}"}), flush=True)
        if line:
            print(json.dumps(line), flush=True)
    link.close()


if __name__ == "__main__":
    main()
