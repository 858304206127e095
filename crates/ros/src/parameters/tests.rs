use std::sync::Arc;

use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::text::SENTENCE_CHARS;

use super::services::MAX_PARAMETERS;
use super::store::matches;
use super::value::{MAX_ITEMS, MAX_TEXT_BYTES};
use super::*;

fn store(yaml: &str) -> Arc<Store> {
    Arc::new(Store::new("/robot/walker".to_string(), &overrides_from_yaml(yaml).unwrap(), |_| {}))
}

#[test]
fn files_are_read_by_node_name_and_wildcards() {
    let store = store(
        "/**: {ros__parameters: {a: 1, b: 1, c: 1}}\n\
         /robot/walker: {ros__parameters: {b: 2, group: {d: [1.0, 2.0]}}}\n\
         robot: {walker: {ros__parameters: {c: 3}}}\n\
         /*/walker: {ros__parameters: {e: yes}}\n\
         /walker: {ros__parameters: {a: 9}}\n",
    );
    let declare = |name| ParameterBuilder::new(Arc::clone(&store), name, 0_i64).declare().unwrap().get();
    assert_eq!((declare("a"), declare("b"), declare("c")), (1, 2, 3));
    let group = ParameterBuilder::new(Arc::clone(&store), "group.d", vec![0.0]).declare().unwrap();
    assert_eq!(group.get(), [1.0, 2.0]);
    assert!(ParameterBuilder::new(Arc::clone(&store), "e", false).declare().unwrap().get());
    assert!(store.unused_overrides().is_empty());
}

#[test]
fn wrong_files_are_refused_with_the_place() {
    let error = |text| overrides_from_yaml(text).unwrap_err();
    assert!(error("- 1").contains("NODE"));
    assert!(error("walker: 3").contains("/walker"));
    assert!(error("ros__parameters: {a: 1}").contains("below a node's name"));
    assert!(error("walker: {ros__parameters: {a: [1, 2.0]}}").contains("one type"));
    assert!(error("walker: {ros__parameters: {g: {a: }}}").contains("g.a"));
}

#[test]
fn values_are_checked_when_declared_and_when_set() {
    let store = store("/**: {ros__parameters: {rate: 5000.0, steps: 2.5}}");
    let build = |name| ParameterBuilder::new(Arc::clone(&store), name, 100.0).range(1.0, 1000.0);
    let error = build("rate").declare().err().unwrap().to_string();
    assert!(error.contains("rate") && error.contains("from 1 to 1000") && error.contains("5000"), "{error}");
    let error = ParameterBuilder::new(Arc::clone(&store), "steps", 1_i64).declare().err().unwrap().to_string();
    assert!(error.contains("expected integer, got double 2.5"), "{error}");

    let limit = build("limit")
        .validate("even", |value| if value % 2.0 == 0.0 { Ok(()) } else { Err(format!("{value} is odd")) })
        .declare()
        .unwrap();
    let set = |value: ParameterValue| store.set(&[("limit".to_string(), value)]);
    assert_eq!(set(ParameterValue::Double(4.0)), Ok(()));
    assert_eq!(limit.get(), 4.0);
    assert!(set(ParameterValue::Double(f64::NAN)).unwrap_err().contains("NaN"));
    assert!(set(ParameterValue::Double(3.0)).unwrap_err().contains("3 is odd"));
    assert!(set(ParameterValue::Integer(4)).unwrap_err().contains("write 4.0"));
    assert!(store.set(&[("limt".to_string(), ParameterValue::Double(1.0))]).unwrap_err().contains("limit"));
    assert_eq!(limit.get(), 4.0);
    assert!(build("limit").declare().is_err(), "declared twice");
}

#[test]
fn several_are_set_all_or_nothing() {
    let store = store("{}");
    let a = ParameterBuilder::new(Arc::clone(&store), "a", 1_i64).declare().unwrap();
    let _b = ParameterBuilder::new(Arc::clone(&store), "b", 1_i64).read_only().declare().unwrap();
    let both = [("a".to_string(), ParameterValue::Integer(5)), ("b".to_string(), ParameterValue::Integer(5))];
    assert!(store.set(&both).unwrap_err().contains("read-only"));
    assert_eq!(a.get(), 1);
}

#[test]
fn a_request_without_end_is_refused_and_sets_nothing() {
    let store = store("{}");
    let text = ParameterBuilder::new(Arc::clone(&store), "text", String::new()).declare().unwrap();
    let parameter = |value: String| wire::Parameter {
        name: "text".into(),
        value: wire::ParameterValue { r#type: 4, string_value: value, ..Default::default() },
    };
    let set = |parameters: Vec<_>| store.set_parameters(&wire::SetParametersRequest { parameters }).results;
    let results = set(vec![parameter("x".into()); 1_000_000]);
    assert_eq!(results.len(), MAX_PARAMETERS);
    assert!(results.iter().all(|result| !result.successful && result.reason.contains("1000000 parameters")));
    let result = set(vec![parameter("x".repeat(MAX_TEXT_BYTES + 1))]).remove(0);
    assert!(result.reason.contains("65537 bytes of text"), "{}", result.reason);
    let mut list = parameter(String::new());
    list.value = wire::ParameterValue { r#type: 8, double_array_value: vec![0.0; MAX_ITEMS + 1], ..Default::default() };
    assert!(set(vec![list]).remove(0).reason.contains("4097 items"));
    // What is refused is not repeated in full, nor does it fake a line.
    let mut unknown = parameter(String::new());
    unknown.name = "x\n[INFO] armed".repeat(100_000);
    let reason = set(vec![unknown]).remove(0).reason;
    assert!(!reason.contains('\n') && reason.chars().count() <= SENTENCE_CHARS + 1, "{reason}");
    assert_eq!(text.get(), "");
    assert!(set(vec![parameter("x".repeat(MAX_TEXT_BYTES))])[0].successful);
    let names = vec!["text".to_string(); 1_000_000];
    assert_eq!(store.get_parameters(&wire::GetParametersRequest { names }).values.len(), MAX_PARAMETERS);
}

#[test]
fn lists_follow_prefix_and_depth() {
    let store = store("{}");
    for name in ["a", "g.b", "g.h.c", "gg.d"] {
        ParameterBuilder::new(Arc::clone(&store), name, 1_i64).declare().unwrap();
    }
    let list = |prefixes: &[&str], depth| {
        let prefixes = prefixes.iter().map(|prefix| (*prefix).to_string()).collect();
        store.list_parameters(&wire::ListParametersRequest { prefixes, depth }).result.names
    };
    assert_eq!(list(&[], 0), ["a", "g.b", "g.h.c", "gg.d"]);
    assert_eq!(list(&[], 1), ["a"]);
    assert_eq!(list(&["g"], 0), ["g.b", "g.h.c"]);
    assert_eq!(list(&["g"], 1), ["g.b"]);
    assert_eq!(list(&["a"], 1), ["a"]);
}

#[test]
fn patterns_match_as_in_ros() {
    for (pattern, node, expected) in [
        ("/**", "/a/b", true),
        ("/*", "/a", true),
        ("/*", "/a/b", false),
        ("/*/b", "/a/b", true),
        ("/**/b", "/b", true),
        ("/**/b", "/x/a/b", true),
        ("/a/**", "/b/a", false),
        ("/a", "/a", true),
        ("/a", "/a/b", false),
    ] {
        assert_eq!(matches(pattern, node), expected, "{pattern} {node}");
    }
}
