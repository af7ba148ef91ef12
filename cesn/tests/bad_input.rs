//! Files and settings that cannot work, each with the sentence a user gets.

#[path = "support/planar.rs"]
mod planar;

use proptest::prelude::*;
use tandem_cesn::{Demonstration, Model, Ridge, Settings};

fn csv_error(text: &str) -> String {
    Demonstration::from_csv("a.csv", text).expect_err("refused").to_string()
}

fn train_error(demonstrations: &[Demonstration], settings: &Settings) -> String {
    Model::train(demonstrations, settings).expect_err("refused").to_string()
}

fn line(name: &str, context: f64, steps: usize) -> Demonstration {
    let outputs = (0..steps).map(|t| context * t as f64).collect();
    Demonstration::new(name, &[("context_a", context)], &["y"], outputs, None).expect("legal")
}

fn small() -> Settings {
    Settings {
        units: 30,
        checkpoint_step: 5,
        ..Settings::default()
    }
}

#[test]
fn a_well_formed_file_is_read_column_by_column() {
    let text = "step,y,context_a,time_s,x\r\n0,1.5,7,0,-1\r\n1,2.5,7,0.05,-2e-1\r\n\r\n2,3.5,7.0,0.1,0\r\n";
    let read = Demonstration::from_csv("a.csv", text).expect("well formed");
    assert_eq!(
        (read.context(), read.steps(), read.period_s()),
        (&[7.0][..], 3, Some(0.05))
    );
    assert_eq!(read.output_columns(), ["y", "x"]);
    assert_eq!(read.rows().collect::<Vec<_>>(), [[1.5, -1.0], [2.5, -0.2], [3.5, 0.0]]);
    let again = Demonstration::from_csv("b.csv", &read.to_csv()).expect("what we write we read");
    assert_eq!(again.rows().collect::<Vec<_>>(), read.rows().collect::<Vec<_>>());
}

#[test]
fn a_file_that_cannot_be_used_is_refused_with_file_line_and_column() {
    let cases = [
        ("", "a.csv: the file is empty; the first line must name the columns"),
        (
            "context_a,,y\n",
            "a.csv, line 1: column 2 has no name; name every column",
        ),
        (
            "context_a,y,y\n",
            "a.csv, line 1: column `y` appears twice; rename or remove one",
        ),
        (
            "x,y\n1,2\n1,2\n",
            "a.csv, line 1: no column begins with `context_`; add one for each number of the condition",
        ),
        (
            "context_a,step\n1,0\n1,1\n",
            "a.csv, line 1: no output column; beside `step`, `time_s` and `context_…` there must be one to predict",
        ),
        (
            "context_a,y\n1,2\n",
            "a.csv: 1 row(s) of numbers; a movement has at least two, one for each step",
        ),
        (
            "context_a,y\n1,2\n1\n",
            "a.csv, line 3: 1 fields where the header names 2 columns; complete the row",
        ),
        (
            "context_a,y\n1,2\n\n1,two\n",
            "a.csv, line 4, column `y`: `two` is not a number; write it with a decimal point",
        ),
        (
            "context_a,y\n1,2\n1,NaN\n",
            "a.csv, line 3, column `y`: NaN is not finite; remove or repair the row",
        ),
        (
            "context_a,y\n1,2\ninf,1\n",
            "a.csv, line 3, column `context_a`: inf is not finite; remove or repair the row",
        ),
        (
            "context_a,y\n1,2\n2,3\n",
            "a.csv, line 3, column `context_a`: 2 differs from 1 above; a condition holds throughout",
        ),
        (
            "step,context_a,y\n0,1,2\n2,1,3\n",
            "a.csv, line 3, column `step`: 2 where 1 follows; steps count up from 0, one a row",
        ),
        (
            "time_s,context_a,y\n0,1,2\n1,1,3\n4,1,3\n",
            "a.csv, line 3, column `time_s`: 1 s after the row above, not 2 s; resample evenly",
        ),
    ];
    for (text, sentence) in cases {
        assert_eq!(csv_error(text), sentence);
    }
}

