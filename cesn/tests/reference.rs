//! Agreement with reference numbers that were solved in 60-digit arithmetic.
//!
//! `data/reference.json` holds five regressions: ordinary least squares, ridge with constant contexts, fewer
//! samples than weights, a free bias with a washout, and state feedback. Each array has to agree to 1e-9 of its
//! largest magnitude; what goes through the closed form of leaving one demonstration out, to 1e-8.

use serde_json::Value;
use tandem_cesn::regression::Fit;
use tandem_cesn::samples::{Samples, Sequence};
use tandem_cesn::{Bias, Reservoir, Ridge, student_t_quantile};

const TOLERANCE: f64 = 1e-9;
const LEFT_OUT_TOLERANCE: f64 = 1e-8;

fn file() -> Value {
    let file: Value = serde_json::from_str(include_str!("data/reference.json")).expect("the file is JSON");
    assert_eq!(file["format"], "cesnplus-reference-1");
    file
}

/// All numbers in a value, however deeply nested, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

fn count(value: &Value) -> usize {
    usize::try_from(value.as_u64().expect("a count")).expect("it fits")
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

#[track_caller]
fn assert_close(what: &str, found: &[f64], expected: &Value, tolerance: f64) {
    let expected = numbers(expected);
    assert_eq!(found.len(), expected.len(), "{what}: lengths");
    let scale = expected.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let error = (found - expected).abs() / scale;
        assert!(
            error <= tolerance,
            "{what}[{i}]: {found} is not {expected} (off by {error:.1e} of the largest)"
        );
    }
}

/// One case with its reservoir, samples and fit.
struct Case {
    json: Value,
    name: String,
    reservoir: Reservoir,
    samples: Samples,
    fit: Fit,
}

impl Case {
    fn new(json: Value) -> Self {
        let name = json["name"].as_str().expect("a name").to_owned();
        let (units, inputs, outputs) = (count(&json["N"]), count(&json["n_in"]), count(&json["n_out"]));
        let (w, w_in) = (numbers(&json["W"]), numbers(&json["Win"]));
        let reservoir = Reservoir::from_dense(units, inputs, &w, &w_in, number(&json["leak"])).expect("legal");
        let sequences: Vec<Sequence> = json["demos"]
            .as_array()
            .expect("a list")
            .iter()
            .enumerate()
            .map(|(demonstration, demo)| Sequence {
                inputs: numbers(&demo["inputs"]),
                targets: numbers(&demo["targets"]),
                weight: 1.0,
                demonstration,
                from: 0,
            })
            .collect();
        let washout = count(&json["washout"]);
        let samples = Samples::harvest(&reservoir, &sequences, outputs, washout).expect("legal");
        let ridge = match number(&json["ridge"]) {
            0.0 => Ridge::None,
            lambda => Ridge::Fixed { lambda },
        };
        let fit = Fit::new(&samples, ridge, bias(&json)).expect("solvable");
        Self {
            json,
            name,
            reservoir,
            samples,
            fit,
        }
    }

    fn quantile(&self) -> f64 {
        let p = 0.5 * (1.0 + number(&self.json["confidence"]));
        student_t_quantile(self.fit.nu, p).expect("legal")
    }

    /// `y` and `h` of a state.
    fn predict(&self, state: &[f64]) -> (Vec<f64>, f64) {
        let z: Vec<f64> = std::iter::once(1.0).chain(state.iter().copied()).collect();
        let dot = |row: &[f64]| row.iter().zip(&z).map(|(w, z)| w * z).sum::<f64>();
        (
            self.fit.w_out.chunks_exact(z.len()).map(dot).collect(),
            self.fit.leverage(state).expect("it fits"),
        )
    }

    #[track_caller]
    fn check(&self, what: &str, found: &[f64]) {
        self.check_to(what, found, TOLERANCE);
    }

    #[track_caller]
    fn check_to(&self, what: &str, found: &[f64], tolerance: f64) {
        assert_close(&format!("{}: {what}", self.name), found, &self.json[what], tolerance);
    }
}

fn bias(json: &Value) -> Bias {
    if json["penalise_bias"] == true {
        Bias::Penalised
    } else {
        Bias::Free
    }
}

fn cases() -> Vec<Case> {
    let mut file = file();
    let cases = file["cases"]
        .as_array_mut()
        .expect("a list")
        .drain(..)
        .map(Case::new)
        .collect::<Vec<_>>();
    assert_eq!(cases.len(), 5, "every case of the file");
    cases
}

/// Runs a reservoir along `inputs` and returns the state after each.
fn states(reservoir: &Reservoir, inputs: &[f64]) -> Vec<Vec<f64>> {
    let mut state = reservoir.rest();
    let mut step = |input: &[f64]| {
        reservoir.update(&mut state, input);
        state.activations().to_vec()
    };
    inputs.chunks_exact(reservoir.inputs()).map(&mut step).collect()
}

