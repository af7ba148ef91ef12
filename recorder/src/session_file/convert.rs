//! Our messages in our own protobuf: every field, under the name and in the unit that the schema promises.

use std::collections::BTreeMap;

use tandem_wire as wire;

use super::schemas::{
    Body, ChannelDrops, Claim, Clearance, ClockOffset, ClockReport, Command, Counts, Cylinder, Emergency, Forecast,
    ForecastPoint, Gap, Guidance, Header, Hop, JournalCount, Law, Lease, MessageId, Motion, Obeyed, PeerClock,
    Proposal, Refusals, Scene, Setpoint, State, StreamCount, Trial, Used, Wish,
};
use super::standard::{frame_name, pose, vector};
use crate::budget::HopBudget;
use crate::sinks::Drops;
use crate::tally;

impl From<&wire::Header> for Header {
    fn from(header: &wire::Header) -> Self {
        Self {
            tick: header.tick,
            session: header.session.0,
            sequence: header.seq.0,
            sent_ns: header.sent.0,
        }
    }
}

impl From<wire::MessageId> for MessageId {
    fn from(id: wire::MessageId) -> Self {
        Self {
            session: id.session.0,
            sequence: id.seq.0,
        }
    }
}

impl From<wire::Motion> for Motion {
    fn from(motion: wire::Motion) -> Self {
        let press = match motion {
            wire::Motion::Permitted { press } => press,
            wire::Motion::Held(_) => 0,
        };
        Self {
            permitted: motion.is_permitted(),
            press,
            held_because: motion.reason().map(|reason| reason.to_string()).unwrap_or_default(),
        }
    }
}

impl From<&wire::Refusals> for Refusals {
    fn from(refused: &wire::Refusals) -> Self {
        Self {
            count: refused.count,
            last: refused.last.map(|why| why.to_string()).unwrap_or_default(),
        }
    }
}

impl From<wire::Used> for Used {
    fn from(used: wire::Used) -> Self {
        Self {
            session: used.id.session.0,
            sequence: used.id.seq.0,
            sent_ns: used.sent.0,
            age_ms: wire::seconds(used.age) * 1e3,
        }
    }
}

