//! What a predictor says: its forecasts, and what it proposes to be guided by.

use tandem_wire as wire;

use super::super::hex;
use super::super::schemas::{Forecast, ForecastPoint, Guidance, Proposal};
use super::super::standard::vector;

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
            model_sha256: hex(&forecast.model),
            first_step: forecast.first_step,
            period_s: wire::seconds(forecast.period),
            points: forecast.points.iter().map(point).collect(),
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