#[test]
fn demonstrations_that_do_not_fit_each_other_are_refused() {
    let settings = small();
    let one = line("one", 1.0, 20);
    assert_eq!(
        train_error(std::slice::from_ref(&one), &settings),
        "1 demonstration(s): at least two with different contexts are needed, or nothing can be generalised"
    );
    assert_eq!(
        train_error(&[one.clone(), line("two", 2.0, 21)], &settings),
        "two has 21 steps, but one has 20; resample them to one length"
    );
    assert_eq!(
        train_error(&[one.clone(), line("two", 1.0, 20)], &settings),
        "the contexts of the demonstrations do not differ; a model of one condition has nothing to interpolate"
    );
    let other = Demonstration::new("two", &[("context_b", 2.0)], &["y"], vec![0.0; 20], None).expect("legal");
    assert_eq!(
        train_error(&[one.clone(), other], &settings),
        "two has the columns context_b,y, but one has context_a,y; give all demonstrations the same header"
    );
    let clocked = Demonstration::new("two", &[("context_a", 2.0)], &["y"], vec![0.0; 20], Some(0.02)).expect("legal");
    let other = Demonstration::new("one", &[("context_a", 1.0)], &["y"], vec![0.0; 20], Some(0.01)).expect("legal");
    assert_eq!(
        train_error(&[other, clocked], &settings),
        "two has a step every 0.02 s, but one every 0.01 s; resample them to one period"
    );
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let demonstrations = [line("one", 1.0, 20), line("two", 2.0, 20)];
    let refused = |settings: Settings| train_error(&demonstrations, &settings);
    assert_eq!(
        refused(Settings {
            confidence: 1.0,
            ..small()
        }),
        "confidence is 1; it must be above 0 and below 1"
    );
    assert_eq!(
        refused(Settings { units: 9999, ..small() }),
        "units is 9999; it must be 1 to 4096"
    );
    assert_eq!(
        refused(Settings {
            ridge: Ridge::Fixed { lambda: f64::NAN },
            ..small()
        }),
        "ridge.fixed.lambda is NaN; it must be above 0 and at most 1e12"
    );
    assert_eq!(
        refused(Settings {
            checkpoint_step: 19,
            ..small()
        }),
        "checkpoint_step 19 leaves nothing to forecast in 20 steps; it must be below 19"
    );
    assert_eq!(
        refused(Settings { washout: 20, ..small() }),
        "a washout of 20 steps leaves no sample; shorten it"
    );
}

#[test]
fn ordinary_least_squares_works_with_enough_rows_and_says_so_without() {
    let bells = [0.4, 0.6, 0.8, 1.0].map(|a| planar::bell(a, 100));
    let paper = Settings {
        ridge: Ridge::None,
        units: 40,
        jitter: None,
        checkpoint_step: 50,
        ..Settings::default()
    };
    let model = Model::train(&bells, &paper).expect("400 rows for 41 weights");
    assert!(
        (model.rows_and_edf().1 - 41.0).abs() < 1e-6,
        "the edf of least squares is its number of weights"
    );
    let middle = model.forecast(&[0.7], 51).expect("legal");
    let peak = middle.mean(51).expect("forecast")[0];
    assert!((peak - 0.7).abs() < 0.05, "{peak}");
    let few = train_error(&bells, &Settings { units: 500, ..paper });
    assert_eq!(
        few,
        "ordinary least squares needs more than 501 rows and has 400; choose a ridge"
    );
}

#[test]
fn several_context_points_are_one_longer_context() {
    let with_two_points = |a: f64| {
        let at = |step| planar::rounded(a, step);
        let columns = ["context_x1", "context_y1", "context_x2", "context_y2"];
        let values = [at(20), at(41)].concat();
        let context: Vec<(&str, f64)> = columns.into_iter().zip(values).collect();
        let outputs = (0..planar::STEPS).flat_map(at).collect();
        Demonstration::new("two points", &context, &["x", "y"], outputs, None).expect("legal")
    };
    let model = Model::train(&planar::TRAINED.map(with_two_points), &Settings::default()).expect("trainable");
    let unseen = with_two_points(0.1);
    let forecast = model.forecast(unseen.context(), 42).expect("legal");
    let [x, y] = planar::position(0.1, 60);
    let mean = forecast.mean(60).expect("forecast");
    assert!(libm::hypot(mean[0] - x, mean[1] - y) < 0.006);
}

#[test]
fn odd_but_legal_demonstrations_train() {
    let constant = |name, a| {
        let outputs = (0..30).flat_map(|t| [a * f64::from(t), 0.15, 0.0]).collect();
        Demonstration::new(name, &[("context_a", a)], &["x", "z", "nothing"], outputs, None).expect("legal")
    };
    for units in [1, 2, 30] {
        for bias in [tandem_cesn::Bias::Penalised, tandem_cesn::Bias::Free] {
            let settings = Settings {
                units,
                bias,
                density: 1.0,
                ..small()
            };
            let model = Model::train(&[constant("a", 1.0), constant("b", 2.0)], &settings).expect("trainable");
            let forecast = model.forecast(&[1.5], 10).expect("legal");
            assert!((forecast.mean(20).expect("forecast")[1] - 0.15).abs() < 0.05);
        }
    }
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "(context_a|step|time_s|y|,|\n|1|-2.5e3|nan|\\PC){0,60}") {
        let _ = Demonstration::from_csv("a.csv", &text);
    }

    #[test]
    fn no_arguments_make_the_quantile_panic(exponent in -9.0..12.0_f64, p in 0.0..1.0_f64) {
        let quantile = tandem_cesn::student_t_quantile(libm::exp10(exponent), p);
        prop_assert!(quantile.is_none_or(f64::is_finite));
    }
}
