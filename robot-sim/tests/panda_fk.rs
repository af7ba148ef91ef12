//! Forward kinematics and Jacobian against reference values that another library computed (its name is in the file).

use serde_json::Value;
use tandem_robot_sim::kinematics::{forward, jacobian_at};

const TOLERANCE: f64 = 1e-9;

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        _ => vec![value.as_f64().expect("a number")],
    }
}

fn assert_close(what: &str, found: &[f64], wanted: &Value) {
    let wanted = numbers(wanted);
    assert_eq!(found.len(), wanted.len());
    for (found, wanted) in found.iter().zip(wanted) {
        assert!((found - wanted).abs() <= TOLERANCE, "{what}: {found} is not {wanted}");
    }
}

#[test]
fn flange_pose_and_jacobian_agree_with_the_reference() {
    let file: Value = serde_json::from_str(include_str!("data/panda_fk.json")).unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert!(!cases.is_empty());
    for case in cases {
        let q = numbers(&case["q"]).try_into().expect("seven joints");
        let frames = forward(&q);
        let flange = frames.flange();
        assert_close("position", flange.origin.as_slice(), &case["position"]);
        // The file counts row by row, nalgebra column by column.
        assert_close("rotation", flange.rotation.transpose().as_slice(), &case["rotation"]);
        let jacobian = jacobian_at(&frames, &flange.origin);
        assert_close("jacobian", jacobian.transpose().as_slice(), &case["jacobian"]);
    }
}
