#!/usr/bin/env python3
"""Reads a recorded demo with software that Tandem's authors did not write, and compares what it finds.

    pip install -r checks/requirements.txt
    tandem demo --pace max --json --record demo.mcap > demo.json
    tandem session info demo.mcap --json > info.json
    python checks/read_session.py demo.mcap info.json demo.json

The file is read by the `mcap` package with every checksum on. Channels in Foxglove's schemas are decoded by the
classes that Foxglove publishes, not by the schemas in the file: whoever knows only the standard must be able to read
them. Our own channels are decoded by the schemas in the file. Exit code 0 if all of it agrees, 1 if something differs.
"""

import hashlib
import json
import math
import sys
from collections import Counter, defaultdict
from importlib import import_module

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

failures = []


def check(name, holds, detail=""):
    print(f"  {'ok  ' if holds else 'FAIL'} {name}{'' if holds else ': ' + str(detail)}")
    if not holds:
        failures.append(name)


def close(a, b, tolerance=1e-12):
    return a is not None and b is not None and abs(a - b) <= tolerance


def xyz(v):
    return (v.x, v.y, v.z)


def distance(a, b):
    return math.dist(xyz(a), xyz(b))


def norm(v):
    return math.hypot(*xyz(v))


def standard(name):
    """Foxglove's own class for a schema's name."""
    short = name.removeprefix("foxglove.")
    return getattr(import_module(f"foxglove_schemas_protobuf.{short}_pb2"), short)


class Session:
    def __init__(self, path):
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            self.robot = next(iter(summary.channels.values())).topic.split("/")[1]
            self.counted = summary.statistics.channel_message_counts
            self.topics = {channel.id: channel.topic for channel in summary.channels.values()}
            self.schemas = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
            self.metadata = {record.name: record.metadata for record in reader.iter_metadata()}
            self.attachments = list(reader.iter_attachments())
            self.messages = defaultdict(list)
            self.times = defaultdict(list)
            decoder = DecoderFactory()
            for schema, channel, message in reader.iter_messages():
                self.times[channel.topic].append(message.log_time)
                if schema.name.startswith("foxglove."):
                    decoded = standard(schema.name).FromString(message.data)
                elif channel.message_encoding == "protobuf":
                    decoded = decoder.decoder_for(channel.message_encoding, schema)(message.data)
                else:
                    decoded = message.data
                self.messages[channel.topic].append(decoded)

    def __getitem__(self, name):
        return self.messages[f"tandem/{self.robot}/{name}"]


def counts(session, info):
    read = {topic: len(messages) for topic, messages in session.messages.items()}
    said = {channel["topic"]: channel["messages"] for channel in info["channels"]}
    indexed = {session.topics[number]: count for number, count in session.counted.items() if count}
    check("as many messages on every channel as `tandem session info` says", read == said, (read, said))
    check("as many as the file's own index says", read == indexed, (read, indexed))
    closing = session.metadata["tandem.counts"]
    for name in ["state", "command", "proposal", "setpoint"]:
        received = int(closing[f"{name}.received"])
        check(f"as many messages on {name} as the recorder received", len(session[name]) == received, received)
    check("the robot's name", session.robot == info["robot"], session.robot)
    check("the file says it lost nothing", closing["dropped.session_file"] == "0", closing)
    ordered = all(times == sorted(times) for times in session.times.values())
    check("every channel is in the order of its times", ordered)


def model(session, info):
    hashes = {hashlib.sha256(attachment.data).hexdigest() for attachment in session.attachments}
    recorded = session.metadata["tandem.node.predictor"]["model_sha256"]
    check("the attached model has the recorded hash", {recorded} == hashes, (recorded, hashes))
    check("and `tandem session info` says the same", info["model_sha256"] == recorded)
    forecasts = session["forecast"]
    check("and so does every forecast", forecasts and all(f.model_sha256 == recorded for f in forecasts))


STANDARD = {
    "frames": "foxglove.FrameTransforms",
    "tool_pose": "foxglove.PoseInFrame",
    "forecast_path": "foxglove.PosesInFrame",
    "shapes": "foxglove.SceneUpdate",
    "log": "foxglove.Log",
    "arm_points": "foxglove.PointCloud",
}
FRAMES = [f"link{n}" for n in range(1, 8)] + ["flange", "tool"]


def poses(session):
    """What tools draw by themselves says the same as our own record."""
    for name, schema in STANDARD.items():
        found = session.schemas.get(f"tandem/{session.robot}/{name}")
        check(f"{name} is a {schema}", found == schema, found)
    states, frames, tools = session["state"], session["frames"], session["tool_pose"]
    check("one set of frames and one tool pose for every state", len(states) == len(frames) == len(tools))
    named = all([t.child_frame_id for t in f.transforms] == FRAMES for f in frames)
    check("the frames are named", named)
    based = all(t.parent_frame_id == "base" for f in frames for t in f.transforms)
    check("and hang on the base", based)
    same = all(
        xyz(t.translation) == xyz(pose.position) and t.rotation.w == pose.orientation.w
        for state, f in zip(states, frames)
        for t, pose in zip(f.transforms, [*state.links, state.tool])
    )
    check("every frame is where the state says", same)
    check("so is the tool", all(xyz(s.tool.position) == xyz(t.pose.position) for s, t in zip(states, tools)))
    rotations = [t.rotation for f in frames for t in f.transforms]
    units = all(close(math.hypot(q.x, q.y, q.z, q.w), 1.0, 1e-9) for q in rotations)
    check("every rotation has length one", units)
    moved = max(distance(a.tool.position, b.tool.position) for a, b in zip(states, states[1:]))
    check("the tool moved, and never jumped", 0.001 < moved < 0.1, moved)


