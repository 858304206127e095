//! A gait's file and its message hold the same fields: every value of either shows in the other.

use gait::{Gait, SecondStep};
use serde_json::Value;

/// A gait whose optional parts are all there.
fn whole() -> Gait {
    let mut gait = Gait::from_json(include_str!("../../tests/gaits/amble.json")).unwrap();
    let rows = gait.planned_coefficients(gait::StepSide::Mirrored);
    gait.second_step = Some(SecondStep { coefficients_rad: rows, reference_coefficients_rad: rows });
    gait.certificate =
        Some(gait::Certificate { points: 11, largest_multiplier: 0.7, landing_run_m: 0.01, stable: true });
    Gait::from_json(&gait.to_json()).expect("a gait with all its parts is one")
}

/// A gait with a lead and a cycle, which has no second step beside them.
fn with_domains() -> Gait {
    let gait = whole();
    let domains = gait.schedule();
    let gait = Gait { second_step: None, lead: domains.clone(), cycle: domains, ..gait };
    Gait::from_json(&gait.to_json()).expect("a gait with a lead and a cycle is one")
}

/// Where every value of `json` stands, as JSON pointers.
fn leaves(json: &Value) -> Vec<String> {
    let below =
        |key: &str, value: &Value| leaves(value).into_iter().map(|leaf| format!("/{key}{leaf}")).collect::<Vec<_>>();
    match json {
        Value::Array(items) => items.iter().enumerate().flat_map(|(i, item)| below(&i.to_string(), item)).collect(),
        Value::Object(fields) => fields.iter().flat_map(|(key, value)| below(key, value)).collect(),
        _ => vec![String::new()],
    }
}

/// `json` with another value at `leaf`, so near that what was allowed still is.
fn changed(json: &Value, leaf: &str) -> Value {
    let mut json = json.clone();
    let value = json.pointer_mut(leaf).unwrap();
    *value = match &*value {
        Value::Null => Value::from("x"),
        Value::Bool(flag) => Value::from(!flag),
        Value::String(text) => Value::from(format!("{text}x")),
        Value::Number(number) if number.is_u64() => Value::from(number.as_u64().unwrap() + 1),
        Value::Number(number) => Value::from(number.as_f64().unwrap() + 1e-9),
        _ => unreachable!("a leaf holds no others"),
    };
    json
}

#[test]
fn every_value_of_a_gait_file_is_in_its_message() {
    let file: Value = serde_json::from_str(&whole().to_json()).unwrap();
    let message = tandem_msgs::Gait::from_gait(&whole());
    let mut only_one_value = Vec::new();
    for leaf in leaves(&file) {
        let Ok(gait) = Gait::from_json(&changed(&file, &leaf).to_string()) else {
            only_one_value.push(leaf);
            continue;
        };
        let carried = tandem_msgs::Gait::from_gait(&gait);
        assert_ne!(carried, message, "{leaf} of the gait file is not in the message");
        assert_eq!(carried.to_gait().unwrap(), gait, "{leaf} does not come back");
    }
    // What no gait may have otherwise; the message is refused for another value of them, below.
    only_one_value.retain(|leaf| !leaf.starts_with("/mirror/"));
    assert_eq!(only_one_value, ["/bezier_degree", "/format", "/version"]);
}

#[test]
fn every_value_of_a_gait_message_is_in_its_file() {
    for gait in [whole(), with_domains()] {
        every_value_is_in_the_file(&gait);
    }
}

fn every_value_is_in_the_file(gait: &Gait) {
    let message = serde_json::to_value(tandem_msgs::Gait::from_gait(gait)).unwrap();
    for leaf in leaves(&message) {
        let of_the_message = leaf.starts_with("/header/") || leaf == "/solver/worst_constraint";
        let carried: tandem_msgs::Gait = serde_json::from_value(changed(&message, &leaf)).unwrap();
        let same = carried.to_gait().is_ok_and(|other| other.to_json() == gait.to_json());
        assert_eq!(same, of_the_message, "{leaf} of the message");
    }
}
