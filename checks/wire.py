#!/usr/bin/env python3
"""Holds four descriptions of the wire together: the bytes that Tandem's own tests are pinned to, the Python codec of
examples/python, the tables of docs/wire.md, and what the Rust sources say of kinds and lengths.

    python3 checks/wire.py

Plain Python, nothing to install. Exit code 0 if all agree, 1 if something differs.
"""

import re
import struct
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "examples" / "python"))
sys.dont_write_bytecode = True

import tandem_wire as wire  # noqa: E402

failures = []


def check(name, holds, detail=""):
    if not holds:
        failures.append(name)
        print(f"FAIL {name}{': ' + str(detail) if detail else ''}")


def golden():
    """Name and bytes of every pinned message."""
    for block in (ROOT / "wire/tests/golden.txt").read_text().strip().split("\n\n"):
        name, *rows = block.split("\n")
        yield name, bytes.fromhex("".join(rows))


def refused(name, data):
    try:
        wire.decode(name, data)
    except wire.Malformed:
        return True
    return False


def check_bytes():
    seen = set()
    for name, data in golden():
        seen.add(name)
        try:
            head, body = wire.decode(name, data)
        except wire.Malformed as why:
            check(f"{name}: take the new layout over into examples/python/tandem_wire.py and docs/wire.md", False, why)
            continue
        check(f"{name} is written as it was read", wire.encode(name, head, body) == data)
        want = wire.header(41, 0x0123456789ABCDEF, 9, 4_100_000_000)
        check(f"{name}'s header", head == want, head)
        cut = [at for at in range(len(data)) if not refused(name, data[:at])]
        check(f"{name} cut short is refused", not cut, cut)
        check(f"{name} with a byte behind it is refused", refused(name, data + b"\0"))
        for at, value in ((0, wire.VERSION + 1), (1, 99), (2, 1)):
            spoiled = data[:at] + bytes([value]) + data[at + 1 :]
            check(f"{name} with another byte {at} is refused", refused(name, spoiled))
    check("every message has its golden bytes", seen == set(wire.MESSAGES), seen ^ set(wire.MESSAGES))


def check_values():
    """A few fields, so that a codec which reads the wrong ones in the right lengths is noticed."""
    said = {name: wire.decode(name, data)[1] for name, data in golden()}
    check("command", said["command"]["deadman"] == ("Held", {"press": 3}))
    check("command's echo", said["command"]["seen"] == {"session": 77, "seq": 40})
    check("setpoint", said["setpoint"]["lease"] == {"number": 2, "holder": 88, "name": "ada"})
    check("setpoint's law", said["setpoint"]["law"] == ("Constant", 0.25))
    check("setpoint's limits", said["setpoint"]["limited"] == {"workspace": False, "speed": True, "acceleration": False})
    check("state", said["state"]["motion"] == ("Held", ("SetpointLost", {"silent": 101_000_000})))
    check("state in words", wire.in_words(said["state"]["motion"]) == "the arbiter's setpoints stopped 101 ms ago")
    check("state obeys", said["state"]["obeys"]["setpoint"] == said["setpoint"])
    check("scene", said["scene"]["goal"] == (0.5, 0.3, 0.15))
    check("trial", said["trial"] == ("Begin", {"number": 1, "label": "first"}))
    check("lease", said["lease"] == {"wish": "TakeOver", "name": "supervisor"})
    check("estop", said["estop"] == ("Clear", {"stop": {"session": 77, "seq": 3}, "by": "ada"}))
    check("storage", said["storage"] == {"condition": "NoSpace", "dropped": 12})
    clock = said["clock"]["peers"][0]
    check("clock", (clock["node"], clock["offset"], clock["is_skewed"]) == ("RobotSim", -1_500_000_000, True), clock)
    check("ping", said["ping"]["heard"] == 4_099_900_000)
    check("info", said["info"]["model"] == bytes([1, 2, 3]))
    whats = [entry["what"] for entry in said["journal"]["entries"]]
    check("journal", whats[3] == ("Output", {"topic": ("Journal", "Arbiter"), "bytes": b"\3"}), whats)


