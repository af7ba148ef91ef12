//! The demonstrations that ship are the formula, and nothing else.

#[path = "support/planar.rs"]
mod planar;

use std::path::PathBuf;

use tandem_cesn::Demonstration;

fn file(a: f64) -> PathBuf {
    let name = format!("planar_a{:02.0}.csv", a * 100.0);
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../examples/demonstrations")
        .join(name)
}

#[test]
fn the_shipped_files_equal_the_formula() {
    for a in planar::TRAINED {
        let text = std::fs::read_to_string(file(a)).expect("the file ships");
        assert_eq!(text, planar::demonstration(a).to_csv(), "{}", file(a).display());
        let read = Demonstration::from_csv("planar", &text).expect("it is well formed");
        assert_eq!(read.steps(), 84);
        assert_eq!(read.period_s(), Some(0.1));
        assert_eq!(read.context_columns(), ["context_x_m", "context_y_m"]);
        assert_eq!(read.output_columns(), ["x_m", "y_m"]);
        assert_eq!(read.rows().nth(planar::CHECKPOINT), Some(read.context()));
    }
}

#[test]
fn the_paths_pass_over_the_first_obstacle_and_under_the_second() {
    let clearance = |[x, y]: [f64; 2], obstacle: f64| libm::hypot(x - obstacle, y) - 0.02;
    for a in planar::TRAINED.into_iter().chain(planar::INSIDE) {
        let path: Vec<[f64; 2]> = (0..planar::STEPS).map(|step| planar::position(a, step)).collect();
        assert!(
            path.iter()
                .all(|p| clearance(*p, 0.28) > 0.005 && clearance(*p, 0.46) > 0.005),
            "a = {a}"
        );
        assert!(path.iter().any(|p| p[1] > 0.9 * a) && path.iter().any(|p| p[1] < -0.5 * a));
    }
}

/// Writes the files anew: `cargo test -p tandem-cesn --test demonstration_files -- --ignored`.
#[test]
#[ignore = "it writes into examples/demonstrations; run it after changing the formula"]
fn write_the_files() {
    for a in planar::TRAINED {
        std::fs::write(file(a), planar::demonstration(a).to_csv()).expect("the folder can be written");
    }
}
