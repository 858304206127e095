//! Parameter files.

use serde_yaml_ng::Value as Yaml;

use super::value::ParameterValue;

const PARAMETERS_KEY: &str = "ros__parameters";

/// A value for a parameter from the command line or a file, and the nodes that it is for.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Override {
    /// A node's full name, in which `*` stands for one part and `**` for any number.
    pub(crate) node: String,
    pub(crate) name: String,
    pub(crate) value: ParameterValue,
}

/// The values of a parameter file: node names (nested by namespace if one likes), `ros__parameters`, values nested by
/// dots.
pub(crate) fn overrides_from_yaml(text: &str) -> Result<Vec<Override>, String> {
    let document: Yaml = serde_yaml_ng::from_str(text).map_err(|error| format!("not YAML: {error}"))?;
    let Yaml::Mapping(nodes) = document else {
        return Err(format!("expected 'NODE: {{{PARAMETERS_KEY}: {{NAME: VALUE}}}}'"));
    };
    let mut overrides = Vec::new();
    nodes_of(&nodes, "", &mut overrides)?;
    Ok(overrides)
}

fn key(yaml: &Yaml) -> Result<String, String> {
    match yaml {
        Yaml::String(text) => Ok(text.clone()),
        Yaml::Bool(value) => Ok(value.to_string()),
        Yaml::Number(value) => Ok(value.to_string()),
        _ => Err("a key must be a name".to_string()),
    }
}

fn nodes_of(nodes: &serde_yaml_ng::Mapping, namespace: &str, overrides: &mut Vec<Override>) -> Result<(), String> {
    for (name, content) in nodes {
        let name = key(name)?;
        if name == PARAMETERS_KEY {
            let Yaml::Mapping(values) = content else {
                return Err(format!("{namespace}: {PARAMETERS_KEY} must hold 'NAME: VALUE'"));
            };
            if namespace.is_empty() {
                return Err(format!("{PARAMETERS_KEY} must stand below a node's name"));
            }
            values_of(values, "", namespace, overrides)?;
        } else {
            let full = format!("{namespace}/{}", name.trim_matches('/'));
            let Yaml::Mapping(inner) = content else {
                return Err(format!("{full}: expected '{PARAMETERS_KEY}:' below it"));
            };
            nodes_of(inner, &full, overrides)?;
        }
    }
    Ok(())
}

fn values_of(
    values: &serde_yaml_ng::Mapping,
    prefix: &str,
    node: &str,
    overrides: &mut Vec<Override>,
) -> Result<(), String> {
    for (name, value) in values {
        let name = format!("{prefix}{}", key(name)?);
        if let Yaml::Mapping(inner) = value {
            values_of(inner, &format!("{name}."), node, overrides)?;
        } else {
            overrides.push(Override {
                node: node.to_string(),
                value: ParameterValue::from_yaml(value).map_err(|reason| format!("{node}: {name}: {reason}"))?,
                name,
            });
        }
    }
    Ok(())
}
