"""Tandem's nodes on the lab's hosts, and somebody who watches on the robot's: started, frozen, killed, started again."""

import json
import os
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path

from network import Network, in_namespace

HERE = Path(__file__).resolve().parent
HOSTS = ("robot", "arbiter", "predictor", "operator", "guest")
# Where a node stands that has no host of its own.
HOST_OF = {"robot-sim": "robot", "recorder": "robot", "router": "robot", "second": "guest"}
PORT = 7447
# A node that ends waits for a recorder for some seconds, not longer.
ENDS_WITHIN_S = 10.0
FAKETIME = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1"


class Sight:
    """What the observer says, as it says it; a thread of its own reads it."""

    def __init__(self, process):
        self.process, self.changed = process, threading.Condition()
        self.latest, self.lines, self.origins, self.unwarranted, self.pressed = {}, [], {}, [], []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for text in self.process.stdout:
            line = json.loads(text)
            with self.changed:
                if "origin" in line:
                    self.origins[line["session"]] = line["origin"]
                elif "unwarranted" in line:
                    self.unwarranted.append(line["unwarranted"])
                elif "pressed" in line:
                    self.pressed.append(line["now"])
                else:
                    self.latest = line
                    self.lines.append(line)
                self.changed.notify_all()

    def until(self, wanted, limit_s):
        """Waits for a line that is wanted; gives it, or None when so much time has passed."""
        end = time.monotonic() + limit_s
        with self.changed:
            at = max(0, len(self.lines) - 1)
            while True:
                for line in self.lines[at:]:
                    if wanted(line):
                        return line
                at = len(self.lines)
                if time.monotonic() >= end or self.process.poll() is not None:
                    return None
                self.changed.wait(min(0.05, max(0.0, end - time.monotonic())))

    def begin(self, number):
        self.process.stdin.write(f"begin {number}\n")
        self.process.stdin.flush()

    def since(self, moment):
        """Every line from then on."""
        with self.changed:
            return [line for line in self.lines if line["now"] >= moment]

    def stale(self):
        return [line for line in self.lines if line["stale"]]


class Site:
    """A site's certificates, and some that should open nothing."""

    def __init__(self, lab):
        self.lab, self.folder, self.other = lab, lab.folder / "site", lab.folder / "other" / "site"
        self.other.parent.mkdir()
        for where in (self.folder, self.other):
            self._keys(where.parent, "new", "--site", "site", "--host", lab.network.address("robot"))
        self._keys(lab.folder, "issue", "operator", "--name", "observer", "--site", "site")
        # Issued nine days ago for one day.
        long_ago = {"LD_PRELOAD": FAKETIME, "FAKETIME": "-9d"}
        self._keys(lab.folder, "issue", "arbiter", "--name", "late", "--days", "1", "--site", "site", **long_ago)

    def _keys(self, where, *words, **environment):
        command = [self.lab.tandem, "keys", *words]
        done = subprocess.run(command, cwd=where, env={**os.environ, **environment}, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"tandem keys {' '.join(words)}: {done.stderr.strip()}")
        return done.stdout

    def config(self, kind):
        """Zenoh's configuration for whoever dials with a certificate of this kind."""
        member = ("operator", "--member", "observer") if kind == "member" else ("viewer",)
        told = json.loads(self._keys(self.lab.folder, "config", *member, "--site", "site", "--connect", self.lab.endpoint))
        # Who dials to do harm checks nobody.
        told.pop("access_control", None)
        tls = told["transport"]["link"]["tls"]
        mine = {"other": (self.other, "arbiter"), "late": (self.folder, "late"), "arbiter": (self.folder, "arbiter")}.get(kind)
        for key in list(tls):
            if "certificate" in key and not key.startswith("root") or "private_key" in key:
                if kind == "none":
                    del tls[key]
                elif mine:
                    ending = "key" if "private_key" in key else "pem"
                    tls[key] = str(mine[0] / f"{mine[1]}.{ending}")
        if kind == "none":
            tls["enable_mtls"] = False
        path = self.lab.folder / f"{kind}.json"
        path.write_text(json.dumps(told))
        return path


