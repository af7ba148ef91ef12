"""Several hosts on one machine: network namespaces, joined by a switch whose links can be made bad on purpose.

Each host is a namespace with one TAP device `eth0`, 10.77.0.<number>/24; every frame passes through this process, so delay,
jitter, loss, rate, duplicates, reordering, corruption and cuts in one direction need nothing of the kernel but TAP devices.
Needs root and iproute2. As a program it obeys lines of JSON on its input and answers each with one on its output, so that
Python's own pauses in whoever drives the lab do not delay frames.
"""

import ctypes
import fcntl
import heapq
import json
import os
import random
import selectors
import struct
import subprocess
import sys
import time

CLONE_NEWNET = 0x40000000
TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
QUEUE_S = 0.5  # what would wait longer at a rate limit is dropped, as by a router's buffer
HEADERS = 54  # Ethernet, IPv4 and TCP: what corruption spares, so that a frame still finds its way to a checksum
GOOD = {"delay": 0.0, "jitter": 0.0, "loss": 0.0, "rate": 0.0, "duplicate": 0.0, "corrupt": 0.0, "reorder": 0.0}


def missing():
    """Why there can be no lab here, or None."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if not os.path.exists("/dev/net/tun"):
        return "there is no /dev/net/tun"
    probe = f"tandem-probe-{os.getpid()}"
    try:
        made = subprocess.run(["ip", "netns", "add", probe], capture_output=True, text=True)
    except FileNotFoundError:
        return "the program `ip` (iproute2) is not there"
    if made.returncode:
        return f"no network namespace can be made: {made.stderr.strip()}"
    subprocess.run(["ip", "netns", "del", probe], capture_output=True)
    return None


def address(number):
    return f"10.77.0.{number}"


def in_namespace(name):
    """What to put before a command to run it on a host."""
    return ["ip", "netns", "exec", name]


class Line:
    """A host's line in one direction. Times in seconds, rate in bit/s, shares from 0 to 1."""

    def __init__(self):
        self.set, self.free, self.last = GOOD, 0.0, 0.0

    def arrivals(self, frame, now, draw):
        """What becomes of a frame: (when, bytes) for every copy of it that comes out at the other end."""
        link = self.set
        if link is GOOD:
            yield now, frame
            return
        if draw.random() < link["loss"]:
            return
        start = now
        if link["rate"]:
            start = max(now, self.free)
            if start - now > QUEUE_S:
                return
            start = self.free = start + len(frame) * 8 / link["rate"]
        if len(frame) > HEADERS and draw.random() < link["corrupt"]:
            spoiled = bytearray(frame)
            spoiled[draw.randrange(HEADERS, len(frame))] ^= 1 << draw.randrange(8)
            frame = bytes(spoiled)
        for _ in range(2 if draw.random() < link["duplicate"] else 1):
            at = start + max(0.0, link["delay"] + (draw.gauss(0.0, link["jitter"]) if link["jitter"] else 0.0))
            if draw.random() < link["reorder"]:
                at += draw.uniform(0.005, 0.040)  # overtaken by what comes within these milliseconds
            else:
                at = self.last = max(at, self.last)
            yield at, frame