def scene(session):
    recorded = session["scene"][0]
    entities = {entity.id: entity for entity in session["shapes"][0].entities}
    cylinders = entities["obstacles"].cylinders
    check("a cylinder for every obstacle", len(cylinders) == len(recorded.obstacles) > 0, len(cylinders))
    match = all(
        close(c.pose.position.x, o.foot_m.x)
        and close(c.pose.position.y, o.foot_m.y)
        and close(c.pose.position.z, o.foot_m.z + o.height_m / 2)
        and close(c.size.x, 2 * o.radius_m)
        and close(c.size.z, o.height_m)
        for c, o in zip(cylinders, recorded.obstacles)
    )
    check("where and as large as the scene says", match)
    goal = entities["goal"].spheres[0].pose.position
    check("the goal is where the scene says", distance(goal, recorded.goal_m) == 0.0)


def forecast(session):
    for said, path in zip(session["forecast"], session["forecast_path"], strict=True):
        same = [xyz(p.position_m) for p in said.points] == [xyz(p.position) for p in path.poses]
        check(f"forecast {said.number}: its {len(said.points)} points are the path's poses", same)
        check("its interval has a width everywhere", all(norm(p.half_width_m) > 0 for p in said.points))


def arbitration(session):
    """The record of every tick explains the velocity that was commanded."""
    setpoints = session["setpoint"]
    worst = 0.0
    for setpoint in setpoints:
        omega, human = setpoint.human_weight, xyz(setpoint.human_velocity_m_s)
        guided = setpoint.HasField("guidance")
        robot = xyz(setpoint.guidance.velocity_m_s) if guided else (0.0, 0.0, 0.0)
        expected = [omega * h + (1 - omega) * r for h, r in zip(human, robot)]
        if setpoint.motion.permitted:
            worst = max(worst, math.dist(expected, xyz(setpoint.blended_velocity_m_s)))
    check("blended = ω·human + (1 − ω)·robot at every tick", worst < 1e-12, worst)
    held = [s for s in setpoints if not s.motion.permitted]
    check("whoever is held has a reason", held and all(s.motion.held_because for s in held))
    check("and is told to stand", all(norm(s.velocity_m_s) == 0.0 for s in held))
    laws = Counter(int(s.law) for s in setpoints)
    check("one law throughout", len(laws) == 1, laws)


def figures(session, demo):
    """The demo's own figures, computed again from the file alone."""
    running = [s for s in session["state"] if s.trial == 1]
    clearances = [s.closest_since_last.distance_m for s in running if s.HasField("closest_since_last")]
    check("smallest clearance", close(min(clearances), demo["min_clearance_m"]), min(clearances))
    goal = session["scene"][0].goal_m
    permitted = [s for s in session["setpoint"] if s.motion.permitted]
    # In lockstep the state of tick k is what setpoint k − 1 led to, and the figures end with the last permitted tick.
    ticks = {s.header.tick: s for s in session["state"]}
    reached = [distance(state.tool.position, goal) for state in ticks.values()]
    found = min(reached, key=lambda d: abs(d - demo["goal_distance_m"]))
    check("distance to the goal at the end", close(found, demo["goal_distance_m"]), found)
    check("it was reached", demo["reached_goal"] and demo["goal_distance_m"] <= session["scene"][0].goal_tolerance_m)
    last = {s.header.tick: s for s in permitted}
    after = [s for s in last.values() if s.HasField("guidance")]
    weight = sum(s.human_weight for s in after) / len(after)
    check("mean ω after the checkpoint", close(weight, demo["weight_mean_after"], 1e-9), weight)
    effort = sum(norm(s.human_velocity_m_s) for s in after) / len(after)
    check("human effort after it", close(effort, demo["human_effort_mean_m_s"], 1e-9), effort)
    check("and nothing was lost", demo["messages_lost"] == 0)


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    with open(sys.argv[2], encoding="utf-8") as file:
        info = json.load(file)
    with open(sys.argv[3], encoding="utf-8") as file:
        demo = json.load(file)
    print(f"{sys.argv[1]}, read by Python's mcap and Foxglove's published schemas:")
    session = Session(sys.argv[1])
    counts(session, info)
    model(session, info)
    poses(session)
    scene(session)
    forecast(session)
    arbitration(session)
    figures(session, demo)
    if failures:
        sys.exit(f"{len(failures)} checks failed")
    print("all of it agrees")


if __name__ == "__main__":
    main()
