"""Rows as lines for whoever waits, and as the table of docs/reliability.md."""

import json
import statistics

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
        f"{row['name']}: {row['repetitions']}×, stop begins {pair(row['begins_ms'], '.0f')} ms, stands {pair(row['rests_ms'], '.0f')} ms"
        f" ({pair(row['beyond_ramp_ms'], '.0f')} beyond the ramp), moves again {pair(row['recovers_s'], '.2f')} s,"
        f" other stops {row['other_stops']}, by an old press {row['stale']}, without deadman or lease {len(row['unwarranted'])}: {verdict}"
    )


def keep(path, row):
    """Keeps a row in a file of figures, in the place of an earlier one of its name."""
    before = json.loads(path.read_text())["rows"] if path.exists() else []
    rows = [other for other in before if other["name"] != row["name"]] + [row]
    path.write_text(json.dumps({"rows": rows}, indent=1))


def share(missed):
    return f"{100 * missed:.1f} %"


def without_leave(row):
    """States that said "moving" and lacked what that takes, of all that said so. Rows of an older lab have no figures for it."""
    if "unwarranted" not in row:
        return "–"
    seen = len(row["unwarranted"]) + row["warranted"] + row["unjudged"]
    return f"{len(row['unwarranted'])} of {seen}"


def cells(row):
    stops = row["expects"] == STOPS
    others = f"{60 * row['other_stops'] / max(1.0, row['driven_s']):.1f}"
    return [
        row["name"],
        row["promise"],
        str(row["repetitions"]),
        pair(row["begins_ms"] if stops else [], ".0f"),
        pair(row["rests_ms"] if stops else [], ".0f"),
        share(row["setpoints_missed"]),
        share(row["commands_missed"]),
        others,
        pair(row["recovers_s"], ".1f"),
        f"{row['stale']} of {row['moved']}",
        without_leave(row),
        row["date"],
    ]


HEAD = [
    "fault",
    "promised",
    "times",
    "stop begins, ms",
    "stands, ms",
    "setpoints missed",
    "commands missed",
    "other stops a minute",
    "moves again, s",
    "by an old press",
    "without deadman or lease",
    "measured",
]


def standing(table):
    """The cells of the rows that a page's table has, by the name of the fault."""
    lines = [line.strip("|").split("|") for line in table.splitlines() if line.startswith("| ")]
    return {cells[0].strip(): [cell.strip() for cell in cells] for cells in lines if len(cells) == len(HEAD)}


def markdown(table, rows):
    """The table anew: what was measured now, and what stood there already."""
    shown = [row for row in rows if "begins_ms" in row and row["promise"] != CONTROL]
    have = standing(table) | {row["name"]: cells(row) for row in shown}
    out = []
    for group, faults in MATRIX.items():
        members = [have[fault.name] for fault in faults if fault.name in have]
        if not members:
            continue
        out += [f"### {group}", "", "| " + " | ".join(HEAD) + " |", "| --- | --- |" + " ---: |" * (len(HEAD) - 2)]
        out += ["| " + " | ".join(member) + " |" for member in members]
        out.append("")
    return "\n".join(out)


def write(page, rows):
    """Puts rows into the table between the page's marks, in the place of those of their names."""
    text = page.read_text()
    first, rest = text.split(MARK[0])
    table, last = rest.split(MARK[1])
    page.write_text(f"{first}{MARK[0]}\n\n{markdown(table, rows)}\n{MARK[1]}{last}")
