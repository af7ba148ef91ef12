//! Which layouts a viewer is sent.

use std::sync::Mutex;

use crossbeam_channel::bounded;
use tandem_wire::{
    Aabb, Arrivals, Envelope, Finite, Header, Motion, Pose, Reason, Refusals, SECOND, Scene, Seq, Stamp, State, Vec3,
};

use super::*;
use crate::heard::{Entry, Sample};

/// Keeps whether each layout that comes is to be seen at once.
#[derive(Clone, Default)]
struct Collected(Arc<Mutex<Vec<bool>>>);

impl LogSink for Collected {
    fn send(&self, message: LogMsg) {
        if let LogMsg::BlueprintActivationCommand(command) = message {
            assert!(command.make_default);
            self.0.lock().unwrap().push(command.make_active);
        }
    }

    fn flush_blocking(&self, _: Duration) -> Result<(), SinkFlushError> {
        Ok(())
    }
}

fn heard(sample: Sample) -> Arc<Heard> {
    Arc::new(Heard {
        at: Stamp(SECOND),
        session_time: Stamp(SECOND),
        tick: 0,
        entry: Entry::Sample(sample),
    })
}

fn state(seq: u64, arrivals: Option<Arrivals>) -> Arc<Heard> {
    let body = State {
        trial: 0,
        trial_start: 0,
        joints: [Finite(0.0); 7],
        joint_velocities: [Finite(0.0); 7],
        links: [Pose::default(); 8],
        tool: Pose::default(),
        tool_velocity: Vec3::ZERO,
        clearance: None,
        closest: None,
        motion: Motion::Held(Reason::NoTrial),
        at_rest: true,
        obeys: None,
        arrivals,
        refused: Refusals::default(),
    };
    let seq = Seq(seq);
    let header = Header {
        seq,
        ..Header::default()
    };
    heard(Sample::State(Box::new(Envelope { header, body })))
}

fn scene(goal: Vec3) -> Arc<Heard> {
    let body = Scene {
        obstacles: Vec::new(),
        bodies: Vec::new(),
        start: Vec3::new(0.4, 0.0, 0.2),
        goal,
        goal_tolerance: Finite(0.01),
        workspace: Aabb {
            min: Vec3::new(0.2, -0.5, 0.0),
            max: Vec3::new(0.8, 0.5, 0.8),
        },
        period: SECOND / 10,
    };
    let header = Header::default();
    heard(Sample::Scene(Envelope { header, body }))
}

#[test]
fn the_layout_fits_once_the_task_is_known_and_later_leaves_alone_what_a_person_moved() {
    let (tell, _told) = bounded(1);
    let show = Show {
        timing: Timing::default(),
        provenance: Provenance {
            robot: "panda".parse().unwrap(),
            build: "test".into(),
            epoch_unix_nanos: 0,
        },
        purpose: Purpose::Live,
        meshes: None,
    };
    let outlet = Collected::default();
    let mut sink = StreamSink::new(Arc::new(outlet.clone()), LIVE_BATCH, &show, Arc::new(Shared::new(tell)));
    let mut sent_after = |heard: Arc<Heard>| {
        sink.take(&heard).unwrap();
        // A recording passes on what it is given on a thread of its own; this waits for it.
        sink.close().unwrap();
        std::mem::take(&mut *outlet.0.lock().unwrap())
    };
    let goal = Vec3::new(0.4, 0.5, 0.2);
    assert_eq!(sent_after(state(1, None)), [true], "something is shown at once");
    assert_eq!(sent_after(scene(goal)), [true], "and then what fits");
    assert!(
        sent_after(scene(goal)).is_empty(),
        "a scene is repeated, a layout is not"
    );
    let elsewhere = Vec3::new(-0.4, 0.5, 0.2);
    assert_eq!(sent_after(scene(elsewhere)), [false]);
    assert_eq!(sent_after(state(2, Some(Arrivals::default()))), [false]);
    assert!(sent_after(state(3, Some(Arrivals::default()))).is_empty());
}
