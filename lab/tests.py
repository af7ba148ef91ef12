"""The lab judges itself: every promise can be broken, and what broke it is said. `lab/run` runs these before it measures."""

import unittest

import judge
import table
from faults import MATRIX, Fault, STOPS
from warrant import Warrants

HOLDER, STRANGER, ROBOT = 2, 3, 4
HEAD = {"session": ROBOT, "seq": 90}


def a_stop(**changed):
    """A stop as `tandem session stops` tells it, that keeps every promise."""
    stop = {"reason": "the arbiter's setpoints stopped 100 ms ago", "noticed_ms": 100.0, "began_ms": 105.0, "at_rest_ms": 230.0}
    return {**stop, "speed_m_s": 0.2, "way_m": 0.02, "at": 1.1, "until": 2.5, "again": None, **changed}


def figures(**changed):
    of_motion = {"drove_on": 0, "stale": 0, "stale_recorded": 0, "warranted": 9, "unjudged": 0, "unwarranted": []}
    return {**of_motion, "refused": 0, "recovers_s": [0.5], "pressed": [1.5], "driven_s": 60.0, "files": [], "incomplete": [], **changed}


def troubles(fault=None, stop=None, other=(), **changed):
    """What is said of a row of one repetition: the fault came at 1 s and was undone at 2 s."""
    fault = fault or Fault("a fault", "stops", stands_still=True)
    measured = [a_stop() if fault.expects == STOPS else None] if stop is None else [stop]
    return judge.broken(fault, figures(**changed), [{"begun": 1.0, "healed": 2.0, "went": 2.5}], measured, list(other))


class Promises(unittest.TestCase):
    def broken(self, words, **row):
        said = troubles(**row)
        self.assertEqual(len(said), 1, said)
        self.assertIn(words, said[0])

    def test_a_row_that_keeps_everything_is_kept(self):
        self.assertEqual(troubles(), [])

    def test_a_stop_that_begins_late_breaks_it(self):
        self.broken("began later than 110 ms: 111", stop=a_stop(noticed_ms=101.0, began_ms=111.0))

    def test_a_stop_that_is_noticed_and_not_taken_up_breaks_it(self):
        self.broken("after they were noticed: 12", stop=a_stop(noticed_ms=20.0, began_ms=32.0, at_rest_ms=100.0))

    def test_braking_for_longer_than_the_ramp_and_the_joints_take_breaks_it(self):
        # From 0.32 m/s the ramp takes 100 ms.
        at_the_limit = a_stop(speed_m_s=0.32, began_ms=105.0, at_rest_ms=305.0)
        self.assertEqual(troubles(stop=at_the_limit), [])
        self.broken("beyond the ramp: 101", stop={**at_the_limit, "at_rest_ms": 306.0})

    def test_an_arm_that_never_stands_breaks_it(self):
        self.broken("beyond the ramp: never", stop=a_stop(at_rest_ms=None))

    def test_motion_before_the_fault_is_undone_breaks_it(self):
        self.broken("moved before the fault was undone", stop=a_stop(until=1.5))

    def test_a_row_in_which_nobody_tried_to_move_it_breaks_it(self):
        fault = Fault("an emergency stop", "no press moves it", because="emergency", stands_still=True)
        self.broken("nobody pressed", fault=fault, stop=a_stop(reason="emergency stop"), pressed=[])

    def test_a_row_without_the_robots_journal_breaks_it(self):
        self.broken("no journal of the robot", driven_s=0)

    def test_an_arm_that_speeds_up_while_it_is_stopped_breaks_it(self):
        self.broken("1 times it drove on", drove_on=1)

    def test_no_stop_where_one_is_promised_breaks_it(self):
        fault = Fault("a fault", "stops")
        said = judge.broken(fault, figures(), [{"begun": 1.0, "healed": 2.0, "went": 2.5}], [None], [])
        self.assertEqual(said, ["1 times it did not stop"])

    def test_a_stop_where_none_is_promised_breaks_it(self):
        self.broken("it stopped 1 times", fault=Fault("a fault", "goes on", expects="drives on"), other=[a_stop()])

    def test_a_stop_that_comes_with_the_fault_is_promised_only_where_the_row_stops(self):
        stops = [a_stop(), a_stop(at=1.2), a_stop(reason="the trial is over")]
        self.assertEqual(judge.unasked(Fault("a fault", "stops"), stops, stops[:1]), stops[1:2])
        self.assertEqual(judge.unasked(Fault("a fault", "goes on", expects="drives on"), stops, stops[:1]), stops[:2])

    def test_motion_by_an_old_press_or_by_nobody_breaks_it(self):
        self.broken("without a fresh press", stale=1)
        self.broken("nobody holds the lease", unwarranted=["nobody holds the lease"])
        self.broken("only 3 states could be judged", warranted=3, unjudged=4)

    def test_a_file_that_cannot_be_repaired_or_lacks_much_breaks_it(self):
        self.broken("cannot be repaired: no header", files=[{"lacks_s": None, "why": "no header"}])
        self.broken("lack more than 1 s before the kill: 1.5 s", files=[{"lacks_s": 1.5, "why": ""}])
        self.broken("a hole", files=[{"lacks_s": 0.1, "why": ""}], incomplete=["entries 3 to 9 are missing"])

    def test_a_stranger_who_reaches_the_robot_breaks_it(self):
        self.broken("of a stranger", fault=Fault("a forger", "let in nowhere", certificate="none"), refused=judge.FEW + 1)


