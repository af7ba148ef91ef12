//! The arm as its URDF file describes it: found, read, moved by its joints, and refused with a place when it is wrong.

use std::path::{Path, PathBuf};

use crate::script::{record, session};
use tandem_recorder::{Drawing, Drops, Entry, Output, Sample, Urdf, View};
use tandem_wire::Timing;

/// One triangle as a binary STL file.
fn stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(1_u32.to_le_bytes());
    for number in [0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0] {
        bytes.extend((number as f32 * 0.1).to_le_bytes());
    }
    bytes.extend([0; 2]);
    bytes
}

/// A chain of seven joints that turn about z, one above the other, named like the Panda's.
fn panda(look: &str) -> String {
    let mut text =
        String::from("<robot name=\"panda\">\n<material name=\"white\"><color rgba=\"1 1 1 1\"/></material>\n");
    for link in 0..=8 {
        text += &format!("<link name=\"panda_link{link}\">{look}</link>\n");
    }
    for joint in 1..=8 {
        let (parent, kind) = (joint - 1, if joint == 8 { "fixed" } else { "revolute" });
        text += &format!(
            "<joint name=\"panda_joint{joint}\" type=\"{kind}\"><parent link=\"panda_link{parent}\"/>\
             <child link=\"panda_link{joint}\"/><origin xyz=\"0 0 0.1\" rpy=\"0 0 0\"/><axis xyz=\"0 0 1\"/></joint>\n"
        );
    }
    text + "</robot>\n"
}

const MESH: &str = "<visual><origin xyz=\"0 0 0.05\"/><geometry>\
    <mesh filename=\"package://franka_description/meshes/link.stl\" scale=\"2 2 2\"/></geometry>\
    <material name=\"white\"/></visual>";

/// A package as ROS lays it out: `franka_description/robots/panda.urdf` and its meshes beside.
fn package(folder: &Path, text: &str) -> PathBuf {
    let package = folder.join("franka_description");
    for within in ["robots", "meshes"] {
        std::fs::create_dir_all(package.join(within)).expect("a folder");
    }
    std::fs::write(package.join("meshes/link.stl"), stl()).expect("a file");
    let path = package.join("robots/panda.urdf");
    std::fs::write(&path, text).expect("a file");
    path
}

fn drawn(urdf: &Urdf) -> Vec<Drawing> {
    let timing = Timing::default().lockstep();
    let mut view = View::new(timing).with_urdf(urdf);
    let (mut drawings, mut began) = (Vec::new(), false);
    for output in record(&session(), timing) {
        let Output::Show(heard) = output else { continue };
        if !std::mem::replace(&mut began, true) {
            view.begin_recording(&heard, &mut drawings);
        }
        view.draw(&heard, Drops::default(), &mut drawings);
    }
    drawings
}

fn component(drawing: &Drawing, name: &str) -> Option<String> {
    let batch = drawing
        .batches
        .iter()
        .find(|batch| batch.descriptor.component.as_str() == name)?;
    Some(format!("{:?}", batch.array))
}

#[test]
fn meshes_are_drawn_once_and_the_joints_turn_them_at_every_state() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = Urdf::load(&package(folder.path(), &panda(MESH))).unwrap();
    let drawings = drawn(&urdf);
    let meshes: Vec<_> = drawings
        .iter()
        .filter(|d| component(d, "Asset3D:blob").is_some())
        .collect();
    assert_eq!(meshes.len(), 9, "one for every link");
    assert!(
        meshes.iter().all(|mesh| mesh.moment.is_none()),
        "they hold at all times"
    );
    let third = "world/arm/panda_link0/panda_link1/panda_link2/panda_link3";
    assert!(meshes.iter().any(|mesh| mesh.path == format!("{third}/look0")));

    let states = record(&session(), Timing::default().lockstep())
        .iter()
        .filter(
            |output| matches!(output, Output::Show(heard) if matches!(heard.entry, Entry::Sample(Sample::State(_)))),
        )
        .count();
    let turns = drawings.iter().filter(|d| d.path == third && d.moment.is_some());
    assert_eq!(turns.count(), states, "a turn for every state");
    assert!(
        !drawings.iter().any(|d| component(d, "Capsules3D:lengths").is_some()),
        "no capsules besides"
    );
}

