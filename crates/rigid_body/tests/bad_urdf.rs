//! Every way in which a URDF can be wrong gives one clear error, and none brings the program down.

mod common;
mod mutated;

use common::{Random, VISION60};
use mutated::mutated;
use rigid_body::{Model, ModelError};

fn load(urdf: &str) -> Result<Model, ModelError> {
    Model::floating_base_from_urdf(urdf)
}

/// The error after replacing `from`, which must be there, by `to` in the Vision 60's URDF.
fn error_of(from: &str, to: &str) -> ModelError {
    assert!(VISION60.contains(from), "the test's text '{from}' is no longer in the URDF");
    load(&VISION60.replacen(from, to, 1)).expect_err("the file is wrong")
}

fn says(error: &ModelError, words: &[&str]) {
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "'{message}' does not say '{word}'");
    }
}

const BODY: &str =
    "<inertial><mass value=\"1\"/><inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/></inertial>";

fn link(name: &str) -> String {
    format!("<link name=\"{name}\">{BODY}</link>")
}

fn joint(name: &str, parent: &str, child: &str) -> String {
    format!(
        "<joint name=\"{name}\" type=\"continuous\"><parent link=\"{parent}\"/><child link=\"{child}\"/><axis xyz=\"0 1 0\"/></joint>"
    )
}

fn robot(parts: &[String]) -> String {
    format!("<robot name=\"r\">{}</robot>", parts.concat())
}

#[test]
fn the_test_robots_load() {
    load(VISION60).expect("the project's own robot");
    load(&robot(&[link("a"), link("b"), joint("j", "a", "b")])).expect("two links and a joint");
}

#[test]
fn not_xml() {
    for text in ["", "   ", "robot", "{\"robot\": 1}", "<robot", "<robot>", "</robot>", "<robot></robot", "\u{0}"] {
        let error = load(text).expect_err("not XML");
        assert!(matches!(error, ModelError::NotUrdf(_)), "'{text}': {error}");
        says(&error, &["<robot>"]);
    }
    says(&load("<model name=\"x\"/>").expect_err("not a robot"), &["<model>", "<robot>"]);
    says(&load(&VISION60[..VISION60.len() / 2]).expect_err("cut in half"), &["cannot be read"]);
}