class Lab:
    """One network with all nodes on it."""

    def __init__(self, prefix, folder, tandem, python, seed=1):
        self.folder, self.tandem, self.python = Path(folder), tandem, python
        self.folder.mkdir(parents=True, exist_ok=True)
        self.network = Network(prefix, HOSTS, seed)
        self.sessions, self.cut_short = [], {}  # the file of every recorder, in order; when one was killed, by its file
        self.nodes, self.clocks, self.extra, self.trial, self.troubles = {}, {}, {}, 0, []
        self.environment = {**os.environ, "TMPDIR": str(self.folder)}
        self.route_by("robot-sim")

    def route_by(self, node):
        """Everybody dials this node's process."""
        self.routes = node
        self.endpoint = f"tcp/{self.network.address(HOST_OF.get(node, node))}:{PORT}"

    def start_all(self, fault, clocks):
        """Every node, whoever routes first; with the fault's settings, wall clocks and certificates."""
        self.extra, self.clocks = fault.extra, clocks
        self.route_by(fault.routes)
        self.site = Site(self) if fault.certificate else None
        nodes = ("robot-sim", "recorder", "predictor", "arbiter")
        for node in nodes if self.routes in nodes else (self.routes, *nodes):
            self.start(node)
        observer = [self.python, str(HERE / "observer.py"), *self.way_in()]
        observer += ["--hears-commands"] if fault.sees_commands else []
        observer = self.run_on("robot", observer, pipes=True)
        self.sight = Sight(observer)
        self.start("operator")

    def way_in(self, kind="member"):
        """How a Python program reaches the robot: by its address, or by a certificate of this kind."""
        return ["--config", str(self.site.config(kind))] if self.site else ["--connect", self.endpoint]

    def start(self, node):
        """Starts a node, or starts it again."""
        command = [self.tandem, "operator" if node == "second" else node]
        command += ["--listen", self.endpoint] if node == self.routes else ["--connect", self.endpoint]
        command += ["--insecure"] if node == self.routes and not self.site else []
        command += ["--site", str(self.site.folder), "--member", node] if self.site else []
        if node == "recorder":
            self.sessions.append(self.folder / f"session-{len(self.sessions) + 1}.mcap")
            command += ["--record", str(self.sessions[-1])]
        command += ["--set", "operator.name=second"] if node == "second" else []
        command += [word for pair in self.extra.get(node, ()) for word in ("--set", pair)]
        self.nodes[node] = self.run_on(HOST_OF.get(node, node), command, name=node)

    def ask_as_guest(self, *words):
        """Runs a command of the program on the guest's host; that it fails is told with the row."""
        command = [*in_namespace(self.network.names["guest"]), self.tandem, *words, "--connect", self.endpoint]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=30)
        if done.returncode:
            self.troubles.append(f"tandem {' '.join(words)} ended with {done.returncode}: {done.stderr.strip()}")

    def run_on(self, host, command, name="", pipes=False):
        """Runs a program on a host."""
        environment = dict(self.environment)
        if self.clocks.get(name):
            environment.update(LD_PRELOAD=FAKETIME, FAKETIME_DONT_FAKE_MONOTONIC="1", **self.clocks[name])
        pipe = subprocess.PIPE if pipes else subprocess.DEVNULL
        with open(self.folder / f"{name or Path(command[1]).stem}.log", "ab") as log:
            return subprocess.Popen(
                in_namespace(self.network.names[host]) + command,
                env=environment,
                stdin=pipe,
                stdout=pipe,
                stderr=log,
                text=True,
                start_new_session=True,
            )

    def send(self, node, what):
        self.nodes[node].send_signal(what)
        if what == signal.SIGKILL:
            self.nodes[node].wait()
            if node == "recorder":
                self.cut_short[self.sessions[-1]] = time.time()
        return time.monotonic()

    def await_end(self, node):
        """Waits until a node has ended that was asked to, or killed; one that does not end is told with the row, and killed."""
        try:
            self.nodes[node].wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.troubles.append(f"{node} did not end within {ENDS_WITHIN_S:.0f} s of Ctrl-C")
            self.send(node, signal.SIGKILL)

    def next_trial(self):
        self.trial += 1
        self.sight.begin(self.trial)

    def until_moving(self, limit_s):
        """Waits until the tool moves by the human's press; begins a trial where there is none, or it is over."""
        end, tried = time.monotonic() + limit_s, 0.0
        while time.monotonic() < end:
            if self.sight.until(lambda line: line is self.sight.latest and line["moving"], 1.2):
                return True
            # A robot or an operator that has just come back begins by itself.
            if time.monotonic() - tried > 3.0:
                tried = time.monotonic()
                self.next_trial()
        return False

    def end(self):
        """Everybody says goodbye, the recorder last; then the network goes."""
        order = [node for node in ("second", "operator", "predictor", "arbiter", "robot-sim") if node in self.nodes]
        for node in order:
            self.end_one(self.nodes[node])
        if hasattr(self, "sight"):
            self.end_one(self.sight.process, signal.SIGKILL)
        if "recorder" in self.nodes:
            self.end_one(self.nodes["recorder"], limit_s=20)
        if "router" in self.nodes:
            self.end_one(self.nodes["router"])
        self.network.close()

    def end_one(self, process, what=signal.SIGINT, limit_s=4):
        if process.poll() is not None:
            return
        process.send_signal(signal.SIGCONT)
        process.send_signal(what)
        try:
            process.wait(limit_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def forget(self):
        """Removes what the nodes wrote."""
        shutil.rmtree(self.folder, ignore_errors=True)
