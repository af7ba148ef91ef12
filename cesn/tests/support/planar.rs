//! The planar task: around two obstacles, above the first and below the second, by a family of paths.

#![allow(dead_code, reason = "each test binary and the bench use their own part")]

use tandem_cesn::Demonstration;

pub(crate) const STEPS: u32 = 84;
pub(crate) const CHECKPOINT: usize = 41;
pub(crate) const PERIOD_S: f64 = 0.1;
pub(crate) const TRAINED: [f64; 3] = [0.08, 0.11, 0.14];
pub(crate) const INSIDE: [f64; 10] = [0.083, 0.087, 0.09, 0.094, 0.1, 0.105, 0.118, 0.122, 0.128, 0.135];
pub(crate) const OUTSIDE: [f64; 4] = [0.05, 0.06, 0.165, 0.18];

/// The position at `step` on the path of amplitude `a`, in metres.
///
/// `s = 10τ³ − 15τ⁴ + 6τ⁵`, `x = 0.6 s`, `y = a exp(−((x−.28)/.07)²) − a k exp(−((x−.46)/.06)²)` with
/// `k = .8 + 2 (a − .11)`, and only then `x += .12 (a − .11) sin 2πs`.
pub(crate) fn position(a: f64, step: u32) -> [f64; 2] {
    let tau = f64::from(step) / f64::from(STEPS - 1);
    let s = tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
    let x = 0.6 * s;
    let bump = |centre: f64, width: f64| libm::exp(-((x - centre) / width) * ((x - centre) / width));
    let k = 0.8 + 2.0 * (a - 0.11);
    let y = a * bump(0.28, 0.07) - a * k * bump(0.46, 0.06);
    [x + 0.12 * (a - 0.11) * libm::sin(std::f64::consts::TAU * s), y]
}

/// The position to the nanometre, as the shipped files hold it.
pub(crate) fn rounded(a: f64, step: u32) -> [f64; 2] {
    position(a, step).map(|metres| (metres * 1e9).round() / 1e9 + 0.0)
}

pub(crate) fn checkpoint(a: f64) -> [f64; 2] {
    rounded(a, 41)
}

pub(crate) fn demonstration(a: f64) -> Demonstration {
    let [x, y] = checkpoint(a);
    let outputs = (0..STEPS).flat_map(|step| rounded(a, step)).collect();
    let context = [("context_x_m", x), ("context_y_m", y)];
    Demonstration::new(
        &format!("planar {a}"),
        &context,
        &["x_m", "y_m"],
        outputs,
        Some(PERIOD_S),
    )
    .expect("finite")
}

pub(crate) fn demonstrations() -> Vec<Demonstration> {
    TRAINED.map(demonstration).to_vec()
}

/// `a · exp(−((t − ½)/.15)²/2)` over `steps` steps, conditioned on its height in the middle.
pub(crate) fn bell(a: f64, steps: u32) -> Demonstration {
    let at = |step: u32| (f64::from(step) / f64::from(steps - 1) - 0.5) / 0.15;
    let outputs = (0..steps)
        .map(|step| a * libm::exp(-0.5 * at(step) * at(step)))
        .collect();
    Demonstration::new(
        &format!("bell {a}"),
        &[("context_height", a)],
        &["height"],
        outputs,
        None,
    )
    .expect("finite")
}
