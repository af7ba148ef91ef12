"""Tandem's wire layout 3 in plain Python: keys, and every message as bytes and back.

Nothing but the standard library. `docs/wire.md` tells the same in words; `checks/wire.py` holds both, and the bytes that
Tandem's own tests are pinned to, together.

    header, command = decode("command", data)
    data = encode("command", header, {"velocity": (0.1, 0.0, 0.0), "deadman": "Released", "seen": None})

How values look: a struct is a dict; a vector a tuple of three numbers; an option None or the value; a list of bytes
`bytes`; an enum is the variant's name, or (name, value) where the variant carries something.
"""

import math
import struct

VERSION = 4
HEADER = struct.Struct("<BBHIQQQ")
ROOT = "tandem"


class Malformed(Exception):
    """Bytes that are no message, and why."""


class Reader:
    """Takes a body apart; nothing in it makes it reserve more than there is."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        if count > len(self.data) - self.at:
            raise Malformed("truncated")
        self.at += count
        return self.data[self.at - count : self.at]


class Int:
    """An integer of fixed width, little-endian."""

    def __init__(self, name, width, signed=False):
        self.name, self.width, self.signed = name, width, signed

    def read(self, reader):
        return int.from_bytes(reader.take(self.width), "little", signed=self.signed)

    def write(self, value, out):
        out += value.to_bytes(self.width, "little", signed=self.signed)


class Float:
    """A double, little-endian. NaN and infinity are refused when read."""

    name = "f64"

    def read(self, reader):
        (value,) = struct.unpack("<d", reader.take(8))
        if not math.isfinite(value):
            raise Malformed("not a finite number")
        return value

    def write(self, value, out):
        out += struct.pack("<d", value)


class Bool:
    """One byte, 0 or 1."""

    name = "bool"

    def read(self, reader):
        byte = reader.take(1)[0]
        if byte > 1:
            raise Malformed("a body that does not follow the layout")
        return byte == 1

    def write(self, value, out):
        out.append(int(value))


class Text:
    """Length in bytes as u64, then UTF-8."""

    name = "text"

    def read(self, reader):
        try:
            return bytes(reader.take(U64.read(reader))).decode("utf-8")
        except UnicodeDecodeError as error:
            raise Malformed("a body that does not follow the layout") from error

    def write(self, value, out):
        data = value.encode("utf-8")
        U64.write(len(data), out)
        out += data


class Bytes:
    """So many bytes; without a width their number stands in front as u64."""

    def __init__(self, width=None):
        self.width, self.name = width, f"{width} bytes" if width else "bytes"

    def read(self, reader):
        return bytes(reader.take(self.width or U64.read(reader)))

    def write(self, value, out):
        if self.width is None:
            U64.write(len(value), out)
        elif len(value) != self.width:
            raise ValueError(f"{self.width} bytes are needed, not {len(value)}")
        out += value


class Label:
    """A short name: 24 bytes of UTF-8, zeros behind. Read for people, whatever the bytes are."""

    name, width = "Label", 24

    def read(self, reader):
        text = bytes(reader.take(self.width)).split(b"\0")[0].decode("utf-8", "replace")
        return "".join("\ufffd" if ord(letter) < 32 or 127 <= ord(letter) < 160 else letter for letter in text)

    def write(self, value, out):
        data = value.encode("utf-8")[: self.width]
        data = data.decode("utf-8", "ignore").encode("utf-8")
        out += data.ljust(self.width, b"\0")


class Option:
    """One byte, 0 or 1; after 1 the value."""

    def __init__(self, inner):
        self.inner, self.name = inner, f"option of {inner.name}"

    def read(self, reader):
        return self.inner.read(reader) if BOOL.read(reader) else None

    def write(self, value, out):
        out.append(int(value is not None))
        if value is not None:
            self.inner.write(value, out)


class Many:
    """The number of elements as u64, then these; or, with a count, just so many of them."""

    def __init__(self, inner, count=None):
        self.inner, self.count = inner, count
        self.name = f"{count} × {inner.name}" if count else f"list of {inner.name}"

    def read(self, reader):
        count = self.count or U64.read(reader)
        # No element is empty, so a claim of more than there are bytes is false.
        if count > len(reader.data) - reader.at:
            raise Malformed("truncated")
        return [self.inner.read(reader) for _ in range(count)]

    def write(self, value, out):
        if self.count is None:
            U64.write(len(value), out)
        elif len(value) != self.count:
            raise ValueError(f"{self.count} elements are needed, not {len(value)}")
        for element in value:
            self.inner.write(element, out)


class Vec3:
    """Three doubles."""

    name = "Vec3"

    def read(self, reader):
        return (F64.read(reader), F64.read(reader), F64.read(reader))

    def write(self, value, out):
        out += struct.pack("<3d", *value)


class Struct:
    """The fields one after the other, nothing in between."""

    def __init__(self, struct_name, **fields):
        self.name, self.fields = struct_name, fields

    def read(self, reader):
        return {name: kind.read(reader) for name, kind in self.fields.items()}

    def write(self, value, out):
        for name, kind in self.fields.items():
            kind.write(value[name], out)


class Enum:
    """The variant's number as u32, from 0 in the order given; then what it carries. None: nothing."""

    def __init__(self, enum_name, **variants):
        self.name, self.variants = enum_name, variants
        self.names = list(variants)

    def read(self, reader):
        number = U32.read(reader)
        if number >= len(self.names):
            raise Malformed("a body that does not follow the layout")
        name = self.names[number]
        inner = self.variants[name]
        return name if inner is None else (name, inner.read(reader))

    def write(self, value, out):
        name, inner = value if isinstance(value, tuple) else (value, None)
        U32.write(self.names.index(name), out)
        if self.variants[name] is not None:
            self.variants[name].write(inner, out)


