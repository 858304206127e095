//! The command line (`--ros-args`) and the environment of a ROS 2 process.

use std::path::{Path, PathBuf};

use crate::RosError;
use crate::log_file::LogFileChoice;
use crate::names::{Remap, RemapKind, check_node_name, expand, full_namespace};
use crate::parameters::{Override, ParameterValue, overrides_from_yaml};
use crate::security::Security;

/// How far a node looks for others (`ROS_AUTOMATIC_DISCOVERY_RANGE`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DiscoveryRange {
    /// Every network interface.
    Subnet,
    /// This machine only, over its loopback interface.
    Localhost,
}

/// What the command line and the environment say about a node.
#[derive(Clone, Debug)]
pub struct Arguments {
    pub(crate) remaps: Vec<Remap>,
    pub(crate) overrides: Vec<Override>,
    pub(crate) log_level: Option<String>,
    pub(crate) logger_levels: Vec<(String, String)>,
    pub(crate) rosout: bool,
    pub(crate) log_file: LogFileChoice,
    pub(crate) domain_id: u16,
    pub(crate) range: DiscoveryRange,
    pub(crate) security: Security,
    /// A panic in any thread ends the process.
    pub(crate) supervised: bool,
}

impl Default for Arguments {
    /// No arguments, domain 0, this machine only.
    fn default() -> Self {
        Arguments {
            remaps: Vec::new(),
            overrides: Vec::new(),
            log_level: None,
            logger_levels: Vec::new(),
            rosout: true,
            log_file: LogFileChoice::default(),
            domain_id: 0,
            range: DiscoveryRange::Localhost,
            security: Security::Off,
            supervised: false,
        }
    }
}

impl Arguments {
    /// Reads the process's own command line and environment. The second part is what stands outside `--ros-args`,
    /// program name first, as an argument parser wants it.
    ///
    /// # Errors
    /// Names the first argument, file or variable that is not understood.
    pub fn from_process() -> Result<(Self, Vec<String>), RosError> {
        let (arguments, rest) = Self::from_line(std::env::args())?;
        Ok((arguments.supervised(), rest))
    }

    /// As [`Arguments::from_process`] from given arguments (the program's name first): for programs that are more than
    /// a node.
    ///
    /// # Errors
    /// Names the first argument, file or variable that is not understood.
    pub fn from_line(line: impl IntoIterator<Item = String>) -> Result<(Self, Vec<String>), RosError> {
        // What is not Unicode is not taken for unset: each reader refuses the replaced characters by the variable's
        // name.
        Self::parse(line, |name| Some(std::env::var_os(name)?.to_string_lossy().into_owned()))
    }

    /// For a program that is a node and nothing else, as [`Arguments::from_process`] makes it: a panic in any thread of
    /// the process is the node's failure and ends it with an error.
    #[must_use]
    pub fn supervised(mut self) -> Self {
        self.supervised = true;
        self
    }

