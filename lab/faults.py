"""The fault matrix: what befalls the nodes, what is promised, and how it is brought about and undone."""

import signal
import time
from dataclasses import dataclass, field
from typing import Callable, Optional

STOPS, DRIVES_ON = "stops", "drives on"
OTHERS = ("robot", "arbiter", "predictor", "guest")


def nothing(_lab):
    return time.monotonic()


@dataclass
class Fault:
    """A row of the table."""

    name: str
    promise: str  # in words, for the table
    inject: Callable = nothing
    heal: Callable = nothing
    expects: str = STOPS
    group: str = ""
    hold: tuple = (0.25, 0.7)  # for how long the fault stays, once the robot stands
    prepare: Callable = nothing  # once, before the nodes start: the line's quality, a guest
    extra: dict = field(default_factory=dict)  # settings by node
    clocks: dict = field(default_factory=dict)  # faketime's environment by node
    guest: Optional[list] = None  # what hostile.py does on the guest's host, once the robot moves
    certificate: str = ""  # the nodes have certificates, and the guest one of this kind
    robot_dies: bool = False
    stands_still: bool = False  # nothing may move it before the fault is undone
    because: str = ""  # how the reason of its stop begins, where other stops come as well
    routes: str = "robot-sim"  # whose process everybody dials
    quick: bool = False
    recovers_s: float = 30.0
    settles_s: float = 0.0  # how long it must have moved before the fault comes

    @property
    def spoils(self):
        """Whether a guest says true states with a bit turned, which an observer believes."""
        return bool(self.guest) and "garbage" in self.guest

    @property
    def sees_commands(self):
        """Whether the observer hears commands: certificates let operators hear none, and garbage would drown it."""
        return not self.certificate and not self.spoils


def kill(node):
    return lambda lab: lab.send(node, signal.SIGKILL)


def freeze(node):
    return lambda lab: lab.send(node, signal.SIGSTOP)


def thaw(node):
    return lambda lab: lab.send(node, signal.SIGCONT)


def start(node):
    """Starts a node again, once the one before has ended."""

    def again(lab):
        lab.await_end(node)
        lab.start(node)
        return time.monotonic()

    return again


def end(node):
    return lambda lab: lab.send(node, signal.SIGINT)


def emergency(lab):
    """Somebody who has no part in driving stops the robot; gives the moment at which it said so."""
    asked = time.monotonic()
    lab.ask_as_guest("estop", "--by", "a bystander")
    told = [line["now"] for line in lab.sight.since(asked) if line["why"] == EMERGENCY]
    return max(asked, min(told) - 0.05) if told else asked


def clear(lab):
    """The same one lets it go; gives the moment at which it set about that."""
    asked = time.monotonic()
    lab.ask_as_guest("estop", "--clear", "--by", "a bystander")
    return asked


def cut(host, *others, back=True):
    return lambda lab: lab.network.cut(host, *others, back=back)


def heal(lab):
    return lab.network.heal()


def line(host="operator", **settings):
    """A bad line, to a host and from it."""
    return lambda lab: lab.network.line(host, **settings)


CUT = {"inject": cut("operator", *OTHERS), "heal": heal}
EMERGENCY = "emergency stop by a bystander"
STILL = "as on a good line: a cut stops it, a fresh press moves it"
BY_ITSELF = "the robot stops by itself"
NODES = [
    Fault("operator killed", "stops; moves again by a press of the new one", kill("operator"), start("operator"), quick=True),
    Fault("operator ended (Ctrl-C)", "stops at once", end("operator"), start("operator"), settles_s=0.8),
    Fault("operator frozen (SIGSTOP)", "stops; what was held does not count when it wakes", freeze("operator"), thaw("operator")),
    Fault("arbiter killed", BY_ITSELF, kill("arbiter"), start("arbiter"), quick=True),
    Fault("arbiter ended (Ctrl-C)", "stops at once; a fresh press moves it again", end("arbiter"), start("arbiter")),
    Fault("arbiter frozen", BY_ITSELF, freeze("arbiter"), thaw("arbiter")),
    Fault("predictor killed", "the human alone goes on", kill("predictor"), start("predictor"), DRIVES_ON, quick=True),
    Fault("predictor ended (Ctrl-C)", "the human alone goes on", end("predictor"), start("predictor"), DRIVES_ON, settles_s=0.8),
    Fault("predictor frozen", "the human alone goes on", freeze("predictor"), thaw("predictor"), DRIVES_ON),
    Fault("recorder killed", "nothing changes; each file can be repaired", kill("recorder"), start("recorder"), DRIVES_ON, settles_s=1.2),
    Fault("recorder frozen", "nothing changes", freeze("recorder"), thaw("recorder"), DRIVES_ON),
    Fault("robot frozen", "stops, in its own time; needs a fresh press when it wakes", freeze("robot-sim"), thaw("robot-sim")),
    Fault("robot killed", "a new one needs a fresh press", kill("robot-sim"), start("robot-sim"), robot_dies=True),
    Fault("router killed", BY_ITSELF + "; needs a fresh press", kill("router"), start("router"), routes="router"),
]
HELD = "stops at once; no press moves it until it is cleared, a fresh one then does"
EMERGENCIES = [
    Fault("a bystander's emergency stop", HELD, emergency, clear, because=EMERGENCY, hold=(0.6, 1.2), quick=True),
]
CUTS = [
    Fault("operator's host cut off", "stops; needs a fresh press", **CUT, quick=True),
    Fault("… for three seconds", "stops; nothing queued moves it", **CUT, hold=(2.8, 3.2)),
    Fault("from the operator, one way", "stops", cut("operator", *OTHERS, back=False), heal, quick=True),
    Fault("to the operator, one way", "the operator lets go, blind", cut("robot", "operator", back=False), heal),
    Fault("arbiter's host cut off", BY_ITSELF, cut("arbiter", "robot", "operator", "predictor", "guest"), heal),
    Fault("from the arbiter, one way", BY_ITSELF, cut("arbiter", "robot", back=False), heal),
    Fault("to the arbiter, one way", "stops", cut("robot", "arbiter", back=False), heal),
]
# On good lines nothing can be under way that moves it before the fault is undone.
for fault in NODES + EMERGENCIES + CUTS:
    fault.stands_still = fault.expects == STOPS and not fault.robot_dies
