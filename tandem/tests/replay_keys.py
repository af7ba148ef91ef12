"""Plays a session on a real (pseudo) terminal and presses every key that a replay knows. Usage: replay_keys.py TANDEM SESSION"""

import fcntl
import json
import os
import pty
import re
import select
import socket
import struct
import subprocess
import sys
import termios
import time

PATIENCE_S = 60


class Screen:
    """What a person would see and press."""

    def __init__(self, master):
        self.master, self.text = master, ""

    def until(self, pattern):
        """Waits until something like this is written, and forgets what came before."""
        limit = time.monotonic() + PATIENCE_S
        while not (found := re.search(pattern, self.text)):
            assert time.monotonic() < limit, f"no {pattern!r} in {self.text[-400:]!r}"
            if select.select([self.master], [], [], 1)[0]:
                self.text += os.read(self.master, 65536).decode(errors="replace")
        self.text = self.text[found.end():]
        return found

    def press(self, keys):
        self.text = ""
        os.write(self.master, keys.encode())


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def start(tandem, session, terminal):
    command = [tandem, "replay", session, "--paused", "--json", "--robot", "ghost", "--listen", f"tcp/127.0.0.1:{free_port()}"]
    return subprocess.Popen(command, stdin=terminal, stderr=terminal, stdout=subprocess.PIPE, start_new_session=True)


def press_everything(screen):
    """Each key, until the line under the progress bar says what it did."""
    end = float(screen.until(r"0\.0 of (\d+\.\d) s  paused")[1])
    part = lambda share: rf"{end * share:.1f}".replace(".", r"\.")

    screen.press("5")
    at = float(screen.until(r"([1-9]\d*\.\d) of \S+ s  paused")[1])
    assert abs(at - end / 2) < 0.2, (at, end)
    screen.press("\x1b[C")  # right: a second on
    later = float(screen.until(rf"(?!{at})(\d+\.\d) of \S+ s  paused")[1])
    assert abs(later - at - 1) < 0.2, (at, later)
    screen.press("\x1b[1;2D")  # shift and left: ten seconds back
    screen.until(rf"(?!{later})(\d+\.\d) of \S+ s  paused")
    screen.press("+")
    screen.press(" ")
    screen.until(r"× 2")
    screen.press("-")
    screen.until(r"× 1(?!\d)")
    screen.press(" ")
    screen.until(r"paused")
    screen.press("l")
    screen.until(r"paused.*loop")
    screen.press("3[7]")
    low, high = map(float, screen.until(r"paused  \[(\d+\.\d), (\d+\.\d)\]  loop").groups())
    # A digit means tenths of the part that is played.
    assert abs(low - 0.3 * end) < 0.2 and abs(high - low - 0.7 * (end - low)) < 0.2, (low, high)
    screen.press("\x7f")  # backspace: the whole again
    screen.until(r"paused  loop")
    screen.press("l\x1b[F")  # end
    screen.until(rf"{part(1)} of \S+ s  paused(?!  loop)")
    screen.press(",")  # the instant before
    screen.press(".")
    screen.press("\x1b[H")  # home
    screen.until(r"0\.0 of \S+ s  paused")


def main():
    tandem, session = sys.argv[1:]
    master, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 120, 0, 0))
    was = termios.tcgetattr(terminal)
    replay = start(tandem, session, terminal)
    screen = Screen(master)
    try:
        screen.until(r"q quit")
        press_everything(screen)
        screen.press("q")
        said, _ = replay.communicate(timeout=PATIENCE_S)
    finally:
        replay.kill()
    said = json.loads(said)
    assert replay.returncode == 0, (replay.returncode, said)
    assert said["messages_played"] > 0 and said["messages_lost"] == 0 and said["passes"] > 1, said
    assert termios.tcgetattr(terminal)[:4] == was[:4], "the terminal is as it was"
    print("every key did what it says")


main()
