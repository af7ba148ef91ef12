#!/usr/bin/env python3
"""A peer that nobody invited: garbage, replays, forgeries, or bulk traffic, for as long as it lives.

    hostile.py garbage|replay|forge|bulk|sink [--connect ENDPOINT] [--robot NAME]

`garbage` puts broken messages on every key as fast as Python can; `replay` says every command, setpoint and state again,
twice, a third of a second later; `forge` says permitted setpoints and commands in runs of its own, with true echoes, 200
times a second; `bulk` puts as much as the line takes, at bulk's priority, and `sink` takes it in.
"""

import argparse
import os
import random
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples" / "python"))
import tandem_wire as wire  # noqa: E402
import zenoh  # noqa: E402
from tandem_link import Link, arguments, fresh_session  # noqa: E402

KEYS = ("command", "proposal", "setpoint", "state", "trial", "lease", "scene", "forecast")


def garbage(link, out):
    """Nothing, noise, headers with noise behind, true messages with bits turned."""
    draw, seen = random.Random(1), {}
    while True:
        while (item := link.next(0.0)) is not None:
            seen[item[1]] = item[2]
        for suffix in KEYS:
            kind = wire.MESSAGES[suffix][0]
            frame = wire.HEADER.pack(wire.VERSION, kind, 0, draw.getrandbits(32), draw.getrandbits(64), draw.getrandbits(64), 0)
            spoiled = bytearray(seen.get(suffix, frame))
            spoiled[draw.randrange(len(spoiled))] ^= 1 << draw.randrange(8)
            if suffix == "trial":
                spoiled[0] = 0  # a true trial's mark with another number in it would be a trial
            for data in (b"", os.urandom(200), frame + os.urandom(draw.randrange(700)), os.urandom(20_000), bytes(spoiled)):
                out[suffix].put(data)
        time.sleep(0.001)


def replay(link, out):
    """What was said is said again, twice."""
    waiting, told = [], set()
    while True:
        item = link.next(0.005)
        if item and item[2] not in told:
            told.add(item[2])
            waiting.append((time.monotonic() + 0.3, item[1], item[2]))
        if len(told) > 5000:
            told.clear()
        while waiting and waiting[0][0] <= time.monotonic():
            _, suffix, data = waiting.pop(0)
            out[suffix].put(data)
            out[suffix].put(data)


def forge(link, out):
    """Motion that nobody asked for, made with care: true echoes, the lease as it is, numbers from 1."""
    session, seq, setpoint, seen, tick = fresh_session(), 0, None, None, 0
    while True:
        while (item := link.next(0.0)) is not None:
            head, body = wire.decode(item[1], item[2])
            if item[1] == "setpoint" and head["session"] != session:
                setpoint = body
            elif item[1] == "state":
                seen, tick = wire.identity(head), head["tick"]
        if setpoint and seen:
            seq += 1
            motion, velocity = ("Permitted", {"press": seq // 20 + 1}), (0.3, 0.3, 0.3)
            used = setpoint["command"] and {**setpoint["command"], "seen": seen}
            forged = {**setpoint, "motion": motion, "velocity": velocity, "seen": seen, "command": used}
            command = {"velocity": velocity, "deadman": ("Held", {"press": seq // 20 + 1}), "seen": seen}
            head = wire.header(tick, session, seq, time.monotonic_ns())
            out["setpoint"].put(wire.encode("setpoint", head, forged))
            out["command"].put(wire.encode("command", head, command))
        time.sleep(0.005)


def bulk(link, _out):
    """As much as the line takes."""
    name = wire.key(link.robot, "journal/bulk")
    publisher = link.session.declare_publisher(
        name, priority=zenoh.Priority.DATA_LOW, congestion_control=zenoh.CongestionControl.BLOCK
    )
    while True:
        publisher.put(bytes(1 << 18))


def sink(link, _out):
    """Takes in what `bulk` sends."""
    while True:
        link.next(1.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    doings = {"garbage": garbage, "replay": replay, "forge": forge, "bulk": bulk, "sink": sink}
    parser.add_argument("what", choices=doings)
    arguments(parser)
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    heard = {"garbage": KEYS, "replay": ("command", "setpoint", "state"), "forge": ("setpoint", "state"), "bulk": (), "sink": ("journal/bulk",)}
    link = Link(options, heard[options.what])
    out = {suffix: link.publisher(suffix, suffix in ("command", "setpoint", "state", "proposal")) for suffix in KEYS}
    try:
        doings[options.what](link, out)
    except KeyboardInterrupt:
        os._exit(0)  # whatever is still queued need not arrive


if __name__ == "__main__":
    main()