def check_bad_numbers():
    data = bytearray(dict(golden())["command"])
    for bad in ("nan", "inf", "-inf"):
        data[32:40] = struct.pack("<d", float(bad))
        check(f"a velocity of {bad} is refused", refused("command", bytes(data)))
    scene = bytearray(dict(golden())["scene"])
    scene[32:40] = b"\xff" * 8
    check("a claim of many elements is refused", refused("scene", bytes(scene)))


def tables(page):
    """The tables behind headings `### Name`: a list of (field, type) each."""
    found, name = {}, None
    for line in page.split("\n"):
        if line.startswith("#"):
            heading = re.match(r"### `(\w+)`", line)
            name = heading and heading.group(1)
        row = re.match(r"\| `(\w+)` \| ([^|]+?) \|", line)
        if name and row:
            found.setdefault(name, []).append((row.group(1), row.group(2).replace("`", "")))
    return found


def layouts(layout, found):
    """Every struct and enum that a message is made of."""
    if isinstance(layout, (wire.Option, wire.Many)):
        layouts(layout.inner, found)
    elif isinstance(layout, wire.Struct):
        found[layout.name] = [(name, kind.name) for name, kind in layout.fields.items()]
        for kind in layout.fields.values():
            layouts(kind, found)
    elif isinstance(layout, wire.Enum):
        rows = []
        for number, (name, kind) in enumerate(layout.variants.items()):
            carried = "–" if kind is None else carries(kind)
            rows.append((name, f"{number}: {carried}"))
            if isinstance(kind, wire.Struct):
                for inner in kind.fields.values():
                    layouts(inner, found)
            elif kind is not None:
                layouts(kind, found)
        found[layout.name] = rows


def carries(kind):
    """What a variant carries: its fields, or the value itself."""
    if isinstance(kind, wire.Struct):
        return ", ".join(f"{name} {inner.name}" for name, inner in kind.fields.items())
    return kind.name


def check_page():
    page = (ROOT / "docs/wire.md").read_text()
    told, wanted = tables(page), {}
    for _, _, layout in wire.MESSAGES.values():
        layouts(layout, wanted)
    for name, rows in wanted.items():
        check(f"docs/wire.md tells {name} field by field", told.get(name) == rows, f"\n  page: {told.get(name)}\n  code: {rows}")
    check("docs/wire.md tells of nothing else", set(told) <= set(wanted), set(told) - set(wanted))
    for name, (kind, longest, layout) in wire.MESSAGES.items():
        row = f"| {kind} | `{layout.name}` | {longest} |"
        check(f"docs/wire.md tells kind and length of {name}", row in page, row)
    check("docs/wire.md tells the version", f"**version {wire.VERSION}**" in page)


def check_sources():
    """Versions and lengths as the Rust sources have them; the bytes above cover the rest."""
    codec = (ROOT / "wire/src/codec.rs").read_text()
    check("the version", f"pub const VERSION: u8 = {wire.VERSION};" in codec)
    messages = (ROOT / "wire/src/messages.rs").read_text()
    lengths = {name: eval(text) for name, text in re.findall(r"message!\((\w+), [^;]*?, (\d+(?: << \d+)?)\);", messages)}
    for _, (_, longest, layout) in wire.MESSAGES.items():
        if layout.name in lengths:
            check(f"the longest {layout.name}", lengths[layout.name] == longest, lengths[layout.name])
    check("lengths were found", len(lengths) >= 10, lengths)


check_bytes()
if not failures:
    check_values()
    check_bad_numbers()
check_sources()
check_page()
print(f"wire: {len(wire.MESSAGES)} messages, {'all agree' if not failures else str(len(failures)) + ' differences'}")
sys.exit(1 if failures else 0)
