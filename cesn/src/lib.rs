//! CESN+: a forecaster of movements that says how sure it is.
//!
//! A *conditional echo state network* is a fixed random recurrent network (the reservoir) driven by a constant
//! context, such as the point where a movement passed its checkpoint. Its transient from rest is the clock; a
//! linear readout, trained by ridge regression on a few demonstrations, turns its state into positions. The *plus*
//! is a prediction interval from the same regression, which widens where the context is unlike the demonstrations.
//!
//! ```text
//! x(t) = (1 − a) x(t−1) + a tanh(W_in [1; u(t)] + W x(t−1))       x(0) = 0
//! y(t) = W_out [1; x(t)]                                          W_out = (A⁻¹ ZᵀY)ᵀ,  A = ZᵀZ + λI
//! half-width = t_{(1+conf)/2, ν} · s · √(1 + zᵀ A⁻¹ z)             z = [1; x]
//! ```
//!
//! The state equation is that of leaky echo state networks (Jaeger 2001; Lukoševičius 2012), the interval that of
//! linear regression, both as the CESN+ paper combines them. What that paper leaves open is settled here: λ by its
//! marginal likelihood, effective degrees of freedom, one common scale for the context, copies of the
//! demonstrations with a jittered context, and a spread that also covers leaving a demonstration out.
//!
//! # What it refuses to know
//!
//! Robots, networks, clocks, files, who drives, and what an interval is used for. It takes text and numbers and
//! gives numbers and bytes; it never prints, and its warnings are values.
//!
//! # The same numbers everywhere
//!
//! A forecast is made of basic operations and square roots in a written order, so one model file gives the same
//! bits on every machine, whatever its vector unit. Training goes through `faer`, whose kernels depend on the
//! processor: two machines may train models that differ in their last bits, and the model's hash says so.
//!
//! # Where to start reading
//!
//! [`Model::train`] and [`Model::forecast`] are the whole story in two calls. `train` goes through the parts in
//! order: `seeded` (weights), `samples` and `update` (running the reservoir along the demonstrations), `regression`
//! with `evidence` (the readout and its ridge), `leave_out` and `interval` (how wide). Then come `forecast` and
//! `stepper` (running a model) and `artefact` (the file).
//!
//! ```
//! use tandem_cesn::{Demonstration, Model, Settings};
//!
//! let path = |height: f64| (0..60).map(|t| height * f64::from(t) / 59.0).collect();
//! let demonstration = |height| {
//!     let context = [("context_height_m", height)];
//!     Demonstration::new("line", &context, &["y_m"], path(height), Some(0.1))
//! };
//! let demonstrations = [demonstration(0.8)?, demonstration(1.0)?, demonstration(1.2)?];
//! let settings = Settings { units: 100, checkpoint_step: 20, ..Settings::default() };
//! let model = Model::train(&demonstrations, &settings)?;
//!
//! let known = model.forecast(&[1.0], 21)?;
//! let unknown = model.forecast(&[3.0], 21)?;
//! assert!((known.mean(59).unwrap()[0] - 1.0).abs() < 0.01);
//! assert!(unknown.mean_ratio() > known.mean_ratio());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod artefact;
mod csv;
pub mod demonstration;
pub mod evidence;
pub mod forecast;
pub mod interval;
pub mod leave_out;
pub mod model;
pub mod quantile;
mod random;
mod readout;
pub mod regression;
pub mod replan;
pub mod reservoir;
pub mod samples;
mod scale;
mod seeded;
pub mod settings;
mod stepper;
mod tanh;
pub mod train;
mod triangle;
mod update;

pub use artefact::ArtefactError;
pub use demonstration::{Demonstration, DemonstrationError};
pub use forecast::{Forecast, ForecastError, Forecaster};
pub use interval::{Calibration, Interval};
pub use model::{Model, Provenance, Source};
pub use quantile::student_t_quantile;
pub use regression::FitError;
pub use reservoir::{Reservoir, ReservoirError};
pub use scale::Scale;
pub use seeded::Shape;
pub use settings::{Bias, Feedback, IntervalKind, Jitter, Ridge, Settings, SettingsError, Warning};
pub use stepper::{Fed, Step, Stepper};
pub use train::TrainError;
