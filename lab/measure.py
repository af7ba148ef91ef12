"""One row of the matrix: the fault, again and again; then what the robot's own journal says of it."""

import json
import os
import random
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import judge
from faults import STOPS
from hosts import HERE, Lab

# So long the last of several recorders has to fetch what nodes kept of the whole row: minutes of journals, at bulk's priority.
FILLS_S = 10.0


def stepping_clocks(lab):
    """Wall clocks that a file steps; every node reads the same one."""
    path = lab.folder / "clock"
    path.write_text("+0")
    clock = {"FAKETIME_TIMESTAMP_FILE": str(path), "FAKETIME_NO_CACHE": "1"}
    return path, {node: clock for node in ("robot-sim", "arbiter", "predictor", "operator", "recorder")}


class Row:
    """A fault at work."""

    def __init__(self, fault, prefix, folder, options):
        self.fault, self.options = fault, options
        self.lab = Lab(prefix, folder, options.tandem, options.python, options.seed)
        self.draw, self.repetitions, self.troubles = random.Random(options.seed), [], []
        self.guests, self.clock = [], None

    def run(self):
        """Everything; gives the row's figures."""
        fault, lab = self.fault, self.lab
        wanted = self.options.repetitions
        end, wanted = time.monotonic() + self.options.limit_s, wanted + wanted // 20
        try:
            self._start()
            while len(self.repetitions) < wanted and time.monotonic() < end:
                if not self._repeat():
                    break
                self.options.progress(fault, len(self.repetitions), wanted)
            if lab.cut_short:
                time.sleep(FILLS_S)
        finally:
            self.ended = time.monotonic()
            for guest in self.guests:
                lab.end_one(guest, signal.SIGKILL)
            lab.end()
        figures = self._figures(wanted)
        if not (figures["troubles"] or self.options.keep):
            lab.forget()
        return figures

    def _start(self):
        fault, lab = self.fault, self.lab
        clocks = fault.clocks
        if clocks == "stepping":
            self.clock, clocks = stepping_clocks(lab)
        lab.start_all(fault, clocks)
        if not lab.until_moving(30):
            self.troubles.append("it never moved")
            raise RuntimeError(f"{fault.name}: it never moved; see {lab.folder}")
        fault.prepare(lab)
        if fault.guest == ["second"]:
            lab.start("second")
            time.sleep(1.0)
        elif fault.guest:
            host, what = fault.guest
            if what == "bulk":
                self.guests.append(lab.run_on("robot", [lab.python, str(HERE / "hostile.py"), "sink", *lab.way_in()]))
            command = [lab.python, str(HERE / "hostile.py"), what, *lab.way_in(fault.certificate)]
            self.guests.append(lab.run_on(host, command))
            time.sleep(1.5)

    def _step_clock(self):
        if self.clock:
            self.clock.write_text(self.draw.choice(["+1h", "-1h", "+0", "+30m"]))

    def _repeat(self):
        """Once: it moves, the fault comes, the robot stands or drives on, the fault goes, it moves again."""
        fault, lab = self.fault, self.lab
        if not lab.until_moving(fault.recovers_s):
            self.troubles.append(f"did not move within {fault.recovers_s:.0f} s")
            return False
        time.sleep(fault.settles_s + self.draw.uniform(0.05, 0.25))
        if not lab.sight.latest["moving"]:
            return True  # it has just arrived, or a bad line has stopped it: not a repetition
        self._step_clock()
        begun = fault.inject(lab)
        hold = self.draw.uniform(*fault.hold)
        if fault.expects == STOPS and not fault.robot_dies:
            lab.sight.until(lambda line: line["now"] >= begun and not line["permitted"] and line["at_rest"], 1.5)
        time.sleep(hold)
        healed = fault.heal(lab)
        went = None
        if fault.expects == STOPS:
            went = self._until_it_goes(begun, healed)
        self.repetitions.append({"begun": begun, "healed": healed, "went": went})
        return True

    def _until_it_goes(self, begun, healed):
        """Waits for motion by a press after the fault; begins a trial if the operator has none left to do."""
        lab, end = self.lab, time.monotonic() + self.fault.recovers_s
        while time.monotonic() < end:
            line = lab.sight.until(lambda line: line["now"] > begun and line is lab.sight.latest and line["permitted"], 3.0)
            if line and line["now"] >= healed - 0.001:
                return line["now"]
            if not line:
                lab.next_trial()
        return None

    def _ask(self, *words):
        done = subprocess.run([self.options.tandem, *words], capture_output=True, text=True, timeout=120)
        if not done.stdout:
            raise RuntimeError(f"tandem {' '.join(words)}: {done.stderr.strip()}")
        return json.loads(done.stdout)

    def _figures(self, wanted):
        fault, lab = self.fault, self.lab
        # A new recorder fetches what there was before it, so that the last file tells of the whole row.
        runs = self._ask("session", "stops", "--json", str(lab.sessions[-1]))
        info = self._ask("session", "info", "--json", str(lab.sessions[-1]))
        stops = [self._placed(run, stop) for run in runs for stop in run["stops"]]
        # That the nodes are ended is no fault of the row's.
        stops = [stop for stop in stops if stop["at"] is None or stop["at"] < self.ended]
        self.repetitions = [repetition for repetition in self.repetitions if not self._stood(repetition, stops)]
        measured = [self._of(repetition, stops) for repetition in self.repetitions]
        found = [stop for stop in measured if stop]
        other = judge.unasked(fault, stops, found)
        figures = {
            "group": fault.group,
            "name": fault.name,
            "promise": fault.promise,
            "expects": fault.expects,
            "wanted": wanted,
            "repetitions": len(self.repetitions),
            **self._of_stops(found),
            "recovers_s": [r["went"] - r["healed"] for r in self.repetitions if r["went"]],
            "other_stops": len(other),
            **self._of_streams(runs, info),
            "drove_on": sum(stop["drove_on"] for stop in stops),
            **self._of_motion(runs),
            "files": [self._mended(path) for path in lab.cut_short],
            "incomplete": [run["missing"] for run in runs if run["missing"]],
        }
        broken = judge.broken(fault, figures, self.repetitions, measured, other)
        happened = Counter(self.troubles + lab.troubles)
        figures["troubles"] = [what if times == 1 else f"{times} times: {what}" for what, times in happened.items()] + broken
        return figures

    @staticmethod
    def _of_stops(found):
        return {
            "begins_ms": [stop["began_ms"] for stop in found],
            "taken_up_ms": [judge.taken_up_ms(stop) for stop in found],
            "rests_ms": [stop["at_rest_ms"] for stop in found],
            "beyond_ramp_ms": [judge.beyond_ramp_ms(stop) for stop in found],
            "way_mm": [1e3 * stop["way_m"] for stop in found],
            "reasons": sorted({" ".join(w for w in stop["reason"].split() if not w.isdigit()) for stop in found}),
        }

    @staticmethod
    def _of_streams(runs, info):
        commands = next((s for s in info["streams"] if s["topic"] == "command"), {"received": 0, "missed": 0})
        admitted, missed = (sum(run[key] for run in runs) for key in ("setpoints", "setpoints_missed"))
        return {
            "driven_s": sum(run["span_s"] for run in runs),
            "setpoints_missed": missed / max(1, admitted + missed),
            "commands_missed": commands["missed"] / max(1, commands["received"] + commands["missed"]),
            "refused": sum(run["refused"] for run in runs),
        }

    def _of_motion(self, runs):
        """By what it moved: as its journal has it, and as the observer saw it, which a guest's broken states spoil."""
        sight, spoiled = self.lab.sight, self.fault.spoils
        recorded = sum(not again["fresh"] for again in self._agains(runs))
        return {
            "moved": len(self._agains(runs)),
            "stale": recorded + (0 if spoiled else len(sight.stale())),
            "stale_recorded": recorded,
            "warranted": sight.latest.get("warranted", 0),
            "unjudged": sight.latest.get("unjudged", 0),
            "pressed": list(sight.pressed),
            "unwarranted": [] if spoiled else list(sight.unwarranted),
        }

    def _mended(self, path):
        """Repairs the file of a recorder that was killed: what the repaired one lacks before the kill, in seconds."""
        whole = path.with_suffix(".repaired.mcap")
        done = subprocess.run([self.options.tandem, "session", "repair", str(path)], capture_output=True, text=True, timeout=120)
        if done.returncode:
            return {"lacks_s": None, "why": done.stderr.strip()}
        info = self._ask("session", "info", "--json", str(whole))
        whole.unlink()
        ends = info["began_unix_ns"] * 1e-9 + info["duration_s"]
        return {"lacks_s": self.lab.cut_short[path] - ends, "why": ""}

    @staticmethod
    def _agains(runs):
        """Every time that motion was permitted anew."""
        firsts = [run["first"] for run in runs if run["first"]]
        return firsts + [stop["again"] for run in runs for stop in run["stops"] if stop["again"]]

    def _placed(self, run, stop):
        """A stop with its instants on this machine's clock."""
        origin = self.lab.sight.origins.get(run["session"])
        heard = origin + stop["heard_ns"] * 1e-9 if origin is not None else None
        again = origin + stop["again"]["at_ns"] * 1e-9 if heard and stop["again"] else None
        return {**stop, "at": heard and heard + stop["noticed_ms"] * 1e-3, "until": again}

    @staticmethod
    def _stood(repetition, stops):
        """Whether the robot had stopped already when the fault came, or because its trial ended at that moment: then the
        repetition tells nothing."""
        began, end = repetition["begun"], repetition["healed"]
        placed = [stop for stop in stops if stop["at"] is not None]
        already = any(stop["at"] < began - 0.02 and (stop["until"] is None or stop["until"] > began) for stop in placed)
        return already or any(
            began - 0.02 <= stop["at"] <= end and stop["reason"] == "the trial is over" for stop in placed
        )

    def _of(self, repetition, stops):
        """The stop that a repetition brought about."""
        began, end = repetition["begun"] - 0.02, repetition["healed"] + 0.15
        stops = [stop for stop in stops if stop["reason"].startswith(self.fault.because)]
        return next((stop for stop in stops if stop["at"] is not None and began <= stop["at"] <= end), None)
