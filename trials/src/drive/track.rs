//! The path that a recorded tool took, as something to be followed.

use tandem_recorder::Recorded;
use tandem_wire::{JOINTS, MILLISECOND, Nanos, Session, Stamp, State, Topic, Vec3, decode, seconds};

/// A tool that has moved less than this stands still, in metres.
const STANDS_M: f64 = 0.001;
/// So much of a standstill is kept before the first motion.
const LEAD: Nanos = 200 * MILLISECOND;
/// No arm of ours goes faster between two states, in metres per second: what does was put elsewhere.
const FASTEST_M_S: f64 = 2.0;
/// How far apart two states may lie for any other reason, in metres.
const ROUNDING_M: f64 = 0.005;

/// Where the tool was at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint {
    /// Since the track's beginning.
    pub at: Nanos,
    /// The tool's tip, in the base frame, in metres.
    pub tool: Vec3,
}

/// A tool's path over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// At increasing instants; never empty.
    points: Vec<Waypoint>,
    /// The joints at its beginning, in radians, if they are known.
    joints: Option<[f64; JOINTS]>,
    /// How long after its beginning the recording goes on elsewhere.
    broken: Option<Nanos>,
}

/// Why a recording cannot be followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoTrack {
    /// No states.
    #[error("the recording holds no states of the robot between --from and --until")]
    NoStates,
    /// The tool stands.
    #[error("the tool does not move in the recording between --from and --until")]
    NoMotion,
}

impl Track {
    /// A track through these points; those that do not come later than the one before are left out.
    ///
    /// # Errors
    /// If there are no points.
    pub fn through(points: impl IntoIterator<Item = Waypoint>) -> Result<Self, NoTrack> {
        let mut kept: Vec<Waypoint> = Vec::new();
        for point in points {
            if point.tool.is_finite() && kept.last().is_none_or(|last| point.at > last.at) {
                kept.push(point);
            }
        }
        let first = kept.first().ok_or(NoTrack::NoStates)?.at;
        kept.iter_mut().for_each(|point| point.at -= first);
        Ok(Self {
            points: kept,
            joints: None,
            broken: None,
        })
    }

    /// The track of the first motion among these messages, by the robot's own clock. It ends where the arm was put
    /// elsewhere, as at the beginning of another trial, or where the robot was started again.
    ///
    /// # Errors
    /// If there is no motion.
    pub fn recorded<'a>(messages: impl IntoIterator<Item = &'a Recorded>) -> Result<Self, NoTrack> {
        let states = messages.into_iter().filter(|message| message.topic == Topic::State);
        let seen: Vec<Seen> = states.filter_map(Seen::of).collect();
        if seen.is_empty() {
            return Err(NoTrack::NoStates);
        }
        let moved = |from: &Seen, to: &Seen| (to.tool - from.tool).norm() >= STANDS_M;
        let mut rest: &[Seen] = &seen;
        // Jumps before the first motion are passed over: the arm was put at its start.
        loop {
            let unbroken = &rest[..unbroken(rest)];
            if let Some(starts) = unbroken.iter().position(|state| moved(&unbroken[0], state)) {
                let ends = unbroken
                    .iter()
                    .rposition(|state| unbroken.last().is_some_and(|last| moved(last, state)));
                return Self::cut(unbroken, starts, ends.unwrap_or(starts), rest.len() > unbroken.len());
            }
            rest = &rest[unbroken.len()..];
            if rest.is_empty() {
                return Err(NoTrack::NoMotion);
            }
        }
    }

    /// From shortly before the first motion until shortly after the last.
    fn cut(states: &[Seen], starts: usize, ends: usize, goes_on: bool) -> Result<Self, NoTrack> {
        let (starts, ends) = (states[starts].at, states[ends].at.after(LEAD));
        let kept: Vec<&Seen> = states
            .iter()
            .filter(|state| state.at.after(LEAD) >= starts && state.at <= ends)
            .collect();
        let mut track = Self::through(kept.iter().map(|state| Waypoint {
            at: state.at.0,
            tool: state.tool,
        }))?;
        track.joints = kept.first().map(|state| state.joints);
        track.broken = goes_on.then(|| track.duration());
        Ok(track)
    }

    /// How long it takes.
    #[must_use]
    pub fn duration(&self) -> Nanos {
        self.points.last().map_or(0, |last| last.at)
    }

    /// The joints at its beginning, in radians.
    #[must_use]
    pub const fn joints(&self) -> Option<&[f64; JOINTS]> {
        self.joints.as_ref()
    }

    /// Whether the recording goes on elsewhere where the track ends, and when that is.
    #[must_use]
    pub const fn broken(&self) -> Option<Nanos> {
        self.broken
    }

    /// Where the tool was, on the straight line between two points.
    #[must_use]
    pub fn position(&self, at: Nanos) -> Vec3 {
        let (from, to) = self.around(at);
        let span = to.at.saturating_sub(from.at);
        if span == 0 {
            return from.tool;
        }
        let part = at.saturating_sub(from.at).min(span) as f64 / span as f64;
        from.tool + (to.tool - from.tool) * part
    }

    /// How fast it went, in metres per second; zero at the end.
    #[must_use]
    pub fn velocity(&self, at: Nanos) -> Vec3 {
        let (from, to) = self.around(at);
        let span = seconds(to.at.saturating_sub(from.at));
        if span > 0.0 {
            (to.tool - from.tool) * (1.0 / span)
        } else {
            Vec3::ZERO
        }
    }

    /// The distance of `tool` from the nearest place within `window` around an instant, in metres.
    #[must_use]
    pub fn distance(&self, tool: Vec3, at: Nanos, window: Nanos) -> f64 {
        let from = self
            .points
            .partition_point(|point| point.at < at.saturating_sub(window));
        let to = self
            .points
            .partition_point(|point| point.at <= at.saturating_add(window));
        let near = self.points.get(from.saturating_sub(1)..to).unwrap_or_default();
        let here = (tool - self.position(at)).norm();
        near.windows(2)
            .map(|pair| distance_to_line(tool, pair[0].tool, pair[1].tool))
            .fold(here, f64::min)
    }

    /// The points before and after an instant; twice the last one from the end on.
    fn around(&self, at: Nanos) -> (Waypoint, Waypoint) {
        let after = self.points.partition_point(|point| point.at <= at);
        let last = self.points.len() - 1;
        (
            self.points[after.saturating_sub(1).min(last)],
            self.points[after.min(last)],
        )
    }
}