class TheTable(unittest.TestCase):
    def test_every_fault_has_a_name_of_its_own(self):
        names = [fault.name for faults in MATRIX.values() for fault in faults]
        self.assertEqual(len(names), len(set(names)))

    def test_a_row_has_a_cell_for_every_heading(self):
        row = {"name": "a", "promise": "b", "expects": STOPS, "repetitions": 1, "begins_ms": [1.0], "rests_ms": [2.0], "date": "today"}
        row |= {"setpoints_missed": 0.0, "commands_missed": 0.25, "other_stops": 0, "driven_s": 60.0, "recovers_s": [1.0]}
        row |= {"stale": 0, "moved": 1, "unwarranted": ["nobody holds the lease"], "warranted": 7, "unjudged": 2}
        cells = table.cells(row)
        self.assertEqual(len(cells), len(table.HEAD))
        self.assertEqual(cells[table.HEAD.index("commands missed")], "25.0 %")
        self.assertEqual(cells[table.HEAD.index("without deadman or lease")], "1 of 10")


def a_state(press=1, **changed):
    """A state that says "moving", and its setpoint."""
    motion = ("Permitted", {"press": press})
    setpoint = {"motion": motion, "lease": {"holder": HOLDER}, "command": {"id": {"session": HOLDER, "seq": 5}}, **changed}
    return {"motion": motion, "obeys": {"setpoint": setpoint}}


def said(warrants, number, deadman=("Held", {"press": 1}), operator=HOLDER, at=10.0, answers=None):
    """Has a command be heard; gives the press that begins with it."""
    return warrants.hear(at, {"session": operator, "seq": number}, {"deadman": deadman, "seen": answers})


def heard(**command):
    warrants = Warrants()
    said(warrants, 5, **command)
    return warrants


class WhoLetsItMove(unittest.TestCase):
    def test_a_held_deadman_of_whoever_holds_the_lease_does(self):
        warrants = heard()
        self.assertIsNone(warrants.missing(10.1, HEAD, a_state()))
        self.assertEqual((warrants.warranted, warrants.unjudged), (1, 0))

    def test_a_press_begins_once(self):
        warrants = heard(deadman="Released")
        self.assertEqual([said(warrants, number, ("Held", {"press": 7})) for number in (6, 7)], [7, None])

    def test_a_released_one_or_another_press_does_not(self):
        self.assertIn("not held", heard(deadman="Released").missing(10.1, HEAD, a_state()))
        self.assertIn("not held", heard(deadman=("Held", {"press": 2})).missing(10.1, HEAD, a_state()))

    def test_one_that_was_held_long_ago_does_not(self):
        self.assertIn("last seen held 300 ms before", heard().missing(10.3, HEAD, a_state()))

    def test_saying_an_old_command_again_does_not_make_it_new(self):
        warrants = heard()
        said(warrants, 5, at=10.3)
        self.assertIn("last seen held", warrants.missing(10.3, HEAD, a_state()))

    def test_a_command_that_answers_an_old_state_does_not(self):
        warrants = Warrants()
        warrants.missing(9.3, {"session": ROBOT, "seq": 20}, {"motion": ("Held", "NoTrial"), "obeys": None})
        said(warrants, 5, answers={"session": ROBOT, "seq": 20})
        self.assertIsNone(warrants.missing(10.04, HEAD, a_state()))
        self.assertIn("answers a state that is 800 ms old", warrants.missing(10.1, HEAD, a_state()))

    def test_nobody_else_and_no_setpoint_does(self):
        self.assertIn("not the lease holder's", heard().missing(10.1, HEAD, a_state(command={"id": {"session": STRANGER, "seq": 5}})))
        self.assertIn("nobody holds the lease", heard().missing(10.1, HEAD, a_state(lease=None)))
        self.assertIn("no command", heard().missing(10.1, HEAD, a_state(command=None)))

    def test_a_setpoint_that_the_arm_has_still_to_take_up_may_until_the_next_plan(self):
        for state in (a_state(motion=("Held", "DeadmanReleased")), {**a_state(), "obeys": None}):
            warrants = heard()
            self.assertIsNone(warrants.missing(10.1, HEAD, state))
            self.assertIn("by this press", warrants.missing(10.12, HEAD, state))

    def test_a_command_that_was_not_heard_is_counted_and_not_judged(self):
        warrants = heard(operator=STRANGER)
        self.assertIsNone(warrants.missing(10.1, HEAD, a_state()))
        self.assertEqual((warrants.warranted, warrants.unjudged), (0, 1))

    def test_a_robot_that_stands_needs_nobody(self):
        self.assertIsNone(Warrants().missing(10.1, HEAD, {"motion": ("Held", "NoTrial"), "obeys": None}))


if __name__ == "__main__":
    unittest.main()
