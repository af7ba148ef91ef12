"""A Zenoh session as Tandem's nodes use it: who listens routes, streams go out with a priority of their own.

Needs the package `eclipse-zenoh` 1.10 (`pip install eclipse-zenoh==1.10.2`).
"""

import json
import queue
import secrets
import time

import zenoh

import tandem_wire as wire

LOOP = ("operator", "predictor", "arbiter", "robot-sim")


def fresh_session():
    """A number that no other run has, as far as chance goes."""
    return secrets.randbits(64)


def arguments(parser):
    """The flags of every node."""
    parser.add_argument("--robot", default="panda", help="the robot's name, as it stands in the keys [panda]")
    parser.add_argument("--connect", action="append", default=[], metavar="ENDPOINT", help="whom to connect to")
    parser.add_argument("--config", metavar="FILE", help="Zenoh's configuration, as `tandem keys config` prints it")
    parser.add_argument("--listen", action="append", default=[], metavar="ENDPOINT", help="where to listen, and route")


def open_session(options):
    """Opens the session that the flags ask for."""
    if options.config:
        with open(options.config, encoding="utf-8") as file:
            return zenoh.open(zenoh.Config.from_json5(file.read()))
    config = zenoh.Config()
    connect = options.connect or ([] if options.listen else ["tcp/127.0.0.1:7447"])
    for name, value in (
        ("mode", "router" if options.listen else "client"),
        ("listen/endpoints", options.listen),
        ("connect/endpoints", connect),
        ("connect/timeout_ms", -1),
        ("connect/exit_on_failure", False),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
    ):
        config.insert_json5(name, json.dumps(value))
    return zenoh.open(config)


class Link:
    """What a node hears and says about one robot. What arrives waits in `inbox` as (arrival, suffix, bytes)."""

    def __init__(self, options, listens_to, lockstep=False):
        self.session, self.robot, self.lockstep = open_session(options), options.robot, lockstep
        self.inbox, self.declared = queue.Queue(), []
        for suffix in listens_to:
            subscriber = self.session.declare_subscriber(wire.key(self.robot, suffix), self._taker(suffix))
            self.declared.append(subscriber)

    def _taker(self, suffix):
        def take(sample):
            self.inbox.put((time.monotonic_ns(), suffix, sample.payload.to_bytes()))

        return take

    def publisher(self, suffix, stream):
        """A publisher: a stream has a priority of its own and drops; in lockstep everything blocks."""
        real = stream and not self.lockstep
        publisher = self.session.declare_publisher(
            wire.key(self.robot, suffix),
            priority=zenoh.Priority.REAL_TIME if real else zenoh.Priority.DATA_HIGH,
            congestion_control=zenoh.CongestionControl.DROP if real else zenoh.CongestionControl.BLOCK,
            express=True,
        )
        self.declared.append(publisher)
        return publisher

    def answer_info(self, node, info):
        """Answers whoever asks who this node is."""
        name = wire.key(self.robot, f"node/{node}")
        data = wire.encode("info", wire.header(0, info["session"], 1, time.monotonic_ns()), info)
        self.declared.append(self.session.declare_queryable(name, lambda query: query.reply(name, data)))

    def appear(self, node):
        """Shows that this node is there. The last thing to declare: who sees it can reach the subscribers."""
        self.declared.append(self.session.liveliness().declare_token(wire.key(self.robot, f"alive/{node}")))

    def await_peers(self, names):
        """Waits until these nodes are there: nothing may be published in lockstep before."""
        there, missing = queue.Queue(), set(names)

        def look(sample):
            if sample.kind == zenoh.SampleKind.PUT:
                there.put(str(sample.key_expr).split("/")[-1])

        watched = wire.key(self.robot, "alive/*")
        watching = self.session.liveliness().declare_subscriber(watched, look, history=True)
        while missing:
            missing.discard(there.get())
        watching.undeclare()

    def next(self, limit_s):
        """What has arrived next, or None after so long."""
        try:
            return self.inbox.get(timeout=max(0.0, limit_s))
        except queue.Empty:
            return None

    def close(self):
        self.session.close()
