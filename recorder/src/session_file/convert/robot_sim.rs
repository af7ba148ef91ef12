//! What a robot says: its state and its surroundings.

use tandem_wire as wire;

use super::super::schemas::{Body, Clearance, Cylinder, Obeyed, Scene, State};
use super::super::standard::{frame_name, pose, vector};

impl From<&wire::Envelope<wire::State>> for State {
    fn from(message: &wire::Envelope<wire::State>) -> Self {
        let state = &message.body;
        let obeyed = |obeyed: wire::Obeyed| Obeyed {
            setpoint: obeyed.id.into(),
            arrived_ns: obeyed.arrived.0,
            moved_ns: obeyed.moved.0,
        };
        Self {
            header: (&message.header).into(),
            trial: state.trial,
            trial_start_tick: state.trial_start,
            joints_rad: state.joints.iter().map(|angle| angle.0).collect(),
            joint_velocities_rad_s: state.joint_velocities.iter().map(|speed| speed.0).collect(),
            links: state.links.iter().map(pose).collect(),
            tool: pose(&state.tool),
            tool_velocity_m_s: vector(state.tool_velocity),
            clearance: state.clearance.map(Into::into),
            closest_since_last: state.closest.map(Into::into),
            motion: state.motion.into(),
            at_rest: state.at_rest,
            obeys: state.obeys.map(obeyed),
            setpoint_success_rate: state.arrivals.map(|arrivals| arrivals.success_rate.0),
            setpoints_missed: state.arrivals.map(|arrivals| arrivals.missed),
            setpoints_missed_longest: state.arrivals.map(|arrivals| arrivals.longest),
            refused: (&state.refused).into(),
        }
    }
}

impl From<wire::Clearance> for Clearance {
    fn from(clearance: wire::Clearance) -> Self {
        Self {
            distance_m: clearance.distance.0,
            body: clearance.body.into(),
            obstacle: clearance.obstacle.into(),
        }
    }
}

impl From<&wire::Envelope<wire::Scene>> for Scene {
    fn from(message: &wire::Envelope<wire::Scene>) -> Self {
        let scene = &message.body;
        let cylinder = |cylinder: &wire::Cylinder| Cylinder {
            foot_m: vector(cylinder.foot),
            radius_m: cylinder.radius.0,
            height_m: cylinder.height.0,
        };
        let body = |body: &wire::Body| Body {
            frame: frame_name(body.frame),
            from_m: vector(body.from),
            to_m: vector(body.to),
            radius_m: body.radius.0,
        };
        Self {
            header: (&message.header).into(),
            obstacles: scene.obstacles.iter().map(cylinder).collect(),
            bodies: scene.bodies.iter().map(body).collect(),
            start_m: vector(scene.start),
            goal_m: vector(scene.goal),
            goal_tolerance_m: scene.goal_tolerance.0,
            workspace_min_m: vector(scene.workspace.min),
            workspace_max_m: vector(scene.workspace.max),
            control_period_s: wire::seconds(scene.period),
        }
    }
}
