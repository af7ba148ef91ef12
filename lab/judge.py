"""Whether a row kept what it promises. Pure: figures and stops in, every broken promise out, in words."""

from faults import CONTROL, DRIVES_ON, STOPS

# From the last setpoint that let the arm move: a timeout of 100 ms, and the next two.
BEGINS_WITHIN_MS = 110.0
# From what the robot noticed to braking: at most ten ticks until the next plan, and the tick itself.
TAKES_UP_WITHIN_MS = 11.0
# The tool's speed is ramped down by 0.8 (RAMP_SHARE, robot-sim/src/arm/reference.rs) of `tool_acceleration_m_s2`.
RAMP_M_S2 = 0.8 * 4.0
# What braking may take beyond the ramp: the reference is ahead of a tool that speeds up by 40 ms of ramp, the ramp ends with a
# whole plan of 10 ms, and the joints need some plans more to stand. 76 ms is the most that was seen in 5681 stops.
BEYOND_RAMP_MS = 100.0
# A robot refuses this many messages of its own arbiter's in a row of cuts; a stranger says 200 a second.
FEW = 200
# Stops that belong to every trial, whatever else happens.
USUAL = ("the deadman is released", "the trial is over", "no trial is running")
# By so much motion may seem to begin before the fault was undone: the clocks of two processes are compared.
CLOCKS_S = 0.02
# What a killed recorder's file may lack before the kill (docs/sessions.md).
FILE_LACKS_S = 1.0


def beyond_ramp_ms(stop):
    """How much longer the arm braked than the ramp of its tool takes; None while it did not stand."""
    if stop["began_ms"] is None or stop["at_rest_ms"] is None:
        return None
    return stop["at_rest_ms"] - stop["began_ms"] - 1e3 * stop["speed_m_s"] / RAMP_M_S2


def taken_up_ms(stop):
    """From the robot's notice to its braking."""
    return None if stop["began_ms"] is None else stop["began_ms"] - stop["noticed_ms"]


def above(values, limit):
    """What is over the limit, or is not known."""
    return [value for value in values if value is None or value > limit]


def shown(values):
    """The first few, for people."""
    return ", ".join("never" if value is None else f"{value:.0f}" for value in values[:5])


def unasked(fault, stops, found):
    """Stops that the row does not promise: where it drives on, also those that came with the fault."""
    promised = found if fault.expects == STOPS else []
    return [stop for stop in stops if stop not in promised and not stop["reason"].startswith(USUAL)]


def broken(fault, figures, repetitions, measured, other):
    """Every promise that was not kept, in words. `measured` has the stop of each repetition, or None; `other` the rest."""
    if fault.promise == CONTROL:
        return [] if figures["refused"] > FEW else ["the forger was not heard, so that the other rows show nothing"]
    troubles = of_motion(fault, figures)
    if fault.expects == STOPS and not fault.robot_dies:
        troubles += of_stops(fault, repetitions, measured)
    if fault.because and not any(r["begun"] < at < r["healed"] for at in figures["pressed"] for r in repetitions):
        troubles.append("nobody pressed while the fault lasted, so that it does not show that no press counts")
    if fault.expects == STOPS and len(figures["recovers_s"]) < len(repetitions):
        troubles.append(f"{len(repetitions) - len(figures['recovers_s'])} times it did not move again")
    if fault.expects == DRIVES_ON and other:
        troubles.append(f"it stopped {len(other)} times: {other[0]['reason']}")
    if fault.certificate and figures["refused"] > FEW:
        troubles.append(f"{figures['refused']} messages of a stranger reached the robot")
    if not repetitions:
        troubles.append("no repetition")
    if not figures["driven_s"]:
        troubles.append("the session file holds no journal of the robot, so that its stops are not known")
    return troubles + of_files(figures)


def of_motion(fault, figures):
    """Motion that nobody asked for."""
    troubles = []
    if figures["drove_on"]:
        troubles.append(f"{figures['drove_on']} times it drove on")
    if figures["stale"]:
        told = f"{figures['stale_recorded']} by its journal, the rest as the observer saw it"
        troubles.append(f"{figures['stale']} times it moved without a fresh press ({told})")
    if figures["unwarranted"]:
        told = "; ".join(sorted(set(figures["unwarranted"])))
        troubles.append(f"{len(figures['unwarranted'])} states said that it moves and lacked what that takes: {told}")
    if fault.sees_commands and figures["warranted"] <= figures["unjudged"]:
        troubles.append(f"only {figures['warranted']} states could be judged by the deadman, {figures['unjudged']} could not")
    return troubles


def of_stops(fault, repetitions, measured):
    """Stops that the fault brought about: when they began, how long they took, what moved the arm again."""
    troubles, found = [], [stop for stop in measured if stop]
    if None in measured:
        troubles.append(f"{measured.count(None)} times it did not stop")
    for what, values, limit in (
        ("began later than {} ms", [stop["began_ms"] for stop in found], BEGINS_WITHIN_MS),
        ("were taken up later than {} ms after they were noticed", [taken_up_ms(stop) for stop in found], TAKES_UP_WITHIN_MS),
        ("took more than {} ms beyond the ramp", [beyond_ramp_ms(stop) for stop in found], BEYOND_RAMP_MS),
    ):
        late = above(values, limit)
        if late:
            troubles.append(f"{len(late)} stops {what.format(f'{limit:.0f}')}: {shown(late)}")
    pairs = [(stop, again) for stop, again in zip(measured, repetitions) if stop]
    early = [stop for stop, again in pairs if stop["until"] is not None and stop["until"] < again["healed"] - CLOCKS_S]
    if fault.stands_still and early:
        troubles.append(f"{len(early)} times it moved before the fault was undone: {early[0]['reason']}")
    return troubles


def of_files(figures):
    """Session files of a recorder that was killed."""
    files = figures["files"]
    unread = [file for file in files if file["lacks_s"] is None]
    late = [file["lacks_s"] for file in files if file["lacks_s"] is not None and file["lacks_s"] > FILE_LACKS_S]
    troubles = [f"{len(unread)} files cannot be repaired: {unread[0]['why']}"] if unread else []
    if late:
        troubles.append(f"{len(late)} repaired files lack more than {FILE_LACKS_S:.0f} s before the kill: {max(late):.1f} s")
    if files and figures["incomplete"]:
        troubles.append(f"the robot's journal has a hole that was not filled: {figures['incomplete'][0]}")
    return troubles