#[test]
fn the_states_of_every_demonstration_agree() {
    for case in cases() {
        let washout = count(&case.json["washout"]);
        let mut sample = 0;
        for (d, demo) in case.json["demos"].as_array().expect("a list").iter().enumerate() {
            let states = states(&case.reservoir, &numbers(&demo["inputs"]));
            let what = format!("{}: states of demonstration {d}", case.name);
            assert_close(&what, &states.concat(), &demo["states"], TOLERANCE);
            for state in &states[washout..] {
                let row = case.samples.row(sample).expect("it was harvested");
                assert_eq!(&row[1..], state, "harvested side by side or alone: the same bits");
                sample += 1;
            }
        }
        assert_eq!(sample, case.samples.rows());
    }
}

#[test]
fn the_regression_agrees() {
    for case in cases() {
        let (p, fit) = (case.samples.columns(), &case.fit);
        assert_eq!(
            (case.samples.rows(), p),
            (count(&case.json["n"]), count(&case.json["p"]))
        );
        let lower = case.samples.gram();
        let whole = (0..p * p).map(|k| lower[(k / p).min(k % p) * p + (k / p).max(k % p)]);
        case.check("gram", &whole.collect::<Vec<_>>());
        case.check("Wout", &fit.w_out);
        case.check("rss", &fit.rss);
        case.check("tr_H", &[fit.edf]);
        case.check("nu", &[fit.nu]);
        case.check("s", &fit.s);
        case.check("t_quantile", &[case.quantile()]);
        case.check("leverage_train", &fit.leverages);
    }
}

#[test]
fn leaving_demonstrations_out_agrees() {
    for case in cases() {
        let left_out = case.fit.left_out.as_ref().expect("regular");
        case.check_to("lodo_residuals", &left_out.residuals, LEFT_OUT_TOLERANCE);
        case.check_to("lodo_leverage", &left_out.leverages, LEFT_OUT_TOLERANCE);
        case.check_to("s_lodo", &left_out.s, LEFT_OUT_TOLERANCE);
        let outputs = case.fit.s.len();
        let mean_square = |k: usize| {
            left_out
                .residuals
                .iter()
                .skip(k)
                .step_by(outputs)
                .map(|e| e * e)
                .sum::<f64>()
        };
        let rmse: Vec<f64> = (0..outputs)
            .map(|k| (mean_square(k) / case.samples.rows() as f64).sqrt())
            .collect();
        case.check_to("lodo_rmse", &rmse, LEFT_OUT_TOLERANCE);
    }
}

#[test]
fn the_evidence_agrees_where_it_is_defined() {
    let mut compared = 0;
    for case in cases().iter().filter(|case| !case.json["log_evidence"].is_null()) {
        case.check(
            "log_evidence",
            &case.samples.evidence(bias(&case.json)).at(case.fit.lambda),
        );
        compared += 1;
    }
    assert_eq!(compared, 3);
}

#[test]
fn unseen_movements_agree() {
    for case in cases() {
        let (outputs, quantile) = (case.fit.s.len(), case.quantile());
        for (i, test) in case.json["tests"].as_array().expect("a list").iter().enumerate() {
            let states = states(&case.reservoir, &numbers(&test["inputs"]));
            let predicted: Vec<_> = states.iter().map(|state| case.predict(state)).collect();
            let means: Vec<f64> = predicted.iter().flat_map(|(mean, _)| mean.clone()).collect();
            let leverages: Vec<f64> = predicted.iter().map(|(_, h)| *h).collect();
            let width = |h: f64, k: usize| quantile * case.fit.s[k] * h.sqrt();
            let rows = |more: f64| {
                leverages
                    .iter()
                    .flat_map(move |h| (0..outputs).map(move |k| width(h + more, k)))
            };
            let check = |what: &str, found: &[f64]| {
                assert_close(
                    &format!("{}: test {i}: {what}", case.name),
                    found,
                    &test[what],
                    TOLERANCE,
                );
            };
            check("states", &states.concat());
            check("outputs", &means);
            check("leverage", &leverages);
            check("pi_half", &rows(1.0).collect::<Vec<_>>());
            check("ci_half", &rows(0.0).collect::<Vec<_>>());
        }
    }
}

#[test]
fn the_closed_loop_agrees() {
    let case = cases()
        .into_iter()
        .find(|case| case.name == "E_feedback")
        .expect("it is in the file");
    for run in case.json["closed_loop"].as_array().expect("a list") {
        let (context, mut before) = (number(&run["context"]), number(&run["y0"]));
        let mut state = case.reservoir.rest();
        let outputs: Vec<f64> = (0..run["outputs"].as_array().expect("a list").len())
            .map(|_| {
                case.reservoir.update(&mut state, &[context, before]);
                before = case.predict(state.activations()).0[0];
                before
            })
            .collect();
        assert_close(
            &format!("closed loop from {context}"),
            &outputs,
            &run["outputs"],
            TOLERANCE,
        );
    }
}

#[test]
fn the_quantiles_agree() {
    let file = file();
    let rows = file["t_quantiles"].as_array().expect("a list");
    assert_eq!(rows.len(), 40);
    for row in rows {
        let row = numbers(row);
        let found = student_t_quantile(row[0], row[1]).expect("legal");
        assert!(
            (found / row[2] - 1.0).abs() < 1e-11,
            "ν = {}, p = {}: {found} is not {}",
            row[0],
            row[1],
            row[2]
        );
    }
}
