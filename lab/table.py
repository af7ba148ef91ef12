"""Rows as lines for whoever waits, and as the table of docs/reliability.md."""

import json
import statistics
import time

from faults import CONTROL, MATRIX, STOPS

MARK = ("<!-- lab/run writes from here -->", "<!-- to here -->")


def pair(values, form):
    """Median and worst."""
    values = [value for value in values or [] if value is not None]
    return f"{statistics.median(values):{form}} / {max(values):{form}}" if values else "–"


def line(row):
    """One row for whoever waits."""
    if "begins_ms" not in row:
        return f"{row['name']}: {'; '.join(row['troubles'])}"
    verdict = "BROKEN: " + "; ".join(row["troubles"]) if row["troubles"] else "kept"
    return (
        f"{row['name']}: {row['repetitions']}×, stop begins {pair(row['begins_ms'], '.0f')} ms, stands {pair(row['rests_ms'], '.0f')} ms,"
        f" moves again {pair(row['recovers_s'], '.2f')} s, other stops {row['other_stops']}, stale {row['stale']}: {verdict}"
    )


def merged(path, row):
    """Adds a row to the figures in a file, in the place of an earlier one of its name."""
    before = json.loads(path.read_text())["rows"] if path.exists() else []
    row["date"] = time.strftime("%Y-%m-%d", time.gmtime())
    rows = [other for other in before if other["name"] != row["name"]] + [row]
    path.write_text(json.dumps({"rows": rows}, indent=1))
    return rows


def cells(row):
    share = f"{100 * row['setpoints_missed']:.1f} %"
    stops = row["expects"] == STOPS
    others = f"{60 * row['other_stops'] / max(1.0, row['driven_s']):.1f}"
    return [
        row["name"],
        row["promise"],
        str(row["repetitions"]),
        pair(row["begins_ms"] if stops else [], ".0f"),
        pair(row["rests_ms"] if stops else [], ".0f"),
        share,
        others,
        pair(row["recovers_s"], ".1f"),
        f"{row['stale']} of {row['moved']}",
    ]


HEAD = [
    "fault",
    "promised",
    "times",
    "stop begins, ms",
    "stands, ms",
    "setpoints missed",
    "other stops a minute",
    "moves again, s",
    "by an old press",
]


def markdown(rows):
    out = []
    for group in MATRIX:
        order = [fault.name for fault in MATRIX[group]]
        shown = [row for row in rows if "begins_ms" in row and row["promise"] != CONTROL]
        members = sorted(
            (row for row in shown if row["group"] == group and row["name"] in order),
            key=lambda row: order.index(row["name"]),
        )
        if not members:
            continue
        out += [f"### {group}", "", "| " + " | ".join(HEAD) + " |", "| --- | --- |" + " ---: |" * (len(HEAD) - 2)]
        out += ["| " + " | ".join(cells(row)) + " |" for row in members]
        out.append("")
    return "\n".join(out)


def write(page, rows):
    """Puts the table between the page's marks."""
    text = page.read_text()
    first, rest = text.split(MARK[0])
    _, last = rest.split(MARK[1])
    page.write_text(f"{first}{MARK[0]}\n\n{markdown(rows)}\n{MARK[1]}{last}")