    /// As [`Arguments::from_process`] from given arguments (the program's name first) and environment.
    ///
    /// # Errors
    /// Names the first argument, file or variable that is not understood.
    pub fn parse(
        arguments: impl IntoIterator<Item = String>,
        environment: impl Fn(&str) -> Option<String>,
    ) -> Result<(Self, Vec<String>), RosError> {
        let mut enclave = None;
        let mut parsed = Arguments {
            domain_id: domain_id(&environment)?,
            range: discovery_range(&environment)?,
            ..Arguments::default()
        };
        let mut rest = Vec::new();
        let mut arguments = arguments.into_iter();
        rest.extend(arguments.next());
        let mut ours = false;
        while let Some(argument) = arguments.next() {
            if !ours {
                if argument == "--ros-args" {
                    ours = true;
                } else {
                    rest.push(argument);
                }
                continue;
            }
            let mut value = || {
                arguments.next().ok_or_else(|| RosError::Argument {
                    argument: argument.clone(),
                    reason: "a value must follow".to_string(),
                })
            };
            match argument.as_str() {
                "--ros-args" => {}
                "--" => ours = false,
                "-r" | "--remap" => parsed.remaps.push(remap(&value()?)?),
                "-p" | "--param" => {
                    let text = value()?;
                    parsed.overrides.push(parameter(&text)?);
                }
                "--params-file" => {
                    let path = PathBuf::from(value()?);
                    parsed.overrides.extend(parameters_file(&path)?);
                }
                "--log-level" => {
                    let text = value()?;
                    parsed.set_log_level(&text)?;
                }
                // It names what security would use and does not ask for it: every ROS 2 launch file may give it.
                "-e" | "--enclave" => enclave = Some(value()?),
                "--enable-rosout-logs" | "--disable-rosout-logs" => parsed.rosout = argument.starts_with("--enable"),
                "--enable-stdout-logs" | "--disable-stdout-logs" => {}
                "--enable-external-lib-logs" => parsed.log_file.wanted = true,
                "--disable-external-lib-logs" => parsed.log_file.wanted = false,
                "--log-file-name" => parsed.log_file.rename(value()?)?,
                other => {
                    return Err(RosError::Argument {
                        argument: other.to_string(),
                        reason: "not known after --ros-args (known: -r, -p, --params-file, --log-level, -e, \
                                 --log-file-name, --enable-/--disable-rosout-logs and -external-lib-logs)"
                            .to_string(),
                    });
                }
            }
        }
        parsed.security = Security::find(&environment, enclave.as_deref())?;
        Ok((parsed, rest))
    }

    /// From `LEVEL` or `LOGGER:=LEVEL`.
    fn set_log_level(&mut self, text: &str) -> Result<(), RosError> {
        match text.split_once(":=") {
            Some((logger, level)) => self.logger_levels.push((logger.to_string(), log_level(text, level)?)),
            None => self.log_level = Some(log_level(text, text)?),
        }
        Ok(())
    }

    /// The same with another domain id.
    #[must_use]
    pub fn with_domain_id(mut self, domain_id: u16) -> Self {
        self.domain_id = domain_id;
        self
    }

    /// The same with another discovery range.
    #[must_use]
    pub fn with_range(mut self, range: DiscoveryRange) -> Self {
        self.range = range;
        self
    }

    /// The node's name and full namespace after `__node` and `__ns`.
    pub(crate) fn node_name(&self, name: &str, namespace: &str) -> Result<(String, String), RosError> {
        let mut node = None;
        let mut space = None;
        for rule in &self.remaps {
            if rule.node.as_deref().is_some_and(|only| only != name) {
                continue;
            }
            match &rule.kind {
                RemapKind::NodeName(to) if node.is_none() => node = Some(to.clone()),
                RemapKind::Namespace(to) if space.is_none() => space = Some(to.clone()),
                _ => {}
            }
        }
        let node = node.unwrap_or_else(|| name.to_string());
        check_node_name(&node)?;
        Ok((node, full_namespace(space.as_deref().unwrap_or(namespace))?))
    }
}

fn domain_id(environment: &impl Fn(&str) -> Option<String>) -> Result<u16, RosError> {
    match environment("ROS_DOMAIN_ID").filter(|value| !value.is_empty()) {
        None => Ok(0),
        Some(value) => match value.parse() {
            Ok(id @ 0..=232) => Ok(id),
            _ => Err(RosError::Environment {
                name: "ROS_DOMAIN_ID",
                value,
                reason: "expected a number from 0 to 232 (0 to 101 is safe on Linux)".to_string(),
            }),
        },
    }
}

