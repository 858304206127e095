//! ROS names: validation, expansion and remapping (<https://design.ros2.org/articles/topic_and_service_names.html>).

use crate::RosError;

fn token_problem(token: &str) -> Option<&'static str> {
    if token.is_empty() {
        return Some("empty part between slashes");
    }
    if token.starts_with(|c: char| c.is_ascii_digit()) {
        return Some("a part must not begin with a digit");
    }
    if !token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Some("letters, digits, underscores and slashes are allowed");
    }
    if token.contains("__") {
        return Some("two underscores in a row are not allowed");
    }
    None
}

fn name_error(name: &str, reason: &str) -> RosError {
    RosError::Name { name: name.to_string(), reason: reason.to_string() }
}

/// A node's base name: one token.
pub(crate) fn check_node_name(name: &str) -> Result<(), RosError> {
    if name.is_empty()
        || name.starts_with(|c: char| c.is_ascii_digit())
        || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    {
        return Err(name_error(name, "a node's name is letters, digits and underscores, not beginning with a digit"));
    }
    Ok(())
}

/// What [`check_prefix`] allows, for people.
pub const PREFIX_RULE: &str = "letters, digits, underscores and slashes";

/// Whether a text can stand before names of joints or frames.
///
/// # Errors
/// One sentence for people.
#[allow(clippy::ptr_arg)] // a parameter's validator gets what the parameter holds
pub fn check_prefix(prefix: &String) -> Result<(), String> {
    if prefix.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '/') {
        Ok(())
    } else {
        Err(format!("expected {PREFIX_RULE}, got {prefix:?}"))
    }
}

/// A namespace in its full form: `/` or `/a/b`. ROS 2 puts a missing first slash itself.
pub(crate) fn full_namespace(namespace: &str) -> Result<String, RosError> {
    let trimmed = namespace.strip_prefix('/').unwrap_or(namespace);
    if trimmed.is_empty() {
        return Ok("/".to_string());
    }
    match trimmed.split('/').find_map(token_problem) {
        Some(problem) => Err(name_error(namespace, problem)),
        None => Ok(format!("/{trimmed}")),
    }
}

/// Expands `name` for a node: `~` is the node's own name, `{node}`, `{ns}` and `{namespace}` are replaced, a relative
/// name is put in the namespace. The result begins with a slash.
pub(crate) fn expand(name: &str, namespace: &str, node: &str) -> Result<String, RosError> {
    let prefix = if namespace == "/" { "" } else { namespace };
    let replaced = name
        .replace("{node}", node)
        .replace("{namespace}", prefix.trim_start_matches('/'))
        .replace("{ns}", prefix.trim_start_matches('/'));
    let full = if let Some(rest) = replaced.strip_prefix('~') {
        match rest.strip_prefix('/') {
            Some(rest) => format!("{prefix}/{node}/{rest}"),
            None if rest.is_empty() => format!("{prefix}/{node}"),
            None => return Err(name_error(name, "a slash must follow the tilde")),
        }
    } else if replaced.starts_with('/') {
        replaced
    } else {
        format!("{prefix}/{replaced}")
    };
    match full[1..].split('/').find_map(token_problem) {
        Some(problem) => Err(name_error(name, problem)),
        None => Ok(full),
    }
}

/// One `from:=to` rule of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Remap {
    /// Applies only to the node of this name.
    pub(crate) node: Option<String>,
    pub(crate) kind: RemapKind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RemapKind {
    NodeName(String),
    Namespace(String),
    Topic { from: String, to: String },
    Service { from: String, to: String },
    TopicOrService { from: String, to: String },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Subject {
    Topic,
    Service,
}

/// The full name of a topic or service after the first rule that matches.
pub(crate) fn resolve(
    name: &str,
    subject: Subject,
    namespace: &str,
    node: &str,
    rules: &[Remap],
) -> Result<String, RosError> {
    let full = expand(name, namespace, node)?;
    for rule in rules {
        if rule.node.as_deref().is_some_and(|only| only != node) {
            continue;
        }
        let (from, to) = match &rule.kind {
            RemapKind::TopicOrService { from, to } => (from, to),
            RemapKind::Topic { from, to } if subject == Subject::Topic => (from, to),
            RemapKind::Service { from, to } if subject == Subject::Service => (from, to),
            _ => continue,
        };
        if expand(from, namespace, node)? == full {
            return expand(to, namespace, node);
        }
    }
    Ok(full)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_expand_as_in_ros() {
        for (name, namespace, expected) in [
            ("joint_states", "/", "/joint_states"),
            ("joint_states", "/robot", "/robot/joint_states"),
            ("/joint_states", "/robot", "/joint_states"),
            ("~/state", "/robot", "/robot/walker/state"),
            ("~", "/", "/walker"),
            ("{ns}/a", "/robot", "/robot/robot/a"),
            ("/{node}/a", "/robot", "/walker/a"),
            ("a/b", "/x/y", "/x/y/a/b"),
        ] {
            assert_eq!(expand(name, namespace, "walker").unwrap(), expected, "{name} in {namespace}");
        }
        for bad in ["", "/", "a//b", "a/", "1a", "a b", "a__b", "~a", "a/{x}"] {
            assert!(expand(bad, "/", "walker").is_err(), "{bad:?} must be refused");
        }
    }

    #[test]
    fn the_first_matching_rule_counts() {
        let rule = |from: &str, to: &str| Remap {
            node: None,
            kind: RemapKind::TopicOrService { from: from.to_string(), to: to.to_string() },
        };
        let rules = [rule("a", "b"), rule("/n/a", "c"), rule("b", "d")];
        let resolved = |name| resolve(name, Subject::Topic, "/n", "walker", &rules).unwrap();
        assert_eq!(resolved("a"), "/n/b", "not applied twice");
        assert_eq!(resolved("/n/a"), "/n/b");
        assert_eq!(resolved("b"), "/n/d");
        assert_eq!(resolved("/a"), "/a");
    }

    #[test]
    fn rules_can_be_for_one_node_or_one_kind() {
        let rules = [
            Remap {
                node: Some("other".to_string()),
                kind: RemapKind::Topic { from: "a".to_string(), to: "b".to_string() },
            },
            Remap { node: None, kind: RemapKind::Service { from: "a".to_string(), to: "c".to_string() } },
        ];
        assert_eq!(resolve("a", Subject::Topic, "/", "walker", &rules).unwrap(), "/a");
        assert_eq!(resolve("a", Subject::Service, "/", "walker", &rules).unwrap(), "/c");
        assert_eq!(resolve("a", Subject::Topic, "/", "other", &rules).unwrap(), "/b");
    }

    #[test]
    fn namespaces_get_their_slash() {
        assert_eq!(full_namespace("robot").unwrap(), "/robot");
        assert_eq!(full_namespace("/robot/a").unwrap(), "/robot/a");
        assert_eq!(full_namespace("").unwrap(), "/");
        assert_eq!(full_namespace("/").unwrap(), "/");
        assert!(full_namespace("/a/").is_err());
        assert!(full_namespace("/a b").is_err());
    }
}