def units(enum_name, *names):
    """An enum whose variants carry nothing."""
    return Enum(enum_name, **{name: None for name in names})


U8, U32, U64, I64 = Int("u8", 1), Int("u32", 4), Int("u64", 8), Int("i64", 8, signed=True)
F64, BOOL, TEXT, VEC3, LABEL = Float(), Bool(), Text(), Vec3(), Label()
NANOS = Int("ns", 8)  # a duration, or an instant of the sender's monotonic clock, in nanoseconds

MESSAGE_ID = Struct("MessageId", session=U64, seq=U64)
SEEN = Option(MESSAGE_ID)
POSE = Struct("Pose", position=VEC3, orientation=Many(F64, 4))
AABB = Struct("Aabb", min=VEC3, max=VEC3)
DEADMAN = Enum("Deadman", Released=None, Held=Struct("Held", press=U32))
LEASE = Struct("Lease", number=U32, holder=U64, name=LABEL)
SILENT = Struct("Silent", silent=NANOS)
REASON = Enum(
    "Reason",
    NoCommandYet=None,
    NoSetpointYet=None,
    CommandLost=SILENT,
    SetpointLost=SILENT,
    StateLost=SILENT,
    DeadmanReleased=None,
    AwaitingPress=None,
    LoopTooOld=None,
    TrialOver=None,
    NoTrial=None,
    ShuttingDown=None,
    SecondOperator=None,
    NoLease=None,
    EmergencyStop=Struct("EmergencyStop", stop=MESSAGE_ID, by=LABEL),
    SetpointsMissed=Struct("SetpointsMissed", in_a_row=U32),
)
MOTION = Enum("Motion", Permitted=Struct("Permitted", press=U32), Held=REASON)
REFUSAL = units(
    "Refusal",
    "Unreadable",
    "Duplicate",
    "OutOfOrder",
    "ForeignSession",
    "LoopTooOld",
    "TooFarAhead",
    "SecondOperator",
    "NotSupervisor",
    "NoSeat",
)
REFUSALS = Struct("Refusals", count=U64, last=Option(REFUSAL))
LAW = Enum("Law", Adaptive=None, Fixed=None, Human=None, Robot=None, Constant=F64, Attentive=None)
LIMITED = Struct("Limited", workspace=BOOL, speed=BOOL, acceleration=BOOL)
USED = Struct("Used", id=MESSAGE_ID, sent=NANOS, age=NANOS, seen=SEEN)
GUIDANCE = Struct(
    "Guidance",
    forecast=U32,
    phase=F64,
    last_step=U32,
    velocity=VEC3,
    position=VEC3,
    half_width=VEC3,
    ratio=F64,
    ratio_high=F64,
)
FORECAST_POINT = Struct("ForecastPoint", position=VEC3, half_width=VEC3, ratio=F64)
CLEARANCE = Struct("Clearance", distance=F64, body=U8, obstacle=U8)
CYLINDER = Struct("Cylinder", foot=VEC3, radius=F64, height=F64)
BODY = Struct("Body", **{"frame": U8, "from": VEC3, "to": VEC3, "radius": F64})

