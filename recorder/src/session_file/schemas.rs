//! Our own messages as protobuf that describes itself: units in the field names, reasons in words.
//!
//! The fields are numbered in the order they stand here, and every file carries its own description, so a file stays
//! readable whatever becomes of these structs. Vectors and poses are Foxglove's, so that tools know them.

#![expect(
    clippy::disallowed_types,
    reason = "the derive lists schemas it has seen in a set whose order it never asks"
)]

use foxglove::Encode;
use foxglove::messages::{Pose, Vector3};

#[derive(Encode)]
pub(super) struct Header {
    pub(super) tick: u32,
    pub(super) session: u64,
    pub(super) sequence: u64,
    pub(super) sent_ns: u64,
}

#[derive(Encode)]
pub(super) struct MessageId {
    pub(super) session: u64,
    pub(super) sequence: u64,
}

#[derive(Encode)]
pub(super) struct Motion {
    pub(super) permitted: bool,
    pub(super) press: u32,
    pub(super) held_because: String,
}

#[derive(Encode)]
pub(super) struct Command {
    pub(super) header: Header,
    pub(super) velocity_m_s: Vector3,
    pub(super) deadman_held: bool,
    pub(super) deadman_press: u32,
    pub(super) seen_state: Option<MessageId>,
}

#[derive(Encode)]
pub(super) struct Guidance {
    pub(super) forecast_number: u32,
    pub(super) phase_steps: f64,
    pub(super) last_step: u32,
    pub(super) velocity_m_s: Vector3,
    pub(super) position_m: Vector3,
    pub(super) half_width_m: Vector3,
    pub(super) ratio_to_training: f64,
    pub(super) ratio_high: f64,
}

#[derive(Encode)]
pub(super) struct Proposal {
    pub(super) header: Header,
    pub(super) seen_state: Option<MessageId>,
    pub(super) guidance: Option<Guidance>,
}

#[derive(Encode)]
pub(super) struct ForecastPoint {
    pub(super) position_m: Vector3,
    pub(super) half_width_m: Vector3,
    pub(super) ratio_to_training: f64,
}

#[derive(Encode)]
pub(super) struct Forecast {
    pub(super) header: Header,
    pub(super) number: u32,
    pub(super) context_m: Vec<f64>,
    pub(super) model_sha256: String,
    pub(super) first_step: u32,
    pub(super) period_s: f64,
    pub(super) points: Vec<ForecastPoint>,
}

#[derive(Clone, Copy, Encode)]
pub(super) enum Law {
    Adaptive,
    Fixed,
    Human,
    Robot,
    Constant,
    Attentive,
}

#[derive(Encode)]
pub(super) struct Used {
    pub(super) session: u64,
    pub(super) sequence: u64,
    pub(super) sent_ns: u64,
    pub(super) age_ms: f64,
    pub(super) seen_state: Option<MessageId>,
}

#[derive(Encode)]
pub(super) struct Refusals {
    pub(super) count: u64,
    pub(super) last: String,
}

#[derive(Encode)]
pub(super) struct Setpoint {
    pub(super) header: Header,
    pub(super) velocity_m_s: Vector3,
    pub(super) motion: Motion,
    pub(super) law: Law,
    pub(super) constant_weight: Option<f64>,
    pub(super) human_weight: f64,
    pub(super) human_velocity_m_s: Vector3,
    pub(super) guidance: Option<Guidance>,
    pub(super) blended_velocity_m_s: Vector3,
    pub(super) limited_by_workspace: bool,
    pub(super) limited_by_speed: bool,
    pub(super) limited_by_acceleration: bool,
    pub(super) used_command: Option<Used>,
    pub(super) used_proposal: Option<Used>,
    pub(super) seen_state: Option<MessageId>,
    pub(super) refused: Refusals,
    pub(super) lease: Option<Lease>,
    pub(super) asked_by: Option<String>,
}

#[derive(Encode)]
pub(super) struct Lease {
    pub(super) number: u32,
    pub(super) holder_session: u64,
    pub(super) name: String,
}

#[derive(Encode)]
pub(super) struct Claim {
    pub(super) header: Header,
    pub(super) wish: Wish,
    pub(super) name: String,
}

#[derive(Clone, Copy, Encode)]
pub(super) enum Wish {
    Drive,
    Release,
    TakeOver,
}

#[derive(Encode)]
pub(super) struct Emergency {
    pub(super) header: Header,
    /// The stop that ends; of a stop, nothing.
    pub(super) clears: Option<MessageId>,
    pub(super) by: String,
}

#[derive(Encode)]
pub(super) struct Clearance {
    pub(super) distance_m: f64,
    pub(super) body: u32,
    pub(super) obstacle: u32,
}

#[derive(Encode)]
pub(super) struct Obeyed {
    pub(super) setpoint: MessageId,
    pub(super) arrived_ns: u64,
    pub(super) moved_ns: u64,
}