#[test]
fn no_root() {
    let error = load("<robot name=\"r\"/>").expect_err("no links");
    assert_eq!(error, ModelError::NoRoot { links: 0 });
    let ring = robot(&[link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")]);
    says(&load(&ring).expect_err("a ring"), &["closes a loop", "'j'"]);
}

#[test]
fn two_roots() {
    let error = load(&robot(&[link("a"), link("b")])).expect_err("two roots");
    assert_eq!(error, ModelError::TwoRoots { first: "a".to_owned(), second: "b".to_owned() });
}

#[test]
fn loops() {
    let twice =
        robot(&[link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("k", "a", "c"), joint("l", "b", "c")]);
    says(&load(&twice).expect_err("c has two parents"), &["'l'", "'c'", "loop"]);
    // A ring beside a good tree.
    let ring = robot(&[
        link("a"),
        link("b"),
        link("c"),
        link("d"),
        joint("j", "a", "b"),
        joint("k", "c", "d"),
        joint("l", "d", "c"),
    ]);
    says(&load(&ring).expect_err("a ring apart"), &["'k'", "loop"]);
    let own = robot(&[link("a"), link("b"), joint("j", "b", "b")]);
    says(&load(&own).expect_err("a joint to itself"), &["'j'", "loop"]);
}

#[test]
fn names() {
    let double = robot(&[link("a"), link("a")]);
    says(&load(&double).expect_err("two links a"), &["two links", "'a'"]);
    let double = robot(&[link("a"), link("b"), link("c"), joint("j", "a", "b"), joint("j", "a", "c")]);
    says(&load(&double).expect_err("two joints j"), &["two joints", "'j'"]);
    let error = error_of("<child link=\"front_left_toe\"/>", "<child link=\"front_left_tow\"/>");
    says(&error, &["front_left_toe_fixed", "front_left_tow", "does not exist"]);
}

#[test]
fn joint_types_that_are_not_supported() {
    let from = "name=\"front_left_knee\" type=\"revolute\"";
    for kind in ["floating", "planar", "spherical", "ball", ""] {
        let error = error_of(from, &format!("name=\"front_left_knee\" type=\"{kind}\""));
        let expected = ModelError::UnsupportedJoint { joint: "front_left_knee".to_owned(), found: kind.to_owned() };
        assert_eq!(error, expected);
    }
    let mimic = error_of(
        "<limit lower=\"0\" upper=\"3.14159265\"",
        "<mimic joint=\"rear_left_knee\"/><limit lower=\"0\" upper=\"3.14159265\"",
    );
    says(&mimic, &["front_left_knee", "mimic"]);
}

#[test]
fn masses_and_inertias() {
    let start = VISION60.find("<link name=\"front_left_hip\">").expect("the link is there");
    let open = start + VISION60[start..].find("<inertial>").expect("it has one");
    let close = open + VISION60[open..].find("</inertial>").expect("it is closed") + "</inertial>".len();
    let missing = format!("{}{}", &VISION60[..open], &VISION60[close..]);
    let error = load(&missing).expect_err("no inertial");
    assert_eq!(error, ModelError::MissingInertial { link: "front_left_hip".to_owned() });
    for mass in ["0", "-1.975"] {
        let error = error_of("<mass value=\"1.975\"/>", &format!("<mass value=\"{mass}\"/>"));
        says(&error, &["front_left_hip", "positive mass", mass]);
    }
    // xx + yy < zz, and a negative one.
    for ixx in ["0.001", "-0.008"] {
        let error = error_of("ixx=\"0.00891458\"", &format!("ixx=\"{ixx}\""));
        assert!(matches!(&error, ModelError::BadInertia { link, .. } if link == "front_left_hip"), "{error}");
    }
    let error = error_of("ixx=\"0.00891458\" ixy=\"0\"", "ixx=\"0.00891458\" ixy=\"0.02\"");
    assert!(matches!(error, ModelError::BadInertia { .. }), "{error}");
}

#[test]
fn numbers_that_are_none() {
    for bad in ["NaN", "inf", "-inf", "1e999"] {
        says(&error_of("<mass value=\"1.975\"/>", &format!("<mass value=\"{bad}\"/>")), &["front_left_hip", "mass"]);
        says(&error_of("izz=\"0.8369\"", &format!("izz=\"{bad}\"")), &["torso", "izz"]);
        let origin = "<origin xyz=\"0.34385 0.092865 0\"";
        says(&error_of(origin, &format!("<origin xyz=\"0.34385 {bad} 0\"")), &["front_left_hip_roll", "xyz"]);
        says(
            &error_of("<axis xyz=\"1 0 0\"/>", &format!("<axis xyz=\"{bad} 0 0\"/>")),
            &["front_left_hip_roll", "axis"],
        );
    }
    let error = error_of("<axis xyz=\"1 0 0\"/>", "<axis xyz=\"0 0 0\"/>");
    assert_eq!(error, ModelError::BadAxis { joint: "front_left_hip_roll".to_owned(), length: 0.0 });
    says(
        &error_of("<mass value=\"1.975\"/>", "<mass value=\"heavy\"/>"),
        &["front_left_hip", "mass value", "heavy", "line 61"],
    );
    says(&error_of("<axis xyz=\"1 0 0\"/>", "<axis xyz=\"1 0\"/>"), &["front_left_hip_roll", "axis xyz", "3 number"]);
}

#[test]
fn a_file_of_100_mb() {
    let text = format!("<robot name=\"r\">{}</robot>", " ".repeat(100 << 20));
    says(&load(&text).expect_err("too large"), &["bytes long", "at most"]);
}

#[test]
fn entity_expansion() {
    let bomb = "<?xml version=\"1.0\"?><!DOCTYPE r [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;\">]>\
                <robot name=\"&b;\"><link name=\"l\"/></robot>";
    assert_eq!(load(bomb).expect_err("a document type"), ModelError::DocumentType);
    let lower = bomb.replace("<!DOCTYPE", "<!doctype");
    load(&lower).expect_err("a document type by another spelling");
}

#[test]
fn deep_and_wide() {
    let deep = format!("<robot name=\"r\">{}{}</robot>", "<a>".repeat(200_000), "</a>".repeat(200_000));
    assert!(matches!(load(&deep), Err(ModelError::TooDeep { .. })));
    let wide = format!("<robot name=\"r\">{}</robot>", "<a/>".repeat(200_000));
    assert!(matches!(load(&wide), Err(ModelError::TooManyElements { .. })));
}

#[test]
fn a_subtree_asked_for_wrongly() {
    let model = load(VISION60).expect("the project's own robot");
    says(&model.subtree(&["front_left_ankle"], 1.0).expect_err("no such joint"), &["front_left_ankle"]);
    says(&model.subtree(&["base_x"], 1.0).expect_err("the base stays"), &["base_x"]);
    let knee = model.subtree(&["front_left_knee"], 1.0).expect_err("a knee without a thigh");
    says(&knee, &["front_left_knee", "front_left_hip_pitch"]);
    for share in [-0.1, 1.1, f64::NAN] {
        assert!(matches!(model.subtree::<&str>(&[], share), Err(ModelError::BadTorsoShare(_))));
    }
    let twice = ["front_left_hip_roll", "front_left_hip_roll"];
    says(&model.subtree(&twice, 1.0).expect_err("named twice"), &["two joints"]);
}

/// Mutated files load or are refused, and never panic; what loads has finite numbers.
/// TANDEM_FUZZ_CASES sets how many (a million were run once).
#[test]
fn mutated_files_never_panic() {
    let cases = std::env::var("TANDEM_FUZZ_CASES").map_or(3_000, |n| n.parse().expect("a number of cases"));
    // Without shapes, and with one leg: what the loader reads, and quick to read.
    let start = VISION60.find("<!-- rear left leg -->").expect("a comment in the URDF");
    let mut small = format!("{}</robot>", &VISION60[..start]);
    while let (Some(from), Some(to)) = (small.find("<visual>"), small.find("</visual>")) {
        small.replace_range(from..to + "</visual>".len(), "");
    }
    load(&small).expect("one leg");
    let mut random = Random(2026);
    let mut loaded = 0;
    for _ in 0..cases {
        let text = mutated(&small, || random.number());
        if let Ok(model) = load(&text) {
            loaded += 1;
            assert!(model.total_mass().is_finite() && model.total_mass() > 0.0, "{text}");
        }
    }
    assert!(loaded > cases / 100 && loaded < cases, "{loaded} of {cases} loaded");
}