COMMAND = Struct("Command", velocity=VEC3, deadman=DEADMAN, seen=SEEN)
PROPOSAL = Struct("Proposal", seen=SEEN, guidance=Option(GUIDANCE))
FORECAST = Struct(
    "Forecast",
    number=U32,
    context=Many(F64),
    model=Bytes(32),
    first_step=U32,
    period=NANOS,
    points=Many(FORECAST_POINT),
)
SETPOINT = Struct(
    "Setpoint",
    velocity=VEC3,
    motion=MOTION,
    lease=Option(LEASE),
    asks=Option(LABEL),
    law=LAW,
    weight=F64,
    human=VEC3,
    guidance=Option(GUIDANCE),
    blended=VEC3,
    limited=LIMITED,
    command=Option(USED),
    proposal=Option(USED),
    seen=SEEN,
    refused=REFUSALS,
)
OBEYED = Struct("Obeyed", id=MESSAGE_ID, arrived=NANOS, moved=NANOS, setpoint=SETPOINT)
ARRIVALS = Struct("Arrivals", success_rate=F64, missed=U32, longest=U32)
STATE = Struct(
    "State",
    trial=U32,
    trial_start=U32,
    joints=Many(F64, 7),
    joint_velocities=Many(F64, 7),
    links=Many(POSE, 8),
    tool=POSE,
    tool_velocity=VEC3,
    clearance=Option(CLEARANCE),
    closest=Option(CLEARANCE),
    motion=MOTION,
    at_rest=BOOL,
    obeys=Option(OBEYED),
    arrivals=Option(ARRIVALS),
    refused=REFUSALS,
)
SCENE = Struct(
    "Scene",
    obstacles=Many(CYLINDER),
    bodies=Many(BODY),
    start=VEC3,
    goal=VEC3,
    goal_tolerance=F64,
    workspace=AABB,
    period=NANOS,
)
TRIAL = Enum(
    "Trial",
    Begin=Struct("Begin", number=U32, label=TEXT),
    End=Struct("End", number=U32, outcome=TEXT),
)
CLAIM = Struct("Claim", wish=units("Wish", "Drive", "Release", "TakeOver"), name=LABEL)
EMERGENCY = Enum(
    "Emergency",
    Stop=Struct("Stop", by=LABEL),
    Clear=Struct("Clear", stop=MESSAGE_ID, by=LABEL),
)
NODE = units("NodeName", "Operator", "Predictor", "Arbiter", "RobotSim", "Recorder")
TOPIC = Enum(
    "Topic",
    Command=None,
    Proposal=None,
    Forecast=None,
    Setpoint=None,
    State=None,
    Scene=None,
    Trial=None,
    Journal=NODE,
    Info=NODE,
    Alive=NODE,
    Device=None,
    Lease=None,
    Emergency=None,
    Storage=None,
    Clock=NODE,
    Ping=NODE,
    TakeOver=None,
    AllClear=None,
)
BYTES = Bytes()
TOPIC_BYTES = Struct("TopicBytes", topic=TOPIC, bytes=BYTES)
HAPPENING = Enum(
    "Happening",
    Sample=TOPIC_BYTES,
    Wake=None,
    Presence=Struct("Presence", peer=NODE, alive=BOOL),
    Stop=None,
    Output=TOPIC_BYTES,
    Snapshot=Struct("Snapshot", bytes=BYTES),
    Missed=Struct("Missed", topic=TOPIC, tick=U32),
)
JOURNAL_ENTRY = Struct("JournalEntry", at=NANOS, wall=NANOS, what=HAPPENING)
JOURNAL = Struct("JournalBatch", first=U64, lost=U64, entries=Many(JOURNAL_ENTRY))
INFO = Struct("NodeInfo", session=U64, config=TEXT, seed=U64, build=TEXT, model=BYTES)
STORAGE = Struct("Storage", condition=units("Condition", "Kept", "Behind", "NoSpace", "Failing"), dropped=U64)
PEER_CLOCK = Struct(
    "PeerClock",
    node=NODE,
    session=U64,
    offset=I64,
    uncertainty=NANOS,
    round_trip=NANOS,
    round_trip_median=NANOS,
    round_trip_worst=NANOS,
    samples=U32,
    steps=U32,
    skew=I64,
    is_skewed=BOOL,
)
CLOCK = Struct("ClockReport", peers=Many(PEER_CLOCK))
PONG = Struct("Pong", heard=NANOS, unix_nanos=U64)