fn distance_to_line(point: Vec3, from: Vec3, to: Vec3) -> f64 {
    let along = to - from;
    let length = along.dot(along);
    let part = if length > 0.0 {
        ((point - from).dot(along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (point - (from + along * part)).norm()
}

/// What of a recorded state matters here.
#[derive(Clone, Copy, Debug)]
struct Seen {
    session: Session,
    at: Stamp,
    tool: Vec3,
    joints: [f64; JOINTS],
}

impl Seen {
    fn of(message: &Recorded) -> Option<Self> {
        let state = decode::<State>(&message.bytes).ok()?;
        Some(Self {
            session: state.header.session,
            at: state.header.sent,
            tool: state.body.tool.position,
            joints: state.body.joints.map(|joint| joint.0),
        })
    }

    /// Whether an arm could have come from here to there.
    fn leads_to(&self, next: &Self) -> bool {
        let reach = FASTEST_M_S * seconds(next.at.since(self.at)) + ROUNDING_M;
        self.session == next.session && (next.tool - self.tool).norm() <= reach
    }
}

/// How many states follow each other without a jump.
fn unbroken(states: &[Seen]) -> usize {
    let jump = states.windows(2).position(|pair| !pair[0].leads_to(&pair[1]));
    jump.map_or(states.len(), |at| at + 1)
}

#[cfg(test)]
mod tests {
    use tandem_wire::SECOND;

    use super::*;

    fn point(at: Nanos, x: f64) -> Waypoint {
        Waypoint {
            at,
            tool: Vec3::new(x, 0.0, 0.0),
        }
    }

    #[test]
    fn between_two_points_the_tool_is_on_the_line_and_after_the_last_one_it_stands() {
        let track = Track::through([point(5 * SECOND, 0.0), point(7 * SECOND, 0.4)]).unwrap();
        assert_eq!(track.duration(), 2 * SECOND);
        assert!((track.position(SECOND / 2).x - 0.1).abs() < 1e-12);
        assert!((track.velocity(SECOND / 2).x - 0.2).abs() < 1e-12);
        assert_eq!(track.position(9 * SECOND).x, 0.4);
        assert_eq!(track.velocity(9 * SECOND), Vec3::ZERO);
    }

    #[test]
    fn points_that_come_no_later_are_left_out_and_none_at_all_is_refused() {
        let track = Track::through([point(5, 0.0), point(5, 1.0), point(3, 1.0), point(9, 2.0)]).unwrap();
        assert_eq!(track.points, [point(0, 0.0), point(4, 2.0)]);
        assert_eq!(Track::through([]), Err(NoTrack::NoStates));
        let one = Track::through([point(5, 0.3)]).unwrap();
        assert_eq!(
            (one.position(1).x, one.velocity(1), one.duration()),
            (0.3, Vec3::ZERO, 0)
        );
    }

    #[test]
    fn a_distance_is_measured_to_the_nearest_place_nearby() {
        let track = Track::through([point(0, 0.0), point(SECOND, 0.1), point(9 * SECOND, 0.9)]).unwrap();
        let tool = Vec3::new(0.05, 0.02, 0.0);
        assert!((track.distance(tool, SECOND, SECOND) - 0.02).abs() < 1e-12);
        assert!(
            track.distance(Vec3::new(0.9, 0.0, 0.0), 0, SECOND / 2) > 0.7,
            "that comes much later"
        );
    }
}