#[test]
fn a_joint_angle_turns_its_link_about_its_axis() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = Urdf::load(&package(folder.path(), &panda(""))).unwrap();
    let timing = Timing::default().lockstep();
    let outputs = record(&session(), timing);
    let state = outputs.iter().find_map(|output| match output {
        Output::Show(heard) if matches!(heard.entry, Entry::Sample(Sample::State(_))) => Some(heard),
        _ => None,
    });
    let mut heard = (**state.unwrap()).clone();
    let mut turned = |angle: f64| {
        if let Entry::Sample(Sample::State(message)) = &mut heard.entry {
            message.body.joints[2].0 = angle;
        }
        let mut drawings = Vec::new();
        View::new(timing)
            .with_urdf(&urdf)
            .draw(&heard, Drops::default(), &mut drawings);
        let link = drawings.iter().find(|d| d.path.ends_with("panda_link3")).unwrap();
        component(link, "Transform3D:quaternion").unwrap()
    };
    let (none, half) = (turned(0.0), turned(std::f64::consts::PI));
    assert!(none.contains("0.0,\n  0.0,\n  0.0,\n  1.0"), "{none}");
    assert!(half.contains("1.0,\n  "), "half a turn about z: {half}");
    assert_ne!(none, half);
}

#[test]
fn shapes_without_a_mesh_and_colours_are_drawn_too() {
    let folder = tempfile::tempdir().unwrap();
    let looks = "<visual><geometry><box size=\"0.1 0.1 0.1\"/></geometry></visual>\
        <visual><geometry><cylinder radius=\"0.05\" length=\"0.2\"/></geometry></visual>\
        <visual><geometry><sphere radius=\"0.05\"/></geometry>\
        <material name=\"x\"><color rgba=\"1 0 0 0.5\"/></material></visual>";
    let drawings = drawn(&Urdf::load(&package(folder.path(), &panda(looks))).unwrap());
    for name in ["Boxes3D:half_sizes", "Cylinders3D:lengths", "Ellipsoids3D:half_sizes"] {
        let found = drawings
            .iter()
            .filter(|d| d.path.contains("/look") && component(d, name).is_some());
        assert_eq!(found.count(), 9, "{name}");
    }
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |text: &str| {
        let error = Urdf::load(&package(folder.path(), text)).unwrap_err();
        let because = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
        format!("{error}{}", because.unwrap_or_default())
    };
    let robot = panda(MESH);
    for (text, words) in [
        (String::new(), "is no URDF file"),
        ("<robot><link".to_owned(), "is no URDF file"),
        ("<sdf/>".to_owned(), "begins with <robot>"),
        ("<robot/>".to_owned(), "no link is the first one"),
        (
            "<robot><link name=\"a\"/></robot>".to_owned(),
            "has 0 revolute joints; the arm has 7",
        ),
        (
            robot.replace("link.stl", "other.stl"),
            "which is not there; looked for it at",
        ),
        (
            robot.replace("2 2 2", "2 two 2"),
            "line 3: scale=\"2 two 2\" should be 3 numbers",
        ),
        (robot.replace("0 0 0.05", "0 0 inf"), "should be 3 numbers"),
        (
            robot.replace("<parent link=\"panda_link3\"/>", ""),
            "a joint without <parent link=…>",
        ),
        (
            robot.replace("<child link=\"panda_link8\"/>", "<child link=\"panda_link9\"/>"),
            "there is no link",
        ),
        (
            robot.replace("<child link=\"panda_link8\"/>", "<child link=\"panda_link2\"/>"),
            "hangs on two others",
        ),
        (
            panda("<visual><geometry><torus/></geometry></visual>"),
            "a shape \"torus\" is not known",
        ),
        (panda("<visual/>"), "a visual without a geometry"),
    ] {
        let said = refusal(&text);
        assert!(said.contains(words), "{said}\nshould say: {words}");
        assert!(said.contains("panda.urdf"), "{said}");
    }
    let nowhere = Urdf::load(&folder.path().join("nowhere.urdf")).unwrap_err();
    assert!(
        nowhere.to_string().contains("nowhere.urdf\" cannot be read"),
        "{nowhere}"
    );
    assert!(Urdf::load(folder.path()).is_err(), "a folder is no file");
}