# What a message is called: its kind, the longest that an honest sender makes it (header included), its body.
MESSAGES = {
    "command": (1, 128, COMMAND),
    "proposal": (2, 512, PROPOSAL),
    "forecast": (3, 1 << 20, FORECAST),
    "setpoint": (4, 1024, SETPOINT),
    "state": (5, 4096, STATE),
    "scene": (6, 1 << 16, SCENE),
    "trial": (7, 1 << 12, TRIAL),
    "journal": (8, 1 << 22, JOURNAL),
    "info": (9, 1 << 24, INFO),
    "storage": (11, 64, STORAGE),
    "lease": (12, 128, CLAIM),
    "estop": (13, 128, EMERGENCY),
    "clock": (14, 4096, CLOCK),
    "ping": (15, 64, PONG),
}


def key(robot, suffix):
    """The key of a topic: `tandem/<robot>/<suffix>`."""
    return f"{ROOT}/{robot}/{suffix}"


def header(tick, session, seq, sent):
    """What stands in front of a message; `sent` in nanoseconds of the sender's monotonic clock."""
    return {"tick": tick, "session": session, "seq": seq, "sent": sent}


def identity(head):
    """A message's exact name."""
    return {"session": head["session"], "seq": head["seq"]}


def encode(name, head, body):
    """A message's bytes."""
    kind, _, layout = MESSAGES[name]
    out = bytearray(HEADER.pack(VERSION, kind, 0, head["tick"], head["session"], head["seq"], head["sent"]))
    layout.write(body, out)
    return bytes(out)


def decode(name, data):
    """Header and body of a message; `Malformed` for anything that an honest sender would not send."""
    kind, longest, layout = MESSAGES[name]
    if len(data) > longest:
        raise Malformed(f"{len(data)} bytes are too many for this kind of message")
    if len(data) < HEADER.size:
        raise Malformed(f"truncated after {len(data)} bytes")
    version, found, zero, tick, session, seq, sent = HEADER.unpack_from(data)
    if version != VERSION:
        raise Malformed(f"layout version {version}, this is version {VERSION}")
    if zero != 0:
        raise Malformed("a body that does not follow the layout")
    if found != kind:
        raise Malformed(f"message of kind {found} under the key of kind {kind}")
    reader = Reader(data[HEADER.size :])
    body = layout.read(reader)
    if reader.at != len(reader.data):
        raise Malformed(f"{len(reader.data) - reader.at} bytes too many behind the body")
    return header(tick, session, seq, sent), body


def decode_at(suffix, data):
    """The same by the key's end. A take-over and an emergency stop's end have force under keys of their own only."""
    name = {"lease/take-over": "lease", "estop/clear": "estop"}.get(suffix, suffix)
    head, body = decode(name, data)
    force = {"lease": lambda: body["wish"] == "TakeOver", "estop": lambda: body[0] == "Clear"}.get(name)
    if force and force() != (suffix != name):
        raise Malformed("a word that has no force under this key")
    return head, body


def seconds(nanos):
    """Nanoseconds as seconds."""
    return nanos * 1e-9


REASONS = {
    "NoCommandYet": "no command has arrived yet",
    "NoSetpointYet": "no setpoint has arrived yet",
    "CommandLost": "the operator's commands stopped {ms:.0f} ms ago",
    "SetpointLost": "the arbiter's setpoints stopped {ms:.0f} ms ago",
    "StateLost": "the robot's state stopped {ms:.0f} ms ago",
    "DeadmanReleased": "the deadman is released",
    "AwaitingPress": "waiting for a fresh press of the deadman",
    "LoopTooOld": "commands answer a state that is too old",
    "TrialOver": "the trial is over",
    "NoTrial": "no trial is running",
    "ShuttingDown": "the node is shutting down",
    "SecondOperator": "another operator holds the lease",
    "NoLease": "nobody holds the lease",
    "EmergencyStop": "emergency stop by {by}",
    "SetpointsMissed": "{in_a_row} setpoints in a row were missed",
}


def in_words(motion):
    """Whether the robot may move, and if not, why."""
    name, what = motion
    if name == "Permitted":
        return f"moving, by press {what['press']}"
    reason, details = what if isinstance(what, tuple) else (what, {})
    ms, by = details.get("silent", 0) * 1e-6, details.get("by") or "nobody named"
    return REASONS[reason].format(ms=ms, by=by, in_a_row=details.get("in_a_row"))