fn discovery_range(environment: &impl Fn(&str) -> Option<String>) -> Result<DiscoveryRange, RosError> {
    if let Some(value) = environment("ROS_LOCALHOST_ONLY").filter(|value| !value.is_empty()) {
        // As in ROS 2: where the old variable is switched on it wins.
        match value.as_str() {
            "1" => return Ok(DiscoveryRange::Localhost),
            "0" => {}
            _ => {
                return Err(RosError::Environment {
                    name: "ROS_LOCALHOST_ONLY",
                    value,
                    reason: "expected 0 or 1".to_string(),
                });
            }
        }
    }
    match environment("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
        None | Some("" | "SUBNET" | "SYSTEM_DEFAULT") => Ok(DiscoveryRange::Subnet),
        Some("LOCALHOST") => Ok(DiscoveryRange::Localhost),
        Some(other) => Err(RosError::Environment {
            name: "ROS_AUTOMATIC_DISCOVERY_RANGE",
            value: other.to_string(),
            reason: "expected SUBNET or LOCALHOST (OFF and static peers are not supported by this middleware)"
                .to_string(),
        }),
    }
}

fn log_level(argument: &str, level: &str) -> Result<String, RosError> {
    match level.to_ascii_lowercase().as_str() {
        "debug" => Ok("debug".to_string()),
        "info" => Ok("info".to_string()),
        "warn" => Ok("warn".to_string()),
        "error" | "fatal" => Ok("error".to_string()),
        _ => Err(RosError::Argument {
            argument: format!("--log-level {argument}"),
            reason: "expected debug, info, warn, error or fatal, or LOGGER:=LEVEL".to_string(),
        }),
    }
}

/// `[node:]from:=to`
fn remap(text: &str) -> Result<Remap, RosError> {
    let wrong = |reason: &str| RosError::Argument { argument: format!("-r {text}"), reason: reason.to_string() };
    let (from, to) = text.split_once(":=").ok_or_else(|| wrong("expected FROM:=TO"))?;
    if from.is_empty() || to.is_empty() {
        return Err(wrong("expected FROM:=TO, both sides present"));
    }
    // Whatever the node, both sides must be names. (Only names in programs have substitutions in braces.)
    let check = |name: &str| match expand(name, "/", "node") {
        _ if name.contains('{') => Err(wrong("braces are not allowed here")),
        Ok(_) => Ok(name.to_string()),
        Err(error) => Err(wrong(&error.to_string())),
    };
    for (scheme, is_topic) in [("rostopic://", true), ("rosservice://", false)] {
        if let Some(from) = from.strip_prefix(scheme) {
            let (from, to) = (check(from)?, check(to)?);
            return Ok(Remap {
                node: None,
                kind: if is_topic { RemapKind::Topic { from, to } } else { RemapKind::Service { from, to } },
            });
        }
    }
    let (node, from) = match from.split_once(':') {
        Some((node, from)) => {
            check_node_name(node).map_err(|error| wrong(&error.to_string()))?;
            (Some(node.to_string()), from)
        }
        None => (None, from),
    };
    let kind = match from {
        "__node" | "__name" => {
            check_node_name(to).map_err(|error| wrong(&error.to_string()))?;
            RemapKind::NodeName(to.to_string())
        }
        "__ns" => {
            if !to.starts_with('/') {
                return Err(wrong("a namespace must begin with a slash"));
            }
            full_namespace(to).map_err(|error| wrong(&error.to_string()))?;
            RemapKind::Namespace(to.to_string())
        }
        _ => RemapKind::TopicOrService { from: check(from)?, to: check(to)? },
    };
    Ok(Remap { node, kind })
}

/// `[node:]name:=value`
fn parameter(text: &str) -> Result<Override, RosError> {
    let wrong = |reason: String| RosError::Argument { argument: format!("-p {text}"), reason };
    let (name, value) = text.split_once(":=").ok_or_else(|| wrong("expected NAME:=VALUE".to_string()))?;
    let (node, name) = match name.split_once(':') {
        Some((node, _)) if check_node_name(node).is_err() => {
            return Err(wrong(format!(
                "the node is \"{node}\"; expected its name alone, without namespace or wildcards (those are for --params-file)"
            )));
        }
        Some((node, name)) => (format!("/**/{node}"), name),
        None => ("/**".to_string(), name),
    };
    if name.is_empty() {
        return Err(wrong("expected NAME:=VALUE".to_string()));
    }
    let value = serde_yaml_ng::from_str(value)
        .map_err(|error| wrong(format!("the value is not YAML: {error}")))
        .and_then(|value| ParameterValue::from_yaml(&value).map_err(wrong))?;
    Ok(Override { node, name: name.to_string(), value })
}