impl From<wire::Guidance> for Guidance {
    fn from(guidance: wire::Guidance) -> Self {
        Self {
            forecast_number: guidance.forecast,
            phase_steps: guidance.phase.0,
            last_step: guidance.last_step,
            velocity_m_s: vector(guidance.velocity),
            position_m: vector(guidance.position),
            half_width_m: vector(guidance.half_width),
            ratio_to_training: guidance.ratio.0,
            ratio_high: guidance.ratio_high.0,
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

impl From<&wire::Envelope<wire::Command>> for Command {
    fn from(message: &wire::Envelope<wire::Command>) -> Self {
        let command = &message.body;
        let press = match command.deadman {
            wire::Deadman::Released => 0,
            wire::Deadman::Held { press } => press,
        };
        Self {
            header: (&message.header).into(),
            velocity_m_s: vector(command.velocity),
            deadman_held: command.deadman != wire::Deadman::Released,
            deadman_press: press,
            seen_state: command.seen.map(Into::into),
        }
    }
}

impl From<&wire::Envelope<wire::Proposal>> for Proposal {
    fn from(message: &wire::Envelope<wire::Proposal>) -> Self {
        Self {
            header: (&message.header).into(),
            seen_state: message.body.seen.map(Into::into),
            guidance: message.body.guidance.map(Into::into),
        }
    }
}

impl From<&wire::Envelope<wire::Forecast>> for Forecast {
    fn from(message: &wire::Envelope<wire::Forecast>) -> Self {
        let forecast = &message.body;
        let point = |point: &wire::ForecastPoint| ForecastPoint {
            position_m: vector(point.position),
            half_width_m: vector(point.half_width),
            ratio_to_training: point.ratio.0,
        };
        Self {
            header: (&message.header).into(),
            number: forecast.number,
            context_m: forecast.context.iter().map(|number| number.0).collect(),
            model_sha256: super::hex(&forecast.model),
            first_step: forecast.first_step,
            period_s: wire::seconds(forecast.period),
            points: forecast.points.iter().map(point).collect(),
        }
    }
}

impl From<&wire::Envelope<wire::Setpoint>> for Setpoint {
    fn from(message: &wire::Envelope<wire::Setpoint>) -> Self {
        let setpoint = &message.body;
        let (law, constant_weight) = match setpoint.law {
            wire::Law::Adaptive => (Law::Adaptive, None),
            wire::Law::Fixed => (Law::Fixed, None),
            wire::Law::Human => (Law::Human, None),
            wire::Law::Robot => (Law::Robot, None),
            wire::Law::Constant(weight) => (Law::Constant, Some(weight.0)),
            wire::Law::Attentive => (Law::Attentive, None),
        };
        Self {
            header: (&message.header).into(),
            velocity_m_s: vector(setpoint.velocity),
            motion: setpoint.motion.into(),
            law,
            constant_weight,
            human_weight: setpoint.weight.0,
            human_velocity_m_s: vector(setpoint.human),
            guidance: setpoint.guidance.map(Into::into),
            blended_velocity_m_s: vector(setpoint.blended),
            limited_by_workspace: setpoint.limited.workspace,
            limited_by_speed: setpoint.limited.speed,
            limited_by_acceleration: setpoint.limited.acceleration,
            used_command: setpoint.command.map(Into::into),
            used_proposal: setpoint.proposal.map(Into::into),
            seen_state: setpoint.seen.map(Into::into),
            refused: (&setpoint.refused).into(),
            lease: setpoint.lease.map(Into::into),
        }
    }
}

impl From<wire::Lease> for Lease {
    fn from(lease: wire::Lease) -> Self {
        Self {
            number: lease.number,
            holder_session: lease.holder.0,
            name: lease.name.to_string(),
        }
    }
}

impl From<&wire::Envelope<wire::Claim>> for Claim {
    fn from(message: &wire::Envelope<wire::Claim>) -> Self {
        Self {
            header: (&message.header).into(),
            wish: match message.body.wish {
                wire::Wish::Drive => Wish::Drive,
                wire::Wish::Release => Wish::Release,
                wire::Wish::TakeOver => Wish::TakeOver,
            },
            name: message.body.name.to_string(),
        }
    }
}

impl From<&wire::Envelope<wire::Emergency>> for Emergency {
    fn from(message: &wire::Envelope<wire::Emergency>) -> Self {
        let (clears, by) = match message.body {
            wire::Emergency::Stop { by } => (None, by),
            wire::Emergency::Clear { stop, by } => (Some(stop.into()), by),
        };
        Self {
            header: (&message.header).into(),
            clears,
            by: by.to_string(),
        }
    }
}

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

impl From<&wire::Envelope<wire::Trial>> for Trial {
    fn from(message: &wire::Envelope<wire::Trial>) -> Self {
        let (number, begins, label, outcome) = match &message.body {
            wire::Trial::Begin { number, label } => (*number, true, label.clone(), String::new()),
            wire::Trial::End { number, outcome } => (*number, false, String::new(), outcome.clone()),
        };
        Self {
            header: (&message.header).into(),
            number,
            begins,
            label,
            outcome,
        }
    }
}

impl Counts {
    pub(super) fn new(counts: &tally::Counts, drops: Drops) -> Self {
        let stream = |count: &tally::StreamCount| StreamCount {
            topic: count.topic.to_string(),
            received: count.received,
            missed: count.missed,
            late: count.late,
            repeated: count.repeated,
            unreadable: count.unreadable,
            sender_runs: count.runs,
        };
        let journal = |count: &tally::JournalCount| JournalCount {
            node: count.node.to_string(),
            entries: count.entries,
            lost_by_writer: count.lost,
            missed: count.missed,
        };
        Self {
            streams: counts.streams.iter().map(stream).collect(),
            journals: counts.journals.iter().map(journal).collect(),
            dropped_before_session_file: drops.session_file.total(),
            dropped_before_views: drops.views.total(),
            drops: channel_drops(drops),
            gaps: counts.gaps.iter().map(Into::into).collect(),
            gaps_forgotten: counts.gaps_forgotten,
            clocks: counts.clocks.iter().map(Into::into).collect(),
            hops: counts.hops.iter().map(Into::into).collect(),
        }
    }
}

fn channel_drops(drops: Drops) -> Vec<ChannelDrops> {
    let mut channels = BTreeMap::<String, (u64, u64)>::new();
    for (channel, number) in drops.session_file.by_channel() {
        channels.entry(channel).or_default().0 = number;
    }
    for (channel, number) in drops.views.by_channel() {
        channels.entry(channel).or_default().1 = number;
    }
    let row = |(channel, (session_file, views))| ChannelDrops {
        channel,
        session_file,
        views,
    };
    channels.into_iter().map(row).collect()
}

impl From<&tally::Gap> for Gap {
    fn from(gap: &tally::Gap) -> Self {
        Self {
            topic: gap.topic.to_string(),
            session: gap.session.0,
            first: gap.first,
            last: gap.last,
        }
    }
}

impl From<&tally::ClockOffset> for ClockOffset {
    fn from(clock: &tally::ClockOffset) -> Self {
        Self {
            node: clock.node.to_string(),
            session: clock.session.0,
            least_one_way_ns: clock.least,
            mean_one_way_ns: clock.mean,
            most_one_way_ns: clock.most,
            messages: clock.messages,
        }
    }
}

impl ClockReport {
    pub(super) fn new(node: wire::NodeName, message: &wire::Envelope<wire::ClockReport>) -> Self {
        Self {
            header: (&message.header).into(),
            node: node.to_string(),
            peers: message.body.peers.iter().map(Into::into).collect(),
        }
    }
}

impl From<&wire::PeerClock> for PeerClock {
    fn from(peer: &wire::PeerClock) -> Self {
        Self {
            node: peer.node.to_string(),
            session: peer.session.0,
            offset_ns: peer.offset,
            uncertainty_ns: peer.uncertainty,
            round_trip_ns: peer.round_trip,
            round_trip_median_ns: peer.round_trip_median,
            round_trip_worst_ns: peer.round_trip_worst,
            samples: peer.samples,
            steps: peer.steps,
            skew_ns: peer.skew,
            is_skewed: peer.is_skewed,
        }
    }
}

impl From<&HopBudget> for Hop {
    fn from(hop: &HopBudget) -> Self {
        let ms = |nanos: wire::Nanos| wire::seconds(nanos) * 1e3;
        Self {
            name: hop.hop.as_str().to_owned(),
            count: hop.count,
            p50_ms: ms(hop.all.p50),
            p95_ms: ms(hop.all.p95),
            p99_ms: ms(hop.all.p99),
            worst_ms: ms(hop.worst),
            recent_p50_ms: ms(hop.recent.p50),
            recent_p95_ms: ms(hop.recent.p95),
            recent_p99_ms: ms(hop.recent.p99),
            uncertainty_ms: ms(hop.uncertainty),
        }
    }
}