#[derive(Encode)]
pub(super) struct State {
    pub(super) header: Header,
    pub(super) trial: u32,
    pub(super) trial_start_tick: u32,
    pub(super) joints_rad: Vec<f64>,
    pub(super) joint_velocities_rad_s: Vec<f64>,
    pub(super) links: Vec<Pose>,
    pub(super) tool: Pose,
    pub(super) tool_velocity_m_s: Vector3,
    pub(super) clearance: Option<Clearance>,
    pub(super) closest_since_last: Option<Clearance>,
    pub(super) motion: Motion,
    pub(super) at_rest: bool,
    pub(super) obeys: Option<Obeyed>,
    pub(super) setpoint_success_rate: Option<f64>,
    pub(super) setpoints_missed: Option<u32>,
    pub(super) setpoints_missed_longest: Option<u32>,
    pub(super) refused: Refusals,
}

#[derive(Encode)]
pub(super) struct Cylinder {
    pub(super) foot_m: Vector3,
    pub(super) radius_m: f64,
    pub(super) height_m: f64,
}

#[derive(Encode)]
pub(super) struct Body {
    pub(super) frame: String,
    pub(super) from_m: Vector3,
    pub(super) to_m: Vector3,
    pub(super) radius_m: f64,
}

#[derive(Encode)]
pub(super) struct Scene {
    pub(super) header: Header,
    pub(super) obstacles: Vec<Cylinder>,
    pub(super) bodies: Vec<Body>,
    pub(super) start_m: Vector3,
    pub(super) goal_m: Vector3,
    pub(super) goal_tolerance_m: f64,
    pub(super) workspace_min_m: Vector3,
    pub(super) workspace_max_m: Vector3,
    pub(super) control_period_s: f64,
}

#[derive(Encode)]
pub(super) struct Trial {
    pub(super) header: Header,
    pub(super) number: u32,
    pub(super) begins: bool,
    pub(super) label: String,
    pub(super) outcome: String,
}

#[derive(Encode)]
pub(super) struct StreamCount {
    pub(super) topic: String,
    pub(super) received: u64,
    pub(super) missed: u64,
    pub(super) late: u64,
    pub(super) repeated: u64,
    pub(super) unreadable: u64,
    pub(super) sender_runs: u64,
}

#[derive(Encode)]
pub(super) struct JournalCount {
    pub(super) node: String,
    pub(super) entries: u64,
    pub(super) lost_by_writer: u64,
    pub(super) missed: u64,
}

#[derive(Encode)]
pub(super) struct ChannelDrops {
    pub(super) channel: String,
    pub(super) session_file: u64,
    pub(super) views: u64,
}

#[derive(Encode)]
pub(super) struct Gap {
    pub(super) topic: String,
    pub(super) session: u64,
    pub(super) first: u64,
    pub(super) last: u64,
}

#[derive(Encode)]
pub(super) struct ClockOffset {
    pub(super) node: String,
    pub(super) session: u64,
    pub(super) least_one_way_ns: i64,
    pub(super) mean_one_way_ns: i64,
    pub(super) most_one_way_ns: i64,
    pub(super) messages: u64,
}

#[derive(Encode)]
pub(super) struct PeerClock {
    pub(super) node: String,
    pub(super) session: u64,
    pub(super) offset_ns: i64,
    pub(super) uncertainty_ns: u64,
    pub(super) round_trip_ns: u64,
    pub(super) round_trip_median_ns: u64,
    pub(super) round_trip_worst_ns: u64,
    pub(super) samples: u32,
    pub(super) steps: u32,
    pub(super) skew_ns: i64,
    pub(super) is_skewed: bool,
}

#[derive(Encode)]
pub(super) struct ClockReport {
    pub(super) header: Header,
    pub(super) node: String,
    pub(super) peers: Vec<PeerClock>,
}

#[derive(Encode)]
pub(super) struct Hop {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) p50_ms: f64,
    pub(super) p95_ms: f64,
    pub(super) p99_ms: f64,
    pub(super) worst_ms: f64,
    pub(super) recent_p50_ms: f64,
    pub(super) recent_p95_ms: f64,
    pub(super) recent_p99_ms: f64,
    pub(super) uncertainty_ms: f64,
}

#[derive(Encode)]
pub(super) struct Counts {
    pub(super) streams: Vec<StreamCount>,
    pub(super) journals: Vec<JournalCount>,
    pub(super) dropped_before_session_file: u64,
    pub(super) dropped_before_views: u64,
    pub(super) drops: Vec<ChannelDrops>,
    pub(super) gaps: Vec<Gap>,
    pub(super) gaps_forgotten: u64,
    pub(super) clocks: Vec<ClockOffset>,
    pub(super) hops: Vec<Hop>,
}