fn parameters_file(path: &Path) -> Result<Vec<Override>, RosError> {
    let wrong = |reason: String| RosError::Argument { argument: format!("--params-file {}", path.display()), reason };
    let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    overrides_from_yaml(&text).map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<(Arguments, Vec<String>), RosError> {
        Arguments::parse(line.split_whitespace().map(str::to_string), |_| None)
    }

    fn message(result: Result<(Arguments, Vec<String>), RosError>) -> String {
        result.expect_err("must be refused").to_string()
    }

    #[test]
    fn arguments_of_the_program_are_left_alone() {
        let (arguments, rest) =
            parse("program --seconds 5 --ros-args -r __node:=walker -- --verbose --ros-args -p a:=1").unwrap();
        assert_eq!(rest, ["program", "--seconds", "5", "--verbose"]);
        assert_eq!(arguments.node_name("controller", "/").unwrap(), ("walker".to_string(), "/".to_string()));
        assert_eq!(arguments.overrides[0].value, ParameterValue::Integer(1));
    }

    #[test]
    fn names_and_namespaces_are_remapped() {
        let (arguments, _) =
            parse("p --ros-args -r other:__node:=x -r controller:__ns:=/robot -r __ns:=/late").unwrap();
        assert_eq!(arguments.node_name("controller", "/").unwrap(), ("controller".to_string(), "/robot".to_string()));
        assert_eq!(arguments.node_name("other", "/").unwrap().0, "x");
    }

    #[test]
    fn wrong_arguments_are_named() {
        assert!(message(parse("p --ros-args --speed 3")).contains("\"--speed\""));
        assert!(message(parse("p --ros-args -r ab")).contains("FROM:=TO"));
        assert!(message(parse("p --ros-args -r")).contains("a value must follow"));
        assert!(message(parse("p --ros-args -r __ns:=/a//b")).contains("/a//b"));
        assert!(message(parse("p --ros-args -p a")).contains("NAME:=VALUE"));
        assert!(message(parse("p --ros-args -p a:=[1,x]")).contains("one type"));
        assert!(message(parse("p --ros-args --log-level loud")).contains("loud"));
        assert!(message(parse("p --ros-args --params-file /nowhere.yaml")).contains("/nowhere.yaml"));
    }

    #[test]
    fn the_environment_is_read() {
        let with = |name: &'static str, value: &'static str| {
            Arguments::parse(["p".to_string()], move |asked| (asked == name).then(|| value.to_string()))
        };
        assert_eq!(with("ROS_DOMAIN_ID", "42").unwrap().0.domain_id, 42);
        assert_eq!(with("ROS_DOMAIN_ID", "").unwrap().0.domain_id, 0);
        assert!(message(with("ROS_DOMAIN_ID", "233")).contains("ROS_DOMAIN_ID=233"));
        assert!(message(with("ROS_DOMAIN_ID", "x")).contains("0 to 232"));
        assert_eq!(with("ROS_LOCALHOST_ONLY", "1").unwrap().0.range, DiscoveryRange::Localhost);
        assert_eq!(with("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").unwrap().0.range, DiscoveryRange::Localhost);
        assert_eq!(with("NOTHING", "").unwrap().0.range, DiscoveryRange::Subnet);
        assert!(message(with("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")).contains("OFF"));
    }

    #[test]
    fn an_enclave_alone_asks_for_nothing() {
        let (arguments, _) = parse("p --ros-args -e /robot --enclave /robot").unwrap();
        assert_eq!(arguments.security, Security::Off);
    }
}