LINES = [
    Fault("50 ± 5 ms each way", STILL, **CUT, prepare=line(delay=0.05, jitter=0.005)),
    Fault("100 ± 10 ms", STILL, **CUT, prepare=line(delay=0.1, jitter=0.01)),
    Fault("200 ± 20 ms", STILL, **CUT, prepare=line(delay=0.2, jitter=0.02)),
    Fault("2 % of frames lost", STILL, **CUT, prepare=line(loss=0.02)),
    Fault("10 % lost", STILL, **CUT, prepare=line(loss=0.1), quick=True),
    Fault("30 % lost", "mostly stands; never moves unasked", **CUT, prepare=line(loss=0.3), recovers_s=90),
    Fault("2 Mbit/s, bulk beside", STILL, **CUT, prepare=line(rate=2e6), guest=["operator", "bulk"]),
    Fault("10 % of frames twice", STILL, **CUT, prepare=line(duplicate=0.1)),
    Fault("10 % overtaken", STILL, **CUT, prepare=line(reorder=0.1)),
    Fault("2 % with a turned bit", STILL, **CUT, prepare=line(corrupt=0.02)),
]
AHEAD, BEHIND = {"FAKETIME": "+1h"}, {"FAKETIME": "-1h"}
CLOCKS = [
    Fault("operator an hour ahead", STILL, **CUT, clocks={"operator": AHEAD}),
    Fault("robot an hour behind", STILL, **CUT, clocks={"robot-sim": BEHIND}),
    Fault("arbiter an hour behind, predictor ahead", STILL, **CUT, clocks={"arbiter": BEHIND, "predictor": AHEAD}),
    Fault("all of them stepping by an hour", STILL, **CUT, clocks="stepping", quick=True),
]
GUESTS = [
    Fault("a flood of garbage on every key", STILL, **CUT, guest=["guest", "garbage"]),
    Fault("everything said again, twice", STILL, **CUT, guest=["guest", "replay"]),
    Fault(
        "motion forged in other runs' names", "refused while the true ones speak", expects=DRIVES_ON, guest=["guest", "forge"], hold=(0.5, 1.0)
    ),
    Fault("two operators press at once", "one drives, the other is refused", expects=DRIVES_ON, guest=["second"], hold=(0.5, 1.0)),
]
FORGER = {**CUT, "guest": ["guest", "forge"]}
SHUT_OUT = "let in nowhere: " + STILL
CONTROL = "nothing: it is heard"
STRANGERS = [
    Fault("all nodes with certificates, no stranger", STILL, **{**FORGER, "guest": None}, certificate="member"),
    Fault("forger without a certificate", SHUT_OUT, **FORGER, certificate="none", quick=True),
    Fault("forger with another site's certificate", SHUT_OUT, **FORGER, certificate="other"),
    Fault("forger with an expired certificate", SHUT_OUT, **FORGER, certificate="late"),
    Fault("forger with a viewer's certificate", "hears, and may say nothing: " + STILL, **FORGER, certificate="viewer"),
    # Nothing is promised: it shows that a forger who is let in does reach the robot, so that the rows above show something.
    Fault("forger with the arbiter's own certificate", CONTROL, **FORGER, certificate="arbiter"),
]
MATRIX = {
    "Nodes": NODES,
    "Emergency stop": EMERGENCIES,
    "Cuts": CUTS,
    "Bad lines, to the operator and back": LINES,
    "Wall clocks": CLOCKS,
    "Guests": GUESTS,
    "Certificates, and a stranger who forges setpoints": STRANGERS,
}
for title, faults in MATRIX.items():
    for fault in faults:
        fault.group = title
