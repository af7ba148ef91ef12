//! The plan of the house: which crate may import which, read from `cargo metadata`.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

/// From the ground up. A crate may import crates of lower floors, never of its own or a higher one; on the ground,
/// `settings` and `cesn` import nothing of ours and neither does `wire`.
const FLOORS: [&[&str]; 6] = [
    &["tandem-wire", "tandem-settings", "tandem-cesn"],
    &["tandem-site"],
    &["tandem-link"],
    &[
        "tandem-operator",
        "tandem-predictor",
        "tandem-arbiter",
        "tandem-robot-sim",
        "tandem-recorder",
    ],
    &["tandem-trials"],
    &["tandem", "tandem-fuzz"],
];

/// What a node's library may import of ours: never the shell, and only the predictor knows the model.
const NODE_IMPORTS: [&str; 3] = ["tandem-wire", "tandem-settings", "tandem-cesn"];

/// Crates that only these of ours may name. The fuzzer ships with nothing, and takes session files apart.
const RESERVED: [(&str, &[&str]); 4] = [
    ("zenoh", &["tandem-link"]),
    ("rerun", &["tandem-recorder"]),
    ("mcap", &["tandem-recorder", "tandem-fuzz"]),
    ("faer", &["tandem-cesn"]),
];

/// Package → what it imports, tests and build scripts aside.
fn imports() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata prints JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let name = |value: &Value| value["name"].as_str().expect("a name").to_owned();
    let normal = |package: &Value| {
        let dependencies = package["dependencies"].as_array().expect("dependencies").iter();
        dependencies
            .filter(|dependency| dependency["kind"].is_null())
            .map(name)
            .collect()
    };
    packages
        .iter()
        .map(|package| (name(package), normal(package)))
        .collect()
}

fn floor(package: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&package))
}

#[test]
fn no_import_runs_up_or_sideways() {
    let imports = imports();
    assert!(imports.len() >= 10, "the workspace has all its crates");
    for (package, imported) in &imports {
        let own = floor(package).unwrap_or_else(|| panic!("{package} stands on no floor: add it to the plan"));
        for other in imported {
            if let Some(theirs) = floor(other) {
                assert!(theirs < own, "{package} (floor {own}) imports {other} (floor {theirs})");
            }
        }
    }
}

#[test]
fn a_nodes_library_knows_neither_the_shell_nor_another_node() {
    for (package, imported) in &imports() {
        if floor(package) == Some(3) {
            for other in imported.iter().filter(|name| floor(name).is_some()) {
                assert!(NODE_IMPORTS.contains(&other.as_str()), "{package} imports {other}");
                assert!(
                    other != "tandem-cesn" || package == "tandem-predictor",
                    "{package} imports the model"
                );
            }
        }
    }
}

#[test]
fn heavy_crates_are_named_in_one_place() {
    for (package, imported) in &imports() {
        for (reserved, owners) in RESERVED {
            assert!(
                owners.contains(&package.as_str()) || !imported.iter().any(|name| name == reserved),
                "{package} imports {reserved}"
            );
        }
    }
}