class Switch:
    """The hosts' lines, up to the switch and down from it; who may not reach whom; and the frames under way."""

    def __init__(self, taps, seed):
        self.taps, self.up, self.down = taps, [Line() for _ in taps], [Line() for _ in taps]
        self.draw, self.blocked = random.Random(seed), set()
        self.known, self.under_way, self.order = {}, [], 0

    def take(self, source, now):
        """Reads what a host sends."""
        for _ in range(64):
            try:
                frame = os.read(self.taps[source], 4096)
            except BlockingIOError:
                return
            self.known[frame[6:12]] = source
            target = self.known.get(frame[:6])
            broadcast = frame[0] & 1 or target is None
            ways = range(len(self.taps)) if broadcast else (target,)
            for up_at, sent in self.up[source].arrivals(frame, now, self.draw):
                for port in ways:
                    if port != source and (source, port) not in self.blocked:
                        self._send(source, port, sent, up_at)

    def _send(self, source, port, frame, at):
        for down_at, copy in self.down[port].arrivals(frame, at, self.draw):
            self.order += 1
            heapq.heappush(self.under_way, (down_at, self.order, source, port, copy))

    def deliver(self, now):
        """Hands over what is due. A cut also swallows what was on the line."""
        while self.under_way and self.under_way[0][0] <= now:
            _, _, source, port, frame = heapq.heappop(self.under_way)
            if (source, port) not in self.blocked:
                try:
                    os.write(self.taps[port], frame)
                except OSError:
                    pass  # a host whose queue is full loses frames, as one does

    def obey(self, order):
        if order["do"] == "set":
            for lines in (self.up, self.down):
                lines[order["host"]].set = {**GOOD, **order["link"]}
        elif order["do"] == "block":
            self.blocked.add((order["from"], order["to"]))
        elif order["do"] == "heal":
            self.blocked.clear()

    def wait(self, now):
        return max(0.0, self.under_way[0][0] - now) if self.under_way else None


def make_host(name, number):
    """Makes a namespace with its TAP device, and gives the device's descriptor."""
    libc = ctypes.CDLL(None, use_errno=True)
    subprocess.run(["ip", "netns", "add", name], check=True)
    home = os.open("/proc/self/ns/net", os.O_RDONLY)
    there = os.open(f"/var/run/netns/{name}", os.O_RDONLY)
    try:
        if libc.setns(there, CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), "setns")
        tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", b"eth0", IFF_TAP | IFF_NO_PI))
        for words in (
            "ip link set lo up",
            f"ip addr add {address(number)}/24 dev eth0",
            "ip link set eth0 up",
        ):
            subprocess.run(words.split(), check=True)
    finally:
        libc.setns(home, CLONE_NEWNET)
        os.close(home)
        os.close(there)
    return tap


def main(names, seed):
    taps = []
    try:
        for number, name in enumerate(names, 1):
            taps.append(make_host(name, number))
        switch = Switch(taps, seed)
        selector = selectors.DefaultSelector()
        for number, tap in enumerate(taps):
            selector.register(tap, selectors.EVENT_READ, number)
        selector.register(sys.stdin, selectors.EVENT_READ, None)
        print(json.dumps("ready"), flush=True)
        while True:
            for key, _ in selector.select(switch.wait(time.monotonic())):
                if key.data is not None:
                    switch.take(key.data, time.monotonic())
                    continue
                line = sys.stdin.buffer.raw.readline()
                if not line:
                    return
                switch.obey(json.loads(line))
                print(json.dumps(time.monotonic()), flush=True)
            switch.deliver(time.monotonic())
    except KeyboardInterrupt:
        pass
    finally:
        for tap in taps:
            os.close(tap)
        for name in names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True)


class Network:
    """The switch as whoever drives the lab sees it."""

    def __init__(self, prefix, hosts, seed=1):
        self.hosts = list(hosts)
        self.names = {host: f"{prefix}-{host}" for host in self.hosts}
        command = [sys.executable, __file__, str(seed), *self.names.values()]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self.process.stdout.readline().strip() != '"ready"':
            raise RuntimeError("the network does not come up")

    def _order(self, **order):
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def address(self, host):
        return address(self.hosts.index(host) + 1)

    def line(self, host, **settings):
        """What befalls frames on their way to a host, and again on their way from it; nothing said: nothing."""
        return self._order(do="set", host=self.hosts.index(host), link=settings)

    def cut(self, one, *others, back=True):
        """Nothing passes from one host to the others any more; nor back, unless told so."""
        at = None
        for other in others:
            a, b = self.hosts.index(one), self.hosts.index(other)
            at = self._order(**{"do": "block", "from": a, "to": b})
            if back:
                at = self._order(**{"do": "block", "from": b, "to": a})
        return at

    def heal(self):
        """All cuts end; links stay as bad as they are."""
        return self._order(do="heal")

    def close(self):
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()


if __name__ == "__main__":
    main(sys.argv[2:], int(sys.argv[1]))
